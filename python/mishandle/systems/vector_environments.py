"""Vector environments without access to their sub-environments as systems: ``AsyncVectorEnv`` and
native ones."""

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import concatenate, create_empty_array, iterate
from numpy.typing import NDArray

from mishandle.base.limits import limited
from mishandle.errors import InvalidScenario, InvalidTypeError, InvalidValueError, TimeLimitExceeded
from mishandle.policies.kinds import start
from mishandle.policies.servers import Rows
from mishandle.scenarios.applications import Applications, environment_seed
from mishandle.scenarios.axes import Attribute, Axis, FaultParameter, PolicyArgument, ResetOption
from mishandle.scenarios.lines import Disturbed
from mishandle.scenarios.requests import EarlyStop, Request
from mishandle.scenarios.values import all_numbers, idle_action, one_number
from mishandle.systems.environments import EnvironmentSystem, PolicySystem, Time, complete
from mishandle.systems.interface import Outcome, System
from mishandle.systems.reductions import Reduced


_MOVES = 10
"""Largest number of control steps until the observations of all rows have changed."""


def environment_system(
    environment: Any, policy: Any, space: Sequence[Axis], **options: Any
) -> System:
    """Returns the system of an environment or a vector environment."""
    if isinstance(environment, VectorEnv) and not isinstance(environment, SyncVectorEnv):
        return VectorSystem(environment, policy, space, **options)
    return EnvironmentSystem(environment, policy, space, **options)


