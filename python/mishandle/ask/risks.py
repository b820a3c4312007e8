"""The probability that a system fails under a distribution of scenarios."""

from __future__ import annotations

import pathlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from typing_extensions import Unpack

import mishandle._native as _native
import mishandle.results as results
from mishandle.ask.margins import untested
from mishandle.base.files import PathLike
from mishandle.base.interruption import after_the_batch, deliver
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.runs.documents import RunFile, RunOptions, RunResult, answer, write_counterexample
from mishandle.runs.targets import Formulas, Space, make_target
from mishandle.scenarios.arguments import check_number
from mishandle.scenarios.axes import Axis


@dataclass(frozen=True, kw_only=True)
class Risk(RunResult, results.Risk):
    """The probability that a simulation violates the formula. A simulation is a scenario of the
    distribution and a random seed."""

    def export(self, path: PathLike, failure: int = 0) -> pathlib.Path:
        """Writes a failure as a counterexample file (``.json``), for :func:`replay` and
        :func:`regress`.

        Parameters
        ----------
        path : path
            File to write; an existing file is replaced.
        failure : int
            Index in ``failures``.
        """
        if not 0 <= failure < len(self.failures):
            raise InvalidValueError(
                f"failure is {failure}; the result has {len(self.failures)} failures"
            )
        return write_counterexample(self.path, 1, self.failures[failure].simulation, path)


def risk(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    distribution: Mapping[str, str] | None = None,
    simulations: int = 50_000,
    method: str = "auto",
    batch: int = 64,
    seed: int = 0,
    **settings: Unpack[RunOptions],
) -> Risk:
    """Estimates the probability that a simulation of a system violates a formula.

    ``docs/guide/risk.md`` explains the parts of the estimation and what their intervals assume.

    Parameters
    ----------
    system, formula, space, **settings
        See :func:`falsify`.
    distribution : dict of str, optional
        Distributions by axis, in the unit of the axis and truncated to its bounds: ``"uniform"``,
        ``"log-uniform"``, ``"normal:MEAN:STD"``, ``"triangular:MODE"``, and ``"weights:W0:W1:..."``
        for whole numbers and categories. The other axes are uniform, in the logarithm if they are
        logarithmic; noise draws of a task are standard normal.
    simulations : int
        Number of simulations, at least 100.
    method : str
        Parts of the estimation besides Monte Carlo: ``"auto"`` (all), ``"monte-carlo"`` (none),
        ``"importance"`` or ``"splitting"``.
    batch : int
        Number of simulations at once. The result does not depend on it.
    seed : int
        Random seed, of which scenarios and seeds of simulations are derived.

    Returns
    -------
    Risk

    Raises
    ------
    MishandleError
        If a name, a number, a distribution or a formula is invalid, nothing is random, or no
        simulation has a verdict.

    Examples
    --------
    The gap is too small above 8 m/s, three standard deviations above the mean. That has the
    probability 0.00135:

    >>> import tempfile
    >>> run = tempfile.mkdtemp() + "/run.sqlite"
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> space = [Axis("speed", 0, 10, "m/s")]
    >>> found = risk(
    ...     system, "always(gap >= 2)", space, distribution={"speed": "normal:5:1"},
    ...     simulations=4000, out=run
    ... )
    >>> found.probability.low < 0.00135 < found.probability.high
    True
    >>> found.failures[0].scenario["speed"] > 8
    True
    """
    run = RunFile(settings)
    check_number("seed", seed, 0)
    check_number("simulations", simulations, 1)
    check_number("batch", batch, 1)
    if isinstance(distribution, str) or not isinstance(distribution or {}, Mapping):
        raise InvalidTypeError(
            f'`distribution` is {distribution!r}; expected a dictionary, such as {{"speed": '
            '"normal:5:1"}'
        )
    distributions = {str(axis): str(text) for axis, text in (distribution or {}).items()}

    def check(space: Sequence[Axis]) -> None:
        axes = [axis.to_native() for axis in space]
        _native.check_risk(
            axes, simulations=simulations, method=method, batch=batch, distributions=distributions
        )

    made = make_target(system, formula, space, run.target, check)
    with after_the_batch(run.progress) as report:
        text, interruption, notes = _native.risk(
            made.native, formula=made.formula, simulations=simulations, method=method, batch=batch,
            distributions=distributions, seed=seed, out=run.native, progress=report
        )
    result = answer(Risk, made, text, notes)
    if (
        interruption is None
        and result.monte_carlo.without_verdict == result.monte_carlo.simulations
    ):
        raise untested(made.system.exceptions)
    return deliver(result, interruption)
