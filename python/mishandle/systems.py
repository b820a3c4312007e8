"""Systems under test: functions and environments."""

from __future__ import annotations

import inspect
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

from mishandle import _native
from mishandle.axes import Attribute, Axis, ResetOption, Value, get_path, set_path
from mishandle.policies import Policy, as_policy, policy_hash, source_text

Scenario = dict[str, Value]

Source = Union[str, Callable[[Any], float]]
"""Source of a signal: a path such as ``"obs[3]"``, ``"info.speed"``, ``"data.qpos[2]"`` or ``"reward"``, or a function of the
unwrapped environment. ``data`` and other names are attributes of the unwrapped environment."""


class InvalidScenario(Exception):
    """Raise it in a system or its reset if it cannot start from the scenario."""


class _TimeLimit(Exception):
    """The simulation took longer than its time limit."""


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

    def to_native(self) -> tuple[str, int, int, NDArray[np.float64], int, float]:
        """Returns the outcome as the extension module takes it."""
        return self.end, self.step, self.index, self.samples, self.steps, self.total_reward


class System:
    """Base of all systems. It keeps the first exceptions, so that a run can report them."""

    name: str
    signals: list[tuple[str, str]]
    control_dt: float
    steps: int
    versions: list[tuple[str, str]]
    exceptions: list[str]
    depends_on_seed: bool = True

    def simulate(self, batch: Sequence[tuple[Scenario, int]]) -> list[Outcome]:
        """Simulates pairs of scenario and seed."""
        raise NotImplementedError

    def description(self) -> str:
        """Returns a text that changes if the code of the system changes."""
        raise NotImplementedError

    def keep_exception(self) -> None:
        """Keeps the exception that is handled now."""
        if len(self.exceptions) < 10:
            self.exceptions.append(traceback.format_exc())


@contextmanager
def _limited(seconds: float | None) -> Iterator[None]:
    """Raises :class:`_TimeLimit` in the main thread after some seconds. Other threads cannot be interrupted."""
    if seconds is None or threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: Any) -> None:
        raise _TimeLimit

    previous = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)


def columns_of(trace: Any) -> dict[str, NDArray[np.float64]]:
    """Returns the columns of a dictionary of arrays or of a data frame."""
    if isinstance(trace, Mapping):
        items = list(trace.items())
    elif hasattr(trace, "columns"):
        items = [(name, trace[name].to_numpy()) for name in trace.columns]
    else:
        raise TypeError(f"a trace must be a dictionary of arrays or a data frame, not a {type(trace).__name__}")
    columns = {str(name): np.asarray(values, dtype=np.float64).reshape(-1) for name, values in items}
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"the signals of a trace must have the same length, got {lengths}")
    return columns


class FunctionSystem(System):
    """A function from a scenario to a trace."""

    def __init__(
        self,
        function: Callable[..., Any],
        *,
        nominal: Scenario,
        control_dt: float,
        steps: int | None,
        units: Mapping[str, str],
        time_limit: float | None,
    ) -> None:
        self._function = function
        self._takes_seed = _takes_seed(function)
        self.depends_on_seed = self._takes_seed
        self._time_limit = time_limit
        self.name = getattr(function, "__name__", type(function).__name__)
        self.control_dt = control_dt
        self.exceptions = []
        self.versions = [("numpy", np.__version__)]
        # An exception in the undisturbed scenario is the user's, so it is not caught.
        first = columns_of(self._call(nominal, 0))
        samples = len(next(iter(first.values()), []))
        if samples < 2:
            raise ValueError(f"the trace of the nominal scenario has {samples} samples; expected at least 2")
        self.steps = samples - 1 if steps is None else steps
        self.signals = [(name, units.get(name, "")) for name in first]

    def _call(self, scenario: Scenario, seed: int) -> Any:
        return self._function(scenario, seed=seed) if self._takes_seed else self._function(scenario)

    def simulate(self, batch: Sequence[tuple[Scenario, int]]) -> list[Outcome]:
        return [self._one(scenario, seed) for scenario, seed in batch]

    def _one(self, scenario: Scenario, seed: int) -> Outcome:
        nothing = np.zeros((0, len(self.signals)))
        try:
            with _limited(self._time_limit):
                trace = self._call(scenario, seed)
        except InvalidScenario:
            return Outcome("invalid scenario", nothing, 0)
        except _TimeLimit:
            return Outcome("timed out", nothing, 0)
        except Exception:
            self.keep_exception()
            return Outcome("crashed", nothing, 0)
        columns = columns_of(trace)
        missing = [name for name, _ in self.signals if name not in columns]
        if missing:
            raise ValueError(f"the trace of scenario {scenario} lacks the signals {missing}")
        samples = np.column_stack([columns[name] for name, _ in self.signals])
        steps = len(samples) - 1
        if steps < self.steps:
            return Outcome("terminated", samples, steps, step=steps)
        return Outcome("completed", samples, steps)

    def description(self) -> str:
        return source_text(self._function)


