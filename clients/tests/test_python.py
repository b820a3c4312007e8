"""The client in Python."""

import ast
import subprocess
import sys
import textwrap
import unittest

from contract import HERE, PYTHON_CART, PYTHON_TANK, Cart, Tank
from peer import Peer


class PythonTank(Tank, unittest.TestCase):
    command, folder = PYTHON_TANK, HERE / "python"


class PythonCart(Cart, unittest.TestCase):
    command, folder, target = PYTHON_CART, HERE / "python", ["cart.toml"]


class Python(unittest.TestCase):
    """The client in Python with code that breaks things."""

    def ask(self, body, kind="simulate", **fields):
        """Serves a function with this body, and returns the answer and the process's other output."""
        start = 'import os, subprocess, sys\nfrom mishandle_simulator import serve\ndef simulate(scenario, seed):\n'
        end = '\nserve({"name": "test"}, simulate)\n'
        code = start + textwrap.indent(textwrap.dedent(body), "    ") + end
        with Peer([sys.executable, "-c", code], HERE / "python") as peer:
            answer = peer.ask(kind, **{"seed": "18446744073709551615", "scenario": {"a": 1}, **fields})
            again = peer.ask(kind, **{"seed": "18446744073709551615", "scenario": {"a": 1}, **fields})
            self.assertEqual(answer, again)
            self.assertEqual(peer.close()[1], b"")
            return answer, peer.printed()

    def test_the_client_has_at_most_40_lines(self):
        self.assertLessEqual(len((HERE / "python/mishandle_simulator.py").read_text().splitlines()), 40)

    def test_prints_of_user_code_and_of_its_children_go_to_standard_error(self):
        body = """
        print("a print")
        sys.stdout.write("a write\\n")
        os.write(1, b"a library in C\\n")
        subprocess.run(["echo", "a child"])
        return {"trace": {"y": [1]}}"""
        answer, printed = self.ask(body)
        self.assertEqual(answer, {"trace": {"y": [1]}})
        for text in ("a print", "a write", "a library in C", "a child"):
            self.assertIn(text, printed)

    def test_user_code_cannot_read_questions(self):
        answer, _ = self.ask('return {"trace": {"y": [len(subprocess.run("cat", capture_output=True).stdout)]}}')
        self.assertEqual(answer, {"trace": {"y": [0]}})
        self.assertIn("EOFError", self.ask("input()")[0]["error"])

    def test_an_exception_is_an_error_with_its_text_and_a_traceback_on_standard_error(self):
        answer, printed = self.ask('raise ValueError("no \\"solution\\"\\nfor Δt")')
        self.assertEqual(answer, {"error": 'ValueError: no "solution"\nfor Δt'})
        self.assertIn("Traceback", printed)

    def test_what_is_no_answer_is_an_error(self):
        for body in ("pass", "return [1]", 'return {"trace": {"y": [object()]}}', 'return {"trace": {"y": {1j}}}'):
            self.assertIn("TypeError", self.ask(body)[0]["error"], body)

    def test_numbers_that_are_not_finite_are_null(self):
        answer, _ = self.ask('return {"trace": {"y": (1.5, float("nan"), float("inf"), -float("inf"), 2)}}')
        self.assertEqual(answer, {"trace": {"y": [1.5, None, None, None, 2]}})

    def test_arrays_become_lists(self):
        body = """
        import array
        class Number(float):
            def tolist(self): return float(self)
        return {"trace": {"y": array.array("d", [1, float("nan")]), "z": [Number(2)]}, "end": "terminated"}"""
        self.assertEqual(self.ask(body)[0], {"trace": {"y": [1, None], "z": [2]}, "end": "terminated"})

    def test_the_seed_has_64_bits(self):
        self.assertEqual(self.ask('return {"trace": {}, "reason": str(seed)}')[0]["reason"], "18446744073709551615")

    def test_serve_needs_one_mode(self):
        for arguments in ("", "print, print, print", "reset=print", "step=print"):
            code = f"from mishandle_simulator import serve\nserve({{}}, {arguments})"
            ended = subprocess.run([sys.executable, "-c", code], cwd=HERE / "python", capture_output=True, text=True)
            self.assertIn("serve needs simulate=, or reset= and step=", ended.stderr)


class Ros2(unittest.TestCase):
    def test_the_skeleton_parses_and_says_that_it_was_not_run(self):
        text = (HERE / "ros2/mishandle_ros2.py").read_text()
        self.assertIn("NOT RUN", ast.get_docstring(ast.parse(text)))
