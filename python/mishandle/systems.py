"""Systems under test: functions and tasks."""

from __future__ import annotations

import inspect
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from mishandle import _native
from mishandle.applications import PolicyArguments
from mishandle.axes import Axis
from mishandle.controllers import Controller
from mishandle.errors import InvalidScenario, InvalidTypeError, InvalidValueError
from mishandle.fault_lines import Disturbed, FaultLine
from mishandle.fingerprints import walk
from mishandle.flat_values import idle_action
from mishandle.limits import TimeLimitExceeded, check_interruptible, check_time_limit, limited
from mishandle.pictures import Recording
from mishandle.policies import Policy, as_policy, start
from mishandle.policy_servers import Rows
from mishandle.reductions import Reduced
from mishandle.requests import EarlyStop, Request, Scenario

Source = Union[str, Callable[..., float], Reduced]
"""Source of a signal: a path such as ``"obs[3]"``, ``"obs.achieved_goal[0]"``, ``"info.speed"``, ``"data.qpos[2]"`` or
``"reward"``, or a function of the unwrapped environment, or of it and the observation. ``data`` and other names are attributes
of the unwrapped environment; names after a dictionary are its keys. :class:`mishandle.Reduced` reduces several values of a control
step."""


Frames = Callable[[Scenario, Any, list[int]], Sequence[Any]]
"""Draws samples of a simulation: a function of the scenario, the trace and the samples that returns one array (height, width, 3) of bytes
for each sample."""


@dataclass
class Outcome:
    """One simulation.

    ``samples`` has one row per sample, beginning with the reset, and one column per signal.
    """

    end: str
    samples: NDArray[np.float64]
    steps: int
    step: int = 0
    index: int = 0
    total_reward: float = 0.0
    reason: str = ""
    """Why it ended so, if an exception says it."""

    def to_native(self) -> _native.Outcome:
        """Returns the outcome as the extension module takes it."""
        return self.end, self.step, self.index, self.samples, self.steps, self.total_reward, self.reason


class System:
    """Base of all systems. It keeps the first exceptions, so that a run can report them."""

    name: str
    signals: list[tuple[str, str]]
    control_dt: float
    steps: int
    versions: list[tuple[str, str]]
    exceptions: list[str]
    depends_on_seed: bool = True
    knows_control_dt: bool = True
    """Whether ``control_dt`` was given or stated by the system."""
    has_pictures: bool = False
    """Whether it can draw its simulations."""
    recording: Recording | None = None
    """Pictures that the next simulation draws."""

    @property
    def random_axes(self) -> list[str]:
        """Names of the axes that make an episode depend on its seed."""
        faults: FaultLine | None = getattr(self, "faults", None)
        return [] if faults is None else faults.random_axes

    def simulate(self, batch: Sequence[Request]) -> list[Outcome]:
        """Simulates requests."""
        raise NotImplementedError

    def code(self) -> list[Any]:
        """Returns the functions and objects whose code the workers of a cluster need."""
        raise NotImplementedError

    def keep_exception(self) -> str:
        """Keeps the exception that is handled now. Returns it without its traceback, which differs between machines."""
        if len(self.exceptions) < 10:
            self.exceptions.append(traceback.format_exc())
        return "".join(traceback.format_exception_only(*sys.exc_info()[:2])).strip()

    def keep_reason(self, error: TimeLimitExceeded) -> str:
        """Keeps and returns the exception of a time limit that is handled now, if it says more than that the time is over."""
        return self.keep_exception() if error.args else ""


class NativeSystem(System):
    """A task that the Rust core simulates together with its controller."""

    def __init__(self, signals: list[tuple[str, str]]) -> None:
        self.signals = signals
        self.exceptions = []


