"""Faults of sensors and actuators between an environment and its policy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Union

import numpy as np
from gymnasium import spaces as gymnasium_spaces
from numpy.typing import NDArray

from mishandle import _native
from mishandle.axes import Axis, FaultParameter
from mishandle.errors import InvalidTypeError, InvalidValueError

Channels = Mapping[str, Union[int, Sequence[int]]]
"""Channels by name: the index or indexes of their numbers in the flat observation or action."""

Ranges = Mapping[str, tuple[float, float]]
"""Lowest and highest value of the numbers of channels, by name."""


@dataclass(frozen=True)
class Layout:
    """The numbers of an observation or action: channels, ranges, and whether a fault can compute with them."""

    channels: tuple[tuple[str, tuple[int, ...]], ...]
    ranges: tuple[tuple[float, float], ...]
    has_numbers: bool

    @classmethod
    def from_native(cls, given: _native.Layout) -> Layout:
        channels, ranges, has_numbers = given
        named = tuple((name, tuple(entries)) for name, entries in channels)
        return cls(named, tuple((low, high) for low, high in ranges), has_numbers)

    def to_native(self) -> _native.Layout:
        return [(name, list(entries)) for name, entries in self.channels], list(self.ranges), self.has_numbers


@dataclass(frozen=True)
class FaultSettings:
    """What the faults of an environment are made of. It can be sent to other processes."""

    observation: Layout | None
    action: Layout | None
    count: int
    delays: bool
    steps: int
    control_dt: float

    def native(self) -> _native.Faults:
        """Returns the faults of the extension module."""
        return _native_faults(self)


@lru_cache(maxsize=32)
def _native_faults(settings: FaultSettings) -> _native.Faults:
    layouts = [None if layout is None else layout.to_native() for layout in (settings.observation, settings.action)]
    return _native.Faults(
        observation=layouts[0],
        action=layouts[1],
        count=settings.count,
        has_delays=settings.delays,
        control_dt=settings.control_dt,
        episode_steps=settings.steps,
    )


def faults(
    environment: Any,
    *,
    sensing: bool = True,
    actuation: bool = True,
    delays: bool = False,
    count: int = 1,
    channels: Channels | None = None,
    actions: Channels | None = None,
    ranges: Ranges | None = None,
    steps: int | None = None,
    control_dt: float | None = None,
) -> list[Axis]:
    """Returns the axes of faults of an environment: kind, channel, onset, duration, recovery and magnitude.

    A fault acts between the environment and the policy. ``sensor_fault`` is the kind of a fault of what the policy observes,
    ``actuator_fault`` that of what the environment gets. Signals are those of the environment, without the faults. At their
    nominal values the axes change nothing. ``docs/guide/faults.md`` describes the kinds.

    Parameters
    ----------
    environment
        A Gymnasium environment or vector environment, or the name of a task.
    sensing, actuation : bool
        Whether observations and actions have faults.
    delays : bool
        Whether there are also axes of delays, which may vary during an episode, and of rare observations.
    count : int
        Number of faults of each side that can overlap. They are applied in the order of their numbers.
    channels, actions : mapping, optional
        Channels of the observation and of the action by name, each with the index or indexes of its numbers. By default each
        number is one; the parts of a dictionary, and the quantities of a task, are channels with their names. If there is more
        than one, the nominal choice is ``"all"``.
    ranges : mapping, optional
        Lowest and highest value of channels of the observation. By default those of the observation space, and -1 and 1 for
        numbers without finite bounds. Magnitudes are in units of half the range.
    steps, control_dt
        Number of control steps of an episode, and the duration of a control step in seconds; by default those of the environment.

    Examples
    --------
    >>> import gymnasium
    >>> env = gymnasium.make("CartPole-v1")
    >>> [axis.name for axis in faults(env, channels={"cart": [0, 1], "pole": [2, 3]}, actuation=False)][:3]
    ['sensor_fault', 'sensor_fault_channel', 'sensor_fault_partner']
    """
    # These modules import this one.
    from mishandle.environments import control_period, episode_steps
    from mishandle.task_environments import TaskEnv

    if isinstance(environment, str):
        environment = TaskEnv(environment)
    if not (hasattr(environment, "reset") and hasattr(environment, "step")):
        raise InvalidTypeError(
            f"a {type(environment).__name__} has no control steps between which a fault could act; faults need a Gymnasium environment "
            "or the name of a task"
        )
    if count < 1 or not (sensing or actuation or delays):
        raise InvalidValueError("there is no fault: count must be at least 1, and sensing, actuation or delays True")
    # A task knows its channels and what its sensors can measure.
    layouts = getattr(environment.unwrapped, "fault_layouts", None)
    known = [] if layouts is None else [Layout.from_native(layout) for layout in layouts]
    spaces = (_single_space(environment, "observation_space"), _single_space(environment, "action_space"))
    # A wrapper may have changed its spaces.
    is_own = all(_size(space) == len(layout.ranges) for space, layout in zip(spaces, known))
    if known and is_own and channels is None and actions is None and ranges is None:
        observation, action = known
    else:
        observation = _layout(spaces[0], channels, ranges, "obs")
        action = _layout(spaces[1], actions, None, "action")
    settings = FaultSettings(
        observation=observation if sensing or delays else None,
        action=action if actuation or delays else None,
        count=count,
        delays=delays,
        steps=episode_steps(environment, steps),
        control_dt=control_period(environment) if control_dt is None else control_dt,
    )
    made = settings.native()
    kept = {"sensor_fault": sensing, "actuator_fault": actuation}
    axes = [Axis.from_native(native, FaultParameter(settings)) for native in made.axes]
    return [axis for axis in axes if all(keep or not axis.name.startswith(side) for side, keep in kept.items())]


def _single_space(environment: Any, name: str) -> Any:
    return getattr(environment, f"single_{name}", None) or getattr(environment, name)


def _layout(space: Any, channels: Channels | None, ranges: Ranges | None, what: str) -> Layout:
    """Returns the layout of an observation or action of a space."""
    parts, found = _numbers(space, what)
    bounds = list(found)
    # Spaces of whole numbers have no value between two of theirs.
    has_numbers = all(isinstance(part, gymnasium_spaces.Box) and part.dtype.kind == "f" for part in _leaves(space))
    given = {name: (entries,) if isinstance(entries, int) else tuple(entries) for name, entries in (channels or {}).items()}
    for name, entries in given.items():
        if not entries or not all(0 <= entry < len(bounds) for entry in entries):
            raise InvalidValueError(f"the channel `{name}` has the numbers {list(entries)}; there are {len(bounds)}, from 0 on")
    named = given or parts
    for name, (low, high) in (ranges or {}).items():
        if name not in named:
            raise InvalidValueError(f"there is no channel `{name}` with a range; the channels are {', '.join(named)}")
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise InvalidValueError(f"the range of the channel `{name}` is {low} to {high}; it must be finite, the lower value first")
        for entry in named[name]:
            bounds[entry] = (float(low), float(high))
    return Layout(tuple(named.items()), tuple(bounds), has_numbers)


def _size(space: Any) -> int:
    """Returns the number of numbers of a space."""
    return sum(int(np.prod(part.shape)) for part in _leaves(space))


def _leaves(space: Any) -> list[Any]:
    return list(space.spaces.values()) if isinstance(space, gymnasium_spaces.Dict) else [space]


def _numbers(space: Any, what: str) -> tuple[dict[str, tuple[int, ...]], list[tuple[float, float]]]:
    """Returns the channels that a space has by itself, and the range of each number."""
    if isinstance(space, gymnasium_spaces.Dict):
        channels: dict[str, tuple[int, ...]] = {}
        bounds: list[tuple[float, float]] = []
        for name, part in space.spaces.items():
            _, own = _numbers(part, name)
            channels[name] = tuple(range(len(bounds), len(bounds) + len(own)))
            bounds += own
        return channels, bounds
    if isinstance(space, gymnasium_spaces.Box):
        pairs = zip(space.low.reshape(-1).tolist(), space.high.reshape(-1).tolist())
        # The largest number of a type is not a bound.
        own = [(low, high) if -1e30 < low < high < 1e30 else (-1.0, 1.0) for low, high in pairs]
        return {f"{what}[{i}]": (i,) for i in range(len(own))}, own
    if isinstance(space, gymnasium_spaces.Discrete):
        return {what: (0,)}, [(float(space.start), float(space.start + space.n - 1))]
    if isinstance(space, gymnasium_spaces.MultiDiscrete):
        sizes = space.nvec.reshape(-1).tolist()
        return {f"{what}[{i}]": (i,) for i in range(len(sizes))}, [(0.0, float(size - 1)) for size in sizes]
    raise InvalidTypeError(f"faults of a {type(space).__name__} are not known: only of Box, Discrete, MultiDiscrete and a Dict of them")


class FaultLine:
    """The faults between the environment and the policy of a system. Without fault axes it does nothing."""

    def __init__(self, space: Sequence[Axis], control_dt: float, spaces: tuple[Any, Any]) -> None:
        fault_axes = {axis.name: axis for axis in space if isinstance(axis.apply, FaultParameter)}
        found = {axis.apply.settings for axis in fault_axes.values() if isinstance(axis.apply, FaultParameter)}
        if len(found) > 1:
            raise InvalidValueError("the axes of faults come from different calls of mishandle.faults; use those of one call")
        self._axes = fault_axes
        self._settings = next(iter(found), None)
        if self._settings is not None and self._settings.control_dt != control_dt:
            raise InvalidValueError(
                f"the faults were made for a control period of {self._settings.control_dt:g} s, but that of the system is {control_dt:g} s, so "
                "their times would be wrong; pass the same `control_dt` to mishandle.faults and to the question"
            )

        layouts = () if self._settings is None else (self._settings.observation, self._settings.action)
        for what, layout, found in zip(("observation", "action"), layouts, spaces):
            if layout is not None and _size(found) != len(layout.ranges):
                raise InvalidValueError(
                    f"the faults were made for an environment whose {what} has {len(layout.ranges)} numbers, but that of the system has "
                    f"{_size(found)}; pass the same environment to mishandle.faults and to the question"
                )

    @property
    def is_used(self) -> bool:
        """Whether the space has axes of faults."""
        return self._settings is not None

    @property
    def random_axes(self) -> list[str]:
        """Names of the axes that make an episode depend on its seed."""
        if self._settings is None:
            return []
        return [name for name in self._settings.native().random_axes if name in self._axes]

    def start(self, scenario: Mapping[str, Any], seed: int) -> Disturbed | None:
        """Starts an episode; ``None`` if its scenario has no fault."""
        if self._settings is None:
            return None
        values = {name: axis.number(scenario[name]) for name, axis in self._axes.items()}
        active = self._settings.native().start(values, seed)
        return None if active is None else Disturbed(active, self._settings)

    def pauses(self, scenario: Mapping[str, Any], seed: int) -> bool:
        """Whether a fault pauses the policy in some control step."""
        found = self.start(scenario, seed)
        return found is not None and found.has_pause


def idle_action(space: Any) -> Any:
    """Returns the action before the first one of a policy: 0, or the value of the space that is nearest to it.

    >>> idle_action(gymnasium_spaces.Box(0.5, 1.0, (2,)))
    array([0.5, 0.5], dtype=float32)
    """
    if isinstance(space, gymnasium_spaces.Box):
        return np.clip(np.zeros(space.shape), space.low, space.high).astype(space.dtype)
    if isinstance(space, gymnasium_spaces.Discrete):
        return space.start
    return np.zeros(space.shape, space.dtype)


class Disturbed:
    """The faults of one episode. Control steps count from 0."""

    def __init__(self, active: _native.ActiveFaults, settings: FaultSettings) -> None:
        self._active = active
        self._settings = settings
        self._last: Any = None
        self.has_pause = active.has_pause()

    def observe(self, step: int, observation: Any) -> Any:
        """Returns what the policy sees of an observation."""
        if self._settings.observation is None:
            return observation
        numbers = _flat(observation)
        self._active.observe(step, numbers)
        return _like(observation, numbers)

    def is_paused(self, step: int) -> bool:
        return self._active.is_paused(step)

    def answer(self, step: int, action: Any, idle: Any) -> Any:
        """Returns the action of the policy, or the last one if a fault pauses it."""
        if self.is_paused(step):
            return idle if self._last is None else self._last
        self._last = action if np.isscalar(action) else np.array(action, copy=True)
        return action

    def act(self, step: int, action: Any) -> Any:
        """Returns the action that the environment gets."""
        layout = self._settings.action
        if layout is None:
            return action
        bounds = np.array(layout.ranges)
        numbers = np.clip(_flat(action), bounds[:, 0], bounds[:, 1])
        if not self._active.act(step, numbers):
            return action
        return _like(action, np.clip(numbers, bounds[:, 0], bounds[:, 1]))


def _flat(value: Any) -> NDArray[np.float64]:
    """Returns the numbers of an observation or action in a new array."""
    if isinstance(value, Mapping):
        return np.concatenate([_flat(part) for part in value.values()])
    return np.array(value, dtype=np.float64).reshape(-1)


def _like(value: Any, numbers: NDArray[np.float64]) -> Any:
    """Returns numbers in the form of an observation or action."""
    if isinstance(value, Mapping):
        first, parts = 0, {}
        for name, part in value.items():
            size = int(np.size(part))
            parts[name] = _like(part, numbers[first : first + size])
            first += size
        return parts
    form = np.asarray(value)
    if form.dtype.kind != "f":
        numbers = np.rint(numbers)
    made = numbers.astype(form.dtype).reshape(form.shape)
    return made if isinstance(value, np.ndarray) else made[()]
