"""Policies behind a server, such as a vision-language-action model on a GPU elsewhere."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gymnasium import spaces as gymnasium_spaces
from numpy.typing import NDArray

from mishandle.base.limits import check_time_limit
from mishandle.errors import (
    InvalidTypeError, InvalidValueError, PolicyServerError, TimeLimitExceeded
)
from mishandle.policies.connections import PROTOCOLS, Connection, Dialog, check_url
from mishandle.policies.messages import MSGPACK_NUMPY
from mishandle.policies.observations import Part, Request, View
from mishandle.scenarios.applications import PolicyArguments
from mishandle.scenarios.axes import Axis, Value
from mishandle.scenarios.values import idle_action

_KEYS = {"openpi": ("observation/state", "prompt"), "vla-eval": ("state", "task_description")}
"""Keys of an observation that is no dictionary, and of the instruction, in each protocol."""


@dataclass(frozen=True)
class PolicyServer:
    """A policy behind a server: each request is an observation, each answer is a chunk of actions.

    ``policy="ws://host:port"`` is its short form. ``docs/guide/policy_servers.md`` says what is
    sent, and what happens if the server fails. Needs the packages ``websockets`` and ``msgpack``.

    Parameters
    ----------
    url : str
        Address of the server, such as ``"ws://localhost:8000"`` or ``"wss://host:443"``.
    observation : mapping, optional
        Parts of a request by key: ``"obs"``, a path such as ``"obs.agent_pos"`` or ``"obs[3]"``,
        ``"render"``, a :class:`Resized` picture, a function of the observation, an :class:`Axis` of
        the space (its value or its name is sent), or a dictionary of parts. By default, a
        dictionary is sent as it is, and another observation as ``"observation/state"`` (openpi) or
        ``"state"`` (vla-eval).
    instruction : str or Axis, optional
        Text of the task, or an axis of categories whose name is sent. Its key is ``"prompt"`` or
        ``"task_description"`` (vla-eval).
    execute : int, optional
        Number of actions of a chunk that are executed before the next request; by default all of
        them.
    time_limit : float
        Longest time until an answer, in seconds, and how long a server that went away is awaited.
        The first answer of a server that compiles its model can take minutes.
    reset : mapping, optional
        A message that is sent at the start of each episode. The chunk of the last episode is
        forgotten in any case.
    protocol : str
        ``"openpi"`` or ``"vla-eval"``.
    headers : mapping, optional
        Headers of the HTTP request that opens a connection, such as ``{"Authorization": "Api-Key
        ..."}``. No run file contains them.
    """

    url: str
    observation: Mapping[str, Part] | None = None
    instruction: str | Axis | None = None
    execute: int | None = None
    time_limit: float = 60.0
    reset: Mapping[str, Any] | None = None
    protocol: str = "openpi"
    headers: Mapping[str, str] = field(default_factory=dict, repr=False)
    metadata: dict[str, Any] = field(default_factory=dict, init=False, repr=False)
    """What the server said about itself when a question was asked about it last."""

    def __post_init__(self) -> None:
        check_url(self.url)
        check_time_limit(self.time_limit)
        if self.execute is not None and (type(self.execute) is not int or self.execute < 1):
            raise InvalidValueError(
                f"execute is {self.execute!r}; it must be a whole number of at least 1"
            )
        if self.protocol not in PROTOCOLS:
            raise InvalidValueError(
                f"protocol is {self.protocol!r}; expected {' or '.join(map(repr, PROTOCOLS))}"
            )
        if not isinstance(self.instruction, (str, Axis, type(None))):
            raise InvalidTypeError(
                f"instruction is a {type(self.instruction).__name__}; expected a text or an axis"
            )
        if isinstance(self.instruction, Axis) and isinstance(self.instruction.values, str):
            raise InvalidValueError(
                f"the axis `{self.instruction.name}` of the instruction has no names; expected an "
                "axis of categories"
            )
        if self.observation is not None:
            self.request(None)

    @property
    def name(self) -> str:
        """Its address, as run files name it."""
        return self.url

    @property
    def hash(self) -> str | None:
        """Hash of the policy that the server states, under the key ``hash`` of its metadata."""
        found = self.metadata.get("hash")
        return found if isinstance(found, str) and found and found.isprintable() else None

    @property
    def is_deterministic(self) -> bool:
        """Whether the server states a hash, and under the key ``deterministic`` that an answer
        depends on the request alone."""
        return self.hash is not None and self.metadata.get("deterministic") is True

    @property
    def settings(self) -> list[Any]:
        """What decides how the policy acts, as far as it is known here."""
        chunk = (self.execute, self.protocol, dict(self.reset or {}))
        return [
            self.observation, self.instruction, chunk,
            self.metadata if self.hash is None else self.hash
        ]

    @property
    def gap(self) -> str | None:
        """What the settings do not say; ``None`` if the server states a hash."""
        return f"the policy behind {self.url}" if self.hash is None else None

    def connect(self) -> None:
        """Asks the server for its metadata.

        Raises
        ------
        PolicyServerError
            If no server answers, or not in this protocol.
        """
        try:
            dialog = self.dialog()
        except (PolicyServerError, TimeLimitExceeded) as error:
            raise PolicyServerError(
                f"{error}; is a server of the protocol {self.protocol!r} running there?"
            ) from error
        dialog.connection.leave()
        self.metadata.clear()
        self.metadata.update(dialog.metadata)

    def dialog(self, patience: float = 0.0) -> Dialog:
        """Opens a connection."""
        connection = Connection(self.url, self.headers, self.time_limit, patience)
        try:
            return PROTOCOLS[self.protocol](connection)
        except BaseException:
            connection.close()
            raise

    def request(self, observation_space: Any, arguments: PolicyArguments | None = None) -> Request:
        """Returns what makes the requests for observations of a space."""
        state, instruction = _KEYS[self.protocol]
        if self.observation is not None:
            parts = dict(self.observation)
        elif isinstance(observation_space, gymnasium_spaces.Dict):
            parts = {key: _Key(key) for key in observation_space.spaces}
        else:
            parts = {state: "obs"}
        others: dict[str, Part] = {}
        if self.instruction is not None:
            text = self.instruction
            others[instruction] = text if isinstance(text, Axis) else _Constant(text)
        for argument, axis in () if arguments is None else arguments.axes.items():
            others[argument] = axis
        for key in others.keys() & parts.keys():
            raise InvalidValueError(
                f"two parts of a request have the key {key!r}; leave one of them out"
            )
        return Request({**parts, **others})


@dataclass(frozen=True)
class _Key:
    """A part of a dictionary of observations."""

    key: str

    def __call__(self, observation: Any) -> Any:
        return observation[self.key]


@dataclass(frozen=True)
class _Constant:
    """A part of a request that is always the same."""

    value: Any

    def __call__(self, observation: Any) -> Any:
        return self.value


def as_server(policy: Any) -> Any:
    """Returns the server of an address; other policies as they are."""
    return (
        PolicyServer(policy) if isinstance(policy, str) and policy.startswith(("ws://", "wss://"))
        else policy
    )


def states_determinism(policy: Any) -> bool:
    """Returns whether nothing speaks against repeating a simulation of this policy: a server must
    say so."""
    return not isinstance(policy, PolicyServer) or policy.is_deterministic


def _always(row: int) -> bool:
    return True


@dataclass(frozen=True)
class Rows:
    """The simulations of a batch, as a policy behind a server needs them besides their
    observations."""

    scenarios: Sequence[Mapping[str, Value]]
    draw: Callable[[], Sequence[Any]] | None = None
    """Draws all rows."""
    is_running: Callable[[int], bool] = _always
    """Whether a row still needs actions."""


class ServedPolicy:
    """The policy of a server for a batch of environments. Each row has a connection of its own,
    because a server may keep an episode for each."""

    def __init__(
        self, server: PolicyServer, spaces: tuple[Any, Any], arguments: PolicyArguments | None,
        can_draw: bool
    ) -> None:
        self._server = server
        self._request = server.request(spaces[0], arguments)
        self._space = spaces[1]
        self._rows: list[_Row] = []
        self._batch = Rows(())
        _check_action_space(spaces[1])
        if self._request.has_pictures and not can_draw:
            raise InvalidValueError(
                'the policy server gets pictures ("render"), but the system draws none; an '
                'environment needs render_mode="rgb_array"'
            )
        for axis in self._request.axes:
            if arguments is None or axis.name not in arguments.space:
                raise InvalidValueError(
                    f"the policy server gets the axis `{axis.name}`, which is not in the space" + (
                        " of a robot in a file: its instruction must be a text" if arguments is None
                        else ""
                    )
                )

    def __getstate__(self) -> dict[str, Any]:
        # Connections cannot be copied; a copy opens its own.
        return {**self.__dict__, "_rows": [], "_batch": Rows(())}

    def reset(self, rows: int) -> None:
        for row in self._rows[rows:]:
            row.close()
        self._rows = self._rows[:rows] + [
            _Row(self._server, self._space) for _ in range(rows - len(self._rows))
        ]
        for row in self._rows:
            row.begin()
        self._batch = Rows([{}] * rows)

    def begin(self, batch: Rows) -> None:
        """Says which simulations start. It follows a reset."""
        self._batch = batch

    def act(self, observations: Any, rows: int) -> Any:
        asking = [
            row for row in range(rows) if self._batch.is_running(row) and self._rows[row].is_empty
        ]
        pictures: Sequence[Any] = [None] * rows
        if asking and self._request.has_pictures and self._batch.draw is not None:
            pictures = self._batch.draw()
        for row in asking:
            view = View(observations[row], self._batch.scenarios[row], pictures[row])
            instruction = self._server.instruction
            text = (
                str(view.scenario[instruction.name]) if isinstance(instruction, Axis)
                else instruction
            )
            self._rows[row].ask(self._request.of(view), text)
        return [
            self._rows[row].next() if self._batch.is_running(row) else idle_action(self._space)
            for row in range(rows)
        ]


class _Row:
    """One simulation: its connection and the rest of its chunk."""

    def __init__(self, server: PolicyServer, space: Any) -> None:
        self._server = server
        self._space = space
        self._dialog: Dialog | None = None
        self._is_start = True
        self._chunk: list[Any] = []

    @property
    def is_empty(self) -> bool:
        return not self._chunk

    def begin(self) -> None:
        self._is_start = True
        self._chunk = []

    def next(self) -> Any:
        return self._chunk.pop(0)

    def ask(self, request: dict[str, Any], instruction: str | None) -> None:
        """Gets the next chunk. After a failure, the next question is asked in a new connection."""
        server, dialog, self._dialog = self._server, self._dialog, None
        if self._is_start:
            dialog = self._ready(dialog)
        elif dialog is None:
            # The server has lost what it remembered of the episode.
            raise PolicyServerError(
                f"the connection to the policy server {server.url} was lost in this episode"
            )
        try:
            if self._is_start:
                dialog.start(server.reset, instruction)
            self._chunk = actions_of(dialog.ask(request), self._space, server)
        except BaseException:
            dialog.connection.close()
            raise
        self._is_start = False
        self._dialog = dialog

    def _ready(self, dialog: Dialog | None) -> Dialog:
        """Returns an open connection to the same policy as before."""
        if dialog is not None and dialog.connection.is_open:
            return dialog
        server = self._server
        dialog = server.dialog(patience=server.time_limit)
        is_same = dialog.metadata.get("hash") == server.hash
        if server.hash is None:
            # Packed, because metadata may contain arrays.
            is_same = MSGPACK_NUMPY.pack(dialog.metadata) == MSGPACK_NUMPY.pack(server.metadata)
        if not is_same:
            raise dialog.connection.failure(
                "now has other metadata than before the first simulation: it serves another policy"
            )
        return dialog

    def close(self) -> None:
        dialog, self._dialog = self._dialog, None
        if dialog is not None:
            dialog.connection.leave()


def actions_of(answer: Any, space: Any, server: PolicyServer) -> list[Any]:
    """Returns the actions of an answer that are executed: those that the server asks for, as
    elements of the space.

    >>> server = PolicyServer("ws://localhost:8000", execute=2)
    >>> actions_of(
    ...     {"actions": np.zeros((10, 7))}, gymnasium_spaces.Box(-1, 1, (7,)), server
    ... )[1].shape
    (7,)
    """
    if not isinstance(answer, Mapping) or "actions" not in answer:
        keys = (
            f"has the keys {', '.join(map(str, answer)) or 'none'}" if isinstance(answer, Mapping)
            else f"is a {type(answer).__name__}"
        )
        raise PolicyServerError(
            f"the answer of the policy server {server.url} {keys}; expected a dictionary with "
            "`actions`"
        )
    shape = tuple(space.shape or ())
    try:
        actions: NDArray[np.float64] = np.asarray(answer["actions"], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise PolicyServerError(
            f"the `actions` of the policy server {server.url} are not numbers: {error}"
        ) from error
    if actions.shape == shape:
        actions = actions[None]
    if shape == () and actions.ndim == 2 and actions.shape[1] == 1:
        actions = actions[:, 0]
    horizon = len(actions) if actions.ndim else 0
    count = server.execute or horizon
    if actions.shape[1:] != shape or not 1 <= count <= horizon:
        one = " x ".join(map(str, shape)) or "1"
        needed = f", and {count} actions are executed" if server.execute else ""
        raise PolicyServerError(
            f"the `actions` of the policy server {server.url} have the shape {actions.shape}; "
            f"expected (horizon, action), where an action of the environment is {one} "
            f"number{'' if math.prod(shape) == 1 else 's'}{needed}"
        )
    return [_element(action, space, server) for action in actions[:count]]


def _element(action: NDArray[np.float64], space: Any, server: PolicyServer) -> Any:
    if np.issubdtype(space.dtype, np.floating):
        return action.astype(space.dtype)
    # NaN is no whole number; it ends the simulation as an invalid action.
    if not np.isfinite(action).all():
        return action
    if (action != np.rint(action)).any():
        raise PolicyServerError(
            f"the policy server {server.url} sent the action {action}; expected whole numbers of "
            f"the space {space}"
        )
    return action.astype(space.dtype) if action.ndim else int(action)


def _check_action_space(space: Any) -> None:
    known = (
        gymnasium_spaces.Box, gymnasium_spaces.Discrete, gymnasium_spaces.MultiDiscrete,
        gymnasium_spaces.MultiBinary
    )
    if not isinstance(space, known):
        raise InvalidTypeError(
            "a policy server returns arrays, but the actions of the environment are a "
            f"{type(space).__name__}"
        )
