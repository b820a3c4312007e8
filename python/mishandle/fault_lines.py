"""Faults and delays between an environment and its policy, while they act."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mishandle import _native
from mishandle.axes import Axis, FaultParameter
from mishandle.errors import InvalidValueError
from mishandle.fault_layouts import FaultSettings
from mishandle.flat_values import numbers_of, parts_of, with_changes
from mishandle.requests import Request


class FaultLine:
    """The faults between the environment and the policy of a system. Without fault axes it does nothing.

    ``steps`` and ``control_dt`` are those of the system, ``spaces`` the spaces of its observations and actions.
    """

    def __init__(self, space: Sequence[Axis], control_dt: float, steps: int, spaces: tuple[Any, Any]) -> None:
        fault_axes = {axis.name: axis for axis in space if isinstance(axis.apply, FaultParameter)}
        found = {axis.apply.settings for axis in fault_axes.values() if isinstance(axis.apply, FaultParameter)}
        if len(found) > 1:
            raise InvalidValueError("the axes of faults come from different calls of mishandle.faults; use those of one call")
        self._axes = fault_axes
        self._settings = next(iter(found), None)
        if self._settings is not None:
            _check(self._settings, control_dt, steps, spaces)
        self._make()

    def _make(self) -> None:
        settings = self._settings
        self._native = None if settings is None else settings.native()
        layout = None if settings is None else settings.action
        self._bounds = None if layout is None else layout.bounds()

    def __getstate__(self) -> dict[str, Any]:
        # The object of the extension module cannot be sent to other processes.
        return {"_axes": self._axes, "_settings": self._settings}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._make()

    @property
    def is_used(self) -> bool:
        """Whether the space has axes of faults."""
        return self._settings is not None

    @property
    def random_axes(self) -> list[str]:
        """Names of the axes that make an episode depend on its seed."""
        return [] if self._native is None else [name for name in self._native.random_axes if name in self._axes]

    def start(self, scenario: Mapping[str, Any], seed: int) -> Disturbed | None:
        """Starts an episode; ``None`` if its scenario has no fault."""
        if self._native is None or self._settings is None:
            return None
        values = {name: axis.number(scenario[name]) for name, axis in self._axes.items()}
        active = self._native.start(values, seed)
        return None if active is None else Disturbed(active, self._settings, self._bounds)

    def start_all(self, chunk: Sequence[Request]) -> list[tuple[Sequence[Request], list[Disturbed | None]]]:
        """Starts the episodes of a chunk. If a fault pauses the policy in one of them, each is a chunk of its own: a policy cannot be
        paused for one row and act for another one."""
        started = [self.start(request.scenario, request.seed) for request in chunk]
        if any(each is not None and each.has_pause for each in started):
            return [([request], [each]) for request, each in zip(chunk, started)]
        return [(chunk, started)]


def _check(settings: FaultSettings, control_dt: float, steps: int, spaces: tuple[Any, Any]) -> None:
    """Checks that faults were made for a system."""
    for what, layout, space in zip(("observation", "action"), (settings.observation, settings.action), spaces):
        if layout is None:
            continue
        parts = parts_of(space)
        size = sum(part.size for part in parts)
        if size != len(layout.ranges):
            problem = f"{what} has {len(layout.ranges)} numbers, but that of the system has {size}"
        elif [(part.path, part.size) for part in parts] != [(part.path, part.size) for part in layout.parts]:
            problem = f"{what} has other parts than that of the system"
        else:
            continue
        raise InvalidValueError(
            f"the faults were made for an environment whose {problem}; pass the same environment to mishandle.faults and to the question"
        )
    if settings.control_dt != control_dt:
        raise InvalidValueError(
            f"the faults were made for a control period of {settings.control_dt:g} s, but that of the system is {control_dt:g} s, so their "
            "times would be wrong; pass the same `control_dt` to mishandle.faults and to the question"
        )
    if settings.steps != steps:
        raise InvalidValueError(
            f"the faults were made for episodes of {settings.steps} control steps, but those of the system have {steps}, so the bounds of "
            "their times would be wrong; pass the same `steps` to mishandle.faults and to the question"
        )


class Disturbed:
    """The faults of one episode. Control steps count from 0."""

    def __init__(self, active: _native.ActiveFaults, settings: FaultSettings, bounds: tuple[Any, Any] | None) -> None:
        self._active = active
        self._observed = () if settings.observation is None else settings.observation.parts
        self._acted = () if settings.action is None else settings.action.parts
        self._bounds = bounds
        self._last: Any = None
        self.has_pause = active.has_pause()

    def observe(self, step: int, observation: Any) -> Any:
        """Returns what the policy sees of an observation. Numbers that no fault changes are those of the observation."""
        if not self._observed:
            return observation
        before = numbers_of(self._observed, observation)
        after = before.copy()
        self._active.observe(step, after)
        return with_changes(self._observed, observation, before, after)

    def is_paused(self, step: int) -> bool:
        return self.has_pause and self._active.is_paused(step)

    def answer(self, step: int, action: Any, idle: Any) -> Any:
        """Returns the action of the policy, or the last one if a fault pauses it."""
        if not self.has_pause:
            return action
        if self.is_paused(step):
            return idle if self._last is None else self._last
        # A policy may write its next action into the same array.
        self._last = copy.deepcopy(action)
        return action

    def act(self, step: int, action: Any) -> Any:
        """Returns the action that the environment gets. Numbers that no fault changes are those of the action, also outside of the
        space; faults see it clipped to its range."""
        if self._bounds is None:
            return action
        low, high = self._bounds
        before = np.minimum(np.maximum(numbers_of(self._acted, action), low), high)
        after = before.copy()
        if not self._active.act(step, after):
            return action
        return with_changes(self._acted, action, before, np.minimum(np.maximum(after, low), high))
