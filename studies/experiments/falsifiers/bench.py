"""Runs the benchmark and appends each trial to results/rows/SEARCH-BATCH.csv.gz. A second run continues: it skips recorded trials.

    python studies/experiments/falsifiers/bench.py                       # all searches of this environment
    python studies/experiments/falsifiers/bench.py --searches portfolio random --systems ball-balancing --seeds 10
    python studies/experiments/falsifiers/bench.py --estimate            # cost of the missing trials, without running them

Trial `s` of all searches has random seed `s`. A search that takes over a second a trial without its simulations (`slow` in
searches.py) runs ten seeds of ten systems: those at equal distances in the list. results/runs.jsonl has commit, versions and machine
of each run, and each row the number of its run.
"""

import argparse
import csv
import gzip
import importlib.metadata
import json
import multiprocessing
import os
import pathlib
import platform
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

# One process per job; before the import of libraries with threads of their own.
for threads in ("RAYON_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(threads, "1")

import searches
import systems
from trial import Trial

HERE = pathlib.Path(__file__).parent
BUDGET, SEEDS, SLOW_SEEDS, SLOW_SYSTEMS = 300, 30, 10, 10
COLUMNS = ["system", "seed", "simulations", "violated", "minimum", "rounds", "simulation_ms", "proposal_ms", "run"]
QUICK_SYSTEMS, QUICK_SEEDS, QUICK_SECONDS, QUICK_MILLISECONDS = 8, 5, 300.0, 10.0
QUICK_SEARCHES = ["portfolio", "random", "scipy-dual-annealing", "scipy-direct", "cma", "optuna-cma-es"]
QUICK_RESULTS = HERE.parents[2] / "target/falsifier-bench"


@dataclass(frozen=True)
class Job:
    """The missing seeds of a search on a system."""

    search: str
    batch: int
    system: str
    seeds: tuple[int, ...]
    budget: int


def evenly(items: list[Any], count: int) -> list[Any]:
    """Returns `count` items at equal distances, the first and the last among them."""
    if len(items) <= count:
        return items
    return [items[round(k * (len(items) - 1) / (count - 1))] for k in range(count)]


def path(results: pathlib.Path, search: str, batch: int) -> pathlib.Path:
    return results / "rows" / f"{search}-{batch}.csv.gz"


def recorded(results: pathlib.Path, search: str, batch: int) -> set[tuple[str, int]]:
    file = path(results, search, batch)
    if not file.exists():
        return set()
    with gzip.open(file, "rt", newline="", encoding="utf-8") as lines:
        return {(row["system"], int(row["seed"])) for row in csv.DictReader(lines)}


def jobs(arguments: argparse.Namespace, chosen: list[systems.System]) -> list[Job]:
    """Returns the missing trials, all systems of a search together, in the order of the given searches or of the list."""
    by_name = {search.name: search for search in searches.SEARCHES}
    found = []
    for search in [by_name[name] for name in arguments.searches or by_name]:
        if search.environment != arguments.environment:
            continue
        of = evenly(chosen, SLOW_SYSTEMS) if search.slow else chosen
        count = min(arguments.seeds, SLOW_SEEDS) if search.slow else arguments.seeds
        for batch in search.batches:
            done = recorded(arguments.results, search.name, batch) if batch in arguments.batches else set()
            for system in of if batch in arguments.batches else []:
                seeds = tuple(seed for seed in range(count) if (system.name, seed) not in done)
                if seeds:
                    found.append(Job(search.name, batch, system.name, seeds, arguments.budget))
    return found


_values: dict[str, systems.Value] = {}


def simulate(job: Job) -> tuple[Job, list[dict[str, Any]]]:
    """Runs the trials of a job."""
    system = next(system for system in systems.load() if system.name == job.system)
    if job.system not in _values:
        _values.clear()
        _values[job.system] = system.make()
    search = next(search for search in searches.SEARCHES if search.name == job.search)
    rows = []
    for seed in job.seeds:
        trial = Trial(system, _values[job.system], seed, job.budget, job.batch)
        started = time.perf_counter()
        searches.run(search, trial)
        elapsed = time.perf_counter() - started
        rows.append(
            {
                "system": job.system,
                "seed": seed,
                "simulations": trial.simulations,
                "violated": int(trial.violated),
                "minimum": f"{trial.minimum:.6g}",
                "rounds": trial.rounds,
                "simulation_ms": f"{1e3 * trial.simulation_seconds:.0f}",
                "proposal_ms": f"{1e3 * (elapsed - trial.simulation_seconds):.0f}",
            }
        )
    return job, rows


def append(file: pathlib.Path, rows: list[dict[str, Any]]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    is_new = not file.exists()
    with gzip.open(file, "at", newline="", encoding="utf-8") as lines:
        writer = csv.DictWriter(lines, COLUMNS, lineterminator="\n")
        if is_new:
            writer.writeheader()
        writer.writerows(rows)


def start_run(arguments: argparse.Namespace) -> int:
    """Adds this run to runs.jsonl and returns its number."""
    file = arguments.results / "runs.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    number = len(file.read_text(encoding="utf-8").splitlines()) + 1 if file.exists() else 1
    commit = subprocess.run(["git", "describe", "--always", "--dirty", "--abbrev=12"], cwd=HERE, stdout=subprocess.PIPE, text=True)
    here = [search for search in searches.SEARCHES if search.environment == arguments.environment]
    packages = sorted({"numpy", *(package for search in here for package in search.packages)})
    record = {
        "run": number,
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "commit": commit.stdout.strip(),
        "command": " ".join(sys.argv[1:]),
        "versions": {"python": platform.python_version(), **{package: importlib.metadata.version(package) for package in packages}},
        "machine": {"system": platform.platform(), "cores": os.cpu_count(), "load": round(os.getloadavg()[0], 1)},
    }
    with open(file, "a", encoding="utf-8") as lines:
        lines.write(json.dumps(record) + "\n")
    return number


def estimate(todo: list[Job], chosen: list[systems.System], results: pathlib.Path) -> float:
    """Returns the seconds of the missing trials on one core: simulations at their measured time, and proposals of recorded trials.

    Without a recorded trial of its search on its system, a trial has half the budget. Without one of its search, its proposals take
    0.1 s, or 100 s if the search is slow.
    """
    slow = {search.name for search in searches.SEARCHES if search.slow}
    facts = {system.name: system.facts for system in chosen}
    total = 0.0
    for search, batch in sorted({(job.search, job.batch) for job in todo}):
        file = path(results, search, batch)
        rows = list(csv.DictReader(gzip.open(file, "rt", newline="", encoding="utf-8"))) if file.exists() else []
        proposals = sum(float(row["proposal_ms"]) for row in rows) / len(rows) if rows else 1e5 if search in slow else 100.0
        for job in (job for job in todo if (job.search, job.batch) == (search, batch)):
            own = [int(row["simulations"]) for row in rows if row["system"] == job.system] or [job.budget // 2]
            simulations = sum(own) / len(own)
            total += len(job.seeds) * (simulations * facts[job.system].get("simulation_ms", 0.05) + proposals) / 1e3
    return total


def progress(todo: list[Job], done: Iterator[tuple[Job, list[dict[str, Any]]]], arguments: argparse.Namespace, run: int) -> None:
    started, finished = time.monotonic(), 0
    total = sum(len(job.seeds) for job in todo)
    for job, rows in done:
        append(path(arguments.results, job.search, job.batch), [{**row, "run": run} for row in rows])
        finished += len(rows)
        mean = sum(row["simulations"] if row["violated"] else job.budget for row in rows) / len(rows)
        spent = time.monotonic() - started
        print(f"{finished}/{total} trials, {spent:.0f} s: {job.search}-{job.batch} {job.system}: {mean:.1f}", file=sys.stderr, flush=True)
        if arguments.seconds and spent > arguments.seconds:
            print(f"stopped after {arguments.seconds:.0f} s; the same command continues", file=sys.stderr)
            return


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="runs the benchmark of falsifiers")
    parser.add_argument("--searches", nargs="+", default=[], help="names; by default all of the environment")
    parser.add_argument("--systems", nargs="+", default=[], help="starts of names; by default all")
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 16])
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--budget", type=int, default=BUDGET)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seconds", type=float, help="stop after this time; the same command continues")
    parser.add_argument("--environment", default="requirements", help="file of requirements whose searches run")
    parser.add_argument("--results", type=pathlib.Path, default=HERE / "results")
    parser.add_argument("--quick", action="store_true", help="some cheap systems, searches and seeds, in target/falsifier-bench")
    parser.add_argument("--estimate", action="store_true", help="print the cost of the missing trials and end")
    arguments = parser.parse_args()
    if arguments.quick:
        arguments.results = QUICK_RESULTS
        arguments.seeds = min(arguments.seeds, QUICK_SEEDS)
        arguments.seconds = arguments.seconds or QUICK_SECONDS
        if arguments.environment == "requirements":
            arguments.searches = arguments.searches or QUICK_SEARCHES
    return arguments


def main() -> None:
    arguments = parse()
    known = [search.name for search in searches.SEARCHES]
    for name in arguments.searches:
        if name not in known:
            sys.exit(f"error: unknown search {name}; expected one of {', '.join(known)}")
    every = systems.load()
    chosen = [system for system in every if not arguments.systems or system.name.startswith(tuple(arguments.systems))]
    if not chosen:
        sys.exit(f"error: no system starts with {' or '.join(arguments.systems)}")
    if arguments.quick:
        chosen = evenly([system for system in chosen if system.facts.get("simulation_ms", 0.0) < QUICK_MILLISECONDS], QUICK_SYSTEMS)
    todo = jobs(arguments, chosen)
    seconds = estimate(todo, chosen, arguments.results)
    trials = sum(len(job.seeds) for job in todo)
    print(f"{trials} missing trials: about {seconds / 3600:.1f} h on one free core", file=sys.stderr)
    if arguments.estimate or not todo:
        return
    run = start_run(arguments)
    with multiprocessing.get_context("spawn").Pool(arguments.jobs) as pool:
        progress(todo, pool.imap_unordered(simulate, todo), arguments, run)


if __name__ == "__main__":
    main()
