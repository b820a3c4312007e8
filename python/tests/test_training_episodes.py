"""Tests of `TrainingEpisodes`, the episodes of `mishandle train`."""

import os
import subprocess
import sys
import unittest

import cases
import core
import mishandle
import numpy as np
from mishandle import MishandleError
from mishandle.systems import TrainingEpisodes


def actions(step, environments, size):
    """Return the actions of trainer_rows.rs: from -1.25 to 1.25 in steps of an eighth."""
    i = np.arange(environments * size)
    return ((step * 5 + i * 7) % 21 / 8 - 1.25).astype(np.float32).reshape(environments, size)


def walk(env, steps):
    """Return the results of `steps` control steps as bytes, in the order of trainer_rows.rs."""
    results = [env.reset()]
    for step in range(steps):
        observations, rewards, terminated, truncated, info = env.step(
            actions(step, env.environments, env.action_size)
        )
        results += [rewards, terminated, truncated, info["final_observation"], observations]
    return b"".join(array.tobytes() for array in results)


class Bits(unittest.TestCase):
    def test_rows_are_bit_identical_to_the_trainer(self):
        for task in ["point-reaching", "ball-balancing"]:
            numbers = dict(environments=5, seed=11, time_limit=40, steps=70)
            trainer = core.example("trainer_rows", task, *numbers.values())
            env = TrainingEpisodes(
                task, 5, seed=11, time_limit=40, action_noise=0.25, staggered=True
            )
            self.assertEqual(walk(env, 70), trainer, task)

    def test_results_depend_on_the_seed_and_not_on_the_threads(self):
        make = lambda seed, threads: TrainingEpisodes(
            "ball-balancing", 9, seed=seed, threads=threads, time_limit=20
        )
        first = walk(make(1, 1), 45)
        self.assertEqual(first, walk(make(1, 3), 45))
        self.assertNotEqual(first, walk(make(2, 1), 45))

    def test_a_reset_restarts_the_same_episodes(self):
        env = TrainingEpisodes("point-reaching", 3, seed=5, action_noise=0.1)
        self.assertEqual(walk(env, 10), walk(env, 10))


class Episodes(unittest.TestCase):
    def test_shapes_types_and_names(self):
        env = TrainingEpisodes("ball-balancing", 4)
        self.assertEqual(
            (env.task, env.environments, env.action_size, env.episode_steps),
            ("ball-balancing", 4, 9, 300)
        )
        self.assertEqual(env.control_dt, 1 / 60)
        self.assertEqual(len(env.observation_names), env.observation_size)
        self.assertEqual(env.observation_names[8], "joint_positions[8]")
        shape = (4, env.observation_size)
        first = env.reset()
        self.assertEqual((first.shape, first.dtype), (shape, np.float32))
        observations, rewards, terminated, truncated, info = env.step(np.zeros((4, 9), np.float32))
        self.assertEqual((observations.shape, observations.dtype), (shape, np.float32))
        self.assertEqual((rewards.shape, rewards.dtype), ((4,), np.float64))
        for flags in [terminated, truncated]:
            self.assertEqual((flags.shape, flags.dtype), ((4,), np.bool_))
        self.assertEqual(list(info), ["final_observation"])
        self.assertEqual(info["final_observation"].shape, shape)

    def test_the_time_limit_truncates_and_the_next_episode_starts_in_the_same_step(self):
        env = TrainingEpisodes("point-reaching", 2, time_limit=3)
        first = env.reset()
        for step in range(1, 7):
            before = observations if step > 1 else first
            observations, _, terminated, truncated, info = env.step(np.ones((2, 9), np.float32))
            self.assertFalse(terminated.any())
            self.assertEqual(truncated.all(), step % 3 == 0)
            final = info["final_observation"]
            # The arm moves in the step that ends an episode, so the final observation is not a
            # first observation.
            self.assertFalse(np.array_equal(final, before))
            self.assertEqual(np.array_equal(final, observations), step % 3 != 0)
            if step == 3:
                self.assertTrue(
                    np.array_equal(observations[:, 9:18], first[:, 9:18]), "at rest again"
                )
                self.assertFalse(
                    np.array_equal(observations[:, 18:21], first[:, 18:21]), "another target"
                )

    def test_a_lost_ball_terminates_the_episode(self):
        env = TrainingEpisodes("ball-balancing", 2)
        env.reset()
        tilt = np.tile(np.array([1, -1, 1, -1, 1, 1, 1, 0, 0], np.float32), (2, 1))
        ends = [env.step(tilt)[2:4] for _ in range(299)]
        self.assertTrue(any(terminated.any() for terminated, _ in ends))
        self.assertFalse(any(truncated[0] for _, truncated in ends[:100]))

    def test_actions_are_clipped(self):
        env = TrainingEpisodes("point-reaching", 1)
        observations = []
        for size in [1.0, 5.0]:
            env.reset()
            observations.append(env.step(np.full((1, 9), size, np.float32))[0])
        self.assertTrue(np.array_equal(*observations))


