"""Searches with the ask-and-tell interface, and robustness as a function for optimizers of other
libraries."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

import mishandle._native as _native
from mishandle.base.documents import document
from mishandle.errors import InvalidStateError, InvalidValueError
from mishandle.runs.targets import Formulas, Space, TargetOptions, make_target
from mishandle.scenarios.arguments import check_number
from mishandle.scenarios.axes import Axis
from mishandle.scenarios.requests import Scenario

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
        Whether each coordinate is a whole number, bounds included, as in
        :func:`scipy.optimize.differential_evolution`.
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
        if not (
            np.isfinite(self._low).all() and np.isfinite(self._high).all()
            and (self._low < self._high).all()
        ):
            raise InvalidValueError(
                f"bounds must be finite pairs with the lower one first, got {list(bounds)}"
            )
        self._levels = _levels(bounds, integrality)
        self._native = _native.Search(name, self._levels, seed, document(options))
        self._asked: list[tuple[Point, list[float]]] = []

    def ask(self, points: int = 1) -> list[Point]:
        """Returns up to ``points`` points to evaluate. Fewer if the next ones depend on pending
        values."""
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
            raise InvalidValueError(
                f"values must be in the order of the points; the next point is {expected.tolist()}"
            )
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


def _levels(
    bounds: Sequence[tuple[float, float]], integrality: Sequence[bool] | None
) -> list[int | None]:
    """Returns the number of whole numbers between the bounds of each coordinate; ``None`` for a
    real number."""
    whole = [False] * len(bounds) if integrality is None else list(integrality)
    if len(whole) != len(bounds):
        raise InvalidValueError(
            f"integrality has {len(whole)} entries; expected one for each of the {len(bounds)} "
            "coordinates"
        )
    for (low, high), is_whole in zip(bounds, whole):
        if is_whole and not (float(low).is_integer() and float(high).is_integer()):
            raise InvalidValueError(
                f"the bounds of a whole number must be whole numbers, got {(low, high)}"
            )
    return [
        int(high - low) + 1 if is_whole else None for (low, high), is_whole in zip(bounds, whole)
    ]


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

    >>> found = find_minimum(
    ...     lambda x: float((x[0] - 1) ** 2), [(-3, 3)], search="nelder-mead", budget=200
    ... )
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
                raise InvalidValueError(
                    f"the function is NaN at {point.tolist()}; return inf for a point without a "
                    "value"
                )
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


class Objective:
    """The robustness of a system at points of the unit cube, which another optimizer can minimize.

    Coordinate ``i`` of a point is a number in [0, 1]: 0 is the lower bound of axis ``i`` and 1 the
    upper bound. An axis with ``n`` whole numbers or names has value number ``floor(n * u)``.

    Parameters
    ----------
    system, formula, space, **target
        See :func:`mishandle.falsify`.
    seed : int
        Random seed of all simulations, so that the objective is a function of the point.

    Attributes
    ----------
    space : list of Axis
        The axes, one for each coordinate.
    levels : list
        Number of values of each discrete axis; ``None`` for a continuous one.

    Examples
    --------
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> objective = Objective(system, "always(gap >= 2)", [Axis("speed", 0, 20, "m/s")])
    >>> objective([[0.0], [0.5]]).tolist()
    [8.0, -2.0]
    >>> objective.scenario([0.5])
    {'speed': 10.0}
    """

    def __init__(
        self, system: Any, formula: Formulas = None, space: Space = None, *, seed: int = 0,
        **target: Unpack[TargetOptions]
    ) -> None:
        check_number("seed", seed, 0)
        made = make_target(system, formula, space, target)
        self._native = _native.Objective(made.native)
        self._seed = seed
        self.space: list[Axis] = list(made.space)
        self.levels = [
            None if axis.values in ("continuous", "logarithmic") else int(axis.high - axis.low) + 1
            for axis in self.space
        ]

    def __call__(self, points: ArrayLike, *, threshold: float = math.inf) -> NDArray[np.float64]:
        """Returns the robustness at each row of ``points``; infinity if a simulation has no
        verdict.

        A simulation ends as soon as its robustness is certain, or certain to be above
        ``threshold``, which is at least 0. In the second case its value is a lower bound that is
        above the threshold. A function returns whole traces.
        """
        if not threshold >= 0:
            raise InvalidValueError(f"the threshold is {threshold}; it must be at least 0")
        found = self._native.robustness(self._rows(points), self._seed, threshold)
        return np.array([math.inf if value is None else value for value in found])

    def scenario(self, point: Sequence[float] | NDArray[np.float64]) -> Scenario:
        """Returns the scenario at a point."""
        [row] = self._rows(np.asarray([point], dtype=np.float64))
        return self._native.scenario(row)

    def _rows(self, points: ArrayLike) -> list[list[float]]:
        rows = np.asarray(points, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != len(self.space):
            raise InvalidValueError(
                f"expected points with {len(self.space)} coordinates each, got an array of shape "
                f"{rows.shape}"
            )
        if not ((rows >= 0) & (rows <= 1)).all():
            raise InvalidValueError("coordinates must be from 0 to 1")
        found: list[list[float]] = rows.tolist()
        return found
