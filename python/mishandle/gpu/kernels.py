"""The kernels of :mod:`mishandle.gpu.batches`: copies between the buffers of the host and the
arrays of MuJoCo Warp."""

# The annotations of kernels are calls, which type checkers reject.
# mypy: ignore-errors
# pyright: basic

import mujoco_warp as mjw
import warp as wp

MAX_VALUE = wp.constant(1e10)
"""MuJoCo's ``mjMAXVAL``: a larger number means that the simulation has diverged."""

# Too little memory. The other bits report solver iterations, which MuJoCo C does not treat as an
# error either.
_OVERFLOWS = (
    mjw.OverflowType.NEFC
    | mjw.OverflowType.NJMAX_NNZ
    | mjw.OverflowType.BROADPHASE
    | mjw.OverflowType.NARROWPHASE
    | mjw.OverflowType.CCD
    | mjw.OverflowType.NVMAX
    | mjw.OverflowType.EPA_HORIZON
)
OVERFLOWS = wp.constant(int(_OVERFLOWS))


@wp.kernel
def set_forces(
    forces: wp.array2d(dtype=wp.float64), substep: int, pushed: wp.array(dtype=int),
    xfrc: wp.array3d(dtype=float)
) -> None:
    row, body, axis = wp.tid()
    xfrc[row, pushed[body], axis] = float(forces[row, 3 * substep + axis])


@wp.kernel
def set_controls(
    inputs: wp.array2d(dtype=wp.float64), first: int, ctrl: wp.array2d(dtype=float)
) -> None:
    row, column = wp.tid()
    ctrl[row, first + column] = float(inputs[row, first + column])


@wp.kernel
def set_bools(source: wp.array2d(dtype=wp.uint8), target: wp.array2d(dtype=wp.bool)) -> None:
    row, column = wp.tid()
    target[row, column] = source[row, column] != wp.uint8(0)


@wp.kernel
def to_float(
    source: wp.array2d(dtype=wp.float64), stride: int, offset: int, size: int,
    target: wp.array2d(dtype=float)
) -> None:
    row, column = wp.tid()
    target[row, column] = float(source[row, (column // size) * stride + offset + column % size])


@wp.kernel
def copy_columns(
    source: wp.array2d(dtype=float), offset: int, target: wp.array2d(dtype=float)
) -> None:
    row, column = wp.tid()
    target[row, offset + column] = source[row, column]


@wp.kernel
def scatter(
    states: wp.array2d(dtype=wp.float64), rows: wp.array(dtype=int), offset: int,
    target: wp.array2d(dtype=float)
) -> None:
    index, column = wp.tid()
    target[rows[index], column] = float(states[index, offset + column])


@wp.kernel
def scatter_bools(
    states: wp.array2d(dtype=wp.float64), rows: wp.array(dtype=int), offset: int,
    target: wp.array2d(dtype=wp.bool)
) -> None:
    index, column = wp.tid()
    target[rows[index], column] = states[index, offset + column] != wp.float64(0.0)


@wp.kernel
def gather(
    source: wp.array2d(dtype=float), offset: int, states: wp.array2d(dtype=wp.float64)
) -> None:
    row, column = wp.tid()
    states[row, offset + column] = wp.float64(source[row, column])


@wp.kernel
def gather_bools(
    source: wp.array2d(dtype=wp.bool), offset: int, states: wp.array2d(dtype=wp.float64)
) -> None:
    row, column = wp.tid()
    states[row, offset + column] = wp.where(source[row, column], wp.float64(1.0), wp.float64(0.0))


@wp.kernel
def watch(
    qpos: wp.array2d(dtype=float), qvel: wp.array2d(dtype=float), overflow: wp.array(dtype=int),
    status: wp.array(dtype=int)
) -> None:
    row = wp.tid()
    # An overflow explains a divergence, so it has priority, and it lasts until the end of the
    # control step.
    if overflow[row] & OVERFLOWS:
        status[row] = 2
    if status[row] == 0:
        for i in range(qpos.shape[1]):
            if not (wp.abs(qpos[row, i]) < MAX_VALUE):
                status[row] = 1
        for i in range(qvel.shape[1]):
            if not (wp.abs(qvel[row, i]) < MAX_VALUE):
                status[row] = 1


@wp.kernel
def write_status(
    status: wp.array(dtype=int), column: int, outputs: wp.array2d(dtype=float)
) -> None:
    row = wp.tid()
    outputs[row, column] = float(status[row])
