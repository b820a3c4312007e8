"""Environments that draw a scenario at each reset."""

import collections
import importlib
import math
import pathlib
import pickle
import sys
import unittest
import warnings

from cases import FolderCase
import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import SyncVectorEnv

import mishandle
from mishandle import Attribute, Axis, ResetOption, ScenarioEnv
from mishandle.errors import InvalidStateError, InvalidTypeError, InvalidValueError

STEPS = 60


def push(env, value):
    env.unwrapped.state = np.asarray(env.unwrapped.state) + [0.0, value, 0.0, 0.0]
    return np.array(env.unwrapped.state, dtype=np.float32)


def cart_pole():
    return gymnasium.make("CartPole-v1")


def cart_pole_space(env):
    return [
        Axis("length", 0.2, 1.5, "m", kind="model", nominal=0.5, apply=Attribute("length")),
        Axis("low", -0.2, 0.0, nominal=-0.05),
        Axis("push", -0.5, 0.5, "m/s", kind="event", nominal=0.0, apply=push),
        *mishandle.faults(
            env, delays=True, count=2, actions={"force": 0}, steps=STEPS, control_dt=0.02
        ),
    ]


def balance(observation):
    return int(observation[2] + 0.3 * observation[3] > 0)


def states(env, observation):
    """Returns the states of an episode."""
    found = [np.array(env.unwrapped.state, dtype=np.float64)]
    for _ in range(STEPS):
        observation, _, terminated, _, _ = env.step(balance(observation))
        found.append(np.array(env.unwrapped.state, dtype=np.float64))
        if terminated:
            break
    return np.array(found)


class Still(gymnasium.Env):
    """Observes its speed and its random start."""

    observation_space = Box(-np.inf, np.inf, (2,), np.float64)
    action_space = Box(-1.0, 1.0, (1,), np.float64)
    metadata = {}

    def __init__(self):
        self.speed, self.options, self.refuses = 0.5, [], False

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.options.append(options)
        if self.refuses and self.speed > 0.75:
            raise mishandle.InvalidScenario
        return np.array([self.speed, self.np_random.normal()]), {"own": 1}

    def step(self, action):
        return np.array([self.speed, self.np_random.normal()]), 0.0, False, False, {}


SPEED = Axis("speed", 0.0, 1.0, "m/s", kind="model", nominal=0.5, apply=Attribute("speed"))


def draws(env, count):
    for _ in range(count):
        yield env.reset()[1]


class Episodes(unittest.TestCase):
    def test_an_episode_has_the_bits_of_the_simulation_of_its_scenario(self):
        plain = cart_pole()
        space = cart_pole_space(plain)
        signals = {f"s{index}": lambda env, index=index: env.state[index] for index in range(4)}
        env = ScenarioEnv(
            cart_pole(), space, nominal=0.0, corners=0.3, steps=STEPS, control_dt=0.02
        )
        cases = [
            {"length": 1.2, "push": 0.25},
            {"low": -0.01, "action_delay": 2, "observation_delay": 1},
            {"sensor_fault": "bias", "sensor_fault_offset": 0.1, "sensor_fault_duration": 0.4},
            {
                "actuator_fault": "pause", "actuator_fault_onset": 0.2,
                "actuator_fault_duration": 0.3
            },
            {}
        ]
        with warnings.catch_warnings(action="ignore"):
            for seed in range(40):
                # Some given and some drawn scenarios.
                given = cases[seed] if seed < len(cases) else None
                observation, info = env.reset(
                    seed=seed, options=None if given is None else {"at": given}
                )
                self.assertEqual(info["scenario_origin"] == "given", given is not None)
                found = states(env, observation)
                [simulated] = mishandle.simulate(
                    plain, "always(abs(s2) <= 9)", space, at=info["scenario"], seed=seed,
                    policy=balance, signals=signals,
                    steps=STEPS, control_dt=0.02, termination="evaluate",
                )  # fmt: skip
                expected = np.stack(list(simulated.trace.values()), axis=1)
                self.assertEqual(found.tobytes(), expected.tobytes(), info)

    def test_nominal_episodes_are_those_of_the_environment(self):
        plain, wrapped = cart_pole(), ScenarioEnv(
            cart_pole(), cart_pole_space(cart_pole()), nominal=1.0, corners=0.0, steps=STEPS,
            control_dt=0.02
        )
        for episode in range(4):
            seed = 7 if episode in (0, 2) else None
            first, _ = plain.reset(seed=seed)
            second, info = wrapped.reset(seed=seed)
            self.assertEqual(
                (info["scenario"], info["scenario_origin"]), ({"push": 0.0}, "nominal")
            )
            self.assertEqual(first.tobytes(), second.tobytes())
            self.assertEqual(states(plain, first).tobytes(), states(wrapped, second).tobytes())

    def test_a_fault_that_pauses_the_policy_holds_its_action(self):
        env = cart_pole()
        space = mishandle.faults(
            env, sensing=False, actions={"force": 0}, steps=STEPS, control_dt=0.02
        )
        kinds = space[0].values
        self.assertIn("pause", kinds)
        env = ScenarioEnv(env, space, nominal=0.0, steps=STEPS, control_dt=0.02)
        at = {
            "actuator_fault": "pause", "actuator_fault_onset": 0.1, "actuator_fault_duration": 0.1
        }
        env.reset(seed=0, options={"at": at})
        given = []
        step = env.unwrapped.step
        env.unwrapped.step = lambda action: given.append(int(action)) or step(action)
        # The pole has fallen before the end.
        with warnings.catch_warnings(action="ignore"):
            for index in range(14):
                env.step([0, 1, 0, 1, 1][index] if index < 5 else 0)
        # 0.1 s to 0.2 s are the steps 5 to 9, which repeat the action of step 4.
        self.assertEqual(given, [0, 1, 0, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0])


