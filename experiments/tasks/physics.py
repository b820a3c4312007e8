"""Measures contacts and joint velocities of recorded episodes, in MuJoCo's Python 3.17.0.

    mishandle tasks peg-in-hole --mjcf peg-in-hole.xml
    mishandle evaluate peg-in-hole --controller ppo --episodes 20 --seed 1 --out run.sqlite
    cargo run --release --example recorded_states -- run.sqlite 20 > states.f64
    python experiments/tasks/physics.py peg-in-hole.xml states.f64

The script repeats every control step from the recorded state, with the velocity rule of the servos, and checks that the
result equals the next recorded state bit for bit. It measures after each physics step:

- force: the resultant of all contact forces (N) of the robot and the object in its hand on fixtures, that is, on everything
  except loose objects. The force of a control step is the maximum over its physics steps. The script prints the median and
  the range over the episodes of two numbers: the largest force, and the force that is reached in 30 control steps (0.5 s).
- depth: the maximum penetration of two bodies (mm), for each pair of bodies, over all episodes.
- velocity: the maximum velocity of each joint over all episodes, relative to its limit.

    python experiments/tasks/physics.py panda peg-in-hole.xml

drives the arm at full scale from its initial pose, without contacts: each joint by itself and all together in every
combination of directions, there and back; and 100 episodes in random directions, which change every 10 control steps.

    python experiments/tasks/physics.py drop cube-stacking.xml

opens the hand in its initial pose, if it holds a loose object, waits for 3 s and prints the maximum depths and those at rest.
"""

import itertools
import sys

import mujoco
import numpy as np

CONTROL_STEPS = 300
EPISODES = 100
LEAD = np.array([0.435] * 4 + [0.522] * 3 + [0.002] * 2)
LIMIT = np.array([2.175] * 4 + [2.61] * 3 + [0.2] * 2)
STATE = mujoco.mjtState.mjSTATE_INTEGRATION


def servo(data, targets):
    """Sets the setpoints of the servos: the velocity rule."""
    q = data.qpos[:9]
    data.ctrl[:9] = q + np.clip(targets - q, -LEAD, LEAD)


class Bodies:
    """The part of the scene to which each body belongs: robot, fixture or loose object."""

    def __init__(self, model):
        self.model = model
        self.robot = model.body("link0").id
        self.welds = [
            i for i in range(model.neq) if model.eq_type[i] == mujoco.mjtEq.mjEQ_WELD
        ]

    def root(self, body):
        return self.model.body_rootid[body]

    def part(self, body, data):
        root = self.root(body)
        if root == self.robot:
            return "robot"
        if any(data.eq_active[i] and self.model.eq_obj2id[i] == body for i in self.welds):
            return "robot"
        is_free = root > 0 and self.model.body_jntnum[root] > 0
        return "loose" if is_free else "fixture"

    def name(self, geom):
        body = self.model.geom_bodyid[geom]
        name = self.model.body(body).name if body else self.model.geom(geom).name
        return "cloth" if name.startswith("cloth") else name


def contact_forces(model, data, bodies, depth):
    """Returns the resultant force of the robot on fixtures and updates the maximum depth of each pair."""
    total, wrench = np.zeros(3), np.zeros(6)
    for i in range(data.ncon):
        contact = data.contact[i]
        key = "-".join(sorted(bodies.name(geom) for geom in contact.geom))
        depth[key] = max(depth.get(key, 0.0), -contact.dist)
        parts = [bodies.part(model.geom_bodyid[geom], data) for geom in contact.geom]
        if sorted(parts) == ["fixture", "robot"]:
            mujoco.mj_contactForce(model, data, i, wrench)
            sign = 1 if parts[0] == "robot" else -1
            total += sign * contact.frame.reshape(3, 3).T @ wrench[:3]
    return np.linalg.norm(total)


