"""Draws studies/notebook/2026-11-25-gpu-training.svg: validation of controllers that were trained on a GPU, from the learning curves in this folder.

    python studies/experiments/gpu/curves.py
"""

from __future__ import annotations

import csv
from pathlib import Path

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams["svg.hashsalt"] = "mishandle"
import matplotlib.pyplot as plt

HERE = Path(__file__).resolve().parent
PICTURE = HERE.parents[1] / "notebook/2026-11-25-gpu-training.svg"
TASKS = ("point-reaching", "ball-balancing", "cube-stacking", "ball-catching", "ball-pushing", "door-opening", "peg-in-hole")


def validations(path: Path) -> tuple[list[float], list[float]]:
    """Returns wall-clock times (s) and strict success rates (%) of a curve."""
    with path.open() as file:
        rows = [row for row in csv.DictReader(file) if row["strict_success_rate"]]
    return [float(row["wall_clock_secs"]) for row in rows], [100 * float(row["strict_success_rate"]) for row in rows]


figure, plots = plt.subplots(2, 4, figsize=(11, 5), layout="constrained")
for task, plot in zip(TASKS, plots.flat):
    for seed in range(3):
        path = HERE / f"curves/{task}-s{seed}.csv"
        if path.exists():
            plot.plot(*validations(path), label=f"GPU, seed {seed}")
    cpu = HERE / f"curves/{task}-cpu-s0.csv"
    if cpu.exists():
        plot.plot(*validations(cpu), "k--", label="16 CPU cores, seed 0")
    plot.set(title=task, ylim=(0, 102), xlim=(0, None))
    plot.grid(alpha=0.3)
    plot.legend(fontsize=7, loc="lower right")
plots.flat[-1].set_axis_off()
figure.supxlabel("wall-clock time, s")
figure.supylabel("strict success rate in validation, %")
figure.savefig(PICTURE, metadata={"Date": None})
