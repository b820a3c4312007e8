"""The servo rule of the crate ``mishandle-world`` as a kernel of Warp: position servos that keep
velocity limits. ``servo.rs`` explains it."""

# The annotations of kernels are calls, which type checkers reject.
# mypy: ignore-errors
# pyright: basic

import functools

import mujoco
import numpy as np
import warp as wp
from mujoco_warp._src.types import vec10

BRAKING_SHARE = wp.constant(wp.float64(0.98))
SWEEPS = wp.constant(4)
"""As in ``servo.rs``."""

COLUMNS = ("qpos", "dof", "max_velocity", "max_effort")
"""Columns of the table of servos: the indices of a joint's position and velocity, then the limits
of the servo. The gains are those of the model."""


def find_controls(table, targets, model, data):
    """Returns the controls of one world of MuJoCo C after ``mj_step1``, for audits of the
    kernel."""
    qpos, dofs = table[:, 0].astype(int), table[:, 1].astype(int)
    max_velocity, max_effort = table[:, 2:].T
    stiffness, damping = model.actuator_gainprm[: len(table), 0], -model.actuator_biasprm[
        : len(table), 2
    ]
    h, q, v = model.opt.timestep, data.qpos[qpos], data.qvel[dofs]
    limit = max_velocity * damping / stiffness
    lead = np.clip(targets - q, -limit, limit)
    required = stiffness * lead - damping * v
    effort = np.clip(required, -max_effort, max_effort)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    inertia = mass[np.ix_(dofs, dofs)] + h * np.diag(model.dof_damping[dofs])
    other = data.qfrc_passive[dofs] - data.qfrc_bias[dofs]
    implicit = np.abs(required) < max_effort
    acceleration = np.linalg.solve(inertia + h * np.diag(damping * implicit), effort + other)
    brakes = np.abs(v + h * acceleration) > max_velocity
    if not brakes.any():
        return q + lead
    most = float(BRAKING_SHARE) * max_effort
    begin = np.where(brakes, np.clip(effort, -most, most), effort)
    inverse = np.linalg.inv(inertia + h * np.diag(damping * (implicit | brakes)))
    effort, acceleration = begin.copy(), inverse @ (begin + other)
    for _ in range(int(SWEEPS)):
        for i in range(len(effort)):
            after, change = v[i] + h * acceleration[i], effort[i] - begin[i]
            bound = (
                np.clip(after, -max_velocity[i], max_velocity[i]) if change == 0
                else -np.copysign(max_velocity[i], change)
            )
            following = np.clip(
                effort[i] + (bound - after) / (h * inverse[i, i]), -most[i], most[i]
            )
            if after == bound:
                following = effort[i]
            elif change * (following - begin[i]) < 0:
                following = begin[i]
            acceleration += inverse[:, i] * (following - effort[i])
            effort[i] = following
    return np.where(brakes | (effort != begin), q + (effort + damping * v) / stiffness, q + lead)


