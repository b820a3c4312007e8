"""Connections to policy servers: one WebSocket each, in the protocol of openpi or of vla-eval."""

import contextlib
import socket
import struct
import time
import weakref
from collections.abc import Generator, Mapping
from typing import Any, Protocol
from urllib.parse import urlsplit

from mishandle.base.packages import needed
from mishandle.errors import InvalidValueError, PolicyServerError, TimeLimitExceeded
from mishandle.policies.messages import MAX_MESSAGE, MSGPACK_NUMPY, TEXT_KEYS, Encoding

_RETRY = 0.2
"""Pause between two attempts to reach a server that was there before, in seconds."""

_GOODBYE = 1.0
"""Longest time that a server has to agree that a connection ends, in seconds."""

_MAX_TEXT = 4000
"""Longest text of a server in an error, in characters; of a longer one, the end is kept."""


def check_url(url: str) -> None:
    """Checks the address of a policy server.

    >>> check_url("ws://user:secret@robot:8000")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    mishandle.errors.InvalidValueError: the address of a policy server must not contain a ...
    """
    try:
        parts = urlsplit(url)
        is_valid = (
            parts.scheme in ("ws", "wss") and bool(parts.hostname)
            and (parts.port is None or parts.port > 0)
        )
    except ValueError:
        is_valid = False
    if not is_valid or not url.isprintable():
        raise InvalidValueError(
            f"{url!r} is not the address of a policy server; expected ws://host:port or "
            "wss://host:port"
        )
    if parts.username is not None or parts.password is not None:
        raise InvalidValueError(
            "the address of a policy server must not contain a password, because run files contain "
            "the address; pass it in `headers`"
        )


class Connection:
    """A WebSocket to a policy server.

    Whatever interrupts it between question and answer (an exception, a time limit, Ctrl-C) closes
    it, so that a late answer is never read as that of the next question.

    Parameters
    ----------
    url : str
        Address of the server. Neither a redirect nor a proxy leads to another one.
    headers : mapping
        Headers of the HTTP request that opens the connection.
    time_limit : float
        Longest time until the connection is open, and until each answer, in seconds.
    patience : float
        How long a connection that is refused is tried again, in seconds: a server may start again.
    """

    def __init__(
        self, url: str, headers: Mapping[str, str], time_limit: float, patience: float = 0.0
    ) -> None:
        self.url = url
        self._time_limit = time_limit
        deadline = time.monotonic() + patience
        while True:
            try:
                self._socket = self._opened(headers)
                break
            except PolicyServerError:
                if time.monotonic() + _RETRY > deadline:
                    raise
                time.sleep(_RETRY)
        # Runs when nothing refers to the connection, and at the end of the program, while the
        # thread that reads from the socket still runs: a thread that the interpreter has stopped
        # could hold the lock of the socket for good.
        self._leave = weakref.finalize(self, self._socket.close)

    def _opened(self, headers: Mapping[str, str]) -> Any:
        with needed("policy servers need websockets and msgpack: pip install websockets msgpack"):
            from websockets.sync.client import connect
        parts = urlsplit(self.url)
        port = parts.port or (443 if parts.scheme == "wss" else 80)
        opened = None
        try:
            with self._failures("cannot be reached"):
                # With a socket of our own, websockets follows no redirect and uses no proxy.
                opened = socket.create_connection(
                    (parts.hostname or "", port), timeout=self._time_limit
                )
                opened.settimeout(None)
                # A server that does not read must not block a question longer.
                opened.setsockopt(
                    socket.SOL_SOCKET, socket.SO_SNDTIMEO,
                    struct.pack("ll", *_seconds_and_microseconds(self._time_limit))
                )
                opening = connect(
                    self.url,
                    sock=opened,
                    additional_headers=dict(headers),
                    compression=None,
                    max_size=MAX_MESSAGE,
                    open_timeout=self._time_limit,
                    # A server that compiles its model answers no ping for a while.
                    ping_interval=None,
                    close_timeout=_GOODBYE,
                )
                # Left by `leave` or `close`.
                return opening.__enter__()
        except BaseException:
            if opened is not None:
                opened.close()
            raise

    @property
    def is_open(self) -> bool:
        """Whether the other side has not closed it."""
        return bool(self._socket.protocol.state.name == "OPEN")

    def leave(self) -> None:
        """Closes the connection between two questions, with a word to the server."""
        self._leave()

    def close(self) -> None:
        """Closes the connection at once, without waiting for the server."""
        self._leave.detach()
        with contextlib.suppress(OSError):
            self._socket.socket.shutdown(socket.SHUT_RDWR)

    def send(self, message: bytes) -> None:
        """Sends a message that has no answer."""
        with self._closing(), self._failures("broke the connection"):
            self._check_silence()
            self._socket.send(message)

    def receive(self) -> bytes | str:
        """Waits for a message: a text is an error or an acknowledgment."""
        from websockets.exceptions import ConnectionClosed

        with self._closing(), self._failures("broke the connection"):
            found: bytes | str = self._socket.recv(timeout=self._time_limit)
            # A server that reports an error may leave then.
            with contextlib.suppress(ConnectionClosed):
                self._check_silence()
            return found

    def _check_silence(self) -> None:
        """Checks that no message waits: it would be read as the answer to the next request."""
        try:
            self._socket.recv(timeout=0)
        except TimeoutError:
            return
        raise self.failure(
            "sent a message before its request: it must send one message for each request, or the "
            "actions would be those of earlier requests"
        )

    def ask(self, message: bytes) -> bytes | str:
        """Sends a message and waits for the answer."""
        self.send(message)
        return self.receive()

    def failure(self, text: str) -> PolicyServerError:
        """Closes the connection and returns the error."""
        self.close()
        return PolicyServerError(f"the policy server {self.url} {text}")

    def unpacked(self, encoding: Encoding, data: bytes | str) -> Any:
        """Returns a message, which must not be a text."""
        if isinstance(data, str):
            raise self.failure(f"reports an error:\n{_shown(data)}")
        try:
            return encoding.unpack(data)
        except Exception as error:
            raise self.failure(
                f"sent {len(data)} bytes that are no message in msgpack: {error}"
            ) from error

    @contextlib.contextmanager
    def _closing(self) -> Generator[None, None, None]:
        try:
            yield
        except BaseException:
            self.close()
            raise

    @contextlib.contextmanager
    def _failures(self, text: str) -> Generator[None, None, None]:
        """Turns what can go wrong with a connection into the exceptions of a simulation."""
        from websockets.exceptions import WebSocketException

        try:
            yield
        except (OSError, WebSocketException) as error:
            if isinstance(error, TimeoutError) or isinstance(error.__cause__, BlockingIOError):
                raise TimeLimitExceeded(
                    f"the policy server {self.url} did not answer within {self._time_limit:g} s"
                ) from None
            raise PolicyServerError(f"the policy server {self.url} {text}: {error}") from error