class Draws(unittest.TestCase):
    def test_axes_have_their_distributions_and_origins_their_shares(self):
        names = ["dry", "wet", "ice"]
        space = [
            SPEED,
            Axis("mass", 0.01, 100.0, "kg", values="logarithmic", kind="model"),
            Axis("delay", 0, 3, values="integer", kind="model", nominal=0),
            Axis("surface", values=names, kind="model"),
            Axis("depth", 1.0, 3.0, kind="model", nominal=1.0, when={"surface": ["wet"]}),
            Axis("gust", -3.0, 3.0, kind="noise", nominal=0.0),
        ]
        env = ScenarioEnv(Still(), space, nominal=0.2, corners=0.3, seed=3)
        count = 6000
        found = collections.defaultdict(list)
        for info in draws(env, count):
            self.assertEqual(info["own"], 1)
            found[info["scenario_origin"]].append(info["scenario"])
        for origin, share in [("nominal", 0.2), ("corner", 0.3), ("random", 0.5)]:
            self.assertLess(
                abs(len(found[origin]) - share * count), 5 * math.sqrt(count * share * (1 - share)),
                origin
            )
        for scenario in found["corner"]:
            self.assertIn(scenario["speed"], (0.0, 1.0))
            self.assertIn(scenario["surface"], ("dry", "ice"))
        self.assertTrue(all(scenario == {} for scenario in found["nominal"]))
        random = found["random"]

        def close(values, mean, deviation):
            self.assertLess(abs(np.mean(values) - mean), 5 * deviation / math.sqrt(len(values)))

        # Uniform from 0 to 1; in the logarithm from -2 to 2; 0 to 3; a normal distribution.
        close([each["speed"] for each in random], 0.5, math.sqrt(1 / 12))
        close([math.log10(each["mass"]) for each in random], 0.0, 4 / math.sqrt(12))
        for delay in range(4):
            close([each["delay"] == delay for each in random], 0.25, math.sqrt(3 / 16))
        for name in names:
            close([each["surface"] == name for each in random], 1 / 3, math.sqrt(2 / 9))
        wet = [each["depth"] for each in random if each["surface"] == "wet"]
        close(wet, 2.0, 2 / math.sqrt(12))
        self.assertTrue(all(each["depth"] == 1.0 for each in random if each["surface"] != "wet"))
        close([each["gust"] for each in random], 0.0, 6 / math.sqrt(12))

    def test_seeds_repeat_draws_and_environments_train_with_their_own(self):
        def some(env, **options):
            first = env.reset(**options)[1]
            return [first["scenario"], *[info["scenario"] for info in draws(env, 5)]]

        make = lambda seed=None: ScenarioEnv(Still(), [SPEED], nominal=0.0, seed=seed)
        self.assertEqual(some(make(1)), some(make(1)))
        self.assertNotEqual(some(make(1)), some(make(2)))
        self.assertNotEqual(some(make()), some(make()))
        self.assertEqual(some(make(1), seed=9), some(make(2), seed=9))
        vector = SyncVectorEnv([make] * 3)
        observations, info = vector.reset(seed=20)
        singles = [make().reset(seed=20 + row) for row in range(3)]
        np.testing.assert_array_equal(observations, [observation for observation, _ in singles])
        np.testing.assert_array_equal(
            info["scenario"]["speed"], [each["scenario"]["speed"] for _, each in singles]
        )
        self.assertEqual(
            list(info["scenario_origin"]), [each["scenario_origin"] for _, each in singles]
        )

    def test_a_copy_draws_the_same_and_an_episode_with_changes_is_not_copied(self):
        env = ScenarioEnv(Still(), [SPEED], nominal=0.0, seed=4)
        copy = pickle.loads(pickle.dumps(env))
        self.assertEqual(*[[info["scenario"] for info in draws(each, 5)] for each in (env, copy)])
        with self.assertRaisesRegex(InvalidStateError, "before its first reset or after `close`"):
            pickle.dumps(env)
        env.close()
        pickle.dumps(env)

    def test_what_a_scenario_changes_is_restored(self):
        env = ScenarioEnv(
            Still(), [SPEED, Axis("x", 0.0, 1.0, apply=ResetOption("start.x"))], nominal=0.5,
            corners=0.0, seed=0
        )
        origins = set()
        for _ in range(20):
            observation, info = env.reset(options={"start": {"y": 2.0}})
            origins.add(info["scenario_origin"])
            start = {"y": 2.0}
            if info["scenario_origin"] == "random":
                start["x"] = info["scenario"]["x"]
            self.assertEqual(observation[0], info["scenario"].get("speed", 0.5))
            self.assertEqual(env.unwrapped.options[-1], {"start": start})
        self.assertEqual(origins, {"nominal", "random"})
        env.reset(options={"at": {"speed": 0.75}})
        self.assertEqual(env.unwrapped.speed, 0.75)
        env.close()
        self.assertEqual(env.unwrapped.speed, 0.5)

    def test_a_scenario_that_the_environment_refuses_is_drawn_again(self):
        env = ScenarioEnv(Still(), [SPEED], nominal=0.0, corners=0.0, seed=0)
        env.unwrapped.refuses = True
        self.assertTrue(all(info["scenario"]["speed"] <= 0.75 for info in draws(env, 50)))
        with self.assertRaises(mishandle.InvalidScenario):
            env.reset(options={"at": {"speed": 0.8}})
        self.assertEqual(env.unwrapped.speed, 0.5)
        narrow = ScenarioEnv(
            Still(), [Axis("speed", 0.8, 1.0, apply=Attribute("speed"))], nominal=0.0
        )
        narrow.unwrapped.refuses = True
        with self.assertRaisesRegex(mishandle.InvalidScenario, "refused 100 scenarios"):
            narrow.reset()

    def test_faults_that_show_nan_are_not_drawn(self):
        env = cart_pole()
        space = mishandle.faults(env, actuation=False, steps=STEPS, control_dt=0.02)
        env = ScenarioEnv(env, space, nominal=0.0, corners=0.5, steps=STEPS, control_dt=0.02)
        fills = collections.Counter(
            info["scenario"]["sensor_fault_fill"] for info in draws(env, 400)
        )
        self.assertEqual(set(fills), {"last", "zero"})
        _, info = env.reset(
            options={
                "at": {
                    "sensor_fault": "dropout", "sensor_fault_duration": 0.4,
                    "sensor_fault_fill": "nan"
                }
            }
        )
        self.assertEqual(info["scenario"]["sensor_fault_fill"], "nan")


