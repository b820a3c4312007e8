"""Results from the documents of the extension module."""

from __future__ import annotations

import json
import os
import pathlib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar, cast

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.files import PathLike, write_text
from mishandle.base.interruption import Progress
from mishandle.errors import MishandleError
from mishandle.runs.run_files import open_run
from mishandle.runs.targets import Target, TargetOptions
from mishandle.scenarios.arguments import check_out

Result = TypeVar("Result")
Answer = TypeVar("Answer", bound="RunResult")


def read(kind: type[Result], text: str, **others: Any) -> Result:
    """Returns the result in the text of a document. ``others`` are fields that only Python has."""
    return results.build(kind, {**json.loads(text), **others})


def write_counterexample(
    run: PathLike, trial: int, simulation: int, path: PathLike
) -> pathlib.Path:
    """Writes a failing simulation of a run as a counterexample file. Returns the path."""
    file = pathlib.Path(path)
    if file.suffix.lower() != ".json":
        raise MishandleError(
            f"the counterexample file is {os.fspath(path)}; its name must end with .json"
        )
    return write_text(file, _native.counterexample(os.fspath(run), trial, simulation))


class RunOptions(TargetOptions, total=False):
    """Keyword arguments of a question that writes a run file: where it writes, besides those that
    describe the system."""

    out: PathLike | None
    """Run file; by default the first free name in the folder ``runs``."""
    resume: bool
    """Whether to continue the run in ``out``. Its recorded simulations are not repeated, except for
    the first one of a system that is deterministic: if it differs, the system is not that of the
    run."""
    any_build: bool
    """With ``resume``: whether this build of Mishandle, MuJoCo and the packages of the system may
    continue a run that another one started. Both are then in the run file (:attr:`Run.builds`)."""
    durable: bool
    """Whether each batch is synced to the disk, so that a power failure loses none."""
    progress: Progress | None
    """Gets the numbers of finished and of all simulations after each batch. Its exceptions, and
    Ctrl-C, end the question after the running batch. The exception has the result so far as its
    attribute ``result``."""


class RunFile:
    """Where a question writes its simulations, and the rest of its options."""

    def __init__(self, options: RunOptions) -> None:
        out, resume = options.get("out"), options.get("resume", False)
        any_build, durable = options.get("any_build", False), options.get("durable", False)
        check_out(out, resume, any_build)
        self.native = (None if out is None else os.fspath(out), resume, durable, any_build)
        self.progress = options.get("progress")
        own = RunOptions.__annotations__.keys() - TargetOptions.__annotations__.keys()
        rest = {name: value for name, value in options.items() if name not in own}
        self.target = cast(TargetOptions, rest)


def answer(kind: type[Answer], target: Target, text: str, notes: Sequence[str]) -> Answer:
    """Returns the result of a question, and warns its caller of the notes."""
    for note in notes:
        warnings.warn(note, stacklevel=3)
    result = read(kind, text, **target.facts)
    result.remember(target.native)
    return result


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """A result with a run file. It remembers its system, so that it can simulate more; a copy from
    pickle has forgotten it."""

    largest_difference: float = 0.0
    """Largest difference between two simulations of the nominal scenario with the same seed."""
    exceptions: list[str] = field(default_factory=list)
    """Tracebacks of exceptions of the system."""
    not_covered: tuple[str, ...] = ()
    """Parts of the system that its hash does not cover."""

    if TYPE_CHECKING:
        run: str | None

    @property
    def path(self) -> pathlib.Path:
        """The run file."""
        return pathlib.Path(self.run or "")

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if not name.startswith("_")}

    def remember(self, target: _native.Target) -> None:
        # The dataclasses are frozen, and the system is not a field: it cannot be compared or
        # copied.
        self.__dict__["_target"] = target

    @property
    def remembered(self) -> _native.Target | None:
        return self.__dict__.get("_target")

    def report(
        self, path: PathLike, *, simulate: bool = True, probes: int = 64, sensitivity: int = 0
    ) -> None:
        """Writes a page about the run: one HTML file that loads nothing, for a browser or to send.

        Parameters
        ----------
        path : path
            File to write; an existing file is replaced.
        simulate : bool
            Whether to measure with the system of this result: sizes of failing patches, repeats
            with other seeds, noise, corners.
        probes : int
            Number of random scenarios that estimate the size of a failing patch.
        sensitivity : int
            Number of random scenarios that measure the total effect of each axis on the robustness
            (Sobol index). 0 skips them.
        """
        if self.remembered is None or not simulate:
            open_run(self.path).report(
                path, simulate=simulate, probes=probes, sensitivity=sensitivity
            )
            return
        html = _native.report(self.remembered, os.fspath(self.path), probes, sensitivity)
        write_text(path, html)
