"""Writes operators.json: models of one operator each, and the results of ONNX's reference evaluator.

    cargo xtask golden interchange-onnx

Each operator is computed at 0, -0, ±1, ±100, ±1e4 and, if it has one argument, at further numbers; with all its
optional attributes, without each one, and without any. ONNX Runtime must agree; EXCEPTIONS lists where it does not.
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
SMALL = [0.0, -0.0, 1.0, -1.0, 100.0, -100.0, 0.3, -0.7]
# Operators of which ONNX Runtime is right where the two do not agree, and why.
EXCEPTIONS = {
    "BatchNormalization": "up to opset 9, the reference uses the mean of the batch, as in training",
    "GatherElements": "the reference refuses indices that are smaller than the data",
    "LogSoftmax": "the reference takes the logarithm of a number that is rounded to 0",
    "Mean": "the reference does not broadcast the first input",
    "Pad": "the reference does not crop",
}

onnxruntime.set_default_logger_severity(4)
exceptions_met = set()
cases = []


class Graph:
    """The operators of a model with the input `o`, one row of numbers.

    Inputs of operators are names, functions of the graph, constants, or lists of integers.
    """

    def __init__(self):
        self.nodes, self.weights = [], []

    def op(self, operator, *inputs, outputs=1, **attributes):
        """Adds an operator and returns the name of its last output."""
        inputs = [self.name(each) for each in inputs]
        names = [f"v{len(self.nodes)}_{index}" for index in range(outputs)]
        self.nodes.append(helper.make_node(operator, inputs, names, **attributes))
        return names[-1]

    def name(self, value):
        if isinstance(value, str):
            return value
        if callable(value):
            return value(self)
        array = np.array(value, np.int64) if isinstance(value, list) else value
        self.weights.append(numpy_helper.from_array(array, f"c{len(self.weights)}"))
        return self.weights[-1].name

    def model(self, result, size, opset):
        result = self.op("Cast", result, to=TensorProto.FLOAT)
        self.nodes.append(helper.make_node("Flatten", [result], ["a"], axis=0))
        info = lambda name, size: helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, size])
        graph = helper.make_graph(self.nodes, "g", [info("o", size)], [info("a", None)], self.weights)
        return helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)


def then(operator, *inputs, **attributes):
    return lambda graph: graph.op(operator, *inputs, **attributes)


def shaped(*shape, value="o"):
    return then("Reshape", value, list(shape))


def integers(value="o"):
    return then("Cast", value, to=TensorProto.INT64)


def number(value, kind=np.float32):
    return np.array(value, kind)


def weights(*shape):
    return np.sin(1 + np.arange(np.prod(shape))).astype(np.float32).reshape(shape)


POSITIVE = then("Greater", "o", number(0))


def results(made, row):
    """Yields the results of the reference evaluator and of ONNX Runtime; None where one fails."""
    reference = lambda: ReferenceEvaluator(made)
    session = lambda: onnxruntime.InferenceSession(made.SerializeToString(), providers=["CPUExecutionProvider"])
    for evaluator in (reference, session):
        try:
            with np.errstate(all="ignore"):
                yield evaluator().run(None, {"o": row})[0]
        except Exception:
            yield None


def case(operator, *inputs, numbers=EDGES, opset=22, refused=None, shape=False, **attributes):
    """Adds a case. `refused` is a part of our message for a model that we do not run; with `shape`, the result is the
    shape of the output."""
    graph = Graph()
    result = graph.op(operator, *inputs, **attributes)
    made = graph.model(graph.op("Shape", result) if shape else result, len(numbers), opset)
    row = np.array([numbers], np.float32)
    entry = {"operator": operator, "opset": opset, "numbers": text(row)}
    if refused:
        entry["refused"] = refused
    else:
        onnx.checker.check_model(made)
        expected, other = results(made, row)
        agree = expected is not None and other is not None and expected.shape == other.shape
        if not (agree and np.allclose(expected, other, rtol=2e-6, atol=2e-6, equal_nan=True)):
            message = f"{operator} of opset {opset}: {expected}, by ONNX Runtime {other}\n{made.graph.node}"
            assert operator in EXCEPTIONS, message
            exceptions_met.add(operator)
            expected = other
        entry["expected"] = text(expected)
    entry["model"] = base64.b64encode(made.SerializeToString()).decode()
    cases.append(entry)


def text(numbers):
    return " ".join(str(x).removesuffix(".0") for x in numbers.flatten())


def variants(**attributes):
    """All attributes, each of them absent, and none."""
    found = [attributes]
    for name in attributes:
        found.append({other: value for other, value in attributes.items() if other != name})
    found.append({})
    return [each for index, each in enumerate(found) if each not in found[:index]]


def takes_integers(operator):
    types = onnx.defs.get_schema(operator, 22, "").type_constraints[0].allowed_type_strs
    return "tensor(int64)" in types


def unary():
    plain = """Abs Acos Asin Atan Ceil Cos Erf Exp Flatten Floor HardSwish Identity IsNaN Log Mish Neg Reciprocal Relu
        Round Sigmoid Sign Sin Softplus Softsign Sqrt Tan Tanh"""
    attributes = {
        "Elu": {"alpha": 0.3}, "LeakyRelu": {"alpha": 0.3}, "HardSigmoid": {"alpha": 0.3, "beta": 0.7},
        "Gelu": {"approximate": "tanh"},
    }
    for operator in [*plain.split(), *attributes]:
        for given in variants(**attributes.get(operator, {})):
            case(operator, "o", numbers=ALL, **given)
        if takes_integers(operator):
            # ONNX Runtime has no `Relu` of integers, either.
            case(operator, integers(), refused="cannot be computed" if operator == "Relu" else None)
    case("Not", POSITIVE)
    case("Clip", "o", number(-2), number(3))
    case("Clip", "o", "", number(3))
    case("Clip", "o", number(-2))
    case("Clip", "o")
    case("Clip", integers(), number(-2, np.int64), number(3, np.int64))
    for given in variants(min=-2.0, max=3.0):
        case("Clip", "o", opset=10, **given)
    case("Cast", "o", numbers=MORE, to=TensorProto.INT64)
    case("Cast", then("Not", POSITIVE), to=TensorProto.BOOL)
    case("Cast", "o", to=TensorProto.BOOL, refused="converts numbers to truth values")
    case("CastLike", "o", number(0, np.int64), numbers=MORE)


def binary():
    """All pairs of the edges."""
    column = shaped(-1, 1)
    for operator in "Add Div Equal Greater GreaterOrEqual Less LessOrEqual Max Mean Min Mul Pow Sub Sum".split():
        case(operator, "o", column)
    case("Mod", "o", column, fmod=1)
    case("PRelu", then("Expand", "o", [8, 8]), column)
    # No zero: the quotient of integers by it is not defined.
    divisors = number([[1], [-1], [7], [-7], [100], [-100]], np.int64)
    for operator in "Add Div Equal Greater GreaterOrEqual Less LessOrEqual Max Min Mod Mul Sub".split():
        for given in variants(fmod=1) if operator == "Mod" else [{}]:
            case(operator, integers(), divisors, numbers=[5.0, -5.0, 7.0, -8.0, 1e4, -1e4, 0.0], **given)
    for operator in ("Max", "Mean", "Min", "Sum"):
        case(operator, "o")
        case(operator, "o", column, number(0.5))
    case("Pow", "o", number([[0], [1], [2], [3], [-1], [0.5], [-0.0]]))
    case("Pow", integers(), number(2, np.int64))
    case("Pow", "o", number(2, np.int64), refused="`Pow`")
    for operator in ("And", "Or", "Xor"):
        case(operator, POSITIVE, shaped(-1, 1, value=POSITIVE))
    case("Where", POSITIVE, number(7), column)


def reductions():
    cube, table = shaped(2, 2, 2), shaped(2, 4)
    for operator in "L2 LogSumExp Max Mean Min Prod Sum SumSquare".split():
        operator = f"Reduce{operator}"
        for given in variants(keepdims=0, noop_with_empty_axes=1):
            case(operator, cube, [0, -1], **given)
            is_wrong = operator == "ReduceL2" and "noop_with_empty_axes" in given
            case(operator, cube, refused="reduces no dimension" if is_wrong else None, **given)
        for given in variants(keepdims=0, axes=[0, -1]):
            case(operator, cube, opset=11, **given)
        if operator in ("ReduceMax", "ReduceMin", "ReduceProd", "ReduceSum"):
            case(operator, integers(cube), [1])
    for operator in ("Softmax", "LogSoftmax"):
        for given in variants(axis=0):
            case(operator, cube, **given)
            case(operator, table, numbers=[0.0, -0.0, 1.0, -1.0, 100.0, 99.0, 1e4, 9999.0], **given)
        case(operator, table, opset=11)
        case(operator, cube, opset=11, axis=2)
        case(operator, cube, opset=11, refused="reduces several dimensions")
    for given in variants(exclusive=1, reverse=1):
        case("CumSum", table, number(1, np.int64), **given)


def shapes():
    table = shaped(2, 4)
    for given in variants(axis=2):
        case("Flatten", shaped(2, 2, 2), shape=True, **given)
    for given in variants(start=1, end=2):
        case("Shape", shaped(4, 2, 1), **given)
    case("Size", table)
    case("Concat", table, table, axis=-1)
    for given in variants(value=numpy_helper.from_array(number([2]))):
        case("ConstantOfShape", [2, 4], **given)
    case("Constant", value=numpy_helper.from_array(number([2, 3])))
    case("Constant", value_float=2.5)
    case("Constant", value_floats=[2.5, 3])
    case("Constant", value_int=3)
    case("Constant", value_ints=[2, 4])
    case("Expand", "o", [3, 1])
    case("Tile", table, [2, 2])
    for given in variants(allowzero=1):
        case("Reshape", "o", [2, -1], **given)
    case("Reshape", table, [0, 2, 2])
    for given in variants(perm=[1, 0, 2]):
        case("Transpose", shaped(2, 1, 4), **given)
    case("Squeeze", shaped(1, 8, 1), [0], shape=True)
    case("Squeeze", shaped(1, 8, 1), shape=True)
    case("Squeeze", shaped(1, 8, 1), shape=True, opset=11, axes=[-1])
    case("Unsqueeze", "o", [0, -1], shape=True)
    case("Unsqueeze", "o", shape=True, opset=11, axes=[0])
    case("Slice", table, [0, 1], [2, 3])
    case("Slice", table, [1], [2**62], [1])
    case("Slice", table, [-1], [-100], [1], [-2])
    for given in variants(axes=[1, 0]):
        case("Slice", table, opset=9, starts=[0, 1], ends=[1, 2], **given)
    case("Split", table, num_outputs=2, outputs=2)
    case("Split", table, [1, 3], axis=1, outputs=2)
    case("Split", "o", num_outputs=3, axis=1, outputs=3)
    case("Split", table, opset=11, split=[1, 3], axis=1, outputs=2)
    case("Split", table, opset=11, outputs=2)
    pads = [1, 0, 0, 2]
    for given in variants(mode="reflect") + [{"mode": "constant"}, {"mode": "edge"}, {"mode": "wrap"}]:
        case("Pad", table, pads, **given)
        if given.get("mode") != "wrap":
            case("Pad", table, opset=10, pads=pads, **given)
    case("Pad", table, pads, number(7))
    case("Pad", table, opset=10, pads=pads, value=7.0)
    case("Pad", integers(table), pads, number(7, np.int64))
    case("Pad", table, [-1, 0, 1, -2], number(7))
    case("Pad", shaped(1, 1, 8), [0, 0, 7, 0, 0, 7], mode="reflect")
    case("Pad", shaped(1, 1, 8), [0, 0, 8, 0, 0, 0], mode="reflect", refused="mirrors more numbers")
    case("Pad", table, [1, 2], number(7), [1], refused="`axes`")


def gathers():
    cube, pairs = shaped(2, 2, 2), number([[1, 0], [0, -1]], np.int64)
    for given in variants(axis=1):
        case("Gather", cube, [1, -1, 0], **given)
        case("GatherElements", cube, number([[[1, -1]], [[0, 1]]], np.int64), **given)
    case("GatherElements", "o", number([[3, 1, -8, 2, 0]], np.int64), axis=-1)
    for given in variants(batch_dims=1):
        case("GatherND", cube, number([[[1], [-1], [0]], [[0], [1], [-2]]], np.int64), **given)
        case("GatherND", cube, pairs, **given)
    case("GatherND", cube, number([[1, 0, 1], [0, -1, 0]], np.int64))
    # x[:, [3, 1, 0, 2]], as PyTorch's exporter writes it.
    case("GatherND", then("Transpose", "o", perm=[1, 0]), number([[3], [1], [0], [2]], np.int64), batch_dims=0)


def products():
    table, image = shaped(2, 4), shaped(1, 2, 4, 2)
    case("MatMul", table, weights(4, 3))
    case("MatMul", table, weights(4))
    case("MatMul", weights(3, 1, 2), table)
    for given in variants(alpha=0.5, beta=0.3, transA=1, transB=1):
        a = then("Transpose", table) if "transA" in given else table
        b = weights(3, 4) if "transB" in given else weights(4, 3)
        case("Gemm", a, b, weights(3), **given)
        case("Gemm", a, b, **given)
    case("Gemm", table, weights(4, 3), weights(3), opset=7)
    given = {"numbers": MORE, "kernel_shape": [2, 2]}
    for optional in variants(dilations=[2, 1], pads=[1, 0, 0, 1], strides=[2, 1]):
        case("Conv", image, weights(2, 2, 2, 2), weights(2), **given, **optional)
    case("Conv", image, weights(2, 2, 2, 2), **given)
    case("Conv", image, weights(2, 1, 2, 2), group=2, **given)
    case("Conv", shaped(1, 2, 8), weights(3, 2, 3), numbers=MORE, kernel_shape=[3], pads=[1, 1])
    for operator, own in (("AveragePool", {"count_include_pad": 1}), ("MaxPool", {})):
        for optional in variants(pads=[1, 0, 0, 1], strides=[2, 1], **own):
            case(operator, image, **given, **optional)
        case(operator, image, ceil_mode=1, refused="ceil_mode", **given)
        case(operator, image, auto_pad="SAME_UPPER", refused="auto_pad", **given)
        case(operator, image, dilations=[2, 1], refused="dilations", **given)
    case("MaxPool", image, outputs=2, refused="MaxPool", **given)
    case("GlobalAveragePool", image, numbers=MORE)


def normalizations():
    image, scale = shaped(2, 4, 2), weights(4)
    statistics = [scale, weights(4), weights(4), 1 + weights(4) ** 2]
    for given in variants(epsilon=0.1, momentum=0.5):
        case("BatchNormalization", image, *statistics, numbers=MORE, **given)
        case("BatchNormalization", image, *statistics, numbers=MORE, opset=9, **given)
    training = {"training_mode": 1, "outputs": 3, "refused": "training_mode"}
    case("BatchNormalization", image, *statistics, numbers=MORE, **training)
    for given in variants(epsilon=0.1):
        case("InstanceNormalization", image, scale, weights(4), numbers=MORE, **given)
        case("GroupNormalization", image, scale, weights(4), numbers=MORE, num_groups=2, **given)
    case("GroupNormalization", shaped(1, 4, 2, 2), scale, weights(4), numbers=MORE, num_groups=1)
    case("GroupNormalization", image, weights(2), weights(2), opset=18, num_groups=2, refused="opset 21")
    for given in variants(axis=1, epsilon=0.1):
        size = (4, 2) if "axis" in given else (2,)
        case("LayerNormalization", image, weights(*size), weights(*size), numbers=MORE, **given)
        case("LayerNormalization", image, weights(*size), numbers=MORE, **given)
    case("LayerNormalization", image, weights(2), numbers=MORE, outputs=3, refused="LayerNormalization")


def recurrences():
    """Sequences of four steps, with a state of three numbers."""
    for operator, gates in (("LSTM", 4), ("GRU", 3)):
        states = 2 if operator == "LSTM" else 1

        def inputs(directions=1):
            sizes = [(3 * gates, 2), (3 * gates, 3), (6 * gates,), None, *[(1, 3)] * states]
            return [shaped(4, 1, 2), *[weights(directions, *size) if size else "" for size in sizes]]

        given = {"hidden_size": 3, **({"linear_before_reset": 1} if operator == "GRU" else {})}
        for count in (3, 4, 7):
            for outputs in range(1, 2 + states):
                case(operator, *inputs()[:count], outputs=outputs, **given)
        for direction in ("forward", "reverse", "bidirectional"):
            both = inputs(2 if direction == "bidirectional" else 1)
            case(operator, *both, numbers=SMALL, direction=direction, **given)
        for name, value in (("clip", 0.5), ("layout", 1), ("activations", ["Tanh"] * (gates - 1))):
            case(operator, *inputs(), refused=name, **given, **{name: value})
        if operator == "LSTM":
            case(operator, *inputs(), weights(1, 9), refused="`LSTM` with peepholes", **given)
            case(operator, *inputs(), input_forget=1, refused="input_forget", **given)
        else:
            case(operator, *inputs(), hidden_size=3, refused="linear_before_reset")


def main():
    for part in (unary, binary, reductions, shapes, gathers, products, normalizations, recurrences):
        part()
    assert exceptions_met == set(EXCEPTIONS), exceptions_met
    with open("operators.json", "w", encoding="utf-8") as file:
        lines = ",\n".join(json.dumps(each, separators=(",", ":")) for each in cases)
        file.write(f"[\n{lines}\n]\n")


if __name__ == "__main__":
    main()
