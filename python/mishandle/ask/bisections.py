"""The first of ordered controllers that fails."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.files import PathLike
from mishandle.errors import InvalidTypeError
from mishandle.runs.documents import Reported, read

BisectProgress = Callable[[str, int, int], None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bisection(Reported, results.Bisection):
    """The first failing one of ordered controllers. ``str`` gives the text of the command."""

    shown: str
    """The text of the command."""

    def __str__(self) -> str:
        return self.shown

    def _page(self, probes: int | None, sensitivity: int) -> str:
        document = json.dumps(dataclasses.asdict(self))
        return _native.bisection_report(document, probes, sensitivity)


def bisect(
    folder: PathLike,
    *,
    counterexamples: PathLike | None = None,
    rate: float | None = None,
    target: PathLike | None = None,
    space: str | None = None,
    action_noise: float | None = None,
    episodes: int | None = None,
    plan: PathLike | None = None,
    all: bool = False,
    seed: int | None = None,
    out: PathLike = "runs/bisect",
    progress: BisectProgress | None = None,
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
        Lowest success rate of a candidate that passes.
    target : str or path, optional
        With ``rate``: a task, or the path of a target file (``.toml``).
    space, action_noise, episodes, plan, seed
        With ``rate``: scenario space, noise on the actions, largest number of simulations of a
        candidate (1000), file of a plan, and random seed.
    all : bool
        Whether every candidate is tested, so that the result says whether one passes after one that
        fails.
    out : path
        Folder of the result and of all simulations. The same call continues an interrupted
        bisection.
    progress : callable, optional
        Gets the name of the candidate, the number of its simulations and the largest number, now
        and then. Its exceptions, and Ctrl-C, end the bisection.

    Raises
    ------
    MishandleError
        If an argument is wrong, there are fewer than two candidates, or a simulation cannot be run.
    """
    if target is not None and not isinstance(target, (str, os.PathLike)):
        raise InvalidTypeError(
            f"the candidates of a bisection are files, and a {type(target).__name__} is neither "
            "the name of a task nor the path of a target file"
        )
    given = {
        "regress.rate": rate,
        "target": target,
        "space": space,
        "action-noise": action_noise,
        "evaluate.episodes": episodes,
        "seed": seed,
        "regress.every": "true" if all else None,
    }
    keys = [(key, _word(value)) for key, value in given.items() if value is not None]
    paths = [None if path is None else os.fspath(path) for path in (counterexamples, plan)]
    document, text = _native.bisect(
        os.fspath(folder), paths[0], keys, paths[1], os.fspath(out), progress
    )
    return read(Bisection, document, shown=text)


def _word(value: str | float | PathLike) -> str:
    return os.fspath(value) if isinstance(value, (str, os.PathLike)) else str(value)
