"""The smallest disturbance, from Python."""

import os
import pickle
import signal
from typing import Any

from cases import FolderCase, take_interrupts
import gymnasium
import mishandle
import numpy as np
from mishandle import Axis
from mishandle.errors import InvalidTypeError, InvalidValueError

def half_space(scenario: dict[str, Any]) -> dict[str, list[float]]:
    return {"y": [0.3 - (0.5 * scenario["a"] - 0.3 * scenario["b"] + 0.2 * scenario["c"])] * 2}


INPUTS = [Axis(name, -1, 1, kind="input") for name in "abc"]


class Push(gymnasium.Env[Any, Any]):
    """A mass that a push moves; the policy can hold it up to a force of 1."""

    def __init__(self) -> None:
        self.action_space = gymnasium.spaces.Box(-1, 1, (1,))
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.push, self.x = float((options or {}).get("push", 0.0)), 0.0
        return np.array([self.push]), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.x += self.push + float(np.clip(action[0], -1, 1))
        return np.array([self.push]), 0.0, False, False, {}


class Margins(FolderCase):
    def test_the_witness_is_a_counterexample(self) -> None:
        found = mishandle.margin(half_space, "always(y >= 0)", INPUTS, budget=500, name="half")
        file = pickle.loads(pickle.dumps(found)).export(self.folder / "witness.json")
        again = mishandle.replay(file, half_space, "always(y >= 0)", INPUTS, name="half")
        self.assertEqual((again.differences, again.build_differences), ((), ()))
        assert found.witness is not None
        self.assertEqual(again.repetition.scenario, found.witness.scenario)
        self.assertEqual(again.recorded_robustness, found.witness.robustness)
        test = mishandle.regress(
            self.folder, lambda scenario: {"y": [1.0] * 2}, "always(y >= 0)", INPUTS, name="half"
        )
        self.assertEqual((test.passes, test.fails), (1, 0))
        with self.assertRaisesRegex(InvalidValueError, "leave out `trial`"):
            mishandle.replay(file, half_space, "always(y >= 0)", INPUTS, trial=1)
        with self.assertRaisesRegex(mishandle.MishandleError, "must end with .json"):
            found.export(self.folder / "witness.txt")

    def test_a_policy_in_an_environment_has_the_margin_of_its_actuator(self) -> None:
        # The policy cancels a push of up to 1; x exceeds 1 after 10 steps if the rest is more than
        # 0.1: 1.1 of 2 is 0.55.
        space = [Axis("push", -2, 2, kind="event")]
        policy = lambda observation: -observation
        found = mishandle.margin(
            Push(), "always(abs(x) <= 1)", space, policy=policy, signals={"x": "x"}, steps=10,
            budget=300
        )
        assert found.witness is not None
        self.assertTrue(0.55 <= found.witness.amplitude < 0.57, found.witness)

    def test_a_margin_names_the_categories_that_it_keeps_and_searches_each_of_them_if_asked(
        self
    ) -> None:
        # A push of 80 % fails on dry ground, of 30 % on wet ground.
        space = [Axis("ground", values=["dry", "wet"], kind="model"), *INPUTS[:1]]
        limits = {"dry": 0.8, "wet": 0.3}
        system = lambda scenario: {"y": [limits[scenario["ground"]] - scenario["a"]] * 2}
        found = mishandle.margin(system, "always(y >= 0)", space, budget=200)
        assert found.witness is not None
        self.assertEqual((found.categories, found.each_category), ({"ground": "dry"}, ()))
        self.assertTrue(0.8 <= found.witness.amplitude < 0.82)
        plan = {"margin": {"each_category": True}}
        found = mishandle.margin(system, "always(y >= 0)", space, budget=200, plan=plan)
        assert found.witness is not None
        self.assertEqual(
            (found.categories, found.witness.scenario["ground"]), ({"ground": "wet"}, "wet")
        )
        self.assertTrue(0.3 <= found.witness.amplitude < 0.32)
        dry, wet = found.each_category
        assert dry.amplitude is not None
        self.assertEqual((dry.categories, wet.categories), ({"ground": "dry"}, {"ground": "wet"}))
        self.assertTrue(0.8 <= dry.amplitude < 0.82 and wet.amplitude == found.witness.amplitude)
        self.assertEqual(found.simulations, dry.simulations + wet.simulations)

    def test_a_safe_system_has_no_witness(self) -> None:
        found = mishandle.margin(half_space, "always(y >= -2)", INPUTS, budget=200)
        self.assertEqual(
            (found.witness, found.no_violation_up_to, len(found.levels)), (None, 1.0, 1)
        )
        self.assertEqual(
            (found.no_violation_simulations, found.simulations, found.is_complete), (200, 200, True)
        )
        with self.assertRaisesRegex(mishandle.MishandleError, "no witness"):
            found.export("witness.json")

    def test_impossible_requests_are_errors_before_the_first_simulation(self) -> None:
        calls: list[Any] = []

        def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
            calls.append(scenario)
            return {"y": [1.0] * 2}

        for space, options, text in [
            ([Axis("a", 0, 1)], {}, "the number of disturbed axes is 0.*whose `kind` is \"model\""),
            (INPUTS, {"budget": 0}, "budget is 0"),
            (INPUTS, {"budget": 2_000_000}, "the budget is 2000000"),
            (INPUTS, {"seed": -1}, "seed is -1"),
        ]:
            with self.subTest(text), self.assertRaisesRegex(InvalidValueError, text):
                mishandle.margin(
                    system, "always(y >= 0)", space, **options  # type: ignore[arg-type]
                )
        self.assertEqual(calls, [])
        with self.assertRaisesRegex(InvalidTypeError, "no argument `budgets`"):
            mishandle.margin(system, "always(y >= 0)", INPUTS, budgets=3)  # type: ignore[call-arg]

    def test_a_system_without_a_verdict_was_not_tested(self) -> None:
        with self.assertWarnsRegex(UserWarning, "no verdict"), self.assertRaisesRegex(
            mishandle.MishandleError,
            "simulations have no verdict, so the search stopped.*`y` is not finite"
        ):
            mishandle.margin(
                lambda scenario: {"y": [float("nan")] * 2}, "always(y >= 0)", INPUTS, budget=50
            )

    def test_an_exception_of_the_progress_ends_the_search(self) -> None:
        def progress(done: int, total: int) -> None:
            if done > 100:
                raise KeyboardInterrupt

        with self.assertRaises(KeyboardInterrupt) as raised:
            mishandle.margin(half_space, "always(y >= 0)", INPUTS, progress=progress)
        result: mishandle.ask.Margin = raised.exception.result  # type: ignore[attr-defined]
        self.assertTrue(100 < result.simulations < 100 + 2 * 64 and not result.is_complete)

    def test_ctrl_c_ends_the_search_after_the_batch_and_keeps_the_witness_so_far(self) -> None:
        take_interrupts(self)
        calls = 0

        def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
            nonlocal calls
            calls += 1
            # After the first violations, in the middle of a batch. The checks before the search
            # call the system, too, and how often depends on how fast it is.
            if calls == 1500:
                os.kill(os.getpid(), signal.SIGINT)
            return half_space(scenario)

        with self.assertRaises(KeyboardInterrupt) as raised:
            mishandle.margin(system, "always(y >= 0)", INPUTS)
        result: mishandle.ask.Margin = raised.exception.result  # type: ignore[attr-defined]
        self.assertTrue(500 < result.simulations <= calls < 1500 + 64, (result.simulations, calls))
        self.assertFalse(result.is_complete)
        assert result.witness is not None
        self.assertLess(result.witness.robustness, 0)
        self.assertIs(signal.getsignal(signal.SIGINT), signal.default_int_handler)
        self.assertTrue(result.export(self.folder / "witness.json").exists())

    def test_a_second_ctrl_c_interrupts_at_once(self) -> None:
        take_interrupts(self)
        calls = 0

        def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
            nonlocal calls
            calls += 1
            if calls in (1500, 1501):
                os.kill(os.getpid(), signal.SIGINT)
            return half_space(scenario)

        with self.assertRaises(KeyboardInterrupt) as raised:
            mishandle.margin(system, "always(y >= 0)", INPUTS)
        self.assertEqual((calls, hasattr(raised.exception, "result")), (1501, False))

    def test_exceptions_are_kept(self) -> None:
        def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
            if scenario["a"] > 0.5:
                raise ValueError("too far")
            return {"y": [1.0 + scenario["a"]] * 2}

        found = mishandle.margin(system, "always(y >= 0.2)", INPUTS[:1], budget=1000)
        self.assertIn("too far", found.exceptions[0])
        self.assertIsNotNone(found.witness)
