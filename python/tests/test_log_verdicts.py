"""Tests of verdicts on logs: the same for files, logs that were read, columns in memory, and the
command."""

import dataclasses
import json
import re
import subprocess
import sys

import mishandle
import numpy as np
import pandas
import polars
import pyarrow
import pyarrow.parquet
from mcap.writer import Writer as McapWriter
from mishandle import results
from mishandle.errors import InvalidValueError
from test_logs import START, Files


def command(*words):
    """Returns the document of the command."""
    done = subprocess.run(
        [
            sys.executable, "-c",
            "import sys; from mishandle.command import main; sys.exit(main())", "monitor", "--json",
            *words
        ],
        capture_output=True, text=True
    )
    if done.returncode not in (0, 1):
        raise AssertionError(done.stderr)
    return results.build(mishandle.logs.Monitoring, json.loads(done.stdout))


def without_names(found):
    """Returns the verdicts without the names of the logs."""
    return [dataclasses.replace(verdict, log="") for verdict in found.verdicts]


class Logs(Files):
    def csv(self, name, columns):
        path = self.folder / name
        pandas.DataFrame(columns).to_csv(path, index=False)
        return path

    def files(self, columns):
        """The same table in each format."""
        paths = [self.csv("log.csv", columns)]
        for ending in ("jsonl", "npz", "parquet"):
            paths.append(self.folder / f"log.{ending}")
        rows = zip(*columns.values())
        paths[1].write_text("".join(json.dumps(dict(zip(columns, row))) + "\n" for row in rows))
        np.savez(paths[2], **{name: np.array(values) for name, values in columns.items()})
        pyarrow.parquet.write_table(pyarrow.table(columns), paths[3])
        return paths


