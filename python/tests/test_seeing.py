"""ONNX policies that see, through the package."""

import json
import pathlib
import tempfile
import unittest

import mishandle
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper


def seeing(path, camera="over"):
    """Writes a policy whose action is a product of the mean color and the joints."""
    nodes = [
        helper.make_node("Cast", ["image"], ["bytes"], to=TensorProto.FLOAT),
        helper.make_node("Div", ["bytes", "white"], ["light"]),
        helper.make_node("Transpose", ["light"], ["channels"], perm=[0, 3, 1, 2]),
        helper.make_node("Conv", ["channels", "kernel"], ["edges"], kernel_shape=[3, 3], strides=[2, 2]),
        helper.make_node("Relu", ["edges"], ["found"]),
        helper.make_node("GlobalAveragePool", ["found"], ["mean"]),
        helper.make_node("Flatten", ["mean"], ["features"]),
        helper.make_node("Concat", ["features", "joints"], ["all"], axis=1),
        helper.make_node("MatMul", ["all", "matrix"], ["action"]),
    ]
    draw = np.random.default_rng(0).normal
    weights = {
        "white": np.float32(255),
        "kernel": draw(size=(4, 3, 3, 3)).astype(np.float32),
        "matrix": draw(size=(13, 9)).astype(np.float32),
    }
    graph = helper.make_graph(
        nodes, "policy",
        [helper.make_tensor_value_info("joints", TensorProto.FLOAT, ["N", 9]),
         helper.make_tensor_value_info("image", TensorProto.UINT8, ["N", 24, 32, 3])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["N", 9])],
        [numpy_helper.from_array(value, name) for name, value in weights.items()],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(made, {
        "mishandle.task": "point-reaching",
        "mishandle.parts": json.dumps(["joint_positions"]),
        "mishandle.images": json.dumps([["image", camera]]),
    })
    onnx.save(made, path)


class Seeing(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = pathlib.Path(folder.name) / "seeing.onnx"

    def test_light_changes_what_a_policy_does(self):
        seeing(self.path)
        run = lambda at: mishandle.simulate("point-reaching", space="starts+light", policy=str(self.path), at=at)[0].robustness
        self.assertEqual(run({}), run({}))
        self.assertNotEqual(run({}), run({"lamp_strength": 0.3}))

    def test_a_task_without_a_named_space_says_how_to_run_it(self):
        seeing(self.path)
        with self.assertRaisesRegex(mishandle.InvalidValueError, 'sees through cameras of a task; .* space="starts"'):
            mishandle.evaluate("point-reaching", policy=str(self.path), episodes=1)

    def test_an_unknown_camera_is_named(self):
        seeing(self.path, camera="ovre")
        with self.assertRaisesRegex(mishandle.MishandleError, "camera `ovre`, but point-reaching has only over, wrist"):
            mishandle.evaluate("point-reaching", space="starts", policy=str(self.path), episodes=1)

    def test_a_policy_that_sees_is_not_a_function_of_an_observation(self):
        seeing(self.path)
        with self.assertRaisesRegex(mishandle.InvalidValueError, "sees through the camera `over`"):
            mishandle.load_controller(self.path)


if __name__ == "__main__":
    unittest.main()
