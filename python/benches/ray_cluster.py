"""Measures campaigns on Ray: overhead of a batch, throughput with one and two workers, messages,
and the writer's rate.

    python3 python/benches/ray_cluster.py

Each line is the median of five rounds, in which all variants alternate.
"""

import argparse
import os
import pathlib
import pickle
import statistics
import tempfile
import time
from typing import Any

os.environ.setdefault("RAY_AUTH_MODE", "disabled")

import mishandle
import ray
from mishandle import Axis, _native
from mishandle.cluster import RayExecutor
from mishandle.cluster.plans import PlanFactory

PLAN = """
target = "ball-balancing"
controller = "ppo"
[evaluate]
episodes = 100000
"""

SPACE = [Axis("speed", 0.0, 1.0)]


def nothing(scenario: dict[str, Any]) -> dict[str, list[float]]:
    return {"x": [1.0, 1.0]}


def seconds(work: Any) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    folder = pathlib.Path(tempfile.mkdtemp())
    (folder / "plan.toml").write_text(PLAN)
    [(_, path, _)] = _native.create_campaign(PLAN, str(folder / "runs"))
    plan, hashes = _native.recorded_plan(str(path))
    local = _native.PlanWorker(plan, hashes, 1)
    requests: list[Any] = [([0.3 + 0.0002 * i, 0.0], i, False) for i in range(512)]
    found = local.rollout(requests[:64])
    print(f"request: {len(pickle.dumps(requests[:64], 5)) / 64:.0f} bytes")
    print(f"episode: {len(pickle.dumps(found, 5)) / 64:.0f} bytes")

    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="WARNING")
    executors = {"1 worker": RayExecutor(num_cpus=2), "2 workers": RayExecutor(num_cpus=1)}
    shared = next(iter(executors.values())).share(PlanFactory(plan, hashes))
    empty = next(iter(executors.values())).share(lambda: lambda batch: [0] * len(batch))
    for executor in executors.values():
        executor.run(shared, requests)
        executor.run(empty, requests)
    times: dict[str, list[float]] = {}
    for _ in range(rounds):
        times.setdefault("this process", []).append(seconds(lambda: local.rollout(requests)))
        for name, executor in executors.items():
            # Ray ends workers that are idle for a second; this starts them again.
            executor.run(shared, requests[:64])
            times.setdefault(name, []).append(seconds(lambda: executor.run(shared, requests)))
            for size in (8, 64, 512):
                key = f"overhead of an empty batch of {size}, {name}"
                times.setdefault(key, []).append(
                    seconds(lambda: executor.run(empty, requests[:size]))
                )
        single = RayExecutor(num_cpus=1, chunk=1)
        times.setdefault("overhead of 1000 empty tasks, 2 workers", []).append(
            seconds(lambda: single.run(empty, [requests[0]] * 1000))
        )
    alone = statistics.median(times["this process"])
    for name, measured in times.items():
        median = statistics.median(measured)
        rate = f", {len(requests) / median:.0f} simulations/s, {alone / median:.2f} of this process"
        rate = "" if "overhead" in name else rate
        print(
            f"{name}: {1e3 * median:.1f} ms (from {1e3 * min(measured):.1f} to "
            f"{1e3 * max(measured):.1f}){rate}"
        )

    def write() -> None:
        out = folder / f"{time.monotonic_ns()}.sqlite"
        plan = {"evaluate": {"batch": 1024}}
        mishandle.evaluate(nothing, "always(x > 0)", SPACE, episodes=20_000, plan=plan, out=out)

    rates = [20_000 / seconds(write) for _ in range(rounds)]
    print(f"searches and writer: {statistics.median(rates):.0f} rows/s")


if __name__ == "__main__":
    main()
