"""Writes operators.json: models of one operator each, and the results of ONNX's reference evaluator.

    cargo xtask golden interchange-onnx

Each operator is computed at 0, -0, ±1, ±100, ±1e4 and, if it has one argument, further numbers; with all its optional
attributes, without each one, and without any. ONNX Runtime must agree; EXCEPTIONS lists where it does not.
"""

import base64
import json

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

EDGES = [0.0, -0.0, 1.0, -1.0, 100.0, -100.0, 1e4, -1e4]
MORE = [*EDGES, 0.5, -0.5, 1.5, 2.5, 20.0, -20.0, 89.0, -89.0]
ALL = [*MORE, 1e-3, 0.9999, 1e6, 1e8, np.inf, -np.inf, np.nan]
FLOAT, INT64, BOOL = TensorProto.FLOAT, TensorProto.INT64, TensorProto.BOOL
NEWEST = 22

onnxruntime.set_default_logger_severity(4)
CASES = []
# Whom to believe where the two do not agree, and why.
EXCEPTIONS = {
    "BatchNormalization": ("ONNX Runtime", "up to opset 9, the reference uses the mean of the batch, as in training"),
    "GatherElements": ("ONNX Runtime", "the reference refuses indices that are smaller than the data"),
    "LogSoftmax": ("ONNX Runtime", "the reference takes the logarithm of a number that is rounded to 0"),
    "Mean": ("ONNX Runtime", "the reference does not broadcast the first input"),
    "Pad": ("ONNX Runtime", "the reference does not crop"),
    "Relu": ("reference", "ONNX Runtime has no Relu of integers"),
}
EXCEPTIONS_MET = set()


class Graph:
    """A model with the input `o`, one row of numbers."""

    def __init__(self, size):
        self.nodes, self.weights, self.size, self.o = [], [], size, "o"

    def op(self, operator, *inputs, outputs=1, **attributes):
        """Adds an operator and returns the name of its last output."""
        names = [f"v{len(self.nodes)}_{index}" for index in range(outputs)]
        self.nodes.append(helper.make_node(operator, inputs, names, **attributes))
        return names[-1]

    def constant(self, values, kind=np.float32):
        name = f"c{len(self.weights)}"
        self.weights.append(numpy_helper.from_array(np.array(values, kind), name))
        return name

    def integers(self, *values):
        return self.constant(values, np.int64)

    def reshaped(self, value, *shape):
        return self.op("Reshape", value, self.integers(*shape))

    def model(self, result, opset):
        row = self.reshaped(self.op("Cast", result, to=FLOAT), 1, -1)
        self.nodes.append(helper.make_node("Identity", [row], ["a"]))
        info = lambda name, size: helper.make_tensor_value_info(name, FLOAT, [1, size])
        graph = helper.make_graph(self.nodes, "g", [info("o", self.size)], [info("a", None)], self.weights)
        made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
        return made


def results(made, row):
    """Returns the results of the reference evaluator and of ONNX Runtime; None where one fails."""
    with np.errstate(all="ignore"):
        reference = lambda: ReferenceEvaluator(made).run(None, {"o": row})[0]
        session = lambda: onnxruntime.InferenceSession(made.SerializeToString(), providers=["CPUExecutionProvider"])
        for run in (reference, lambda: session().run(None, {"o": row})[0]):
            try:
                yield run()
            except Exception:
                yield None


def case(operator, build, numbers=EDGES, opset=NEWEST, refused=None):
    """Adds a case: `build` returns the name of the result. `refused` is a part of our message for a model that we do
    not run."""
    graph = Graph(len(numbers))
    made = graph.model(build(graph), opset)
    row = np.array([numbers], np.float32)
    entry = {"operator": operator, "opset": opset, "numbers": text(row)}
    if refused:
        entry["refused"] = refused
    else:
        onnx.checker.check_model(made)
        expected, other = results(made, row)
        agree = expected is not None and other is not None and expected.shape == other.shape
        if not (agree and np.allclose(expected, other, rtol=2e-6, atol=2e-6, equal_nan=True)):
            reason = EXCEPTIONS.get(operator)
            assert reason, f"{operator} of opset {opset}: {expected} and by ONNX Runtime {other}\n{made.graph.node}"
            EXCEPTIONS_MET.add(operator)
            expected = other if reason[0] == "ONNX Runtime" else expected
        entry["expected"] = text(expected)
    entry["model"] = base64.b64encode(made.SerializeToString()).decode()
    CASES.append(entry)


