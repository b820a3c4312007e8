"""Guards: the same in Python as in the program, and policies in Python that are guarded."""

import math

from cases import FolderCase
import gymnasium
import numpy as np

import mishandle
from mishandle import Axis, Guard
from mishandle.policies import Guarded

FORMULA = "abs(tray_from_ball_1) <= 0.06 and abs(tray_from_ball_2) <= 0.06"


class Line(gymnasium.Env):
    """A point that drifts to the right, with the action as its velocity to the left."""

    observation_space = gymnasium.spaces.Box(-9.0, 9.0, (1,))
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))

    def __init__(self):
        self.x = 0.0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = options["x"]
        return np.array([self.x], dtype=np.float32), {}

    def step(self, action):
        self.x += 0.1 - 0.2 * float(np.ravel(action)[0])
        return np.array([self.x], dtype=np.float32), 0.0, False, False, {}


class Counting:
    """A policy with a constant action that counts its episodes."""

    def __init__(self, action):
        self.action, self.episodes = action, 0

    def reset(self):
        self.episodes += 1

    def __call__(self, observation):
        return [self.action]


class Guards(FolderCase):
    def test_a_guard_and_its_file_guard_a_controller_of_a_task(self):
        guard = Guard(FORMULA, "expert", dwell=0.1, return_threshold=0.02)
        file = self.folder / "guard.toml"
        file.write_text(guard.toml())
        asked = {"policy": "ppo", "space": "starts+delay", "episodes": 12, "seed": 4}
        found = [
            mishandle.evaluate(
                "ball-balancing", **asked, guard=each, out=self.folder / f"{index}.sqlite"
            )
            for index, each in enumerate((guard, file, None))
        ]
        self.assertEqual(found[0].success_rate, found[1].success_rate)
        self.assertEqual(found[0].guard.fallback, "expert")
        self.assertIsNone(found[2].guard)
        target = {"policy": "ppo", "space": "starts+delay", "guard": guard}
        again = mishandle.replay(
            self.folder / "0.sqlite", "ball-balancing", trial=1, number=3, **target
        )
        self.assertEqual(again.differences, ())
        self.assertIn("guard_active", again.repetition.trace)

    def test_mistakes_name_what_is_wrong(self):
        ask = lambda guard: mishandle.evaluate(
            "ball-balancing", policy="ppo", episodes=1, guard=guard
        )
        for guard, message in (
            (Guard("tray_from_bal_1 <= 0", "expert"), "tray_from_bal_1.*did you mean"),
            (Guard("ball_1 <= 1", "exprt"), "exprt"),
            (Guard("ball_1 <= 1"), "fallback"),
            (Guard("ball_1 <= 1", "hold", actions="positions"), "a task knows"),
            (Guard("always[0:10](ball_1 <= 1)", "hold", return_threshold=1), "no way back"),
            (Guard("ball_1 <= 1", "hold", threshold=1, return_threshold=0), "return-threshold"),
            (Guard("ball_1 <= 1", "hold", dwell=-1), "dwell"),
            (Guard("ball_1 <= ", "hold"), "ball_1 <="),
            (self.folder / "missing.toml", "missing.toml"),
            (3, "mishandle.Guard"),
        ):
            with self.subTest(guard=guard), self.assertRaisesRegex(
                mishandle.MishandleError, f"(?s){message}"
            ):
                ask(guard)
        with self.assertRaisesRegex(mishandle.MishandleError, "NaN"):
            Guard("x <= 1", threshold=math.nan).toml()

    def test_a_policy_in_python_is_guarded(self):
        policy, fallback = Counting(0.0), Counting(1.0)
        guard = Guard("x <= 0.45", return_threshold=0.3, dwell=0.2)
        guarded = Guarded(policy, guard, fallback, quantities=["x"], period=0.1, steps=20)
        guarded.reset()
        x, active = 0.0, []
        for _ in range(12):
            [action] = guarded([x])
            active.append(guarded.active)
            x += 0.1 - 0.2 * action
        # It hands over at 0.5, and back at 0.1: the robustness is then 0.35 or more.
        self.assertEqual(active, [False] * 5 + [True] * 4 + [False] * 3)
        self.assertEqual((policy.episodes, fallback.episodes), (1, 1))

    def test_a_guarded_policy_is_the_policy_of_a_system(self):
        asked = {
            "space": [Axis("x", 0.0, 0.3, kind="start")], "signals": {"x": lambda line: line.x},
            "steps": 20, "control_dt": 0.1
        }
        asked |= {"formula": "always(x <= 1)", "episodes": 8, "seed": 1}
        guard = Guard("x <= 0.7", return_threshold=0.2)
        guarded = Guarded(
            Counting(0.0), guard, Counting(1.0), quantities=lambda seen: {"x": seen[0]}, period=0.1,
            steps=20
        )
        bare = mishandle.evaluate(
            Line(), policy=Counting(0.0), out=self.folder / "bare.sqlite", **asked
        )
        safe = mishandle.evaluate(Line(), policy=guarded, out=self.folder / "safe.sqlite", **asked)
        self.assertEqual((bare.success_rate.value, safe.success_rate.value), (0.0, 1.0))

    def test_an_action_that_is_no_number_hands_over(self):
        guarded = Guarded(
            Counting(math.nan), Guard("x <= 9"), Counting(1.0), quantities=["x"], period=0.1,
            steps=5
        )
        self.assertEqual(guarded([0.0]), [1.0])
        self.assertTrue(guarded.active)

    def test_another_number_of_quantities_is_an_error(self):
        guarded = Guarded(
            Counting(0.0), Guard("x <= 9"), Counting(1.0), quantities=["x", "y"], period=0.1,
            steps=5
        )
        with self.assertRaisesRegex(mishandle.MishandleError, "2 quantities"):
            guarded([0.0])
        with self.assertRaisesRegex(mishandle.MishandleError, "fallback"):
            Guarded(
                Counting(0.0), Guard("x <= 9", "hold"), Counting(1.0), quantities=["x"], period=0.1,
                steps=5
            )
