"""Compares `falsify -k falsify.keep-going=true` with random points and with repeated trials of the plain search, at equal budgets.

    python3 studies/experiments/keep_going/keep_going.py target/release/mishandle [SYSTEM ...]

Each method spends the same number of simulations per seed:

    keep-going  one trial with -k falsify.keep-going=true -k falsify.new-mode-rate=0
    random      one trial of --search random with -k falsify.keep-going=true -k falsify.new-mode-rate=0
    repeated    as many trials of the plain search as the budget allows; each ends at its first violation

Printed are means over the seeds, with the smallest and largest value: failures, modes (as `mishandle show` groups
those of one run), cells (pairwise cells of the space with a failure: 10 bins for each axis) and, for `toy/pits`, the pits with a
failure, of 6.
"""

import itertools
import json
import pathlib
import sqlite3
import subprocess
import sys
import tempfile

SEEDS = range(10)
SYSTEMS = {
    "pits": ("toy/pits", [], 300),
    "small-pits": ("toy/pits", ["--formula", "always(height >= -0.02 and clearance >= -0.02)"], 500),
    "idle-axes": ("toy/pits", ["--space", "starts+dynamics"], 500),
    "balance": ("ball-balancing", ["--controller", "ppo", "--space", "events"], 200),
    "reach": ("point-reaching", ["--controller", "ppo", "--space", "starts+events"], 200),
}
SEARCHES = ["portfolio", "turbo", "cma-es", "nelder-mead"]
SEARCHES_OF_TASKS = ["portfolio", "turbo"]
CENTERS = [(0.2, 0.2), (0.75, 0.25), (0.25, 0.75), (0.55, 0.55), (0.85, 0.6), (0.8, 0.9)]


def falsify(program, target, arguments, out):
    command = [program, "falsify", target, *arguments, "-k", "report.repeats=0", "--json", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(done.stderr)
    return json.loads(done.stdout)


def measure(program, target, run):
    listed = subprocess.run([program, "show", str(run), "--json"], capture_output=True, text=True, check=True)
    found = json.loads(listed.stdout)["counterexamples"]
    with sqlite3.connect(run) as file:
        bounds = file.execute("SELECT low, high FROM axis ORDER BY position").fetchall()
        rows = file.execute("SELECT unit_point FROM simulation WHERE robustness < 0").fetchall()
    points = [json.loads(point) for (point,) in rows]
    free = [axis for axis, (low, high) in enumerate(bounds) if low < high]
    cells = {
        (a, b, min(int(10 * point[a]), 9), min(int(10 * point[b]), 9))
        for point in points
        for a, b in itertools.combinations(free, 2)
    }
    result = {"failures": found["failures"], "modes": len(found["modes"]), "cells": len(cells)}
    if target == "toy/pits":
        distance = lambda point: [(point[0] - x) ** 2 + (point[1] - y) ** 2 for x, y in CENTERS]
        result["pits"] = len({min(range(6), key=distance(point).__getitem__) for point in points})
    return result


def repeated(program, target, arguments, budget, search, seed, folder):
    """Runs plain trials, and keeps those whose simulations together are at most the budget."""
    plain = [*arguments, "--search", search, "--seed", str(seed), "--budget", str(budget)]
    trials = falsify(program, target, [*plain, "--trials", "200"], folder / "all.sqlite")["trials"]
    sums = list(itertools.accumulate(trial["simulations"] for trial in trials))
    count = sum(total <= budget for total in sums)
    if count == len(trials):
        print(f"  {search}: 200 trials took only {sums[-1]} of {budget} simulations", file=sys.stderr)
    run = folder / "repeated.sqlite"
    if count == 0:
        return {"failures": 0, "modes": 0, "cells": 0, **({"pits": 0} if target == "toy/pits" else {})}
    falsify(program, target, [*plain, "--trials", str(count)], run)
    return measure(program, target, run)


def main():
    program, *chosen = sys.argv[1:]
    program = str(pathlib.Path(program).resolve())
    for name in chosen or SYSTEMS:
        target, arguments, budget = SYSTEMS[name]
        print(f"{name}: {target} {' '.join(arguments)}, {budget} simulations, seeds {SEEDS.start} to {SEEDS.stop - 1}")
        searches = SEARCHES if target.startswith("toy/") else SEARCHES_OF_TASKS
        for method, search in [("random", "random"), *itertools.product(["repeated", "keep-going"], searches)]:
            results = []
            for seed in SEEDS:
                with tempfile.TemporaryDirectory() as folder:
                    folder = pathlib.Path(folder)
                    if method == "repeated":
                        results.append(repeated(program, target, arguments, budget, search, seed, folder))
                        continue
                    own = [*arguments, "--search", search, "--seed", str(seed), "--trials", "1", "--budget", str(budget)]
                    run = folder / "run.sqlite"
                    falsify(program, target, [*own, "-k", "falsify.keep-going=true", "-k", "falsify.new-mode-rate=0"], run)
                    results.append(measure(program, target, run))
            cells = []
            for key in results[0]:
                values = [result[key] for result in results]
                cells.append(f"{key} {sum(values) / len(values):.1f} ({min(values)} to {max(values)})")
            print(f"  {method:10} {search:12} {', '.join(cells)}", flush=True)


if __name__ == "__main__":
    main()
