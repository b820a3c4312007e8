"""Tests of online monitors: bounds, forms of a sample, errors."""

import collections
import dataclasses
import unittest

import mishandle
import numpy as np
import pandas
import polars
import pyarrow
from mishandle import Formula, OnlineMonitor

INFINITY = float("inf")


def trace(seed, samples=25):
    return np.random.default_rng(seed).normal(size=(samples, 2))


def columns(rows):
    return {"x": rows[:, 0], "y": rows[:, 1]}


def answers(monitor):
    return monitor.bounds(), monitor.verdict(), monitor.decided(), len(monitor)


class Bounds(unittest.TestCase):
    def test_a_monitor_and_a_formula_have_the_same_bounds_also_after_a_reset(self):
        rows, text = trace(0), "always[0:3](x <= 1 -> eventually[0:6](y >= 1))"
        monitor = OnlineMonitor(text, ["x", "y"])
        for _ in range(2):
            monitor.reset()
            for length, row in enumerate(rows, start=1):
                monitor.push(row)
                expected = Formula(text).robustness_bounds(columns(rows[:length]))
                self.assertEqual((monitor.bounds(), len(monitor)), (expected, length))

    def test_a_window_without_an_end_is_that_of_a_trace_of_known_length(self):
        rows = trace(0)
        for text in ["always(eventually[0:3](x >= 0))", "(x <= 2) until (y >= 1)"]:
            monitor = OnlineMonitor(text, ["x", "y"], samples=len(rows))
            monitor.push_many(rows)
            self.assertEqual(monitor.bounds(), Formula(text).robustness_bounds(columns(rows)), text)


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

    def test_names_count_before_places(self):
        # x violates x <= 1 where y is read in its place.
        Row = collections.namedtuple("Row", "y x unused")
        Sample = dataclasses.make_dataclass("Sample", ["y", "x", "unused"])
        frame = pandas.DataFrame({"y": [5.0, 6.0], "x": [0.25, 0.5], "unused": [9.0, 9.0]})
        record = np.array([(5.0, 0.25, 9.0)], [(name, float) for name in frame.columns])
        forms = {
            "named tuple": Row(5.0, 0.25, 9.0),
            "data class": Sample(5.0, 0.25, 9.0),
            "Series": frame.iloc[0],
            "record": record[0],
            "record array": record.view(np.recarray)[0],
            "dictionary": {"y": 5.0, "x": 0.25},
            "other mapping": collections.ChainMap({"y": 5.0}, {"x": 0.25}),
        }
        for name, sample in forms.items():
            monitor = OnlineMonitor("x <= 1 and y >= 4.5", ["x", "y"])
            monitor.push(sample)
            self.assertEqual(monitor.decided(), (0, 0.5), name)
        many = {
            "data frame": frame,
            "data frame of polars": polars.from_pandas(frame),
            "table of pyarrow": pyarrow.Table.from_pandas(frame),
            "dictionary": frame.to_dict("list"),
            "structured array": frame.to_records(index=False),
            "named tuple of columns": Row([5.0, 6.0], [0.25, 0.5], [9.0, 9.0]),
            "list of named tuples": [Row(5.0, 0.25, 9.0), Row(6.0, 0.5, 9.0)],
            "list of dictionaries": frame.to_dict("records"),
            "list of Series": [frame.iloc[0], frame.iloc[1]],
        }
        for name, samples in many.items():
            monitor = OnlineMonitor("always(x <= 1 and y >= 4.5)", ["x", "y"])
            monitor.push_many(samples)
            self.assertEqual((len(monitor), monitor.bounds()), (2, (-INFINITY, 0.5)), name)
        # Labels that are places are no names.
        monitor = OnlineMonitor("x <= 1 and y >= 4.5", ["x", "y"])
        monitor.push(pandas.Series([0.25, 5.0]))
        self.assertEqual(monitor.decided(), (0, 0.5))
        monitor = OnlineMonitor("always(x <= 1)")
        monitor.push_many(frame["x"])
        self.assertEqual(len(monitor), 2)

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
            (collections.namedtuple("Row", "x z")(0.0, 0.0), ValueError, "lacks the signal y"),
            (pandas.Series([0.0, 0.0], ["x", "x"]), ValueError, "several values of the signal x"),
            ({0.0, 1.0}, TypeError, "got a set"),
            ({"x": 0.0, "y": 0.0}.values(), TypeError, "got a dict_values"),
            ("ab", TypeError, "got a str"),
            (np.zeros((1, 2)), TypeError, "push_many takes several samples"),
            (pandas.DataFrame({"x": [0.0], "y": [0.0]}), TypeError, "push_many takes them"),
            (np.ma.masked_equal([0.0, -9.0], -9.0), ValueError, "masked"),
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

    def test_columns_that_are_missing_or_of_another_signal_are_errors(self):
        frame = pandas.DataFrame({"x": [0.0], "z": [0.0]})
        for samples, text in [
            (frame, "lacks the signals y"), (frame.to_records(index=False), "lacks the signals y"),
            ({"x": [0.0], "y": ["a"]}, "`y` is not an array of numbers")
        ]:
            with self.assertRaisesRegex(ValueError, text):
                OnlineMonitor("x <= 1 and y >= 0").push_many(samples)
        with self.assertRaisesRegex(ValueError, "of the column `z`; the monitor reads x"):
            OnlineMonitor("x <= 1").push_many(frame["z"])
        for samples in [{0.0, 1.0}, (x for x in [0.0]), 3.0, None]:
            with self.assertRaisesRegex(TypeError, "samples must be an array"):
                OnlineMonitor("x <= 1").push_many(samples)

    def test_masked_values_are_refused_and_data_without_a_mask_are_read(self):
        masked = np.ma.masked_equal([0.0, -9.0], -9.0)
        monitor = OnlineMonitor("always(x <= 1)")
        for samples in [masked, [masked[1]], {"x": masked}]:
            with self.assertRaises(ValueError, msg=repr(samples)):
                monitor.push_many(samples)
        monitor.push_many(np.ma.array([0.0, 0.5]))
        monitor.push(np.ma.array([0.75]))
        self.assertEqual(monitor.bounds(), (-INFINITY, 0.25))

    def test_rows_of_another_length_are_errors(self):
        monitor = OnlineMonitor("x <= 1 and y >= 0")
        for rows in [np.zeros((4, 3)), np.zeros((4, 1))]:
            with self.assertRaisesRegex(ValueError, "2 values"):
                monitor.push_many(rows)
        for rows in [np.zeros(4), np.zeros((4, 2, 1))]:
            with self.assertRaises((TypeError, ValueError)):
                monitor.push_many(rows)
        self.assertEqual(len(monitor), 0)

    def test_a_formula_without_a_signal_is_refused(self):
        with self.assertRaisesRegex(ValueError, "reads no signal"):
            OnlineMonitor("always(1 <= 2)", ["x"])

    def test_names_and_indices(self):
        with self.assertRaisesRegex(ValueError, "same name"):
            OnlineMonitor("x <= 1", ["x", "x"])
        with self.assertRaisesRegex(TypeError, "sequence of names"):
            OnlineMonitor("x <= 1", "x")
        with self.assertRaisesRegex(ValueError, "y"):
            OnlineMonitor("x <= 1 and y >= 0", ["x"])
        with self.assertRaises(ValueError):
            OnlineMonitor("x <=")
        with self.assertRaises(ValueError):
            OnlineMonitor("eventually[0:0.2s](x >= 4)")
        monitor = OnlineMonitor(["x <= 1", "x >= 0"])
        for question in [monitor.bounds, monitor.verdict, monitor.decided]:
            with self.assertRaisesRegex(ValueError, "2 formulas"):
                question(2)
