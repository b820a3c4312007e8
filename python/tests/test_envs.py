"""Tests of the tasks as Gymnasium environments."""

import functools
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import unittest
import warnings

import cases
import core
import gymnasium
import mishandle
import numpy as np
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from mishandle import MishandleError, TaskEnv, TaskVectorEnv, _native
from mishandle.systems.task_environments import TASKS


def actions(step, rows, size):
    """Returns the actions of simulator_rows.rs: from -1.25 to 1.25 in steps of an eighth."""
    i = np.arange(rows * size)
    return ((step * 5 + i * 7) % 21 / 8 - 1.25).astype(np.float32).reshape(rows, size)


def walk(task, rows, seed, steps, threads):
    """Returns the results of control steps as bytes, in the order of simulator_rows.rs."""
    simulator = _native.Simulator(task, rows, preset="paper", reward="shaped", threads=threads)
    mask, seeds = np.ones(rows, dtype=bool), np.arange(seed, seed + rows, dtype=np.uint64)
    results = [simulator.reset(mask, seeds, np.full((rows, len(simulator.axes)), np.nan))]
    results += [simulator.step(actions(step, rows, simulator.action_size)) for step in range(steps)]
    return b"".join(array.tobytes() for samples in results for array in samples[:3])


@functools.cache
def draws():
    """Returns whether this machine can draw pictures."""
    env = TaskEnv("point-reaching", render_mode="rgb_array", width=16, height=16)
    env.reset(seed=0)
    try:
        env.render()
    except MishandleError as error:
        assert "libegl1" in str(error), error
        return False
    return True


class Bits(unittest.TestCase):
    def test_rows_are_bit_identical_to_the_core_for_any_number_of_threads(self):
        for task in ["point-reaching", "ball-balancing"]:
            expected = core.example("simulator_rows", task, 5, 11, 40)
            for threads in [1, 3]:
                self.assertEqual(walk(task, 5, 11, 40, threads), expected, (task, threads))

    def test_a_vector_environment_equals_single_environments(self):
        vector = TaskVectorEnv("ball-balancing", 3)
        observations, _ = vector.reset(seed=[4, 5, 6])
        singles = [TaskEnv("ball-balancing") for _ in range(3)]
        for row, env in enumerate(singles):
            np.testing.assert_array_equal(env.reset(seed=4 + row)[0], observations[row])
        for step in range(30):
            given = actions(step, 3, 9)
            observations, rewards, terminated, _, info = vector.step(given)
            for row, env in enumerate(singles):
                found = env.step(given[row])
                np.testing.assert_array_equal(found[0], observations[row])
                self.assertEqual((found[1], found[2]), (rewards[row], terminated[row]))
                self.assertEqual(
                    found[4]["signals"]["ball_speed"], info["signals"]["ball_speed"][row]
                )


class Environments(unittest.TestCase):
    def test_all_tasks_pass_the_checker_of_gymnasium(self):
        for name in TASKS:
            env = gymnasium.make(name)
            with warnings.catch_warnings(record=True, action="always") as caught:
                check_env(
                    env.unwrapped,
                    skip_render_check=name != "mishandle/PointReaching-v0" or not draws()
                )
            texts = [str(warning.message) for warning in caught]
            # Observations have no bounds.
            self.assertTrue(all("infinity" in text for text in texts), (name, texts))
            self.assertEqual(env.spec.max_episode_steps, 300)

    def test_a_scenario_sets_the_initial_state(self):
        env = TaskEnv("point-reaching")
        first = env.reset(
            seed=1, options={"scenario": {"target_x": 0.5, "target_y": 0.1, "target_z": 0.4}}
        )
        second = env.reset(seed=2, options={"scenario": [0.5, 0.1, 0.4]})
        np.testing.assert_array_equal(first[0], second[0])
        self.assertFalse(np.array_equal(env.reset(seed=3)[0], first[0]))
        with self.assertRaisesRegex(ValueError, "no axis `target`; the axes are target_x"):
            env.reset(options={"scenario": {"target": 1.0}})

    def test_the_reward_is_the_sum_of_its_terms(self):
        env = TaskEnv("door-opening")
        env.reset(seed=0)
        _, reward, _, _, info = env.step(np.zeros(9, np.float32))
        self.assertAlmostEqual(reward, sum(info["reward_terms"].values()), places=12)


