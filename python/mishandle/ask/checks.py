"""The requirements of a file, checked on a system."""

import os
from dataclasses import dataclass
from typing import Any, Literal

from typing_extensions import Unpack

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.documents import Call
from mishandle.base.files import PathLike
from mishandle.base.interruption import Progress
from mishandle.base.progress import reporting
from mishandle.runs.documents import read
from mishandle.runs.printed import Printed
from mishandle.runs.targets import Space, TargetOptions, make_target


@dataclass(frozen=True, kw_only=True, repr=False)
class Check(Printed, results.Check):
    """A traceability matrix: verdict and evidence of each requirement. ``str`` gives the text of
    the command."""

    shown: str
    """The text of the command."""
    exit_code: int
    """0: nothing that counts is violated; 1: something is; 2: a requirement could not be
    checked."""


def check(
    system: Any,
    file: PathLike,
    space: Space = None,
    *,
    out: PathLike,
    episodes: int | None = None,
    budget: int | None = None,
    search: str | None = None,
    seed: int | None = None,
    progress: Progress | Literal[False] | None = None,
    **target: Unpack[TargetOptions],
) -> Check:
    """Checks all requirements of a file, as the command ``mishandle check`` does.

    Parameters
    ----------
    system, space, **target
        See :func:`mishandle.falsify`. ``check.batch`` of ``plan`` is 1 by default.
    file : path
        TOML file; ``docs/guide/check.md`` describes it.
    out : path
        Folder of the runs, the counterexamples and the reports. A second call continues an
        interrupted check.
    episodes, budget : int, optional
        Number of random scenarios, and largest number of simulations of a search; by default those
        of the file, or 100 and 300.
    search : str
        Name of the search; by default ``"portfolio"``.
    seed : int
        Random seed.
    progress : callable or False, optional
        Gets the numbers of finished and of all simulations of the present run. By default a bar;
        ``False`` shows nothing.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from mishandle import Axis
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> _ = (folder / "requirements.toml").write_text(
    ...     '[[requirement]]\\nname = "R-1"\\nformula = "always(gap >= 2)"'
    ... )
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> found = check(
    ...     system, folder / "requirements.toml", [Axis("speed", 0, 10, "m/s")],
    ...     out=folder / "checked", episodes=20
    ... )
    >>> (found.cells[0].verdict, found.exit_code)
    ('violated', 1)
    """
    path = os.fspath(file)
    stated = _native.requirement_formulas(path)
    # Systems with formulas of their own have a name or are files. The others need one.
    formula = None if isinstance(system, (str, os.PathLike)) else stated[0][1]
    given = {"episodes": episodes, "budget": budget, "search": search}
    call = Call("check", target, {"seed": seed, "check": given}, {"check": {"batch": 1}})
    made = make_target(system, formula, space, target, call)
    with reporting(progress) as report:
        document, text, exit_code = _native.check(
            made.native, requirements=path, out=os.fspath(out), progress=report
        )
    return read(Check, document, shown=text, exit_code=exit_code)
