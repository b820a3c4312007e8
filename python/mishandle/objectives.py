"""Robustness as a function of a point, for optimizers of other libraries."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

from mishandle import _native
from mishandle.arguments import check_number
from mishandle.axes import Axis
from mishandle.errors import InvalidValueError
from mishandle.requests import Scenario
from mishandle.targets import Formulas, Space, TargetOptions, make_target


class Objective:
    """The robustness of a system at points of the unit cube, which another optimizer can minimize.

    Coordinate ``i`` of a point is a number in [0, 1]: 0 is the lower bound of axis ``i`` and 1 the upper bound. An axis with ``n``
    whole numbers or names has value number ``floor(n * u)``.

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
        self, system: Any, formula: Formulas = None, space: Space = None, *, seed: int = 0, **target: Unpack[TargetOptions]
    ) -> None:
        check_number("seed", seed, 0)
        made = make_target(system, formula, space, target, lambda space: None)
        self._native = _native.Objective(made.native, made.formula)
        self._seed = seed
        self.space: list[Axis] = list(made.space)
        self.levels = [_levels(axis) for axis in self.space]

    def __call__(self, points: ArrayLike, *, threshold: float = math.inf) -> NDArray[np.float64]:
        """Returns the robustness at each row of ``points``; infinity if a simulation has no verdict.

        A simulation ends as soon as its robustness is certain, or certain to be above ``threshold``, which is at least 0. In the second
        case its value is a lower bound that is above the threshold. A function returns whole traces.
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
            raise InvalidValueError(f"expected points with {len(self.space)} coordinates each, got an array of shape {rows.shape}")
        if not ((rows >= 0) & (rows <= 1)).all():
            raise InvalidValueError("coordinates must be from 0 to 1")
        found: list[list[float]] = rows.tolist()
        return found


def _levels(axis: Axis) -> int | None:
    if axis.values in ("continuous", "logarithmic"):
        return None
    return int(axis.high - axis.low) + 1
