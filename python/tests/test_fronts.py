"""The same question on the command line, in a plan, in a campaign, on a Ray cluster and in Python:
rows and results to the bit."""

import dataclasses
import importlib.util
import json
import os
import pathlib
import re
import sqlite3
import subprocess
import sys
import tempfile
import unittest
from collections.abc import Callable
from typing import Any

from cases import FolderCase
import mishandle
from mishandle import results

COMMAND = pathlib.Path(sys.executable).with_name("mishandle")

RANDOM = ["--search", "random", "--trials", "2", "--budget", "40", "--seed", "3"]
RANDOM_PLAN = 'search = "random"\ntrials = 2\nbudget = 40\nisolate = true'
CAR = ["toy/car-following", "--space", "dynamics+events"]


@dataclasses.dataclass(frozen=True)
class Question:
    """A question that writes a run file, as arguments, as a plan and as a call."""

    kind: type[Any]
    arguments: list[str]
    plan: str
    ask: Callable[[pathlib.Path], Any]


def falsify(
    out: pathlib.Path, system: str, repeats: int = 100, keep_going: bool = False,
    smooth_region: bool = False, **options: Any
) -> mishandle.ask.Falsification:
    table = {"batch": 64, "keep_going": keep_going, "isolate": True}
    report = {"repeats": repeats, "smooth_region": smooth_region}
    return mishandle.falsify(
        system, search="random", trials=2, budget=40, seed=3, out=out,
        plan={"falsify": table, "report": report}, **options
    )


