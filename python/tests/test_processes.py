"""Simulators that are programs of their own."""

import subprocess
import sys
import warnings

from cases import FolderCase
import mishandle
from mishandle import Axis, MishandleError, Process
from mishandle.errors import InvalidTypeError, InvalidValueError

CHILD = """
import json, os, sys, time
for line in sys.stdin:
    question = json.loads(line)
    answer = {"id": question["id"]}
    if question["type"] == "hello":
        answer |= {"protocol": 1, "name": "child", "control_dt": 1.0, "steps": 1}
        answer |= {"seeded": True, "time_limit": 1}
        answer["axes"] = [{"name": "a", "unit": "", "low": 0, "high": 1, "nominal": 0.5}]
        answer["signals"] = [{"name": name, "unit": ""} for name in ("y", "process", "seed")]
        answer["formulas"] = [{"name": "small", "text": "always(y <= 2)"}]
    else:
        a = question["scenario"]["a"]
        if a > 0.8:
            time.sleep(3)
        if a < 0.1:
            sys.exit("out of range")
        seed = int(question["seed"]) % 1000
        answer["trace"] = {"y": [a] * 2, "process": [os.getpid()] * 2, "seed": [seed] * 2}
    print(json.dumps(answer), flush=True)
"""


class Processes(FolderCase):
    def setUp(self):
        super().setUp()
        (self.folder / "child.py").write_text(CHILD)
        self.child = Process([sys.executable, "child.py"], folder=self.folder)

    def simulate(self, a, **options):
        return mishandle.simulate(self.child, at={"a": a}, **options)[0]

    def test_the_program_states_its_axes_and_its_formula(self):
        found = self.simulate(0.5)
        self.assertEqual(found.robustness, 1.5)
        result = mishandle.falsify(
            self.child, "always(y <= 0.6)", trials=1, budget=60, search="random",
            out=self.folder / "run.sqlite"
        )
        self.assertEqual(result.falsified_trials, 1)

    def test_failures_are_typed_ends_without_verdict_and_keep_their_reason(self):
        late = self.simulate(0.9)
        self.assertIn("time limit", late.end.replace("timed out", "time limit"))
        self.assertIsNone(late.robustness)
        crashed = self.simulate(0.05)
        self.assertIn("crashed", crashed.end.replace("failed", "crashed"))
        self.assertIsNone(crashed.robustness)
        self.assertEqual(self.simulate(0.25).robustness, 1.75)

    def test_a_replay_asks_the_program_again(self):
        run = self.folder / "run.sqlite"
        mishandle.evaluate(self.child, episodes=3, out=run, axes={"a": (0.2, 0.7)})
        again = mishandle.replay(run, self.child, trial=1, number=2, axes={"a": (0.2, 0.7)})
        self.assertEqual(again.recorded_robustness, again.repetition.robustness)

    def test_what_does_not_fit_is_an_error(self):
        with self.assertRaises(InvalidTypeError):
            Process(7)
        with self.assertRaises(InvalidValueError):
            Process(" ")
        with self.assertRaisesRegex(InvalidTypeError, "space of Process"):
            mishandle.simulate(self.child, space=[Axis("a", 0, 1)], at={"a": 0.5})
        with self.assertRaisesRegex(InvalidTypeError, "policy of a Process"):
            mishandle.simulate(self.child, policy=lambda observation: [0.0], at={"a": 0.5})
        with self.assertRaisesRegex(MishandleError, "no-such-program"):
            mishandle.simulate(Process("no-such-program"), at={"a": 0.5})

    def test_a_process_that_outlives_a_time_limit_of_a_function_is_reported(self):
        program = (
            "import sys, time\n"
            "for line in sys.stdin:\n"
            "    time.sleep(3 * (float(line) > 0.8)); print(float(line), flush=True)"
        )
        child = subprocess.Popen(
            [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            text=True
        )

        def ask(scenario):
            child.stdin.write(f"{scenario['a']}\n")
            child.stdin.flush()
            return {"y": [float(child.stdout.readline())] * 2}

        with child:
            with warnings.catch_warnings(record=True, action="always") as caught:
                mishandle.simulate(
                    ask, "always(y <= 2)", [Axis("a", 0, 1)], at={"a": 0.9}, time_limit=0.5,
                    version="1"
                )
            self.assertIn(
                f"the process {child.pid} that the function talks to still runs",
                str(caught[0].message)
            )
            child.kill()
