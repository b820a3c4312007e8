"""Tests of the command ``python -m mishandle.gpu.verdicts``, without a GPU."""

import json
import unittest
from dataclasses import replace

from mishandle.gpu import verdicts


class Verdicts(unittest.TestCase):
    CASE = verdicts.Case("point-reaching", "ppo", 1.0, ("success",))
    SAMPLE = verdicts.Sample(simulations=100, seed=7, threads=2)

    def test_the_simulations_are_those_of_the_command_risk(self):
        options = "--formula success -k risk.method=monte-carlo --simulations 100 --seed 7 --json"
        expected = json.loads(
            verdicts.command("risk", *verdicts.subject(self.CASE), *options.split())
        )
        axes = verdicts.axes_of(self.CASE)
        drawn = verdicts.draws(axes, self.SAMPLE)
        [row] = verdicts.in_c(self.CASE, self.SAMPLE)
        self.assertEqual(row.violated, expected["monte_carlo"]["failures"])
        names = [axis.name for axis in axes]
        self.assertGreater(len(expected["failures"]), 0)
        for failure in expected["failures"]:
            scenario = [failure["scenario"][name] for name in names]
            self.assertIn((scenario, int(failure["seed"])), drawn)

    def test_moved_scenarios_stay_in_their_ranges(self):
        axes = verdicts.axes_of(self.CASE)
        for values in ([axis.low for axis in axes], [axis.high for axis in axes]):
            for axis, value, found in zip(axes, values, verdicts.moved(values, axes)):
                self.assertAlmostEqual(abs(found - value), 1e-7, places=12)
                self.assertTrue(axis.low <= found <= axis.high)

    def test_a_larger_move_flips_more_verdicts(self):
        def flips(move):
            [row] = verdicts.in_c(self.CASE, replace(self.SAMPLE, move=move))
            return row.moved_missed + row.moved_refuted

        small, large = flips(1e-7), flips(0.05)
        self.assertLess(small, 3)
        self.assertGreater(large, small)

    def test_every_task_has_a_case_for_each_formula(self):
        found = [(case.task, formula) for case in verdicts.CASES for formula in case.formulas]
        self.assertEqual(len(found), 16)
        self.assertEqual(len(set(found)), 16)