class Errors(unittest.TestCase):
    def check(self, message, action):
        with self.assertRaises(MishandleError) as raised:
            action()
        self.assertIn(message, str(raised.exception))
        self.assertNotIn("\n", str(raised.exception))

    def test_names_and_numbers(self):
        self.check("did you mean `point-reaching`?", lambda: TrainingEpisodes("point-reachin", 1))
        self.check(
            "no task preset `x`; choose from: paper, code",
            lambda: TrainingEpisodes("point-reaching", 1, preset="x")
        )
        self.check(
            "no reward `x`; choose from: shaped",
            lambda: TrainingEpisodes("point-reaching", 1, reward="x")
        )
        self.check(
            "`environments` must be a whole number from 1 to 10^6, found 0",
            lambda: TrainingEpisodes("point-reaching", 0)
        )
        self.check(
            "`time_limit` must be a whole number from 1 to 10^12",
            lambda: TrainingEpisodes("point-reaching", 1, time_limit=0)
        )
        self.check(
            "`action_noise` must be",
            lambda: TrainingEpisodes("point-reaching", 1, action_noise=float("nan"))
        )
        for threads in [0, 1025, 2**40]:
            message = f"`threads` must be a whole number from 1 to 1024, found {threads}"
            self.check(message, lambda: TrainingEpisodes("point-reaching", 1, threads=threads))
        with self.assertRaises(OverflowError):
            TrainingEpisodes("point-reaching", -1)

    def test_actions(self):
        env = TrainingEpisodes("point-reaching", 2)
        good = np.zeros((2, 9), np.float32)
        self.check("call `reset` before the first `step`", lambda: env.step(good))
        first = env.reset()
        bad = good.copy()
        bad[1, 4] = np.nan
        self.check("must be finite, found NaN at [1, 4]", lambda: env.step(bad))
        self.check("found [2, 8]", lambda: env.step(good[:, :8]))
        self.check("found [3, 9]", lambda: env.step(np.zeros((3, 9), np.float32)))
        self.check(
            "float32 and shape (2, 9), found ndarray of float64", lambda: env.step(np.zeros((2, 9)))
        )
        self.check(
            "found ndarray of float32 and shape (18,)", lambda: env.step(np.zeros(18, np.float32))
        )
        self.check("found list", lambda: env.step([[0.0] * 9] * 2))
        # The invalid calls did not step the environments, and an array in column order is accepted.
        self.assertTrue(
            np.array_equal(env.step(np.asfortranarray(good))[0], self.after_one_step(first))
        )

    def test_actions_anywhere_in_memory(self):
        env = TrainingEpisodes("point-reaching", 2)
        good = np.linspace(-1, 1, 18, dtype=np.float32).reshape(2, 9)

        def step(actions):
            env.reset()
            return env.step(actions)[0]

        expected = step(good)
        packed = np.zeros((2, 9), np.dtype([("pad", "u1"), ("action", "f4")]))
        packed["action"] = good
        self.assertFalse(packed["action"].flags.aligned)
        odd = np.frombuffer(b"\0" + good.tobytes(), np.float32, offset=1, count=18).reshape(2, 9)
        self.assertFalse(odd.flags.aligned)
        for unaligned in [packed["action"], odd]:
            self.check("not aligned in memory", lambda: step(unaligned))
            self.assertTrue(np.array_equal(step(unaligned.copy()), expected))
        wide = np.zeros((4, 27), np.float32)
        wide[::2, ::3] = good
        backward = np.ascontiguousarray(good[::-1, ::-1])
        for strided in [wide[::2, ::3], np.asfortranarray(good), backward[::-1, ::-1]]:
            self.assertTrue(np.array_equal(step(strided), expected))
        one = np.ones(1, np.float32)
        self.assertTrue(
            np.array_equal(step(np.broadcast_to(one, (2, 9))), step(np.ones((2, 9), np.float32)))
        )
        self.check("float32", lambda: step(good.astype(">f4")))

    @staticmethod
    def after_one_step(first):
        env = TrainingEpisodes("point-reaching", 2)
        assert np.array_equal(env.reset(), first)
        return env.step(np.zeros((2, 9), np.float32))[0]


class Fork(cases.ThreadsAndForks):
    def make(self, rows, threads):
        return TrainingEpisodes("point-reaching", rows, threads=threads)

    def test_a_child_creates_its_own_environments(self):
        make = lambda: walk(TrainingEpisodes("ball-balancing", 4, seed=3, threads=2), 5)
        expected = make()
        self.in_child(lambda: make() == expected)

    def test_a_child_drops_the_environments_of_its_parent(self):
        held = [TrainingEpisodes("point-reaching", 4, threads=4)]
        held[0].reset()
        self.in_child(lambda: held.pop() is not None)

    def test_the_first_use_after_an_import_can_be_in_a_child(self):
        program = "import os, mishandle\n" \
            "if os.fork() == 0:\n" \
            "    env = mishandle.systems.TrainingEpisodes('point-reaching', 2)\n" \
            "    os._exit(0 if env.reset().shape[0] == 2 else 1)\n" \
            "assert os.wait()[1] == 0"
        subprocess.run([sys.executable, "-c", program], check=True, timeout=600)
