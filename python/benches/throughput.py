"""Control steps per second of `TaskVectorEnv`, of the extension module below it, of the Rust core,
and of panda-gym, in one run.

    python python/benches/throughput.py [--rounds 5] [--threads 2]

It needs a release build of the package (`pip install .`), panda-gym and cargo. They take turns in
each round; the table has medians and ranges over the rounds. On a machine that does other things
too, look at the ratio by CPU time. Each control step of panda-gym has 20 physics steps of 1/500 s
for a reaching arm.
"""

import argparse
import pathlib
import statistics
import subprocess
import time

import gymnasium
import mishandle
import numpy as np
from mishandle import _native

SECONDS = 2.0
ROOT = pathlib.Path(__file__).resolve().parents[2]
CORE = "core_throughput"


def rate(step, rows):
    """Returns the control steps per second, and per second of CPU time, of `rows` environments that
    are stepped together."""
    step()
    started, cpu, steps = time.perf_counter(), time.process_time(), 0
    while time.perf_counter() - started < SECONDS:
        step()
        steps += rows
    return steps / (time.perf_counter() - started), steps / (time.process_time() - cpu)


def core_rate(task, rows, threads):
    """Returns the control steps per second of the Rust core, in a process of its own."""
    command = [ROOT / "target/release/examples" / CORE, task, str(rows), str(threads)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    subprocess.run(
        ["cargo", "build", "--quiet", "--release", "--example", CORE], cwd=ROOT, check=True
    )
    cases = {}
    for task, rows in [("point-reaching", 64), ("point-reaching", 512), ("ball-balancing", 512)]:
        simulator = _native.Simulator(
            task, rows, preset="paper", reward="shaped", threads=arguments.threads
        )
        axes = len(simulator.axes)
        start = np.ones(rows, dtype=bool), np.arange(rows, dtype=np.uint64), np.full(
            (rows, axes), np.nan
        )
        env = mishandle.TaskVectorEnv(task, rows, threads=arguments.threads)
        actions = np.zeros((rows, 9), np.float32)
        simulator.reset(*start)
        env.reset(seed=0)
        pair = (lambda s=simulator, a=actions: s.step(a)), (lambda e=env, a=actions: e.step(a))
        cases[task, rows] = pair
    import panda_gym  # noqa: F401 (registers its environments)

    other = gymnasium.make("PandaReach-v3", max_episode_steps=10**9)
    other.reset(seed=0)
    still = np.zeros(other.action_space.shape, np.float32)
    found = {name: [] for name in cases}
    panda = []
    for _ in range(arguments.rounds):
        for (task, rows), (extension, vector) in cases.items():
            core = core_rate(task, rows, arguments.threads)
            found[task, rows].append((core, rate(extension, rows), rate(vector, rows)))
        panda.append(rate(lambda: other.step(still), 1)[0])
    text = (
        lambda values: f"{statistics.median(values):.0f} ({min(values):.0f} to {max(values):.0f})"
    )
    ratio = (
        lambda values: f"{statistics.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"
    )
    print(
        "| | core, steps/s | extension | TaskVectorEnv | ratio to the core | ratio to the "
        "extension by CPU time |"
    )
    print("|---|--:|--:|--:|--:|--:|")
    for (task, rows), measured in found.items():
        core = np.array([core for core, _, _ in measured])
        extension, extension_cpu = np.transpose([extension for _, extension, _ in measured])
        vector, vector_cpu = np.transpose([vector for _, _, vector in measured])
        rates = f"{text(core)} | {text(extension)} | {text(vector)}"
        print(
            f"| {task}, {rows} environments | {rates} | {ratio(vector / core)} | "
            f"{ratio(vector_cpu / extension_cpu)} |"
        )
    print(f"| panda-gym, PandaReach-v3, 1 environment | | | {text(panda)} | | |")


if __name__ == "__main__":
    main()
