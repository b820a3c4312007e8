"""The results of all questions, as the command line prints them with ``--json``.

Written by ``cargo xtask results``; change the Rust types instead.
``build`` makes a result from a parsed document.
"""

from __future__ import annotations

import dataclasses
import functools
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, cast

Value = float | int | str
"""Value of an axis: a number, a whole number of an integer axis, or the name of a category."""

_T = TypeVar("_T")


@dataclasses.dataclass(frozen=True, kw_only=True)
class InitialAxis:
    """An axis of an initial box."""

    name: str
    """Name."""
    unit: str
    """Unit."""
    low: float
    """Lower bound."""
    high: float
    """Upper bound."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Note:
    """A note on a task."""

    topic: str
    """``paper`` (differences from the paper), ``physics`` (that the MJCF does not show),
    ``success`` (what it does not say) or ``weaknesses`` (of the shipped controllers)."""
    every_task: bool
    """Whether the note applies to every task."""
    subject: str
    """Subject; for ``weaknesses`` the controllers."""
    paper: str | None = None
    """For ``paper``: what the paper prints."""
    here: str | None = None
    """For ``paper``: what this program uses."""
    why: str | None = None
    """For ``paper``: why it differs."""
    fact: str | None = None
    """For the other topics: the fact."""
    measured: str | None = None
    """For the other topics: how it was measured."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Task:
    """A task."""

    name: str
    """Name of the task."""
    variant_of: str | None
    """Base task of a variant; ``None`` for other tasks."""
    success: str
    """Formula of success."""
    strict: str
    """Formula of strict success."""
    careful: str | None = None
    """Formula of careful success; missing if the task has none."""
    safe: str
    """Formula that every safe sample satisfies."""
    completion: str
    """Formula that holds when the task is complete."""
    signals: tuple[str, ...]
    """Names of the signals. Traces contain those of the manner, which come last, only if a
    formula reads one of them."""
    initial_box: tuple[InitialAxis, ...]
    """The axes of the initial box."""
    controllers: tuple[str, ...]
    """Names of the shipped controllers."""
    notes: tuple[Note, ...]
    """Notes on the task."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Targets:
    """The names of all targets."""

    targets: tuple[str, ...]
    """Names of all targets."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Formula:
    """A named formula."""

    name: str
    """Name."""
    text: str
    """Text."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Signal:
    """A signal."""

    name: str
    """Name."""
    unit: str
    """Unit; empty without one."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Space:
    """A scenario space."""

    name: str
    """Name."""
    axes: tuple[Axis, ...]
    """Its axes."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Axis:
    """An axis of a scenario space, with its distribution and meaning."""

    name: str
    """Name."""
    kind: str
    """Kind of quantity: ``start``, ``model``, ``event``, ``fault``, ``input`` or ``noise``."""
    unit: str
    """Unit; empty without one."""
    low: float
    """Lower bound."""
    high: float
    """Upper bound."""
    nominal: float | None
    """Value in the undisturbed episode; ``None``: drawn at random."""
    values: str | tuple[str, ...]
    """``continuous``, ``logarithmic``, ``integer``, or the names of the categories, whose values
    count from 0."""
    only_if: tuple[NeededAxis, ...] | None = None
    """Values of other axes that this axis needs for an effect, all of them; missing if it always
    has one. In other scenarios it is nominal."""
    distribution: str
    """Distribution of drawn values: ``uniform`` (of the logarithm for ``logarithmic``) or
    ``normal``."""
    meaning: str
    """Quantity that the axis sets."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class NeededAxis:
    """Values of an axis without which another one has no effect."""

    axis: str
    """Name of the axis."""
    one_of: tuple[float, ...] | None
    """Its values with an effect; ``None``: all but ``other_than``."""
    other_than: float | None
    """Its value without an effect; ``None``: all but those in ``one_of``."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Target:
    """A target."""

    name: str
    """Name."""
    kind: str
    """Kind: ``task``, ``toy``, ``arch``, ``robot``, ``process`` or ``python``."""
    deterministic: bool
    """Whether the same scenario and seed give the same episode."""
    control_dt: float
    """Duration of a control step, s."""
    episode_steps: int
    """Number of control steps of an episode."""
    formulas: tuple[Formula, ...]
    """Named formulas, the default requirement first."""
    signals: tuple[Signal, ...]
    """Signals."""
    spaces: tuple[Space, ...]
    """Named scenario spaces, the default first."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SearchOption:
    """An option of a search."""

    name: str
    """Name."""
    type: str
    """Type of the value."""
    default: str
    """Default."""
    range: str
    """Allowed values; empty if the type says all."""
    meaning: str
    """Meaning."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Search:
    """A search."""

    name: str
    """Name."""
    summary: str
    """Summary in one line."""
    reference: str
    """Paper."""
    options: tuple[SearchOption, ...]
    """Options."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ProtocolFinding:
    """The outcome of one check."""

    check: str
    """Name of the check: ``hello``, ``nominal``, ``corners``, ``repeat``, ``seeds``, ``order``,
    ``unknown``, ``process``, ``output`` or ``end``."""
    passed: bool
    """Whether it passed."""
    finding: str
    """Finding in words; if the check failed, with a way out."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ProtocolCheck:
    """Whether a simulator that is a program keeps the protocol."""

    command: str
    """The command."""
    name: str | None
    """Name of the simulator; ``None`` if it does not describe itself."""
    passed: bool
    """Whether all checks passed."""
    checks: tuple[ProtocolFinding, ...]
    """The checks, in the order in which they were made. A check that a failed one makes
    pointless is missing."""
    start_seconds: float | None
    """Time from the start of the program to its description, s; ``None`` without one."""
    simulation_seconds: float | None
    """Median time of the simulations of the nominal scenario, s; ``None`` without one."""
    step_seconds: float | None
    """Mean time of a control step in these simulations, s; ``None`` in the mode ``trace``."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RequirementVerdict:
    """A named requirement on one simulation."""

    name: str
    """Name."""
    formula: str
    """Formula."""
    robustness: float | None
    """Its robustness; ``None`` without a verdict."""
    violated: bool | None
    """Whether it is violated; ``None`` without a verdict."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogVerdict:
    """The verdict of a formula on a log."""

    log: str
    """File of the log; of a log with several topics, their files."""
    name: str | None
    """Name of the requirement; ``None`` for that of ``--formula``."""
    description: str | None
    """Description of the requirement; ``None`` without one."""
    severity: str
    """``critical``, ``error`` or ``warning``: a violated formula with ``warning`` does not give
    exit code 1."""
    formula: str
    """Formula."""
    robustness: float
    """Robustness at time 0."""
    violated: bool
    """Whether it is violated."""
    cuts_windows: bool
    """Whether the robustness depends on a window that is cut."""
    samples: int | None
    """Number of samples; ``None`` with ``--dense``."""
    missing_values: int
    """Number of missing values that ``--missing`` held or left out."""
    origin_ns: int | None
    """Instant of 0 s in nanoseconds, if times in this document are differences from it; ``None``
    if they are those of the log."""
    violations: tuple[LogViolation, ...]
    """When each part of the formula is violated, in the order of time. Parts are the operands of
    ``and`` below ``always``."""
    worst_part: WorstPart | None
    """The part that is violated most, or nearest to it; ``None`` if the formula requires none
    inside the log."""
    predicate: LogPredicate | None
    """The predicate that determines the robustness; ``None`` if no comparison does, as in an
    empty window."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogViolation:
    """A time in which a part of a formula is violated."""

    formula: str
    """The part."""
    start: float | None
    """First time in seconds; ``None`` if the log has no times and no period."""
    end: float | None
    """Last time in seconds."""
    duration: float | None
    """``end`` minus ``start``: 0 for a single sample."""
    start_sample: int | None
    """First sample, from 0; ``None`` with ``--dense``."""
    end_sample: int | None
    """Last sample."""
    worst: float
    """Least robustness of the part in this time."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class WorstPart:
    """The part of a formula that is violated most."""

    formula: str
    """The part."""
    robustness: float
    """Its least robustness."""
    time: float | None
    """Its time in seconds; ``None`` if the log has no times and no period."""
    sample: int | None
    """Its sample, from 0; ``None`` with ``--dense``."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogPredicate:
    """The predicate that determines the robustness at time 0."""

    formula: str
    """The comparison."""
    time: float | None
    """The time in seconds; ``None`` if the log has no times and no period."""
    sample: int | None
    """The sample, from 0; ``None`` with ``--dense``."""
    values: tuple[float, float]
    """Values of the two sides."""
    robustness: float
    """Its robustness."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Monitor:
    """Robustness of formulas on recorded logs."""

    robustness: float
    """Robustness at time 0 of the first formula; of several logs, in the worst one."""
    violated: bool
    """Whether the formula is violated. At a robustness of 0, ``<=``, ``>=`` and ``==`` hold, and
    ``<``, ``>`` and ``!=`` do not."""
    windows: str
    """``cut``: windows are cut at the end of the trace, as in RTAMT; ``whole`` with
    ``--strict-horizon``."""
    cuts_windows: bool
    """Whether ``robustness`` depends on a window that is cut."""
    robustness_signal: tuple[float, ...] | None = None
    """Robustness at each sample, with ``--values``; with ``--strict-horizon`` at the first
    samples, those whose windows are inside the trace. With ``--dense``, at each breakpoint."""
    robustness_times: tuple[float, ...] | None = None
    """The times of ``robustness_signal`` in seconds, with ``--values``, if the log has times."""
    requirements: tuple[RequirementVerdict, ...] | None = None
    """Each named requirement; missing without one. Without ``--formula``, the other keys are
    those of the first. Missing with several logs."""
    verdicts: tuple[LogVerdict, ...]
    """The verdict of each formula on each log, worst first: violated formulas by their severity,
    then satisfied formulas."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FirstViolation:
    """The first violation of a part of a formula."""

    formula: str
    """The part."""
    sample: int
    """Its sample, from 0."""
    time: float | None
    """Its time in seconds; ``None`` if the log has no times and no period."""
    robustness: float
    """The robustness of the part there."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MonitorChange:
    """A line of ``monitor --follow``: what the samples so far say about a formula."""

    event: str
    """``verdict``: no continuation changes the verdict. ``end``: the samples have ended before
    that, and the verdict is that of ``monitor`` without ``--follow``. ``interrupted``: a signal
    ended the command. ``bounds``, with ``--bounds``: the bounds have changed."""
    name: str | None
    """Name of the requirement; ``None`` for that of ``--formula``."""
    samples: int
    """Number of samples so far."""
    time: float | None
    """Time of the last sample in seconds; ``None`` if the log has no times and no period."""
    origin_ns: int | None
    """Instant of 0 s in nanoseconds, if times are differences from it; ``None`` if they are
    those of the log."""
    low: float
    """The least robustness at time 0 over all continuations."""
    high: float
    """The greatest robustness at time 0 over all continuations. With ``end``, it is ``low``."""
    violated: bool | None
    """Whether the formula is violated; ``None`` as long as this is not certain."""
    violation: FirstViolation | None
    """The first violation of a part of the formula that is known; ``None`` if the formula is not
    violated, and if none is known. Parts are the operands of ``and`` below ``always``."""
    cuts_windows: bool
    """With ``end``: whether the robustness depends on a window that is cut."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FormulaHorizon:
    """The part of a trace that decides a formula at time 0."""

    samples: int | None
    """Number of samples; ``None`` if the sampling period is unknown and the formula has times,
    or if a bound does not fit the period."""
    seconds: float | None
    """Time of the last one in seconds; ``None`` if the sampling period is unknown and the
    formula counts samples."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FormulaTrap:
    """A place of a formula that often means something else than its author thinks."""

    name: str
    """Name of the trap, such as ``vacuous-implication``."""
    severity: str
    """``warning``, or ``note`` for one that is often intended. ``--strict`` counts warnings."""
    line: int | None
    """Line of the text, from 1; ``None`` if it concerns the whole formula."""
    column: int | None
    """Column of the text in characters, from 1."""
    formula: str
    """The sub-formula."""
    why: str
    """Its meaning, and why it is often not intended."""
    instead: str | None
    """Advice; ``None`` without a general one."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FormulaExample:
    """A formula and its sub-formulas on a trace."""

    kind: str
    """``log``, ``episode`` (of a target), ``found`` (by a search for an example), or ``pattern``
    (that of a pattern)."""
    name: str
    """Name of the log or of the target; ``satisfied`` or ``violated`` for an example."""
    robustness: float
    """Robustness at time 0."""
    violated: bool
    """Whether the formula is violated."""
    samples: int
    """Number of samples."""
    period: float | None
    """Sampling period in seconds; ``None`` if it is unknown."""
    values: tuple[FormulaValues, ...] | None = None
    """Values of the signals of the formula over time, for examples that were made for it."""
    lanes: tuple[FormulaLane, ...]
    """The formula and its sub-formulas, depth first."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FormulaValues:
    """The values of a signal of an example."""

    signal: str
    """Name."""
    values: tuple[float, ...]
    """Values, one for each sample."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FormulaLane:
    """A sub-formula over a trace."""

    formula: str
    """The sub-formula."""
    depth: int
    """Its depth: 0 for the formula itself."""
    spans: tuple[LaneSpan, ...]
    """When it holds, is violated, or is not decided, in the order of time."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LaneSpan:
    """Samples of the same state."""

    state: str
    """``holds``, ``violated`` (also with a window that is cut at the end), or ``undecided``: not
    violated, but a window of the sub-formula reaches beyond the end of the trace."""
    first: int
    """First sample, from 0."""
    last: int
    """Last sample."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FormulaDescription:
    """A formula: in words, its traps, and what it says about traces."""

    pattern: str | None
    """Name of the pattern that it comes from; ``None`` without one."""
    formula: str
    """Formula."""
    parenthesized: str
    """The formula with parentheses around every operand, so that the precedence is visible."""
    symbols: str
    """The formula in mathematical symbols."""
    words: tuple[str, ...]
    """The formula in English, line by line; parts of a line above are indented. Empty if it has
    too many operators."""
    signals: tuple[Signal, ...]
    """Signals that it reads, with their units."""
    period: float | None
    """Sampling period in seconds; ``None`` if it is unknown."""
    horizon: FormulaHorizon | None
    """The part of a trace that decides it at time 0; ``None`` if it depends on all samples up to
    the end."""
    traps: tuple[FormulaTrap, ...]
    """The known traps in it."""
    examples: tuple[FormulaExample, ...]
    """Its verdict on traces: the logs or the nominal episode, otherwise traces that were found
    for it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PatternParameter:
    """A parameter of a pattern."""

    name: str
    """Name."""
    kind: str
    """``condition`` (a formula), ``signal`` (a number over time), ``number`` or ``time``."""
    default: str | None
    """Default; ``None`` if it must be set."""
    meaning: str
    """Meaning."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RequirementPattern:
    """A named pattern of requirements."""

    name: str
    """Name."""
    summary: str
    """The requirement in one sentence."""
    formula: str
    """Formula, with its parameters in braces."""
    parameters: tuple[PatternParameter, ...]
    """Its parameters."""
    source: str
    """Where it comes from."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MinedParameter:
    """A parameter of a formula."""

    name: str
    """Name."""
    low: float
    """Least value of its range."""
    high: float
    """Greatest value of its range."""
    unit: str | None
    """Unit of a bound of a window: ``s``, ``ms``, ``us`` or ``ns``; ``None`` for a number, and
    for a bound that counts samples."""
    tightest: str
    """Whether the least or the greatest value is the tightest: ``low`` or ``high``."""
    resolution: float | None
    """Step of the values; ``None`` if they are exact to the next number."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MinedPoint:
    """Values of the parameters for which the traces satisfy the formula."""

    values: tuple[float, ...]
    """Values, in the order of the parameters."""
    formula: str
    """Formula with these values."""
    robustness: float
    """Least robustness of the traces that satisfy it."""
    satisfied: int
    """Number of traces that satisfy it."""
    support: int
    """Number of those that support it: in the others, the condition of an implication never
    holds, or windows are cut."""
    cut: int
    """Number of those that are shorter than the windows of the formula, which are cut at their
    end."""
    decisive: str | None
    """The trace that decides the values: it satisfies the formula, and a tighter parameter
    violates it most; ``None`` if the ranges decide."""
    decisive_time: float | None
    """The time at which it decides in seconds, or its sample if it has no times."""
    decisive_sample: int | None
    """The sample at which it decides."""
    violated_if_tighter: tuple[int | None, ...]
    """For each parameter, how many traces more violate the formula if it alone is one step
    tighter; ``None`` at the end of its range."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MinedTrace:
    """The tightest value of a parameter for one trace."""

    name: str
    """Name of the trace."""
    value: float | None
    """The value; ``None`` if the trace violates the formula with the loosest one."""
    supports: bool
    """Whether the trace contains the windows of the formula with the mined value, and the
    condition of each implication holds at some sample."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mining:
    """The tightest values of the parameters of a formula for which logs or runs satisfy it."""

    formula: str
    """Formula as given, with the names of its parameters."""
    parameters: tuple[MinedParameter, ...]
    """The parameters."""
    traces: int
    """Number of traces."""
    share: float
    """Share of the traces that must satisfy the formula."""
    outcome: str
    """``found``; ``loosest-fails``: too few traces satisfy the formula with the loosest values;
    ``tightest-holds``: they satisfy it with the tightest values, so that the ranges decide."""
    points: tuple[MinedPoint, ...]
    """The tightest values; with several parameters, the Pareto front. Empty if the loosest
    values fail."""
    per_trace: tuple[MinedTrace, ...]
    """Per trace, the tightest value of the only parameter. Empty with several parameters."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class GuardFacts:
    """A guard: an online monitor of the controller, and who acts instead of it."""

    formula: str
    """Formula that is monitored."""
    threshold: float
    """Robustness below which the fallback takes over, in the unit of the formula."""
    return_threshold: float | None
    """Robustness from which on the controller acts again; ``None`` if the fallback keeps the
    control."""
    dwell: float
    """Shortest time for which the fallback acts, s."""
    fallback: str
    """The fallback: ``hold``, ``retreat``, or a controller."""
    privileged: bool
    """Whether the guard reads signals of the target, which the controller does not see."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AxisFacts:
    """An axis of a scenario space."""

    name: str
    """Name."""
    kind: str
    """Kind of quantity: ``start``, ``model``, ``event``, ``fault``, ``input`` or ``noise``."""
    unit: str
    """Unit; empty without one."""
    low: float
    """Lower bound."""
    high: float
    """Upper bound."""
    nominal: float | None
    """Value in the undisturbed episode; ``None``: drawn at random."""
    values: str | tuple[str, ...]
    """``continuous``, ``logarithmic``, ``integer``, or the names of the categories, whose values
    count from 0."""
    only_if: tuple[NeededAxis, ...] | None = None
    """Values of other axes that this axis needs for an effect, all of them; missing if it always
    has one. In other scenarios it is nominal."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Estimate:
    """A rate or mean over ``n`` simulations with its 95 % confidence interval."""

    value: float | None
    """Estimate; ``None`` if ``n`` is 0."""
    low: float | None
    """Lower bound of the interval; ``None`` for a degenerate sample."""
    high: float | None
    """Upper bound of the interval; ``None`` for a degenerate sample."""
    n: int
    """Number of simulations in the estimate."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Corners:
    """Results at the corners and the center of the initial box. They are counts of chosen
    points, so they have no intervals."""

    seeds: int
    """Number of simulations per point."""
    n: int
    """Number of corners that count: those from which the target can start, with ``--box
    reachable`` the reachable ones."""
    without_verdict: int
    """Number of these at which no simulation has a verdict. They do not count as successes."""
    succeeding: int
    """Number of these at which all simulations succeed."""
    strictly_succeeding: int | None
    """Number of these at which all simulations succeed strictly; ``None`` without a strict
    formula."""
    carefully_succeeding: int | None = None
    """Number of these at which all simulations succeed carefully; missing without such a
    formula."""
    center_succeeds: bool | None
    """Whether all simulations at the center succeed; ``None`` if it does not count, or none of
    them has a verdict."""
    center_strictly_succeeds: bool | None
    """Whether all simulations at the center succeed strictly; ``None`` if it does not count,
    none of them has a verdict, and without a strict formula."""
    center_carefully_succeeds: bool | None = None
    """Whether all simulations at the center succeed carefully; missing if it does not count,
    none of them has a verdict, and without such a formula."""
    points: tuple[CornerPoint, ...]
    """The corners, then the center."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CornerPoint:
    """The simulations of a corner or of the center."""

    kind: str
    """``corner`` or ``center``."""
    scenario: dict[str, Value]
    """Value by axis name."""
    reachable: bool | None
    """Whether success is possible from there; ``None`` if this is unknown."""
    counts: bool
    """Whether the point counts."""
    n: int
    """Number of simulations."""
    invalid_starts: int | None = None
    """Number of these that cannot start, which decide nothing; missing if there are none."""
    successes: int
    """Number of these that succeed."""
    strict_successes: int | None
    """Number of these that succeed strictly; ``None`` without a strict formula."""
    careful_successes: int | None = None
    """Number of these that succeed carefully; missing without such a formula."""
    diverged: int
    """Number of simulations that diverged. Like the next three, none of them is a success."""
    invalid: int
    """Number of simulations that ended in a value that is not finite."""
    failed: int
    """Number of simulations that could not start, crashed or took too long."""
    undecided: int
    """Number of other simulations that left success undecided."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AxisRates:
    """Success rates over the values of each axis, and over those of the pairs of axes that
    interact most.

    They count random simulations only: points that a search chose lie where earlier results
    were low, so their rates say nothing about an axis. A simulation counts for an axis only if
    the axis has an effect in its scenario.
    """

    success_rate: Estimate
    """Success rate over all simulations that count, with its Wilson interval."""
    axes: tuple[AxisRate, ...]
    """The axes that vary, those with the smallest p-value first."""
    pairs: tuple[PairRate, ...]
    """The pairs of axes with the largest interaction, largest first; at most 6."""
    pairs_tested: int
    """Number of pairs of axes that were tested."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AxisRate:
    """Success rates over the values of an axis."""

    axis: str
    """Name of the axis."""
    unit: str
    """Unit of its values; empty without one."""
    success_rate: Estimate
    """Success rate over the simulations in which the axis has an effect."""
    bins: tuple[RateBin, ...]
    """Parts of the range, in ascending order: each category, each of at most 12 whole numbers,
    or 5 parts of equal width, 10 from 500 simulations on. A logarithmic axis is divided on its
    scale."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RateBin:
    """Success rate over a part of the range of an axis."""

    low: float
    """Lowest value."""
    high: float
    """Highest value; for a whole number or a category the same as ``low``."""
    name: str | None = None
    """Name of the category; missing for a number."""
    success_rate: Estimate
    """Success rate, with its Wilson interval."""
    p_value: float | None
    """P-value of Fisher's exact test that the simulations in the bin succeed as often as all
    others of the axis, after Holm's correction for all bins of all axes; ``None`` if one of both
    is empty."""
    differs: bool
    """Whether the rate differs from that of the others: a p-value below 0.05."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairRate:
    """Success rates over the values of two axes."""

    axes: tuple[str, str]
    """Names of both axes."""
    bins: tuple[tuple[ValueRange, ...], tuple[ValueRange, ...]]
    """Parts of the range of each axis."""
    interaction: float
    """Fraction of the variance of success that both axes explain together beyond the sum of
    their separate effects (second-order Sobol index over the cells), without what chance
    explains."""
    p_value: float
    """P-value of a chi-squared test that the effects of both axes add up, after Holm's
    correction for all pairs."""
    cells: tuple[tuple[Estimate, ...], ...]
    """Success rate in each cell: a row for each bin of the first axis."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ValueRange:
    """A part of the range of an axis."""

    low: float
    """Lowest value."""
    high: float
    """Highest value; for a whole number or a category the same as ``low``."""
    name: str | None = None
    """Name of the category; missing for a number."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sequential:
    """A rule that ends simulations, and what it found. Its interval holds at any time: at all
    ends of batches together, it contains the true value with a probability of at least 95 %."""

    until: str
    """The rule: ``decided`` or ``width=W``."""
    measure: str
    """Quantity that the rule watches: ``success`` or ``robustness``."""
    rate: float | None = None
    """The rate that ``decided`` compares with; missing without one."""
    margin: float | None = None
    """The largest difference that counts as none; missing without one."""
    robustness_bounds: tuple[float, float] | None = None
    """Bounds of the robustness; values beyond them count as the bound. Missing for ``success``."""
    interval: Estimate
    """Rate, or difference B - A, with an interval that holds at any time."""
    p_value: float | None = None
    """p-value of "no difference" that holds at any time; missing for a rate."""
    decision: str | None
    """Reason that ended the simulations: ``narrow``, ``above``, ``below`` or ``equivalent``;
    ``None`` if the rule did not end them."""
    simulations: int
    """Number of simulations, or of pairs."""
    max_simulations: int
    """Largest number of simulations, or of pairs."""
    verdict: str
    """Finding of the rule, in a sentence."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Control:
    """The same starts and seeds with every other axis at nominal: what the controller does
    without the perturbations of the space. Simulation i of the arm is paired with simulation i
    of the space."""

    trial: int
    """Number of the trial that holds the simulations of the arm in the run file."""
    nominal: tuple[str, ...]
    """Axes that the arm fixes at their nominal values."""
    simulations: int
    """Number of simulations of the arm; 1 if all of them would be the same."""
    success_rate: Estimate
    """Success rate of the arm over the pairs, with an interval as that of the space. A pair
    counts if both of its simulations have a verdict."""
    difference: Estimate
    """Success rate in the space minus that of the arm, with Newcombe's interval for pairs; with
    a rule that ends the evaluation, with one that holds at any time."""
    fails_only_in_space: int
    """Number of pairs that fail only in the space: the perturbation is what they fail of."""
    fails_only_in_control: int
    """Number of pairs that fail only in the arm."""
    p_value: float
    """Two-sided p-value of "no difference": exact McNemar test, or one that holds at any time."""
    left_out: int
    """Number of pairs that do not count, because one of their simulations has no verdict."""
    without_verdict: EndCounts
    """Simulations of the arm without a verdict, by reason."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EndCounts:
    """Numbers of simulations without a verdict on success, by reason."""

    diverged: int
    """Diverged."""
    invalid: int
    """Ended because the controller or the environment returned a value that is not finite."""
    failed: int
    """Could not start, crashed or took too long."""
    undecided: int
    """Left success undecided."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Requirement:
    """A named requirement over the simulations of a run."""

    name: str
    """Name."""
    formula: str
    """Formula."""
    simulations: int
    """Number of simulations in which it has a verdict; without the corners of an evaluation."""
    violated: int
    """Number of these that violate it."""
    violation_rate: Estimate | None
    """Fraction of these that violate it, with its Wilson interval; ``None`` if a search chose
    the simulations, because then it says nothing about the space."""
    minimum_robustness: float | None
    """Minimum robustness; ``None`` without a verdict."""
    maximum_robustness: float | None
    """Maximum robustness; ``None`` without a verdict. If it is the minimum, no simulation
    changed it."""
    trial: int | None
    """Trial of the simulation with the minimum robustness."""
    simulation: int | None
    """Number of this simulation."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EndReasons:
    """The simulations of a run with one end whose target, or its controller, said why."""

    end: str
    """The end, such as ``crashed``, ``timed out``, ``invalid scenario`` or ``terminated``."""
    simulations: int
    """Number of simulations with this end and a reason, those of corners and of the moves toward
    nominal included."""
    trial: int
    """Trial of the first of them."""
    simulation: int
    """Number of the first of them."""
    reason: str
    """Reason of the first of them, in the words of the program: at most 4096 bytes, often with
    the end of its standard error."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Screening:
    """Counts of a screening: another engine simulates everything, MuJoCo C confirms what it
    flags and an audit sample of the rest."""

    device: str
    """Device of the other engine: ``gpu``."""
    simulations: int
    """Number of screened simulations."""
    flagged: int
    """Number of these that were flagged: with a violation or without a verdict there, for a
    falsification also those with a lower robustness than all earlier ones of their trial. MuJoCo
    C repeated all of them."""
    audit_sample: int
    """Number of others that MuJoCo C repeated: a random sample."""
    without_verdict: int
    """Number of screened simulations without a verdict."""
    overflows: int
    """Number of these for lack of memory for contacts or constraints."""
    confirmed_without_verdict: int
    """Number of simulations of MuJoCo C without a verdict."""
    findings: dict[str, Finding] | None = None
    """Findings of MuJoCo C, by kind: ``failure``, and for an evaluation ``strict_failure`` and
    ``dangerous`` if the target has these formulas; missing for a falsification."""
    reasons: dict[str, Confirmed] | None = None
    """Of a falsification, the simulations of MuJoCo C by their reason: ``violated``,
    ``without_verdict``, ``lowest`` (lower than all earlier ones of the trial) and
    ``audit_sample``; missing for other questions."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Finding:
    """Number of simulations in which MuJoCo C found something."""

    flagged: int
    """Number among the flagged simulations."""
    audit_sample: int
    """Number in the audit sample."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Confirmed:
    """Simulations that MuJoCo C repeated for one reason."""

    simulations: int
    """Number of simulations."""
    violations: int
    """Number of these that violate the requirement."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScreenedFailure:
    """A simulation without success."""

    number: int
    """Number of the simulation."""
    scenario: dict[str, Value]
    """Scenario by axis; a value that is drawn at random is missing."""
    seed: int
    """Random seed."""
    robustness: float | None
    """Robustness of the success formula; ``None`` without a verdict."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Success rate, dangerous behavior rate and completion time of a controller."""

    run: str | None = None
    """Path of the run file; missing if none is written."""
    target: str
    """Name of the target."""
    task: str
    """The same; the older name of ``target``."""
    target_kind: str
    """Kind of the target: ``task``, ``toy``, ``arch``, ``robot``, ``process`` or ``python``."""
    target_hash: str
    """Hash of the target."""
    preset: str | None
    """Task preset; ``None`` if the target is not a task."""
    controller: str | None
    """Name of the controller; ``None`` without one."""
    controller_hash: str | None
    """Hash of what the controller does; ``None`` without one."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    stochastic: bool
    """Whether actions are sampled from the policy's distribution."""
    action_noise: float
    """Standard deviation of the noise that is added to actions."""
    observation_noise: float
    """Standard deviation of the noise that is added to observations."""
    seed: int
    """Seed of the plan, from which the seeds of simulations are derived. For ``simulate``, and
    for ``margin`` of a target without noise, it is the seed of the simulations themselves; only
    those of repeats are derived from it."""
    space: str
    """Name of the scenario space."""
    axes: tuple[str, ...]
    """Names of its axes, the order of ``initial_configuration``."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the space in the same order."""
    set_axes: tuple[str, ...]
    """Names of the axes whose range the plan sets."""
    control_dt: float
    """Duration of a control step, s."""
    episode_steps: int
    """Number of control steps of a whole episode."""
    box: str
    """Region of the initial states: ``whole`` or ``reachable``."""
    leaves_out_starts: bool
    """Whether any initial state was rejected as unreachable and drawn again."""
    is_complete: bool
    """Whether all simulations of the plan are finished; ``false`` after an interruption, exit
    code 130."""
    simulations: int
    """Number of simulations from random scenarios, without the corners."""
    diverged: int
    """Number of these that diverged. With screening, this and the next three keys count
    simulations of MuJoCo C."""
    invalid: int
    """Number of these that ended because the controller or the environment returned a value that
    is not finite."""
    failed: int
    """Number of these that could not start, crashed or took too long."""
    undecided: int
    """Number of others that left success undecided."""
    strict_undecided: int
    """Number of others that left strict success undecided."""
    careful_undecided: int | None = None
    """Number of others that left careful success undecided; missing if the target has no such
    formula."""
    success_rate: Estimate
    """Fraction of the started simulations that satisfy the success formula, with its Wilson
    interval."""
    strict_success_rate: Estimate | None = None
    """Fraction of the started simulations that satisfy the success formula and the strict
    formula, with its Wilson interval; missing if the target has no such formula."""
    careful_success_rate: Estimate | None = None
    """Fraction of the started simulations that satisfy the success formula and the formula
    ``careful``, with its Wilson interval; missing if the target has no such formula, and with
    screening."""
    dangerous_behavior_rate: Estimate | None = None
    """Mean fraction of control steps that violate the formula ``safe``, over the simulations
    that neither diverged nor were invalid, with a betting interval; missing if the target has no
    such formula."""
    dangerous_episode_rate: Estimate | None = None
    """Fraction of the same simulations in which any control step violates the formula ``safe``,
    with its Wilson interval; missing if the target has no such formula."""
    task_completion_time: Estimate | None = None
    """Mean number of control steps until the formula ``completion`` first holds with its whole
    window inside the episode, over the successful simulations that complete, with a bootstrap
    interval; its bounds are ``None`` for fewer than 10 values or if all values are equal.
    Missing if the target has no such formula."""
    corners: Corners | None
    """Results at the corners and the center of the initial box; ``None`` if the space has no
    numeric axis of kind ``start``."""
    axis_rates: AxisRates | None = None
    """Success rates over the values of the axes; missing for fewer than 50 random simulations,
    with screening, and without any verdict or axis."""
    sequential: Sequential | None = None
    """The rule that ends the evaluation; missing without one. The intervals of the rates then
    hold at any time, and the completion time has none."""
    control: Control | None = None
    """The control arm; missing if no axis is varied but initial states, and if it is switched
    off."""
    requirements: tuple[Requirement, ...] | None = None
    """Each named requirement over the random simulations; missing without one."""
    reasons: tuple[EndReasons, ...] | None = None
    """Reasons that the target gave for the ends of simulations, by end; missing without one."""
    screening: Screening | None = None
    """Counts of the screening; missing without it. The rates are then those of a two-phase
    sample: see ``gpu.md``."""
    failures: tuple[ScreenedFailure, ...] | None = None
    """With screening, up to 100 simulations of MuJoCo C without success; missing without it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SmoothRegion:
    """The part of a space that cannot fail if no predicate is steeper than its samples show."""

    slope: float | None
    """Largest of the estimated upper bounds (95 % together) of the change of each predicate per
    width of the space, at any time; ``None`` if refused."""
    largest_slope: float | None
    """Largest slope of a predicate between adjacent samples; ``None`` if refused."""
    predicates: int | None
    """Number of predicates of the requirement; ``None`` if refused."""
    covered: float | None
    """Fraction of the space in which then no scenario fails: the lower end of a 95 % interval;
    ``None`` if refused."""
    refusal: str | None
    """Why there is no region; ``None`` with one."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """A trial: one search with its own random seed."""

    trial: int
    """Number of the trial, from 1."""
    falsified: bool
    """Whether the trial found a counterexample."""
    simulations: int
    """Number of simulations."""
    first_violation: int | None
    """Number of the first simulation with a counterexample; ``None`` without one."""
    minimum_robustness: float | None
    """Minimum robustness; ``None`` if no simulation has one."""
    initial_configuration: tuple[float | None, ...] | None
    """The values of ``scenario`` in the order of ``axes``."""
    scenario: dict[str, Value] | None
    """Scenario of the simulation with the minimum robustness by axis; a value that is drawn at
    random is missing."""
    simulation: int | None
    """Number of that simulation."""
    seed: int | None
    """Random seed of that simulation."""
    end: str | None
    """``falsified``, ``budget spent``, ``search ended`` or, with ``--keep-going``, ``modes dried
    up``; ``None`` if the run was interrupted before."""
    diverged: int
    """Number of simulations that diverged."""
    invalid: int
    """Number of simulations that ended in a value that is not finite."""
    failed: int
    """Number of simulations that could not start, crashed or took too long."""
    undecided: int
    """Number of other simulations that left the formula undecided."""
    undefined: int
    """Number of undecided simulations without a finite value of the formula."""
    first_unevaluated: Unevaluated | None
    """The first simulation that is invalid, failed or undefined; ``None`` without one."""
    repeats: Repeats | None
    """Simulations of the counterexample with other seeds; ``None`` without a counterexample,
    without randomness, and in a campaign."""
    cause: Cause | None
    """The axes that cause the failure; ``None`` without a counterexample, in a campaign, with
    ``--keep-going``, with ``--no-isolate`` and with a screening."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Unevaluated:
    """A simulation without a verdict."""

    simulation: int
    """Number of the simulation in its trial, from 1."""
    scenario: dict[str, Value]
    """Scenario by axis; a value that is drawn at random is missing."""
    seed: int
    """Random seed."""
    end: str
    """How the simulation ended, in words."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Repeats:
    """Simulations of one scenario with other random seeds."""

    simulations: int
    """Number of simulations, with or without a verdict."""
    failures: int
    """Number of these that violate the requirement."""
    failure_rate: Estimate
    """Failure rate of the simulations with a verdict, with its Wilson interval."""
    quantiles: tuple[Quantile, ...] | None
    """Quantiles of the robustness at the probabilities 0, 0.05, 0.5, 0.95 and 1, linearly
    interpolated; ``None`` without a verdict."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Quantile:
    """A quantile of the robustness."""

    p: float
    """Probability."""
    robustness: float
    """Robustness that this fraction of the simulations does not exceed."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Cause:
    """The axes that cause the failure of a counterexample: simulations with its seed that move
    it toward nominal. They count in no rate."""

    simulations: int
    """Number of these simulations."""
    scenario: dict[str, Value]
    """The failing scenario with the fewest axes off nominal, and of these the closest to
    nominal."""
    robustness: float
    """Its robustness."""
    axes: tuple[str, ...]
    """Axes that have another value than the nominal one in this scenario; empty if the nominal
    scenario fails."""
    sufficient: tuple[str, ...] | None
    """Axes that cause a failure alone: with their value of the counterexample and all others at
    nominal, the simulation fails. ``None`` if there are too many axes to try."""
    necessary: tuple[str, ...] | None
    """Axes that remove the failure alone: the counterexample with this axis at nominal does not
    fail. ``None`` if there are too many axes to try."""
    only_on_bounds: tuple[str, ...]
    """Axes that must be exactly on a bound: ``scenario`` does not fail if they move inside by a
    millionth of their width. Empty if it fails there, too, or if no axis is on a bound."""
    other_seeds: Estimate | None
    """Failures of ``scenario`` with other seeds; ``None`` if the target is not random."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FoundMode:
    """A failure mode and the trials that found it."""

    mode: int
    """Number of the mode, from 1."""
    failures: int
    """Number of its failures."""
    predicate: str
    """Their decisive predicate; empty if the formula has none."""
    samples: tuple[int, int]
    """First and last sample at which the violation of a failure is final."""
    times: tuple[float, float]
    """Times of these samples, s."""
    axes: tuple[str, ...]
    """Names of the axes that matter: those by which failures with this predicate were grouped."""
    region: dict[str, tuple[Value, Value] | None]
    """Smallest and largest value by axis; ``None``: drawn at random."""
    trial: int
    """Number of the trial of the representative, the failure nearest to the nominal scenario."""
    simulation: int
    """Number of the representative within its trial."""
    seed: int
    """Its random seed."""
    scenario: dict[str, Value]
    """Its scenario by axis; a value that is drawn at random is missing."""
    robustness: float
    """Its robustness."""
    distance_from_nominal: float
    """Root mean square of its offsets from nominal over the axes, as fractions of their widths."""
    found: tuple[FirstInMode, ...]
    """The trials that found it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FirstInMode:
    """The first simulation of a trial in a mode."""

    trial: int
    """Number of the trial."""
    simulation: int
    """Number of its first simulation in the mode."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class UnseenModes:
    """Estimates of the failure modes that no trial found, from the numbers of trials that found
    each mode.

    The trials of a run have independent seeds, so these estimates hold for searches that
    choose their points by earlier results. Those from the number of failures of each mode, as in
    Good and Turing, would need independent simulations.
    """

    trials: int
    """Number of trials."""
    found_once: int
    """Number of modes that exactly one trial found."""
    expected_new: float
    """Expected number of new modes of another trial."""
    total: float
    """Lower estimate of the number of modes that such trials can find (Chao2)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Coverage:
    """Pairwise coverage of a space by simulations, with 10 bins for each axis, or its levels if
    they are fewer.

    The cells are those of every pair of axes (of the axis, if the space has one): pairwise or
    2-way coverage, as in Kuhn, Kacker and Lei, "Introduction to combinatorial testing", 2013.
    Cells of all axes together would be too many to visit.

    A visited cell has at least one simulation. It says nothing about the rest of the cell,
    and nothing about combinations of three or more axes.
    """

    pairs: int
    """Number of pairs of axes with more than one value; 1 for a space with one such axis."""
    cells: int
    """Number of cells of all pairs."""
    visited: int
    """Number of cells with a simulation."""
    failing: int
    """Number of cells with a failing simulation."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Adversary:
    """An adversary: a policy that disturbs simulations while they run. All simulations of its
    training are those of the trials, and count."""

    axes: int
    """Number of axes that the adversary decides. The others are random."""
    decisions: int
    """Number of times in an episode at which it decides some of them."""
    rows: int
    """Number of simulations from which it learns before the next ones start."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Falsification:
    """Counterexamples that the trials of a search found."""

    run: str | None = None
    """Path of the run file; missing if none is written."""
    target: str
    """Name of the target."""
    task: str
    """The same; the older name of ``target``."""
    target_kind: str
    """Kind of the target: ``task``, ``toy``, ``arch``, ``robot``, ``process`` or ``python``."""
    target_hash: str
    """Hash of the target."""
    preset: str | None
    """Task preset; ``None`` if the target is not a task."""
    controller: str | None
    """Name of the controller; ``None`` without one."""
    controller_hash: str | None
    """Hash of what the controller does; ``None`` without one."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    stochastic: bool
    """Whether actions are sampled from the policy's distribution."""
    action_noise: float
    """Standard deviation of the noise that is added to actions."""
    observation_noise: float
    """Standard deviation of the noise that is added to observations."""
    seed: int
    """Seed of the plan, from which the seeds of simulations are derived. For ``simulate``, and
    for ``margin`` of a target without noise, it is the seed of the simulations themselves; only
    those of repeats are derived from it."""
    space: str
    """Name of the scenario space."""
    axes: tuple[str, ...]
    """Names of its axes, the order of ``initial_configuration``."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the space in the same order."""
    set_axes: tuple[str, ...]
    """Names of the axes whose range the plan sets."""
    control_dt: float
    """Duration of a control step, s."""
    episode_steps: int
    """Number of control steps of a whole episode."""
    is_complete: bool
    """Whether all trials have ended; ``false`` after an interruption, exit code 130."""
    search: str
    """Name of the search."""
    search_options: dict[str, float | int | bool | str | tuple[float, ...] | tuple[tuple[float, ...], ...]]
    """Search options that the plan sets."""
    formula: str
    """The requirement."""
    budget: int
    """Largest number of simulations per trial."""
    batch: int
    """Number of simulations run at once."""
    fixed_seed: int | None
    """Random seed of every simulation; ``None`` if each simulation has a seed of its own."""
    early_stopping: bool
    """Whether simulations end as soon as the search does not need the rest."""
    simulations: int
    """Number of simulations of all trials."""
    control_steps: int
    """Number of control steps of all simulations; with screening of those of MuJoCo C."""
    falsified_trials: int
    """Number of trials that found a counterexample."""
    falsification_rate: Estimate
    """Fraction of the ended trials that found a counterexample, with its Wilson interval."""
    mean_simulations: float | None
    """Mean number of simulations up to the counterexample, over the falsified trials only;
    ``None`` without one."""
    median_simulations: int | None
    """Number of simulations after which half of all trials are falsified; ``None`` if fewer than
    half are falsified within the budget, or if a trial was interrupted."""
    restricted_mean_simulations: float | None
    """Mean number of simulations over all trials; a trial without a counterexample counts as the
    budget. ``None`` if a trial was interrupted."""
    smooth_region: SmoothRegion | None
    """The part of the space that cannot fail if the requirement is smooth; ``None`` where
    ``failure_rate_bound`` is."""
    failure_rate_bound: float | None
    """One-sided 95 % upper bound of the failure rate if no simulation of uniform random samples
    (``random``) fails; ``None`` otherwise."""
    requirements: tuple[Requirement, ...] | None = None
    """Each named requirement over all simulations; missing without one."""
    reasons: tuple[EndReasons, ...] | None = None
    """Reasons that the target gave for the ends of simulations, by end; missing without one."""
    trials: tuple[Trial, ...]
    """The trials."""
    failures: int | None = None
    """Number of simulations that violate the requirement, over all trials. This key and the next
    four exist with ``--keep-going`` only."""
    not_grouped: int | None = None
    """Number of these that are in no mode: without a recorded trace, or beyond 5,000."""
    modes: tuple[FoundMode, ...] | None = None
    """Failure modes, the one with the most failures first."""
    unseen_modes: UnseenModes | None = None
    """Estimates of the modes that no trial found; ``None`` for fewer than two trials."""
    coverage: Coverage | None = None
    """Pairwise coverage of the space by the simulations."""
    screening: Screening | None = None
    """Counts of the screening; missing without it."""
    adversary: Adversary | None = None
    """The adversary that disturbed the simulations; missing without one."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CategoryMargin:
    """The smallest disturbance at one combination of categories."""

    categories: dict[str, str]
    """The category of each categorical axis."""
    simulations: int
    """Number of simulations."""
    is_complete: bool
    """Whether the search was not interrupted."""
    amplitude: float | None
    """Amplitude of the smallest violation that was found; ``None`` without one."""
    simulation: int | None
    """Number of its simulation in the run; ``None`` without one."""
    no_violation_up_to: float | None
    """As in the whole document."""
    no_violation_simulations: int | None
    """As in the whole document."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Level:
    """The simulations with disturbances up to an amplitude."""

    amplitude: float
    """Largest offset of a disturbed axis, as a fraction of the distance from its nominal value
    to its bound."""
    simulations: int
    """Number of simulations."""
    seeds: int
    """Number of different seeds of these; 1 if the seed has no effect."""
    without_verdict: int
    """Number of simulations without a verdict."""
    minimum_robustness: float | None
    """Minimum robustness; ``None`` if no simulation has one."""
    is_violated: bool
    """Whether a simulation violates the requirement."""
    is_complete: bool
    """Whether the search at this amplitude was not interrupted."""
    is_exhaustive: bool
    """Whether all scenarios up to the amplitude were simulated and have a verdict, which is
    possible if all axes are discrete."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Witness:
    """A violation and the size of its disturbance."""

    amplitude: float
    """Largest offset (L∞): the amplitude."""
    l2: float
    """Root of the sum of the squares of the offsets (L2)."""
    l1: float
    """Sum of the offsets (L1)."""
    axes: int
    """Number of disturbed axes."""
    simulation: int
    """Number of its simulation in the run."""
    scenario: dict[str, Value]
    """Scenario by axis; a value that is drawn at random is missing."""
    seed: int
    """Random seed."""
    robustness: float | None
    """Robustness."""
    repeats: Repeats | None
    """Repeats of the witness with other seeds; ``None`` if the seed has no effect."""
    fails_in_most_repeats: bool | None
    """Whether more than half of the repeats violate the requirement; ``None`` without repeats."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Margin:
    """The smallest disturbance that violates a requirement."""

    run: str | None = None
    """Path of the run file; missing if none is written."""
    target: str
    """Name of the target."""
    task: str
    """The same; the older name of ``target``."""
    target_kind: str
    """Kind of the target: ``task``, ``toy``, ``arch``, ``robot``, ``process`` or ``python``."""
    target_hash: str
    """Hash of the target."""
    preset: str | None
    """Task preset; ``None`` if the target is not a task."""
    controller: str | None
    """Name of the controller; ``None`` without one."""
    controller_hash: str | None
    """Hash of what the controller does; ``None`` without one."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    stochastic: bool
    """Whether actions are sampled from the policy's distribution."""
    action_noise: float
    """Standard deviation of the noise that is added to actions."""
    observation_noise: float
    """Standard deviation of the noise that is added to observations."""
    seed: int
    """Seed of the plan, from which the seeds of simulations are derived. For ``simulate``, and
    for ``margin`` of a target without noise, it is the seed of the simulations themselves; only
    those of repeats are derived from it."""
    space: str
    """Name of the scenario space."""
    axes: tuple[str, ...]
    """Names of its axes, the order of ``initial_configuration``."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the space in the same order."""
    set_axes: tuple[str, ...]
    """Names of the axes whose range the plan sets."""
    control_dt: float
    """Duration of a control step, s."""
    episode_steps: int
    """Number of control steps of a whole episode."""
    formula: str
    """The requirement."""
    simulations: int
    """Number of simulations, without the repeats of the witness."""
    is_random: bool
    """Whether the seed has an effect. If so, the simulations of the search have different seeds."""
    is_complete: bool
    """Whether the search was not interrupted."""
    categories: dict[str, str]
    """Names of the categorical axes and the category at which each of them stays. A margin
    varies numbers only."""
    each_category: tuple[CategoryMargin, ...]
    """The search for each combination of categories, if that was requested; otherwise empty. The
    other keys are those of the search with the smallest disturbance."""
    levels: tuple[Level, ...]
    """The amplitudes in the order in which they were tried."""
    no_violation_up_to: float | None
    """Largest amplitude below that of the witness at which a finished search found no violation
    and most simulations have a verdict; ``None`` without one."""
    no_violation_simulations: int | None
    """Number of simulations with a verdict on which ``no_violation_up_to`` rests; ``None``
    without one."""
    no_violation_seeds: int | None
    """Number of different seeds of these; ``None`` without one."""
    witness: Witness | None
    """The violation with the smallest disturbance; ``None`` without one."""
    reasons: tuple[EndReasons, ...] | None = None
    """Reasons that the target gave for the ends of simulations, by end; missing without one."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SourceRange:
    """The range from which an axis of source cases is drawn."""

    axis: str
    """Name of the axis."""
    low: float
    """Lowest value."""
    high: float
    """Highest value."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MetamorphicRelation:
    """The pairs of a metamorphic relation."""

    name: str
    """Name of the relation."""
    change: dict[str, str]
    """The change of each changed axis: an offset such as ``+0.02``, a factor such as ``*0.8``,
    or a value such as ``=0.3``."""
    holds: str
    """The relation of the results: ``same-verdict``, ``not-better``, ``not-worse``, the last two
    also with a tolerance of the robustness as in ``not-worse:0.05``, or
    ``robustness-within:DISTANCE``."""
    pairs: int
    """Number of pairs that were simulated."""
    out_of_bounds: int
    """Number of source cases whose follow-up case is outside of the bounds of an axis. They were
    not simulated for this relation."""
    without_verdict: int
    """Number of pairs in which a simulation has no verdict."""
    verdicts: VerdictCounts
    """The verdicts of the other pairs."""
    broken: int
    """Number of pairs that break the relation."""
    broken_rate: Estimate
    """The rate of broken pairs among those with two verdicts."""
    worst: tuple[BrokenPair, ...]
    """Up to 100 broken pairs, the largest difference of the robustness first."""
    smallest_change: SmallestChange | None
    """The smallest share of the change that still breaks the relation from the source case of
    the first of them; ``None`` without one, or if an axis is changed to a category."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VerdictCounts:
    """Pairs by the verdicts of source case and follow-up case."""

    both_satisfied: int
    """Both satisfy the requirement."""
    both_violated: int
    """Both violate it."""
    worse: int
    """The source case satisfies it, the follow-up case violates it."""
    better: int
    """The source case violates it, the follow-up case satisfies it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BrokenPair:
    """A pair that breaks a relation."""

    pair: int
    """Number of the pair, from 1."""
    seed: int
    """Random seed of both cases."""
    source: PairCase
    """The source case."""
    follow_up: PairCase
    """The follow-up case."""
    difference: float
    """Robustness of the follow-up case minus that of the source case."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairCase:
    """A simulation of a pair."""

    trial: int
    """Its trial in the run."""
    simulation: int
    """Its number in the trial."""
    scenario: dict[str, Value]
    """Scenario by axis."""
    robustness: float | None
    """Robustness; ``None`` without a verdict."""
    is_violated: bool | None
    """Whether it violates the requirement; ``None`` without a verdict."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SmallestChange:
    """The smallest change that was found to break a relation, by bisection: an upper bound."""

    pair: int
    """Number of the pair."""
    share: float
    """Share of the change, up to 1."""
    holds_at: float
    """Largest smaller share that was tried and does not break the relation; 0 is the source case
    itself."""
    change: dict[str, float]
    """Difference from the source case on each changed axis, in the unit of the axis."""
    follow_up: PairCase
    """The follow-up case with this change."""
    simulations: int
    """Number of simulations of the bisection."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Metamorphic:
    """Relations between the results of pairs of scenarios: metamorphic relations.

    A source case is a random scenario. A relation changes some of its axes, which gives the
    follow-up case, and says what must hold between the two results. Both cases have the same
    seed.
    """

    run: str | None = None
    """Path of the run file; missing if none is written."""
    target: str
    """Name of the target."""
    task: str
    """The same; the older name of ``target``."""
    target_kind: str
    """Kind of the target: ``task``, ``toy``, ``arch``, ``robot``, ``process`` or ``python``."""
    target_hash: str
    """Hash of the target."""
    preset: str | None
    """Task preset; ``None`` if the target is not a task."""
    controller: str | None
    """Name of the controller; ``None`` without one."""
    controller_hash: str | None
    """Hash of what the controller does; ``None`` without one."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    stochastic: bool
    """Whether actions are sampled from the policy's distribution."""
    action_noise: float
    """Standard deviation of the noise that is added to actions."""
    observation_noise: float
    """Standard deviation of the noise that is added to observations."""
    seed: int
    """Seed of the plan, from which the seeds of simulations are derived. For ``simulate``, and
    for ``margin`` of a target without noise, it is the seed of the simulations themselves; only
    those of repeats are derived from it."""
    space: str
    """Name of the scenario space."""
    axes: tuple[str, ...]
    """Names of its axes, the order of ``initial_configuration``."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the space in the same order."""
    set_axes: tuple[str, ...]
    """Names of the axes whose range the plan sets."""
    control_dt: float
    """Duration of a control step, s."""
    episode_steps: int
    """Number of control steps of a whole episode."""
    formula: str
    """The requirement."""
    sources: tuple[SourceRange, ...]
    """The values of source cases, in the order of the axes."""
    pairs: int
    """Requested number of source cases."""
    simulations: int
    """Number of all simulations."""
    is_random: bool
    """Whether the seed has an effect. If so, each pair has its own seed."""
    is_complete: bool
    """Whether the test was not interrupted; otherwise the counts are those of the finished
    pairs."""
    relations: tuple[MetamorphicRelation, ...]
    """The relations."""
    reasons: tuple[EndReasons, ...] | None = None
    """Reasons that the target gave for the ends of simulations, by end; missing without one."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AxisDistribution:
    """The distribution of an axis."""

    axis: str
    """Name of the axis."""
    distribution: str
    """Its distribution; ``fixed`` for an axis with one value."""
    low: float
    """Lower bound of the axis, where the distribution is truncated."""
    high: float
    """Upper bound of the axis, where the distribution is truncated."""
    unit: str
    """Unit of the axis."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Probability:
    """A probability of a violation with its 95 % interval."""

    value: float | None
    """Estimate."""
    low: float | None
    """Lower bound."""
    high: float | None
    """Upper bound."""
    source: str
    """Part that it is from: ``monte-carlo``, ``importance`` or ``splitting``."""
    assumption: str | None
    """Assumption of the interval; ``None`` if it has none."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MonteCarlo:
    """Independent simulations under the distribution itself."""

    simulations: int
    """Number of simulations."""
    failures: int
    """Number of these that violate the requirement."""
    invalid_starts: int | None = None
    """Number of these from whose scenario the target cannot start, which leave the failure rate;
    missing if there are none."""
    without_verdict: int
    """Number of others without a verdict, which count as passed."""
    bound_with_undecided: float | None
    """Upper bound of the probability (97.5 %) if the simulations without a verdict are failures."""
    failure_rate: Estimate
    """Failure rate, with its exact 95 % interval (Clopper and Pearson, with the decision that
    ends Monte Carlo)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Exploration:
    """The search for failures."""

    simulations: int
    """Number of simulations."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Importance:
    """Simulations under a distribution that is fitted to the failures, with weights."""

    fitting_simulations: int
    """Number of simulations that fitted the regions."""
    simulations: int
    """Number of simulations of the estimate."""
    failures: int
    """Number of failures in the regions."""
    effective_failures: float
    """Number of equally weighted failures with the same precision."""
    components: int
    """Number of regions."""
    regions: Estimate
    """Probability of a failure in the regions, with a 95 % betting interval. It is that among
    all scenarios, so it does not answer the question if ``monte_carlo`` has invalid starts."""
    outside: float
    """Estimate of the probability of failures outside of the regions from the few draws there,
    without an interval."""
    monte_carlo_inside: int
    """Number of failures of Monte Carlo in the regions."""
    monte_carlo_outside: int
    """Number of failures of Monte Carlo outside of them."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Splitting:
    """Adaptive multilevel splitting with independent chains."""

    simulations: int
    """Number of simulations."""
    population: int
    """Number of particles of a chain."""
    estimate: Estimate | None
    """Mean of the chains; ``None`` if they disagree or are too small."""
    chains: tuple[Chain, ...]
    """The chains."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Chain:
    """A chain of multilevel splitting."""

    probability: float
    """Estimate of the probability of a robustness below the level."""
    level: float
    """0 if the chain reached the failures, otherwise the robustness that it reached."""
    is_complete: bool
    """Whether it reached the failures."""
    levels: int
    """Number of levels."""
    acceptance: float
    """Fraction of accepted moves."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RiskFailure:
    """A failure."""

    scenario: dict[str, Value]
    """Scenario by axis; a value that is drawn at random is missing."""
    simulation: int
    """Number of the simulation in the run."""
    seed: int
    """Random seed."""
    robustness: float
    """Robustness."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Risk:
    """The probability of a violation under a distribution of scenarios."""

    run: str | None = None
    """Path of the run file; missing if none is written."""
    target: str
    """Name of the target."""
    task: str
    """The same; the older name of ``target``."""
    target_kind: str
    """Kind of the target: ``task``, ``toy``, ``arch``, ``robot``, ``process`` or ``python``."""
    target_hash: str
    """Hash of the target."""
    preset: str | None
    """Task preset; ``None`` if the target is not a task."""
    controller: str | None
    """Name of the controller; ``None`` without one."""
    controller_hash: str | None
    """Hash of what the controller does; ``None`` without one."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    stochastic: bool
    """Whether actions are sampled from the policy's distribution."""
    action_noise: float
    """Standard deviation of the noise that is added to actions."""
    observation_noise: float
    """Standard deviation of the noise that is added to observations."""
    seed: int
    """Seed of the plan, from which the seeds of simulations are derived. For ``simulate``, and
    for ``margin`` of a target without noise, it is the seed of the simulations themselves; only
    those of repeats are derived from it."""
    space: str
    """Name of the scenario space."""
    axes: tuple[str, ...]
    """Names of its axes, the order of ``initial_configuration``."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the space in the same order."""
    set_axes: tuple[str, ...]
    """Names of the axes whose range the plan sets."""
    control_dt: float
    """Duration of a control step, s."""
    episode_steps: int
    """Number of control steps of a whole episode."""
    formula: str
    """The requirement."""
    method: str
    """``auto``, ``monte-carlo``, ``importance``, ``splitting`` or ``sequence``."""
    distribution: tuple[AxisDistribution, ...]
    """The distribution of the scenarios."""
    seed_is_random: bool
    """Whether the seed of each simulation is random, too."""
    simulations: int
    """Number of all simulations."""
    is_complete: bool
    """Whether the estimation was not interrupted; otherwise the answer is that of the finished
    parts."""
    probability: Probability | None
    """The answer; ``None`` without an estimate."""
    bounds: tuple[float, float]
    """Lower and upper bound (95 %) without an assumption; ``[0, 1]`` without any verdict."""
    refusals: tuple[str, ...]
    """Why parts have no estimate, in words; a budget that is too small for multilevel splitting
    is one of them."""
    splitting_refusal: str | None
    """Why multilevel splitting has no estimate: ``budget``, ``chains``, ``invalid-starts``,
    ``monte-carlo``, ``below-importance`` or ``above-importance``; ``None`` if it has one, or was
    not needed."""
    monte_carlo: MonteCarlo
    """Plain Monte Carlo."""
    exploration: Exploration
    """The search for failures."""
    importance: Importance | None
    """Importance sampling; ``None`` if it was not run."""
    splitting: Splitting | None
    """Multilevel splitting; ``None`` if it was not run."""
    failures: tuple[RiskFailure, ...]
    """Up to three failures, those nearest to the center of the distribution first."""
    reasons: tuple[EndReasons, ...] | None = None
    """Reasons that the target gave for the ends of simulations, by end; missing without one."""
    screening: Screening | None = None
    """Counts of the screening; missing without it. The estimate of Monte Carlo is then that of a
    two-phase sample: see ``gpu.md``."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Explanation:
    """When, where and by which predicate a simulation violates or satisfies the requirement.
    Samples count from 0."""

    run: str | None = None
    """Path of the run file; missing within the document of ``simulate``."""
    target: str
    """Target of the run."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    trial: int
    """Number of the trial."""
    simulation: int
    """Number of the simulation within the trial."""
    scenario: dict[str, Value]
    """Scenario by axis; a value that is drawn at random is missing."""
    seed: int
    """Random seed of the simulation."""
    formula: str
    """Requirement."""
    robustness: float
    """Robustness of the requirement."""
    violated: bool
    """Whether the requirement is violated. At a robustness of 0, ``<=``, ``>=`` and ``==`` hold,
    and ``<``, ``>`` and ``!=`` do not."""
    reason: str | None = None
    """Why the simulation ended so, in the words of the target or its controller; missing if they
    said nothing."""
    decided: Instant | None
    """First sample after which nothing can change whether the requirement is satisfied; ``None``
    if the trace does not decide it."""
    predicate: Predicate | None
    """Decisive predicate; ``None`` if an operator has an empty window."""
    window: Window | None
    """Samples at which the operator above evaluates the predicate; ``None`` without a predicate."""
    path: tuple[PathStep, ...]
    """Sub-formulas from the requirement to the predicate."""
    conjuncts: tuple[Conjunct, ...]
    """Conjuncts of the requirement."""
    sentences: tuple[str, ...]
    """The explanation in sentences."""
    signals: SignalTable | None
    """Signals of the requirement at some samples; ``None`` without a predicate."""
    axes_at_nominal: AxesAtNominal | None = None
    """The failure with each axis alone at its nominal value; left out by other commands than
    ``explain``, with ``--axes 0``, if the requirement is satisfied, and without an axis off
    nominal."""
    point: str | None
    """``corner`` or ``center`` for a simulation at the corners of the initial box, trial 2 of an
    evaluation; otherwise ``None``."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the scenario space."""
    control_dt: float
    """Time between two samples, s."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Instant:
    """A sample and its time."""

    sample: int
    """Sample, from 0."""
    time: float
    """Its time, s."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Predicate:
    """A decisive predicate at its sample."""

    formula: str
    """Text."""
    sample: int
    """Sample, from 0."""
    time: float
    """Its time, s."""
    comparison: str
    """``<=``, ``>=``, ``<``, ``>``, ``==`` or ``!==``."""
    sides: tuple[str, str]
    """Texts of its two sides."""
    values: tuple[float, float]
    """Their values at the sample."""
    robustness: float
    """Robustness of the predicate at the sample."""
    negated: bool
    """Whether the formula requires the predicate to be false."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Window:
    """The samples at which an operator evaluates a predicate."""

    samples: tuple[int, int]
    """First and last of them."""
    violated: int
    """Number of them that violate the predicate."""
    first_violated: int | None
    """First of these; ``None`` if there are none."""
    last_violated: int | None
    """Last of these; ``None`` if there are none."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PathStep:
    """A sub-formula on the path to the decisive predicate."""

    formula: str
    """Text."""
    operator: str | None
    """Operator; ``None`` for a signal or a number."""
    sample: int
    """Sample, from 0."""
    time: float
    """Its time, s."""
    window: tuple[int, int] | None
    """First and last sample of its window; ``None`` without one."""
    robustness: float
    """Robustness at the sample."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Conjunct:
    """A conjunct of a requirement."""

    formula: str
    """Text."""
    robustness: float
    """Robustness of the requirement with this conjunct as the only operand of each ``and`` above
    it."""
    decided: Instant | None
    """As ``decided`` of the explanation, for this conjunct."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SignalTable:
    """Values of signals at some samples: up to the decisive one, at the instant that decides the
    requirement, and at the end."""

    columns: tuple[Signal, ...]
    """The signals: up to four of those that the requirement reads, those of the predicate first."""
    rows: tuple[SignalRow, ...]
    """The samples."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SignalRow:
    """Values of signals at a sample."""

    sample: int
    """Sample, from 0."""
    values: tuple[float | None, ...]
    """One value per column; ``None`` if the trace does not have it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AxesAtNominal:
    """A failure simulated again with each axis alone at its nominal value and the same seed.
    What an axis removes with others, and what it does with other seeds, is not in it."""

    axes: tuple[AxisAtNominal, ...]
    """The simulated axes, that with the largest robustness first."""
    left_out: int
    """Number of axes off nominal that were left out because of the limit: those nearest to
    nominal."""
    reason: str | None = None
    """Why the other axes were not simulated; missing if all were."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AxisAtNominal:
    """A failure with one axis at its nominal value."""

    axis: str
    """The axis."""
    value: float
    """Its value in the failure."""
    nominal: float
    """Its nominal value, with which the simulation was repeated."""
    robustness: float | None
    """Robustness of that simulation; ``None`` without a verdict."""
    violated: bool | None
    """Whether it still violates the requirement; ``None`` without a verdict."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Noise:
    """The share of the variance of the robustness that comes from the scenario; the rest comes
    from noise."""

    scenario_share: float | None
    """Share that comes from the scenario, from 0 to 1; ``None`` if the robustness is constant,
    infinite or undecided."""
    scenario_share_interval: tuple[float, float] | None
    """Lower and upper bound of its 95 % interval."""
    scenarios: int
    """Number of random scenarios."""
    repeats: int
    """Number of simulations of each."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Simulation:
    """Simulations of one chosen scenario."""

    target: str
    """Name of the target."""
    task: str
    """The same; the older name of ``target``."""
    target_kind: str
    """Kind of the target: ``task``, ``toy``, ``arch``, ``robot``, ``process`` or ``python``."""
    target_hash: str
    """Hash of the target."""
    preset: str | None
    """Task preset; ``None`` if the target is not a task."""
    controller: str | None
    """Name of the controller; ``None`` without one."""
    controller_hash: str | None
    """Hash of what the controller does; ``None`` without one."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    stochastic: bool
    """Whether actions are sampled from the policy's distribution."""
    action_noise: float
    """Standard deviation of the noise that is added to actions."""
    observation_noise: float
    """Standard deviation of the noise that is added to observations."""
    seed: int
    """Seed of the plan, from which the seeds of simulations are derived. For ``simulate``, and
    for ``margin`` of a target without noise, it is the seed of the simulations themselves; only
    those of repeats are derived from it."""
    space: str
    """Name of the scenario space."""
    axes: tuple[str, ...]
    """Names of its axes, the order of ``initial_configuration``."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the space in the same order."""
    set_axes: tuple[str, ...]
    """Names of the axes whose range the plan sets."""
    control_dt: float
    """Duration of a control step, s."""
    episode_steps: int
    """Number of control steps of a whole episode."""
    scenario: dict[str, Value]
    """Scenario by axis; a value that is drawn at random is missing."""
    formula: str
    """The requirement."""
    end: str | None
    """How the simulation ended, in words; ``None`` with ``--repeat``, as the next three keys."""
    reason: str | None = None
    """Why the simulation ended so, in the words of the target or its controller; missing if they
    said nothing."""
    steps: int | None
    """Number of control steps."""
    robustness: float | None
    """Robustness of the requirement."""
    violated: bool | None
    """Whether the requirement is violated; ``None`` without a verdict. At a robustness of 0,
    ``<=``, ``>=`` and ``==`` hold, and ``<``, ``>`` and ``!=`` do not."""
    explanation: Explanation | None
    """The document of ``explain``, without ``schema`` and ``run``."""
    requirements: tuple[RequirementVerdict, ...] | None = None
    """Each named requirement; missing without one."""
    repeats: Repeats | None
    """Repeated simulations; ``None`` without ``--repeat``."""
    noise: Noise | None
    """Split of the variance of the robustness; ``None`` without ``--repeat`` or randomness."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CheckedRequirement:
    """A requirement of a file."""

    name: str
    """Identifier."""
    text: str | None
    """The requirement in words, from the file; ``None`` without them."""
    formula: str
    """Formula as the file states it, with the units of its bounds; or the name of one of the
    target."""
    named_formula: str | None
    """Text of the formula that ``formula`` names; ``None`` if ``formula`` is the text."""
    severity: str
    """Severity of a violation: ``critical``, ``error`` or ``warning``."""
    clauses: tuple[str, ...]
    """Clauses of standards that ask for it."""
    source: str | None
    """Where the numbers of the formula come from; ``None`` if the file does not say it."""
    space: str
    """Scenario space."""
    max_failure_rate: float | None
    """Largest failure rate that is allowed; ``None``: no violation is."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CheckedController:
    """A controller of a check."""

    name: str
    """Name, or path; empty for a target without one."""
    hash: str | None
    """Hash of what the controller does; ``None`` without one."""
    target_hash: str
    """Hash of the target with this controller."""
    runs: tuple[CheckRun, ...]
    """The runs, with all their simulations."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CheckRun:
    """A run file of a check."""

    run: str
    """Path of the run file."""
    kind: str
    """``random`` scenarios, or a ``search``."""
    space: str
    """Scenario space."""
    requirement: str | None
    """The requirement that the search tries to violate; ``None`` for random scenarios."""
    simulations: int
    """Number of simulations."""
    digest: str
    """Digest of all records of the run: equal for equal simulations."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CheckCell:
    """The verdict of a requirement for a controller."""

    requirement: str
    """Identifier of the requirement."""
    controller: str
    """Name of the controller."""
    verdict: str
    """``violated``; ``not violated`` in the simulations that were run, which proves nothing
    about others; ``no verdict``: the simulations do not decide, or one of them has no verdict;
    or ``not applicable``: the target lacks signals of the formula."""
    evidence: str
    """The evidence in a sentence."""
    missing_signals: tuple[str, ...]
    """Signals of the formula that the target lacks."""
    random: CheckCounts
    """Random scenarios in the space of the requirement."""
    searched: CheckCounts
    """Simulations that searches chose in this space, also searches for another requirement."""
    failure_rate: Estimate | None
    """Share of the random scenarios that violate it, with two one-sided 95 % bounds
    (Clopper-Pearson). Simulations without a verdict count as satisfied for the lower bound, as
    violated for the upper one. ``None`` if it is not applicable."""
    minimum_robustness: float | None
    """Minimum robustness; ``None`` without a verdict."""
    is_constant: bool
    """Whether the robustness is the same in all simulations, at least two, although the space
    has axes: nothing that was varied changes it, so ``not violated`` was not tested."""
    counterexample: CheckCounterexample | None
    """The violation with the minimum robustness; ``None`` without one."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CheckCounts:
    """Numbers of simulations of a requirement."""

    simulations: int
    """Number of simulations with a verdict."""
    violated: int
    """Number of these that violate it."""
    without_verdict: int
    """Number of simulations without a verdict."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CheckCounterexample:
    """A violation as evidence."""

    run: str
    """Run file."""
    trial: int
    """Trial."""
    simulation: int
    """Number of the simulation in its trial."""
    seed: int
    """Random seed of the simulation."""
    scenario: tuple[CheckedValue, ...]
    """The scenario beside the nominal one."""
    robustness: float
    """Robustness."""
    file: str | None
    """Counterexample file; ``None`` for a system that the command line cannot simulate."""
    replay: str
    """Command, or call in Python, that simulates it again."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CheckedValue:
    """The value of an axis in a counterexample."""

    axis: str
    """Name of the axis."""
    unit: str
    """Unit; empty without one."""
    value: float | None
    """Value; ``None``: drawn at random."""
    nominal: float | None
    """Value in the undisturbed episode; ``None``: drawn at random."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Check:
    """A file of requirements checked on a target with one or several controllers: a traceability
    matrix. It is evidence from simulations, and no certificate."""

    folder: str
    """Folder of the run files, the counterexamples and the reports."""
    requirements_file: str
    """File of the requirements."""
    requirements_digest: str
    """SHA-256 of this file."""
    title: str | None
    """Title of the file; ``None`` without one."""
    notice: str | None
    """Note for the readers, from the file; ``None`` without one."""
    target: str
    """Name of the target."""
    target_kind: str
    """Kind of the target."""
    fail_on: str
    """Least severity of a violation with exit code 1: ``critical``, ``error`` or ``warning``."""
    allows_inapplicable: bool
    """Whether requirements whose signals the target lacks are accepted."""
    seed: int
    """Seed of all runs."""
    search: str
    """Search for counterexamples."""
    program: str
    """Version of the program."""
    requirements: tuple[CheckedRequirement, ...]
    """The requirements, in the order of the file."""
    controllers: tuple[CheckedController, ...]
    """The controllers, in the given order."""
    cells: tuple[CheckCell, ...]
    """The cells of the matrix: for each requirement, one per controller."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CampaignRun:
    """A finished run of a campaign."""

    name: str
    """Name of the run, and of its file, or of the folder of its hardening, without extension."""
    kind: str
    """Kind of the run: ``evaluate``, ``falsify``, ``margin``, ``metamorphic``, ``risk`` or
    ``harden``."""
    result: Evaluation | Falsification | Margin | Metamorphic | Risk | Hardening
    """The document of that command, without ``schema``."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hardening:
    """A controller before and after a hardening: the final comparison, and how it was reached.

    The measures, the failure probabilities, the margins and the searches are those of the
    final set: scenarios and seeds that are simulated once, after the last decision. No training
    run and no decision used them. The corners of the initial box are the same points everywhere.
    """

    target: str
    """Name of the target."""
    space: str
    """Scenario space in which the controller shall fail less often."""
    seed: int
    """Random seed."""
    before: str
    """Name or path of the controller before."""
    guard: GuardFacts | None = None
    """Guard under which the controllers act and train; left out without one."""
    trainer: str | None = None
    """Command of the trainer of the user; left out if this program trained."""
    after: str | None
    """File of the accepted controller; ``None`` if no round was accepted."""
    folder: str
    """Folder of the runs."""
    commit: str
    """Git commit of the program that began the final comparison."""
    verdict: str
    """The result in a sentence."""
    worse: tuple[str, ...]
    """Names of the measures that are worse after, at 5 % after Holm's correction, and
    ``corners`` if the controller succeeds at fewer of them."""
    measures: tuple[HardenedMeasure, ...]
    """The measures before and after."""
    corners: HardenedCorners | None
    """Corners of the initial box at which all simulations succeed; ``None`` without a box."""
    failure_probability: tuple[Estimate, ...]
    """Failure probability in the space by Monte Carlo, with its Clopper-Pearson interval, before
    and, if a round was accepted, after."""
    margin: tuple[HardenedMargin, ...]
    """Bounds of the smallest disturbance that breaks the controller, before and, if a round was
    accepted, after; empty if the space has starts only."""
    searches: tuple[HardenedSearch, ...]
    """Searches with the same budget, before and, if a round was accepted, after."""
    modes: tuple[HardenedMode, ...]
    """Failure modes of these searches, before and after."""
    archive: HardenedArchive | None
    """Failures that were found and trained on, and how many of them are fixed: no held-out
    measure. ``None`` if no round was accepted."""
    rounds: tuple[HardeningRound, ...]
    """The rounds, in order."""
    environment_steps: int
    """Environment steps of all training runs; 0 with a trainer of the user."""
    simulations: int
    """Simulations of all runs in the folder."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HardenedMeasure:
    """A rate of success before and after."""

    name: str
    """Name: ``space`` (success in the space), ``success``, ``strict`` and ``careful`` (from
    random starts), ``noise`` (from random starts with action noise of 0.5)."""
    before: Estimate
    """Rate before, with its Wilson interval."""
    after: Estimate | None
    """Rate after; ``None`` if no round was accepted."""
    difference: Estimate | None
    """After minus before, with Newcombe's interval for pairs."""
    broken: int
    """Number of pairs in which only the controller before succeeds."""
    fixed: int
    """Number of pairs in which only the controller after succeeds."""
    p_value: float | None
    """Two-sided p-value of the exact McNemar test; ``None`` without a controller after."""
    adjusted_p_value: float | None
    """The p-value, adjusted by Holm's method for all measures."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HardenedCorners:
    """Corners of the initial box before and after."""

    corners: int
    """Number of corners."""
    before: int
    """Number of these at which all simulations succeed, before."""
    after: int | None
    """The same, after; ``None`` if no round was accepted."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HardenedMargin:
    """The smallest disturbance of a controller."""

    amplitude: float | None
    """Amplitude of the smallest disturbance that breaks it; ``None`` if none was found."""
    without_failure: float | None
    """Largest amplitude at which no simulation failed."""
    simulations: int
    """Number of simulations."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HardenedSearch:
    """Searches for failures of a controller."""

    simulations: int
    """Number of simulations."""
    failures: int
    """Number of these that fail."""
    modes: int
    """Number of failure modes."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HardenedMode:
    """A failure mode in the searches of the final comparison."""

    predicate: str
    """Decisive predicate."""
    axes: tuple[str, ...]
    """Axes by which its failures were grouped."""
    change: str
    """``vanished``, ``stayed`` or ``appeared``."""
    before: int
    """Number of its failures before."""
    after: int
    """Number of its failures after."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HardenedArchive:
    """Failures that the searches of the rounds found, simulated again."""

    failures: int
    """Number of failures."""
    fixed: int
    """Number of these that the controller after passes, with the same seed."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HardeningRound:
    """A round of a hardening."""

    number: int
    """Number of the round, from 1."""
    failures: int
    """Failures that its searches found."""
    environment_steps: int
    """Environment steps of its training; 0 if a trainer of the user trained, which does not say."""
    file_hash: str | None = None
    """First 32 digits of the SHA-256 of the file that a trainer of the user wrote; left out
    without one."""
    bound_before: float | None
    """Upper bound of the failure rate in the space before the round, on the validation set."""
    bound_after: float | None
    """The same after the round; ``None`` without a candidate."""
    accepted: bool
    """Whether the round was accepted."""
    reason: str
    """Reason for it, in a sentence."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Campaign:
    """A grid of runs."""

    folder: str
    """Path of the folder."""
    is_complete: bool
    """Whether all runs are complete; ``false`` after an interruption, exit code 130."""
    runs: tuple[CampaignRun, ...]
    """The finished runs."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ComparedRun:
    """A run of a comparison."""

    run: str
    """Path of the run file."""
    controller: str | None
    """Name or path of the controller; ``None`` without one."""
    controller_hash: str | None
    """Hash of what the controller does; ``None`` without one."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    target_hash: str
    """Hash of the target."""
    not_covered: tuple[str, ...]
    """Parts of the target that its hash does not cover, so that an equal hash does not say that
    they are the same."""
    commit: str
    """Git commit of the program that made the run."""
    without_verdict: EndCounts
    """Random simulations without a verdict on success, of the pairs that count. They do not
    count as successes."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairedRates:
    """A rate of both runs."""

    first: Estimate
    """Rate of A, with its Wilson interval, or with one that holds at any time; ``None`` if no
    simulation of A has a verdict."""
    second: Estimate
    """Rate of B, likewise."""
    difference: Estimate
    """B minus A, with Newcombe's interval for pairs, or with one that holds at any time;
    ``None`` if one of the rates is."""
    first_only: int
    """Number of pairs in which only A succeeds."""
    second_only: int
    """Number of pairs in which only B succeeds."""
    p_value: float
    """Two-sided p-value of the exact McNemar test, or of its form that holds at any time."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairedMeans:
    """A mean of both runs."""

    first: float | None
    """Mean of A; ``None`` without pairs."""
    second: float | None
    """Mean of B; ``None`` without pairs."""
    difference: Estimate
    """B minus A, with its bootstrap interval over the pairs."""
    smaller: int
    """Number of pairs in which B's value is smaller."""
    larger: int
    """Number of pairs in which B's value is larger."""
    p_value: float
    """Two-sided p-value of the exact sign test, or of its form that holds at any time."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ComparedPair:
    """A simulation of both runs."""

    trial: int
    """Number of the trial; trial 2 has the corners and the center of the initial box."""
    simulation: int
    """Number of the simulation within the trial."""
    seed: int
    """Random seed of the simulation."""
    scenario: dict[str, Value]
    """Scenario by axis; a value that is drawn at random is missing."""
    first_robustness: float | None
    """Robustness in A; ``None`` without a verdict."""
    second_robustness: float | None
    """Robustness in B; ``None`` without a verdict."""
    replay: str
    """Command that replays the failure."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two evaluations on the same scenarios and seeds, A and B, compared pair by pair.

    The rates and means cover the random simulations. The corners and the center of the
    initial box are not a random sample, so they appear among the new and the fixed failures
    only.
    """

    target: str
    """Name of the target."""
    target_kind: str
    """Kind of the target: ``task``, ``toy``, ``arch``, ``robot``, ``process`` or ``python``."""
    formula: str
    """Formula of success."""
    first: ComparedRun
    """The run A."""
    second: ComparedRun
    """The run B."""
    differences: tuple[str, ...]
    """Facts that differ and can cause differences, as text."""
    sequential: Sequential | None = None
    """The rule that ended both evaluations; missing without one. The difference of the success
    rates and its p-value then hold at any time."""
    at_any_time: bool
    """Whether results decided how many pairs there are. Then the rates, their differences and
    all p-values hold at any time; intervals of means are for a fixed number of pairs, but that
    of a robustness that the rule watches."""
    pairs: int
    """Number of pairs of random simulations that count."""
    left_out: int
    """Number of other pairs: the target cannot start from the scenario in A or in B."""
    success: PairedRates
    """Success rate."""
    strict_success: PairedRates | None
    """Strict success rate; ``None`` if the target has no such formula."""
    careful_success: PairedRates | None = None
    """Careful success rate; missing if one of the runs did not evaluate such a formula."""
    robustness: PairedMeans
    """Robustness, over pairs with two finite values; if a rule watches it, over pairs with two
    values, clipped to the bounds of the rule."""
    dangerous_steps: PairedMeans | None
    """Number of dangerous control steps; ``None`` if the target has no such formula."""
    completion_step: PairedMeans | None
    """Control step of completion, over pairs in which both succeed; ``None`` if the target has
    no such formula."""
    verdict: str
    """Conclusion from the success rates, in a sentence."""
    new_failures: tuple[ComparedPair, ...]
    """Simulations in which A succeeds and B does not; exit code 1 if there are any."""
    fixed_failures: tuple[ComparedPair, ...]
    """Simulations in which B succeeds and A does not."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the scenarios."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DifferingRun:
    """A run of a difference."""

    run: str
    """Path of the run file."""
    digest: str
    """Digest of all trials, simulations and traces, 32 hexadecimal digits."""
    kind: str
    """Kind of the run: ``evaluate``, ``falsify``, ``margin``, ``metamorphic`` or ``risk``."""
    target: str
    """Name of the target."""
    target_kind: str
    """Kind of the target."""
    controller: str
    """Name of the controller; empty without one."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    space: str
    """Scenario space."""
    formula: str
    """Requirement."""
    search: str
    """Search; empty for ``evaluate``."""
    seed: int
    """Seed of the run."""
    simulations: int
    """Number of simulations."""
    failures: int
    """Number of these that violate the requirement."""
    trials: int
    """Number of started trials."""
    falsified_trials: int
    """Number of these that found a counterexample."""
    is_complete: bool
    """Whether all trials have ended."""
    minimum_robustness: float | None
    """Minimum robustness; ``None`` if no simulation has one."""
    commit: str
    """Git commit of the program that made the run."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DifferingFact:
    """A fact in which two runs differ."""

    name: str
    """Subject of the fact, such as ``plan action-noise`` or ``hash of the target``."""
    first: str | None
    """In A; ``None`` if A has no such fact."""
    second: str | None
    """In B; ``None`` if B has no such fact."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DifferingResult:
    """A rate or mean of two runs."""

    name: str
    """Name, such as ``success rate``."""
    is_fraction: bool
    """Whether it is a fraction, from 0 to 1."""
    first: Estimate | None
    """In A, with its interval; ``None`` if A has none."""
    second: Estimate | None
    """In B, with its interval; ``None`` if B has none."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DifferingSimulations:
    """The simulations of two runs, place by place: trial and number."""

    shared: int
    """Number of simulations with the same scenario and seed at the same place."""
    other_scenarios: int
    """Number of places with other scenarios or seeds."""
    first_only: int
    """Number of places that only A has."""
    second_only: int
    """Number of places that only B has."""
    same: int
    """Number of shared simulations that are the same to the bit."""
    changed: int
    """Number of shared simulations with another verdict."""
    changes: tuple[ChangedVerdict, ...]
    """The first of these, at most 100."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ChangedVerdict:
    """A simulation with another verdict in B than in A."""

    trial: int
    """Number of the trial."""
    simulation: int
    """Number of the simulation within the trial."""
    seed: int
    """Random seed."""
    scenario: dict[str, Value]
    """Scenario by axis; a value that is drawn at random is missing."""
    first: str
    """Verdict in A: ``passes``, ``fails``, or the end of a simulation without one."""
    second: str
    """Verdict in B."""
    first_robustness: float | None
    """Robustness in A; ``None`` without a verdict."""
    second_robustness: float | None
    """Robustness in B; ``None`` without a verdict."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunDifference:
    """How two runs differ, A and B."""

    first: DifferingRun
    """The run A."""
    second: DifferingRun
    """The run B."""
    same_records: bool
    """Whether all trials, simulations and traces are the same to the bit; exit code 0. The facts
    may differ nevertheless, such as the commit of the program."""
    facts: tuple[DifferingFact, ...]
    """Facts that differ: keys of the plan, target, controller, axes, formulas, program."""
    results: tuple[DifferingResult, ...]
    """Rates and means of both runs, also equal ones."""
    notes: tuple[str, ...]
    """Why results of a run are missing."""
    simulations: DifferingSimulations
    """The simulations."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the scenarios of A."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExpectedPairs:
    """Expected shares of pairs."""

    both: float
    """Both succeed."""
    first_only: float
    """Only A succeeds."""
    second_only: float
    """Only B succeeds."""
    neither: float
    """Neither succeeds."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SampleSize:
    """How many simulations, or pairs, a question takes: fixed beforehand, and with a rule that
    stops by itself. No target is simulated."""

    until: str
    """The rule: ``decided`` or ``width=W``."""
    rate: float | None = None
    """The rate that ``decided`` compares with; missing without one."""
    margin: float | None = None
    """The largest difference that counts as none; missing without one."""
    expected_rate: float | None = None
    """The expected success rate; missing for pairs."""
    expected_pairs: ExpectedPairs | None = None
    """The expected shares of pairs; missing for a rate."""
    fixed: int | None
    """Smallest number that is fixed beforehand and is enough with a probability of 90 %: the
    usual 5 % test or interval decides rightly, or the interval is as narrow as asked. ``None``
    if it is above the maximum."""
    median: int | None
    """Median number of the rule that stops by itself, from replications of the rule; ``None`` if
    it does not decide in half of them."""
    ninety_percent: int | None
    """Number within which the rule decides in 90 % of the replications; ``None`` if it does not."""
    mean: float
    """Mean number of the rule; a replication without a decision counts the maximum."""
    decided: float
    """Share of the replications in which the rule decides within the maximum."""
    max_simulations: int
    """The maximum."""
    batch: int
    """Number of simulations, or pairs, between two looks of the rule."""
    replications: int
    """Number of replications."""
    seed: int
    """Random seed of the replications."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TablePage:
    """A page of tables."""

    name: str
    """Name of the file without ending."""
    title: str
    """Title."""
    tables: tuple[Table, ...]
    """The tables of the page."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Table:
    """A table."""

    caption: str
    """Caption."""
    columns: tuple[str, ...]
    """Names of the columns."""
    rows: tuple[tuple[str, ...], ...]
    """Rows of cells, as text; names are between backticks."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tables:
    """Tables of campaigns. ``reproduce performance``, ``reproduce falsification`` and
    ``reproduce tables`` print the same document."""

    pages: tuple[TablePage, ...]
    """The pages."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VerifiedUnit:
    """A unit that was run again: a trial of a falsification, or a hundred simulations of an
    evaluation."""

    campaign: str
    """Name of the campaign."""
    run: str
    """Name of the run."""
    trial: int
    """Number of the trial."""
    first: int
    """Number of the first simulation."""
    simulations: int
    """Number of simulations, as recorded."""
    agrees: bool
    """Whether the rows have the recorded digest, and all counts are the same."""
    differences: tuple[str, ...]
    """Each difference as text: name, recorded value, value of the new simulations."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Verification:
    """Units of collected results, run again."""

    commit: str | None
    """Commit at which the digests hold, from the manifest; ``None`` if it names none."""
    program: str
    """Commit of this program."""
    share: float
    """Share of the units."""
    seed: int
    """Seed that chose the units."""
    all_units: int
    """Number of units of the results."""
    agreeing: int
    """Number of units that agree."""
    units: tuple[VerifiedUnit, ...]
    """The units that were run again."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunSummary:
    """A run file. One that cannot be read has the keys ``run`` and ``error`` only."""

    run: str
    """Path of the run file."""
    error: str | None
    """Why the file cannot be read; ``None`` if it can."""
    kind: str | None = None
    """Kind of the run: ``evaluate``, ``falsify``, ``margin``, ``metamorphic`` or ``risk``."""
    target: str | None = None
    """Name of the target."""
    target_kind: str | None = None
    """Kind of the target."""
    controller: str | None = None
    """Name of the controller; empty without one."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    space: str | None = None
    """Scenario space."""
    formula: str | None = None
    """Requirement."""
    search: str | None = None
    """Search; empty for ``evaluate``."""
    seed: int | None = None
    """Seed of the run."""
    simulations: int | None = None
    """Number of simulations."""
    failures: int | None = None
    """Number of these that violate the requirement."""
    trials: int | None = None
    """Number of started trials."""
    falsified_trials: int | None = None
    """Number of these that found a counterexample."""
    is_complete: bool | None = None
    """Whether all trials have ended."""
    minimum_robustness: float | None = None
    """Minimum robustness; ``None`` if no simulation has one."""
    commit: str | None = None
    """Git commit of the program that made the run."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Replay:
    """A recorded simulation, simulated again."""

    run: str
    """Path of the run file, or of the exported counterexample."""
    target: str
    """Target."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    space: str
    """Scenario space."""
    axes: tuple[str, ...]
    """Names of the axes, the order of ``initial_configuration``."""
    trial: int
    """Number of the trial."""
    simulation: int
    """Number of the simulation within the trial."""
    point: str | None
    """``corner`` or ``center`` for a simulation at the corners of the initial box, trial 2 of an
    evaluation; otherwise ``None``."""
    initial_configuration: tuple[float | None, ...]
    """The values of ``scenario`` in the order of ``axes``."""
    scenario: dict[str, Value]
    """Scenario by axis; a value that is drawn at random is missing."""
    seed: int
    """Random seed of the simulation."""
    end: str
    """How the simulation ended, in words."""
    reason: str | None = None
    """Why the simulation ended so, in the words of the target or its controller; missing if they
    said nothing."""
    steps: int
    """Number of control steps."""
    robustness: float | None
    """Robustness of the requirement; ``None`` without a verdict."""
    violated: bool | None
    """Whether the requirement is violated; ``None`` without a verdict. At a robustness of 0,
    ``<=``, ``>=`` and ``==`` hold, and ``<``, ``>`` and ``!=`` do not."""
    same: bool
    """Whether everything recorded of the simulation agrees with the plan of the run and with the
    replay, bit for bit."""
    differences: tuple[str, ...]
    """Each difference as text: name, recorded value, expected or replayed value."""
    formula: str
    """The requirement."""
    has_verdict: bool
    """Whether the end of the simulation allows a verdict."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the scenario space."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogExplanation:
    """A verdict on a log and what decides it."""

    verdict: LogVerdict
    """The verdict."""
    period: float
    """Time between two samples, s."""
    decided: Instant | None
    """First sample after which nothing can change whether the requirement is satisfied; ``None``
    if the trace does not decide it."""
    predicate: Predicate | None
    """Decisive predicate; ``None`` if an operator has an empty window."""
    window: Window | None
    """Samples at which the operator above evaluates the predicate; ``None`` without a predicate."""
    path: tuple[PathStep, ...]
    """Sub-formulas from the requirement to the predicate."""
    conjuncts: tuple[Conjunct, ...]
    """Conjuncts of the requirement."""
    sentences: tuple[str, ...]
    """The explanation in sentences."""
    signals: SignalTable | None
    """Signals of the requirement at some samples; ``None`` without a predicate."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogExplanations:
    """When, where and by which predicate a log violates or satisfies formulas."""

    explanations: tuple[LogExplanation, ...]
    """Each formula on each log, worst first, as in the document of ``monitor``."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvaluatedCount:
    """How many simulations were evaluated."""

    evaluated: int
    """Number of evaluated simulations."""
    total: int
    """Number of simulations of the run."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MaskedConjunct:
    """A conjunct over the simulations of a run."""

    formula: str
    """Text."""
    sets_satisfied: int
    """Number of satisfied simulations whose robustness it sets."""
    sets_violated: int
    """Number of violated simulations whose robustness it sets."""
    fails: int
    """Number of simulations that violate the requirement with this conjunct as the only operand
    of each ``and`` above it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Masking:
    """Which conjuncts of a requirement set the robustness of a run and which ones fail."""

    run: str
    """Path of the run file."""
    formula: str
    """Requirement."""
    satisfied: EvaluatedCount
    """Simulations that satisfy the requirement. None are evaluated if the target cannot be
    simulated."""
    violated: EvaluatedCount
    """Simulations that violate the requirement."""
    conjuncts: tuple[MaskedConjunct, ...]
    """Conjuncts of the requirement."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FailureMode:
    """Failures with the same decisive predicate, similar scenarios and similar times."""

    mode: int
    """Number of the mode, from 1."""
    failures: int
    """Number of its failures."""
    predicate: str
    """Their decisive predicate; empty if the formula has none."""
    samples: tuple[int, int]
    """First and last sample at which the violation of a failure is final."""
    times: tuple[float, float]
    """Times of these samples, s."""
    axes: tuple[str, ...]
    """Names of the axes that matter: those by which failures with this predicate were grouped."""
    region: dict[str, tuple[Value, Value] | None]
    """Smallest and largest value by axis; ``None``: drawn at random."""
    trial: int
    """Number of the trial of the representative, the failure nearest to the nominal scenario."""
    simulation: int
    """Number of the representative within its trial."""
    seed: int
    """Its random seed."""
    scenario: dict[str, Value]
    """Its scenario by axis; a value that is drawn at random is missing."""
    robustness: float
    """Its robustness."""
    distance_from_nominal: float
    """Root mean square of its offsets from nominal over the axes, as fractions of their widths."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Counterexamples:
    """The failure modes of a run."""

    run: str
    """Path of the run file."""
    target: str
    """Target of the run."""
    formula: str
    """Requirement of the run."""
    failures: int
    """Number of simulations that violate the requirement."""
    not_grouped: int
    """Number of these that are in no mode: without a recorded trace, or beyond 5,000."""
    modes: tuple[FailureMode, ...]
    """Failure modes, the one with the most failures first."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the scenario space."""
    control_dt: float
    """Duration of a control step, s."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExportedCounterexample:
    """An exported counterexample."""

    file: str | None
    """Path of the file; ``None`` if it was not written."""
    same_as: str | None
    """Path of a file whose minimized scenario differs by at most 1 % of the width of each axis,
    so that this one was not written; ``None`` if it was."""
    mode: int | None
    """Failure mode; ``None`` with ``--simulation``."""
    trial: int
    """Number of the trial."""
    simulation: int
    """Number of the simulation within the trial."""
    seed: int
    """Random seed of the simulation."""
    scenario: dict[str, Value]
    """Scenario by axis; a value that is drawn at random is missing."""
    robustness: float
    """Robustness of the requirement."""
    predicate: str | None
    """Decisive predicate; ``None`` without one."""
    minimized: Minimized | None
    """The minimization; ``None`` without ``--minimize``."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Minimized:
    """How a counterexample was minimized."""

    scenario: dict[str, Value]
    """Recorded scenario by axis."""
    robustness: float | None
    """Its robustness."""
    axes_off_nominal: tuple[int, int]
    """Number of axes off nominal, recorded and minimized."""
    simulations: int
    """Number of simulations."""
    complete: bool
    """Whether the budget was enough."""
    interrupted: bool
    """Whether a signal ended the minimization or its repeats early."""
    fewest_axes: bool
    """Whether every smaller set of axes passes, with these axes at their recorded values and the
    others at nominal."""
    same_predicate: bool
    """Whether the decisive predicate is the recorded one."""
    repeats: Repeats | None
    """Simulations of the minimized scenario with other seeds; ``None`` without randomness."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Exports:
    """Exported counterexamples."""

    run: str
    """Path of the run file."""
    files: tuple[ExportedCounterexample, ...]
    """The files."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the scenario space."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RegressionTest:
    """A counterexample, simulated again."""

    file: str
    """Name of the file."""
    target: str | None
    """Target; ``None`` if the file is not a counterexample."""
    result: str
    """``passes``, ``still fails`` or ``error``; with ``--baseline`` also ``new failure`` and
    ``fixed``."""
    recorded_robustness: float | None
    """Robustness in the file."""
    robustness: float | None
    """Robustness now, with the recorded seed."""
    predicate: str | None
    """Decisive predicate now."""
    sample: int | None
    """Its sample, from 0."""
    values: tuple[float, float] | None
    """Values of its two sides."""
    same_target: bool | None
    """Whether the target has the recorded hash; ``None`` after an error, if the recorded
    controller cannot be loaded, and if the hash does not cover all of the target."""
    repeats: Repeats | None
    """Simulations with other seeds; ``None`` without ``--repeat``, without randomness and after
    an error."""
    reason: str | None
    """Why the test fails or could not run; ``None`` if it passes."""
    baseline: BaselineTest | None
    """The same simulations with the baseline; ``None`` without ``--baseline``."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BaselineTest:
    """Simulations of a counterexample with the baseline."""

    robustness: float | None
    """Robustness with the recorded seed; ``None`` after an error."""
    repeats: Repeats | None
    """Simulations with other seeds; ``None`` where those of the controller are."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Regression:
    """Counterexamples of a folder, simulated again. The document is printed also if a test could
    not run (exit code 2)."""

    folder: str
    """The folder."""
    controller: str | None
    """The controller; ``None``: that of each counterexample."""
    baseline: str | None
    """The controller of ``--baseline``; ``None`` without it."""
    passes: int
    """Number of tests that pass, with the controller alone."""
    fails: int
    """Number of tests that fail, with the controller alone."""
    errors: int
    """Number of tests that could not run."""
    new_failures: int | None
    """Number of tests that fail but pass with the baseline; ``None`` without ``--baseline``."""
    fixed: int | None
    """Number of tests that pass but fail with the baseline; ``None`` without ``--baseline``."""
    is_complete: bool
    """Whether all tests are finished; ``false`` after an interruption, exit code 130: the others
    are missing."""
    tests: tuple[RegressionTest, ...]
    """The tests, in the order of the file names."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvidenceSigner:
    """The key of a signature."""

    algorithm: str
    """Algorithm of the key as ``ssh-keygen -l`` prints it, such as ``ED25519``."""
    fingerprint: str
    """Fingerprint as ``ssh-keygen -l`` prints it, such as ``SHA256:...``."""
    principals: tuple[str, ...]
    """Names of this key in the file of ``--allowed-signers``: in its first line with the key."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvidenceRun:
    """A run of a folder of evidence."""

    file: str
    """Run file in the folder."""
    page: str
    """Page in the folder."""
    files: str | None
    """Folder with the files of its target and its controllers, in the folder; ``None`` if it
    needs none."""
    target: str
    """Name of the target."""
    simulations: int
    """Number of simulations."""
    is_complete: bool
    """Whether the run is finished."""
    not_replayable: str | None
    """Why its simulations cannot be replayed from the folder alone; ``None`` if they can."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvidenceCheck:
    """A check of requirements in a folder of evidence."""

    folder: str
    """Folder of its requirements, matrix and counterexamples in the folder."""
    verdicts: str
    """Its verdicts, counted in a sentence."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evidence:
    """A folder of evidence that was written: runs with their pages and files, hashes of all, and
    a signature."""

    folder: str
    """Path of the folder."""
    signer: EvidenceSigner | None
    """The key that signed it; ``None`` without a signature."""
    files: int
    """Number of files, without the list of hashes and the signature."""
    bytes: int
    """Their size, in bytes."""
    runs: tuple[EvidenceRun, ...]
    """The runs, in the order in which they were given."""
    checks: tuple[EvidenceCheck, ...]
    """The checks of requirements, whose runs are among them."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VerifiedRun:
    """A run of a folder of evidence, verified."""

    file: str
    """Run file in the folder."""
    simulations: int
    """Number of simulations."""
    chosen: int
    """Number of simulations that the seed chose. Those that a time limit ended are not replayed."""
    replayed: tuple[ReplayedSimulation, ...]
    """The simulations that were replayed."""
    not_replayed: str | None
    """Why none could be replayed; ``None`` if some were, or none was to be."""
    build_differences: tuple[str, ...]
    """Differences between the build that made the run and this program. Results can differ
    between builds."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplayedSimulation:
    """A simulation that was replayed."""

    trial: int
    """Its trial."""
    simulation: int
    """Its number in the trial."""
    differences: tuple[str, ...]
    """Differences between record, plan and replay; empty if they agree to the bit."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VerifiedCheck:
    """A check of requirements, verified."""

    folder: str
    """Its folder in the folder of evidence."""
    verdicts: int
    """Number of verdicts that were derived from the runs again."""
    replayed: int
    """Number of counterexamples that were replayed."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvidenceVerification:
    """A folder of evidence, verified. The document is printed also if the folder differs (exit
    code 1)."""

    folder: str
    """Path of the folder."""
    signature: str
    """``trusted``: the key of the signature is that of ``--public-key`` or one of
    ``--allowed-signers``; ``valid``: the signature fits, but nothing vouches for the key;
    ``missing``; ``wrong``: it does not fit the hashes, or its key is not allowed; ``unchecked``:
    ``ssh-keygen``, which checks signatures, is missing or does not answer."""
    signer: EvidenceSigner | None
    """The key of the signature; ``None`` without one that fits."""
    files: int
    """Number of files whose hashes were compared."""
    problems: tuple[str, ...]
    """Everything wrong with signature, files, manifest, pages and run files; empty if nothing
    is."""
    unverified: tuple[str, ...]
    """Everything that cannot be verified although nothing differs: simulations that cannot be
    replayed, runs that are not finished or empty, a signature without ``ssh-keygen``; empty if
    there is nothing."""
    pages_compared: bool
    """Whether README and pages were made again and compared; ``false`` if another build made
    them."""
    program: str
    """Commit of this program."""
    share: float
    """Share of the simulations that were to be replayed, at least one of each run."""
    seed: int
    """Seed that chose the simulations."""
    runs: tuple[VerifiedRun, ...]
    """The runs; empty if a file differs, because then no run is opened."""
    checks: tuple[VerifiedCheck, ...]
    """The checks of requirements: their verdicts follow from the runs, or a problem says that
    they do not."""
    is_verified: bool
    """Whether all is as it should be: no problem, nothing unverified, no replay that differs,
    and no interruption."""
    is_complete: bool
    """Whether the verification came to its end; ``false`` after an interruption."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BisectedCandidate:
    """A tested candidate of a bisection."""

    place: int
    """Place among the candidates, from 1."""
    name: str
    """Name of the file."""
    controller: str
    """Path of the controller."""
    result: str
    """``passes``, ``fails`` or ``undecided``."""
    success_rate: Estimate | None
    """Of a test by a rate: success rate with an interval that holds at any time; ``None``
    otherwise."""
    simulations: int
    """Number of simulations."""
    reason: str | None
    """Why the candidate fails or is undecided; ``None`` if it passes."""
    run: str | None
    """Of a test by a rate: path of the run file; ``None`` otherwise, or if the candidate cannot
    be loaded."""
    violated: tuple[str, ...]
    """Paths of the counterexamples that the candidate violates."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bisection:
    """The first of an ordered list of controllers that fails a test."""

    folder: str
    """Folder of the finished tests."""
    command: str
    """Command that asks again, and continues after an interruption."""
    test: str
    """Test in words."""
    candidates: tuple[str, ...]
    """Names of all candidates, the oldest first."""
    found: bool
    """Whether the first failing candidate was found: the one just before it passes. Exit code 0."""
    verdict: str
    """Answer in a sentence."""
    last_good: str | None
    """Name of the last candidate that passes before ``first_bad``; ``None`` without an answer."""
    first_bad: str | None
    """Name of the first candidate that fails; ``None`` without an answer. One of ``undecided``
    can fail before it."""
    undecided: tuple[str, ...]
    """Names of the candidates between both. Their tests do not decide, so ``found`` is
    ``false``."""
    is_monotone: bool | None
    """With every candidate tested: whether no candidate passes after one that fails; ``None``
    otherwise."""
    simulations: int
    """Number of simulations of all tested candidates, also of those that were tested earlier."""
    is_complete: bool
    """Whether all tests are finished; ``false`` after an interruption, exit code 130."""
    tested: tuple[BisectedCandidate, ...]
    """The tested candidates, in the order of the candidates."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Demonstrations:
    """A data set of recorded episodes."""

    target: str
    """Name of the target."""
    task: str
    """The same; the older name of ``target``."""
    target_kind: str
    """Kind of the target: ``task``, ``toy``, ``arch``, ``robot``, ``process`` or ``python``."""
    target_hash: str
    """Hash of the target."""
    preset: str | None
    """Task preset; ``None`` if the target is not a task."""
    controller: str | None
    """Name of the controller; ``None`` without one."""
    controller_hash: str | None
    """Hash of what the controller does; ``None`` without one."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    stochastic: bool
    """Whether actions are sampled from the policy's distribution."""
    action_noise: float
    """Standard deviation of the noise that is added to actions."""
    observation_noise: float
    """Standard deviation of the noise that is added to observations."""
    seed: int
    """Seed of the plan, from which the seeds of simulations are derived. For ``simulate``, and
    for ``margin`` of a target without noise, it is the seed of the simulations themselves; only
    those of repeats are derived from it."""
    space: str
    """Name of the scenario space."""
    axes: tuple[str, ...]
    """Names of its axes, the order of ``initial_configuration``."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the space in the same order."""
    set_axes: tuple[str, ...]
    """Names of the axes whose range the plan sets."""
    control_dt: float
    """Duration of a control step, s."""
    episode_steps: int
    """Number of control steps of a whole episode."""
    folder: str
    """Folder of the data set."""
    format: str
    """Its format: ``lerobot`` or ``npz``."""
    relabel: str | None
    """Controller whose action in each state is recorded, by its name or its path; ``None`` if it
    is the one that acts."""
    archive: str | None = None
    """Failures from which scenarios were drawn: the path of a file or folder; left out without
    them."""
    archived: int
    """Number of simulations with a scenario of the archive."""
    simulations: int
    """Number of simulations."""
    episodes: int
    """Number of episodes in the data set."""
    frames: int
    """Number of frames of all episodes: one per control step."""
    successes: int
    """Number of episodes that satisfy the success formula."""
    left_out: int
    """Number of simulations that are not in the data set: without a control step, or without
    success if only successful episodes are kept."""
    bytes: int
    """Size of all files, bytes."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainingTime:
    """Time until the return of a training run converged."""

    environment_steps: int
    """Number of control steps over all environments."""
    control_steps: int
    """Number of control steps per environment."""
    secs: float
    """Wall-clock time, s."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScenarioRates:
    """Rates of a validation on scenarios."""

    success_rate: float
    """Success rate."""
    strict_success_rate: float
    """Strict success rate."""
    mean_return: float
    """Mean undiscounted return."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Training:
    """A finished training run."""

    task: str
    """Task."""
    algorithm: str
    """Training algorithm."""
    device: str
    """Device of the physics of the training episodes: ``cpu`` or ``gpu``."""
    seed: int
    """Seed of the training run."""
    environments: int
    """Number of parallel environments."""
    environment_steps: int
    """Number of control steps over all environments."""
    best_environment_steps: int
    """Number of these until the best policy."""
    wall_clock_secs: float
    """Wall-clock time, s."""
    stopped_early: bool
    """Whether the validation criterion stopped the training run early."""
    stop_condition: str | None
    """That criterion in words; ``None`` if it did not stop the training run."""
    training_time: TrainingTime | None
    """Time until the return converged; ``None`` if it did not converge, or without ``--csv``."""
    no_training_time: str | None
    """Why there is no training time; ``None`` with one."""
    success_rate: float | None
    """Success rate of the best policy in validation, on random starts without disturbances;
    ``None`` without validation, and if no episode has a verdict."""
    strict_success_rate: float | None
    """Strict success rate of the best policy in the same validation; ``None`` without
    validation, and if no episode has a verdict."""
    space: ScenarioRates | None
    """Its validation on random scenarios of the space; ``None`` without a space, and without a
    verdict."""
    corners: ScenarioRates | None
    """Its validation at corners of the space; ``None`` without a space, and without a verdict."""
    controller_hash: str
    """Hash of the best policy."""
    best: str
    """Path of the best controller."""
    last: str
    """Path of the last controller."""
    csv: str | None
    """Path of the learning curve; ``None`` without ``--csv``."""
    tensorboard: str | None
    """Path of the folder for TensorBoard; ``None`` without ``--tensorboard``."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainingPlan:
    """A checked plan of a training run, which was not started."""

    task: str
    """Task."""
    algorithm: str
    """Training algorithm."""
    reward: str
    """Reward."""
    device: str
    """Device of the physics of the training episodes: ``cpu`` or ``gpu``."""
    seed: int
    """Seed of the training run."""
    environment_steps: int
    """Number of control steps over all environments, rounded up to whole iterations."""
    command: str
    """Command of the training run."""
    settings: str
    """All settings, as TOML."""
    task_hash: str
    """Hash of the task."""
    layout_hash: str
    """Hash of its layout of observations and actions."""
    formats: dict[str, int]
    """Format version of controller files by kind of policy."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class GuardAlarms:
    """Alarms of a guard that only watches."""

    seed: int
    """Seed of the evaluation."""
    failures: int
    """Number of scenarios in which the controller alone violates the requirement."""
    successes: int
    """Number of scenarios in which it satisfies the requirement."""
    without_verdict: int
    """Number of scenarios without a verdict, which count nowhere here."""
    missed: Estimate
    """Share of failures without an alarm before the failure is certain, with its Wilson
    interval."""
    late: int
    """Number of these with a later alarm."""
    false_alarms: Estimate
    """Share of successes with an alarm, with its Wilson interval."""
    area: Estimate
    """Probability that the least robustness of a failure is below that of a success: 1 if all
    failures are below all successes, 0.5 by chance."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AlarmLead:
    """Time from an alarm to the certain failure: the first sample at which no continuation
    satisfies the requirement."""

    n: int
    """Number of failures with an alarm in time."""
    median: float
    """Median, s."""
    low: float
    """10 % quantile, s."""
    high: float
    """90 % quantile, s."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class GuardCurvePoint:
    """A threshold, and its alarms in the training scenarios."""

    threshold: float
    """Threshold, in the unit of the guard's formula."""
    missed: int
    """Number of failures without an alarm in time."""
    false_alarms: int
    """Number of successes with an alarm."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class GuardTuning:
    """A guard whose threshold was chosen on training scenarios, measured on held-out ones.

    An alarm is a robustness of the guard's formula below the threshold. Alarms are counted
    where the guard only watches, so that they do not change what happens.
    """

    target: str
    """Name of the target."""
    task: str
    """The same; the older name of ``target``."""
    target_kind: str
    """Kind of the target: ``task``, ``toy``, ``arch``, ``robot``, ``process`` or ``python``."""
    target_hash: str
    """Hash of the target."""
    preset: str | None
    """Task preset; ``None`` if the target is not a task."""
    controller: str | None
    """Name of the controller; ``None`` without one."""
    controller_hash: str | None
    """Hash of what the controller does; ``None`` without one."""
    guard: GuardFacts | None = None
    """Guard of the controller; left out without one."""
    stochastic: bool
    """Whether actions are sampled from the policy's distribution."""
    action_noise: float
    """Standard deviation of the noise that is added to actions."""
    observation_noise: float
    """Standard deviation of the noise that is added to observations."""
    seed: int
    """Seed of the plan, from which the seeds of simulations are derived. For ``simulate``, and
    for ``margin`` of a target without noise, it is the seed of the simulations themselves; only
    those of repeats are derived from it."""
    space: str
    """Name of the scenario space."""
    axes: tuple[str, ...]
    """Names of its axes, the order of ``initial_configuration``."""
    space_axes: tuple[AxisFacts, ...]
    """The axes of the space in the same order."""
    set_axes: tuple[str, ...]
    """Names of the axes whose range the plan sets."""
    control_dt: float
    """Duration of a control step, s."""
    episode_steps: int
    """Number of control steps of a whole episode."""
    folder: str
    """Folder with the run files and the guard."""
    guard_file: str
    """Path of the guard with the chosen threshold."""
    requirement: str
    """Formula whose violation is a failure."""
    false_alarm_limit: float
    """Largest allowed share of successful training scenarios with an alarm."""
    verdict: str
    """Conclusion from the held-out scenarios, in sentences."""
    training: GuardAlarms
    """Alarms in the training scenarios, on which the threshold was chosen: they flatter the
    guard."""
    held_out: GuardAlarms
    """Alarms in the held-out scenarios."""
    lead: AlarmLead | None
    """Time from an alarm to the certain failure in the held-out scenarios; ``None`` without an
    alarm before a failure."""
    guarded: PairedRates
    """Success in the held-out scenarios: A is the controller alone, B the guarded controller.
    ``second_only`` counts saved scenarios, ``first_only`` broken ones."""
    fallback: PairedRates
    """Success in the held-out scenarios: A is the controller alone, B the fallback alone."""
    curve: tuple[GuardCurvePoint, ...]
    """Missed failures and false alarms of all thresholds in the training scenarios."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Validation:
    """Validation of a policy during training."""

    episodes: int
    """Number of episodes."""
    success_rate: float
    """Success rate."""
    strict_success_rate: float
    """Strict success rate."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Controller:
    """A controller file."""

    task: str
    """Task."""
    algorithm: str
    """Training algorithm."""
    preset: str
    """Task preset."""
    reward: str
    """Reward."""
    seed: int
    """Seed of the training run."""
    environment_steps: int
    """Number of control steps of the training run until this policy."""
    wall_clock_secs: float
    """Wall-clock time of the training run, s."""
    git_commit: str
    """Git commit of the program; empty if it is unknown."""
    command: str
    """Command of the training run; empty if it is unknown."""
    validation: Validation | None
    """Validation of the policy during training; ``None`` without one."""
    policy: str
    """Kind of policy."""
    sizes: tuple[int, ...]
    """Layer sizes."""
    controller_hash: str
    """Hash of what the controller does."""
    task_hash: str
    """Hash of the task."""
    layout_hash: str
    """Hash of the layout of observations and actions."""
    settings: str
    """The training settings, as TOML."""
    weaknesses: tuple[str, ...]
    """Known weaknesses of a shipped controller ``TASK/NAME``, from the notes on its task."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ControllerExport:
    """An exported controller."""

    file: str
    """The ONNX file."""
    task: str
    """Task."""
    algorithm: str
    """Training algorithm."""
    controller_hash: str
    """Hash of the controller."""
    observation_size: int
    """Number of values of an observation."""
    action_size: int
    """Number of values of an action."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ControllerImport:
    """A controller made from the weights of another tool."""

    file: str
    """The controller file."""
    task: str
    """Its task."""
    source: str
    """The imported file and the library that wrote it."""
    sizes: tuple[int, ...]
    """Layer sizes."""
    hidden_activation: str
    """Activation of the hidden layers."""
    output_activation: str
    """Activation of the last layer."""
    layer_norm: bool
    """Whether it has layer normalization."""
    normalized: bool
    """Whether it normalizes observations."""
    observation_clip: float | None
    """Limit of normalized observations; ``None`` without one."""
    controller_hash: str
    """Hash of the controller."""


