"""Files of requirements, checked on systems in Python."""

import json
from typing import Any

from cases import FolderCase
import mishandle
from mishandle import Axis

SPACE = [Axis("speed", 0, 10, "m/s", nominal=0)]

FILE = """
[[requirement]]
name = "R-0"
formula = "always(force <= 1)"
severity = "warning"

[[requirement]]
name = "R-1"
formula = "always(gap >= 2)"
clause = "3.1"

[[requirement]]
name = "R-2"
formula = "always(gap >= -1)"
"""


def car(scenario: dict[str, Any]) -> dict[str, list[float]]:
    return {"gap": [10.0, 10.0 - scenario["speed"]]}


class CheckTests(FolderCase):
    def setUp(self) -> None:
        super().setUp()
        self.file = self.folder / "requirements.toml"
        self.file.write_text(FILE)

    def check(self, system: Any, out: str = "checked", **asked: Any) -> mishandle.ask.Check:
        return mishandle.check(
            system, self.file, SPACE, out=self.folder / out, episodes=60, budget=30, **asked
        )

    def test_verdicts_are_those_of_a_hand_calculation(self) -> None:
        found = self.check(car)
        verdicts = {cell.requirement: cell.verdict for cell in found.cells}
        # The speed is uniform from 0 to 10, so that a fifth of the scenarios leaves less than 2.
        self.assertEqual(
            verdicts, {"R-0": "not applicable", "R-1": "violated", "R-2": "not violated"}
        )
        self.assertEqual(found.exit_code, 1)
        self.assertIn("R-1: violated", str(found))
        rate = found.cells[1].failure_rate
        assert rate is not None and rate.low is not None and rate.high is not None
        self.assertLess(rate.low, 0.2)
        self.assertGreater(rate.high, 0.2)
        for name in ("check.json", "junit.xml", "report.md", "report.html"):
            self.assertIn("R-1", (self.folder / "checked" / name).read_text())
        counterexample = found.cells[1].counterexample
        assert counterexample is not None and counterexample.file is not None
        replayed = mishandle.replay(counterexample.file, car, {"R-1": "always(gap >= 2)"}, SPACE)
        self.assertEqual(replayed.robustness, counterexample.robustness)

    def test_a_second_call_simulates_nothing_and_another_system_is_an_error(self) -> None:
        first = self.check(car)
        calls = []

        def counted(scenario: dict[str, Any]) -> dict[str, list[float]]:
            return car(scenario)

        document = json.loads((self.folder / "checked" / "check.json").read_text())
        again = self.check(car, progress=lambda done, total: calls.append(done))
        self.assertEqual(again.cells, first.cells)
        self.assertEqual(json.loads((self.folder / "checked" / "check.json").read_text()), document)
        with self.assertRaises(mishandle.MishandleError):
            self.check(counted)

    def test_mistakes_in_the_file_and_in_the_arguments(self) -> None:
        with self.assertRaisesRegex(ValueError, r'plan\["check"\]\["fail_on"\] is "fatal"; it'):
            self.check(car, plan={"check": {"fail_on": "fatal"}})
        self.file.write_text(FILE.replace("clause", "claus"))
        with self.assertRaisesRegex(ValueError, "claus"):
            self.check(car)
