"""Gymnasium environments in the process of the search as systems."""

import copy
import inspect
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from mishandle.base.limits import check_time_limit, limited
from mishandle.errors import InvalidScenario, InvalidTypeError, InvalidValueError, TimeLimitExceeded
from mishandle.policies.kinds import Policy, as_policy, start
from mishandle.policies.servers import Rows
from mishandle.scenarios.applications import Applications, PolicyArguments, environment_seed
from mishandle.scenarios.attributes import Attributes
from mishandle.scenarios.axes import Axis, follower, parse_path
from mishandle.scenarios.lines import Disturbed, FaultLine
from mishandle.scenarios.requests import EarlyStop, Request
from mishandle.scenarios.scenes import has_model
from mishandle.scenarios.values import (
    all_numbers, check_size, idle_action, one_number, size_of
)
from mishandle.systems.interface import Outcome, Source, System
from mishandle.systems.reductions import PhysicsSteps, Reduced
from mishandle.systems.starts import Invalid, Settle, Starts


class PolicySystem(System):
    """Base of environments with a policy: their names, signals, time limit and policy."""

    def __init__(
        self, environment: Any, policy: Any, space: Sequence[Axis], *,
        signals: Mapping[str, Source | tuple[Source, str]], steps: int | None,
        control_dt: float | None, time_limit: float | None, batched_policy: bool,
        settle: Settle | None = None, invalid: Invalid | None = None
    ) -> None:
        check_time_limit(time_limit)
        spaces = [
            getattr(environment, f"single_{name}", None) or getattr(environment, name, None)
            for name in ("observation_space", "action_space")
        ]
        self.arguments = PolicyArguments(space)
        self.policy: Policy = as_policy(
            policy, batched_policy, spaces=(spaces[0], spaces[1]), arguments=self.arguments,
            can_draw=getattr(environment, "render_mode", None) == "rgb_array"
        )
        self._policy_source = policy
        self._environment = environment
        self._action_size = size_of(spaces[1])
        self.space = {axis.name: axis for axis in space}
        self.time_limit = time_limit
        self.sources, self.signals = sources_and_signals(signals)
        self.physics_steps = PhysicsSteps()
        self._readers = [_reader(source, self.physics_steps) for source in self.sources]
        self.name = spec_name(environment)
        self.starts = Starts(settle, invalid, spaces[1])
        # A time limit of the environment counts the control steps in which it settles.
        self.steps = (
            episode_steps(environment, steps) if steps is not None
            else episode_steps(environment, None) - self.starts.steps
        )
        self.control_dt = control_dt if control_dt is not None else control_period(environment)
        self.knows_control_dt = control_dt is not None or states_control_dt(environment)
        self.faults = FaultLine(space, self.control_dt, self.steps, (spaces[0], spaces[1]))
        self.idle = idle_action(spaces[1]) if self.faults.is_used else None
        self.versions = [("gymnasium", gymnasium.__version__), ("numpy", np.__version__)]
        self.exceptions = []

    def code(self) -> list[Any]:
        applications = [axis.apply for axis in self.space.values()]
        return [self._environment.unwrapped, self._policy_source, self.sources, applications]

    def first_sample(
        self, unwrapped: Any, observation: Any, info: Mapping[str, Any]
    ) -> tuple[list[float], list[int]]:
        """Returns the signals after a reset, and the columns of values that only the ``info`` of a
        step contains; they are NaN until :func:`complete` sets them."""
        late = []
        for column, (source, read) in enumerate(zip(self.sources, self._readers)):
            source = source.source if isinstance(source, Reduced) else source
            if isinstance(source, str) and source.startswith("info."):
                try:
                    read(unwrapped, observation, info, 0.0)
                except KeyError:
                    late.append(column)
        if not late:
            return self.sample(unwrapped, observation, info, 0.0), late
        values = []
        for column, read in enumerate(self._readers):
            values.append(math.nan if column in late else read(unwrapped, observation, info, 0.0))
        return values, late

    def sample(
        self, unwrapped: Any, observation: Any, info: Mapping[str, Any], reward: float
    ) -> list[float]:
        """Returns the signals at one sample of an environment without its wrappers."""
        try:
            return [read(unwrapped, observation, info, reward) for read in self._readers]
        except (LookupError, AttributeError, TypeError, ValueError):
            for (name, _), source, read in zip(self.signals, self.sources, self._readers):
                try:
                    read(unwrapped, observation, info, reward)
                except (LookupError, AttributeError, TypeError, ValueError) as error:
                    text = source if isinstance(source, (str, Reduced)) else "a function"
                    raise InvalidValueError(
                        f"the signal `{name}` has no value: its source is {text}, and "
                        f"{type(error).__name__}: {error}"
                    ) from error
            raise

    def act(
        self, observations: list[Any], times: "Sequence[Time]"
    ) -> tuple[tuple[str, str] | None, Any]:
        """Returns the end of the simulations and its reason if the policy fails, and its actions.
        The simulations share its time."""
        try:
            if self.time_limit is None:
                return None, self._actions(observations)
            left = min(row.left(self.time_limit) for row in times) * len(times)
            started = time.perf_counter()
            try:
                with limited(left):
                    return None, self._actions(observations)
            finally:
                spent = (time.perf_counter() - started) / len(times)
                for row in times:
                    row.spent += spent
        except TimeLimitExceeded as error:
            return ("timed out", self.keep_reason(error)), None
        except Exception:
            return ("crashed", self.keep_exception()), None

    def _actions(self, observations: list[Any]) -> Any:
        actions = self.policy.act(observations, len(observations))
        if len(actions) != len(observations):
            raise InvalidValueError(
                f"the policy returned {len(actions)} actions for {len(observations)} observations"
            )
        if self._action_size is not None:
            for action in actions:
                check_size(action, self._action_size)
        return actions