class Pictures(unittest.TestCase):
    def setUp(self):
        if not draws() and "without_egl" not in self.id():
            self.skipTest("EGL is not installed: apt install libegl1 libgl1-mesa-dri")

    def test_a_picture_shows_the_state(self):
        env = TaskEnv("point-reaching", render_mode="rgb_array", width=320, height=240)
        env.reset(seed=0, options={"scenario": [0.5, -0.3, 0.4]})
        first = env.render()
        self.assertEqual((first.shape, first.dtype), ((240, 320, 3), np.uint8))
        np.testing.assert_array_equal(env.render(), first)
        # The target is the only red thing; a target further to the left of the robot is elsewhere
        # in the picture.
        columns = []
        for y in (-0.3, 0.3):
            env.reset(seed=0, options={"scenario": [0.5, y, 0.4]})
            picture = env.render().astype(int)
            red = (picture[..., 0] > 150) & (picture[..., 1] < 90) & (picture[..., 2] < 90)
            self.assertTrue(20 < red.sum() < 2000, red.sum())
            columns.append(np.nonzero(red)[1].mean())
        self.assertGreater(abs(columns[0] - columns[1]), 30)
        for _ in range(10):
            env.step(np.ones(9, np.float32))
        self.assertFalse(np.array_equal(env.render(), picture), "the arm has moved")

    def test_a_vector_environment_returns_a_picture_of_each_row_in_any_thread(self):
        env = gymnasium.make_vec(
            "mishandle/BallBalancing-v0", num_envs=2, render_mode="rgb_array", width=160, height=120
        )
        env.reset(seed=[4, 5])
        pictures = env.render()
        self.assertEqual(
            (type(pictures), len(pictures), pictures[0].shape), (tuple, 2, (120, 160, 3))
        )
        single = TaskEnv("ball-balancing", render_mode="rgb_array", width=160, height=120)
        single.reset(seed=5)
        np.testing.assert_array_equal(single.render(), pictures[1])
        found = []
        thread = threading.Thread(target=lambda: found.append(env.render()))
        thread.start()
        thread.join()
        np.testing.assert_array_equal(found[0], pictures)

    def test_mistakes_are_explained(self):
        with self.assertRaisesRegex(RuntimeError, "make it with render_mode='rgb_array'"):
            TaskEnv("point-reaching").render()
        with self.assertRaisesRegex(
            ValueError, "'human' is not supported; it must be 'rgb_array' or None"
        ):
            TaskEnv("point-reaching", render_mode="human")
        with self.assertRaisesRegex(
            ValueError, "161 x 120 pixels; width and height must be even and from 16 to 4096"
        ):
            TaskEnv("point-reaching", render_mode="rgb_array", width=161, height=120).render()

    def test_without_egl_the_package_works_and_a_picture_is_an_error(self):
        # Both libraries are loaded by name when a picture is drawn; an empty file under these names
        # cannot be loaded.
        program = (
            "import mishandle\n"
            "env = mishandle.TaskEnv('point-reaching', render_mode='rgb_array')\n"
            "env.reset(seed=0)\n"
            "try:\n"
            "    env.render()\n"
            "except mishandle.MishandleError as error:\n"
            "    print(error)\n"
        )
        with tempfile.TemporaryDirectory() as folder:
            for name in ["libEGL.so.1", "libEGL.so"]:
                (pathlib.Path(folder) / name).touch()
            variables = {**os.environ, "LD_LIBRARY_PATH": folder}
            found = subprocess.run(
                [sys.executable, "-c", program], env=variables, check=True, capture_output=True,
                text=True, timeout=600
            )
        self.assertRegex(found.stdout, "cannot render .*apt install libegl1 libgl1-mesa-dri")


