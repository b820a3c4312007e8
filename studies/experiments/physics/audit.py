"""Replays recorded controls in MuJoCo's own Python and measures penetration, forces and velocities.

    python audit.py FOLDER [FOLDER ...]

A FOLDER is written by the example record_controls of mishandle-studies. Needs mujoco and numpy, nothing of this project.

A pair of bodies is in an impact during the first 20 ms of a contact and in sustained contact after that. Depths are those between the
shapes as drawn (no scene uses margins). Forces are sums of the normal forces of a pair.
"""

import json
import sys
from pathlib import Path

import mujoco
import numpy as np

IMPACT = 0.020  # s
LOAD = 140.0  # N
VELOCITY_LIMIT = np.array([2.175] * 4 + [2.61] * 3 + [0.2] * 2)


def body_of(model: mujoco.MjModel, geom: int) -> int:
    """Returns the body of a geom, or its first ancestor with a name."""
    body = model.geom_bodyid[geom]
    while body and not model.body(body).name:
        body = model.body_parentid[body]
    return body


def size_of(model: mujoco.MjModel, geom: int) -> float:
    """Returns the smallest extent of a geom, m."""
    size, kind = model.geom_size[geom], model.geom_type[geom]
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return np.inf
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return 2 * size.min()
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return 2 * size[:2].min()
    return 2 * size[0]


def point_speed(model: mujoco.MjModel, data: mujoco.MjData, body: int, point: np.ndarray) -> np.ndarray:
    """Returns the velocity of a point of a body, m/s."""
    if model.body_weldid[body] == 0:
        return np.zeros(3)
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, point, body)
    return jacobian @ data.qvel


