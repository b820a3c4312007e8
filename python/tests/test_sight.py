"""Axes of images in observations, tasks whose observation has images, and recordings of them."""

import pickle
import unittest

from cases import FolderCase
import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.vector import SyncVectorEnv

import mishandle
from mishandle.scenarios.lines import FaultLine

STEPS = 20
FORMULA = "always(step >= 0)"


NOISE = {"corruption": "gaussian-noise", "corruption_severity": 2}
DARK = {"corruption": "dark", "corruption_severity": 2}
"""A factor of 0.7 of the brightness."""

DUSK = {"lamp_strength": 0.18, "ambient_scale": 0.5}


class Filmed(gymnasium.Env):
    """Shows the control step as the brightness of an image, and as a number."""

    metadata = {}
    dt = 0.1
    observation_space = Dict({
        "front": Box(0, 255, (6, 8, 3), np.uint8), "step": Box(0.0, 100.0, (1,), np.float32)
    })
    action_space = Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count = 0
        return self._observation(), {}

    def step(self, action):
        self.count += 1
        return self._observation(), 0.0, False, False, {}

    def _observation(self):
        # The same memory each time, which nobody else may write.
        if not hasattr(self, "image"):
            self.image = np.zeros((6, 8, 3), np.uint8)
        self.image[:] = 10 * self.count
        return {"front": self.image, "step": np.array([self.count], np.float32)}


class Watching:
    """A policy that remembers the brightness of the images that it sees."""

    def __init__(self):
        self.seen = []

    def reset(self):
        self.seen = []

    def __call__(self, observation):
        self.seen.append((int(observation["front"][0, 0, 0]), float(observation["step"][0])))
        return np.zeros(1, np.float32)


def watch(at, env=None):
    env, policy = Filmed() if env is None else env, Watching()
    space = mishandle.sight(env, steps=STEPS)
    [found] = mishandle.simulate(
        env, FORMULA, space, at=at, policy=policy, signals={"step": "obs.step[0]"}, steps=STEPS,
        seed=3
    )
    return policy.seen, found