QUESTIONS = {
    "evaluate a toy": Question(
        results.Evaluation,
        ["evaluate", "toy/noisy", "--episodes", "50", "--seed", "3"],
        'target = "toy/noisy"\nseed = 3\n[evaluate]\nepisodes = 50',
        lambda out: mishandle.evaluate("toy/noisy", episodes=50, seed=3, out=out),
    ),
    "evaluate a task": Question(
        results.Evaluation,
        [
            "evaluate", "point-reaching", "--controller", "ppo", "--space", "starts+sensing",
            "--episodes", "10", "--seed", "3"
        ],
        'target = "point-reaching"\ncontroller = "ppo"\nspace = "starts+sensing"\nseed = 3\n'
        '[evaluate]\nepisodes = 10',
        lambda out: mishandle.evaluate(
            "point-reaching", None, "starts+sensing", policy="ppo", episodes=10, seed=3, out=out
        ),
    ),
    "falsify a random toy": Question(
        results.Falsification,
        ["falsify", "toy/noisy", *RANDOM, "-k", "report.repeats=10"],
        f'target = "toy/noisy"\nseed = 3\n[falsify]\n{RANDOM_PLAN}',
        lambda out: falsify(out, "toy/noisy", repeats=10),
    ),
    "falsify a safe toy": Question(
        results.Falsification,
        [
            "falsify", "toy/sphere-2d", *RANDOM, "--formula", "always(distance >= -1)", "-k",
            "report.smooth-region=true"
        ],
        'target = "toy/sphere-2d"\nseed = 3\n[falsify]\nformula = "always(distance >= -1)"\n'
        f'{RANDOM_PLAN}',
        lambda out: falsify(
            out, "toy/sphere-2d", formula="always(distance >= -1)", smooth_region=True
        ),
    ),
    "falsify and keep going": Question(
        results.Falsification,
        [
            "falsify", "toy/pits", *RANDOM, "-k", "falsify.keep-going=true", "-k",
            "falsify.isolate=true"
        ],
        f'target = "toy/pits"\nseed = 3\n[falsify]\nkeep-going = true\n{RANDOM_PLAN}',
        lambda out: falsify(out, "toy/pits", keep_going=True),
    ),
    "falsify a task": Question(
        results.Falsification,
        [
            "falsify", "point-reaching", "--controller", "ppo", "--formula", "strict", "--space",
            "starts+sensing", *RANDOM
        ],
        'target = "point-reaching"\ncontroller = "ppo"\nspace = "starts+sensing"\nseed = 3\n'
        f'[falsify]\nformula = "strict"\n{RANDOM_PLAN}',
        lambda out: falsify(
            out, "point-reaching", formula="strict", space="starts+sensing", policy="ppo"
        ),
    ),
    "falsify a task with noise": Question(
        results.Falsification,
        [
            "falsify", "ball-balancing", "--controller", "ppo", "--action-noise", "0.5", *RANDOM,
            "-k", "report.repeats=10"
        ],
        'target = "ball-balancing"\ncontroller = "ppo"\naction-noise = 0.5\nseed = 3\n'
        f'[falsify]\n{RANDOM_PLAN}',
        lambda out: falsify(out, "ball-balancing", policy="ppo", action_noise=0.5, repeats=10),
    ),
    "margin of a toy": Question(
        results.Margin,
        ["margin", *CAR, "--budget", "300", "--seed", "3"],
        'target = "toy/car-following"\nspace = "dynamics+events"\nseed = 3\n[margin]\nbudget = 300',
        lambda out: mishandle.margin(
            "toy/car-following", space="dynamics+events", budget=300, seed=3, out=out
        ),
    ),
    "margin of a task": Question(
        results.Margin,
        ["margin", "ball-balancing", "--controller", "td3", "--budget", "40"],
        'target = "ball-balancing"\ncontroller = "td3"\nspace = "disturbance"\n'
        '[margin]\nbudget = 40',
        lambda out: mishandle.margin("ball-balancing", policy="td3", budget=40, out=out),
    ),
    "risk of a toy by splitting": Question(
        results.Risk,
        [
            "risk", "toy/hidden-corner", "--simulations", "20000", "-k", "risk.method=splitting",
            "--seed", "4"
        ],
        'target = "toy/hidden-corner"\nseed = 4\n[risk]\nsimulations = 20000\nmethod = "splitting"',
        lambda out: mishandle.risk(
            "toy/hidden-corner", simulations=20000, seed=4, out=out,
            plan={"risk": {"method": "splitting"}}
        ),
    ),
    "risk of a toy with a distribution": Question(
        results.Risk,
        [
            "risk", "toy/sphere-2d", "--simulations", "5000", "-k",
            "risk.distributions.y=normal:-0.4:0.05"
        ],
        'target = "toy/sphere-2d"\n[risk]\nsimulations = 5000\n[risk.distributions]\n'
        'y = "normal:-0.4:0.05"',
        lambda out: mishandle.risk(
            "toy/sphere-2d", simulations=5000, out=out,
            plan={"risk": {"distributions": {"y": "normal:-0.4:0.05"}}}
        ),
    ),
    "risk of a task": Question(
        results.Risk,
        ["risk", "ball-balancing", "--controller", "ppo", "--simulations", "100"],
        'target = "ball-balancing"\ncontroller = "ppo"\n[risk]\nsimulations = 100',
        lambda out: mishandle.risk(
            "ball-balancing", space="starts", policy="ppo", simulations=100, out=out
        ),
    ),
}


def tables(path: pathlib.Path) -> dict[str, list[tuple[Any, ...]]]:
    """Returns all rows of a run file, without the order in which they were written and the commit
    of the build."""
    with sqlite3.connect(path) as file:
        names = [
            name for (name,) in file.execute("select name from sqlite_master where type = 'table'")
        ]
        rows = {name: sorted(file.execute(f"select * from {name}"), key=repr) for name in names}
    rows["header"] = [row for row in rows["header"] if row[0] not in ("git_commit", "header_hash")]
    return rows


def rows(path: pathlib.Path) -> dict[str, list[tuple[Any, ...]]]:
    """Returns ``tables`` without what follows a search: a campaign simulates nothing besides its
    runs."""
    return {name: found for name, found in tables(path).items() if name != "finding"}


