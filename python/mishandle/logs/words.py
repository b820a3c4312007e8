"""Errors about logs in the words of Python: the native code names the flags of ``mishandle
monitor``."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from mishandle.errors import InvalidValueError

_FLAG = re.compile(
    r"`[^`]*`|(?<![\w/-])--(?P<flag>[a-z][a-z-]*)"
    r"(?: (?P<value>'[^']*'|[A-Z]+(?:=[A-Z]+)?\b|[a-z]+(?:\|[a-z]+)+|(?:hold|drop|comma|point)\b|"
    r"\d[\d.e+-]*|\S+(?=, otherwise)))?"
)
_ARGUMENTS = {"topic": "topics"}
_TRUE = {"sort", "strict_horizon"}


def in_python(message: str) -> str:
    """Returns a message with arguments instead of flags. A text in backquotes stays: it is that of
    the user.

    >>> in_python("pass --resample hold|linear, or --time-unit; `--sort` is a column")
    'pass resample="hold"|"linear", or time_unit; `--sort` is a column'
    """
    return _FLAG.sub(_argument, message)


def _argument(found: re.Match[str]) -> str:
    flag, value = found["flag"], found["value"]
    if flag is None:
        return found[0]
    name = flag.replace("-", "_")
    name = f"{name}=True" if name in _TRUE else _ARGUMENTS.get(name, name)
    if value is None:
        return name
    if value[0] == "'" or value[0].isdigit() or value[0].isupper():
        return f"{name}={value}"
    return f"{name}=" + "|".join(f'"{word}"' for word in value.split("|"))


@contextmanager
def python_words() -> Iterator[None]:
    """Gives errors of the native code the words of Python."""
    try:
        yield
    except InvalidValueError as error:
        raise InvalidValueError(in_python(str(error))) from None
