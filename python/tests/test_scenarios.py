"""Scenarios that a caller gives, and actions that are dictionaries or tuples."""

import unittest
from typing import Any

import gymnasium
import mishandle
import numpy as np
from mishandle import Axis
from mishandle.errors import InvalidTypeError, InvalidValueError

SPACE = [Axis("x", -1, 1, "m"), Axis("z", 0, 1, "m")]


def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
    return {"y": [scenario["x"]] * 3}


def simulate(at: Any) -> Any:
    return mishandle.simulate(system, "always(y >= -2)", SPACE, at=at)[0].scenario


class At(unittest.TestCase):
    def test_values_are_a_dictionary_or_one_number_for_each_axis(self) -> None:
        self.assertEqual(simulate({"x": 0.25}), {"x": 0.25, "z": 0.5})
        self.assertEqual(simulate(np.array([0.25, 0.75])), {"x": 0.25, "z": 0.75})

    def test_other_values_are_errors_that_name_the_axis(self) -> None:
        for at, text in [
            ("ab", "`at` is 'ab'; expected a dictionary"),
            (b"ab", "`at` is b'ab'"),
            (5, "`at` is 5"),
            ([None, 0.0], "the scenario's `x` is None; expected a number"),
            (["a", 0.0], "the scenario's `x` is 'a'; expected a number"),
            ({"z": None}, "the scenario's `z` is None; expected a number"),
        ]:
            with self.subTest(at=at), self.assertRaises(InvalidTypeError) as caught:
                simulate(at)
            self.assertIn(text, str(caught.exception))
        for at, text in [
            ([0.1], "the scenario has 1 values; expected 2"),
            ([float("nan"), 0.0], "the scenario's `x` is NaN"),
            ({1: 2.0}, "the space has no axis 1; its axes: x, z"),
        ]:
            with self.subTest(at=at), self.assertRaises(InvalidValueError) as caught:
                simulate(at)
            self.assertIn(text, str(caught.exception))


class Composite(gymnasium.Env[Any, Any]):
    """The observation is the sum of the numbers in the last action."""

    def __init__(self, space: gymnasium.Space[Any]) -> None:
        self.action_space = space
        self.observation_space = gymnasium.spaces.Box(-10, 10, (1,))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        self.start = float((options or {}).get("x", 0.0))
        return np.array([self.start]), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert self.action_space.contains(action), action
        parts = action.values() if isinstance(action, dict) else action
        return np.array([
            self.start + sum(float(np.sum(part)) for part in parts)
        ]), 0.0, False, False, {}


class CompositeActions(unittest.TestCase):
    def test_dictionaries_and_tuples_reach_the_environment(self) -> None:
        push, grip = np.array([0.25], dtype=np.float32), 1
        box, discrete = gymnasium.spaces.Box(-1, 1, (1,)), gymnasium.spaces.Discrete(2)
        for space, action in [
            (gymnasium.spaces.Dict({"push": box, "grip": discrete}), {"push": push, "grip": grip}),
            (gymnasium.spaces.Tuple((box, discrete)), (push, grip)),
        ]:
            with self.subTest(space=space):
                [found] = mishandle.simulate(
                    Composite(space), "always(y <= 2)", [Axis("x", 0, 1)], at=[0.5],
                    policy=lambda observation, action=action: action, signals={"y": "obs[0]"},
                    steps=2, control_dt=0.1
                )
                self.assertEqual(found.trace["y"].tolist(), [0.5, 1.75, 1.75])
                self.assertEqual(found.robustness, 0.25)