class VectorEnvironments(unittest.TestCase):
    def test_next_step_mode_resets_in_the_step_after_the_end(self):
        env = TaskVectorEnv("point-reaching", 2, max_episode_steps=3)
        self.assertIs(env.metadata["autoreset_mode"], AutoresetMode.NEXT_STEP)
        first, _ = env.reset(seed=1)
        push = np.ones((2, 9), np.float32)
        for _ in range(2):
            self.assertFalse(env.step(push)[3].any())
        last, _, terminated, truncated, _ = env.step(push)
        self.assertTrue(truncated.all() and not terminated.any())
        observations, rewards, terminated, truncated, _ = env.step(push)
        self.assertFalse(truncated.any() or terminated.any())
        self.assertEqual(rewards.tolist(), [0.0, 0.0])
        np.testing.assert_array_equal(observations[:, 9:18], first[:, 9:18], "at rest again")
        self.assertFalse(np.array_equal(observations[:, 18:21], first[:, 18:21]), "another target")
        self.assertFalse(np.array_equal(last, observations))
        self.assertFalse(env.step(push)[3].any(), "the next episode has its full length")

    def test_same_step_mode_returns_the_final_observation(self):
        next_step = TaskVectorEnv("point-reaching", 2, max_episode_steps=2)
        same_step = TaskVectorEnv(
            "point-reaching", 2, max_episode_steps=2, autoreset_mode="SameStep"
        )
        for env in [next_step, same_step]:
            env.reset(seed=3)
        push = np.ones((2, 9), np.float32)
        self.assertNotIn("final_obs", same_step.step(push)[4])
        next_step.step(push)
        last = next_step.step(push)[0]
        observations, _, _, truncated, info = same_step.step(push)
        self.assertTrue(truncated.all() and info["_final_obs"].all())
        np.testing.assert_array_equal(np.stack(info["final_obs"]), last)
        # Both modes start the same second episode.
        np.testing.assert_array_equal(next_step.step(push)[0], observations)

    def test_without_copies_the_same_arrays_are_returned_with_the_same_numbers(self):
        for mode in ["NextStep", "SameStep"]:
            fresh, reused = [
                TaskVectorEnv(
                    "ball-balancing", 3, max_episode_steps=40, autoreset_mode=mode, copy=copy
                )
                for copy in [True, False]
            ]
            kept = [fresh.reset(seed=4)[0]]
            first, _ = reused.reset(seed=4)
            copies = [first.copy()]
            for step in range(100):
                given = actions(step, 3, 9)
                results, same = fresh.step(given), reused.step(given)
                for one, other in zip(results[:4], same[:4]):
                    np.testing.assert_array_equal(one, other)
                for part in ["signals", "reward_terms"]:
                    for name, values in results[4][part].items():
                        np.testing.assert_array_equal(values, same[4][part][name], name)
                if "final_obs" in results[4]:
                    ended = results[4]["_final_obs"]
                    np.testing.assert_array_equal(ended, results[2] | results[3])
                    np.testing.assert_array_equal(
                        np.stack(results[4]["final_obs"][ended]),
                        np.stack(same[4]["final_obs"][ended])
                    )
                    for name, values in results[4]["final_info"]["signals"].items():
                        np.testing.assert_array_equal(
                            values, same[4]["final_info"]["signals"][name], name
                        )
                self.assertIs(same[0], first)
                self.assertTrue(
                    np.shares_memory(same[4]["signals"]["ball_speed"], reused._samples[2])
                )
                kept.append(results[0])
                copies.append(same[0].copy())
                if step == 50:
                    mask = same[3]  # An array of the environment itself.
                    mask[:] = [True, False, True]
                    kept.append(fresh.reset(options={"reset_mask": mask.copy()})[0])
                    copies.append(reused.reset(options={"reset_mask": mask})[0].copy())
            # Later steps left the earlier arrays alone.
            np.testing.assert_array_equal(np.stack(kept), np.stack(copies))

    def test_a_row_that_diverged_keeps_its_last_observation(self):
        class Diverging:
            """The simulator, whose row 1 diverges in each step."""

            def __init__(self, native):
                self._native = native

            def __getattr__(self, name):
                return getattr(self._native, name)

            def step(self, actions, out):
                before = [array[1].copy() for array in out[:3]]
                self._native.step(actions, out)
                for array, row in zip(out, [before[0], 0.0, before[2], True, True]):
                    array[1] = row
                return out

        for copy in [True, False]:
            env = TaskVectorEnv("point-reaching", 2, copy=copy)
            first = env.reset(seed=0)[0].copy()
            env._simulations.native = Diverging(env._simulations.native)
            observations, rewards, terminated, _, info = env.step(np.ones((2, 9), np.float32))
            np.testing.assert_array_equal(observations[1], first[1])
            self.assertFalse(np.array_equal(observations[0], first[0]))
            self.assertEqual((rewards[1], terminated.tolist()), (0.0, [False, True]))
            self.assertGreater(info["signals"]["finger_target_distance"][1], 0.0)

    def test_the_memory_of_results_is_checked(self):
        native = _native.Simulator("point-reaching", 2, preset="paper", reward="shaped", threads=1)
        still, arrays = np.zeros((2, 9), np.float32), native.arrays()
        for wrong, message in [
            (np.zeros((3, arrays[0].shape[1]), np.float32), "`out` must have the shape"),
            (np.zeros(arrays[0].shape[::-1], np.float32).T, "contiguous"),
            (
                np.zeros(arrays[0].nbytes + 1, np.uint8)[1:].view(np.float32).reshape(
                    arrays[0].shape
                ),
                "not aligned"
            ),
        ]:
            with self.assertRaisesRegex(Exception, message):
                native.step(still, (wrong, *arrays[1:]))
        frozen = np.zeros_like(arrays[0])
        frozen.flags.writeable = False
        with self.assertRaises(Exception):
            native.step(still, (frozen, *arrays[1:]))
        with self.assertRaises(Exception):
            native.step(still, (*arrays[:2], arrays[1], *arrays[3:]))

    def test_seeds_scenarios_and_masks_are_honored_per_environment(self):
        env = TaskVectorEnv("point-reaching", 3)
        both = [env.reset(seed=seed)[0] for seed in (5, [5, 6, 7])]
        np.testing.assert_array_equal(*both)
        targets = [[0.5, 0.0, 0.3], {"target_x": 0.6}, None]
        observations, info = env.reset(seed=5, options={"scenario": targets})
        np.testing.assert_array_equal(observations[2], both[0][2])
        np.testing.assert_allclose(observations[0, 18:21], targets[0], atol=1e-6)
        before = env.step(np.ones((3, 9), np.float32))[0]
        after, _ = env.reset(options={"reset_mask": np.array([True, False, True])})
        np.testing.assert_array_equal(after[1], before[1])
        self.assertFalse(np.array_equal(after[0], before[0]))

    def test_a_lost_ball_terminates_the_episode(self):
        env = TaskVectorEnv("ball-balancing", 2)
        env.reset(seed=0)
        tilt = np.tile(np.array([1, -1, 1, -1, 1, 1, 1, 0, 0], np.float32), (2, 1))
        ends = [env.step(tilt)[2:4] for _ in range(299)]
        self.assertTrue(any(terminated.any() for terminated, _ in ends))


