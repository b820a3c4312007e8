"""What holds for every client of the simulator protocol, and for the same two systems in every language."""

import json
import os
import pathlib
import shlex
import subprocess
import sys
import tempfile
import unittest

from peer import Peer, check_hello

HERE = pathlib.Path(__file__).resolve().parent.parent
PROGRAM = os.environ.get("MISHANDLE")
PYTHON_TANK = [sys.executable, "tank.py"]
PYTHON_CART = [sys.executable, "cart.py"]


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
        words = shlex.join(self.command)
        checked = self.mishandle("init", "--check", words)
        self.assertEqual(checked.returncode, 0, checked.stdout + checked.stderr)
        found = self.mishandle("falsify", *(self.target or ["--command", words]), "--trials", "1", "--budget", "200")
        self.assertEqual(found.returncode, 1, found.stdout + found.stderr)
        self.assertIn("1 of 1 search,", " ".join(found.stdout.split()))

    def mishandle(self, *arguments):
        environment = {**os.environ, "MISHANDLE_ALLOW_PROGRAMS": "1"}
        with tempfile.TemporaryDirectory() as runs:
            out = ["--out", f"{runs}/run.sqlite"] if arguments[0] == "falsify" else []
            command = [PROGRAM, *arguments, *out]
            return subprocess.run(command, cwd=self.folder, env=environment, capture_output=True, text=True)


class Tank(Client):
    """The same tank in several languages."""

    def test_the_tank_is_that_of_python(self):
        with self.start() as peer, Peer(PYTHON_TANK, HERE / "python") as python:
            for key in ("control_dt", "steps", "axes", "signals", "formulas"):
                self.assertEqual(peer.hello[key], python.hello[key])
            for scenario in [python.nominal(), *python.corners()]:
                self.assertEqual(peer.episode(scenario), python.episode(scenario))

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
