"""Demonstrations of a controller as data sets for imitation learning."""

from __future__ import annotations

import os
from collections.abc import Sequence

from typing_extensions import Unpack

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.documents import Call
from mishandle.base.files import PathLike
from mishandle.base.interruption import Progress
from mishandle.errors import InvalidTypeError
from mishandle.runs.documents import read
from mishandle.runs.targets import ControllerOptions, controller_text
from mishandle.scenarios.arguments import checked_cameras, checked_size, is_real


def record(
    system: PathLike,
    *,
    out: PathLike,
    space: str | None = None,
    episodes: int | None = None,
    format: str = "lerobot",
    relabel: PathLike | None = None,
    cameras: Sequence[str] = (),
    size: tuple[int, int] = (64, 64),
    successful: bool = False,
    archive: PathLike | None = None,
    archive_share: float = 0.5,
    seed: int | None = None,
    progress: Progress | None = None,
    **target: Unpack[ControllerOptions],
) -> results.Demonstrations:
    """Records what a controller sees and does as a data set to train a policy on.

    The same as ``mishandle record``; ``docs/guide/record.md`` lists the columns. The scenarios are
    the random ones of :func:`evaluate` with the same target, space, seed and number of episodes, or
    failures of an archive.

    Parameters
    ----------
    system : str or path
        Name of a task, or path of a target file.
    out : path
        Folder of the data set; it must not exist. It appears when it is complete.
    space, seed, progress, **target
        See :func:`falsify`. The ``policy`` is a controller, such as ``"expert"``.
    episodes : int
        Number of simulations (100).
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
    sides = checked_size("size", size)
    if not is_real(archive_share):
        raise InvalidTypeError(
            f"archive_share is {archive_share!r}; it must be a number from 0 to 1"
        )
    call = Call("record", target, {"seed": seed, "evaluate": {"episodes": episodes}})
    text = _native.record(
        controller_text(system, space, target, call), format=format,
        relabel=None if relabel is None else os.fspath(relabel), cameras=checked_cameras(cameras),
        size=list(sides), only_successful=successful,
        archive=None if archive is None else os.fspath(archive),
        archive_share=float(archive_share), out=os.fspath(out), progress=progress
    )
    return read(results.Demonstrations, text)
