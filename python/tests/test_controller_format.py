"""Runs docs/reference/controller_format.md: its reader and writer against our own."""

import pathlib
import re
import tempfile
import unittest

import mishandle
import numpy as np
import onnx
import onnxruntime

ROOT = pathlib.Path(__file__).parents[2]
# Largest differences: the weights of TD3 and DDPG amplify the rounding of 32-bit numbers.
BOUNDS = {"td3": 3e-5, "ddpg": 3e-5}


def page():
    """Returns the blocks of code of the page, and the names that they define."""
    text = (ROOT / "docs/reference/controller_format.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    names = {}
    for block in blocks:
        exec(compile(block, "docs/reference/controller_format.md", "exec"), names)
    return blocks, names


class Format(unittest.TestCase):
    def setUp(self):
        self.path = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory())) / "a.safetensors"
        self.blocks, names = page()
        self.read, self.act, self.write = (names[name] for name in ("read", "act", "write"))

    def test_each_block_has_at_most_30_lines(self):
        self.assertEqual(len(self.blocks), 3)
        for block in self.blocks:
            self.assertLessEqual(len(block.strip().splitlines()), 30)

    def test_the_reader_agrees_with_our_actions(self):
        for name in ("ppo", "trpo", "sac", "td3", "ddpg"):
            header, tensors = self.read(ROOT / f"controllers/ball-balancing/{name}.safetensors")
            controller = mishandle.load_controller(f"ball-balancing/{name}")
            mean, std = tensors["normalizer.mean"], np.sqrt(tensors["normalizer.variance"])
            noise = np.random.default_rng(1).normal(size=(100, len(mean)))
            observations = (mean + std * noise).astype(np.float32)
            found = self.act(header, tensors, observations)
            np.testing.assert_allclose(
                found, controller(observations), atol=BOUNDS.get(name, 1e-5), rtol=1e-5
            )

    def test_our_program_reads_what_the_writer_wrote(self):
        header, tensors = self.read(ROOT / "controllers/ball-balancing/ppo.safetensors")
        self.write(self.path, header, tensors)
        ours = mishandle.load_controller("ball-balancing/ppo")
        self.assertEqual(mishandle.load_controller(str(self.path)).hash, ours.hash)
        random = np.random.default_rng(2)
        for activation in ("elu", "relu", "tanh", "leaky_relu", "silu", "gelu"):
            for norm in (None, "plain", "affine"):
                header["policy"] = {
                    "kind": "gaussian", "sizes": [len(tensors["normalizer.mean"]), 16, 20, 9],
                    "observation_clip": None,
                    "hidden_activation": activation, "output_activation": "identity",
                }
                layers = {
                    "normalizer.mean": tensors["normalizer.mean"],
                    "normalizer.variance": tensors["normalizer.variance"],
                    "policy.log_std": np.zeros(9, np.float32),
                }
                sizes = header["policy"]["sizes"]
                for layer, (inputs, outputs) in enumerate(zip(sizes, sizes[1:])):
                    prefix = f"policy.layers.{layer}."
                    layers[prefix + "weight"] = random.normal(
                        size=(outputs, inputs)
                    ).astype(np.float32) / inputs
                    layers[prefix + "bias"] = random.normal(size=outputs).astype(np.float32)
                    if norm == "affine" and layer < 2:
                        layers[prefix + "norm.weight"] = random.normal(
                            size=outputs
                        ).astype(np.float32)
                        layers[prefix + "norm.bias"] = random.normal(
                            size=outputs
                        ).astype(np.float32)
                if norm:
                    header["policy"]["layer_norm"] = norm
                self.write(self.path, header, layers)
                observations = random.normal(size=(50, sizes[0])).astype(np.float32)
                found = mishandle.load_controller(str(self.path))(observations)
                expected = self.act(header, layers, observations)
                np.testing.assert_allclose(
                    found, expected, atol=1e-5, rtol=1e-5, err_msg=f"{activation}, {norm}"
                )

    def test_a_controller_of_another_robot_has_its_own_sizes(self):
        header, tensors = self.read(ROOT / "controllers/ball-balancing/ppo.safetensors")
        random = np.random.default_rng(5)
        for inputs, actions in ((1, 1), (4, 2), (63, 12)):
            part = lambda name, size: [{"name": name, "unit": "", "size": size}]
            header["task"] = "my-robot"
            header["layout"] = {
                "observation": part("state", inputs), "action": part("force", actions)
            }
            header["policy"] = {
                "kind": "gaussian", "sizes": [inputs, actions], "hidden_activation": "elu",
                "output_activation": "identity",
            }
            layers = {
                "normalizer.mean": random.normal(size=inputs),
                "normalizer.variance": np.ones(inputs),
                "policy.log_std": np.zeros(actions, np.float32),
                "policy.layers.0.weight": random.normal(
                    size=(actions, inputs)
                ).astype(np.float32) / inputs,
                "policy.layers.0.bias": random.normal(size=actions).astype(np.float32),
            }
            self.write(self.path, header, layers)
            controller = mishandle.load_controller(self.path)
            self.assertEqual(
                (controller.task, controller.observation_size, controller.action_size),
                ("my-robot", inputs, actions)
            )
            observations = random.normal(size=(6, inputs)).astype(np.float32)
            expected = self.act(header, layers, observations)
            np.testing.assert_allclose(controller(observations), expected, atol=1e-5, rtol=1e-5)

    def test_a_history_of_the_writer_acts_in_our_program_as_in_the_reader(self):
        header, tensors = self.read(ROOT / "controllers/ball-balancing/ppo.safetensors")
        size, random = len(tensors["normalizer.mean"]), np.random.default_rng(3)
        inputs = size + 2 * (size + 9)
        header["policy"] = {
            "kind": "gaussian", "sizes": [inputs, 9], "hidden_activation": "elu",
            "output_activation": "identity",
            "history": 2,
        }
        layers = {name: tensors[name] for name in ("normalizer.mean", "normalizer.variance")} | {
            "policy.log_std": np.zeros(9, np.float32),
            "policy.layers.0.weight": random.normal(size=(9, inputs)).astype(np.float32) / 5,
            "policy.layers.0.bias": random.normal(size=9).astype(np.float32),
        }
        self.write(self.path, header, layers)
        controller = mishandle.load_controller(str(self.path))
        self.assertEqual((controller.observation_size, controller.action_size), (size, 9))
        self.assertTrue(controller.is_recurrent)
        past = [(np.zeros((3, size), np.float32), np.zeros((3, 9), np.float32))] * 2
        for _ in range(5):
            observations = random.normal(size=(3, size)).astype(np.float32)
            expected = self.act(header, layers, observations, past)
            np.testing.assert_allclose(controller(observations), expected, atol=1e-5, rtol=1e-5)
            past = [(observations, np.clip(expected, -1, 1)), past[0]]
        self.assertGreater(self.check_history(header, layers, controller), 1)

    def test_shipped_controllers_with_a_history_act_as_in_the_reader(self):
        for path in sorted(ROOT.glob("controllers/*/*.safetensors")):
            header, tensors = self.read(path)
            if header["policy"].get("history", 0) > 0:
                with self.subTest(path=str(path)):
                    self.check_history(header, tensors, mishandle.load_controller(str(path)))

    def check_history(self, header, layers, controller):
        """Compares the model of a controller with the reader in two episodes at once. Returns the
        largest action."""
        model = controller.to_onnx()
        onnx.checker.check_model(onnx.load_from_string(model), full_check=True)
        session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
        size, steps, random = (
            controller.observation_size, header["policy"]["history"], np.random.default_rng(4)
        )
        zeros = (np.zeros((2, size), np.float32), np.zeros((2, controller.action_size), np.float32))
        past, largest = [zeros] * steps, 0.0
        history = np.zeros((2, steps * (size + controller.action_size)), np.float32)
        for _ in range(20):
            # As in training: rounding errors grow with the inputs of the network.
            spread = np.sqrt(layers["normalizer.variance"]) * random.normal(size=(2, size))
            observation = (layers["normalizer.mean"] + spread).astype(np.float32)
            expected = self.act(header, layers, observation, past)
            outputs = ["action", "unclipped_action", "next_history"]
            action, unclipped, history = session.run(
                outputs, {"observation": observation, "history": history}
            )
            bound = BOUNDS.get(header["algorithm"], 1e-5)
            np.testing.assert_allclose(unclipped, expected, atol=bound, rtol=1e-5)
            past = [(observation, np.clip(expected, -1, 1)), *past[:-1]]
            np.testing.assert_allclose(
                history, np.concatenate([part for pair in past for part in pair], 1), atol=bound
            )
            largest = max(largest, np.abs(expected).max())
        return largest
