"""Models of other libraries as policies, and paths of signals. Stand-ins replace PyTorch and
Stable-Baselines3."""

import functools
import unittest

import gymnasium
import mishandle
import numpy as np
from mishandle import Attribute, Axis, ResetOption
from mishandle.errors import InvalidValueError
from mishandle.policies.kinds import as_policy, policy_hash
from mishandle.systems.environments import episode_steps


class Tensor:
    def __init__(self, values):
        self.values = np.array(values, dtype=np.float32)

    def detach(self):
        return self

    cpu = detach

    def numpy(self):
        return self.values


# The package recognizes PyTorch by the name of the base class, because it must not import it.
Module = type(
    "Module", (),
    {"__module__": "torch.nn.modules.module", "state_dict": lambda self: {"w": Tensor(self.w)}}
)


class Network(Module):
    def __init__(self, w):
        self.w = w


class Moments:
    def __init__(self, mean):
        self.mean, self.var = np.array([mean]), np.array([1.0])


class Normalizer:
    norm_obs = True

    def __init__(self, mean):
        self.obs_rms = Moments(mean)

    def normalize_obs(self, observation):
        return observation - self.obs_rms.mean


class Model:
    """Has the methods of a Stable-Baselines3 model."""

    def __init__(self, w, mean=None):
        self.policy = Network(w)
        self.normalizer = None if mean is None else Normalizer(mean)
        self.seen = None

    def get_vec_normalize_env(self):
        return self.normalizer

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        self.seen = observation
        return np.zeros((len(observation), 1)), state


def calls(model):
    return lambda observation: model.predict(observation)


class Hashes(unittest.TestCase):
    def test_the_hash_covers_the_weights_that_a_policy_refers_to(self):
        class Wrapper:
            def __init__(self, model):
                self.model, self.steps = model, 0

            def act(self, observation):
                return self.model.predict(observation)

        makers = [
            Network, Model, lambda w: calls(Model(w)), lambda w: calls(Network(w)),
            lambda w: Wrapper(Model(w))
        ]
        makers += [lambda w: Wrapper(Model(w)).act, lambda w: functools.partial(calls(Network(w)))]
        for maker in makers:
            self.assertEqual(policy_hash(maker([1.0])), policy_hash(maker([1.0])))
            self.assertNotEqual(policy_hash(maker([1.0])), policy_hash(maker([2.0])))
        self.assertNotEqual(
            policy_hash(Model([1.0], mean=0.0)), policy_hash(Model([1.0], mean=1.0))
        )

    def test_the_state_that_a_reset_clears_is_not_a_part_of_a_controller(self):
        class Integrator:
            def __init__(self, gain):
                self.gain, self.total = gain, 0.0

            def reset(self):
                self.total = 0.0

            def __call__(self, observation):
                self.total += self.gain * float(observation[0])
                return self.total

        controller = Integrator(2.0)
        before = policy_hash(controller)
        controller(np.ones(1))
        self.assertEqual(policy_hash(controller), before)
        self.assertNotEqual(policy_hash(Integrator(3.0)), before)


class Predictions(unittest.TestCase):
    def test_observations_are_normalized_as_in_training(self):
        model = Model([1.0], mean=3.0)
        as_policy(model).act([np.array([5.0]), np.array([2.0])], 2)
        np.testing.assert_array_equal(model.seen, [[2.0], [-1.0]])

    def test_batches_of_dictionaries_are_dictionaries_of_batches(self):
        rows = [{"goal": np.array([1.0, 2.0])}, {"goal": np.array([3.0, 4.0])}]
        actions = as_policy(lambda batch: batch["goal"][:, 0], batched=True).act(rows, 2)
        np.testing.assert_array_equal(actions, [1.0, 3.0])