class Runs(Logs):
    def test_a_clock_that_starts_again_is_two_logs_with_a_verdict_each(self):
        # The second run violates d <= 2. Sorted, and with one row of each time, it is gone.
        columns = {"time": [0.0, 1.0, 2.0, 0.0, 1.0, 2.0], "d": [1.0, 1.0, 1.0, 9.0, 1.0, 1.0]}
        for plan in [{}, {"log": {"sort": True, "duplicates": "first"}}]:
            for log in [*self.files(columns), columns, pandas.DataFrame(columns)]:
                found = mishandle.monitor("always(d <= 2)", log, plan=plan)
                values = [verdict.robustness for verdict in found.verdicts]
                self.assertEqual(values, [-7.0, 1.0], repr(log))
                names = [verdict.log for verdict in found.verdicts]
                places = "(line 5 to line 7|line 4 to line 6|row 4 to row 6)"
                self.assertRegex(names[0], f"run 2 of 2, {places}")
                with self.assertRaisesRegex(InvalidValueError, "the times start again in"):
                    mishandle.robustness("always(d <= 2)", log, plan=plan)
        found = command("--formula", "always(d <= 2)", str(self.files(columns)[0]))
        self.assertEqual([verdict.robustness for verdict in found.verdicts], [-7.0, 1.0])

    def test_a_clock_that_starts_again_in_the_middle_is_two_logs_in_all_formats(self):
        # The first row of the second run violates d <= 2. With one row of each time, it is gone.
        times = [*range(11), *range(5, 13)]
        columns = {"time": [float(time) for time in times], "d": [1.0] * 11 + [9.0] + [1.0] * 7}
        recording = self.mcap(columns)
        for choices in [{}, {"sort": True, "duplicates": "last"}]:
            for log in [*self.files(columns), columns, pandas.DataFrame(columns), recording]:
                formula = "always(d <= 2)"
                if log is recording:
                    formula, choices = "always(`/state/d` <= 2)", {**choices, "time": "header"}
                found = mishandle.monitor(formula, log, plan={"log": choices})
                values = [verdict.robustness for verdict in found.verdicts]
                self.assertEqual(values, [-7.0, 1.0], repr(log))
                self.assertIn("run 2 of 2", found.verdicts[0].log)

    def mcap(self, columns):
        """Messages with these times in seconds in their headers."""
        path = self.folder / "log.mcap"
        with open(path, "wb") as stream:
            writer = McapWriter(stream)
            writer.start()
            channel = writer.register_channel("/state", "json", 0)
            for index, (time, d) in enumerate(zip(columns["time"], columns["d"])):
                message = {"header": {"stamp": {"sec": int(time), "nanosec": 0}}, "d": d}
                stamp = START + index * 10**9
                writer.add_message(channel, stamp, json.dumps(message).encode(), stamp)
            writer.finish()
        return path

    def test_seconds_and_nanoseconds_are_one_time_in_all_formats(self):
        columns = {
            "stamp.sec": [10, 11, 12], "stamp.nanosec": [900_000_000, 100_000_000, 100_000_000],
            "d": [0.0, 3.0, 0.0]
        }
        for time in ("stamp", "stamp.sec", "stamp.nanosec"):
            plan = {"log": {"time": time, "dense": "hold"}}
            for log in [*self.files(columns), columns, pandas.DataFrame(columns)]:
                found = mishandle.monitor("always[0:0.5s](d <= 1)", log, plan=plan)
                [violation] = found.verdicts[0].violations
                self.assertEqual((found.robustness, violation.start), (-2.0, 11.1), repr(log))
        wrong = {**columns, "stamp.nanosec": [0, 1_000_000_000, 0]}
        with self.assertRaisesRegex(InvalidValueError, "from 0 to 999999999"):
            mishandle.monitor("always(d <= 1)", wrong, plan={"log": {"time": "stamp"}})

    def test_a_unit_is_asked_for_in_all_formats(self):
        for times in [[0.0, 100.0, 200.0], [0.5, 33.5, 66.5]]:
            columns = {"time": times, "d": [0.0, 0.0, 3.0]}
            for log in [*self.files(columns), columns, pandas.DataFrame(columns)]:
                with self.assertRaisesRegex(InvalidValueError, "time_unit"):
                    mishandle.monitor("always(d <= 2)", log, plan={"log": {"dense": "hold"}})

    def test_a_column_of_dates_has_the_times(self):
        dates = pandas.date_range("2024-01-31T12:00:00Z", periods=3, freq="500ms")
        for times in [dates, list(dates.to_pydatetime()), [date.isoformat() for date in dates]]:
            found = mishandle.monitor("always[0:1s](d <= 2)", {"time": times, "d": [1.0, 1.0, 3.0]})
            self.assertEqual(found.robustness, -1.0, repr(times))
        with self.assertRaisesRegex(InvalidValueError, "the times `time` have the type complex128"):
            mishandle.monitor("always(d <= 2)", {"time": np.zeros(3, complex), "d": [1.0] * 3})