def text(numbers):
    return " ".join(str(x).removesuffix(".0") for x in numbers.flatten())


def variants(attributes):
    """All attributes, each of them absent, and none."""
    found = [attributes]
    for name in attributes:
        found.append({other: value for other, value in attributes.items() if other != name})
    found.append({})
    return [each for index, each in enumerate(found) if each not in found[:index]]


def is_integer(operator, opset=NEWEST):
    types = onnx.defs.get_schema(operator, opset, "").type_constraints[0].allowed_type_strs
    return "tensor(int64)" in types


def unary():
    plain = """Abs Acos Asin Atan Ceil Cos Erf Exp Floor HardSwish Identity IsNaN Log Mish Neg Reciprocal Relu Round
        Sigmoid Sign Sin Softplus Softsign Sqrt Tan Tanh Flatten"""
    attributes = {
        "Elu": {"alpha": 0.3}, "LeakyRelu": {"alpha": 0.3}, "HardSigmoid": {"alpha": 0.3, "beta": 0.7}, "Gelu": {"approximate": "tanh"},
    }
    for operator in [*plain.split(), *attributes]:
        for given in variants(attributes.get(operator, {})):
            case(operator, lambda g: g.op(operator, g.o, **given), ALL)
        if operator != "Identity" and is_integer(operator):
            case(operator, lambda g: g.op(operator, g.op("Cast", g.o, to=INT64)))
    case("IsNaN", lambda g: g.op("IsNaN", g.op("Sqrt", g.o)))
    case("Not", lambda g: g.op("Not", g.op("Greater", g.o, g.constant(0))))
    case("Clip", lambda g: g.op("Clip", g.o, g.constant(-2), g.constant(3)))
    case("Clip", lambda g: g.op("Clip", g.o, "", g.constant(3)))
    case("Clip", lambda g: g.op("Clip", g.o, g.constant(-2)))
    case("Clip", lambda g: g.op("Clip", g.o))
    case("Clip", lambda g: g.op("Clip", g.op("Cast", g.o, to=INT64), g.constant(-2, np.int64), g.constant(3, np.int64)))
    for given in variants({"min": -2.0, "max": 3.0}):
        case("Clip", lambda g: g.op("Clip", g.o, **given), opset=10)
    case("Cast", lambda g: g.op("Cast", g.o, to=INT64), MORE)
    case("Cast", lambda g: g.op("Cast", g.op("Less", g.o, g.constant(0)), to=BOOL))
    case("Cast", lambda g: g.op("Cast", g.o, to=BOOL), refused="converts numbers to truth values")
    case("CastLike", lambda g: g.op("CastLike", g.o, g.constant(0, np.int64)), MORE)


def binary():
    """All pairs of the edges."""
    for operator in "Add Div Equal Greater GreaterOrEqual Less LessOrEqual Max Mean Min Mod Mul PRelu Pow Sub Sum".split():
        given = {"fmod": 1} if operator == "Mod" else {}
        pair = lambda g: (g.o, g.reshaped(g.o, -1, 1))
        if operator == "PRelu":
            pair = lambda g: (g.op("Expand", g.o, g.integers(8, 8)), g.reshaped(g.o, -1, 1))
        case(operator, lambda g: g.op(operator, *pair(g), **given))
        if is_integer(operator) and operator not in ("PRelu", "Pow"):
            # No zero: the quotient of integers by it is not defined.
            divisor = lambda g: g.constant([[1], [-1], [7], [-7], [100], [-100]], np.int64)
            for each in variants({"fmod": 1}) if operator == "Mod" else [{}]:
                case(operator, lambda g: g.op(operator, g.op("Cast", g.o, to=INT64), divisor(g), **each), [5.0, -5.0, 7.0, -8.0, 1e4, -1e4, 0.0])
    for operator in ("Max", "Mean", "Min", "Sum"):
        case(operator, lambda g: g.op(operator, g.o))
        case(operator, lambda g: g.op(operator, g.o, g.reshaped(g.o, -1, 1), g.constant(0.5)))
    case("Pow", lambda g: g.op("Pow", g.o, g.reshaped(g.constant([0, 1, 2, 3, -1, 0.5, -0.0]), -1, 1)))
    case("Pow", lambda g: g.op("Pow", g.o, g.constant(2, np.int64)), refused="`Pow`")
    case("Pow", lambda g: g.op("Pow", g.op("Cast", g.o, to=INT64), g.constant(2, np.int64)))
    for operator in ("And", "Or", "Xor"):
        truth = lambda g: g.op("Greater", g.o, g.constant(0))
        case(operator, lambda g: g.op(operator, truth(g), g.reshaped(truth(g), -1, 1)))
    case("Where", lambda g: g.op("Where", g.op("Greater", g.o, g.constant(0)), g.constant(7), g.reshaped(g.o, -1, 1)))


