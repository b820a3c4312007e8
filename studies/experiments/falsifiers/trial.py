"""One trial: a search with a budget, until its first violation."""

import math
import time
from collections.abc import Sequence

import numpy as np
from systems import NO_VERDICT, System, Value
from numpy.typing import NDArray


class Finished(Exception):
    """The trial found a violation, or its budget is spent."""


class Trial:
    """Counts the simulations of a search in the order of its requests.

    A search evaluates a point or a round of points by `values`. After a violation or the last simulation of the budget it raises
    Finished, which ends the loop of the search wherever it is.
    """

    def __init__(self, system: System, value: Value, seed: int, budget: int, batch: int) -> None:
        self.system, self.seed, self.budget, self.batch = system, seed, budget, batch
        self._value = value
        self.simulations = self.rounds = self.without_verdict = 0
        self.minimum = math.inf
        self.violated = False
        self.simulation_seconds = 0.0

    def values(self, points: Sequence[NDArray[np.float64]], learns: bool = True) -> list[float]:
        """Returns the robustness at each point; infinity without a verdict.

        A search that does not learn from values gets lower bounds above the minimum so far, which saves most of their simulations.
        """
        found = []
        for number, point in enumerate(points):
            if number % self.batch == 0:
                self.rounds += 1
            point = np.clip(np.asarray(point, dtype=np.float64), 0.0, 1.0)
            started = time.perf_counter()
            value = self._value(point, math.inf if learns else max(self.minimum, 0.0))
            self.simulation_seconds += time.perf_counter() - started
            self.simulations += 1
            self.without_verdict += math.isinf(value)
            self.minimum = min(self.minimum, value)
            self.violated = value < 0
            if self.violated or self.simulations == self.budget:
                raise Finished
            found.append(value)
        return found

    def finite(self, points: Sequence[NDArray[np.float64]]) -> list[float]:
        """The same for libraries that need finite values."""
        return [min(value, NO_VERDICT) for value in self.values(points)]

    def one(self, point: NDArray[np.float64]) -> float:
        """The same for one point."""
        return self.finite([point])[0]
