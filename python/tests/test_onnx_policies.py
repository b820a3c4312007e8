"""ONNX files as policies of environments: each acts as in ONNX Runtime, or is refused before the
first simulation."""

import pickle

import gymnasium
import mishandle
import numpy as np
import onnx
import onnxruntime
from gymnasium import spaces
from mishandle import Axis
from mishandle.policies.onnx_policies import OnnxPolicy
from mishandle.policies.kinds import policy_hash
from onnx import TensorProto, helper
from onnx_models import ModelCase, model, node

VECTOR = spaces.Box(-np.inf, np.inf, (3,))
ONE = spaces.Box(-1, 1, (1,))
ROWS = [np.array(row, np.float32) for row in ([0.5, -1, 2], [3, 0.25, -0.5], [-2, 1, 0])]
WEIGHTS = {"w": np.array([[0.5], [-1.0], [0.25]], np.float32)}


def linear(**changes):
    arguments = {
        "nodes": [node("MatMul", ["o", "w"], ["a"])], "inputs": [("o", ["N", 3])],
        "outputs": [("a", ["N", 1])], "weights": WEIGHTS
    }
    return model(**{**arguments, **changes})


class Line(gymnasium.Env):
    """Moves x by a tenth of the action in each of five steps. The observations are a vector or a
    dictionary."""

    def __init__(self, names=None, action_space=ONE):
        part = lambda size: spaces.Box(-np.inf, np.inf, (size,))
        self.names = names
        self.observation_space = (
            VECTOR if names is None else spaces.Dict({names[0]: part(1), names[1]: part(2)})
        )
        self.action_space = action_space

    def _observation(self):
        whole = np.array([self.x, self.steps, 1.0], np.float32)
        return whole if self.names is None else {self.names[0]: whole[:1], self.names[1]: whole[1:]}

    def reset(self, *, seed=None, options=None):
        self.x, self.steps = options["x0"], 0
        return self._observation(), {}

    def step(self, action):
        self.x += 0.1 * float(np.ravel(action)[0])
        self.steps += 1
        return self._observation(), 0.0, False, False, {}


class Case(ModelCase):
    def load(self, made, observations=VECTOR, actions=ONE, task=None):
        self.path.write_bytes(made if isinstance(made, bytes) else made.SerializeToString())
        policy = OnnxPolicy(self.path, observations, actions, task)
        policy.reset(len(ROWS))
        return policy

    def refuse(self, words, made, *arguments, **options):
        with self.assertRaisesRegex(mishandle.MishandleError, words):
            self.load(made, *arguments, **options)

    def check(self, made, *arguments):
        """Compares the actions of three rows with those of each row alone in ONNX Runtime."""
        policy = self.load(made, *arguments)
        session = onnxruntime.InferenceSession(str(self.path), providers=["CPUExecutionProvider"])
        [source] = session.get_inputs()
        dtype = {
            "tensor(float)": np.float32, "tensor(double)": np.float64, "tensor(float16)": np.float16
        }[source.type]
        shape = [size if isinstance(size, int) else 1 for size in source.shape]
        expected = [
            session.run(None, {source.name: row.astype(dtype).reshape(shape)})[0].ravel()
            for row in ROWS
        ]
        for again in (policy, pickle.loads(pickle.dumps(policy))):
            np.testing.assert_allclose(again.act(ROWS, 3), expected, rtol=1e-6)
            np.testing.assert_allclose(again.act(ROWS[:1], 1), expected[:1], rtol=1e-6)


