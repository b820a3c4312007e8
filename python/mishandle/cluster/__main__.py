"""The command ``python3 -m mishandle.cluster``: completes the runs of a campaign on a Ray
cluster."""

import argparse
import contextlib
import os
import pathlib
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mishandle._native as _native
from mishandle.cluster.executors import RayExecutor, check_address
from mishandle.cluster.plans import HardeningFactory, PlanFactory
from mishandle.errors import MishandleError


def complete_runs(
    executor: RayExecutor, folder: str, runs: Sequence[tuple[str, str, bool]], *, jobs: int,
    durable: bool = False, any_build: bool = False, report: Callable[[str, int, int], None]
) -> None:
    """Completes the runs of the campaign in a folder on a cluster, ``jobs`` of them at a time.

    The simulations of a question are spread over the cluster. A hardening is one task on one
    worker, which continues where another one was lost. ``runs`` have name, path, and whether the
    plan is that of a hardening. ``report`` gets the name of a run and the numbers of its finished
    and of all simulations after each batch, in the thread of the run. If ``executor.stop`` is set,
    all runs end after their last finished batch.
    """

    hardenings = executor.share(HardeningFactory(folder, durable=durable, any_build=any_build))

    def complete_hardening(name: str) -> None:
        with contextlib.suppress(KeyboardInterrupt):
            [simulations] = executor.run(hardenings, [name])
            report(name, simulations, simulations)

    def complete(run: tuple[str, str, bool]) -> None:
        name, path, is_hardening = run
        if executor.stop.is_set():
            return
        if is_hardening:
            complete_hardening(name)
            return
        shared = executor.share(PlanFactory(*_native.recorded_plan(path)))

        def progress(done: int, total: int) -> bool:
            report(name, done, total)
            return not executor.stop.is_set()

        try:
            _native.complete_run(
                folder, name, simulate=lambda requests: executor.run(shared, requests),
                durable=durable, any_build=any_build, progress=progress
            )
        except KeyboardInterrupt:
            return

    with ThreadPoolExecutor(max_workers=jobs) as pool:
        futures = [pool.submit(complete, run) for run in runs]
        try:
            while not all(future.done() for future in futures):
                if any(future.done() and future.exception() is not None for future in futures):
                    break
                time.sleep(0.1)
        except KeyboardInterrupt:
            pass
        if not all(future.done() for future in futures):
            executor.stop.set()
        for future in futures:
            future.result()


class _Progress:
    """Progress on stderr: a line that is overwritten on a terminal, otherwise a line from time to
    time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: dict[str, tuple[int, int]] = {}
        self._is_terminal = sys.stderr.isatty()
        self._interval = 0.5 if self._is_terminal else 10.0
        self._last = time.monotonic()

    def __call__(self, name: str, done: int, total: int) -> None:
        with self._lock:
            self._counts[name] = done, total
            if time.monotonic() - self._last < self._interval:
                return
            self._last = time.monotonic()
            finished, planned = (sum(counts) for counts in zip(*self._counts.values()))
            text = f"{finished} of at most {planned} simulations in {len(self._counts)} runs"
            sys.stderr.write(f"\r\033[K{text}" if self._is_terminal else f"{text}\n")
            sys.stderr.flush()

    def clear(self) -> None:
        """Removes the line from the terminal."""
        if self._is_terminal:
            sys.stderr.write("\r\033[K")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a campaign on a Ray cluster. Returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python3 -m mishandle.cluster",
        description="Simulates the runs of a campaign on a Ray cluster. `mishandle run FILE -k "
        "engine.ray=ADDRESS` calls it and prints the results.",
    )
    parser.add_argument("campaign", nargs="?", metavar="FILE", help="campaign file (TOML)")
    parser.add_argument("--out", metavar="DIR", help="folder to create for the run files")
    parser.add_argument("--resume", metavar="DIR", help="complete the campaign in this folder")
    parser.add_argument(
        "--address", help="address of the cluster; `auto` for a running one, `local` to start one"
    )
    parser.add_argument(
        "--jobs", type=int, default=16, metavar="N", help="runs at the same time (default: 16)"
    )
    parser.add_argument(
        "--chunk", type=int, metavar="N",
        help="simulations of a task (default: a batch in 4 tasks per CPU)"
    )
    parser.add_argument("--durable", action="store_true", help="sync each batch to the disk")
    parser.add_argument(
        "--any-build", action="store_true",
        help="with --resume: continue runs that another build started"
    )
    given = parser.parse_args(arguments)
    if (given.resume is None) == (given.campaign is None):
        parser.error("give a campaign FILE with --out DIR, or --resume DIR")
    if given.campaign is not None and given.out is None:
        parser.error("give the folder for the run files: --out DIR")
    if given.jobs < 1:
        parser.error(f"--jobs is {given.jobs}; it must be at least 1")
    try:
        # Before the folder is created.
        check_address(given.address)
        if given.resume is not None:
            runs = _native.campaign_runs(given.resume)
        else:
            runs = _native.create_campaign(
                pathlib.Path(given.campaign).read_text(encoding="utf-8"), given.out
            )
        executor = RayExecutor(given.address, chunk=given.chunk)
    except (OSError, ValueError, ImportError, ConnectionError, MishandleError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    progress = _Progress()
    _interrupt_on_sigterm()
    try:
        complete_runs(
            executor, given.out if given.resume is None else given.resume,
            [(name, os.fspath(path), is_hardening) for name, path, is_hardening in runs],
            jobs=min(given.jobs, len(runs)), durable=given.durable, any_build=given.any_build,
            report=progress
        )
    except (RuntimeError, MishandleError) as error:
        progress.clear()
        print(f"error: {error}", file=sys.stderr)
        return 2
    progress.clear()
    if executor.stop.is_set():
        print("interrupted; all finished batches are stored", file=sys.stderr)
        return 130
    return 0


def _interrupt_on_sigterm() -> None:
    def interrupt(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)


if __name__ == "__main__":
    sys.exit(main())