class SameAnswers(Logs):
    def test_each_format_and_columns_in_memory_have_the_verdict_of_the_command(self):
        generator = np.random.default_rng(5)
        jittered = np.round(np.cumsum(generator.uniform(0.05, 0.15, 80)), 3).tolist()
        even = [round(0.02 * row, 2) for row in range(80)]
        force, speed = np.round(generator.normal(size=(2, 80)), 3).tolist()
        formula = "always(force <= 1 and eventually[0:0.2s](speed >= 0))"
        cases = [
            (even, {}),
            (jittered, {"dense": "hold"}),
            (jittered, {"dense": "linear", "tolerance": 0.2}),
            (jittered, {"resample": "linear", "period": 0.04}),
            (jittered, {"resample": "hold", "period": 0.05}),
        ]
        for times, reading in cases:
            columns = {"time": times, "force": force, "speed": speed}
            settings = [f"log.{name}={value}" for name, value in reading.items()]
            keys = [word for setting in settings for word in ("-k", setting)]
            paths = self.files(columns)
            expected = command("--formula", formula, str(paths[0]), *keys)
            self.assertTrue(expected.violated)
            for path in paths:
                asked = {
                    "path": path, "log": mishandle.read_log(path), "columns": columns,
                    "pandas": pandas.DataFrame(columns)
                }
                asked["polars"] = polars.DataFrame(columns)
                for name, log in asked.items():
                    found = mishandle.monitor(formula, log, plan={"log": reading})
                    self.assertEqual(
                        without_names(found), without_names(expected), (path.suffix, name, reading)
                    )
                    self.assertEqual(
                        mishandle.robustness(formula, log, plan={"log": reading}),
                        expected.robustness
                    )
                found = mishandle.monitor(formula, path, plan={"log": reading})
                self.assertEqual(found.verdicts[0].log, str(path))

    def test_times_in_other_units_and_dates_count_from_the_first_sample(self):
        instants = [1_700_000_000_000_000_000 + 20_000_000 * row for row in range(5)]
        force = [0.0, 1.0, 5.0, 6.0, 1.0]
        dates = pandas.to_datetime(instants, utc=True)
        path = self.csv("ns.csv", {"stamp": instants, "force": force})
        cases = [
            (path, {"time": "stamp", "time_unit": "ns"}),
            ({"stamp": instants, "force": force}, {"time": "stamp", "time_unit": "ns"}),
            ({"time": np.array(instants, "datetime64[ns]"), "force": force}, {}),
            (pandas.DataFrame({"t": dates, "force": force}), {"time": "t"}),
            ({"t": [date.isoformat() for date in dates], "force": force}, {"time": "t"}),
            (
                mishandle.read_log(path, plan={"log": {"time": "stamp", "time_unit": "ns"}}), {}
            ),
        ]
        for log, reading in cases:
            plan = {"log": reading}
            [verdict] = mishandle.monitor("always(force <= 2)", log, plan=plan).verdicts
            self.assertEqual(verdict.origin_ns, instants[0], reading)
            [violation] = verdict.violations
            self.assertEqual((violation.start, violation.end, violation.worst), (0.04, 0.06, -4.0))

    def test_the_robustness_is_the_first_value_of_the_signal(self):
        generator = np.random.default_rng(2)
        for text in (
            "always(x <= 1)", "eventually[2:5](x >= 1 and y <= 0)", "(x <= 1) until[0:4] (y >= 1)",
            "x >= y"
        ):
            formula = mishandle.Formula(text)
            for length in (1, 3, 20):
                columns = dict(zip("xy", generator.normal(size=(2, length))))
                self.assertEqual(formula.robustness(columns), formula.robustness_signal(columns)[0])
                decided = formula.robustness_signal(columns, decided_only=True)
                expected = decided[0] if len(decided) else None
                self.assertEqual(formula.robustness(columns, decided_only=True), expected)

    def test_values_are_those_at_each_sample(self):
        columns = {"x": [0.0, 3.0, 1.0]}
        plan = {"log": {"period": 0.5}, "monitor": {"values": True}}
        found = mishandle.monitor("x <= 2", columns, plan=plan)
        self.assertEqual(
            (found.robustness_signal, found.robustness_times), ((2.0, -1.0, 1.0), (0.0, 0.5, 1.0))
        )
        with self.assertRaisesRegex(ValueError, "is about one log"):
            mishandle.monitor("x <= 2", [columns, columns], plan=plan)
        cut = {"log": {"strict_horizon": False}}
        found = mishandle.monitor("always[0:4](x <= 2)", columns, plan=cut)
        self.assertTrue(found.cuts_windows)
        with self.assertRaisesRegex(
            ValueError, r'needs 5 samples.*; leave out plan\["log"\]\["strict_horizon"\]$'
        ):
            strict = {"log": {"strict_horizon": True}}
            mishandle.monitor("always[0:4](x <= 2)", columns, plan=strict)
        seconds = {"log": {"period": 0.5, "unit": "s"}}
        bounds = mishandle.monitor("always[1:2](x <= 2)", columns, plan=seconds)
        self.assertEqual(bounds.robustness, 1.0)


HOW = "hold|linear"
DENSE = r'plan\["log"\]\["dense"\]'


def stated(key, value):
    """Returns a regular expression for the argument that states a key. Words are quoted."""
    value = value if value in ("SECONDS", "COLUMN", "True") else f'"{value}"'
    return re.escape(f'plan={{"log": {{"{key}": {value}}}}}')


