"""Traces that users pass: dictionaries of arrays and data frames."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mishandle.errors import InvalidTypeError, InvalidValueError


def trace_of(given: Any) -> Any:
    """Returns the trace of a simulation, such as those of ``simulate``; of a trace, itself."""
    is_trace = isinstance(given, Mapping) or hasattr(given, "columns")
    return _with_index(given if is_trace else getattr(given, "trace", given))


def _with_index(trace: Any) -> Any:
    """Returns a data frame with its named index as a column: often it has the times."""
    names = getattr(getattr(trace, "index", None), "names", None)
    if not names or not hasattr(trace, "reset_index"):
        return trace
    has_names = all(isinstance(name, str) and name not in trace.columns for name in names)
    return trace.reset_index() if has_names else trace


def columns_of(
    trace: Any, names: Sequence[str] | None = None,
    hint: Callable[[list[str]], str | None] | None = None
) -> dict[str, NDArray[np.float64]]:
    """Returns some or all columns of a dictionary of arrays or of a data frame. Beside those in
    ``names``, there may be columns that are no numbers, such as time stamps, and columns of the
    same name. ``hint`` checks the names of all columns, and advises if some are missing."""
    trace = trace_of(trace)
    if isinstance(trace, Mapping):
        labels = list(trace)
    elif hasattr(trace, "columns"):
        labels = list(trace.columns)
    else:
        raise InvalidTypeError(
            f"a trace must be a dictionary of arrays or a data frame, not a {type(trace).__name__}"
        )
    known = [str(label) for label in labels]
    missing = [name for name in names or [] if name not in known]
    suggestion = hint(known) if hint is not None else None
    if missing:
        raise InvalidValueError(
            f"the trace lacks the signals {_listed(missing)}; it has {_listed(known) or 'none'}"
            + (f"; {suggestion}" if suggestion else "")
        )
    read = [(name, label) for name, label in zip(known, labels) if names is None or name in names]
    twice = [name for name, count in Counter(name for name, _ in read).items() if count > 1]
    if twice:
        raise InvalidValueError(f"the trace has several columns of the same name: {_listed(twice)}")
    columns = {}
    for name, label in read:
        values = trace[label] if isinstance(trace, Mapping) else trace[label].to_numpy()
        try:
            column = _numbers(values)
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidValueError(
                f"the signal `{name}` is not an array of numbers: {error}"
            ) from error
        if column.ndim != 1:
            raise InvalidValueError(
                f"the signal `{name}` has the shape {column.shape}; expected one number per "
                "sample, so that each component is a signal of its own"
            )
        columns[name] = column
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InvalidValueError(f"the signals of a trace must have the same length, got {lengths}")
    return columns


def _listed(names: Sequence[str]) -> str:
    """Lists names. Characters that nobody sees, such as those that reverse the text after them,
    appear as their escapes."""
    return ", ".join(
        "".join(c if c.isprintable() else ascii(c)[1:-1] for c in name) for name in names
    )


def _numbers(values: Any) -> NDArray[np.float64]:
    array: Any = np.asanyarray(values)
    if array.dtype.kind not in "biufO":
        raise TypeError(f"its elements have the type {array.dtype}")
    if (
        array.dtype.kind == "O"
        and any(isinstance(value, (str, bytes, complex)) for value in array.flat)
    ):
        raise TypeError("some of its elements are not real numbers")
    numbers: NDArray[np.float64] = np.ma.filled(array.astype(np.float64), np.nan)
    return numbers
