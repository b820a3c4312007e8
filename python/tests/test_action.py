"""The commands of the GitHub action, as they are in its file."""

import os
import pathlib
import re
import subprocess
import sys
from typing import Any

from cases import FolderCase
import yaml  # type: ignore[import-untyped, unused-ignore]

ROOT = pathlib.Path(__file__).resolve().parents[2]


class ActionTests(FolderCase):
    def setUp(self) -> None:
        super().setUp()
        with open(ROOT / "action.yml", encoding="utf-8") as file:
            self.action: dict[str, Any] = yaml.safe_load(file)

    def run_action(self, **given: str) -> tuple[int, str]:
        """Runs the steps as a runner does: in order, until one fails. Returns the exit code and the
        output."""
        inputs = {name: str(details["default"]) for name, details in self.action["inputs"].items()}
        self.assertLessEqual(set(given), set(inputs))
        inputs.update(given)
        # There is nothing to install: the test runs in an environment with the package.
        inputs["package"] = "pip"

        def filled(text: str) -> str:
            found = re.fullmatch(r"\$\{\{ inputs\.(\w+) \}\}", text)
            if found is not None:
                return inputs[found[1]]
            return {"${{ github.action_path }}": str(ROOT)}[text]

        output = ""
        for step in self.action["runs"]["steps"]:
            if "uses" in step:
                self.assertRegex(step["uses"], r"^[\w/-]+@v\d+\.\d+\.\d+$")
                continue
            condition = re.fullmatch(r"\$\{\{ inputs\.(\w+) != '(\w*)' \}\}", step.get("if", ""))
            if condition is not None and inputs[condition[1]] == condition[2]:
                continue
            self.assertTrue(condition is not None or "if" not in step)
            environment = {name: filled(value) for name, value in step.get("env", {}).items()}
            path = os.pathsep.join([str(pathlib.Path(sys.executable).parent), os.environ["PATH"]])
            summary = str(self.folder / "summary.md")
            done = subprocess.run(
                ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]],
                cwd=self.folder,
                env={**os.environ, "PATH": path, "GITHUB_STEP_SUMMARY": summary, **environment},
                capture_output=True, text=True, check=False
            )
            output += done.stdout + done.stderr
            if done.returncode != 0:
                return done.returncode, output
        return 0, output

    def mishandle(self, *words: str) -> None:
        program = pathlib.Path(sys.executable).parent / "mishandle"
        subprocess.run([program, *words], cwd=self.folder, capture_output=True, check=False)

    def test_all_parts_run_before_the_worst_one_decides(self) -> None:
        self.mishandle(
            "falsify", "point-reaching", "--controller", "sac", "--space", "starts+delay+sensing",
            "--formula", "always[60:300](finger_target_distance <= 0.001)", "--trials", "1",
            "--budget", "20", "--out", "run.sqlite"
        )
        self.mishandle("regress", "failures", "--add", "run.sqlite", "-k", "regress.all=true")
        (self.folder / "requirements.toml").write_text(
            '[[requirement]]\nname = "R-1"\nformula = "always(tool_speed <= 100)"\n'
        )
        code, output = self.run_action(
            controller="ppo", baseline="ppo", counterexamples="failures", target="point-reaching",
            compare="5", requirements="requirements.toml", budget="10"
        )
        # The same controller has no new failure.
        self.assertEqual(code, 0, output)
        results = self.folder / "mishandle-results"
        self.assertEqual(
            (results / "status").read_text().split(), ["regress", "0", "compare", "0", "check", "0"]
        )
        for name in ("regress.xml", "compare.html", "check/junit.xml", "check/report.html"):
            self.assertTrue((results / name).is_file(), name)
        self.assertIn("R-1", (self.folder / "summary.md").read_text())
        code, output = self.run_action(controller="ppo", counterexamples="failures")
        self.assertEqual(code, 1, output)

    def test_a_violated_requirement_and_one_that_cannot_be_checked(self) -> None:
        file = self.folder / "requirements.toml"
        for formula, expected in [
            ("always(tool_speed <= 0)", 1), ("always(no_such_signal <= 0)", 2)
        ]:
            file.write_text(f'[[requirement]]\nname = "R-1"\nformula = "{formula}"\n')
            code, output = self.run_action(
                controller="ppo", target="point-reaching", requirements="requirements.toml",
                budget="5", folder=f"out-{expected}"
            )
            self.assertEqual(code, expected, output)

    def test_an_action_without_a_task_is_an_error(self) -> None:
        code, output = self.run_action()
        self.assertEqual(code, 2)
        self.assertIn("nothing was tested", output)
