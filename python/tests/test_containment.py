"""Tests of models that would end the process of the interpreter."""

import pathlib
import subprocess
import sys
import textwrap

from cases import FolderCase

MODEL = """<mujoco><size memory="{memory}"/><worldbody>
<body name="arm"><joint name="hinge" axis="0 1 0"/><geom size="0.1" pos="0 0 0.4"/></body>
</worldbody><actuator><motor joint="hinge"/></actuator></mujoco>"""

TARGET = """
format = 1
name = "pendulum"
model.file = "pendulum.xml"
control = { period = 0.01, steps = 20 }
start = { hinge = "angle" }
observation = { angle = "qpos('hinge')" }
policy = { expression = "-angle", actions = 1, action = "action" }
signals = { angle = { value = "qpos('hinge')[0]", unit = "rad" } }
axes = { angle = { range = [-0.1, 0.2], unit = "rad" } }
formulas = { near = "always(angle <= 1)" }
"""


def evaluated(folder: pathlib.Path, memory: str) -> subprocess.CompletedProcess[str]:
    (folder / "pendulum.xml").write_text(MODEL.format(memory=memory))
    (folder / "pendulum.toml").write_text(textwrap.dedent(TARGET))
    # A file with the name of a library in the working directory must not run.
    (folder / "sys.py").write_text("raise SystemExit(9)")
    (folder / "mishandle.py").write_text("raise SystemExit(9)")
    code = (
        "import sys; sys.path.pop(0); import mishandle; from mishandle._native import run_command; "
    )
    code += "sys.exit(run_command(['mishandle', 'evaluate', 'pendulum.toml', '--episodes', '2']))"
    return subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False,
        timeout=300
    )


class ContainmentTest(FolderCase):
    def test_a_model_is_tried_by_a_process_of_this_interpreter(self) -> None:
        found = evaluated(self.folder, "1M")
        self.assertEqual(found.returncode, 0, found.stderr)

    def test_a_model_that_takes_all_memory_is_an_error(self) -> None:
        found = evaluated(self.folder, "2G")
        self.assertEqual(found.returncode, 2, found.stderr)
        self.assertIn("it has 2048 MiB", found.stderr)
