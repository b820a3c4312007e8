"""Writes the learning curves with their bands as a tidy CSV file, from which the chart of studies/notebook/2026-11-22-skrl.md is drawn.

    cargo run -p mishandle-studies --example comparison_charts
"""

import csv

COLUMNS = ["task", "algorithm", "seeds", "side", "environment_steps", "mean", "low", "high"]


def write_bands(path, all_found):
    """Writes a row for each task, algorithm, side and point."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for found in all_found:
            for side, band in found["bands"].items():
                points = zip(found["environment_steps"], band["mean"], band["low"], band["high"])
                for point in points:
                    writer.writerow([found["task"], found["algorithm"], len(found["seeds"]), side, *point])