class Errors(unittest.TestCase):
    def check(self, message, action, kind=MishandleError):
        with self.assertRaises(kind) as raised:
            action()
        self.assertIn(message, str(raised.exception))
        self.assertNotIn("\n", str(raised.exception))

    def test_names_and_numbers(self):
        self.check("did you mean `point-reaching`?", lambda: TaskEnv("point-reachin"))
        self.check(
            "no task preset `x`; choose from: paper, code",
            lambda: TaskEnv("point-reaching", preset="x")
        )
        self.check(
            "no reward `x`; choose from: shaped", lambda: TaskEnv("point-reaching", reward="x")
        )
        self.check("from 1 to 1000000, found 0", lambda: TaskVectorEnv("point-reaching", 0))
        for threads in [0, 1025, 2**40]:
            message = f"`threads` must be a whole number from 1 to 1024, found {threads}"
            self.check(message, lambda: TaskVectorEnv("point-reaching", 1, threads=threads))

    def test_actions(self):
        env = TaskVectorEnv("point-reaching", 2)
        env.reset(seed=0)
        good = np.zeros((2, 9), np.float32)
        bad = good.copy()
        bad[1, 4] = np.nan
        self.check("must be finite, found NaN at [1, 4]", lambda: env.step(bad))
        self.check("must have the shape [2, 9], found [2, 8]", lambda: env.step(good[:, :8]))

    def test_actions_anywhere_in_memory(self):
        env = TaskVectorEnv("point-reaching", 2)
        good = np.linspace(-1, 1, 18, dtype=np.float32).reshape(2, 9)

        def step(given):
            env.reset(seed=0)
            return env.step(given)[0]

        expected = step(good)
        odd = np.frombuffer(b"\0" + good.tobytes(), np.float32, offset=1, count=18).reshape(2, 9)
        self.assertFalse(odd.flags.aligned)
        self.check("not aligned in memory", lambda: step(odd))
        wide = np.zeros((4, 27), np.float32)
        wide[::2, ::3] = good
        for strided in [
            wide[::2, ::3], np.asfortranarray(good), good.astype(">f4"), good.astype(np.float64)
        ]:
            np.testing.assert_array_equal(step(strided), expected)


class Fork(cases.ThreadsAndForks):
    def make(self, rows, threads):
        return TaskVectorEnv("point-reaching", rows, threads=threads)

    def reset(self, env):
        return env.reset(seed=0)[0]

    def test_a_child_creates_its_own_environments(self):
        expected = walk("ball-balancing", 4, 3, 5, 2)
        self.in_child(lambda: walk("ball-balancing", 4, 3, 5, 2) == expected)

    def test_a_child_drops_the_environments_of_its_parent(self):
        held = [TaskVectorEnv("point-reaching", 4, threads=4)]
        held[0].reset(seed=0)
        self.in_child(lambda: held.pop() is not None)

    def test_the_first_use_after_an_import_can_be_in_a_child(self):
        program = (
            "import os, mishandle\n"
            "if os.fork() == 0:\n"
            "    env = mishandle.TaskVectorEnv('point-reaching', 2)\n"
            "    os._exit(0 if env.reset()[0].shape[0] == 2 else 1)\n"
            "assert os.wait()[1] == 0"
        )
        subprocess.run([sys.executable, "-c", program], check=True, timeout=600)


class Package(unittest.TestCase):
    def test_importing_the_package_registers_the_environments(self):
        for name in TASKS:
            self.assertIn(name, gymnasium.registry)
        self.assertEqual(len(TASKS), 8)

    def test_the_public_names_exist(self):
        for name in mishandle.__all__:
            self.assertTrue(hasattr(mishandle, name), name)
