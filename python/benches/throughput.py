"""Control steps per second of `TaskVectorEnv`, of the extension module below it, and of panda-gym, in one run.

    python python/benches/throughput.py [--rounds 5] [--threads 2]

It needs a release build of the package (`pip install .`) and panda-gym. The three take turns in each round; the table has medians
and ranges over the rounds. On a machine that does other things too, look at the ratio by CPU time. Each control step of panda-gym has 20 physics steps of 1/500 s for a reaching arm.
"""

import argparse
import statistics
import time

import gymnasium
import mishandle
import numpy as np
from mishandle import _native

SECONDS = 2.0


def rate(step, rows):
    """Returns the control steps per second, and per second of CPU time, of `rows` environments that are stepped together."""
    step()
    started, cpu, steps = time.perf_counter(), time.process_time(), 0
    while time.perf_counter() - started < SECONDS:
        step()
        steps += rows
    return steps / (time.perf_counter() - started), steps / (time.process_time() - cpu)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    cases = {}
    for task, rows in [("point-reaching", 64), ("point-reaching", 512), ("ball-balancing", 512)]:
        simulator = _native.Simulator(task, rows, preset="paper", reward="shaped", threads=arguments.threads)
        axes = len(simulator.axes)
        start = np.ones(rows, dtype=bool), np.arange(rows, dtype=np.uint64), np.full((rows, axes), np.nan)
        env = mishandle.TaskVectorEnv(task, rows, threads=arguments.threads)
        actions = np.zeros((rows, 9), np.float32)
        simulator.reset(*start)
        env.reset(seed=0)
        pair = (lambda s=simulator, a=actions: s.step(a)), (lambda e=env, a=actions: e.step(a))
        cases[f"{task}, {rows} environments"] = (pair, rows)
    import panda_gym  # noqa: F401 (registers its environments)

    other = gymnasium.make("PandaReach-v3", max_episode_steps=10**9)
    other.reset(seed=0)
    still = np.zeros(other.action_space.shape, np.float32)
    found = {name: [] for name in cases}
    panda = []
    for _ in range(arguments.rounds):
        for name, ((core, vector), rows) in cases.items():
            found[name].append((rate(core, rows), rate(vector, rows)))
        panda.append(rate(lambda: other.step(still), 1)[0])
    text = lambda values: f"{statistics.median(values):.0f} ({min(values):.0f} to {max(values):.0f})"
    ratio = lambda values: f"{statistics.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"
    print("| | extension, steps/s | TaskVectorEnv, steps/s | ratio | ratio by CPU time |\n|---|--:|--:|--:|--:|")
    for name, pairs in found.items():
        (core, core_cpu), (vector, vector_cpu) = (np.transpose(side) for side in zip(*pairs))
        ratios = f"{ratio(vector / core)} | {ratio(vector_cpu / core_cpu)}"
        print(f"| {name} | {text(core)} | {text(vector)} | {ratios} |")
    print(f"| panda-gym, PandaReach-v3, 1 environment | | {text(panda)} | | |")


if __name__ == "__main__":
    main()
