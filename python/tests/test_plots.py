"""Tests of the plots: what they draw, not how it looks."""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

os.environ["MPLBACKEND"] = "agg"

import matplotlib.pyplot as plt
import mishandle
import numpy as np
from mishandle import Axis, InvalidScenario

SPACE = [
    Axis("x", -1.0, 1.0, "m"),
    Axis("mass", 0.1, 10.0, "kg", values="logarithmic"),
    Axis("surface", values=["dry", "wet"]),
]


def system(scenario):
    if scenario["surface"] == "wet" and scenario["x"] > 0.5:
        raise InvalidScenario
    return {"d": np.full(4, scenario["x"])}


class Plots(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.path = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory())) / "run.sqlite"
        cls.found = mishandle.falsify(
            system, "always(d >= -0.8)", SPACE, search="random", trials=3, budget=15, seed=1,
            out=cls.path
        )
        cls.columns = mishandle.open_run(cls.path).columns()

    def tearDown(self):
        plt.close("all")

    def points(self, ax):
        return {
            collection.get_label(): collection.get_offsets().data for collection in ax.collections
        }

    def test_a_map_shows_each_simulation_once(self):
        ax = mishandle.plots.plot_robustness_map(self.found)
        values = self.columns["robustness"]
        points = self.points(ax)
        violated = [row for row, value in enumerate(values) if value is not None and value < 0]
        unknown = [row for row, value in enumerate(values) if value is None]
        self.assertTrue(violated and unknown)
        self.assertEqual(sum(map(len, points.values())), len(values))
        for label, rows in [("violation", violated), ("no verdict", unknown)]:
            expected = [[self.columns["x"][row], self.columns["mass"][row]] for row in rows]
            np.testing.assert_array_equal(points[label], expected)
        self.assertEqual(
            (ax.get_xlabel(), ax.get_ylabel(), ax.get_yscale()), ("x [m]", "mass [kg]", "log")
        )
        self.assertEqual(len(ax.figure.axes), 2, "a bar explains the colors")

    def test_a_map_of_chosen_axes_in_given_axes(self):
        _, given = plt.subplots()
        ax = mishandle.plots.plot_robustness_map(
            mishandle.open_run(self.path), x="surface", y="robustness", ax=given
        )
        self.assertIs(ax, given)
        self.assertEqual([label.get_text() for label in ax.get_xticklabels()], ["dry", "wet"])
        self.assertEqual(ax.get_ylabel(), "robustness")
        with self.assertRaisesRegex(ValueError, "no axis 'z'; its axes: x, mass, surface"):
            mishandle.plots.plot_robustness_map(self.path, x="z")

    def test_the_progress_of_each_trial_ends_at_its_minimum(self):
        ax = mishandle.plots.plot_search_progress(self.path)
        lines = [
            line for line in ax.lines if line.get_marker() == "None" and len(line.get_xdata()) > 0
        ][:3]
        by_trial = {trial.trial: trial for trial in self.found.trials}
        found = [line.get_ydata()[-1] for line in ax.lines if line.get_drawstyle() == "steps-post"]
        self.assertEqual(found, [by_trial[trial].minimum_robustness for trial in (1, 2, 3)])
        self.assertTrue(lines)
        self.assertIn(f"{self.found.falsified_trials} of 3 trials falsified", ax.get_title())

    def test_a_trace_has_its_thresholds_and_the_interval_of_violation(self):
        trace = {"x": np.array([0.0, 2.0, 3.0, 0.5, 0.0]), "y": np.zeros(5)}
        axes = mishandle.plots.plot_trace(
            trace, "always[2:4](x <= 1)", units={"x": "m"}, period=0.5
        )
        self.assertEqual([ax.get_ylabel() for ax in axes], ["x [m]", "robustness"])
        self.assertEqual(axes[-1].get_xlabel(), "time [s]")
        self.assertEqual(axes[0].lines[1].get_ydata(), [1.0, 1.0])
        [shade] = axes[0].patches
        # Sample 2 at 1 s; sample 1 is outside the window.
        self.assertEqual((shade.get_x(), shade.get_x() + shade.get_width()), (0.75, 1.25))
        self.assertEqual(axes[1].lines[0].get_ydata()[0], -2.0)
        [simulation] = mishandle.simulate(system, "always(d >= -0.8)", SPACE)
        self.assertEqual(len(mishandle.plots.plot_trace(simulation)), 1)
        with self.assertRaisesRegex(ValueError, "no signal z; it has x, y"):
            mishandle.plots.plot_trace(trace, signals=["z"])

    def test_a_cut_window_is_not_drawn_as_a_verdict(self):
        trace = {"x": np.array([0.0, 2.0, 0.5])}
        for formula, title, shades in [
            ("eventually[0:9](x >= 3)", "undecided", 0),
            ("always[0:9](x <= 3)", "undecided", 0),
            ("always[0:9](x <= 1)", "at most -1", 1),
            ("eventually[0:9](x >= 1)", "at least 1", 0),
            ("always[0:2](x <= 1)", "-1", 1),
        ]:
            axes = mishandle.plots.plot_trace(trace, formula)
            self.assertTrue(axes[0].get_title().endswith(f": {title}"), axes[0].get_title())
            self.assertEqual(len(axes[0].patches), shades, formula)
        # `always[0:2]` is decided at sample 0 only; the line of the cut windows starts there.
        solid, dotted = axes[1].lines[:2]
        self.assertEqual(
            (len(solid.get_xdata()), dotted.get_linestyle(), list(dotted.get_xdata())),
            (1, ":", [0, 1, 2])
        )

    def test_colors_near_zero_differ_from_the_background(self):
        from mishandle.plots import _colors

        for values in ([-1.0, 1.0], [0.0, 1.0], [-1.0, 0.0]):
            colors = _colors(np.array(values))
            for value in (-1e-9, 1e-9):
                red, green, blue, _ = colors["cmap"](colors["norm"](value))
                self.assertLess(min(red, green, blue), 0.85, (values, value))
        colors = _colors(np.array([-1.0, 1.0]))
        red, _, blue, _ = colors["cmap"](colors["norm"](-1e-9))
        self.assertGreater(red, blue)

    def test_the_package_works_without_matplotlib_until_a_plot_is_drawn(self):
        program = (
            "import sys; sys.modules['matplotlib'] = None\n"
            "import mishandle\n"
            "try:\n"
            "    mishandle.plots.plot_trace({'x': [1.0]})\n"
            "except ImportError as error:\n"
            "    print(error)\n"
        )
        found = subprocess.run(
            [sys.executable, "-c", program], check=True, capture_output=True, text=True
        )
        advice = "pip install '.[plots]' in a clone of Mishandle"
        self.assertEqual(found.stdout, f"plots need matplotlib: {advice}\n")
