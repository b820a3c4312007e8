"""Starts of episodes of an environment: settling after a reset, and starts that are invalid."""

import numbers
from collections.abc import Callable, Mapping
from typing import Any, Union

from mishandle.errors import InvalidScenario, InvalidTypeError
from mishandle.scenarios.arguments import check_number
from mishandle.scenarios.values import idle_action

Settle = Union[int, tuple[int, Any]]
"""Control steps between the reset and the start of an episode, with an action: ``20``, or ``(20,
action)``. Without an action, it is 0 or the nearest value of the action space."""

Invalid = Callable[[Any, Mapping[str, Any]], bool]
"""Says from observation and ``info`` whether an episode cannot start there."""


class Starts:
    """How episodes of an environment start after its reset."""

    def __init__(self, settle: Settle | None, invalid: Invalid | None, action_space: Any) -> None:
        pair = settle if isinstance(settle, tuple) else (settle, None)
        if len(pair) != 2:
            raise InvalidTypeError(
                f"settle is {settle!r}; expected a number of control steps, or a pair of it and "
                "an action"
            )
        steps, action = pair
        if steps is not None:
            check_number("settle", steps, 1)
        if invalid is not None and not callable(invalid):
            raise InvalidTypeError(
                f"invalid is {invalid!r}; expected a function of observation and info"
            )
        self.steps = int(steps) if isinstance(steps, numbers.Integral) else 0
        self.action = idle_action(action_space) if action is None and self.steps else action
        self._invalid = invalid

    def settled(
        self, environment: Any, observation: Any, info: Mapping[str, Any]
    ) -> tuple[Any, Mapping[str, Any]]:
        """Lets an environment settle; returns the observation and ``info`` of the start. Raises
        :class:`InvalidScenario` if it is none."""
        for _ in range(self.steps):
            observation, _, terminated, truncated, info = environment.step(self.action)
            if terminated or truncated:
                raise InvalidScenario("the environment ended the episode while it settled")
        if self.is_invalid(observation, info):
            raise InvalidScenario("the start is invalid")
        return observation, info

    def is_invalid(self, observation: Any, info: Mapping[str, Any]) -> bool:
        """Returns whether no episode starts at an observation."""
        return self._invalid is not None and bool(self._invalid(observation, info))
