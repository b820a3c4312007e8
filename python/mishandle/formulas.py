"""Formulas of signal temporal logic."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mishandle import _native
from mishandle.systems import columns_of


class Formula:
    """A formula over named signals.

    Parameters
    ----------
    text : str
        Text in RTAMT's syntax, such as ``"always[0:10](x <= 1)"``. Bounds without a unit count samples.

    Examples
    --------
    >>> formula = Formula("always(x <= 1)")
    >>> formula.signals
    ['x']
    >>> formula.robustness({"x": [0.5, 0.2, 0.75]})
    0.25
    """

    def __init__(self, text: str) -> None:
        self._native = _native.Formula(text)

    @property
    def signals(self) -> list[str]:
        """Names of its signals."""
        return self._native.signals

    @property
    def subformulas(self) -> list[Formula]:
        """Its sub-formulas, the formula itself last."""
        return [Formula(text) for text in self._native.subformulas]

    @property
    def symbols(self) -> str:
        """The formula in mathematical symbols.

        >>> Formula("always(x <= 1)").symbols
        '□(x ≤ 1)'
        """
        return self._native.symbols

    def robustness(self, trace: Any, *, period: float = 1.0, decided_only: bool = False) -> float | None:
        """Returns the robustness at the first sample; ``None`` if ``decided_only`` and the trace is too short.

        Parameters
        ----------
        trace : dict of arrays or data frame
            One column per signal.
        period : float
            Time between two samples, in seconds. It matters for bounds with a unit.
        decided_only : bool
            Whether windows that reach past the end of the trace leave the formula undecided. By default they are cut, as
            RTAMT does.
        """
        found = self.robustness_signal(trace, period=period, decided_only=decided_only)
        return float(found[0]) if len(found) > 0 else None

    def robustness_signal(
        self, trace: Any, *, period: float = 1.0, decided_only: bool = False
    ) -> NDArray[np.float64]:
        """Returns the robustness at each sample.

        >>> Formula("x <= 1").robustness_signal({"x": [0.5, 2.0]}).tolist()
        [0.5, -1.0]
        """
        columns = columns_of(trace)
        names = [name for name in columns if name in self.signals]
        missing = sorted(set(self.signals) - set(names))
        if missing:
            raise ValueError(f"the trace lacks the signals {', '.join(missing)}; it has {', '.join(columns) or 'none'}")
        samples = np.column_stack([columns[name] for name in names]) if names else np.zeros((0, 0))
        return self._native.robustness_signal(names, samples, period, decided_only)

    def __str__(self) -> str:
        return str(self._native)

    def __repr__(self) -> str:
        return f"Formula({str(self)!r})"


def robustness(formula: str | Formula, trace: Any, *, period: float = 1.0) -> float | None:
    """Returns the robustness of a formula on a trace: positive if it is satisfied, negative if it is violated.

    >>> robustness("eventually(x >= 3)", {"x": [1.0, 2.5]})
    -0.5
    """
    parsed = formula if isinstance(formula, Formula) else Formula(formula)
    return parsed.robustness(trace, period=period)
