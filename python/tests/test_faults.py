"""Faults between an environment and its policy."""

import json
import unittest
import warnings
from unittest import mock

from cases import FolderCase
import cloudpickle
import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete, Tuple
from gymnasium.spaces.utils import flatten
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

import mishandle
from mishandle import Axis
from mishandle.base.documents import Call
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.scenarios.axes import axes_document
from mishandle.scenarios.lines import FaultLine
from mishandle.scenarios.values import idle_action, numbers_of, parts_of, with_changes
from mishandle.scenarios.requests import Request
from mishandle.systems.vector_environments import environment_system

mishandle.register()

STEPS = 40


def simulate(*arguments, **options):
    [found] = mishandle.simulate(*arguments, **options)
    return found


class Recorder(gymnasium.Env):
    """Observes a counter and its negative, and remembers the actions. The signals are the counter
    and the last action."""

    observation_space = Box(-100.0, 100.0, (2,), np.float32)
    action_space = Box(-2.0, 2.0, (1,), np.float32)
    metadata = {}
    dt = 0.1

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count, self.action = 0.0, 0.0
        return self._observation(), {}

    def step(self, action):
        self.count += 1.0
        self.action = float(action[0])
        return self._observation(), 0.0, False, False, {}

    def _observation(self):
        return np.array([self.count, -self.count], np.float32)


class Gears(Recorder):
    """A counter with a discrete action."""

    action_space = Discrete(3)

    def step(self, action):
        return super().step([action])


class Seen:
    """A policy that remembers what it sees, and commands a part of it."""

    def __init__(self):
        self.observations = []

    def reset(self):
        self.observations = []

    def __call__(self, observation):
        self.observations.append(observation.copy())
        return np.array([0.04 * observation[0]], np.float32)


def run(at, env=None, policy=None, axes=None, **options):
    env = Recorder() if env is None else env
    policy = Seen() if policy is None else policy
    space = [
        Axis("unused", 0.0, 1.0),
        *mishandle.faults(env, steps=STEPS, channels={"up": 0, "down": 1}, **options)
    ]
    with warnings.catch_warnings(action="ignore"):
        found = simulate(
            env, "always(count >= 0)", space, at=at, policy=policy, steps=STEPS,
            signals={"count": "obs[0]", "action": lambda env: env.action}, axes=axes or {},
        )
    return found, np.array(policy.observations) if isinstance(policy, Seen) else None


LIFE = {"sensor_fault_onset": 1.0, "sensor_fault_duration": 0.5}
HELD = {"actuator_fault_onset": 1.0, "actuator_fault_duration": 0.5}


class SensingTest(unittest.TestCase):
    def test_a_policy_sees_the_fault_for_its_life_cycle_and_the_signals_do_not(self):
        count = np.arange(STEPS, dtype=np.float32)
        _, healthy = run({})
        np.testing.assert_array_equal(healthy, np.stack([count, -count], axis=1))
        for fault, expected in [
            ({"sensor_fault": "freeze"}, np.full(5, 9)),
            ({"sensor_fault": "dropout", "sensor_fault_fill": "zero"}, np.zeros(5)),
            ({"sensor_fault": "dropout", "sensor_fault_fill": "last"}, np.full(5, 9)),
            ({"sensor_fault": "stuck", "sensor_fault_level": 0.5}, np.full(5, 50)),
            ({"sensor_fault": "bias", "sensor_fault_offset": 0.25}, np.arange(10, 15) + 25),
            (
                {"sensor_fault": "ramp", "sensor_fault_offset": 0.25},
                np.arange(10, 15) + 25 * np.arange(1, 6) / 5
            ),
            (
                {"sensor_fault": "spike", "sensor_fault_offset": 0.25},
                np.arange(10, 15) + 25 * np.arange(5, 0, -1) / 5
            ),
            (
                {"sensor_fault": "quantization", "sensor_fault_quantum": 0.08},
                np.array([8, 8, 16, 16, 16])
            ),
        ]:
            with self.subTest(fault):
                found, seen = run({**LIFE, **fault, "sensor_fault_channel": "up"})
                np.testing.assert_allclose(seen[10:15, 0], expected, rtol=1e-6)
                np.testing.assert_array_equal(seen[:10], healthy[:10])
                np.testing.assert_array_equal(seen[15:], healthy[15:])
                np.testing.assert_array_equal(seen[:, 1], healthy[:, 1])
                np.testing.assert_array_equal(found.trace["count"], np.arange(STEPS + 1))
        _, seen = run({
            **LIFE, "sensor_fault": "swap", "sensor_fault_channel": "up",
            "sensor_fault_partner": "down"
        })
        np.testing.assert_array_equal(seen[10:15], healthy[10:15, ::-1])

    def test_a_policy_that_answers_nan_ends_as_an_invalid_action_without_a_verdict(self):
        found, _ = run({**LIFE, "sensor_fault": "dropout", "sensor_fault_fill": "nan"})
        self.assertEqual(
            (found.end, found.steps, found.robustness),
            ("invalid action 0 in control step 11", 10, None)
        )

    def test_numbers_without_a_meaning_for_the_kind_are_nominal_and_named(self):
        env = Recorder()
        space = mishandle.faults(env, steps=STEPS)
        with self.assertWarnsRegex(UserWarning, "sensor_fault_offset has no effect"):
            found = simulate(
                env, "always(count >= 0)", space,
                at={**LIFE, "sensor_fault": "freeze", "sensor_fault_offset": 0.25},
                policy=Seen(), steps=STEPS, signals={"count": "obs[0]"},
            )
        self.assertEqual(found.scenario["sensor_fault_offset"], 0.0)