class Audit:
    def __init__(self, folder: Path) -> None:
        self.header = json.loads((folder / "header.json").read_text())
        self.model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
        self.model.opt.timestep = 1 / 60 / self.header["substeps"]
        self.data = mujoco.MjData(self.model)
        self.numbers = np.fromfile(folder / "controls.f64", dtype="<f8")
        model = self.model
        names = [model.body(b).name for b in range(model.nbody)]
        self.name = [names[body_of(model, g)] or "world" for g in range(model.ngeom)]
        self.size = [size_of(model, g) for g in range(model.ngeom)]
        robot = {"link%d" % i for i in range(8)} | {"hand", "left_finger", "right_finger"}
        self.is_robot = [name in robot for name in self.name]
        self.welds = [e for e in range(model.neq) if model.eq_type[e] != mujoco.mjtEq.mjEQ_FLEX]

    def episodes(self):
        header, model, data = self.header, self.model, self.data
        steps = header["steps"] * header["substeps"]
        per_step = header["controls"] + 1
        stride = header["state"] + steps * per_step
        for episode in range(header["episodes"]):
            row = self.numbers[episode * stride :][:stride]
            mujoco.mj_setState(model, data, row[: header["state"]], mujoco.mjtState.mjSTATE_INTEGRATION)
            yield row[header["state"] :].reshape(steps, per_step)

    def run(self) -> dict:
        model, data, h = self.model, self.data, self.model.opt.timestep
        sustained, impacts, loaded, worst = [], [], {}, {}
        speed = np.zeros(9)
        force_of = np.zeros(6)
        forces = {"fixture": [], "ground": [], "self": []}
        for controls in self.episodes():
            deepest, since = 0.0, {}
            largest = dict.fromkeys(forces, 0.0)
            for row in controls:
                data.ctrl[:9] = row[:9]
                if not row[9]:
                    for weld in self.welds:
                        data.eq_active[weld] = 0
                before = data.qvel.copy()
                mujoco.mj_step(model, data)
                speed = np.maximum(speed, np.abs(data.qvel[:9]) / VELOCITY_LIMIT)
                pairs: dict = {}
                for i in range(data.ncon):
                    contact = data.contact[i]
                    if contact.geom1 < 0 or contact.geom2 < 0:
                        continue
                    mujoco.mj_contactForce(model, data, i, force_of)
                    key = (self.name[contact.geom1], self.name[contact.geom2])
                    pair = pairs.setdefault(key, [0.0, 0.0, None])
                    pair[1] += force_of[0]
                    if -contact.dist > pair[0]:
                        pair[0], pair[2] = -contact.dist, contact
                now = {}
                classes = dict.fromkeys(forces, 0.0)
                for key, (depth, force, contact) in pairs.items():
                    if contact is None:
                        continue
                    g1, g2 = contact.geom1, contact.geom2
                    if key in since:
                        start, speed_in = since[key]
                    else:
                        after, data.qvel[:] = data.qvel.copy(), before
                        relative = point_speed(model, data, model.geom_bodyid[g2], contact.pos) - point_speed(
                            model, data, model.geom_bodyid[g1], contact.pos
                        )
                        data.qvel[:] = after
                        start, speed_in = data.time, abs(relative @ contact.frame[:3])
                    now[key] = (start, speed_in)
                    if data.time - start >= IMPACT:
                        if force <= LOAD:
                            deepest = max(deepest, depth)
                            if depth > loaded.get(key, (0,))[0]:
                                loaded[key] = (depth, force)
                        elif depth > worst.get(key, (0,))[0]:
                            worst[key] = (depth, force)
                    else:
                        bound = max(0.003, speed_in * h)
                        share = depth / min(bound, 0.25 * min(self.size[g1], self.size[g2]))
                        impacts.append((share, depth, speed_in, force, key))
                    robots = self.is_robot[g1] + self.is_robot[g2]
                    if robots == 2:
                        classes["self"] += force
                    elif robots == 1:
                        other = g2 if self.is_robot[g1] else g1
                        if model.geom_type[other] == mujoco.mjtGeom.mjGEOM_PLANE:
                            classes["ground"] += force
                        elif model.body_weldid[model.geom_bodyid[other]] == 0 or model.body_mocapid[
                            model.body_rootid[model.geom_bodyid[other]]
                        ] >= 0:
                            classes["fixture"] += force
                since = now
                for name in largest:
                    largest[name] = max(largest[name], classes[name])
            sustained.append(deepest)
            for name in forces:
                forces[name].append(largest[name])
        return {
            "sustained": np.array(sustained),
            "impacts": sorted(impacts, key=lambda impact: -impact[0]),
            "loaded": loaded,
            "worst": worst,
            "speed": speed,
            "forces": forces,
        }


def main() -> None:
    for folder in map(Path, sys.argv[1:]):
        audit = Audit(folder)
        result = audit.run()
        s = 1e3 * result["sustained"]
        header = audit.header
        print(f"{folder.name}: {header['episodes']} episodes, {header['substeps']} substeps, success {header['success']}, strict {header['strict']}")
        print(f"  sustained contact up to {LOAD:.0f} N: deepest {np.median(s):.2f} mm (median over episodes), {s.max():.2f} mm (largest)")
        for key, (depth, force) in sorted(result["loaded"].items(), key=lambda item: -item[1][0])[:4]:
            print(f"    {key[0]} and {key[1]}: {1e3 * depth:.2f} mm at {force:.1f} N")
        for key, (depth, force) in sorted(result["worst"].items(), key=lambda item: -item[1][0])[:3]:
            print(f"    above {LOAD:.0f} N: {key[0]} and {key[1]}: {1e3 * depth:.2f} mm at {force:.0f} N")
        seen = set()
        for share, depth, v, force, key in result["impacts"]:
            if key not in seen and len(seen) < 4:
                seen.add(key)
                print(f"    impact {key[0]} and {key[1]}: {1e3 * depth:.2f} mm at {v:.2f} m/s, {100 * share:.0f} % of its bound, {force:.0f} N")
        print("  largest force on the robot, N (median, largest): " + "; ".join(
            f"{name} {np.median(values):.0f}, {max(values):.0f}" for name, values in result["forces"].items()))
        print(f"  joint speed over its limit: {result['speed'][:7].max():.3f}", flush=True)


if __name__ == "__main__":
    main()