class Inputs(Case):
    def test_batches_of_every_kind_have_the_actions_of_their_rows(self):
        for shape, output in (
            (["N", 3], ["N", 1]), ([1, 3], [1, 1]), ([3], [1]), ([None, 3], [None, 1])
        ):
            with self.subTest(shape):
                self.check(linear(inputs=[("o", shape)], outputs=[("a", output)]))
        # The input has batches, but the inside of the model does not.
        inside = [node("Reshape", ["o", "size"], ["row"]), node("MatMul", ["row", "w"], ["a"])]
        self.check(linear(nodes=inside, weights={**WEIGHTS, "size": np.array([1, 3])}))
        # Rows change each other.
        mean = [
            node("ReduceMean", ["o"], ["m"], axes=[0], keepdims=1),
            node("MatMul", ["m", "w"], ["a"])
        ]
        self.check(linear(nodes=mean, outputs=[("a", [1, 1])]))
        self.refuse(
            "a fixed batch of 4 observations",
            linear(inputs=[("o", [4, 3])], outputs=[("a", [4, 1])])
        )

    def test_numbers_of_other_types_are_converted(self):
        for kind, dtype in ((TensorProto.DOUBLE, np.float64), (TensorProto.FLOAT16, np.float16)):
            with self.subTest(dtype):
                weights = {"w": WEIGHTS["w"].astype(dtype)}
                self.check(
                    linear(
                        inputs=[("o", ["N", 3], kind)], outputs=[("a", ["N", 1], kind)],
                        weights=weights
                    )
                )
        whole = [
            node("Cast", ["o"], ["f"], to=TensorProto.FLOAT), node("MatMul", ["f", "w"], ["a"])
        ]
        integers = linear(nodes=whole, inputs=[("o", ["N", 3], TensorProto.INT64)])
        self.refuse(
            "input `o` of the type tensor.int64., but observations are real numbers", integers
        )
        counts = spaces.MultiDiscrete([4, 4, 4])
        policy = self.load(integers, counts)
        np.testing.assert_array_equal(
            policy.act([np.array([1, 2, 3]), np.array([3, 0, 1])], 2), [[-0.75], [1.75]]
        )
        # A number in a discrete space is a scalar, or a vector of one number.
        for shape in (["N"], ["N", 1]):
            last = [
                node("Cast", ["o"], ["f"], to=TensorProto.FLOAT),
                node("Reshape", ["f", "size"], ["a"])
            ]
            made = linear(
                nodes=last, inputs=[("o", shape, TensorProto.INT64)],
                weights={"size": np.array([-1, 1])}
            )
            np.testing.assert_array_equal(
                self.load(made, spaces.Discrete(3)).act([2, 0], 2), [[2], [0]]
            )

    def test_sizes_that_do_not_fit_are_named(self):
        self.refuse(r"input `o` of the shape \[N, 2\], but observations have the shape \[3\]",
                    linear(inputs=[("o", ["N", 2])], weights={"w": WEIGHTS["w"][:2]}))
        self.refuse(
            r"output `a` of the shape \[1, 2\] in real numbers, but an action is 1 real numbers",
            linear(outputs=[("a", ["N", 2])], weights={"w": np.ones((3, 2), np.float32)})
        )
        two = linear(
            nodes=[node("Add", ["o", "p"], ["a"])], inputs=[("o", ["N", 3]), ("p", ["N", 3])],
            outputs=[("a", ["N", 3])]
        )
        self.refuse(
            "nothing says what the input `p` is; observations are a Box, not a dictionary", two
        )

    def test_a_dictionary_fills_the_inputs_with_the_names_of_its_keys(self):
        joined = [
            node("Concat", ["place", "rest"], ["o"], axis=1), node("MatMul", ["o", "w"], ["a"])
        ]
        made = linear(nodes=joined, inputs=[("rest", ["N", 2]), ("place", ["N", 1])])
        parts = spaces.Dict({
            "place": spaces.Box(-9, 9, (1,)), "rest": spaces.Box(-9, 9, (2,)),
            "more": spaces.Discrete(2)
        })
        observations = [{"place": row[:1], "rest": row[1:], "more": 1} for row in ROWS]
        expected = np.stack(ROWS) @ WEIGHTS["w"]
        np.testing.assert_allclose(self.load(made, parts).act(observations, 3), expected)
        self.refuse(
            "has the input o, but observations are a dictionary with the keys .*one input for "
            "each key",
            linear(), parts
        )
        # Through the library, with the environment in the loop: x ends at 0.5 + the sum of actions.
        self.load(made, parts)
        run = lambda names: mishandle.simulate(
            Line(names), "always(x <= 9)", [Axis("x0", -1, 1)], at={"x0": 0.5},
            policy=str(self.path), signals={"x": f"obs.{names[0]}[0]"}, steps=5
        )
        x, path = 0.5, [0.5]
        for step in range(5):
            x += 0.1 * (0.5 * np.float32(x) - step + 0.25)
            path.append(x)
        np.testing.assert_allclose(run(("place", "rest"))[0].trace["x"], path, rtol=1e-5)
        with self.assertRaisesRegex(
            mishandle.MishandleError,
            "has the inputs rest, place, but observations are a dictionary"
        ):
            run(("place", "others"))
        self.refuse(
            "observations of the space Tuple; flatten them", linear(), spaces.Tuple([VECTOR])
        )