def columns_of(
    trace: Any, names: Sequence[str] | None = None, hint: Callable[[list[str]], str | None] | None = None
) -> dict[str, NDArray[np.float64]]:
    """Returns some or all columns of a dictionary of arrays or of a data frame. Beside those in ``names``, there may be columns
    that are no numbers, such as time stamps, and columns of the same name. ``hint`` is asked if columns are missing."""
    # A simulation, such as those of `simulate`.
    trace = getattr(trace, "trace", trace) if not isinstance(trace, Mapping) and not hasattr(trace, "columns") else trace
    if isinstance(trace, Mapping):
        labels = list(trace)
    elif hasattr(trace, "columns"):
        labels = list(trace.columns)
    else:
        raise InvalidTypeError(f"a trace must be a dictionary of arrays or a data frame, not a {type(trace).__name__}")
    known = [str(label) for label in labels]
    missing = [name for name in names or [] if name not in known]
    if missing:
        suggestion = hint(known) if hint is not None else None
        raise InvalidValueError(
            f"the trace lacks the signals {_listed(missing)}; it has {_listed(known) or 'none'}"
            + (f"; {suggestion}" if suggestion else "")
        )
    read = [(name, label) for name, label in zip(known, labels) if names is None or name in names]
    twice = [name for name, count in Counter(name for name, _ in read).items() if count > 1]
    if twice:
        raise InvalidValueError(f"the trace has several columns of the same name: {_listed(twice)}")
    columns = {}
    for name, label in read:
        values = trace[label] if isinstance(trace, Mapping) else trace[label].to_numpy()
        try:
            column = _numbers(values)
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidValueError(f"the signal `{name}` is not an array of numbers: {error}") from error
        if column.ndim != 1:
            raise InvalidValueError(
                f"the signal `{name}` has the shape {column.shape}; expected one number per sample, so that each component "
                "is a signal of its own"
            )
        columns[name] = column
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InvalidValueError(f"the signals of a trace must have the same length, got {lengths}")
    return columns


def _listed(names: Sequence[str]) -> str:
    """Lists names. Characters that nobody sees, such as those that reverse the text after them, appear as their escapes."""
    return ", ".join("".join(c if c.isprintable() else ascii(c)[1:-1] for c in name) for name in names)


def _numbers(values: Any) -> NDArray[np.float64]:
    array: Any = np.asanyarray(values)
    if array.dtype.kind not in "biufO":
        raise TypeError(f"its elements have the type {array.dtype}")
    if array.dtype.kind == "O" and any(isinstance(value, (str, bytes, complex)) for value in array.flat):
        raise TypeError("some of its elements are not real numbers")
    numbers: NDArray[np.float64] = np.ma.filled(array.astype(np.float64), np.nan)
    return numbers


class FunctionSystem(System):
    """A function from a scenario to a trace."""

    def __init__(
        self,
        function: Callable[..., Any],
        *,
        nominal: Scenario,
        control_dt: float | None,
        steps: int | None,
        units: Mapping[str, str],
        time_limit: float | None,
        frame: Frames | None = None,
    ) -> None:
        if frame is not None and not callable(frame):
            raise InvalidTypeError(f"frame is a {type(frame).__name__}; expected a function frame(scenario, trace, samples)")
        self._frame = frame
        self.has_pictures = frame is not None
        self._function = function
        self._takes_seed = _takes_seed(function)
        self.depends_on_seed = self._takes_seed
        self._time_limit = time_limit
        name = getattr(function, "__name__", type(function).__name__)
        # A name without characters that shells interpret, because it becomes part of a file name.
        self.name = "lambda" if name == "<lambda>" else name
        self.control_dt = 1.0 if control_dt is None else control_dt
        self.knows_control_dt = control_dt is not None
        self.exceptions = []
        self.versions = [("numpy", np.__version__)]
        self._has_cut = self._has_process = False
        check_time_limit(time_limit)
        check_interruptible(time_limit)
        # An exception in the undisturbed scenario is the user's, so it is not caught.
        try:
            with limited(time_limit):
                trace = self._call(nominal, 0)
        except TimeLimitExceeded:
            raise InvalidValueError(f"the nominal scenario takes longer than the time limit of {time_limit} s") from None
        first = columns_of(trace)
        samples = len(next(iter(first.values()), []))
        if samples < 2:
            raise InvalidValueError(f"the trace of the nominal scenario has {samples} samples; expected at least 2")
        self.steps = samples - 1 if steps is None else steps
        self.signals = [(name, units.get(name, "")) for name in first]

    def _call(self, scenario: Scenario, seed: int) -> Any:
        return self._function(scenario, seed=seed) if self._takes_seed else self._function(scenario)

    def simulate(self, batch: Sequence[Request]) -> list[Outcome]:
        check_interruptible(self._time_limit)
        return [self._one(request.scenario, request.seed) for request in batch]

    def _one(self, scenario: Scenario, seed: int) -> Outcome:
        nothing = np.zeros((0, len(self.signals)))
        try:
            with limited(self._time_limit):
                trace = self._call(scenario, seed)
        except InvalidScenario as error:
            return Outcome("invalid scenario", nothing, 0, reason=str(error))
        except TimeLimitExceeded:
            self._warn_of_processes()
            return Outcome("timed out", nothing, 0)
        except Exception:
            return Outcome("crashed", nothing, 0, reason=self.keep_exception())
        if self.recording is not None and self._frame is not None:
            frame = self._frame
            self.recording.add_all(lambda samples: frame(scenario, trace, samples))
        columns = columns_of(trace)
        missing = [name for name, _ in self.signals if name not in columns]
        if missing:
            raise InvalidValueError(f"the trace of scenario {scenario} lacks the signals {missing}")
        samples = np.column_stack([columns[name] for name, _ in self.signals])
        if len(samples) > self.steps + 1:
            self._warn_of_cut(scenario, len(samples))
            samples = samples[: self.steps + 1]
        if len(samples) == 0:
            self.exceptions += [f"the trace of scenario {scenario} has no samples"][: 10 - len(self.exceptions)]
            return Outcome("crashed", nothing, 0, reason="the trace has no samples")
        steps = len(samples) - 1
        if steps < self.steps:
            return Outcome("terminated", samples, steps, step=steps)
        return Outcome("completed", samples, steps)

    def _warn_of_processes(self) -> None:
        """Warns of processes that live on after a time-out: the next scenario can get their late answers."""
        if self._has_process:
            return
        for process in walk(self._function).processes:
            if process.poll() is None:
                self._has_process = True
                warnings.warn(
                    f"a simulation timed out, and the process {process.pid} that the function talks to still runs: unless its answers "
                    "say to which scenario they belong, the next scenario gets the late one. Kill and restart the process when a "
                    "mishandle.TimeLimitExceeded passes the function, or use mishandle.Process",
                    stacklevel=2,
                )

    def _warn_of_cut(self, scenario: Scenario, samples: int) -> None:
        if not self._has_cut:
            warnings.warn(
                f"the trace of scenario {scenario} has {samples} samples, but an episode has {self.steps} control steps: later "
                "samples are left out, here and in other long traces; if they matter, pass the number of control steps of the "
                "longest trace as `steps`",
                stacklevel=2,
            )
        self._has_cut = True

    def code(self) -> list[Any]:
        return [self._function]