class Choices(Logs):
    def test_each_undecided_choice_names_the_key(self):
        cases = [
            (
                {"time": [0.0, 0.1, 0.3], "x": [1, 1, 1]}, {},
                f'pass {stated("resample", HOW)} or {stated("dense", HOW)}, '
                f'or {stated("period", "SECONDS")} if its'
            ),
            (
                {"time": [0.0, 0.2, 0.1], "x": [1, 1, 1]}, {},
                'row 3; if its clock starts again there, cut the log into two; pass '
                f'{stated("sort", "True")} if its rows are in the wrong order$'
            ),
            (
                {"time": [0.0, 0.1, 0.1], "x": [1, 1, 1]}, {},
                f'row 3; pass {stated("duplicates", "first|last")}$'
            ),
            (
                {"time": [0, 10**13], "x": [1, 1]}, {},
                f'pass {stated("time_unit", "s|ms|us|ns")}'
            ),
            (
                {"x": [1.0, np.nan]}, {},
                f'row 2: `x` has no number; pass {stated("missing", "hold|drop")}$'
            ),
            ({"x": [1.0, np.inf]}, {}, "row 2: `x` has no number"),
            (
                {"x": [1.0, 2.0]}, {"resample": "hold"},
                f'resampling needs the new period; pass {stated("period", "SECONDS")}$'
            ),
            (
                {"x": [1.0, 2.0]}, {"dense": "hold"},
                f'need the times of the samples; pass {stated("time", "COLUMN")}$'
            ),
            (
                {"x": [1.0, 2.0]}, {"tolerance": 1.0},
                "the tolerance is the longest step that resampling or dense time bridges; "
                f'pass {stated("resample", HOW)}'
            ),
            (
                {"x": [1.0, 2.0]}, {"dense": "hold", "resample": "hold"},
                f"{DENSE} is set; it must be left out, because log.resample is set"
            ),
            (
                {"x": [1.0, 2.0]}, {"missing": "skip"},
                r'plan\["log"\]\["missing"\] is "skip"; it must be "error", "hold" or "drop"'
            ),
            (
                {"x": [1.0, 2.0]}, {"period": 0.0},
                r'plan\["log"\]\["period"\] is 0.0; it must be a number of seconds above 0'
            ),
            ({"x": [1.0, 2.0]}, {"time": "t"}, "time is `t`, but no column has this name"),
            (
                {"time": [0.0, 1.0], "x": [1, 1]}, {"period": 0.5},
                "period is 0.5 s, but the mean step of column `time` is 1 s; leave out "
                r'plan\["log"\]\["period"\], or pass ' + stated("resample", HOW)
            ),
        ]
        for log, reading, message in cases:
            for ask in (mishandle.monitor, mishandle.robustness):
                with self.assertRaisesRegex(InvalidValueError, message) as raised:
                    ask("always(x <= 2)", log, plan={"log": reading})
                self.assertNotIn("--", str(raised.exception))
                self.assertNotIn("-k", str(raised.exception))
        for name, message in [
            ("resampled", "no key `log.resampled`; known keys are: .* resample"),
            ("topics", r'plan\["log"\]\["topics"\]\["a"\] has no effect on this question')
        ]:
            with self.assertRaisesRegex(InvalidValueError, message):
                value = {"a": "a.csv"} if name == "topics" else "hold"
                mishandle.monitor("always(x <= 2)", {"x": [1.0]}, plan={"log": {name: value}})
        with self.assertRaisesRegex(
            ValueError,
            f'needs the time between two samples.*pass {stated("period", "SECONDS")}'
        ):
            mishandle.robustness("always[0:2s](x <= 2)", {"x": [1.0]})
        read = mishandle.logs.Log("read", {"": mishandle.logs.Topic("", None, {"x": np.zeros(2)})})
        for log, name, value in [
            ({"x": [1.0]}, "format", "csv"), (read, "time", "t"),
            ({"a": {"x": [1.0]}}, "delimiter", ";")
        ]:
            with self.assertRaisesRegex(
                ValueError, rf'plan\["log"\]\["{name}"\] has no effect on'
            ):
                mishandle.monitor("always(x <= 2)", log, plan={"log": {name: value}})
        path = self.csv("t.csv", {"stamp": [0.0, 1.0], "x": [1.0, 1.0]})
        advice = f'{stated("time", "stamp")} if the column `stamp` has the times in seconds'
        with self.assertRaisesRegex(
            ValueError, f'pass {stated("period", "SECONDS")}, or {advice}'
        ):
            mishandle.robustness("always[0:2s](x <= 2)", path)

    def test_the_advice_has_the_unit_of_the_name(self):
        path = self.csv("t.csv", {"TimeMS": [0.0, 100.0], "x": [1.0, 1.0]})
        with self.assertRaises(ValueError) as caught:
            mishandle.robustness("always[0:0.1s](x <= 2)", path)
        text = str(caught.exception)
        self.assertIn("if the column `TimeMS` has the times in milliseconds", text)
        self.assertIn('plan={"log": {"time": "TimeMS", "time_unit": "ms"}}', text)
        plan = {"log": {"time": "TimeMS", "time_unit": "ms"}}
        self.assertEqual(mishandle.robustness("always[0:0.1s](x <= 2)", path, plan=plan), 1.0)

    def test_a_named_index_is_a_column(self):
        frame = pandas.DataFrame({"x": [0.0, 3.0]}, pandas.Index([0.0, 0.1], name="time"))
        formula = "always[0:0.1s](x <= 2)"
        self.assertEqual(mishandle.robustness(formula, frame), -1.0)
        self.assertEqual(mishandle.robustness("always[0:0.1s](`a/x` <= 2)", {"a": frame}), -1.0)
        stamps = frame.set_axis(pandas.Index([0, 100], name="stamp"))
        plan = {"log": {"time": "stamp", "time_unit": "ms"}}
        self.assertEqual(mishandle.robustness(formula, stamps, plan=plan), -1.0)
        with self.assertRaisesRegex(ValueError, "no column `time`"):
            mishandle.robustness(formula, frame.reset_index(drop=True))

    def test_the_choices_decide(self):
        log = {"time": [0.0, 0.3, 0.1, 0.1, 0.2], "x": [0.0, 1.0, 5.0, 2.0, np.nan]}
        for reading, expected in [
            ({"duplicates": "first", "missing": "hold"}, -3.0),
            ({"duplicates": "last", "missing": "hold"}, 0.0),
        ]:
            plan = {"log": {"sort": True, **reading}}
            self.assertEqual(mishandle.robustness("always(x <= 2)", log, plan=plan), expected)
        reading = {"sort": True, "duplicates": "last", "missing": "drop", "dense": "linear"}
        found = mishandle.monitor("always(x <= 2)", log, plan={"log": reading})
        self.assertEqual((found.robustness, found.verdicts[0].missing_values), (0.0, 1))


