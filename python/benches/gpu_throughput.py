"""Control steps per second on a GPU: MuJoCo Warp alone, and simulations of a controller with signals, rewards and action noise.

    python python/benches/gpu_throughput.py [--rows 16384] [--waves 4] [TASK ...]

Columns: ``bare``: the physics steps of MuJoCo Warp as a CUDA graph, from the start states of random scenarios. ``step``: the same with
servos, poses and copies from and to the host. ``screened``: ``mishandle risk --backend gpu``, without the time to compile kernels and to
allocate memory, with ``--confirm 0.0001``. ``C``: ``mishandle risk --method monte-carlo`` on all cores of the same host.
"""

from __future__ import annotations

import argparse
import json
import os
import time

import numpy as np
import warp as wp

from mishandle import _native, gpu, gpu_audit

TASKS = [task for task in gpu_audit.TASKS if task != "cloth-placing"]
EPISODE_STEPS = 300

made: list[Recorder] = []


class Recorder(gpu.WarpBatch):
    """Keeps its arguments, its first start states and the times of its steps."""

    def __init__(self, *arguments: object) -> None:
        start = time.perf_counter()
        super().__init__(*arguments)
        self.made_in = time.perf_counter() - start
        self.arguments, self.starts, self.waited = arguments, None, 0.0
        made.append(self)

    def write_states(self, rows: np.ndarray, states: np.ndarray) -> None:
        if self.starts is None:
            self.starts = np.reshape(states, (len(rows), -1)).copy()
        super().write_states(rows, states)

    def step(self) -> None:
        start = time.perf_counter()
        super().step()
        self.waited += time.perf_counter() - start


gpu.WarpBatch = Recorder


def command(*arguments: str) -> float:
    """Runs a command and returns its duration, s. Its output is dropped."""
    start = time.perf_counter()
    stdout, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        code = _native.run_command(["mishandle", *arguments])
    finally:
        os.dup2(stdout, 1)
    if code not in (0, 1):
        raise SystemExit(f"{arguments}: exit code {code}")
    return time.perf_counter() - start


def rate(run: object, steps: int, rows: int) -> float:
    """Returns control steps per second of a function that takes one control step."""
    run()
    wp.synchronize()
    start = time.perf_counter()
    for _ in range(steps):
        run()
    wp.synchronize()
    return rows * steps / (time.perf_counter() - start)


def measure(task: str, rows: int, waves: int) -> dict[str, object]:
    made.clear()
    common = ["risk", task, "--controller", "ppo", "--action-noise", "0.1", "--seed", "1"]
    simulations = rows * waves
    begin = time.perf_counter()
    total = command(*common, "--simulations", str(simulations), "--backend", "gpu", "--rows", str(rows), "--confirm", "0.0001")
    first = made[0]
    halves = list(made)
    # The time of the screening: from the first start to the end, as the command prints it, is total less the making of the batches.
    screened = simulations * EPISODE_STEPS / (total - sum(batch.made_in for batch in halves))
    cpu_simulations = 200 * (os.cpu_count() or 1)
    cpu = command(*common, "--simulations", str(cpu_simulations), "--method", "monte-carlo")
    arguments = list(first.arguments)
    arguments[2] = rows
    whole = gpu.WarpBatch.__mro__[1](*arguments)
    starts = np.concatenate([batch.starts for batch in halves])[:rows]
    whole.write_states(np.arange(len(starts), dtype=np.int32), starts)
    arrays = whole.arrays()
    # The targets hold the start: the first joints of the Panda are its servos.
    arrays["targets"][:] = whole.data.qpos.numpy()[:, list(arguments[4])]
    arrays["active"][:] = whole.data.eq_active.numpy()
    if arrays["mocap"].size:
        poses = np.concatenate([whole.data.mocap_pos.numpy(), whole.data.mocap_quat.numpy()], axis=2)
        arrays["mocap"][:] = poses.reshape(rows, -1)
    step = rate(whole.step, 100, rows)
    bare = None
    if whole._device.is_cuda:
        with wp.ScopedDevice(whole._device), wp.ScopedStream(whole._stream):
            with wp.ScopedCapture(stream=whole._stream) as capture:
                for _ in range(arguments[3]):
                    gpu.mjw.step(whole._model, whole.data)
            bare = rate(lambda: wp.capture_launch(capture.graph, stream=whole._stream), 100, rows)
    free, all_memory = (whole._device.free_memory, whole._device.total_memory) if whole._device.is_cuda else (0, 0)
    return {
        "task": task,
        "rows": rows,
        "substeps": arguments[3],
        "bare": bare,
        "step": step,
        "screened": screened,
        "waited_s": [batch.waited for batch in halves],
        "total_s": total,
        "making_s": [batch.made_in for batch in halves],
        "C": cpu_simulations * EPISODE_STEPS / cpu,
        "memory_used": all_memory - free,
        "seconds": time.perf_counter() - begin,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tasks", nargs="*", default=TASKS)
    parser.add_argument("--rows", type=int, default=16384)
    parser.add_argument("--waves", type=int, default=4)
    options = parser.parse_args()
    for task in options.tasks:
        print(json.dumps(measure(task, options.rows, options.waves)), flush=True)


if __name__ == "__main__":
    main()
