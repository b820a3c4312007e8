"""Statistics of trials: restricted mean, success rate, effect size, paired tests. All of numbers of simulations, less is better."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

RESAMPLES = 2000
SEED = 0


def restricted(simulations: Sequence[int], violated: Sequence[bool], budget: int) -> NDArray[np.float64]:
    """Returns the simulations to the first violation; a trial without one counts as its budget, also if its search ended earlier."""
    return np.where(violated, simulations, budget).astype(float)


def mean_interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """Returns the 95 % percentile bootstrap interval of the mean."""
    random = np.random.default_rng(SEED)
    means = values[random.integers(0, len(values), (RESAMPLES, len(values)))].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def ratio_intervals(pairs: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> list[tuple[float, float]]:
    """Returns 95 % percentile bootstrap intervals of the sum of the first means over the sum of the second ones.

    A pair has the trials of two searches on a system, by seed. The first interval resamples seeds: it is about these systems. The second
    one resamples the systems, too: it is about systems like these.
    """
    random = np.random.default_rng(SEED)
    intervals = []
    for chosen in (np.tile(np.arange(len(pairs)), (RESAMPLES, 1)), random.integers(0, len(pairs), (RESAMPLES, len(pairs)))):
        means = np.empty((RESAMPLES, len(pairs), 2))
        for index, pair in enumerate(pairs):
            seeds = random.integers(0, len(pair[0]), (RESAMPLES, len(pair[0])))
            means[:, index] = np.stack([side[seeds].mean(axis=1) for side in pair], axis=1)
        sums = np.take_along_axis(means, chosen[:, :, None], axis=1).sum(axis=1)
        low, high = np.percentile(sums[:, 0] / sums[:, 1], [2.5, 97.5])
        intervals.append((float(low), float(high)))
    return intervals


def wilson_interval(successes: int, count: int) -> tuple[float, float]:
    """Returns the 95 % interval of a rate (Wilson 1927)."""
    z = float(stats.norm.ppf(0.975))
    rate = successes / count
    center = rate + z * z / (2 * count)
    half = z * math.sqrt(rate * (1 - rate) / count + z * z / (4 * count * count))
    scale = 1 + z * z / count
    return max(0.0, (center - half) / scale), min(1.0, (center + half) / scale)


def a12(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Returns the probability that a trial of the first search needs fewer simulations than one of the second, ties counted half.

    Vargha and Delaney, Journal of Educational and Behavioral Statistics 25(2), 2000, with the order of a cost: 1 is best.
    """
    return float((first[:, None] < second[None, :]).mean() + 0.5 * (first[:, None] == second[None, :]).mean())


def paired_p(first: NDArray[np.float64], second: NDArray[np.float64], alternative: str = "two-sided") -> float:
    """Returns the p-value of Wilcoxon's signed-rank test on pairs with the same seed. Pratt's ranks keep ties in the sample.

    With the alternative `greater`, the first search needs more simulations.
    """
    if (first == second).all():
        return 1.0
    return float(stats.wilcoxon(first, second, zero_method="pratt", alternative=alternative, method="approx").pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """Returns the p-values adjusted for the number of tests (Holm 1979)."""
    order = np.argsort(p_values)
    adjusted, largest = [0.0] * len(p_values), 0.0
    for rank, index in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = largest
    return adjusted
