"""Axes of faults of sensors and actuators between an environment and its policy."""

import json
from typing import Any

from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.scenarios.arguments import check_number, check_period, check_steps
from mishandle.scenarios.axes import Axis, FaultParameter
from mishandle.scenarios.layouts import (
    ACTION, OBSERVATION, Channels, FaultSettings, Layout, Ranges, Side
)
from mishandle.systems.environments import (
    control_period, episode_steps, spec_name, states_control_dt
)
from mishandle.systems.task_environments import TaskEnv

MOST = 100
"""Largest number of faults of one side."""


def faults(
    environment: Any, *, sensing: bool = True, actuation: bool = True, delays: bool = False,
    count: int = 1, channels: Channels | None = None, actions: Channels | None = None,
    ranges: Ranges | None = None, action_ranges: Ranges | None = None, steps: int | None = None,
    control_dt: float | None = None
) -> list[Axis]:
    """Returns the axes of faults of an environment: kind, channel, onset, duration, recovery and
    magnitude.

    A fault acts between the environment and the policy. ``sensor_fault`` is the kind of a fault of
    what the policy observes, ``actuator_fault`` that of what the environment gets. Signals are
    those of the environment, without the faults. At their nominal values the axes change nothing.
    ``docs/guide/faults.md`` describes the kinds.

    Parameters
    ----------
    environment
        A Gymnasium environment or vector environment, or the name of a task. The sub-environments
        of an ``AsyncVectorEnv`` are out of reach: pass one of them to get the names and ranges that
        an environment of a task states.
    sensing, actuation : bool
        Whether observations and actions have faults.
    delays : bool
        Whether there are also axes of delays, which may vary during an episode, and of rare
        observations.
    count : int
        Number of faults of each side that can overlap. They are applied in the order of their
        numbers.
    channels, actions : mapping, optional
        Channels of the observation and of the action by name, each with the index or indexes of its
        numbers. A number belongs to one channel at most. By default each number is one; the parts
        of a dictionary or tuple, and the quantities of a task, are channels with their names. If
        there is more than one, the nominal choice is ``"all"``. The numbers of a dictionary have
        the order of the names in its space, which is alphabetical.
    ranges, action_ranges : mapping, optional
        Lowest and highest value of channels of the observation and of the action, by name. By
        default those of the space. Magnitudes are in units of half the range. A number of the
        observation without two finite bounds has the range -1 to 1; a number of the action needs a
        stated one, because saturation, a reversed sign and a loss of authority depend on it.
    steps, control_dt
        Number of control steps of an episode, and the duration of a control step in seconds; by
        default those of the environment. The question needs the same. The frame rate of videos
        (``render_fps``) is not taken as the control rate.

    Examples
    --------
    >>> import gymnasium
    >>> env = gymnasium.make("CartPole-v1")
    >>> [
    ...     axis.name
    ...     for axis in faults(env, channels={"cart": [0, 1], "pole": [2, 3]}, control_dt=0.02)
    ... ][:3]
    ['sensor_fault', 'sensor_fault_channel', 'sensor_fault_partner']
    """
    if isinstance(environment, str):
        environment = TaskEnv(environment)
    if not (hasattr(environment, "reset") and hasattr(environment, "step")):
        raise InvalidTypeError(
            f"a {type(environment).__name__} has no control steps between which a fault could act; "
            "faults need a Gymnasium environment or the name of a task"
        )
    check_number("count", count, 1, MOST)
    check_steps(steps)
    check_period(control_dt)
    if not (sensing or actuation or delays):
        raise InvalidValueError(
            "there is no fault: at least one of sensing, actuation and delays must be True"
        )
    # What a sub-environment states holds for a vector environment of it.
    one = next(iter(getattr(environment, "envs", None) or ()), environment)
    if control_dt is None and not states_control_dt(one):
        raise InvalidValueError(
            f"the times of faults are in seconds, but {spec_name(one)} does not state the duration "
            "of a control step (attribute `dt`); pass it as control_dt, in seconds"
        )
    # A task knows its channels and what its sensors can measure.
    stated = getattr(one.unwrapped, "fault_layouts", None) or (None, None)
    observation = _layout(environment, OBSERVATION, stated[0], channels, ranges, sensing or delays)
    action = _layout(environment, ACTION, stated[1], actions, action_ranges, actuation or delays)
    if actuation and action is not None:
        _check_ranges(action)
    settings = FaultSettings(
        observation=None if observation is None else observation.with_unit_ranges(), action=action,
        count=int(count), delays=delays, steps=episode_steps(one, steps),
        control_dt=control_period(one) if control_dt is None else float(control_dt)
    )
    kept = {"sensor_fault": sensing, "actuator_fault": actuation}
    parameter = FaultParameter(settings)
    axes = [Axis.from_document(axis, parameter) for axis in json.loads(settings.native().axes)]
    return [
        axis for axis in axes
        if all(keep or not axis.name.startswith(side) for side, keep in kept.items())
    ]


def _layout(
    environment: Any, side: Side, stated: Any, channels: Channels | None, ranges: Ranges | None,
    is_used: bool
) -> Layout | None:
    """Returns the layout of one side of an environment; ``None`` without a fault or delay there."""
    if not is_used:
        for argument, given in ((side.channels, channels), (side.ranges, ranges)):
            if given is not None:
                raise InvalidTypeError(
                    f"the argument `{argument}` has no effect without faults of the {side.value}; "
                    "leave it out"
                )
        return None
    name = f"{side.value}_space"
    space = getattr(environment, f"single_{name}", None) or getattr(environment, name)
    made = None if stated is None else Layout.from_native(stated, space)
    # A wrapper may have changed the space.
    if made is None or sum(part.size for part in made.parts) != len(made.ranges):
        made = Layout.of_space(space, side)
    return made.with_names(side, channels, ranges)


def _check_ranges(action: Layout) -> None:
    """Checks that all numbers of an action have a range. Every kind of fault can meet every
    channel, and some need the range."""
    unbounded = action.unbounded
    if not (action.has_numbers and unbounded):
        return
    names = [name for name, entries in action.channels if set(entries) & set(unbounded)]
    if not names:
        raise InvalidValueError(
            f"the numbers {unbounded} of the action have no finite bounds in its space and belong "
            "to no channel, but a loss of authority disturbs all numbers: make them a channel in "
            "actions, and state its range in action_ranges"
        )
    ranges = "{" + ", ".join(f'"{name}": (-1.0, 1.0)' for name in names) + "}"
    raise InvalidValueError(
        f"the numbers {unbounded} of the action have no finite bounds in its space, but "
        "saturation, a reversed sign and a loss of authority depend on them: state the range of "
        f"each channel, such as action_ranges={ranges}, or pass actuation=False"
    )
