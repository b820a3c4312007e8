"""A program that asks a policy server, for the policy of a target file: ``python -m
mishandle.policies.client ws://host:port``.

Each line on its input is a question of ``policy.process`` (``docs/guide/policies.md``), each line
of its output the answer. What is left of a chunk of actions is the ``state`` of the answer, so that
an answer follows from its question alone.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from mishandle.base.limits import MAX_SECONDS
from mishandle.errors import InvalidValueError, MishandleError, TimeLimitExceeded
from mishandle.policies.connections import Dialog
from mishandle.policies.observations import Request, View
from mishandle.policies.servers import PolicyServer, actions_of


class Client:
    """Answers questions from chunks of a policy server."""

    def __init__(self, server: PolicyServer) -> None:
        self._server = server
        self._request: Request = server.request(None)
        self._dialog: Dialog = server.dialog()

    def answer(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the answer to a question.

        The state has the number of actions that are left, and these actions, the next one first.
        All zeros, as at the start of an episode, means that there are none.
        """
        state = [float(number) for number in question.get("state", [])]
        if state and state[0] > 0.0:
            size = _action_size(len(state), self._execute)
            left = np.reshape(state[1 : 1 + int(state[0]) * size], (-1, size))
        else:
            left = self._chunk(question["observation"])
            if len(left) > 1 and len(state) != 1 + (len(left) - 1) * left.shape[1]:
                raise InvalidValueError(
                    f"the target file states state = {len(state)}, but {len(left)} actions of "
                    f"{left.shape[1]} numbers are executed: set state = "
                    f"{1 + (len(left) - 1) * left.shape[1]} beside the process"
                )
        rest = left[1:]
        memory = np.zeros(len(state))
        if len(rest) > 0:
            memory[: 1 + rest.size] = [len(rest), *rest.ravel()]
        answer = {"id": question["id"], "action": _numbers(left[0])}
        return {**answer, "state": memory.tolist()} if state else answer

    @property
    def _execute(self) -> int:
        return self._server.execute or 1

    def _chunk(self, observation: Sequence[float | None]) -> Any:
        """Asks the server for the actions that are executed. Each question starts an episode,
        because others may be between this one and the last one of its simulation."""
        values = np.array(
            [math.nan if number is None else number for number in observation], dtype=np.float32
        )
        request = self._request.of(View(values, {}, None))
        instruction = self._server.instruction
        self._dialog.start(
            self._server.reset, instruction if isinstance(instruction, str) else None
        )
        answer = self._dialog.ask(request)
        size = _last_size(answer)
        return np.stack(actions_of(answer, Box(-np.inf, np.inf, (size,), np.float64), self._server))


def _action_size(length: int, execute: int) -> int:
    """Returns the length of an action, from that of the state.

    >>> _action_size(1 + 7 * 3, 8)
    3
    """
    if execute < 2 or (length - 1) % (execute - 1) != 0:
        raise InvalidValueError(
            f"state = {length} of the target file does not fit --execute {execute}: expected 1 + "
            f"{execute - 1} x action size"
        )
    return (length - 1) // (execute - 1)


def _last_size(answer: Any) -> int:
    shape = (
        np.shape(answer["actions"]) if isinstance(answer, Mapping) and "actions" in answer else ()
    )
    return int(shape[-1]) if shape else 1


def _numbers(action: Any) -> list[float | None]:
    """Returns an action in JSON, which has no NaN and no infinities."""
    return [float(number) if math.isfinite(number) else None for number in action]


def run(client: Client, lines: Iterable[str]) -> None:
    """Answers each line."""
    for line in lines:
        print(json.dumps(client.answer(json.loads(line))), flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the program and returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m mishandle.policies.client",
        description="Asks a policy server for the actions of a target file."
    )
    parser.add_argument("url", help="address of the server, such as ws://localhost:8000")
    parser.add_argument(
        "--observation", metavar="KEY",
        help="key of the observation in a request; by default observation/state, or state"
    )
    parser.add_argument("--instruction", metavar="TEXT", help="text of the task")
    parser.add_argument(
        "--execute", type=int, default=1, metavar="K",
        help="actions of a chunk that are executed (default: 1)"
    )
    parser.add_argument("--protocol", default="openpi", choices=["openpi", "vla-eval"])
    parser.add_argument(
        "--reset", type=json.loads, metavar="JSON", help="message that is sent before each request"
    )
    given = parser.parse_args(arguments)
    observation = None if given.observation is None else {given.observation: "obs"}
    try:
        server = PolicyServer(
            given.url,
            observation=observation,
            instruction=given.instruction,
            execute=given.execute,
            # The target file has the time limit of an answer.
            time_limit=MAX_SECONDS,
            reset=given.reset,
            protocol=given.protocol,
        )
        run(Client(server), sys.stdin)
    except (MishandleError, TimeLimitExceeded) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
