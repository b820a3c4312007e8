"""Recomputes the paper's tables from the stored summaries with lifelines and SciPy, without Mishandle.

    pip install scipy==1.17.1 lifelines==0.30.3
    python studies/experiments/paper/recompute.py studies/experiments/paper/results/DATE

The values are those of studies/notebook/2026-11-28-paper. The intervals of DBR and TCT depend on the order of all episodes, so they are
stored in `evaluations.csv` and printed as they are; `studies reproduce verify` runs the episodes again.
"""

import csv
import itertools
import json
import pathlib
import sys
import tomllib

from lifelines import KaplanMeierFitter
from lifelines.statistics import logrank_test
from lifelines.utils import restricted_mean_survival_time
from scipy.stats import binomtest, mannwhitneyu


def rows(path: pathlib.Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def rate(part: int, n: int) -> str:
    """Returns a rate in percent with its Wilson interval."""
    interval = binomtest(part, n).proportion_ci(method="wilson")
    return f"{100 * part / n:.2f} [{100 * interval.low:.2f}, {100 * interval.high:.2f}]"


def mean(units: list[dict[str, str]], total: str, count: str, stored: dict[str, str], name: str) -> str:
    """Returns the mean of all units with the stored interval, and compares it with the stored mean."""
    n = sum(int(unit[count]) for unit in units)
    if n == 0:
        assert stored[name] == "", stored
        return "-"
    value = sum(float(unit[total]) for unit in units) / n
    low, high = (float(stored[f"{name.rsplit('_', 1)[0]}_{end}"]) for end in ("low", "high"))
    assert abs(value - float(stored[name])) <= 1e-9 * max(1, value) and low <= value <= high, (value, stored)
    return f"{value:.5f} [{low:.5f}, {high:.5f}]"


def performance(folder: pathlib.Path, runs: list[dict]) -> None:
    stored = {row["run"]: row for row in rows(folder / "evaluations.csv")}
    print("campaign, run, SR of the first 100, SR %, DBR, TCT, failing corners")
    for run in runs:
        units = [unit for unit in rows(folder / f"{run['name']}.csv") if unit["trial"] == "1"]
        successes, started = (sum(int(unit[name]) for unit in units) for name in ("successes", "started"))
        facts = stored[run["name"]]
        first = f"{100 * int(units[0]['successes']) / int(units[0]['started']):.0f}"
        danger = mean(units, "dangerous_sum", "dangerous_n", facts, "dangerous_rate")
        completion = mean(units, "completion_sum", "completed", facts, "completion_time")
        corners = f"{facts['failing_corners']} of {facts['corners']}"
        print(folder.name, run["name"], first, rate(successes, started), danger, completion, corners, sep=", ")


def falsification(folder: pathlib.Path, runs: list[dict]) -> None:
    groups: dict[tuple[str, ...], dict[str, tuple[list[int], list[bool]]]] = {}
    print("campaign, run, falsified, rate %, mean over successes, restricted mean, ended early, simulations, violations")
    for run in runs:
        plan = tomllib.loads(run["plan"])
        budget = plan["falsify"]["budget"]
        trials = rows(folder / f"{run['name']}.csv")
        failed = [int(trial["violations"]) > 0 for trial in trials]
        times = [int(trial["simulations"]) if is_failed else budget for trial, is_failed in zip(trials, failed)]
        successes = [time for time, is_failed in zip(times, failed) if is_failed]
        average = f"{sum(successes) / len(successes):.1f}" if successes else "-"
        restricted = restricted_mean_survival_time(KaplanMeierFitter().fit(times, failed), budget)
        early = sum(trial["status"] == "converged" for trial in trials)
        simulations, violations = (sum(int(trial[name]) for trial in trials) for name in ("simulations", "violations"))
        falsified = f"{len(successes)} of {len(times)}"
        values = rate(len(successes), len(times)), average, f"{restricted:.1f}", early, simulations
        print(folder.name, run["name"], falsified, *values, rate(violations, simulations), sep=", ")
        key = (folder.name, plan["target"], plan["controller"])
        groups.setdefault(key, {})[plan["falsify"]["search"]] = (times, failed)
    print("\ncampaign, target, controller, searches, log-rank chi-squared, p, A")
    for key, searches in groups.items():
        for (first, (a, a_failed)), (second, (b, b_failed)) in itertools.combinations(searches.items(), 2):
            if any(a_failed) or any(b_failed):
                test = logrank_test(a, b, a_failed, b_failed)
                effect = mannwhitneyu(a, b).statistic / (len(a) * len(b))
                values = f"{test.test_statistic:.2f}", f"{test.p_value:.4f}", f"{effect:.2f}"
                print(*key, f"{first} {second}", *values, sep=", ")


def main(folder: pathlib.Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    for campaign in manifest["campaigns"]:
        plans = [tomllib.loads(run["plan"]) for run in campaign["runs"]]
        for kind, show in (("evaluate", performance), ("falsify", falsification)):
            runs = [run for run, plan in zip(campaign["runs"], plans) if kind in plan]
            if runs:
                show(folder / campaign["name"], runs)
                print()


main(pathlib.Path(sys.argv[1]))
