"""Ctrl-C in functions that write no run file: the running batch ends first, and the exception holds
the result so far."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

Progress = Callable[[int, int], None]

Result = TypeVar("Result")


@contextlib.contextmanager
def after_the_batch(progress: Progress | None) -> Iterator[Progress]:
    """Yields a progress function that raises the ``KeyboardInterrupt`` of Ctrl-C after the running
    batch.

    A second Ctrl-C interrupts at once, also inside of the system, and the result so far is lost. A
    handler of the caller stays.
    """
    requests: list[int] = []

    def handle(number: int, frame: Any) -> None:
        if requests:
            signal.default_int_handler(number, frame)
        requests.append(number)

    def report(done: int, total: int) -> None:
        if requests:
            requests.clear()
            raise KeyboardInterrupt
        if progress is not None:
            progress(done, total)

    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield report
        return
    signal.signal(signal.SIGINT, handle)
    try:
        yield report
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if requests:
        raise KeyboardInterrupt


def deliver(result: Result, interruption: BaseException | None) -> Result:
    """Returns a result. If an exception ended its computation early, raises that with the result so
    far as its attribute ``result``."""
    if interruption is None:
        return result
    setattr(interruption, "result", result)  # noqa: B010
    # From Python 3.11 on.
    if hasattr(interruption, "add_note"):
        interruption.add_note("the result so far is the attribute `result` of this exception")
    raise interruption
