"""Demonstrations of a controller as data sets for imitation learning."""

import os
from collections.abc import Sequence
from typing import Literal

from typing_extensions import Unpack

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.documents import Call
from mishandle.base.files import PathLike
from mishandle.base.interruption import Progress
from mishandle.base.progress import reporting
from mishandle.errors import InvalidTypeError
from mishandle.runs.documents import read
from mishandle.runs.targets import ControllerOptions, controller_text
from mishandle.scenarios.arguments import checked_cameras, checked_size


def record(
    system: PathLike,
    *,
    out: PathLike,
    space: str | None = None,
    episodes: int | None = None,
    cameras: Sequence[str] = (),
    size: tuple[int, int] = (64, 64),
    seed: int | None = None,
    progress: Progress | Literal[False] | None = None,
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
        See :func:`falsify`. The ``policy`` is a controller, such as ``"expert"``. The table
        ``record`` of ``plan`` has the ``format`` (``"lerobot"`` or ``"npz"``), a controller that
        relabels the actions (DAgger), and an archive of failures.
    episodes : int
        Number of simulations (100).
    cameras : sequence of str
        Cameras whose images are recorded: ``"over"`` and ``"wrist"`` for tasks, and those that a
        target file states.
    size : tuple of int
        Width and height of the images, pixels, each from 1 to 1024.

    Examples
    --------
    >>> import tempfile
    >>> out = os.path.join(tempfile.mkdtemp(), "demonstrations")
    >>> found = record(
    ...     "point-reaching", policy="expert", out=out, episodes=2, cameras=["over"], size=(16, 16),
    ...     plan={"record": {"format": "npz"}}
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
    given = {"camera": checked_cameras(cameras), "size": list(sides)}
    call = Call(
        "record", target, {"seed": seed, "evaluate": {"episodes": episodes}, "record": given}
    )
    with reporting(progress) as report:
        text = _native.record(
            controller_text(system, space, target, call), out=os.fspath(out), progress=report
        )
    return read(results.Demonstrations, text)
