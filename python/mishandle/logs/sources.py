"""What can be a log: files, recordings, and columns in memory."""

import os
import pathlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.base.traces import columns_of, trace_of
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.logs import lerobot_data
from mishandle.logs.recordings import (
    FILE, TABLE, Log, Reading, Topic, is_recording, read_logs, read_signals
)

Times = tuple[str, str, Union[NDArray[Any], list[str]]]
"""Column, kind and values of the times."""

NativeTopic = tuple[Union[str, None], Union[Times, None], list[tuple[str, NDArray[np.float64]]]]
NativeLog = tuple[str, list[tuple[Union[str, None], str]], list[NativeTopic]]
"""Name, files with their topics, and topics in memory, as the extension module takes a log."""


Hint = Callable[[list[str]], Union[str, None]]
"""Checks the names of all columns of a log, and advises if it lacks a signal."""


def native_logs(
    log: Any, signals: Sequence[str], hint: Hint, reading: Reading
) -> Iterator[NativeLog]:
    """Yields the logs that an argument is: one, or all episodes of a data set."""
    if isinstance(log, (str, os.PathLike)):
        file = pathlib.Path(os.fspath(log))
        if lerobot_data.is_data_set(file):
            reading.check_effect([*TABLE, "time"], f"the data set {file}")
            yield from (_of_recording(episode, signals, hint) for episode in read_logs(file))
        elif is_recording(file):
            reading.check_effect(TABLE, f"the recording {file}")
            yield _of_recording(read_signals(file, signals, reading.time), signals, hint)
        else:
            yield str(file), [(None, str(file))], []
    elif isinstance(log, Log):
        reading.check_effect([*TABLE, "time"], "a log that was read")
        yield _of_recording(log, signals, hint)
    elif isinstance(log, Mapping) and log and all(_is_topic(part) for part in log.values()):
        yield _of_topics({str(name): part for name, part in log.items()}, signals, hint, reading)
    else:
        reading.check_effect(FILE, "columns in memory")
        columns = columns_of(log, signals, hint)
        yield "", [], [(None, _times(log, reading), list(columns.items()))]


def _is_topic(part: Any) -> bool:
    return isinstance(part, (str, os.PathLike, Topic, Mapping)) or hasattr(part, "columns")


def _of_topics(
    log: Mapping[str, Any], signals: Sequence[str], hint: Hint, reading: Reading
) -> NativeLog:
    """Returns the log of several topics: all of them files, or all in memory."""
    files: list[tuple[str | None, str]] = [
        (name, os.fspath(part)) for name, part in log.items()
        if isinstance(part, (str, os.PathLike))
    ]
    if len(files) == len(log):
        return ", ".join(file for _, file in files), files, []
    if files:
        raise InvalidTypeError(
            f"the topic {files[0][0]} is a file, and others are not; read it by mishandle.read_log"
        )
    reading.check_effect(FILE, "topics in memory")
    topics: list[NativeTopic] = []
    known: list[str] = []
    for name, part in log.items():
        times = _of_log(part) if isinstance(part, Topic) else _times(part, reading)
        part = part.columns if isinstance(part, Topic) else trace_of(part)
        labels = [str(label) for label in (part if isinstance(part, Mapping) else part.columns)]
        known += [f"{name}/{label}" for label in labels]
        read = [label for label in labels if f"{name}/{label}" in signals]
        topics.append(
            (
                name, times,
                [(f"{name}/{label}", values) for label, values in columns_of(part, read).items()]
            )
        )
    _check_signals("", signals, known, {}, hint)
    return "", [], topics


def _of_recording(log: Log, signals: Sequence[str], hint: Hint) -> NativeLog:
    reasons = dict(log.not_read)
    topics: list[NativeTopic] = []
    for topic in log.topics.values():
        prefix = f"{topic.name}/" if topic.name else ""
        reasons |= {f"{prefix}{column}": reason for column, reason in topic.left_out.items()}
        read = [
            (f"{prefix}{name}", values) for name, values in topic.columns.items()
            if f"{prefix}{name}" in signals
        ]
        if read or not signals:
            topics.append((topic.name or None, _of_log(topic), read))
    _check_signals(log.name, signals, log.signals, reasons, hint)
    return log.name, [], topics


