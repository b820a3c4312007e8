"""Mistakes in arguments are errors instead of silent defaults."""

import pathlib
import subprocess
import sys
import tempfile
import time
import unittest
import warnings
from xml.etree import ElementTree

from cases import FolderCase
import gymnasium
import mishandle
import numpy as np
import pandas
from mishandle import Axis

SPACE = [Axis("speed", 0, 10, "m/s")]


def braking(scenario):
    return {"gap": [10.0, 10.0 - scenario["speed"]]}


class Arguments(unittest.TestCase):
    def setUp(self):
        self.out = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory())) / "run.sqlite"

    def falsify(self, system=braking, formula="always(gap >= 1)", space=SPACE, **options):
        settings = {"search": "random", "trials": 1, "budget": 3, "out": self.out}
        return mishandle.falsify(system, formula, space, **{**settings, **options})

    def test_an_unknown_argument_is_an_error_with_the_nearest_name(self):
        for name, near in [
            ("time_limits", "time_limit"), ("terminaton", "termination"), ("period", "control_dt")
        ]:
            with self.assertRaisesRegex(TypeError, f"no argument `{name}`; did you mean `{near}`"):
                self.falsify(**{name: 1})
        for function in (mishandle.simulate, mishandle.evaluate):
            with self.assertRaisesRegex(TypeError, "no argument `foo`"):
                function(braking, "always(gap >= 1)", SPACE, foo=1)

    def test_an_argument_without_effect_is_an_error(self):
        for options in ({"policy": lambda x: x}, {"signals": {"x": "obs[0]"}}, {"guard": "g"}):
            with self.assertRaisesRegex(TypeError, "has no effect on a function"):
                self.falsify(**options)
        with self.assertRaisesRegex(TypeError, "`signals` has no effect on a target"):
            mishandle.simulate("point-reaching", policy="ppo", signals={"x": "obs[0]"})

    def test_bounds_in_seconds_need_a_known_control_step(self):
        with self.assertRaisesRegex(ValueError, "pass it as control_dt"):
            self.falsify(formula="always[0:1s](gap >= 1)")
        self.assertGreater(
            self.falsify(formula="always[0:1s](gap >= 1)", control_dt=1.0).simulations, 0
        )
        self.out = self.out.with_name("pole.sqlite")
        env = gymnasium.make("CartPole-v1")  # states render_fps, but no dt
        with self.assertRaisesRegex(ValueError, "pass it as control_dt"):
            self.falsify(
                env, "always[0:1s](x <= 9)", policy=lambda x: 0, signals={"x": "obs[0]"}, steps=60
            )

    def test_a_chained_comparison_is_reported(self):
        with self.assertWarnsRegex(UserWarning, "comparisons do not chain"):
            mishandle.Formula("always(-1 <= x <= 1)")
        with self.assertWarnsRegex(UserWarning, "comparisons do not chain"):
            self.falsify(formula="always(1 <= gap <= 20)")

    def test_a_signal_with_several_components_is_an_error(self):
        with self.assertRaisesRegex(ValueError, r"`gap` has the shape \(3, 2\)"):
            self.falsify(lambda scenario: {"gap": np.zeros((3, 2))})
        with self.assertRaisesRegex(ValueError, r"`x` has the shape \(3, 2\)"):
            mishandle.robustness("always(x <= 1)", {"x": np.zeros((3, 2))})

    def test_a_trace_is_never_converted_silently(self):
        frame = pandas.DataFrame([[10.0, 1.0], [10.0, 1.0]], columns=["gap", "gap"])
        for trace in (
            frame, {"gap": ["10", "5"]}, {"gap": [10.0, 5 + 3j]},
            {"gap": np.array(["2026-01-01"] * 2, "M8[s]")}
        ):
            with self.assertRaises(ValueError):
                self.falsify(lambda scenario, trace=trace: trace)
        masked = {"gap": np.ma.masked_array([10.0, -99.0], mask=[0, 1])}
        [found] = mishandle.simulate(lambda scenario: masked, "always(gap >= 1)", SPACE)
        self.assertIsNone(found.robustness)
        self.assertIn("invalid signal", found.end)

    def test_simulations_without_a_verdict_are_no_evidence(self):
        def only_nominal(scenario):
            return {"gap": [10.0, 9.0 if scenario["speed"] == 5.0 else np.nan]}

        with self.assertWarnsRegex(UserWarning, "nor evidence of safety"):
            found = self.falsify(only_nominal)
        self.assertEqual((found.falsified_trials, found.simulations), (0, 3))

    def test_an_empty_trace_is_a_crash_and_not_the_end_of_the_run(self):
        self.falsify(lambda scenario: {"gap": [10.0, 9.0]})
        speeds = list(mishandle.open_run(self.out).columns()["speed"])[1:]
        self.assertEqual(len(speeds), 2)
        # The checks before the first simulation do not draw these speeds.
        empty = lambda scenario: {"gap": [] if scenario["speed"] in speeds else [10.0, 9.0]}
        self.assertEqual(sum(trial.failed for trial in self.falsify(empty, out=None).trials), 2)

    def test_a_number_that_is_nan_from_time_to_time_is_not_deterministic(self):
        calls = []

        def flicker(scenario):
            calls.append(scenario)
            return {"gap": [10.0, float("nan") if len(calls) % 2 else 3.0]}

        with self.assertWarnsRegex(UserWarning, "not deterministic"):
            self.assertEqual(self.falsify(flicker).largest_difference, float("inf"))

    def test_invalid_numbers_are_errors_of_this_package(self):
        for options in (
            {"steps": 2.5}, {"steps": -3}, {"time_limit": float("inf")}, {"time_limit": 0}
        ):
            with self.assertRaises(mishandle.MishandleError):
                self.falsify(**options)
        for axis in ({"low": 0, "high": 1, "nominal": 3}, {"values": ["a", "b"], "nominal": 5},
                     {"low": 0, "high": 3, "values": "integer", "nominal": 1.5}):
            with self.assertRaisesRegex(mishandle.MishandleError, "nominal value of axis `x`"):
                Axis("x", **axis)
        for name in ("", "a\nb"):
            with self.assertRaisesRegex(mishandle.MishandleError, "name of an axis"):
                Axis(name, 0, 1)

    def test_a_source_without_a_value_is_named(self):
        env = gymnasium.make("CartPole-v1")
        for source in ("obs[99]", "info.speed", "no_such_attribute", lambda env: env.missing):
            with self.assertRaisesRegex(RuntimeError, "the signal `x` has no value"):
                self.falsify(
                    env, "always(x <= 9)", policy=lambda x: 0, signals={"x": source}, steps=60
                )

    def test_a_formula_that_would_be_ignored_is_an_error(self):
        with self.assertRaisesRegex(ValueError, "`other` would be ignored"):
            self.falsify(formula={"gap": "always(gap >= 1)", "other": "always(gap >= 2)"})
        with self.assertRaisesRegex(TypeError, "a list is not a formula"):
            self.falsify(formula=["always(gap >= 1)"])

    def test_a_formula_can_be_an_object(self):
        formula = mishandle.Formula("always(gap >= 1)")
        self.assertEqual(formula, mishandle.Formula("always(gap >= 1)"))
        [found] = mishandle.simulate(braking, formula, SPACE, at={"speed": 4})
        self.assertEqual(found.robustness, 5.0)

    def test_a_space_is_a_list_of_axes(self):
        for space in ({"speed": (0, 10)}, "starts", [("speed", 0, 10)]):
            with self.assertRaisesRegex(TypeError, "a space is a list of axes"):
                self.falsify(space=space)

    def test_a_missing_onnx_file_is_named(self):
        with self.assertRaisesRegex(ValueError, "missing.onnx"):
            mishandle.simulate("point-reaching", policy="missing.onnx")

    def test_undecided_simulations_are_reported(self):
        env = gymnasium.make("CartPole-v1")
        options = {"policy": lambda x: 1, "signals": {"angle": "obs[2]"}, "steps": 100}
        space = [Axis("low", -0.2, 0.0, nominal=-0.05)]
        # The environment terminates at 0.209 rad, so no simulation violates the formula.
        with self.assertWarnsRegex(UserWarning, 'termination="hold" or "evaluate"'):
            found = self.falsify(env, "always(abs(angle) <= 0.4)", space, **options)
        self.assertEqual(sum(trial.undecided for trial in found.trials), found.simulations)
        self.out = self.out.with_name("held.sqlite")
        with warnings.catch_warnings(action="error"):
            found = self.falsify(
                env, "always(abs(angle) <= 0.4)", space, termination="hold", **options
            )
        self.assertEqual(
            (found.falsified_trials, sum(trial.undecided for trial in found.trials)), (0, 0)
        )

    def test_formulas_and_spaces_of_a_task_have_names(self):
        task, options = "point-reaching", {
            "search": "random", "trials": 1, "budget": 2, "policy": "ppo"
        }
        plain = mishandle.falsify(task, "strict", out=self.out, **options)
        named = mishandle.falsify(
            task, "strict", "starts", out=self.out.with_name("named.sqlite"), **options
        )
        self.assertIn("0.03", mishandle.open_run(plain.path).formula)
        self.assertEqual(
            mishandle.open_run(plain.path).formula, mishandle.open_run(named.path).formula
        )
        self.assertEqual(plain.trials, named.trials)
        self.assertEqual(
            mishandle.replay(named.path, task, "strict", "starts", policy="ppo").differences, ()
        )
        [one] = mishandle.simulate(task, "strict", "starts", policy="ppo")
        [other] = mishandle.simulate(task, "strict", policy="ppo")
        self.assertEqual((one.robustness, one.scenario), (other.robustness, other.scenario))
        space = "starts+sensing"
        found = mishandle.falsify(
            task, None, space, out=self.out.with_name("sensing.sqlite"), **options
        )
        self.assertGreater(len(found.trials[0].scenario), len(named.trials[0].scenario))
        self.assertEqual(
            mishandle.evaluate(
                task, None, space, policy="ppo", episodes=2, out=self.out.with_name("e")
            ).success_rate.n,
            2
        )
        axes = {"target_x": (0.5, 0.6), "action_delay": 2}
        found = mishandle.falsify(
            task, None, axes=axes, out=self.out.with_name("axes.sqlite"), **options
        )
        values = found.trials[0].scenario
        self.assertEqual(values["action_delay"], 2)
        self.assertTrue(0.5 <= values["target_x"] <= 0.6, values)
        with self.assertRaisesRegex(ValueError, "no axis `target_w`"):
            mishandle.simulate(task, policy="ppo", axes={"target_w": 0.1})
        with self.assertRaisesRegex(ValueError, "action_delay"):
            mishandle.simulate(task, policy="ppo", axes={"action_delay": [2, 7]})
        for formula, given, message in [
            ("strct", None, "no formula or signal `strct`.*did you mean `strict`"),
            ("strct", "starts", "no formula or signal `strct`"),
            ("strict", "start", "there is no space `start`.*did you mean `starts`"),
        ]:
            with self.assertRaisesRegex(ValueError, message):
                mishandle.simulate(task, formula, given, policy="ppo")
        # So does a policy in Python.
        still = lambda observation: np.zeros(9)
        [one] = mishandle.simulate(task, "strict", "starts", policy=still)
        [other] = mishandle.simulate(task, "strict", policy=still)
        self.assertEqual(one.robustness, other.robustness)

    def test_a_plan_has_the_keys_of_plan_files_with_underscores(self):
        def check(message, plan, function=mishandle.falsify, **options):
            with self.assertRaisesRegex(mishandle.MishandleError, message):
                function(braking, "always(gap >= 1)", SPACE, plan=plan, **options)

        falsify, early = {"early_stopping": True}, 'plan\\["falsify"\\]\\["early_stopping"\\]'
        found = self.falsify(plan={"falsify": falsify, "seed": np.int64(2**62), "report": None})
        self.assertIn("early-stopping = true", mishandle.open_run(found.path).plan)
        self.assertEqual(mishandle.open_run(found.path).seed, 2**62)
        for plan, message in [
            ({"falsify": {"early_stoping": True}}, "no key `falsify.early_stoping`.*early_stop"),
            ({"falsify": {"early_stopping": 1}}, early + " is 1; it must be true or false"),
            ({"falsify": 3}, r'plan\["falsify"\] is 3; it must be a table'),
            ({"margin": {"each_category": True}}, "has no effect on this question"),
            ({"engine": {"jobs": 2}}, "has no effect on this question"),
            ({"stochastic": True}, r'plan\["stochastic"\] has no effect on this system'),
            ({"target": "toy/noisy"}, r'plan\["target"\] has no effect on this system'),
            ({"axes": {"speed": [1]}}, r'plan\["axes"\]\["speed"\] is .*it must be a number'),
            ({"falsify": {"new_mode_rate": float("nan")}}, "NaN"),
            ({"falsify": {"options": {"visit": print}}}, "is a builtin_function_or_method"),
            ([("seed", 3)], "plan is .*expected a dictionary"),
        ]:
            with self.subTest(message):
                check(message, plan)
        check("seed is set twice, as an argument and in `plan`", {"seed": 1}, seed=1)
        check("budget is set twice", {"margin": {"budget": 9}}, mishandle.margin, budget=9)
        for name, value in [("budget", "many"), ("seed", 1.5)]:
            check(f"^{name} is .*; it must be an integer", {}, **{name: value})

    def test_arguments_are_checked_before_the_system_is_called(self):
        calls = []

        def system(scenario):
            calls.append(scenario)
            return braking(scenario)

        def check(
            message, function=mishandle.falsify, space=SPACE, formula="always(gap >= 1)", **options
        ):
            with self.assertRaisesRegex(mishandle.MishandleError, message):
                function(system, formula, space, **options)

        for options, message in [
            ({"search": "randon"}, "no search `randon`"),
            ({"plan": {"falsify": {"search": "random", "options": {"max": 3}}}}, "max"),
            ({"trials": 0}, "number of trials is 0"),
            ({"trials": 2.5}, "trials is 2.5"),
            ({"budget": -1}, "budget is -1"),
            ({"budget": 2**40}, "budget is"),
            ({"plan": {"falsify": {"batch": 0}}}, "batch size is 0"),
            ({"seed": -1}, "seed is -1"),
            ({"termination": "holds"}, "termination is 'holds'"),
            ({"resume": True}, "needs the run file"),
            ({"resume": True, "out": self.out}, "there is no run file"),
            ({"formula": "always(gap >="}, "expected"),
            ({"space": SPACE + SPACE}, "two axes have the name `speed`"),
            ({"space": [Axis("speed", 5, 2)]}, "lower bound"),
        ]:
            check(message, **options)
        check("episodes is 0", mishandle.evaluate, episodes=0)
        check("batch size", mishandle.evaluate, plan={"evaluate": {"batch": 10**6}})
        check("repeat is 0", mishandle.simulate, repeat=0)
        check("no axis mass; its axes: speed", mishandle.simulate, at={"mass": 1})
        self.out.touch()
        check("exists already", out=self.out)
        self.assertEqual(calls, [])

    def test_two_axes_that_set_the_same_thing_are_an_error(self):
        env = gymnasium.make("CartPole-v1")
        options = {"policy": lambda x: 1, "signals": {"angle": "obs[2]"}, "steps": 100}
        attribute, option = mishandle.Attribute, mishandle.ResetOption
        for one, other, message in [
            (attribute("length"), attribute("length"), "both set the attribute 'length'"),
            (attribute("state[0]"), attribute("state[ 0 ]"), "both set the attribute"),
            (option("low"), option("low"), "both set the reset option 'low'"),
            (
                option("scenario"), option("scenario.x"),
                "the reset option 'scenario' and its part 'scenario.x'"
            ),
            (None, option("a"), "both set the reset option 'a'"),
        ]:
            space = [Axis("a", 0.2, 1.5, apply=one), Axis("b", 0.2, 1.5, apply=other)]
            with self.assertRaisesRegex(ValueError, message):
                self.falsify(env, "always(angle <= 1)", space, **options)
        space = [
            Axis("a", 0.2, 1.5, apply=attribute("length")),
            Axis("b", 9, 10, apply=attribute("gravity"))
        ]
        self.assertEqual(
            self.falsify(
                env, "always(angle <= 1)", space, termination="hold", **options
            ).simulations,
            3
        )

    def test_a_run_continues_with_its_own_settings_only(self):
        self.falsify()
        for options, message in [
            ({"budget": 5}, "made with other settings: budget: recorded 3, given 5; "),
            ({"trials": 2}, "trials: recorded 1, given 2"),
            ({"seed": 3}, "seed: recorded 0, given 3"),
        ]:
            settings = {
                "search": "random", "trials": 1, "budget": 3, "out": self.out, "resume": True,
                **options
            }
            with self.assertRaisesRegex(mishandle.MishandleError, message):
                mishandle.falsify(braking, "always(gap >= 1)", SPACE, **settings)
        with self.assertRaisesRegex(
            mishandle.MishandleError, r"from 0.0 to 9.0, nominal 4.5.*the file was changed"
        ):
            self.falsify(space=[Axis("speed", 0, 9, "m/s")], resume=True)
        self.assertEqual(self.falsify(resume=True, plan={"falsify": {"batch": 7}}).simulations, 3)

    def test_the_differences_of_a_replay_are_plain_numbers(self):
        self.falsify()
        other = mishandle.replay(
            self.out, lambda scenario: {"gap": [4.0, 4.0]}, "always(gap >= 1)", SPACE
        )
        found = [text for text in other.differences if text.startswith("robustness:")]
        self.assertRegex(found[0], r"^robustness: recorded -?[\d.]+, replayed 3.0$")


