"""Tests of time limits and of the base of all exceptions."""

import signal
import subprocess
import sys
import threading
import time
import unittest

from cases import FolderCase
import gymnasium
import mishandle
import numpy as np
from mishandle import Axis, MishandleError
from mishandle.errors import (
    InvalidStateError, InvalidTypeError, InvalidValueError, MissingPackageError
)
from mishandle.errors import TimeLimitExceeded
from mishandle.base.limits import limited

SPACE = [Axis("delay", 0.0, 1.0, "s", nominal=0.0)]


def sleepy(scenario):
    try:
        time.sleep(scenario["delay"])
    except Exception:
        pass  # must not swallow the time limit
    return {"d": [1.0, 1.0]}


class Slow(gymnasium.Env):
    """Each step sleeps for the option `delay`."""

    observation_space = gymnasium.spaces.Box(-1, 1, (1,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def reset(self, *, seed=None, options=None):
        self.delay = (options or {}).get("delay", 0.0)
        return np.zeros(1, np.float32), {}

    def step(self, action):
        time.sleep(self.delay)
        return np.zeros(1, np.float32), 0.0, False, False, {}


def in_thread(work):
    """Returns the result of `work` in another thread, or raises its exception."""
    found = []

    def run():
        try:
            found.append((work(), None))
        except BaseException as error:
            found.append((None, error))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(60)
    value, error = found[0]
    if error is not None:
        raise error
    return value


class Systems(unittest.TestCase):
    def setUp(self):
        self.handler, self.alarms = signal.getsignal(signal.SIGALRM), []

    def tearDown(self):
        self.assertEqual(signal.getsignal(signal.SIGALRM), self.handler, "the handler is restored")
        self.assertEqual(signal.getitimer(signal.ITIMER_REAL), (0.0, 0.0))

    def end(self, delay, system=sleepy, limit=0.3, **options):
        [found] = mishandle.simulate(
            system, "always(d >= 0)", SPACE, at={"delay": delay}, time_limit=limit, **options
        )
        return found.end

    def test_a_function_in_the_main_thread_is_interrupted(self):
        self.assertEqual(self.end(1000.0), "timed out in control step 0")
        self.assertEqual(self.end(0.0), "completed")

    def test_a_function_in_another_thread_is_refused(self):
        with self.assertRaisesRegex(
            InvalidStateError, "only the main thread of Python can interrupt a function"
        ):
            in_thread(lambda: self.end(0.0))
        self.assertEqual(in_thread(lambda: self.end(0.0, limit=None)), "completed")

    def test_a_nominal_scenario_that_hangs_is_an_error(self):
        with self.assertRaisesRegex(
            ValueError, "nominal scenario takes longer than the time limit of 0.1 s"
        ):
            mishandle.simulate(
                lambda scenario: time.sleep(5), "always(d >= 0)", SPACE, time_limit=0.1
            )

    def test_an_environment_is_limited_in_every_thread(self):
        kinds = dict(
            system=Slow(), policy=lambda o: np.zeros(1, np.float32), signals={"d": "reward"},
            steps=20
        )
        # Seven steps of 0.05 s are longer than 0.3 s; in another thread the limit is checked after
        # a step. A busy machine does fewer.
        ends = {f"timed out in control step {step}" for step in range(8)}
        self.assertIn(self.end(0.05, **kinds), ends)
        self.assertIn(in_thread(lambda: self.end(0.05, **kinds)), ends)
        self.assertEqual(in_thread(lambda: self.end(0.0, **kinds)), "completed")

    def test_the_policy_counts(self):
        class Policy:
            steps = 0

            def reset(self):
                self.steps = 0

            def __call__(self, observation):
                self.steps += 1
                # The probe and the first steps are fast.
                time.sleep(5 if self.steps == 4 and self.slow else 0)
                return np.zeros(9 if len(observation) > 1 else 1, np.float32)

        policy = Policy()
        policy.slow = False
        kinds = dict(policy=policy, signals={"d": "reward"}, steps=20)
        system = Slow()
        self.assertEqual(self.end(0.0, system=system, **kinds), "completed")
        policy.slow = True
        self.assertEqual(self.end(0.0, system=system, **kinds), "timed out in control step 4")
        task = mishandle.simulate("point-reaching", policy=policy, rows=1, time_limit=2.0)
        self.assertEqual(task[0].end, "timed out in control step 4")

    def test_limits_are_positive(self):
        for limit in [0.0, -1.0, float("nan")]:
            with self.assertRaisesRegex(ValueError, "must be above 0"):
                self.end(0.0, limit=limit)


class Timers(unittest.TestCase):
    def test_limits_can_be_nested(self):
        for outer, inner, expected in [(10.0, 0.05, "inner"), (0.05, 10.0, "outer")]:
            found = None
            try:
                with limited(outer):
                    try:
                        with limited(inner):
                            time.sleep(1000)
                    except TimeLimitExceeded:
                        found = "inner"
                        if expected == "outer":
                            raise
            except TimeLimitExceeded:
                found = "outer"
            self.assertEqual(found, expected)
            self.assertEqual(signal.getitimer(signal.ITIMER_REAL), (0.0, 0.0))

    def test_a_timer_of_the_caller_keeps_running(self):
        fired = []
        previous = signal.signal(signal.SIGALRM, lambda *_: fired.append(time.monotonic()))
        self.addCleanup(signal.signal, signal.SIGALRM, previous)
        self.addCleanup(signal.setitimer, signal.ITIMER_REAL, 0.0)
        started = time.monotonic()
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with limited(0.1), self.assertRaises(TimeLimitExceeded):
            time.sleep(0.05)
            raise TimeLimitExceeded
        time.sleep(0.5)
        self.assertEqual(len(fired), 1)
        self.assertGreaterEqual(fired[0] - started, 0.3)
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        with self.assertRaises(TimeLimitExceeded), limited(0.3):
            time.sleep(5)
        self.assertEqual(len(fired), 2, "both timers fire")


class Exceptions(FolderCase):
    def test_all_have_one_base_and_the_usual_one(self):
        for kind, usual in [
            (InvalidValueError, ValueError),
            (InvalidTypeError, TypeError),
            (InvalidStateError, RuntimeError),
            (MissingPackageError, ImportError),
            (mishandle.InvalidScenario, Exception),
        ]:
            self.assertTrue(issubclass(kind, MishandleError) and issubclass(kind, usual), kind)

    def test_mistakes_in_values_are_value_errors_and_damaged_files_are_not(self):
        for mistake in [
            lambda: mishandle.Formula("always(x <"),
            lambda: mishandle.TaskEnv("point-reachin"),
            lambda: mishandle.load_controller("ball-catching/none"),
            lambda: mishandle.ask.Search("randon", [(0, 1)]),
            lambda: mishandle.robustness("x <= 1", {"x": [1.0]}, plan={"log": {"period": -1.0}}),
        ]:
            with self.assertRaises(MishandleError) as raised:
                mistake()
            self.assertIsInstance(raised.exception, ValueError)
        path = self.folder / "run.sqlite"
        path.write_bytes(b"no database" * 100)
        with self.assertRaises(MishandleError) as raised:
            mishandle.open_run(path)
        self.assertNotIsInstance(raised.exception, ValueError)

    def test_another_version_of_mujoco_is_refused_at_import(self):
        library, source = self.folder / "other.so", self.folder / "other.c"
        source.write_text('const char* mj_versionString(void) { return "3.3.0"; }\n')
        subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source], check=True)
        command = ["env", f"LD_PRELOAD={library}", sys.executable, "-c", "import mishandle"]
        found = subprocess.run(command, capture_output=True, text=True)
        self.assertNotEqual(found.returncode, 0)
        self.assertIn(
            "ImportError: mishandle needs MuJoCo 3.17.0, but the library that was loaded is "
            "MuJoCo 3.3.0",
            found.stderr
        )