class ActuationTest(unittest.TestCase):
    def test_the_environment_gets_the_fault_for_its_life_cycle(self):
        commands = np.float32(0.04) * np.arange(STEPS, dtype=np.float32)
        # Only what the environment gets within the range of its actions is compared.
        for fault, expected in [
            ({"actuator_fault": "stuck"}, np.full(5, commands[9])),
            (
                {"actuator_fault": "authority-loss", "actuator_fault_loss": 0.75},
                0.25 * commands[10:15]
            ),
            ({"actuator_fault": "sign-flip"}, -commands[10:15]),
            (
                {"actuator_fault": "saturation", "actuator_fault_limit": 0.2},
                np.minimum(commands[10:15], 0.4)
            ),
            (
                {"actuator_fault": "command-loss", "actuator_fault_probability": 1.0},
                np.full(5, commands[9])
            ),
        ]:
            with self.subTest(fault):
                found, _ = run({**HELD, **fault})
                np.testing.assert_allclose(found.trace["action"][11:16], expected, rtol=1e-6)
                np.testing.assert_array_equal(found.trace["action"][1:11], commands[:10])
                np.testing.assert_array_equal(found.trace["action"][16:], commands[15:])

    def test_a_paused_policy_is_not_asked_and_its_last_action_is_held(self):
        policy = Seen()
        found, seen = run({**HELD, "actuator_fault": "pause"}, policy=policy)
        np.testing.assert_array_equal(seen[:, 0], [*range(10), *range(15, STEPS)])
        np.testing.assert_array_equal(
            found.trace["action"][11:16], np.full(5, found.trace["action"][10])
        )

    def test_discrete_actions_have_the_faults_that_only_move_them(self):
        env = Gears()
        axes = {axis.name: axis for axis in mishandle.faults(env, steps=STEPS, sensing=False)}
        self.assertEqual(
            list(axes["actuator_fault"].values),
            ["none", "stuck", "command-loss", "clock-jitter", "pause"]
        )
        found = simulate(
            env, "always(count >= 0)", list(axes.values()), at={**HELD, "actuator_fault": "stuck"},
            policy=lambda observation: int(observation[0]) % 3, steps=STEPS,
            signals={"count": "obs[0]", "action": lambda env: env.action},
        )
        self.assertEqual(found.trace["action"][10:17].tolist(), [0, 0, 0, 0, 0, 0, 0])
        self.assertEqual(found.trace["action"][7:10].tolist(), [0, 1, 2])