def reductions():
    table = lambda g: g.reshaped(g.o, 2, 2, 2)
    for operator in "ReduceL2 ReduceLogSumExp ReduceMax ReduceMean ReduceMin ReduceProd ReduceSum ReduceSumSquare".split():
        for given in variants({"keepdims": 0, "noop_with_empty_axes": 1}):
            case(operator, lambda g: g.op(operator, table(g), g.integers(0, -1), **given))
            refused = "reduces no dimension" if operator == "ReduceL2" and "noop_with_empty_axes" in given else None
            case(operator, lambda g: g.op(operator, table(g), **given), refused=refused)
        for given in variants({"keepdims": 0, "axes": [0, -1]}):
            case(operator, lambda g: g.op(operator, table(g), **given), opset=11)
        if operator in ("ReduceMax", "ReduceMin", "ReduceProd", "ReduceSum"):
            case(operator, lambda g: g.op(operator, g.op("Cast", table(g), to=INT64), g.integers(1)))
    for operator in ("Softmax", "LogSoftmax"):
        for given in variants({"axis": 0}):
            case(operator, lambda g: g.op(operator, table(g), **given))
            case(operator, lambda g: g.op(operator, g.reshaped(g.o, 2, 4), **given), [0.0, -0.0, 1.0, -1.0, 100.0, 99.0, 1e4, 9999.0])
        case(operator, lambda g: g.op(operator, g.reshaped(g.o, 2, 4)), opset=11)
        case(operator, lambda g: g.op(operator, table(g), axis=2), opset=11)
        case(operator, lambda g: g.op(operator, table(g)), opset=11, refused="reduces several dimensions")
    for given in variants({"exclusive": 1, "reverse": 1}):
        case("CumSum", lambda g: g.op("CumSum", g.reshaped(g.o, 2, 4), g.constant(1, np.int64), **given))