def episodes(model, path):
    size = mujoco.mj_stateSize(model, STATE)
    rows = np.fromfile(path).reshape(-1, CONTROL_STEPS + 1, size + 9)
    data, after, bodies = mujoco.MjData(model), mujoco.MjData(model), Bodies(model)
    steps = round(1 / 60 / model.opt.timestep)
    grasp = model.site("grasp").id
    depth, velocity, forces, lowest = {}, np.zeros(9), [], np.inf
    for episode in rows:
        forces.append([])
        for row, following in itertools.pairwise(episode):
            mujoco.mj_setState(model, data, row[:size], STATE)
            mujoco.mj_setState(model, after, following[:size], STATE)
            data.eq_active[:] = after.eq_active
            strongest = 0.0
            for _ in range(steps):
                servo(data, following[size:])
                mujoco.mj_step(model, data)
                velocity = np.maximum(velocity, np.abs(data.qvel[:9]) / LIMIT)
                lowest = min(lowest, data.site_xpos[grasp][2])
                strongest = max(strongest, contact_forces(model, data, bodies, depth))
            forces[-1].append(strongest)
            state = np.zeros(size)
            mujoco.mj_getState(model, data, state, STATE)
            if not np.array_equal(state, following[:size]):
                sys.exit(f"the repeated control step differs by {np.abs(state - following[:size]).max()}")
    print(f"{len(rows)} episodes, equal to the recorded ones bit for bit")
    forces = np.sort(forces)
    for name, values in [("largest force", forces[:, -1]), ("force in 30 control steps", forces[:, -30])]:
        print(f"{name}: median {np.median(values):.0f} N, range {values.min():.0f} to {values.max():.0f} N")
    print_depth(depth)
    print(f"lowest position of the grasp point: {lowest:.3f} m")
    print("velocity:", " ".join(f"{v:.3f}" for v in velocity))


def print_depth(depth):
    print("depth:", ", ".join(f"{pair} {1000 * d:.2f} mm" for pair, d in sorted(depth.items())))


def drop(model):
    """Opens the hand in its initial pose and waits 3 s."""
    data, bodies, depth = mujoco.MjData(model), Bodies(model), {}
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    targets = data.qpos[:9].copy()
    if bodies.welds:
        data.eq_active[:] = 0
        targets[7:] = 0.04
    for _ in range(round(3 / model.opt.timestep)):
        servo(data, targets)
        mujoco.mj_step(model, data)
        contact_forces(model, data, bodies, depth)
    print_depth(depth)
    rest = {}
    contact_forces(model, data, bodies, rest)
    print("at rest, ", end="")
    print_depth(rest)


def drive(model, actions):
    """Drives the arm from its initial pose; returns the maximum velocities."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    targets, peak = data.qpos[:9].copy(), np.zeros(9)
    low, high = model.jnt_range[:9].T
    steps = round(1 / 60 / model.opt.timestep)
    for action in actions:
        targets[:7] = np.clip(targets[:7] + 0.125 * action, low[:7], high[:7])
        for _ in range(steps):
            servo(data, targets)
            mujoco.mj_step(model, data)
            peak = np.maximum(peak, np.abs(data.qvel[:9]) / LIMIT)
    return peak[:7]


def panda(model):
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    there_and_back = [1] * 150 + [-1] * 270
    single = [drive(model, np.outer(there_and_back, joint)) for joint in (*np.eye(7), *-np.eye(7))]
    together = [
        drive(model, np.outer(there_and_back, signs)) for signs in itertools.product((1, -1), repeat=7)
    ]
    generator = np.random.default_rng(0)
    random = [
        drive(model, np.repeat(generator.choice([-1, 1], (30, 7)), 10, axis=0)) for _ in range(EPISODES)
    ]
    diagonal = [max(single[joint][joint], single[joint + 7][joint]) for joint in range(7)]
    for name, peaks in [
        ("each joint by itself", diagonal),
        ("all joints together", np.max(together, axis=0)),
        ("random directions", np.max(random, axis=0)),
    ]:
        print(f"{name + ':':22}", " ".join(f"{v:.3f}" for v in peaks))


if __name__ == "__main__":
    modes = {"panda": panda, "drop": drop}
    if sys.argv[1] in modes:
        modes[sys.argv[1]](mujoco.MjModel.from_xml_path(sys.argv[2]))
    else:
        episodes(mujoco.MjModel.from_xml_path(sys.argv[1]), sys.argv[2])