class Environments(Case):
    def test_a_file_acts_as_its_formula_does(self):
        self.path.write_bytes(linear().SerializeToString())
        env = gymnasium.make("Pendulum-v1", max_episode_steps=30)
        space = [Axis("x_init", 0.1, 1.0), Axis("y_init", 0.1, 1.0)]
        ask = lambda policy: mishandle.simulate(
            env, "always(c <= 2)", space, policy=policy, signals={"c": "obs[0]", "rate": "obs[2]"}
        )
        [found] = ask(self.path)
        [expected] = ask(lambda observation: observation @ WEIGHTS["w"])
        np.testing.assert_allclose(found.trace["rate"], expected.trace["rate"], atol=1e-4)
        self.assertEqual(found.end, "completed")


class Outputs(Case):
    def outputs(self, *operators):
        nodes = [node(operator, ["h"], [name]) for name, operator in operators]
        return linear(
            nodes=[node("MatMul", ["o", "w"], ["h"]), *nodes],
            outputs=[(name, ["N", 1]) for name, _ in operators]
        )

    def test_one_of_several_outputs_is_the_action_only_if_something_says_so(self):
        expected = np.stack(ROWS) @ WEIGHTS["w"]
        value = [node("ReduceSum", ["o"], ["value"]), node("MatMul", ["o", "w"], ["mean"])]
        by_size = linear(
            nodes=[*value, node("Identity", ["o"], ["latent"])],
            outputs=[("latent", ["N", 3]), ("mean", ["N", 1])]
        )
        np.testing.assert_allclose(self.load(by_size).act(ROWS, 3), expected)
        by_name = self.outputs(("value", "Abs"), ("actions", "Identity"), ("log_prob", "Exp"))
        np.testing.assert_allclose(self.load(by_name).act(ROWS, 3), expected)
        unnamed = self.outputs(("7", "Abs"), ("9", "Neg"))
        self.refuse(
            "has the outputs 7, 9, and nothing says which one is the action: several", unnamed
        )
        side = self.path.with_name("policy.onnx.json")
        side.write_text('{"action": "9"}')
        np.testing.assert_allclose(self.load(unnamed).act(ROWS, 3), -expected)
        with_metadata = self.outputs(("7", "Abs"), ("9", "Neg"))
        helper.set_model_props(
            with_metadata, {"mishandle.action": "7", "mishandle.task": "ball-balancing"}
        )
        side.unlink()
        np.testing.assert_allclose(self.load(with_metadata).act(ROWS, 3), np.abs(expected))
        self.refuse(
            "is for the task ball-balancing, not for point-reaching", with_metadata,
            task="point-reaching"
        )
        for text, words in (
            ('{"action": "8"}', "no output `8`; its outputs: 7, 9"),
            ('{"out": "9"}', "the key `out`"),
            ('{"chunk": {"execute": 2}}', "the key `chunk`, which needs a task or a target file"),
            ('{"history": 2}', "the key `history`, which needs a task or a target file"),
            ("{", "invalid description"), ('{"state": [["h", "9"]]}', "no input `h`; its inputs: o")
        ):
            side.write_text(text)
            self.refuse(words, unnamed)

    def test_discrete_actions_are_choices_and_not_scores(self):
        choice = [
            node("Gemm", ["o", "w"], ["scores"]),
            node("ArgMax", ["scores"], ["a"], axis=1, keepdims=0)
        ]
        weights = {"w": np.array([[1, 0], [0, 1], [0, 0]], np.float32)}
        made = linear(nodes=choice, outputs=[("a", ["N"], TensorProto.INT64)], weights=weights)
        actions = self.load(made, VECTOR, spaces.Discrete(2)).act(ROWS, 3)
        self.assertEqual((actions.tolist(), actions.dtype), ([0, 0, 1], np.int64))
        self.assertTrue(all(spaces.Discrete(2).contains(action) for action in actions))
        self.refuse(
            "output `a` of the shape .1. in integers, but an action is 1 real numbers", made,
            VECTOR, ONE
        )
        scores = linear(nodes=choice[:1], outputs=[("scores", ["N", 2])], weights=weights)
        self.refuse(
            "export the choice .`argmax`. instead of its scores", scores, VECTOR, spaces.Discrete(2)
        )
        self.refuse(
            "cannot return actions of the space Dict", made, VECTOR, spaces.Dict({"a": ONE})
        )

    def test_actions_that_are_not_numbers_end_the_simulation(self):
        self.load(
            linear(
                nodes=[
                    node("MatMul", ["o", "w"], ["h"]), node("Sub", ["h", "h"], ["z"]),
                    node("Div", ["z", "z"], ["a"])
                ]
            )
        )
        with self.assertWarns(UserWarning):
            [found] = mishandle.simulate(
                Line(), "always(x <= 9)", [Axis("x0", -1, 1)], policy=str(self.path),
                signals={"x": "obs[0]"}, steps=5
            )
        self.assertEqual(found.end, "invalid action 0 in control step 1")


