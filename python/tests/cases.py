"""What several tests share."""

import gc
import os
import pathlib
import signal
import tempfile
import threading
import time
import unittest
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np


def batch(size: int) -> dict[str, Any]:
    """Returns the plan of a search that proposes several simulations at once."""
    return {"falsify": {"batch": size}}


def take_interrupts(test: unittest.TestCase) -> None:
    """Ctrl-C raises in a test. A shell starts background jobs with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    test.addCleanup(signal.signal, signal.SIGINT, before)


class FolderCase(unittest.TestCase):
    """A test with an empty folder."""

    def setUp(self) -> None:
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))


class Line(gymnasium.Env[Any, Any]):
    """A point whose velocity is the action, 0.1 s per control step."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space = gymnasium.spaces.Box(-10, 10, (1,), np.float64)
    metadata: dict[str, Any] = {}
    dt = 0.1

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.place = float((options or {}).get("start", 0.0))
        return np.array([self.place]), {}

    def step(self, action: Any) -> Any:
        self.place += 0.1 * float(action[0])
        return np.array([self.place]), 0.0, False, False, {}


class ThreadsAndForks(unittest.TestCase):
    """How environments of a task behave beside other threads, and in a process made by fork. A
    base: tests import its module, so that it is not one of theirs."""

    def make(self, rows: int, threads: int) -> Any:
        """Returns ``rows`` environments of point reaching."""
        raise NotImplementedError

    def reset(self, env: Any) -> Any:
        """Resets the environments, and returns the observations."""
        return env.reset()

    def in_child(self, action: Callable[[], bool]) -> None:
        """Runs ``action`` in a process made by fork, which must return True within a minute."""
        child = os.fork()
        if child == 0:
            status = 1
            try:
                status = 0 if action() else 2
            finally:
                # Not os._exit alone: the child must also be able to drop what it inherited.
                gc.collect()
                os._exit(status)
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                self.assertEqual(os.waitstatus_to_exitcode(status), 0)
                return
            time.sleep(0.01)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        self.fail("the child hangs")

    def steps(self, rows: int, threads: int) -> tuple[Any, Any]:
        """Returns environments after a reset, and actions of 0."""
        env = self.make(rows, threads)
        self.reset(env)
        return env, np.zeros((rows, 9), np.float32)

    def test_other_python_threads_run_during_a_step(self) -> None:
        env, still = self.steps(2000, 1)
        stepping = threading.Thread(target=lambda: [env.step(still) for _ in range(3)])
        stepping.start()
        counted = 0
        while stepping.is_alive():
            counted += 1
            time.sleep(0.001)
        # If the steps held the interpreter, the loop would run at most three times.
        self.assertGreater(counted, 10)

    def test_a_child_cannot_use_the_environments_of_its_parent(self) -> None:
        env, still = self.steps(4, 2)
        first = self.reset(env).copy()

        def raises() -> bool:
            messages = []
            for action in [lambda: self.reset(env), lambda: env.step(still)]:
                try:
                    action()
                except RuntimeError as error:
                    messages.append(str(error))
            return len(messages) == 2 and all('get_context("spawn")' in text for text in messages)

        self.in_child(raises)
        # The parent is unaffected.
        np.testing.assert_array_equal(self.reset(env), first)
        env.step(still)

    def test_a_fork_during_a_step_of_another_thread(self) -> None:
        env, still = self.steps(2000, 2)
        stopping = threading.Event()

        def work() -> None:
            while not stopping.is_set():
                env.step(still)

        def walks() -> bool:
            other, actions = self.steps(2, 1)
            return all(len(other.step(actions)) == 5 for _ in range(2))

        stepping = threading.Thread(target=work)
        stepping.start()
        try:
            for _ in range(5):
                self.in_child(walks)
        finally:
            stopping.set()
            stepping.join()
