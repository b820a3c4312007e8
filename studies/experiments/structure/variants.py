"""The variants: which parts have a model of their own, and how the models are composed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from formulas import Parts
from model import asinh_targets, finite, median_and_scale, standardized
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp

Array = NDArray[np.float64]
Tree = tuple[str, list["Tree"]] | int
"""A leaf is the number of a model; a node is a minimum or maximum."""

Targets = Callable[[list[Parts]], list[tuple[Array, float]]]
Shape = list[tuple[bool, int]]


@dataclass(frozen=True)
class Variant:
    """`targets` returns, for each model, its targets and the target of 0. `score` is `bound` or `probability`."""

    name: str
    tree: Callable[[Shape, int], Tree]
    targets: Targets
    score: str


def whole(shape: Shape, windows: int) -> Tree:
    return 0


def of_conjuncts(shape: Shape, windows: int) -> Tree:
    return ("min", list(range(sum(count for _, count in shape))))


def of_conjuncts_and_whole(shape: Shape, windows: int) -> Tree:
    """The minimum of the conjuncts alone and of the robustness is the robustness, also below `eventually`."""
    return ("min", list(range(sum(count for _, count in shape) + 1)))


def of_windows(shape: Shape, windows: int) -> Tree:
    nodes: list[Tree] = []
    first = 0
    for eventually, count in shape:
        leaf = lambda conjunct, window, first=first: (first + conjunct) * windows + window
        per_window: list[Tree] = [("min", [leaf(i, w) for i in range(count)]) for w in range(windows)]
        nodes.append(("max" if eventually else "min", per_window))
        first += count
    return ("min", nodes)


def robustness(found: list[Parts]) -> list[tuple[Array, float]]:
    return [asinh_targets(np.array([one.robustness for one in found]))]


def each(rows: Array) -> list[tuple[Array, float]]:
    return [asinh_targets(column) for column in rows.T]


def alone(found: list[Parts]) -> list[tuple[Array, float]]:
    return each(np.stack([one.alone for one in found]))


def alone_and_whole(found: list[Parts]) -> list[tuple[Array, float]]:
    return alone(found) + robustness(found)


def decisive(found: list[Parts]) -> list[tuple[Array, float]]:
    return each(np.stack([one.decisive for one in found]))


def windows(found: list[Parts]) -> list[tuple[Array, float]]:
    return each(np.stack([one.windows.ravel() for one in found]))


# Differences below this share of the median distance from a violation are ties.
TIE = 0.01
# The most that a secondary signal moves a target, in standard deviations.
SPREAD = 0.5


def untied(found: list[Parts]) -> list[tuple[Array, float]]:
    """Targets of the robustness in which points of a plateau are ordered by a secondary signal: the mean over conjuncts and
    windows of their asinh-transformed robustness. The order of points of different plateaus never changes."""
    values = finite(np.array([one.robustness for one in found]))
    rows = np.stack([finite(column) for column in np.stack([one.windows.ravel() for one in found]).T])
    scales = [median_and_scale(row) for row in rows]
    secondary = np.mean([np.arcsinh((row - middle) / scale) for row, (middle, scale) in zip(rows, scales)], axis=0)
    order = np.argsort(values, kind="stable")
    groups, tolerance = [[order[0]]], TIE * np.median(np.abs(values))
    for i in order[1:]:
        if values[i] - values[groups[-1][0]] <= tolerance and (values[i] < 0) == (values[groups[-1][0]] < 0):
            groups[-1].append(i)
        else:
            groups.append([i])
    leveled = values.copy()
    for group in groups:
        leveled[group] = values[group].mean()
    targets, level = asinh_targets(leveled)
    heights = [targets[group[0]] for group in groups]
    for k, group in enumerate(groups):
        if len(group) > 1:
            room = min(SPREAD, 0.5 * (heights[k + 1] - heights[k])) if k + 1 < len(groups) else SPREAD
            ranks = np.argsort(np.argsort(secondary[group], kind="stable"), kind="stable")
            targets[group] += room * ranks / (len(group) - 1)
    return [standardized(targets, level)]


VARIANTS = {
    variant.name: variant
    for score in ("bound", "probability")
    for variant in (
        Variant(f"whole-{score}", whole, robustness, score),
        Variant(f"conjuncts-{score}", of_conjuncts, alone, score),
        Variant(f"conjuncts-whole-{score}", of_conjuncts_and_whole, alone_and_whole, score),
        Variant(f"decisive-{score}", of_conjuncts, decisive, score),
        Variant(f"windows-{score}", of_windows, windows, score),
        Variant(f"untied-{score}", whole, untied, score),
    )
}


def composed_bound(tree: Tree, heights: list[Array]) -> Array:
    """Composes bounds of the leaves: a bound of the composition, because minima and maxima are monotone."""
    if isinstance(tree, int):
        return heights[tree]
    kind, children = tree
    found = np.stack([composed_bound(child, heights) for child in children])
    return np.asarray(found.min(0) if kind == "min" else found.max(0))


def log_probability(tree: Tree, heights: list[Array]) -> Array:
    """Returns the logarithm of the probability that the tree is below 0, for independent leaves whose means are these numbers
    of standard deviations above 0."""
    if isinstance(tree, int):
        return np.asarray(log_ndtr(-heights[tree]))
    kind, children = tree
    found = np.stack([log_probability(child, heights) for child in children])
    if kind == "max":
        return np.asarray(found.sum(0))
    # 1 - Π (1 - p); for small p the sum of p, whose logarithm does not underflow.
    exact = np.log(-np.expm1(np.log1p(-np.minimum(np.exp(found), 1 - 1e-16)).sum(0)) + 1e-300)
    return np.where(found.max(0) < -15, logsumexp(found, axis=0), exact)
