"""Recordings for Rerun (https://rerun.io): ``pip install '.[rerun]'`` in a clone of Mishandle.

Rerun and MuJoCo are imported when :func:`to_rerun` is called.
"""

import math
import os
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.base.documents import Call, Plan
from mishandle.base.files import PathLike
from mishandle.base.packages import needed
from mishandle.errors import InvalidValueError
from mishandle.logs.online import OnlineMonitor
from mishandle.runs.run_files import HasPath

TIMELINE = "time"
"""Timeline of all entities: seconds from the start of an episode."""

ROOTS = ("failure", "nominal")
"""Entities of the recorded simulation and of the nominal scenario."""

_FORCE = 0.001
"""Length of a contact force, m/N."""

_HIDDEN_GROUP = 3
"""First group of geoms that MuJoCo's viewer hides: collision geoms."""

_PLANE = 5.0
"""Half size of an infinite plane, m."""


def to_rerun(
    simulation: HasPath | PathLike, path: PathLike, *, nominal: bool = True,
    trial: int | None = None, number: int | None = None, plan: Plan | None = None
) -> pathlib.Path:
    """Writes a recorded simulation as a file for Rerun: bodies, contacts, cameras, signals and
    robustness on one timeline.

    The simulation runs again. Contact forces are those of the model of its pictures in the recorded
    states: a scenario that changes the model, such as a friction, has other forces.

    Parameters
    ----------
    simulation : Falsification, Evaluation or path
        A result or run file of a task or target file, or a counterexample file (``.json``).
    path : path
        The ``.rrd`` file; an existing file is replaced.
    nominal : bool
        Also write the nominal scenario with the same seed, in a view beside the recorded one.
    trial, number : int, optional
        The simulation of a run; by default the first counterexample, otherwise the one with the
        least robustness.
    plan : dict, optional
        Rare settings: ``controller`` and ``target`` of the table ``engine`` are the present paths
        of the run's controller and target file, if they were moved.

    Notes
    -----
    Below ``failure`` and ``nominal`` are ``bodies/NAME``, ``contacts``, ``cameras/NAME``,
    ``signals/NAME``, and ``robustness/low`` and ``robustness/high``: the least and the greatest
    robustness of the formula over all continuations of the episode up to this sample. They are
    missing where they are infinite.
    """
    rr, mujoco = _packages()
    file = pathlib.Path(path)
    if file.suffix.lower() != ".rrd":
        raise InvalidValueError(f"the file is {os.fspath(path)}; its name must end with .rrd")
    source = simulation if isinstance(simulation, (str, os.PathLike)) else simulation.path
    scene = _native.recorded_states(
        os.fspath(source), Call("to_rerun", {"plan": plan}).text(), trial=trial, number=number,
        nominal=nominal
    )
    if scene["differences"]:
        raise InvalidValueError(
            "the replay differs from the record: " + "; ".join(scene["differences"])
        )
    model = mujoco.MjModel.from_binary_path("scene.mjb", {"scene.mjb": scene["model"]})
    recording = rr.RecordingStream(
        "mishandle", recording_id=f"{scene['target']}-{scene['place'][0]}-{scene['place'][1]}"
    )
    # The only timeline is that of the simulation.
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    file.parent.mkdir(parents=True, exist_ok=True)
    roots = ROOTS[: len(scene["episodes"])]
    recording.save(file, default_blueprint=_blueprint(roots))
    for root, episode in zip(roots, scene["episodes"]):
        _Episode(rr, mujoco, recording, root, model, scene, episode).log()
    recording.flush()
    recording.disconnect()
    return file


def _packages() -> tuple[Any, Any]:
    with needed("recordings for Rerun need rerun-sdk and mujoco", "rerun"):
        import mujoco
        import rerun
    return rerun, mujoco


def _blueprint(roots: Sequence[str]) -> Any:
    """Scenes side by side, and below them signals and robustness of both."""
    import rerun.blueprint as rrb

    scenes = [rrb.Spatial3DView(origin=f"/{root}", name=root) for root in roots]
    contents = [f"/{root}/{part}/**" for root in roots for part in ("robustness",)]
    charts = [
        rrb.TimeSeriesView(origin="/", contents=contents, name="robustness"),
        *(rrb.TimeSeriesView(origin=f"/{root}/signals", name=f"signals, {root}") for root in roots),
    ]
    return rrb.Blueprint(
        rrb.Vertical(rrb.Horizontal(*scenes), rrb.Horizontal(*charts), row_shares=[3, 2]),
        collapse_panels=True
    )


