"""What the faults of an environment are made of: the channels of its observation and action, and
their ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Union

import numpy as np
from gymnasium import spaces as gymnasium_spaces
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.scenarios.arguments import is_real, is_whole
from mishandle.scenarios.values import Part, leaves, parts_of

Channels = Mapping[str, Union[int, Sequence[int]]]
"""Channels by name: the index or indexes of their numbers in the flat observation or action."""

Ranges = Mapping[str, tuple[float, float]]
"""Lowest and highest value of the numbers of channels, by name."""

RESERVED = ("all", "next")
"""Names of all channels together, and of the channel after another one."""

_LARGEST = 1e30
"""The largest number of a type is not a bound."""


@dataclass(frozen=True)
class Side:
    """The words for an observation or action in messages."""

    value: str
    channels: str
    ranges: str
    number: str


OBSERVATION = Side("observation", "channels", "ranges", "obs")
ACTION = Side("action", "actions", "action_ranges", "action")


@dataclass(frozen=True)
class Layout:
    """The numbers of an observation or action: channels, ranges, whether a fault can compute with
    them, and their places."""

    channels: tuple[tuple[str, tuple[int, ...]], ...]
    ranges: tuple[tuple[float, float], ...]
    has_numbers: bool
    parts: tuple[Part, ...]

    @classmethod
    def from_native(cls, given: _native.Layout, space: Any) -> Layout:
        """Returns the layout that a task states for a space."""
        channels, ranges, has_numbers = given
        named = tuple((name, tuple(entries)) for name, entries in channels)
        return cls(named, tuple((low, high) for low, high in ranges), has_numbers, parts_of(space))

    @classmethod
    def of_space(cls, space: Any, side: Side) -> Layout:
        """Returns the layout that a space has by itself. Numbers without bounds have infinite
        ones."""
        found = list(leaves(space))
        parts = parts_of(space)
        ranges = [each for _, leaf in found for each in _ranges(leaf)]
        channels: dict[str, tuple[int, ...]] = {}
        for part, (path, leaf) in zip(parts, found):
            entries = range(part.first, part.first + part.size)
            if path:
                name = (
                    path[0] if isinstance(space, gymnasium_spaces.Dict)
                    else f"{side.number}[{path[0]}]"
                )
                channels[str(name)] = (*channels.get(str(name), ()), *entries)
            elif isinstance(leaf, gymnasium_spaces.Discrete):
                channels[side.number] = (0,)
            else:
                channels.update({f"{side.number}[{entry}]": (entry,) for entry in entries})
        channels = {name: entries for name, entries in channels.items() if entries}
        if not channels:
            raise InvalidValueError(
                f"the {side.value} has no numbers, so it has no faults; pass sensing=False or "
                "actuation=False"
            )
        # Spaces of whole numbers have no value between two of theirs.
        has_numbers = all(
            isinstance(leaf, gymnasium_spaces.Box) and leaf.dtype.kind == "f" for _, leaf in found
        )
        return cls(tuple(channels.items()), tuple(ranges), has_numbers, parts)

    def with_names(self, side: Side, channels: Channels | None, ranges: Ranges | None) -> Layout:
        """Returns the layout with other channels and ranges."""
        named = check_channels(
            side, dict(self.channels) if channels is None else channels, len(self.ranges)
        )
        bounds = list(self.ranges)
        for name, bound in check_ranges(side, ranges, list(named)).items():
            for entry in named[name]:
                bounds[entry] = bound
        return replace(self, channels=tuple(named.items()), ranges=tuple(bounds))

    @property
    def unbounded(self) -> list[int]:
        """Indexes of the numbers without two finite bounds."""
        return [
            entry for entry, bound in enumerate(self.ranges) if not all(map(math.isfinite, bound))
        ]

    def with_unit_ranges(self) -> Layout:
        """Returns the layout in which numbers without two finite bounds have the range -1 to 1."""
        unbounded = set(self.unbounded)
        ranges = tuple(
            (-1.0, 1.0) if entry in unbounded else bound for entry, bound in enumerate(self.ranges)
        )
        return replace(self, ranges=ranges)

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the lowest and the highest value of each number."""
        pairs = np.array(self.ranges, dtype=np.float64).reshape(-1, 2)
        return pairs[:, 0].copy(), pairs[:, 1].copy()

    def to_native(self) -> _native.Layout:
        return [
            (name, list(entries)) for name, entries in self.channels
        ], list(self.ranges), self.has_numbers


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
        """Makes the faults of the extension module."""
        layouts = [
            None if layout is None else layout.to_native()
            for layout in (self.observation, self.action)
        ]
        return _native.Faults(
            observation=layouts[0], action=layouts[1], count=self.count, has_delays=self.delays,
            control_dt=self.control_dt, episode_steps=self.steps
        )


