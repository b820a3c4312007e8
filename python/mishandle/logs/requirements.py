"""Formulas that engineers write: in words, with their traps, from patterns, and with mined
parameters."""

import dataclasses
import json
from collections.abc import Iterator, Mapping
from typing import Any, Union

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.documents import Plan
from mishandle.errors import InvalidValueError
from mishandle.logs.formulas import Formula
from mishandle.logs.recordings import Reading
from mishandle.logs.sources import Hint, native_logs

Range = Union[tuple[float, float], tuple[float, float, str]]
"""Least and greatest value of a parameter; a bound of a window has a unit."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FormulaDescription(results.FormulaDescription):
    """A formula in words with its traps, as the document of ``mishandle formula --json``; ``str``
    gives its text with the drawing."""

    text: str = ""

    def __str__(self) -> str:
        return self.text


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mining(results.Mining):
    """The tightest values of parameters, as the document of ``mishandle formula --parameter
    --json``; ``str`` gives its text."""

    text: str = ""

    def __str__(self) -> str:
        return self.text


def formula(
    formula: str | Formula, log: Any = (), *, units: Mapping[str, str] | None = None,
    plan: Plan | None = None
) -> FormulaDescription:
    """Returns a formula in words, with its known traps, drawn over logs or over two traces that are
    found for it.

    Parameters
    ----------
    formula : str or Formula
    log : log, or list, tuple or iterator of logs, optional
        As for :func:`mishandle.monitor`. Without one, the examples are a trace that satisfies the
        formula and one that violates it.
    units : dict, optional
        Units by the names of signals. By default those of the endings of names, such as ``_deg``.
    plan : dict, optional
        Rare settings: how the log is read, as for :func:`mishandle.monitor`, and ``{"formula":
        {"episode": SECONDS}}``, the duration with which the windows are compared.

    Examples
    --------
    >>> [trap.name for trap in formula("always p >= 1 implies q >= 1").traps]
    ['precedence']
    """
    text = str(formula) if isinstance(formula, Formula) else formula
    reading = Reading("formula", plan)
    parsed = Formula(text)
    named = _logs(log, parsed.signals, parsed.hint, reading)
    document, shown = _native.describe_formula(text, named, reading.call, dict(units or {}))
    return dataclasses.replace(results.build(FormulaDescription, json.loads(document)), text=shown)


def pattern(name: str, **settings: object) -> str:
    """Returns the formula of a pattern of requirements with these values of its parameters.

    The page ``docs/reference/patterns.md`` has all patterns.

    Examples
    --------
    >>> pattern("response", p="x >= 1", q="y <= 0.1", deadline="2s")
    'always(x >= 1 implies eventually[0s:2s](y <= 0.1))'
    """
    text, _ = _native.pattern_formula(name, [(key, str(value)) for key, value in settings.items()])
    return text


def mine(
    formula: str, parameters: Mapping[str, Range], log: Any, *, plan: Plan | None = None
) -> Mining:
    """Returns the tightest values of the parameters of a formula for which logs satisfy it.

    Parameters
    ----------
    formula : str
        The names of the parameters are numbers in it, or bounds of windows.
    parameters : dict from name to (low, high) or (low, high, unit)
    log : log, or list, tuple or iterator of logs
        As for :func:`mishandle.monitor`.
    plan : dict, optional
        Rare settings: how the log is read, as for :func:`mishandle.monitor`, and in the table
        ``formula``: ``share`` of the logs that must satisfy the formula (1), number of ``points``
        of the Pareto front of several parameters (10), and ``resolution``, the steps by the names
        of parameters. By default values are exact, and bounds are multiples of the sampling period.

    Examples
    --------
    >>> mine(
    ...     "always(force <= limit)", {"limit": (0, 50)}, {"force": [1.0, 7.5, 3.0]}
    ... ).points[0].values
    (7.5,)
    """
    reading = Reading("mine", plan)
    ranges = []
    for name, given_range in parameters.items():
        low, high, *rest = given_range
        ranges.append((name, float(low), float(high), rest[0] if rest else None))
    signals = _native.mined_signals(formula, ranges, reading.call)
    named = _logs(log, signals, lambda known: None, reading)
    if not named:
        raise InvalidValueError("there is no log")
    document, text = _native.mine(formula, ranges, named, reading.call)
    return dataclasses.replace(results.build(Mining, json.loads(document)), text=text)


def _logs(log: Any, signals: list[str], hint: Hint, reading: Reading) -> list[Any]:
    sources = [
        source
        for each in (log if isinstance(log, (list, tuple, Iterator)) else [log])
        for source in native_logs(each, signals, hint, reading)
    ]
    return [
        (name or f"log {number}", files, topics)
        for number, (name, files, topics) in enumerate(sources, 1)
    ]