class States(Case):
    def test_the_rows_of_a_recurrent_policy_have_states_of_their_own(self):
        nodes = [
            node("MatMul", ["o", "w"], ["x"]), node("Add", ["x", "h_in"], ["h_out"]),
            node("Tanh", ["h_out"], ["a"])
        ]
        state = ["N", 1]
        made = linear(
            nodes=nodes, inputs=[("o", ["N", 3]), ("h_in", state)],
            outputs=[("a", ["N", 1]), ("h_out", state)]
        )
        self.refuse("nothing says what the input `h_in` is", made)
        self.path.with_name("policy.onnx.json").write_text('{"state": [["h_in", "h_out"]]}')
        policy = self.load(made)
        sums = np.zeros((3, 1))
        for _ in range(3):
            sums += np.stack(ROWS) @ WEIGHTS["w"]
            np.testing.assert_allclose(policy.act(ROWS, 3), np.tanh(sums), rtol=1e-6)
        policy.reset(3)
        np.testing.assert_allclose(
            policy.act(ROWS, 3), np.tanh(np.stack(ROWS) @ WEIGHTS["w"]), rtol=1e-6
        )


class Refusals(Case):
    def test_models_that_draw_random_numbers_are_refused_wherever_they_are(self):
        noise = {
            "RandomNormal": node("RandomNormal", [], ["n"], shape=[1, 1]),
            "RandomUniformLike": node("RandomUniformLike", ["h"], ["n"]),
            "Bernoulli": node("Bernoulli", ["h"], ["n"]),
        }
        for name, operator in noise.items():
            nodes = [node("MatMul", ["o", "w"], ["h"]), operator, node("Add", ["h", "n"], ["a"])]
            self.refuse(f"the operator `{name}`, which draws random numbers", linear(nodes=nodes))
        branch = lambda operator: helper.make_graph(
            [operator], "b", [], [helper.make_tensor_value_info("n", 1, None)]
        )
        nodes = [
            node("MatMul", ["o", "w"], ["h"]),
            node(
                "If", ["c"], ["n"], then_branch=branch(noise["RandomNormal"]),
                else_branch=branch(node("Identity", ["h"], ["n"]))
            ),
            node("Add", ["h", "n"], ["a"])
        ]
        self.refuse(
            "the operator `RandomNormal`",
            linear(nodes=nodes, weights={**WEIGHTS, "c": np.array(True)})
        )
        dropout = [node("MatMul", ["o", "w"], ["h"]), node("Dropout", ["h", "p", "t"], ["a"])]
        weights = {**WEIGHTS, "p": np.float32(0.5), "t": np.array(True)}
        self.refuse(
            "the operator `Dropout` in training mode; export it after `model.eval",
            linear(nodes=dropout, weights=weights)
        )
        self.check(linear(nodes=[dropout[0], node("Dropout", ["h"], ["a"])]))

    def test_files_that_cannot_be_loaded_say_why(self):
        self.refuse(
            "cannot be loaded by ONNX Runtime .*opset_version=20",
            linear(nodes=[node("Sin", ["o"], ["a"])], opset=999)
        )
        unknown = linear(nodes=[node("Frobnicate", ["o"], ["a"])])
        self.refuse("cannot be loaded by ONNX Runtime .*Frobnicate", unknown)
        whole = linear().SerializeToString()
        self.refuse("cannot be read: it is damaged", whole[:-3])
        self.refuse(
            "cannot be computed for an observation of zeros",
            linear(nodes=[node("Reshape", ["o", "s"], ["a"])], weights={"s": np.array([7, 1])})
        )
        with self.assertRaisesRegex(ValueError, "there is no file"):
            OnnxPolicy(self.path.with_name("missing.onnx"), VECTOR, ONE)
        save = lambda: onnx.save(
            linear(), self.path, save_as_external_data=True, location="w.bin", size_threshold=0
        )
        save()
        before = policy_hash(str(self.path))
        weights = self.path.with_name("w.bin")
        weights.write_bytes(bytes(12))
        self.assertNotEqual(policy_hash(str(self.path)), before)
        weights.unlink()
        with self.assertRaisesRegex(
            ValueError, "weights in the file w.bin, which is not beside it"
        ):
            OnnxPolicy(self.path, VECTOR, ONE)

    def test_long_chains_and_deep_branches_end_with_an_answer(self):
        count = 10_000
        names = ["h", *(f"x{number}" for number in range(count - 1)), "a"]
        nodes = [
            node("MatMul", ["o", "w"], ["h"]),
            *(node("Neg", [x], [y]) for x, y in zip(names, names[1:]))
        ]
        self.check(linear(nodes=nodes))
        # 500 times a graph in an attribute of a node.
        data = b""
        for _ in range(500):
            for number in (6, 5, 1):
                data = bytes([number << 3 | 2]) + _varint(len(data)) + data
        self.refuse(
            "cannot be loaded by ONNX Runtime", bytes([7 << 3 | 2]) + _varint(len(data)) + data
        )


def _varint(value):
    digits = []
    while value >= 0x80:
        digits.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*digits, value])


class Tasks(Case):
    def test_a_policy_of_a_task_must_fit_it(self):
        weights = {"w": np.full((27, 9), 0.01, np.float32)}
        made = linear(inputs=[("o", ["N", 27])], outputs=[("a", ["N", 9])], weights=weights)
        self.path.write_bytes(made.SerializeToString())
        found = mishandle.evaluate("point-reaching", policy=str(self.path), episodes=2, rows=2)
        self.assertEqual(found.success_rate.n, 2)
        self.path.write_bytes(linear().SerializeToString())
        with self.assertRaisesRegex(
            mishandle.MishandleError, r"shape \[N, 3\], but the task has 27 numbers per observation"
        ):
            mishandle.evaluate("point-reaching", policy=str(self.path), episodes=2)
