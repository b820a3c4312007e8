"""Time limits of simulations."""

import signal
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from mishandle.errors import InvalidStateError, InvalidValueError, TimeLimitExceeded


MAX_SECONDS = 1e7
"""Longest time limit, in seconds. Timers of the system have a limit, too."""


def check_time_limit(seconds: float | None) -> None:
    """Checks that a time limit is positive."""
    if seconds is not None and not 0 < seconds <= MAX_SECONDS:
        raise InvalidValueError(
            f"the time limit is {seconds} s; it must be above 0 and at most {MAX_SECONDS:g} s"
        )


def can_interrupt() -> bool:
    """Returns whether a timer can interrupt the calling thread."""
    return hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()


def check_interruptible(seconds: float | None) -> None:
    """Checks that a function with a time limit can be interrupted in this thread."""
    if seconds is not None and not can_interrupt():
        raise InvalidStateError(
            f"the time limit of {seconds} s cannot be enforced here: only the main thread of "
            "Python can interrupt a function; call it from the main thread, or leave out "
            "`time_limit`"
        )


@contextmanager
def limited(seconds: float | None) -> Generator[None, None, None]:
    """Raises :class:`TimeLimitExceeded` if the body takes longer.

    The main thread is interrupted by a timer, in Python code and in system calls that wait. In
    other threads, and for code in C that does not return to Python, the limit is checked at the end
    of the body. Limits can be nested, and a timer of the caller keeps running.
    """
    if seconds is None:
        yield
        return
    started = time.monotonic()
    if can_interrupt():
        with _timer(seconds):
            yield
    else:
        yield
    if time.monotonic() - started > seconds:
        raise TimeLimitExceeded


@contextmanager
def _timer(seconds: float) -> Generator[None, None, None]:
    started = time.monotonic()
    outer, interval = signal.getitimer(signal.ITIMER_REAL)
    # A timer of the caller that ends first keeps its handler.
    outer_pending = 0 < outer < seconds
    is_active = True

    def interrupt(number: int, frame: Any) -> None:
        nonlocal outer, outer_pending
        if outer_pending:
            outer, outer_pending = interval, False
            signal.setitimer(signal.ITIMER_REAL, max(seconds - (time.monotonic() - started), 1e-6))
            if callable(previous):
                previous(number, frame)
        elif is_active:
            raise TimeLimitExceeded

    previous = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, outer if outer_pending else seconds)
    try:
        try:
            yield
        finally:
            is_active = False
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)
        if outer > 0:
            passed = time.monotonic() - started
            signal.setitimer(signal.ITIMER_REAL, max(outer - passed, 1e-6), interval)
