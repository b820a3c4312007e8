"""Monitors that get one sample after the other, while a robot runs."""

from collections.abc import Sequence
from typing import Any

import numpy as np

import mishandle._native as _native
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.logs.formulas import Formula


class OnlineMonitor(_native.OnlineMonitor):
    """A monitor of one or more formulas over the same signals, which shares their common parts.

    Parameters
    ----------
    formulas : str, Formula, or sequence of them
        The methods ``bounds``, ``verdict`` and ``decided`` take the index of a formula, 0 by
        default.
    signals : sequence of str, optional
        Names of the values of a sample, in order. By default the signals of the formulas, in the
        order in which they occur; :attr:`signals` lists them.
    period : float, optional
        Time between two samples, in seconds. Formulas with a unit in their bounds need it.
    samples : int, optional
        Number of samples of the whole trace, if it is known. A window without an end then ends
        there.

    Notes
    -----
    - ``push(sample)`` adds a sample: a tuple, list or array with one number for each signal, a
      dictionary by name, or a number if there is one signal. A number that is NaN or infinite is an
      error.
    - ``push_many(array)`` adds the rows of an array (samples, signals).
    - ``bounds()`` is the least and the greatest robustness at the first sample over all
      continuations.
    - ``verdict()`` is True or False as soon as nothing can change it, and None before.
    - ``decided()`` is the sample whose robustness the last push decided, and the robustness, or
      None.
    - ``reset()`` forgets all samples, and ``len(monitor)`` counts them.

    A monitor is for one thread at a time.

    Examples
    --------
    >>> monitor = OnlineMonitor("always[0:9](x <= 1)")
    >>> for x in [0.0, 0.5, 3.0]:
    ...     monitor.push(x)
    ...     print(monitor.bounds(), monitor.verdict())
    (-inf, 1.0) None
    (-inf, 0.5) None
    (-inf, -2.0) False
    """

    def __new__(
        cls, formulas: str | Formula | Sequence[str | Formula],
        signals: Sequence[str] | None = None, period: float | None = None,
        samples: int | None = None
    ) -> "OnlineMonitor":
        given = [formulas] if isinstance(formulas, (str, Formula)) else list(formulas)
        parsed = [
            formula if isinstance(formula, Formula) else Formula(formula) for formula in given
        ]
        if isinstance(signals, str):
            raise InvalidTypeError(f"signals must be a sequence of names, such as [{signals!r}]")
        names = (
            [name for formula in parsed for name in formula.signals] if signals is None
            else list(signals)
        )
        if signals is not None and len(set(names)) < len(names):
            raise InvalidValueError(f"two signals have the same name: {', '.join(names)}")
        monitor = super().__new__(
            cls, [str(formula) for formula in parsed], list(dict.fromkeys(names)), period, samples
        )
        return monitor  # type: ignore[return-value]

    def push_many(self, samples: Any) -> None:
        """Adds the rows of an array (samples, signals), or the numbers of an array if there is one
        signal."""
        rows = np.asarray(samples, dtype=np.float64)
        super().push_many(
            rows.reshape(-1, 1) if rows.ndim == 1 and len(self.signals) == 1 else rows
        )