class Tables(Logs):
    def test_all_formats_give_the_columns_that_were_written(self):
        columns = {
            "time": [0.5, 0.75, 1.0], "q[0]": [1.0, -2.0, 3.5], "flag": [True, False, True],
            "name": ["a", "b", "c"]
        }
        for path in self.files(columns):
            log = mishandle.read_log(path)
            topic = log.topics[""]
            self.assertEqual(
                (topic.times.dtype, topic.times.tolist()),
                (np.int64, [500_000_000, 750_000_000, 1_000_000_000])
            )
            self.assertEqual(
                {name: values.tolist() for name, values in topic.columns.items()},
                {"q[0]": [1, -2, 3.5], "flag": [1, 0, 1]}
            )
            if path.suffix != ".npz":
                self.assertEqual(topic.left_out, {"name": "it has no numbers"})
            self.assertEqual((log.name, log.signals), (str(path), ["q[0]", "flag"]))

    def test_a_table_without_times_has_none(self):
        log = mishandle.read_log(self.csv("x.csv", {"x": [1.0, 2.0], "y": [np.nan, 3.0]}))
        self.assertIsNone(log.topics[""].times)
        np.testing.assert_array_equal(log.topics[""].columns["y"], [np.nan, 3.0])
        self.assertEqual(mishandle.robustness("always(x <= 2)", log), 0.0)
        with self.assertRaisesRegex(ValueError, "`y` has no number"):
            mishandle.robustness("always(y <= 2)", log)

    def test_topics_of_a_column_and_of_several_files(self):
        rows = {
            "time": [0.0, 0.1, 0.5, 1.0], "topic": ["arm", "hand", "arm", "hand"],
            "v": [1.0, 2.0, 3.0, 4.0]
        }
        log = mishandle.read_log(
            self.csv("split.csv", rows), plan={"log": {"topic_column": "topic"}}
        )
        self.assertEqual(log.signals, ["arm/v", "hand/v"])
        self.assertEqual(log.topics["hand"].times.tolist(), [100_000_000, 1_000_000_000])
        formula = "always(`hand/v` - `arm/v` <= 0.5)"
        topics = {
            "arm": {"time": [0.0, 0.5], "v": [1.0, 3.0]},
            "hand": {"time": [0.1, 1.0], "v": [2.0, 4.0]}
        }
        files = {name: self.csv(f"{name}.csv", columns) for name, columns in topics.items()}
        frames = {name: pandas.DataFrame(columns) for name, columns in topics.items()}
        expected = command(
            "--formula", formula, "-k", "log.dense=hold",
            *[f"-klog.topics.{name}={path}" for name, path in files.items()]
        )
        for each in (log, log.topics, topics, files, frames):
            found = mishandle.monitor(formula, each, plan={"log": {"dense": "hold"}})
            self.assertEqual(without_names(found), without_names(expected))
        with self.assertRaisesRegex(ValueError, "different times; pass plan=.*resample"):
            mishandle.monitor(formula, topics)
        with self.assertRaisesRegex(
            ValueError, "lacks the signals hand/w; it has arm/time, arm/v, hand/time, hand/v"
        ):
            mishandle.monitor("`hand/w` <= 1", topics, plan={"log": {"dense": "hold"}})


