"""The probability that a system fails under a distribution of scenarios."""

from __future__ import annotations

import os
import pathlib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from typing_extensions import Unpack

from mishandle import _native
from mishandle.arguments import check_number, check_out
from mishandle.axes import Axis
from mishandle.errors import InvalidTypeError, InvalidValueError, MishandleError
from mishandle.explanations import Estimate
from mishandle.falsification import PathLike, Progress, Remembering
from mishandle.interruption import after_the_batch, deliver
from mishandle.margins import untested, write_counterexample
from mishandle.systems import Scenario
from mishandle.targets import Formulas, Space, TargetOptions, make_target


@dataclass(frozen=True)
class Probability:
    """The probability of a violation with its 95 % interval."""

    value: float
    low: float
    high: float
    source: str
    """Part that it is from: ``"monte-carlo"``, ``"importance"`` or ``"splitting"``."""
    assumption: str | None
    """What the interval assumes; ``None`` if nothing."""


@dataclass(frozen=True)
class AxisDistribution:
    """The distribution of an axis, truncated to its bounds."""

    axis: str
    distribution: str
    """``"fixed"`` for an axis with one value."""
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class MonteCarlo:
    """Independent simulations under the distribution."""

    simulations: int
    failures: int
    without_verdict: int
    """Number of simulations without a verdict, which count as passed."""
    failure_rate: Estimate
    bound_with_undecided: float | None
    """Upper bound of the probability (97.5 %) if the simulations without a verdict are failures."""


@dataclass(frozen=True)
class Exploration:
    """The search for failures."""

    simulations: int


@dataclass(frozen=True)
class Importance:
    """Importance sampling around the failures found."""

    fitting_simulations: int
    simulations: int
    failures: int
    effective_failures: float
    """Number of equally weighted failures with the same precision."""
    components: int
    """Number of regions."""
    regions: Estimate
    """Probability of a failure in the regions."""
    outside: float
    """Estimate of the probability of failures outside of the regions, without an interval."""
    monte_carlo_inside: int
    monte_carlo_outside: int


@dataclass(frozen=True)
class SplittingChain:
    """One chain of multilevel splitting."""

    probability: float
    """Estimate of the probability of a robustness below the level."""
    level: float
    is_complete: bool
    levels: int
    acceptance: float


@dataclass(frozen=True)
class Splitting:
    """Multilevel splitting."""

    simulations: int
    population: int
    estimate: Estimate | None
    """Mean of the chains; ``None`` if they disagree or are too small."""
    chains: list[SplittingChain]


@dataclass(frozen=True)
class RiskFailure:
    """A simulation that violates the formula."""

    scenario: Scenario
    simulation: int
    """Its number in the run file."""
    seed: int
    robustness: float


