"""Faults and delays between an environment and its policy, while they act."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import mishandle._native as _native
from mishandle.errors import InvalidValueError
from mishandle.scenarios.axes import Axis, FaultParameter
from mishandle.scenarios.images import ImageSettings, SeenImages, images_of
from mishandle.scenarios.layouts import FaultSettings
from mishandle.scenarios.requests import Request
from mishandle.scenarios.values import numbers_of, parts_of, with_changes


class FaultLine:
    """The faults and the effects on images between the environment and the policy of a system.
    Without their axes it does nothing.

    ``steps`` and ``control_dt`` are those of the system, ``spaces`` the spaces of its observations
    and actions.
    """

    def __init__(
        self, space: Sequence[Axis], control_dt: float, steps: int, spaces: tuple[Any, Any]
    ) -> None:
        self._axes: dict[str, Axis] = {}
        self._image_axes: dict[str, Axis] = {}
        faults: set[FaultSettings] = set()
        images: set[ImageSettings] = set()
        for axis in space:
            if not isinstance(axis.apply, FaultParameter):
                continue
            settings = axis.apply.settings
            if isinstance(settings, ImageSettings):
                self._image_axes[axis.name] = axis
                images.add(settings)
            else:
                self._axes[axis.name] = axis
                faults.add(settings)
        for function, found in (("faults", faults), ("sight", images)):
            if len(found) > 1:
                raise InvalidValueError(
                    f"the axes of mishandle.{function} come from different calls; use those of "
                    "one call"
                )
        self._settings = next(iter(faults), None)
        self._image_settings = next(iter(images), None)
        if self._settings is not None:
            _check(self._settings, spaces)
            _check_times("the faults", "faults", self._settings, (control_dt, steps))
        if self._image_settings is not None:
            _check_images(self._image_settings, spaces[0])
            _check_times("the axes of images", "sight", self._image_settings, (control_dt, steps))
        self._make()

    def _make(self) -> None:
        settings, images = self._settings, self._image_settings
        self._native = None if settings is None else settings.native()
        self._native_images = None if images is None else images.native()
        layout = None if settings is None else settings.action
        self._bounds = None if layout is None else layout.bounds()

    def __getstate__(self) -> dict[str, Any]:
        # The objects of the extension module cannot be sent to other processes.
        return {
            name: self.__dict__[name]
            for name in ("_axes", "_image_axes", "_settings", "_image_settings")
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._make()

    @property
    def is_used(self) -> bool:
        """Whether the space has axes of faults or images."""
        return self._settings is not None or self._image_settings is not None

    @property
    def random_axes(self) -> list[str]:
        """Names of the axes that make an episode depend on its seed."""
        faults = [] if self._native is None else self._native.random_axes
        images = [] if self._native_images is None else self._native_images.random_axes
        return [name for name in faults if name in self._axes] + [
            name for name in images if name in self._image_axes
        ]

    def start(self, scenario: Mapping[str, Any], seed: int) -> Disturbed | None:
        """Starts an episode; ``None`` if its scenario has no fault and no effect on images."""
        active = seen = None
        if self._native is not None:
            active = self._native.start(_numbers(self._axes, scenario), seed)
        if self._native_images is not None and self._image_settings is not None:
            images = self._native_images.start(_numbers(self._image_axes, scenario), seed)
            seen = None if images is None else SeenImages(images, self._image_settings.images)
        if active is None and seen is None:
            return None
        return Disturbed(active, seen, self._settings, self._bounds)

    def start_all(
        self, chunk: Sequence[Request]
    ) -> list[tuple[Sequence[Request], list[Disturbed | None]]]:
        """Starts the episodes of a chunk. If a fault pauses the policy in one of them, each is a
        chunk of its own: a policy cannot be paused for one row and act for another one."""
        started = [self.start(request.scenario, request.seed) for request in chunk]
        if any(each is not None and each.has_pause for each in started):
            return [([request], [each]) for request, each in zip(chunk, started)]
        return [(chunk, started)]


def _numbers(axes: Mapping[str, Axis], scenario: Mapping[str, Any]) -> dict[str, float]:
    return {name: axis.number(scenario[name]) for name, axis in axes.items()}


def _check(settings: FaultSettings, spaces: tuple[Any, Any]) -> None:
    """Checks that faults were made for the spaces of a system."""
    for what, layout, space in zip(
        ("observation", "action"), (settings.observation, settings.action), spaces
    ):
        if layout is None:
            continue
        parts = parts_of(space)
        size = sum(part.size for part in parts)
        if size != len(layout.ranges):
            problem = f"{what} has {len(layout.ranges)} numbers, but that of the system has {size}"
        elif [(part.path, part.size) for part in parts] != [
            (part.path, part.size) for part in layout.parts
        ]:
            problem = f"{what} has other parts than that of the system"
        else:
            continue
        raise InvalidValueError(
            f"the faults were made for an environment whose {problem}; pass the same environment "
            "to mishandle.faults and to the question"
        )


def _check_images(settings: ImageSettings, space: Any) -> None:
    """Checks that axes of images were made for the observations of a system."""
    if images_of(space) != settings.images:
        raise InvalidValueError(
            "the axes of images were made for an environment with other images; pass the same "
            "environment to mishandle.sight and to the question"
        )


def _check_times(
    what: str, function: str, settings: FaultSettings | ImageSettings, times: tuple[float, int]
) -> None:
    """Checks that what a function of this package made has the control period and the control steps
    of a system."""
    control_dt, steps = times
    if settings.control_dt != control_dt:
        raise InvalidValueError(
            f"{what} were made for a control period of {settings.control_dt:g} s, but that of the "
            f"system is {control_dt:g} s, so their times would be wrong; pass the same "
            f"`control_dt` to mishandle.{function} and to the question"
        )
    if settings.steps != steps:
        raise InvalidValueError(
            f"{what} were made for episodes of {settings.steps} control steps, but those of the "
            f"system have {steps}, so the bounds of their times would be wrong; pass the same "
            f"`steps` to mishandle.{function} and to the question"
        )


class Disturbed:
    """The faults and the images of one episode. Control steps count from 0."""

    def __init__(
        self, active: _native.ActiveFaults | None, images: SeenImages | None,
        settings: FaultSettings | None, bounds: tuple[Any, Any] | None
    ) -> None:
        self._active = active
        self._images = images
        used = None if active is None else settings
        self._observed = () if used is None or used.observation is None else used.observation.parts
        self._acted = () if used is None or used.action is None else used.action.parts
        self._bounds = bounds
        self._last: Any = None
        self.has_pause = active is not None and active.has_pause()

    def observe(self, step: int, observation: Any) -> Any:
        """Returns what the policy sees of an observation. Numbers that no fault changes are those
        of the observation."""
        if self._images is not None:
            observation = self._images.observe(step, observation)
        if self._active is None or not self._observed:
            return observation
        before = numbers_of(self._observed, observation)
        after = before.copy()
        self._active.observe(step, after)
        return with_changes(self._observed, observation, before, after)

    def is_paused(self, step: int) -> bool:
        return self._active is not None and self.has_pause and self._active.is_paused(step)

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
        """Returns the action that the environment gets. Numbers that no fault changes are those of
        the action, also outside of the space; faults see it clipped to its range."""
        if self._active is None or self._bounds is None:
            return action
        low, high = self._bounds
        before = np.minimum(np.maximum(numbers_of(self._acted, action), low), high)
        after = before.copy()
        if not self._active.act(step, after):
            return action
        return with_changes(self._acted, action, before, np.minimum(np.maximum(after, low), high))
