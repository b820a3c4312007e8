"""ONNX models: ours in ONNX Runtime, and others in our runtime, compared with ONNX Runtime."""

import pathlib
import time

import gymnasium
import mishandle
from mishandle.errors import InvalidValueError
import numpy as np
import onnx
import onnxruntime
import onnx_models
from onnx import helper
from onnx_models import ModelCase, numbers

ROOT = pathlib.Path(__file__).parents[2]
TOLERANCE = 1e-5
SLIDER = """<mujoco><worldbody><body><joint name="j" type="slide"/><geom size="0.1" mass="1"/>
</body></worldbody><actuator><motor joint="j"/></actuator></mujoco>"""
TARGET = """format = 1
name = "slider"
model.file = "slider.xml"
control = { period = 0.02, steps = 5 }
policy = { onnx = "policy.onnx", action = "action" }
start.j = "place"
observation.place = "qpos('j')"
signals.height = "qpos('j')[0]"
axes.place = { range = [-1, 1] }
formulas.near = "always(height <= 9)"
"""


def session(data):
    return onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])


def observations_of(task, controller):
    """Returns observations of episodes of a controller."""
    name = "".join(word.capitalize() for word in task.split("-"))
    env = gymnasium.make_vec(f"mishandle/{name}-v0", num_envs=4)
    observations, _ = env.reset(seed=1)
    rows = [observations]
    for _ in range(15):
        observations, *_ = env.step(np.clip(controller(observations), -1, 1))
        rows.append(observations)
    env.close()
    return np.concatenate(rows)


class Export(ModelCase):
    def test_all_shipped_controllers_agree_in_onnx_runtime_and_in_ours(self):
        paths = sorted(ROOT.glob("controllers/*/*.safetensors"))
        # The first generation is complete.
        self.assertEqual(len([path for path in paths if "-" not in path.stem]), 40)
        for path in paths:
            task, name = path.parent.name, f"{path.parent.name}/{path.stem}"
            controller = mishandle.load_controller(name)
            data = controller.to_onnx()
            onnx.checker.check_model(onnx.load_from_string(data), full_check=True)
            self.path.write_bytes(data)
            if "history" in [given.name for given in session(data).get_inputs()]:
                # It is no function of observations: test_controller_format.py compares such a
                # model with the reader.
                continue
            ours = mishandle.load_controller(self.path)
            self.assertEqual(ours.task, task)
            observations = observations_of(task, controller)
            own = controller(observations)
            action, unclipped = session(data).run(
                ["action", "unclipped_action"], {"observation": observations}
            )
            np.testing.assert_allclose(unclipped, own, atol=TOLERANCE, rtol=TOLERANCE, err_msg=name)
            clipped = np.clip(own, -1, 1)
            np.testing.assert_allclose(action, clipped, atol=TOLERANCE, rtol=0, err_msg=name)
            # The weights of TD3 and DDPG amplify the rounding of 32-bit numbers: 1.1e-5 was the
            # largest difference.
            bound = 2e-5 if path.stem.split("-")[0] in ("td3", "ddpg") else TOLERANCE
            np.testing.assert_allclose(
                ours(observations), clipped, atol=bound, rtol=0, err_msg=name
            )


def model(
    nodes, weights, inputs=(("observation", ["N", 27]),), outputs=(("action", ["N", 9]),), **more
):
    return onnx_models.model(nodes, inputs, outputs, weights, **more)


def linear(path, weights, **properties):
    """Writes a model that multiplies an observation by a matrix."""
    inputs, outputs = weights.shape
    made = model(
        [helper.make_node("MatMul", ["observation", "w"], ["action"])],
        {"w": weights.astype(np.float32)},
        [("observation", ["N", inputs])], [("action", ["N", outputs])], **properties,
    )
    onnx.save(made, path)


