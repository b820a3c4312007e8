"""Systems that the Rust core simulates with a policy in Python: tasks, and robots in files."""

import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.base.limits import check_time_limit, limited
from mishandle.errors import InvalidValueError, TimeLimitExceeded
from mishandle.policies.controllers import Controller
from mishandle.policies.kinds import Policy, as_policy, start
from mishandle.policies.servers import Rows
from mishandle.scenarios.applications import PolicyArguments
from mishandle.scenarios.axes import Axis
from mishandle.scenarios.lines import Disturbed, FaultLine
from mishandle.scenarios.requests import EarlyStop, Request
from mishandle.scenarios.values import idle_action
from mishandle.systems.interface import Outcome, System


class CoreSystem(System):
    """A task, or a robot that a file describes, with a policy in Python that may see. The Rust core
    simulates it and requests the actions of up to 16 simulations at once. ``images`` are names of
    cameras, widths and heights."""

    def __init__(
        self, target: str, policy: Any, batched_policy: bool, images: Sequence[tuple[str, int, int]]
    ) -> None:
        self.name, observation_size, self._action_size = _native.policy_interface(target)
        self.images = images
        if any(camera == "state" for camera, *_ in images):
            raise InvalidValueError(
                "a policy in Python cannot see through a camera `state`: this is the key of the "
                "other observations"
            )
        if isinstance(policy, Controller):
            _check_sees(policy, images)
        seen = {
            camera: Box(0, 255, (height, width, 3), np.uint8) for camera, width, height in images
        }
        state = Box(-np.inf, np.inf, (observation_size,))
        spaces = (
            Dict({"state": state, **seen}) if seen else state,
            Box(-np.inf, np.inf, (self._action_size,))
        )
        self._policy: Policy = as_policy(policy, batched_policy, spaces=spaces)
        self.has_timed_out = False
        self.versions = [("numpy", np.__version__)]
        self.exceptions = []

    def act(
        self, observations: NDArray[np.float32], images: Sequence[NDArray[np.uint8]], rows: int,
        is_start: bool
    ) -> NDArray[np.float32] | None:
        """Returns one action per row; ``None`` after an exception."""
        names = [camera for camera, *_ in self.images]
        seen: Any = (
            [{"state": row[0], **dict(zip(names, row[1:]))} for row in zip(observations, *images)]
            if names else observations
        )
        try:
            if is_start:
                self._policy.reset(rows)
            given = self._policy.act(seen, rows)
            return _one_per_row(given, rows, self._action_size, self.name)
        except (Exception, TimeLimitExceeded) as error:
            self.has_timed_out = isinstance(error, TimeLimitExceeded)
            self.keep_exception()
            return None