class VectorSystem(PolicySystem):
    """A vector environment whose sub-environments are in other processes or in native code.

    Scenarios pass through the options of one reset per sub-environment, with Gymnasium's option
    ``"reset_mask"``. Attributes of an ``AsyncVectorEnv`` are set by ``set_attr``. Signals come from
    observations, ``info`` and the reward.
    """

    def __init__(
        self, environment: Any, policy: Any, space: Sequence[Axis], **options: Any
    ) -> None:
        super().__init__(environment, policy, space, **options)
        self._rows: int = environment.num_envs
        self.idle = idle_action(environment.single_action_space)
        self._mode = AutoresetMode(
            environment.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP)
        )
        # After a reset in the same step, the last state of an episode cannot be drawn.
        self.has_pictures = (
            environment.render_mode == "rgb_array" and self._mode is not AutoresetMode.SAME_STEP
        )
        # A row that ended in the last step would restart in the next one, also after a reset in
        # some versions of Gymnasium.
        self._restarts = False
        # A row that was never reset has no observation for a masked reset of another row.
        self._is_new = True
        self._check_sources()
        self._check_axes()
        self._check_masks()

    def __getstate__(self) -> Any:
        raise InvalidTypeError(
            "a vector environment cannot be sent to a cluster, which runs many environments "
            "itself; pass a single environment"
        )

    def _check_sources(self) -> None:
        kind = type(self._environment.unwrapped).__name__
        for given, (name, _) in zip(self.sources, self.signals):
            source = given.source if isinstance(given, Reduced) else given
            if callable(source) or not (source == "reward" or source.startswith(("obs", "info."))):
                text = "a function" if callable(source) else repr(source)
                raise InvalidValueError(
                    f"the source of the signal `{name}` is {text}, but the sub-environments of a "
                    f"{kind} are out of reach; use 'obs[...]', 'info....' or 'reward', or a "
                    "SyncVectorEnv"
                )

    def _check_axes(self) -> None:
        kind = type(self._environment.unwrapped).__name__
        # Setting an unknown attribute would create it.
        vector = self._environment.unwrapped
        one = vector.env_fns[0]() if isinstance(vector, AsyncVectorEnv) else None
        for axis in self.space.values():
            if (
                axis.apply is None
                or isinstance(axis.apply, (ResetOption, FaultParameter, PolicyArgument))
            ):
                continue
            if not isinstance(axis.apply, Attribute) or one is None:
                text = "an attribute" if isinstance(axis.apply, Attribute) else "a function"
                raise InvalidValueError(
                    f"the axis `{axis.name}` is applied by {text}, but the sub-environments of a "
                    f"{kind} are out of reach; use a reset option, or a SyncVectorEnv"
                )
            if not axis.apply.path.isidentifier():
                raise InvalidValueError(
                    f"the axis `{axis.name}` sets {axis.apply.path!r}, but a {kind} can set whole "
                    "attributes only; use a reset option, or a SyncVectorEnv"
                )
            if not one.has_wrapper_attr(axis.apply.path):
                raise InvalidValueError(
                    f"the environment has no attribute {axis.apply.path!r}, which the axis "
                    f"`{axis.name}` sets"
                )
        if one is not None:
            one.close()

    def _check_masks(self) -> None:
        """Checks that a reset with a mask leaves the other rows alone. Otherwise scenarios would be
        mixed up silently."""
        if self._rows == 1:
            return
        environment = self._environment

        def rows(batched: Any) -> list[NDArray[Any]]:
            return [
                np.copy(all_numbers(row)) for row in iterate(environment.observation_space, batched)
            ]

        def same(one: NDArray[Any], other: NDArray[Any]) -> bool:
            return np.array_equal(one, other, equal_nan=True)

        first = before = rows(environment.reset(seed=0)[0])
        environment.action_space.seed(0)
        for _ in range(_MOVES):
            before = rows(environment.step(environment.action_space.sample())[0])
            if not any(map(same, before, first)):
                break
        after = rows(environment.reset(options={"reset_mask": np.arange(self._rows) == 0})[0])
        if not all(map(same, before[1:], after[1:])):
            raise InvalidTypeError(
                f"{type(environment).__name__} ignores the option 'reset_mask' of reset, so its "
                "sub-environments cannot get different scenarios; use num_envs=1, a SyncVectorEnv "
                "or an AsyncVectorEnv"
            )

    def simulate(self, batch: Sequence[Request]) -> list[Outcome]:
        chunks = [batch[first : first + self._rows] for first in range(0, len(batch), self._rows)]
        paths = [
            axis.apply.path for axis in self.space.values() if isinstance(axis.apply, Attribute)
        ]
        before = {path: self._environment.unwrapped.get_attr(path) for path in paths}
        try:
            return [
                outcome for chunk in chunks for part in self.faults.start_all(chunk)
                for outcome in self._guarded(*part)
            ]
        finally:
            self._restore(before)

    def _restore(self, attributes: Mapping[str, Sequence[Any]]) -> None:
        """Sets attributes to what they were. A call that Ctrl-C interrupted leaves processes that
        take no others."""
        try:
            for path, values in attributes.items():
                self._environment.unwrapped.set_attr(path, list(values))
        except Exception:
            self._revive()
            for path, values in attributes.items():
                self._environment.unwrapped.set_attr(path, list(values))

    def _guarded(
        self, chunk: Sequence[Request], faults: Sequence[Disturbed | None]
    ) -> list[Outcome]:
        """Simulates together, or one by one if that fails, so that one scenario cannot spoil the
        others."""
        reason = ""
        try:
            return self._together(chunk, faults)
        except InvalidScenario as error:
            end, reason = "invalid scenario", str(error)
        except TimeLimitExceeded:
            end = "timed out"
        except Exception:
            end = "crashed"
            if len(chunk) == 1:
                reason = self.keep_exception()
        self._revive()
        if len(chunk) > 1:
            return [
                outcome for one in chunk
                for outcome in self._guarded([one], [self.faults.start(one.scenario, one.seed)])
            ]
        return [Outcome(end, np.zeros((0, len(self.signals))), 0, reason=reason)]

    def _revive(self) -> None:
        """Starts new processes: an exception or a time limit leaves those of an ``AsyncVectorEnv``
        unusable."""
        old = self._environment.unwrapped
        if not isinstance(old, AsyncVectorEnv):
            return
        old.close_extras(terminate=True)
        fresh = AsyncVectorEnv(
            old.env_fns, shared_memory=old.shared_memory, context=old.context, daemon=old.daemon,
            worker=old.worker, observation_mode=old.observation_mode, autoreset_mode=self._mode
        )
        fresh.spec = old.spec
        # The caller's object gets the new processes, so that it stays usable.
        old.__dict__, fresh.__dict__ = fresh.__dict__, {}
        self._restarts, self._is_new = False, True

    def _together(
        self, chunk: Sequence[Request], faults: Sequence[Disturbed | None]
    ) -> list[Outcome]:
        count = len(chunk)
        clock = Time()
        rollout = _Rollout(self, chunk)
        # The other rows repeat the last scenario; their results are dropped.
        padded = [*chunk, *[chunk[-1]] * (self._rows - count)]
        with self._timed(clock, count):
            batched, info = self._reset(padded)
            batched, info, ended = self._settled(batched, info)
            rows = list(iterate(self._environment.observation_space, batched))
        rollout.start(rows, info)
        for row in range(count):
            if ended[row] or self.starts.is_invalid(rows[row], row_info(info[row], row)):
                rollout.end(row, "invalid scenario", 0)
        self._draw(0)
        batch = Rows(
            [each.scenario for each in padded], self._environment.render,
            lambda row: row in rollout.running()
        )
        start(self.policy, self.arguments, batch)
        space = self._environment.single_action_space
        disturbed = [*faults, *[None] * (self._rows - count)]
        idle = self.idle
        for step in range(1, self.steps + 1):
            running = rollout.running()
            if not running:
                break
            seen = [
                row if each is None else each.observe(step - 1, row)
                for row, each in zip(rows, disturbed)
            ]
            if all(each is not None and each.is_paused(step - 1) for each in faults):
                actions: list[Any] = [idle] * self._rows
            else:
                failure, given = self.act(seen, [clock])
                if failure is not None:
                    rollout.end_all(*failure, step)
                    break
                actions = [given[row] for row in range(self._rows)]
            for row, each in enumerate(disturbed):
                if each is not None:
                    actions[row] = each.answer(step - 1, actions[row], idle)
                bad = np.flatnonzero(
                    ~np.isfinite(np.asarray(all_numbers(actions[row]), dtype=np.float64))
                )
                if len(bad) > 0:
                    actions[row] = idle
                    rollout.end(row, "invalid action", step, int(bad[0]))
                elif each is not None:
                    actions[row] = each.act(step - 1, actions[row])
            joint: Any = create_empty_array(space, self._rows)
            joint = concatenate(space, actions, joint)
            with self._timed(clock, len(running)):
                batched, rewards, terminated, truncated, info = self._environment.step(joint)
                ended = np.asarray(terminated) | np.asarray(truncated)
                rows = list(iterate(self._environment.observation_space, batched))
            self._restarts = bool(ended.any())
            self._draw(step)
            last = list(rows)
            if self._mode is AutoresetMode.SAME_STEP and ended.any():
                for row in np.flatnonzero(ended).tolist():
                    last[row] = info["final_obs"][row]
            rollout.step(step, last, info, np.asarray(rewards, dtype=np.float64), ended, self._mode)
            if self._mode is AutoresetMode.DISABLED and ended.any():
                batched, _ = self._environment.reset(options={"reset_mask": ended})
                rows = list(iterate(self._environment.observation_space, batched))
        return rollout.outcomes()

    def _draw(self, sample: int) -> None:
        """Draws a sample of the first row if a report asks for it."""
        if self.recording is not None:
            self.recording.add(sample, lambda: self._environment.render()[0])

    @contextmanager
    def _timed(self, clock: Time, rows: int) -> Iterator[None]:
        """Limits a block to the rest of the time of ``rows`` simulations together, and adds its
        time to their clock."""
        started = time.perf_counter()
        try:
            with limited(None if self.time_limit is None else clock.left(self.time_limit) * rows):
                yield
        finally:
            clock.spent += (time.perf_counter() - started) / rows

    def _reset(self, requests: Sequence[Request]) -> tuple[Any, list[Mapping[str, Any]]]:
        """Resets each row to its scenario; returns the observations and the ``info`` of each row's
        own reset."""
        environment = self._environment
        if self._is_new:
            environment.reset(seed=0)
            self._is_new = False
        if self._restarts and self._mode is AutoresetMode.NEXT_STEP:
            environment.step(environment.action_space.sample())
        self._restarts = False
        for axis in self.space.values():
            if isinstance(axis.apply, Attribute):
                environment.unwrapped.set_attr(
                    axis.apply.path, [each.scenario[axis.name] for each in requests]
                )
        observations: Any = None
        infos: list[Mapping[str, Any]] = []
        for row, request in enumerate(requests):
            options = Applications(self.space, request.scenario).options()
            if self._rows > 1:
                options["reset_mask"] = np.arange(self._rows) == row
            seeds: list[int | None] = [None] * self._rows
            seeds[row] = environment_seed(request.seed)
            observations, info = environment.reset(seed=seeds, options=options)
            infos.append(info)
        return observations, infos


    def _settled(
        self, observations: Any, infos: list[Mapping[str, Any]]
    ) -> tuple[Any, list[Mapping[str, Any]], NDArray[np.bool_]]:
        """Lets all rows settle after their resets. Returns observations, the ``info`` of each row,
        and whether its episode ended."""
        ended = np.zeros(self._rows, dtype=bool)
        if self.starts.steps == 0:
            return observations, infos, ended
        space = self._environment.single_action_space
        joint: Any = create_empty_array(space, self._rows)
        joint = concatenate(space, [self.starts.action] * self._rows, joint)
        for _ in range(self.starts.steps):
            observations, _, terminated, truncated, info = self._environment.step(joint)
            infos = [info] * self._rows
            last = np.asarray(terminated) | np.asarray(truncated)
            ended |= last
            self._restarts = bool(last.any())
            if self._mode is AutoresetMode.DISABLED and last.any():
                observations, _ = self._environment.reset(options={"reset_mask": last})
        return observations, infos, ended


