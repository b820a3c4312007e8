"""Compares the adversary with searches on a task: see studies/notebook/2026-11-27-adversary.md.

    python3 studies/experiments/adversary/compare.py TASK SPACE BOUND BUDGET TRIALS SEED FORMULA OUT

BOUND narrows the disturbances of the actions; an empty FORMULA is the task's success. OUT gets a line of JSON for each search.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

PROGRAM = "target/debug/mishandle"
SEARCHES = ["adversary", "portfolio", "cma-es", "random"]


def plan(task, space, bound, search, seed, trials, budget, formula):
    """Returns a plan as TOML."""
    lines = [f'target = "{task}"', 'controller = "ppo"', f'space = "{space}"', f"seed = {seed}", "[axes]"]
    if "disturbance" in space:
        axes = [f"disturbance_joint{joint}_{second}" for joint in range(1, 8) for second in range(1, 6)]
        lines += [f"{axis} = [{-bound}, {bound}]" for axis in axes]
    lines += ["[falsify]", f'search = "{search}"', f"trials = {trials}", f"budget = {budget}", "isolate = false"]
    return "\n".join([*lines, f'formula = "{formula}"'] if formula else lines)


def main():
    """Runs all searches."""
    task, space, bound, budget, trials, seed, formula, out = sys.argv[1:9]
    for search in SEARCHES:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "plan.toml")
            file.write_text(plan(task, space, float(bound), search, int(seed), int(trials), int(budget), formula))
            command = [PROGRAM, "falsify", "--plan", file, "--json", "--repeats", "0", "--out", Path(folder, "run.sqlite")]
            result = json.loads(subprocess.run(command, capture_output=True, text=True, check=False).stdout)
        trial = lambda found: [found["simulations"], found["falsified"], found["minimum_robustness"]]  # noqa: E731
        facts = {"task": task, "space": space, "bound": float(bound), "formula": formula, "seed": int(seed)}
        row = facts | {"search": search, "budget": int(budget), "steps": result["control_steps"]}
        with Path(out).open("a") as lines:
            lines.write(json.dumps(row | {"trials": [trial(found) for found in result["trials"]]}) + "\n")


main()
