"""Policies behind a server: what is sent, how chunks are executed, and what identifies them."""

import contextlib
import pathlib
import sqlite3
import unittest
import warnings
from typing import Any

import gymnasium
import mishandle
import numpy as np
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
from mishandle import Axis, PolicyArgument, PolicyServer
from mishandle.errors import InvalidStateError, InvalidValueError, PolicyServerError
from mishandle.policies import Resized
from mishandle.policies.messages import MSGPACK_NUMPY, TEXT_KEYS
from mishandle.policies.observations import resize_with_pad
from openpi_client import image_tools, msgpack_numpy
from openpi_client.websocket_client_policy import WebsocketClientPolicy
from servers import Line, openpi_server, proportional, seeing

START = Axis("start", -1.5, 1.5, "m", nominal=1.0)
NEAR = "always[30:40](abs(place) <= 0.2)"
NOW = "always(abs(place) <= 100)"
OPTIONS: dict[str, Any] = {"signals": {"place": ("obs[0]", "m")}, "steps": 40, "version": "1"}


def simulate(
    policy: Any, environment: Any = None, space: Any = (START,), at: Any = None,
    formula: str = NEAR, **options: Any
) -> Any:
    [found] = mishandle.simulate(
        environment or Line(), formula, list(space), at=at or {"start": 1.0}, policy=policy,
        **{**OPTIONS, **options}
    )
    return found


