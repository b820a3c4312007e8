"""Tests of the benchmark: statistics against published values and arithmetic by hand, volumes against counts, counting of trials.

    python studies/experiments/falsifiers/test_falsifiers.py
"""

import csv
import gzip
import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

import functions
import measures
import numpy as np
import searches
import systems
import tables
from trial import Finished, Trial

HERE = pathlib.Path(__file__).parent


def system(name):
    return next(system for system in systems.load() if system.name == name)


def values_of(numbers):
    """A system whose value is the next number, whatever the point."""
    rest = list(numbers)
    return lambda point, threshold: rest.pop(0)


class Measures(unittest.TestCase):
    def test_wilson_intervals_of_newcombe(self):
        # R. Newcombe, Statistics in Medicine 17, 1998, table I, method 3.
        for successes, count, low, high in [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0, 0.1611), (1, 29, 0.0061, 0.1718)]:
            found = measures.wilson_interval(successes, count)
            np.testing.assert_allclose(found, (low, high), atol=6e-5)

    def test_intervals_of_a_ratio_of_constants_have_no_width_over_seeds(self):
        # Ratios of 1/2 and 3/4: (1 + 3) / (2 + 4) of both systems, and at most 3/4 of two of the
        # same.
        pairs = [(np.full(5, 1.0), np.full(5, 2.0)), (np.full(5, 3.0), np.full(5, 4.0))]
        seeds, like_these = measures.ratio_intervals(pairs)
        np.testing.assert_allclose(seeds, (2 / 3, 2 / 3))
        np.testing.assert_allclose(like_these, (0.5, 0.75))

    def test_a12_counts_pairs_and_half_of_the_ties(self):
        # Of nine pairs, 1 < 2, 3, 4 and 2 < 3, 4 and 3 < 4 are six, and 2 = 2 and 3 = 3 are ties.
        self.assertAlmostEqual(measures.a12(np.array([1, 2, 3]), np.array([2, 3, 4])), 7 / 9)
        self.assertEqual(measures.a12(np.array([5]), np.array([1, 2])), 0.0)

    def test_holm_by_hand(self):
        # 4 · 0.005, 3 · 0.01, 2 · 0.03, and the largest is not below its predecessor.
        np.testing.assert_allclose(measures.holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
        self.assertEqual(measures.holm([0.9, 0.8]), [1.0, 1.0])

    def test_paired_p_by_the_normal_approximation(self):
        # Ten differences of one sign: rank sum 0 with mean 10 · 11 / 4 and variance 10 · 11 · 21
        # / 24.
        first = np.arange(10.0)
        z = 27.5 / math.sqrt(96.25)
        second = first + np.arange(1, 11)
        self.assertAlmostEqual(measures.paired_p(first, second), math.erfc(z / math.sqrt(2)), places=12)
        self.assertAlmostEqual(measures.paired_p(second, first, "greater"), math.erfc(z / math.sqrt(2)) / 2, places=12)
        self.assertEqual(measures.paired_p(first, first), 1.0)

    def test_the_bootstrap_is_close_to_the_normal_interval_of_a_large_sample(self):
        values = np.random.default_rng(3).exponential(50.0, 400)
        low, high = measures.mean_interval(values)
        half = 1.96 * values.std() / 20
        np.testing.assert_allclose((low, high), (values.mean() - half, values.mean() + half), atol=0.15 * half)

    def test_a_censored_trial_counts_as_the_budget(self):
        self.assertEqual(measures.restricted([7, 300, 41], [True, False, False], 300).tolist(), [7.0, 300.0, 300.0])


class Functions(unittest.TestCase):
    def test_volumes_agree_with_counts_of_other_points(self):
        points = 200_000
        for function in functions.FUNCTIONS:
            found = functions.count(function, points, seed=17)
            expected = function.volume * points
            # Four standard deviations of the count, and of the recorded count.
            slack = 4 * math.sqrt(expected * (1 + points / functions.COUNT_POINTS)) + 1
            self.assertLess(abs(found - expected), slack, function.name)

    def test_no_function_fails_in_the_center(self):
        for function in functions.FUNCTIONS:
            self.assertGreaterEqual(function.values(np.full((1, function.dimension), 0.5))[0], 0, function.name)

    def test_tails_of_sums_of_uniform_numbers(self):
        self.assertAlmostEqual(functions.uniform_sum_tail(2, 1.5), 0.125)
        self.assertAlmostEqual(functions.uniform_sum_tail(3, 2.5), 0.5**3 / 6)
        self.assertAlmostEqual(functions.uniform_sum_tail(4, 2.0), 0.5)

    def test_usual_functions_have_their_published_minima(self):
        # Surjanovic and Bingham, Virtual Library of Simulation Experiments. It rounds Styblinski
        # and Tang's to -39.16599, which is not below the bound -39.16616 of other sources.
        cases = [
            (functions.ackley, [0.0] * 10, 0.0),
            (functions.branin, [math.pi, 2.275], 0.397887),
            (functions.goldstein_price, [0.0, -1.0], math.log(3)),
            (functions.griewank, [0.0] * 8, 0.0),
            (functions.hartmann6, [0.20169, 0.150011, 0.476874, 0.275332, 0.311652, 0.6573], -3.32237),
            (functions.levy, [1.0] * 5, 0.0),
            (functions.michalewicz, [2.202906, 1.570796, 1.284992, 1.923058, 1.720470], -4.687658),
            (functions.rastrigin, [0.0] * 4, 0.0),
            (functions.rosenbrock, [1.0] * 4, 0.0),
            (functions.schwefel, [420.9687] * 3, 0.0),
            (functions.styblinski_tang, [-2.903534] * 6, -39.166166 * 6),
        ]
        for formula, minimum, value in cases:
            self.assertAlmostEqual(float(formula(np.array([minimum]))[0]), value, places=3, msg=formula.__name__)


class Trials(unittest.TestCase):
    def trial(self, numbers, budget, batch):
        return Trial(system("ball-2"), values_of(numbers), 0, budget, batch)

    def test_simulations_count_up_to_the_violation_in_a_batch(self):
        trial = self.trial([3.0, 2.0, 1.0, -0.5, -9.0], 10, 4)
        self.assertEqual(trial.values([np.zeros(2)] * 2), [3.0, 2.0])
        with self.assertRaises(Finished):
            trial.values([np.zeros(2)] * 3)
        self.assertEqual((trial.simulations, trial.rounds, trial.violated, trial.minimum), (4, 2, True, -0.5))

    def test_the_budget_ends_a_trial(self):
        trial = self.trial([1.0] * 9, 3, 1)
        with self.assertRaises(Finished):
            trial.values([np.zeros(2)] * 9)
        self.assertEqual((trial.simulations, trial.violated), (3, False))

    def test_zero_is_no_violation_and_infinity_is_none(self):
        trial = self.trial([0.0, math.inf], 3, 1)
        self.assertEqual(trial.finite([np.zeros(2)] * 2), [0.0, systems.NO_VERDICT])
        self.assertEqual((trial.violated, trial.without_verdict), (False, 1))

    def test_a_search_that_does_not_learn_keeps_its_minimum(self):
        chosen = next(system for system in systems.load() if system.group == "task")
        found = []
        for learns in (True, False):
            trial = Trial(chosen, chosen.make(), 0, 6, 1)
            points = np.random.default_rng(5).random((6, chosen.dimension))
            with self.assertRaises(Finished):
                trial.values(list(points), learns)
            found.append((trial.minimum, trial.violated, trial.simulations))
        self.assertEqual(found[0], found[1])


class Searches(unittest.TestCase):
    def test_a_seed_repeats_a_trial_of_every_search_of_this_environment(self):
        for search in [search for search in searches.SEARCHES if search.environment == "requirements"]:
            for name in ("ball-5", "mixed-5"):
                chosen = system(name)
                for batch in search.batches:
                    trials = [Trial(chosen, chosen.make(), 5, 40, batch) for _ in range(2)]
                    for trial in trials:
                        searches.run(search, trial)
                    first, second = ((trial.simulations, trial.minimum, trial.violated) for trial in trials)
                    self.assertEqual(first, second, (search.name, name))
                    self.assertGreater(first[0], 0, search.name)

    def test_a_third_of_an_integer_axis_is_its_middle_value(self):
        self.assertEqual(searches.unit(np.array([1.0, 0.25]), [3, None]).tolist(), [0.5, 0.25])


class Bench(unittest.TestCase):
    def run_bench(self, results, *arguments):
        command = [sys.executable, "bench.py", "--results", results, "--jobs", "1", "--seeds", "5", *arguments]
        return subprocess.run(command, cwd=HERE, stderr=subprocess.PIPE, text=True)

    def test_a_second_run_continues_with_the_same_rows(self):
        with tempfile.TemporaryDirectory() as folder:
            chosen = ["--systems", "ball-2", "--searches", "portfolio", "random", "scipy-dual-annealing", "--batches", "1"]
            self.assertEqual(self.run_bench(folder, *chosen).returncode, 0)
            file = pathlib.Path(folder) / "rows/portfolio-1.csv.gz"
            lines = gzip.open(file, "rt").read().splitlines(keepends=True)
            self.assertEqual(len(lines), 6)
            file.write_bytes(gzip.compress("".join(lines[:3]).encode()))
            again = self.run_bench(folder, *chosen)
            self.assertIn("3 missing trials", again.stderr)
            timeless = lambda lines: [list(row.values())[:6] for row in csv.DictReader(lines)]
            self.assertEqual(timeless(gzip.open(file, "rt").read().splitlines()), timeless(lines))
            found = tables.read(pathlib.Path(folder))
            self.assertEqual(found.keys(1), [("random", 1), ("portfolio", 1), ("scipy-dual-annealing", 1)])
            self.assertIn("over 1 systems", tables.bars(found))

    def test_unknown_names_are_errors(self):
        with tempfile.TemporaryDirectory() as folder:
            self.assertIn("unknown search portfoli; expected one of random", self.run_bench(folder, "--searches", "portfoli").stderr)
            self.assertIn("no system starts with ball-99", self.run_bench(folder, "--systems", "ball-99").stderr)


if __name__ == "__main__":
    unittest.main()