class _Rollout:
    """The simulations of the first rows of a vector environment."""

    def __init__(self, system: VectorSystem, chunk: Sequence[Request]) -> None:
        count = len(chunk)
        self._system = system
        self._stops = [
            EarlyStop(each.stop, system.signals, system.control_dt, system.steps) for each in chunk
        ]
        self._samples: list[list[list[float]]] = [[] for _ in range(count)]
        self._late: list[list[int]] = [[] for _ in range(count)]
        self._ends: list[Outcome | None] = [None] * count
        self._steps = [0] * count
        self._returns = [0.0] * count

    def running(self) -> list[int]:
        return [row for row, end in enumerate(self._ends) if end is None]

    def end(self, row: int, end: str, step: int, index: int = 0, reason: str = "") -> None:
        if row < len(self._ends) and self._ends[row] is None:
            self._ends[row] = Outcome(
                end, np.zeros((0, 0)), self._steps[row], step, index, reason=reason
            )

    def end_all(self, end: str, reason: str, step: int) -> None:
        for row in self.running():
            self.end(row, end, step, reason=reason)

    def start(self, observations: Sequence[Any], infos: Sequence[Mapping[str, Any]]) -> None:
        """Adds the first sample of each row, with the ``info`` of its reset."""
        for row, samples in enumerate(self._samples):
            sample, self._late[row] = self._system.first_sample(
                None, observations[row], row_info(infos[row], row)
            )
            samples.append(sample)

    def add(self, observation: Any, info: Mapping[str, Any], reward: float, row: int) -> None:
        """Adds a sample of a row after a step."""
        self._samples[row].append(
            self._system.sample(None, observation, row_info(info, row), reward)
        )
        if self._late[row]:
            complete(self._samples[row], self._late[row])
            self._late[row] = []

    def step(
        self, step: int, observations: Sequence[Any], info: Mapping[str, Any],
        rewards: NDArray[np.float64], ended: NDArray[np.bool_], mode: AutoresetMode
    ) -> None:
        for row in self.running():
            is_final = mode is AutoresetMode.SAME_STEP and ended[row]
            found = info["final_info"] if is_final and "final_info" in info else info
            reward = one_number(rewards[row])
            self.add(observations[row], found, reward, row)
            self._steps[row] = step
            self._returns[row] += reward
            if not math.isfinite(reward):
                self.end(row, "invalid reward", step)
            elif step == self._system.steps:
                self.end(row, "completed", step)
            elif ended[row]:
                self.end(row, "terminated", step)
            elif self._stops[row].may_stop(self._samples[row]):
                self.end(row, "stopped", step)

    def outcomes(self) -> list[Outcome]:
        found = []
        for row, end in enumerate(self._ends):
            outcome = end or Outcome("completed", np.zeros((0, 0)), self._steps[row])
            # Without a step, the first sample lacks values.
            outcome.samples = np.asarray(
                [] if self._late[row] else self._samples[row], dtype=np.float64
            ).reshape(-1, len(self._system.signals))
            outcome.total_reward = self._returns[row]
            found.append(outcome)
        return found


def row_info(info: Mapping[str, Any], row: int) -> dict[str, Any]:
    """Returns the ``info`` of one sub-environment. Gymnasium marks present values in an array with
    an underscore.

    >>> info = {
    ...     "speed": np.array([1.0, 2.0]), "_speed": np.array([False, True]),
    ...     "part": {"x": np.array([3, 4])}
    ... }
    >>> row_info(info, 0), row_info(info, 1)
    ({'part': {'x': 3}}, {'speed': 2.0, 'part': {'x': 4}})
    """
    found: dict[str, Any] = {}
    for key, value in info.items():
        present = info.get(f"_{key}")
        if key.startswith("_") or (present is not None and not present[row]):
            continue
        if isinstance(value, Mapping):
            found[key] = row_info(value, row)
        elif value is not None and len(value) > row:
            one = value[row]
            found[key] = one.item() if isinstance(one, np.generic) else one
    return found
