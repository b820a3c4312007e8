"""The client for FMUs, with an FMU that pythonfmu makes."""

import importlib.util
import pathlib
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

from contract import HERE, PROGRAM, PYTHON_TANK, Client
from peer import Peer, check_hello

missing = [name for name in ("fmpy", "pythonfmu") if importlib.util.find_spec(name) is None]
folder = pathlib.Path(tempfile.mkdtemp())
START = [sys.executable, str(HERE / "fmu/mishandle_fmu.py"), "Tank.fmu"]
TIMES = ["--step", "0.1", "--stop", "30"]
AXES = ["--axis", "start_level=0.1:0.9", "--axis", "demand=0.02:0.1:0.06", "--axis", "lag=0.5:2"]
SIGNALS = ["--signal", "level", "--signal", "valve"]


def setUpModule():
    if missing:
        raise unittest.SkipTest(f"not installed: pip install {' '.join(missing)}")
    build = [sys.executable, "-m", "pythonfmu", "build", "-f", HERE / "tests/fmus/tank.py", "-d", folder]
    subprocess.run(build, check=True, stdout=subprocess.DEVNULL)


def tearDownModule():
    shutil.rmtree(folder)


class FmuTank(Client, unittest.TestCase):
    command = [*START, *TIMES, *AXES, *SIGNALS, "--formula", "no_overflow=always(level <= 1)"]
    folder = folder

    def test_the_traces_are_those_of_the_tank_in_python(self):
        with self.start() as peer, Peer(PYTHON_TANK, HERE / "python") as python:
            for scenario in [python.nominal(), *python.corners()]:
                renamed = {"start_level": scenario["level"], "demand": scenario["demand"], "lag": scenario["lag"]}
                self.assertEqual(peer.episode(renamed), python.episode(scenario))

    def test_prints_of_the_fmu_go_to_standard_error(self):
        with self.start() as peer:
            peer.episode(peer.nominal())
            self.assertIn("a print of the FMU", peer.printed())

    def test_hello_states_the_start_of_the_fmu_and_versions(self):
        with self.start() as peer:
            self.assertEqual(peer.nominal(), {"start_level": 0.5, "demand": 0.06, "lag": 1.0})
            self.assertEqual(peer.hello["versions"]["fmi"], "2.0")

    def test_the_unpacked_fmu_is_removed_also_after_a_kill(self):
        for end in (Peer.close, lambda peer: peer.process.kill()):
            with tempfile.TemporaryDirectory() as scratch:
                with Peer(["env", f"TMPDIR={scratch}", *self.command], self.folder) as peer:
                    peer.episode(peer.nominal())
                    self.assertEqual(len(list(pathlib.Path(scratch).iterdir())), 1)
                    end(peer)
                until = time.monotonic() + 20
                while list(pathlib.Path(scratch).iterdir()) and time.monotonic() < until:
                    time.sleep(0.02)
                self.assertEqual(list(pathlib.Path(scratch).iterdir()), [])


class FmuWithActions(Client, unittest.TestCase):
    """The valve is closed and the policy has the inflow."""

    fixed = ["--set", "is_closed=true", "--axis", "start_level=0.1:0.9", "--axis", "demand=0:0.1:0.06"]
    policy_of_tank = ["--action", "extra", "--observation", "level", "--action-limit", "0.2"]
    command = [*START, *TIMES, *fixed, *SIGNALS, *policy_of_tank, "--formula", "no_overflow=always(level <= 1)"]
    folder = folder
    policy = staticmethod(lambda observation: [0.1 if observation[0] < 0.7 else 0.0])

    @unittest.skipUnless(PROGRAM, "MISHANDLE does not name the program")
    def test_mishandle_checks_and_falsifies_it(self):
        """Falsifying it needs a controller, which the test of the cart has."""
        checked = self.mishandle("init", "--check", shlex.join(self.command))
        self.assertEqual(checked.returncode, 0, checked.stdout + checked.stderr)

    def test_without_demand_the_level_is_the_integral_of_the_action(self):
        with self.start() as peer:
            trace, _ = peer.episode({"start_level": 0.2, "demand": 0.0}, policy=lambda _: [0.05])
            for k, level in enumerate(trace["level"]):
                self.assertAlmostEqual(level, 0.2 + 0.05 * 0.1 * k, delta=1e-12)
            self.assertEqual(set(trace["valve"]), {0.0})


class Fmu(unittest.TestCase):
    def test_booleans_are_categories_and_integers_whole_numbers(self):
        command = [*START, *TIMES, "--axis", "is_closed", "--axis", "fails_at=0:400", *SIGNALS]
        with Peer(command, folder) as peer:
            check_hello(peer.hello)
            closed, fails = peer.hello["axes"]
            self.assertEqual((closed["values"], closed["nominal"]), (["false", "true"], "false"))
            self.assertEqual((fails["values"], fails["high"]), ("integer", 400))
            trace, _ = peer.episode({"is_closed": "true", "fails_at": 0})
            self.assertEqual(set(trace["valve"]), {0.0})

    def test_an_fmu_may_end_the_simulation(self):
        with Peer([*START, *TIMES, "--axis", "ends_at=0:400", *SIGNALS], folder) as peer:
            whole, end = peer.episode({"ends_at": 0})
            self.assertIsNone(end)
            for step in (1, 77, 300):
                trace, end = peer.episode({"ends_at": step})
                self.assertEqual(end, "terminated")
                self.assertEqual(trace["level"][:step], whole["level"][:step])
                self.assertEqual(len(trace["level"]), step + 1)
            self.assertEqual(peer.episode({"ends_at": 301}), (whole, None))

    def test_an_error_of_the_fmu_is_an_error_or_the_end_of_the_process(self):
        """pythonfmu calls an exception a fatal error, after which nothing of the FMU may be called."""
        command = [*START, *TIMES, "--axis", "fails_at=0:400", *SIGNALS]
        with Peer(command, folder) as peer:
            with self.assertRaisesRegex(AssertionError, "(?s)the simulator ended.*fmi2DoStep failed"):
                peer.episode({"fails_at": 77})

    def test_mistakes_name_what_is_wrong(self):
        for words, expected in (
            ([], r"parameter +Real +demand +start 0.06"),
            (["--signal", "levle", *TIMES], "no variable `levle`"),
            (["--signal", "level"], "state --step and --stop"),
            (["--signal", "level", "--step", "0.1", "--stop", "0.25"], "not a multiple"),
            ([*SIGNALS, *TIMES, "--axis", "level=0:1"], "`level` cannot be set"),
            ([*SIGNALS, *TIMES, "--axis", "lag"], "expected lag=low:high:nominal"),
            ([*SIGNALS, *TIMES, "--axis", "lag=2:3"], "not in order"),
            ([*SIGNALS, *TIMES, "--axis", "lag=a:b"], "expected numbers"),
            ([*SIGNALS, *TIMES, "--formula", "always(level)"], "expected name=value"),
            ([*SIGNALS, *TIMES, "--action", "lag", "--observation", "level"], "expected a real input"),
            ([*SIGNALS, *TIMES, "--action", "extra"], "need each other"),
            ([*SIGNALS, *TIMES, "--set", "lag=x"], "--set"),
        ):
            ended = subprocess.run([*START, *words], cwd=folder, capture_output=True, text=True, timeout=20)
            self.assertNotEqual(ended.returncode, 0, words)
            self.assertRegex(ended.stderr, expected)
            self.assertEqual(ended.stdout, "")
