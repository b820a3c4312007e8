"""How the values of a scenario reach an environment."""

import copy
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from mishandle.errors import InvalidTypeError
from mishandle.scenarios.axes import (
    Attribute, Axis, FaultParameter, PolicyArgument, ResetOption, Value
)


class Applications:
    """What the values of some axes change in an environment, apart from faults and its policy:
    attributes to set before the reset, options of the reset, and functions to call after it."""

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
            elif not isinstance(application, (FaultParameter, PolicyArgument)):
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

    def reset(
        self, environment: Any, seed: int | None, others: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Resets an environment, whose attributes are set already."""
        observation, info = environment.reset(seed=seed, options=self.options(others) or None)
        for function, value in self._functions:
            changed = function(environment, value)
            observation = observation if changed is None else changed
        return observation, info


class PolicyArguments:
    """The keyword arguments that a policy gets from the axes of a space."""

    def __init__(self, space: Iterable[Axis]) -> None:
        self.space = {axis.name: axis for axis in space}
        self.axes = {
            axis.apply.name: axis for axis in self.space.values()
            if isinstance(axis.apply, PolicyArgument)
        }
        """Axes by the name of the argument."""

    def __bool__(self) -> bool:
        return bool(self.axes)

    def of(self, scenario: Mapping[str, Value]) -> dict[str, Value]:
        """Returns the arguments in a scenario.

        >>> PolicyArguments([Axis("estimate_bias", -1, 1, apply=PolicyArgument("bias"))]).of({
        ...     "estimate_bias": 0.5, "mass": 2.0
        ... })
        {'bias': 0.5}
        """
        return {argument: scenario[axis.name] for argument, axis in self.axes.items()}

    def check(self, policy: Callable[..., Any]) -> None:
        """Checks that a policy takes the arguments."""
        try:
            parameters = inspect.signature(policy).parameters
        except (TypeError, ValueError):
            return
        if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values()):
            return
        for argument, axis in self.axes.items():
            if (
                argument not in parameters
                or parameters[argument].kind is inspect.Parameter.POSITIONAL_ONLY
            ):
                raise InvalidTypeError(
                    f"the policy has no keyword argument `{argument}`, which the axis "
                    f"`{axis.name}` sets; its arguments: {', '.join(parameters) or 'none'}"
                )


def environment_seed(seed: int) -> int:
    """Returns the seed of an environment in a simulation: some take seeds of 32 bits only."""
    return seed % 2**31


def _set_option(options: dict[str, Any], name: str, value: Value) -> None:
    """Sets an option of a reset; dots separate the names of nested options."""
    *parents, last = name.split(".")
    for parent in parents:
        options = options.setdefault(parent, {})
    options[last] = value