class EnvironmentSystem(PolicySystem):
    """A Gymnasium environment with a policy. The sub-environments of a ``SyncVectorEnv`` are
    stepped together."""

    def __init__(
        self, environment: Any, policy: Any, space: Sequence[Axis], **options: Any
    ) -> None:
        self._environments: list[Any] = list(getattr(environment, "envs", None) or [environment])
        first = self._environments[0]
        if not isinstance(first, gymnasium.Env):
            raise InvalidTypeError(
                f"a {type(environment).__name__} is not a Gymnasium environment or a vector of them"
            )
        if any(each.has_wrapper_attr("draws_scenarios") for each in self._environments):
            raise InvalidTypeError(
                "a ScenarioEnv draws scenarios of its own, so it cannot be given one: pass the "
                "environment without this wrapper"
            )
        if len({id(each.unwrapped) for each in self._environments}) < len(self._environments):
            raise InvalidValueError(
                "two sub-environments of the vector environment are the same object, so they "
                "cannot have scenarios of their own; each function of the vector environment must "
                "make a new one"
            )
        super().__init__(first, policy, space, **options)
        self.has_pictures = first.render_mode == "rgb_array"
        self.has_scene = has_model(first.unwrapped)

    def __getstate__(self) -> dict[str, Any]:
        # Simulators outside of Python cannot be copied, so an environment that Gymnasium made is
        # made again.
        environments = [each if each.spec is None else each.spec for each in self._environments]
        return {**self.__dict__, "_environments": environments, "_environment": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._environments = [
            gymnasium.make(each) if isinstance(each, gymnasium.envs.registration.EnvSpec) else each
            for each in self._environments
        ]
        self._environment = self._environments[0]

    def simulate(self, batch: Sequence[Request]) -> list[Outcome]:
        size = len(self._environments)
        chunks = [batch[first : first + size] for first in range(0, len(batch), size)]
        return [
            outcome for chunk in chunks for part in self.faults.start_all(chunk)
            for outcome in self._together(*part)
        ]

    def _together(
        self, chunk: Sequence[Request], faults: Sequence[Disturbed | None]
    ) -> list[Outcome]:
        given = zip(self._environments, chunk, faults)
        rows = [
            _Row(self, environment, request, disturbed) for environment, request, disturbed in given
        ]
        try:
            return self._run(rows)
        finally:
            for row in reversed(rows):
                row.attributes.restore()

    def _run(self, rows: "list[_Row]") -> list[Outcome]:
        for row in rows:
            row.set()
        for row in rows:
            row.check_own()
        for row in rows:
            row.reset()
        batch = Rows(
            [row.scenario for row in rows], lambda: [row.draw() for row in rows],
            lambda row: rows[row].outcome is None
        )
        start(self.policy, self.arguments, batch)
        for step in range(1, self.steps + 1):
            running = [row for row in rows if row.outcome is None]
            if not running:
                break
            # Ended rows keep their last observation, so that the rows of a recurrent policy stay in
            # place. A row without one did not start.
            for row in running:
                row.see(step - 1)
            if all(row.is_paused(step - 1) for row in running):
                for row in running:
                    row.step(None, step)
                continue
            observations = [running[0].seen if row.seen is None else row.seen for row in rows]
            failure, actions = self.act(
                observations, [] if self.time_limit is None else [row.time for row in running]
            )
            if failure is not None:
                end, reason = failure
                for row in rows:
                    row.end(end, step, reason=reason)
                break
            for row, action in zip(rows, actions):
                row.step(action, step)
        return [row.finish() for row in rows]


class _Row:
    """One simulation in one environment."""

    def __init__(
        self, system: EnvironmentSystem, environment: Any, request: Request,
        faults: Disturbed | None
    ) -> None:
        self._system = system
        self.scenario = request.scenario
        self._applications = Applications(system.space, request.scenario)
        self._seed = environment_seed(request.seed)
        self._stop = EarlyStop(request.stop, system.signals, system.control_dt, system.steps)
        self._faults = faults
        self.attributes = Attributes()
        self._own: list[Any] = []
        self._environment = environment
        self._unwrapped: Any = None
        self._samples: list[list[float]] = []
        self._late: list[int] = []
        self._total_reward = 0.0
        self._steps = 0
        self.time = Time()
        self.observation: Any = None
        self.seen: Any = None
        self.outcome: Outcome | None = None

    def set(self) -> None:
        """Sets the attributes of the scenario."""
        self._guarded(self._set, None, 0)

    def _set(self, argument: None, step: int) -> None:
        self.attributes.set(self._environment.unwrapped, self._applications.attributes)
        self._own = copy.deepcopy(self.attributes.values())

    def check_own(self) -> None:
        """Checks that no other row has set the same attributes since."""
        if (
            self.outcome is None
            and not all(map(np.array_equal, self.attributes.values(), self._own))
        ):
            paths = ", ".join(path for path, _ in self._applications.attributes)
            raise InvalidValueError(
                "the sub-environments of the vector environment share what the axes set "
                f"({paths}), so they cannot have scenarios of their own; each sub-environment "
                "needs objects of its own"
            )

    def reset(self) -> None:
        if self.outcome is None:
            self._guarded(self._start, None, 0)
            self._draw()

    def _start(self, argument: None, step: int) -> None:
        start = self._applications.reset(self._environment, self._seed)
        observation, info = self._system.starts.settled(self._environment, *start)
        self.observation = observation
        # A wrapper may make a new environment in its reset.
        self._unwrapped = self._environment.unwrapped
        sample, self._late = self._system.first_sample(self._unwrapped, observation, info)
        self._samples.append(sample)

    def _draw(self) -> None:
        """Draws the last sample, and notes where its bodies are, if a report asks for it. The time
        of this does not count."""
        recording, motion = self._system.recording, self._system.motion
        if recording is not None and self._samples:
            recording.add(self._steps, self._environment.render)
        if motion is not None and self._samples:
            motion.add(self._steps, self._unwrapped)

    def draw(self) -> Any:
        """Returns a picture for the policy; ``None`` after the end."""
        return self._environment.render() if self.outcome is None else None

    def see(self, step: int) -> None:
        """Sets what the policy sees in a control step, counted from 0."""
        self.seen = (
            self.observation if self._faults is None
            else self._faults.observe(step, self.observation)
        )

    def is_paused(self, step: int) -> bool:
        """Returns whether a fault keeps the policy from acting in a control step, counted from
        0."""
        return self._faults is not None and self._faults.is_paused(step)

    def step(self, action: Any, step: int) -> None:
        if self.outcome is not None:
            return
        if self._faults is not None:
            action = self._faults.answer(step - 1, action, self._system.idle)
        index = first_not_finite(action)
        if index is None:
            self._guarded(self._advance, action, step)
            self._draw()
        else:
            self.end("invalid action", step, index)

    def _advance(self, action: Any, step: int) -> None:
        system = self._system
        if self._faults is not None:
            action = self._faults.act(step - 1, action)
        with system.physics_steps.watched(self._unwrapped):
            observation, given, terminated, truncated, info = self._environment.step(action)
            reward = one_number(given)
            self.observation = observation
            self._steps = step
            self._total_reward += reward
            self._samples.append(system.sample(self._unwrapped, observation, info, reward))
        if self._late:
            complete(self._samples, self._late)
            self._late = []
        if not math.isfinite(reward):
            self.end("invalid reward", step)
        elif step == system.steps:
            self.end("completed", step)
        elif terminated or truncated:
            self.end("terminated", step)
        elif self._stop.may_stop(self._samples):
            self.end("stopped", step)

    def _guarded(self, work: Callable[..., None], argument: Any, step: int) -> None:
        limit = self._system.time_limit
        try:
            if limit is None:
                work(argument, step)
            else:
                started = time.perf_counter()
                with limited(self.time.left(limit)):
                    work(argument, step)
                self.time.spent += time.perf_counter() - started
        except InvalidScenario as error:
            self.end("invalid scenario", step, reason=str(error))
        except TimeLimitExceeded:
            self.end("timed out", step)
        except Exception:
            self.end("crashed", step, reason=self._system.keep_exception())

    def end(self, end: str, step: int, index: int = 0, reason: str = "") -> None:
        if self.outcome is None:
            self.outcome = Outcome(end, np.zeros((0, 0)), self._steps, step, index, reason=reason)

    def finish(self) -> Outcome:
        outcome = self.outcome or Outcome("completed", np.zeros((0, 0)), self._steps)
        # Without a step, the first sample lacks values.
        outcome.samples = np.asarray([] if self._late else self._samples, dtype=np.float64).reshape(
            -1, len(self._system.signals)
        )
        outcome.total_reward = self._total_reward
        return outcome


def complete(samples: list[list[float]], late: list[int]) -> None:
    """Sets the columns ``late`` of the first sample to their values in the second one.

    >>> samples = [[0.5, math.nan], [0.75, 2.0]]
    >>> complete(samples, [1])
    >>> samples
    [[0.5, 2.0], [0.75, 2.0]]
    """
    for column in late:
        samples[0][column] = samples[1][column]


_FEW = 32
"""Longest action that is checked number by number."""


def first_not_finite(action: Any) -> int | None:
    """Returns the index of the first number of an action that is NaN or infinite.

    >>> first_not_finite(np.array([0.5, np.nan])), first_not_finite([0.5, 1.0]), first_not_finite({
    ...     "gear": 1, "force": np.inf
    ... })
    (1, None, 0)
    """
    # Most actions are short arrays, which Python checks faster than NumPy.
    if (
        type(action) is np.ndarray and action.ndim == 1 and action.dtype.kind == "f"
        and len(action) <= _FEW
    ):
        if all(map(math.isfinite, action.tolist())):
            return None
    elif isinstance(action, (int, np.integer)):
        return None
    try:
        values = np.asarray(all_numbers(action), dtype=np.float64)
    except (TypeError, ValueError):
        return None  # Actions of other spaces than boxes; the environment checks them.
    finite = np.isfinite(values)
    return None if finite.all() else int(np.flatnonzero(~finite)[0])


Reader = Callable[[Any, Any, Mapping[str, Any], float], float]


def _reader(source: Source, physics_steps: PhysicsSteps) -> Reader:
    """Returns the function from unwrapped environment, observation, info and reward to the value of
    a signal."""
    if not isinstance(source, Reduced):
        read = _values(source)
        return lambda environment, observation, info, reward: one_number(
            read(environment, observation, info, reward)
        )
    several = _values(source.source)
    reduced = source
    if not reduced.reads_physics_steps:
        return lambda environment, observation, info, reward: reduced.reduce(
            several(environment, observation, info, reward)
        )
    if callable(source.source) and _positional_parameters(source.source) >= 2:
        raise InvalidTypeError(
            "a source that is read after each physics step is a function of the environment; it "
            "has no observation there"
        )
    number = physics_steps.add(reduced, lambda environment: several(environment, None, {}, 0.0))
    return lambda environment, observation, info, reward: number(environment)


def _values(
    source: str | Callable[..., Any]
) -> Callable[[Any, Any, Mapping[str, Any], float], Any]:
    """Returns the function from unwrapped environment, observation, info and reward to the value of
    a source."""
    if callable(source):
        function = source
        if _positional_parameters(function) >= 2:
            return lambda environment, observation, info, reward: function(environment, observation)
        return lambda environment, observation, info, reward: function(environment)
    if source == "reward":
        return lambda environment, observation, info, reward: reward
    segments = parse_path(source)
    first, indexes = segments[0]
    if first == "obs" and len(segments) == len(indexes) == 1:
        [place] = indexes
        return lambda environment, observation, info, reward: observation[place]
    follow = follower(segments)
    if first == "obs":
        return lambda environment, observation, info, reward: follow({"obs": observation})
    if first == "info":
        return lambda environment, observation, info, reward: follow({"info": info})
    return lambda environment, observation, info, reward: follow(environment)


def _positional_parameters(function: Callable[..., Any]) -> int:
    """Returns the number of positional parameters without a default."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return 1
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(
        parameter.kind in kinds and parameter.default is parameter.empty for parameter in parameters
    )


@dataclass
class Time:
    """Wall-clock time of one simulation, in seconds."""

    spent: float = 0.0

    def left(self, limit: float) -> float:
        """Returns the rest of a time limit, at least a millisecond."""
        return max(limit - self.spent, 1e-3)


def sources_and_signals(
    signals: Mapping[str, Source | tuple[Source, str]],
) -> tuple[list[Source], list[tuple[str, str]]]:
    """Returns the source of each signal, and its name and unit."""
    if not signals:
        raise InvalidValueError(
            'an environment needs signals, for instance signals={"x": "obs[0]"}'
        )
    pairs = {
        name: source if isinstance(source, tuple) else (source, "")
        for name, source in signals.items()
    }
    return [source for source, _ in pairs.values()], [
        (name, unit) for name, (_, unit) in pairs.items()
    ]


def spec_name(environment: Any) -> str:
    """Returns the name of an environment: that of its registration or of its class."""
    return (
        str(environment.spec.id) if environment.spec is not None
        else type(environment.unwrapped).__name__
    )


def episode_steps(environment: Any, steps: int | None) -> int:
    """Returns the number of control steps of an episode."""
    limit = environment.spec.max_episode_steps if environment.spec is not None else None
    if limit is None:
        limit = _wrapped_limit(environment)
    if limit is None:
        limit = getattr(environment.unwrapped, "max_episode_steps", None)
    if steps is None and limit is None:
        raise InvalidValueError(
            "the environment has no time limit; pass the number of control steps as `steps`"
        )
    return int(steps if steps is not None else limit or 0)


def _wrapped_limit(environment: Any) -> int | None:
    """Returns the least time limit of Gymnasium's wrappers, in control steps."""
    limits = []
    while isinstance(environment, gymnasium.Wrapper):
        if isinstance(environment, gymnasium.wrappers.TimeLimit):
            limits.append(int(environment._max_episode_steps))
        environment = environment.env
    return min(limits, default=None)


def states_control_dt(environment: Any) -> bool:
    """Returns whether the environment has the attribute ``dt``. The frame rate of its videos can
    differ from its control rate."""
    dt = getattr(environment.unwrapped, "dt", None)
    return isinstance(dt, (int, float)) and dt > 0


def control_period(environment: Any) -> float:
    """Returns the duration of a control step in seconds; 1 if the environment does not state it."""
    if states_control_dt(environment):
        return float(environment.unwrapped.dt)
    rate = environment.metadata.get("render_fps")
    return 1.0 / rate if rate else 1.0
