"""The tasks as Gymnasium environments."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.errors import InvalidStateError, InvalidValueError
from mishandle.scenarios.arguments import checked_cameras, checked_size
from mishandle.scenarios.axes import Axis
from mishandle.systems.image_axes import OF_SCENES

Floats = NDArray[np.float32]

TASKS = {
    "mishandle/PointReaching-v0": "point-reaching",
    "mishandle/CubeStacking-v0": "cube-stacking",
    "mishandle/PegInHole-v0": "peg-in-hole",
    "mishandle/BallBalancing-v0": "ball-balancing",
    "mishandle/BallCatching-v0": "ball-catching",
    "mishandle/BallPushing-v0": "ball-pushing",
    "mishandle/DoorOpening-v0": "door-opening",
    "mishandle/ClothPlacing-v0": "cloth-placing",
}
"""Name of the task of each registered environment."""


class _Simulations:
    """Simulations of one task with a random generator for each row."""

    def __init__(self, task: str, rows: int, preset: str, reward: str, threads: int | None) -> None:
        self.settings = (task, preset, reward)
        self.native = _native.Simulator(task, rows, preset=preset, reward=reward, threads=threads)
        self.rows = rows
        self.axes = [name for name, *_ in self.native.axes]
        self.signals = [name for name, _ in self.native.signals]
        self.reward_terms = self.native.reward_terms
        size = self.native.observation_size
        self.observation_space = Box(-np.inf, np.inf, (size,), np.float32)
        self.action_space = Box(-1.0, 1.0, (self.native.action_size,), np.float32)

    def scenario(self, given: Mapping[str, float] | Sequence[float] | None) -> NDArray[np.float64]:
        """Returns a scenario as numbers. NaN is a random value."""
        values = np.full(len(self.axes), np.nan)
        if given is None:
            return values
        if not isinstance(given, Mapping):
            if len(given) != len(self.axes):
                raise InvalidValueError(
                    f"the scenario has {len(given)} values; expected {len(self.axes)}: "
                    f"{', '.join(self.axes)}"
                )
            values[:] = given
            return values
        for name, value in given.items():
            if name not in self.axes:
                raise InvalidValueError(
                    f"there is no axis `{name}`; the axes are {', '.join(self.axes)}"
                )
            values[self.axes.index(name)] = value
        return values


class _Eyes:
    """The cameras of a task in its observation."""

    def __init__(self, task: str, names: Sequence[str], size: tuple[int, int]) -> None:
        self._names = checked_cameras(names)
        width, height = checked_size("image_size", size)
        self._native = _native.TaskCameras(task, self._names, width, height)
        self.spaces = {name: Box(0, 255, (height, width, 3), np.uint8) for name in self._names}
        self.axes = [
            (space, axis) for space, axis in json.loads(_native.task_sight_axes(task))
            if space.rpartition("-")[0] in OF_SCENES
        ]
        self._known = {axis["name"]: Axis.from_document(axis) for _, axis in self.axes}

    def start(self, state: NDArray[np.float64], given: Mapping[str, Any], seed: int) -> None:
        for name in given:
            if name not in self._known:
                raise InvalidValueError(
                    f"there is no axis of sight `{name}`; the axes are {', '.join(self._known)}"
                )
        self._native.start(
            state, {name: self._known[name].number(value) for name, value in given.items()}, seed
        )

    def images(self, state: NDArray[np.float64]) -> dict[str, NDArray[np.uint8]]:
        return dict(zip(self._names, self._native.images(state)))


class TaskEnv(gymnasium.Env[Any, Floats]):
    """One of the eight tasks.

    Parameters
    ----------
    task : str
        Name of the task, such as ``"point-reaching"``.
    preset : str
        Task preset: ``"paper"`` or ``"code"``.
    reward : str
        ``"shaped"`` or ``"original"``.
    render_mode : str, optional
        ``"rgb_array"``: :meth:`render` returns a picture. It needs EGL (on Debian and Ubuntu: ``apt
        install libegl1 libgl1-mesa-dri``), but no display and no GPU.
    width, height : int
        Size of a picture in pixels, both even.
    cameras : sequence of str
        Cameras in the observation: ``"over"`` the table, ``"wrist"``. The observation is then a
        dictionary with ``"state"`` and an image of each camera, bytes of the shape (height, width,
        3). They need no EGL and have the same bytes on every machine.
    image_size : tuple of int
        Width and height of these images, pixels.

    Notes
    -----
    ``options={"sight": {"lamp_strength": 0.3}}`` of a reset sets axes of sight, which
    :func:`mishandle.sight` returns. Actions change the targets of seven joints and two fingers;
    each is clipped to [-1, 1]. A reset draws the initial state with ``seed``;
    ``options={"scenario": {"target_x": 0.5}}`` sets some or all of its axes. ``info`` contains the
    dictionaries ``signals`` and ``reward_terms``. Gymnasium's wrapper ``TimeLimit`` truncates the
    episode.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 60}

    def __init__(
        self, task: str, *, preset: str = "paper", reward: str = "shaped",
        render_mode: str | None = None, width: int = 640, height: int = 480,
        cameras: Sequence[str] = (), image_size: tuple[int, int] = (64, 64)
    ) -> None:
        self.render_mode = _checked_render_mode(render_mode)
        self._size = (width, height)
        self._simulations = _Simulations(task, 1, preset, reward, 1)
        self.observation_space: Any = self._simulations.observation_space
        self.action_space = self._simulations.action_space
        self._eyes = _Eyes(task, cameras, image_size) if cameras else None
        if self._eyes is not None:
            self.observation_space = Dict({"state": self.observation_space, **self._eyes.spaces})

    @property
    def sight_axes(self) -> list[tuple[str, Any]]:
        """The axes of sight that a reset sets by the option ``"sight"``, each with the name of its
        space; none without cameras."""
        return [] if self._eyes is None else self._eyes.axes

    @property
    def dt(self) -> float:
        """Duration of a control step, in seconds."""
        return self._simulations.native.control_dt

    @property
    def max_episode_steps(self) -> int:
        """Number of control steps of an episode."""
        return self._simulations.native.episode_steps

    @property
    def fault_layouts(self) -> list[_native.Layout]:
        """The channels of observation and action that :func:`mishandle.faults` uses, and their
        ranges."""
        return self._simulations.native.fault_layouts

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        scenario = self._simulations.scenario((options or {}).get("scenario"))
        seeds = self.np_random.integers(2**63, size=1, dtype=np.uint64)
        samples = self._simulations.native.reset(np.ones(1, dtype=bool), seeds, scenario[None])
        given = (options or {}).get("sight", {})
        if self._eyes is not None:
            self._eyes.start(self._simulations.native.state(0), given, int(seeds[0]))
        elif given:
            raise InvalidValueError(
                "the option `sight` has no effect without cameras; make the environment with "
                "cameras=['over', 'wrist']"
            )
        return self._observation(samples), self._info(samples)

    def _observation(self, samples: _native.Samples) -> Any:
        state = samples[0][0]
        return (
            state if self._eyes is None
            else {"state": state, **self._eyes.images(self._simulations.native.state(0))}
        )

    def step(self, action: Floats) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        actions = np.asarray(action, dtype=np.float32).reshape(1, -1)
        samples = self._simulations.native.step(actions)
        return self._observation(samples), float(samples[1][0].sum()), bool(
            samples[3][0]
        ), False, self._info(samples)

    def render(self) -> Any:
        """Returns a picture of the current state: bytes of the shape (height, width, 3). The camera
        does not move."""
        _check_rendering(self.render_mode)
        return self._simulations.native.render([0], *self._size)[0]

    def _info(self, samples: _native.Samples) -> dict[str, Any]:
        return {
            "signals": dict(zip(self._simulations.signals, samples[2][0].tolist())),
            "reward_terms": dict(zip(self._simulations.reward_terms, samples[1][0].tolist())),
        }


