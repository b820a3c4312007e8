"""Progress and text of results: a bar by default, none if it is unwanted, and results that print as
the lines that say what they mean."""

import contextlib
import io
import re
import sys
import tempfile
import types
import unittest
import unittest.mock
import warnings
from typing import Any

import mishandle
from mishandle import Axis
from mishandle.base import progress


def car(scenario: dict[str, float]) -> dict[str, list[float]]:
    return {"gap": [10.0, 10.0 - scenario["speed"]]}


class Counted:
    """The same system, which counts its calls."""

    def __init__(self) -> None:
        self.calls = 0

    def __getstate__(self) -> dict[str, int]:
        """What the calls change is no part of the system."""
        return {}

    def __call__(self, scenario: dict[str, float]) -> dict[str, list[float]]:
        self.calls += 1
        return car(scenario)


SPACE = [Axis("speed", 0, 10, "m/s", nominal=0, kind="input")]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def asked(
    stream: io.StringIO, question: Any = mishandle.falsify, system: Any = car, **settings: Any
) -> Any:
    """Asks with this stream as standard error, and without waiting before a bar appears."""
    formula = settings.pop("formula", "always(gap >= 2)")
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stderr(stream), \
            unittest.mock.patch.object(progress, "BAR", (0.0, 0.0)), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return question(system, formula, SPACE, out=f"{folder}/run.sqlite", **settings)


class ProgressTest(unittest.TestCase):
    def test_a_terminal_has_a_bar_that_is_removed(self) -> None:
        stream = Terminal()
        asked(stream, search="random", trials=1, budget=40, plan={"falsify": {"batch": 1}})
        lines = stream.getvalue().split("\r\033[K")
        # Before the first simulation: how many, and about how long.
        self.assertRegex(lines[1], "^at most 40 simulations.*; after 6 probes: about")
        self.assertRegex(lines[2], r"^\[#*-*\] \d+/\d+ simulations, 0:00")
        self.assertEqual(lines[-1], "")

    def test_the_system_is_called_for_the_announced_simulations_alone(self) -> None:
        plan = {"evaluate": {"corners": False, "control": False}}
        risk = {"risk": {"simulations": 100, "method": "monte-carlo"}}
        for question, settings, budget in [
            (mishandle.falsify, {"search": "random", "trials": 1, "budget": 40}, 40),
            (mishandle.evaluate, {"episodes": 30, "plan": plan}, 30),
            (mishandle.margin, {"budget": 50}, 50),
            (mishandle.risk, {"plan": risk}, 100),
        ]:
            stream, system = Terminal(), Counted()
            asked(stream, question, system, formula="always(gap >= -9)", **settings)
            said = re.search(r"at most (\d+) simulations.*; after (\d+) probes", stream.getvalue())
            assert said is not None, stream.getvalue()
            self.assertEqual(int(said[1]), budget)
            self.assertEqual(system.calls, budget + int(said[2]), question)

    def test_false_shows_nothing_and_a_short_question_writes_no_line(self) -> None:
        for stream, settings in [(Terminal(), {"progress": False}), (io.StringIO(), {})]:
            asked(stream, search="random", trials=1, budget=20, **settings)
            self.assertEqual(stream.getvalue(), "")

    def test_a_long_question_writes_lines_without_a_terminal(self) -> None:
        stream = io.StringIO()
        with unittest.mock.patch.object(progress, "LINES", (0.0, 0.0)):
            asked(stream, mishandle.margin, budget=60)
        lines = stream.getvalue().splitlines()
        self.assertRegex(lines[0], "^at most 60 simulations; after 6 probes: about ")
        self.assertRegex(lines[1], r"^\d+/60 simulations, 0:00")

    def test_a_notebook_has_one_text_that_changes(self) -> None:
        texts: list[str] = []

        class Handle:
            def update(self, data: dict[str, str], raw: bool) -> None:
                texts.append(data["text/plain"])

        def display(data: dict[str, str], raw: bool, display_id: bool) -> Handle:
            texts.append("first " + data["text/plain"])
            return Handle()

        python: Any = types.ModuleType("IPython")
        python.get_ipython = lambda: types.SimpleNamespace(kernel=None)
        python.display = types.ModuleType("IPython.display")
        python.display.display = display
        modules = {"IPython": python, "IPython.display": python.display}
        stream = Terminal()
        with unittest.mock.patch.dict(sys.modules, modules):
            asked(stream, search="random", trials=1, budget=20)
        self.assertEqual(stream.getvalue(), "")
        self.assertTrue(texts[0].startswith("first at most 20 simulations"), texts)
        self.assertFalse(any(text.startswith("first") for text in texts[1:]), texts)
        self.assertRegex(texts[-1], r"simulations, 0:0\d$")

    def test_a_function_gets_the_numbers_and_other_values_are_refused(self) -> None:
        found: list[tuple[int, int]] = []
        stream = Terminal()
        asked(
            stream, search="random", trials=1, budget=20,
            progress=lambda done, total: found.append((done, total))
        )
        self.assertEqual((found[-1][0] > 0, stream.getvalue()), (True, ""))
        with self.assertRaisesRegex(TypeError, "progress is True"):
            asked(stream, search="random", trials=1, budget=20, progress=True)


class PrintedTest(unittest.TestCase):
    def test_a_result_prints_its_lines_and_is_one_line_in_a_list(self) -> None:
        stream = io.StringIO()
        for question, settings in [
            (mishandle.falsify, {"search": "random", "trials": 2, "budget": 30}),
            (mishandle.evaluate, {"episodes": 20}),
            (mishandle.margin, {"budget": 60}),
            (mishandle.risk, {"plan": {"risk": {"simulations": 100}}}),
        ]:
            found = asked(stream, question, **settings)
            text = str(found)
            self.assertLess(len(text), 4000, question)
            self.assertIn("python/car", text)
            self.assertNotIn("Number(", text)
            shown = repr(found)
            self.assertTrue(shown.startswith(f"<{type(found).__name__}: "), shown)
            self.assertTrue("\n" not in shown and len(shown) <= 120, shown)
            # The call of the text is escaped.
            table = found._repr_html_()
            self.assertIn("&quot;report.html&quot;", table)
            self.assertIn("<table><tr><th>", table)
            self.assertIn("without_verdict", vars(found))


if __name__ == "__main__":
    unittest.main()
