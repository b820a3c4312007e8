"""Columns of numbers from messages. A nested field is a column such as ``wrench/force/x`` or
``position[0]``."""

import dataclasses
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.errors import InvalidValueError

MAX_ELEMENTS = 100
"""Longest array whose elements become columns. Images, point clouds and laser scans are longer."""

MAX_COLUMNS = 10_000
"""Most columns of a topic, so that a file with other names in each message does not fill the
memory."""

MAX_DEPTH = 32
"""Deepest nesting of fields."""

NAN = float("nan")


class Tables:
    """Tables of the topics that are read, and why others are not."""

    def __init__(self, requested: list[str] | None, time: str) -> None:
        self.columns: dict[str, Columns] = {}
        self.not_read: dict[str, str] = {}
        self.messages = 0
        self._requested = requested
        self._time = time

    def is_requested(self, topic: str) -> bool:
        """Returns whether to read a topic."""
        if self._requested is None or topic in self._requested:
            return True
        self.not_read[topic] = "was not requested"
        return False

    def add(self, topic: str, stamps: dict[str, int], message: Any) -> None:
        """Adds a message with its times in nanoseconds. A topic that is no table is dropped, with
        the reason."""
        stamp = stamp_of(message) if self._time == "header" else stamps[self._time]
        try:
            if stamp is None:
                raise InvalidValueError(
                    'has messages without header.stamp; leave out plan["log"]["time"]'
                )
            self.columns.setdefault(topic, Columns()).append(stamp, message)
        except InvalidValueError as error:
            self.columns.pop(topic, None)
            self.not_read[topic] = str(error)


class Columns:
    """Rows of one topic. A field that a message lacks is NaN there."""

    def __init__(self) -> None:
        self.times: array[int] = array("q")
        self._columns: dict[str, array[float]] = {}
        self._left_out: dict[str, str] = {}
        self._joints: list[str] | None = None

    def append(self, time: int, message: Any) -> None:
        """Adds a row at a time in nanoseconds."""
        if not -(2**63) <= time < 2**63:
            raise InvalidValueError(f"has a message at {time} ns, which does not fit 64 bits")
        self._check_joints(message)
        row = len(self.times)
        self.times.append(time)
        for name, value in self._flattened("", message, MAX_DEPTH):
            column = self._columns.get(name)
            if column is None:
                if len(self._columns) == MAX_COLUMNS:
                    raise InvalidValueError(f"has messages with more than {MAX_COLUMNS} fields")
                column = self._columns[name] = array("d")
            if len(column) < row:
                column.extend([NAN] * (row - len(column)))
            elif len(column) > row:
                raise InvalidValueError(f"has a message with two fields `{name}`")
            column.append(value)

    def finish(self) -> tuple[NDArray[np.int64], dict[str, NDArray[np.float64]], dict[str, str]]:
        """Returns times, columns, and why other fields are no columns. Rows are in the order of
        their times. Where the clock starts again, another run follows: sorting would mix both."""
        times = np.array(self.times, dtype=np.int64)
        order = None if np.all(times[1:] >= times[:-1]) else _order(times)
        columns = {}
        for name, column in self._columns.items():
            values = np.full(len(times), np.nan)
            values[: len(column)] = column
            columns[name] = values if order is None else values[order]
        left_out = {name: reason for name, reason in self._left_out.items() if name not in columns}
        return times if order is None else times[order], columns, left_out

    def _check_joints(self, message: Any) -> None:
        """Refuses states of joints whose order changes: an element would be another joint in each
        message."""
        names = message.get("name") if isinstance(message, dict) else getattr(message, "name", None)
        if not isinstance(names, list) or not names or not isinstance(names[0], str):
            return
        if self._joints is None:
            self._joints = list(names)
        elif self._joints != names:
            raise InvalidValueError(
                "has messages that name different joints or another order "
                f"({', '.join(self._joints[:8])}; {', '.join(map(str, names[:8]))}), so that "
                "`position[0]` has no meaning; split the topic by its publishers"
            )

    def _flattened(self, name: str, value: Any, depth: int) -> Iterator[tuple[str, float]]:
        if isinstance(value, (float, int, np.number, np.bool_)):
            try:
                yield name or "data", float(value)
            except OverflowError:
                self._left_out[name] = "a number is larger than a 64-bit float"
        elif value is None:
            return
        elif isinstance(value, str):
            self._left_out[name] = "it is text"
        elif isinstance(value, (bytes, bytearray, memoryview)):
            self._left_out[name] = "it is an array of bytes"
        elif depth == 0:
            self._left_out[name] = f"its fields are nested deeper than {MAX_DEPTH} levels"
        elif isinstance(value, Mapping):
            for key, part in value.items():
                yield from self._flattened(f"{name}/{key}" if name else str(key), part, depth - 1)
        else:
            fields = fields_of(type(value))
            if fields is not None:
                for field, part in fields(value):
                    yield from self._flattened(
                        f"{name}/{field}" if name else field, part, depth - 1
                    )
                return
            try:
                length = len(value)
            except TypeError:
                self._left_out[name] = f"it is of the type {type(value).__name__}"
                return
            if length > MAX_ELEMENTS:
                self._left_out[name] = f"it is an array of more than {MAX_ELEMENTS} elements"
                return
            for index, part in enumerate(value):
                yield from self._flattened(f"{name}[{index}]", part, depth - 1)


