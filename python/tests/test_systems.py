"""Tests of falsification, evaluation, simulation and replay of systems in Python."""

import os
import signal
import subprocess
import sys
import time
import unittest
import warnings

from cases import FolderCase, take_interrupts
import gymnasium
import mishandle
import numpy as np
from mishandle import Attribute, Axis, InvalidScenario, MishandleError
from mishandle.errors import InvalidStateError

SQUARE = [Axis("x", -1.0, 1.0, "m"), Axis("y", -1.0, 1.0, "m")]


def distance(scenario):
    """The distance of a point from (0.3, -0.4); closer than 0.1 m is a violation."""
    found = np.hypot(scenario["x"] - 0.3, scenario["y"] + 0.4)
    return {"distance": np.full(3, found)}


class Functions(FolderCase):
    def test_a_counterexample_is_found_stored_and_replayed_bit_for_bit(self):
        run = self.folder / "run.sqlite"
        found = mishandle.falsify(
            distance, "always(distance >= 0.1)", SQUARE, search="nelder-mead", trials=4, budget=100,
            out=run
        )
        self.assertEqual(found.path, run)
        self.assertGreater(found.falsified_trials, 0)
        self.assertEqual(found.falsified_trials, len(found.counterexamples))
        worst = found.counterexamples[0]
        exact = np.hypot(worst.scenario["x"] - 0.3, worst.scenario["y"] + 0.4) - 0.1
        self.assertEqual(worst.minimum_robustness, exact)
        again = mishandle.replay(
            run, distance, "always(distance >= 0.1)", SQUARE, trial=worst.trial,
            number=worst.simulation
        )
        self.assertEqual((again.differences, again.build_differences), ((), ()))
        self.assertEqual(again.repetition.robustness, exact)

    def test_a_replay_of_another_system_is_reported(self):
        run = self.folder / "run.sqlite"
        formula = "always(distance >= 0.1)"
        mishandle.falsify(distance, formula, SQUARE, search="random", trials=1, budget=5, out=run)
        other = mishandle.replay(run, lambda scenario: {"distance": np.ones(3)}, formula, SQUARE)
        self.assertTrue(
            any("hash of the target" in text for text in other.differences), other.differences
        )
        self.assertTrue(any("robustness" in text for text in other.differences), other.differences)

    def test_a_system_gets_floats_integers_and_names(self):
        seen = []
        space = [
            Axis("mass", 0.1, 10.0, "kg", values="logarithmic"),
            Axis("delay", 0, 3, values="integer"),
            Axis("surface", values=["dry", "wet", "ice"]),
        ]

        def system(scenario, seed):
            seen.append((scenario, seed))
            return {"x": [0.0, float(scenario["delay"])]}

        mishandle.falsify(
            system, "always(x <= 5)", space, search="random", trials=1, budget=40,
            out=self.folder / "a.sqlite"
        )
        self.assertEqual(
            seen[0][0], {"mass": 1.0, "delay": 1, "surface": "dry"}, "the probe is nominal"
        )
        self.assertTrue(all(type(scenario["delay"]) is int for scenario, _ in seen))
        self.assertEqual({scenario["surface"] for scenario, _ in seen}, {"dry", "wet", "ice"})
        self.assertEqual({scenario["delay"] for scenario, _ in seen}, {0, 1, 2, 3})
        self.assertEqual(len({seed for _, seed in seen[-40:]}), 40)

    def test_data_frames_are_traces(self):
        pandas = __import__("pandas")
        system = lambda scenario: pandas.DataFrame({"x": [0.0, scenario["x"]]})
        [found] = mishandle.simulate(system, "always(x <= 0.5)", SQUARE, at={"x": 0.75})
        self.assertEqual(found.robustness, -0.25)
        self.assertEqual(found.trace["x"].tolist(), [0.0, 0.75])

    def test_failures_are_ends_and_never_verdicts(self):
        def system(scenario):
            if scenario["x"] > 0.5:
                raise RuntimeError("broken pipe")
            if scenario["x"] < -0.5:
                raise InvalidScenario("unreachable")
            if scenario["y"] > 0.5:
                return {"d": [1.0, float("nan")]}
            if scenario["y"] < -0.5:
                time.sleep(10)
            return {"d": [1.0, 1.0]}

        space = SQUARE
        simulate = lambda **at: mishandle.simulate(
            system, "always(d >= 0)", space, at=at, time_limit=0.2
        )[0]
        for at, end in [
            ({"x": 0.9}, "crashed in control step 0"),
            ({"x": -0.9}, "invalid scenario"),
            ({"y": 0.9}, "invalid signal 0 at sample 1"),
            ({"y": -0.9}, "timed out in control step 0"),
        ]:
            found = simulate(**at)
            self.assertEqual((found.end, found.robustness), (end, None), at)
        self.assertEqual((simulate().end, simulate().robustness), ("completed", 1.0))
        run = mishandle.falsify(
            system, "always(d >= 0)", space, search="random", trials=1, budget=60, time_limit=0.05,
            out=self.folder / "f.sqlite"
        )
        self.assertEqual(run.falsified_trials, 0)
        [trial] = run.trials
        self.assertTrue(trial.failed > 0 and trial.invalid > 0)
        self.assertTrue(any("broken pipe" in text for text in run.exceptions))
        reasons = {each.end: each.reason for each in run.reasons or ()}
        self.assertIn("broken pipe", reasons["crashed"])
        self.assertNotIn("Traceback", reasons["crashed"])
        self.assertEqual(reasons.get("invalid scenario", "unreachable"), "unreachable")
        ends = set(mishandle.open_run(run.path).columns()["end"])
        self.assertTrue(
            {
                "completed", "crashed", "invalid scenario", "invalid signal", "timed out"
            } >= ends >= {"crashed"}
        )

    def test_an_exception_in_the_nominal_scenario_is_raised(self):
        def system(scenario):
            raise ZeroDivisionError("no brakes")

        with self.assertRaisesRegex(ZeroDivisionError, "no brakes"):
            mishandle.falsify(system, "always(d >= 0)", SQUARE)

    def test_a_random_system_is_reported_as_such(self):
        generator = np.random.default_rng(0)
        noisy = lambda scenario: {"d": generator.random(3)}
        with self.assertWarnsRegex(UserWarning, "not deterministic"):
            found = mishandle.falsify(
                noisy, "always(d >= -1)", SQUARE, search="random", trials=1, budget=3,
                out=self.folder / "n.sqlite"
            )
        self.assertGreater(found.largest_difference, 0)

    def test_short_traces_are_terminated_episodes(self):
        system = lambda scenario: {"d": [1.0] * (5 if scenario["x"] <= 0 else 3)}
        simulate = lambda rule: mishandle.simulate(
            system, "always[0:4](d >= 0)", SQUARE, at={"x": 1.0}, termination=rule
        )[0]
        self.assertEqual(simulate("undecided").robustness, None)
        self.assertEqual(simulate("evaluate").robustness, None, "the window needs more samples")
        self.assertEqual(simulate("hold").robustness, 1.0)
        self.assertEqual(simulate("hold").end, "terminated after control step 2")
        self.assertEqual(len(simulate("hold").trace["d"]), 5)

    def test_an_early_end_cannot_undo_a_violation_or_a_success(self):
        def system(scenario):
            return {"x": [0.0, scenario["x"], 1.0, 1.0, 1.0, 1.0][: 6 if scenario["x"] == 0 else 3]}

        def found(formula, x):
            [simulation] = mishandle.simulate(
                system, formula, [Axis("x", -5, 5, nominal=0)], at={"x": x}
            )
            self.assertEqual(simulation.end, "terminated after control step 2")
            return simulation.robustness

        # The traces are 0 x 1, and three samples are missing.
        self.assertEqual(found("always[0:5](x <= 2)", 4.0), -2.0)
        self.assertEqual(found("always(x <= 2)", 4.0), -2.0)
        self.assertEqual(found("eventually[0:5](x >= 2)", 4.0), 2.0)
        self.assertEqual(found("not eventually[0:5](x >= 2)", 4.0), -2.0)
        self.assertIsNone(found("always[0:5](x <= 2)", 1.5))
        self.assertIsNone(found("eventually[0:5](x >= 2)", 1.5))
        run = self.folder / "run.sqlite"
        space = [Axis("x", -5, 5, nominal=0)]
        campaign = mishandle.falsify(
            system, "always[0:5](x <= 2)", space, search="random", trials=1, budget=50, out=run
        )
        self.assertEqual(campaign.falsified_trials, 1)
        again = mishandle.replay(run, system, "always[0:5](x <= 2)", space)
        self.assertEqual(again.differences, ())
        self.assertLess(again.recorded_robustness, 0)

    def test_samples_after_the_last_control_step_are_left_out(self):
        system = lambda scenario: {"x": np.full(3 if scenario["x"] <= 0 else 5, scenario["x"])}
        run = self.folder / "run.sqlite"
        with self.assertWarnsRegex(
            UserWarning, "has 5 samples, but an episode has 2 control steps"
        ):
            found = mishandle.falsify(
                system, "always[0:2](x <= 2)", SQUARE, search="random", trials=1, budget=20, out=run
            )
        [trial] = found.trials
        self.assertEqual((trial.simulations, trial.undecided, trial.failed), (20, 0, 0))
        self.assertEqual(set(mishandle.open_run(run).columns()["steps"]), {2})
        with warnings.catch_warnings(action="error"):
            [long] = mishandle.simulate(system, "always[0:2](x <= 2)", SQUARE, at={"x": 1}, steps=4)
        self.assertEqual((long.robustness, len(long.trace["x"])), (1.0, 5))

    def test_tables_have_names_and_integers(self):
        space = [Axis("surface", values=["dry", "wet"]), Axis("delay", 0, 3, values="integer")]
        run = self.folder / "run.sqlite"
        system = lambda scenario: {"x": [0.0, float(scenario["delay"])]}
        mishandle.falsify(
            system, "always(x <= 5)", space, search="random", trials=1, budget=30, out=run
        )
        columns = mishandle.open_run(run).columns()
        self.assertEqual(set(columns["surface"]), {"dry", "wet"})
        self.assertTrue(all(type(value) is int for value in columns["delay"]))
        self.assertEqual(set(mishandle.open_run(run).simulations["surface"]), {"dry", "wet"})

    def test_an_evaluation_reports_rates_and_corners(self):
        found = mishandle.evaluate(
            distance, {"success": "always(distance >= 0.1)", "safe": "distance >= 0.5"}, SQUARE,
            episodes=200, out=self.folder / "e.sqlite"
        )
        self.assertEqual(found.success_rate.n, 200)
        # The circle of violations has 0.8 % of the square.
        self.assertTrue(found.success_rate.low < 0.992 < found.success_rate.high)
        self.assertEqual(len(found.corners.points), 5)
        self.assertTrue(all(corner.successes == 1 for corner in found.corners.points))
        self.assertIsNone(found.task_completion_time)

    def test_a_killed_run_continues_to_the_same_rows(self):
        program = (
            "import sys, time, mishandle, numpy as np\n"
            "def system(scenario):\n"
            "    time.sleep(float(sys.argv[2]))\n"
            "    return {'d': np.full(3, abs(scenario['x']))}\n"
            "space = [mishandle.Axis('x', -1, 1)]\n"
            "mishandle.falsify(system, 'always(d >= -1)', space, search='random', trials=2,\n"
            "    budget=50, out=sys.argv[1], resume=sys.argv[3] == 'resume')\n"
        )
        script = self.folder / "campaign.py"
        script.write_text(program)
        start = lambda *arguments: subprocess.Popen([
            sys.executable, str(script), *map(str, arguments)
        ])
        whole, killed = self.folder / "whole.sqlite", self.folder / "killed.sqlite"
        self.assertEqual(start(whole, 0, "new").wait(), 0)
        process = start(killed, 0.02, "new")
        deadline = time.monotonic() + 60

        def rows():
            try:
                return len(mishandle.open_run(killed).columns()["trial"])
            except MishandleError:
                return 0  # the file is new and still empty

        while time.monotonic() < deadline and rows() < 10:
            time.sleep(0.1)
        process.send_signal(signal.SIGKILL)
        process.wait()
        stored = len(mishandle.open_run(killed).columns()["trial"])
        self.assertTrue(10 <= stored < 100, stored)
        self.assertEqual(start(killed, 0, "resume").wait(), 0)
        self.assertEqual(mishandle.open_run(killed).columns(), mishandle.open_run(whole).columns())

    def test_an_interrupt_ends_the_run_and_keeps_its_rows(self):
        take_interrupts(self)
        count, at = 0, 15

        def system(scenario):
            nonlocal count
            count += 1
            if count == at:
                os.kill(os.getpid(), signal.SIGINT)
            return {"d": [1.0, 5.0 + scenario["x"] + 2.0 * scenario["y"]]}

        run = self.folder / "i.sqlite"
        with self.assertRaises(KeyboardInterrupt):
            mishandle.falsify(
                system, "always(d >= 0)", SQUARE, search="random", trials=1, budget=100, out=run
            )
        stored = len(mishandle.open_run(run).columns()["trial"])
        self.assertTrue(5 <= stored <= 15, stored)
        # The checks before the first simulation end, too.
        count, at = 0, 5
        with self.assertRaises(KeyboardInterrupt):
            mishandle.falsify(
                system, "always(d >= 0)", SQUARE, search="random", trials=1, budget=100
            )
        self.assertLess(count, 20)

    def test_a_nominal_scenario_without_a_verdict_is_reported(self):
        with self.assertWarnsRegex(UserWarning, "no verdict: the signal `d` is nan at sample 1"):
            mishandle.simulate(
                lambda scenario: {"d": [1.0, float("nan")]}, "always(d >= 0)", SQUARE
            )

        def unreachable(scenario):
            if unreachable.calls:
                raise InvalidScenario
            unreachable.calls += 1
            return {"d": [1.0, 1.0]}

        unreachable.calls = 0
        with self.assertWarnsRegex(
            UserWarning, "no verdict: the simulation ends as 'invalid scenario'"
        ):
            mishandle.simulate(unreachable, "always(d >= 0)", SQUARE)

    def test_a_simulation_that_crashed_has_a_traceback(self):
        system = lambda scenario: {"d": [1.0, 1 / scenario["x"] if scenario["x"] != 0 else 1.0]}
        divided = lambda scenario: {"d": [1.0, 1 / (scenario["x"] - 1)]}
        [found] = mishandle.simulate(divided, "always(d >= -9)", SQUARE, at={"x": 1})
        self.assertIn("ZeroDivisionError", found.exceptions[0])
        self.assertIn("divided = lambda", found.exceptions[0])
        self.assertEqual(mishandle.simulate(system, "always(d >= 0)", SQUARE)[0].exceptions, [])

    def test_the_name_of_a_lambda_needs_no_quotes(self):
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)
        found = mishandle.falsify(
            lambda s: {"d": [1.0, 1.0]}, "always(d >= 0)", SQUARE, search="random", trials=1,
            budget=2
        )
        self.assertEqual(found.path.name, "falsify-python-lambda-random-s0.sqlite")

    def test_mistakes_are_explained(self):
        def check(kind, message, *arguments, **options):
            with self.assertRaises(kind) as raised, warnings.catch_warnings():
                mishandle.falsify(*arguments, **options)
            self.assertIn(message, str(raised.exception))

        formula = "always(distance >= 0.1)"
        check(ValueError, "the space has no axes", distance, formula, [])
        check(TypeError, "a int is not a system", 5, formula, SQUARE)
        check(
            MishandleError, "signal `height` is not in the trace", distance, "always(height >= 0)",
            SQUARE
        )
        check(ValueError, "same length", lambda s: {"a": [1, 2], "b": [1]}, formula, SQUARE)
        check(TypeError, "dictionary of arrays or a data frame", lambda s: [1, 2], formula, SQUARE)
        with self.assertRaisesRegex(ValueError, "'cubic'"):
            Axis("x", 0, 1, values="cubic")