class WithoutTask(ModelCase):
    """Models of robots that are none of our tasks."""

    def test_a_model_has_the_sizes_that_it_states(self):
        for inputs, outputs in [(1, 1), (4, 1), (5, 12), (300, 2)]:
            weights = numbers(inputs, outputs)
            linear(self.path, weights)
            policy = mishandle.load_controller(self.path)
            self.assertEqual(
                (policy.observation_size, policy.action_size, policy.task), (inputs, outputs, "")
            )
            self.assertFalse(policy.is_recurrent)
            observations = numbers(7, inputs, seed=1)
            np.testing.assert_allclose(policy.act(observations), observations @ weights, atol=1e-5)
            np.testing.assert_array_equal(policy(observations[2]), policy(observations)[2])

    def test_a_model_may_name_a_robot_that_is_no_task(self):
        linear(self.path, numbers(4, 1), task="my-robot")
        self.assertEqual(mishandle.load_controller(self.path).task, "my-robot")
        with self.assertRaisesRegex(
            Exception, "the ONNX model is for my-robot, not for point-reaching"
        ):
            mishandle.load_controller(self.path, task="point-reaching")

    def test_an_observation_of_another_length_is_an_error(self):
        linear(self.path, numbers(4, 1))
        policy = mishandle.load_controller(self.path)
        for wrong in (np.zeros(3), np.zeros((2, 5))):
            with self.assertRaisesRegex(
                InvalidValueError, r"an observation has [35] numbers; the controller takes 4"
            ):
                policy(wrong)
        with self.assertRaisesRegex(
            InvalidValueError, r"the shape \(1, 1, 4\); expected one observation of 4 numbers"
        ):
            policy(np.zeros((1, 1, 4)))

    def test_a_model_without_a_fixed_size_is_an_error(self):
        made = model(
            [helper.make_node("Tanh", ["observation"], ["action"])], {},
            [("observation", ["N", "M"])], [("action", ["N", "M"])]
        )
        onnx.save(made, self.path)
        with self.assertRaisesRegex(
            InvalidValueError, r"the observation `observation` .* has the shape \[N, N\]; expected"
        ):
            mishandle.load_controller(self.path)

    def test_a_function_acts_with_the_model_and_its_hash_is_a_part_of_the_identity(self):
        space = [mishandle.Axis("start", -1, 1)]

        def evaluated(gain):
            linear(self.path, np.array([[-gain], [-2 * gain]]))
            policy = mishandle.load_controller(self.path)

            def simulate(scenario):
                position, speed, trace = scenario["start"], 0.0, []
                for _ in range(20):
                    trace.append(position)
                    [force] = policy([position, speed])
                    speed += 0.1 * float(force)
                    position += 0.1 * speed
                return {"position": trace}

            path = self.path.with_name(f"{gain}.sqlite")
            path.unlink(missing_ok=True)
            return mishandle.evaluate(
                simulate, "always(position <= 2)", space, episodes=4, out=path
            )

        first, again, other = evaluated(1.0), evaluated(1.0), evaluated(0.5)
        self.assertEqual(first.success_rate.value, 1.0)
        self.assertEqual(first.not_covered, ())
        self.assertEqual(first.target_hash, again.target_hash)
        self.assertNotEqual(first.target_hash, other.target_hash)


class Start(ModelCase):
    def test_a_small_policy_costs_little_before_the_first_simulation(self):
        linear(self.path, numbers(1, 1))
        self.path.with_name("slider.xml").write_text(SLIDER)
        target = self.path.with_name("slider.toml")
        target.write_text(TARGET)
        for ask in (
            lambda: mishandle.load_controller(self.path)(np.zeros(1)),
            lambda: mishandle.evaluate(
                str(target), episodes=1, out=self.path.with_name("run.sqlite")
            ),
        ):
            start = time.process_time()
            ask()
            self.assertLess(time.process_time() - start, 0.3)


