"""LeRobot data sets of the versions 2 and 3, by the package ``pyarrow``."""

import json
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mishandle.base.packages import needed
from mishandle.errors import InvalidValueError
from mishandle.logs.columns import MAX_ELEMENTS

Episode = tuple[int, NDArray[np.int64], dict[str, NDArray[np.float64]], dict[str, str]]
"""Number, times in nanoseconds, columns, and why other features are no columns."""


def is_data_set(path: pathlib.Path) -> bool:
    """Returns whether a path is the folder of a data set."""
    return (path / "meta" / "info.json").is_file()


def episodes(folder: pathlib.Path, number: int | None = None) -> Iterator[Episode]:
    """Yields all episodes or one. A file of version 2 contains one episode, and of version 3
    several."""
    frames_per_second = _frames_per_second(folder)
    files = sorted((folder / "data").glob("chunk-*/*.parquet"))
    if not files:
        raise InvalidValueError(f"the data set {folder} has no file data/chunk-*/*.parquet")
    for file in files:
        table = _table(file)
        index = _column(file, table, "episode_index")
        for episode in np.unique(index) if number is None else [number]:
            rows = np.flatnonzero(index == episode)
            if len(rows):
                columns, left_out = _columns(file, table, rows)
                times = _times(file, columns, frames_per_second)
                order = np.argsort(times, kind="stable")
                yield int(episode), times[order], {
                    name: values[order] for name, values in columns.items()
                }, left_out


def _frames_per_second(folder: pathlib.Path) -> float:
    path = folder / "meta" / "info.json"
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
        version, rate = str(info["codebase_version"]), float(info["fps"])
    except (ValueError, KeyError, TypeError) as error:
        raise InvalidValueError(
            f"{path} does not state codebase_version and fps: {error}"
        ) from error
    if not version.startswith(("v2", "v3")):
        raise InvalidValueError(
            f"{path}: the version of the data set is {version}; v2 and v3 are read"
        )
    if not (np.isfinite(rate) and rate > 0):
        raise InvalidValueError(f"{path}: fps is {rate}; it must be positive")
    return rate


def _table(file: pathlib.Path) -> Any:
    with needed("LeRobot data sets need pyarrow", "logs"):
        import pyarrow.parquet
    try:
        schema = pyarrow.parquet.read_schema(file)
        # Pictures are structures of bytes.
        numbers = [field.name for field in schema if not pyarrow.types.is_struct(field.type)]
        return pyarrow.parquet.ParquetFile(file).read(columns=numbers)
    except (OSError, pyarrow.ArrowException) as error:
        raise InvalidValueError(f"{file} is damaged or no Parquet file: {error}") from error


def _column(file: pathlib.Path, table: Any, name: str) -> NDArray[Any]:
    if name not in table.column_names:
        raise InvalidValueError(f"{file} has no column {name}")
    return np.asarray(table.column(name).to_numpy())


def _columns(
    file: pathlib.Path, table: Any, rows: NDArray[Any]
) -> tuple[dict[str, NDArray[np.float64]], dict[str, str]]:
    """Returns one column for each number of a feature, such as ``observation.state[0]``."""
    columns: dict[str, NDArray[np.float64]] = {}
    left_out: dict[str, str] = {}
    for name in table.column_names:
        values = table.column(name).take(rows).to_pylist()
        if any(isinstance(value, str) for value in values):
            left_out[name] = "it is text"
            continue
        try:
            array = np.array(values, dtype=np.float64)
        except (TypeError, ValueError):
            left_out[name] = "its rows have no common shape, or are no numbers"
            continue
        if array[0].size > MAX_ELEMENTS:
            left_out[name] = f"it is an array of more than {MAX_ELEMENTS} elements"
            continue
        for index in np.ndindex(array.shape[1:]):
            # A feature of the shape (1,) is a number, and stored as one by some versions.
            label = name if array[0].size == 1 else name + "".join(f"[{i}]" for i in index)
            columns[label] = np.ascontiguousarray(array[(slice(None), *index)])
    if "timestamp" not in columns:
        raise InvalidValueError(f"{file} has no column of numbers timestamp")
    return columns, left_out


def _times(
    file: pathlib.Path, columns: dict[str, NDArray[np.float64]], rate: float
) -> NDArray[np.int64]:
    """Returns the times in nanoseconds. Stamps are 32-bit floats; where each is the frame divided
    by the rate up to their precision, the times are that quotient, without the jitter of the
    rounding."""
    stamps = columns["timestamp"]
    if not np.all(np.isfinite(stamps)) or np.any(np.abs(stamps) > 9e9):
        raise InvalidValueError(f"{file} has a timestamp that is no time in seconds")
    frames = columns.get("frame_index")
    if frames is not None:
        exact = frames / rate
        if np.all(np.abs(stamps - exact) <= np.spacing(np.abs(exact).astype(np.float32))):
            stamps = exact
    return np.round(stamps * 1e9).astype(np.int64)