@functools.cache
def make_kernel(servos: int):
    """Returns the kernel that sets the controls of this number of servos. A thread does one
    world."""
    Vector = wp.types.vector(length=servos, dtype=wp.float64)
    Matrix = wp.types.matrix(shape=(servos, servos), dtype=wp.float64)

    @wp.func
    def factor(matrix: Matrix, n: int) -> Matrix:
        a = matrix
        for i in range(n):
            for k in range(i + 1):
                total = a[i, k]
                for m in range(k):
                    total -= a[i, m] * a[k, m]
                if i == k:
                    a[i, k] = wp.sqrt(total)
                else:
                    a[i, k] = total / a[k, k]
        return a

    @wp.func
    def solve(a: Matrix, right: Vector, n: int) -> Vector:
        b = right
        for i in range(n):
            total = b[i]
            for k in range(i):
                total -= a[i, k] * b[k]
            b[i] = total / a[i, i]
        for back in range(n):
            i = n - 1 - back
            total = b[i]
            for k in range(i + 1, n):
                total -= a[k, i] * b[k]
            b[i] = total / a[i, i]
        return b

    @wp.kernel(module="unique")
    def set_servos(
        # The number of servos as a variable, so that Warp does not unroll the loops.
        n: int,
        timestep: wp.array(dtype=float),
        table: wp.array2d(dtype=wp.float64),
        targets: wp.array2d(dtype=wp.float64),
        qpos: wp.array2d(dtype=float),
        qvel: wp.array2d(dtype=float),
        passive: wp.array2d(dtype=float),
        bias: wp.array2d(dtype=float),
        dof_damping: wp.array2d(dtype=float),
        mass: wp.array2d(dtype=float),
        addresses: wp.array(dtype=int),
        counts: wp.array(dtype=int),
        columns: wp.array(dtype=int),
        gains: wp.array2d(dtype=vec10),
        biases: wp.array2d(dtype=vec10),
        ctrl: wp.array2d(dtype=float),
    ):
        row = wp.tid()
        h = wp.float64(timestep[0])
        first = int(table[0, 1])
        inertia, implicit = Matrix(), Vector()
        stiffness, damping = Vector(), Vector()
        velocity, effort, torque = Vector(), Vector(), Vector()
        for i in range(n):
            stiffness[i] = wp.float64(gains[row % gains.shape[0], i][0])
            damping[i] = -wp.float64(biases[row % biases.shape[0], i][2])
            q, v = wp.float64(qpos[row, int(table[i, 0])]), wp.float64(qvel[row, first + i])
            limit = table[i, 2] * damping[i] / stiffness[i]
            lead = wp.clamp(targets[row, i] - q, -limit, limit)
            ctrl[row, i] = float(q + lead)
            velocity[i] = v
            required = stiffness[i] * lead - damping[i] * v
            effort[i] = wp.clamp(required, -table[i, 3], table[i, 3])
            implicit[i] = wp.where(wp.abs(required) < table[i, 3], h * damping[i], wp.float64(0.0))
            torque[i] = wp.float64(passive[row, first + i] - bias[row, first + i])
            start = addresses[first + i]
            for entry in range(start, start + counts[first + i]):
                j = columns[entry] - first
                if j >= 0:
                    inertia[i, j] = wp.float64(mass[row, entry])
                    inertia[j, i] = inertia[i, j]
            viscous = dof_damping[row % dof_damping.shape[0], first + i]
            inertia[i, i] = inertia[i, i] + h * wp.float64(viscous)
        damped = inertia
        for i in range(n):
            damped[i, i] = damped[i, i] + implicit[i]
        acceleration = solve(factor(damped, n), effort + torque, n)
        brakes = Vector()
        some = int(0)
        for i in range(n):
            if wp.abs(velocity[i] + h * acceleration[i]) > table[i, 2]:
                brakes[i] = wp.float64(1.0)
                some = 1
        if some == 0:
            return
        damped = inertia
        for i in range(n):
            if brakes[i] > wp.float64(0.0):
                implicit[i] = h * damping[i]
                most = BRAKING_SHARE * table[i, 3]
                effort[i] = wp.clamp(effort[i], -most, most)
            damped[i, i] = damped[i, i] + implicit[i]
        lower = factor(damped, n)
        inverse = Matrix()
        for i in range(n):
            unit = Vector()
            unit[i] = wp.float64(1.0)
            column = solve(lower, unit, n)
            for j in range(n):
                inverse[i, j] = column[j]
        acceleration = solve(lower, effort + torque, n)
        begin = effort
        for _sweep in range(SWEEPS):
            for i in range(n):
                after = velocity[i] + h * acceleration[i]
                limit = table[i, 2]
                change = effort[i] - begin[i]
                bound = wp.clamp(after, -limit, limit)
                if change > wp.float64(0.0):
                    bound = -limit
                elif change < wp.float64(0.0):
                    bound = limit
                if after != bound:
                    most = BRAKING_SHARE * table[i, 3]
                    next = wp.clamp(effort[i] + (bound - after) / (h * inverse[i, i]), -most, most)
                    if change * (next - begin[i]) < wp.float64(0.0):
                        next = begin[i]
                    for j in range(n):
                        acceleration[j] = acceleration[j] + inverse[i, j] * (next - effort[i])
                    effort[i] = next
        for i in range(n):
            if brakes[i] > wp.float64(0.0) or effort[i] != begin[i]:
                setpoint = (effort[i] + damping[i] * velocity[i]) / stiffness[i]
                ctrl[row, i] = float(wp.float64(qpos[row, int(table[i, 0])]) + setpoint)

    return set_servos
