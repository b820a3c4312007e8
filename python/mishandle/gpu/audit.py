"""One physics step of MuJoCo Warp against one of MuJoCo C, from the same states of episodes of a
controller.

    python -m mishandle.gpu.audit [--space starts] [--formula success] [--states 1000] [--device
    cpu] [TASK ...]

MuJoCo C simulates episodes with action noise 0.3 behind the interface of
:class:`mishandle.gpu.batches.WarpBatch`: targets of servos, mocap poses, active constraints, pushes
and varying fields of the models are those that the GPU would get. In every ``period``-th control
step, the state of each episode is kept. Both engines then take one physics step from each kept
state with the same inputs. Warp computes with 32-bit numbers.

The tables have the absolute differences after this step. ``moved`` is the difference of MuJoCo C
from itself if each number of the positions moves by 1e-7. With a formula that reads signals of the
manner, such as ``careful``, a third table has the relative differences of the measured forces and
of the motion of the arm.
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import os
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mishandle._native import run_command
from mishandle.gpu import batches as gpu
from mishandle.gpu.batches import mujoco
from mishandle.systems import task_environments

TASKS = list(task_environments.TASKS.values())

MOVE = 1e-7
"""Change of positions for the comparison of MuJoCo C with itself: about the precision of 32-bit
numbers."""

QUANTITIES = {
    "joints": "positions of hinges, slides and nodes of the cloth, rad or m",
    "free positions": "positions of free bodies, m",
    "quaternions": "quaternions of free bodies",
    "joint velocities": "velocities of hinges, slides and nodes of the cloth, rad/s or m/s",
    "linear velocities": "velocities of free bodies, m/s",
    "angular velocities": "angular velocities of free bodies, rad/s",
}
"""Parts of the positions and velocities. Not every task has all of them."""

CONVERGED = 1e-12
"""Tolerance of the solver at which its error is below that of numbers of 32 bits."""

EPISODE_STEPS = 300
"""Control steps of an episode, the same for all tasks."""

STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class Audit:
    """Absolute differences after one physics step: for each quantity the largest one per audited
    state.

    The names are ``qpos``, ``qvel`` and ``moved`` (velocities of MuJoCo C after a move), ``early``
    and ``early C`` (velocities of MuJoCo Warp and of MuJoCo C against a solver that converges), and
    those of :data:`QUANTITIES`. If the formula reads signals of the manner, ``forces`` and
    ``motion`` are the differences of the readings of ``probe``, each divided by 1 plus the reading
    of MuJoCo C, and ``force`` is the largest force of MuJoCo C, N.
    """

    def __init__(self) -> None:
        self.differences: dict[str, list[float]] = {}
        self.states = 0
        self.overflows = 0

    def add(self, name: str, difference: NDArray[np.float64]) -> None:
        """Adds the largest difference of a quantity in one state."""
        if difference.size:
            self.differences.setdefault(name, []).append(float(np.max(np.abs(difference))))

    def quantile(self, name: str, share: float) -> float:
        """Returns a quantile of the differences of a quantity: 1 is the maximum."""
        return float(np.quantile(self.differences[name], share))


class CpuBatch(gpu.WarpBatch):
    """A batch that MuJoCo C steps in 64 bits, one row after another. It keeps the states and inputs
    of some control steps."""

    def __init__(self, period: int, made: list[CpuBatch], *arguments: Any, **keywords: Any) -> None:
        # By name, because the constructor may have more arguments than this class knows.
        self.arguments = inspect.signature(super().__init__).bind(*arguments, **keywords).arguments
        self.physics = CpuPhysics(self.arguments)
        super().__init__(**self.arguments)
        self.period = period
        self.states = np.zeros((self._rows, self._state_size))
        self.fields = np.zeros((self._rows, self._fields_size))
        self.age = np.full(self._rows, EPISODE_STEPS)
        self.kept: list[dict[str, NDArray[Any]]] = []
        made.append(self)

    def _record(self) -> None:
        """Compiles no kernels."""
        self._stream = self._graph = None

    def write_states(self, rows: NDArray[np.int32], states: NDArray[np.float64]) -> None:
        self.states[rows] = np.reshape(states, (len(rows), self._state_size))
        self.age[rows] = 0

    def write_fields(self, rows: NDArray[np.int32], values: NDArray[np.float64]) -> None:
        self.fields[rows] = np.reshape(values, (len(rows), self._fields_size))

    def read_states(self) -> NDArray[np.float64]:
        return self.states.reshape(-1)

    def start_step(self) -> None:
        inputs = {name: value for name, value in self.arrays().items() if name != "outputs"} | {
            "fields": self.fields
        }
        # Rows without an episode, before their start or after its end, are not simulated.
        running = self.age < EPISODE_STEPS
        chosen = running & (self.age % self.period == self.period // 2)
        self.kept.append({
            name: value[chosen] for name, value in {"states": self.states, **inputs}.items()
        })
        self.age[running] += 1
        outputs, physics = self.arrays()["outputs"], self.physics
        for row in np.flatnonzero(running).tolist():
            physics.start(self.states[row], inputs, row)
            for substep in range(self._substeps):
                physics.step(inputs, row, substep)
            mujoco.mj_getState(physics.model, physics.data, self.states[row], STATE)
            outputs[row] = physics.output()

    def finish_step(self) -> None:
        """Does nothing: the step has ended."""


FORCES = int(gpu.probes.FORCES)
"""Number of forces that a probe measures."""

ACCELERATION_SHARE = gpu.probes.MOTIONS.index("acceleration share")
"""The one motion that is no largest value."""


def start_readings() -> NDArray[np.float64]:
    """Returns the readings of a probe before the first physics step of a control step."""
    readings = np.zeros(gpu.probes.READINGS)
    readings[-1] = np.inf
    return readings


def measure(
    probe: dict[str, Any], model: Any, data: Any, start: NDArray[np.float64], substep: int,
    readings: NDArray[np.float64]
) -> None:
    """Adds a physics step of one world of MuJoCo C to its readings, as the kernels of
    :mod:`mishandle.gpu.probe` do. ``start`` are the velocities at the start of the control step."""
    parts = {"geom": probe["geoms"], "flex": probe["flexes"]}
    holds = probe["weld"] >= 0 and bool(data.eq_active[probe["weld"]])
    forces, force = np.zeros(FORCES), np.zeros(6)
    for index, contact in enumerate(data.contact):
        first, second = (
            parts["geom"][contact.geom[side]] if contact.geom[side] >= 0
            else parts["flex"][contact.flex[side]]
            for side in (0, 1)
        )
        bits = probe["pairs"][int(holds)][first * int(gpu.probes.PARTS) + second]
        mujoco.mj_contactForce(model, data, index, force)
        forces += [force[0] * (bits >> i & 1) for i in range(FORCES)]
    table = np.array(probe["joints"])
    qpos, dofs, actuators = table[:, :3].astype(int).T
    low, high, max_velocity, max_acceleration, max_torque = table[:, 3:].T
    speed, q = np.abs(data.qvel[dofs]), data.qpos[qpos]
    acceleration = np.abs(data.qvel[dofs] - start[dofs]) / ((substep + 1) * model.opt.timestep)
    torque = (
        model.actuator_gainprm[actuators, 0] * (data.ctrl - data.actuator_length)[actuators]
        + model.actuator_biasprm[actuators, 2] * data.actuator_velocity[actuators]
    )
    tool = np.zeros(6)
    if substep > 0:
        # Poses and velocities of bodies are those of the start of the step.
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, probe["site"], tool, 0)
    motions = [
        speed.max(),
        (speed / max_velocity).max(),
        (acceleration / max_acceleration).max(),
        (np.abs(torque) / max_torque).max(),
        np.linalg.norm(tool[3:]),
    ]
    largest, sums, moved = readings[:FORCES], readings[FORCES : 2 * FORCES], readings[
        2 * FORCES : -1
    ]
    np.maximum(largest, forces, out=largest)
    sums += forces
    moved[ACCELERATION_SHARE] = 0
    np.maximum(moved, motions, out=moved)
    readings[-1] = min(readings[-1], (q - low).min(), (high - q).min())


class CpuPhysics:
    """One world of MuJoCo C. It takes the arguments and inputs of a
    :class:`mishandle.gpu.batches.WarpBatch`."""

    def __init__(self, arguments: dict[str, Any]) -> None:
        self.model = gpu.compile_model(arguments["model"], arguments["timestep"])
        self.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
        self.data = mujoco.MjData(self.model)
        self.servos = np.array(arguments["servos"])
        self.pushed, self.fields = list(arguments.get("pushed", ())), list(
            arguments.get("fields", ())
        )
        self.probe = arguments.get("probe")
        self.readings = start_readings()
        self.velocities = self.data.qvel.copy()

    def start(self, state: NDArray[np.float64], inputs: dict[str, NDArray[Any]], row: int) -> None:
        """Sets a state, and a row's active constraints, mocap poses and fields of the model."""
        values = inputs["fields"][row]
        for name in self.fields:
            array = gpu.attribute(self.model, name)
            array[:], values = values[: array.size].reshape(array.shape), values[array.size :]
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, state, STATE)
        self.data.eq_active[:] = inputs["active"][row]
        poses = inputs["mocap"][row].reshape(-1, 7)
        self.data.mocap_pos[:], self.data.mocap_quat[:] = poses[:, :3], poses[:, 3:]
        self.readings = start_readings()

    def set_inputs(self, inputs: dict[str, NDArray[Any]], row: int, substep: int) -> None:
        """Takes the first half of a physics step, and sets the controls of the servos and the
        push."""
        mujoco.mj_step1(self.model, self.data)
        targets, controls = np.split(inputs["inputs"][row], [len(self.servos)])
        self.data.ctrl[len(self.servos) :] = controls
        self.data.ctrl[: len(self.servos)] = gpu.servo_rule.find_controls(
            self.servos, targets, self.model, self.data
        )
        if self.pushed:
            self.data.xfrc_applied[self.pushed, :3] = inputs["forces"][
                row, 3 * substep : 3 * substep + 3
            ]

    def step(self, inputs: dict[str, NDArray[Any]], row: int, substep: int) -> None:
        """Takes a physics step of a control step."""
        if substep == 0:
            self.velocities = self.data.qvel.copy()
        self.set_inputs(inputs, row, substep)
        mujoco.mj_step2(self.model, self.data)
        if self.probe is not None:
            measure(self.probe, self.model, self.data, self.velocities, substep, self.readings)

    def output(self) -> NDArray[np.float64]:
        """Returns the output row of the present state."""
        data = self.data
        mujoco.mj_kinematics(self.model, data)
        parts = [
            data.qpos, data.qvel, data.xpos, data.xquat, data.site_xpos, data.site_xmat,
            data.xanchor, data.xaxis
        ]
        if self.probe is not None:
            parts.append(self.readings)
        # MuJoCo C resets a world that has diverged, and counts a warning.
        status = float(any(warning.number > 0 for warning in data.warning))
        return np.concatenate([*(part.ravel() for part in parts), [status]])

    def quantities(self) -> dict[str, tuple[str, NDArray[np.int64]]]:
        """Returns the array (``qpos`` or ``qvel``) and the indices of each of
        :data:`QUANTITIES`."""
        found: dict[str, list[int]] = {name: [] for name in QUANTITIES}
        for kind, q, v in zip(self.model.jnt_type, self.model.jnt_qposadr, self.model.jnt_dofadr):
            if kind == mujoco.mjtJoint.mjJNT_FREE:
                found["free positions"] += range(q, q + 3)
                found["quaternions"] += range(q + 3, q + 7)
                found["linear velocities"] += range(v, v + 3)
                found["angular velocities"] += range(v + 3, v + 6)
            else:
                found["joints"].append(q)
                found["joint velocities"].append(v)
        arrays = {name: "qvel" if name.endswith("velocities") else "qpos" for name in QUANTITIES}
        return {
            name: (arrays[name], np.array(indices, dtype=np.int64))
            for name, indices in found.items()
        }


