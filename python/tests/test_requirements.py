"""Tests of formulas in words, of patterns and of mined parameters."""

import unittest

import mishandle
from mishandle.errors import InvalidValueError

LOGS = [
    {"time": [0.0, 0.5, 1.0, 1.5], "force": [0.0, 1.0, 4.0, 7.5]},
    {"time": [0.0, 0.5, 1.0, 1.5], "force": [0.0, 5.0, 4.0, 2.0]},
]


class TestFormula(unittest.TestCase):
    def test_a_formula_without_a_log_has_two_examples(self):
        found = mishandle.formula("always[0:2s](force <= 20)")
        self.assertEqual(found.words, ("at every step from 0 s to 2 s: force is at most 20",))
        self.assertEqual([example.violated for example in found.examples], [False, True])
        for example in found.examples:
            values = {signal.signal: signal.values for signal in example.values}
            plan = {"log": {"period": example.period}}
            robustness = mishandle.robustness("always[0:2s](force <= 20)", values, plan=plan)
            self.assertEqual(robustness, example.robustness)

    def test_a_formula_is_drawn_over_a_log(self):
        found = mishandle.formula("always(force <= 6)", LOGS, units={"force": "N"})
        self.assertEqual(
            [(example.kind, example.violated) for example in found.examples],
            [("log", True), ("log", False)]
        )
        self.assertIn("log 1: violated, robustness -1.5", str(found))
        self.assertEqual(found.signals[0].unit, "N")

    def test_an_episode_shorter_than_a_window_is_a_trap(self):
        [trap] = mishandle.formula(
            "always[0:10s](x >= 1)", plan={"formula": {"episode": 5}}
        ).traps
        self.assertEqual(trap.name, "horizon-beyond-episode")

    def test_patterns(self):
        text = mishandle.logs.pattern("hold-for", p="closed >= 1", q="force < 20", duration="2s")
        self.assertEqual(
            text,
            "always(s_prev not(closed >= 1) and closed >= 1 implies always[0s:2s](force < 20))"
        )
        needs = 'needs the parameter `q`, .*; pass q="x >= 1"$'
        with self.assertRaisesRegex(InvalidValueError, needs):
            mishandle.logs.pattern("hold-for", p="closed >= 1")


class TestMine(unittest.TestCase):
    def test_the_tightest_limit_is_that_of_the_worst_log(self):
        found = mishandle.mine("always(force <= limit)", {"limit": (0, 50)}, LOGS)
        self.assertEqual(
            (found.outcome, found.points[0].values, found.points[0].decisive),
            ("found", (7.5,), "log 1")
        )
        self.assertEqual([trace.value for trace in found.per_trace], [7.5, 5.0])
        self.assertIn("limit = 7.5", str(found))
        for settings, limit in [({"share": 0.5}, 5.0), ({"resolution": {"limit": 2}}, 8.0)]:
            found = mishandle.mine(
                "always(force <= limit)", {"limit": (0, 50)}, LOGS, plan={"formula": settings}
            )
            self.assertEqual(found.points[0].values, (limit,))

    def test_the_range_of_a_bound_has_a_unit(self):
        time = mishandle.mine("eventually[0:T](force >= 4)", {"T": (0, 1.5, "s")}, LOGS)
        self.assertEqual(time.points[0].formula, "eventually[0s:1s](force >= 4)")

    def test_no_value_is_mined_that_no_log_asks_for(self):
        log = {"held": [0.0, 0.0], "force": [9.0, 9.0]}
        found = mishandle.mine("always(held >= 1 implies force <= c)", {"c": (0, 50)}, log)
        self.assertEqual((found.outcome, found.points, found.per_trace), ("no-support", (), ()))

    def test_mistakes(self):
        for parameters, part in [
            ({"force": (0, 1)}, "reads no signal"), ({"c": (1, 0)}, "lower one first")
        ]:
            with self.assertRaisesRegex(InvalidValueError, part):
                mishandle.mine(
                    "always(force <= c)" if "c" in parameters else "always(force <= 1)", parameters,
                    LOGS
                )
        for settings, part in [
            ({"resolution": {"d": 1}}, "names `d`, which is no parameter"),
            ({"share": 2}, r'plan\["formula"\]\["share"\] is 2; it must be a number in \(0, 1\]'),
            ({"episode": 5}, r'\["episode"\] has no effect'),
        ]:
            with self.assertRaisesRegex(InvalidValueError, part):
                mishandle.mine(
                    "always(force <= c)", {"c": (0, 1)}, LOGS, plan={"formula": settings}
                )
        with self.assertRaisesRegex(InvalidValueError, "there is no log"):
            mishandle.mine("always(force <= c)", {"c": (0, 1)}, [])
