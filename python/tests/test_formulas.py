"""Tests of formulas on traces: sub-formula signals, thresholds, samples of a violation, data
frames."""

import unittest

import mishandle
import numpy as np
from mishandle import Formula


def window(values, begin, end, reduce, empty):
    """Returns the reduction over [t + begin, t + end] of each sample t, cut at the end of the
    trace."""
    ranges = [values[t + begin : None if end is None else t + end + 1] for t in range(len(values))]
    return np.array([reduce(part) if len(part) > 0 else empty for part in ranges])


class SubformulaSignals(unittest.TestCase):
    def test_each_signal_agrees_with_a_calculation_by_hand(self):
        generator = np.random.default_rng(3)
        x, y = generator.normal(size=(2, 40))
        text = "always[0:3](x <= 1 and eventually[1:2](abs(y - x) >= 0.5)) or not(y > 2)"
        found = Formula(text).subformula_signals({"x": x, "y": y})
        small, far = 1 - x, abs(y - x) - 0.5
        soon = window(far, 1, 2, np.max, -np.inf)
        both = np.minimum(small, soon)
        held = window(both, 0, 3, np.min, np.inf)
        expected = {
            text: np.maximum(held, 2 - y),
            "always[0:3](x <= 1 and eventually[1:2](abs(y - x) >= 0.5))": held,
            "x <= 1 and eventually[1:2](abs(y - x) >= 0.5)": both,
            "x <= 1": small,
            "eventually[1:2](abs(y - x) >= 0.5)": soon,
            "abs(y - x) >= 0.5": far,
            "not(y > 2)": 2 - y,
            "y > 2": y - 2,
        }
        self.assertEqual(list(found), list(expected))
        for signal, values in zip(found.values(), expected.values()):
            np.testing.assert_array_equal(signal, values)

    def test_bounds_with_units_use_the_period(self):
        x = np.array([0.0, 1.0, 5.0, 2.0])
        found = Formula("eventually[0:0.2s](x >= 4)").subformula_signals({"x": x}, period=0.1)
        self.assertEqual(
            [signal.tolist() for signal in found.values()],
            [[1.0, 1.0, 1.0, -2.0], [-4.0, -3.0, 1.0, -2.0]]
        )
        with self.assertRaisesRegex(ValueError, "0.2"):
            Formula("eventually[0:0.2s](x >= 4)").subformula_signals({"x": x}, period=0.15)


class Violation(unittest.TestCase):
    def check(self, formula, expected, **signals):
        found = np.flatnonzero(Formula(formula).violation(signals)).tolist()
        self.assertEqual(found, expected, formula)

    def test_samples_inside_the_windows(self):
        x = [3, 0, 2, 0, 3, 3]
        self.check("always(x <= 1)", [0, 2, 4, 5], x=x)
        self.check("always[1:4](x <= 1)", [2, 4], x=x)
        self.check("always[1:1](x <= 1)", [], x=x)
        self.check("eventually[1:3](x >= 3)", [1, 2, 3], x=x)
        self.check("x <= 1", [0], x=x)
        self.check("not eventually[2:4](x > 2)", [4], x=x)
        self.check("always[0:1](eventually[0:2](x > 2.5))", [1, 2, 3], x=x)
        # The second conjunct holds, and so does the left side of the implication at sample 4.
        self.check("always[4:4](x <= 1) and eventually(x >= 2)", [4], x=x)
        self.check("always(x > 2 implies y > 0.5)", [4], x=x, y=[1, 0, 0, 0, 0, 1])
        # At sample 5, neither x <= 2 holds there nor x <= 0 at samples 3 and 4. At sample 0, the
        # second window is empty.
        self.check("always[0:5](once[1:2](x <= 0) or x <= 2)", [0, 3, 4, 5], x=[3, 0, 2, 3, 1, 3])
        # Operators that are not looked into.
        self.check(
            "always[2:5](x > 0.5 since y > 0.5)", [3], x=[1, 1, 1, 0, 1, 1], y=[0, 1, 0, 0, 1, 0]
        )

    def test_every_sample_of_a_violation_of_always_matters_and_no_other(self):
        generator = np.random.default_rng(0)
        formula = Formula("always[3:20](x <= 1 and y >= -1)")
        for _ in range(20):
            trace = dict(zip("xy", generator.normal(size=(2, 30))))
            mask = formula.violation(trace)
            self.assertEqual(mask.any(), formula.robustness(trace) < 0)
            repaired = {name: np.where(mask, 0.0, values) for name, values in trace.items()}
            self.assertGreaterEqual(formula.robustness(repaired), 0.0)

    def test_thresholds_are_comparisons_with_numbers(self):
        formula = Formula(
            "always[0:2s](-0.5 <= x and abs(y) < 2 and z >= x and 2 * x <= 3) or abs(w + 1.5) > 1 "
            "or v"
        )
        self.assertEqual(
            formula.thresholds(period=0.5),
            [("x", -0.5), ("y", -2.0), ("y", 2.0), ("w", -2.5), ("w", -0.5)]
        )
        found = Formula("always(`/arm/q[0]` <= 3 and abs(`load/diff1` - 1) < 2)").thresholds()
        self.assertEqual(found, [("/arm/q[0]", 3.0), ("load/diff1", -1.0), ("load/diff1", 3.0)])