class SeveralLogs(Logs):
    def test_a_formula_without_its_signal_takes_no_verdict_from_the_others(self) -> None:
        columns = {"time": [0.0, 1.0], "force": [1.0, 3.0]}
        file = self.csv("log.csv", columns)
        formulas = {
            "soft": "always(force <= 2)", "other": "always(speed <= 1)",
            "odd": "always(sqrt(force - 2) <= 1)"
        }
        for log in (columns, file):
            found = mishandle.monitor(formulas, log)
            self.assertEqual(
                [(verdict.name, verdict.violated) for verdict in found.verdicts], [("soft", True)]
            )
            self.assertEqual(len(found.without_verdict), 2)
            self.assertIn("speed", found.without_verdict[0])
            self.assertIn("no verdict", str(found))
            with self.assertRaisesRegex(ValueError, "speed"):
                mishandle.monitor({"other": "always(speed <= 1)"}, log)

    def test_verdicts_are_worst_first_and_logs_of_one_name_are_told_apart(self):
        paths = [
            self.csv(f"{name}.csv", {"x": values})
            for name, values in [("a", [1.0, 0.5]), ("b", [3.0, 1.0])]
        ]
        found = mishandle.monitor(
            {"low": "always(x <= 2)", "high": "always(x >= -4)"}, [*paths, paths[0], {"x": [7.0]}]
        )
        # The robustness of each by hand.
        expected = [
            ("log 4", "low", -5.0),
            (str(paths[1]), "low", -1.0),
            (f"{paths[0]} (1)", "low", 1.0),
            (f"{paths[0]} (2)", "low", 1.0),
            (f"{paths[0]} (1)", "high", 4.5),
            (f"{paths[0]} (2)", "high", 4.5),
            (str(paths[1]), "high", 5.0),
            ("log 4", "high", 11.0),
        ]
        self.assertEqual(
            [(each.log, each.name, each.robustness) for each in found.verdicts], expected
        )
        self.assertEqual((found.robustness, found.violated), (-5.0, True))
        # A headline and the head of the table stand before the verdicts.
        lines = [line for line in str(found).splitlines() if line]
        self.assertTrue(lines[0].startswith("FAILS  8 verdicts of 4 logs: 2 violated"), lines[0])
        self.assertEqual((len(lines), lines[2].split()[:3]), (10, ["log", "4", "low"]))
        self.assertEqual(
            list(pandas.DataFrame(found.verdicts)["robustness"]), [value for *_, value in expected]
        )
        same = command("--requirement=low=always(x <= 2)", *map(str, [paths[0], paths[0]]))
        self.assertEqual(
            [each.log for each in same.verdicts], [f"{paths[0]} (1)", f"{paths[0]} (2)"]
        )
        with self.assertRaisesRegex(ValueError, f"trace {paths[0]}: "):
            mishandle.monitor("always(y <= 2)", paths[:1])
        self.assertEqual(len(mishandle.monitor("x <= 2", self.folder.glob("*.csv")).verdicts), 2)
        with self.assertRaisesRegex(ValueError, "there is no log"):
            mishandle.monitor("always(y <= 2)", [])

    def test_episodes_of_a_data_set_are_logs(self):
        self.data_set(lengths=(10, 25, 15))
        formula = "always[0:0.2s](action <= 1.5)"
        for log in (self.folder, mishandle.logs.read_logs(self.folder)):
            found = mishandle.monitor(formula, log)
            rows = [(each.log, each.robustness, each.samples) for each in found.verdicts]
            names = [f"{self.folder} episode {number}" for number in range(3)]
            self.assertEqual(rows, [(names[2], -0.5, 15), (names[1], 0.5, 25), (names[0], 1.5, 10)])
        with self.assertRaisesRegex(ValueError, "has 3 logs; ask mishandle.monitor"):
            mishandle.robustness(formula, self.folder)
        self.assertEqual(
            mishandle.robustness(formula, mishandle.read_log(self.folder, episode=2)), -0.5
        )