@contextlib.contextmanager
def _simulated_on_the_cpu(period: int, made: list[CpuBatch]) -> Iterator[None]:
    """Lets MuJoCo C step the worlds of ``-k screening.device=gpu``, and drops the output of the
    process."""
    module: Any = gpu
    original, stdout, null = gpu.WarpBatch, os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    module.WarpBatch = lambda *arguments, **keywords: CpuBatch(period, made, *arguments, **keywords)
    try:
        yield
    finally:
        module.WarpBatch = original
        os.dup2(stdout, 1)
        os.close(stdout)
        os.close(null)


def visited(
    task: str, controller: str, episodes: int, period: int, space: str, formula: str
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Returns the arguments of the batches of a search, and the states and inputs of each kept
    control step, one per row."""
    made: list[CpuBatch] = []
    with _simulated_on_the_cpu(period, made):
        # One simulation per trial: all start at once, and each fills one row.
        subject = (
            f"falsify {task} --space {space} --controller {controller} --action-noise 0.3 --seed "
            f"1 --formula {formula}"
        )
        search = f"--search random --trials {episodes} --budget 1 -k falsify.batch=1"
        screening = (
            "-k report.repeats=0 "
            f"-k screening.device=gpu -k screening.rows={episodes} -k screening.confirm=0.01"
        )
        code = run_command(["mishandle", *f"{subject} {search} {screening}".split()])
    if code not in (0, 1):
        raise RuntimeError(f"the search of {task} ended with exit code {code}")
    kept = [inputs for batch in made for inputs in batch.kept]
    return made[0].arguments, {
        name: np.concatenate([inputs[name] for inputs in kept]) for name in kept[0]
    }


def warp_step(arguments: dict[str, Any], inputs: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
    """Returns the output rows of MuJoCo Warp after one physics step from each state."""
    rows = len(inputs["states"])
    batch = gpu.WarpBatch(**{**arguments, "rows": rows, "substeps": 1})
    for name, buffer in batch.arrays().items():
        if name != "outputs":
            # Inputs per physics step begin with those of the first one.
            buffer[:] = inputs[name][:, : buffer.shape[1]]
    indices = np.arange(rows, dtype=np.int32)
    if inputs["fields"].size:
        batch.write_fields(indices, inputs["fields"])
    batch.write_states(indices, inputs["states"])
    batch.step()
    return batch.arrays()["outputs"].copy()


def audit(
    task: str, controller: str = "ppo", states: int = 1000, episodes: int = 50,
    space: str = "starts", formula: str = "success"
) -> Audit:
    """Audits a task on about ``states`` states of episodes over a space. The name of a formula that
    reads signals of the manner, such as ``careful``, audits them too."""
    period = min(max(1, EPISODE_STEPS * episodes // max(states, 1)), EPISODE_STEPS)
    arguments, inputs = visited(task, controller, episodes, period, space, formula)
    outputs, physics, result = warp_step(arguments, inputs), CpuPhysics(arguments), Audit()
    random, quantities = np.random.default_rng(0), physics.quantities()
    for row, output in enumerate(outputs):
        if output[-1] != 0:
            result.overflows += int(output[-1] == 2)
            continue
        compare(physics, inputs, row, output, quantities, random, result)
    return result


def compare(
    physics: CpuPhysics, inputs: dict[str, NDArray[Any]], row: int, output: NDArray[np.float64],
    quantities: dict[str, tuple[str, NDArray[np.int64]]], random: np.random.Generator, result: Audit
) -> None:
    """Adds the differences of one state."""
    data, nq, nv = physics.data, physics.model.nq, physics.model.nv
    physics.start(inputs["states"][row], inputs, row)
    physics.step(inputs, row, 0)
    differences = {"qpos": output[:nq] - data.qpos, "qvel": output[nq : nq + nv] - data.qvel}
    result.states += 1
    for name, difference in differences.items():
        result.add(name, difference)
    for name, (array, indices) in quantities.items():
        result.add(name, differences[array][indices])
    if physics.probe is not None:
        expected = physics.readings
        difference = (output[-1 - len(expected) : -1] - expected) / (1 + np.abs(expected))
        result.add("force", expected[:FORCES])
        result.add("forces", difference[: 2 * FORCES])
        result.add("motion", difference[2 * FORCES :])
    qvel = data.qvel.copy()
    physics.start(inputs["states"][row], inputs, row)
    physics.set_inputs(inputs, row, 0)
    data.qpos[:] += MOVE * random.choice([-1.0, 1.0], nq)
    mujoco.mj_step(physics.model, data)
    result.add("moved", data.qvel - qvel)
    option = physics.model.opt
    iterations, tolerance = option.iterations, option.tolerance
    option.iterations, option.tolerance = 10 * iterations, CONVERGED
    physics.start(inputs["states"][row], inputs, row)
    physics.set_inputs(inputs, row, 0)
    mujoco.mj_step2(physics.model, data)
    option.iterations, option.tolerance = iterations, tolerance
    result.add("early", output[nq : nq + nv] - data.qvel)
    result.add("early C", qvel - data.qvel)


def main() -> None:
    """Prints two tables of the differences."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tasks", nargs="*", metavar="TASK", help="default: all tasks")
    parser.add_argument("--space", default="starts", help="space of the scenarios")
    parser.add_argument("--formula", default="success", help="name of the formula of the episodes")
    parser.add_argument(
        "--states", type=int, default=1000, help="about this number of states of each task"
    )
    parser.add_argument("--device", help="device of MuJoCo Warp, such as cuda:1 or cpu")
    options = parser.parse_args()
    if unknown := sorted(set(options.tasks) - set(TASKS)):
        parser.error(f"unknown task {unknown[0]}; expected one of {', '.join(TASKS)}")
    if options.device:
        os.environ[gpu.DEVICE_VARIABLE] = options.device
    print(
        "| task | states | overflows | qpos: median | 99 % | max | qvel: median | 99 % | max | "
        "moved: median | 99 % | max |"
    )
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|")
    found = {}
    for task in options.tasks or TASKS:
        found[task] = result = audit(
            task, states=options.states, space=options.space, formula=options.formula
        )
        numbers = [
            f"{result.quantile(name, share):.1e}" for name in ("qpos", "qvel", "moved")
            for share in (0.5, 0.99, 1)
        ]
        print(
            f"| {task} | {result.states} | {result.overflows} | {' | '.join(numbers)} |", flush=True
        )
    print(f"\n| task, maxima | {' | '.join(QUANTITIES)} |\n|---|{'--:|' * len(QUANTITIES)}")
    for task, result in found.items():
        maxima = [
            f"{result.quantile(name, 1):.1e}" if name in result.differences else "-"
            for name in QUANTITIES
        ]
        print(f"| {task} | {' | '.join(maxima)} |", flush=True)
    measured = {task: result for task, result in found.items() if "forces" in result.differences}
    if measured:
        print(
            "\n| task | forces: median | 99 % | max | motion: median | 99 % | max |\n"
            "|---|--:|--:|--:|--:|--:|--:|"
        )
    for task, result in measured.items():
        numbers = [
            f"{result.quantile(name, share):.1e}" for name in ("forces", "motion")
            for share in (0.5, 0.99, 1)
        ]
        print(f"| {task} | {' | '.join(numbers)} |")


if __name__ == "__main__":
    main()
