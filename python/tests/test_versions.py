"""Evaluations and comparisons that stop by themselves, and control arms."""

from cases import FolderCase
from mishandle import Axis, MishandleError, compare_versions, evaluate, sample_size

SPACE = [Axis("speed", 0, 10, "m/s")]
FORMULA = "always(gap >= 2)"


def car(factor):
    return lambda scenario: {"gap": [10.0, 10.0 - factor * scenario["speed"]]}


class Versions(FolderCase):
    def test_an_evaluation_stops_when_the_rate_is_decided(self):
        # 80 % of the speeds keep the gap.
        found = evaluate(
            car(1.0), FORMULA, SPACE, episodes=5000, until="decided", rate=0.5,
            out=self.folder / "a.sqlite"
        )
        self.assertEqual(found.sequential.decision, "above")
        self.assertLess(found.sequential.simulations, 1000)
        self.assertGreater(found.success_rate.low, 0.5)
        self.assertIsNone(found.control)

    def test_equal_versions_are_equivalent_and_their_number_is_that_of_both_files(self):
        runs = (self.folder / "a.sqlite", self.folder / "b.sqlite")
        found = compare_versions(
            car(1.0), FORMULA, SPACE, baseline=car(1.0), name="car", out=runs,
            plan={"compare": {"margin": 0.1}}
        )
        self.assertEqual(found.sequential.decision, "equivalent")
        self.assertEqual((found.success.first_only, found.success.second_only), (0, 0))
        self.assertEqual(found.pairs, found.sequential.simulations)

    def test_a_mean_robustness_needs_bounds(self):
        with self.assertRaisesRegex(MishandleError, "robustness-bounds"):
            compare_versions(
                car(1.0), FORMULA, SPACE, baseline=car(0.9), name="car",
                plan={"compare": {"measure": "robustness"}},
                out=(self.folder / "a", self.folder / "b")
            )

    def test_a_larger_difference_takes_fewer_pairs(self):
        plan = {"size": {"replications": 20}}
        small, large = (sample_size(0.8, against=other, plan=plan) for other in (0.85, 0.95))
        self.assertLess(large.fixed, small.fixed)
        self.assertLess(large.mean, small.mean)
