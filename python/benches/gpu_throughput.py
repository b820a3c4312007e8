"""Control steps per second on a GPU: MuJoCo Warp alone, and simulations of a controller with
signals and action noise.

    python python/benches/gpu_throughput.py [TASK ...] [--rows 16384 ...] [--waves 4] [--space
    starts] [--no-c] [--quick] [--profile]

Each line is a JSON object with these rates, in control steps per second:

- ``bare_start``: the physics steps of MuJoCo Warp as a CUDA graph, again and again from the start
  states, with constant targets
- ``bare``: the physics steps of MuJoCo Warp as a CUDA graph, over the same episodes as
  ``screened``, whose targets are in the GPU's memory
- ``step``: as ``bare_start``, with servos, poses and copies from and to the host
- ``screened``: ``mishandle risk -k screening.device=gpu``, without the time to compile kernels
  and to allocate memory, with ``-k screening.confirm=0.0001`` (more with few simulations)
- ``C``: ``mishandle risk -k risk.method=monte-carlo`` on all cores of the same host

``waited_s``: how long the CPU waited for the GPU. ``visited_s``: how long the CPU computed samples
and actions; ``started_s``: the part of it in control steps in which episodes started. Each has one
number for each batch. ``policy_c_ms``: the policy's actions on one core, for its share of half of
the rows. ``policy_gpu_ms``: those of half of the rows on the GPU, with the copies of observations
and actions. Rewards are not computed: only training needs them. ``bytes_per_world``: the GPU's
memory. With ``--profile``, ``kernels`` has the time of each kernel in one control step, ms. With
another ``--space`` than ``starts``, and with ``--quick``, only ``screened`` is measured.
"""

import argparse
import collections
import json
import os
import tempfile
import time

import numpy as np
import warp as wp

from mishandle import _native, load_controller
import mishandle.gpu.batches as gpu
from mishandle.gpu import audit, networks, verdicts

TASKS = [task for task in audit.TASKS if task != "cloth-placing"]
EPISODE_STEPS = audit.EPISODE_STEPS
CORES = len(os.sched_getaffinity(0))
INPUTS = ("targets", "active", "mocap")

made: "list[Recorder]" = []


class Recorder(gpu.WarpBatch):
    """Keeps its arguments, its first start states, the times of its steps, and, if ``records``, the
    inputs of the first episodes."""

    records = False

    def __init__(self, *arguments: object) -> None:
        start, before = time.perf_counter(), free_memory()
        super().__init__(*arguments)
        self.made_in, self.bytes = time.perf_counter() - start, before - free_memory()
        self.arguments, self.starts, self.finished_at = arguments, None, None
        self.waited = self.visited = self.started = 0.0
        self.has_starts = False
        self.inputs: dict[str, list[np.ndarray]] = {name: [] for name in INPUTS}
        made.append(self)

    def write_states(self, rows: np.ndarray, states: np.ndarray) -> None:
        if self.starts is None:
            self.starts = np.reshape(states, (len(rows), -1)).copy()
        super().write_states(rows, states)
        self.has_starts = True

    def start_step(self) -> None:
        if self.finished_at is not None:
            duration = time.perf_counter() - self.finished_at
            self.visited += duration
            self.started += duration if self.has_starts else 0.0
        self.has_starts = False
        if self.records and len(self.inputs["targets"]) < EPISODE_STEPS:
            for name, buffer in self.arrays().items():
                if name in self.inputs:
                    self.inputs[name].append(buffer.copy())
        super().start_step()

    def finish_step(self) -> None:
        start = time.perf_counter()
        super().finish_step()
        self.finished_at = time.perf_counter()
        self.waited += self.finished_at - start


PLAIN = gpu.WarpBatch
gpu.WarpBatch = Recorder


def free_memory() -> int:
    device = gpu.find_device(None)
    return device.free_memory if device.is_cuda else 0


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


def screen(
    task: str, rows: int, waves: int, space: str = "starts", records: bool = False
) -> tuple[float, list[Recorder]]:
    """Screens ``waves`` simulations for each world. Returns control steps per second and the
    batches."""
    made.clear()
    Recorder.records = records
    common = [
        "risk", task, "--controller", "ppo", "--action-noise", "0.1", "--seed", "1", "-k",
        "risk.method=monte-carlo"
    ]
    common += ["--space", space]
    simulations = rows * waves
    share = max(1e-4, 5 / simulations)
    options = [
        "--simulations", str(simulations), "-k", "screening.device=gpu", "-k",
        f"screening.rows={rows}", "-k", f"screening.confirm={share}"
    ]
    with tempfile.TemporaryDirectory() as folder:
        total = command(*common, *options, "--out", f"{folder}/run.sqlite")
    batches = list(made)
    return simulations * EPISODE_STEPS / (total - sum(batch.made_in for batch in batches)), batches


def rate(run: object, steps: int, rows: int) -> float:
    """Returns control steps per second of a function that takes one control step."""
    run()
    wp.synchronize()
    start = time.perf_counter()
    for _ in range(steps):
        run()
    wp.synchronize()
    return rows * steps / (time.perf_counter() - start)


def physics_graph(whole: gpu.WarpBatch, with_servos: bool) -> object:
    """Returns the CUDA graph of the physics steps of one control step."""
    with wp.ScopedCapture(stream=whole._stream) as capture:
        for _ in range(whole._substeps):
            if with_servos:
                whole.physics_step()
            else:
                gpu.step(whole._model, whole.data, lambda: None)
    return capture.graph


