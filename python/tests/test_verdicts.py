"""What an answer means, as Python prints it: the lines of the terminal, with calls for commands."""

import pathlib
import pickle
import subprocess
import sys
import tempfile
import unittest

import mishandle


def falsified(out: pathlib.Path) -> mishandle.ask.Falsification:
    return mishandle.falsify(
        "ball-balancing", None, "delay", policy="ppo", trials=1, budget=10, seed=1, out=out,
        plan={"falsify": {"batch": 64}},
    )


def cause(text: str) -> str:
    """Returns the lines from `cause` to the one before `sure`, on one line."""
    return " ".join(text[text.index("\ncause "):text.index("\nsure ")].split())


class Verdicts(unittest.TestCase):
    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def test_the_text_is_that_of_the_terminal(self) -> None:
        tmp_path = self.folder
        found = falsified(tmp_path / "a.sqlite")
        text = str(found)
        assert text.startswith("FAILS ")
        # A call is one line, to copy.
        lines = [line for line in text.splitlines() if not line.startswith("fix")]
        assert all(len(line) <= 80 for line in lines)
        arguments = [
            "falsify", "ball-balancing", "--controller", "ppo", "--space", "delay", "--trials", "1",
            "--budget", "10", "--seed", "1", "--out", str(tmp_path / "b.sqlite")
        ]
        program = "import sys; from mishandle.command import main; sys.exit(main())"
        run = subprocess.run(
            [sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False
        )
        assert run.returncode == 1, run.stderr
        assert cause(text) == cause(run.stdout)
        named = found.trials[0].cause
        assert named is not None
        assert all(f"{axis} = {named.scenario[axis]:.0f} " in cause(text) for axis in named.axes)
        assert 'result.export("regressions")' in text

    def test_repr_is_one_line_and_a_copy_says_the_same(self) -> None:
        tmp_path = self.folder
        found = falsified(tmp_path / "a.sqlite")
        assert "\n" not in repr(found) and "FAILS" in repr(found)
        assert str(pickle.loads(pickle.dumps(found))) == str(found)