class DataFrames(unittest.TestCase):
    def test_pandas_and_polars_give_the_robustness_of_a_dictionary(self):
        columns = {
            "label": ["a", "b", "c"], "x": [0.0, 2.0, 5.0], "flag": [True, False, True],
            "n": [1, 2, 3]
        }
        formula = Formula("always(x <= 4 and n <= 2) or flag >= 1")
        expected = formula.robustness_signal({name: columns[name] for name in formula.signals})
        self.assertEqual(expected.tolist(), [0.0, -1.0, 0.0])
        for library in ["pandas", "polars"]:
            frame = __import__(library).DataFrame(columns)
            np.testing.assert_array_equal(formula.robustness_signal(frame), expected)
            self.assertEqual(mishandle.robustness("eventually(x >= 6)", frame), -1.0)
            lacks = "lacks the signals y; it has label, x, flag, n"
            with self.assertRaisesRegex(ValueError, lacks):
                mishandle.robustness("y <= 1", frame)
            with self.assertRaisesRegex(ValueError, "`label` is not an array of numbers"):
                mishandle.robustness("label <= 1", frame)
            texts = __import__(library).DataFrame({**columns, "time": ["0 s", "1 s", "2 s"]})
            with self.assertRaisesRegex(ValueError, "`time` is `0 s`; a time must be a number"):
                mishandle.robustness("eventually(x >= 6)", texts)

    def test_a_simulation_is_a_trace(self):
        system = lambda scenario: {"x": [0.0, scenario["x"]]}
        [found] = mishandle.simulate(system, "always(x <= 3)", [mishandle.Axis("x", 0, 4)])
        self.assertEqual(mishandle.Formula("always(x <= 3)").robustness(found), 1.0)
        self.assertEqual(mishandle.Formula("x <= 1").violation(found).tolist(), [False, False])

    def test_bounds_in_seconds_need_the_period(self):
        log = {"t": [0.0, 0.5, 1.0], "x": [0.0, 3.0, 5.0]}
        formula = mishandle.Formula("always[0:500ms](x <= 4)")
        for call in (formula.robustness_signal, formula.subformula_signals, formula.violation):
            with self.assertRaisesRegex(ValueError, "pass the time between two samples as period"):
                call(log)
        with self.assertRaisesRegex(
            ValueError, r'needs the time between two samples.*pass plan=.*"period": SECONDS'
        ):
            formula.robustness(log)
        for reading in ({"time": "t"}, {"period": 0.5}):
            self.assertEqual(formula.robustness(log, plan={"log": reading}), 1.0)
        for plan in ({"log": {"unit": "s"}}, {"monitor": {"values": True}}):
            with self.assertRaisesRegex(ValueError, "has no effect on this question"):
                formula.robustness(log, plan=plan)

    def test_a_name_in_backquotes_that_looks_like_a_bound_has_no_time(self):
        log = {"d[0 s]": [1.0, 3.0]}
        self.assertEqual(mishandle.robustness("always[0:1](`d[0 s]` <= 2)", log), -1.0)
        with self.assertRaisesRegex(ValueError, '"period": SECONDS'):
            mishandle.robustness("always[0:1s](`d[0 s]` <= 2)", log)
        self.assertEqual(mishandle.robustness("always[0s:inf](`d[0 s]` <= 2)", log), -1.0)

    def test_a_sample_without_a_known_time_is_named_by_its_number(self):
        with self.assertRaisesRegex(mishandle.MishandleError, "`d` is NaN at step 1; every sample"):
            mishandle.Formula("always(d <= 2)").robustness_signal({"d": [1.0, float("nan")]})
        with self.assertRaisesRegex(mishandle.MishandleError, "row 2: `d` has no number"):
            mishandle.robustness("always(d <= 2)", {"d": [1.0, float("nan")]})

    def test_missing_values_are_errors(self):
        for library in ["pandas", "polars"]:
            frame = __import__(library).DataFrame({"x": [0.0, None, 1.0]})
            with self.assertRaisesRegex(mishandle.MishandleError, "has no number"):
                mishandle.robustness("always(x <= 4)", frame)