class ContractTest(unittest.TestCase):
    def test_a_nominal_scenario_has_the_bits_of_an_environment_without_faults(self):
        env, signals = Recorder(), {"count": "obs[0]", "action": lambda env: env.action}
        options = {"policy": Seen(), "steps": STEPS, "signals": signals}
        healthy = simulate(env, "always(count >= 0)", [Axis("unused", 0.0, 1.0)], **options)
        for at in [
            {}, {"sensor_fault": "bias", "sensor_fault_offset": 0.4}, {**LIFE},
            {**HELD, "actuator_fault": "saturation"}
        ]:
            found, _ = run(at, delays=True, count=2)
            np.testing.assert_array_equal(found.trace["action"], healthy.trace["action"])

    def test_vector_environments_give_the_traces_of_a_single_one(self):
        env = Recorder()
        space = mishandle.faults(env, steps=STEPS, delays=True)
        generator = np.random.default_rng(3)

        def scenario():
            values = {}
            for axis in space:
                number = generator.uniform(axis.low, axis.high)
                values[axis.name] = (
                    number if axis.values == "continuous" else axis.value(float(round(number)))
                )
            return values

        at = [scenario() for _ in range(24)]
        at[3].update(actuator_fault="pause", actuator_fault_duration=1.0)

        def outcomes(environment):
            system = environment_system(
                environment, lambda observation: np.array([0.04 * observation[0]], np.float32),
                space, signals={"count": "obs[0]", "echo": "info.action"}, steps=STEPS,
                control_dt=0.1, time_limit=None, batched_policy=False
            )
            return [
                found.samples
                for found in system.simulate([Request(each, seed) for seed, each in enumerate(at)])
            ]

        single = outcomes(Informed())
        for vector in (SyncVectorEnv([Informed] * 5), AsyncVectorEnv([Informed] * 5)):
            for one, other in zip(single, outcomes(vector)):
                np.testing.assert_array_equal(one, other)
            vector.close()

    def test_a_function_without_control_steps_is_refused(self):
        space = mishandle.faults(Recorder(), steps=STEPS)
        with self.assertRaisesRegex(InvalidTypeError, "a function has no control steps"):
            simulate(lambda scenario: {"y": [0.0, 1.0]}, "always(y >= 0)", space)
        with self.assertRaisesRegex(InvalidTypeError, "function has no control steps"):
            mishandle.faults(lambda scenario: {"y": [0.0, 1.0]})
        with self.assertRaisesRegex(InvalidValueError, "nothing applies it"):
            simulate(
                Recorder(), "always(count >= 0)", [Axis("broken", 0, 1, kind="fault")],
                policy=Seen(), steps=STEPS, signals={"count": "obs[0]"}
            )

    def test_another_control_period_than_that_of_the_faults_is_refused(self):
        space = mishandle.faults(Recorder(), steps=STEPS)
        with self.assertRaisesRegex(InvalidValueError, "made for a control period of 0.1 s"):
            simulate(
                Recorder(), "always(count >= 0)", space, policy=Seen(), steps=STEPS,
                signals={"count": "obs[0]"}, control_dt=0.5
            )

    def test_another_number_of_control_steps_than_that_of_the_faults_is_refused(self):
        space = mishandle.faults(Recorder(), steps=STEPS)
        with self.assertRaisesRegex(
            InvalidValueError,
            "made for episodes of 40 control steps, but those of the system have 300"
        ):
            simulate(
                Recorder(), "always(count >= 0)", space, policy=Seen(), steps=300,
                signals={"count": "obs[0]"}
            )
        with self.assertRaisesRegex(InvalidValueError, "episodes of 60 control steps"):
            space = mishandle.faults("point-reaching", steps=60)
            mishandle.simulate(
                "point-reaching", None, space, policy=lambda observation: np.zeros(9, np.float32)
            )

    def test_the_episodes_of_a_batch_start_their_faults_once(self):
        space = mishandle.faults(Recorder(), steps=STEPS)
        at = {axis.name: axis.nominal_value for axis in space}
        batch = [
            Request({**at, **HELD, "actuator_fault": kind}, seed)
            for seed, kind in enumerate(["stuck", "pause", "none", "stuck"])
        ]
        for env in (Recorder(), SyncVectorEnv([Recorder] * 4)):
            system = environment_system(
                env, lambda observation: np.zeros(1, np.float32), space,
                signals={"count": "obs[0]"}, steps=STEPS, control_dt=0.1,
                time_limit=None, batched_policy=False,
            )
            with mock.patch.object(
                FaultLine, "start", autospec=True, side_effect=FaultLine.start
            ) as start:
                system.simulate(batch)
            self.assertEqual(
                [call.args[1:] for call in start.call_args_list], [request[:2] for request in batch]
            )

    def test_the_faults_of_another_environment_are_refused(self):
        for space, problem in [
            (Box(-9.0, 9.0, (4,)), "observation has 4 numbers, but that of the system has 2"),
            (
                Dict({"up": Box(-9.0, 9.0, (1,)), "down": Box(-9.0, 9.0, (1,))}),
                "observation has other parts than that of the system"
            ),
        ]:
            other = Recorder()
            other.observation_space = space
            with self.assertRaisesRegex(InvalidValueError, problem):
                simulate(
                    Recorder(), "always(count >= 0)", mishandle.faults(other, steps=STEPS),
                    policy=Seen(), steps=STEPS, signals={"count": "obs[0]"}
                )

    def test_a_system_on_a_cluster_keeps_its_faults(self):
        env = Recorder()
        system = environment_system(
            env, Seen(), mishandle.faults(env, steps=STEPS), signals={"count": "obs[0]"},
            steps=STEPS, control_dt=0.1, time_limit=None, batched_policy=False
        )
        copy = cloudpickle.loads(cloudpickle.dumps(system))
        at = {axis.name: axis.nominal_value for axis in system.space.values()} | LIFE | {
            "sensor_fault": "freeze"
        }
        for each in (system, copy):
            each.simulate([Request(at, 3)])
            self.assertEqual([seen[0] for seen in each._policy_source.observations[9:15]], [9] * 6)
        self.assertEqual(
            set(system.random_axes),
            {"sensor_fault_probability", "actuator_fault_probability", "actuator_fault_lateness"}
        )

    def test_the_shortest_fault_is_found_by_bisection(self):
        env = Recorder()
        space = mishandle.faults(env, steps=STEPS, actuation=False)
        # Commands are positive, unless the policy sees a negative counter.
        with warnings.catch_warnings(action="ignore"):
            found = mishandle.margin(
                env, "eventually[40:40](action >= 0)", space, budget=300, policy=Seen(),
                steps=STEPS,
                axes={
                    "sensor_fault": "stuck", "sensor_fault_level": -0.5,
                    "sensor_fault_channel": "all", "sensor_fault_recovery": 0.0
                },
                signals={"action": lambda env: env.action}
            )
        # Only a fault up to the end shows, and its latest onset is 0.8 of the episode, 3.2 s.
        self.assertAlmostEqual(found.witness.scenario["sensor_fault_duration"], 0.8, delta=0.06)


class Informed(Recorder):
    """A recorder whose ``info`` has the action."""

    def step(self, action):
        observation, reward, terminated, truncated, _ = super().step(action)
        return observation, reward, terminated, truncated, {"action": self.action}

    def reset(self, *, seed=None, options=None):
        observation, _ = super().reset(seed=seed)
        return observation, {"action": 0.0}