def shapes():
    square = lambda g: g.reshaped(g.o, 2, 4)
    for given in variants({"axis": 2}):
        case("Flatten", lambda g: g.op("Shape", g.op("Flatten", g.reshaped(g.o, 2, 2, 2), **given)))
    for given in variants({"start": 1, "end": 2}):
        case("Shape", lambda g: g.op("Shape", g.reshaped(g.o, 4, 2, 1), **given))
    case("Size", lambda g: g.op("Size", square(g)))
    case("Concat", lambda g: g.op("Concat", square(g), square(g), axis=-1))
    for given in variants({"value": numpy_helper.from_array(np.array([2], np.float32))}):
        case("ConstantOfShape", lambda g: g.op("Add", square(g), g.op("ConstantOfShape", g.integers(2, 4), **given)))
    case("Constant", lambda g: g.op("Add", g.o, g.op("Constant", value=numpy_helper.from_array(np.float32(2)))))
    case("Constant", lambda g: g.op("Add", g.o, g.op("Constant", value_float=2.5)))
    case("Constant", lambda g: g.op("Add", g.o, g.op("Constant", value_floats=[2.5])))
    case("Constant", lambda g: g.op("Reshape", g.o, g.op("Constant", value_ints=[2, 4])))
    case("Constant", lambda g: g.op("Gather", g.o, g.op("Constant", value_int=3), axis=1))
    case("Expand", lambda g: g.op("Expand", g.o, g.integers(3, 1)))
    case("Tile", lambda g: g.op("Tile", square(g), g.integers(2, 2)))
    for given in variants({"allowzero": 1}):
        case("Reshape", lambda g: g.op("Reshape", g.o, g.integers(2, -1), **given))
    case("Reshape", lambda g: g.op("Reshape", square(g), g.integers(0, 2, 2)))
    for given in variants({"perm": [1, 0, 2]}):
        case("Transpose", lambda g: g.op("Transpose", g.reshaped(g.o, 2, 1, 4), **given))
    case("Squeeze", lambda g: g.op("Shape", g.op("Squeeze", g.reshaped(g.o, 1, 8, 1), g.integers(0))))
    case("Squeeze", lambda g: g.op("Shape", g.op("Squeeze", g.reshaped(g.o, 1, 8, 1))))
    case("Unsqueeze", lambda g: g.op("Shape", g.op("Unsqueeze", g.o, g.integers(0, -1))))
    case("Squeeze", lambda g: g.op("Shape", g.op("Squeeze", g.reshaped(g.o, 1, 8, 1), axes=[-1])), opset=11)
    case("Unsqueeze", lambda g: g.op("Shape", g.op("Unsqueeze", g.o, axes=[0])), opset=11)
    case("Slice", lambda g: g.op("Slice", square(g), g.integers(0, 1), g.integers(2, 3)))
    case("Slice", lambda g: g.op("Slice", square(g), g.integers(1), g.integers(2**62), g.integers(1)))
    case("Slice", lambda g: g.op("Slice", square(g), g.integers(-1), g.integers(-100), g.integers(1), g.integers(-2)))
    for given in variants({"axes": [1, 0]}):
        case("Slice", lambda g: g.op("Slice", square(g), starts=[0, 1], ends=[1, 2], **given), opset=9)
    case("Split", lambda g: g.op("Split", square(g), num_outputs=2, outputs=2))
    case("Split", lambda g: g.op("Split", square(g), g.integers(1, 3), axis=1, outputs=2))
    case("Split", lambda g: g.op("Split", g.o, num_outputs=3, axis=1, outputs=3))
    case("Split", lambda g: g.op("Split", square(g), split=[1, 3], axis=1, outputs=2), opset=11)
    case("Split", lambda g: g.op("Split", square(g), outputs=2), opset=11)
    pads = [1, 0, 0, 2]
    for mode in ("constant", "reflect", "edge", "wrap"):
        case("Pad", lambda g: g.op("Pad", square(g), g.integers(*pads), mode=mode))
        if mode != "wrap":
            case("Pad", lambda g: g.op("Pad", square(g), mode=mode, pads=pads), opset=10)
    case("Pad", lambda g: g.op("Pad", square(g), g.integers(*pads)))
    case("Pad", lambda g: g.op("Pad", square(g), g.integers(*pads), g.constant(7)))
    case("Pad", lambda g: g.op("Pad", g.op("Cast", square(g), to=INT64), g.integers(*pads), g.constant(7, np.int64)))
    case("Pad", lambda g: g.op("Pad", square(g), g.integers(-1, 0, 1, -2), g.constant(7)))
    case("Pad", lambda g: g.op("Pad", square(g), pads=pads, value=7.0), opset=10)
    case("Pad", lambda g: g.op("Pad", square(g), g.integers(1, 2), g.constant(7), g.integers(1)), refused="`axes`")
    case("Pad", lambda g: g.op("Pad", g.reshaped(g.o, 1, 1, 8), g.integers(0, 0, 7, 0, 0, 7), mode="reflect"))
    case("Pad", lambda g: g.op("Pad", g.reshaped(g.o, 1, 1, 8), g.integers(0, 0, 8, 0, 0, 0), mode="reflect"), refused="mirrors")


