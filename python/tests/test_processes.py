"""Systems that are processes of their own."""

import pickle
import subprocess
import sys
import unittest
import warnings

import mishandle
from mishandle import Axis, JsonProcess
from mishandle.policies import policy_hash

CHILD = """
import json, os, sys, time
for line in sys.stdin:
    given = json.loads(line)
    if given["a"] > 0.8:
        time.sleep(3)
    if given["a"] < 0.1:
        sys.exit(3)
    print(json.dumps({"y": [given["a"]] * 2, "process": [os.getpid()] * 2, "seed": [given.get("seed", -1)] * 2}), flush=True)
"""

SPACE = [Axis("a", 0, 1, nominal=0.5)]


class Processes(unittest.TestCase):
    def simulate(self, system, a, **options):
        return mishandle.simulate(system, "always(y <= 2)", SPACE, at={"a": a}, **options)[0]

    def test_the_late_answer_of_a_scenario_is_never_that_of_the_next(self):
        with JsonProcess([sys.executable, "-c", CHILD]) as child:
            first = self.simulate(child, 0.5)
            self.assertEqual(self.simulate(child, 0.5).trace["process"][0], first.trace["process"][0])
            self.assertEqual(self.simulate(child, 0.9, time_limit=0.5).end, "timed out in control step 0")
            found = self.simulate(child, 0.25, time_limit=10)
            self.assertEqual(found.robustness, 1.75)
            self.assertNotEqual(found.trace["process"][0], first.trace["process"][0])

    def test_a_process_that_ends_is_a_crash_and_starts_again(self):
        with JsonProcess([sys.executable, "-c", CHILD]) as child:
            found = self.simulate(child, 0.05)
            self.assertEqual(found.end, "crashed in control step 0")
            self.assertIn("exit code 3 instead of an answer", found.exceptions[0])
            self.assertEqual(self.simulate(child, 0.5).robustness, 1.5)

    def test_a_process_gets_a_seed_if_it_names_a_key_for_it(self):
        for key, seed in [(None, -1), ("seed", 7)]:
            with JsonProcess([sys.executable, "-c", CHILD], seed=key) as child:
                self.assertEqual(self.simulate(child, 0.5, seed=7).trace["seed"][0], seed)

    def test_a_copy_starts_a_process_of_its_own(self):
        with JsonProcess([sys.executable, "-c", CHILD], seed="seed") as child:
            before = policy_hash(child)
            self.simulate(child, 0.5)
            self.assertEqual(policy_hash(child), before)
            with pickle.loads(pickle.dumps(child)) as copy:
                self.assertEqual(self.simulate(copy, 0.5).robustness, 1.5)
        self.assertNotEqual(policy_hash(JsonProcess([sys.executable, "-c", CHILD + " "])), before)

    def test_a_process_that_outlives_a_time_limit_is_reported(self):
        child = subprocess.Popen([sys.executable, "-c", CHILD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

        def ask(scenario):
            child.stdin.write(f'{{"a": {scenario["a"]}}}\n')
            child.stdin.flush()
            return {"y": [float(child.stdout.readline().split("[")[1].split(",")[0])] * 2}

        with child:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                self.simulate(ask, 0.9, time_limit=0.5, version="1")
            self.assertIn(f"the process {child.pid} that the function talks to still runs", str(caught[0].message))
            child.kill()


if __name__ == "__main__":
    unittest.main()
