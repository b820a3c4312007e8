"""Checks before the first simulation, Boolean verdicts, and statements about points that a search
chose."""

import html
import pathlib
import re
import tempfile
import unittest
import warnings
from collections.abc import Callable
from typing import Any

import mishandle
from mishandle import Axis


def warned(system: Any, formula: str, space: list[Axis], **settings: Any) -> str:
    """Returns the warnings of a falsification."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mishandle.falsify(
            system, formula, space, trials=1, budget=20, out=f"{folder}/run.sqlite", **settings
        )
    return "\n".join(str(warning.message) for warning in caught)


class PreflightTest(unittest.TestCase):
    def test_a_nominal_scenario_that_fails_is_named(self) -> None:
        found = warned(lambda scenario: {"y": [-1.0, -1.0]}, "always(y >= 0)", [Axis("a", 0, 1)])
        self.assertIn("the nominal scenario violates the requirement", found)

    def test_a_requirement_that_sample_0_decides_is_named(self) -> None:
        found = warned(
            lambda scenario: {"y": [5.0, scenario["a"]]}, "eventually(y >= 3)", [Axis("a", 0, 1)]
        )
        self.assertIn("sample 0 alone satisfies the requirement", found)

    def test_an_axis_that_changes_no_trace_is_named_and_the_others_are_not(self) -> None:
        axes = [Axis("a", 0, 1), Axis("typo", 0, 1)]
        found = warned(lambda scenario: {"y": [scenario["a"], 1.0]}, "always(y >= -1)", axes)
        self.assertIn("axis `typo` changes no trace", found)
        self.assertNotIn("axis `a`", found)

    def test_the_claim_about_an_axis_is_taken_back_if_it_has_an_effect(self) -> None:
        def system(scenario: dict[str, float]) -> dict[str, list[float]]:
            return {"y": [-1.0 if 0.2 < scenario["a"] < 0.7 else 1.0] * 2}

        axes = [Axis("a", 0, 1, nominal=0), Axis("typo", 0, 1, nominal=0)]
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            out = f"{folder}/run.sqlite"
            answer = mishandle.falsify(
                system, "always(y >= 0)", axes, search="random", trials=1, budget=40, out=out
            )
            answer.report(f"{folder}/page.html")
            page = pathlib.Path(f"{folder}/page.html").read_text()
        self.assertEqual(answer.falsified_trials, 1)
        said = "\n".join(str(warning.message) for warning in found)
        for text in [said, "\n".join(answer.warnings), html.unescape(page)]:
            self.assertIn("changes no trace at the probed points", text)
            self.assertNotIn("axis `a` changes", text)

    def test_the_time_of_a_push_is_probed_with_its_force(self) -> None:
        def pushed(scenario: dict[str, float]) -> dict[str, list[float]]:
            sample = round(scenario["time"])
            return {"y": [scenario["force"] if index == sample else 0.0 for index in range(5)]}

        axes = [
            Axis("time", 1, 4, kind="event", nominal=1),
            Axis("force", 0, 1, kind="event", nominal=0)
        ]
        self.assertEqual(warned(pushed, "always(y <= 2)", axes), "")

    def test_a_premise_that_never_holds_is_named(self) -> None:
        found = warned(
            lambda scenario: {"y": [scenario["a"], 0.5]}, "always(y > 2 implies y < 0)",
            [Axis("a", 0, 1)]
        )
        self.assertIn("the premise `y > 2` held at no sample", found)

    def test_a_sound_question_has_no_warning(self) -> None:
        found = warned(
            lambda scenario: {"y": [1.0, scenario["a"]]}, "always(y >= -1)", [Axis("a", 0, 1)]
        )
        self.assertEqual(found, "")


class VerdictTest(unittest.TestCase):
    def test_a_count_of_zero_satisfies_equality(self) -> None:
        for formula, rate in [
            ("always(n == 0)", 1.0), ("always(n <= 0)", 1.0), ("always(n < 0)", 0.0)
        ]:
            with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                out = f"{folder}/run.sqlite"
                found = mishandle.evaluate(
                    lambda scenario: {"n": [0, 0]}, formula, [Axis("x", 0, 1)], episodes=12, out=out
                )
            self.assertEqual(found.success_rate.value, rate, formula)

    def test_requirements_have_results_of_their_own(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            found = mishandle.evaluate(
                lambda scenario: {"y": [0.0, scenario["a"]], "big": [0.0, 1000 * scenario["a"]]},
                space=[Axis("a", 0, 1)],
                requirements={"small": "always(y <= 0.5)", "large": "always(big <= 2000)"},
                episodes=40, out=f"{folder}/run.sqlite"
            )
        counts = {
            requirement.name: requirement.violated for requirement in found.requirements or []
        }
        self.assertEqual(counts["large"], 0)
        self.assertTrue(0 < counts["small"] < 40, counts)


class AdaptiveTest(unittest.TestCase):
    """Only ``a`` has an effect, and the failures are one half-space."""

    def run_of(self, folder: str, search: str) -> mishandle.runs.Run:
        out = f"{folder}/{search}.sqlite"
        axes = [Axis(name, 0, 1) for name in "abcdefghij"]
        mishandle.falsify(
            lambda scenario: {"y": [0.5 - scenario["a"]] * 2}, "always(y >= 0)", axes,
            trials=2, budget=80, search=search, out=out, plan={"falsify": {"keep_going": True}}
        )
        return mishandle.open_run(out)

    def test_points_of_a_search_name_no_axis_and_make_one_mode(self) -> None:
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for search, expected in [("portfolio", None), ("random", ["a"])]:
                run = self.run_of(folder, search)
                page = pathlib.Path(f"{folder}/{search}.html")
                run.report(page, plan={"report": {"simulations": False}})
                text = re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", page.read_text())))
                effects = re.search(r"each explains alone: (.*?)\. An", text)
                named = effects and re.findall(r"([a-j]) \d+ %", effects[1])
                self.assertEqual(named, expected, search)
                self.assertEqual(len(run.failure_modes()), 1, search)

    def test_the_first_counterexample_moves_to_the_axis_that_causes_it(self) -> None:
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            axes = [Axis(name, 0, 1, nominal=0) for name in "abcdefghij"]
            found = mishandle.falsify(
                lambda scenario: {"y": [0.5 - scenario["a"]] * 2}, "always(y >= 0)", axes, trials=3,
                out=f"{folder}/run.sqlite"
            )
        for trial in found.trials:
            cause = trial.cause
            assert cause is not None
            self.assertEqual(
                (cause.axes, cause.sufficient, cause.necessary), (("a",), ("a",), ("a",))
            )
            self.assertLessEqual(cause.simulations, 30)

    def test_a_failure_only_on_a_bound_is_marked_and_an_open_bound_excludes_it(self) -> None:
        axes = [Axis("a", 0, 1, nominal=0), Axis("b", 0, 1, nominal=0)]

        def falsified(
            fails: Callable[[float], bool], **options: Any
        ) -> mishandle.ask.Falsification:
            def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
                return {"y": [-1.0 if fails(scenario["a"]) else 1.0] * 2}

            with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return mishandle.falsify(
                    system, "always(y >= 0)", axes, trials=2, budget=60, out=f"{folder}/run.sqlite",
                    **options
                )

        for fails, expected in [(lambda a: a >= 1, ("a",)), (lambda a: a > 0.999, ())]:
            found = falsified(fails)
            self.assertEqual(found.falsified_trials, 2)
            for trial in found.trials:
                assert trial.cause is not None
                self.assertEqual((trial.cause.only_on_bounds, trial.cause.axes), (expected, ("a",)))
        found = falsified(lambda a: a >= 1, axes={"a": "[0, 1)"})
        self.assertEqual(found.falsified_trials, 0)
        found = falsified(lambda a: a > 0.9, plan={"falsify": {"fixed_seed": 5}})
        self.assertEqual({trial.seed for trial in found.trials}, {5})


class ModesTest(unittest.TestCase):
    def test_a_mode_never_mixes_categories(self) -> None:
        def faults(scenario: dict[str, Any]) -> dict[str, list[float]]:
            y = {
                "none": 1, "a": 1, "b": 0.5 - scenario["severity"], "d": 0.9 - scenario["severity"]
            }[scenario["fault"]]
            return {"y": [y, y]}

        space = [
            Axis("fault", values=["none", "a", "b", "d"], kind="event"),
            Axis("severity", 0, 1, kind="event", nominal=0),
        ]
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            out = f"{folder}/run.sqlite"
            mishandle.falsify(
                faults, "always(y >= 0)", space, trials=1, budget=100, out=out, seed=1,
                plan={"falsify": {"keep_going": True, "new_mode_rate": 0}}
            )
            modes = mishandle.open_run(out).failure_modes()
        regions = [mode.region["fault"] for mode in modes]
        self.assertTrue(
            all(region is not None and region[0] == region[1] for region in regions), regions
        )
        self.assertGreater(len(modes), 1)
