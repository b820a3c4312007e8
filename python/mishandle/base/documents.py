"""Documents for the extension module: what a call states, its arguments and ``plan``."""

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

from mishandle.errors import InvalidTypeError, InvalidValueError

Plan = Mapping[str, Any]
"""Tables and keys of a plan, such as ``{"falsify": {"early_stopping": True}}``."""


def document(value: Any) -> str:
    """Returns JSON, with numbers of NumPy and paths as values.

    >>> document({"seed": 3, "axes": {"speed": (0, 5)}})
    '{"seed": 3, "axes": {"speed": [0, 5]}}'
    """
    try:
        return json.dumps(value, allow_nan=False, default=_plain)
    except ValueError as error:
        raise InvalidValueError(f"a value is NaN or infinite: {error}") from None


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Sequence):
        return list(value)
    raise InvalidTypeError(
        f"{value!r} is a {type(value).__name__}; expected a number, a text, a list or a dictionary"
    )


class Call:
    """The question or function of a call, its arguments as keys of a plan, and ``plan`` itself.
    Native code reads them together; ``None`` is a key that is left out."""

    def __init__(
        self, question: str, options: Mapping[str, Any], arguments: Plan | None = None,
        defaults: Plan | None = None
    ) -> None:
        self.question = question
        self.plan = _dictionary("plan", options.get("plan"))
        self._arguments = {
            **(arguments or {}), **{name: _dictionary(name, options.get(name)) for name in NAMED}
        }
        self._defaults = defaults or {}

    def text(self, guard: str | None = None, **arguments: Any) -> str:
        """Returns the document, with further arguments."""
        given = dict(self._arguments)
        for name, value in arguments.items():
            is_table = isinstance(value, Mapping) and name in given
            given[name] = {**given[name], **value} if is_table else value
        return document({
            "question": self.question, "defaults": self._defaults, "plan": self.plan,
            "arguments": given, "guard": guard
        })

    def table(self, name: str) -> dict[str, Any]:
        """Returns a table of named values, of ``plan`` and the argument."""
        return {**_dictionary(name, self.plan.get(name)), **self._arguments[name]}

    def take(self, name: str, default: Any) -> Any:
        """Takes a key that the caller reads out of ``plan``."""
        value = self.plan.pop(name, None)
        return default if value is None else value


NAMED = ("axes", "requirements")
"""Arguments that are tables."""


def _dictionary(name: str, value: Any) -> dict[str, Any]:
    if value is not None and not isinstance(value, Mapping):
        raise InvalidTypeError(f"{name} is {value!r}; expected a dictionary")
    return dict(value or {})