class ConditionTest(unittest.TestCase):
    def test_an_axis_of_a_function_can_be_conditional(self):
        seen = []

        def road(scenario):
            seen.append(scenario)
            return {"y": [1.0, 1.0 - scenario["depth"]]}

        space = [
            Axis("surface", values=["dry", "wet", "ice"], kind="model"),
            Axis("depth", 0.0, 0.2, "m", nominal=0.0, kind="model", when={"surface": ["wet"]}),
        ]
        mishandle.evaluate(road, "always(y >= 0)", space, episodes=200)
        self.assertTrue(all(each["depth"] == 0.0 for each in seen if each["surface"] != "wet"))
        self.assertGreater(sum(each["depth"] > 0.0 for each in seen), 30)
        with self.assertRaisesRegex(
            InvalidValueError, "`damp` of the axis `surface`, which has no such value"
        ):
            mishandle.evaluate(
                road, "always(y >= 0)", [space[0], Axis("depth", 0, 1, when={"surface": ["damp"]})],
                episodes=3
            )


class Rig(gymnasium.Env):
    """Observes a dictionary, not in the order of its names, and remembers its action, which is a
    dictionary, too."""

    observation_space = Dict({
        "tilt": Box(-100.0, 100.0, (1,), np.float64),
        "arm": Dict({
            "reach": Box(-100.0, 100.0, (2,), np.float64),
            "grip": Box(-100.0, 100.0, (1,), np.float64)
        }),
    })
    action_space = Dict({"push": Box(0.5, 4.0, (1,), np.float32), "gear": Discrete(3, start=1)})
    dt = 0.1

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count = 0.0
        return self._observation(), {"push": 0.0, "gear": 0}

    def step(self, action):
        self.count += 1.0
        info = {"push": float(action["push"][0]), "gear": int(action["gear"])}
        return self._observation(), 0.0, False, False, info

    def _observation(self):
        count = self.count
        return {
            "tilt": np.array([count]),
            "arm": {"reach": np.array([count + 10, count + 20]), "grip": np.array([count + 30])}
        }


class Echo:
    """A policy of the rig that remembers what it sees. It can write all its actions into one
    array."""

    def __init__(self, has_one_array):
        self.push = np.zeros(1, np.float32) if has_one_array else None
        self.seen = []

    def reset(self):
        self.seen = []

    def __call__(self, observation):
        self.seen.append(numbers_of(parts_of(Rig.observation_space), observation))
        count = float(observation["tilt"][0])
        push = np.zeros(1, np.float32) if self.push is None else self.push
        push[0] = 0.5 + 0.05 * count
        return {"push": push, "gear": 1 + int(count + 1) % 3}


def rig(env, at, has_one_array=False, **options):
    """Returns the traces of scenarios in an environment or a vector environment of rigs, and what
    the policy saw last."""
    space = mishandle.faults(Rig(), steps=STEPS, **options)
    nominal = {axis.name: axis.nominal_value for axis in space}
    policy = Echo(has_one_array)
    signals = {"tilt": "obs.tilt[0]", "push": "info.push", "gear": "info.gear"}
    system = environment_system(
        env, policy, space, signals=signals, steps=STEPS, control_dt=0.1, time_limit=None,
        batched_policy=False,
    )
    outcomes = system.simulate([Request({**nominal, **each}, seed) for seed, each in enumerate(at)])
    return [each.samples for each in outcomes], np.array(policy.seen)


