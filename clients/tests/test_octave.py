"""The client in Octave. MATLAB, for which it is also written, was not run."""

import shutil
import subprocess
import tempfile
import textwrap
import unittest

from contract import HERE, Tank
from peer import Peer

OCTAVE = shutil.which("octave-cli")
needs_octave = unittest.skipUnless(OCTAVE, "no Octave: apt-get install --no-install-recommends octave")


@needs_octave
class OctaveTank(Tank, unittest.TestCase):
    command, folder = [OCTAVE, "--norc", "--eval", "tank"], HERE / "octave"


@needs_octave
class Octave(unittest.TestCase):
    """The client with code that breaks things."""

    def answers(self, code, *questions):
        """Serves a script in a process of its own. Returns an answer for each question, and the standard error."""
        with tempfile.TemporaryDirectory() as folder:
            path = f"{folder}/script.m"
            with open(path, "w") as file:
                file.write("1;\n" + textwrap.dedent(code))
            with Peer([OCTAVE, "--norc", "--path", str(HERE / "octave"), path], HERE) as peer:
                self.hello = peer.hello
                answers = [peer.ask(kind, **fields) for kind, fields in questions]
                self.assertEqual(peer.close(), (0, b""))
                return answers, peer.printed()

    def simulate(self, body, seed="1", **scenario):
        code = f"function answer = f(scenario, seed)\n{textwrap.dedent(body)}\nend\nmishandle_serve(struct('name', 'x'), @f)\n"
        (answer, again), printed = self.answers(code, *[("simulate", {"seed": seed, "scenario": scenario})] * 2)
        self.assertEqual(answer, again)
        return answer, printed

    def test_prints_go_to_standard_error(self):
        body = "a = 42\ndisp('hello'); printf('there\\n'); system('echo child');\nanswer.trace.y = a;"
        answer, printed = self.simulate(body)
        self.assertEqual(answer, {"trace": {"y": [42]}})
        for text in ("a = 42", "hello", "there", "child"):
            self.assertIn(text, printed)

    def test_an_exception_is_an_error_with_its_text(self):
        answer, printed = self.simulate("error('no \"solution\"\\nfor %d', 3)")
        self.assertEqual(answer, {"error": 'no "solution"\nfor 3'})
        self.assertIn('no "solution"', printed)
        self.assertIn("error", self.simulate("answer = 3;")[0])
        self.assertIn("error", self.simulate("x = 3;")[0])

    def test_numbers_keep_their_digits_and_lists_stay_lists(self):
        body = """
        answer.trace.y = [1/3; -Inf; NaN; Inf; 1e-300];
        answer.trace.z = [];
        answer.trace.b = [true, false];
        answer.end = 'terminated'; answer.reason = seed;"""
        answer, _ = self.simulate(body, seed="18446744073709551615")
        trace = {"y": [1 / 3, None, None, None, 1e-300], "z": [], "b": [1, 0]}
        self.assertEqual(answer, {"trace": trace, "end": "terminated", "reason": "18446744073709551615"})

    def test_hello_may_use_structures_and_single_numbers(self):
        code = """
        hello = struct('name', 'x', 'control_dt', 1, 'steps', 1, 'deterministic', false);
        hello.axes = struct('name', 'a', 'values', {{'cold', 'wet ice'}}, 'nominal', 'cold');
        hello.signals = struct('name', {'y', 'z'});
        hello.spaces.all = {'a'};
        hello.policy.observation = struct('name', 'o');
        hello.policy.action = struct('name', 'u', 'size', 1);
        hello.policy.action_limit = 1;
        function answer = reset(scenario, seed)
          answer.signals = [numel(scenario.a), 0]; answer.observation = 5;
        end
        function answer = step(action)
          answer.signals = [action, 0]; answer.observation = action;
        end
        mishandle_serve(hello, @reset, @step)
        """
        questions = ("reset", {"seed": "1", "scenario": {"a": "wet ice"}}), ("step", {"action": [0.1]}), ("simulate", {})
        answers, _ = self.answers(code, *questions)
        self.assertEqual(self.hello["axes"], [{"name": "a", "values": ["cold", "wet ice"], "nominal": "cold"}])
        self.assertEqual(self.hello["signals"], [{"name": "y"}, {"name": "z"}])
        self.assertEqual(self.hello["spaces"], {"all": ["a"]})
        self.assertIs(self.hello["deterministic"], False)
        policy = {"observation": [{"name": "o"}], "action": [{"name": "u", "size": 1}], "action_limit": 1}
        self.assertEqual((self.hello["policy"], self.hello["mode"]), (policy, "step"))
        self.assertEqual(answers[:2], [{"signals": [7, 0], "observation": [5]}, {"signals": [0.1, 0], "observation": [0.1]}])
        self.assertIn("simulate", answers[2]["error"])

    def test_serve_needs_one_mode(self):
        ended = subprocess.run(
            [OCTAVE, "--norc", "--path", str(HERE / "octave"), "--eval", "mishandle_serve(struct())"],
            capture_output=True,
            text=True,
        )
        self.assertIn("mishandle_serve needs a function, or reset and step", ended.stderr)
        self.assertEqual(ended.returncode, 1)