def replay(whole: gpu.WarpBatch, batches: list[Recorder]) -> float:
    """Returns control steps per second of the physics of recorded episodes. Their inputs are in the
    GPU's memory."""
    rows, data = whole._rows, whole.data
    inputs = {
        name: wp.array(
            np.array([
                np.concatenate(step) for step in zip(*(batch.inputs[name] for batch in batches))
            ]),
            dtype=whole._there[name].dtype,
        )
        for name in INPUTS
        if whole._there[name].size
    }
    whole.write_states(
        np.arange(rows, dtype=np.int32), np.concatenate([batch.starts for batch in batches])
    )
    graph = physics_graph(whole, with_servos=True)
    wp.synchronize()
    start = time.perf_counter()
    for step in range(EPISODE_STEPS):
        for name, values in inputs.items():
            wp.copy(whole._there[name], values[step])
        active = whole._there["active"]
        if active.size:
            wp.launch(
                gpu.kernels.set_bools, data.eq_active.shape, inputs=[active],
                outputs=[data.eq_active]
            )
        wp.capture_launch(graph, stream=whole._stream)
    wp.synchronize()
    return rows * EPISODE_STEPS / (time.perf_counter() - start)


def profile(whole: gpu.WarpBatch) -> dict[str, float]:
    """Returns the time of each kernel and copy in one control step from the present states, ms."""
    wp.timing_begin(cuda_filter=wp.TIMING_ALL)
    whole._control_step()
    times: dict[str, float] = collections.defaultdict(float)
    for result in wp.timing_end():
        times[result.name] += result.elapsed
    return {
        name: round(ms, 4) for name, ms in sorted(times.items(), key=lambda item: -item[1])[:25]
    }


def policy_times(task: str, rows: int) -> tuple[float, float]:
    """Returns how long the policy takes for the actions of ``rows`` rows on all cores, and on the
    GPU, ms."""
    sizes = json.loads(verdicts.command("controller", f"{task}/ppo", "--json"))["sizes"]
    network = networks.WarpNetwork(sizes, "elu", rows)
    controller = load_controller(f"{task}/ppo")
    share = np.zeros((-(-rows // CORES), sizes[0]), dtype=np.float32)
    calls = 100
    return tuple(1e3 / rate(run, calls, 1) for run in (lambda: controller(share), network.forward))


def measure(task: str, rows: int, options: argparse.Namespace) -> dict[str, object]:
    begin = time.perf_counter()
    screened, batches = screen(task, rows, options.waves, options.space)
    arguments = list(batches[0].arguments)
    found: dict[str, object] = {
        "task": task,
        "rows": rows,
        "waves": options.waves,
        "cores": CORES,
        "space": options.space,
        "substeps": arguments[3],
        "screened": screened,
        "waited_s": [round(batch.waited, 3) for batch in batches],
        "visited_s": [round(batch.visited, 3) for batch in batches],
        "started_s": [round(batch.started, 3) for batch in batches],
        "making_s": [round(batch.made_in, 3) for batch in batches],
        "bytes_per_world": sum(batch.bytes for batch in batches) // rows,
    }
    is_quick = options.quick or options.space != "starts"
    if not (options.no_c or is_quick):
        count = 200 * CORES
        common = (
            f"risk {task} --controller ppo --action-noise 0.1 --seed 1 --simulations {count} "
            "-k risk.method=monte-carlo"
        )
        found["C"] = count * EPISODE_STEPS / command(*common.split())
    if is_quick:
        found["seconds"] = round(time.perf_counter() - begin, 1)
        return found
    _, batches = screen(task, rows, 1, records=True)
    arguments[2] = rows
    whole = PLAIN(*arguments)
    whole.write_states(
        np.arange(rows, dtype=np.int32), np.concatenate([batch.starts for batch in batches])
    )
    for name in INPUTS:
        whole.arrays()[name][:] = np.concatenate([batch.inputs[name][0] for batch in batches])
    found["step"] = rate(whole.step, 100, rows)
    found["policy_c_ms"], found["policy_gpu_ms"] = policy_times(task, rows // 2)
    if whole._device.is_cuda:
        with wp.ScopedDevice(whole._device), wp.ScopedStream(whole._stream):
            graph = physics_graph(whole, with_servos=False)
            found["bare_start"] = rate(
                lambda: wp.capture_launch(graph, stream=whole._stream), 100, rows
            )
            found["bare"] = replay(whole, batches)
            if options.profile:
                found["kernels"] = profile(whole)
    found["seconds"] = round(time.perf_counter() - begin, 1)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tasks", nargs="*", default=TASKS)
    parser.add_argument("--rows", type=int, nargs="+", default=[16384])
    parser.add_argument("--waves", type=int, default=4)
    parser.add_argument("--space", default="starts")
    parser.add_argument("--no-c", action="store_true")
    parser.add_argument("--profile", action="store_true")
    parser.add_argument(
        "--quick", action="store_true", help="only `screened`, as with another --space"
    )
    options = parser.parse_args()
    if options.profile and (options.quick or options.space != "starts"):
        parser.error("--profile needs all measurements: leave out --quick and --space")
    for task in options.tasks:
        for rows in options.rows:
            print(json.dumps(measure(task, rows, options)), flush=True)


if __name__ == "__main__":
    main()