def _order(times: NDArray[np.int64]) -> NDArray[np.int64]:
    """Returns the order of rows by time, within each run of the clock."""
    starts = [0, *_native.clock_restarts(times), len(times)]
    runs = [
        first + np.argsort(times[first:last], kind="stable")
        for first, last in zip(starts, starts[1:])
    ]
    return np.concatenate(runs)


def stamp_of(message: Any) -> int | None:
    """Returns the time in nanoseconds that a message states: ``header.stamp`` of ROS, or
    ``timestamp`` of Foxglove."""
    header = _field(message, "header")
    stamp = _field(message, "timestamp") if header is None else _field(header, "stamp")
    seconds = [
        value for name in ("sec", "secs", "seconds") if (value := _field(stamp, name)) is not None
    ]
    nanoseconds = [
        value for name in ("nanosec", "nsec", "nsecs", "nanos")
        if (value := _field(stamp, name)) is not None
    ]
    if (
        not seconds or not nanoseconds or not isinstance(seconds[0], int)
        or not isinstance(nanoseconds[0], int)
    ):
        return None
    return int(seconds[0]) * 1_000_000_000 + int(nanoseconds[0])


def _field(message: Any, name: str) -> Any:
    return message.get(name) if isinstance(message, Mapping) else getattr(message, name, None)


Fields = Callable[[Any], Iterable[tuple[str, Any]]]

_FIELDS: dict[type, "Fields | None"] = {}


def fields_of(kind: type) -> Fields | None:
    """Returns the function that lists the fields of a message of this class, or ``None`` for other
    classes."""
    if kind in _FIELDS:
        return _FIELDS[kind]
    found: Fields | None = None
    if dataclasses.is_dataclass(kind):
        # Messages of the package rosbags.
        names = [field.name for field in dataclasses.fields(kind)]
        found = lambda message: [(name, getattr(message, name)) for name in names]  # noqa: E731
    elif hasattr(kind, "DESCRIPTOR"):
        found = _protobuf_fields
    elif isinstance(getattr(kind, "__slots__", None), list) and hasattr(kind, "_full_text"):
        # Messages of the package mcap-ros2-support.
        slots = list(getattr(kind, "__slots__"))
        found = lambda message: [(name, getattr(message, name)) for name in slots]  # noqa: E731
    _FIELDS[kind] = found
    return found


def _protobuf_fields(message: Any) -> Iterator[tuple[str, Any]]:
    for field in message.DESCRIPTOR.fields:
        # The value of a field that is not set is the default, which nobody measured. Scalars
        # without presence are always set.
        if not field.has_presence or message.HasField(field.name):
            yield field.name, getattr(message, field.name)
