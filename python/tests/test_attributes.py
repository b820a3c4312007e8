"""Attributes that axes set: they reach one row each, and are restored."""

import signal
import unittest
import warnings

from cases import FolderCase, batch, take_interrupts
import gymnasium
import mishandle
import mujoco
import numpy as np
from mishandle import Attribute, Axis
from mishandle.scenarios.attributes import Attributes


class Slider(gymnasium.Env):
    """Moves by its speed times its action in each step."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))
    shared = {"gain": 1.0}
    limit = 3.0

    def __init__(self, *, config=None, array=None):
        self.speed, self.array = 0.5, np.array([1.0, 2.0]) if array is None else array
        self.config = {"gains": [1.0, 2.0]} if config is None else config

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = 0.0
        return np.array([self.x], np.float32), {}

    def step(self, action):
        if self.speed > 1.5:
            raise RuntimeError("too fast")
        self.x += self.speed * self.array[0] * self.config["gains"][1] * float(action[0])
        return np.array([self.x], np.float32), 0.0, False, False, {}


class TestSlider(FolderCase):
    KINDS = {
        "policy": lambda observation: np.ones(1, np.float32), "signals": {"x": "obs[0]"}, "steps": 2
    }
    SPACE = [
        Axis("speed", 0.1, 2.0, nominal=0.5, kind="model", apply=Attribute("speed")),
        Axis("first", 0.5, 1.5, nominal=1.0, kind="model", apply=Attribute("array[0]")),
        Axis("gain", 0.5, 1.5, nominal=1.0, kind="model", apply=Attribute("config.gains[1]")),
        Axis("limit", 1.0, 5.0, nominal=3.0, kind="model", apply=Attribute("limit")),
    ]

    def falsify(self, env, **options):
        kinds = {
            "trials": 1, "budget": 12, "search": "random", "out": self.folder / "run.sqlite",
            **self.KINDS
        }
        return mishandle.falsify(
            env, "always(x <= 90)", options.pop("space", self.SPACE), **{**kinds, **options}
        )

    def check_restored(self, env):
        self.assertEqual(
            (env.speed, env.array.tolist(), env.config), (0.5, [1.0, 2.0], {"gains": [1.0, 2.0]})
        )
        self.assertNotIn("limit", vars(env), "the class states it")

    def test_attributes_are_restored_after_a_run_with_crashes(self):
        env = Slider()
        found = self.falsify(env)
        self.assertGreater(sum(trial.failed for trial in found.trials), 0)
        self.check_restored(env)

    def test_attributes_are_restored_after_an_exception_and_after_an_interrupt(self):
        env = Slider()

        class Broken(Exception):
            pass

        def progress(done, total):
            raise Broken

        with self.assertRaises(Broken):
            self.falsify(env, progress=progress)
        self.check_restored(env)
        take_interrupts(self)
        calls = []

        def policy(observation):
            calls.append(observation)
            if len(calls) == 11:
                signal.raise_signal(signal.SIGINT)
            return np.ones(1, np.float32)

        with self.assertRaises(KeyboardInterrupt):
            self.falsify(env, policy=policy, out=self.folder / "other.sqlite")
        self.check_restored(env)

    def test_each_row_has_its_own_scenario(self):
        rows = [Slider() for _ in range(3)]
        vector = gymnasium.vector.SyncVectorEnv([lambda row=row: row for row in rows])
        first = self.falsify(Slider(), out=self.folder / "one.sqlite")
        again = self.falsify(vector, plan=batch(3), out=self.folder / "three.sqlite")
        columns = [mishandle.open_run(found.path).columns() for found in (first, again)]
        self.assertEqual(*columns)
        for row in rows:
            self.check_restored(row)

    def test_rows_that_share_what_an_axis_sets_are_refused(self):
        one = Slider()
        with self.assertRaisesRegex(
            ValueError, "are the same object, so they cannot have scenarios of their own"
        ):
            self.falsify(gymnasium.vector.SyncVectorEnv([lambda: one] * 2))
        for shared in ({"config": {"gains": [1.0, 2.0]}}, {"array": np.array([1.0, 2.0])}):
            vector = gymnasium.vector.SyncVectorEnv([lambda: Slider(**shared)] * 2)
            with self.assertRaisesRegex(
                ValueError,
                r"share what the axes set \(speed, array\[0\], config.gains\[1\], limit\)"
            ):
                self.falsify(
                    vector, plan=batch(2), out=self.folder / f"{next(iter(shared))}.sqlite"
                )

    def test_attributes_in_other_processes_are_restored(self):
        vector = gymnasium.vector.AsyncVectorEnv([Slider] * 2)
        self.addCleanup(vector.close)
        space = [self.SPACE[0]]
        with warnings.catch_warnings(action="ignore"):
            self.falsify(vector, space=space, plan=batch(2))
        self.assertEqual(vector.get_attr("speed"), (0.5, 0.5))

    def test_environments_of_classes_and_with_arrays_can_be_falsified(self):
        for name, options in [
            ("Class", {}), ("Array", {"array": np.array([np.float32(1.0), 2.0])}),
            ("Type", {"config": {"gains": (1, 2)}})
        ]:
            gymnasium.register(
                f"mishandle-tests/{name}-v0", entry_point=Slider, max_episode_steps=5
            )
            self.addCleanup(gymnasium.registry.pop, f"mishandle-tests/{name}-v0")
            env = gymnasium.make(f"mishandle-tests/{name}-v0", **options)
            found = self.falsify(env, space=[self.SPACE[0]], out=self.folder / f"{name}.sqlite")
            self.assertEqual(found.simulations, 12)


ARM = """
<mujoco>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" armature="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.05" mass="{upper}"/>
      <body name="lower" pos="0.4 0 0">
        <joint name="elbow" axis="0 1 0"/>
        <geom type="box" size="0.2 0.04 0.03" pos="0.2 0 0" mass="{lower}"/>
      </body>
    </body>
  </worldbody>
  <tendon><fixed name="both">
    <joint joint="shoulder" coef="1"/><joint joint="elbow" coef="-1"/>
  </fixed></tendon>
  <actuator><motor joint="elbow" gear="3"/></actuator>
