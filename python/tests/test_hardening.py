"""Hardening from Python: the result of the command line, interruptions, and mistakes."""

import dataclasses
import hashlib
import json
import os
import pathlib
import shlex
import signal
import subprocess
import sys
from typing import Any

from cases import FolderCase, take_interrupts
import mishandle
from mishandle import _native, results
from mishandle.errors import InvalidTypeError, InvalidValueError

ROOT = pathlib.Path(__file__).parents[2]

ARGUMENTS: dict[str, Any] = {
    "space": "starts+delay",
    "policy": "ppo",
    "axes": {"action_delay": (1, 3)},
    "rounds": 1,
    "steps": 256,
    "budget": 8,
    "episodes": 4,
    "seed": 5,
}

PLAN = {"searches": ["random"], "validation": 4, "risk": 100, "margin": 10}


def settings(folder: pathlib.Path) -> str:
    """Returns a file of training settings with which an iteration takes few steps."""
    file = folder / "settings.toml"
    file.write_text(
        'rollout_steps = 8\n[episodes]\nenvironments = 16\n[policy]\nhidden = [64, 64]\n'
        'activation = "elu"\n'
        "[run]\nvalidation_episodes = 2\nvalidation_interval = 2\n"
    )
    return str(file)


def without_paths(found: results.Hardening) -> dict[str, Any]:
    after = None if found.after is None else ""
    return dataclasses.asdict(dataclasses.replace(found, folder="", after=after))