class Recordings(Logs):
    def test_a_recording_is_a_log(self):
        rows = [{"q": [0.1 * row], "mode": "run"} for row in range(10)]
        path = self.json_mcap({"/arm/state": rows, "/other": [{"x": 1}] * 10})
        formula = "always(`/arm/state/q[0]` <= 0.45)"
        for log in (path, mishandle.read_log(path), mishandle.read_log(path, ["/arm/state"])):
            plan = {"log": {"time": "log"}} if log is path else {}
            [verdict] = mishandle.monitor(formula, log, plan=plan).verdicts
            self.assertEqual(
                (verdict.log, verdict.origin_ns, verdict.samples), (str(path), START, 10)
            )
            [violation] = verdict.violations
            self.assertEqual((violation.start, violation.end), (0.05, 0.09))
        self.assertAlmostEqual(mishandle.robustness(formula, path), 0.45 - 0.9)
        for log in (path, mishandle.read_log(path)):
            with self.assertRaisesRegex(ValueError, "/arm/state/mode: it is text"):
                mishandle.monitor("`/arm/state/mode` <= 1", log)
            with self.assertRaisesRegex(ValueError, "lacks the signals /leg/q"):
                mishandle.monitor("`/leg/q` <= 1", log)

    def test_a_field_that_a_message_lacks_is_a_missing_value(self):
        path = self.json_mcap({"/arm/state": [{"q": 1.0}, {}, {"q": 3.0}]})
        formula = "always(`/arm/state/q` <= 2)"
        lacks = f'row 2: .* has no number; pass {stated("missing", "hold|drop")}'
        with self.assertRaisesRegex(ValueError, lacks):
            mishandle.monitor(formula, path)
        found = mishandle.monitor(formula, path, plan={"log": {"missing": "hold"}})
        self.assertEqual(found.verdicts[0].missing_values, 1)
