"""Policy servers that hang, break, restart or answer nonsense: simulations end without a verdict,
and the next ones are right."""

import base64
import contextlib
import hashlib
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import textwrap
import threading
import time
import unittest
from collections.abc import Iterator
from typing import Any

import mishandle
import numpy as np
from gymnasium.vector import SyncVectorEnv
from mishandle import Axis, PolicyServer
from mishandle.errors import (
    InvalidStateError, InvalidValueError, MishandleError, PolicyServerError
)
from mishandle.policies.messages import MSGPACK_NUMPY
from openpi_client import msgpack_numpy
from servers import Line, openpi_server, proportional
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

# The nominal place is negative. Servers of these tests fail at places above 1.
SPACE = [Axis("start", -2.0, 2.0, "m", nominal=-0.5)]
OPTIONS: dict[str, Any] = {"signals": {"place": ("obs[0]", "m")}, "steps": 20, "version": "1"}

SERVER = """
import sys
sys.path.insert(0, {folder!r})
from servers import Recorded, proportional
from websockets.sync.server import serve
import os
def policy(request):
    if request["observation/state"][0] > 1.0 and {dies}:
        os._exit(1)
    return proportional(request)
found = Recorded(policy, {metadata!r})
with serve(found.handle, "127.0.0.1", {port}) as server:
    print(server.socket.getsockname()[1], flush=True)
    server.serve_forever()
"""


def simulate(policy: Any, start: float, environment: Any = None, **options: Any) -> Any:
    found = mishandle.simulate(
        environment or Line(), "always(abs(place) <= 3)", SPACE, at={"start": start}, policy=policy,
        **{**OPTIONS, **options}
    )
    return found[0]


def failing(what: Any) -> Any:
    """A policy that does something else at places above 1."""
    return lambda request: what(request) if request[
        "observation/state"
    ][0] > 1.0 else proportional(request)


