"""Checks of the arguments that describe a system and its formulas."""

import difflib
import math
import numbers
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, SupportsFloat

from typing_extensions import TypeGuard

import mishandle._native as _native
from mishandle.errors import InvalidTypeError, InvalidValueError, MishandleError
from mishandle.logs.formulas import Formula
from mishandle.scenarios.axes import (
    Attribute, Axis, FaultParameter, PolicyArgument, ResetOption, Value, parse_path
)

ROLES = ("success", "strict", "careful", "safe", "completion")
"""Names of formulas that define metrics."""

def check_applicable(given: Mapping[str, object], applicable: Sequence[str], kind: str) -> None:
    """Checks that the keyword arguments have an effect on this kind of system."""
    for name in given:
        if name not in applicable:
            raise InvalidTypeError(f"the argument `{name}` has no effect on {kind}; leave it out")


def checked_cameras(cameras: object) -> list[str]:
    """Checks the names of cameras, and returns them."""
    names: list[Any] = (
        list(cameras) if isinstance(cameras, Iterable) and not isinstance(cameras, str) else [None]
    )
    if not all(isinstance(name, str) for name in names):
        raise InvalidTypeError(
            f"cameras is {cameras!r}; expected a list of names, such as ['over', 'wrist']"
        )
    for name in names:
        if names.count(name) > 1:
            raise InvalidValueError(f"the camera `{name}` is named twice")
    return names


def is_whole(value: object) -> TypeGuard[int]:
    """Returns whether a value is a whole number, and no Boolean."""
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


def checked_size(name: str, size: object) -> tuple[int, int]:
    """Checks the size of an image, and returns its width and its height."""
    sides = list(size) if isinstance(size, (tuple, list)) else []
    if len(sides) != 2 or not all(is_whole(side) and 1 <= side <= 1024 for side in sides):
        raise InvalidValueError(
            f"{name} is {size!r}; expected a width and a height from 1 to 1024, such as (64, 64)"
        )
    return int(sides[0]), int(sides[1])


def check_steps(steps: object) -> None:
    """Checks the number of control steps."""
    if steps is not None and (not is_whole(steps) or steps < 1):
        raise InvalidValueError(f"steps is {steps!r}; it must be a whole number of at least 1")


def check_period(control_dt: object) -> None:
    """Checks the duration of a control step.

    >>> check_period(0)
    Traceback (most recent call last):
        ...
    mishandle.errors.InvalidValueError: control_dt is 0; it must be positive and finite, in seconds
    """
    if control_dt is None:
        return
    if not is_real(control_dt) or not 0 < float(control_dt) < math.inf:
        raise InvalidValueError(
            f"control_dt is {control_dt!r}; it must be positive and finite, in seconds"
        )


def is_real(value: object) -> TypeGuard[numbers.Real]:
    """Returns whether a value is a real number. Python counts Booleans as numbers; here they are
    none.

    >>> is_real(2), is_real(0.5), is_real(True), is_real("2")
    (True, True, False, False)
    """
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def check_number(name: str, value: object, least: int, most: int = 2**64 - 1) -> None:
    """Checks a count or a random seed.

    >>> check_number("batch", 0, 1)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    mishandle.errors.InvalidValueError: batch is 0; it must be a whole number from 1 to ...
    """
    if not is_whole(value) or not least <= int(value) <= most:
        raise InvalidValueError(
            f"{name} is {value!r}; it must be a whole number from {least} to {most}"
        )


def check_out(out: str | os.PathLike[str] | None, resume: bool) -> None:
    """Checks that a new run file does not exist and that a run to continue does."""
    if resume and out is None:
        raise InvalidValueError("resume=True needs the run file as `out`")
    if out is None or os.path.exists(out) == resume:
        return
    if resume:
        raise MishandleError(
            f"there is no run file {os.fspath(out)} to continue; start it with resume=False"
        )
    raise MishandleError(
        f"the run file {os.fspath(out)} exists already; choose another `out`, or continue the run "
        "with resume=True"
    )


def check_termination(termination: object) -> None:
    """Checks the rule for episodes that end early."""
    if termination not in ("undecided", "hold", "evaluate"):
        raise InvalidValueError(
            f"termination is {termination!r}; it must be 'undecided', 'hold' or 'evaluate'"
        )


