"""Axes whose values the policy gets."""

import pathlib
from typing import Any

from cases import FolderCase, Line
import mishandle
import numpy as np
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
from mishandle import Axis, PolicyArgument
from mishandle.errors import InvalidTypeError, InvalidValueError

BIAS = Axis("estimate_bias", -0.5, 0.5, "m", nominal=0.0, apply=PolicyArgument("bias"))
DELAY = Axis("own_delay", 0, 5, values="integer", nominal=0, apply=PolicyArgument("delay"))
START = Axis("start", -1.0, 1.0, "m", nominal=0.0)


def estimated(observation: Any, bias: float) -> Any:
    return -5.0 * (observation + bias)


def estimated_rows(observations: Any, bias: Any) -> Any:
    assert bias.shape == (len(observations),)
    return -5.0 * (observations + bias[:, None])


class Late:
    """Acts on an observation that is some control steps old."""

    def reset(self) -> None:
        self.seen: list[Any] = []

    def __call__(self, observation: Any, *, delay: int) -> Any:
        self.seen.append(observation)
        return -5.0 * self.seen[max(len(self.seen) - 1 - delay, 0)]


OPTIONS: dict[str, Any] = {"signals": {"place": ("obs[0]", "m")}, "steps": 60}
NEAR = "always[50:60](abs(place) <= 0.2)"


class Arguments(FolderCase):
    def ends(
        self, environment: Any, policy: Any, space: Any, scenarios: Any, **options: Any
    ) -> list[float]:
        found = []
        for scenario in scenarios:
            [episode] = mishandle.simulate(
                environment, NEAR, space, at=scenario, policy=policy, **OPTIONS, **options
            )
            found.append(float(episode.trace["place"][-1]))
        return found

    def test_the_policy_gets_the_value_in_each_kind_of_environment(self) -> None:
        scenarios = [{"estimate_bias": bias, "start": 0.3} for bias in (-0.5, 0.0, 0.25)]
        # The place converges to the opposite of the bias.
        expected = [0.5, 0.0, -0.25]
        for made in (Line(), SyncVectorEnv([Line] * 3), AsyncVectorEnv([Line] * 2)):
            for policy, batched in ((estimated, False), (estimated_rows, True)):
                ends = self.ends(made, policy, [START, BIAS], scenarios, batched_policy=batched)
                np.testing.assert_allclose(ends, expected, atol=1e-6)
            made.close()

    def test_the_rows_of_a_batch_have_values_of_their_own(self) -> None:
        made = SyncVectorEnv([Line] * 4)
        options = {
            "search": "random", "trials": 1, "budget": 60,
            "plan": {"falsify": {"batch": 4, "keep_going": True, "new_mode_rate": 0.0}}
        }
        found = mishandle.falsify(
            made, NEAR, [START, BIAS], policy=estimated_rows, batched_policy=True, **OPTIONS,
            **options, out=self.file("rows")
        )
        columns = mishandle.open_run(found.path).columns()
        self.assertEqual(len(columns["robustness"]), 60)
        for robustness, bias in zip(columns["robustness"], columns["estimate_bias"]):
            self.assertAlmostEqual(robustness, 0.2 - abs(bias), delta=1e-6)

    def test_a_delay_of_the_policy_makes_the_loop_unstable(self) -> None:
        [steady, swinging] = self.ends(
            Line(), Late(), [START, DELAY], [{"start": 0.5, "own_delay": d} for d in (0, 5)]
        )
        self.assertLess(abs(steady), 1e-9)
        # Without a delay the place halves in each step; five steps at this gain are unstable.
        self.assertGreater(abs(swinging), 0.5)

    def test_failures_replay_and_are_tested_again(self) -> None:
        space = [START, BIAS]
        run = {"policy": estimated, **OPTIONS}
        found = mishandle.falsify(
            Line(), NEAR, space, search="random", trials=1, budget=40, out=self.file("line"), **run
        )
        worst = found.counterexamples[0]
        again = mishandle.replay(
            found.path, Line(), NEAR, space, trial=worst.trial, number=worst.simulation, **run
        )
        self.assertEqual(again.differences, ())
        found.export(self.folder / "suite", plan={"regress": {"minimize": True}})
        failing = mishandle.regress(self.folder / "suite", Line(), NEAR, space, **run)
        self.assertEqual([test.result for test in failing.tests], ["still fails"])
        better = lambda observation, bias: -5.0 * (observation + 0.1 * bias)
        passing = mishandle.regress(
            self.folder / "suite", Line(), NEAR, space, **{**run, "policy": better}
        )
        self.assertEqual([test.result for test in passing.tests], ["passes"])

    def test_a_policy_of_a_task_gets_the_value(self) -> None:
        def push(observation: Any, speed: float) -> Any:
            return np.full(9, speed)

        space = [Axis("own_speed", 0.0, 1.0, nominal=0.0, apply=PolicyArgument("speed"))]
        traces = []
        for speed in (0.0, 1.0):
            [episode] = mishandle.simulate(
                "point-reaching", None, space, at={"own_speed": speed}, policy=push, rows=2
            )
            traces.append(next(iter(episode.trace.values())))
        self.assertGreater(np.abs(traces[0] - traces[1]).max(), 0.05)

    def test_mistakes_are_errors(self) -> None:
        call = lambda policy, space: mishandle.simulate(
            Line(), NEAR, space, policy=policy, **OPTIONS
        )
        with self.assertRaisesRegex(
            InvalidTypeError,
            "no keyword argument `bias`, which the axis `estimate_bias` sets; .*: observation"
        ):
            call(lambda observation: observation, [BIAS])
        with self.assertRaisesRegex(
            InvalidTypeError, "a Model takes observations only; wrap it in a function"
        ):
            call(type("Model", (), {"predict": lambda self, observation: observation})(), [BIAS])
        other = Axis("bias_too", -1, 1, apply=PolicyArgument("bias"))
        with self.assertRaisesRegex(
            InvalidValueError, "`estimate_bias` and `bias_too` both set the policy argument 'bias'"
        ):
            call(estimated, [BIAS, other])

    def test_an_environment_to_train_in_leaves_the_value_to_the_policy(self) -> None:
        training = mishandle.ScenarioEnv(Line(), [START, BIAS], nominal=0.0, corners=0.0, seed=1)
        _, info = training.reset(options={"at": {"start": 0.25, "estimate_bias": 0.5}})
        self.assertEqual(info["scenario"]["estimate_bias"], 0.5)

    def file(self, name: str) -> pathlib.Path:
        return self.folder / f"{name}.sqlite"
