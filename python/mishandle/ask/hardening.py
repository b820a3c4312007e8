"""A controller that fails less often, with evidence."""

import os
import pathlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from typing_extensions import Unpack

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.documents import Call
from mishandle.base.files import PathLike
from mishandle.base.progress import reporting
from mishandle.errors import InvalidTypeError, MishandleError
from mishandle.policies.servers import as_server
from mishandle.runs.documents import Reported, read
from mishandle.runs.printed import Printed
from mishandle.runs.targets import ControllerOptions, controller_text

HardenProgress = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True, repr=False)
class Hardening(Printed, Reported, results.Hardening):
    """A controller before and after a hardening."""

    @property
    def path(self) -> pathlib.Path:
        """The folder of all runs."""
        return pathlib.Path(self.folder)

    def _page(self, call: str) -> str:
        return _native.hardening_report(self.folder, call)


def harden(
    system: str,
    *,
    out: PathLike,
    space: str | None = None,
    rounds: int | None = None,
    steps: int | None = None,
    budget: int | None = None,
    episodes: int | None = None,
    settings: PathLike | None = None,
    trainer: str | None = None,
    seed: int | None = None,
    resume: bool = False,
    progress: HardenProgress | Literal[False] | None = None,
    **target: Unpack[ControllerOptions],
) -> Hardening:
    """Trains a controller of a task on its failures until it fails less often, and measures the
    difference.

    The same as ``mishandle harden``. ``docs/guide/harden.md`` explains rounds, decisions, the final
    comparison and the table ``harden`` of ``plan``. Training needs a reward and a network of this
    program, so the system is a task and the policy one of our controllers, unless a ``trainer`` of
    yours trains it. :class:`ScenarioEnv` retrains policies of other libraries.

    Parameters
    ----------
    system : str
        Name of a task.
    out : path
        File of the accepted controller, with the extension of the one before (``.safetensors``,
        ``.onnx``). The runs are in the folder beside it: ``better.harden`` for
        ``better.safetensors``.
    space, **target
        See :func:`falsify`. In the space, such as ``"starts+delay"``, the controller ``policy``
        shall fail less often.
    rounds : int
        Largest number of rounds (3).
    steps : int
        Environment steps of the training of a round (2,000,000).
    budget : int
        Number of simulations of each search, in a round and in the final comparison (300).
    episodes : int
        Number of simulations of each measure in the final comparison (1000), and twice as many as
        in a validation.
    settings : path, optional
        Training settings (TOML); by default those by which the controller was trained.
    trainer : str, optional
        Command that trains the controller of a round, such as ``"python train.py"``, with the
        arguments of ``docs/guide/harden.md``.
    seed : int
        Random seed; by default 0.
    resume : bool
        Whether to continue the hardening of ``out``, with the arguments of its start. A finished
        one is read again.
    progress : callable or False, optional
        Gets the phase, the finished part of it and the whole, now and then. Its exceptions, and
        Ctrl-C, end the hardening; ``resume=True`` continues it. By default a bar; ``False`` shows
        nothing.

    Returns
    -------
    Hardening
        ``after`` is ``None`` if no round was accepted.
    """
    if not isinstance(system, str):
        raise InvalidTypeError(
            f"a hardening trains a controller in a task, and a {type(system).__name__} is not the "
            "name of a task; retrain a policy of your own environment with mishandle.ScenarioEnv"
        )
    if space is not None and not isinstance(space, str):
        raise InvalidTypeError(
            "the space of a hardening is one of the task, by name, such as 'starts+delay'; `axes` "
            "narrows or adds axes"
        )
    policy = as_server(target.get("policy", ""))
    if not isinstance(policy, (str, os.PathLike)):
        raise InvalidTypeError(
            "a hardening trains one of our controllers, by name or path, not a "
            f"{type(policy).__name__}; write a network of skrl or Stable-Baselines3 as a "
            "controller with `mishandle import`, or retrain it with mishandle.ScenarioEnv"
        )
    _check_out(pathlib.Path(out), resume)
    given = {
        "rounds": rounds, "steps": steps, "budget": budget, "episodes": episodes,
        "settings": settings, "trainer": trainer
    }
    validation = (episodes + 1) // 2 if isinstance(episodes, int) else None
    call = Call(
        "harden", target, {"seed": seed, "harden": given}, {"harden": {"validation": validation}}
    )
    with reporting(progress, unit="") as report:
        text, lines = _native.harden(
            controller_text(system, space, target, call), out=os.fspath(out), resume=resume,
            progress=report
        )
    return read(Hardening, text, shown=lines)


def _check_out(out: pathlib.Path, resume: bool) -> None:
    """Checks that a new hardening has no files and that one to continue has its folder."""
    folder = out.with_suffix(".harden")
    if resume and not folder.exists():
        raise MishandleError(
            f"there is no hardening in {folder} to continue; start it with resume=False"
        )
    for path in () if resume else (out, folder):
        if path.exists():
            raise MishandleError(
                f"{path} exists already; choose another `out`, or continue the hardening with "
                "resume=True"
            )