class Dialog(Protocol):
    """Questions and answers of one connection."""

    metadata: dict[str, Any]
    connection: Connection

    def start(self, reset: Mapping[str, Any] | None, instruction: str | None) -> None:
        """Starts an episode."""

    def ask(self, request: dict[str, Any]) -> Any:
        """Returns the answer to a request."""


class OpenpiDialog:
    """The protocol of openpi: the server sends its metadata, then answers each request. A text is
    an error."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.metadata = _mapping(
            connection, connection.unpacked(MSGPACK_NUMPY, connection.receive()), "metadata"
        )

    def start(self, reset: Mapping[str, Any] | None, instruction: str | None) -> None:
        """Sends the reset, if the server has one: openpi's own has none. Its answer may be a text,
        as that of RoboArena."""
        if reset is not None:
            self.connection.ask(MSGPACK_NUMPY.pack(dict(reset)))

    def ask(self, request: dict[str, Any]) -> Any:
        return self.connection.unpacked(
            MSGPACK_NUMPY, self.connection.ask(MSGPACK_NUMPY.pack(request))
        )


class VlaEvalDialog:
    """The protocol of vla-eval, version 1: numbered messages with a type. The server keeps a
    session for each connection, and episodes in it."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self._number = 0
        self._is_in_episode = False
        self._send("hello", {"harness_version": "", "protocol_version": 1})
        self.metadata = self._received("hello")

    def start(self, reset: Mapping[str, Any] | None, instruction: str | None) -> None:
        if self._is_in_episode:
            self._send("episode_end", {})
        self._send(
            "episode_start",
            {"task": {} if instruction is None else {"name": instruction}, **(reset or {})}
        )
        self._is_in_episode = True

    def ask(self, request: dict[str, Any]) -> Any:
        self._send("observation", request)
        return self._received("action")

    def _send(self, kind: str, payload: Mapping[str, Any]) -> None:
        self._number += 1
        message = {
            "type": kind, "payload": dict(payload), "seq": self._number, "timestamp": time.time()
        }
        self.connection.send(TEXT_KEYS.pack(message))

    def _received(self, kind: str) -> dict[str, Any]:
        connection = self.connection
        message = _mapping(
            connection, connection.unpacked(TEXT_KEYS, connection.receive()), "message"
        )
        if message.get("type") == "error":
            raise connection.failure(f"reports an error:\n{_shown(str(message.get('payload')))}")
        if message.get("type") != kind or message.get("seq") != self._number:
            raise connection.failure(
                f"sent the message {message.get('type')!r} number {message.get('seq')!r}; expected "
                f"{kind!r} number {self._number}"
            )
        return _mapping(connection, message.get("payload"), "message")


PROTOCOLS: dict[str, type[OpenpiDialog] | type[VlaEvalDialog]] = {
    "openpi": OpenpiDialog, "vla-eval": VlaEvalDialog
}


def _seconds_and_microseconds(seconds: float) -> tuple[int, int]:
    """Returns a time as the system takes it; 0 would mean no limit.

    >>> _seconds_and_microseconds(2.5), _seconds_and_microseconds(1e-9)
    ((2, 500000), (0, 1))
    """
    return int(seconds), max(int(seconds % 1 * 1e6), int(seconds < 1))


def _mapping(connection: Connection, message: Any, what: str) -> dict[str, Any]:
    if not isinstance(message, dict):
        raise connection.failure(
            f"sent a {type(message).__name__} instead of a dictionary as its {what}"
        )
    return message


def _shown(text: str) -> str:
    """Returns the end of a text of a server, without characters that control a terminal.

    >>> _shown("\\x1b[2Jfailed")
    '\\\\x1b[2Jfailed'
    """
    text = text.strip()
    text = text if len(text) <= _MAX_TEXT else "..." + text[-_MAX_TEXT:]
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)
