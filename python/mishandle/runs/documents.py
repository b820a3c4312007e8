"""Results from the documents of the extension module."""

from __future__ import annotations

import json
import os
import pathlib
import warnings
from collections.abc import Sequence
from typing import Any, TypeVar

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.files import PathLike, write_text
from mishandle.errors import MishandleError
from mishandle.runs.run_files import open_run

Result = TypeVar("Result")


def warn_all(notes: Sequence[str]) -> None:
    """Warns the caller of the function that asked a question."""
    for note in notes:
        warnings.warn(note, stacklevel=3)


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


class RunResult:
    """A result with a run file. It remembers its system, so that it can simulate more; a copy from
    pickle has forgotten it."""

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
