"""Explanations, failure modes, reports and comparisons of runs."""

import pickle

from cases import FolderCase
import mishandle
from mishandle.errors import InvalidValueError
import numpy as np

TIME = np.arange(101) * 0.1


def oscillator(scenario):
    """A damped oscillation in closed form: x(t) = a exp(-d t) cos(t), and a speed limit that only
    large amplitudes break."""
    decay = np.exp(-scenario["damping"] * TIME)
    x = scenario["amplitude"] * decay * np.cos(TIME)
    return {"x": x, "energy": (scenario["amplitude"] * decay) ** 2}


SPACE = [mishandle.Axis("amplitude", 0.5, 2.0, "m"), mishandle.Axis("damping", 0.05, 1.0, "1/s")]
FORMULA = "always[0:100](x >= -0.8 and energy <= 9)"


class Explanations(FolderCase):
    def falsify(self) -> mishandle.ask.Falsification:
        return mishandle.falsify(
            oscillator, FORMULA, SPACE, control_dt=0.1, trials=4, budget=60, seed=1,
            out=self.folder / "run.sqlite"
        )

    def test_the_explanation_names_the_sample_of_the_minimum(self) -> None:
        result = self.falsify()
        self.assertGreater(result.falsified_trials, 0)
        found = result.explain()
        worst = result.counterexamples[0]
        trace = oscillator(worst.scenario)
        # By hand: the energy is at most 4, so the minimum of x + 0.8 decides.
        sample = int(np.argmin(trace["x"]))
        self.assertEqual(found.robustness, worst.minimum_robustness)
        self.assertEqual((found.predicate.formula, found.predicate.sample), ("x >= -0.8", sample))
        self.assertAlmostEqual(found.predicate.time, TIME[sample])
        self.assertEqual(found.predicate.values, (trace["x"][sample], -0.8))
        self.assertEqual(found.window.violated, int(np.sum(trace["x"] < -0.8)))
        self.assertEqual(
            {part.formula: part.robustness for part in found.conjuncts}["energy <= 9"],
            9 - max(trace["energy"])
        )
        self.assertIn("x >= -0.8", str(found))
        with self.assertRaisesRegex(InvalidValueError, "trial 9"):
            result.explain(9)

    def test_an_axis_back_at_nominal_removes_the_failure_or_not(self) -> None:
        space = [mishandle.Axis("a", 0, 1, nominal=0), mishandle.Axis("b", 0, 1, nominal=0)]
        system = lambda scenario: {"x": [scenario["a"]] * 3, "y": [scenario["b"]] * 3}
        out = self.folder / "run.sqlite"
        result = mishandle.falsify(
            system, "always(x <= 0.5) and always(y <= 2)", space, trials=1, budget=30, seed=1,
            out=out
        )
        found = result.explain()
        at_nominal = found.axes_at_nominal
        assert at_nominal is not None
        # Only `a` can break the formula, and nothing simulates this system again.
        for each in at_nominal.axes:
            self.assertEqual((each.nominal, each.violated), (0.0, each.axis == "b"))
        self.assertEqual(at_nominal.reason is None, len(at_nominal.axes) == 2)
        removing = [each.axis for each in at_nominal.axes if each.axis == "a"]
        self.assertEqual(
            "Axes that remove the failure alone, back at nominal: a." in str(found),
            removing == ["a"]
        )
        self.assertIsNone(result.explain(plan={"report": {"axes": 0}}).axes_at_nominal)
        with self.assertRaisesRegex(InvalidValueError, r'plan\["report"\]\["axes"\] is -1'):
            result.explain(plan={"report": {"axes": -1}})

    def test_the_region_of_a_mode_has_the_names_of_categories(self) -> None:
        space = [
            mishandle.Axis("surface", values=["dry", "wet", "ice"]),
            mishandle.Axis("gear", 1, 5, values="integer", nominal=1)
        ]
        grip = {"dry": 1.0, "wet": 0.8, "ice": 0.2}
        system = lambda scenario: {"grip": [grip[scenario["surface"]]] * 2}
        out = self.folder / "grip.sqlite"
        mishandle.falsify(
            system, "always(grip >= 0.5)", space, search="random", trials=5, budget=50, out=out
        )
        [mode] = mishandle.open_run(out).failure_modes()
        self.assertEqual(mode.region["surface"], ("ice", "ice"))
        self.assertTrue(all(isinstance(gear, int) for gear in mode.region["gear"]))

    def test_failures_are_grouped_and_reported(self) -> None:
        result = self.falsify()
        modes = mishandle.open_run(result.path).failure_modes()
        self.assertEqual(sum(mode.failures for mode in modes), len(result.counterexamples))
        failures = [(trial.trial, trial.simulation) for trial in result.counterexamples]
        for mode in modes:
            self.assertIn((mode.trial, mode.simulation), failures)
            self.assertEqual(mode.predicate, "x >= -0.8")
            self.assertEqual(set(mode.region), {"amplitude", "damping"})
        result.report(self.folder / "report.html")
        page = (self.folder / "report.html").read_text()
        self.assertIn("x &gt;= -0.8", page)
        # The result knows its system, so the page has the size of the failing patch and the
        # corners.
        self.assertIn("random scenarios in a box around these failures", page)
        self.assertIn("corners of the initial box", page)
        # A function in Python cannot be simulated from the file alone, and the page says so.
        mishandle.open_run(result.path).report(self.folder / "file.html")
        self.assertIn("they take simulations", (self.folder / "file.html").read_text())
        # With the system, the file is enough for the page of the result.
        run = mishandle.open_run(result.path)
        run.report(self.folder / "again.html", oscillator, FORMULA, SPACE, control_dt=0.1)
        self.assertEqual((self.folder / "again.html").read_text(), page)
        copied = pickle.loads(pickle.dumps(result))
        self.assertEqual(copied, result)
        copied.report(self.folder / "copied.html")
        self.assertIn("they take simulations", (self.folder / "copied.html").read_text())

    def test_exported_counterexamples_are_a_regression_suite(self) -> None:
        result = self.falsify()
        exports = result.export(self.folder / "suite")
        self.assertEqual(len(exports.paths), len(mishandle.open_run(result.path).failure_modes()))
        arguments = {"control_dt": 0.1, "name": "oscillator"}
        found = mishandle.regress(self.folder / "suite", oscillator, FORMULA, SPACE, **arguments)
        self.assertEqual((found.fails, found.passes, found.errors), (len(exports.files), 0, 0))
        for test, exported in zip(found.tests, exports.files):
            self.assertEqual((test.robustness, test.same_target), (test.recorded_robustness, True))
            self.assertEqual(test.robustness, min(oscillator(exported.scenario)["x"]) + 0.8)
            self.assertIn("x >= -0.8", test.reason)

        def damped(scenario):
            return oscillator({**scenario, "amplitude": 0.1 * scenario["amplitude"]})

        found = mishandle.regress(self.folder / "suite", damped, FORMULA, SPACE, **arguments)
        self.assertEqual((found.passes, found.fails), (len(exports.files), 0))
        with self.assertRaises(mishandle.MishandleError):
            mishandle.regress(self.folder / "nothing", oscillator, FORMULA, SPACE, **arguments)

    def test_two_evaluations_are_compared_pair_by_pair(self) -> None:
        def worse(scenario):
            return oscillator({**scenario, "damping": 0.5 * scenario["damping"]})

        paths = [self.folder / "a.sqlite", self.folder / "b.sqlite"]
        for system, path in zip((oscillator, worse), paths):
            mishandle.evaluate(
                system, FORMULA, SPACE, control_dt=0.1, episodes=80, seed=3, out=path,
                name="oscillator"
            )
        found = mishandle.compare(*paths)
        self.assertGreater(len(found.new_failures), 0)
        pair = found.new_failures[0]
        self.assertEqual(min(oscillator(pair.scenario)["x"]) + 0.8, pair.first_robustness)
        difference = mishandle.runs.diff(*paths)
        self.assertEqual(
            difference.simulations.changed, len(found.new_failures) + len(found.fixed_failures)
        )
        self.assertTrue(mishandle.runs.diff(paths[0], paths[0]).same_records)
        found.report(self.folder / "compare.html")
        page = (self.folder / "compare.html").read_text()
        self.assertIn(f"New failures: A succeeds, B fails ({len(found.new_failures)})", page)
        # The replay of a Python system needs its code.
        self.assertIn("system, formula, space, trial=1", page)
        with self.assertRaises(mishandle.MishandleError):
            mishandle.compare(paths[0], self.falsify().path)