def bits(kind: type[Any], found: Any) -> dict[str, str]:
    """Returns the fields of a result or a document, except for the paths of runs. The texts have
    all digits and the signs of zeros."""
    built = results.build(kind, found) if isinstance(found, dict) else found
    names = [field.name for field in dataclasses.fields(kind) if field.name != "run"]
    return {name: repr(plain(getattr(built, name))) for name in names}


def plain(value: Any) -> Any:
    """Returns a value as tuples and dictionaries."""
    if dataclasses.is_dataclass(value):
        return {
            field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)
        }
    return tuple(plain(item) for item in value) if isinstance(value, tuple) else value


class Fronts(FolderCase):
    answers: dict[str, Any] = {}
    """Answers in Python by question, each with its run file: simulations of tasks take most of the
    time of these tests."""

    @classmethod
    def setUpClass(cls) -> None:
        cls.runs = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))

    @classmethod
    def answer(cls, name: str) -> Any:
        """Returns the answer to a question in Python."""
        if name not in cls.answers:
            cls.answers[name] = QUESTIONS[name].ask(cls.runs / str(len(cls.answers)))
        return cls.answers[name]

    def command(self, *arguments: Any) -> dict[str, Any]:
        """Returns the document that the command prints."""
        words = [str(argument) for argument in arguments]
        done = subprocess.run(
            [COMMAND, *words, "--json"], capture_output=True, text=True, cwd=self.folder,
            check=False
        )
        self.assertIn(done.returncode, (0, 1), done.stderr)
        document: dict[str, Any] = json.loads(done.stdout)
        return document

    def plan(self, question: Question) -> str:
        path = self.folder / "plan.toml"
        path.write_text(question.plan)
        return str(path)

    def test_every_question_has_the_same_rows_and_the_same_result(self) -> None:
        for number, (name, question) in enumerate(QUESTIONS.items()):
            with self.subTest(name):
                flags, plan = (self.folder / f"{number}-{front}" for front in ("flags", "plan"))
                expected = bits(question.kind, self.command(*question.arguments, "--out", flags))
                # No question contains what its answer simulates besides.
                settings = [key for key in question.arguments if key.startswith("report.")]
                planned = self.command(
                    question.arguments[0], "--plan", self.plan(question), "--out", plan,
                    *(part for key in settings for part in ("-k", key))
                )
                self.assertEqual(bits(question.kind, planned), expected)
                found = self.answer(name)
                self.assertEqual(bits(question.kind, found), expected)
                self.assertEqual(found.path.parent, self.runs)
                for path in (plan, found.path):
                    self.assertEqual(tables(path), tables(flags))
        # The questions have something to compare.
        answers = self.answers
        trials = answers["falsify a random toy"].trials
        self.assertEqual(
            [trial.repeats.simulations for trial in trials if trial.falsified], [10, 10]
        )
        self.assertGreater(answers["falsify a safe toy"].smooth_region.slope, 0)
        self.assertGreater(len(answers["falsify and keep going"].modes), 1)
        self.assertTrue(any(trial.repeats for trial in answers["falsify a task"].trials))
        self.assertIsNotNone(answers["margin of a toy"].witness)
        self.assertIsNotNone(answers["risk of a toy by splitting"].splitting)

    def test_a_run_of_a_campaign_has_the_same_rows_and_the_same_result(self) -> None:
        for number, (name, question) in enumerate(QUESTIONS.items()):
            with self.subTest(name):
                answer, folder = self.answer(name), self.folder / f"{number}-campaign"
                expected = plain(answer)
                seed = (re.findall(r"seed = (\d+)", question.plan) or ["0"])[0]
                seeds = ["-k", f"seed=[{seed}]"]
                [run] = self.command("run", self.plan(question), *seeds, "--out", folder)["runs"]
                [file] = folder.glob("*.sqlite")
                self.assertEqual(tables(file), rows(answer.path))
                found = plain(results.build(question.kind, run["result"]))
                # An answer in Python has fields that no document has.
                compared = {
                    field.name for field in dataclasses.fields(question.kind)
                    if question.kind is not results.Falsification or field.default is not None
                } - {"run", "smooth_region"}
                trials = zip(expected.get("trials", ()), found.get("trials", ()))
                for trial, of_campaign in trials:
                    # The checks of the physics move a cause back.
                    if trial["physics"] is not None:
                        trial["cause"] = of_campaign["cause"] = None
                    trial["repeats"] = trial["physics"] = None
                for key in compared:
                    self.assertEqual(repr(found[key]), repr(expected[key]), key)

    @unittest.skipUnless(importlib.util.find_spec("ray"), "the package ray is not installed")
    def test_a_ray_cluster_has_the_same_rows(self) -> None:
        for number, name in enumerate(["evaluate a task", "falsify a random toy"]):
            question = QUESTIONS[name]
            with self.subTest(name):
                folder = self.folder / f"{number}-ray"
                command = [
                    sys.executable, "-m", "mishandle.cluster", self.plan(question), "--out", folder
                ]
                environment = {**os.environ, "RAY_AUTH_MODE": "disabled"}
                done = subprocess.run(
                    command, capture_output=True, text=True, cwd=self.folder, env=environment,
                    check=False
                )
                self.assertEqual(done.returncode, 0, done.stderr)
                [file] = folder.glob("*.sqlite")
                self.assertEqual(tables(file), rows(self.answer(name).path))

    def test_a_simulation_is_the_same(self) -> None:
        for name, arguments, options in [
            ("toy/noisy", ["--at", "0.7"], {"at": [0.7]}),
            (
                "point-reaching", ["--controller", "ppo", "--space", "starts"],
                {"policy": "ppo", "space": "starts"}
            ),
        ]:
            with self.subTest(name):
                expected = self.command("simulate", name, *arguments, "--seed", "5")
                [found] = mishandle.simulate(name, seed=5, **options)  # type: ignore[arg-type]
                self.assertEqual(
                    bits(results.Simulation, found.document), bits(results.Simulation, expected)
                )
                self.assertEqual(found.robustness, expected["robustness"])

    def test_repeats_of_a_scenario_are_the_same(self) -> None:
        for name, arguments, options in [
            ("toy/noisy", ["--at", "0.7"], {"at": [0.7]}),
            (
                "point-reaching",
                ["--controller", "ppo", "--space", "starts+sensing", "--at", "noise_target=0.005"],
                {"policy": "ppo", "space": "starts+sensing", "at": {"noise_target": 0.005}},
            ),
            ("toy/sphere-2d", ["--at", "0.3,-0.4"], {"at": [0.3, -0.4]}),
        ]:
            with self.subTest(name):
                counts = ["--repeat", "25", "-k", "simulate.scenarios=3", "--seed", "5"]
                expected = self.command("simulate", name, *arguments, *counts)
                found = mishandle.repeat(
                    name, repeats=25, seed=5, plan={"simulate": {"scenarios": 3}},
                    **options  # type: ignore[arg-type]
                )
                self.assertEqual(
                    bits(results.Simulation, found), bits(results.Simulation, expected)
                )
        assert found.repeats is not None
        self.assertEqual(found.repeats.simulations, 1)
        # The simulations themselves have the same seeds.
        several = mishandle.simulate("toy/noisy", at=[0.7], repeat=25, seed=5)
        repeated = mishandle.repeat(
            "toy/noisy", at=[0.7], repeats=25, seed=5, plan={"simulate": {"scenarios": 0}}
        ).repeats
        assert repeated is not None and repeated.quantiles is not None
        values = sorted(found.robustness or 0.0 for found in several)
        self.assertEqual(
            (repeated.quantiles[0].robustness, repeated.quantiles[-1].robustness),
            (values[0], values[-1])
        )

    def test_the_default_numbers_of_repeats_are_the_same(self) -> None:
        expected = self.command("simulate", "toy/noisy", "--repeat", "100")
        self.assertEqual(
            bits(results.Simulation, mishandle.repeat("toy/noisy")),
            bits(results.Simulation, expected)
        )

    def test_an_explanation_is_the_same(self) -> None:
        found = self.answer("falsify a task")
        shown = self.command("show", found.path, "--simulation", "first")
        expected = results.build(results.Explanation, shown)
        self.assertEqual(repr(plain(found.explain())), repr(plain(expected)))

    def test_a_replay_is_the_same(self) -> None:
        options: dict[str, Any] = {"formula": "strict", "space": "starts+sensing", "policy": "ppo"}
        found = self.answer("falsify a task")
        [file, *_] = found.export(self.folder / "suite").paths
        for path in (found.path, file):
            expected = results.build(results.Replay, self.command("replay", path))
            again = mishandle.replay(path, "point-reaching", **options)
            self.assertEqual(
                repr(plain(results.Replay(**{key: getattr(again, key) for key in vars(expected)}))),
                repr(plain(expected))
            )
            self.assertTrue(again.same)

    def test_a_comparison_is_the_same(self) -> None:
        paths = [self.folder / "ppo", self.folder / "sac"]
        for path in paths:
            mishandle.evaluate(
                "point-reaching", None, "starts+sensing", policy=path.name, episodes=10, out=path
            )
        expected = self.command("compare", *paths)
        found = mishandle.compare(*paths)
        self.assertEqual(bits(results.Comparison, found), bits(results.Comparison, expected))
        self.assertEqual(found.paths, tuple(paths))

    def test_failure_modes_exports_and_regressions_are_the_same(self) -> None:
        for name, options in [
            ("toy/pits", {"keep_going": True}),
            ("toy/noisy", {}),
            ("point-reaching", {"formula": "strict", "space": "starts+sensing", "policy": "ppo"}),
        ]:
            with self.subTest(name):
                out = self.folder / name.replace("/", "-")
                found = falsify(out, name, **options)
                shown = results.build(results.RunShown, self.command("show", out))
                modes = shown.counterexamples.modes
                self.assertEqual(repr(mishandle.open_run(out).failure_modes()), repr(modes))
                for minimize in ([], ["-k", "regress.minimize=true"]):
                    folders = [
                        self.folder / f"{out.name}-{front}-{len(minimize)}"
                        for front in ("command", "python")
                    ]
                    expected = self.command(
                        "regress", folders[0], "--add", out, "-k", "regress.all=true", *minimize
                    )
                    exported = found.export(
                        folders[1], plan={"regress": {"minimize": bool(minimize)}}
                    )
                    texts = [
                        repr(plain(result)).replace(str(folder), "")
                        for result, folder in zip(
                            (results.build(results.Exports, expected), exported), folders
                        )
                    ]
                    self.assertEqual(texts[0], texts[1])
                    files = [
                        {path.name: path.read_bytes() for path in folder.iterdir()}
                        for folder in folders
                    ]
                    self.assertEqual(files[0], files[1])
                    self.assertEqual(sorted(files[1]), sorted(path.name for path in exported.paths))
                target = {key: value for key, value in options.items() if key != "keep_going"}
                for repeats in (0, 20):
                    counts = (
                        ["--repeat", repeats, "-k", "regress.max-failure-rate=0.1"]
                        if repeats > 0 else []
                    )
                    again = self.command("regress", folders[1], *counts)
                    rate = 0.1 if repeats > 0 else 0.0
                    tested = mishandle.regress(
                        folders[1], name, repeats=repeats,
                        plan={"regress": {"max_failure_rate": rate}}, **target
                    )
                    self.assertEqual(
                        bits(results.Regression, tested), bits(results.Regression, again)
                    )