class Sent(unittest.TestCase):
    def test_the_bytes_of_a_request_are_those_of_the_client_of_openpi(self) -> None:
        with openpi_server(proportional) as server:
            ours = simulate(server.url, steps=1, formula=NOW, at={"start": 0.75})
            with warnings.catch_warnings():
                # It opens connections as older versions of websockets do.
                warnings.simplefilter("ignore", DeprecationWarning)
                theirs = WebsocketClientPolicy("127.0.0.1", server.port)
            answer = theirs.infer({"observation/state": np.array([0.75])})
            self.assertEqual(server.raw[-1], server.raw[-2])
            self.assertAlmostEqual(ours.trace["place"][1], 0.75 + 0.1 * answer["actions"][0, 0])

    def test_every_message_has_the_bytes_of_openpi(self) -> None:
        picture = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
        message = {
            "observation/image": picture[:, ::-1],
            "nested": {
                "a": np.float32(0.5), "b": np.array(3, np.int16), "c": [1, "two", None, True]
            },
            "state": np.linspace(0, 1, 5),
            "float": np.float64(2.0),
            "none": np.zeros((0, 3), np.float32),
        }
        self.assertEqual(MSGPACK_NUMPY.pack(message), msgpack_numpy.packb(message))
        back = MSGPACK_NUMPY.unpack(msgpack_numpy.packb(message))
        np.testing.assert_array_equal(back["observation/image"], picture[:, ::-1])
        self.assertEqual(
            (back["nested"]["a"], back["nested"]["a"].dtype, back["none"].shape),
            (0.5, np.float32, (0, 3))
        )

    def test_the_other_encoding_is_that_of_vla_eval(self) -> None:
        from vla_eval.protocol import Message, MessageType, pack_message, unpack_message

        payload = {
            "state": np.linspace(0, 1, 5), "images": {"front": np.zeros((2, 2, 3), np.uint8)},
            "n": np.int64(2)
        }
        packed = TEXT_KEYS.pack({
            "type": "observation", "payload": payload, "seq": 3, "timestamp": 1.5
        })
        read = unpack_message(packed)
        np.testing.assert_array_equal(read.payload["state"], payload["state"])
        np.testing.assert_array_equal(read.payload["images"]["front"], payload["images"]["front"])
        answer = TEXT_KEYS.unpack(
            pack_message(Message(MessageType.ACTION, {"actions": payload["state"]}, 3, 1.5))
        )
        np.testing.assert_array_equal(answer["payload"]["actions"], payload["state"])

    def test_a_message_of_a_server_makes_arrays_of_numbers_only(self) -> None:
        for dtype, data, shape in [
            ("|O", b"12345678", [1]), ("<f8", b"123", [1]), ("<f8", b"", [-1]),
            ("<U1", b"1234", [1])
        ]:
            array = {b"__ndarray__": True, b"data": data, b"dtype": dtype, b"shape": shape}
            with self.assertRaises(ValueError, msg=dtype):
                MSGPACK_NUMPY.unpack(msgpack_numpy.packb(array))

    def test_a_resized_picture_has_the_pixels_of_openpi(self) -> None:
        random = np.random.default_rng(0)
        for size in [(48, 64), (64, 48), (100, 30), (32, 32), (7, 9)]:
            picture = random.integers(0, 256, (*size, 3), np.uint8)
            np.testing.assert_array_equal(
                resize_with_pad(picture, 32, 32), image_tools.resize_with_pad(picture, 32, 32)
            )

    def test_parts_come_from_observation_picture_scenario_and_functions(self) -> None:
        task = Axis("task", values=["go home", "go away"], apply=PolicyArgument("mode"))
        gain = Axis("gain", 0, 1, nominal=0.5, apply=PolicyArgument("gain"))
        with openpi_server(lambda request: {"actions": np.zeros((1, 1))}) as server:
            policy = PolicyServer(
                server.url,
                observation={
                    "state": "obs", "first": "obs[0]",
                    "camera": {"small": Resized("render", 16, 16), "full": "render"},
                    "double": lambda observation: 2 * observation
                },
                instruction=task
            )
            simulate(
                policy, space=[START, task, gain],
                at={"start": 0.5, "task": "go away", "gain": 0.25}, steps=1, formula=NOW
            )
        sent = server.requests[-1]
        self.assertEqual(sent["state"].tolist(), [0.5])
        self.assertEqual((sent["first"], sent["double"].tolist()), (0.5, [1.0]))
        self.assertEqual((sent["prompt"], sent["mode"], sent["gain"]), ("go away", "go away", 0.25))
        made = Line()
        made.reset(options={"start": 0.5})
        np.testing.assert_array_equal(sent["camera"]["full"], made.render())
        self.assertEqual(sent["camera"]["small"].shape, (16, 16, 3))

    def test_a_dictionary_is_sent_as_it_is(self) -> None:
        class Parts(Line):
            observation_space = gymnasium.spaces.Dict({
                "agent": Line.observation_space, "goal": Line.observation_space
            })

            def reset(self, **options: Any) -> Any:
                observation, info = super().reset(**options)
                return {"agent": observation, "goal": np.zeros(1)}, info

            def step(self, action: Any) -> Any:
                observation, *others = super().step(action)
                return {"agent": observation, "goal": np.zeros(1)}, *others

        with openpi_server(lambda request: {"actions": -5.0 * request["agent"][None]}) as server:
            found = simulate(
                PolicyServer(server.url, instruction="go"), Parts(),
                signals={"place": "obs.agent[0]"}
            )
        self.assertGreater(found.robustness, 0.19)
        self.assertEqual(sorted(server.requests[0]), ["agent", "goal", "prompt"])
        self.assertEqual(server.requests[0]["prompt"], "go")

    def test_a_policy_acts_on_pictures(self) -> None:
        with openpi_server(seeing) as server:
            policy = PolicyServer(server.url, observation={"observation/image": "render"})
            for environment in (Line(), SyncVectorEnv([Line] * 3)):
                found = simulate(policy, environment, at={"start": -1.2})
                self.assertGreater(found.robustness, 0.0)