@dataclass(frozen=True)
class Risk(Remembering):
    """The probability that a simulation violates the formula. A simulation is a scenario of the distribution and a random seed."""

    path: pathlib.Path = field(compare=False)
    """Its run file. Two results are equal if all else is."""
    formula: str
    method: str
    distribution: list[AxisDistribution]
    simulations: int
    probability: Probability | None
    """``None`` without an estimate."""
    bounds: tuple[float, float]
    """Bounds (95 %) that assume nothing."""
    refusals: list[str]
    """Why parts have no estimate."""
    monte_carlo: MonteCarlo
    exploration: Exploration
    importance: Importance | None
    splitting: Splitting | None
    failures: list[RiskFailure]
    """Up to three failures, those nearest to the center of the distribution first."""
    is_complete: bool
    """Whether the estimation was not interrupted; otherwise the answer is that of the finished parts."""
    largest_difference: float = 0.0
    exceptions: list[str] = field(default_factory=list)

    def export(self, path: PathLike, failure: int = 0) -> pathlib.Path:
        """Simulates a failure again and writes it as a counterexample file (``.json``), for :func:`replay` and :func:`regress`.

        Parameters
        ----------
        path : path
            File to write; an existing file is replaced.
        failure : int
            Index in ``failures``.
        """
        target: _native.Target | None = self.__dict__.get("_target")
        if target is None:
            raise MishandleError("a copy of a result does not know its system; export the failure of the result itself")
        if not 0 <= failure < len(self.failures):
            raise InvalidValueError(f"failure is {failure}; the result has {len(self.failures)} failures")
        values = self.__dict__["_values"][failure]
        text = _native.simulated_counterexample(
            target, formula=self.formula, values=values, seed=self.failures[failure].seed
        )
        return write_counterexample(path, text)


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
    out: PathLike | None = None,
    resume: bool = False,
    durable: bool = False,
    progress: Progress | None = None,
    **target: Unpack[TargetOptions],
) -> Risk:
    """Estimates the probability that a simulation of a system violates a formula.

    ``docs/guide/risk.md`` explains the parts of the estimation and what their intervals assume.

    Parameters
    ----------
    system, formula, space, **target
        See :func:`falsify`.
    distribution : dict of str, optional
        Distributions by axis, in the unit of the axis and truncated to its bounds: ``"uniform"``, ``"log-uniform"``,
        ``"normal:MEAN:STD"``, ``"triangular:MODE"``, and ``"weights:W0:W1:..."`` for whole numbers and categories. The other axes are
        uniform, in the logarithm if they are logarithmic; noise draws of a task are standard normal.
    simulations : int
        Number of simulations, at least 100.
    method : str
        Parts of the estimation besides Monte Carlo: ``"auto"`` (all), ``"monte-carlo"`` (none), ``"importance"`` or
        ``"splitting"``.
    batch : int
        Number of simulations at once. The result does not depend on it.
    seed : int
        Random seed, of which scenarios and seeds of simulations are derived.
    out : path, optional
        Run file; by default the first free name in the folder ``runs``.
    resume : bool
        Whether to continue the run in ``out``. Its recorded simulations are not repeated.
    durable : bool
        Whether each batch is synced to the disk, so that a power failure loses none.
    progress : callable, optional
        Gets the numbers of finished and of all simulations after each batch. Its exceptions, and Ctrl-C, end the estimation after
        the running batch. The exception has the result so far as its attribute ``result``.

    Returns
    -------
    Risk

    Raises
    ------
    MishandleError
        If a name, a number, a distribution or a formula is invalid, nothing is random, or no simulation has a verdict.
    ValueError, TypeError
        If the system, its trace or its signals do not have the stated form.

    Examples
    --------
    The gap is too small above 8 m/s, three standard deviations above the mean. That has the probability 0.00135:

    >>> import tempfile
    >>> run = tempfile.mkdtemp() + "/run.sqlite"
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> space = [Axis("speed", 0, 10, "m/s")]
    >>> found = risk(system, "always(gap >= 2)", space, distribution={"speed": "normal:5:1"}, simulations=4000, out=run)
    >>> found.probability.low < 0.00135 < found.probability.high
    True
    >>> found.failures[0].scenario["speed"] > 8
    True
    """
    check_out(out, resume)
    check_number("seed", seed, 0)
    check_number("simulations", simulations, 1)
    check_number("batch", batch, 1)
    if isinstance(distribution, str) or not isinstance(distribution or {}, Mapping):
        raise InvalidTypeError(f'`distribution` is {distribution!r}; expected a dictionary, such as {{"speed": "normal:5:1"}}')
    distributions = {str(axis): str(text) for axis, text in (distribution or {}).items()}

    def check(space: Sequence[Axis]) -> None:
        axes = [axis.to_native() for axis in space]
        _native.check_risk(axes, simulations=simulations, method=method, batch=batch, distributions=distributions)

    made = make_target(system, formula, space, target, check)
    with after_the_batch(progress) as report:
        found = _native.risk(
            made.native,
            formula=made.formula,
            simulations=simulations,
            method=method,
            batch=batch,
            distributions=distributions,
            seed=seed,
            out=(None if out is None else os.fspath(out), resume, durable),
            progress=report,
        )
    for text in found.pop("warnings"):
        warnings.warn(text, stacklevel=2)
    interruption = found.pop("interruption")
    (number, failed, without_verdict), rate, bound = found.pop("monte_carlo")
    monte_carlo = MonteCarlo(number, failed, without_verdict, Estimate(*rate), bound)
    if interruption is None and monte_carlo.without_verdict == monte_carlo.simulations:
        raise untested(made.system.exceptions)
    probability, failures = found.pop("probability"), found.pop("failures")
    result = Risk(
        path=pathlib.Path(found.pop("path")),
        method=method,
        distribution=[AxisDistribution(*axis) for axis in found.pop("distribution")],
        probability=None if probability is None else Probability(*probability[0], *probability[1:]),
        monte_carlo=monte_carlo,
        exploration=Exploration(found.pop("exploration")),
        importance=_importance(found.pop("importance")),
        splitting=_splitting(found.pop("splitting")),
        failures=[RiskFailure(*failure[:4]) for failure in failures],
        largest_difference=made.largest_difference,
        exceptions=made.system.exceptions,
        **found,
    )
    result._remember(made.native)
    # One number for each axis: a scenario by name leaves random draws out.
    result.__dict__["_values"] = [values for *_, values in failures]
    return deliver(result, interruption)


def _importance(found: tuple[Any, ...] | None) -> Importance | None:
    if found is None:
        return None
    (fitting, simulations, failures, effective, components), regions, outside, (inside, others) = found
    return Importance(fitting, simulations, failures, effective, components, Estimate(*regions), outside, inside, others)


def _splitting(found: tuple[Any, ...] | None) -> Splitting | None:
    if found is None:
        return None
    simulations, population, mean, chains = found
    estimate = None if mean is None else Estimate(*mean)
    return Splitting(simulations, population, estimate, [SplittingChain(*chain) for chain in chains])
