"""Searches with the ask-and-tell interface."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mishandle import _native
from mishandle.errors import InvalidStateError, InvalidValueError

Point = NDArray[np.float64]


class Search:
    """A minimization over a box.

    Parameters
    ----------
    name : str
        One of :func:`search_names`.
    bounds : sequence of pairs
        Lower and upper bound of each coordinate.
    seed : int
        Random seed.
    integrality : sequence of bool, optional
        Whether each coordinate is a whole number, bounds included, as in :func:`scipy.optimize.differential_evolution`.
    **options
        Options of the search; ``mishandle list NAME`` lists them.

    Examples
    --------
    >>> search = Search("random", [(0, 1), (-2, 2)])
    >>> [point] = search.ask()
    >>> search.tell(point, 3.5)
    >>> search.best[1]
    3.5
    """

    def __init__(
        self,
        name: str,
        bounds: Sequence[tuple[float, float]],
        seed: int = 0,
        *,
        integrality: Sequence[bool] | None = None,
        **options: Any,
    ) -> None:
        self._low, self._high = np.asarray(bounds, dtype=np.float64).reshape(-1, 2).T
        if not (np.isfinite(self._low).all() and np.isfinite(self._high).all() and (self._low < self._high).all()):
            raise InvalidValueError(f"bounds must be finite pairs with the lower one first, got {list(bounds)}")
        self._levels = _levels(bounds, integrality)
        self._native = _native.Search(name, self._levels, seed, list(options.items()))
        self._asked: list[tuple[Point, list[float]]] = []

    def ask(self, points: int = 1) -> list[Point]:
        """Returns up to ``points`` points to evaluate. Fewer if the next ones depend on pending values."""
        found = self._native.ask(points)
        scaled = [self._scaled(np.asarray(u)) for u in found]
        self._asked += list(zip(scaled, found))
        return scaled

    def tell(self, point: Sequence[float] | Point, value: float) -> None:
        """Passes the value at the oldest pending point."""
        if not self._asked:
            raise InvalidValueError("no point is pending; call ask first")
        expected, unit = self._asked[0]
        if not np.array_equal(expected, np.asarray(point, dtype=np.float64)):
            raise InvalidValueError(f"values must be in the order of the points; the next point is {expected.tolist()}")
        self._native.tell(unit, value)
        self._asked.pop(0)

    @property
    def finished(self) -> bool:
        """Whether the search has ended by its own criterion."""
        return self._native.finished

    @property
    def best(self) -> tuple[Point, float] | None:
        """Point with the lowest value so far, and the value."""
        found = self._native.best
        if found is None:
            return None
        return self._scaled(np.asarray(found[0])), found[1]

    def _scaled(self, unit: Point) -> Point:
        scaled: Point = self._low * (1 - unit) + self._high * unit
        for index, levels in enumerate(self._levels):
            if levels is not None:
                scaled[index] = self._low[index] + min(math.floor(unit[index] * levels), levels - 1)
        return scaled


def _levels(bounds: Sequence[tuple[float, float]], integrality: Sequence[bool] | None) -> list[int | None]:
    """Returns the number of whole numbers between the bounds of each coordinate; ``None`` for a real number."""
    whole = [False] * len(bounds) if integrality is None else list(integrality)
    if len(whole) != len(bounds):
        raise InvalidValueError(f"integrality has {len(whole)} entries; expected one for each of the {len(bounds)} coordinates")
    for (low, high), is_whole in zip(bounds, whole):
        if is_whole and not (float(low).is_integer() and float(high).is_integer()):
            raise InvalidValueError(f"the bounds of a whole number must be whole numbers, got {(low, high)}")
    return [int(high - low) + 1 if is_whole else None for (low, high), is_whole in zip(bounds, whole)]


@dataclass(frozen=True)
class Minimum:
    """Result of :func:`find_minimum`."""

    x: Point
    fun: float
    evaluations: int


def find_minimum(
    function: Callable[[Point], float],
    bounds: Sequence[tuple[float, float]],
    *,
    search: str = "portfolio",
    budget: int = 1000,
    seed: int = 0,
    options: Mapping[str, Any] | None = None,
) -> Minimum:
    """Minimizes a function over a box.

    >>> found = find_minimum(lambda x: float((x[0] - 1) ** 2), [(-3, 3)], search="nelder-mead", budget=200)
    >>> abs(float(found.x[0]) - 1) < 1e-3
    True
    """
    if budget < 1:
        raise InvalidValueError(f"the budget is {budget}; it must be at least 1")
    minimization = Search(search, bounds, seed, **(options or {}))
    evaluations = 0
    while evaluations < budget and not minimization.finished:
        points = minimization.ask(1)
        if not points:
            break
        for point in points:
            value = float(function(point))
            if math.isnan(value):
                raise InvalidValueError(f"the function is NaN at {point.tolist()}; return inf for a point without a value")
            minimization.tell(point, value)
            evaluations += 1
    best = minimization.best
    if best is None:
        raise InvalidStateError("the search evaluated no point")
    return Minimum(best[0], best[1], evaluations)


def search_names() -> list[str]:
    """Returns the names of all searches.

    >>> "random" in search_names()
    True
    """
    return _native.search_names()