def build(kind: type[_T], document: Mapping[str, Any]) -> _T:
    """Makes a result of a type from a parsed document.

    Seeds become integers, infinities numbers, arrays tuples. A scenario has the names of categories, and leaves out values that are
    drawn at random. Keys that the type does not have are ignored: a later version
    of the program may have added them.
    """
    return _build(kind, _named(document, {}))


def _build(kind: type[_T], document: Mapping[str, Any]) -> _T:
    fields, hints = dataclasses.fields(cast("Any", kind)), _hints(cast("Any", kind))
    known = [field.name for field in fields if field.name in document]
    return kind(**{name: _value(hints[name], document[name]) for name in known})


@functools.lru_cache(maxsize=None)
def _hints(kind: Any) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _named(value: Any, axes: Mapping[str, Any]) -> Any:
    """Returns a part of a document with the values of axes as Python has them. ``axes`` are the facts of each axis."""
    if isinstance(value, list):
        return [_named(item, axes) for item in value]
    if not isinstance(value, Mapping):
        return value
    if "space_axes" in value:
        axes = {axis["name"]: axis for axis in value["space_axes"]}
    named = {key: _named(item, axes) for key, item in value.items()}
    if isinstance(named.get("scenario"), dict):
        drawn = named["scenario"].items()
        named["scenario"] = {axis: _axis_value(axes.get(axis), number) for axis, number in drawn if number is not None}
    if isinstance(named.get("region"), dict):
        regions = named["region"].items()
        named["region"] = {axis: ends and [_axis_value(axes.get(axis), end) for end in ends] for axis, ends in regions}
    return named


