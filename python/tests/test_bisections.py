"""Bisections from Python: the result of the command line, interruptions, and mistakes."""

import json
import pathlib
import shutil
import subprocess
import sys
from typing import Any

from cases import FolderCase
import mishandle
from mishandle import results

ROOT = pathlib.Path(__file__).parents[2]

PLAN: dict[str, Any] = {"target": "point-reaching", "evaluate": {"episodes": 200}}
RATE: dict[str, Any] = {"rate": 0.8, "plan": PLAN}


def command(*words: str) -> subprocess.CompletedProcess[str]:
    program = "import sys; from mishandle.command import main; sys.exit(main())"
    return subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True)


class Bisections(FolderCase):
    def checkpoints(self) -> pathlib.Path:
        """Returns a folder of four controllers: two that are shipped, then two that hardly
        trained."""
        steps = self.folder / "steps"
        steps.mkdir()
        settings = self.folder / "small.toml"
        settings.write_text(
            "rollout_steps = 16\nminibatch_size = 128\nepisodes.environments = 16\n"
            "run.total_steps = 2048\nrun.validation_interval = 4\nrun.validation_episodes = 4\n"
        )
        bad = self.folder / "bad.safetensors"
        trained = command(
            "train", "point-reaching", "--algorithm", "ppo", "--settings", str(settings), "--out",
            str(bad)
        )
        self.assertEqual(trained.returncode, 0, trained.stderr)
        good = ROOT / "controllers" / "point-reaching" / "ppo.safetensors"
        for step in range(1, 5):
            shutil.copy(good if step <= 2 else bad, steps / f"step-{step}.safetensors")
        return steps

    def test_it_is_the_bisection_of_the_command_line(self) -> None:
        steps = self.checkpoints()
        seen: set[str] = set()

        def note(name: str, done: int, most: int) -> None:
            self.assertLessEqual(done, most)
            seen.add(name)

        out = self.folder / "out"
        found = mishandle.bisect(steps, **RATE, out=out, progress=note)
        self.assertEqual(
            (found.last_good, found.first_bad), ("step-2.safetensors", "step-3.safetensors")
        )
        self.assertEqual(len(found.candidates), 4)
        self.assertEqual(seen, {tested.name for tested in found.tested})
        self.assertIn("step-3.safetensors is the first that fails", str(found))

        # The command of the result asks the same question, and its tests are finished.
        self.assertTrue(found.command.startswith("mishandle regress --first-bad "))
        again = command(*found.command.split()[1:], "--json")
        self.assertEqual(again.returncode, 0, again.stderr)
        document = {**json.loads(again.stdout), "shown": str(found)}
        self.assertEqual(results.build(mishandle.ask.Bisection, document), found)

        # The runs are files as any other, and the page compares those of the neighbors.
        good, bad = (
            tested.run for tested in found.tested
            if tested.name in (found.last_good, found.first_bad)
        )
        assert good is not None and bad is not None
        self.assertGreater(mishandle.compare(good, bad).success.first_only, 0)
        found.report(self.folder / "page.html", plan={"report": {"simulations": False}})
        page = (self.folder / "page.html").read_text()
        self.assertIn("step-4.safetensors: fails", page)
        self.assertIn("Paired differences", page)

        every = {**PLAN, "regress": {"every": True}}
        whole = mishandle.bisect(steps, rate=0.8, plan=every, out=out)
        self.assertEqual((len(whole.tested), whole.is_monotone), (4, True))

    def test_exceptions_of_progress_end_it(self) -> None:
        steps = self.checkpoints()

        def stop(name: str, done: int, most: int) -> None:
            raise RuntimeError("enough")

        with self.assertRaisesRegex(RuntimeError, "enough"):
            mishandle.bisect(steps, **RATE, out=self.folder / "out", progress=stop)
        self.assertTrue(mishandle.bisect(steps, **RATE, out=self.folder / "out").found)

    def test_mistakes_are_errors(self) -> None:
        empty = self.folder / "-empty"
        empty.mkdir()

        def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
            return {"gap": [1.0, scenario["x"]]}

        cases: list[tuple[str, dict[str, Any]]] = [
            ("has 0 controllers", RATE),
            ("give a test: `counterexamples` or `rate`", {}),
            ("a number between 0 and 1", {**RATE, "rate": 1.5}),
            ("is a test of its own", {**RATE, "counterexamples": "failures"}),
            ("`rate` needs a target", {"rate": 0.5}),
            ("is a function; expected", {**RATE, "plan": {"target": system}}),
            ("has no effect on this question", {"rate": 0.5, "plan": {"regress": {"mode": 2}}}),
        ]
        for message, arguments in cases:
            with self.subTest(message), self.assertRaisesRegex(mishandle.MishandleError, message):
                mishandle.bisect(empty, **arguments, out=self.folder / "out")
        self.assertFalse((self.folder / "out").exists())