class Structure(unittest.TestCase):
    """Observations and actions that are dictionaries and tuples."""

    def test_numbers_follow_the_names_of_the_space_and_change_alone(self):
        inner = Dict({
            "z": Box(-1, 1, (2,), np.float64), "b": Tuple([Box(-1, 1, (1, 3)), Box(-1, 1, ())])
        })
        space = Dict({
            "second": Box(-1, 1, (2, 2)), "first": inner, "third": Tuple([Box(-1, 1, (1,)), inner])
        })
        space.seed(8)
        parts = parts_of(space)

        def reversed_names(value):
            if isinstance(value, tuple):
                return tuple(map(reversed_names, value))
            return (
                {name: reversed_names(value[name]) for name in reversed(value)}
                if isinstance(value, dict) else value
            )

        for entry in range(len(flatten(space, space.sample()))):
            value = reversed_names(space.sample())
            before = flatten(space, value).astype(np.float64)
            np.testing.assert_array_equal(numbers_of(parts, value), before)
            after = before.copy()
            after[entry] = 0.5
            made = with_changes(parts, value, before, after)
            np.testing.assert_array_equal(flatten(space, made), after)
            np.testing.assert_array_equal(flatten(space, value), before)
            self.assertTrue(space.contains(made))
            self.assertIs(with_changes(parts, value, before, before.copy()), value)

    def test_large_whole_numbers_beside_a_fault_keep_their_value(self):
        space = Box(0, 2**62, (2,), np.int64)
        value = np.array([2**61 + 1, 7])
        before = numbers_of(parts_of(space), value)
        made = with_changes(parts_of(space), value, before, np.array([before[0], 3.0]))
        self.assertEqual(made.tolist(), [2**61 + 1, 3])

    def test_a_fault_hits_the_channel_that_it_names(self):
        # The order of the space: arm.grip, arm.reach[0], arm.reach[1], tilt.
        base = np.add.outer(np.arange(STEPS), [30.0, 10.0, 20.0, 0.0])
        for options, channel, columns in [
            ({}, "tilt", [3]), ({}, "arm", [0, 1, 2]),
            ({"channels": {"grip": 0, "others": [1, 2, 3]}}, "grip", [0]),
        ]:
            at = {
                **LIFE, "sensor_fault": "bias", "sensor_fault_offset": 0.25,
                "sensor_fault_channel": channel
            }
            expected = base.copy()
            expected[10:15, columns] += 25.0
            with self.subTest(channel):
                _, seen = rig(Rig(), [at], **options)
                np.testing.assert_allclose(seen, expected, rtol=1e-6)

    def test_a_paused_policy_with_actions_in_a_dictionary_holds_the_last_one(self):
        [trace], _ = rig(Rig(), [{**HELD, "actuator_fault": "pause"}], has_one_array=True)
        np.testing.assert_allclose(trace[11:16, 1], [0.5 + 0.05 * 9] * 5, rtol=1e-6)
        self.assertEqual(trace[11:16, 2].tolist(), [2] * 5)
        # A pause from the start holds the idle action: the value of the space that is nearest to 0.
        [trace], _ = rig(Rig(), [{**HELD, "actuator_fault_onset": 0.0, "actuator_fault": "pause"}])
        self.assertEqual(trace[1:6, 1:].tolist(), [[0.5, 1.0]] * 5)

    def test_vector_environments_give_the_traces_of_a_single_one(self):
        at = [
            {**LIFE, "sensor_fault": "freeze", "sensor_fault_channel": "tilt"},
            {**HELD, "actuator_fault": "pause", "actuator_fault_onset": 0.0},
            {**HELD, "actuator_fault": "stuck", "actuator_fault_channel": "push"},
            {"action_delay": 3},
            {**LIFE, "sensor_fault": "swap", "sensor_fault_channel": "tilt"},
        ]
        single, _ = rig(Rig(), at, delays=True)
        for vector in (SyncVectorEnv([Rig] * 2), AsyncVectorEnv([Rig] * 2)):
            for one, other in zip(single, rig(vector, at, delays=True)[0]):
                np.testing.assert_array_equal(one, other)
            vector.close()

    def test_idle_actions_are_in_their_space_and_nearest_to_zero(self):
        for space, expected in [
            (Box(0.5, 1.0, (2,)), [0.5, 0.5]), (Box(-3.0, -1.0, (1,)), [-1.0]),
            (Box(-np.inf, np.inf, (1,)), [0.0]),
            (Discrete(4, start=-9), [-6]), (Discrete(3, start=2), [2]),
            (MultiDiscrete([2, 2], start=[0, 5]), [0, 5]),
            (Tuple([Discrete(2), Dict({"a": Box(2.0, 3.0, (1,))})]), [0, 2.0]),
        ]:
            with self.subTest(space):
                self.assertTrue(space.contains(idle_action(space)))
                self.assertEqual(numbers_of(parts_of(space), idle_action(space)).tolist(), expected)


class Torques(Recorder):
    """Actions without bounds. The signal is an action as the environment gets it."""

    action_space = Box(-np.inf, np.inf, (3,), np.float64)

    def step(self, action):
        self.given = action
        return super().step(action)


def torques(at, **options):
    """Returns the actions that the environment gets in each control step, of 3, 500 + the step, and
    -700."""
    env, given = Torques(), []
    space = mishandle.faults(
        env, steps=STEPS, action_ranges={"action[0]": (-4.0, 4.0)} | options.pop("ranges", {}),
        **options
    )

    def record(env):
        given.append(getattr(env, "given", None))
        return 0.0

    with warnings.catch_warnings(action="ignore"):
        simulate(
            env, "always(x >= 0)", space, at=at,
            policy=lambda observation: np.array([3.0, 500.0 + observation[0], -700.0]), steps=STEPS,
            signals={"x": record},
        )
    return np.array(given[-STEPS:])


