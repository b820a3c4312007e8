"""Run files as tables."""

import json
import os
import pathlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from typing_extensions import Unpack

import mishandle._native as _native
from mishandle.base.documents import Call, Plan
from mishandle.base.files import write_text
from mishandle.errors import InvalidValueError, MissingPackageError
from mishandle.results import Counterexamples, FailureMode, build
from mishandle.runs.explanations import Explanation
from mishandle.runs.targets import Formulas, Space, TargetOptions, make_target
from mishandle.scenarios.axes import Value

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class RunAxis:
    """Axis of a recorded space. ``values`` is ``"continuous"``, ``"logarithmic"``, ``"integer"`` or
    ``"categorical"``; the names of a categorical axis have the numbers ``low``, ``low + 1``, and so
    on; ``low`` is 0 unless a setting narrowed the axis."""

    name: str
    unit: str
    low: float
    high: float
    values: str = "continuous"
    names: tuple[str, ...] = ()

    def value(self, number: float) -> Value:
        """Returns the value of a recorded number: a name of a categorical axis, an integer of an
        integer axis.

        >>> RunAxis("surface", "", 0, 1, "categorical", ("dry", "wet")).value(1.0)
        'wet'
        """
        if self.values in ("continuous", "logarithmic"):
            return number
        return self.names[int(number - self.low)] if self.names else int(number)


class Run:
    """A run file. Opening it checks the structure of the file and the hashes of all rows.

    Parameters
    ----------
    path : path
        The file.

    Attributes
    ----------
    path : pathlib.Path
        The file.
    target, formula, search : str
        Name of the system, text of the requirement, and name of the search; the last is empty for
        an evaluation.
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
    builds : list of str
        The programs that made the run: the one that started it, and those that continued it with
        ``engine.any_build`` of a plan.
    not_covered : list of str
        Parts of the system that its hash does not cover.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._native = _native.Run(os.fspath(path))
        self.path = pathlib.Path(path)
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
        self.builds: list[str] = header["builds"]
        self.not_covered: list[str] = header["not_covered"]

    @property
    def is_evaluation(self) -> bool:
        """Whether :func:`evaluate` made the run."""
        return "[evaluate]" in self.plan.splitlines()

    def columns(self) -> dict[str, list[Any]]:
        """Returns all simulations as lists: trial, number, seed, robustness, end, steps, a column
        per axis and verdict.

        A categorical axis has names, an integer axis integers.
        """
        columns = self._native.simulations()
        for axis in self.axes:
            columns[axis.name] = [
                None if number is None else axis.value(number) for number in columns[axis.name]
            ]
        return columns

    @property
    def simulations(self) -> "pandas.DataFrame":
        """All simulations as a data frame of pandas, with the columns of :meth:`columns`."""
        try:
            import pandas
        except ImportError as error:
            raise MissingPackageError(
                "data frames need pandas: pip install pandas; `columns` returns lists without it"
            ) from error
        return pandas.DataFrame(self.columns())

    def trace(self, trial: int, number: int) -> dict[str, NDArray[np.float64]] | None:
        """Returns the stored trace of a simulation: an array per signal; ``None`` if it is not
        stored."""
        samples = self._native.trace(trial, number)
        if samples is None:
            return None
        return {name: samples[:, column] for column, (name, _) in enumerate(self.signals)}

    def explain(self, trial: int, number: int, *, plan: Plan | None = None) -> Explanation:
        """Explains when, where and by which predicate a simulation violates or satisfies the
        formula.

        A counterexample is explained from its stored trace. A simulation without one is simulated
        again, and so is a failure with each axis alone at its nominal value, for at most
        ``report.axes`` axes of ``plan`` (30). Both work for runs of Mishandle's own tasks and
        target files only; ``axes_at_nominal.reason`` says so for other systems. ``controller`` and
        ``target`` of the table ``engine`` are the present paths of files that were moved.
        """
        call = Call("explain", {"plan": plan})
        return build(Explanation, json.loads(self._native.explain(trial, number, call.text())))

    def report(
        self, path: str | os.PathLike[str], system: Any = None, formula: Formulas = None,
        space: Space = None, **target: Unpack[TargetOptions]
    ) -> None:
        """Writes a page about the run, as the result of its question does.

        A run file never imports code: without its ``system``, given as in :func:`falsify`, only
        Mishandle's own tasks can be simulated; the page says so if another system cannot.
        """
        call = Call("evaluate" if self.is_evaluation else "simulate", target)
        parts = Call("report", {"plan": {"report": call.take("report", {})}}).text()
        if system is None:
            given = {"formula": formula, "space": space, **call.plan, **target}
            given.pop("plan", None)
            for name, value in given.items():
                if value is not None:
                    raise InvalidValueError(f"{name} has no effect without a system; leave it out")
            html = self._native.report(parts)
        else:
            made = make_target(system, formula, space, target, call)
            html = _native.report(made.native, os.fspath(self.path), parts)
        write_text(path, html)

    def failure_modes(self) -> tuple[FailureMode, ...]:
        """Groups the failures by decisive predicate, region and time, the largest group first."""
        return build(Counterexamples, json.loads(self._native.failure_modes())).modes


def _axis(name: str, unit: str, low: float, high: float, values: str) -> RunAxis:
    kind, _, text = values.partition(": ")
    names = tuple(text.split(", ")) if text else ()
    # Two names look like one name that contains a comma; the numbers remain then.
    return RunAxis(name, unit, low, high, kind, names if len(names) == int(high - low) + 1 else ())


def open_run(path: str | os.PathLike[str]) -> Run:
    """Opens a run file for reading."""
    return Run(path)


class HasPath(Protocol):
    """A result with a run file, such as :class:`mishandle.ask.Falsification`."""

    @property
    def path(self) -> os.PathLike[str]: ...