class TaskSystem(System):
    """One of the tasks with a policy. A whole batch is stepped together, with the bits of the
    command line."""

    def __init__(
        self, task: str, policy: Any, *, preset: str, rows: int, batched_policy: bool,
        time_limit: float | None = None, space: Sequence[Axis] = ()
    ) -> None:
        check_time_limit(time_limit)
        if isinstance(policy, Controller):
            _check_sees(policy, [])
        self._time_limit = time_limit
        self._arguments = (task, policy, preset, rows, batched_policy, time_limit, space)
        self._rows = rows
        native = self._simulate(manner=False)
        self.own_signals = native.signals
        observations = Box(-np.inf, np.inf, (native.observation_size,))
        spaces = (observations, Box(-1, 1, (native.action_size,)))
        self.arguments = PolicyArguments(space)
        self._policy: Policy = as_policy(
            policy, batched_policy, spaces=spaces, task=task, arguments=self.arguments
        )
        self.policy_source = policy
        self.facts = [task, preset]
        self.name = task
        self.control_dt = native.control_dt
        self.steps = native.episode_steps
        self.faults = FaultLine(space, self.control_dt, self.steps, spaces)
        self._idle = idle_action(spaces[1])
        self.versions = [("numpy", np.__version__)]
        self.exceptions = []

    def __reduce__(self) -> "tuple[Callable[..., TaskSystem], tuple[Any, ...]]":
        return _task_system, (*self._arguments, len(self.signals) > len(self.own_signals))

    def _simulate(self, manner: bool) -> _native.Simulator:
        task, _, preset, rows, *_ = self._arguments
        self._native = _native.Simulator(
            task, rows, preset=preset, reward="shaped", threads=None, manner=manner
        )
        self.signals = self._native.signals
        return self._native

    def reads_manner(self, formulas: Iterable[str]) -> bool:
        """Whether a formula reads a signal that is not one of its own, such as a contact force."""
        own = {name for name, _ in self.own_signals}
        return any(not own.issuperset(_native.Formula(text).signals) for text in formulas)

    def compute_manner(self) -> None:
        """Computes the signals of the manner from now on, after its own."""
        if len(self.signals) == len(self.own_signals):
            self._simulate(manner=True)

    @property
    def formulas(self) -> dict[str, str]:
        """Its formulas by name, success first."""
        return dict(self._native.formulas)

    @property
    def space(self) -> list[Axis]:
        """The initial box."""
        return [
            Axis(name, low, high, unit, meaning=meaning)
            for name, unit, low, high, meaning in self._native.axes
        ]

    def code(self) -> list[Any]:
        return [self.policy_source]

    def simulate(self, batch: Sequence[Request]) -> list[Outcome]:
        chunks = [batch[first : first + self._rows] for first in range(0, len(batch), self._rows)]
        return [
            outcome for chunk in chunks for part in self.faults.start_all(chunk)
            for outcome in self._together(*part)
        ]

    def _together(
        self, chunk: Sequence[Request], faults: Sequence[Disturbed | None]
    ) -> list[Outcome]:
        count, rows = len(chunk), self._rows
        # The other rows repeat the last scenario; their results are dropped.
        padded = [*chunk, *[chunk[-1]] * (rows - count)]
        nominal = {axis.name: axis.nominal_number for axis in self.space}
        scenarios = np.array([
            [float(each.scenario.get(name, value)) for name, value in nominal.items()]
            for each in padded
        ])
        seeds = np.array([each.seed for each in padded], dtype=np.uint64)
        observations, _, signals, _, _ = self._native.reset(
            np.ones(rows, dtype=bool), seeds, scenarios
        )
        returns = np.zeros(rows)
        ends: list[tuple[str, int, int] | None] = [None] * rows
        reasons = [""] * rows
        stops = [EarlyStop(each.stop, self.signals, self.control_dt, self.steps) for each in chunk]
        traces: list[list[NDArray[np.float64]]] = [[signals[row]] for row in range(count)]
        start(
            self._policy, self.arguments,
            Rows(
                [each.scenario for each in padded],
                is_running=lambda row: row < count and ends[row] is None
            )
        )
        # The rows share the time of the policy; the task itself cannot hang.
        left = None if self._time_limit is None else self._time_limit * rows
        for step in range(1, self.steps + 1):
            started = time.monotonic()
            seen = observations
            for place, each in enumerate(faults):
                if each is not None:
                    seen = seen.copy() if seen is observations else seen
                    seen[place] = each.observe(step - 1, observations[place])
            is_paused = all(each is not None and each.is_paused(step - 1) for each in faults)
            try:
                with limited(left):
                    given = [self._idle] * rows if is_paused else self._policy.act(seen, rows)
                actions = _one_per_row(given, rows, self._native.action_size, self.name)
            except TimeLimitExceeded as error:
                reason = self.keep_reason(error)
                reasons = [reason if end is None else "" for end in ends]
                ends = [end or ("timed out", step, 0) for end in ends]
                break
            except Exception:
                reason = self.keep_exception()
                reasons = [reason if end is None else "" for end in ends]
                ends = [end or ("crashed", step, 0) for end in ends]
                break
            if left is not None:
                left = max(left - (time.monotonic() - started), 1e-3)
            for place, each in enumerate(faults):
                if each is not None:
                    actions[place] = each.answer(step - 1, actions[place], self._idle)
                    if np.isfinite(actions[place]).all():
                        actions[place] = each.act(step - 1, actions[place])
            if not np.isfinite(actions).all():
                for row, column in np.argwhere(~np.isfinite(actions)):
                    ends[row] = ends[row] or ("invalid action", step, int(column))
                actions = np.nan_to_num(actions)
            observations, rewards, signals, _, diverged = self._native.step(actions)
            returns += np.where([end is None for end in ends], rewards.sum(axis=1), 0.0)
            for row in np.flatnonzero(diverged):
                ends[row] = ends[row] or ("diverged", step, 0)
            for row in range(count):
                if ends[row] is None:
                    traces[row].append(signals[row])
                    if stops[row].may_stop(traces[row]):
                        ends[row] = ("stopped", step, 0)
            if None not in ends[:count]:
                break
        outcomes = []
        for row in range(count):
            end, step, index = ends[row] or ("completed", 0, 0)
            samples = np.array(traces[row])
            outcomes.append(
                Outcome(
                    end, samples, len(samples) - 1, step, index, float(returns[row]), reasons[row]
                )
            )
        return outcomes


def _task_system(
    task: str, policy: Any, preset: str, rows: int, batched_policy: bool, time_limit: float | None,
    space: Sequence[Axis], manner: bool
) -> TaskSystem:
    system = TaskSystem(
        task, policy, preset=preset, rows=rows, batched_policy=batched_policy,
        time_limit=time_limit, space=space
    )
    if manner:
        system.compute_manner()
    return system


def _one_per_row(given: Any, rows: int, size: int, name: str) -> NDArray[np.float32]:
    """Returns the actions of a batch for the system of a name, whose actions have a size. Rows in
    another dimension are an error: they would be another policy."""
    actions = np.array(given, dtype=np.float32)
    if len(np.atleast_1d(actions)) != rows and (rows > 1 or actions.ndim > 1):
        raise InvalidValueError(
            f"the policy returned the shape {actions.shape} for a batch of {rows}; expected one "
            "action per row"
        )
    if actions.size != rows * size:
        raise InvalidValueError(
            f"the policy returned {actions.size} numbers for {rows} "
            f"observation{'s' if rows > 1 else ''}; {name} takes {size} for each"
        )
    return actions.reshape(rows, size)


def _check_sees(controller: Controller, images: Sequence[tuple[str, int, int]]) -> None:
    """Checks that a controller gets the images that it needs."""
    given = {camera: (height, width, 3) for camera, width, height in images}
    if any(given.get(camera) != shape for camera, shape in controller.images):
        cameras = [camera for camera, _ in controller.images]
        (height, width, _), *others = {shape for _, shape in controller.images}
        size = f", image_size={(width, height)}" if not others else ""
        raise InvalidValueError(f"the controller {controller.name} needs cameras={cameras}{size}")