def gathers():
    table = lambda g: g.reshaped(g.o, 2, 2, 2)
    for given in variants({"axis": 1}):
        case("Gather", lambda g: g.op("Gather", table(g), g.integers(1, -1, 0), **given))
        case("GatherElements", lambda g: g.op("GatherElements", table(g), g.constant([[[1, -1]], [[0, 1]]], np.int64), **given))
    case("GatherElements", lambda g: g.op("GatherElements", g.o, g.constant([[3, 1, -8, 2, 0]], np.int64), axis=-1))
    for given in variants({"batch_dims": 1}):
        case("GatherND", lambda g: g.op("GatherND", table(g), g.constant([[[1], [-1], [0]], [[0], [1], [-2]]], np.int64), **given))
        case("GatherND", lambda g: g.op("GatherND", table(g), g.constant([[1, 0], [0, -1]], np.int64), **given))
    case("GatherND", lambda g: g.op("GatherND", table(g), g.constant([[1, 0, 1], [0, -1, 0]], np.int64)))
    # x[:, [3, 1, 0, 2]] by PyTorch's exporter.
    case(
        "GatherND",
        lambda g: g.op("Transpose", g.op("GatherND", g.op("Transpose", g.o, perm=[1, 0]), g.constant([[3], [1], [0], [2]], np.int64)), perm=[1, 0]),
    )


def products():
    matrix = lambda g: g.reshaped(g.o, 2, 4)
    weights = lambda g, *shape: g.reshaped(g.constant(np.sin(np.arange(np.prod(shape)))), *shape)
    case("MatMul", lambda g: g.op("MatMul", matrix(g), weights(g, 4, 3)))
    case("MatMul", lambda g: g.op("MatMul", matrix(g), weights(g, 4)))
    case("MatMul", lambda g: g.op("MatMul", weights(g, 3, 1, 2), matrix(g)))
    for given in variants({"alpha": 0.5, "beta": 0.3, "transA": 1, "transB": 1}):
        a = lambda g: g.op("Transpose", matrix(g)) if "transA" in given else matrix(g)
        b = lambda g: weights(g, 3, 4) if "transB" in given else weights(g, 4, 3)
        case("Gemm", lambda g: g.op("Gemm", a(g), b(g), weights(g, 3), **given))
        case("Gemm", lambda g: g.op("Gemm", a(g), b(g), **given))
    case("Gemm", lambda g: g.op("Gemm", matrix(g), weights(g, 4, 3), weights(g, 3)), opset=7)
    image = lambda g: g.reshaped(g.o, 1, 2, 4, 2)
    kernel = {"kernel_shape": [2, 2]}
    optional = {"dilations": [2, 1], "pads": [1, 0, 0, 1], "strides": [2, 1]}
    for given in variants(optional):
        case("Conv", lambda g: g.op("Conv", image(g), weights(g, 2, 2, 2, 2), weights(g, 2), **kernel, **given), MORE)
    case("Conv", lambda g: g.op("Conv", image(g), weights(g, 2, 2, 2, 2), **kernel), MORE)
    case("Conv", lambda g: g.op("Conv", image(g), weights(g, 2, 1, 2, 2), group=2, **kernel), MORE)
    case("Conv", lambda g: g.op("Conv", g.reshaped(g.o, 1, 2, 8), weights(g, 3, 2, 3), kernel_shape=[3], pads=[1, 1]), MORE)
    del optional["dilations"]
    for operator in ("AveragePool", "MaxPool"):
        for given in variants({**optional, "count_include_pad": 1} if operator == "AveragePool" else optional):
            case(operator, lambda g: g.op(operator, image(g), **kernel, **given), MORE)
        case(operator, lambda g: g.op(operator, image(g), ceil_mode=1, **kernel), MORE, refused="ceil_mode")
        case(operator, lambda g: g.op(operator, image(g), auto_pad="SAME_UPPER", **kernel), MORE, refused="auto_pad")
        case(operator, lambda g: g.op(operator, image(g), dilations=[2, 1], **kernel), MORE, refused="dilations")
    case("MaxPool", lambda g: g.op("MaxPool", image(g), outputs=2, **kernel), MORE, refused="MaxPool")
    case("GlobalAveragePool", lambda g: g.op("GlobalAveragePool", image(g)), MORE)


