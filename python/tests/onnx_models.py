"""ONNX models for tests."""

from cases import FolderCase
import numpy as np
from onnx import TensorProto, helper, numpy_helper

node = helper.make_node


class ModelCase(FolderCase):
    """A test with the path of a model."""

    def setUp(self):
        super().setUp()
        self.path = self.folder / "policy.onnx"


def numbers(*shape, seed=0):
    return (np.random.default_rng(seed).normal(size=shape) * 0.3).astype(np.float32)


def model(nodes, inputs, outputs, weights=(), opset=17, **properties):
    """Inputs and outputs are pairs of name and shape, or triples with the type."""
    info = lambda name, shape, kind=TensorProto.FLOAT: helper.make_tensor_value_info(
        name, kind, shape
    )
    graph = helper.make_graph(
        nodes, "policy", [info(*each) for each in inputs], [info(*each) for each in outputs],
        [numpy_helper.from_array(value, name) for name, value in dict(weights).items()],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    helper.set_model_props(made, {f"mishandle.{key}": value for key, value in properties.items()})
    return made
