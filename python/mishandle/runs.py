"""Run files as tables."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mishandle import _native
from mishandle.errors import MissingPackageError

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]


@dataclass(frozen=True)
class RunAxis:
    """Axis of a recorded space. ``values`` is ``"continuous"``, ``"logarithmic"``, ``"integer"`` or ``"categorical"``; the
    names of a categorical axis have the numbers 0, 1, and so on."""

    name: str
    unit: str
    low: float
    high: float
    values: str = "continuous"
    names: tuple[str, ...] = ()

    def value(self, number: float | None) -> float | int | str | None:
        """Returns the value of a recorded number: a name of a categorical axis, an integer of an integer axis.

        >>> RunAxis("surface", "", 0, 1, "categorical", ("dry", "wet")).value(1.0)
        'wet'
        """
        if number is None or self.values in ("continuous", "logarithmic"):
            return number
        return self.names[int(number)] if self.names else int(number)


class Run:
    """A run file. Opening it checks the structure of the file and the hashes of all rows.

    Parameters
    ----------
    path : path
        The file.

    Attributes
    ----------
    target, formula, search : str
        Name of the system, text of the requirement, and name of the search; the last is empty for an evaluation.
    seed : int
        Random seed of the run.
    plan : str
        The plan in TOML.
    control_dt : float
        Duration of a control step, in seconds.
    steps : int
        Number of control steps of an episode.
    axes : list of RunAxis
        The space.
    signals : list of (str, str)
        Name and unit of each signal.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._native = _native.Run(os.fspath(path))
        header = self._native.header()
        self.target: str = header["target"]
        self.formula: str = header["formula"]
        self.search: str = header["search"]
        self.seed: int = header["seed"]
        self.plan: str = header["plan"]
        self.control_dt: float = header["control_dt"]
        self.steps: int = header["steps"]
        self.axes = [_axis(*axis) for axis in header["axes"]]
        self.signals: list[tuple[str, str]] = header["signals"]

    def columns(self) -> dict[str, list[Any]]:
        """Returns all simulations as lists: trial, number, seed, robustness, end, steps, a column per axis and verdict.

        A categorical axis has names, an integer axis integers.
        """
        columns = self._native.simulations()
        for axis in self.axes:
            columns[axis.name] = [axis.value(number) for number in columns[axis.name]]
        return columns

    @property
    def simulations(self) -> pandas.DataFrame:
        """All simulations as a data frame of pandas, with the columns of :meth:`columns`."""
        try:
            import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]
        except ImportError as error:
            raise MissingPackageError("data frames need pandas: pip install pandas; `columns` returns lists without it") from error
        return pandas.DataFrame(self.columns())

    def trace(self, trial: int, number: int) -> dict[str, NDArray[np.float64]] | None:
        """Returns the stored trace of a simulation: an array per signal; ``None`` if it is not stored."""
        samples = self._native.trace(trial, number)
        if samples is None:
            return None
        return {name: samples[:, column] for column, (name, _) in enumerate(self.signals)}


def _axis(name: str, unit: str, low: float, high: float, values: str) -> RunAxis:
    kind, _, text = values.partition(": ")
    names = tuple(text.split(", ")) if text else ()
    # Two names look like one name that contains a comma; the numbers remain then.
    return RunAxis(name, unit, low, high, kind, names if len(names) == int(high) + 1 else ())


def open_run(path: str | os.PathLike[str]) -> Run:
    """Opens a run file for reading."""
    return Run(path)
