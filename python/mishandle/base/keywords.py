"""Checks of keyword arguments."""

import difflib
from collections.abc import Iterable, Sequence

from mishandle.errors import InvalidTypeError


def check_options(given: Iterable[str], known: Sequence[str]) -> None:
    """Checks that all keyword arguments are known.

    >>> check_options(["time_limits"], ["time_limit"])  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    mishandle.errors.InvalidTypeError: there is no argument `time_limits`; did you mean ...
    """
    aliases = {"period": "control_dt", "dt": "control_dt"}
    for name in given:
        if name in known:
            continue
        near = [aliases[name]] if name in aliases else difflib.get_close_matches(name, known, 1)
        hint = f"did you mean `{near[0]}`?" if near else f"known ones: {', '.join(known)}"
        raise InvalidTypeError(f"there is no argument `{name}`; {hint}")
