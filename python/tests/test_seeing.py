"""ONNX policies that see, through the package."""

import json
import shutil

import mishandle
from mishandle.errors import InvalidStateError, InvalidValueError
import numpy as np
import onnx
from onnx import TensorProto
from onnx_models import ModelCase, model, node


JOINTS = {"task": "point-reaching", "parts": json.dumps(["joint_positions"])}


def seeing(path, camera="over", sizes=(9, 9)):
    """Writes a policy whose action is a product of the mean color and the joints."""
    nodes = [
        node("Cast", ["image"], ["bytes"], to=TensorProto.FLOAT),
        node("Div", ["bytes", "white"], ["light"]),
        node("Transpose", ["light"], ["channels"], perm=[0, 3, 1, 2]),
        node(
            "Conv", ["channels", "kernel"], ["edges"], kernel_shape=[3, 3], strides=[2, 2]
        ),
        node("Relu", ["edges"], ["found"]),
        node("GlobalAveragePool", ["found"], ["mean"]),
        node("Flatten", ["mean"], ["features"]),
        node("Concat", ["features", "joints"], ["all"], axis=1),
        node("MatMul", ["all", "matrix"], ["action"]),
    ]
    draw = np.random.default_rng(0).normal
    weights = {
        "white": np.float32(255),
        "kernel": draw(size=(4, 3, 3, 3)).astype(np.float32),
        "matrix": draw(size=(4 + sizes[0], sizes[1])).astype(np.float32),
    }
    inputs = [("joints", ["N", sizes[0]]), ("image", ["N", 24, 32, 3], TensorProto.UINT8)]
    images = json.dumps([["image", camera]])
    outputs = [("action", ["N", sizes[1]])]
    onnx.save(model(nodes, inputs, outputs, weights, **JOINTS, images=images), path)


def remembering(path):
    """Writes a policy that sees the last two images, and plays three of the four actions that it
    predicts."""
    nodes = [
        node("Cast", ["image"], ["bytes"], to=TensorProto.FLOAT),
        node("Flatten", ["bytes"], ["pixels"]),
        node("Flatten", ["joints"], ["numbers"]),
        node("Concat", ["pixels", "numbers"], ["all"], axis=1),
        node("MatMul", ["all", "matrix"], ["flat"]),
        node("Reshape", ["flat", "shape"], ["action"]),
    ]
    weights = {
        "matrix": np.random.default_rng(1).normal(
            scale=1e-4, size=(2 * 6 * 8 * 3 + 9, 4 * 9)
        ).astype(np.float32),
        "shape": np.array([1, 4, 9]),
    }
    inputs = [("joints", [1, 9]), ("image", [1, 2, 6, 8, 3], TensorProto.UINT8)]
    facts = {"images": json.dumps([["image", "over"]]), "history": "2", "chunk": '{"execute": 3}'}
    onnx.save(model(nodes, inputs, [("action", [1, 4, 9])], weights, **JOINTS, **facts), path)


ROBOT = """<mujoco><worldbody><geom name="floor" type="plane" size="3 3 0.1"/>
  <body name="arm" pos="0 0 0.5"><joint name="hinge" axis="0 1 0" damping="0.5"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04" rgba="0.2 0.3 0.7 1"/></body>
  </worldbody>
  <actuator><motor name="torque" joint="hinge"/></actuator></mujoco>"""

TARGET = """
format = 1
name = "seen"
model.file = "seen.xml"
control = { period = 0.02, steps = 50 }
start = { hinge = "tilt" }
observation = { angle = "qpos('hinge')" }
policy.action = "action"
signals = { angle = "qpos('hinge')[0]" }
axes = { tilt = { range = [-0.3, 0.3], unit = "rad" } }
formulas = { small = "always(angle <= 2)" }
[cameras]
desk = { position = [1.5, 0, 1], look_at = [0, 0, 0], fovy = 50 }
"""