class TaskVectorEnv(gymnasium.vector.VectorEnv[Floats, Floats, NDArray[Any]]):
    """Environments of one task, stepped together by all threads.

    Parameters
    ----------
    task : str
        Name of the task, such as ``"point-reaching"``.
    num_envs : int
        Number of environments.
    preset, reward : str
        As for :class:`TaskEnv`.
    max_episode_steps : int, optional
        Control steps until truncation; by default the episode length of the task.
    autoreset_mode : AutoresetMode
        ``NEXT_STEP`` (the default) or ``SAME_STEP``.
    copy : bool
        Whether each step and each reset returns new arrays, as in Gymnasium's vector environments.
        With ``False``, all return the same arrays with new contents, so that no memory is
        allocated; copy what must survive the next step.
    threads : int, optional
        Number of threads, by default the number of cores. Results do not depend on it.
    render_mode, width, height
        As for :class:`TaskEnv`; :meth:`render` returns a tuple with a picture of each environment.

    Notes
    -----
    ``reset`` takes one seed, or one per environment, and ``options`` with ``"scenario"`` (one, or
    one per environment) and Gymnasium's ``"reset_mask"``. ``info["signals"]`` and
    ``info["reward_terms"]`` contain an array per name. Rust writes all results straight into the
    memory of the arrays, with and without ``copy``.

    Examples
    --------
    >>> env = TaskVectorEnv("point-reaching", 4, copy=False)
    >>> first, _ = env.reset(seed=0)
    >>> second, rewards, terminated, truncated, info = env.step(np.zeros((4, 9), np.float32))
    >>> second is first, info["signals"]["finger_target_distance"].shape
    (True, (4,))
    """

    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array"], "render_fps": 60, "autoreset_mode": AutoresetMode.NEXT_STEP
    }

    def __init__(
        self, task: str, num_envs: int = 1, *, preset: str = "paper", reward: str = "shaped",
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, copy: bool = True,
        threads: int | None = None, render_mode: str | None = None, width: int = 640,
        height: int = 480
    ) -> None:
        self.render_mode = _checked_render_mode(render_mode)
        self._size = (width, height)
        mode = AutoresetMode(autoreset_mode)
        if mode is AutoresetMode.DISABLED:
            raise InvalidValueError("the autoreset mode must be NEXT_STEP or SAME_STEP")
        self._simulations = _Simulations(task, num_envs, preset, reward, threads)
        native = self._simulations.native
        self.num_envs = num_envs
        self.metadata = {**self.metadata, "autoreset_mode": mode}
        self._same_step = mode is AutoresetMode.SAME_STEP
        self._limit = native.episode_steps if max_episode_steps is None else max_episode_steps
        self.single_observation_space = self._simulations.observation_space
        self.single_action_space = self._simulations.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators = [np.random.default_rng() for _ in range(num_envs)]
        self._seeds = np.zeros(num_envs, dtype=np.uint64)
        self._elapsed = np.zeros(num_envs, dtype=np.int64)
        self._ended = np.zeros(num_envs, dtype=bool)
        self._copy = copy
        self._samples = native.arrays()
        self._rewards = np.zeros(num_envs)
        self._truncated = np.zeros(num_envs, dtype=bool)
        self._random = np.full((num_envs, len(self._simulations.axes)), np.nan)

    @property
    def dt(self) -> float:
        """Duration of a control step, in seconds."""
        return self._simulations.native.control_dt

    @property
    def max_episode_steps(self) -> int:
        """Number of control steps until truncation."""
        return self._limit

    @property
    def fault_layouts(self) -> list[_native.Layout]:
        """The channels of observation and action of one environment that :func:`mishandle.faults`
        uses, and their ranges."""
        return self._simulations.native.fault_layouts

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        options = options or {}
        # A copy, because the mask can be an array that the reset writes.
        mask = np.array(options.get("reset_mask", np.ones(self.num_envs, dtype=bool)), dtype=bool)
        if seed is None or isinstance(seed, (int, np.integer)):
            seeds: list[int | None] = [
                None if seed is None else int(seed) + row for row in range(self.num_envs)
            ]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise InvalidValueError(
                f"there are {len(seeds)} seeds for {self.num_envs} environments"
            )
        for row, value in enumerate(seeds):
            if value is not None and mask[row]:
                self._generators[row], _ = np_random(value)
        scenarios = self._scenarios(options.get("scenario"))
        if self._copy:
            observations, terms, signals, terminated, diverged = self._samples
            self._samples = (
                observations.copy(), terms.copy(), signals.copy(), terminated.copy(),
                diverged.copy()
            )
        self._ended[mask] = False
        self._start(mask, scenarios)
        return self._samples[0], self._info(self._samples)

    def _scenarios(self, given: Any) -> NDArray[np.float64]:
        if given is None or isinstance(given, Mapping):
            return np.tile(self._simulations.scenario(given), (self.num_envs, 1))
        given = list(given)
        if given and not isinstance(given[0], (Mapping, Sequence, np.ndarray, type(None))):
            return np.tile(self._simulations.scenario(given), (self.num_envs, 1))
        if len(given) != self.num_envs:
            raise InvalidValueError(
                f"there are {len(given)} scenarios for {self.num_envs} environments"
            )
        return np.stack([self._simulations.scenario(one) for one in given])

    def _start(self, mask: NDArray[np.bool_], scenarios: NDArray[np.float64]) -> None:
        """Starts an episode in some rows, in the arrays of the last step."""
        for row in np.flatnonzero(mask):
            self._seeds[row] = self._generators[row].integers(2**63, dtype=np.uint64)
        self._elapsed[mask] = 0
        self._simulations.native.reset(mask, self._seeds, scenarios, self._samples)

    def step(
        self, actions: Floats
    ) -> tuple[Floats, NDArray[Any], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        native, before = self._simulations.native, self._samples
        actions = np.asarray(actions, dtype=np.float32)
        samples = native.step(actions, native.arrays() if self._copy else before)
        observations, terms, signals, terminated, diverged = samples
        if self._copy:
            self._rewards, self._truncated = np.empty(self.num_envs), np.empty(
                self.num_envs, dtype=bool
            )
            if diverged.any():
                # The others were written by the step.
                observations[diverged], signals[diverged] = before[0][diverged], before[2][diverged]
        self._samples, rewards, truncated, restarted = (
            samples, self._rewards, self._truncated, self._ended
        )
        np.add.reduce(terms, axis=1, out=rewards)
        self._elapsed += 1
        np.greater_equal(self._elapsed, self._limit, out=truncated)
        np.greater(truncated, terminated, out=truncated)
        if restarted.any():
            # Their step counts as the reset: its action has no effect, its reward is 0.
            self._start(restarted, self._random)
            rewards[restarted] = 0.0
            truncated[restarted] = False
        ended = terminated | truncated
        if not self._same_step:
            self._ended = ended
            return observations, rewards, terminated, truncated, self._info(samples)
        if not ended.any():
            return observations, rewards, terminated, truncated, self._info(samples)
        final_info = self._info((observations, terms.copy(), signals.copy(), terminated, diverged))
        final_observations = np.full(self.num_envs, None, dtype=object)
        for row in np.flatnonzero(ended).tolist():
            final_observations[row] = observations[row].copy()
        ends = terminated.copy()
        self._start(ended, self._random)
        terminated[:] = ends
        info = self._info(samples)
        info["final_obs"] = final_observations
        info["_final_obs"] = ended
        info["final_info"] = final_info
        info["_final_info"] = ended
        return observations, rewards, terminated, truncated, info

    def render(self) -> tuple[Any, ...]:
        """Returns a picture of each environment: bytes of the shape (height, width, 3)."""
        _check_rendering(self.render_mode)
        return tuple(self._simulations.native.render(list(range(self.num_envs)), *self._size))

    def _info(self, samples: _native.Samples) -> dict[str, Any]:
        # Rows of the transposed arrays are views of columns.
        return {
            "signals": dict(zip(self._simulations.signals, samples[2].T)),
            "reward_terms": dict(zip(self._simulations.reward_terms, samples[1].T)),
        }


def _checked_render_mode(mode: str | None) -> str | None:
    if mode not in (None, "rgb_array"):
        raise InvalidValueError(
            f"the render mode {mode!r} is not supported; it must be 'rgb_array' or None"
        )
    return mode


def _check_rendering(mode: str | None) -> None:
    if mode is None:
        raise InvalidStateError(
            "the environment does not render; make it with render_mode='rgb_array'"
        )


def register() -> None:
    """Registers the environments with Gymnasium. Importing ``mishandle`` does so, too."""
    for name, task in TASKS.items():
        if name in gymnasium.registry:
            continue
        gymnasium.register(
            name, entry_point="mishandle.systems.task_environments:TaskEnv",
            vector_entry_point="mishandle.systems.task_environments:TaskVectorEnv",
            max_episode_steps=300, kwargs={"task": task}
        )
