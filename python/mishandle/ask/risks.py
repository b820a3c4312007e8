"""The probability that a system fails under a distribution of scenarios."""

import pathlib
from dataclasses import dataclass
from typing import Any

from typing_extensions import Unpack

import mishandle.results as results
from mishandle.ask.margins import check_tested
from mishandle.base.documents import Call
from mishandle.base.files import PathLike
from mishandle.errors import InvalidValueError
from mishandle.runs.documents import RunFile, RunOptions, RunResult, write_counterexample
from mishandle.runs.targets import Formulas, Space, make_target


@dataclass(frozen=True, kw_only=True, repr=False)
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
    simulations: int | None = None,
    seed: int | None = None,
    **settings: Unpack[RunOptions],
) -> Risk:
    """Estimates the probability that a simulation of a system violates a formula.

    ``docs/guide/risk.md`` explains the parts of the estimation, what their intervals assume, and
    the distributions of axes. The other arguments are those of :func:`falsify`.

    Parameters
    ----------
    simulations : int
        Number of simulations (50,000), at least 100.
    seed : int
        Random seed, of which scenarios and seeds of simulations are derived.

    Examples
    --------
    The gap is too small above 8 m/s, three standard deviations above the mean. That has the
    probability 0.00135:

    >>> import tempfile
    >>> from mishandle import Axis
    >>> run = tempfile.mkdtemp() + "/run.sqlite"
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> space = [Axis("speed", 0, 10, "m/s")]
    >>> found = risk(
    ...     system, "always(gap >= 2)", space, simulations=4000, out=run,
    ...     plan={"risk": {"distributions": {"speed": "normal:5:1"}}}
    ... )
    >>> found.probability.low < 0.00135 < found.probability.high
    True
    >>> found.failures[0].scenario["speed"] > 8
    True
    """
    run = RunFile(settings)
    call = Call("risk", settings, {"risk": {"simulations": simulations}, "seed": seed})
    made = make_target(system, formula, space, run.target, call)
    result = run.ask(Risk, made)
    check_tested(made, result.monte_carlo.failure_rate.value is not None)
    return result