class Images(unittest.TestCase):
    def test_an_axis_changes_what_the_policy_sees_and_nothing_else(self):
        plain, trace = watch({})
        self.assertEqual(plain, [(10 * step, step) for step in range(STEPS)])
        dark, darkened = watch(DARK)
        self.assertEqual(dark, [(7 * step, step) for step in range(STEPS)])
        np.testing.assert_array_equal(trace.trace["step"], darkened.trace["step"])

    def test_faults_of_cameras_move_images(self):
        late, _ = watch({"camera_delay": 3})
        self.assertEqual(
            [image for image, _ in late], [10 * max(step - 3, 0) for step in range(STEPS)]
        )
        self.assertEqual([number for _, number in late], list(range(STEPS)))
        # From 0.5 s to 1 s, steps 5 to 9, the image of the step before stays.
        frozen, _ = watch({
            "camera_fault": "freeze", "camera_fault_onset": 0.5, "camera_fault_duration": 0.5
        })
        self.assertEqual(
            [image // 10 for image, _ in frozen],
            [4 if 5 <= step < 10 else step for step in range(STEPS)]
        )

    def test_noise_depends_on_the_seed_and_nominal_axes_keep_every_byte(self):
        env = Filmed()
        line = FaultLine(
            mishandle.sight(env, steps=STEPS), 0.1, STEPS, (env.observation_space, env.action_space)
        )
        self.assertIn("corruption", line.random_axes)
        nominal = {axis.name: axis.nominal_value for axis in mishandle.sight(env, steps=STEPS)}
        self.assertIsNone(line.start(nominal, 1))
        observation, _ = env.reset()

        def noisy(seed):
            return line.start({**nominal, **NOISE}, seed).observe(0, observation)["front"].tobytes()

        self.assertEqual(noisy(1), noisy(1))
        self.assertNotEqual(noisy(1), noisy(2))
        self.assertEqual(observation["front"].max(), 0)
        copied = pickle.loads(pickle.dumps(line))
        again = copied.start({**nominal, **NOISE}, 1).observe(0, observation)["front"].tobytes()
        self.assertEqual(again, noisy(1))

    def test_faults_of_numbers_and_of_images_act_together(self):
        env, policy = Filmed(), Watching()
        numbers = mishandle.faults(env, channels={"step": 144}, actuation=False, steps=STEPS)
        space = [*numbers, *mishandle.sight(env, steps=STEPS)]
        at = {
            "camera_delay": 1, "sensor_fault": "freeze", "sensor_fault_onset": 0.5,
            "sensor_fault_duration": 0.2
        }
        mishandle.simulate(
            env, FORMULA, space, at=at, policy=policy, signals={"step": "obs.step[0]"}, steps=STEPS
        )
        self.assertEqual(
            [image // 10 for image, _ in policy.seen], [max(step - 1, 0) for step in range(STEPS)]
        )
        self.assertEqual([number for _, number in policy.seen][4:8], [4, 4, 4, 7])

    def test_vector_environments_and_training_environments_apply_them(self):
        seen, _ = watch(DARK, SyncVectorEnv([Filmed, Filmed]))
        self.assertEqual(seen, [(7 * step, step) for step in range(STEPS)])
        env = mishandle.ScenarioEnv(
            Filmed(), mishandle.sight(Filmed(), steps=STEPS), steps=STEPS, seed=1
        )
        env.reset(options={"at": DARK})
        env.step(np.zeros(1, np.float32))
        observation = env.step(np.zeros(1, np.float32))[0]
        self.assertEqual((observation["front"][0, 0, 0], observation["step"][0]), (14, 2))

    def test_an_observation_may_be_one_image(self):
        class One(Filmed):
            observation_space = Filmed.observation_space["front"]

            def _observation(self):
                return super()._observation()["front"]

        env, seen = One(), []

        def policy(observation):
            seen.append(int(observation[0, 0, 0]))
            return np.zeros(1, np.float32)

        space = mishandle.sight(env, spaces="image-2", steps=STEPS)
        signals = {"step": lambda env: env.count}
        mishandle.simulate(
            env, FORMULA, space, at=DARK, policy=policy, signals=signals,
            steps=STEPS
        )
        # Nominal simulations come first.
        self.assertEqual(seen[-STEPS:], [7 * step for step in range(STEPS)])

    def test_what_needs_a_simulator_is_refused_in_one_line(self):
        for spaces, message in [
            ("light-1", "light-1 would change the scene, which Filmed does not draw for Mishandle"),
            (["image-3", "camera-3", "object-5"], "camera-3, object-5 would change the scene"),
            ("light", "there is no space of sight 'light'"),
        ]:
            with self.assertRaisesRegex(mishandle.MishandleError, message) as caught:
                mishandle.sight(Filmed(), spaces=spaces, steps=STEPS)
            self.assertNotIn("\n", str(caught.exception))
        with self.assertRaisesRegex(mishandle.MishandleError, "has no image"):
            mishandle.sight(gymnasium.make("CartPole-v1"), control_dt=0.02)
        space = mishandle.sight(Filmed(), steps=STEPS)
        with self.assertRaisesRegex(
            mishandle.MishandleError, "the axes of images were made for episodes of 20"
        ):
            mishandle.simulate(
                Filmed(), FORMULA, space, policy=Watching(), signals={"step": "obs.step[0]"},
                steps=STEPS + 1
            )


class Tasks(unittest.TestCase):
    def test_a_task_shows_images_that_change_with_its_axes_of_sight(self):
        env = gymnasium.make(
            "mishandle/BallPushing-v0", cameras=["wrist", "over"], image_size=(24, 16)
        )
        observation, _ = env.reset(seed=1)
        self.assertEqual(list(observation), ["state", "wrist", "over"])
        self.assertTrue(env.observation_space.contains(observation))
        plain = gymnasium.make("mishandle/BallPushing-v0").reset(seed=1)[0]
        np.testing.assert_array_equal(observation["state"], plain)
        dark, _ = env.reset(
            seed=1, options={"sight": {**DUSK, "object_red": -0.3}}
        )
        self.assertLess(dark["over"].mean(), observation["over"].mean() - 10)
        np.testing.assert_array_equal(dark["state"], plain)
        # The arm moves, and the images with it.
        after = env.step(np.ones(9, np.float32))[0]
        self.assertFalse(np.array_equal(after["wrist"], dark["wrist"]))
        with self.assertRaisesRegex(mishandle.MishandleError, "there is no axis of sight `lamp`"):
            env.reset(options={"sight": {"lamp": 0.2}})
        with self.assertRaisesRegex(mishandle.MishandleError, "expected a number from 0.5 to 1.1"):
            env.reset(options={"sight": {"ambient_scale": 20.0}})
        with self.assertRaisesRegex(mishandle.MishandleError, "no effect without cameras"):
            gymnasium.make("mishandle/BallPushing-v0").reset(
                options={"sight": {"ambient_scale": 0.5}}
            )
        with self.assertRaisesRegex(mishandle.MishandleError, "over, wrist"):
            gymnasium.make("mishandle/BallPushing-v0", cameras=["left"])

    def test_a_policy_that_sees_is_falsified_by_the_light(self):
        """A policy that stops in the dark violates a formula that it satisfies in the light."""
        env = mishandle.TaskEnv("point-reaching", cameras=["over"], image_size=(16, 16))
        space = mishandle.sight(env, spaces=["light-5", "image-5"])
        self.assertIn("ambient_scale", [axis.name for axis in space])

        def policy(observation):
            return np.full(9, 1.0 if observation["over"].mean() > 110 else 0.0, np.float32)

        space = mishandle.sight(env, spaces=["light-5", "image-5"], steps=30)
        signals = {"distance": "info.signals.finger_target_distance"}

        def run(at):
            [found] = mishandle.simulate(
                env, "always(distance >= 0)", space, at=at, policy=policy, signals=signals,
                steps=30, seed=2
            )
            return found.trace["distance"]

        light, dark = run({}), run({**DUSK, "corruption": "dark", "corruption_severity": 5})
        self.assertEqual(light[0], dark[0])
        self.assertGreater(np.abs(light - light[0]).max(), 0.01)
        self.assertLess(np.abs(dark - dark[0]).max(), 0.01)


NPZ = {"record": {"format": "npz"}}


class Recordings(FolderCase):
    def test_a_recording_has_the_images_of_the_environment_and_its_result(self):
        calls = []
        out = self.folder / "out"
        found = mishandle.record(
            "point-reaching", policy="expert", out=out, episodes=2, plan=NPZ,
            cameras=["over", "wrist"], size=(16, 12),
            progress=lambda done, count: calls.append((done, count)),
        )
        with np.load(out / "data.npz") as data:
            images, states = data["observation.images.over"], data["observation.state"]
            at = {
                name: float(data[f"scenario.{name}"][0])
                for name in ["target_x", "target_y", "target_z"]
            }
        with self.assertRaisesRegex(mishandle.MishandleError, "nothing exists"):
            mishandle.record("point-reaching", policy="expert", out=out, episodes=1, plan=NPZ)
        self.assertEqual((found.episodes, found.frames, found.format), (2, 600, "npz"))
        self.assertEqual(calls[-1], (2, 2))
        env = mishandle.TaskEnv("point-reaching", cameras=["over"], image_size=(16, 12))
        observation, _ = env.reset(options={"scenario": at})
        # The expert also sees the targets of its joints.
        np.testing.assert_array_equal(observation["state"], states[0][:-9])
        np.testing.assert_array_equal(observation["over"], images[0])

    def test_an_interrupted_recording_leaves_nothing(self):
        def stop(done, count):
            raise RuntimeError("enough")

        out = self.folder / "out"
        with self.assertRaisesRegex(RuntimeError, "enough"):
            mishandle.record(
                "point-reaching", policy="expert", out=out, episodes=2, plan=NPZ, progress=stop
            )
        self.assertEqual(list(self.folder.iterdir()), [])
        for changed, message in [
            ({"cameras": "over"}, "expected a list of names"),
            ({"cameras": ["left"]}, "over, wrist"),
            ({"size": (0, 8)}, "a width and a height from 1 to 1024"),
            ({"plan": {"record": {"format": "hdf5"}}}, "lerobot, npz"),
            ({"policy": "experts"}, "expert"),
        ]:
            options = {"policy": "expert", "out": out, "episodes": 1, "plan": NPZ, **changed}
            with self.assertRaisesRegex(mishandle.MishandleError, message):
                mishandle.record("point-reaching", **options)
        with self.assertRaisesRegex(mishandle.MishandleError, "neither the name of a task"):
            mishandle.record(Filmed(), out=out)