ROAD = [
    Axis("speed", 0, 10, "m/s"),
    Axis("delay", 0, 4, values="integer", kind="model"),
    Axis("surface", values=["dry", "wet", "ice"], nominal="wet", kind="model"),
]


class Settings(FolderCase):
    """Axes of a system of the user that have narrower ranges, or fixed values."""

    def test_a_system_receives_the_nominal_value_that_its_axis_states(self):
        self.assertEqual([axis.nominal_value for axis in ROAD], [5.0, 2, "wet"])
        self.assertEqual([axis.nominal_number for axis in ROAD], [5.0, 2.0, 1.0])
        self.assertEqual(Axis("surface", values=["dry", "wet"], nominal=1).nominal_value, "wet")
        seen = []
        mishandle.simulate(
            lambda s: seen.append(s) or {"gap": [1.0, 1.0]}, "always(gap >= 0)", ROAD
        )
        self.assertEqual(seen[0], {"speed": 5.0, "delay": 2, "surface": "wet"})
        for nominal in ("sand", 1.5):
            with self.assertRaisesRegex(mishandle.MishandleError, "axis `surface`"):
                Axis("surface", values=["dry", "wet"], nominal=nominal)
        with self.assertRaisesRegex(
            mishandle.MishandleError, "nominal value of axis `x` is 'dry'; the axis has no names"
        ):
            Axis("x", 0, 1, nominal="dry")

    def test_axes_of_functions_and_environments_are_fixed_and_narrowed(self):
        seen = []

        def system(scenario):
            seen.append(scenario)
            return {"gap": [10.0, 10.0 - scenario["speed"]]}

        run = self.folder / "run.sqlite"
        axes = {"surface": "ice", "speed": (2.0, 3.0), "delay": 4}
        found = mishandle.falsify(
            system, "always(gap >= 0)", ROAD, axes=axes, search="random", trials=1, budget=20,
            out=run
        )
        self.assertEqual(found.simulations, 20)
        self.assertTrue(all(2 <= scenario["speed"] <= 3 for scenario in seen))
        self.assertEqual(
            {(scenario["surface"], scenario["delay"]) for scenario in seen}, {("ice", 4)}
        )
        columns = mishandle.open_run(run).columns()
        self.assertEqual((set(columns["surface"]), set(columns["delay"])), ({"ice"}, {4}))
        again = mishandle.replay(
            run, system, "always(gap >= 0)", ROAD, axes=axes, trial=1, number=3
        )
        self.assertEqual((again.differences, again.repetition.scenario["surface"]), ((), "ice"))
        env = gymnasium.make("CartPole-v1", max_episode_steps=3)
        space = [
            Axis("low", -0.05, 0.0),
            Axis("length", 0.4, 0.6, kind="model", apply=mishandle.Attribute("length"))
        ]
        signals = {"length": lambda env: env.length}
        kinds = {"policy": lambda o: 1, "signals": signals, "termination": "hold"}
        [found] = mishandle.simulate(
            env, "always(length <= 9)", space, axes={"length": 0.45}, **kinds
        )
        self.assertEqual(found.trace["length"].tolist(), [0.45] * 4)

    def test_impossible_settings_are_errors(self):
        for axes, message in [
            ({"sped": 1}, "there is no axis `sped`.*did you mean `speed`"),
            ({"delay": 9}, "delay cannot be 9: expected a whole number from 0 to 4"),
            ({"surface": "sand"}, "there is no category `sand`"),
            ({"speed": 1, "delay": 1, "surface": "dry"}, "at least 1"),
        ]:
            with self.assertRaisesRegex(mishandle.MishandleError, message):
                mishandle.simulate(braking, "always(gap >= 0)", ROAD, axes=axes)

    def test_a_category_of_a_narrowed_axis_keeps_its_name(self):
        run = self.folder / "run.sqlite"
        seen = []
        system = lambda s: seen.append(s["surface"]) or {"gap": [1.0, 1.0]}
        mishandle.evaluate(
            system, "always(gap >= 0)", ROAD, axes={"surface": (1, 2)}, episodes=20, out=run
        )
        self.assertEqual(set(seen), {"wet", "ice"})
        self.assertEqual(set(mishandle.open_run(run).columns()["surface"]), {"wet", "ice"})


