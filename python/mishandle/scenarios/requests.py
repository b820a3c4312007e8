"""Simulations that are requested from a system."""

from collections.abc import Sequence
from typing import NamedTuple, Union

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.scenarios.axes import Value

Scenario = dict[str, Value]

Stop = tuple[str, float, bool]
"""Requirement, threshold of its robustness, and whether an episode that terminates is a whole
one."""


class Request(NamedTuple):
    """A simulation. With ``stop``, it may end as soon as its samples determine the robustness of
    the requirement, or show that it is above the threshold."""

    scenario: Scenario
    seed: int
    stop: Union[Stop, None] = None


class EarlyStop:
    """The early stop of a running simulation; without one it never stops."""

    def __init__(
        self, stop: Stop | None, signals: Sequence[tuple[str, str]], control_dt: float, steps: int
    ) -> None:
        self._native = None
        if stop is not None:
            formula, threshold, needs_windows = stop
            names = [name for name, _ in signals]
            self._native = _native.EarlyStop(
                formula, names, control_dt, steps, threshold, needs_windows
            )
        self._samples = 0

    def may_stop(self, samples: Sequence[Sequence[float]] | Sequence[NDArray[np.float64]]) -> bool:
        """Returns whether the simulation may end with the last of its samples."""
        if self._native is None:
            return False
        may_stop = False
        for sample in samples[self._samples :]:
            may_stop = self._native.push(sample)
        self._samples = len(samples)
        return may_stop