def balance(observation):
    """A policy for CartPole."""
    x, v, angle, rate = observation
    return int(angle + 0.3 * rate + 0.05 * x + 0.1 * v > 0)


def set_angle(env, value):
    env.unwrapped.state[2] = value
    return np.array(env.unwrapped.state, dtype=np.float32)


POLE = [
    Axis("angle", -0.2, 0.2, "rad", apply=set_angle),
    Axis("length", 0.2, 1.5, "m", nominal=0.5, kind="model", apply=Attribute("length")),
]
SIGNALS = {"x": ("obs[0]", "m"), "angle": ("obs[2]", "rad"), "length": lambda env: env.length}


class WithLateInfo(gymnasium.Env):
    """An environment whose resets lack values of ``info``, as those of MuJoCo robots."""

    observation_space = gymnasium.spaces.Box(-10, 10, (1,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = (options or {}).get("x", 0.0)
        return np.array([self.x], np.float32), {}

    def step(self, action):
        self.x += 0.5
        return np.array([self.x], np.float32), 0.0, self.x > 2, False, {"speed": self.x * 2}


class Environments(FolderCase):
    def test_a_value_that_only_steps_have_keeps_its_first_value_at_the_reset(self):
        kinds = {"policy": lambda observation: np.zeros(1, np.float32), "steps": 3}
        signals = {"x": "obs[0]", "speed": "info.speed"}
        single = WithLateInfo()
        vectors = [
            gymnasium.vector.SyncVectorEnv([WithLateInfo] * 2),
            gymnasium.vector.AsyncVectorEnv([WithLateInfo] * 2)
        ]
        for env in [single, *vectors]:
            [found] = mishandle.simulate(
                env, "always(speed <= 9)", [Axis("x", 0, 1)], at={"x": 0}, signals=signals, **kinds
            )
            self.assertEqual(found.trace["x"].tolist(), [0.0, 0.5, 1.0, 1.5])
            self.assertEqual(found.trace["speed"].tolist(), [1.0, 1.0, 2.0, 3.0])
            with self.assertRaisesRegex(RuntimeError, "the signal `speed` has no value"):
                mishandle.simulate(
                    env, "always(speed <= 9)", [Axis("x", 0, 1)], signals={"speed": "info.sped"},
                    **kinds
                )
        vectors[1].close()

    def test_options_attributes_and_functions_set_the_scenario(self):
        env = gymnasium.make("CartPole-v1", max_episode_steps=50)
        kinds = dict(policy=balance, signals=SIGNALS)
        [found] = mishandle.simulate(
            env, "always(angle <= 1)", POLE, at={"angle": 0.1, "length": 0.7}, **kinds
        )
        self.assertEqual(found.trace["angle"][0], np.float32(0.1))
        self.assertTrue((found.trace["length"] == 0.7).all())
        self.assertEqual(len(found.trace["x"]), 51)
        self.assertEqual(found.total_reward, 50.0)
        low = Axis("low", -0.05, 0.05, nominal=0.04)
        high = Axis("high", 0.05, 0.1, nominal=0.05)
        [found] = mishandle.simulate(env, "always(angle <= 1)", [low, high], **kinds)
        self.assertTrue(
            0.04 <= found.trace["angle"][0] <= 0.05, "options of the reset bound the initial state"
        )

    def test_a_vector_environment_gives_the_rows_of_a_single_one(self):
        formula, kinds = "always(abs(angle) <= 0.19)", dict(
            policy=balance, signals=SIGNALS, steps=60
        )
        options = dict(search="random", trials=2, budget=20, plan={"falsify": {"batch": 4}})
        single = gymnasium.make("CartPole-v1")
        vector = gymnasium.make_vec("CartPole-v1", num_envs=3, vectorization_mode="sync")
        runs = []
        for number, env in enumerate([single, vector]):
            path = self.folder / f"{number}.sqlite"
            mishandle.falsify(env, formula, POLE, out=path, **options, **kinds)
            runs.append(mishandle.open_run(path).columns())
        self.assertEqual(*runs)
        self.assertTrue(any(value is not None and value < 0 for value in runs[0]["robustness"]))

    def test_a_policy_that_fails_ends_the_simulation(self):
        def broken(observation):
            if observation[0] > 0.01:
                raise RuntimeError("no signal")
            return 1

        env = gymnasium.make("CartPole-v1", max_episode_steps=50)
        [found] = mishandle.simulate(
            env, "always(x <= 5)", [Axis("low", -0.05, -0.04), Axis("high", -0.03, -0.02)],
            policy=lambda o: 1, signals=SIGNALS
        )
        self.assertTrue(found.end.startswith("terminated"), found.end)
        self.assertIsNone(found.robustness, "an episode that terminated early is undecided")
        with self.assertRaisesRegex(RuntimeError, "no signal"):
            mishandle.simulate(env, "always(x <= 5)", POLE, policy=broken, signals=SIGNALS)

    def test_actions_that_are_not_finite_are_named(self):
        env = gymnasium.make("Pendulum-v1", max_episode_steps=20)
        space = [Axis("x_init", 0.1, 1.0), Axis("y_init", 0.1, 1.0)]
        steps = iter(range(10_000))
        policy = lambda observation: np.array([np.nan if next(steps) > 45 else 0.0], np.float32)
        found = mishandle.simulate(
            env, "always(c <= 2)", space, policy=policy, signals={"c": "obs[0]"}, repeat=2
        )
        self.assertEqual(
            [one.end for one in found],
            ["invalid action 0 in control step 7", "invalid action 0 in control step 1"]
        )

    def test_an_action_that_is_not_finite_never_reaches_the_environment(self):
        class Recording(gymnasium.Env):
            observation_space = gymnasium.spaces.Box(-1, 1, (1,), np.float32)
            action_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float32)
            actions = []

            def reset(self, *, seed=None, options=None):
                return np.zeros(1, np.float32), {}

            def step(self, action):
                self.actions.append(action)
                return np.zeros(1, np.float32), 0.0, False, False, {}

        bad = float("nan"), float("inf"), -float("inf")
        arrays = [
            np.array([0.0, value], kind) for value in bad
            for kind in (np.float16, np.float32, np.float64)
        ]
        others = [
            [0.0, bad[0]], (0.0, bad[1]), np.array([[0.0, bad[0]]]), np.array([0.0, bad[2]], object)
        ]
        for action in arrays + others:
            # The probes of the undisturbed scenario take the first steps.
            found = mishandle.simulate(
                Recording(), "always(x <= 1)", [Axis("x", 0, 1)], policy=lambda o: action,
                signals={"x": "obs[0]"}, steps=3
            )
            self.assertEqual(
                [one.end for one in found], ["invalid action 1 in control step 1"], repr(action)
            )
        self.assertEqual(Recording.actions, [])
        # Finite actions, also those whose squares overflow.
        for action in [np.array([1e30, -1e30], np.float32), np.array([1e300, 0.0])]:
            Recording.actions.clear()
            [found] = mishandle.simulate(
                Recording(), "always(x <= 1)", [Axis("x", 0, 1)], policy=lambda o: action,
                signals={"x": "obs[0]"}, steps=3
            )
            self.assertEqual(found.end, "completed", repr(action))
            self.assertTrue(
                all(each is action for each in Recording.actions) and len(Recording.actions) >= 3
            )
        # Another number of numbers than the action space has.
        for action in [3, np.int64(3), 10**400, [1.0], np.zeros(3), {"gear": 1}, "left"]:
            with self.assertRaisesRegex(InvalidStateError, "the policy returned an action of"):
                mishandle.simulate(
                    Recording(), "always(x <= 1)", [Axis("x", 0, 1)], policy=lambda o: action,
                    signals={"x": "obs[0]"}, steps=3
                )

    def test_models_with_predict_are_policies(self):
        class Model:
            def __init__(self):
                self.starts = []

            def predict(self, observation, state=None, episode_start=None, deterministic=False):
                self.starts.append(bool(episode_start[0]))
                return np.array([balance(row) for row in observation]), state

        model = Model()
        env = gymnasium.make("CartPole-v1", max_episode_steps=10)
        found = mishandle.simulate(env, "always(angle <= 1)", POLE, policy=model, signals=SIGNALS)
        self.assertEqual(found[0].end, "completed")
        self.assertEqual(model.starts[:11], [True] + [False] * 9 + [True])


class Tools(unittest.TestCase):
    def test_searches_minimize_and_agree_with_the_function(self):
        for name in mishandle.ask.search_names():
            found = mishandle.ask.find_minimum(
                lambda x: float((x**2).sum()), [(-1, 2), (-2, 1)], search=name, budget=400
            )
            self.assertEqual(found.fun, float((found.x**2).sum()), name)
            self.assertLess(found.fun, 0.1, name)
        search = mishandle.ask.Search("random", [(0, 1)])
        first, second = search.ask(2)
        with self.assertRaisesRegex(ValueError, "order of the points"):
            search.tell(second, 1.0)

    def test_whole_numbers_of_a_search_are_whole_and_within_their_bounds(self):
        for name in mishandle.ask.search_names():
            search = mishandle.ask.Search(
                name, [(-1, 2), (0.0, 1.0)], seed=3, integrality=[True, False]
            )
            for _ in range(40):
                for point in search.ask(1):
                    self.assertIn(point[0], (-1.0, 0.0, 1.0, 2.0), name)
                    search.tell(point, float(point.sum()))
        with self.assertRaisesRegex(ValueError, "one for each of the 1 coordinates"):
            mishandle.ask.Search("random", [(0, 1)], integrality=[True, False])
        with self.assertRaisesRegex(ValueError, "must be whole numbers"):
            mishandle.ask.Search("random", [(0, 1.5)], integrality=[True])

    def test_a_search_that_knows_whole_numbers_rarely_repeats_a_point(self):
        search = mishandle.ask.Search("portfolio", [(0, 3), (0, 3)], integrality=[True, True])
        found = set()
        for _ in range(16):
            [point] = search.ask(1)
            found.add(tuple(point))
            search.tell(point, 1.0)
        self.assertGreater(len(found), 12)

    def test_an_objective_is_the_robustness_of_a_simulation(self):
        objective = mishandle.ask.Objective(distance, "always(distance >= 0.1)", SQUARE)
        points = np.random.default_rng(1).random((4, 2))
        expected = [np.hypot(2 * u - 1.3, 2 * v - 0.6) - 0.1 for u, v in points]
        np.testing.assert_allclose(objective(points), expected, atol=1e-12)
        self.assertEqual(objective.scenario([0.0, 1.0]), {"x": -1.0, "y": 1.0})
        for wrong, message in [
            ([0.5, 0.5], "coordinates each"), ([[0.5, 1.5]], "from 0 to 1"),
            ([[0.5, np.nan]], "from 0 to 1")
        ]:
            with self.assertRaisesRegex(ValueError, message):
                objective(wrong)
        with self.assertRaisesRegex(ValueError, "at least 0"):
            objective(points, threshold=-1.0)

    def test_an_objective_of_a_task_has_levels_and_bounds_above_a_threshold(self):
        # The gap of the last cars grows above 40 m at full throttle, and stays at 10 m at rest.
        cars = mishandle.ask.Objective("arch/cc1")
        found = cars([[1.0] * 20 + [0.0] * 20, [0.0] * 40])
        self.assertLess(found[0], 0)
        self.assertEqual(found[1], 30.0)
        delay = mishandle.ask.Objective("point-reaching", "success", "delay", policy="ppo")
        self.assertEqual([axis.name for axis in delay.space], ["action_delay", "observation_delay"])
        self.assertEqual(delay.levels, [axis.high - axis.low + 1 for axis in delay.space])
        objective = mishandle.ask.Objective(
            "door-opening", "success", "starts", policy="ppo", seed=4
        )
        points = np.random.default_rng(0).random((3, len(objective.space)))
        exact = objective(points)
        [found] = mishandle.simulate(
            "door-opening", "success", "starts", policy="ppo", at=objective.scenario(points[0]),
            seed=4
        )
        self.assertEqual(exact[0], found.robustness)
        bounds = objective(points, threshold=0.0)
        self.assertTrue(
            ((bounds == exact) | ((bounds > 0) & (bounds <= exact))).all(), (bounds, exact)
        )