class Failures(unittest.TestCase):
    def assert_no_verdict(self, found: Any, end: str, reason: str) -> None:
        self.assertTrue(found.end.startswith(end), found.end)
        self.assertIsNone(found.robustness)
        self.assertIn(reason, found.exceptions[0] if found.exceptions else "")

    def test_a_server_that_is_not_there_is_an_error_before_the_first_simulation(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as closed:
            port = closed.getsockname()[1]
        with self.assertRaisesRegex(
            PolicyServerError,
            f"ws://127.0.0.1:{port} cannot be reached: .*refused.*'openpi' running there"
        ):
            simulate(f"ws://127.0.0.1:{port}", 0.5)
        with self.assertRaisesRegex(InvalidValueError, "is not the address of a policy server"):
            simulate("ws://", 0.5)

    def test_a_server_of_something_else_is_an_error_before_the_first_simulation(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as silent:
            policy = PolicyServer(f"ws://127.0.0.1:{silent.getsockname()[1]}", time_limit=0.3)
            with self.assertRaisesRegex(
                PolicyServerError, "did not answer within 0.3 s; is a server of the protocol"
            ):
                simulate(policy, 0.5)
        with openpi_server(proportional) as server:
            with self.assertRaisesRegex(
                PolicyServerError, "sent .* that are no message|sent the message|sent a"
            ):
                simulate(PolicyServer(server.url, protocol="vla-eval", time_limit=0.5), 0.5)

    def test_a_message_before_its_request_is_never_an_answer(self) -> None:
        def answer(websocket: Any, status: Any) -> None:
            websocket.send(MSGPACK_NUMPY.pack({}))
            with contextlib.suppress(ConnectionClosed):
                for message in websocket:
                    websocket.send(MSGPACK_NUMPY.pack(proportional(MSGPACK_NUMPY.unpack(message))))
                    websocket.send(status)

        statuses = [
            MSGPACK_NUMPY.pack({"actions": np.full((1, 1), 7.0)}), MSGPACK_NUMPY.pack({"ok": 1}),
            "ok"
        ]
        for status in statuses:
            server = serve(lambda websocket: answer(websocket, status), "127.0.0.1", 0)
            thread = threading.Thread(target=server.serve_forever, daemon=True)
            thread.start()
            try:
                port = server.socket.getsockname()[1]
                with self.assertRaisesRegex(
                    MishandleError, "sent a message before its request"
                ):
                    simulate(PolicyServer(f"ws://127.0.0.1:{port}", time_limit=5.0), 0.5)
            finally:
                server.shutdown()
                thread.join()

    def test_the_late_answer_of_a_simulation_is_never_that_of_the_next(self) -> None:
        def late(request: Any) -> Any:
            time.sleep(0.6)
            return {"actions": np.full((50, 1), 7.0)}

        with openpi_server(failing(late)) as server:
            policy = PolicyServer(server.url, time_limit=0.3)
            expected = simulate(policy, 0.5).trace["place"]
            self.assert_no_verdict(
                simulate(policy, 1.5), "timed out", "did not answer within 0.3 s"
            )
            connections = server.connections
            np.testing.assert_array_equal(simulate(policy, 0.5).trace["place"], expected)
            # In one run, too, and with a connection that the time-out closed.
            found = mishandle.evaluate(
                Line(), "always(abs(place) <= 3)", SPACE, policy=policy, episodes=12, seed=1,
                **OPTIONS
            )
        columns = mishandle.open_run(found.path).columns()
        for start, end, robustness in zip(columns["start"], columns["end"], columns["robustness"]):
            if start > 1.0:
                self.assertTrue(end.startswith("timed out"), end)
                self.assertIsNone(robustness)
            else:
                self.assertAlmostEqual(robustness, 3.0 - abs(start))
        self.assertGreater(sum(start > 1.0 for start in columns["start"]), 1)
        self.assertGreater(server.connections, connections + 1)

    def test_the_time_limit_of_a_simulation_closes_the_connection(self) -> None:
        def late(request: Any) -> Any:
            time.sleep(0.6)
            return {"actions": np.full((50, 1), 7.0)}

        with openpi_server(failing(late)) as server:
            found = simulate(server.url, 1.5, time_limit=0.3)
            self.assertTrue(found.end.startswith("timed out"), found.end)
            episodes = mishandle.simulate(
                SyncVectorEnv([Line] * 2), "always(abs(place) <= 3)", SPACE, at={"start": 0.5},
                policy=server.url, time_limit=5, **OPTIONS
            )
            self.assertEqual(episodes[0].robustness, 2.5)

    def test_what_is_no_chunk_of_actions_ends_the_simulation_as_crashed(self) -> None:
        answers: list[tuple[Any, str]] = [
            ("Traceback: out of memory", "reports an error:\nTraceback: out of memory"),
            (b"\xc1\xc1", "that are no message in msgpack"),
            (msgpack_numpy.packb([1, 2]), "is a list; expected a dictionary with `actions`"),
            (b"", "that are no message in msgpack"),
            (
                {"action": np.zeros((1, 1))},
                "has the keys action; expected a dictionary with `actions`"
            ),
            (
                {"actions": np.zeros((10, 7))},
                "have the shape (10, 7); expected (horizon, action), where an action of the "
                "environment is 1 number"
            ),
            ({"actions": np.zeros((0, 1))}, "have the shape (0, 1)"),
            ({"actions": "left"}, "are not numbers"),
            ({"actions": None}, "have the shape ()"),
        ]
        for answer, reason in answers:
            with self.subTest(reason), openpi_server(failing(lambda request: answer)) as server:
                self.assert_no_verdict(simulate(server.url, 1.5), "crashed", reason)
                self.assertEqual(simulate(server.url, 0.5).robustness, 2.5)

    def test_a_chunk_that_is_too_short_is_an_error(self) -> None:
        with openpi_server(failing(lambda request: {"actions": np.zeros((3, 1))})) as server:
            with self.assertRaisesRegex(
                InvalidStateError, r"shape \(1, 1\).* and 4 actions are executed"
            ):
                simulate(PolicyServer(server.url, execute=4), 1.5)

    def test_nan_is_an_invalid_action(self) -> None:
        for value in (np.nan, np.inf):
            with openpi_server(
                failing(lambda request: {"actions": np.full((1, 1), value)})
            ) as server:
                found = simulate(server.url, 1.5)
            self.assertTrue(found.end.startswith("invalid action"), found.end)
            self.assertIsNone(found.robustness)

    def test_an_exception_of_the_server_is_a_crash_with_its_traceback(self) -> None:
        with openpi_server(failing(lambda request: request["missing"])) as server:
            self.assert_no_verdict(simulate(server.url, 1.5), "crashed", "KeyError: 'missing'")
            self.assertEqual(simulate(server.url, 0.5).robustness, 2.5)

    def test_a_frame_that_is_too_large_is_a_crash(self) -> None:
        with openpi_server(failing(lambda request: b"x" * (2**26 + 1))) as server:
            self.assert_no_verdict(simulate(server.url, 1.5), "crashed", "broke the connection")

    def test_a_server_that_does_not_read_is_a_time_out(self) -> None:
        with deaf_server() as port:
            policy = PolicyServer(
                f"ws://127.0.0.1:{port}",
                observation={"large": lambda observation: np.zeros(2_000_000)}, time_limit=1.0
            )
            with self.assertRaisesRegex(InvalidStateError, "did not answer within 1 s"):
                simulate(policy, 0.5)

    def test_a_killed_server_ends_one_simulation_and_serves_the_next_after_its_restart(
        self
    ) -> None:
        with process(dies=True) as (server, port):
            policy = PolicyServer(f"ws://127.0.0.1:{port}", time_limit=20.0)
            restarted: list[Any] = []

            def restart() -> None:
                server.wait()
                time.sleep(0.5)
                restarted.append(started_process(port=port))

            watcher = threading.Thread(target=restart)
            watcher.start()
            options = {
                "search": "random", "trials": 1, "budget": 30, "seed": 1, **OPTIONS,
                "plan": {"falsify": {"keep_going": True, "new_mode_rate": 0.0}}
            }
            found = mishandle.falsify(
                Line(), "always(abs(place) <= 1.9)", SPACE, policy=policy, **options
            )
            watcher.join()
            restarted[0].kill()
            restarted[0].communicate()
        columns = mishandle.open_run(found.path).columns()
        crashed = [row for row, end in enumerate(columns["end"]) if end != "completed"]
        self.assertEqual(len(crashed), 1)
        self.assertGreater(columns["start"][crashed[0]], 1.0)
        for row, (start, robustness) in enumerate(zip(columns["start"], columns["robustness"])):
            if row not in crashed:
                self.assertAlmostEqual(robustness, 1.9 - abs(start))
        self.assertIn("broke the connection", found.exceptions[0])

    def test_another_policy_at_the_same_address_is_a_crash(self) -> None:
        for before, after in [
            ({"hash": "a"}, {"hash": "b"}), ({"size": np.zeros(2)}, {"size": np.zeros(3)})
        ]:
            with openpi_server(failing(lambda request: b""), before) as server:
                space, options = SPACE, {"search": "random", "trials": 1, "budget": 12, **OPTIONS}

                def change(done: int, total: int) -> None:
                    server.metadata = after

                found = mishandle.falsify(
                    Line(), "always(abs(place) <= 9)", space, policy=server.url, progress=change,
                    **options
                )
                columns = mishandle.open_run(found.path).columns()
            first = next(row for row, start in enumerate(columns["start"]) if start > 1.0)
            self.assertLess(first, 11)
            self.assertEqual({end for end in columns["end"][:first]} | {"completed"}, {"completed"})
            self.assertTrue(all(end.startswith("crashed") for end in columns["end"][first:]))
            self.assertIn("it serves another policy", "".join(found.exceptions))

    def test_ctrl_c_ends_a_question_at_once_and_the_run_continues_later(self) -> None:
        done = threading.Event()
        with tempfile.TemporaryDirectory() as folder, openpi_server(
            failing(lambda request: done.wait())
        ) as server:
            program = textwrap.dedent(f"""
                import signal, sys
                # A shell starts background jobs with SIGINT ignored, and programs inherit it.
                signal.signal(signal.SIGINT, signal.default_int_handler)
                sys.path.insert(0, {str(pathlib.Path(__file__).parent)!r})
                import mishandle
                from test_policy_server_failures import Line, OPTIONS, SPACE
                mishandle.falsify(
                    Line(), "always(abs(place) <= 1.9)", SPACE, policy={server.url!r},
                    search="random", trials=1, budget=20,
                    plan={{"falsify": {{"keep_going": True}}}},
                    out={folder + "/run.sqlite"!r}, **OPTIONS)
            """)
            child = subprocess.Popen(
                [sys.executable, "-c", program], stderr=subprocess.PIPE, text=True
            )
            self.addCleanup(child.kill)
            while not any(request["observation/state"][0] > 1.0 for request in server.requests):
                self.assertIsNone(
                    child.poll(),
                    child.stderr.read() if child.poll() is not None and child.stderr else ""
                )
                time.sleep(0.05)
            child.send_signal(signal.SIGINT)
            # The server answers after the end of the child only.
            _, errors = child.communicate()
            self.assertIn("KeyboardInterrupt", errors)
            server.policy = proportional
            done.set()
            found = mishandle.falsify(
                Line(), "always(abs(place) <= 1.9)", SPACE, policy=server.url, search="random",
                trials=1, budget=20, plan={"falsify": {"keep_going": True}},
                out=f"{folder}/run.sqlite", resume=True, **OPTIONS,
            )
            columns = mishandle.open_run(found.path).columns()
        self.assertEqual(set(columns["end"]), {"completed"})
        for start, robustness in zip(columns["start"], columns["robustness"]):
            self.assertAlmostEqual(robustness, 1.9 - abs(start))


def started_process(dies: bool = False, port: int = 0, metadata: Any = None) -> Any:
    folder = str(pathlib.Path(__file__).parent)
    program = SERVER.format(folder=folder, dies=dies, port=port, metadata=metadata or {})
    child = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    return child


@contextlib.contextmanager
def process(dies: bool) -> Iterator[tuple[Any, int]]:
    """Runs a server in a process."""
    child = started_process(dies)
    try:
        yield child, int(child.stdout.readline())
    finally:
        child.kill()
        child.communicate()


@contextlib.contextmanager
def deaf_server() -> Iterator[int]:
    """Runs a server that opens connections, sends its metadata, and reads nothing more."""
    listening = socket.create_server(("127.0.0.1", 0))
    kept: list[socket.socket] = []

    def accept() -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = listening.accept()
                kept.append(connection)
                head = connection.recv(65536).decode()
                key = next(
                    line.split(": ")[1] for line in head.split("\r\n")
                    if line.lower().startswith("sec-websocket-key")
                )
                digest = base64.b64encode(
                    hashlib.sha1((key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11").encode()).digest()
                ).decode()
                connection.sendall(
                    b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\n"
                    b"Connection: Upgrade\r\n"
                    + f"Sec-WebSocket-Accept: {digest}\r\n\r\n".encode() + b"\x82\x01\x80"
                )

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield listening.getsockname()[1]
    finally:
        for each in (listening, *kept):
            each.close()
