"""Observations and actions as flat arrays of numbers, in the order of their space."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces as gymnasium_spaces
from gymnasium.vector.utils import batch_space, create_empty_array, iterate
from numpy.typing import NDArray

from mishandle.errors import InvalidTypeError, InvalidValueError


@dataclass(frozen=True)
class Part:
    """The numbers of one array in an observation or action.

    ``path`` has its names in dictionaries and its places in tuples, ``first`` is its first number
    in the flat array, and ``kind`` says whether it has real or whole numbers.
    """

    path: tuple[str | int, ...]
    first: int
    size: int
    dtype: str
    kind: str

    @property
    def numbers(self) -> slice:
        """Its numbers in the flat array."""
        return slice(self.first, self.first + self.size)


def spaces_in(
    space: Any, path: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    """Yields the path and the space of each part of a space that is no Dict or Tuple."""
    if isinstance(space, gymnasium_spaces.Dict):
        for name, part in space.spaces.items():
            yield from spaces_in(part, (*path, name))
    elif isinstance(space, gymnasium_spaces.Tuple):
        for place, part in enumerate(space.spaces):
            yield from spaces_in(part, (*path, place))
    else:
        yield path, space


def leaves(space: Any) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    """Yields the path and the space of each array in the values of a space."""
    kinds = gymnasium_spaces.Box, gymnasium_spaces.Discrete, gymnasium_spaces.MultiDiscrete
    for path, part in spaces_in(space):
        if not isinstance(part, kinds):
            raise InvalidTypeError(
                f"faults of a {type(part).__name__} are not known: only of Box, Discrete, "
                "MultiDiscrete, and a Dict or Tuple of them"
            )
        yield path, part


def parts_of(space: Any) -> tuple[Part, ...]:
    """Returns the parts of the values of a space.

    >>> speed, gear = gymnasium_spaces.Box(0.0, 1.0, (2,)), gymnasium_spaces.Discrete(3)
    >>> [
    ...     (part.path, part.first)
    ...     for part in parts_of(gymnasium_spaces.Dict({"speed": speed, "gear": gear}))
    ... ]
    [(('gear',), 0), (('speed',), 1)]
    """
    found: list[Part] = []
    first = 0
    for path, leaf in leaves(space):
        size = int(np.prod(leaf.shape))
        found.append(Part(path, first, size, leaf.dtype.str, leaf.dtype.kind))
        first += size
    return tuple(found)


def numbers_of(parts: Sequence[Part], value: Any) -> NDArray[np.float64]:
    """Returns the numbers of a value in a new array. Names count, not the order of a dictionary.

    >>> pair = gymnasium_spaces.Dict({
    ...     "a": gymnasium_spaces.Discrete(5), "b": gymnasium_spaces.Discrete(5)
    ... })
    >>> numbers_of(parts_of(pair), {"b": 2, "a": 1})
    array([1., 2.])
    """
    if len(parts) == 1:
        return _numbers(parts[0], value)
    return np.concatenate([_numbers(part, value) for part in parts])


def _numbers(part: Part, value: Any) -> NDArray[np.float64]:
    for name in part.path:
        try:
            value = value[name]
        except (LookupError, TypeError):
            raise InvalidValueError(
                f"an observation or action lacks the part {name!r} of its space"
            ) from None
    numbers = np.array(value, dtype=np.float64).reshape(-1)
    if len(numbers) != part.size:
        where = "".join(f"[{name!r}]" for name in part.path)
        raise InvalidValueError(
            f"an observation or action{where} has {len(numbers)} numbers; its space has {part.size}"
        )
    return numbers


def with_changes(
    parts: Sequence[Part], value: Any, before: NDArray[np.float64], after: NDArray[np.float64]
) -> Any:
    """Returns a value whose numbers that differ between two flat arrays are those of the second
    one. It shares the parts without a change with ``value``, and is ``value`` if no number differs.

    >>> pair = gymnasium_spaces.Dict({
    ...     "a": gymnasium_spaces.Discrete(5), "b": gymnasium_spaces.Discrete(5)
    ... })
    >>> with_changes(
    ...     parts_of(pair), {"b": 2, "a": 1}, np.array([1.0, 2.0]), np.array([4.0, 2.0])
    ... )["a"]
    np.int64(4)
    """
    # The fastest comparison of short arrays. Equal NaNs are equal.
    if before.tobytes() == after.tobytes():
        return value
    for part in parts:
        old, new = before[part.numbers], after[part.numbers]
        if old.tobytes() != new.tobytes():
            value = replaced(value, part.path, lambda found: _changed(part, found, old, new))
    return value


def replaced(value: Any, path: Sequence[str | int], change: Callable[[Any], Any]) -> Any:
    """Returns a value with a change of its part at a path. It shares the other parts."""
    if not path:
        return change(value)
    made = replaced(value[path[0]], path[1:], change)
    if isinstance(value, Mapping):
        return {**value, path[0]: made}
    return tuple(made if place == path[0] else each for place, each in enumerate(value))


def _changed(
    part: Part, value: Any, before: NDArray[np.float64], after: NDArray[np.float64]
) -> Any:
    array: NDArray[Any] = np.array(value, order="C")
    if array.dtype.kind != part.kind:
        # Whole numbers as an action of real numbers can become fractions.
        array = array.astype(part.dtype)
    if part.kind != "f":
        after = np.rint(after)
    np.copyto(array.reshape(-1), after, casting="unsafe", where=before != after)
    return array if isinstance(value, np.ndarray) else array[()]


def all_numbers(value: Any) -> NDArray[Any]:
    """Returns all numbers of an observation or action of any space, those of a dictionary in the
    order of its names."""
    if isinstance(value, Mapping):
        return np.concatenate([all_numbers(value[key]) for key in sorted(value)])
    if isinstance(value, tuple):
        return np.concatenate([all_numbers(part) for part in value])
    return np.asarray(value).reshape(-1)


def one_number(value: Any) -> float:
    """Returns a number, such as a reward. Environments also return an array of one element.

    >>> one_number(np.array([0.5])), one_number(2)
    (0.5, 2.0)
    """
    return float(value.item() if isinstance(value, np.ndarray) else value)


def size_of(space: Any) -> int | None:
    """Returns the number of numbers in a value of a space; ``None`` if it is not known.

    >>> size_of(gymnasium_spaces.Dict({
    ...     "gear": gymnasium_spaces.Discrete(3), "force": gymnasium_spaces.Box(-1, 1, (2,))
    ... }))
    3
    """
    known = (
        gymnasium_spaces.Box, gymnasium_spaces.Discrete, gymnasium_spaces.MultiDiscrete,
        gymnasium_spaces.MultiBinary
    )
    parts = [part for _, part in spaces_in(space)]
    if not all(isinstance(part, known) for part in parts):
        return None
    sizes: list[int] = [math.prod(part.shape) for part in parts]
    return sum(sizes)


def check_size(action: Any, size: int) -> None:
    """Checks that an action has as many numbers as those of its space. NumPy would repeat a single
    number for all actuators.

    >>> check_size([0.5], 2)
    Traceback (most recent call last):
        ...
    mishandle.errors.InvalidValueError: the policy returned an action of 1 number; expected 2
    """
    found = action.size if type(action) is np.ndarray else all_numbers(action).size
    if found != size:
        raise InvalidValueError(
            f"the policy returned an action of {found} number{'' if found == 1 else 's'}; expected "
            f"{size}"
        )


def idle_action(space: Any) -> Any:
    """Returns the action before the first one of a policy: 0, or the value of the space that is
    nearest to it.

    >>> idle_action(gymnasium_spaces.Box(0.5, 1.0, (2,)))
    array([0.5, 0.5], dtype=float32)
    >>> idle_action(gymnasium_spaces.Dict({"gear": gymnasium_spaces.Discrete(3, start=1)}))
    {'gear': np.int64(1)}
    """
    if isinstance(space, gymnasium_spaces.Dict):
        return {name: idle_action(part) for name, part in space.spaces.items()}
    if isinstance(space, gymnasium_spaces.Tuple):
        return tuple(idle_action(part) for part in space.spaces)
    if isinstance(space, gymnasium_spaces.Box):
        return np.clip(np.zeros(space.shape), space.low, space.high).astype(space.dtype)
    if isinstance(space, gymnasium_spaces.Discrete):
        return np.clip(np.int64(0), space.start, space.start + space.n - 1)
    if isinstance(space, gymnasium_spaces.MultiDiscrete):
        return np.clip(
            np.zeros_like(space.nvec), space.start, space.start + space.nvec - 1
        ).astype(space.dtype)
    # Other spaces have a value of zeros in Gymnasium.
    one = batch_space(space, 1)
    return next(iter(iterate(one, create_empty_array(space, 1, np.zeros))))