class RangeTest(unittest.TestCase):
    WIDE = {"action[1]": (-900.0, 900.0), "action[2]": (-900.0, 900.0)}

    def test_an_action_without_bounds_needs_stated_ranges(self):
        with self.assertRaisesRegex(
            InvalidValueError,
            r'numbers \[1, 2\].*action_ranges={"action\[1\]": \(-1.0, 1.0\), "action'
        ):
            torques({})
        with self.assertRaisesRegex(InvalidValueError, r"numbers \[2\].* belong to no channel"):
            mishandle.faults(
                Torques(), steps=STEPS, actions={"a": [0, 1]}, action_ranges={"a": (0, 1)}
            )
        # Delays and faults of the observation need none.
        self.assertGreater(
            len(mishandle.faults(Torques(), steps=STEPS, actuation=False, delays=True)), 0
        )

    def test_a_fault_computes_with_the_stated_range(self):
        given = torques(
            {**HELD, "actuator_fault": "saturation", "actuator_fault_limit": 0.5}, ranges=self.WIDE
        )
        np.testing.assert_array_equal(given[10:15], np.tile([2.0, 450.0, -450.0], (5, 1)))

    def test_numbers_that_no_fault_changes_are_never_clipped(self):
        narrow = {"action[1]": (-1.0, 1.0), "action[2]": (-1.0, 1.0)}
        commands = np.array([[3.0, 500.0 + step, -700.0] for step in range(STEPS)])
        faulty = {**HELD, "actuator_fault": "sign-flip", "actuator_fault_channel": "action[0]"}
        for at, change in [({}, 1), (faulty, -1), ({**faulty, "action_jitter": 0}, -1)]:
            expected = commands.copy()
            expected[10:15, 0] *= change
            np.testing.assert_array_equal(torques(at, ranges=narrow, delays=True), expected)

    def test_late_actions_without_bounds_are_not_clipped(self):
        env = Torques()
        given = torques({"action_delay": 2}, ranges=self.WIDE, delays=True)
        np.testing.assert_array_equal(given[:2], np.zeros((2, 3)))
        np.testing.assert_array_equal(given[2:, 1], 500.0 + np.arange(STEPS - 2))
        space = mishandle.faults(env, steps=STEPS, actuation=False, sensing=False, delays=True)
        found = simulate(
            env, "always(x >= 0)", space, at={"action_delay": 1},
            policy=lambda observation: np.full(3, 1e6), steps=STEPS,
            signals={"x": lambda env: env.action},
        )
        self.assertEqual(found.trace["x"].tolist(), [0.0, 0.0, *[1e6] * (STEPS - 1)])


class ArgumentTest(unittest.TestCase):
    def test_channels_and_ranges_that_do_not_fit_are_errors(self):
        for options, problem in [
            (
                {"channels": {"x": [0, 7]}},
                r"`x` in `channels` is \[0, 7\]; there are 2 numbers, from 0 on"
            ),
            ({"channels": {"x": -1}}, "there are 2 numbers, from 0 on"),
            ({"actions": {"x": 1}}, "`x` in `actions` is 1; there are 1 numbers"),
            ({"channels": {"x": []}}, "one or several whole numbers"),
            (
                {"channels": {"x": True}},
                "`x` in `channels` is True; it must be one or several whole numbers"
            ),
            ({"channels": {"x": np.array([True, False])}}, "whole numbers"),
            ({"channels": {"x": "0"}}, "`x` in `channels` is '0'; it must be"),
            ({"channels": {"x": ["0"]}}, "whole numbers"),
            ({"channels": {"x": 0.0}}, "whole numbers"),
            ({"channels": {"x": None}}, "whole numbers"),
            ({"channels": {"x": [1, 1]}}, "each number once"),
            (
                {"channels": {"x": [0, 1], "y": 1}},
                "`x` and `y` in `channels` both have the number 1"
            ),
            ({"channels": {"all": 0}}, "`all` of a channel of the observation is reserved"),
            ({"actions": {"next": 0}}, "`next` of a channel of the action is reserved"),
            ({"channels": {"": 0}}, "needs a printable name"),
            ({"channels": {3: 0}}, "channel 3 of the observation needs a printable name"),
            ({"channels": {}}, "channels is empty"),
            (
                {"ranges": {"x": (0, 1)}},
                "there is no channel `x` of the observation, which `ranges` names"
            ),
            (
                {"action_ranges": {"obs[0]": (0, 1)}},
                r"of the action, which `action_ranges` names; the channels are action\[0\]"
            ),
            (
                {"channels": {"x": 0}, "ranges": {"x": (1, 0)}},
                r"`x` in `ranges` is \(1, 0\); expected two finite numbers, the lower"
            ),
            ({"channels": {"x": 0}, "ranges": {"x": (0, np.inf)}}, "two finite numbers"),
            ({"channels": {"x": 0}, "ranges": {"x": 4}}, "two finite numbers"),
            ({"channels": {"x": 0}, "ranges": {"x": ("0", "1")}}, "two finite numbers"),
            ({"channels": {"x": 0}, "ranges": {"x": (False, True)}}, "two finite numbers"),
            ({"sensing": False, "actuation": False}, "there is no fault"),
            *(
                ({"count": count}, "count is .*; it must be a whole number from 1 to 100")
                for count in (0, 1.5, "2", True, 10**6)
            ),
            *(
                ({"steps": steps}, "steps is .*; it must be a whole number of at least 1")
                for steps in (-5, 0, 1.5, "9", True)
            ),
            *(
                ({"control_dt": dt}, "control_dt is .*; it must be positive and finite, in seconds")
                for dt in (-1, 0, np.nan, np.inf, "0.1", True)
            ),
        ]:
            with self.subTest(options), self.assertRaisesRegex(InvalidValueError, problem):
                mishandle.faults(Recorder(), **{"steps": STEPS, **options})
        for options, problem in [
            ({"channels": [0, 1]}, r"channels is \[0, 1\]; expected numbers by name"),
            (
                {"action_ranges": (0, 1)},
                r"action_ranges is \(0, 1\); expected ranges of channels by name"
            ),
            (
                {"actuation": False, "action_ranges": {"action[0]": (0, 1)}},
                "`action_ranges` has no effect without faults of the action"
            ),
        ]:
            with self.subTest(options), self.assertRaisesRegex(InvalidTypeError, problem):
                mishandle.faults(Recorder(), steps=STEPS, **options)

    def test_numbers_of_numpy_are_numbers(self):
        plain = mishandle.faults(
            Recorder(), steps=STEPS, channels={"x": [1], "y": 0}, ranges={"x": (-2.0, 2.0)},
            count=2, control_dt=0.5
        )
        numpy = mishandle.faults(
            Recorder(), steps=np.int64(STEPS), channels={"x": np.array([1]), "y": np.int64(0)},
            ranges={"x": np.array([-2, 2])}, count=np.int8(2), control_dt=np.float32(0.5)
        )
        self.assertEqual(plain, numpy)

    def test_names_of_a_space_that_a_channel_cannot_have_are_errors(self):
        env = Recorder()
        env.observation_space = Dict({"all": Box(-1.0, 1.0, (1,)), "wheel": Box(-1.0, 1.0, (1,))})
        with self.assertRaisesRegex(
            InvalidValueError, "`all` of a channel of the observation is reserved.*`channels`"
        ):
            mishandle.faults(env, steps=STEPS)
        self.assertGreater(
            len(mishandle.faults(env, steps=STEPS, channels={"whole": 0, "wheel": 1})), 0
        )

    def test_the_duration_of_a_control_step_must_be_known(self):
        env = gymnasium.make("CartPole-v1")  # states render_fps, but no dt
        with self.assertRaisesRegex(
            InvalidValueError, "CartPole-v1 does not state the duration .* pass it as control_dt"
        ):
            mishandle.faults(env)
        axes = {axis.name: axis for axis in mishandle.faults(env, control_dt=0.02)}
        self.assertAlmostEqual(axes["sensor_fault_onset"].high, 0.8 * 500 * 0.02)

    def test_several_names_of_a_category_are_refused_at_once(self):
        for setting in (["bias", "ramp"], ("bias", "ramp"), True, (0.0, "1"), (0.0, 1.0, 2.0)):
            with self.subTest(setting), self.assertRaisesRegex(
                InvalidValueError, 'axes\\["sensor_fault"\\] is .*; it must be a number'
            ):
                run({}, axes={"sensor_fault": setting})
        with self.assertRaisesRegex(InvalidTypeError, "is a set; expected a number"):
            run({}, axes={"sensor_fault": {"bias"}})
        with self.assertRaisesRegex(
            InvalidTypeError, "axes is 'sensor_fault'; expected a dictionary"
        ):
            run({}, axes="sensor_fault")


