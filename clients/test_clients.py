"""Tests of the clients of the simulator protocol: `python3 clients/test_clients.py`.

They talk to each client over pipes and need no build of Mishandle. With its program in the environment variable
MISHANDLE, they also run `mishandle protocol check` and `mishandle falsify` on each. What is not installed is skipped.
"""

import json
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import textwrap
import unittest

from peer import Peer, check_hello

HERE = pathlib.Path(__file__).resolve().parent
PROGRAM = os.environ.get("MISHANDLE")
built = tempfile.TemporaryDirectory()
STRICT = ["-std=c99", "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
SANITIZED = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def compile_c(source, *flags):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise unittest.SkipTest("no C compiler: apt-get install gcc")
    program = pathlib.Path(built.name) / pathlib.Path(source).stem
    if not program.exists():
        subprocess.run([compiler, *STRICT, *flags, f"-I{HERE / 'c'}", str(source), "-o", str(program), "-lm"], check=True)
    return str(program)


def brake(observation):
    """A policy of the cart: a spring and a damper, within the limit of the action."""
    return [min(1.0, max(-1.0, -2.0 * observation[0] - 1.5 * observation[1]))]


class Client:
    """What holds for every client. A subclass states the command and the folder."""

    command: list
    folder = HERE
    policy = None
    # Arguments of `mishandle falsify` in place of the command.
    target = None

    @classmethod
    def start(cls):
        return Peer(cls.command, cls.folder)

    def test_hello_keeps_to_the_contract_and_is_the_same_in_two_processes(self):
        with self.start() as one, self.start() as two:
            check_hello(one.hello)
            self.assertEqual(one.hello, two.hello)
            self.assertEqual(one.ask("hello", protocol=1), one.hello)

    def test_nominal_and_corners_have_complete_traces_of_numbers(self):
        with self.start() as peer:
            for scenario in [peer.nominal(), *peer.corners()]:
                trace, end = peer.episode(scenario, policy=self.policy)
                self.assertIsNone(end)
                self.assertTrue(all(isinstance(number, (int, float)) for column in trace.values() for number in column))

    def test_an_answer_does_not_depend_on_the_questions_before_it(self):
        with self.start() as peer, self.start() as fresh:
            first, other = peer.corners()[0], peer.corners()[-1]
            episodes = [peer.episode(each, policy=self.policy) for each in (first, other, first)]
            self.assertEqual(episodes[0], episodes[2])
            self.assertNotEqual(episodes[0], episodes[1])
            self.assertEqual(episodes[1], fresh.episode(other, policy=self.policy))

    def test_an_axis_that_lacks_is_an_error_that_names_it(self):
        with self.start() as peer:
            before = peer.episode(peer.nominal(), policy=self.policy)
            for axis in peer.nominal():
                scenario = {name: value for name, value in peer.nominal().items() if name != axis}
                with self.assertRaisesRegex(RuntimeError, axis):
                    peer.episode(scenario, policy=self.policy)
            self.assertEqual(peer.episode(peer.nominal(), policy=self.policy), before)

    def test_an_unknown_type_is_an_error_and_an_unknown_key_is_none(self):
        with self.start() as peer:
            self.assertIn("dance", peer.ask("dance", to={"what": [1, None, True, "\\"]})["error"])
            kind = "reset" if peer.hello.get("mode") == "step" else "simulate"
            plain = peer.ask(kind, seed="1", scenario=peer.nominal())
            self.assertNotIn("error", plain)
            more = peer.ask(kind, seed="1", scenario=peer.nominal(), later={"a": [{}, [], "]}", 1e-3, None, False]})
            self.assertEqual(more, plain)

    def test_the_program_ends_with_its_standard_input(self):
        with self.start() as peer:
            self.assertEqual(peer.close(), (0, b""))

    def test_the_program_ends_when_its_owner_is_killed(self):
        with self.start() as peer:
            kind = "reset" if peer.hello.get("mode") == "step" else "simulate"
            peer.send(json.dumps({"id": 2, "type": kind, "seed": "1", "scenario": peer.nominal()}).encode())
            peer.process.stdout.close()
            peer.process.stdin.close()
            peer.process.wait(60)

    @unittest.skipUnless(PROGRAM, "MISHANDLE does not name the program")
    def test_mishandle_checks_and_falsifies_it(self):
        words = " ".join(map(str, self.command))
        checked = self.mishandle("protocol", "check", words)
        self.assertEqual(checked.returncode, 0, checked.stdout + checked.stderr)
        found = self.mishandle("falsify", *(self.target or ["--command", words]), "--trials", "1", "--budget", "200")
        self.assertEqual(found.returncode, 1, found.stdout + found.stderr)
        self.assertIn("falsified 1 of 1 trials", found.stdout + found.stderr)

    def mishandle(self, *arguments):
        environment = {**os.environ, "MISHANDLE_ALLOW_PROGRAMS": "1"}
        with tempfile.TemporaryDirectory() as runs:
            out = ["--out", f"{runs}/run.sqlite"] if arguments[0] == "falsify" else []
            command = [PROGRAM, *arguments, *out]
            return subprocess.run(command, cwd=self.folder, env=environment, capture_output=True, text=True)


class Tank(Client):
    """The same tank in several languages."""

    def test_the_tank_is_that_of_python(self):
        with self.start() as peer, PythonTank.start() as reference:
            for key in ("control_dt", "steps", "signals", "formulas"):
                self.assertEqual(peer.hello[key], reference.hello[key])
            for scenario in [reference.nominal(), *reference.corners()]:
                self.assertEqual(peer.episode(scenario), reference.episode(scenario))

    def test_it_overflows_in_a_corner_and_not_at_nominal(self):
        with self.start() as peer:
            nominal, _ = peer.episode(peer.nominal())
            self.assertLess(max(nominal["level"]), 1)
            corner, _ = peer.episode({"level": 0.1, "demand": 0.02, "lag": 2.0})
            self.assertGreater(max(corner["level"]), 1)

    def test_it_fills_no_faster_than_its_inflow_and_the_first_sample_is_the_start(self):
        with self.start() as peer:
            for scenario in peer.corners():
                trace, _ = peer.episode(scenario)
                levels = trace["level"]
                self.assertEqual((levels[0], trace["valve"][0]), (scenario["level"], 0))
                rises = [after - before for before, after in zip(levels, levels[1:])]
                self.assertLessEqual(max(rises), 0.1 * 0.12)


class Cart(Client):
    policy = staticmethod(brake)

    def test_without_a_force_the_cart_keeps_its_velocity(self):
        with self.start() as peer:
            trace, _ = peer.episode({"position": -0.25, "velocity": 0.5, "mass": 1.5}, policy=lambda _: [0.0])
            for k, (position, velocity) in enumerate(zip(trace["position"], trace["velocity"])):
                self.assertEqual(velocity, 0.5)
                self.assertAlmostEqual(position, -0.25 + 0.5 * 0.05 * k, delta=1e-12)

    def test_a_constant_force_gives_force_over_mass(self):
        with self.start() as peer:
            trace, _ = peer.episode({"position": 0, "velocity": 0, "mass": 2.0}, policy=lambda _: [1.0])
            self.assertAlmostEqual(trace["velocity"][-1], 10.0 / 2.0, delta=1e-9)

    def test_a_missing_action_is_an_error(self):
        with self.start() as peer:
            peer.ask("reset", seed="0", scenario=peer.nominal())
            self.assertIn("error", peer.ask("step"))


class PythonTank(Tank, unittest.TestCase):
    command, folder = [sys.executable, "tank.py"], HERE / "python"


class PythonCart(Cart, unittest.TestCase):
    command, folder, target = [sys.executable, "cart.py"], HERE / "python", ["cart.toml"]


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


if __name__ == "__main__":
    unittest.main()
