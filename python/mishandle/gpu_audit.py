"""One physics step of MuJoCo Warp against one of MuJoCo C, from the same states of episodes of a controller.

    python -m mishandle.gpu_audit [--space starts] [--period 30] [--device cpu] [TASK ...]

Each row of a screening is audited in every ``period``-th control step: both engines start from its positions, velocities, warm start,
mocap poses and active constraints, with the same constants, controls and pushes, and take one physics step. Warp computes with 32-bit numbers. The column `moved`
is the difference of MuJoCo C from itself if each number of its positions moves by 1e-7.
"""

from __future__ import annotations

import argparse
import os
from typing import Any

import numpy as np

from mishandle import gpu
from mishandle._native import run_command
from mishandle.gpu import attribute, mujoco

TASKS = [
    "point-reaching",
    "cube-stacking",
    "peg-in-hole",
    "ball-balancing",
    "ball-catching",
    "ball-pushing",
    "door-opening",
    "cloth-placing",
]


MOVE = 1e-7
"""Change of positions for the comparison of MuJoCo C with itself: about the precision of 32-bit numbers."""


class Audit:
    """Absolute differences after one physics step: one number per audited state."""

    def __init__(self) -> None:
        self.differences: dict[str, list[float]] = {"qpos": [], "qvel": [], "moved": []}
        self.states = 0
        self.overflows = 0

    def add(self, name: str, difference: Any) -> None:
        """Adds the largest difference of a quantity in one state."""
        self.differences[name].append(float(np.max(np.abs(difference), initial=0.0)))

    def summary(self) -> dict[str, tuple[float, float, float]]:
        """Returns the median, the 99 % quantile and the maximum of each quantity."""
        return {
            name: (float(np.median(values)), float(np.quantile(values, 0.99)), float(np.max(values)))
            for name, values in self.differences.items()
        }


class Fields:
    """Values of the varying fields of the model of each row."""

    def __init__(self, names: Any) -> None:
        self.names = list(names)
        self.values: dict[int, Any] = {}

    def write(self, rows: Any, values: Any) -> None:
        """Replaces the values of some rows."""
        self.values.update(zip((int(row) for row in rows), np.reshape(values, (len(rows), -1)).copy()))

    def load(self, row: int, model: Any) -> None:
        """Writes the values of a row into a model of MuJoCo C."""
        values = self.values.get(row, np.zeros(0))
        for name in self.names if len(values) else []:
            array = attribute(model, name)
            array[:] = values[: array.size].reshape(array.shape)
            values = values[array.size :]


def audit(task: str, controller: str = "ppo", simulations: int = 100, period: int = 30, space: str = "starts") -> Audit:
    """Audits a task on the states that a controller visits in a space, with action noise 0.3."""
    result = Audit()
    original: Any = gpu.WarpBatch
    module: Any = gpu

    class Audited(original):  # type: ignore[misc]
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            xml, timestep, rows, substeps, servo_qpos, servo_lead, pushed, fields = arguments
            self.steps, self.substeps = 0, substeps
            self.servos = (np.array(servo_qpos), np.array(servo_lead))
            self.pushed, self.fields = list(pushed), Fields(fields)
            self.one = original(xml, timestep, rows, 1, servo_qpos, servo_lead, pushed, fields)
            self.model = gpu.compile_model(xml, timestep)
            self.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
            self.c = mujoco.MjData(self.model)

        def write_fields(self, rows: Any, values: Any) -> None:
            super().write_fields(rows, values)
            self.one.write_fields(rows, values)
            self.fields.write(rows, values)

        def step(self) -> None:
            if self.steps % period == period // 2:
                compare(self, result)
            self.steps += 1
            super().step()

    module.WarpBatch = Audited
    stdout, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        arguments = f"risk {task} --space {space} --controller {controller} --action-noise 0.3 --seed 1 --simulations {simulations}"
        code = run_command(
            ["mishandle", *arguments.split(), "--backend", "gpu", "--rows", str(simulations), "--confirm", "0.01"]
        )
    finally:
        os.dup2(stdout, 1)
        os.close(stdout)
        os.close(null)
        module.WarpBatch = original
    if code not in (0, 1):
        raise RuntimeError(f"the screening of {task} ended with exit code {code}")
    return result