class Seeing(ModelCase):
    def test_light_changes_what_a_policy_does(self):
        seeing(self.path)
        run = lambda at: mishandle.simulate(
            "point-reaching", space="starts+light-3", policy=str(self.path), at=at
        )[0].robustness
        self.assertEqual(run({}), run({}))
        self.assertNotEqual(run({}), run({"lamp_strength": 0.3}))

    def test_a_task_without_a_named_space_starts_as_in_starts(self):
        seeing(self.path)
        run = lambda **given: mishandle.evaluate(
            "point-reaching", policy=str(self.path), episodes=2, **given
        ).success_rate
        self.assertEqual(run(), run(space="starts"))

    def test_an_unknown_camera_is_named(self):
        seeing(self.path, camera="ovre")
        with self.assertRaisesRegex(
            mishandle.MishandleError,
            "camera `ovre`, but point-reaching has only over, wrist; did you mean `over`?"
        ):
            mishandle.evaluate("point-reaching", space="starts", policy=str(self.path), episodes=1)
        for system in ("point-reaching", self.robot()):
            with self.assertRaisesRegex(
                mishandle.MishandleError,
                "camera `ovr`, but .*(; did you mean `over`|has only desk)"
            ):
                mishandle.evaluate(
                    system, policy=lambda observation: np.zeros(9), cameras=["ovr"], episodes=1
                )

    def robot(self):
        (self.path.parent / "seen.xml").write_text(ROBOT)
        file = self.path.parent / "seen.toml"
        file.write_text(TARGET)
        return file

    def recorded(self, size):
        """Returns what the policy got and did in two simulations."""
        out = self.path.parent / "recorded"
        mishandle.record(
            "point-reaching", policy=self.path, space="starts+light-3+image-3+faults-camera",
            out=out, episodes=2, seed=3, cameras=["over"], size=size,
            plan={"record": {"format": "npz"}}
        )
        with np.load(out / "data.npz") as arrays:
            starts = arrays["episode_starts"]
            names = ("observation.state", "observation.images.over", "action")
            return [
                [arrays[name][first:end] for name in names]
                for first, end in zip(starts, starts[1:])
            ]

    def test_a_loaded_controller_acts_as_in_a_simulation(self):
        for write, size in ((seeing, (32, 24)), (remembering, (8, 6))):
            write(self.path)
            controller = mishandle.load_controller(self.path)
            self.assertEqual(
                (controller.images, controller.observation_size),
                ([("over", (size[1], size[0], 3))], 27)
            )
            episodes = self.recorded(size)
            for states, images, actions in episodes:
                controller.reset()
                found = [
                    controller(state, {"over": image, "wrist": None})
                    for state, image in zip(states, images)
                ]
                self.assertEqual(executed(np.stack(found)), actions.tobytes())
                self.assertGreater(np.std(actions[:, 0]), 0)
            # Both at once, in the three forms of the same arguments.
            controller.reset()
            batches = [np.stack(both) for both in zip(*episodes)]
            for step in range(20):
                state, image, action = (batch[:, step] for batch in batches)
                arguments = [
                    (state, {"over": image}), (state, [image]), ({"state": state, "over": image},)
                ][step % 3]
                self.assertEqual(executed(controller(*arguments)), action.tobytes())
            shutil.rmtree(self.path.parent / "recorded")
        # A chunk is a memory: the rows of an episode stay the same until a reset.
        self.assertTrue(controller.is_recurrent)
        with self.assertRaisesRegex(InvalidStateError, "2 rows .* 1 were given: call `reset"):
            controller(states[0], [images[0]])
        controller.reset()
        self.assertEqual(executed(controller(states[0], [images[0]])), actions[0].tobytes())

    def test_a_policy_of_a_target_file_is_loaded_with_its_parts(self):
        seeing(self.path, sizes=(1, 1))
        description = {"parts": ["angle"], "images": [["image", "desk"]]}
        self.path.with_name("policy.onnx.json").write_text(json.dumps(description))
        file = self.robot()
        file.write_text(TARGET.replace("observation = {", 'observation = { other = "[1, 2]",'))
        with self.assertRaisesRegex(mishandle.MishandleError, "only a task has parts"):
            mishandle.load_controller(self.path)
        controller = mishandle.load_controller(self.path, task=file)
        image = np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)
        act = lambda *numbers: controller(numbers, {"desk": image})
        self.assertEqual((controller.observation_size, act(1, 2, 0.5)), (3, act(8, 9, 0.5)))
        self.assertNotEqual(act(1, 2, 0.5), act(1, 2, 0.6))
        # In a simulation, too.
        given = {"space": "starts", "trials": 1, "budget": 2, "search": "random"}
        rows = [
            mishandle.open_run(
                mishandle.falsify(file, "always(angle <= 9)", policy=policy, **how, **given).path
            ).columns()["robustness"]
            for policy, how in [
                (str(self.path), {}), (controller, {"cameras": ["desk"], "image_size": (32, 24)})
            ]
        ]
        self.assertEqual(*rows)

    def test_images_that_a_loaded_controller_cannot_use_are_named(self):
        seeing(self.path)
        controller = mishandle.load_controller(self.path)
        state, image = np.zeros(27), np.zeros((24, 32, 3), np.uint8)
        for arguments, message in [
            ((state,), "needs an image of the camera `over`; given: none"),
            ((state, {"wrist": image, "ovr": image}), "camera `over`; given: wrist, ovr"),
            (({"state": state, "wrist": image},), "camera `over`; given: wrist"),
            (({"over": image},), "expected `state`"),
            ((state, [image, image]), "number of images is 2; .* through over"),
            (
                (state, [image / 255]),
                r"`over` has the shape \(24, 32, 3\) and the type float64; "
                r"expected \(24, 32, 3\) and uint8",
            ),
            ((state, [image.transpose(2, 0, 1)]), r"the shape \(3, 24, 32\)"),
            ((np.zeros((2, 27)), [image]), r"expected \(2, 24, 32, 3\)"),
        ]:
            with self.assertRaisesRegex(mishandle.MishandleError, message):
                controller(*arguments)
        blind = mishandle.load_controller("point-reaching/ppo")
        self.assertEqual(blind.images, [])
        self.assertEqual(blind({"state": state, "over": image}).tobytes(), blind(state).tobytes())

    def test_a_shipped_policy_that_sees_is_loaded_and_keeps_nan(self):
        controller = mishandle.load_controller("point-reaching/vision")
        self.assertEqual([camera for camera, _ in controller.images], ["over", "wrist"])
        state, images = np.zeros(27), [np.zeros(shape, np.uint8) for _, shape in controller.images]
        self.assertTrue(np.isfinite(controller(state, images)).all())
        state[0] = np.nan
        self.assertTrue(np.isnan(controller(state, images)).any())
        with self.assertRaisesRegex(
            InvalidValueError, r"needs cameras=\['over', 'wrist'\], image_size=\(64, 64\)"
        ):
            mishandle.simulate("point-reaching", policy=controller, cameras=["over"])
        # A model that names cameras which its task lacks.
        seeing(self.path, camera="ovre")
        with self.assertRaisesRegex(mishandle.MishandleError, "did you mean `over`"):
            mishandle.load_controller(self.path, task="point-reaching")

    def test_a_policy_in_python_sees_what_an_onnx_policy_sees(self):
        for write, size in ((seeing, (32, 24)), (remembering, (8, 6))):
            write(self.path)
            controller = mishandle.load_controller(self.path)
            shapes = set()

            def policy(observation):
                shapes.add(
                    (
                        observation["state"].shape, observation["over"].shape,
                        observation["over"].dtype.name
                    )
                )
                return controller(observation)

            policy.reset = controller.reset
            # No random scenario violates it.
            question = {
                "formula": "always(finger_target_distance <= 9)",
                "space": "starts+light-3+faults-camera", "search": "random"
            }
            question |= {"trials": 1, "budget": 3, "seed": 2}
            expected = mishandle.falsify("point-reaching", policy=str(self.path), **question)
            # A memory is that of one simulation, or of the rows of a batch.
            asked = [(policy, {"batched_policy": False})] if write is seeing else []
            for own, how in [
                *asked, (lambda both: controller(both), {"batched_policy": True}), (controller, {})
            ]:
                if write is remembering and how:
                    own.reset = controller.reset
                found = mishandle.falsify(
                    "point-reaching", policy=own, cameras=["over"], image_size=size, **how,
                    **question
                )
                rows = [mishandle.open_run(run.path).columns() for run in (expected, found)]
                for name in ("seed", "robustness", "steps", "end", "lamp_strength"):
                    self.assertEqual(rows[0][name], rows[1][name], name)
                self.assertEqual(len(set(rows[0]["robustness"])), 3)
            self.assertLessEqual(shapes, {((27,), (size[1], size[0], 3), "uint8")})

    def test_a_replay_and_a_target_file_show_a_policy_the_images(self):
        file = self.robot()
        given = {"policy": bright, "cameras": ["desk"], "image_size": (12, 8)}
        found = mishandle.falsify(
            file, "always(angle <= 0.2)", space="starts+light-3", trials=1, budget=20, **given
        )
        self.assertEqual(found.falsified_trials, 1)
        worst = found.counterexamples[0]
        again = mishandle.replay(
            found.path, file, "always(angle <= 0.2)", space="starts+light-3", trial=1,
            number=worst.simulation, **given
        )
        self.assertEqual(again.differences, ())
        # Another size is another system.
        question = {"trials": 1, "budget": 2, "out": self.path.parent / "run.sqlite"}
        mishandle.falsify(file, **question, **given)
        mishandle.falsify(file, **question, **given, resume=True)
        with self.assertRaisesRegex(mishandle.MishandleError, "hash of the target"):
            mishandle.falsify(file, **question, **{**given, "image_size": (12, 9)}, resume=True)

    def test_one_action_for_each_row_is_needed(self):
        message = r"shape \(9, \d+\) for a batch of \d+; expected one action per row"
        for count, given in (
            (len, {}),
            (
                lambda observations: len(observations["state"]),
                {"cameras": ["over"], "image_size": (4, 4)}
            )
        ):
            policy = lambda observations: np.full((9, count(observations)), 0.1)
            with self.assertRaisesRegex(mishandle.MishandleError, message):
                mishandle.evaluate(
                    "point-reaching", policy=policy, batched_policy=True, episodes=4, **given
                )

    def test_a_nominal_scenario_without_a_verdict_is_a_warning(self):
        policy = lambda observation: np.full(9, np.nan)
        with self.assertWarnsRegex(UserWarning, "the nominal scenario .* has no verdict"):
            mishandle.simulate("point-reaching", policy=policy, cameras=["over"], image_size=(4, 4))

    def test_cameras_are_names_that_differ(self):
        for cameras in (3, "over", [3], ["over", "over"]):
            with self.assertRaisesRegex(mishandle.MishandleError, "camera"):
                mishandle.simulate("point-reaching", policy=bright, cameras=cameras)
        robot = self.robot()
        robot.write_text(TARGET.replace("desk", "state"))
        with self.assertRaisesRegex(mishandle.MishandleError, "camera `state`"):
            mishandle.simulate(robot, policy=bright, cameras=["state"], image_size=(8, 8))

    def test_cameras_without_a_policy_that_gets_images_are_errors(self):
        seeing(self.path)
        for system, given, message in [
            ("point-reaching", {"policy": str(self.path)}, "`cameras` has no effect on a target"),
            ("point-reaching", {"policy": bright, "cameras": "over"}, "expected a list of names"),
            (
                "point-reaching", {"policy": bright, "image_size": (0, 8)},
                "image_size is .*; expected a width and a height"
            ),
            (
                "point-reaching", {"policy": bright, "image_size": 64},
                "image_size is 64; expected a width and a height"
            ),
            (
                "point-reaching", {"policy": bright, "rows": 3},
                "`cameras` has no effect on a task"
            ),
            (
                "point-reaching", {"policy": bright, "space": [mishandle.Axis("x", 0, 1)]},
                "`cameras` has no effect on a task"
            ),
            (
                lambda scenario: {"y": [0.0, 1.0]},
                {"formula": "always(y <= 2)", "space": [mishandle.Axis("x", 0, 1)]},
                "`cameras` has no effect"
            ),
        ]:
            with self.assertRaisesRegex(mishandle.MishandleError, message):
                mishandle.evaluate(system, **{"cameras": ["over"], "episodes": 1, **given})


def executed(actions):
    """Returns the bytes of actions as a task executes them."""
    return np.clip(actions, -1, 1).tobytes()


def bright(observation):
    return np.full(1, observation["desk"].mean() / 255 - 0.5)