class Chunks(unittest.TestCase):
    def test_k_actions_of_a_chunk_are_executed_before_the_next_question(self) -> None:
        chunk = np.arange(6.0)[:, None]
        for execute, expected in [(None, 6), (4, 4), (1, 1)]:
            with openpi_server(
                lambda request: {"actions": chunk + 10 * request["observation/state"].round(6)}
            ) as server:
                found = simulate(
                    PolicyServer(server.url, execute=execute), at={"start": 0.0}, steps=6,
                    formula=NOW
                )
                asked = [float(request["observation/state"][0]) for request in server.requests]
            # Two simulations check the nominal scenario.
            per_simulation = -(-6 // expected)
            self.assertEqual(len(asked), 3 * per_simulation)
            place, places = 0.0, [0.0]
            for step in range(6):
                if step % expected == 0:
                    base = 10 * round(place, 6)
                place += 0.1 * (step % expected + base)
                places.append(place)
            np.testing.assert_allclose(found.trace["place"], places, atol=1e-5)

    def test_each_episode_starts_with_an_empty_chunk(self) -> None:
        with openpi_server(lambda request: {"actions": np.zeros((100, 1))}) as server:
            episodes = mishandle.simulate(
                Line(), NEAR, [START], at={"start": 0.5}, policy=server.url, repeat=3, **OPTIONS
            )
        self.assertEqual(len(episodes), 3)
        self.assertEqual(
            [float(request["observation/state"][0]) for request in server.requests][-3:], [0.5] * 3
        )
        self.assertEqual(server.connections, 1 + 1)

    def test_a_reset_is_told_to_a_server_that_has_one(self) -> None:
        def roboarena(request: Any) -> Any:
            return (
                "reset successful" if request.pop("endpoint") == "reset" else proportional(request)
            )

        with openpi_server(roboarena) as server:
            policy = PolicyServer(
                server.url,
                observation={"observation/state": "obs", "endpoint": lambda observation: "infer"},
                reset={"endpoint": "reset"},
            )
            self.assertGreater(simulate(policy).robustness, 0.19)
        self.assertEqual(sum("observation/state" not in request for request in server.requests), 3)

    def test_rows_of_a_vector_environment_keep_their_chunks_apart(self) -> None:
        def policy(request: Any) -> Any:
            return {"actions": np.linspace(-2.0, 0.0, 4)[:, None] * request["observation/state"]}

        with openpi_server(policy) as server:
            runs = []
            for made in (Line(), SyncVectorEnv([Line] * 4), AsyncVectorEnv([Line] * 4)):
                found = mishandle.evaluate(
                    made, NEAR, [START], policy=server.url, episodes=8, seed=3,
                    plan={"evaluate": {"batch": 4}}, **OPTIONS
                )
                runs.append(mishandle.open_run(found.path).columns()["robustness"])
                made.close()
        self.assertEqual(runs[0], runs[1])
        self.assertEqual(runs[0], runs[2])

    def test_rows_that_ended_ask_nothing(self) -> None:
        class Short(Line):
            def step(self, action: Any) -> Any:
                observation, reward, _, _, info = super().step(action)
                return observation, reward, bool(self.place > 1.0), False, info

        with openpi_server(lambda request: {"actions": np.zeros((1, 1))}) as server:
            made = SyncVectorEnv([Short] * 2)
            episodes = mishandle.simulate(
                made, NEAR, [START], at={"start": 1.2}, policy=server.url, repeat=2,
                termination="hold", **OPTIONS
            )
        self.assertEqual([episode.steps for episode in episodes], [1, 1])
        self.assertEqual(
            sum(request["observation/state"][0] == 1.2 for request in server.requests), 2
        )


class Kinds(unittest.TestCase):
    def test_discrete_actions_are_whole_numbers(self) -> None:
        class Discrete(Line):
            action_space = gymnasium.spaces.Discrete(3, start=-1)

            def step(self, action: Any) -> Any:
                assert type(action) is int, action
                return super().step([5.0 * action])

        def policy(request: Any) -> Any:
            return {"actions": -np.sign(np.round(request["observation/state"]))}

        with openpi_server(policy) as server:
            found = simulate(server.url, Discrete(), at={"start": 1.2})
        self.assertEqual(found.end, "completed")
        self.assertLess(abs(found.trace["place"][-1]), 0.51)
        with openpi_server(lambda request: {"actions": np.array([[0.5]])}) as server:
            with self.assertRaisesRegex(
                InvalidStateError, "expected whole numbers of the space Discrete"
            ):
                simulate(server.url, Discrete())

    def test_a_real_environment_and_policy(self) -> None:
        """Gymnasium's pendulum, held upright by a linear policy behind a server, has the bits of
        the same policy without a server."""

        def linear(observation: Any) -> Any:
            cosine, sine, rate = np.asarray(observation, dtype=np.float64)
            return np.clip(
                [-12.0 * np.arctan2(sine, cosine) - 3.0 * rate], -2, 2
            ).astype(np.float32)

        made = gymnasium.make("Pendulum-v1")
        angle = Axis("x_init", 0.05, 0.3, "rad", nominal=0.1)
        options: dict[str, Any] = {
            "signals": {"cosine": "obs[0]"}, "steps": 60, "version": "1", "episodes": 12, "seed": 1
        }
        formula = "always[40:60](cosine >= 0.99)"
        with openpi_server(
            lambda request: {"actions": linear(request["observation/state"])[None]}
        ) as server:
            served = mishandle.evaluate(made, formula, [angle], policy=server.url, **options)
        local = mishandle.evaluate(made, formula, [angle], policy=linear, **options)
        one, other = (
            mishandle.open_run(found.path).columns()["robustness"] for found in (served, local)
        )
        self.assertEqual(one, other)
        self.assertEqual(served.success_rate.value, 1.0)

    def test_tasks_take_a_server(self) -> None:
        with openpi_server(lambda request: {"actions": np.zeros((200, 9))}) as server:
            [served] = mishandle.simulate("point-reaching", policy=server.url, rows=2, version="1")
            [local] = mishandle.simulate(
                "point-reaching", policy=lambda observation: np.zeros(9), rows=2
            )
            self.assertEqual(served.robustness, local.robustness)
            with self.assertRaisesRegex(InvalidValueError, "the system draws none"):
                mishandle.simulate(
                    "point-reaching",
                    policy=PolicyServer(server.url, observation={"image": "render"})
                )


class Identity(unittest.TestCase):
    def evaluated(self, server: Any, **options: Any) -> Any:
        given = {key: value for key, value in OPTIONS.items() if key != "version"}
        with warnings.catch_warnings(record=True, action="always") as caught:
            run = {"search": "random", "trials": 1, "budget": 2}
            found = mishandle.falsify(
                Line(), NEAR, [START], policy=PolicyServer(server.url, **options), **run, **given
            )
        return found, [str(each.message) for each in caught]

    def test_a_server_that_states_nothing_is_not_covered_and_not_deterministic(self) -> None:
        with openpi_server(proportional) as server:
            found, messages = self.evaluated(server)
            self.assertEqual(found.not_covered, (f"the policy behind {server.url}",))
            self.assertIn("does not cover the policy behind", messages[0])
        with contextlib.closing(sqlite3.connect(f"file:{found.path}?mode=ro", uri=True)) as run:
            components = dict(run.execute("SELECT role, name FROM component"))
        self.assertEqual(components["not covered"], found.not_covered[0])
        self.assertEqual(components["policy"], server.url)
        self.assertFalse(self.is_deterministic(found.path))

    def test_a_server_that_states_its_hash_and_that_it_is_deterministic_is_covered(self) -> None:
        stated = {"hash": "a" * 64, "deterministic": True, "started": 1.5}
        with openpi_server(proportional, stated) as server:
            found, messages = self.evaluated(server)
            self.assertEqual((found.not_covered, messages), ((), []))
            self.assertTrue(self.is_deterministic(found.path))
            again, _ = self.evaluated(server)
            server.metadata = {**stated, "started": 2.5}
            later, _ = self.evaluated(server)
            server.metadata = {**stated, "hash": "b" * 64}
            other, _ = self.evaluated(server)
            executed, _ = self.evaluated(server, execute=1)
        hashes = [
            self.header(each.path, "target_hash") for each in (found, again, later, other, executed)
        ]
        self.assertEqual(hashes[0], hashes[1])
        self.assertEqual(hashes[0], hashes[2])
        self.assertEqual(len(set(hashes)), 3)

    def test_a_hash_alone_does_not_promise_the_same_bits(self) -> None:
        with openpi_server(proportional, {"hash": "a" * 64}) as server:
            found, _ = self.evaluated(server)
        self.assertEqual(found.not_covered, ())
        self.assertFalse(self.is_deterministic(found.path))

    def test_a_server_that_is_not_deterministic_is_found_out(self) -> None:
        random = np.random.default_rng(0)
        with openpi_server(
            lambda request: {"actions": random.normal(size=(1, 1))},
            {"hash": "a", "deterministic": True}
        ) as server:
            found, messages = self.evaluated(server)
        self.assertIn("not deterministic", messages[0])
        self.assertFalse(self.is_deterministic(found.path))

    def test_a_run_contains_no_header_and_no_password(self) -> None:
        with self.assertRaisesRegex(InvalidValueError, "must not contain a password"):
            PolicyServer("ws://user:secret@host:1")
        policy = PolicyServer("ws://host:1", headers={"Authorization": "Api-Key secret"})
        self.assertNotIn("secret", repr(policy))
        with openpi_server(proportional) as server:
            found, _ = self.evaluated(server, headers={"Authorization": "Api-Key secret"})
            self.assertNotIn(b"Api-Key", pathlib.Path(found.path).read_bytes())

    def header(self, path: Any, key: str) -> Any:
        with contextlib.closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as run:
            return run.execute("SELECT value FROM header WHERE key = ?", [key]).fetchone()[0]

    def is_deterministic(self, path: Any) -> bool:
        return bool(self.header(path, "target_is_deterministic"))
