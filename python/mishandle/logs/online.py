"""Monitors that get one sample after the other, while a robot runs."""

import dataclasses
import numbers
from array import array
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.base.traces import columns_of
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.logs.formulas import Formula


class OnlineMonitor(_native.OnlineMonitor):
    """A monitor of one or more formulas over the same signals, which shares their common parts.

    Parameters
    ----------
    formulas : str, Formula, or sequence of them
        The methods ``bounds``, ``verdict`` and ``decided`` take the index of a formula, 0 by
        default.
    signals : sequence of str, optional
        Names of the values of a sample, in order. By default the signals of the formulas, in the
        order in which they occur; :attr:`signals` lists them.
    period : float, optional
        Time between two samples, in seconds. Formulas with a unit in their bounds need it.
    samples : int, optional
        Number of samples of the whole trace, if it is known. A window without an end then ends
        there.

    Notes
    -----
    - ``push(sample)`` adds a sample: a tuple, list or array with one number for each signal, or a
      number if there is one signal. A dictionary, a named tuple, a data class, a record of NumPy or
      a ``Series`` of pandas is read by its names. A number that is NaN or infinite is an error.
    - ``push_many(samples)`` adds the rows of an array (samples, signals), or of a data frame, a
      dictionary of arrays or a structured array, whose columns are read by their names.
    - ``bounds()`` is the least and the greatest robustness at the first sample over all
      continuations.
    - ``verdict()`` is True or False as soon as nothing can change it, and None before.
    - ``decided()`` is the sample whose robustness the last push decided, and the robustness, or
      None.
    - ``reset()`` forgets all samples, and ``len(monitor)`` counts them.

    A monitor is for one thread at a time.

    Examples
    --------
    >>> monitor = OnlineMonitor("always[0:9](x <= 1)")
    >>> for x in [0.0, 0.5, 3.0]:
    ...     monitor.push(x)
    ...     print(monitor.bounds(), monitor.verdict())
    (-inf, 1.0) None
    (-inf, 0.5) None
    (-inf, -2.0) False
    """

    def __new__(
        cls, formulas: str | Formula | Sequence[str | Formula],
        signals: Sequence[str] | None = None, period: float | None = None,
        samples: int | None = None
    ) -> "OnlineMonitor":
        given = [formulas] if isinstance(formulas, (str, Formula)) else list(formulas)
        parsed = [
            formula if isinstance(formula, Formula) else Formula(formula) for formula in given
        ]
        if isinstance(signals, str):
            raise InvalidTypeError(f"signals must be a sequence of names, such as [{signals!r}]")
        names = (
            [name for formula in parsed for name in formula.signals] if signals is None
            else list(signals)
        )
        if signals is not None and len(set(names)) < len(names):
            raise InvalidValueError(f"two signals have the same name: {', '.join(names)}")
        monitor = super().__new__(
            cls, [formula.native for formula in parsed], list(dict.fromkeys(names)), period, samples
        )
        return monitor  # type: ignore[return-value]

    def push_many(self, samples: Any) -> None:
        """Adds the rows of an array (samples, signals), or the numbers of an array if there is one
        signal. Whatever has names is read by its names."""
        columns = _columns(samples)
        if columns is not None:
            super().push_many(_rows(columns, self.signals))
            return
        if isinstance(samples, (list, tuple)) and any(map(has_names, samples)):
            for sample in samples:
                self.push(sample)
            return
        if not (isinstance(samples, Sequence) or hasattr(samples, "__array__")):
            raise InvalidTypeError(
                "samples must be an array (samples, signals), a data frame or a dictionary of "
                f"arrays, not a {type(samples).__name__}"
            )
        self._check_name(samples)
        _check_masks(samples)
        try:
            rows = np.asarray(samples, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InvalidTypeError(f"samples must be numbers: {error}") from error
        super().push_many(
            rows.reshape(-1, 1) if rows.ndim == 1 and len(self.signals) == 1 else rows
        )

    def _check_name(self, samples: Any) -> None:
        """Checks that a column with a name, such as a ``Series``, is that of the only signal."""
        name = getattr(samples, "name", None)
        if isinstance(name, str) and name and [name] != self.signals:
            raise InvalidValueError(
                f"the samples are of the column `{name}`; the monitor reads "
                f"{', '.join(self.signals)}"
            )


def has_names(sample: Any) -> bool:
    """Returns whether the numbers of a sample have names.

    >>> has_names({"x": 1.0}), has_names((1.0, 2.0)), has_names(np.zeros(1, [("x", "f8")])[0])
    (True, False, True)
    """
    return (
        isinstance(sample, Mapping) or hasattr(sample, "_fields") or hasattr(sample, "keys")
        or dataclasses.is_dataclass(sample)
        or getattr(getattr(sample, "dtype", None), "names", None) is not None
    )


def values_of(sample: Any, signals: list[str]) -> list[Any]:
    """Returns the numbers of a sample in the order of the signals. Names count before places; the
    extension module calls it for samples that are no plain tuple, list, dictionary or array.

    >>> import collections
    >>> values_of(collections.namedtuple("Row", "a b")(0.0, 5.0), ["b", "a"])
    [5.0, 0.0]
    """
    _check_masks(sample)
    if hasattr(sample, "columns"):
        raise InvalidTypeError(
            f"a sample must be one number per signal; got a {type(sample).__name__} of several "
            "samples: push_many takes them"
        )
    if dataclasses.is_dataclass(sample):
        names = [field.name for field in dataclasses.fields(sample)]
        return _by_name(names, [getattr(sample, name) for name in names], signals)
    if hasattr(sample, "_fields"):
        return _by_name(sample._fields, list(sample), signals)
    names_of_record = getattr(getattr(sample, "dtype", None), "names", None)
    if names_of_record is not None and np.ndim(sample) == 0:
        return _by_name(names_of_record, list(sample.item()), signals)
    if hasattr(sample, "keys"):
        labels = list(sample.keys())
        values = sample.to_list() if hasattr(sample, "to_list") else [sample[key] for key in labels]
        # The places of a `Series` without names.
        if labels == list(range(len(values))):
            return values
        return _by_name([str(label) for label in labels], values, signals)
    if isinstance(sample, (str, bytes)) or not (
        isinstance(sample, (Sequence, Iterator, array, numbers.Real))
        or hasattr(sample, "__array__")
    ):
        raise InvalidTypeError(
            "a sample must be numbers, one per signal, or have them by name; got a "
            f"{type(sample).__name__}"
        )
    if isinstance(sample, (Sequence, Iterator)):
        return list(sample)
    found = np.asarray(sample)
    if found.ndim > 1 or found.dtype.names is not None:
        raise InvalidTypeError(
            f"a sample must be one number per signal; got an array of the shape {found.shape} and "
            f"the type {found.dtype}: push_many takes several samples"
        )
    return list(np.atleast_1d(found).tolist())


def _check_masks(sample: Any) -> None:
    """Refuses masked values, which are missing: the data below a mask are no measurement."""
    parts = sample if isinstance(sample, (list, tuple)) else [sample]
    if any(np.ma.is_masked(part) for part in parts):
        raise InvalidValueError("the sample has masked values; leave out samples that lack one")


def _by_name(names: Sequence[str], values: Sequence[Any], signals: list[str]) -> list[Any]:
    for signal in signals:
        if list(names).count(signal) != 1:
            what = "lacks" if signal not in names else "has several values of"
            raise InvalidValueError(f"the sample {what} the signal {signal}")
    found = dict(zip(names, values))
    return [found[signal] for signal in signals]


def _columns(samples: Any) -> Any:
    """Returns samples whose columns have names as a trace; ``None`` if they have none."""
    names = getattr(getattr(samples, "dtype", None), "names", None)
    if names is not None:
        return {name: np.atleast_1d(samples)[name] for name in names}
    if hasattr(samples, "_fields"):
        return dict(zip(samples._fields, samples))
    if hasattr(samples, "column_names"):
        # A table of pyarrow.
        return {name: samples[name].to_numpy() for name in samples.column_names}
    return samples if isinstance(samples, Mapping) or hasattr(samples, "columns") else None


def _rows(columns: Any, signals: list[str]) -> NDArray[np.float64]:
    found = columns_of(columns, signals)
    return np.column_stack([found[signal] for signal in signals]) if signals else np.zeros((0, 0))