class Actions(unittest.TestCase):
    def test_the_number_of_actions_must_be_that_of_the_observations(self):
        env = gymnasium.make("Pendulum-v1", max_episode_steps=5)
        space = [Axis("x_init", 0.1, 1.0), Axis("y_init", 0.1, 1.0)]
        with self.assertRaisesRegex(
            RuntimeError, "the policy returned 3 actions for 1 observations"
        ):
            mishandle.simulate(
                env, "always(c <= 2)", space, policy=lambda batch: np.zeros(3), batched_policy=True,
                signals={"c": "obs[0]"}
            )


    def test_an_action_of_another_length_is_refused_and_never_repeated(self):
        class Plane(gymnasium.Env):
            """A NumPy environment: it would repeat a single number for both directions."""

            observation_space = gymnasium.spaces.Box(-9, 9, (2,))
            action_space = gymnasium.spaces.Box(-9, 9, (2,))
            dt = 0.1

            def reset(self, *, seed=None, options=None):
                self.place = np.zeros(2)
                return self.place, {}

            def step(self, action):
                self.place = self.place + np.asarray(action)
                return self.place, 0.0, False, False, {}

        def end(policy, **options):
            found = mishandle.simulate(
                Plane(), "always(x <= 9)", [Axis("unused", 0, 1)], policy=policy, steps=3,
                signals={"x": "obs[0]"}, **options
            )
            return found[0].end

        self.assertEqual(end(lambda observation: np.array([0.5, 0.5])), "completed")
        self.assertEqual(end(lambda observation: [0.5, 0.5]), "completed")
        for given in (np.array([0.5]), 0.5, [0.5], np.zeros(3), np.zeros((2, 2))):
            refused = "the policy returned an action of .*expected 2"
            with self.assertRaisesRegex(RuntimeError, refused):
                end(lambda observation: given)

    def test_rewards_and_signals_of_one_element_are_numbers(self):
        class Arrays(gymnasium.Env):
            observation_space = action_space = gymnasium.spaces.Box(-9, 9, (1,))
            dt = 0.1

            def reset(self, *, seed=None, options=None):
                return np.zeros((1, 1)), {}

            def step(self, action):
                return np.full((1, 1), 0.5), np.array([0.25]), False, False, {}

        [found] = mishandle.simulate(
            Arrays(), "always(x <= 9)", [Axis("unused", 0, 1)], policy=lambda observation: [0.0],
            steps=2, signals={"x": "obs[0]", "r": "reward"}
        )
        self.assertEqual(found.end, "completed")
        self.assertEqual(list(found.trace["x"]), [0.0, 0.5, 0.5])
        self.assertEqual(list(found.trace["r"])[1:], [0.25, 0.25])

    def test_a_wrapper_states_the_time_limit(self):
        env = gymnasium.wrappers.TimeLimit(Goal(), 7)
        self.assertEqual(episode_steps(env, None), 7)
        longer = gymnasium.wrappers.TimeLimit(env, 9)
        self.assertEqual(episode_steps(longer, None), 7)
        with self.assertRaisesRegex(InvalidValueError, "has no time limit"):
            episode_steps(Goal(), None)


class Goal(gymnasium.Env):
    """Moves by its action towards a goal; its observations, settings and information are
    dictionaries."""

    observation_space = gymnasium.spaces.Dict({
        "position": gymnasium.spaces.Box(-9, 9, (2,)), "goal": gymnasium.spaces.Box(-9, 9, (2,))
    })
    action_space = gymnasium.spaces.Box(-1, 1, (2,))

    def __init__(self):
        self.config = {"gains": [1.0, 1.0]}

    def _get_obs(self):
        return {"position": self.position.copy(), "goal": self.goal}

    def reset(self, *, seed=None, options=None):
        self.position, self.goal = np.zeros(2), np.array([options["goal"]["x"], 0.0])
        return self._get_obs(), {"errors": {"last": [0.0, 0.5]}}

    def step(self, action):
        self.position += self.config["gains"][0] * np.asarray(action)
        return self._get_obs(), 0.0, False, False, {"errors": {"last": [1.0, 2.0]}}


class Paths(unittest.TestCase):
    def simulate(self, signals, *, gain="config.gains[0]"):
        space = [
            Axis("x", 1.0, 5.0, apply=ResetOption("goal.x")),
            Axis("gain", 0.5, 1.0, kind="model", apply=Attribute(gain)),
        ]
        policy = lambda observation: np.clip(observation["goal"] - observation["position"], -1, 1)
        formula = " and ".join(f"always({name} >= -100)" for name in signals)
        [found] = mishandle.simulate(
            Goal(), formula, space, at={"x": 2.0, "gain": 0.5}, policy=policy, signals=signals,
            steps=3
        )
        return {name: values.tolist() for name, values in found.trace.items()}

    def test_paths_lead_into_dictionaries(self):
        trace = self.simulate({
            "x": "obs.position[0]", "error": "info.errors.last[1]", "gain": "config.gains[0]"
        })
        self.assertEqual(
            trace, {"x": [0.0, 0.5, 1.0, 1.5], "error": [0.5, 2.0, 2.0, 2.0], "gain": [0.5] * 4}
        )

    def test_functions_of_environment_and_observation_are_sources(self):
        far = lambda env, observation: float(np.abs(observation["goal"] - env.position).max())
        self.assertEqual(self.simulate({"far": (far, "m")}), {"far": [2.0, 1.5, 1.0, 0.5]})

    def test_misspelled_attributes_and_keys_are_errors(self):
        for path in ("config.gain", "confic", "position_gain"):
            with self.assertRaisesRegex(RuntimeError, path.rpartition(".")[2]):
                self.simulate({"x": "obs.position[0]"}, gain=path)


class StableBaselines(unittest.TestCase):
    def test_a_missing_package_is_named(self):
        import mishandle.sb3

        try:
            import stable_baselines3  # noqa: F401
        except ImportError:
            with self.assertRaisesRegex(ImportError, "pip install stable-baselines3"):
                mishandle.sb3.vec_env(gymnasium.make_vec("mishandle/PointReaching-v0", num_envs=2))
