"""Prints which spaces break which controllers, as Markdown, from the run files of campaigns.

Usage: python3 studies/experiments/spaces/table.py FOLDER...

A cell has the share of random scenarios of the space in which the controller violates the formula `success`, in percent, and the
mean number of simulations that the search needed for a violation (a dash: no violation in any trial).
"""

import sqlite3
import sys
import tomllib
from pathlib import Path

RANDOM_TRIAL = 1  # the corners of the space are another trial
SPACES = ["starts", "delay", "sensing", "drift", "dynamics", "events", "disturbance", "noise", "all"]
CONTROLLERS = ["ppo", "trpo", "sac", "td3", "ddpg"]


def read(path: Path) -> tuple[tuple[str, str, str], str, str]:
    """Returns target, controller and space of a run, its kind, and the text of its result; "?" if it is not finished."""
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as run:
        header = dict(run.execute("SELECT * FROM header"))
        plan = tomllib.loads(header["plan"])
        key = (plan["target"], plan["controller"], plan["space"])
        if header["kind"] == "evaluate":
            values = [row[0] for row in run.execute("SELECT robustness FROM simulation WHERE trial = ?", (RANDOM_TRIAL,))]
            if len(values) < plan["evaluate"]["episodes"]:
                return key, "rate", "?"
            failures = sum(value is not None and value < 0 for value in values)
            return key, "rate", f"{100 * failures / len(values):g} %"
        trials = list(run.execute("SELECT status, simulations FROM trials"))
        if len(trials) < plan["falsify"]["trials"] or any(status == "running" for status, _ in trials):
            return key, "search", "?"
        needed = [simulations for status, simulations in trials if status == "falsified"]
        if not needed:
            return key, "search", "–"
        missed = "" if len(needed) == len(trials) else f" ({len(needed)} of {len(trials)})"
        return key, "search", f"{sum(needed) / len(needed):.0f}{missed}"


def main(folders: list[str]) -> None:
    cells: dict[tuple[str, str, str], dict[str, str]] = {}
    for path in (path for folder in folders for path in sorted(Path(folder).glob("*.sqlite"))):
        key, kind, text = read(path)
        cells.setdefault(key, {})[kind] = text
    spaces = [space for space in SPACES if any(key[2] == space for key in cells)]
    print("| task | controller | " + " | ".join(f"`{space}`" for space in spaces) + " |")
    print("|---|---|" + "--:|" * len(spaces))
    rows = sorted({key[:2] for key in cells}, key=lambda row: (row[0], CONTROLLERS.index(row[1])))
    for target, controller in rows:
        row = [cells.get((target, controller, space), {}) for space in spaces]
        texts = [f"{cell.get('rate', '?')} / {cell.get('search', '?')}" if cell else "" for cell in row]
        print(f"| `{target}` | `{controller}` | " + " | ".join(texts) + " |")


if __name__ == "__main__":
    main(sys.argv[1:])
