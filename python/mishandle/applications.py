"""How the values of a scenario reach an environment."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

from mishandle.axes import Attribute, Axis, FaultParameter, ResetOption, Value


class Applications:
    """What the values of some axes change in an environment, apart from faults: attributes to set before the reset, options of the
    reset, and functions to call after it."""

    def __init__(self, space: Mapping[str, Axis], scenario: Mapping[str, Value]) -> None:
        self.attributes: list[tuple[str, Value]] = []
        self._options: list[tuple[str, Value]] = []
        self._functions: list[tuple[Callable[..., Any], Value]] = []
        for name, value in scenario.items():
            application = space[name].apply
            if application is None or isinstance(application, ResetOption):
                self._options.append((name if application is None else application.name, value))
            elif isinstance(application, Attribute):
                self.attributes.append((application.path, value))
            elif not isinstance(application, FaultParameter):
                self._functions.append((application, value))

    def options(self, others: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Returns the options of the reset, together with others.

        >>> space = {"x": Axis("x", 0, 1, apply=ResetOption("start.x"))}
        >>> Applications(space, {"x": 0.25}).options({"start": {"y": 1.0}})
        {'start': {'y': 1.0, 'x': 0.25}}
        """
        options = copy.deepcopy(dict(others or {}))
        for name, value in self._options:
            _set_option(options, name, value)
        return options

    def reset(self, environment: Any, seed: int | None, others: Mapping[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Resets an environment, whose attributes are set already."""
        observation, info = environment.reset(seed=seed, options=self.options(others) or None)
        for function, value in self._functions:
            changed = function(environment, value)
            observation = observation if changed is None else changed
        return observation, info


def environment_seed(seed: int) -> int:
    """Returns the seed of an environment in a simulation: some take seeds of 32 bits only."""
    return seed % 2**31


def _set_option(options: dict[str, Any], name: str, value: Value) -> None:
    """Sets an option of a reset; dots separate the names of nested options."""
    *parents, last = name.split(".")
    for parent in parents:
        options = options.setdefault(parent, {})
    options[last] = value