class Archive(FolderCase):
    def run_of(self, name, formula="always(speed <= 0.9)", space=(SPEED,)):
        return mishandle.evaluate(
            Still(), formula, list(space), policy=lambda observation: np.zeros(1),
            signals={"speed": "obs[0]"}, steps=3,
            episodes=40, out=self.folder / name,
        )  # fmt: skip

    def drawn(self, archive, count=3000, **options):
        shares = {"archive_share": 1.0, "nominal": 0.0, "corners": 0.0, **options}
        env = ScenarioEnv(Still(), [SPEED], archive, seed=5, **shares)
        return collections.Counter(info["scenario"]["speed"] for info in draws(env, count))

    def test_failures_are_drawn_by_their_rank_and_others_least_of_all(self):
        run = self.run_of("run.sqlite")
        columns = mishandle.open_run(run.path).columns()
        pairs = sorted(zip(columns["robustness"], columns["speed"]))
        failures = [speed for robustness, speed in pairs if robustness < 0]
        passed = [speed for robustness, speed in pairs if robustness >= 0][: len(failures)]
        self.assertGreater(len(failures), 1)
        # Two thirds of the weight by rank, and one third for those that passed.
        weights = collections.Counter()
        ranks = 1 / np.arange(1, len(failures) + 1)
        for speeds, share in ((failures, 2 / 3), (passed, 1 / 3)):
            for speed, weight in zip(speeds, ranks * share / ranks.sum()):
                weights[speed] += weight
        count = 3000
        found = self.drawn(run.path, count)
        self.assertLessEqual(set(found), set(weights))
        for speed, share in weights.items():
            self.assertLess(
                abs(found[speed] - share * count), 5 * math.sqrt(count * share * (1 - share)), speed
            )

    def test_archives_are_runs_counterexamples_and_folders(self):
        run = self.run_of("run.sqlite")
        columns = mishandle.open_run(run.path).columns()
        worst = max(columns["speed"])
        suite = self.folder / "suite"
        suite.mkdir()
        place = columns["speed"].index(worst)
        text = mishandle._native.counterexample(
            str(run.path), columns["trial"][place], columns["number"][place]
        )
        (suite / "worst.json").write_text(text)
        for archive in (suite, [suite / "worst.json"], [str(suite)]):
            self.assertEqual(set(self.drawn(archive, 20)), {worst})
        both = self.drawn([suite, run.path], 200)
        self.assertGreater(len(both), 2)
        shared = self.drawn(suite, 400, archive_share=0.5)
        self.assertLess(abs(shared[worst] - 200), 50)

    def test_an_archive_that_does_not_fit_is_an_error(self):
        run = self.run_of("run.sqlite")
        passing = self.run_of("passing.sqlite", "always(speed <= 2)")
        mass = Axis("mass", 0.0, 1.0)
        (self.folder / "empty").mkdir()
        for archive, space, message in [
            (run.path, [mass], "the space has no axis `speed`"),
            (
                run.path, [Axis("speed", 0.0, 0.5, "m/s", apply=Attribute("speed"))],
                "run.sqlite are of another space.*speed"
            ),
            (
                run.path, [Axis("speed", 0.0, 1.0, "km/h", apply=Attribute("speed"))],
                "the unit of `speed` is `m/s` there"
            ),
            (
                passing.path, [SPEED],
                "passing.sqlite; it must be run files or counterexamples with at least one failure"
            ),
            (self.folder / "empty", [SPEED], "with at least one failure"),
            (self.folder / "missing.sqlite", [SPEED], "missing.sqlite"),
        ]:
            with self.subTest(message), self.assertRaisesRegex(mishandle.MishandleError, message):
                ScenarioEnv(Still(), space, archive)
        # An axis that an archive does not have was nominal.
        heavy = Axis("mass", 0.0, 1.0, kind="model", nominal=0.25, apply=lambda env, mass: None)
        env = ScenarioEnv(
            Still(), [SPEED, heavy], run.path, archive_share=1.0, nominal=0.0, corners=0.0
        )
        self.assertEqual({info["scenario"]["mass"] for info in draws(env, 20)}, {0.25})
        with self.assertRaisesRegex(InvalidTypeError, "archive is 3"):
            ScenarioEnv(Still(), [SPEED], 3)


