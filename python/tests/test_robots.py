"""Robots that a file describes."""

import pathlib
import tempfile
import unittest

import mishandle

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


class TestRobots(unittest.TestCase):
    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        (self.folder / "cartpole.xml").write_text(MODEL)
        self.file = self.folder / "cartpole.toml"
        self.file.write_text(FILE)

    def test_every_question_takes_the_path_of_a_target_file(self) -> None:
        evaluated = mishandle.evaluate(self.file, episodes=20)
        self.assertEqual(evaluated.success_rate.value, 1.0)
        falsified = mishandle.falsify(str(self.file), space="starts+delay", trials=2, budget=60, seed=1)
        self.assertEqual(falsified.falsified_trials, 2)

    def test_a_simulation_has_the_signals_of_the_file(self) -> None:
        [episode] = mishandle.simulate(self.file, at={"tilt": 0.2})
        self.assertEqual(list(episode.trace), ["angle"])
        self.assertEqual(episode.trace["angle"][0], 0.2)
        self.assertEqual(len(episode.trace["angle"]), 101)

    def test_mistakes_name_the_line(self) -> None:
        self.file.write_text(FILE.replace("qpos('hinge')\", unit", "qpos('hing')\", unit"))
        with self.assertRaisesRegex(mishandle.InvalidValueError, "line 9: no joint `hing`; did you mean `hinge`"):
            mishandle.evaluate(self.file, episodes=2)
        with self.assertRaisesRegex(mishandle.InvalidTypeError, "by name"):
            mishandle.evaluate(self.file, space=[mishandle.Axis("tilt", 0, 1)], episodes=2)


if __name__ == "__main__":
    unittest.main()
