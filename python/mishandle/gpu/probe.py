"""Measurements over the physics steps of a control step, as in ``probe.rs`` of the crate
``mishandle-world``: contact forces of the robot, and the motion of its arm."""

# The annotations of kernels are calls, which type checkers reject.
# mypy: ignore-errors
# pyright: basic

import numpy as np
import warp as wp
from mujoco_warp._src.support import contact_force_fn
from mujoco_warp._src.types import vec5, vec10

FORCES = wp.constant(6)
"""Forces of the robot on fixtures, on the ground, on itself and on the object, of the robot without
its fingers on the object, and all of the robot but those on an object that it carries."""

PARTS = wp.constant(5)
"""Parts that forces act between: fingers, arm, object, ground, fixture."""

COLUMNS = (
    "qpos", "dof", "actuator", "low", "high", "max_velocity", "max_acceleration", "max_torque"
)
"""Columns of the table of joints: indices of position, velocity and servo, then the range and the
limits."""

MOTIONS = ("speed", "speed share", "acceleration share", "torque share", "tool speed")
"""The largest motions of a control step: speed of a joint, its share of the limit, the shares of
the acceleration, which is that over the whole control step, and of the torque that a servo demands
before it is limited, and speed of the tool between the physics steps."""

READINGS = 2 * int(FORCES) + len(MOTIONS) + 1
"""Numbers of a control step: the largest forces, the sums of the forces over the physics steps, the
largest motions, and the smallest distance of a joint to the end of its range."""

KEYS = ("geoms", "flexes", "pairs", "weld", "body", "site", "joints")
"""Keys of a probe: the part of each geom and of each flex; for a hand without and with an object,
the forces of each pair of parts as bits; the weld that holds the object, or -1; body and site of
the tool; the table of joints."""


class WarpProbe:
    """The probe of a batch of MuJoCo Warp. :meth:`before_step` and :meth:`after_step` launch its
    kernels around a physics step."""

    def __init__(self, probe, mujoco_model, model, data):
        self._model, self._data = model, data
        self._geoms = wp.array(probe["geoms"], dtype=int)
        self._flexes = wp.array(probe["flexes"], dtype=int)
        self._pairs = wp.array(np.array(probe["pairs"], dtype=np.int32), dtype=int)
        self._joints = wp.array(
            np.array(probe["joints"], dtype=np.float32).reshape(-1, len(COLUMNS)), dtype=float
        )
        self._weld, self._body, self._site = probe["weld"], probe["body"], probe["site"]
        self._root = int(mujoco_model.body_rootid[self._body])
        rows = data.nworld
        self._start = wp.zeros((rows, mujoco_model.nv), dtype=float)
        self._forces = wp.zeros((rows, int(FORCES)), dtype=float)
        self.readings = wp.zeros((rows, READINGS), dtype=float)

    def before_step(self, substep):
        """Keeps the velocities at the start of a control step."""
        if substep == 0:
            wp.copy(self._start, self._data.qvel)

    def after_step(self, substep):
        """Measures the physics step. The first one of a control step starts the readings."""
        model, data = self._model, self._data
        contact = data.contact
        inputs = [
            model.opt.cone, contact.frame, contact.friction, contact.dim, contact.efc_address,
            contact.adhesion, data.efc.force
        ]
        inputs += [
            data.njmax, data.nacon, contact.worldid, contact.geom, contact.flex, data.eq_active,
            self._weld
        ]
        inputs += [self._geoms, self._flexes, self._pairs]
        wp.launch(add_forces, data.naconmax, inputs=inputs, outputs=[self._forces])
        inputs = [
            substep, model.opt.timestep, self._joints, self._body, self._site, self._root,
            self._start, data.qpos, data.qvel
        ]
        inputs += [model.actuator_gainprm, model.actuator_biasprm, data.ctrl]
        inputs += [data.actuator_length, data.actuator_velocity]
        inputs += [data.cvel, data.subtree_com, data.site_xpos]
        wp.launch(measure, data.nworld, inputs=inputs, outputs=[self._forces, self.readings])


@wp.func
def part(
    geom: wp.array(dtype=wp.vec2i), flex: wp.array(dtype=wp.vec2i), contact: int, side: int,
    geoms: wp.array(dtype=int), flexes: wp.array(dtype=int)
) -> int:
    # Without flexes, their array is empty.
    if geom[contact][side] >= 0:
        return geoms[geom[contact][side]]
    return flexes[flex[contact][side]]


