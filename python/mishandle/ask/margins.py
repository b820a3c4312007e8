"""The smallest disturbance that makes a system fail."""

from __future__ import annotations

import os
import pathlib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from typing_extensions import Unpack

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.files import PathLike
from mishandle.base.interruption import after_the_batch, deliver
from mishandle.errors import MishandleError
from mishandle.runs.documents import RunFile, RunOptions, RunResult, answer, write_counterexample
from mishandle.runs.targets import Formulas, Space, make_target
from mishandle.scenarios.arguments import check_number
from mishandle.scenarios.axes import Axis


@dataclass(frozen=True, kw_only=True)
class Margin(RunResult, results.Margin):
    """The smallest disturbance that violates a requirement."""

    def export(self, path: PathLike) -> pathlib.Path:
        """Writes the witness as a counterexample file (``.json``), for :func:`replay` and
        :func:`regress`.

        An existing file is replaced. Returns the path.
        """
        if self.witness is None:
            raise MishandleError(
                "there is no witness to export: no simulation violates the formula"
            )
        return write_counterexample(self.path, 1, self.witness.simulation, path)


def margin(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    budget: int = 3000,
    each_category: bool = False,
    seed: int = 0,
    **settings: Unpack[RunOptions],
) -> Margin:
    """Searches for the smallest disturbance with which a system violates a formula.

    The disturbed axes are those of the space with a nominal value, except for initial states
    (``kind="start"``) and categories. Initial states vary in their whole range. The result is an
    upper bound with a witness: a smaller disturbance that violates the formula may exist.
    ``docs/guide/margin.md`` explains the search.

    Parameters
    ----------
    system, formula, space, **settings
        See :func:`falsify`. The default space of a task with one of our controllers is
        ``"disturbance"``.
    budget : int
        Largest number of simulations. A system that depends on its seed is simulated up to 100
        times more: the witness with other seeds.
    each_category : bool
        Whether to search once for each combination of categories, each time with the whole budget.
        Otherwise categorical axes stay at their nominal categories, which ``categories`` of the
        result names.
    seed : int
        Seed of the search. A deterministic system is simulated with it, one that depends on its
        seed with many derived seeds.

    Returns
    -------
    Margin

    Raises
    ------
    MishandleError
        If a name, a number or a formula is invalid, the space has no disturbed axis, or no
        simulation has a verdict.

    Examples
    --------
    The gap is too small above 8 m/s, which is 80 % of the way from 0 to 10 m/s:

    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> space = [Axis("speed", 0, 10, "m/s", nominal=0, kind="input")]
    >>> import tempfile
    >>> found = margin(
    ...     system, "always(gap >= 2)", space, budget=300, out=tempfile.mkdtemp() + "/run.sqlite"
    ... )
    >>> 0.8 < found.witness.amplitude < 0.82
    True
    """
    run = RunFile(settings)
    check_number("seed", seed, 0)
    check_number("budget", budget, 1)
    if (
        isinstance(system, str) and space is None
        and isinstance(settings.get("policy", ""), (str, os.PathLike))
    ):
        space = "disturbance"

    def check(space: Sequence[Axis]) -> None:
        _native.check_margin([axis.to_native() for axis in space], budget=budget)

    made = make_target(system, formula, space, run.target, check)
    with after_the_batch(run.progress) as report:
        text, interruption, notes = _native.margin(
            made.native, formula=made.formula, budget=budget, each_category=each_category,
            seed=seed, out=run.native, progress=report
        )
    result = answer(Margin, made, text, notes)
    if result.categories and not result.each_category:
        fixed = ", ".join(f"{name} = {category}" for name, category in result.categories.items())
        warnings.warn(
            f"a margin varies numeric axes only, so {fixed} stayed; each_category=True searches "
            "each category",
            stacklevel=2
        )
    if interruption is None and all(level.minimum_robustness is None for level in result.levels):
        raise untested(made.system.exceptions)
    return deliver(result, interruption)


def untested(exceptions: list[str]) -> MishandleError:
    """Returns the error for simulations that all have no verdict."""
    cause = (
        f"; the first exception:\n{exceptions[0]}" if exceptions
        else "; `simulate` shows the end of one of them"
    )
    return MishandleError(f"no simulation has a verdict, so the system was not tested{cause}")
