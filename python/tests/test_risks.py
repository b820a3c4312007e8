"""The probability of a failure, from Python."""

import math
import pickle
from typing import Any

from cases import FolderCase
import mishandle
from mishandle import Axis
from mishandle.errors import InvalidValueError
from test_margins import Push

SPEED = [Axis("speed", 0, 10, "m/s")]


def gap(scenario: dict[str, Any]) -> dict[str, list[float]]:
    return {"gap": [10.0, 10.0 - scenario["speed"]]}


def distributed(**distributions: Any) -> dict[str, Any]:
    return {"risk": {"distributions": distributions}}


class Risks(FolderCase):
    def test_a_closed_form_is_in_the_interval(self) -> None:
        # Uniform from 0 to 10 m/s, the gap is too small above 8 m/s: 2 / 10.
        found = mishandle.risk(gap, "always(gap >= 2)", SPEED, simulations=2000, seed=1)
        assert found.probability is not None
        self.assertTrue(found.probability.low < 0.2 < found.probability.high, found.probability)
        self.assertEqual(
            (found.probability.source, found.probability.assumption), ("monte-carlo", None)
        )
        self.assertEqual((found.monte_carlo.simulations, found.simulations), (2000, 2000))
        self.assertEqual(found.monte_carlo.failures / 2000, found.probability.value)
        self.assertEqual(found.bounds, (found.probability.low, found.probability.high))
        self.assertEqual(vars(found.distribution[0])["distribution"], "uniform")

    def test_a_policy_in_an_environment(self) -> None:
        # The policy cancels pushes of up to 1: |push| > 1.1 of a uniform push from -2 to 2 fails,
        # 45 %.
        found = mishandle.risk(
            Push(), "always(abs(x) <= 1)", [Axis("push", -2, 2, kind="event")],
            policy=lambda observation: -observation, signals={"x": "x"}, steps=10, simulations=400
        )
        self.assertTrue(found.bounds[0] < 0.45 < found.bounds[1], found.bounds)

    def test_a_failure_is_a_counterexample(self) -> None:
        found = mishandle.risk(gap, "always(gap >= 2)", SPEED, simulations=200, name="car")
        file = found.export(self.folder / "failure.json")
        again = mishandle.replay(file, gap, "always(gap >= 2)", SPEED, name="car")
        self.assertEqual(
            (again.differences, again.repetition.scenario), ((), found.failures[0].scenario)
        )
        with self.assertRaisesRegex(InvalidValueError, "failure is 9"):
            found.export(file, failure=9)
        copied = pickle.loads(pickle.dumps(found)).export(self.folder / "copied.json")
        self.assertEqual(copied.read_bytes(), file.read_bytes())

    def test_the_progress_is_reported(self) -> None:
        done: list[tuple[int, int]] = []
        report = lambda *numbers: done.append(numbers)
        mishandle.risk(gap, "always(gap >= 0.05)", SPEED, simulations=500, progress=report)
        self.assertEqual(done[-1], (500, 500))

    def test_impossible_requests_are_errors_before_the_first_simulation(self) -> None:
        calls: list[Any] = []

        def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
            calls.append(scenario)
            return {"gap": [1.0] * 2}

        for options, text in [
            ({"plan": distributed(mass="uniform")}, "no axis `mass`"),
            ({"plan": distributed(speed="gamma:1")}, "`gamma:1` is unknown"),
            ({"plan": distributed(speed="normal:nan:1")}, "speed|nan"),
            ({"plan": distributed(speed="normal:900:1")}, "almost no probability from 0 to 10"),
            ({"plan": distributed(speed=3)}, r'\["speed"\] is 3; it must be a table of dist'),
            ({"plan": {"risk": {"distributions": "normal:5:1"}}}, "it must be a table"),
            ({"simulations": 99}, "from 100 to 1000000000"),
            ({"simulations": 0}, "from 100 to 1000000000"),
            ({"plan": {"risk": {"method": "exact"}}}, "no method `exact`"),
            ({"plan": {"risk": {"batch": 100_000}}}, "the batch size is 100000"),
        ]:
            with self.subTest(text), self.assertRaisesRegex(InvalidValueError, text):
                mishandle.risk(
                    system, "always(gap >= 0)", SPEED, **options  # type: ignore[arg-type]
                )
        self.assertEqual(calls, [])

    def test_a_system_without_a_verdict_was_not_tested(self) -> None:
        def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
            if scenario["speed"] != 5.0:
                raise ValueError("only the nominal speed")
            return {"gap": [1.0] * 2}

        with self.assertRaisesRegex(
            mishandle.MishandleError,
            "simulations have no verdict, so the search stopped.*ValueError: only the nominal speed"
        ) as raised:
            mishandle.risk(system, "always(gap >= 0)", SPEED, simulations=100)
        # Nothing that the caller passed is invalid.
        self.assertNotIsInstance(raised.exception, ValueError)

    def test_a_region_without_a_verdict_is_in_the_bound_and_warned_of(self) -> None:
        # 35 % of the space has no verdict, and nothing else fails.
        def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
            return {"gap": [1.0, math.nan if scenario["speed"] > 6.5 else 1.0]}

        with self.assertWarnsRegex(UserWarning, "have no verdict: .*; no conclusion: "):
            found = mishandle.risk(system, "always(gap >= 0)", SPEED, simulations=400)
        self.assertGreater(found.bounds[1], 0.35)
        self.assertIsNone(found.probability)
        share = found.without_verdict.share
        assert share is not None
        self.assertTrue(0.25 < share < 0.45, share)
        self.assertEqual(found.without_verdict.max_share, 0.05)

    def test_an_evaluation_without_any_verdict_is_warned_of(self) -> None:
        def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
            return {"gap": [1.0, 1.0 if scenario["speed"] == 5.0 else math.nan]}

        with self.assertWarnsRegex(UserWarning, "none of 4 simulations has a verdict.*not tested"):
            found = mishandle.evaluate(system, "always(gap >= 0)", SPEED, episodes=4)
        self.assertIsNone(found.success_rate.value)

    def test_a_mean_outside_of_the_bounds_is_warned_of(self) -> None:
        with self.assertWarnsRegex(
            UserWarning,
            "the mean of the distribution normal:12:3 of speed is outside of its bounds, 0 to 10"
        ):
            mishandle.risk(
                gap, "always(gap >= 2)", SPEED, simulations=100,
                plan=distributed(speed="normal:12:3")
            )

    def test_an_exception_of_the_progress_ends_the_estimation(self) -> None:
        def progress(done: int, total: int) -> None:
            raise KeyboardInterrupt

        for system, options in [(gap, {"space": SPEED}), ("toy/sphere-2d", {})]:
            with self.assertRaises(KeyboardInterrupt) as raised:
                formula = None if isinstance(system, str) else "always(gap >= 2)"
                mishandle.risk(
                    system, formula, simulations=10**9, progress=progress,
                    **options  # type: ignore[arg-type]
                )
            result: mishandle.ask.Risk = raised.exception.result  # type: ignore[attr-defined]
            self.assertEqual((result.is_complete, result.simulations), (False, 64))
            self.assertEqual(result.monte_carlo.simulations, 64)
