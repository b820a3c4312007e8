"""Faults between an environment and its policy."""

import unittest
import warnings

import cloudpickle
import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

import mishandle
from mishandle import Axis

mishandle.register()

STEPS = 40


def simulate(*arguments, **options):
    [found] = mishandle.simulate(*arguments, **options)
    return found


class Recorder(gymnasium.Env):
    """Observes a counter and its negative, and remembers the actions. The signals are the counter and the last action."""

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


def run(at, env=None, policy=None, **options):
    env = Recorder() if env is None else env
    policy = Seen() if policy is None else policy
    space = [Axis("unused", 0.0, 1.0), *mishandle.faults(env, steps=STEPS, channels={"up": 0, "down": 1}, **options)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = simulate(
            env, "always(count >= 0)", space, at=at, policy=policy, steps=STEPS,
            signals={"count": "obs[0]", "action": lambda env: env.action},
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
            ({"sensor_fault": "ramp", "sensor_fault_offset": 0.25}, np.arange(10, 15) + 25 * np.arange(1, 6) / 5),
            ({"sensor_fault": "spike", "sensor_fault_offset": 0.25}, np.arange(10, 15) + 25 * np.arange(5, 0, -1) / 5),
            ({"sensor_fault": "quantization", "sensor_fault_quantum": 0.08}, np.array([8, 8, 16, 16, 16])),
        ]:
            with self.subTest(fault):
                found, seen = run({**LIFE, **fault, "sensor_fault_channel": "up"})
                np.testing.assert_allclose(seen[10:15, 0], expected, rtol=1e-6)
                np.testing.assert_array_equal(seen[:10], healthy[:10])
                np.testing.assert_array_equal(seen[15:], healthy[15:])
                np.testing.assert_array_equal(seen[:, 1], healthy[:, 1])
                np.testing.assert_array_equal(found.trace["count"], np.arange(STEPS + 1))
        _, seen = run({**LIFE, "sensor_fault": "swap", "sensor_fault_channel": "up", "sensor_fault_partner": "down"})
        np.testing.assert_array_equal(seen[10:15], healthy[10:15, ::-1])

    def test_a_policy_that_answers_nan_ends_as_an_invalid_action_without_a_verdict(self):
        found, _ = run({**LIFE, "sensor_fault": "dropout", "sensor_fault_fill": "nan"})
        self.assertEqual((found.end, found.steps, found.robustness), ("invalid action 0 in control step 11", 10, None))

    def test_numbers_without_a_meaning_for_the_kind_are_nominal_and_named(self):
        env = Recorder()
        space = mishandle.faults(env, steps=STEPS)
        with self.assertWarnsRegex(UserWarning, "sensor_fault_offset has no effect"):
            found = simulate(
                env, "always(count >= 0)", space, at={**LIFE, "sensor_fault": "freeze", "sensor_fault_offset": 0.25},
                policy=Seen(), steps=STEPS, signals={"count": "obs[0]"},
            )
        self.assertEqual(found.scenario["sensor_fault_offset"], 0.0)


class ActuationTest(unittest.TestCase):
    def test_the_environment_gets_the_fault_for_its_life_cycle(self):
        commands = np.float32(0.04) * np.arange(STEPS, dtype=np.float32)
        # Only what the environment gets within the range of its actions is compared.
        for fault, expected in [
            ({"actuator_fault": "stuck"}, np.full(5, commands[9])),
            ({"actuator_fault": "authority-loss", "actuator_fault_loss": 0.75}, 0.25 * commands[10:15]),
            ({"actuator_fault": "sign-flip"}, -commands[10:15]),
            ({"actuator_fault": "saturation", "actuator_fault_limit": 0.2}, np.minimum(commands[10:15], 0.4)),
            ({"actuator_fault": "command-loss", "actuator_fault_probability": 1.0}, np.full(5, commands[9])),
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
        np.testing.assert_array_equal(found.trace["action"][11:16], np.full(5, found.trace["action"][10]))

    def test_discrete_actions_have_the_faults_that_only_move_them(self):
        env = Gears()
        axes = {axis.name: axis for axis in mishandle.faults(env, steps=STEPS, sensing=False)}
        self.assertEqual(
            list(axes["actuator_fault"].values), ["none", "stuck", "command-loss", "clock-jitter", "pause"]
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
        for at in [{}, {"sensor_fault": "bias", "sensor_fault_offset": 0.4}, {**LIFE}, {**HELD, "actuator_fault": "saturation"}]:
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
                values[axis.name] = number if axis.values == "continuous" else axis.value(float(round(number)))
            return values

        at = [scenario() for _ in range(24)]
        at[3].update(actuator_fault="pause", actuator_fault_duration=1.0)

        def outcomes(environment):
            system = mishandle.vector_environments.environment_system(
                environment, lambda observation: np.array([0.04 * observation[0]], np.float32), space,
                signals={"count": "obs[0]", "echo": "info.action"}, steps=STEPS, control_dt=0.1, time_limit=None, batched_policy=False,
            )
            return [found.samples for found in system.simulate([(each, seed) for seed, each in enumerate(at)])]

        single = outcomes(Informed())
        for vector in (SyncVectorEnv([Informed] * 5), AsyncVectorEnv([Informed] * 5)):
            for one, other in zip(single, outcomes(vector)):
                np.testing.assert_array_equal(one, other)
            vector.close()

    def test_a_function_without_control_steps_is_refused(self):
        space = mishandle.faults(Recorder(), steps=STEPS)
        with self.assertRaisesRegex(mishandle.InvalidTypeError, "a function has no control steps"):
            simulate(lambda scenario: {"y": [0.0, 1.0]}, "always(y >= 0)", space)
        with self.assertRaisesRegex(mishandle.InvalidTypeError, "function has no control steps"):
            mishandle.faults(lambda scenario: {"y": [0.0, 1.0]})
        with self.assertRaisesRegex(mishandle.InvalidValueError, "nothing applies it"):
            simulate(
                Recorder(), "always(count >= 0)", [Axis("broken", 0, 1, kind="fault")], policy=Seen(), steps=STEPS,
                signals={"count": "obs[0]"},
            )

    def test_another_control_period_than_that_of_the_faults_is_refused(self):
        space = mishandle.faults(Recorder(), steps=STEPS)
        with self.assertRaisesRegex(mishandle.InvalidValueError, "made for a control period of 0.1 s"):
            simulate(
                Recorder(), "always(count >= 0)", space, policy=Seen(), steps=STEPS, signals={"count": "obs[0]"}, control_dt=0.5
            )

    def test_the_faults_of_another_environment_are_refused(self):
        with self.assertRaisesRegex(mishandle.InvalidValueError, "observation has 4 numbers, but that of the system has 2"):
            simulate(
                Recorder(), "always(count >= 0)", mishandle.faults(gymnasium.make("CartPole-v1"), control_dt=0.1), policy=Seen(),
                steps=STEPS, signals={"count": "obs[0]"},
            )

    def test_a_system_on_a_cluster_keeps_its_faults(self):
        env = Recorder()
        system = mishandle.vector_environments.environment_system(
            env, Seen(), mishandle.faults(env, steps=STEPS), signals={"count": "obs[0]"}, steps=STEPS, control_dt=0.1,
            time_limit=None, batched_policy=False,
        )
        copy = cloudpickle.loads(cloudpickle.dumps(system))
        at = {axis.name: axis.nominal_value for axis in system.space.values()} | LIFE | {"sensor_fault": "freeze"}
        for each in (system, copy):
            each.simulate([(at, 3)])
            self.assertEqual([seen[0] for seen in each._policy_source.observations[9:15]], [9] * 6)
        self.assertEqual(set(system.random_axes), {"sensor_fault_probability", "actuator_fault_probability", "actuator_fault_lateness"})

    def test_the_shortest_fault_is_found_by_bisection(self):
        env = Recorder()
        space = mishandle.faults(env, steps=STEPS, actuation=False)
        # Commands are positive, unless the policy sees a negative counter.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = mishandle.margin(
                env, "eventually[40:40](action >= 0)", space, budget=300, policy=Seen(), steps=STEPS,
                axes={"sensor_fault": "stuck", "sensor_fault_level": -0.5, "sensor_fault_channel": "all", "sensor_fault_recovery": 0.0},
                signals={"action": lambda env: env.action},
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
        with self.assertRaisesRegex(mishandle.InvalidValueError, "`damp` of the axis `surface`, which has no such value"):
            mishandle.evaluate(road, "always(y >= 0)", [space[0], Axis("depth", 0, 1, when={"surface": ["damp"]})], episodes=3)

    def test_channels_and_ranges_that_do_not_fit_are_errors(self):
        for options, problem in [
            ({"channels": {"x": [0, 7]}}, "there are 2, from 0 on"),
            ({"channels": {"x": []}}, "has the numbers"),
            ({"ranges": {"x": (0, 1)}}, "there is no channel `x`"),
            ({"channels": {"x": 0}, "ranges": {"x": (1, 0)}}, "the lower value first"),
            ({"count": 0}, "count must be at least 1"),
        ]:
            with self.subTest(options), self.assertRaisesRegex(mishandle.InvalidValueError, problem):
                mishandle.faults(Recorder(), steps=STEPS, **options)


class TaskTest(unittest.TestCase):
    """The same faults on a task in Rust, on its Gymnasium environment, and with a policy in Python."""

    def test_all_three_give_the_same_bits(self):
        task, env_name = "ball-balancing", "mishandle/BallBalancing-v0"
        controller = mishandle.load_controller(f"{task}/ppo")
        start = {"ball_x": 0.42, "ball_y": 0.05}
        env = gymnasium.make(env_name)
        faults = mishandle.faults(env)
        signal = "ball_tray_horizontal_distance"
        formula = f"always[50:200]({signal} <= 0.25)"
        scenarios = [
            {"sensor_fault": kind, "sensor_fault_onset": 0.4, "sensor_fault_duration": 0.6, **extra}
            for kind, extra in {
                "dropout": {"sensor_fault_fill": "zero", "sensor_fault_channel": "ball"},
                "freeze": {"sensor_fault_recovery": 0.2},
                "stuck": {"sensor_fault_level": 0.31, "sensor_fault_channel": "ball", "sensor_fault_recovery": 0.3},
                "bias": {"sensor_fault_offset": 0.07, "sensor_fault_channel": "ball", "sensor_fault_recovery": 0.1},
                "ramp": {"sensor_fault_offset": -0.06, "sensor_fault_channel": "joint_velocities"},
                "spike": {"sensor_fault_offset": 0.21, "sensor_fault_channel": "ball_velocity"},
                "quantization": {"sensor_fault_quantum": 0.03},
                "swap": {"sensor_fault_channel": "ball", "sensor_fault_partner": "ball_velocity"},
                "burst-loss": {"sensor_fault_probability": 0.3, "sensor_fault_burst": 4},
            }.items()
        ] + [
            {"actuator_fault": kind, "actuator_fault_onset": 0.3, "actuator_fault_duration": 0.7, **extra}
            for kind, extra in {
                "authority-loss": {"actuator_fault_loss": 0.37, "actuator_fault_recovery": 0.3},
                "stuck": {"actuator_fault_channel": "joint6"},
                "command-loss": {"actuator_fault_probability": 0.4, "actuator_fault_burst": 3},
                "sign-flip": {"actuator_fault_channel": "joint2"},
                "saturation": {"actuator_fault_limit": 0.02, "actuator_fault_recovery": 0.2},
                "clock-jitter": {"actuator_fault_lateness": 5},
                "pause": {},
            }.items()
        ]
        kinds = {axis.name: set(axis.values) for axis in faults if axis.name in ("sensor_fault", "actuator_fault")}
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
                    task, formula, [*wrapped, *mishandle.faults(task)], at=at, policy=controller, seed=5, rows=2
                )
                self.assertEqual(rust.end, "completed")
                healthy = simulate(task, formula, "starts", at=start, policy="ppo", seed=5)
                self.assertFalse(np.array_equal(rust.trace[signal], healthy.trace[signal]), "the fault has an effect")
                # The environment ends an episode whose ball has fallen.
                count = len(copy.trace[signal])
                self.assertGreater(count, 45)
                np.testing.assert_array_equal(rust.trace[signal][:count], copy.trace[signal])
                np.testing.assert_array_equal(rust.trace[signal], python.trace[signal])

    def test_the_axes_of_an_environment_of_a_task_are_those_of_the_task(self):
        for name, task in mishandle.task_environments.TASKS.items():
            made = {axis.name: axis for axis in mishandle.faults(gymnasium.make(name), delays=True)}
            target = mishandle._native.Target.of_task(task, "ppo", "paper", "all", {}, (False, 0.0, 0.0))
            own = {axis[1]: axis for axis in target.axes}
            for axis in made.values():
                self.assertEqual(axis.to_native(), own[axis.name], f"{task}: {axis.name}")


if __name__ == "__main__":
    unittest.main()