</mujoco>
"""


class Arm:
    def __init__(self, upper=1.0, lower=2.0):
        self.model = mujoco.MjModel.from_xml_string(ARM.format(upper=upper, lower=lower))


def fields(model):
    return {
        name: getattr(model, name) for name in dir(model)
        if isinstance(getattr(model, name), np.ndarray)
    }


class Masses(unittest.TestCase):
    def test_a_model_with_another_mass_is_the_one_that_mujoco_compiles(self):
        arm, expected, before = Arm(), Arm(upper=4.0, lower=0.5), fields(Arm().model)
        attributes = Attributes()
        body = mujoco.mj_name2id(arm.model, mujoco.mjtObj.mjOBJ_BODY, "upper")
        attributes.set(
            arm,
            [
                (f"model.body_mass[{body}]", 4.0), (f"model.body_mass[{body + 1}]", 0.5),
                ("model.opt.gravity[0]", 1.0)
            ]
        )
        self.assertEqual(arm.model.opt.gravity[0], 1.0)
        for name, value in fields(arm.model).items():
            np.testing.assert_allclose(
                value, getattr(expected.model, name), rtol=1e-12, atol=1e-15, err_msg=name
            )
        attributes.restore()
        self.assertEqual(arm.model.opt.gravity[0], 0.0)
        for name, value in fields(arm.model).items():
            np.testing.assert_array_equal(value, before[name], err_msg=name)

    def test_an_inertia_that_an_axis_sets_itself_stays(self):
        arm = Arm()
        attributes = Attributes()
        attributes.set(
            arm, [("model.body_mass[1]", 4.0), ("model.body_inertia[1]", [0.1, 0.2, 0.25])]
        )
        self.assertEqual(arm.model.body_inertia[1].tolist(), [0.1, 0.2, 0.25])
        attributes.restore()
        np.testing.assert_array_equal(arm.model.body_inertia, Arm().model.body_inertia)

    def test_sizes_leave_masses_behind_and_are_reported(self):
        with self.assertWarnsRegex(
            UserWarning, "sets geom_size of a MuJoCo model, which leaves the masses"
        ):
            Attributes().set(Arm(), [("model.geom_size[0, 0]", 0.1)])
