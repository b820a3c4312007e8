"""Tests of simulations that Python steps: they stop as soon as the search does not need the rest,
with the same verdicts."""

import pickle
import sqlite3
import tempfile

from cases import FolderCase
import gymnasium
import mishandle
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from mishandle import Axis
from mishandle.scenarios.requests import EarlyStop, Request

STEPS = 60
SPACE = [
    Axis("start", -1, 1, apply=mishandle.ResetOption("start")),
    Axis("push", -0.05, 0.05, apply=mishandle.ResetOption("push"))
]
COUNT = {"steps": 0}


class Drift(gymnasium.Env):
    """A position that drifts by `push`, with the action; it terminates beyond 2."""

    observation_space = Box(-np.inf, np.inf, (1,))
    action_space = Box(-1, 1, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        options = options or {}
        self.position, self.push = options.get("start", 0.0), options.get("push", 0.0)
        return np.array([self.position], np.float32), {}

    def step(self, action):
        COUNT["steps"] += 1
        self.position += self.push + 0.001 * float(action[0])
        ended = abs(self.position) > 2
        return np.array([self.position], np.float32), 0.0, ended, False, {"position": self.position}


def policy(observation):
    return -np.sign(observation)


def plan(early_stopping, batch=1):
    table = {"early_stopping": early_stopping, "isolate": False, "batch": batch}
    return {"falsify": table, "report": {"repeats": 0}}


def falsified(environment, formula, early_stopping, batch=1, **options):
    """Returns the rows of a falsification, and the number of steps of the environments."""
    COUNT["steps"] = 0
    with tempfile.TemporaryDirectory() as folder:
        mishandle.falsify(
            environment, formula, SPACE, policy=policy, signals={"x": "obs[0]"}, steps=STEPS,
            control_dt=0.1, plan=plan(early_stopping, batch), trials=2, budget=40, search="random",
            seed=4, name="drift", out=f"{folder}/run.sqlite", **options
        )
        with sqlite3.connect(f"{folder}/run.sqlite") as run:
            rows = run.execute(
                "SELECT trial, number, scenario, robustness, ended, steps FROM simulation ORDER "
                "BY trial, number"
            ).fetchall()
    return rows, COUNT["steps"]


class Searches(FolderCase):
    def check(self, make, formula, **options):
        """Checks that a search sees the same verdicts at the same points, in fewer steps; returns
        both numbers of steps."""
        whole, all_steps = falsified(make(), formula, False, **options)
        early, fewer_steps = falsified(make(), formula, True, **options)
        self.assertEqual([row[:3] for row in early], [row[:3] for row in whole])
        for before, after in zip(whole, early):
            if before[3] is None or after[3] is None:
                self.assertEqual(after[3], before[3])
            else:
                self.assertEqual(after[3] < 0, before[3] < 0)
            self.assertLessEqual(after[5], before[5])
        self.assertLess(sum(row[5] for row in early), sum(row[5] for row in whole))
        return all_steps, fewer_steps

    def test_an_environment_takes_fewer_steps_with_the_same_verdicts(self):
        for formula in (
            "always[0:20](abs(x) <= 1.4)", "eventually[0:5s](x >= 0.2)",
            "eventually(x >= 0.9) or always[0:10](x <= 0.8)"
        ):
            for termination in ("undecided", "hold", "evaluate"):
                all_steps, fewer_steps = self.check(Drift, formula, termination=termination)
                self.assertLess(fewer_steps, all_steps)

    def test_vector_environments_too(self):
        formula = "eventually[0:5s](x >= 0.2)"
        makers = [lambda: SyncVectorEnv([Drift] * 3)]
        makers += [
            lambda mode=mode: AsyncVectorEnv(
                [Drift] * 3, autoreset_mode=mode
            ) for mode in AutoresetMode
        ]
        rows = [falsified(Drift(), formula, True, batch=3)[0]]
        for make in makers:
            self.check(make, formula, batch=3)
            rows.append(falsified(make(), formula, True, batch=3)[0])
        # How many run together changes no row.
        for found in rows[1:]:
            self.assertEqual(found, rows[0])

    def test_an_objective_has_the_exact_robustness_in_fewer_steps(self):
        # The position after 20 steps decides; the policy moves it by 0.001 a step.
        objective = mishandle.ask.Objective(
            Drift(), "always[20:20](x <= 1)", SPACE, policy=policy, signals={"x": "obs[0]"},
            steps=STEPS, control_dt=0.1
        )
        points = [[0.75, 0.5], [0.75, 0.8]]
        COUNT["steps"] = 0
        values = objective(points)
        self.assertEqual(COUNT["steps"], 40)
        np.testing.assert_allclose(
            values, [1 - (0.5 - 0.02), 1 - (0.5 + 20 * 0.03 - 0.02)], atol=1e-6
        )

    def test_a_replay_stops_at_the_recorded_step(self):
        known = dict(
            policy=policy, signals={"x": "obs[0]"}, steps=STEPS, control_dt=0.1, name="drift"
        )
        formula = "always[0:20](abs(x) <= 1.1)"
        path = self.folder / "run.sqlite"
        # A global variable that the environment reads is a part of it.
        COUNT["steps"] = 0
        found = mishandle.falsify(
            Drift(), formula, SPACE, plan=plan(True), trials=1, budget=60, search="random",
            out=path, **known
        )
        [worst] = found.counterexamples
        COUNT["steps"] = 0
        again = mishandle.replay(
            path, Drift(), formula, SPACE, trial=worst.trial, number=worst.simulation, **known
        )
        self.assertEqual(again.differences, ())
        with sqlite3.connect(path) as run:
            where = (worst.trial, worst.simulation)
            [row] = run.execute(
                "SELECT ended, steps FROM simulation WHERE trial = ? AND number = ?", where
            ).fetchall()
        # Sample 20 decides it, and the next check is after step 20.
        self.assertEqual(row, ("stopped", 20))

    def test_a_task_with_a_policy_in_python(self):
        run = lambda early: mishandle.falsify(
            "point-reaching", "eventually[0:20](finger_target_distance <= 10)",
            policy=lambda observation: np.zeros(9), trials=1, budget=1, plan=plan(early),
            search="random", out=f"{self.folder}/{early}.sqlite"
        )
        found = [run(early) for early in (False, True)]
        steps = [
            [row[0] for row in sqlite3.connect(each.path).execute("SELECT steps FROM simulation")]
            for each in found
        ]
        self.assertEqual(found[0].counterexamples, found[1].counterexamples)
        self.assertEqual(set(steps[1]), {10})
        self.assertGreater(min(steps[0]), 20)

    def test_the_samples_are_checked_after_every_ten_steps(self):
        stop = EarlyStop(("eventually(x >= 1)", 0.5, False), [("x", "")], 0.1, STEPS)
        samples, stopped = [], []
        for step in range(STEPS + 1):
            samples.append([2.0 if step >= 13 else 0.0])
            stopped.append(stop.may_stop(samples))
        # The bound 1 is above 0.5 from step 13 on. A whole episode does not stop.
        self.assertEqual(
            [step for step, may_stop in enumerate(stopped) if may_stop], [20, 30, 40, 50]
        )
        request = pickle.loads(pickle.dumps(Request({"start": 1.0}, 3, ("x >= 1", 0.0, True))))
        self.assertEqual(request.stop, ("x >= 1", 0.0, True))
