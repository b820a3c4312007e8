"""Logs of real robots: topics with times and columns, from the files of other tools."""

from __future__ import annotations

import dataclasses
import os
import pathlib
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from mishandle import lerobot_data, mcap_files, ros_bags
from mishandle.errors import InvalidValueError
from mishandle.files import PathLike
from mishandle.log_columns import Tables

TIMES = ("log", "publish", "header")
"""Which time of a message counts: when the recorder received it, when its publisher sent it, or the one in its header."""


@dataclasses.dataclass(frozen=True, eq=False)
class Topic:
    """Messages of one topic, as a table.

    ``times`` are integer nanoseconds in increasing order, ``columns`` one array of numbers for each field. A value that a message
    lacks is NaN. ``left_out`` says why other fields are no columns.
    """

    name: str
    times: NDArray[np.int64]
    columns: dict[str, NDArray[np.float64]]
    left_out: dict[str, str] = dataclasses.field(default_factory=dict)

    @property
    def signals(self) -> list[str]:
        """Names of its columns in formulas: ``topic/column``."""
        return [f"{self.name}/{column}" if self.name else column for column in self.columns]

    def __repr__(self) -> str:
        return f"Topic({self.name!r}, {len(self.times)} messages, columns {list(self.columns)})"


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
    path: PathLike,
    topics: Iterable[str] | None = None,
    *,
    time: str = "log",
    partial: bool = False,
    episode: int | None = None,
) -> Log:
    """Reads a recording: MCAP, rosbag2, ROS 1 bag, or an episode of a LeRobot data set.

    ROS 2 messages, JSON and Protobuf in MCAP files are read. A signal of a formula is ``topic/field``, and nested fields are
    ``topic/field/part`` and ``topic/field[0]``, in backquotes: ``"always(`/wrench/wrench/force/z` <= 20)"``. Text, bytes, and arrays
    of more than 100 elements are no columns; :attr:`Topic.left_out` lists them.

    Parameters
    ----------
    path : path
        ``.mcap``, ``.db3`` or ``.bag``, a folder with ``metadata.yaml`` (rosbag2), or a folder with ``meta/info.json`` (LeRobot).
    topics : iterable of str, optional
        Topics to read. By default all whose messages can be read; :attr:`Log.not_read` says why others cannot.
    time : str
        ``"log"``: when the recorder received a message. ``"publish"``: when it was sent (MCAP). ``"header"``: its ``header.stamp``,
        or the field ``timestamp`` of a message of Foxglove. A LeRobot data set has one time and ignores this.
    partial : bool
        Whether to read a damaged or truncated MCAP file up to the damage, as after a power failure. By default it is an error.
    episode : int, optional
        Episode of a LeRobot data set. A data set of one episode needs none.
    """
    file = pathlib.Path(os.fspath(path))
    requested = None if topics is None else ([topics] if isinstance(topics, str) else list(topics))
    if time not in TIMES:
        raise InvalidValueError(f"the time of a message is one of {', '.join(TIMES)}, not {time}")
    if not file.exists():
        raise InvalidValueError(f"the log {file} does not exist")
    if lerobot_data.is_data_set(file):
        if requested is not None:
            raise InvalidValueError(f"{file} is a LeRobot data set, which has columns and no topics; leave out topics")
        return _episode(file, episode)
    if episode is not None:
        raise InvalidValueError(f"{file} has no episodes; only LeRobot data sets (folders with meta/info.json) have")
    tables = Tables(requested, time)
    _read(file, tables, time, partial)
    missing = [name for name in requested or [] if name not in tables.columns]
    if missing:
        known = sorted({*tables.columns, *tables.not_read})
        reasons = [f"the topic {name} {tables.not_read.get(name, 'is not in the log')}" for name in missing]
        raise InvalidValueError(f"{file}: {'; '.join(reasons)}; its topics are {', '.join(known) or 'none'}")
    return Log(str(file), {name: Topic(name, *columns.finish()) for name, columns in tables.columns.items()}, tables.not_read)


def read_logs(paths: PathLike | Sequence[PathLike], *, time: str = "log", partial: bool = False) -> list[Log]:
    """Reads several recordings. A LeRobot data set has one for each episode."""
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
            logs.append(read_log(path, time=time, partial=partial))
    return logs


def _read(file: pathlib.Path, tables: Tables, time: str, partial: bool) -> None:
    ending = file.suffix.lower()
    if file.is_dir() and not (file / "metadata.yaml").exists():
        raise InvalidValueError(
            f"the folder {file} is no log: it has neither metadata.yaml (rosbag2) nor meta/info.json (LeRobot)"
        )
    if not file.is_dir() and ending == ".mcap":
        mcap_files.read(file, tables, partial)
        return
    if not file.is_dir() and ending not in (".bag", ".db3"):
        raise InvalidValueError(f"{file}: the ending of a log is .mcap, .db3 or .bag, not {ending or 'none'}")
    if time == "publish":
        raise InvalidValueError(f'{file}: a bag has no publish times; pass time="log" or time="header"')
    if partial:
        raise InvalidValueError(f"{file}: partial is for MCAP files; repair a bag by `ros2 bag reindex` or `rosbag reindex`")
    ros_bags.read(file, tables)


def _episode(folder: pathlib.Path, episode: int | None) -> Log:
    found = list(lerobot_data.episodes(folder, episode))
    if episode is not None and not found:
        raise InvalidValueError(f"the data set {folder} has no episode {episode}")
    if len(found) != 1:
        raise InvalidValueError(
            f"the data set {folder} has {len(found)} episodes; pass one as episode, or read all by mishandle.read_logs"
        )
    number, times, columns, left_out = found[0]
    return Log(f"{folder} episode {number}", {"": Topic("", times, columns, left_out)})
