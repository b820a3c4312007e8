"""Tests of the ablation's parts: python studies/experiments/structure/test_ablation.py"""

import math
import unittest

import numpy as np
from formulas import parse, parts
from model import Process, asinh_targets
from scipy.optimize import approx_fprime
from scipy.stats import norm
from search import design
from systems import FUNCTIONS, WINDOWS, function_system
from tables import holm
from variants import VARIANTS, composed_bound, log_probability


def data(n: int, d: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(3)
    points = random.random((n, d))
    return points, asinh_targets(np.sin(5 * points[:, 0]) + points[:, 1] + 0.05 * random.normal(size=n))[0]


class Formulas(unittest.TestCase):
    def test_parts_of_nested_formula(self) -> None:
        [term] = parse("eventually[0:1](always[0:1](a <= 1 and b > 0))")
        found = parts([term], {"a": np.array([3.0, 0.5, 0.0]), "b": np.array([1.0, 0.2, 0.1])}, 2)
        # At sample 0: a gives min(-2, 0.5), b min(1, 0.2); at sample 1: a min(0.5, 1), b min(0.2,
        # 0.1).
        self.assertEqual(found.robustness, 0.1)
        self.assertEqual(found.alone.tolist(), [0.5, 0.2])
        self.assertEqual(found.decisive.tolist(), [0.5, 0.1])
        self.assertEqual(found.windows.tolist(), [[-2.0, 0.5], [0.2, 0.1]])

    def test_trees_of_exact_variants_give_the_robustness(self) -> None:
        for name, dimension, eventually, margins in FUNCTIONS:
            system = function_system(name, dimension, eventually, margins)
            for point in np.random.default_rng(0).random((50, dimension)):
                one = system.simulate(point)
                self.assertEqual(one.decisive.min(), one.robustness, name)
                self.assertEqual(min(one.alone.min(), one.robustness), one.robustness, name)
                tree = VARIANTS["windows-bound"].tree(system.terms, WINDOWS)
                composed = composed_bound(tree, [np.array([leaf]) for leaf in one.windows.ravel()])[0]
                # Below `eventually`, conjuncts can hold at different times of a window.
                self.assertGreaterEqual(composed, one.robustness - 1e-12, name)
                if not eventually:
                    self.assertEqual(composed, one.robustness, name)


class Model(unittest.TestCase):
    def test_gradient_of_the_density(self) -> None:
        points, targets = data(15, 3)
        process = Process(3)
        squares = ((points[:, None, :] - points[None, :, :]) ** 2).transpose(2, 0, 1)
        at = np.array([0.1, -0.4, 1.0, -3.0])
        numeric = approx_fprime(at, lambda p: process._density(p, squares, targets)[0], 1e-6)
        np.testing.assert_allclose(process._density(at, squares, targets)[1], numeric, rtol=1e-4, atol=1e-5)

    def test_leave_one_out_means(self) -> None:
        # With the mean of the whole fit, as in the closed form, leaving out is solving without a
        # row and column.
        points, targets = data(12, 2)
        process = Process(2)
        process.condition(points, targets)
        means, _ = process.leave_one_out()
        lengths, noise = np.exp(process.parameters[:-1]), math.exp(process.parameters[-1])
        far = np.sqrt(5 * (((points[:, None] - points[None]) / lengths) ** 2).sum(2))
        kernel = (1 + far + far**2 / 3) * np.exp(-far)
        for i in range(12):
            rest = [j for j in range(12) if j != i]
            noisy = kernel[np.ix_(rest, rest)] + (noise + 1e-10) * np.eye(11)
            expected = process._mean + kernel[i, rest] @ np.linalg.solve(noisy, targets[rest] - process._mean)
            self.assertAlmostEqual(means[i], expected, places=7)


class Composition(unittest.TestCase):
    def test_probability_of_a_tree(self) -> None:
        tree = ("min", [0, ("max", [1, 2])])
        heights = [1.2, -0.3, 0.4]
        p = [norm.cdf(-h) for h in heights]
        expected = 1 - (1 - p[0]) * (1 - p[1] * p[2])
        self.assertAlmostEqual(math.exp(log_probability(tree, [np.array([h]) for h in heights])[0]), expected)
        far = log_probability(("min", [0, 1]), [np.array([30.0]), np.array([31.0])])[0]
        self.assertAlmostEqual(far, norm.logsf(30.0), places=6)

    def test_ties_are_ordered_and_decide_nothing(self) -> None:
        system = function_system(*FUNCTIONS[2])
        found = [system.simulate(point) for point in np.random.default_rng(1).random((60, 8))]
        [(targets, level)] = VARIANTS["untied-bound"].targets(found)
        values = np.array([one.robustness for one in found])
        self.assertEqual(len(set(targets)), 60)
        self.assertLess(len(set(values)), 60)
        for i, j in zip(*np.nonzero(values[:, None] < values[None, :] - 1e-3)):
            self.assertLess(targets[i], targets[j])
        self.assertTrue(((targets < level) == (values < 0)).all())


class Statistics(unittest.TestCase):
    def test_holm(self) -> None:
        # 3 x 0.01; then max(0.03, 2 x 0.02) = 0.04; then max(0.04, 0.03) = 0.04.
        self.assertEqual(holm({"a": 0.02, "b": 0.01, "c": 0.03}), {"b": 0.03, "a": 0.04, "c": 0.04})

    def test_designs_are_paired(self) -> None:
        self.assertTrue((design(9, 4) == design(9, 4)).all())
        self.assertFalse((design(9, 4)[:8] == design(9, 5)[:8]).all())


if __name__ == "__main__":
    unittest.main()
