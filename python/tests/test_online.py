"""Tests of online monitors: equality with the monitor of whole traces at every prefix, forms of a
sample, errors, reset."""

import unittest

import mishandle
import numpy as np
from mishandle import Formula, OnlineMonitor

BOUNDED = [
    "x <= 0.5",
    "always[0:3](x <= 0.5)",
    "eventually[2:5](x > 1 and y < 0)",
    "always[0:4](eventually[1:3](abs(x - y) >= 0.5))",
    "always[0:3](x <= 1 -> eventually[0:6](y >= 1))",
    "(x <= 1) until[1:4] (y >= 0.5)",
    "historically[0:2](x <= 1) or not(once[1:3](y > 1))",
    "eventually[0:5]((x <= 1) since (y >= 0))",
    "always[0:5](rise(x >= 0) -> eventually[0:2](y >= 0))",
]
UNBOUNDED = [
    "always(x <= 1)", "eventually(y >= 2)", "always(eventually[0:3](x >= 0))",
    "(x <= 2) until (y >= 1)"
]
INFINITY = float("inf")


def trace(seed, samples=25):
    return np.random.default_rng(seed).normal(size=(samples, 2))


def columns(rows):
    return {"x": rows[:, 0], "y": rows[:, 1]}


def answers(monitor):
    return monitor.bounds(), monitor.verdict(), monitor.decided(), len(monitor)


class Prefixes(unittest.TestCase):
    def test_bounds_and_decided_values_are_those_of_the_prefix(self):
        for seed in range(5):
            rows = trace(seed)
            for text in BOUNDED:
                formula, monitor = Formula(text), OnlineMonitor(text, ["x", "y"])
                for length, row in enumerate(rows, start=1):
                    monitor.push(row)
                    prefix = columns(rows[:length])
                    bounds = formula.robustness_bounds(prefix)
                    self.assertEqual(monitor.bounds(), bounds, (text, length))
                    certain = True if bounds[0] > 0 else False if bounds[1] < 0 else None
                    self.assertIs(monitor.verdict(), certain, (text, length))
                    signal = formula.robustness_signal(prefix, decided_only=True)
                    last = (len(signal) - 1, signal[-1]) if len(signal) > 0 else None
                    self.assertEqual(monitor.decided(), last, (text, length))

    def test_a_trace_of_known_length_ends_windows_without_an_end(self):
        for seed in range(5):
            rows = trace(seed)
            for text in UNBOUNDED:
                monitor = OnlineMonitor(text, ["x", "y"], samples=len(rows))
                monitor.push_many(rows)
                self.assertEqual(
                    monitor.bounds(), Formula(text).robustness_bounds(columns(rows)), text
                )

    def test_a_trace_of_unknown_length_leaves_the_future_open(self):
        monitor = OnlineMonitor(["always(x <= 1)", "eventually(x >= 3)"])
        monitor.push_many([0.5, 0.0])
        self.assertEqual(
            [monitor.bounds(0), monitor.bounds(1)], [(-INFINITY, 0.5), (-2.5, INFINITY)]
        )
        self.assertEqual([monitor.verdict(0), monitor.verdict(1)], [None, None])
        monitor.push_many([4.0])
        self.assertEqual([monitor.verdict(0), monitor.verdict(1)], [False, True])

    def test_formulas_together_are_as_alone(self):
        rows = trace(9)
        together = OnlineMonitor(BOUNDED + UNBOUNDED, ["x", "y"])
        alone = [OnlineMonitor(text, ["x", "y"]) for text in BOUNDED + UNBOUNDED]
        for row in rows:
            together.push(row)
            for index, monitor in enumerate(alone):
                monitor.push(row)
                found = (
                    together.bounds(index), together.verdict(index), together.decided(index),
                    len(together)
                )
                self.assertEqual(found, answers(monitor))

    def test_bounds_with_units_use_the_period(self):
        monitor = OnlineMonitor("eventually[0:0.2s](x >= 4)", period=0.1)
        monitor.push_many([0.0, 1.0])
        self.assertIsNone(monitor.verdict())
        monitor.push(2.0)
        self.assertEqual((monitor.bounds(), monitor.verdict()), ((-2.0, -2.0), False))
        with self.assertRaises(ValueError):
            OnlineMonitor("eventually[0:0.2s](x >= 4)")