def _axis_value(axis: Mapping[str, Any] | None, number: float) -> Value:
    values = None if axis is None else axis["values"]
    if axis is not None and isinstance(values, list):
        # The first name is that of the lower bound.
        return cast("str", values[int(number - axis["low"])])
    return int(number) if values == "integer" else number


def _value(hint: Any, value: Any) -> Any:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if value is None:
        return None
    if origin is typing.Union or origin is types.UnionType:
        return _alternative([kind for kind in arguments if kind is not type(None)], value)
    if origin is tuple:
        items = arguments[:1] * len(value) if Ellipsis in arguments else arguments
        return tuple(_value(kind, item) for kind, item in zip(items, value, strict=True))
    if origin is dict:
        return {name: _value(arguments[1], item) for name, item in value.items()}
    if dataclasses.is_dataclass(hint):
        return _build(cast("type[Any]", hint), value)
    # Seeds and infinities are strings.
    return hint(value) if hint in (int, float) else value


def _alternative(kinds: Sequence[Any], value: Any) -> Any:
    if len(kinds) == 1:
        return _value(kinds[0], value)
    if isinstance(value, Mapping):
        return _build(next(kind for kind in kinds if _has_keys(kind, cast("Mapping[str, Any]", value))), value)
    return _frozen(value)


def _has_keys(kind: Any, document: Mapping[str, Any]) -> bool:
    required = [field.name for field in dataclasses.fields(kind) if field.default is dataclasses.MISSING]
    return all(name in document for name in required)


def _frozen(value: Any) -> Any:
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value