class TaskTest(FolderCase):
    """The same faults on a task in Rust, on its Gymnasium environment, and with a policy in
    Python."""

    def test_all_three_give_the_same_bits(self):
        task, env_name = "ball-balancing", "mishandle/BallBalancing-v0"
        controller = mishandle.load_controller(f"{task}/ppo")
        start = {"ball_x": 0.42, "ball_y": 0.05}
        env = gymnasium.make(env_name)
        faults = mishandle.faults(env)
        signal = "ball_tray_horizontal_distance"
        formula = f"always[50:200]({signal} <= 0.25)"
        scenarios = (
            [
                {
                    "sensor_fault": kind, "sensor_fault_onset": 0.4, "sensor_fault_duration": 0.6,
                    **extra
                }
                for kind, extra in {
                    "dropout": {"sensor_fault_fill": "zero", "sensor_fault_channel": "ball"},
                    "freeze": {"sensor_fault_recovery": 0.2},
                    "stuck": {
                        "sensor_fault_level": 0.31, "sensor_fault_channel": "ball",
                        "sensor_fault_recovery": 0.3
                    },
                    "bias": {
                        "sensor_fault_offset": 0.07, "sensor_fault_channel": "ball",
                        "sensor_fault_recovery": 0.1
                    },
                    "ramp": {
                        "sensor_fault_offset": -0.06, "sensor_fault_channel": "joint_velocities"
                    },
                    "spike": {"sensor_fault_offset": 0.21, "sensor_fault_channel": "ball_velocity"},
                    "quantization": {"sensor_fault_quantum": 0.03},
                    "swap": {
                        "sensor_fault_channel": "ball", "sensor_fault_partner": "ball_velocity"
                    },
                    "burst-loss": {"sensor_fault_probability": 0.3, "sensor_fault_burst": 4}
                }.items()
            ]
            + [
                {
                    "actuator_fault": kind, "actuator_fault_onset": 0.3,
                    "actuator_fault_duration": 0.7, **extra
                }
                for kind, extra in {
                    "authority-loss": {"actuator_fault_loss": 0.37, "actuator_fault_recovery": 0.3},
                    "stuck": {"actuator_fault_channel": "joint6"},
                    "command-loss": {"actuator_fault_probability": 0.4, "actuator_fault_burst": 3},
                    "sign-flip": {"actuator_fault_channel": "joint2"},
                    "saturation": {"actuator_fault_limit": 0.02, "actuator_fault_recovery": 0.2},
                    "clock-jitter": {"actuator_fault_lateness": 5}, "pause": {}
                }.items()
            ]
        )
        kinds = {
            axis.name: set(axis.values) for axis in faults
            if axis.name in ("sensor_fault", "actuator_fault")
        }
        tested = {scenario.get(side) for scenario in scenarios for side in kinds} - {None}
        self.assertEqual(set.union(*kinds.values()) - tested, {"none"}, "every kind is tested")
        space = "starts+faults-sensing+faults-actuation"
        wrapped = [
            Axis(name, low, high, unit, apply=mishandle.ResetOption(f"scenario.{name}"))
            for name, unit, low, high, _ in env.unwrapped._simulations.native.axes
        ]
        for scenario in scenarios:
            with self.subTest(scenario):
                at = {**start, **scenario}
                rust = simulate(task, formula, space, at=at, policy="ppo", seed=5)
                copy = simulate(
                    env, formula, [*wrapped, *faults], at=at, policy=controller, seed=5,
                    signals={signal: f"info.signals.{signal}"},
                )
                python = simulate(
                    task, formula, [*wrapped, *mishandle.faults(task)], at=at, policy=controller,
                    seed=5, rows=2
                )
                self.assertEqual(rust.end, "completed")
                healthy = simulate(task, formula, "starts", at=start, policy="ppo", seed=5)
                self.assertFalse(
                    np.array_equal(rust.trace[signal], healthy.trace[signal]),
                    "the fault has an effect"
                )
                # The environment ends an episode whose ball has fallen.
                count = len(copy.trace[signal])
                self.assertGreater(count, 45)
                np.testing.assert_array_equal(rust.trace[signal][:count], copy.trace[signal])
                np.testing.assert_array_equal(rust.trace[signal], python.trace[signal])

    def test_the_axes_of_an_environment_of_a_task_are_those_of_the_task(self):
        for name, task in mishandle.systems.task_environments.TASKS.items():
            made = {axis.name: axis for axis in mishandle.faults(gymnasium.make(name), delays=True)}
            call = Call("simulate", {}).text(target=task, controller="ppo", space="all")
            axes = json.loads(mishandle._native.target(call).axes)
            own = {axis["name"]: axis for axis in axes}
            for axis in made.values():
                found = json.loads(axes_document([axis]))
                self.assertEqual(found, [own[axis.name]], f"{task}: {axis.name}")

    def test_vector_environments_of_a_task_have_its_channels_and_ranges(self):
        task, name = "ball-balancing", "mishandle/BallBalancing-v0"
        own = mishandle.faults(task)
        for env in (
            mishandle.TaskVectorEnv(task, 2), SyncVectorEnv([lambda: gymnasium.make(name)] * 2),
            gymnasium.make_vec(name, num_envs=2),
        ):
            self.assertEqual(mishandle.faults(env), own)
        # Other channels keep the ranges of the task, and stated ranges its channels.
        for options in (
            {"channels": {"first": 0}}, {"actions": {"wrist": 6}}, {"ranges": {"ball": (-0.3, 0.3)}}
        ):
            settings = [mishandle.faults(task, **each)[0].apply.settings for each in (options, {})]
            ours, theirs = ((*each.observation.ranges, *each.action.ranges) for each in settings)
            changed = sum(one != other for one, other in zip(ours, theirs))
            self.assertEqual(
                changed,
                0 if "ranges" not in options
                else len(dict(settings[1].observation.channels)["ball"])
            )

    def test_signals_of_the_manner_are_computed_only_where_a_formula_reads_one(self):
        task, force = "point-reaching", "ground_force"
        options = {"policy": lambda observation: np.zeros(9, np.float32), "rows": 2}

        def signals(formula=None, **more):
            found = simulate(task, formula, **options, **more)
            return set(found.trace)

        own = {"finger_target_distance", "finger_twist"}
        self.assertEqual(
            [signals(each) for each in (None, "success", "strict", "always(finger_twist <= 9)")],
            [own] * 4
        )
        for read in [
            signals("careful"), signals(f"always({force} <= 1e9)"),
            signals(requirements={"gentle": f"always({force} <= 1e9)"}),
            signals(requirements={"gentle": "careful"}),
            signals({"success": "always(finger_twist <= 9)", "careful": f"{force} <= 9"}),
        ]:
            self.assertLess(own | {force}, read)
        with warnings.catch_warnings(action="ignore"):
            search, rates = self.folder / "search.sqlite", self.folder / "rates.sqlite"
            mishandle.falsify(
                task, trials=1, budget=2, search="random", out=search,
                plan={"falsify": {"batch": 2, "isolate": False}}, **options
            )
            found = mishandle.evaluate(task, episodes=2, out=rates, **options)
            self.assertIsNotNone(found.careful_success_rate)
            # The question does not change which system it is.
            for path, trial, count in ((search, 1, len(own)), (rates, None, 18)):
                again = mishandle.replay(path, task, trial=trial, number=1, **options)
                self.assertEqual((again.differences, len(again.repetition.trace)), ((), count))
