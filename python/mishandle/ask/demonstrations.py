"""Demonstrations of a controller as data sets for imitation learning."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.files import PathLike
from mishandle.errors import InvalidTypeError
from mishandle.policies.guards import Guard, guard_text
from mishandle.runs.documents import read
from mishandle.runs.targets import TargetOptions, axis_settings, requirements as named_requirements
from mishandle.scenarios.arguments import (
    check_number, check_settings, checked_cameras, checked_size, is_real
)

RecordProgress = Callable[[int, int], None]


def record(
    system: PathLike,
    *,
    policy: PathLike | None = None,
    out: PathLike,
    episodes: int = 100,
    format: str = "lerobot",
    relabel: PathLike | None = None,
    cameras: Sequence[str] = (),
    size: tuple[int, int] = (64, 64),
    successful: bool = False,
    archive: PathLike | None = None,
    archive_share: float = 0.5,
    space: str = "starts",
    axes: Mapping[str, float | tuple[float, float] | str] | None = None,
    preset: str = "paper",
    requirements: Mapping[str, str] | None = None,
    stochastic: bool = False,
    action_noise: float = 0.0,
    observation_noise: float = 0.0,
    guard: Guard | PathLike | None = None,
    seed: int = 0,
    progress: RecordProgress | None = None,
) -> results.Demonstrations:
    """Records what a controller sees and does as a data set to train a policy on.

    The same as ``mishandle record``; ``docs/guide/record.md`` lists the columns. The scenarios are
    the random ones of :func:`evaluate` with the same target, space, seed and number of episodes, or
    failures of an archive.

    Parameters
    ----------
    system : str or path
        Name of a task, or path of a target file.
    policy : str or path, optional
        Controller that acts: ``"expert"`` or another shipped one, or a file. By default the policy
        of the target file.
    out : path
        Folder of the data set; it must not exist. It appears when it is complete.
    episodes : int
        Number of simulations.
    format : str
        ``"lerobot"`` (LeRobot data set, version 3.0) or ``"npz"`` (NumPy arrays in ``data.npz``).
    relabel : str or path, optional
        Controller whose action in each state is recorded, while ``policy`` acts (DAgger).
    cameras : sequence of str
        Cameras whose images are recorded: ``"over"`` and ``"wrist"`` for tasks, and those that a
        target file states.
    size : tuple of int
        Width and height of the images, pixels, each from 1 to 1024.
    successful : bool
        Whether to keep only episodes that satisfy the success formula.
    archive : path, optional
        Failures from which the share ``archive_share`` of the scenarios is drawn: the folder of
        those of a round of :func:`harden`, a run file, a counterexample, a folder of
        counterexamples, or a table (``.csv``).
    archive_share : float
        Share of the simulations with a scenario of the archive.
    space, axes, preset, requirements, stochastic, action_noise, observation_noise, guard
        As for a task in :func:`falsify`.
    seed : int
        Random seed.
    progress : callable, optional
        Gets the number of finished simulations and that of all after each batch. Its exceptions,
        and Ctrl-C, end the recording, and nothing is written.

    Raises
    ------
    MishandleError
        If a name or a number is invalid, or ``out`` exists.

    Examples
    --------
    >>> import tempfile
    >>> out = os.path.join(tempfile.mkdtemp(), "demonstrations")
    >>> found = record(
    ...     "point-reaching", policy="expert", out=out, episodes=2, format="npz", cameras=["over"],
    ...     size=(16, 16)
    ... )
    >>> found.episodes, found.frames
    (2, 600)
    """
    if not isinstance(system, (str, os.PathLike)):
        raise InvalidTypeError(
            f"a {type(system).__name__} is neither the name of a task nor the path of a target "
            "file, and only their controllers are recorded"
        )
    given = {} if axes is None else axes
    options: TargetOptions = {
        "axes": given, "requirements": {} if requirements is None else requirements
    }
    check_settings(given)
    check_number("episodes", episodes, 1)
    check_number("seed", seed, 0)
    cameras = checked_cameras(cameras)
    sides = checked_size("size", size)
    if not is_real(archive_share):
        raise InvalidTypeError(
            f"archive_share is {archive_share!r}; it must be a number from 0 to 1"
        )
    text = _native.record(
        os.fspath(system), "" if policy is None else os.fspath(policy), preset=preset, space=space,
        axes=axis_settings(options), noise=(stochastic, action_noise, observation_noise),
        guard=guard_text(guard), requirements=named_requirements(options), seed=int(seed),
        episodes=int(episodes), format=format,
        relabel=None if relabel is None else os.fspath(relabel), cameras=cameras, size=list(sides),
        only_successful=successful, archive=None if archive is None else os.fspath(archive),
        archive_share=float(archive_share), out=os.fspath(out), progress=progress
    )
    return read(results.Demonstrations, text)
