"""Policy servers and environments for the tests of policies behind a server."""

import contextlib
import threading
import traceback
from collections.abc import Callable, Iterator
from typing import Any

import cases
import numpy as np
from openpi_client import msgpack_numpy
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

MIDDLE, WIDTH = 16, 33
"""The column of the place 0 in a picture of :class:`Line`, and the number of its columns."""


class Line(cases.Line):
    """A point whose pictures show it as a white column, 0.1 m per pixel."""

    metadata = {"render_modes": ["rgb_array"]}
    render_mode = "rgb_array"

    def render(self) -> Any:
        picture = np.zeros((8, WIDTH, 3), np.uint8)
        picture[:, int(np.clip(MIDDLE + round(self.place / 0.1), 0, WIDTH - 1))] = 255
        return picture


class Recorded:
    """What a server of the tests got and does."""

    def __init__(self, policy: Callable[[Any], Any], metadata: dict[str, Any] | None) -> None:
        self.policy = policy
        self.metadata = metadata or {}
        self.requests: list[Any] = []
        self.raw: list[bytes] = []
        self.connections = 0
        self.port = 0

    @property
    def url(self) -> str:
        return f"ws://127.0.0.1:{self.port}"

    def handle(self, websocket: Any) -> None:
        """Speaks the protocol of openpi, as its `WebsocketPolicyServer` does. A policy can return a
        frame instead of an answer."""
        self.connections += 1
        websocket.send(msgpack_numpy.packb(self.metadata))
        with contextlib.suppress(ConnectionClosed):
            while True:
                self.raw.append(websocket.recv())
                self.requests.append(msgpack_numpy.unpackb(self.raw[-1]))
                try:
                    answer = self.policy(self.requests[-1])
                    websocket.send(
                        answer if isinstance(answer, (bytes, str)) else msgpack_numpy.packb(answer)
                    )
                except ConnectionClosed:
                    raise
                except Exception:
                    websocket.send(traceback.format_exc())
                    websocket.close(
                        1011, "Internal server error. Traceback included in previous frame."
                    )


@contextlib.contextmanager
def openpi_server(
    policy: Callable[[Any], Any], metadata: dict[str, Any] | None = None
) -> Iterator[Recorded]:
    """Runs a server in a thread."""
    found = Recorded(policy, metadata)
    server = serve(found.handle, "127.0.0.1", 0, compression=None, max_size=None)
    found.port = server.socket.getsockname()[1]
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield found
    finally:
        server.shutdown()
        thread.join()


def proportional(request: Any) -> Any:
    """A policy that halves the place in each step."""
    return {"actions": -5.0 * np.asarray(request["observation/state"])[None]}


def seeing(request: Any) -> Any:
    """A policy that knows the place from a picture only."""
    columns = np.flatnonzero(request["observation/image"][4, :, 0])
    return {"actions": np.array([[-0.5 * (columns.mean() - MIDDLE)]])}