def _takes_seed(function: Callable[..., Any]) -> bool:
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return False
    return any(parameter.name == "seed" for parameter in parameters)


class TaskSystem(System):
    """One of the tasks with a policy. A whole batch is stepped together, with the bits of the command line."""

    def __init__(self, task: str, policy: Any, *, preset: str, rows: int, batched_policy: bool) -> None:
        self._arguments = (task, policy, preset, rows, batched_policy)
        self._native = _native.Simulator(task, rows, preset=preset, reward="shaped", threads=None)
        self._rows = rows
        self._policy: Policy = as_policy(policy, batched_policy)
        self._policy_source = policy
        self._facts = (task, preset)
        self.name = task
        self.signals = self._native.signals
        self.control_dt = self._native.control_dt
        self.steps = self._native.episode_steps
        self.versions = [("numpy", np.__version__)]
        self.exceptions = []

    def __reduce__(self) -> tuple[Callable[..., TaskSystem], tuple[Any, ...]]:
        return _task_system, self._arguments

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

    def description(self) -> str:
        return "\n".join([*self._facts, policy_hash(self._policy_source)])

    def simulate(self, batch: Sequence[tuple[Scenario, int]]) -> list[Outcome]:
        chunks = [batch[first : first + self._rows] for first in range(0, len(batch), self._rows)]
        return [outcome for chunk in chunks for outcome in self._together(chunk)]

    def _together(self, chunk: Sequence[tuple[Scenario, int]]) -> list[Outcome]:
        count, rows = len(chunk), self._rows
        # The other rows repeat the last scenario; their results are dropped.
        padded = [*chunk, *[chunk[-1]] * (rows - count)]
        names = [name for name, *_ in self._native.axes]
        scenarios = np.array([[float(scenario[name]) for name in names] for scenario, _ in padded])
        seeds = np.array([seed for _, seed in padded], dtype=np.uint64)
        observations, _, signals, _, _ = self._native.reset(np.ones(rows, dtype=bool), seeds, scenarios)
        samples = [signals]
        returns = np.zeros(rows)
        ends: list[tuple[str, int, int] | None] = [None] * rows
        self._policy.reset(rows)
        for step in range(1, self.steps + 1):
            try:
                actions = np.asarray(self._policy.act(observations, rows), dtype=np.float32).reshape(rows, -1)
            except Exception:
                self.keep_exception()
                ends = [end or ("crashed", step, 0) for end in ends]
                break
            if not np.isfinite(actions).all():
                for row, column in np.argwhere(~np.isfinite(actions)):
                    ends[row] = ends[row] or ("invalid action", step, int(column))
                actions = np.nan_to_num(actions)
            observations, rewards, signals, _, diverged = self._native.step(actions)
            samples.append(signals)
            returns += rewards.sum(axis=1)
            for row in np.flatnonzero(diverged):
                ends[row] = ends[row] or ("diverged", step, 0)
        traces = np.stack(samples, axis=1)
        outcomes = []
        for row in range(count):
            end, step, index = ends[row] or ("completed", 0, 0)
            steps = self.steps if end == "completed" else step - 1
            trace = np.ascontiguousarray(traces[row, : steps + 1])
            outcomes.append(Outcome(end, trace, steps, step, index, float(returns[row])))
        return outcomes


def _task_system(task: str, policy: Any, preset: str, rows: int, batched_policy: bool) -> TaskSystem:
    return TaskSystem(task, policy, preset=preset, rows=rows, batched_policy=batched_policy)


