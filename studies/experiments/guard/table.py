"""Prints the table of the README from results.jsonl: python3 studies/experiments/guard/table.py

With folders of `run.sh` as arguments, writes results.jsonl first: one tuning per line, without its
curve, its axes and its paths.
"""

import json
import sys
from pathlib import Path

RESULTS = Path(__file__).parent / "results.jsonl"


def percent(estimate):
    if estimate["value"] is None:
        return "-"
    value, low, high = (100 * estimate[key] for key in ("value", "low", "high"))
    return f"{value:.1f} [{low:.1f}, {high:.1f}] %"


def failure(estimate):
    """The share of failures of a success rate."""
    flipped = {"value": 1 - estimate["value"], "low": 1 - estimate["high"], "high": 1 - estimate["low"]}
    return percent(flipped)


def collect(folders):
    found = []
    for folder in folders:
        for path in sorted(Path(folder).glob("*.json")):
            result = json.loads(path.read_text())
            for key in ("curve", "space_axes", "axes", "folder", "guard_file"):
                del result[key]
            found.append({"guard_name": path.stem, **result})
    RESULTS.write_text("".join(json.dumps(result) + "\n" for result in found))


def row(result):
    guarded, alarms, lead = result["guarded"], result["held_out"], result["lead"]
    difference = guarded["difference"]
    points = "{:+.1f} [{:+.1f}, {:+.1f}]".format(*(-100 * difference[key] for key in ("value", "high", "low")))
    seconds = f"{lead['median']:.2f} ({lead['low']:.2f} to {lead['high']:.2f})" if lead else "-"
    area = alarms["area"]["value"]
    return [
        result["guard_name"],
        f"{result['guard']['threshold']}",
        failure(guarded["first"]),
        failure(guarded["second"]),
        points,
        f"{guarded['second_only']} / {guarded['first_only']}",
        failure(result["fallback"]["second"]),
        percent(alarms["missed"]),
        percent(alarms["false_alarms"]),
        "-" if area is None else f"{area:.2f}",
        seconds,
        str(guarded["difference"]["n"]),
    ]


HEAD = [
    "guard",
    "threshold",
    "failures alone",
    "guarded",
    "difference, points",
    "saved / broken",
    "fallback alone",
    "missed",
    "false alarms",
    "area",
    "alarm to failure, s",
    "n",
]

if sys.argv[1:]:
    collect(sys.argv[1:])
results = [json.loads(line) for line in RESULTS.read_text().splitlines()]
for cells in [HEAD, ["---"] * len(HEAD), *map(row, results)]:
    print("|", " | ".join(cells), "|")
