"""Guards: a policy that an online monitor watches, and who acts when it alarms."""

import dataclasses
import json
import math
import os
import pathlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

import mishandle._native as _native
from mishandle.errors import InvalidTypeError, InvalidValueError, MishandleError
from mishandle.logs.formulas import Formula
from mishandle.policies.kinds import reset_policy


@dataclasses.dataclass(frozen=True)
class Guard:
    """A monitored formula, and who acts when its robustness falls below a threshold.

    The same as the table ``[guard]`` of a plan and the file of ``--guard``; ``docs/guide/guard.md``
    describes it. Pass it as ``guard`` to :func:`evaluate`, :func:`falsify` and the other questions
    about a task, to :func:`harden`, or to :class:`Guarded`.

    Parameters
    ----------
    formula : str or Formula
        Formula over numbers of the observation, such as ``"ball_3 >= 0.1"`` for the third number of
        the part ``ball``. A formula about the past has its robustness at the present sample, a
        formula about the future the best one that is still possible.
    fallback : str
        Who acts after the hand-over: ``"hold"``, ``"retreat"``, ``"expert"`` or another controller
        by name or path. :class:`Guarded` has a policy instead.
    threshold : float
        Robustness below which the guard hands over, in the unit of the formula.
    return_threshold : float, optional
        Robustness from which on the policy acts again; by default the fallback keeps the control.
    dwell : float
        Shortest time for which the fallback acts, in seconds.
    retreat : float
        Duration of the motion that a retreat takes back, in seconds.
    privileged : bool
        Whether the formula reads signals of the target, which the policy does not see.
    actions : str, optional
        What the actions of a target in a file mean to ``hold`` and ``retreat``: ``"increments"`` or
        ``"positions"``.

    Examples
    --------
    >>> print(Guard("speed <= 1", fallback="hold", dwell=0.5).toml())
    formula = "speed <= 1"
    threshold = 0.0
    dwell = 0.5
    fallback = "hold"
    retreat = 1.0
    privileged = false
    """

    formula: str | Formula
    fallback: str = ""
    threshold: float = 0.0
    return_threshold: float | None = None
    dwell: float = 0.0
    retreat: float = 1.0
    privileged: bool = False
    actions: str | None = None

    def toml(self) -> str:
        """Returns the text of a file for ``--guard``."""
        values = {
            "formula": json.dumps(str(self.formula)),
            "threshold": _number("threshold", self.threshold),
            "return-threshold": None if self.return_threshold is None else _number(
                "return_threshold", self.return_threshold
            ),
            "dwell": _number("dwell", self.dwell),
            "fallback": json.dumps(os.fspath(self.fallback)),
            "retreat": _number("retreat", self.retreat),
            "privileged": json.dumps(bool(self.privileged)),
            "actions": None if self.actions is None else json.dumps(self.actions),
        }
        return "\n".join(f"{key} = {value}" for key, value in values.items() if value is not None)


def guard_text(guard: Guard | str | os.PathLike[str] | None) -> str | None:
    """Returns the keys of a guard, or of its file, as TOML."""
    if guard is None:
        return None
    if isinstance(guard, Guard):
        return guard.toml()
    if not isinstance(guard, (str, os.PathLike)):
        raise InvalidTypeError(
            f"a guard is a mishandle.Guard or the path of its file, not a {type(guard).__name__}"
        )
    try:
        return pathlib.Path(guard).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MishandleError(f"the file of the guard {guard} cannot be read: {error}") from error


def _number(name: str, value: Any) -> str:
    """Returns a number as TOML writes it."""
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise InvalidTypeError(f"`{name}` of a guard must be a number, not {value!r}") from error
    if math.isnan(number):
        raise InvalidValueError(f"`{name}` of a guard is NaN")
    return repr(number)


class Guarded:
    """A policy in Python with a guard and a policy as its fallback.

    It is a policy: a function of an observation, with ``reset`` for the start of an episode. Pass
    it wherever a function is a policy, or call it in a control loop. It is for one environment and
    one thread at a time.

    Parameters
    ----------
    policy : callable
        Policy that is guarded: a function of an observation. A method ``reset`` is called at the
        start of an episode. An action that is not finite is none: the fallback acts.
    guard : Guard
        Formula and thresholds. Its ``fallback`` must be left out.
    fallback : callable
        Policy that acts after the hand-over. Its ``reset`` is called at each hand-over.
    quantities : sequence of str, or callable
        Names of the numbers of an observation, or a function from an observation to a dictionary of
        the quantities of the formula.
    period : float
        Control period in seconds.
    steps : int
        Number of control steps of an episode, which bounds what a formula about the future can
        still reach.

    Attributes
    ----------
    active : bool
        Whether the fallback acted in the last control step.
    robustness : float
        Robustness that decided it.

    Examples
    --------
    >>> guarded = Guarded(
    ...     lambda x: 1.0, Guard("x <= 2", return_threshold=1), lambda x: -1.0, quantities=["x"],
    ...     period=0.1, steps=100
    ... )
    >>> guarded.reset()
    >>> [guarded([x]) for x in [0.0, 3.0, 1.5, 0.5]]
    [1.0, -1.0, -1.0, 1.0]
    """

    def __init__(
        self, policy: Callable[[Any], Any], guard: Guard, fallback: Callable[[Any], Any], *,
        quantities: Sequence[str] | Callable[[Any], Mapping[str, float]], period: float, steps: int
    ) -> None:
        if guard.fallback or guard.privileged:
            raise InvalidValueError(
                "a guard of a policy in Python has the argument `fallback` instead of a name, and "
                "is not privileged"
            )
        for name, given in (("policy", policy), ("fallback", fallback)):
            if not callable(given):
                raise InvalidTypeError(
                    f"the {name} is a {type(given).__name__}; expected a function of an observation"
                )
        self.policy, self.guard, self.fallback = policy, guard, fallback
        self._read = quantities if callable(quantities) else None
        self._names = (
            list(Formula(str(guard.formula)).signals) if callable(quantities) else list(quantities)
        )
        self._monitor = _native.GuardMonitor(guard.toml(), self._names, float(period), int(steps))
        self.active, self.robustness = False, float("inf")

    def reset(self) -> None:
        """Starts an episode."""
        self._monitor.reset()
        self.active, self.robustness = False, float("inf")
        reset_policy(self.policy)

    def __call__(self, observation: Any) -> Any:
        """Returns the action of the policy, or of the fallback."""
        action, is_usable = None, False
        if self._monitor.needs_action:
            action = self.policy(observation)
            is_usable = bool(np.all(np.isfinite(np.asarray(action, dtype=float))))
        self.active, takes_over, self.robustness = self._monitor.step(
            self._quantities(observation), is_usable
        )
        if takes_over:
            reset_policy(self.fallback)
        return self.fallback(observation) if self.active else action

    def _quantities(self, observation: Any) -> list[float]:
        if self._read is None:
            return [float(number) for number in np.asarray(observation, dtype=float).ravel()]
        found = self._read(observation)
        missing = [name for name in self._names if name not in found]
        if missing:
            raise InvalidValueError(
                f"`quantities` returns no {missing[0]!r}, which the formula of the guard reads"
            )
        return [float(found[name]) for name in self._names]