def _takes_seed(function: Callable[..., Any]) -> bool:
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return False
    return any(parameter.name == "seed" for parameter in parameters)


def _one_per_row(given: Any, rows: int) -> NDArray[np.float32]:
    """Returns the actions of a batch. Rows in another dimension are an error: they would be another policy."""
    actions = np.array(given, dtype=np.float32)
    if len(np.atleast_1d(actions)) != rows and (rows > 1 or actions.ndim > 1):
        raise InvalidValueError(f"the policy returned the shape {actions.shape} for a batch of {rows}; expected one action per row")
    return actions.reshape(rows, -1)


def _check_sees(controller: Controller, images: Sequence[tuple[str, int, int]]) -> None:
    """Checks that a controller gets the images that it needs."""
    given = {camera: (height, width, 3) for camera, width, height in images}
    if any(given.get(camera) != shape for camera, shape in controller.images):
        cameras = [camera for camera, _ in controller.images]
        (height, width, _), *others = {shape for _, shape in controller.images}
        size = f", image_size={(width, height)}" if not others else ""
        raise InvalidValueError(f"the controller {controller.name} needs cameras={cameras}{size}")


class CoreSystem(System):
    """A task, or a robot that a file describes, with a policy in Python that may see. The Rust core simulates it and requests the
    actions of up to 16 simulations at once. ``images`` are names of cameras, widths and heights."""

    def __init__(self, target: str, policy: Any, batched_policy: bool, images: Sequence[tuple[str, int, int]]) -> None:
        self.name, observation_size, self._action_size = _native.policy_interface(target)
        self.images = images
        if any(camera == "state" for camera, *_ in images):
            raise InvalidValueError("a policy in Python cannot see through a camera `state`: this is the key of the other observations")
        if isinstance(policy, Controller):
            _check_sees(policy, images)
        seen = {camera: Box(0, 255, (height, width, 3), np.uint8) for camera, width, height in images}
        state = Box(-np.inf, np.inf, (observation_size,))
        spaces = (Dict({"state": state, **seen}) if seen else state, Box(-np.inf, np.inf, (self._action_size,)))
        self._policy: Policy = as_policy(policy, batched_policy, spaces=spaces)
        self.has_timed_out = False
        self.versions = [("numpy", np.__version__)]
        self.exceptions = []

    def act(
        self, observations: NDArray[np.float32], images: Sequence[NDArray[np.uint8]], rows: int, is_start: bool
    ) -> NDArray[np.float32] | None:
        """Returns one action per row; ``None`` after an exception."""
        names = [camera for camera, *_ in self.images]
        seen: Any = [{"state": row[0], **dict(zip(names, row[1:]))} for row in zip(observations, *images)] if names else observations
        try:
            if is_start:
                self._policy.reset(rows)
            actions = _one_per_row(self._policy.act(seen, rows), rows)
            if actions.size != rows * self._action_size:
                raise InvalidValueError(
                    f"the policy returned {actions.size} numbers for {rows} observation{'s' if rows > 1 else ''}; {self.name} takes "
                    f"{self._action_size} for each"
                )
            return actions
        except (Exception, TimeLimitExceeded) as error:
            self.has_timed_out = isinstance(error, TimeLimitExceeded)
            self.keep_exception()
            return None