def _check_signals(
    log: str, signals: Sequence[str], known: Sequence[str], reasons: Mapping[str, str], hint: Hint
) -> None:
    suggestion = hint(list(known))
    missing = [signal for signal in signals if signal not in known]
    if not missing:
        return
    # A topic that was not read, or a column that is none.
    said = [
        f"{name}: {reason}"
        for name, reason in reasons.items()
        if any(signal == name or signal.startswith(f"{name}/") for signal in missing)
    ]
    other = f"topics without these signals: {', '.join(reasons)}" if reasons and not said else None
    parts = [
        f"the trace lacks the signals {', '.join(missing)}; it has {', '.join(known) or 'none'}",
        *said,
        other,
        suggestion,
    ]
    raise InvalidValueError(
        (f"trace {log}: " if log else "") + "; ".join(part for part in parts if part)
    )


def _of_log(topic: Topic) -> Times | None:
    return (
        None if topic.times is None
        else ("time", "log", np.ascontiguousarray(topic.times, dtype=np.int64))
    )


def _times(trace: Any, reading: Reading) -> Times | None:
    """Returns the column with the times of columns in memory."""
    trace = trace_of(trace)
    stated = reading.time
    labels = {
        str(label): label for label in (trace if isinstance(trace, Mapping) else trace.columns)
    }
    name = "time" if stated is None else stated
    both = _seconds_and_rest(trace, labels, name)
    if both is not None:
        reading.check_effect(["time_unit"], f"the seconds and the rest of `{name}`")
        return name, "log", both
    if stated is not None and stated not in labels:
        raise InvalidValueError(
            f"time is `{stated}`, but no column has this name; there are {', '.join(labels)}"
        )
    if name not in labels:
        return None
    values = _values(trace, labels[name])
    if values.ndim != 1:
        raise InvalidValueError(
            f"the times `{name}` have the shape {values.shape}; expected one number per sample"
        )
    if values.dtype.kind in "mM":
        return name, "instants", values.astype(f"{values.dtype.kind}8[ns]").astype(np.int64)
    if values.dtype.kind in "iu":
        return name, "integers", values.astype(np.int64)
    if values.dtype.kind == "f":
        return name, "numbers", values.astype(np.float64)
    if values.dtype.kind not in "OUT":
        raise InvalidValueError(
            f"the times `{name}` have the type {values.dtype}; expected numbers, dates or texts"
        )
    # Instants with a zone are objects.
    return name, "texts", [
        value.isoformat() if hasattr(value, "isoformat") else str(value)
        for value in values.tolist()
    ]


def _values(trace: Any, label: Any) -> NDArray[Any]:
    column = trace[label]
    return np.asarray(column if isinstance(trace, Mapping) else column.to_numpy())


def _seconds_and_rest(
    trace: Any, labels: Mapping[str, Any], name: str
) -> NDArray[np.int64] | None:
    """Returns the times in nanoseconds of two columns, if a name means whole seconds and the nano-,
    micro- or milliseconds after them; ``None`` if it does not."""
    found = _native.time_columns(list(labels), name)
    if found is None:
        return None
    *places, unit = found
    columns = [_values(trace, labels[list(labels)[place]]) for place in places]
    whole = []
    for place, values in zip(places, columns):
        integers = values.astype(np.int64) if values.dtype.kind in "iuf" else None
        if integers is None or values.ndim != 1 or not np.array_equal(integers, values):
            raise InvalidValueError(
                f"`{list(labels)[place]}` has values that are no integers; the times `{name}` are "
                "whole seconds and what comes after them in two columns"
            )
        whole.append(integers)
    seconds, rest = whole
    units = 1_000_000_000 // unit
    if seconds.shape != rest.shape or np.any((rest < 0) | (rest >= units)):
        raise InvalidValueError(
            f"`{list(labels)[places[1]]}` must have an integer from 0 to {units - 1} for each of "
            "the whole seconds"
        )
    times: NDArray[np.int64] = seconds * 1_000_000_000 + rest * unit
    return times
