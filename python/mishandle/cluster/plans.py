"""Simulation of recorded plans, and hardenings, on a worker."""

import os
from typing import Any

import mishandle._native as _native
from mishandle.cluster.executors import Simulate
from mishandle.errors import InvalidStateError


class PlanFactory:
    """Makes the simulator of a recorded plan on a worker."""

    def __init__(self, plan: str, hashes: list[str]) -> None:
        self._plan = plan
        self._hashes = hashes

    def __call__(self) -> Simulate:
        return _native.PlanWorker(self._plan, self._hashes, 1).rollout


class HardeningFactory:
    """Makes a function that completes hardenings of a campaign on a worker, by their names. It
    returns their numbers of simulations."""

    def __init__(self, folder: str, *, durable: bool, any_build: bool) -> None:
        self._folder = os.path.abspath(folder)
        self._durable = durable
        self._any_build = any_build

    def __call__(self) -> Simulate:
        if not os.path.isdir(self._folder):
            raise InvalidStateError(
                f"this worker has no folder {self._folder}: a hardening writes its runs and "
                "controllers into the folder of its campaign; put it on a file system that all "
                "nodes share, or run the campaign without Ray"
            )

        def complete(names: list[Any]) -> list[Any]:
            options: dict[str, Any] = {
                "threads": 1, "durable": self._durable, "any_build": self._any_build
            }
            return [_native.complete_hardening(self._folder, name, **options) for name in names]

        return complete
