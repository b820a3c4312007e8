"""Simulation of recorded plans on a worker."""

from __future__ import annotations

from mishandle import _native
from mishandle.ray import Simulate


class PlanFactory:
    """Makes the simulator of a recorded plan on a worker."""

    def __init__(self, plan: str, hashes: list[str]) -> None:
        self._plan = plan
        self._hashes = hashes

    def __call__(self) -> Simulate:
        return _native.PlanWorker(self._plan, self._hashes, 1).rollout
