"""Results from the documents of the extension module."""

import json
import os
import pathlib
import warnings
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.documents import Call, Plan
from mishandle.base.files import PathLike, write_text
from mishandle.base.interruption import Progress, after_the_batch, deliver
from mishandle.base.progress import reporting
from mishandle.errors import MishandleError
from mishandle.runs.printed import Printed
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
    progress: Progress | Literal[False] | None
    """Gets the numbers of finished and of all simulations after each batch. Its exceptions, and
    Ctrl-C, end the question after the running batch. The exception has the result so far as its
    attribute ``result``. By default a bar in terminals and notebooks, and a line from time to time
    on standard error elsewhere; ``False`` shows nothing."""


class RunFile:
    """Where a question writes its simulations, and the rest of its options."""

    def __init__(self, options: RunOptions) -> None:
        self._out, self._resume = options.get("out"), options.get("resume", False)
        check_out(self._out, self._resume)
        self._progress = options.get("progress")
        own = RunOptions.__annotations__.keys() - TargetOptions.__annotations__.keys()
        rest = {name: value for name, value in options.items() if name not in own}
        self.target = cast(TargetOptions, rest)

    def ask(self, kind: type[Answer], target: Target, *, waits: bool = True) -> Answer:
        """Asks the question of a target. Returns the result, and warns the caller of the caller of
        its notes. ``waits`` says whether Ctrl-C waits for the end of the running batch."""
        out = None if self._out is None else os.fspath(self._out)
        with reporting(self._progress) as progress:
            announce = getattr(progress, "announce", None)
            with after_the_batch(progress) if waits else nullcontext(progress) as report:
                text, lines, interruption, notes = _native.ask(
                    target.native, out=out, resume=self._resume, progress=report,
                    announce=announce, earlier_probes=target.probes
                )
        for note in notes:
            warnings.warn(note, stacklevel=3)
        result = read(kind, text, shown=lines, **target.facts)
        result.remember(target.native)
        return deliver(result, interruption)


class Reported:
    """A result with a page."""

    def report(self, path: PathLike, *, plan: Plan | None = None) -> None:
        """Writes a page: one HTML file that loads nothing, for a browser or to send.

        Parameters
        ----------
        path : path
            File to write; an existing file is replaced.
        plan : dict, optional
            Rare settings: ``{"report": {"simulations": False}}`` leaves out what takes simulations
            (sizes of failing patches, repeats with other seeds, noise, corners), ``{"report":
            {"replay": True}}`` adds a 3-D replay. ``mishandle report --help`` lists the keys.
        """
        write_text(path, self._page(Call("report", {"plan": plan}).text()))

    def _page(self, call: str) -> str:
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True, repr=False)
class RunResult(Printed, Reported):
    """A result with a run file. ``str`` gives the lines that say what it means. It remembers its
    system, so that it can simulate more; a copy from pickle has forgotten it."""

    largest_difference: float = 0.0
    """Largest difference between two simulations of the nominal scenario with the same seed."""
    exceptions: list[str] = field(default_factory=list)
    """Tracebacks of exceptions of the system."""
    not_covered: tuple[str, ...] = ()
    """Parts of the system that its hash does not cover."""
    shown: str = field(default="", compare=False)

    if TYPE_CHECKING:
        run: str | None

    @property
    def path(self) -> pathlib.Path:
        """The run file."""
        return pathlib.Path(self.run or "")

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_target"}

    def remember(self, target: _native.Target) -> None:
        # The dataclasses are frozen, and the system is not a field: it cannot be compared or
        # copied.
        self.__dict__["_target"] = target

    @property
    def remembered(self) -> _native.Target | None:
        return self.__dict__.get("_target")

    def _page(self, call: str) -> str:
        if self.remembered is None:
            return _native.Run(os.fspath(self.path)).report(call)
        return _native.report(self.remembered, os.fspath(self.path), call)
