"""The plugin for pytest, in a folder that is not this repository."""

import json
import re
import subprocess
import sys
import textwrap
import xml.etree.ElementTree
from typing import Any

from cases import FolderCase

HEAD = """
import mishandle
from mishandle import Axis

SPACE = [Axis("speed", 0, 10, "m/s", nominal=0)]

def car(scenario):
    return {"gap": [10.0, 10.0 - FACTOR * scenario["speed"]]}
"""

GAP = """
FACTOR = 1.0

@mishandle.requirement("always(gap >= 2)", space=SPACE, budget=60)
def test_gap():
    return car
"""


class PluginTests(FolderCase):
    def write(self, *parts: str) -> None:
        (self.folder / "test_car.py").write_text(
            textwrap.dedent("".join([HEAD, *parts])), encoding="utf-8"
        )

    def pytest(self, *words: str, expected: int) -> str:
        command = [sys.executable, "-m", "pytest", "--color=no", "-p", "no:randomly", *words]
        done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, expected, done.stdout + done.stderr)
        return done.stdout

    def counts(self, text: str) -> tuple[int, int, int]:
        found = re.search(r"mishandle: (\d+) requirements?, (\d+) cached, (\d+) simulations", text)
        assert found is not None, text
        return int(found[1]), int(found[2]), int(found[3])

    def state(self) -> dict[str, Any]:
        [file] = (self.folder / ".mishandle").glob("*/state.json")
        found: dict[str, Any] = json.loads(file.read_text())
        return found

    def test_a_violation_has_its_counterexample_picture_and_command_and_is_cached(self) -> None:
        self.write(GAP)
        text = self.pytest(expected=1)
        self.assertIn("violated: always(gap >= 2)", text)
        speed = float(re.search(r"speed = (\S+) m/s \(nominal 0\)", text)[1])  # type: ignore[index]
        self.assertGreater(speed, 8)
        for kind in ("counterexample", "page", "picture"):
            file = re.search(rf"{kind}: (\S+)", text)[1]  # type: ignore[index]
            self.assertGreater((self.folder / file).stat().st_size, 100, kind)
        self.assertEqual(self.counts(text)[1], 0)
        again = self.pytest(expected=1)
        self.assertIn("cached: nothing that decides it changed", again)
        self.assertEqual(self.counts(again), (1, 1, 0))
        # The known counterexample decides after one simulation.
        fresh = self.pytest("--mishandle-no-cache", expected=1)
        self.assertEqual(self.counts(fresh), (1, 0, 1))
        replay = re.search(r"replay: pytest (.*)", text)[1]  # type: ignore[index]
        self.assertIn("still violates", self.pytest(*replay.split(), expected=1))

    def test_a_repaired_system_passes_then_is_cached_and_breaks_at_the_known_counterexample(
        self
    ) -> None:
        self.write(GAP)
        self.pytest(expected=1)
        self.write(GAP.replace("1.0", "0.5"))
        text = self.pytest("-v", expected=0)
        # One known counterexample, and a search that spends its budget.
        self.assertEqual(self.counts(text), (1, 0, 61))
        self.assertIn("not violated in 60 simulations", text)
        self.assertEqual(self.counts(self.pytest(expected=0)), (1, 1, 0))
        # Another budget, seed or system is another key.
        self.assertEqual(
            self.counts(self.pytest("--mishandle-budget", "30", expected=0)), (1, 0, 31)
        )
        self.assertEqual(
            self.counts(
                self.pytest("--mishandle-budget", "30", "--mishandle-seed", "5", expected=0)
            ),
            (1, 0, 31)
        )
        self.write(GAP)
        self.assertEqual(self.counts(self.pytest(expected=1)), (1, 0, 1))

    def test_fixtures_parameters_settings_and_junit(self) -> None:
        (self.folder / "pytest.ini").write_text(
            "[pytest]\nmishandle_budget = 20\nmishandle_folder = found\n"
        )
        self.write(
            """
import pytest
FACTOR = 1.0

@pytest.fixture
def factor():
    return 0.5

@pytest.mark.parametrize("offset", [10.0, 1.0])
@mishandle.requirement("always(gap >= 0)", space=SPACE)
def test_offset(offset, factor):
    return lambda scenario: {"gap": [offset, offset - factor * scenario["speed"]]}

@mishandle.requirement("always(height >= -1000)", target="toy/noisy")
def test_toy():
    pass

def test_other():
    assert True
"""
        )
        text = self.pytest("--junitxml", "report.xml", expected=1)
        self.assertIn("1 failed, 3 passed", text)
        cases = xml.etree.ElementTree.parse(self.folder / "report.xml").getroot().iter("testcase")
        failed = [case.get("name") for case in cases if case.find("failure") is not None]
        self.assertEqual(failed, ["test_offset[1.0]"])
        self.assertTrue((self.folder / "found" / ".gitignore").is_file())

    def test_a_broken_formula_and_an_exception_are_errors_of_the_test_and_not_cached(self) -> None:
        self.write(GAP.replace("always(gap >= 2)", "always(gap >=)"))
        self.assertIn("gap >=", self.pytest(expected=1))
        self.write(
            """
FACTOR = 1.0

def crash(scenario):
    raise ZeroDivisionError("wheel without radius")

@mishandle.requirement("always(gap >= 2)", space=SPACE, budget=5)
def test_crash():
    return crash
"""
        )
        self.assertIn("wheel without radius", self.pytest(expected=1))
        self.write(
            """
FACTOR = 1.0

def crash(scenario):
    return {"gap": [10.0, 3.0 if scenario["speed"] < 5 else 1 / 0]}

@mishandle.requirement("always(gap >= 2)", space=SPACE, budget=10)
def test_crash():
    return crash
"""
        )
        # A requirement does not hold where the system crashes.
        text = self.pytest("--mishandle-no-cache", expected=1)
        self.assertIn("ZeroDivisionError", text)
        self.assertRegex(text, r"[1-9] of 10 simulations failed")
        (self.folder / ".mishandle").rename(self.folder / "first")
        self.write(GAP.replace("always(gap >= 2)", "always(gap >=)"))
        self.pytest(expected=1)
        self.assertEqual(list((self.folder / ".mishandle").glob("*/state.json")), [])

    def test_a_system_that_mostly_ends_without_a_verdict_passes_no_test(self) -> None:
        source = """
import math
FACTOR = 1.0

def diverging(scenario):
    return {"gap": [10.0, 3.0 + scenario["speed"] if scenario["speed"] < 5 else math.nan]}

@mishandle.requirement("always(gap >= 2)", space=SPACE, budget=20OPTIONS)
def test_diverging():
    return diverging
"""
        self.write(source.replace("OPTIONS", ""))
        text = self.pytest(expected=1)
        self.assertRegex(text, r"no conclusion about .*: .* of 20 simulations .* no verdict: ")
        self.write(source.replace("OPTIONS", ', plan={"max_without_verdict": 0.99}'))
        self.pytest(expected=0)

    def test_what_asks_nothing_passes_no_test(self) -> None:
        for formula in ("gap >= 2", "always(gap <= -60 implies gap >= 2)"):
            self.write(GAP.replace("always(gap >= 2)", formula))
            self.assertIn("not violated: asks nothing: ", self.pytest(expected=1))

    def test_nothing_passes_where_the_plugin_simulates_nothing(self) -> None:
        off = ["-p", "no:mishandle"]
        self.write(GAP)
        self.assertIn("`pytest -p mishandle`", self.pytest(*off, expected=1))
        self.assertIn("violated: always(gap >= 2)", self.pytest("-p", "mishandle", expected=1))
        with_target = GAP.replace("space=SPACE", 'target="toy/noisy"').replace("return car", "pass")
        self.write(with_target)
        self.assertIn("would simulate nothing", self.pytest(*off, expected=1))
        methods = "".join(f"    {line}\n" for line in GAP.split("\n\n")[1].splitlines())
        methods = methods.replace("test_gap()", "test_gap(self)")
        case = f"\nimport unittest\nFACTOR = 1.0\n\nclass TestCar(unittest.TestCase):\n{methods}"
        self.write(case)
        for words in ([], off):
            self.assertIn("unittest.TestCase", self.pytest(*words, expected=1))
        command = [sys.executable, "-m", "unittest", "test_car"]
        done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("would simulate nothing", done.stderr)
        # A method of another class is tested, also inside another decorator.
        patched = methods.replace("@mish", "@unittest.mock.patch('os.sep', '/')\n    @mish", 1)
        self.write(f"\nimport unittest.mock\nFACTOR = 1.0\n\nclass TestCar:\n{patched}")
        self.assertIn("violated: always(gap >= 2)", self.pytest(expected=1))

    def test_a_nondeterministic_system_is_called_so(self) -> None:
        self.write(
            """
import random
FACTOR = 1.0

@mishandle.requirement("always(gap >= -5)", space=SPACE, budget=5)
def test_noise():
    return lambda scenario: {"gap": [10.0, random.random()]}
"""
        )
        text = self.pytest("-rP", expected=0)
        self.assertIn("not deterministic", text)

    def test_workers_of_xdist_share_the_folder(self) -> None:
        try:
            import xdist  # noqa: F401
        except ImportError:
            self.skipTest("pytest-xdist is not installed")
        self.write(
            GAP.replace("1.0", "0.5"), GAP.replace("test_gap", "test_more").replace("1.0", "0.5")
        )
        self.assertEqual(self.counts(self.pytest("-n", "2", expected=0)), (2, 0, 120))
        self.assertEqual(self.counts(self.pytest("-n", "2", expected=0)), (2, 2, 0))

    def test_the_package_does_not_import_pytest(self) -> None:
        code = "import sys, mishandle; sys.exit('pytest' in sys.modules)"
        self.assertEqual(subprocess.run([sys.executable, "-c", code], check=False).returncode, 0)