class TaskSystem(System):
    """One of the tasks with a policy. A whole batch is stepped together, with the bits of the command line."""

    def __init__(
        self,
        task: str,
        policy: Any,
        *,
        preset: str,
        rows: int,
        batched_policy: bool,
        time_limit: float | None = None,
        space: Sequence[Axis] = (),
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
        self._policy: Policy = as_policy(policy, batched_policy, spaces=spaces, task=task, arguments=self.arguments)
        self.policy_source = policy
        self.facts = [task, preset]
        self.name = task
        self.control_dt = native.control_dt
        self.steps = native.episode_steps
        self.faults = FaultLine(space, self.control_dt, self.steps, spaces)
        self._idle = idle_action(spaces[1])
        self.versions = [("numpy", np.__version__)]
        self.exceptions = []

    def __reduce__(self) -> tuple[Callable[..., TaskSystem], tuple[Any, ...]]:
        return _task_system, (*self._arguments, len(self.signals) > len(self.own_signals))

    def _simulate(self, manner: bool) -> _native.Simulator:
        task, _, preset, rows, *_ = self._arguments
        self._native = _native.Simulator(task, rows, preset=preset, reward="shaped", threads=None, manner=manner)
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
            Axis(name, low, high, unit, meaning=meaning) for name, unit, low, high, meaning in self._native.axes
        ]

    def code(self) -> list[Any]:
        return [self.policy_source]

    def simulate(self, batch: Sequence[Request]) -> list[Outcome]:
        chunks = [batch[first : first + self._rows] for first in range(0, len(batch), self._rows)]
        return [
            outcome for chunk in chunks for part in self.faults.start_all(chunk) for outcome in self._together(*part)
        ]

    def _together(self, chunk: Sequence[Request], faults: Sequence[Disturbed | None]) -> list[Outcome]:
        count, rows = len(chunk), self._rows
        # The other rows repeat the last scenario; their results are dropped.
        padded = [*chunk, *[chunk[-1]] * (rows - count)]
        nominal = {axis.name: axis.nominal_number for axis in self.space}
        scenarios = np.array([[float(each.scenario.get(name, value)) for name, value in nominal.items()] for each in padded])
        seeds = np.array([each.seed for each in padded], dtype=np.uint64)
        observations, _, signals, _, _ = self._native.reset(np.ones(rows, dtype=bool), seeds, scenarios)
        returns = np.zeros(rows)
        ends: list[tuple[str, int, int] | None] = [None] * rows
        reasons = [""] * rows
        stops = [EarlyStop(each.stop, self.signals, self.control_dt, self.steps) for each in chunk]
        traces: list[list[NDArray[np.float64]]] = [[signals[row]] for row in range(count)]
        start(
            self._policy,
            self.arguments,
            Rows([each.scenario for each in padded], is_running=lambda row: row < count and ends[row] is None),
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
                actions = _one_per_row(given, rows)
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
            outcomes.append(Outcome(end, samples, len(samples) - 1, step, index, float(returns[row]), reasons[row]))
        return outcomes


def _task_system(
    task: str,
    policy: Any,
    preset: str,
    rows: int,
    batched_policy: bool,
    time_limit: float | None,
    space: Sequence[Axis],
    manner: bool,
) -> TaskSystem:
    system = TaskSystem(
        task, policy, preset=preset, rows=rows, batched_policy=batched_policy, time_limit=time_limit, space=space
    )
    if manner:
        system.compute_manner()
    return system