def check_space(space: Sequence[Axis], is_environment: bool, has_steps: bool = True) -> None:
    """Checks that each axis has a name of its own and, for an environment, that no two axes set the
    same thing.

    >>> check_space(
    ...     [Axis("mass", 1, 2, apply=Attribute("m")), Axis("weight", 1, 2, apply=Attribute("m"))],
    ...     True
    ... )  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    mishandle.errors.InvalidValueError: the axes `mass` and `weight` both set the attribute 'm'; ...
    """
    names: set[str] = set()
    for axis in space:
        if axis.name in names:
            raise InvalidValueError(
                f"two axes have the name `{axis.name}`; the name of each axis must be different"
            )
        names.add(axis.name)
    faulty = next(
        (axis for axis in space if axis.kind == "fault" or isinstance(axis.apply, FaultParameter)),
        None
    )
    if faulty is not None and not has_steps:
        raise InvalidTypeError(
            f"the axis `{faulty.name}` acts between an environment and its policy, but a function "
            "has no control steps between which it could act; use an environment with a policy, "
            "or an axis of another kind that the function itself applies"
        )
    if faulty is not None and not isinstance(faulty.apply, FaultParameter):
        raise InvalidValueError(
            f"the axis `{faulty.name}` has the kind 'fault', but nothing applies it: "
            "mishandle.faults makes the axes of faults"
        )
    if not is_environment:
        return
    setters: list[tuple[str, str, tuple[object, ...], str]] = []
    for axis in space:
        if isinstance(axis.apply, Attribute):
            what, path = "attribute", axis.apply.path
            parts: tuple[object, ...] = tuple(
                part for name, indexes in parse_path(path) for part in (name, *indexes)
            )
        elif axis.apply is None or isinstance(axis.apply, ResetOption):
            what, path = "reset option", axis.name if axis.apply is None else axis.apply.name
            parts = tuple(path.split("."))
        elif isinstance(axis.apply, PolicyArgument):
            what, path, parts = "policy argument", axis.apply.name, (axis.apply.name,)
        else:
            continue
        for other, kind, known, known_path in setters:
            shared = min(len(known), len(parts))
            # The option `scenario` and the option `scenario.x` overwrite each other, too.
            if kind == what and known[:shared] == parts[:shared]:
                whole, part = sorted((known_path, path), key=len)
                both = repr(path) if known == parts else f"{whole!r} and its part {part!r}"
                raise InvalidValueError(
                    f"the axes `{other}` and `{axis.name}` both set the {what} {both}; the value "
                    "of one of them would have no effect"
                )
        setters.append((axis.name, what, parts, path))


def task_formulas(
    formula: str | Formula | Mapping[str, str | Formula] | None, known: Mapping[str, str],
    signals: Sequence[str]
) -> str | Formula | Mapping[str, str | Formula]:
    """Returns the formulas of a task, the requirement first: all of the task if ``formula`` is
    ``None`` or one of their names.

    >>> list(
    ...     task_formulas(
    ...         "strict", {"success": "always(x <= 2)", "strict": "always(x <= 1)"}, ["x"]
    ...     )
    ... )
    ['strict', 'success']
    """
    if formula is None:
        return known
    if isinstance(formula, str) and formula in known:
        return {formula: known[formula], **known}
    if (
        isinstance(formula, str) and formula.isidentifier()
        and formula not in (*signals, "true", "false")
    ):
        near = difflib.get_close_matches(formula, list(known), 1)
        hint = f"did you mean `{near[0]}`?" if near else f"the formulas are {', '.join(known)}"
        raise InvalidValueError(f"the task has no formula or signal `{formula}`; {hint}")
    return formula


def named_formulas(formula: str | Formula | Mapping[str, str | Formula] | None) -> dict[str, str]:
    """Returns formulas by name, the requirement first.

    >>> named_formulas("always(x <= 1)")
    {'success': 'always(x <= 1)'}
    """
    if isinstance(formula, (str, Formula)):
        formula = {"success": formula}
    if not isinstance(formula, Mapping):
        raise InvalidTypeError(
            f"a {type(formula).__name__} is not a formula: expected a text, a Formula, or formulas "
            "by name"
        )
    if not formula:
        raise InvalidValueError("there is no formula")
    first, *others = formula
    for name in others:
        if name not in ROLES:
            raise InvalidValueError(
                f"the formula `{name}` would be ignored; after the first one, the names are "
                f"{', '.join(ROLES)}"
            )
    for each in formula.values():
        if isinstance(each, str):
            Formula(each)
    return {name: str(each) for name, each in formula.items()}


def check_time(formulas: Mapping[str, str], knows_control_dt: bool, control_dt: float) -> None:
    """Checks that the duration of a control step is known if a formula has bounds in units of
    time."""
    if knows_control_dt:
        return
    for text in formulas.values():
        if _native.Formula(text).needs_period:
            raise InvalidValueError(
                f"`{text}` has bounds in units of time, but the duration of a control step is not "
                f"known (assumed: {control_dt:g} s); pass it as control_dt, in seconds"
            )


def scenario_numbers(
    space: Sequence[Axis], at: Mapping[str, Value] | Sequence[float] | None,
    nominal: Sequence[float | None] | None = None
) -> list[float | None]:
    """Returns the numbers of a scenario. Axes that it leaves out have the values ``nominal``."""
    if at is None:
        at = {}
    if isinstance(at, (str, bytes)) or not isinstance(at, (Mapping, Iterable)):
        raise InvalidTypeError(
            f"`at` is {at!r}; expected a dictionary of axes and values, or a sequence with one "
            "number for each axis"
        )
    if not isinstance(at, Mapping):
        values = list(at)
        if len(values) != len(space):
            raise InvalidValueError(f"the scenario has {len(values)} values; expected {len(space)}")
        for axis, number in zip(space, values):
            if not isinstance(number, SupportsFloat):
                raise InvalidTypeError(
                    f"the scenario's `{axis.name}` is {number!r}; expected a number"
                )
        return [float(number) for number in values]
    for name, value in at.items():
        if not isinstance(value, (str, SupportsFloat)):
            raise InvalidTypeError(
                f"the scenario's `{name}` is {value!r}; expected a number, or a name of the axis"
            )
    unknown = sorted(str(name) for name in set(at) - {axis.name for axis in space})
    if unknown:
        names = ", ".join(axis.name for axis in space)
        raise InvalidValueError(f"the space has no axis {', '.join(unknown)}; its axes: {names}")
    if nominal is None:
        nominal = [axis.nominal_number for axis in space]
    return [
        axis.number(at[axis.name]) if axis.name in at else value
        for axis, value in zip(space, nominal)
    ]
