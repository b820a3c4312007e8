"""Chooses the tasks of the ablation by a rule that uses no search, and writes systems.toml.

For each formula, pairs of a shipped controller and a space are tried in a random order. A pair is taken at the largest share of the
space's ranges at which the nominal scenario satisfies the formula, at most 2 of 64 Sobol points and 2 of 64 corners violate it, and
at least one of them does. Smaller shares than one without a violation are not tried. A formula has no two systems with the same
space, and at most as many systems as QUOTAS says.
"""

import itertools

import numpy as np
from scipy.stats import qmc
from systems import FILE, System, task_system

CONTROLLERS = ["ppo", "trpo", "sac", "td3", "ddpg"]
SPACES = ["starts", "dynamics", "sensing", "drift", "events", "disturbance"]
SHARES = [1.0, 0.8, 0.65, 0.5, 0.4, 0.3]
POINTS, MOST_INSIDE, MOST_AT_CORNERS = 64, 2, 2
# The last two formulas have one predicate: only their time windows differ.
QUOTAS = {
    ("ball-balancing", "strict"): 3,
    ("ball-pushing", "strict"): 3,
    ("cube-stacking", "strict"): 3,
    ("cube-stacking", "success"): 1,
    ("peg-in-hole", "strict"): 3,
    ("ball-catching", "strict"): 2,
    ("ball-catching", "success"): 1,
    ("door-opening", "strict"): 1,
}
MOST_TRIED = 8


def failures(system: System, points: np.ndarray, most: int) -> int:
    """Returns the number of violations, or more than `most` of them."""
    count = 0
    for point in points:
        count += system.simulate(point).robustness < 0
        if count > most:
            break
    return count


def measured(system: System) -> tuple[int, int]:
    """Returns the failing Sobol points and corners of a system, as far as the rule needs them."""
    center = failures(system, np.full((1, system.dimension), 0.5), 0)
    corners = np.unique(np.random.default_rng(11).integers(0, 2, (POINTS, system.dimension)), axis=0).astype(float)
    at_corners = failures(system, corners, MOST_AT_CORNERS)
    if center or at_corners > MOST_AT_CORNERS:
        return MOST_INSIDE + 1, at_corners
    return failures(system, qmc.Sobol(system.dimension, seed=11).random(POINTS), MOST_INSIDE), at_corners


def chosen(task: str, formula: str, quota: int) -> list[str]:
    pairs = list(itertools.product(CONTROLLERS, SPACES))
    np.random.default_rng([7, *f"{task}/{formula}".encode()]).shuffle(pairs)
    rows, spaces = [], set()
    for controller, space in pairs[: MOST_TRIED * quota]:
        if space in spaces or len(rows) == quota:
            continue
        for share in SHARES:
            found = measured(task_system(task, controller, space, formula, share))
            print(task, controller, space, formula, share, found, flush=True)
            if sum(found) == 0:
                break
            if found[0] <= MOST_INSIDE and found[1] <= MOST_AT_CORNERS:
                spaces.add(space)
                head = f'task = "{task}"\ncontroller = "{controller}"\nspace = "{space}"\nformula = "{formula}"\nshare = {share}\n'
                rows.append(f"[[system]]\n{head}failing_points = {found[0]}\nfailing_corners = {found[1]}\n")
                break
    return rows


def main() -> None:
    rows = [row for (task, formula), quota in QUOTAS.items() for row in chosen(task, formula, quota)]
    FILE.write_text("# Written by survey.py, which states the rule.\n\n" + "\n".join(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