class Names(unittest.TestCase):
    def test_a_hint_spells_the_name_of_the_column(self):
        with self.assertRaisesRegex(
            ValueError, "lacks the signals load, diff1; .*to read the signal `load/diff1`, write"
        ):
            mishandle.robustness("always(load/diff1 <= 2)", {"load/diff1": [1.0]})
        with self.assertRaisesRegex(ValueError, "did you mean `speed`"):
            mishandle.robustness("always(sped <= 2)", {"speed": [1.0]})
        with self.assertRaisesRegex(ValueError, "written in backquotes"):
            Formula("always(/arm/q <= 2)")

    def test_each_question_refuses_letters_of_columns_and_formulas_without_signals(self):
        log = {"p": [1.0, 2.0], "X": [0.0, 0.0]}
        refusals = {"X(p >= 0)": "backquotes for the signal: `X`", "always(1 <= 2)": "no signal"}
        for text, part in refusals.items():
            for ask in [
                lambda text: mishandle.robustness(text, log),
                lambda text: mishandle.monitor(text, log),
                lambda text: Formula(text).robustness_signal(log),
                lambda text: mishandle.formula(text, log),
                lambda text: mishandle.OnlineMonitor(text, ["p", "X"])
            ]:
                with self.assertRaisesRegex(ValueError, part):
                    ask(text)

    def test_messages_show_no_invisible_characters(self):
        with self.assertRaisesRegex(ValueError, r"it has a\\u202eb\\n, größe$"):
            mishandle.robustness("always(zz <= 2)", {"a\u202eb\n": [1.0], "größe": [1.0]})

    def test_only_columns_that_are_read_need_a_name_of_their_own(self):
        frame = __import__("pandas").DataFrame(
            [[1.0, 2.0, 9.0], [3.0, 4.0, 9.0]], columns=["a", "b", "b"]
        )
        self.assertEqual(mishandle.robustness("always(a <= 2)", frame), -1.0)
        with self.assertRaisesRegex(ValueError, "several columns of the same name: b"):
            mishandle.robustness("always(b <= 2)", frame)
        with self.assertRaisesRegex(ValueError, "several columns of the same name: 1"):
            mishandle.robustness("always(`1` <= 2)", {1: [0.0], "1": [5.0]})


class Statements(unittest.TestCase):
    def test_a_definition_without_use_is_a_warning(self):
        with self.assertWarnsRegex(UserWarning, "no statement reads the definition `low`"):
            Formula("low = speed <= 1\nd <= 2")


class Minima(unittest.TestCase):
    def test_a_function_that_is_nan_is_named_as_such(self):
        with self.assertRaisesRegex(ValueError, r"^the function is NaN at \[.*\]; return inf"):
            mishandle.ask.find_minimum(lambda x: float("nan"), [(0, 1)], budget=5)