def check_channels(side: Side, given: object, size: int) -> dict[str, tuple[int, ...]]:
    """Checks channels, and returns the numbers of each.

    >>> check_channels(OBSERVATION, {"cart": [0, 1], "pole": 1}, 4)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    mishandle.errors.InvalidValueError: the channels `cart` and `pole` in `channels` both have ...
    """
    if not isinstance(given, Mapping):
        raise InvalidTypeError(
            f'{side.channels} is {given!r}; expected numbers by name, such as {{"position": [0, '
            '1]}'
        )
    if not given:
        raise InvalidValueError(
            f"{side.channels} is empty; leave it out to get the channels that the {side.value} "
            "has by itself"
        )
    owners: dict[int, str] = {}
    found: dict[str, tuple[int, ...]] = {}
    for name, entries in given.items():
        if not isinstance(name, str) or not name.strip() or not name.isprintable():
            raise InvalidValueError(
                f"the channel {name!r} of the {side.value} needs a printable name; state one in "
                f"`{side.channels}`"
            )
        if name in RESERVED:
            raise InvalidValueError(
                f"the name `{name}` of a channel of the {side.value} is reserved: `all` means all "
                f"channels, `next` the one after another; state another name in `{side.channels}`"
            )
        found[name] = _entries(side, name, entries, size)
        for entry in found[name]:
            other = owners.setdefault(entry, name)
            if other != name:
                raise InvalidValueError(
                    f"the channels `{other}` and `{name}` in `{side.channels}` both have the "
                    f"number {entry}; each number has one channel"
                )
        if len(set(found[name])) < len(found[name]):
            raise InvalidValueError(
                f"the channel `{name}` in `{side.channels}` is {entries!r}; it must have each "
                "number once"
            )
    return found


def _entries(side: Side, name: str, given: object, size: int) -> tuple[int, ...]:
    """Returns the numbers of a channel."""
    expected = (
        f"it must be one or several whole numbers, because the {side.value} has {size} numbers, "
        "counted from 0"
    )
    many: Any = given.tolist() if isinstance(given, np.ndarray) else given
    if is_whole(many):
        many = [many]
    is_list = isinstance(many, Sequence) and not isinstance(many, (str, bytes)) and len(many) > 0
    if not is_list or not all(map(is_whole, many)):
        raise InvalidValueError(
            f"the channel `{name}` in `{side.channels}` is {given!r}; {expected}"
        )
    entries = tuple(int(entry) for entry in many)
    if not all(0 <= entry < size for entry in entries):
        raise InvalidValueError(
            f"the channel `{name}` in `{side.channels}` is {given!r}; there are {size} numbers, "
            "from 0 on"
        )
    return entries


def check_ranges(
    side: Side, given: object, channels: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Checks the ranges of channels, and returns them.

    >>> check_ranges(ACTION, {"arm": (1, 0)}, ["arm"])  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    mishandle.errors.InvalidValueError: the range of `arm` in `action_ranges` is (1, 0); ...
    """
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise InvalidTypeError(
            f'{side.ranges} is {given!r}; expected ranges of channels by name, such as '
            '{"position": (-2, 2)}'
        )
    found = {}
    for name, pair in given.items():
        if name not in channels:
            raise InvalidValueError(
                f"there is no channel `{name}` of the {side.value}, which `{side.ranges}` names; "
                f"the channels are {', '.join(channels)}"
            )
        found[name] = _range(side, name, pair)
    return found


def _range(side: Side, name: str, given: object) -> tuple[float, float]:
    pair = given.tolist() if isinstance(given, np.ndarray) else given
    if isinstance(pair, (tuple, list)) and len(pair) == 2:
        low, high = pair
        if all(map(is_real, pair)) and math.isfinite(low) and math.isfinite(high) and low < high:
            return float(low), float(high)
    raise InvalidValueError(
        f"the range of `{name}` in `{side.ranges}` is {given!r}; expected two finite numbers, the "
        "lower one first"
    )


def _ranges(leaf: Any) -> list[tuple[float, float]]:
    """Returns the range of each number of an array."""
    if isinstance(leaf, gymnasium_spaces.Box):
        pairs = zip(leaf.low.reshape(-1).tolist(), leaf.high.reshape(-1).tolist())
        return [
            (low if low > -_LARGEST else -math.inf, high if high < _LARGEST else math.inf)
            for low, high in pairs
        ]
    if isinstance(leaf, gymnasium_spaces.Discrete):
        return [(float(leaf.start), float(leaf.start + leaf.n - 1))]
    pairs = zip(leaf.start.reshape(-1).tolist(), leaf.nvec.reshape(-1).tolist())
    return [(float(start), float(start + size - 1)) for start, size in pairs]
