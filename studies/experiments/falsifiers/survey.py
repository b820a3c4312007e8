"""Chooses and classifies the systems of the benchmark, without any search, and writes systems/TASK.toml and systems/functions.toml.

    python studies/experiments/falsifiers/survey.py                     # all of them, which takes an hour on one core
    python studies/experiments/falsifiers/survey.py --of ball-pushing functions

The rule, written before any search was run on the systems:

1. Candidates: each rigid task, space and formula (`success`, then `strict`) with TRIED shipped controllers: the first ones of their
   list, rotated by the number of the pair of task and space, so that all controllers take part.
2. A candidate is probed at UNIFORM uniform points and at all corners of its space, CORNERS random ones if there are more; a
   function at all corners. A space without continuous axes is enumerated. All simulations have random seed 0.
3. A candidate is a system if a point or a corner fails, and at most MOST of the uniform points fail.
4. For each pair of task and space, the first candidate that is a system is taken. Pairs without one have no system.
5. All functions of functions.py are systems. They come first in the list. None fails in the center of its box.

Kinds, from values at the uniform points (all are measured, nothing is judged by eye). The scale of a system is the range between the
5th and the 95th percentile of its robustness, or the largest difference to the median if that is 0:

| kind | criterion, the first that holds |
|---|---|
| needle | at most 2 % of the uniform points fail, and the rank correlation of robustness and distance to the nearest failing point of \
the probe is at most 0.1 among the others; a weak measure with many axes, where all distances are similar |
| cliff | robustness jumps by more than a tenth of the scale where it changes its sign: median over BOUNDARIES segments from a failing \
point to another one, halved HALVINGS times; or the space has no continuous axis |
| seam | of TRIPLES triples of points on a line at distances of BEND, at least 15 % bend: their two differences differ by more than \
half of the larger one, which is at least the median of all larger ones |
| smooth | all others |

A system is a corner case if a corner fails. These are reported apart.
"""

import argparse
import itertools
import os
import subprocess
import time
from collections.abc import Sequence
from typing import Any

# Processor time is measured.
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import mishandle
import numpy as np
from functions import FUNCTIONS, Function
from numpy.typing import NDArray
from scipy import stats
from systems import FUNCTIONS_FILE, NO_VERDICT, SYSTEMS, TASKS, function_value, of_task, task_value

SPACES = ["starts", "delay", "sensing", "drift", "dynamics", "events", "disturbance", "noise", "all"]
FORMULAS = ["success", "strict"]
CONTROLLERS = ["ppo", "trpo", "sac", "td3", "ddpg"]
UNIFORM, CORNERS, MOST, TRIED = 100, 64, 0.3, 3
BOUNDARIES, HALVINGS, TRIPLES, BEND = 5, 12, 25, 0.02
SEED = 20261123

Points = NDArray[np.float64]
Levels = Sequence[int | None]


def corner_points(levels: Levels, random: np.random.Generator, most: int = CORNERS) -> Points:
    d = len(levels)
    if 2**d <= most:
        return np.array(list(itertools.product([0.0, 1.0], repeat=d)))
    return random.integers(0, 2, (most, d)).astype(float)


def uniform_points(levels: Levels, random: np.random.Generator) -> Points:
    """Returns uniform points; all points of a space without continuous axes, if these are at most a thousand."""
    counts = [count for count in levels if count is not None]
    if len(counts) == len(levels) and np.prod(counts) <= 1000:
        return np.array([[(k + 0.5) / n for k, n in zip(point, counts)] for point in itertools.product(*map(range, counts))])
    return random.random((UNIFORM, len(levels)))


def probe(value: Any, levels: Levels, most: float) -> dict[str, Any] | None:
    """Returns the facts of a candidate; None if it is no system."""
    random = np.random.default_rng(SEED)
    points, corners = uniform_points(levels, random), corner_points(levels, random)
    values: list[float] = []
    for point in points:
        values.append(min(value(point, np.inf), NO_VERDICT))
        if sum(found < 0 for found in values) > most * len(points):
            return None
    at_corners = [min(value(corner, np.inf), NO_VERDICT) for corner in corners]
    failures, failing_corners = sum(found < 0 for found in values), sum(found < 0 for found in at_corners)
    if failures + failing_corners == 0:
        return None
    facts = {"uniform_points": len(points), "uniform_failures": failures, "corners": len(corners), "failing_corners": failing_corners}
    every = np.concatenate([points, corners])
    failing = every[np.array(values + at_corners) < 0]
    return {**facts, **classify(value, levels, points, np.array(values), failing, random)}


def classify(
    value: Any, levels: Levels, points: Points, values: Points, failing: Points, random: np.random.Generator
) -> dict[str, Any]:
    low, high = np.percentile(values, [5, 95])
    scale = float(high - low) or float(np.abs(values - np.median(values)).max()) or 1.0
    far = np.sqrt(((points[:, None, :] - failing[None, :, :]) ** 2).sum(axis=2)).min(axis=1)
    constant = np.ptp(values[values >= 0]) == 0 if (values >= 0).any() else True
    guidance = 0.0 if constant else float(stats.spearmanr(values[values >= 0], far[values >= 0]).statistic)
    passing = points[values >= 0]
    jump = boundary_jump(value, levels, failing, passing, random) / scale
    bends = bending(value, levels, points, random)
    if guidance <= 0.1 and (values < 0).mean() <= 0.02:
        kind = "needle"
    elif jump > 0.1:
        kind = "cliff"
    elif bends >= 0.15:
        kind = "seam"
    else:
        kind = "smooth"
    return {"kind": kind, "guidance": round(guidance, 3), "jump": round(jump, 3), "bends": round(bends, 3)}


