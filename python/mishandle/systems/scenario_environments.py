"""Environments that draw a scenario at each reset, to train a policy on the axes with which it was
falsified."""

import os
import secrets
from collections.abc import Mapping, Sequence
from typing import Any, Union

import gymnasium

import mishandle._native as _native
from mishandle.base.files import PathLike
from mishandle.errors import InvalidScenario, InvalidStateError, InvalidTypeError, InvalidValueError
from mishandle.scenarios.applications import Applications, environment_seed
from mishandle.scenarios.arguments import (
    check_number, check_period, check_space, check_steps, is_real, scenario_numbers
)
from mishandle.scenarios.attributes import Attributes
from mishandle.scenarios.axes import (
    Attribute, Axis, FaultParameter, PolicyArgument, ResetOption, Value, axes_document
)
from mishandle.scenarios.lines import Disturbed, FaultLine
from mishandle.scenarios.values import idle_action
from mishandle.systems.environments import control_period, episode_steps, first_not_finite
from mishandle.systems.starts import Invalid, Settle, Starts

Archive = Union[PathLike, Sequence[PathLike], None]

_ATTEMPTS = 100
"""Largest number of draws until the environment accepts a scenario."""


class ScenarioEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """A Gymnasium environment whose episodes have random scenarios, to train a policy with any
    library.

    Each reset draws a scenario and applies it as an evaluation does: the same axes, distributions,
    attributes, options of the reset, functions and faults. ``docs/guide/harden.md`` shows how to
    harden a policy with it.

    Parameters
    ----------
    env : gymnasium.Env
        The environment. Wrap each sub-environment of a vector environment.
    space : sequence of Axis
        Axes of the scenarios, as for :func:`falsify`, with those of :func:`faults`. Faults that
        show NaN to the policy are not drawn, because no policy can learn from NaN.
    archive : path or sequence of paths, optional
        Files with failures: run files, and counterexample files (``.json``) or folders of them.
        Their axes must be those of ``space``. All failure modes of run files have the same weight;
        within a mode, the weight of a failure is inversely proportional to its rank by violation. A
        third of the weight is that of scenarios that passed, but least of all.
    archive_share, nominal, corners : float
        Shares of the episodes with a scenario of the archive (if there is one), as the environment
        is without a scenario, and at corners of the space: each axis at its lower or upper bound.
        The others are random scenarios of the space.
    seed : int, optional
        Random seed of the draws until a ``reset`` with a seed, which starts them again; by default
        a random one. Environments that train together need different seeds.
    steps, control_dt
        Of an episode, if ``space`` has faults: see :func:`falsify`.
    settle, invalid
        How an episode starts: see :func:`falsify`. Another scenario is drawn after an invalid
        start.

    Notes
    -----
    ``info`` of a reset has the drawn values as ``"scenario"``, and their ``"scenario_origin"``:
    ``"nominal"``, ``"corner"``, ``"archive"``, ``"random"`` or ``"given"``. ``reset(options={"at":
    {"speed": 30.0}})`` gives a scenario, in which other axes are nominal. With a seed, the episode
    has the trace of :func:`simulate` with this scenario, this seed and the same actions. Other
    options are passed on.

    A nominal episode sets no attribute, no option and no fault. Functions of axes get the nominal
    value, so that they undo what an earlier episode changed; ``"scenario"`` has these values only.
    Attributes have their own values again at each reset and after ``close``. A scenario that the
    environment refuses by :class:`InvalidScenario` is drawn again. While a fault pauses the policy,
    its actions have no effect.

    Examples
    --------
    >>> env = gymnasium.make("CartPole-v1")
    >>> space = [
    ...     Axis("length", 0.2, 1.5, "m", kind="model", nominal=0.5, apply=Attribute("length"))
    ... ]
    >>> env = ScenarioEnv(env, space, nominal=0.0, corners=0.0, seed=1)
    >>> _, info = env.reset()
    >>> info["scenario_origin"], info["scenario"]["length"] == env.unwrapped.length
    ('random', True)
    >>> _, info = env.reset(options={"at": {"length": 1.25}})
    >>> env.unwrapped.length
    1.25
    """

    draws_scenarios = True
    """Whether its resets draw scenarios, so that a question cannot give it one."""

    def __init__(
        self, env: gymnasium.Env[Any, Any], space: Sequence[Axis], archive: Archive = None, *,
        archive_share: float = 0.25, nominal: float = 0.25, corners: float = 0.1,
        seed: int | None = None, steps: int | None = None, control_dt: float | None = None,
        settle: Settle | None = None, invalid: Invalid | None = None
    ) -> None:
        if not isinstance(env, gymnasium.Env):
            is_vector = isinstance(env, gymnasium.vector.VectorEnv)
            hint = "; wrap each of its sub-environments" if is_vector else ""
            raise InvalidTypeError(f"a {type(env).__name__} is not a Gymnasium environment{hint}")
        super().__init__(env)
        self._space = {axis.name: axis for axis in _checked_space(space)}
        check_steps(steps)
        check_period(control_dt)
        if seed is not None:
            check_number("seed", seed, 0)
        paths = _paths(archive)
        shares = {
            "archive_share": archive_share if paths else 0.0, "nominal": nominal, "corners": corners
        }
        _check_shares(shares)
        # Absolute, because a copy in another process may have another working folder.
        archive_paths = [os.path.abspath(path) for path in paths]
        self._arguments = (nominal, corners, shares["archive_share"], archive_paths)
        self._make()
        self._starts = Starts(settle, invalid, env.action_space)
        is_faulty = any(isinstance(axis.apply, FaultParameter) for axis in space)
        dt = control_period(env) if control_dt is None else float(control_dt)
        limit = episode_steps(env, steps) if is_faulty else 0
        self._faults = FaultLine(list(space), dt, limit, (env.observation_space, env.action_space))
        self._idle = idle_action(env.action_space) if is_faulty else None
        self._nominal = {axis.name: axis.nominal_value for axis in space}
        self._seed = secrets.randbits(63) if seed is None else int(seed)
        self._episode = 0
        self._attributes = Attributes()
        self._disturbed: Disturbed | None = None
        self._step = 0

    def _make(self) -> None:
        nominal, corners, archived, archive = self._arguments
        self._scenarios = _native.Scenarios(
            axes_document(list(self._space.values())), nominal=float(nominal),
            corners=float(corners), archived=float(archived), archive=archive
        )

    def __getstate__(self) -> dict[str, Any]:
        if self._attributes.are_set or self._disturbed is not None:
            raise InvalidStateError(
                "an episode of a scenario is running; copy the environment before its first reset "
                "or after `close`"
            )
        # Objects of the extension module cannot be sent to other processes.
        return {
            name: value for name, value in self.__dict__.items()
            if name not in ("_scenarios", "_attributes")
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._attributes = Attributes()
        self._make()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        others = dict(options or {})
        at = others.pop("at", None)
        if seed is not None:
            self._seed, self._episode = int(seed), 0
        for _ in range(_ATTEMPTS):
            origin, drawn, own_seed = self._scenarios.draw(self._seed, self._episode)
            self._episode += 1
            if at is not None:
                origin, drawn = "given", self._scenarios.at(
                    scenario_numbers(list(self._space.values()), at)
                )
            try:
                return self._start(origin, {**self._nominal, **drawn}, (seed, own_seed), others)
            except InvalidScenario:
                if at is not None:
                    raise
        raise InvalidScenario(
            f"the environment refused {_ATTEMPTS} scenarios, one after the other; the last one is "
            f"{drawn}"
        )

    def _start(
        self, origin: str, scenario: dict[str, Value], seeds: tuple[int | None, int],
        others: Mapping[str, Any]
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode. ``seeds`` are that of the reset and one for the faults of a reset
        without a seed."""
        self._end()
        seed, own_seed = seeds
        is_nominal = origin == "nominal"
        if is_nominal:
            scenario = {name: value for name, value in scenario.items() if self._is_function(name)}
        applications = Applications(self._space, scenario)
        try:
            self._attributes.set(self.env.unwrapped, applications.attributes)
            start = applications.reset(
                self.env, None if seed is None else environment_seed(seed), others
            )
            observation, info = self._starts.settled(self.env, *start)
        except BaseException:
            self._end()
            raise
        if not is_nominal:
            self._disturbed = self._faults.start(scenario, own_seed if seed is None else seed)
        self._step = 0
        return self._observed(observation), {
            **info, "scenario": scenario, "scenario_origin": origin
        }

    def _is_function(self, name: str) -> bool:
        application = self._space[name].apply
        return (
            application is not None
            and not isinstance(
                application, (ResetOption, Attribute, FaultParameter, PolicyArgument)
            )
        )

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        if self._disturbed is None:
            return self.env.step(action)
        action = self._disturbed.answer(self._step, action, self._idle)
        index = first_not_finite(action)
        if index is not None:
            raise InvalidValueError(
                f"number {index} of the action is NaN or infinite, which a fault cannot disturb"
            )
        action = self._disturbed.act(self._step, action)
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._step += 1
        return self._observed(observation), reward, terminated, truncated, info

    def _observed(self, observation: Any) -> Any:
        return (
            observation if self._disturbed is None
            else self._disturbed.observe(self._step, observation)
        )

    def _end(self) -> None:
        """Restores what the scenario changed."""
        self._attributes.restore()
        self._disturbed = None

    def close(self) -> None:
        self._end()
        super().close()


def _checked_space(space: object) -> Sequence[Axis]:
    """Checks that a space is a list of axes that an environment can apply."""
    if isinstance(space, str):
        raise InvalidTypeError(
            f"the space {space!r} of a task also disturbs what lies between the task and its "
            "policy, which only this program's own policies have: pass a list of axes and "
            "mishandle.faults(env, delays=True), or train and harden one of our controllers with "
            "`mishandle train --space` and mishandle.harden"
        )
    if not isinstance(space, Sequence) or not all(isinstance(axis, Axis) for axis in space):
        raise InvalidTypeError('a space is a list of axes, such as [Axis("speed", 0, 10, "m/s")]')
    if not space:
        raise InvalidValueError("the space has no axes")
    check_space(space, True)
    return space


def _paths(archive: Archive) -> list[str]:
    """Returns the paths of an archive."""
    paths = [archive] if isinstance(archive, (str, os.PathLike)) else archive
    if paths is None:
        return []
    if (
        not isinstance(paths, Sequence)
        or not all(isinstance(path, (str, os.PathLike)) for path in paths)
    ):
        raise InvalidTypeError(
            f"archive is {archive!r}; expected the path of a run file or of a folder of "
            "counterexamples, or several"
        )
    return [os.fspath(path) for path in paths]


def _check_shares(shares: Mapping[str, object]) -> None:
    """Checks shares of episodes.

    >>> _check_shares({"nominal": 0.75, "corners": 0.5})  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    mishandle.errors.InvalidValueError: nominal + corners is 1.25; the shares of the episodes ...
    """
    total = 0.0
    for name, share in shares.items():
        if not is_real(share) or not 0.0 <= float(share) <= 1.0:
            raise InvalidValueError(f"{name} is {share!r}; it must be a number from 0 to 1")
        total += float(share)
    # The sum of decimal numbers may be rounded up.
    if total > 1.0 + 1e-9:
        raise InvalidValueError(
            f"{' + '.join(shares)} is {total:g}; the shares of the episodes must add up to at "
            "most 1"
        )