class Files(FolderCase):
    def test_results_make_their_folders(self):
        space = [Axis("speed", 0, 10, "m/s", nominal=0, kind="input")]
        found = mishandle.margin(
            braking, "always(gap >= 2)", space, budget=50, out=self.folder / "run.sqlite"
        )
        self.assertTrue(found.export(self.folder / "new" / "inner" / "smallest.json").is_file())
        found.report(self.folder / "pages" / "margin.html", plan={"report": {"simulations": False}})
        self.assertTrue((self.folder / "pages" / "margin.html").is_file())
        self.assertEqual(
            sorted(path.name for path in (self.folder / "pages").iterdir()), ["margin.html"]
        )

    def test_runs_that_start_at_the_same_moment_have_files_of_their_own(self):
        program = (
            "import mishandle, sys, time\n"
            "time.sleep(max(0.0, float(sys.argv[1]) - time.time()))\n"
            "system = lambda s: {'gap': [1.0, s['speed']]}\n"
            "asked = (system, 'always(gap >= -1)', [mishandle.Axis('speed', 0, 10)])\n"
            "print(mishandle.evaluate(*asked, episodes=3, name='same').path)\n"
        )
        command = [sys.executable, "-c", program, str(time.time() + 3)]
        started = [
            subprocess.Popen(command, cwd=self.folder, stdout=subprocess.PIPE, text=True)
            for _ in range(4)
        ]
        paths = {process.communicate()[0].strip() for process in started}
        self.assertEqual(len(paths), 4, paths)
        self.assertEqual({process.returncode for process in started}, {0})

    def test_a_baseline_tells_new_failures_from_old_ones(self):
        fast = lambda scenario: {"gap": [10.0, 10.0 - 2 * scenario["speed"]]}
        slow = lambda scenario: {"gap": [10.0, 10.0 - 0.1 * scenario["speed"]]}
        suite, report = self.folder / "suite", self.folder / "reports" / "junit.xml"
        kinds = {"name": "car", "search": "random", "trials": 1, "budget": 50}
        mishandle.falsify(
            braking, "always(gap >= 2)", SPACE, out=self.folder / "run.sqlite", **kinds
        ).export(suite)
        for system, baseline, result in [
            (fast, slow, "new failure"), (fast, braking, "still fails"), (slow, fast, "fixed"),
            (slow, slow, "passes")
        ]:
            found = mishandle.regress(
                suite, system, "always(gap >= 2)", SPACE, name="car", baseline=baseline,
                junit=report
            )
            [test] = found.tests
            self.assertEqual(
                (test.result, found.new_failures), (result, int(result == "new failure"))
            )
            [case] = ElementTree.parse(report).iter("testcase")
            self.assertEqual(
                [part.tag for part in case],
                {"new failure": ["failure"], "still fails": ["skipped"]}.get(result, [])
            )

    def test_more_threads_than_cores_are_reported(self):
        with self.assertWarnsRegex(UserWarning, "threads=1000 is more than the .* cores"):
            mishandle.TaskVectorEnv("point-reaching", 2, threads=1000)