def normalizations():
    image = lambda g: g.reshaped(g.o, 2, 4, 2)
    weights = lambda g, size: g.constant(np.sin(1 + np.arange(size)))
    squares = lambda g, size: g.constant(1 + np.cos(np.arange(size)) ** 2)
    for given in variants({"epsilon": 0.1, "momentum": 0.5}):
        for opset in (NEWEST, 9):
            case(
                "BatchNormalization",
                lambda g: g.op("BatchNormalization", image(g), weights(g, 4), weights(g, 4), weights(g, 4), squares(g, 4), **given), MORE, opset,
            )
    case(
        "BatchNormalization",
        lambda g: g.op("BatchNormalization", image(g), weights(g, 4), weights(g, 4), weights(g, 4), squares(g, 4), training_mode=1, outputs=3),
        MORE, refused="training_mode",
    )
    for given in variants({"epsilon": 0.1}):
        case("InstanceNormalization", lambda g: g.op("InstanceNormalization", image(g), weights(g, 4), weights(g, 4), **given), MORE)
        case("GroupNormalization", lambda g: g.op("GroupNormalization", image(g), weights(g, 4), weights(g, 4), num_groups=2, **given), MORE)
    case(
        "GroupNormalization",
        lambda g: g.op("GroupNormalization", image(g), weights(g, 2), weights(g, 2), num_groups=2), MORE, 18, refused="opset 21",
    )
    case("GroupNormalization", lambda g: g.op("GroupNormalization", g.reshaped(g.o, 1, 4, 2, 2), weights(g, 4), weights(g, 4), num_groups=1), MORE)
    for given in variants({"axis": 1, "epsilon": 0.1}):
        shape = (4, 2) if "axis" in given else (2,)
        scale = lambda g: g.reshaped(weights(g, int(np.prod(shape))), *shape)
        case("LayerNormalization", lambda g: g.op("LayerNormalization", image(g), scale(g), scale(g), **given), MORE)
        case("LayerNormalization", lambda g: g.op("LayerNormalization", image(g), scale(g), **given), MORE)
    case("LayerNormalization", lambda g: g.op("LayerNormalization", image(g), weights(g, 2), outputs=3), MORE, refused="LayerNormalization")


def recurrences():
    sequence = lambda g: g.reshaped(g.o, 4, 1, 2)
    weights = lambda g, *shape: g.reshaped(g.constant(np.sin(np.arange(np.prod(shape)))), *shape)
    small = [0.0, -0.0, 1.0, -1.0, 100.0, -100.0, 0.3, -0.7]
    for operator, gates in (("LSTM", 4), ("GRU", 3)):
        def run(g, inputs=3, outputs=1, **given):
            directions = 2 if given.get("direction") == "bidirectional" else 1
            state = [weights(g, directions, 1, 3)] * (2 if operator == "LSTM" else 1)
            known = [
                sequence(g), weights(g, directions, gates * 3, 2), weights(g, directions, gates * 3, 3),
                weights(g, directions, gates * 6), "", *state,
            ]
            if operator == "GRU":
                given = {"linear_before_reset": 1, **given}
            return g.op(operator, *known[:inputs], outputs=outputs, hidden_size=3, **given)

        for numbers in (EDGES, small):
            for inputs in (3, 4, 7):
                for outputs in range(1, 4 if operator == "LSTM" else 3):
                    case(operator, lambda g: run(g, inputs, outputs), numbers)
            for direction in ("forward", "reverse", "bidirectional"):
                case(operator, lambda g: run(g, 7, direction=direction), numbers)
        case(operator, lambda g: run(g, clip=0.5), small, refused="clip")
        case(operator, lambda g: run(g, layout=1), small, refused="layout")
        case(operator, lambda g: run(g, activations=["Tanh"] * (gates - 1)), small, refused="activations")
    case("GRU", lambda g: run(g, linear_before_reset=0), small, refused="linear_before_reset")
    peepholes = lambda g: g.op(
        "LSTM", sequence(g), weights(g, 1, 12, 2), weights(g, 1, 12, 3), "", "", "", "", weights(g, 1, 9), hidden_size=3
    )
    case("LSTM", peepholes, small, refused="LSTM")


def main():
    for part in (unary, binary, reductions, shapes, gathers, products, normalizations, recurrences):
        part()
    assert EXCEPTIONS_MET == set(EXCEPTIONS), EXCEPTIONS_MET
    with open("operators.json", "w", encoding="utf-8") as file:
        lines = ",\n".join(json.dumps(each) for each in CASES)
        file.write(f"[\n{lines}\n]\n")


if __name__ == "__main__":
    main()