class Samples(unittest.TestCase):
    text = "always[0:3](x <= 1 and eventually[0:2](y >= 0))"

    def test_every_form_of_a_sample_gives_the_same(self):
        rows = trace(3)
        forms = {
            "tuple": lambda row: (row[0], row[1]),
            "list": list,
            "list of Python": lambda row: row.tolist(),
            "array": lambda row: row,
            "array with a stride": lambda row: np.repeat(row, 2)[::2],
            "dictionary": lambda row: {"y": row[1], "x": row[0], "unused": 7.0},
            "generator": lambda row: (value for value in row),
        }
        for name, form in forms.items():
            expected, found = OnlineMonitor(self.text), OnlineMonitor(self.text)
            for length, row in enumerate(rows, start=1):
                expected.push_many(rows[length - 1 : length])
                found.push(form(row))
                self.assertEqual(answers(found), answers(expected), name)
        whole = OnlineMonitor(self.text)
        whole.push_many(rows)
        self.assertEqual(answers(whole), answers(expected))

    def test_one_signal_takes_numbers(self):
        for value in [
            3, 3.0, np.float64(3.0), np.float32(3.0), np.int64(3), np.array(3.0), (3,), [3.0],
            {"x": 3}
        ]:
            monitor = OnlineMonitor("x <= 1")
            monitor.push(value)
            self.assertEqual(monitor.decided(), (0, -2.0), repr(value))

    def test_signals_state_the_order(self):
        self.assertEqual(OnlineMonitor(["y >= 0", "x <= 1 or y > 2"]).signals, ["y", "x"])
        monitor = OnlineMonitor("x <= 1", ["unused", "x"])
        monitor.push((9.0, 0.25))
        self.assertEqual(monitor.decided(), (0, 0.75))


class Errors(unittest.TestCase):
    def test_a_wrong_sample_changes_nothing(self):
        wrong = [
            ((), ValueError, "2 values"),
            ((0.0,), ValueError, "2 values"),
            ([0.0, 1.0, 2.0], ValueError, "2 values"),
            (np.zeros(3), ValueError, "2 values"),
            (0.0, ValueError, "2 values"),
            ({"x": 0.0}, ValueError, "lacks the signal y"),
            ({"x": 0.0, "z": 0.0}, ValueError, "lacks the signal y"),
            ((float("nan"), 0.0), ValueError, "x"),
            ([0.0, INFINITY], ValueError, "y"),
            (np.array([0.0, -INFINITY]), ValueError, "y"),
            ({"x": 0.0, "y": float("nan")}, ValueError, "y"),
            (("0", 0.0), TypeError, "no number"),
            ((None, 0.0), TypeError, "no number"),
            ({"x": 0.0, "y": "1"}, TypeError, "no number"),
            (None, TypeError, "numbers"),
        ]
        rows = trace(4)
        text = "always[0:3](x <= 1 and eventually[0:2](y >= 0))"
        expected, found = OnlineMonitor(text), OnlineMonitor(text)
        for index, row in enumerate(rows):
            sample, error, pattern = wrong[index % len(wrong)]
            with self.assertRaisesRegex(error, pattern, msg=repr(sample)) as caught:
                found.push(sample)
            self.assertIsInstance(caught.exception, mishandle.MishandleError)
            self.assertEqual(answers(found), answers(expected), repr(sample))
            expected.push(row)
            found.push(row)
            self.assertEqual(answers(found), answers(expected), repr(sample))

    def test_rows_before_a_wrong_one_are_added(self):
        monitor = OnlineMonitor("always[0:3](x <= 1)")
        with self.assertRaisesRegex(ValueError, "x"):
            monitor.push_many([0.0, 0.5, float("nan"), 2.0])
        self.assertEqual((len(monitor), monitor.bounds()), (2, (-INFINITY, 0.5)))

    def test_rows_of_another_length_are_errors(self):
        monitor = OnlineMonitor("x <= 1 and y >= 0")
        for rows in [np.zeros((4, 3)), np.zeros((4, 1))]:
            with self.assertRaisesRegex(ValueError, "2 values"):
                monitor.push_many(rows)
        for rows in [np.zeros(4), np.zeros((4, 2, 1))]:
            with self.assertRaises((TypeError, ValueError)):
                monitor.push_many(rows)
        self.assertEqual(len(monitor), 0)

    def test_names_and_indices(self):
        with self.assertRaisesRegex(ValueError, "same name"):
            OnlineMonitor("x <= 1", ["x", "x"])
        with self.assertRaisesRegex(TypeError, "sequence of names"):
            OnlineMonitor("x <= 1", "x")
        with self.assertRaisesRegex(ValueError, "y"):
            OnlineMonitor("x <= 1 and y >= 0", ["x"])
        with self.assertRaises(ValueError):
            OnlineMonitor("x <=")
        monitor = OnlineMonitor(["x <= 1", "x >= 0"])
        for question in [monitor.bounds, monitor.verdict, monitor.decided]:
            with self.assertRaisesRegex(ValueError, "2 formulas"):
                question(2)


class Reset(unittest.TestCase):
    def test_a_monitor_that_was_reset_is_as_a_new_one(self):
        rows = trace(6)
        for text in BOUNDED + UNBOUNDED:
            new, used = OnlineMonitor(text, ["x", "y"]), OnlineMonitor(text, ["x", "y"])
            used.push_many(rows[::-1])
            used.reset()
            self.assertEqual(answers(used), answers(new), text)
            for row in rows:
                new.push(row)
                used.push(row)
                self.assertEqual(answers(used), answers(new), text)