class _Episode:
    """An episode below the entity ``root``."""

    def __init__(
        self, rr: Any, mujoco: Any, recording: Any, root: str, model: Any, scene: dict[str, Any],
        episode: dict[str, Any]
    ) -> None:
        self.rr, self.mujoco, self.recording = rr, mujoco, recording
        self.root, self.model, self.scene, self.episode = root, model, scene, episode
        self.data = mujoco.MjData(model)

    def log(self) -> None:
        self.facts()
        self.shapes()
        self.motion()
        self.signals()
        self.robustness()

    def entity(self, *parts: str) -> str:
        return str(self.rr.new_entity_path([self.root, *parts]))

    def static(self, parts: Sequence[str], *what: Any) -> None:
        self.recording.log(self.entity(*parts), *what, static=True)

    def columns(self, parts: Sequence[str], samples: NDArray[np.intp], columns: Any) -> None:
        """Logs a value of each of these samples."""
        times = samples * self.scene["control_dt"]
        self.recording.send_columns(
            self.entity(*parts), [self.rr.TimeColumn(TIMELINE, duration=times)], columns
        )

    def facts(self) -> None:
        lines = [
            f"formula `{self.scene['formula']}`", f"robustness {self.episode['robustness']}",
            f"seed {self.episode['seed']}", ""
        ]
        for (name, unit), value in zip(self.scene["axes"], self.episode["scenario"]):
            lines.append(f"- {name} = {'random' if value is None else value} {unit}".rstrip())
        self.static(
            ["scenario"], self.rr.TextDocument("\n".join(lines), media_type="text/markdown")
        )
        self.static([], self.rr.ViewCoordinates.RIGHT_HAND_Z_UP)

    def body(self, index: int) -> str:
        return self.model.body(index).name or f"body {index}"

    def shapes(self) -> None:
        for index in range(self.model.ngeom):
            if self.model.geom_group[index] >= _HIDDEN_GROUP or self.model.geom_rgba[index][3] == 0:
                continue
            shape = self.shape(index)
            if shape is None:
                continue
            parts = [
                "bodies", self.body(int(self.model.geom_bodyid[index])),
                self.model.geom(index).name or f"geom {index}"
            ]
            pose = self.pose(self.model.geom_pos[index], self.model.geom_quat[index])
            self.static(parts, pose, shape)
        for index in range(self.model.ncam):
            parts = ["cameras", self.model.camera(index).name or f"camera {index}"]
            pinhole = self.rr.Pinhole(
                fov_y=math.radians(float(self.model.cam_fovy[index])), aspect_ratio=4 / 3,
                camera_xyz=self.rr.ViewCoordinates.RUB, image_plane_distance=0.2
            )
            self.static(parts, pinhole)

    def pose(self, position: Any, quaternion: Any) -> Any:
        w, x, y, z = quaternion
        return self.rr.Transform3D(
            translation=position, quaternion=self.rr.Quaternion(xyzw=[x, y, z, w])
        )

    def shape(self, index: int) -> Any:
        """Returns a geom as a shape of Rerun; None if Rerun has none for it."""
        rr, kinds = self.rr, self.mujoco.mjtGeom
        kind, size = int(self.model.geom_type[index]), self.model.geom_size[index]
        color = (255 * self.color(index)).astype(np.uint8)
        solid = rr.components.FillMode.Solid
        if kind == kinds.mjGEOM_SPHERE:
            return rr.Ellipsoids3D(half_sizes=[[size[0]] * 3], colors=[color], fill_mode=solid)
        if kind == kinds.mjGEOM_ELLIPSOID:
            return rr.Ellipsoids3D(half_sizes=[size], colors=[color], fill_mode=solid)
        if kind == kinds.mjGEOM_BOX:
            return rr.Boxes3D(half_sizes=[size], colors=[color], fill_mode=solid)
        if kind == kinds.mjGEOM_PLANE:
            sides = [side if side > 0 else _PLANE for side in size[:2]]
            return rr.Boxes3D(half_sizes=[[*sides, 0.0005]], colors=[color], fill_mode=solid)
        if kind == kinds.mjGEOM_CYLINDER:
            return rr.Cylinders3D(
                lengths=[2 * size[1]], radii=[size[0]], colors=[color], fill_mode=solid
            )
        if kind == kinds.mjGEOM_CAPSULE:
            # Rerun's capsule starts at its origin.
            return rr.Capsules3D(
                lengths=[2 * size[1]], radii=[size[0]], translations=[[0, 0, -size[1]]],
                colors=[color], fill_mode=solid
            )
        if kind == kinds.mjGEOM_MESH:
            return self.mesh(int(self.model.geom_dataid[index]), color)
        return None

    def color(self, index: int) -> NDArray[np.float64]:
        material = int(self.model.geom_matid[index])
        return np.asarray(
            self.model.geom_rgba[index] if material < 0 else self.model.mat_rgba[material]
        )

    def mesh(self, mesh: int, color: Any) -> Any:
        model = self.model
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        return self.rr.Mesh3D(
            vertex_positions=model.mesh_vert[first : first + count],
            triangle_indices=model.mesh_face[face : face + faces], albedo_factor=color
        )

    def motion(self) -> None:
        """Logs poses of bodies and cameras, contact forces and flexible bodies in all states."""
        model, data, states = self.model, self.data, self.episode["states"]
        kind = self.mujoco.mjtState.mjSTATE_INTEGRATION
        size = self.mujoco.mj_stateSize(model, kind)
        poses: list[Any] = []
        for sample, state in enumerate(states):
            self.mujoco.mj_setState(model, data, np.ascontiguousarray(state[:size]), kind)
            self.mujoco.mj_forward(model, data)
            poses.append([
                data.xpos.copy(), data.xquat.copy(), data.cam_xpos.copy(), data.cam_xmat.copy()
            ])
            self.recording.set_time(TIMELINE, duration=sample * self.scene["control_dt"])
            self.contacts()
            self.flexes()
        samples = np.arange(len(states))
        positions, quaternions, cameras, turns = (np.stack(list(part)) for part in zip(*poses))
        for body in range(model.nbody):
            xyzw = quaternions[:, body][:, [1, 2, 3, 0]]
            moves = self.rr.Transform3D.columns(translation=positions[:, body], quaternion=xyzw)
            self.columns(["bodies", self.body(body)], samples, moves)
        for camera in range(model.ncam):
            # MuJoCo has rows, Rerun columns.
            matrices = turns[:, camera].reshape(-1, 3, 3).transpose(0, 2, 1).reshape(-1, 9)
            moves = self.rr.Transform3D.columns(translation=cameras[:, camera], mat3x3=matrices)
            self.columns(
                ["cameras", model.camera(camera).name or f"camera {camera}"], samples, moves
            )

    def contacts(self) -> None:
        """Logs an arrow for the force at each contact point of the present state."""
        points, forces = [], []
        wrench = np.zeros(6)
        for index in range(self.data.ncon):
            contact = self.data.contact[index]
            self.mujoco.mj_contactForce(self.model, self.data, index, wrench)
            # In the frame of the contact, whose rows are its axes.
            force = wrench[:3] @ contact.frame.reshape(3, 3)
            if np.linalg.norm(force) > 0:
                points.append(contact.pos.copy())
                forces.append(force)
        vectors = np.reshape(forces, (-1, 3)) * _FORCE
        arrows = self.rr.Arrows3D(
            origins=np.reshape(points, (-1, 3)), vectors=vectors, colors=[[220, 50, 30]]
        )
        self.recording.log(self.entity("contacts"), arrows)
        largest = max((float(np.linalg.norm(force)) for force in forces), default=0.0)
        self.recording.log(self.entity("contact_force"), self.rr.Scalars(largest))

    def flexes(self) -> None:
        for flex in range(self.model.nflex):
            first, count = self.model.flex_edgeadr[flex], self.model.flex_edgenum[flex]
            vertices = self.data.flexvert_xpos[self.model.flex_vertadr[flex] :]
            strips = vertices[self.model.flex_edge[first : first + count]]
            self.recording.log(self.entity("flexes", str(flex)), self.rr.LineStrips3D(strips))

    def signals(self) -> None:
        units, trace = dict(self.scene["signals"]), self.episode["trace"]
        samples = np.arange(len(trace))
        for index, name in enumerate(self.episode["names"]):
            unit = units.get(name, "")
            self.static(
                ["signals", name], self.rr.SeriesLines(names=[f"{name} ({unit})" if unit else name])
            )
            self.columns(
                ["signals", name], samples, self.rr.Scalars.columns(scalars=trace[:, index])
            )

    def robustness(self) -> None:
        """Logs the bounds of the robustness after each sample."""
        names, trace = self.episode["names"], self.episode["trace"]
        monitor = OnlineMonitor(
            self.scene["formula"], names, period=self.scene["control_dt"],
            samples=self.scene["steps"] + 1
        )
        bounds = []
        for sample in trace:
            monitor.push(sample)
            bounds.append(monitor.bounds())
        values = np.reshape(bounds, (-1, 2))
        for column, name in enumerate(("low", "high")):
            samples = np.flatnonzero(np.isfinite(values[:, column]))
            if len(samples):
                self.static(
                    ["robustness", name], self.rr.SeriesLines(names=[f"{self.root}, {name}"])
                )
                self.columns(
                    ["robustness", name], samples,
                    self.rr.Scalars.columns(scalars=values[samples, column])
                )