def compare(batch: Any, result: Audit) -> None:
    """Takes one physics step from the present states of a batch with both engines."""
    data, inputs, one = batch.data, batch.arrays(), batch.one
    values = {
        name: getattr(data, name).numpy()
        for name in ("qpos", "qvel", "qacc_warmstart", "ctrl", "xfrc_applied", "mocap_pos", "mocap_quat")
    }
    rows = len(values["qpos"])
    spec = mujoco.mjtState.mjSTATE_INTEGRATION
    states = np.zeros((rows, mujoco.mj_stateSize(batch.model, spec)))
    starts = []
    for row in range(rows):
        mujoco.mj_resetData(batch.model, batch.c)
        for name, value in values.items():
            if value.size:
                getattr(batch.c, name)[:] = value[row]
        if inputs["mocap"].size:
            poses = inputs["mocap"][row].reshape(-1, 7)
            batch.c.mocap_pos[:], batch.c.mocap_quat[:] = poses[:, :3], poses[:, 3:]
        batch.c.eq_active[:] = inputs["active"][row]
        mujoco.mj_getState(batch.model, batch.c, states[row], spec)
        starts.append(states[row].copy())
    own = one.arrays()
    for name in ("targets", "active", "mocap", "forces"):
        # The other batch takes the first physics step only.
        own[name][:] = inputs[name][:, : own[name].shape[1]]
    one.write_states(np.arange(rows, dtype=np.int32), states)
    one.step()
    (address, lead), nq, nv = batch.servos, batch.model.nq, batch.model.nv
    random = np.random.default_rng(0)
    for row in range(rows):
        if own["outputs"][row, -1] != 0:
            result.overflows += int(own["outputs"][row, -1] == 2)
            continue
        batch.fields.load(row, batch.model)
        mujoco.mj_setState(batch.model, batch.c, starts[row], spec)
        push(batch, own["forces"][row])
        q = batch.c.qpos[address]
        batch.c.ctrl[: len(address)] = q + np.clip(inputs["targets"][row] - q, -lead, lead)
        mujoco.mj_step(batch.model, batch.c)
        result.states += 1
        result.add("qpos", own["outputs"][row, :nq] - batch.c.qpos)
        result.add("qvel", own["outputs"][row, nq : nq + nv] - batch.c.qvel)
        qvel, ctrl = batch.c.qvel.copy(), batch.c.ctrl.copy()
        mujoco.mj_setState(batch.model, batch.c, starts[row], spec)
        push(batch, own["forces"][row])
        batch.c.qpos[:] += MOVE * random.choice([-1.0, 1.0], nq)
        batch.c.ctrl[:] = ctrl
        mujoco.mj_step(batch.model, batch.c)
        result.add("moved", batch.c.qvel - qvel)


def push(batch: Any, force: Any) -> None:
    """Applies the force of a row to the pushed bodies in MuJoCo C."""
    if batch.pushed:
        batch.c.xfrc_applied[batch.pushed, :3] = force


def main() -> None:
    """Prints a table of the differences."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tasks", nargs="*", default=TASKS)
    parser.add_argument("--space", default="starts")
    parser.add_argument("--period", type=int, default=30)
    parser.add_argument("--simulations", type=int, default=100)
    parser.add_argument("--device")
    options = parser.parse_args()
    if options.device:
        os.environ[gpu.DEVICE_VARIABLE] = options.device
    print("| task | states | overflows | qpos: median | 99 % | max | qvel: median | 99 % | max | moved: median | 99 % | max |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|")
    for task in options.tasks:
        found = audit(task, simulations=options.simulations, period=options.period, space=options.space)
        numbers = [f"{value:.1e}" for name in ("qpos", "qvel", "moved") for value in found.summary()[name]]
        print(f"| {task} | {found.states} | {found.overflows} | {' | '.join(numbers)} |", flush=True)


if __name__ == "__main__":
    main()
