"""Logs of real robots: topics with times and columns, from the files of other tools."""

import dataclasses
import os
import pathlib
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.base.documents import Call, Plan
from mishandle.base.files import PathLike
from mishandle.errors import InvalidValueError
from mishandle.logs import lerobot_data, mcap_files, ros_bags
from mishandle.logs.columns import Tables

MESSAGES = (".mcap", ".bag", ".db3")
"""Endings of recordings of messages."""

TIMES = ("log", "publish", "header")
"""Which time of a message counts: when the recorder received it, when its publisher sent it, or the
one in its header."""


FILE = ("topic_column", "format", "delimiter", "decimal")
"""Keys of the table ``log`` of a plan that have an effect on files only."""

TABLE = ("time_unit", "utc_offset", *FILE)
"""Keys that have an effect on tables only."""


class Reading:
    """How a function reads a log: the table ``log`` of its argument ``plan``."""

    def __init__(self, function: str, plan: Plan | None) -> None:
        self.call = Call(function, {"plan": plan}).text()
        self.time, self._keys = _native.log_keys(self.call)

    def check_effect(self, keys: Sequence[str], kind: str) -> None:
        """Checks that the plan has none of these keys, which have no effect on a kind of log."""
        for key in self._keys:
            if key in keys:
                raise InvalidValueError(
                    f'plan["log"]["{key}"] has no effect on {kind}; leave it out'
                )


@dataclasses.dataclass(frozen=True, eq=False)
class Topic:
    """Messages of one topic, or the rows of a table.

    ``times`` are integer nanoseconds, of messages in increasing order within each run of the clock;
    ``None`` for a table without them. ``columns`` is one array of numbers for each field. A value
    that a message lacks is NaN. ``left_out`` says why other fields are no columns.
    """

    name: str
    times: NDArray[np.int64] | None
    columns: dict[str, NDArray[np.float64]]
    left_out: dict[str, str] = dataclasses.field(default_factory=dict)

    @property
    def signals(self) -> list[str]:
        """Names of its columns in formulas: ``topic/column``."""
        return [f"{self.name}/{column}" if self.name else column for column in self.columns]

    def __repr__(self) -> str:
        rows = len(next(iter(self.columns.values()), ())) if self.times is None else len(self.times)
        return f"Topic({self.name!r}, {rows} messages, columns {list(self.columns)})"


@dataclasses.dataclass(frozen=True, eq=False)
class Log:
    """One recording: its topics, and why other topics were not read."""

    name: str
    topics: dict[str, Topic]
    not_read: dict[str, str] = dataclasses.field(default_factory=dict)

    @property
    def signals(self) -> list[str]:
        """Names of all columns in formulas."""
        return [signal for topic in self.topics.values() for signal in topic.signals]

    def __repr__(self) -> str:
        return f"Log({self.name!r}, topics {list(self.topics)})"


def read_log(
    path: PathLike, topics: Iterable[str] | None = None, *, partial: bool = False,
    episode: int | None = None, plan: Plan | None = None
) -> Log:
    """Reads a recording (MCAP, rosbag2, ROS 1 bag), an episode of a LeRobot data set, or a table
    (CSV, JSON lines, NumPy, Parquet).

    ROS 2 messages, JSON and Protobuf in MCAP files are read. A signal of a formula is
    ``topic/field``, and nested fields are ``topic/field/part`` and ``topic/field[0]``, in
    backquotes: ``"always(`/wrench/wrench/force/z` <= 20)"``. Text, bytes, and arrays of more than
    100 elements are no columns; :attr:`Topic.left_out` lists them. A table is a topic without a
    name, or has those that ``log.topic_column`` names; its rows stay in their order.

    Parameters
    ----------
    path : path
        ``.mcap``, ``.db3`` or ``.bag``, a folder with ``metadata.yaml`` (rosbag2), a folder with
        ``meta/info.json`` (LeRobot), or a table.
    topics : iterable of str, optional
        Topics to read. By default all whose messages can be read; :attr:`Log.not_read` says why
        others cannot.
    partial : bool
        Whether to read a damaged or truncated MCAP file up to the damage, as after a power failure.
        By default it is an error.
    episode : int, optional
        Episode of a LeRobot data set. A data set of one episode needs none.
    plan : dict, optional
        Rare settings: ``time`` of the table ``log``, and for a table ``time_unit``,
        ``utc_offset``, ``topic_column``, ``format``, ``delimiter`` and ``decimal``. The ``time`` of
        messages is ``"log"`` (default): when the recorder received them; ``"publish"``: when they
        were sent (MCAP); or ``"header"``: their ``header.stamp``, or the field ``timestamp`` of a
        message of Foxglove. A LeRobot data set has one time and ignores this.
    """
    file = pathlib.Path(os.fspath(path))
    requested = None if topics is None else ([topics] if isinstance(topics, str) else list(topics))
    reading = Reading("read_log", plan)
    if not file.exists():
        raise InvalidValueError(f"the log {file} does not exist")
    is_data_set = lerobot_data.is_data_set(file)
    if is_data_set or is_recording(file):
        reading.check_effect(TABLE, f"{file}, which is no table")
    if is_data_set:
        if requested is not None:
            raise InvalidValueError(
                f"{file} is a LeRobot data set, which has columns and no topics; leave out topics"
            )
        return _episode(file, episode)
    if episode is not None:
        raise InvalidValueError(
            f"{file} has no episodes; only LeRobot data sets (folders with meta/info.json) have"
        )
    if not is_recording(file):
        if partial:
            raise InvalidValueError(f"{file}: partial is for MCAP files")
        return _requested(_table(file, reading), requested)
    return _requested(_messages(file, requested, reading.time, partial), requested)


