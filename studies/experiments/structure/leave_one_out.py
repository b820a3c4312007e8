"""How well each variant's models predict points that they have not seen: closed-form leave-one-out on one design for each system."""

import csv
import pathlib

import numpy as np
from formulas import Parts
from model import Array
from scipy.stats import qmc, rankdata
from search import Models
from systems import System
from variants import VARIANTS, composed_bound, log_probability

POINTS = 100
KINDS = ["whole", "conjuncts", "conjuncts-whole", "decisive", "windows", "untied"]
# A probability this close to 0 or 1 counts as this one, so that one wrong certainty does not decide
# a mean logarithm.
CERTAIN = 1e-3


def design(system: System) -> Array:
    """Sobol points, every second of which has a random half of its coordinates at a bound, so that some points fail."""
    points = qmc.Sobol(system.dimension, seed=29).random(128)[:POINTS]
    random = np.random.default_rng(29)
    at_bound = random.random(points.shape) < 0.5
    at_bound[::2] = False
    points[at_bound] = np.round(points[at_bound])
    return np.asarray(points)


def figures(system: System, kind: str, points: Array, found: list[Parts]) -> dict[str, float]:
    models = Models(VARIANTS[f"{kind}-probability"], system)
    models.learn(points, found)
    models.next_fit = 0
    models.learn(points, found)
    predictions = [process.leave_one_out() for process in models.processes]
    middles = composed_bound(models.tree, [mean - level for (mean, _), level in zip(predictions, models.levels)])
    heights = [(mean - level) / deviation for (mean, deviation), level in zip(predictions, models.levels)]
    scores = log_probability(models.tree, heights)
    probability = np.clip(np.exp(scores), CERTAIN, 1 - CERTAIN)
    values = np.array([one.robustness for one in found])
    failed = values < 0
    return {
        "violations": float(failed.sum()),
        "rank_correlation": rank_correlation(middles, values),
        "auc": area(scores, failed),
        "log_loss": float(-np.where(failed, np.log(probability), np.log(1 - probability)).mean()),
        "predicted": float(probability.sum()),
    }


def rank_correlation(a: Array, b: Array) -> float:
    a, b = rankdata(a), rankdata(b)
    return float(np.corrcoef(a, b)[0, 1]) if a.std() > 0 and b.std() > 0 else 0.0


def area(scores: Array, failed: np.ndarray) -> float:
    """Returns the probability that a violation has a higher score than a satisfied point; NaN without both."""
    n = int(failed.sum())
    if n in (0, len(failed)):
        return float("nan")
    return float((rankdata(scores)[failed].sum() - n * (n + 1) / 2) / (n * (len(failed) - n)))


def write(systems: list[System], path: pathlib.Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        for i, system in enumerate(systems):
            points = design(system)
            found = [system.simulate(point) for point in points]
            decided = np.stack([one.decisive for one in found])
            # The share of the points at which the most frequent conjunct sets the robustness, and
            # at which it is negative itself.
            sets = np.bincount(decided.argmin(1), minlength=decided.shape[1])
            facts = {"sets": sets.max() / POINTS, "sets_and_fails": float((decided[:, sets.argmax()] < 0).mean())}
            for kind in KINDS:
                row = {"system": system.name, "kind": kind} | figures(system, kind, points, found) | facts
                if i == 0 and kind == KINDS[0]:
                    writer.writerow(row)
                writer.writerow([f"{cell:.4g}" if isinstance(cell, float) else cell for cell in row.values()])
            file.flush()
            print(system.name, flush=True)
