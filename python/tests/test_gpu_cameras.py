"""Tests of the cameras on the device ``gpu``, with the kernels on the CPU."""

import os
import re
import types
import unittest
from pathlib import Path

import numpy as np

os.environ["MISHANDLE_GPU_DEVICE"] = "cpu"
try:
    import mujoco
    from mishandle.gpu.cameras import Cameras, wp
except ImportError:
    mujoco = None

from mishandle.errors import InvalidValueError

STATES = 4


def states_of(cameras):
    """Returns states in which the robot moves, and those ten physics steps before."""
    model = mujoco.MjModel.from_xml_string(cameras.document)
    data = mujoco.MjData(model)
    specification = mujoco.mjtState.mjSTATE_INTEGRATION
    random = np.random.default_rng(1)
    data.ctrl[:] = data.qpos[: model.nu] + 0.4 * random.standard_normal(model.nu)
    found = []
    for _ in range(STATES + 1):
        mujoco.mj_step(model, data, nstep=10)
        state = np.zeros(mujoco.mj_stateSize(model, specification))
        mujoco.mj_getState(model, data, state, specification)
        found.append(state)
    return model, data, np.array(found[1:]), np.array(found[:-1])


def images_of_cpu(cameras, states, before, values, seeds):
    """Returns the images that the crate ``mishandle-camera`` draws."""
    count = len(states)
    numbers = np.arange(count)
    images = cameras._native.images(
        states, before, values, states, numbers.astype(np.int32), seeds.astype(np.uint64),
        numbers.astype(np.uint64)
    )
    width, height = cameras.size
    return images.reshape(-1, height, width, 3)


@unittest.skipIf(mujoco is None, "needs mujoco-warp")
class CamerasTest(unittest.TestCase):
    def check(self, task, size, scenarios=None):
        cameras = Cameras(task, size=size, threads=1)
        _, _, states, before = states_of(cameras)
        values = cameras.draw(5, STATES) if scenarios is None else cameras._native.values(scenarios)
        seeds = np.arange(STATES) + 2**40
        images = cameras.render(states, values, seeds=seeds, before=before).numpy()
        expected = images_of_cpu(cameras, states, before, values, seeds)
        np.testing.assert_array_equal(images, expected)
        # An image of one color would prove nothing.
        self.assertTrue((expected.reshape(len(expected), -1).std(axis=1) > 5).all())

    def test_images_have_the_bytes_of_the_cpu(self):
        for task in ("ball-balancing", "cloth-placing"):
            with self.subTest(task):
                self.check(task, (32, 32), [{}] * STATES)

    def test_images_under_random_axes_have_the_bytes_of_the_cpu(self):
        """All axes of sight differ from their nominal values: soft shadows, patterns, distractors,
        lens, shutter, noise and compression. No side is a whole number of blocks."""
        for task in ("door-opening", "cloth-placing"):
            with self.subTest(task):
                self.check(task, (37, 29))

    def test_each_effect_changes_an_image(self):
        cameras = Cameras("cube-stacking", size=(32, 32), names=["over"], threads=1)
        _, _, states, before = states_of(cameras)
        changes = [
            {"lamp_x": 0.8}, {"lamp_radius": 0.09}, {"distractor_count": 3},
            {"floor_pattern": "wood", "floor_contrast": 0.4}, {"over_camera_yaw": 0.05},
            {"occlusion_size": 0.3}
        ]
        kinds = ["gaussian-noise", "blur", "warm", "vignette", "compression", "defocus"]
        changes += [{"corruption": kind, "corruption_severity": 3} for kind in kinds]
        images = cameras.render(
            np.repeat(states[:1], len(changes) + 1, axis=0), [{}, *changes],
            steps=np.zeros(len(changes) + 1)
        ).numpy()
        self.assertEqual(len({image.tobytes() for image in images}), len(changes) + 1)
        # The rows of states choose scenarios, and images do not depend on their neighbors.
        sights = cameras.sights([{}, *changes], np.repeat(states[:1], len(changes) + 1, axis=0))
        again = cameras.render(states[[0, 0]], sights, rows=[3, 0], steps=[0, 0]).numpy()
        np.testing.assert_array_equal(again, images[[3, 0]])

    def test_poses_of_worlds_give_the_images_of_their_states(self):
        cameras = Cameras("cloth-placing", size=(32, 32), threads=1)
        model, data, states, _ = states_of(cameras)
        positions, quaternions = [], []
        for state in states:
            mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
            mujoco.mj_kinematics(model, data)
            positions.append(data.xpos.copy())
            quaternions.append(data.xquat.copy())
        world = types.SimpleNamespace(
            xpos=wp.array(np.array(positions, np.float32), dtype=wp.vec3, ndim=2, device="cpu"),
            xquat=wp.array(np.array(quaternions, np.float32), dtype=wp.quat, ndim=2, device="cpu"),
        )
        sights = cameras.sights([{}], states[:1])
        rows = np.zeros(STATES, int)
        found = cameras.render(
            cameras.poses_of_worlds(world), sights, rows=rows
        ).numpy().astype(int)
        expected = cameras.render(states, sights, rows=rows).numpy().astype(int)
        # Quaternions in single precision move edges by less than a pixel.
        self.assertLess((np.abs(found - expected).max(axis=-1) > 2).mean(), 0.005)

    def test_the_example_of_the_guide_runs(self):
        page = (Path(__file__).parents[2] / "docs/guide/gpu.md").read_text()
        (example,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
        found = {}
        exec(example, found)
        self.assertEqual(found["images"].shape, (4, 64, 64, 3))

    def test_what_cannot_be_rendered_is_an_error(self):
        with self.assertRaisesRegex(InvalidValueError, "no camera `top`; choose from: over, wrist"):
            Cameras("cube-stacking", names=["top"], threads=1)
        with self.assertRaisesRegex(InvalidValueError, "`faults-camera` moves images in time"):
            Cameras("cube-stacking", space="light-3+faults-camera", threads=1)
        with self.assertRaisesRegex(InvalidValueError, "each side must be from 1 to 1024"):
            Cameras("cube-stacking", size=(0, 64), threads=1)
        cameras = Cameras("cube-stacking", size=(8, 8), threads=1)
        _, _, states, before = states_of(cameras)
        for message, scenarios, keywords in (
            ("`lamp_xx`", [{"lamp_xx": 1.0}] * STATES, {}),
            ("lamp_x", [{"lamp_x": 9.0}] * STATES, {}),
            (
                "`motion-blur` needs the states before",
                [{"corruption": "motion-blur", "corruption_severity": 3}] * STATES, {}
            ),
            ("rows must be one of 2 scenarios for each of 4 states", [{}] * 2, {}),
            ("4 states need as many states before, found 2", [{}] * STATES, {"before": before[:2]}),
            ("seeds must be one number for each of 4 states", [{}] * STATES, {"seeds": [1]}),
        ):
            with self.subTest(message), self.assertRaisesRegex(InvalidValueError, message):
                cameras.render(states, scenarios, **keywords)
        with self.assertRaisesRegex(InvalidValueError, "states must have"):
            cameras.render(states[:, :5], [{}] * STATES)
