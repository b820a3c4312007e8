"""Formulas of signal temporal logic."""

import re
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.base.documents import Plan
from mishandle.base.traces import columns_of
from mishandle.errors import InvalidValueError
from mishandle.logs.recordings import Reading
from mishandle.logs.sources import native_logs
from mishandle.logs.violations import violation


_DISTANCE = re.compile(
    r"abs\((?P<name>`(?:[^`]|``)*`|[^\s`()]+)(?: (?P<center>[+-] [0-9.e+-]+))?\)", re.DOTALL
)
"""Distance of a signal from a number, such as ``abs(x - 3)``."""


class Formula:
    """A formula over named signals.

    Parameters
    ----------
    text : str
        Text in RTAMT's syntax, such as ``"always[0:10](x <= 1)"``. Bounds without a unit count
        samples. A name that is no plain word stands in backquotes: ``"`/joint[0]` <= 1"``.

    Examples
    --------
    >>> formula = Formula("always(x <= 1)")
    >>> formula.signals
    ['x']
    >>> formula.robustness({"x": [0.5, 0.2, 0.75]})
    0.25
    """

    def __init__(self, text: str) -> None:
        self.native = _native.Formula(text)
        if self.native.chains_comparisons:
            warnings.warn(
                "comparisons do not chain: `0.2 <= v <= 0.3` means `(0.2 <= v) <= 0.3`, as in "
                f"RTAMT; write `0.2 <= v and v <= 0.3`. The formula is {text}",
                stacklevel=2,
            )
        for name in self.native.unused_definitions:
            warnings.warn(
                f"no statement reads the definition `{name}`; the formula is {self}", stacklevel=2
            )

    @property
    def signals(self) -> list[str]:
        """Names of its signals."""
        return self.native.signals

    @property
    def needs_period(self) -> bool:
        """Whether a bound is a time other than 0, so that the time between two samples matters.

        >>> Formula("always[0:2s](x <= 1)").needs_period, Formula(
        ...     "always[0:2](x <= 1)"
        ... ).needs_period
        (True, False)
        """
        return self.native.needs_period

    @property
    def subformulas(self) -> "list[Formula]":
        """Its sub-formulas: the formula itself first, then depth first.

        >>> [str(part) for part in Formula("always(x <= 1 and y > 0)").subformulas]
        ['always(x <= 1 and y > 0)', 'x <= 1 and y > 0', 'x <= 1', 'y > 0']
        """
        return [Formula(text) for text in self.native.subformulas]

    @property
    def symbols(self) -> str:
        """The formula in mathematical symbols.

        >>> Formula("always(x <= 1)").symbols
        '□(x ≤ 1)'
        """
        return self.native.symbols

    def robustness(
        self, log: Any, *, decided_only: bool = False, plan: Plan | None = None
    ) -> float | None:
        """Returns the robustness at the first time; ``None`` if ``decided_only`` and the log is too
        short.

        Parameters
        ----------
        log : path, Log, dict of arrays, data frame or Simulation
            As for :func:`mishandle.monitor`, which also says when the formula is violated. Numbers
            in a column ``time`` are the times.
        decided_only : bool
            Whether windows that reach past the end of the log leave the formula undecided. By
            default they are cut, as RTAMT does.
        plan : dict, optional
            Rare settings: how the log is read, as for :func:`mishandle.monitor`. Formulas with a
            unit in their bounds need times in the log or ``{"log": {"period": SECONDS}}``.
        """
        reading = Reading("robustness", plan)
        sources = list(native_logs(log, self.signals, self.hint, reading))
        if len(sources) != 1:
            raise InvalidValueError(
                f"{log} has {len(sources)} logs; ask mishandle.monitor for the verdict on each"
            )
        return _native.log_robustness(self.native, sources[0], reading.call, decided_only)

    def hint(self, names: list[str]) -> str | None:
        """Checks the names of the columns of a log; returns a hint if it lacks a signal."""
        return self.native.hint(names)

    def robustness_signal(
        self, trace: Any, *, period: float | None = None, decided_only: bool = False
    ) -> NDArray[np.float64]:
        """Returns the robustness at each sample.

        >>> Formula("x <= 1").robustness_signal({"x": [0.5, 2.0]}).tolist()
        [0.5, -1.0]
        """
        return self._signal(self._columns(trace), period, decided_only)

    def robustness_bounds(self, trace: Any, *, period: float | None = None) -> tuple[float, float]:
        """Returns the least and the greatest robustness at the first sample over all continuations
        of a trace.

        A window without an end is that of the trace. The bounds can be wider than necessary,
        because the unknown samples of two operands count as independent.

        >>> Formula("always[0:9](x <= 1)").robustness_bounds({"x": [0.0, 3.0, 0.5]})
        (-inf, -2.0)
        """
        columns = self._columns(trace)
        samples = np.column_stack(list(columns.values()))
        return self.native.robustness_bounds(list(columns), samples, self._period(period))

    def subformula_signals(
        self, trace: Any, *, period: float | None = None, decided_only: bool = False
    ) -> dict[str, NDArray[np.float64]]:
        """Returns the robustness of each sub-formula at each sample, by its text, in the order of
        :attr:`subformulas`.

        >>> found = Formula("always(x <= 1 or y >= 2)").subformula_signals({
        ...     "x": [0, 3, 2], "y": [0, 4, 1]
        ... })
        >>> lists = {text: signal.tolist() for text, signal in found.items()}
        >>> lists  # doctest: +NORMALIZE_WHITESPACE
        {'always(x <= 1 or y >= 2)': [-1.0, -1.0, -1.0], 'x <= 1 or y >= 2': [1.0, 2.0, -1.0],
         'x <= 1': [1.0, -2.0, -1.0], 'y >= 2': [-2.0, 2.0, -1.0]}
        """
        columns = self._columns(trace)
        return {
            str(part): part._signal(columns, period, decided_only) for part in self.subformulas
        }

    def thresholds(self, *, period: float = 1.0) -> list[tuple[str, float]]:
        """Returns each signal that is compared with a number, and the number. ``abs(x - 3) <= 1``
        has the numbers 2 and 4.

        >>> Formula("always(abs(x - 3) <= 1 and 0.5 < y)").thresholds()
        [('x', 2.0), ('x', 4.0), ('y', 0.5)]
        """
        names = {_native.spelled(name): name for name in self.signals}
        found: list[tuple[str, float]] = []
        for _, _, _, sides in self.native.nodes(period):
            if sides is None:
                continue
            for term, other in (sides, sides[::-1]):
                try:
                    number = float(other)
                except ValueError:
                    continue
                distance = _DISTANCE.fullmatch(term)
                if term in names:
                    found.append((names[term], number))
                elif distance is not None and distance["name"] in names:
                    name = names[distance["name"]]
                    center = float(
                        (distance["center"] or "0").replace("- ", "-").replace("+ ", "+")
                    )
                    found += [(name, -center - number), (name, -center + number)]
        return found

    def violation(self, trace: Any, *, period: float | None = None) -> NDArray[np.bool_]:
        """Returns which samples make the trace violate the formula; none of a trace that satisfies
        it.

        These are the samples inside the time windows at which comparisons have the wrong value. If
        something never happens that eventually should, it is the whole window. For ``until``,
        ``since`` and other operators between two formulas over time, it is the sample at which the
        operator itself is violated.

        >>> Formula("always[1:3](x <= 1)").violation({"x": [5, 0, 2, 1, 7]}).tolist()
        [False, False, True, False, False]
        >>> Formula("eventually[0:1](x > 1)").violation({"x": [0, 0.5, 2]}).tolist()
        [True, True, False]
        """
        columns = self._columns(trace)
        values = [part._signal(columns, period, False) for part in self.subformulas]
        return violation(self.native.nodes(self._period(period)), values)

    def _signal(
        self, columns: dict[str, NDArray[np.float64]], period: float | None, decided_only: bool
    ) -> NDArray[np.float64]:
        samples = np.column_stack(list(columns.values()))
        return self.native.robustness_signal(
            list(columns), samples, self._period(period), decided_only
        )

    def _period(self, given: float | None) -> float | None:
        if given is None and self.native.needs_period:
            raise InvalidValueError(
                f"`{self}` has bounds in units of time; pass the time between two samples as "
                "period, in seconds (columns with times are not read)"
            )
        return given

    def _columns(self, trace: Any) -> dict[str, NDArray[np.float64]]:
        return columns_of(trace, self.signals, self.hint)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Formula) and str(self) == str(other)

    def __hash__(self) -> int:
        return hash(str(self))

    def __str__(self) -> str:
        return str(self.native)

    def __repr__(self) -> str:
        return f"Formula({str(self)!r})"


def robustness(formula: str | Formula, log: Any, *, plan: Plan | None = None) -> float | None:
    """Returns the robustness of a formula on a log: positive if it is satisfied, negative if it is
    violated.

    The log is a path, a :class:`mishandle.logs.Log`, or columns in memory, and ``plan`` says how it
    is read, as for :func:`mishandle.monitor`.

    >>> robustness("eventually(x >= 3)", {"x": [1.0, 2.5]})
    -0.5
    """
    parsed = formula if isinstance(formula, Formula) else Formula(formula)
    return parsed.robustness(log, plan=plan)
