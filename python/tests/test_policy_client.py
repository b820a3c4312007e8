"""The program that asks a policy server for the actions of a target file."""

import json
import os
import pathlib
import subprocess
import sys
from typing import Any
from unittest import mock

from cases import FolderCase
import mishandle
import numpy as np
from servers import openpi_server
from test_robots import FILE, MODEL

GAINS = [1.0, 2.0, 25.0, 4.0]


def balance(request: Any) -> Any:
    """A chunk of four forces, which hold the one of now."""
    force = np.dot(GAINS, request["observation/state"])
    return {"actions": np.full((4, 1), force)}


class Client(FolderCase):
    def setUp(self) -> None:
        super().setUp()
        (self.folder / "cartpole.xml").write_text(MODEL)
        allowed = mock.patch.dict(os.environ, {"MISHANDLE_ALLOW_PROGRAMS": "1"})
        allowed.start()
        self.addCleanup(allowed.stop)

    def file(self, url: str, *arguments: str, state: str = "") -> pathlib.Path:
        words = [sys.executable, "-m", "mishandle.policies.client", url, *arguments]
        policy = f"policy = {{ process = {json.dumps(words)}, action = \"action\"{state} }}"
        lines = [policy if line.startswith("policy =") else line for line in FILE.splitlines()]
        path = self.folder / "cartpole.toml"
        path.write_text("\n".join(lines))
        return path

    def trace(self, path: Any, **options: Any) -> Any:
        [found] = mishandle.simulate(path, at={"tilt": 0.2}, **options)
        return found.trace["angle"]

    def test_the_policy_of_a_target_file_is_behind_a_server(self) -> None:
        with openpi_server(balance) as server:
            served = self.trace(self.file(server.url))
            self.assertEqual(server.requests[0]["observation/state"].shape, (4,))
        local = self.trace(
            self.folder / "cartpole.toml",
            policy=lambda state: [np.float32(np.dot(GAINS, state.astype(np.float32)))]
        )
        np.testing.assert_allclose(served, local, atol=1e-5)
        self.assertLess(abs(served[-1]), 0.05)

    def test_a_chunk_is_the_state_of_the_program(self) -> None:
        with openpi_server(balance) as server:
            path = self.file(server.url, "--execute", "4", state=", state = 4")
            held = self.trace(path)
            # The check of the program asks twice, each simulation 100 / 4 times.
            questions = len(server.requests)
            in_python = self.trace(
                path, policy=mishandle.PolicyServer(server.url, execute=4), version="1"
            )
        self.assertEqual(questions % 25, 2 % 25)
        np.testing.assert_array_equal(held, in_python)

    def test_an_answer_follows_from_its_question_alone(self) -> None:
        with openpi_server(
            lambda request: {"actions": np.outer([1.0, 2.0, 3.0], request["observation/state"])}
        ) as server:
            program = subprocess.Popen(
                [sys.executable, "-m", "mishandle.policies.client", server.url, "--execute", "3"],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            )
            assert program.stdin is not None and program.stdout is not None

            def ask(number: int, observation: list[Any], state: list[float]) -> Any:
                print(
                    json.dumps({
                        "id": number, "seed": "1", "time": 0.0, "observation": observation,
                        "state": state
                    }),
                    file=program.stdin, flush=True
                )
                return json.loads(program.stdout.readline())

            # Two simulations in turn.
            states = [[0.0] * 5, [0.0] * 5]
            for step in range(6):
                for row, observation in enumerate([[1.0, 2.0], [-1.0, 5.0]]):
                    answer = ask(10 * step + row, observation, states[row])
                    self.assertEqual(answer["id"], 10 * step + row)
                    np.testing.assert_array_equal(
                        answer["action"], (step % 3 + 1) * np.array(observation)
                    )
                    self.assertEqual(ask(0, observation, states[row])["action"], answer["action"])
                    states[row] = answer["state"]
            self.assertEqual(ask(1, [None, 1.0], [0.0] * 5)["action"], [None, 1.0])
            program.stdin.close()
            self.assertEqual(program.wait(timeout=600), 0)
            program.stdout.close()

    def test_mistakes_name_what_to_write(self) -> None:
        with openpi_server(balance) as server:
            with self.assertRaisesRegex(
                mishandle.MishandleError, "set state = 4 beside the process"
            ):
                self.trace(self.file(server.url, "--execute", "4", state=", state = 3"))
            with self.assertRaisesRegex(
                mishandle.MishandleError, "set state = 4 beside the process"
            ):
                self.trace(self.file(server.url, "--execute", "4"))
            url = server.url
        with self.assertRaisesRegex(mishandle.MishandleError, "cannot be reached"):
            self.trace(self.file(url))
        random = np.random.default_rng(0)
        with openpi_server(lambda request: {"actions": random.normal(size=(1, 1))}) as server:
            with self.assertRaisesRegex(mishandle.MishandleError, "answers the same question with"):
                self.trace(self.file(server.url))

    def test_failures_of_the_server_are_ends_without_a_verdict(self) -> None:
        def failing(request: Any) -> Any:
            if abs(request["observation/state"][2]) > 0.25:
                raise RuntimeError("out of memory")
            return balance(request)

        with openpi_server(failing) as server:
            path = self.file(server.url)
            [failed] = mishandle.simulate(path, at={"tilt": 0.29})
            [passed] = mishandle.simulate(path, at={"tilt": 0.2})
        self.assertTrue(failed.end.startswith("crashed"), failed.end)
        self.assertIsNone(failed.robustness)
        self.assertGreater(passed.robustness, 0.0)
