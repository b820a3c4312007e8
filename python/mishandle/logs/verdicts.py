"""Verdicts of formulas on logs: when a formula is violated, how long, and by which part."""

import dataclasses
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Union

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.documents import Plan
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.logs.formulas import Formula
from mishandle.logs.recordings import Reading
from mishandle.logs.sources import NativeLog, native_logs

Formulas = Union[str, Formula, Sequence[Union[str, Formula]], Mapping[str, Union[str, Formula]]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Monitoring(results.Monitor):
    """Verdicts of formulas on logs, as the document of ``mishandle monitor --json``; ``str`` gives
    its text: a table, worst first, or sentences about one formula on one log."""

    without_verdict: tuple[str, ...] = ()
    """Why formulas have no verdict on a log, such as a missing signal. An absent verdict is no
    satisfaction."""
    text: str = ""

    def __str__(self) -> str:
        return "\n".join([self.text, *(f"no verdict: {reason}" for reason in self.without_verdict)])


def monitor(formulas: Formulas, log: Any, *, plan: Plan | None = None) -> Monitoring:
    """Returns the verdicts of formulas on logs, worst first.

    ``verdicts`` has one for each formula and log, with ``violations`` (first and last time,
    duration, least robustness), ``worst_part`` and the deciding ``predicate``.
    ``pandas.DataFrame(found.verdicts)`` is a table.

    Parameters
    ----------
    formulas : str, Formula, sequence of them, or dict from name to formula
    log : log, or list, tuple or iterator of logs
        A path (a table or recording, as for :func:`mishandle.read_log`), a
        :class:`mishandle.logs.Log`, or columns in memory: a dictionary of arrays, a data frame, a
        result of :func:`mishandle.simulate`. A LeRobot data set is several logs. A dictionary from
        names to files, or to columns in memory, is one log with these topics.
    plan : dict, optional
        Rare settings: the table ``log`` says how a log is read, such as ``{"log": {"period":
        0.1}}``; ``mishandle monitor --help`` lists its keys. ``{"monitor": {"values": True}}``
        returns the robustness of the first formula over time as ``robustness_signal`` and
        ``robustness_times``.

    Examples
    --------
    >>> found = monitor(
    ...     "always(force <= 2)", {"time": [0.0, 0.5, 1.5], "force": [1.0, 3.0, 1.0]},
    ...     plan={"log": {"dense": "linear"}}
    ... )
    >>> [(part.start, part.end, part.worst) for part in found.verdicts[0].violations]
    [(0.25, 1.0, -1.0)]
    """
    parsed = _parsed(formulas)
    reading = Reading("monitor", plan)
    sources: list[tuple[NativeLog, list[int]]] = []
    lacking: list[str] = []
    for each in log if isinstance(log, (list, tuple, Iterator)) else [log]:
        found, readable, errors = _readable(parsed, each, reading)
        lacking += errors
        sources += [(source, readable) for source in found]
    if not sources:
        raise InvalidValueError("there is no log")
    named = [
        ((name or f"log {number}", files, topics), readable)
        for number, ((name, files, topics), readable) in enumerate(sources, 1)
    ]
    asked = [(name, formula.native) for name, formula in parsed]
    document, text, without = _native.monitor(asked, named, reading.call)
    return dataclasses.replace(
        results.build(Monitoring, json.loads(document)), text=text,
        without_verdict=(*lacking, *without)
    )


def _columns(
    formulas: Sequence[tuple[str | None, Formula]], log: Any, reading: Reading
) -> list[NativeLog]:
    signals = list(dict.fromkeys(signal for _, formula in formulas for signal in formula.signals))
    return list(native_logs(log, signals, lambda known: _hint(formulas, known), reading))


def _readable(
    formulas: Sequence[tuple[str | None, Formula]], log: Any, reading: Reading
) -> tuple[list[NativeLog], list[int], list[str]]:
    """Returns a log, the positions of the formulas whose signals it has, and why the others have no
    verdict."""
    try:
        return _columns(formulas, log, reading), list(range(len(formulas))), []
    except InvalidValueError:
        readable, errors = [], []
        for index, formula in enumerate(formulas):
            try:
                _columns([formula], log, reading)
                readable.append(index)
            except InvalidValueError as lacking:
                errors.append(f"{formula[0] or formula[1]}: {lacking}")
        if not readable:
            raise
        return _columns([formulas[index] for index in readable], log, reading), readable, errors


def _parsed(formulas: Formulas) -> list[tuple[str | None, Formula]]:
    if isinstance(formulas, Mapping):
        named: list[tuple[str | None, str | Formula]] = [
            (str(name), formula) for name, formula in formulas.items()
        ]
    elif isinstance(formulas, (str, Formula)):
        named = [(None, formulas)]
    elif isinstance(formulas, os.PathLike):
        raise InvalidTypeError(
            "formulas are texts; `mishandle monitor --requirements` reads a file of requirements"
        )
    else:
        named = [(None, formula) for formula in formulas]
    if not named:
        raise InvalidValueError("there is no formula")
    return [
        (name, formula if isinstance(formula, Formula) else Formula(formula))
        for name, formula in named
    ]


def _hint(formulas: Sequence[tuple[str | None, Formula]], known: list[str]) -> str | None:
    return next(
        (hint for _, formula in formulas if (hint := formula.hint(known)) is not None), None
    )