class EnvironmentSystem(System):
    """A Gymnasium environment with a policy. The sub-environments of a ``SyncVectorEnv`` are stepped together."""

    def __init__(
        self,
        environment: Any,
        policy: Any,
        space: Sequence[Axis],
        *,
        signals: Mapping[str, Source | tuple[Source, str]],
        steps: int | None,
        control_dt: float | None,
        time_limit: float | None,
        batched_policy: bool,
    ) -> None:
        import gymnasium

        self._environments: list[Any] = list(getattr(environment, "envs", None) or [environment])
        first = self._environments[0]
        if not isinstance(first, gymnasium.Env):
            raise TypeError(f"a {type(environment).__name__} is not a Gymnasium environment or a SyncVectorEnv of them")
        self._policy: Policy = as_policy(policy, batched_policy)
        self._policy_source = policy
        self._space = {axis.name: axis for axis in space}
        self._time_limit = time_limit
        pairs = {name: source if isinstance(source, tuple) else (source, "") for name, source in signals.items()}
        if not pairs:
            raise ValueError('an environment needs signals, for instance signals={"x": "obs[0]"}')
        self._sources: list[Source] = [source for source, _ in pairs.values()]
        self.signals = [(name, unit) for name, (_, unit) in pairs.items()]
        spec = first.spec
        self.name = spec.id if spec is not None else type(first.unwrapped).__name__
        limit = spec.max_episode_steps if spec is not None else None
        if steps is None and limit is None:
            raise ValueError("the environment has no time limit; pass the number of control steps as `steps`")
        self.steps = int(steps if steps is not None else limit or 0)
        self.control_dt = control_dt if control_dt is not None else _control_dt(first)
        self.versions = [("gymnasium", gymnasium.__version__), ("numpy", np.__version__)]
        self.exceptions = []

    def __getstate__(self) -> dict[str, Any]:
        # Simulators outside of Python cannot be copied, so an environment that Gymnasium made is made again.
        environments = [each if each.spec is None else each.spec for each in self._environments]
        return {**self.__dict__, "_environments": environments}

    def __setstate__(self, state: dict[str, Any]) -> None:
        import gymnasium

        self.__dict__.update(state)
        self._environments = [
            gymnasium.make(each) if isinstance(each, gymnasium.envs.registration.EnvSpec) else each
            for each in self._environments
        ]

    def description(self) -> str:
        spec = self._environments[0].spec
        sources = [source if isinstance(source, str) else source_text(source) for source in self._sources]
        applications = [
            repr(axis.apply) if not callable(axis.apply) else source_text(axis.apply) for axis in self._space.values()
        ]
        parts = [spec.to_json() if spec is not None else "", source_text(self._environments[0].unwrapped)]
        return "\n".join([*parts, policy_hash(self._policy_source), *sources, *applications])

    def simulate(self, batch: Sequence[tuple[Scenario, int]]) -> list[Outcome]:
        size = len(self._environments)
        chunks = [batch[first : first + size] for first in range(0, len(batch), size)]
        return [outcome for chunk in chunks for outcome in self._together(chunk)]

    def _together(self, chunk: Sequence[tuple[Scenario, int]]) -> list[Outcome]:
        rows = [_Row(self, environment) for environment in self._environments[: len(chunk)]]
        for row, (scenario, seed) in zip(rows, chunk):
            row.reset(scenario, seed)
        self._policy.reset(len(rows))
        for step in range(1, self.steps + 1):
            if not any(row.outcome is None for row in rows):
                break
            # Ended rows keep their last observation, so that the rows of a recurrent policy stay in place.
            if all(row.observation is None for row in rows):
                break
            observations = [row.observation for row in rows]
            present = next(observation for observation in observations if observation is not None)
            observations = [present if observation is None else observation for observation in observations]
            try:
                actions = self._policy.act(observations, len(rows))
            except Exception:
                self.keep_exception()
                for row in rows:
                    row.end("crashed", step)
                break
            for row, action in zip(rows, actions):
                row.step(action, step)
        return [row.finish() for row in rows]

    def sample(self, environment: Any, observation: Any, info: Mapping[str, Any], reward: float) -> list[float]:
        """Returns the signals at one sample."""
        return [_value(source, environment, observation, info, reward) for source in self._sources]

    def apply(self, environment: Any, scenario: Scenario) -> tuple[dict[str, Any], list[tuple[Any, Value]]]:
        """Sets attributes; returns the options of the reset and the functions to call after it."""
        options: dict[str, Any] = {}
        later: list[tuple[Any, Value]] = []
        for name, value in scenario.items():
            application = self._space[name].apply
            if application is None or isinstance(application, ResetOption):
                *parents, last = (name if application is None else application.name).split(".")
                inner = options
                for parent in parents:
                    inner = inner.setdefault(parent, {})
                inner[last] = value
            elif isinstance(application, Attribute):
                set_path(environment.unwrapped, application.path, value)
            else:
                later.append((application, value))
        return options, later