class Import(ModelCase):
    def setUp(self):
        super().setUp()
        self.observations = np.random.default_rng(4).normal(size=(32, 27)).astype(np.float32)

    def load(self, made):
        onnx.save(made, self.path)
        return mishandle.load_controller(str(self.path), task="point-reaching")

    def check(self, made):
        onnx.checker.check_model(made, full_check=True)
        ours = self.load(made)(self.observations)
        inputs = [i.name for i in made.graph.input]
        theirs = session(made.SerializeToString()).run(None, {inputs[0]: self.observations})[0]
        # The relative part is for numbers such as those after `Exp`.
        np.testing.assert_allclose(ours, theirs, atol=TOLERANCE, rtol=TOLERANCE)
        # A row does not depend on the batch.
        again = self.load(made)(self.observations[7])
        np.testing.assert_array_equal(ours[7], again)

    def test_operators_of_exported_networks_agree_with_onnx_runtime(self):
        weights = {"w": numbers(27, 16), "b": numbers(16, seed=1), "v": numbers(16, 9, seed=2)}
        gemm = helper.make_node("Gemm", ["observation", "w", "b"], ["h"])
        last = helper.make_node("MatMul", ["a", "v"], ["action"])
        for operator in (
            "Elu", "Relu", "Tanh", "Sigmoid", "LeakyRelu", "Softplus", "Erf", "Exp", "Abs", "Neg",
            "Sin", "Cos", "Softmax",
            "Softsign", "HardSigmoid", "Identity", "HardSwish",
        ):
            with self.subTest(operator):
                self.check(model([gemm, helper.make_node(operator, ["h"], ["a"]), last], weights))
        for opset, nodes, more in (
            (20, [helper.make_node("Gelu", ["h"], ["a"])], {}),
            (20, [helper.make_node("Gelu", ["h"], ["a"], approximate="tanh")], {}),
            (
                17, [helper.make_node("LayerNormalization", ["h", "g", "s"], ["a"])],
                {"g": numbers(16, seed=5), "s": numbers(16, seed=6)}
            ),
            (
                18,
                [
                    helper.make_node("ReduceMean", ["h", "axes"], ["m"]),
                    helper.make_node("Sub", ["h", "m"], ["a"])
                ],
                {"axes": np.array([-1])}
            ),
            (
                13,
                [
                    helper.make_node("Split", ["h", "sizes"], ["p", "q"], axis=1),
                    helper.make_node("Concat", ["q", "p"], ["a"], axis=-1)
                ],
                {"sizes": np.array([6, 10])}
            ),
            (
                17,
                [
                    helper.make_node("Slice", ["h", "from", "to", "axis"], ["p"]),
                    helper.make_node("Concat", ["p", "p"], ["a"], axis=1)
                ],
                {"from": np.array([8]), "to": np.array([16]), "axis": np.array([1])}
            ),
            (
                17, [helper.make_node("Clip", ["h", "low", "high"], ["a"])],
                {"low": np.float32(-0.2), "high": np.float32(0.3)}
            ),
            (
                17,
                [
                    helper.make_node("Shape", ["h"], ["size"]),
                    helper.make_node("ConstantOfShape", ["size"], ["zero"]),
                    helper.make_node("Add", ["h", "zero"], ["a"])
                ],
                {}
            ),
            (
                17,
                [
                    helper.make_node("Pow", ["h", "two"], ["p"]),
                    helper.make_node("Sqrt", ["p"], ["a"])
                ],
                {"two": np.float32(2)}
            ),
            (
                17,
                [
                    helper.make_node("Greater", ["h", "zero"], ["c"]),
                    helper.make_node("Where", ["c", "h", "zero"], ["a"])
                ],
                {"zero": np.float32(0)}
            ),
            (
                17, [helper.make_node("Gather", ["h", "order"], ["a"], axis=1)],
                {"order": np.arange(15, -1, -1)}
            )
        ):
            with self.subTest(nodes[0].op_type):
                self.check(model([gemm, *nodes, last], weights | more, opset=opset))

    def test_operators_that_the_runtime_computes_otherwise_are_refused(self):
        """Each part goes from `h` [N, 9] to `a` [N, 9]. Those without words agree with ONNX
        Runtime."""
        cube = helper.make_node("Reshape", ["h", "cube"], ["c"])
        flat = helper.make_node("Reshape", ["d", "flat"], ["a"])
        cast = lambda to: [
            helper.make_node("Cast", ["h"], ["k"], to=to),
            helper.make_node("Cast", ["k"], ["a"], to=1)
        ]
        types = onnx.TensorProto
        lstm = lambda *more: [
            helper.make_node("Reshape", ["h", "steps"], ["s"]),
            helper.make_node("LSTM", ["s", "lw", "lr", "", *more], ["y"], hidden_size=3),
            helper.make_node("Reshape", ["y", "flat"], ["a"]),
        ]
        for opset in (8, 12, 13, 17, 20, 22):
            old = opset < 13
            cases = [
                (
                    [cube, helper.make_node("Softmax", ["c"], ["d"]), flat],
                    "reduces several dimensions" if old else ""
                ),
                (
                    [cube, helper.make_node("LogSoftmax", ["c"], ["d"], axis=1), flat],
                    "reduces several dimensions" if old else ""
                ),
                ([cube, helper.make_node("Softmax", ["c"], ["d"], axis=2), flat], ""),
                ([helper.make_node("Softmax", ["h"], ["a"])], ""),
                (cast(types.BOOL), "converts numbers to truth values"),
                (cast(types.INT8), "rounds to 8 or 16 bits"),
                (cast(types.UINT8), "rounds to 8 or 16 bits"),
                (cast(types.FLOAT16), "rounds to 8 or 16 bits"), (cast(types.INT32), ""),
                (cast(types.INT64), ""), (lstm(), ""), (lstm("lengths"), "a part of the sequence"),
                (
                    [
                        helper.make_node("ArgMax", ["h"], ["k"], axis=1),
                        helper.make_node("Cast", ["k"], ["m"], to=1),
                        helper.make_node("Add", ["h", "m"], ["a"])
                    ],
                    "operator `ArgMax`"
                ),
                (
                    [
                        helper.make_node("Cast", ["big"], ["m"], to=1),
                        helper.make_node("Add", ["h", "m"], ["a"])
                    ],
                    "more than 32 bits"
                )
            ]
            if opset >= 12:
                less = [
                    helper.make_node("Less", ["h", "half"], ["l"]),
                    helper.make_node("Cast", ["l"], ["t"], to=types.BOOL),
                    helper.make_node("Not", ["t"], ["n"]),
                    helper.make_node("Cast", ["n"], ["a"], to=1)
                ]
                cases.append((less, ""))
                cases.append(
                    ([helper.make_node("Slice", ["h", "first", "last", "one"], ["a"])], "")
                )
            weights = {
                "w": numbers(27, 9) * 9, "v": numbers(9, 9, seed=2), "cube": np.array([-1, 3, 3]),
                "flat": np.array([-1, 9]), "steps": np.array([3, 1, 3]), "lw": numbers(1, 12, 3),
                "lr": numbers(1, 12, 3, seed=1), "lengths": np.array([2], np.int32),
                "half": np.float32(0.5), "big": np.array(2**40), "first": np.array([0]),
                "last": np.array([2**63 - 1]), "one": np.array([1])
            }
            ends = [
                helper.make_node("MatMul", ["observation", "w"], ["h"]),
                helper.make_node("MatMul", ["a", "v"], ["action"])
            ]
            for nodes, words in cases:
                read = {name for each in [*nodes, *ends] for name in each.input}
                made = model(
                    [ends[0], *nodes, ends[1]],
                    {name: weights[name] for name in weights if name in read}, opset=opset
                )
                made.ir_version = 8 if opset < 21 else 10
                with self.subTest(opset=opset, nodes=[each.op_type for each in nodes], words=words):
                    if words:
                        with self.assertRaisesRegex(Exception, words):
                            self.load(made)
                        continue
                    ours = self.load(made)(self.observations)
                    run = session(made.SerializeToString()).run
                    # Some of these models compute one row only.
                    theirs = np.concatenate([
                        run(None, {"observation": row[None]})[0] for row in self.observations
                    ])
                    np.testing.assert_allclose(ours, theirs, atol=TOLERANCE, rtol=TOLERANCE)

    def test_the_opsets_from_7_to_22_agree_with_onnx_runtime(self):
        weights = {
            "w": numbers(16, 27), "b": numbers(16, seed=1), "v": numbers(9, 16, seed=2),
            "c": numbers(9, seed=3)
        }
        nodes = [
            helper.make_node("Gemm", ["observation", "w", "b"], ["h"], transB=1),
            helper.make_node("Elu", ["h"], ["a"]),
            helper.make_node("Gemm", ["a", "v", "c"], ["action"], transB=1),
        ]
        for opset in range(7, 23):
            with self.subTest(opset):
                made = model(nodes, weights, opset=opset)
                made.ir_version = 8 if opset < 21 else 10
                self.check(made)

    def test_a_wide_perceptron_is_within_the_limits(self):
        weights = {"w": numbers(2048, 27), "b": numbers(2048, 2048) / 32, "v": numbers(9, 2048)}
        nodes = [
            helper.make_node("Gemm", ["observation", "w"], ["h"], transB=1),
            helper.make_node("Tanh", ["h"], ["a"]),
            helper.make_node("Gemm", ["a", "b"], ["k"]),
            helper.make_node("Tanh", ["k"], ["c"]),
            helper.make_node("Gemm", ["c", "v"], ["action"], transB=1),
        ]
        self.check(model(nodes, weights))

    def test_metadata_and_side_file(self):
        node = helper.make_node("MatMul", ["observation", "w"], ["action"])
        weights = {"w": numbers(27, 9)}
        with self.assertRaisesRegex(Exception, "is for ball-balancing, not for point-reaching"):
            self.load(model([node], weights, task="ball-balancing"))
        with self.assertRaisesRegex(Exception, "no key `mishandle.outputs`"):
            self.load(self.with_property(model([node], weights), "mishandle.outputs"))
        two = [node, helper.make_node("Neg", ["action"], ["minus"])]
        made = model(two, weights, outputs=[("action", ["N", 9]), ("minus", ["N", 9])])
        plain = self.load(made)
        self.path.with_suffix(".onnx.json").write_text('{"action": "minus"}')
        minus = self.load(made)
        np.testing.assert_array_equal(minus(self.observations), -plain(self.observations))
        self.assertNotEqual(minus.hash, plain.hash)
        self.path.with_suffix(".onnx.json").write_text('{"action": "plus"}')
        with self.assertRaisesRegex(Exception, "no output `plus`; its outputs: action, minus"):
            self.load(made)

    def with_property(self, made, key):
        entry = made.metadata_props.add()
        entry.key, entry.value = key, "x"
        return made

    def test_a_recurrent_policy_is_known_by_the_names_of_its_state(self):
        made = onnx.load(ROOT / "crates/interchange/tests/data/lstm.onnx")
        del made.metadata_props[:]
        onnx.save(made, self.path)
        self.assertTrue(mishandle.load_controller(self.path).is_recurrent)

    def test_hostile_models_are_refused_before_they_take_memory(self):
        huge = np.array([1 << 31, 1 << 31])
        node = helper.make_node
        project = [
            node("ReduceSum", ["big"], ["s"]), node("MatMul", ["observation", "w"], ["m"]),
            node("Add", ["m", "s"], ["action"])
        ]
        weights = {"w": numbers(27, 9)}
        for nodes, more, message in (
            ([node("ConstantOfShape", ["size"], ["big"])], {"size": huge}, "too large"),
            (
                [node("Expand", ["one", "size"], ["big"])], {"size": huge, "one": np.float32(1)},
                "too large"
            ),
            (
                [node("Tile", ["row", "size"], ["big"])],
                {"size": np.array([1 << 40]), "row": numbers(1)}, "too large"
            ),
            (
                [node("Add", ["column", "row"], ["big"])],
                {"column": numbers(10000, 1), "row": numbers(1, 10000)}, "too large"
            ),
            (
                [
                    node("Cast", ["observation"], ["i"], to=onnx.TensorProto.INT64),
                    node("Squeeze", ["i", "zero"], ["j"]), node("ConstantOfShape", ["j"], ["big"])
                ],
                {"zero": np.array([0])}, "shape depends on the observation"
            ),
            ([node("NonZero", ["observation"], ["big"])], {}, "operator `NonZero`"),
            ([node("RandomUniform", [], ["big"], shape=[2])], {}, "operator `RandomUniform`"),
            (
                [node("Gelu", ["observation"], ["big"], domain="com.microsoft")], {},
                "of the domain `com.microsoft`"
            )
        ):
            with self.subTest(message + nodes[0].op_type), self.assertRaisesRegex(
                Exception, message
            ):
                self.load(model([*nodes, *project], weights | more))
        doubled = {"row": numbers(1 << 12)}
        nodes = [
            node("Concat", ["row" if i == 0 else f"d{i}"] * 2, [f"d{i + 1}"], axis=0)
            for i in range(40)
        ]
        with self.assertRaisesRegex(Exception, "too large"):
            self.load(
                model([*nodes, node("Identity", ["d40"], ["big"]), *project], weights | doubled)
            )

    def test_weights_are_read_from_the_file_beside_the_model_only(self):
        node = helper.make_node("MatMul", ["observation", "w"], ["action"])
        plain = self.load(model([node], {"w": numbers(27, 9)}))
        save = lambda name: onnx.save(
            model([node], {"w": numbers(27, 9)}), self.path, save_as_external_data=True,
            location=name, size_threshold=0
        )
        load = lambda: mishandle.load_controller(str(self.path), task="point-reaching")
        save("policy.onnx.data")
        beside = load()
        np.testing.assert_array_equal(beside(self.observations), plain(self.observations))
        weights = self.path.with_suffix(".onnx.data")
        data = weights.read_bytes()
        weights.write_bytes(bytes(8) + data[8:])
        self.assertNotEqual(load().hash, beside.hash)
        weights.write_bytes(data[:-4])
        with self.assertRaisesRegex(Exception, "weights of `w` are not inside `policy.onnx.data`"):
            load()
        weights.unlink()
        with self.assertRaisesRegex(
            Exception, "in another file, `policy.onnx.data`.*no file MODEL.onnx.data"
        ):
            load()
        save("other.data")
        with self.assertRaisesRegex(
            Exception, "in another file, `other.data`.*no file MODEL.onnx.data"
        ):
            load()
        # Files that were renamed together name the old file.
        self.path.with_name("other.data").rename(weights)
        np.testing.assert_array_equal(load()(self.observations), plain(self.observations))

    def test_subgraphs_are_errors(self):
        node = helper.make_node("MatMul", ["observation", "w"], ["action"])
        made = model([node], {"w": numbers(27, 9)})
        branch = helper.make_graph([helper.make_node("Identity", ["action"], ["a"])], "b", [], [])
        made.graph.node.append(
            helper.make_node("If", ["c"], ["z"], then_branch=branch, else_branch=branch)
        )
        with self.assertRaisesRegex(Exception, "subgraph"):
            self.load(made)

    def test_files_of_other_tools_say_what_to_do(self):
        path = self.path.with_name("a.zip")
        path.write_bytes(b"PK\x03\x04 model")
        with self.assertRaisesRegex(Exception, "mishandle controller FILE --task TASK"):
            mishandle.load_controller(str(path))