class Example(FolderCase):
    def test_a_policy_is_hardened_and_compared_on_other_seeds(self):
        folder = pathlib.Path(__file__).parents[1] / "examples"
        sys.path.insert(0, str(folder))
        self.addCleanup(sys.path.pop, 0)
        example = importlib.import_module("cart_pole_hardened")
        found = example.harden(self.folder, iterations=3, candidates=8, episodes=3, evaluated=60)
        seeds = [
            set(mishandle.open_run(file).columns()["seed"])
            for file in (self.folder / "archive.sqlite", self.folder / "space-after.sqlite")
        ]
        self.assertEqual(list(found), ["space", "nearly nominal"])
        self.assertEqual((found["space"].first.n, found["nearly nominal"].second.n), (60, 60))
        self.assertTrue(seeds[0].isdisjoint(seeds[1]))
        self.assertIn("%", example.percent(found["space"].first))


class Mistakes(unittest.TestCase):
    def test_mistakes_are_errors_at_once(self):
        env = cart_pole()
        faults = mishandle.faults(env, steps=STEPS, actuation=False, control_dt=0.02)
        lonely = Axis("late", 0, 2, values="integer", kind="fault")
        for make, message in [
            (lambda: ScenarioEnv(env, "starts+delay"), "only this program's own policies have"),
            (lambda: ScenarioEnv(env, [lonely]), "mishandle.faults makes the axes of faults"),
            (lambda: ScenarioEnv(env, []), "the space has no axes"),
            (lambda: ScenarioEnv(env, [1]), "a space is a list of axes"),
            (lambda: ScenarioEnv(env, [SPEED, SPEED]), "two axes have the name `speed`"),
            (
                lambda: ScenarioEnv(SyncVectorEnv([cart_pole]), [SPEED]),
                "wrap each of its sub-environments"
            ),
            (
                lambda: ScenarioEnv("ball-balancing", [SPEED]),
                "a str is not a Gymnasium environment"
            ),
            (lambda: ScenarioEnv(env, [SPEED], nominal=0.95), r"nominal \+ corners is 1.05"),
            (lambda: ScenarioEnv(env, [SPEED], nominal=-0.5), "nominal is -0.5"),
            (lambda: ScenarioEnv(env, [SPEED], corners="all"), "corners is 'all'"),
            (lambda: ScenarioEnv(env, [SPEED], seed=-1), "seed is -1"),
            (
                lambda: ScenarioEnv(env, faults, steps=STEPS, control_dt=0.05),
                "a control period of 0.02 s"
            ),
            (
                lambda: ScenarioEnv(env, faults, steps=50, control_dt=0.02),
                "episodes of 60 control steps"
            ),
            (
                lambda: ScenarioEnv(env, [SPEED]).reset(options={"at": {"spead": 1.0}}),
                "the space has no axis spead"
            ),
            (lambda: ScenarioEnv(env, [SPEED]).reset(options={"at": {"speed": 2.0}}), "speed")
        ]:
            with self.subTest(message), self.assertRaisesRegex(mishandle.MishandleError, message):
                make()

    def test_what_draws_scenarios_is_not_evaluated(self):
        options = {
            "policy": balance, "signals": {"angle": "obs[2]"}, "steps": STEPS, "control_dt": 0.02
        }
        length = cart_pole_space(cart_pole())[:1]
        make = lambda: gymnasium.wrappers.TimeLimit(ScenarioEnv(cart_pole(), length), STEPS)
        for system in (make(), SyncVectorEnv([make] * 2)):
            with self.assertRaisesRegex(
                InvalidTypeError, "pass the environment without this wrapper"
            ):
                mishandle.evaluate(system, "always(abs(angle) <= 1)", length, **options)

    def test_an_unknown_attribute_is_an_error_at_the_first_reset(self):
        env = ScenarioEnv(cart_pole(), [SPEED], nominal=0.0)
        with self.assertRaisesRegex(AttributeError, "speed"):
            env.reset()

    def test_an_action_that_is_nan_is_an_error_where_a_fault_needs_it(self):
        class Moving(Still):
            dt = 0.1

        env = Moving()
        env = ScenarioEnv(env, mishandle.faults(env, steps=STEPS), nominal=0.0, steps=STEPS)
        env.reset(
            seed=0,
            options={"at": {"actuator_fault": "authority-loss", "actuator_fault_duration": 1.0}}
        )
        with self.assertRaisesRegex(InvalidValueError, "number 0 of the action is NaN"):
            env.step(np.array([np.nan]))
