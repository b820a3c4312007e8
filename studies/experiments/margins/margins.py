"""Measures the smallest disturbance that breaks each shipped controller, and prints the table as Markdown.

Usage: python3 studies/experiments/margins/margins.py MISHANDLE FOLDER

Runs `mishandle margin TASK --controller NAME --space starts+disturbance` for all tasks and controllers. FOLDER gets the JSON document and
the witness of each, which `mishandle replay` runs again. Finished ones are not run again: `tar -xzf studies/experiments/margins/results.tar.gz`
makes the folder `results` of the table in studies/notebook/2026-11-23-margins.md.
"""

import json
import subprocess
import sys
from pathlib import Path

TASKS = [
    "point-reaching",
    "ball-balancing",
    "ball-catching",
    "ball-pushing",
    "door-opening",
    "peg-in-hole",
    "cube-stacking",
    "cloth-placing",
]
CONTROLLERS = ["ppo", "trpo", "sac", "td3", "ddpg"]
# A simulation of cloth takes about 0.5 s.
BUDGETS = {"cloth-placing": 300}
VIOLATED = 1  # exit code


def measure(mishandle: str, folder: Path, task: str, controller: str) -> dict:
    """Returns the JSON document of a controller, from the folder if it is there."""
    path = folder / f"{task}_{controller}.json"
    if not path.is_file():
        witness = folder / f"{task}_{controller}_witness.json"
        command = [mishandle, "margin", task, "--controller", controller, "--space", "starts+disturbance"]
        command += ["--json", "--force", "--out", str(witness)]
        if task in BUDGETS:
            command += ["--budget", str(BUDGETS[task])]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode not in (0, VIOLATED):
            sys.exit(done.stderr)
        if witness.is_file() and witness.stat().st_size == 0:
            witness.unlink()
        path.write_text(done.stdout)
        print(f"{task} {controller}", file=sys.stderr, flush=True)
    return json.loads(path.read_text())


def cell(document: dict) -> str:
    """Returns the amplitude of the witness, its axes, and the amplitude without a violation."""
    passed = document["no_violation_up_to"]
    below = "" if passed is None else f", none to {passed:.2f}"
    witness = document["witness"]
    if witness is None:
        return f"none to {passed:.2f}"
    return f"**{witness['amplitude']:.2f}** on {witness['axes']}{below}"


def main(mishandle: str, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    print("| task | " + " | ".join(f"`{name}`" for name in CONTROLLERS) + " |")
    print("|---|" + "---|" * len(CONTROLLERS))
    for task in TASKS:
        cells = [cell(measure(mishandle, folder, task, controller)) for controller in CONTROLLERS]
        print(f"| `{task}` | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
