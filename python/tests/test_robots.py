"""Robots that a file describes."""

import time

from typing import Any

from cases import FolderCase
import mishandle
from mishandle.errors import InvalidStateError, InvalidTypeError, InvalidValueError
import numpy as np
from servers import openpi_server

MODEL = """<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom type="box" size="0.15 0.1 0.06" mass="1"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.02" mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="force" joint="slide" ctrlrange="-20 20" ctrllimited="true"/></actuator>
</mujoco>"""

FILE = """
format = 1
name = "cartpole"
model.file = "cartpole.xml"
control = { period = 0.02, steps = 100 }
start = { hinge = "tilt" }
observation.state = "[*qpos('slide'), *qvel('slide'), *qpos('hinge'), *qvel('hinge')]"
policy = { expression = "dot([1, 2, 25, 4], state)", action = "action" }
signals.angle = { value = "qpos('hinge')", unit = "rad" }
axes.tilt = { range = [-0.3, 0.3], unit = "rad" }
formulas.upright = "always(angle <= 0.5 and angle >= -0.5)"
"""


class TestRobots(FolderCase):
    def setUp(self) -> None:
        super().setUp()
        (self.folder / "cartpole.xml").write_text(MODEL)
        self.file = self.folder / "cartpole.toml"
        self.file.write_text(FILE)

    def test_every_question_takes_the_path_of_a_target_file(self) -> None:
        evaluated = mishandle.evaluate(self.file, episodes=20)
        self.assertEqual(evaluated.success_rate.value, 1.0)
        falsified = mishandle.falsify(
            str(self.file), space="starts+delay", trials=2, budget=60, seed=1
        )
        self.assertEqual(falsified.falsified_trials, 2)

    def test_a_simulation_has_the_signals_of_the_file(self) -> None:
        [episode] = mishandle.simulate(self.file, at={"tilt": 0.2})
        self.assertEqual(list(episode.trace), ["angle"])
        self.assertEqual(episode.trace["angle"][0], 0.2)
        self.assertEqual(len(episode.trace["angle"]), 101)

    def test_mistakes_name_the_line(self) -> None:
        self.file.write_text(FILE.replace("qpos('hinge')\", unit", "qpos('hing')\", unit"))
        with self.assertRaisesRegex(
            InvalidValueError, "line 9: no joint `hing`; did you mean `hinge`"
        ):
            mishandle.evaluate(self.file, episodes=2)
        with self.assertRaisesRegex(InvalidTypeError, "by name"):
            mishandle.evaluate(self.file, space=[mishandle.Axis("tilt", 0, 1)], episodes=2)

    def test_a_policy_in_python_acts_as_the_same_expression_of_the_file_in_every_space(
        self
    ) -> None:
        for space in ("starts", "starts+delay", "starts+sensing", "all"):
            for batched in (False, True):
                with self.subTest(space, batched=batched):
                    expected = mishandle.evaluate(self.file, space=space, episodes=40, seed=2)
                    policy = balance_rows if batched else balance
                    found = mishandle.evaluate(
                        self.file, space=space, policy=policy, batched_policy=batched, episodes=40,
                        seed=2
                    )
                    one, other = (
                        mishandle.open_run(each.path).columns() for each in (expected, found)
                    )
                    self.assertEqual(one["tilt"], other["tilt"])
                    self.assertEqual(one["end"], other["end"])
                    # The policy of the file computes with 64 bits, ours with 32.
                    pairs = [
                        pair for pair in zip(one["robustness"], other["robustness"])
                        if None not in pair
                    ]
                    self.assertGreater(len(pairs), 20)
                    np.testing.assert_allclose(*zip(*pairs), atol=1e-3)

    def test_a_server_is_the_policy_and_its_failures_are_no_verdicts(self) -> None:
        def policy(request: Any) -> Any:
            tilt = request["observation/state"][2]
            if tilt > 0.25:
                time.sleep(0.5)
            if tilt < -0.25:
                raise RuntimeError("out of memory")
            return {"actions": [np.dot([1, 2, 25, 4], request["observation/state"])]}

        with openpi_server(policy) as server:
            served = mishandle.PolicyServer(server.url, time_limit=0.2)
            ends = {}
            for tilt in (0.2, 0.28, -0.28, -0.2):
                [found] = mishandle.simulate(
                    self.file, at={"tilt": tilt}, policy=served, version="1"
                )
                ends[tilt] = (found.end, found.robustness is None, "".join(found.exceptions))
            with self.assertRaisesRegex(InvalidValueError, "the system draws none"):
                mishandle.simulate(
                    self.file,
                    policy=mishandle.PolicyServer(server.url, observation={"picture": "render"})
                )
        for tilt in (0.2, -0.2):
            self.assertEqual(ends[tilt], ("completed", False, ""))
        self.assertEqual(ends[0.28][:2], ("timed out in control step 1", True))
        self.assertIn("did not answer within 0.2 s", ends[0.28][2])
        self.assertEqual(ends[-0.28][:2], ("crashed in control step 1", True))
        self.assertIn("out of memory", ends[-0.28][2])

    def test_each_question_takes_a_policy_in_python(self) -> None:
        found = mishandle.falsify(
            self.file, space="starts+delay", policy=balance, trials=2, budget=60, seed=1,
            out=self.folder / "a.sqlite"
        )
        self.assertEqual(found.falsified_trials, 2)
        worst = found.counterexamples[0]
        again = mishandle.replay(
            found.path, self.file, space="starts+delay", policy=balance, trial=worst.trial,
            number=worst.simulation
        )
        self.assertEqual(again.differences, ())
        found.export(self.folder / "suite", plan={"regress": {"minimize": True}})
        regression = mishandle.regress(
            self.folder / "suite", self.file, space="starts+delay", policy=balance
        )
        self.assertEqual({test.result for test in regression.tests}, {"still fails"})
        smallest = mishandle.margin(self.file, space="starts+delay", policy=balance, budget=100)
        self.assertIsNotNone(smallest.witness)
        found.report(self.folder / "page.html", plan={"report": {"probes": 4}})
        self.assertIn("cartpole", (self.folder / "page.html").read_text())
        other = mishandle.replay(
            found.path, self.file, space="starts+delay", policy=lambda state: [0.0],
            trial=worst.trial, number=worst.simulation
        )
        self.assertIn("hash of the target", other.differences[0])

    def test_a_policy_with_a_memory_keeps_that_of_its_row(self) -> None:
        class Counting:
            """Pushes for the first ten control steps."""

            def reset(self) -> None:
                self.steps = 0

            def __call__(self, states: Any) -> Any:
                self.steps += 1
                return np.full((len(states), 1), 1.0 if self.steps <= 10 else 0.0)

        runs = []
        for episodes in (40, 3):
            found = mishandle.evaluate(
                self.file, policy=Counting(), batched_policy=True, episodes=episodes, seed=2
            )
            columns = mishandle.open_run(found.path).columns()
            runs.append(
                [row for row in zip(columns["trial"], columns["number"], columns["robustness"])][:3]
            )
        self.assertEqual(*runs)

    def test_a_failing_policy_crashes_and_a_broken_one_is_an_error(self) -> None:
        def sometimes(state: Any) -> Any:
            if abs(state[2]) > 0.25:
                raise RuntimeError("too far")
            return balance(state)

        found = mishandle.evaluate(self.file, policy=sometimes, episodes=60, seed=2)
        ends = mishandle.open_run(found.path).columns()
        for tilt, end in zip(ends["tilt"], ends["end"]):
            self.assertEqual(end, "crashed" if abs(tilt) > 0.25 else "completed")
        self.assertIn("too far", found.exceptions[0])
        with self.assertRaisesRegex(
            InvalidStateError, "returned 2 numbers for 1 observation; cartpole takes 1"
        ):
            mishandle.evaluate(self.file, policy=lambda state: [0.0, 0.0], episodes=2)
        with self.assertRaisesRegex(InvalidTypeError, "`steps` has no effect on a target"):
            mishandle.evaluate(self.file, policy=balance, steps=3, episodes=2)

        def interrupted(state: Any) -> Any:
            calls.append(0)
            if len(calls) > 1000:
                raise KeyboardInterrupt
            return balance(state)

        calls: list[int] = []
        with self.assertRaises(KeyboardInterrupt):
            mishandle.evaluate(self.file, policy=interrupted, episodes=200, version="1")
        self.assertLess(len(calls), 1050)


def balance(state: Any) -> Any:
    return [np.dot([1.0, 2.0, 25.0, 4.0], np.asarray(state, dtype=np.float64))]


def balance_rows(states: Any) -> Any:
    return states.astype(np.float64) @ np.array([[1.0], [2.0], [25.0], [4.0]])
