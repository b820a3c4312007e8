"""The first of ordered controllers that fails."""

import dataclasses
import json
import os
from collections.abc import Callable
from typing import Literal

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.documents import Call, Plan
from mishandle.base.files import PathLike
from mishandle.base.progress import reporting
from mishandle.runs.documents import Reported, read
from mishandle.runs.printed import Printed

BisectProgress = Callable[[str, int, int], None]


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class Bisection(Printed, Reported, results.Bisection):
    """The first failing one of ordered controllers. ``str`` gives the text of the command."""

    shown: str
    """The text of the command."""

    def _page(self, call: str) -> str:
        return _native.bisection_report(json.dumps(dataclasses.asdict(self)), call)


def bisect(
    folder: PathLike,
    *,
    counterexamples: PathLike | None = None,
    rate: float | None = None,
    seed: int | None = None,
    out: PathLike = "runs/bisect",
    progress: BisectProgress | Literal[False] | None = None,
    plan: Plan | None = None,
) -> Bisection:
    """Finds the first controller that fails a counterexample or falls below a success rate, as the
    command ``mishandle regress --first-bad`` does.

    ``docs/guide/compare.md`` explains the tests. The candidates are files of controllers, so the
    target is a task or a target file.

    Parameters
    ----------
    folder : path
        Folder of controllers (``*.safetensors``, ``*.onnx``), ordered by name, with numbers by
        value.
    counterexamples : path, optional
        Counterexample or folder of them: a candidate fails if it violates one.
    rate : float, optional
        Lowest success rate of a candidate that passes. The ``target`` in ``plan`` is a task or the
        path of a target file.
    seed : int, optional
        With ``rate``: random seed.
    out : path
        Folder of the result and of all simulations. The same call continues an interrupted
        bisection.
    progress : callable or False, optional
        Gets the name of the candidate, the number of its simulations and the largest number, now
        and then. Its exceptions, and Ctrl-C, end the bisection. By default a bar; ``False`` shows
        nothing.
    plan : dict, optional
        With ``rate``: the question, such as ``{"target": "ball-balancing", "space": "starts",
        "evaluate": {"episodes": 200}}``. ``{"regress": {"every": True}}`` tests every candidate, so
        that the result says whether one passes after one that fails.

    Raises
    ------
    MishandleError
        If an argument is wrong, there are fewer than two candidates, or a simulation cannot be run.
    """
    call = Call("bisect", {"plan": plan}, {"regress": {"rate": rate}, "seed": seed})
    with reporting(progress) as report:
        document, text = _native.bisect(
            call.text(), os.fspath(folder),
            None if counterexamples is None else os.fspath(counterexamples), os.fspath(out), report
        )
    return read(Bisection, document, shown=text)
