"""Tests of the adapters of LeRobot that need no LeRobot. `cargo xtask examples pusht
point_reaching_lerobot` tests the others with it."""

import json
import unittest

from cases import FolderCase
import numpy as np

import mishandle
from mishandle.errors import MissingPackageError

# As lerobot-eval of LeRobot 0.4.4 writes it, without the paths of videos. Threads finish tasks in
# any order.
TASKS = {
    "per_task": [
        {
            "task_group": "libero_10",
            "task_id": 1,
            "metrics": {
                "sum_rewards": [0.0, 1.0], "max_rewards": [0.0, 1.0], "successes": [False, True],
                "video_paths": []
            },
        },
        {
            "task_group": "libero_10",
            "task_id": 0,
            "metrics": {
                "sum_rewards": [1.5, 2.5, 0.5], "max_rewards": [1.0, 0.75, 0.5],
                "successes": [True, False, False], "video_paths": []
            },
        },
    ],
    "per_group": {},
    "overall": {"pc_success": 40.0, "n_episodes": 5},
}


def of_episodes(successes, seeds):
    """Returns what LeRobot 0.3 and older wrote."""
    return {
        "per_episode": [
            {
                "episode_ix": index, "sum_reward": 1.0, "max_reward": 1.0, "success": success,
                "seed": seed
            }
            for index, (success, seed) in enumerate(zip(successes, seeds))
        ],
        "aggregated": {}
    }


class Evaluations(FolderCase):
    def setUp(self):
        super().setUp()
        self.runs = 0

    def read(self, document, *arguments, **options):
        self.runs += 1
        path = self.folder / "eval_info.json"
        path.write_text(json.dumps(document))
        return mishandle.lerobot.read_evaluation(
            path, *arguments, out=self.folder / f"{self.runs}.sqlite", **options
        )

    def simulations(self, found):
        return mishandle.open_run(found.path).simulations.sort_values("number")

    def test_each_episode_is_one_simulation_in_the_order_of_the_tasks(self):
        found = self.read(TASKS)
        self.assertEqual(
            [found.simulations, found.target, found.corners, found.control],
            [5, "python/libero_10", None, None]
        )
        self.assertEqual(
            self.simulations(found)["total_reward"].tolist(), [1.5, 2.5, 0.5, 0.0, 1.0]
        )
        self.assertEqual(
            (self.simulations(found)["robustness"] > 0).tolist(), [True, False, False, False, True]
        )
        self.assertEqual(100 * found.success_rate.value, TASKS["overall"]["pc_success"])

    def test_the_interval_is_that_of_wilson(self):
        found = self.read(TASKS, task="libero_10/0").success_rate
        z, n, p = 1.959963984540054, 3, 1 / 3
        center, half = (p + z**2 / (2 * n)) / (1 + z**2 / n), z / (1 + z**2 / n) * np.sqrt(
            p * (1 - p) / n + z**2 / (4 * n**2)
        )
        self.assertEqual(found.n, n)
        np.testing.assert_allclose(
            [found.low, found.high], [center - half, center + half], rtol=1e-9
        )

    def test_a_formula_may_ask_for_a_reward(self):
        self.assertEqual(self.read(TASKS, "always(max_reward >= 0.75)").success_rate.value, 3 / 5)

    def test_two_files_are_compared_episode_by_episode(self):
        old, new = [True, True, False, False, False, False], [True, False, True, True, True, True]
        first, second = (self.read(of_episodes(each, range(1000, 1006))) for each in (old, new))
        difference = mishandle.compare(first.path, second.path)
        self.assertEqual([len(difference.new_failures), len(difference.fixed_failures)], [1, 4])
        self.assertNotEqual(first.target_hash, second.target_hash)
        self.assertEqual(
            first.target_hash, self.read(of_episodes(old, range(1000, 1006))).target_hash
        )
        # McNemar's exact test of 1 and 4: twice the sum of the binomials of 5 up to 1.
        self.assertAlmostEqual(difference.success.p_value, 2 * (1 + 5) / 2**5)

    def test_episodes_of_other_seeds_are_no_pairs(self):
        first, second = (self.read(TASKS, start_seed=seed) for seed in (1000, 1001))
        with self.assertRaisesRegex(mishandle.MishandleError, "start_seed|scenario|space"):
            mishandle.compare(first.path, second.path)
        with self.assertRaisesRegex(ValueError, "do not count up from 7"):
            self.read(of_episodes([True, True], [7, 9]))
        self.assertEqual(
            self.simulations(self.read(of_episodes([True, True], [7, 8])))["start_seed"].tolist(),
            [7, 7]
        )

    def test_a_report_simulates_nothing(self):
        found = self.read(TASKS)
        found.report(self.folder / "page.html")
        self.assertEqual(len(self.simulations(found)), 5)
        self.assertIsNone(found.remembered)

    def test_mistakes_are_named(self):
        with self.assertRaisesRegex(
            ValueError,
            "no episodes of the task 'libero_10/7'; its tasks are libero_10/0, libero_10/1"
        ):
            self.read(TASKS, task="libero_10/7")
        with self.assertRaisesRegex(
            ValueError, "is not an eval_info.json of lerobot-eval: KeyError: 'per_task'"
        ):
            self.read({"overall": {}})
        cut = json.loads(json.dumps(TASKS))
        cut["per_task"][0]["metrics"]["successes"].pop()
        with self.assertRaisesRegex(
            ValueError, "is not an eval_info.json of lerobot-eval: ValueError"
        ):
            self.read(cut)
        with self.assertRaisesRegex(ValueError, "nothing.json cannot be read"):
            mishandle.lerobot.read_evaluation(self.folder / "nothing.json")


class Policies(unittest.TestCase):
    def test_a_policy_without_lerobot_says_what_to_install(self):
        with self.assertRaisesRegex(MissingPackageError, r"pip install '\.\[lerobot\]' in"):
            mishandle.lerobot.policy("checkpoints/last/pretrained_model")
