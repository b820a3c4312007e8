"""Progress of a question by default: a bar in terminals and notebooks, a line from time to time
elsewhere."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

from mishandle.errors import InvalidTypeError

CELLS = 30
"""Width of a bar in characters."""

BAR = (0.3, 0.2)
"""Seconds before a bar appears, and between two changes of it."""

LINES = (10.0, 30.0)
"""Seconds before the first line where no bar can be shown, and between two lines."""


@contextlib.contextmanager
def reporting(
    progress: Any, unit: str = "simulations"
) -> Iterator[Callable[..., None] | None]:
    """Yields the function that gets the numbers of finished and of all simulations: that of the
    caller, by default a bar, or ``None`` for ``False``."""
    if progress is False or callable(progress):
        yield progress or None
        return
    if progress is not None:
        raise InvalidTypeError(
            f"progress is {progress!r}; it must be a function of two numbers, or False"
        )
    bar = Bar(unit)
    try:
        yield bar
    finally:
        bar.close()


class Bar:
    """Shows numbers of finished and of all simulations, after the name of a part, if any."""

    def __init__(self, unit: str = "simulations") -> None:
        self._unit = unit
        self._notebook = _notebook()
        has_stream = self._notebook is None and sys.stderr is not None
        self._is_terminal = has_stream and sys.stderr.isatty()
        first, self._interval = LINES if self._writes_lines else BAR
        self._start = time.monotonic()
        self._next = self._start + first
        self._text = ""
        self._is_shown = False
        self._announced = ""

    @property
    def _writes_lines(self) -> bool:
        return self._notebook is None and not self._is_terminal

    def announce(self, text: str) -> None:
        """Shows how many simulations a question takes, and about how long, before the first."""
        self._announced = text
        if not self._writes_lines:
            self._write(text)

    def __call__(self, *found: Any) -> None:
        *names, done, total = found
        now = time.monotonic()
        count = f"{done}/{total}" if total else f"{done}"
        names.append(f"{count} {self._unit}".rstrip())
        self._text = _text(done, total, now - self._start, names, bar=not self._writes_lines)
        if now >= self._next and sys.stderr is not None:
            self._next = now + self._interval
            self._write(self._text)

    def _write(self, text: str) -> None:
        self._is_shown = True
        if self._notebook is not None:
            self._notebook.update({"text/plain": text}, raw=True)
        elif self._is_terminal:
            sys.stderr.write(f"\r\033[K{text}")
            sys.stderr.flush()
        else:
            announced = f"{self._announced}\n" if self._announced else ""
            self._announced = ""
            sys.stderr.write(f"{announced}{text}\n")
            sys.stderr.flush()

    def close(self) -> None:
        """Removes the bar from a terminal; a notebook keeps the last numbers."""
        if self._is_terminal and self._is_shown:
            sys.stderr.write("\r\033[K")
            sys.stderr.flush()
        elif self._notebook is not None and self._is_shown and self._text:
            self._write(self._text)


def _text(done: int, total: int, seconds: float, names: list[str], *, bar: bool) -> str:
    parts = [*names, _duration(seconds)]
    if 0 < done < total:
        parts.append(f"{_duration(seconds * (total - done) / done)} left")
    text = ", ".join(parts)
    if not bar or not total:
        return text
    filled = min(CELLS, CELLS * done // total)
    return f"[{'#' * filled}{'-' * (CELLS - filled)}] {text}"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


class _Notebook:
    """A line of plain text in a notebook, which appears with its first text."""

    def __init__(self, display: Any) -> None:
        self._display = display
        self._handle: Any = None

    def update(self, data: dict[str, str], *, raw: bool) -> None:
        if self._handle is None:
            self._handle = self._display(data, raw=raw, display_id=True)
        else:
            self._handle.update(data, raw=raw)


def _notebook() -> _Notebook | None:
    """Returns the line of a notebook, if IPython is loaded and has a kernel."""
    module = sys.modules.get("IPython")
    shell = module.get_ipython() if module is not None else None
    if shell is None or not hasattr(shell, "kernel"):
        return None
    from IPython.display import display

    return _Notebook(display)
