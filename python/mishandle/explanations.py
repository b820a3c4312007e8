"""Explanations, failure modes and comparisons of recorded simulations."""

from __future__ import annotations

import os
import pathlib
from dataclasses import dataclass
from typing import Any

from mishandle import _native
from mishandle.axes import Value


@dataclass(frozen=True)
class Estimate:
    """A rate or mean with its 95 % interval."""

    value: float | None
    low: float | None
    high: float | None
    n: int


@dataclass(frozen=True)
class Predicate:
    """The predicate and sample that decide the robustness of a formula."""

    text: str
    sample: int
    """Sample at which the predicate decides."""
    time: float
    """Time of the sample, in seconds."""
    sides: tuple[str, str]
    """Texts of the two sides of the comparison."""
    values: tuple[float, float]
    """Values of the two sides at the sample."""
    robustness: float
    negated: bool
    """Whether the formula requires the predicate to be false."""


@dataclass(frozen=True)
class Explanation:
    """When, where and by which predicate a formula is violated or satisfied; ``str`` gives sentences."""

    trial: int
    number: int
    robustness: float
    predicate: Predicate | None
    """The decisive predicate; ``None`` if the value does not come from one."""
    window: tuple[int, int] | None
    """First and last sample at which the operator above evaluates the predicate."""
    violated_samples: int
    """Number of these samples that violate the predicate."""
    path: list[tuple[str, int, float]]
    """Sub-formulas from the formula to the predicate: text, sample, robustness."""
    decided: int | None
    """First sample after which nothing can change whether the formula is satisfied; ``None`` if the trace does not decide it."""
    conjuncts: dict[str, float]
    """Robustness of the formula with each conjunct as the only operand of each ``and`` above it."""
    sentences: list[str]

    def __str__(self) -> str:
        return "\n".join(self.sentences)


@dataclass(frozen=True)
class FailureMode:
    """Failures with the same decisive predicate that are neighbors in the space and in time."""

    predicate: str
    samples: tuple[int, int]
    """First and last sample at which the violation of a failure is final: nothing can satisfy the formula after it."""
    region: dict[str, tuple[Value, Value] | None]
    """Smallest and largest value of each axis; the names of a categorical axis, in the order of the axis."""
    axes: list[str]
    """Axes by which failures with this predicate were grouped. In a space of more than two axes, these are the axes along which
    they are distributed differently from the other simulations; there may be none."""
    failures: list[tuple[int, int]]
    """Trial and number of each failure, the one closest to the nominal scenario first."""


@dataclass(frozen=True)
class PairedRates:
    """A rate in two evaluations, their difference (second minus first), and the p-value of the exact McNemar test."""

    first: Estimate
    second: Estimate
    difference: Estimate
    p_value: float


@dataclass(frozen=True)
class PairedMeans:
    """A mean in two evaluations, the mean difference (second minus first) over the pairs, and the p-value of the sign test."""

    first: float | None
    second: float | None
    difference: Estimate
    p_value: float


@dataclass(frozen=True)
class ComparedPair:
    """A simulation of both evaluations. Trial 1 has the random scenarios, trial 2 the corners."""

    trial: int
    number: int
    seed: int
    scenario: dict[str, float | None]
    first_robustness: float | None
    second_robustness: float | None
    first_succeeds: bool
    second_succeeds: bool


@dataclass(frozen=True)
class Comparison:
    """Two evaluations of the same scenarios and seeds, compared pair by pair."""

    pairs: int
    success: PairedRates
    strict: PairedRates | None
    robustness: PairedMeans
    dangerous_steps: PairedMeans | None
    completion_step: PairedMeans | None
    new_failures: list[ComparedPair]
    """Pairs in which the first succeeds and the second does not."""
    fixed_failures: list[ComparedPair]
    """Pairs in which the second succeeds and the first does not."""
    differences: list[str]
    """What differs besides the controller, such as the build."""
    compared: list[ComparedPair]
    """All pairs, the new and the fixed failures among them."""
    paths: tuple[pathlib.Path, pathlib.Path]
    """The two run files."""

    def report(self, path: str | os.PathLike[str]) -> None:
        """Writes a page about the comparison: one HTML file that loads nothing. An existing file is replaced."""
        first, second = self.paths
        html = _native.comparison_page(os.fspath(first), os.fspath(second))
        pathlib.Path(path).write_text(html, encoding="utf-8")


def compare(first: str | os.PathLike[str], second: str | os.PathLike[str]) -> Comparison:
    """Compares the run files of two evaluations with the same system, space, formula and seed.

    Parameters
    ----------
    first, second : path
        Run files of :func:`mishandle.evaluate`, for example of two policies.

    Raises
    ------
    MishandleError
        If the runs differ in more than the controller, or one is not complete.
    """
    found = _native.compare(os.fspath(first), os.fspath(second))

    def pairs(rows: list[Any]) -> list[ComparedPair]:
        return [
            ComparedPair(trial, number, seed, dict(zip(found["axes"], scenario)), *robustness, *succeeds)
            for trial, number, seed, scenario, robustness, succeeds in rows
        ]

    return Comparison(
        pairs=found["pairs"],
        success=_rates(found["success"]),
        strict=None if found["strict"] is None else _rates(found["strict"]),
        robustness=_means(found["robustness"]),
        dangerous_steps=None if found["dangerous_steps"] is None else _means(found["dangerous_steps"]),
        completion_step=None if found["completion_step"] is None else _means(found["completion_step"]),
        new_failures=pairs(found["new_failures"]),
        fixed_failures=pairs(found["fixed_failures"]),
        differences=found["differences"],
        compared=pairs(found["compared"]),
        paths=(pathlib.Path(first), pathlib.Path(second)),
    )


def _rates(fields: Any) -> PairedRates:
    first, second, difference, p_value = fields
    return PairedRates(Estimate(*first), Estimate(*second), Estimate(*difference), p_value)


def _means(fields: Any) -> PairedMeans:
    first, second, difference, p_value = fields
    return PairedMeans(first, second, Estimate(*difference), p_value)


def explanation(found: dict[str, Any], control_dt: float) -> Explanation:
    """Returns an explanation of the extension module."""
    predicate = None
    if found["predicate"] is not None:
        text, sample, sides, values, robustness, negated = found["predicate"]
        predicate = Predicate(text, sample, sample * control_dt, tuple(sides), tuple(values), robustness, negated)
    window, violated, _ = found["window"] or (None, 0, None)
    return Explanation(
        trial=found["trial"],
        number=found["number"],
        robustness=found["robustness"],
        predicate=predicate,
        window=window,
        violated_samples=violated,
        path=[(text, sample, robustness) for text, sample, _, robustness in found["path"]],
        decided=found["decided"],
        conjuncts=dict(found["conjuncts"]),
        sentences=found["sentences"],
    )