def boundary_jump(value: Any, levels: Levels, failing: Points, passing: Points, random: np.random.Generator) -> float:
    """Returns the median jump of robustness where it changes its sign; infinity without a continuous axis."""
    if all(levels) or len(passing) == 0:
        return np.inf
    jumps = []
    for _ in range(BOUNDARIES):
        inside, outside = failing[random.integers(len(failing))], passing[random.integers(len(passing))]
        # Discrete axes jump by nature, so that they keep the value of the failing point.
        outside = np.where([count is None for count in levels], outside, inside)
        ends = [value(inside, np.inf), min(value(outside, np.inf), NO_VERDICT)]
        if ends[0] >= 0 or ends[1] < 0:
            continue
        for _ in range(HALVINGS):
            middle = (inside + outside) / 2
            found = min(value(middle, np.inf), NO_VERDICT)
            inside, outside = (middle, outside) if found < 0 else (inside, middle)
            ends[found >= 0] = found
        jumps.append(ends[1] - ends[0])
    return float(np.median(jumps)) if jumps else 0.0


def bending(value: Any, levels: Levels, points: Points, random: np.random.Generator) -> float:
    """Returns the fraction of triples on a line that bend. Only continuous axes move."""
    free = np.array([count is None for count in levels])
    if not free.any():
        return 0.0
    differences = []
    for start in points[random.choice(len(points), TRIPLES)]:
        direction = np.abs(random.normal(size=len(levels)) * free)
        # Towards the center, so that no point leaves the box.
        direction *= np.where(start < 0.5, 1, -1) / np.linalg.norm(direction)
        first, second, third = (min(value(start + k * BEND * direction, np.inf), NO_VERDICT) for k in range(3))
        differences.append((second - first, third - second))
    larger = np.abs(differences).max(axis=1)
    bends = np.abs(np.diff(differences, axis=1)[:, 0]) > 0.5 * larger
    return float((bends & (larger > 0) & (larger >= np.median(larger))).mean())


def survey_pair(arguments: tuple[int, str, str]) -> tuple[dict[str, Any] | None, list[str]]:
    """Returns the system of a task and a space, and a line for each probed candidate."""
    number, task, space = arguments
    turn = number % len(CONTROLLERS)
    order = (CONTROLLERS[turn:] + CONTROLLERS[:turn])[:TRIED]
    log = []
    for formula, controller in itertools.product(FORMULAS, order):
        name = f"{task}/{controller}/{space}/{formula}"
        try:
            objective = of_task(task, controller, space, formula)
        except ValueError as error:
            return None, [f"{name}: {error}"]
        started = time.process_time()
        facts = probe(task_value(objective), objective.levels, MOST)
        log.append(f"{name}: {time.process_time() - started:.1f} s, {facts or 'no system'}")
        if facts is not None:
            row: dict[str, Any] = {"name": name, "group": "task", "task": task, "controller": controller, "space": space, "formula": formula}
            # TOML has no null: 0 is a continuous axis.
            row["axes"] = [axis.name for axis in objective.space]
            row |= {"dimension": len(objective.levels), "levels": [count or 0 for count in objective.levels]}
            return {**row, **facts, "simulation_ms": simulation_ms(objective)}, log
    return None, log


def simulation_ms(objective: mishandle.ask.Objective) -> float:
    """Returns the processor time of a simulation in milliseconds."""
    points = np.random.default_rng(SEED).random((10, len(objective.levels)))
    started = time.process_time()
    for point in points:
        objective([point])
    return round(100 * (time.process_time() - started), 2)


def survey_function(function: Function) -> dict[str, Any]:
    """A function is a system whatever the probe finds: its violating volume is known."""
    value, levels = function_value(function), function.axis_levels()
    random = np.random.default_rng(SEED)
    corners = corner_points(levels, random, 2**20)
    failing_corners = int((function.values(corners) < 0).sum())
    points = random.random((300_000, function.dimension))
    values = function.values(points)
    # In the smallest volumes, no point fails; the lowest ones are next to them.
    failing = points[values < 0][:1000] if (values < 0).any() else points[np.argsort(values)[:10]]
    facts = classify(value, levels, points[:UNIFORM], values[:UNIFORM], failing, random)
    row = {"name": function.name, "group": "function", "dimension": function.dimension, "volume": function.volume}
    return {**row, "corners": len(corners), "failing_corners": failing_corners, **facts}


def toml(value: Any) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value).replace("'", '"')


def survey(of: str) -> None:
    """Writes the file of a task or of the functions."""
    if of == FUNCTIONS_FILE:
        write(of, [survey_function(function) for function in FUNCTIONS])
        return
    rows = []
    for number, (task, space) in enumerate(itertools.product(TASKS, SPACES)):
        if task == of:
            row, log = survey_pair((number, task, space))
            print("\n".join(log), flush=True)
            rows += [row] if row else []
    write(of, rows)


def main() -> None:
    known = [FUNCTIONS_FILE, *TASKS]
    parser = argparse.ArgumentParser(description="chooses and classifies the systems of the benchmark")
    parser.add_argument("--of", nargs="+", choices=known, default=known, metavar="NAME", help="tasks, or functions; by default all")
    for of in parser.parse_args().of:
        survey(of)


def write(of: str, rows: list[dict[str, Any]]) -> None:
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=SYSTEMS, stdout=subprocess.PIPE, text=True)
    head = f"# Written by survey.py, which states the rule. Commit {commit.stdout.strip()}, {time.strftime('%Y-%m-%d')}.\n"
    body = ["\n[[system]]\n" + "".join(f"{key} = {toml(value)}\n" for key, value in row.items()) for row in rows]
    (SYSTEMS / f"{of}.toml").write_text(head + "".join(body), encoding="utf-8")


if __name__ == "__main__":
    main()