def _requested(log: Log, requested: list[str] | None) -> Log:
    """Returns the requested topics of a log."""
    missing = [name for name in requested or [] if name not in log.topics]
    if missing:
        known = sorted({*log.topics, *log.not_read})
        reasons = [
            f"the topic {name} {log.not_read.get(name, 'is not in the log')}" for name in missing
        ]
        raise InvalidValueError(
            f"{log.name}: {'; '.join(reasons)}; its topics are {', '.join(known) or 'none'}"
        )
    if requested is None:
        return log
    not_read = {**dict.fromkeys(log.topics, "was not requested"), **log.not_read}
    topics = {name: topic for name, topic in log.topics.items() if name in requested}
    return Log(
        log.name, topics, {name: reason for name, reason in not_read.items() if name not in topics}
    )


def is_recording(file: pathlib.Path) -> bool:
    """Returns whether a path is a recording of messages: a file by its ending, or a folder."""
    return file.is_dir() or file.suffix.lower() in MESSAGES


def read_signals(file: pathlib.Path, signals: Iterable[str], time: str | None) -> Log:
    """Reads the topics of a recording of messages that can have these signals."""
    if not file.exists():
        raise InvalidValueError(f"the log {file} does not exist")
    parts = [signal.split("/") for signal in signals]
    return _messages(
        file, ["/".join(part[:end]) for part in parts for end in range(len(part))], time,
        partial=False
    )


def _messages(
    file: pathlib.Path, requested: list[str] | None, time: str | None, partial: bool
) -> Log:
    if time is not None and time not in TIMES:
        raise InvalidValueError(f"the time of a message is one of {', '.join(TIMES)}, not {time}")
    tables = Tables(requested, time or "log")
    _read(file, tables, time or "log", partial)
    return Log(
        str(file),
        {name: Topic(name, *columns.finish()) for name, columns in tables.columns.items()},
        tables.not_read
    )


def _table(file: pathlib.Path, reading: Reading) -> Log:
    topics, left_out = _native.read_table(str(file), reading.call)
    reasons: dict[str, dict[str, str]] = {name or "": {} for name, _, _ in topics}
    for column, reason in left_out:
        topic = next((name for name in reasons if name and column.startswith(f"{name}/")), "")
        reasons.setdefault(topic, {})[column[len(topic) + 1 :] if topic else column] = reason
    found = {}
    for name, times, columns in topics:
        prefix = 0 if name is None else len(name) + 1
        found[name or ""] = Topic(
            name or "", times, {column[prefix:]: values for column, values in columns},
            reasons[name or ""]
        )
    return Log(str(file), found)


def read_logs(
    paths: PathLike | Sequence[PathLike], *, partial: bool = False, plan: Plan | None = None
) -> list[Log]:
    """Reads several logs, as :func:`read_log`. A LeRobot data set has one for each episode."""
    files = [paths] if isinstance(paths, (str, os.PathLike)) else list(paths)
    logs: list[Log] = []
    for path in files:
        file = pathlib.Path(os.fspath(path))
        if lerobot_data.is_data_set(file):
            logs += [
                Log(f"{file} episode {number}", {"": Topic("", times, columns, left_out)})
                for number, times, columns, left_out in lerobot_data.episodes(file)
            ]
        else:
            logs.append(read_log(path, partial=partial, plan=plan))
    return logs


def _read(file: pathlib.Path, tables: Tables, time: str, partial: bool) -> None:
    ending = file.suffix.lower()
    if file.is_dir() and not (file / "metadata.yaml").exists():
        raise InvalidValueError(
            f"the folder {file} is no log: it has neither metadata.yaml (rosbag2) nor "
            "meta/info.json (LeRobot)"
        )
    if not file.is_dir() and ending == ".mcap":
        mcap_files.read(file, tables, partial)
        return
    if time == "publish":
        raise InvalidValueError(
            f'{file}: a bag has no publish times; pass plan={{"log": {{"time": "log|header"}}}}'
        )
    if partial:
        raise InvalidValueError(
            f"{file}: partial is for MCAP files; repair a bag by `ros2 bag reindex` or `rosbag "
            "reindex`"
        )
    ros_bags.read(file, tables)


def _episode(folder: pathlib.Path, episode: int | None) -> Log:
    found = list(lerobot_data.episodes(folder, episode))
    if episode is not None and not found:
        raise InvalidValueError(f"the data set {folder} has no episode {episode}")
    if len(found) != 1:
        raise InvalidValueError(
            f"the data set {folder} has {len(found)} episodes; pass one as episode, or read all by "
            "mishandle.logs.read_logs"
        )
    number, times, columns, left_out = found[0]
    return Log(f"{folder} episode {number}", {"": Topic("", times, columns, left_out)})