class Hardenings(FolderCase):
    def harden(
        self, name: str, plan: dict[str, Any] | None = None, **arguments: Any
    ) -> mishandle.ask.Hardening:
        given = {**ARGUMENTS, "settings": settings(self.folder), **arguments}
        given["plan"] = {"harden": {**PLAN, **(plan or {})}}
        return mishandle.harden("point-reaching", out=self.folder / name, **given)

    def test_it_is_the_hardening_of_the_command_line_also_in_parts(self) -> None:
        phases: list[str] = []

        def note(phase: str, done: int, total: int) -> None:
            self.assertLessEqual(done, total)
            if phase not in phases:
                phases.append(phase)

        whole = self.harden("whole.safetensors", progress=note)
        self.assertEqual(
            (whole.target, whole.before, whole.path),
            ("point-reaching", "ppo", self.folder / "whole.harden")
        )
        self.assertGreater(whole.rounds[0].failures, 0)
        self.assertEqual((self.folder / "whole.safetensors").exists(), whole.after is not None)
        for part in (
            "round 0: validation", "round 1: search", "round 1: training", "final, before"
        ):
            self.assertTrue(any(phase.startswith(part) for phase in phases), phases)

        plan = self.folder / "plan.toml"
        plan.write_text((whole.path / "harden.toml").read_text())
        command = [
            "import sys; from mishandle.command import main; sys.exit(main())", "harden", "--plan",
            str(plan), "--json"
        ]
        command += ["--out", str(self.folder / "command.safetensors")]
        done = subprocess.run([sys.executable, "-c", *command], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0 if whole.after else 1, done.stderr)
        self.assertEqual(
            without_paths(results.build(results.Hardening, json.loads(done.stdout))),
            without_paths(whole)
        )

        # A third one is interrupted by Ctrl-C and by exceptions in each phase.
        take_interrupts(self)
        stopped: list[str] = []

        def stop(phase: str, done: int, total: int) -> None:
            if phase not in stopped:
                stopped.append(phase)
                if len(stopped) % 2 == 0:
                    raise RuntimeError("enough")
                os.kill(os.getpid(), signal.SIGINT)

        found, calls = None, 0
        while found is None:
            try:
                found = self.harden("parts.safetensors", resume=calls > 0, progress=stop)
            except (KeyboardInterrupt, RuntimeError):
                calls += 1
        self.assertGreater(calls, 5)
        self.assertEqual(without_paths(found), without_paths(whole))

        # A finished one is read again.
        self.assertEqual(self.harden("whole.safetensors", resume=True), whole)
        whole.report(self.folder / "page.html", plan={"report": {"simulations": False}})
        self.assertIn(whole.verdict.split(":")[0], (self.folder / "page.html").read_text())
        with self.assertRaisesRegex(mishandle.MishandleError, "seed: recorded 5, given 6"):
            self.harden("whole.safetensors", resume=True, seed=6)
        with self.assertRaisesRegex(mishandle.MishandleError, "harden.budget: recorded 8, given 9"):
            self.harden("whole.safetensors", resume=True, budget=9)
        with self.assertRaisesRegex(
            mishandle.MishandleError, "whole.harden exists already; choose another `out`"
        ):
            self.harden("whole.safetensors")

    def test_mistakes_are_errors_before_anything_is_written(self) -> None:
        def system(scenario: dict[str, Any]) -> dict[str, list[float]]:
            return {"gap": [1.0, scenario["x"]]}

        out = self.folder / "out.safetensors"
        with self.assertRaisesRegex(
            InvalidTypeError, "function is not the name of a task.*mishandle.ScenarioEnv"
        ):
            mishandle.harden(system, policy="ppo", out=out)  # type: ignore[arg-type]
        with self.assertRaisesRegex(InvalidTypeError, "not a function; write a network"):
            mishandle.harden("point-reaching", policy=system, out=out)
        for message, arguments in [
            ("trains one of our controllers, by name or path, not a NoneType", {"policy": None}),
            ("one of the task, by name", {"space": [mishandle.Axis("x", 0, 1)]}),
            ("no space `delays`", {"space": "delays"}),
            ("the expert", {"policy": "expert"}),
            ("budget is 0", {"budget": 0}),
            ("harden.archive is 0.9", {"plan": {"archive": 0.9}}),
            ('"nominal"\\] is "half"', {"plan": {"nominal": "half"}}),
            ('"searches"\\] is "random"', {"plan": {"searches": "random"}}),
            ("no search `bayes`", {"plan": {"searches": ["bayes"]}}),
            ("no measure `space`", {"plan": {"allow": ["space"]}}),
            ("no device `tpu`", {"plan": {"device": "tpu"}}),
            ("missing.toml", {"settings": "missing.toml"}),
            ("axes is 3", {"axes": 3}),
        ]:
            with self.subTest(message), self.assertRaisesRegex(mishandle.MishandleError, message):
                self.harden("out.safetensors", **arguments)
        with self.assertRaisesRegex(InvalidValueError, "toy/sphere-2d"):
            mishandle.harden("toy/sphere-2d", policy="ppo", out=out)
        with self.assertRaisesRegex(mishandle.MishandleError, "ends in .safetensors"):
            self.harden("out.onnx")
        with self.assertRaisesRegex(
            mishandle.MishandleError, "there is no hardening in .*out.harden to continue"
        ):
            self.harden("out.safetensors", resume=True)
        self.assertEqual(sorted(each.name for each in self.folder.iterdir()), ["settings.toml"])

    def test_a_trainer_of_the_user_trains_and_is_called_again_after_a_failure(self) -> None:
        other = ROOT / "controllers" / "point-reaching" / "ppo-2.safetensors"
        script = self.folder / "my trainer.py"
        script.write_text(
            "import pathlib, shutil, sys\n"
            "ready = pathlib.Path(sys.argv[1])\n"
            "print('begins', flush=True)\n"
            "if not ready.exists():\n"
            "    ready.touch()\n"
            "    sys.exit(4)\n"
            "shutil.copy(sys.argv[2], sys.argv[sys.argv.index('--out') + 1])\n"
        )
        trainer = shlex.join([sys.executable, str(script), str(self.folder / "ready"), str(other)])
        with self.assertRaisesRegex(mishandle.MishandleError, "failed with exit code 4.*begins"):
            self.harden("out.safetensors", settings=None, trainer=trainer)
        found = self.harden("out.safetensors", settings=None, trainer=trainer, resume=True)
        self.assertEqual(found.trainer, trainer)
        digest = hashlib.sha256(other.read_bytes()).hexdigest()
        self.assertTrue(digest.startswith(found.rounds[0].file_hash or "none"), found.rounds)
        with self.assertRaisesRegex(mishandle.MishandleError, "harden.settings is .*trainer"):
            self.harden("second.safetensors", trainer=trainer)
        with self.assertRaisesRegex(InvalidValueError, "trainer is .*it must be a string"):
            self.harden("second.safetensors", settings=None, trainer=[trainer])

    def test_the_plan_of_a_run_says_whether_it_is_a_hardening(self) -> None:
        for table in ("harden", "evaluate"):
            text = f'target = "point-reaching"\ncontroller = "ppo"\n[{table}]\n'
            folder = str(self.folder / table)
            created = _native.create_campaign(text, folder)
            self.assertEqual([is_hardening for _, _, is_hardening in created], [table == "harden"])
            self.assertEqual(_native.campaign_runs(folder), created)