class _Row:
    """One simulation in one environment."""

    def __init__(self, system: EnvironmentSystem, environment: Any) -> None:
        self._system = system
        self._environment = environment
        self._samples: list[list[float]] = []
        self._total_reward = 0.0
        self._steps = 0
        self._spent = 0.0
        self.observation: Any = None
        self.outcome: Outcome | None = None

    def reset(self, scenario: Scenario, seed: int) -> None:
        def start() -> None:
            options, later = self._system.apply(self._environment, scenario)
            # Some environments take seeds of 32 bits only.
            observation, info = self._environment.reset(seed=seed % 2**31, options=options or None)
            for function, value in later:
                changed = function(self._environment, value)
                observation = observation if changed is None else changed
            self.observation = observation
            self._samples.append(self._system.sample(self._environment, observation, info, 0.0))

        self._guarded(start, 0)

    def step(self, action: Any, step: int) -> None:
        if self.outcome is not None:
            return
        values = np.asarray(action, dtype=np.float64).reshape(-1)
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad) > 0:
            self.end("invalid action", step, int(bad[0]))
            return

        def advance() -> None:
            observation, reward, terminated, truncated, info = self._environment.step(action)
            self.observation = observation
            self._steps = step
            self._total_reward += float(reward)
            self._samples.append(self._system.sample(self._environment, observation, info, float(reward)))
            if not np.isfinite(float(reward)):
                self.end("invalid reward", step)
            elif step == self._system.steps:
                self.end("completed", step)
            elif terminated or truncated:
                self.end("terminated", step)

        self._guarded(advance, step)

    def _guarded(self, work: Callable[[], None], step: int) -> None:
        started = time.perf_counter()
        limit = self._system._time_limit
        try:
            with _limited(None if limit is None else max(limit - self._spent, 1e-3)):
                work()
        except InvalidScenario:
            self.end("invalid scenario", step)
        except _TimeLimit:
            self.end("timed out", step)
        except Exception:
            self._system.keep_exception()
            self.end("crashed", step)
        self._spent += time.perf_counter() - started

    def end(self, end: str, step: int, index: int = 0) -> None:
        if self.outcome is None:
            self.outcome = Outcome(end, np.zeros((0, 0)), self._steps, step, index)

    def finish(self) -> Outcome:
        outcome = self.outcome or Outcome("completed", np.zeros((0, 0)), self._steps)
        outcome.samples = np.asarray(self._samples, dtype=np.float64).reshape(-1, len(self._system.signals))
        outcome.total_reward = self._total_reward
        return outcome


def _value(source: Source, environment: Any, observation: Any, info: Mapping[str, Any], reward: float) -> float:
    if callable(source):
        return float(source(environment.unwrapped))
    if source == "reward":
        return reward
    if source.startswith("info."):
        found: Any = info
        for key in source.split(".")[1:]:
            found = found[key]
        return float(found)
    if source.startswith("obs"):
        holder = _Holder(observation)
        return float(get_path(holder, source))
    return float(get_path(environment.unwrapped, source))


@dataclass
class _Holder:
    obs: Any


def _control_dt(environment: Any) -> float:
    """Returns the duration of a control step in seconds; 1 if the environment does not state it."""
    dt = getattr(environment.unwrapped, "dt", None)
    if isinstance(dt, (int, float)) and dt > 0:
        return float(dt)
    rate = environment.metadata.get("render_fps")
    return 1.0 / rate if rate else 1.0
