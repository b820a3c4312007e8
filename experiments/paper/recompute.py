"""Recomputes the table of falsification from the stored rows with lifelines and SciPy, without Mishandle.

    pip install scipy==1.17.1 lifelines==0.30.3
    python experiments/paper/recompute.py experiments/paper/results/DATE

The last columns of its first table are those of docs/notebook/2026-11-23-paper/falsification.md.
"""

import csv
import gzip
import itertools
import json
import pathlib
import sys
import tomllib

from lifelines import KaplanMeierFitter
from lifelines.statistics import logrank_test
from lifelines.utils import restricted_mean_survival_time
from scipy.stats import mannwhitneyu


def lifetimes(path: pathlib.Path, budget: int) -> tuple[list[int], list[bool]]:
    """Returns per trial the number of simulations to the first violation, or the budget, and whether there is one."""
    found: dict[str, int] = {}
    trials: dict[str, None] = {}
    with gzip.open(path, "rt", newline="") as file:
        for row in csv.DictReader(file):
            trials.setdefault(row["trial"])
            if row["robustness"] and float(row["robustness"]) < 0:
                found.setdefault(row["trial"], int(row["simulation"]))
    return [found.get(trial, budget) for trial in trials], [trial in found for trial in trials]


def main(folder: pathlib.Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    groups: dict[tuple[str, ...], dict[str, tuple[list[int], list[bool]]]] = {}
    print("campaign, run, falsified, mean over successes, restricted mean")
    for campaign in manifest["campaigns"]:
        for run in campaign["runs"]:
            plan = tomllib.loads(run["plan"])
            if "falsify" not in plan:
                continue
            budget = plan["falsify"]["budget"]
            times, failed = lifetimes(folder / campaign["name"] / f"{run['name']}.csv.gz", budget)
            successes = [time for time, is_failed in zip(times, failed) if is_failed]
            mean = f"{sum(successes) / len(successes):.1f}" if successes else "-"
            restricted = restricted_mean_survival_time(KaplanMeierFitter().fit(times, failed), budget)
            print(campaign["name"], run["name"], f"{len(successes)} of {len(times)}", mean, f"{restricted:.1f}", sep=", ")
            key = (campaign["name"], plan["target"], plan["controller"])
            groups.setdefault(key, {})[plan["falsify"]["search"]] = (times, failed)
    print("\ncampaign, target, controller, searches, log-rank chi-squared, p, A")
    for key, searches in groups.items():
        for (first, (a, a_failed)), (second, (b, b_failed)) in itertools.combinations(searches.items(), 2):
            if any(a_failed) or any(b_failed):
                test = logrank_test(a, b, a_failed, b_failed)
                effect = mannwhitneyu(a, b).statistic / (len(a) * len(b))
                values = f"{test.test_statistic:.2f}", f"{test.p_value:.4f}", f"{effect:.2f}"
                print(*key, f"{first} {second}", *values, sep=", ")


main(pathlib.Path(sys.argv[1]))