@wp.kernel
def add_forces(
    cone: int, frame: wp.array(dtype=wp.mat33), friction: wp.array(dtype=vec5),
    dim: wp.array(dtype=int), efc_address: wp.array2d(dtype=int), adhesion: wp.array(dtype=float),
    efc_force: wp.array2d(dtype=float), njmax: int, nacon: wp.array(dtype=int),
    worldid: wp.array(dtype=int), geom: wp.array(dtype=wp.vec2i), flex: wp.array(dtype=wp.vec2i),
    active: wp.array2d(dtype=wp.bool), weld: int, geoms: wp.array(dtype=int),
    flexes: wp.array(dtype=int), pairs: wp.array2d(dtype=int), forces: wp.array2d(dtype=float)
):
    contact = wp.tid()
    if contact >= nacon[0]:
        return
    row = worldid[contact]
    holds = int(0)
    if weld >= 0:
        if active[row, weld]:
            holds = 1
    first = part(geom, flex, contact, 0, geoms, flexes)
    second = part(geom, flex, contact, 1, geoms, flexes)
    bits = pairs[holds, first * PARTS + second]
    if bits == 0:
        return
    force = contact_force_fn(
        cone, frame, friction, dim, efc_address, adhesion, efc_force, njmax, nacon, row, contact,
        False
    )
    for i in range(FORCES):
        if (bits >> i) & 1:
            wp.atomic_add(forces, row, i, force[0])


@wp.func
def keep_largest(readings: wp.array2d(dtype=float), row: int, column: int, value: float):
    readings[row, column] = wp.max(readings[row, column], value)


@wp.kernel
def measure(
    substep: int, timestep: wp.array(dtype=float), joints: wp.array2d(dtype=float), body: int,
    site: int, root: int, start: wp.array2d(dtype=float), qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float), gains: wp.array2d(dtype=vec10),
    biases: wp.array2d(dtype=vec10), control: wp.array2d(dtype=float),
    length: wp.array2d(dtype=float), velocity: wp.array2d(dtype=float),
    cvel: wp.array2d(dtype=wp.spatial_vector), subtree_com: wp.array2d(dtype=wp.vec3),
    site_xpos: wp.array2d(dtype=wp.vec3), forces: wp.array2d(dtype=float),
    readings: wp.array2d(dtype=float)
):
    row = wp.tid()
    last = readings.shape[1] - 1
    if substep == 0:
        for i in range(last):
            readings[row, i] = 0.0
        readings[row, last] = wp.inf
    for i in range(FORCES):
        keep_largest(readings, row, i, forces[row, i])
        readings[row, FORCES + i] = readings[row, FORCES + i] + forces[row, i]
        forces[row, i] = 0.0
    duration = float(substep + 1) * timestep[0]
    readings[row, 2 * FORCES + 2] = 0.0
    for i in range(joints.shape[0]):
        q, v = qpos[row, int(joints[i, 0])], qvel[row, int(joints[i, 1])]
        acceleration = (v - start[row, int(joints[i, 1])]) / duration
        servo = int(joints[i, 2])
        gain = gains[row % gains.shape[0], servo][0]
        damping = biases[row % biases.shape[0], servo][2]
        ahead = control[row, servo] - length[row, servo]
        torque = gain * ahead + damping * velocity[row, servo]
        keep_largest(readings, row, 2 * FORCES, wp.abs(v))
        keep_largest(readings, row, 2 * FORCES + 1, wp.abs(v) / joints[i, 5])
        keep_largest(readings, row, 2 * FORCES + 2, wp.abs(acceleration) / joints[i, 6])
        keep_largest(readings, row, 2 * FORCES + 3, wp.abs(torque) / joints[i, 7])
        readings[row, last] = wp.min(
            readings[row, last], wp.min(q - joints[i, 3], joints[i, 4] - q)
        )
    if substep > 0:
        # Poses and velocities of bodies are those of the start of the step.
        twist = cvel[row, body]
        arm = site_xpos[row, site] - subtree_com[row, root]
        speed = wp.length(wp.spatial_bottom(twist) + wp.cross(wp.spatial_top(twist), arm))
        keep_largest(readings, row, 2 * FORCES + 4, speed)
