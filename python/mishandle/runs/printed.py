"""How results print: the lines that say what they mean, one line in a list or a debugger, and a
small table in a notebook. ``vars`` has everything."""

import dataclasses
import html
from collections.abc import Iterator
from typing import Any

WIDTH = 120
"""Largest number of characters of a ``repr``."""

ROWS = 12
"""Largest number of rows of a table."""

LONGEST = 60
"""Largest number of characters of a text in a table."""


class Printed:
    """A result that prints as its lines. Its class is a dataclass with ``repr=False``."""

    def _lines(self) -> str:
        return str(getattr(self, "shown", ""))

    def __str__(self) -> str:
        return self._lines() or repr(self)

    def __repr__(self) -> str:
        lines = self._lines().strip().splitlines()
        said = " ".join(lines[0].split()) if lines else ", ".join(
            f"{name}={value}" for name, value in _facts(self)
        )
        text = f"<{type(self).__name__}: {said}>"
        return text if len(text) <= WIDTH else f"{text[: WIDTH - 2]}…>"

    def _repr_html_(self) -> str:
        """Returns the lines and a table of the numbers for a notebook. All text is escaped."""
        text = self._lines()
        lines = f"<pre>{html.escape(text)}</pre>" if text else ""
        rows = "".join(
            f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
            for name, value in _facts(self)
        )
        return f"{lines}<table>{rows}</table>"


def _facts(result: Any) -> Iterator[tuple[str, str]]:
    """Yields the first fields that are numbers, short texts or estimates."""
    found = 0
    for field in dataclasses.fields(result):
        text = None if field.name == "shown" else _text(getattr(result, field.name))
        if text is not None and found < ROWS:
            found += 1
            yield field.name.replace("_", " "), text


def _text(value: Any) -> str | None:
    if isinstance(value, bool) or isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, str):
        return value if 0 < len(value) <= LONGEST else None
    parts = [getattr(value, name, None) for name in ("value", "low", "high")]
    if all(isinstance(part, (int, float)) for part in parts):
        return f"{parts[0]:.4g} [{parts[1]:.4g}, {parts[2]:.4g}]"
    return None
