"""Summarizes the curves of curves.py: interquartile means with bootstrap bands, their overlap, a table for studies/notebook/2026-11-22-skrl.md."""

import csv
import json

import numpy as np

from bands import write_bands
from curves import ALGORITHMS, CURVES, SIDES, TASKS, curve_path
from page import insert

POINTS = 20
RESAMPLES = 10_000
SEEDS = range(1, 11)
# Fewest seeds with a bootstrap interval.
FEWEST_SEEDS = 5
BANDS = CURVES.parent / "bands.csv"


def read(path):
    with open(path, newline="", encoding="utf-8") as file:
        rows = [(float(row["environment_steps"]), float(row["mean_return"])) for row in csv.DictReader(file)]
    return np.array(rows).reshape(-1, 2)


def binned(curve, edges):
    """Returns the mean return between adjacent edges: the one before where no episode ended, NaN before the first."""
    places = np.searchsorted(edges, curve[:, 0], side="left") - 1
    means = np.full(POINTS, np.nan)
    for point in range(POINTS):
        here = curve[places == point, 1]
        if len(here):
            means[point] = here.mean()
        elif point:
            means[point] = means[point - 1]
    return means


def interquartile_mean(values):
    """Returns the mean over the last axis without the lowest and the highest quarter, rounded down."""
    count = values.shape[-1]
    cut = count // 4
    return np.sort(values, axis=-1)[..., cut : count - cut].mean(axis=-1)


def band(values, random):
    """Returns the interquartile mean over the seeds (the last axis) and its 95 % bootstrap interval."""
    count = values.shape[-1]
    drawn = random.integers(0, count, (RESAMPLES, count))
    resampled = interquartile_mean(values[..., drawn])
    low, high = np.percentile(resampled, [2.5, 97.5], axis=-1)
    return {"mean": interquartile_mean(values), "low": low, "high": high}


def compare(task, algorithm):
    """Compares both sides on a task and algorithm over the seeds that both have; returns None if there are none."""
    have = [seed for seed in SEEDS if all(curve_path(task, algorithm, side, seed).exists() for side in SIDES)]
    if not have:
        return None
    curves = {side: [read(curve_path(task, algorithm, side, seed)) for seed in have] for side in SIDES}
    end = max(curve[-1, 0] for side in SIDES for curve in curves[side])
    edges = np.linspace(0.0, end, POINTS + 1)
    values = {side: np.array([binned(curve, edges) for curve in curves[side]]).T for side in SIDES}
    measured = ~np.isnan(values["skrl"]).any(axis=1) & ~np.isnan(values["mishandle"]).any(axis=1)
    random = np.random.default_rng(0)
    bands = {side: band(values[side][measured], random) for side in SIDES}
    ours, theirs = (bands[side] for side in SIDES)
    overlap = (ours["low"] <= theirs["high"]) & (theirs["low"] <= ours["high"])
    whole = {side: band(values[side][measured].mean(axis=0), random) for side in SIDES}
    return {
        "task": task,
        "algorithm": algorithm,
        "seeds": have,
        "environment_steps": edges[1:][measured].tolist(),
        "overlap": float(overlap.mean()),
        "whole_curve": {side: {key: float(value) for key, value in whole[side].items()} for side in SIDES},
        "bands": {side: {key: value.tolist() for key, value in bands[side].items()} for side in SIDES},
    }


def row(found):
    def side(name):
        mean, low, high = (found["whole_curve"][name][key] for key in ["mean", "low", "high"])
        return f"{mean:.1f} ({low:.1f} to {high:.1f})"

    points = len(found["environment_steps"])
    apart = round(points * (1 - found["overlap"]))
    overlap = f"{points - apart} of {points}" if len(found["seeds"]) >= FEWEST_SEEDS else "too few seeds"
    cells = [f"`{found['task']}`", found["algorithm"].upper(), len(found["seeds"]), side("mishandle"), side("skrl")]
    return "| " + " | ".join(map(str, [*cells, overlap])) + " |"


def table(all_found):
    head = "| task | algorithm | seeds | mean return, Mishandle | mean return, skrl | points where bands overlap |"
    return "\n".join([head, "|---|---|--:|--:|--:|--:|", *map(row, all_found)])


def write():
    pairs = [(task, algorithm) for task in TASKS for algorithm in ALGORITHMS]
    all_found = [found for pair in pairs if (found := compare(*pair))]
    (CURVES / "summary.json").write_text(json.dumps(all_found, indent=1) + "\n", encoding="utf-8")
    write_bands(BANDS, all_found)
    insert("curves", table(all_found))
    print(table(all_found))
