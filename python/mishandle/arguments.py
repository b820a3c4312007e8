"""Checks of the arguments that describe a system and its formulas."""

from __future__ import annotations

import difflib
import numbers
import re
from collections.abc import Iterable, Mapping, Sequence

from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.formulas import Formula

ROLES = ("success", "strict", "safe", "completion")
"""Names of formulas that define metrics."""

_TIME = re.compile(r"\[[^\]]*\d\s*(?:s|ms|us|ns)\b")
"""Interval of a formula with a bound in a unit of time."""


def check_options(given: Iterable[str], known: Sequence[str]) -> None:
    """Checks that all keyword arguments are known.

    >>> check_options(["control_dt", "time_limits"], ["control_dt", "time_limit"])
    Traceback (most recent call last):
        ...
    mishandle.errors.InvalidTypeError: there is no argument `time_limits`; did you mean `time_limit`?
    """
    aliases = {"period": "control_dt", "dt": "control_dt"}
    for name in given:
        if name in known:
            continue
        near = [aliases[name]] if name in aliases else difflib.get_close_matches(name, known, 1)
        hint = f"did you mean `{near[0]}`?" if near else f"known ones: {', '.join(known)}"
        raise InvalidTypeError(f"there is no argument `{name}`; {hint}")


def check_applicable(given: Mapping[str, object], applicable: Sequence[str], kind: str) -> None:
    """Checks that the keyword arguments have an effect on this kind of system."""
    for name in given:
        if name not in applicable:
            raise InvalidTypeError(f"the argument `{name}` has no effect on {kind}; leave it out")


def check_steps(steps: object) -> None:
    """Checks the number of control steps."""
    if steps is not None and (not isinstance(steps, numbers.Integral) or steps < 1):
        raise InvalidValueError(f"steps is {steps!r}; it must be a whole number of at least 1")


def named_formulas(formula: str | Formula | Mapping[str, str | Formula] | None) -> dict[str, str]:
    """Returns formulas by name, the requirement first.

    >>> named_formulas("always(x <= 1)")
    {'success': 'always(x <= 1)'}
    """
    if isinstance(formula, (str, Formula)):
        formula = {"success": formula}
    if not isinstance(formula, Mapping):
        raise InvalidTypeError(
            f"a {type(formula).__name__} is not a formula: expected a text, a Formula, or formulas by name"
        )
    if not formula:
        raise InvalidValueError("there is no formula")
    first, *others = formula
    for name in others:
        if name not in ROLES:
            raise InvalidValueError(
                f"the formula `{name}` would be ignored; after the first one, the names are {', '.join(ROLES)}"
            )
    for each in formula.values():
        if isinstance(each, str):
            Formula(each)
    return {name: str(each) for name, each in formula.items()}


def check_time(formulas: Mapping[str, str], knows_control_dt: bool, control_dt: float) -> None:
    """Checks that the duration of a control step is known if a formula has bounds in units of time."""
    if knows_control_dt:
        return
    for text in formulas.values():
        if _TIME.search(text):
            raise InvalidValueError(
                f"`{text}` has bounds in units of time, but the duration of a control step is not known (assumed: "
                f"{control_dt:g} s); pass it as control_dt, in seconds"
            )
