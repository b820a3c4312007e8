"""Environments that settle after a reset, and starts that are invalid."""

import unittest
from typing import Any

import gymnasium
import mishandle
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from mishandle import Axis
from mishandle.errors import InvalidTypeError, InvalidValueError

SPACE = [Axis("height", 0.0, 8.0, nominal=2.0)]


class Falling(gymnasium.Env[Any, Any]):
    """Falls by 1 in each control step, to the ground at 0; the action lifts it. Ends above 7."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space = gymnasium.spaces.Box(0, 3, (1,), np.float64)
    metadata: dict[str, Any] = {}
    dt = 0.1

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.height = float((options or {}).get("height", 2.0))
        return np.array([self.height]), {"bounced": False}

    def step(self, action: Any) -> Any:
        self.height = max(self.height - 1.0 + float(action[0]), 0.0)
        return np.array([self.height]), 0.0, self.height > 7, False, {"bounced": self.height == 0.0}


OPTIONS: dict[str, Any] = {
    "policy": lambda observation: np.array([2.0]), "signals": {"height": "obs[0]"}, "steps": 3
}


def environments() -> list[Any]:
    return [
        Falling(), SyncVectorEnv([Falling] * 2), AsyncVectorEnv([Falling] * 2),
        AsyncVectorEnv([Falling] * 2, autoreset_mode=AutoresetMode.DISABLED),
        AsyncVectorEnv([Falling] * 2, autoreset_mode=AutoresetMode.SAME_STEP),
    ]


class Starts(unittest.TestCase):
    def trace(self, environment: Any, height: float, **options: Any) -> tuple[str, list[float]]:
        [episode] = mishandle.simulate(
            environment, "always(height <= 100)", SPACE, at={"height": height}, **OPTIONS, **options
        )
        return episode.end, list(episode.trace["height"])

    def test_the_first_sample_is_after_the_settling(self) -> None:
        for environment in environments():
            self.assertEqual(self.trace(environment, 2.0), ("completed", [2, 3, 4, 5]))
            self.assertEqual(self.trace(environment, 2.0, settle=1), ("completed", [1, 2, 3, 4]))
            self.assertEqual(
                self.trace(environment, 3.5, settle=2), ("completed", [1.5, 2.5, 3.5, 4.5])
            )
            self.assertEqual(
                self.trace(environment, 2.0, settle=(2, np.array([1.5]))),
                ("completed", [3, 4, 5, 6])
            )
            environment.close()

    def test_an_invalid_start_has_no_verdict(self) -> None:
        for environment in environments():
            invalid = lambda observation, info: observation[0] == 0 or bool(info["bounced"])
            for height, end in (
                (1.5, "completed"), (1.0, "invalid scenario"), (0.5, "invalid scenario")
            ):
                self.assertEqual(self.trace(environment, height, settle=1, invalid=invalid)[0], end)
            found = mishandle.evaluate(
                environment, "always(height >= 3)", SPACE, **OPTIONS, settle=1,
                invalid=lambda observation, info: observation[0] < 4,
                episodes=60, plan={"evaluate": {"batch": 2}}, seed=3, out=None,
            )
            # All valid starts are at least 4 high, so each episode succeeds until it ends above 7.
            rows = mishandle.open_run(found.path).columns()
            for height, end, robustness in zip(rows["height"], rows["end"], rows["robustness"]):
                self.assertEqual(end == "invalid scenario", height - 1 < 4 or height - 1 > 7)
                self.assertEqual(
                    robustness is None, end == "invalid scenario" or end == "terminated"
                )
            found.path.unlink()
            environment.close()

    def test_an_episode_that_ends_while_it_settles_is_invalid(self) -> None:
        for environment in environments():
            self.assertEqual(
                self.trace(environment, 6.0, settle=(3, np.array([2.0])))[0], "invalid scenario"
            )
            self.assertEqual(
                self.trace(environment, 2.0, settle=(3, np.array([2.0])))[0], "completed"
            )
            environment.close()

    def test_a_time_limit_counts_the_settling(self) -> None:
        limited = gymnasium.wrappers.TimeLimit(Falling(), 10)
        limited.unwrapped.max_episode_steps = 10  # type: ignore[attr-defined]
        options = {name: value for name, value in OPTIONS.items() if name != "steps"}
        [episode] = mishandle.simulate(
            limited, "always(height <= 100)", SPACE, at={"height": 4.0}, settle=4,
            **{**options, "policy": lambda o: np.array([1.0])}
        )
        self.assertEqual(
            (episode.end, episode.steps, list(episode.trace["height"])), ("completed", 6, [0.0] * 7)
        )

    def test_settings_are_a_part_of_the_identity(self) -> None:
        hashes = []
        for options in (
            {}, {"settle": 1}, {"settle": 2}, {"invalid": lambda observation, info: False}
        ):
            found = mishandle.evaluate(
                Falling(), "always(height <= 100)", SPACE, **OPTIONS, **options, episodes=1
            )
            hashes.append(found.target_hash)
            found.path.unlink()
        self.assertEqual(len(set(hashes)), 4)

    def test_an_environment_to_train_in_starts_in_the_same_way(self) -> None:
        training = mishandle.ScenarioEnv(
            Falling(), SPACE, nominal=0.0, corners=0.0, seed=1, settle=1,
            invalid=lambda observation, info: observation[0] < 4
        )
        for _ in range(20):
            observation, info = training.reset()
            self.assertEqual(observation[0], info["scenario"]["height"] - 1)
            self.assertTrue(4 <= observation[0] <= 7)
        with self.assertRaises(mishandle.InvalidScenario):
            training.reset(options={"at": {"height": 1.0}})

    def test_mistakes_are_errors(self) -> None:
        for settle in (0, -1, 1.5, True, (1, np.zeros(1), 2)):
            with self.assertRaises((InvalidValueError, InvalidTypeError)):
                self.trace(Falling(), 2.0, settle=settle)
        with self.assertRaisesRegex(
            InvalidTypeError, "expected a function of observation and info"
        ):
            self.trace(Falling(), 2.0, invalid=True)
        with self.assertRaisesRegex(InvalidTypeError, "`settle` has no effect on a function"):
            mishandle.simulate(lambda scenario: {"x": [0, 0]}, "always(x <= 1)", SPACE, settle=2)
