"""A controller that fails less often, with evidence."""

from __future__ import annotations

import json
import os
import pathlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.files import PathLike, write_text
from mishandle.errors import InvalidTypeError, MishandleError
from mishandle.policies.guards import Guard, guard_text
from mishandle.policies.servers import as_server
from mishandle.runs.documents import read
from mishandle.runs.targets import TargetOptions, axis_settings, requirements as named_requirements
from mishandle.scenarios.arguments import check_number, check_settings, is_real

HardenProgress = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True)
class Hardening(results.Hardening):
    """A controller before and after a hardening."""

    @property
    def path(self) -> pathlib.Path:
        """The folder of all runs."""
        return pathlib.Path(self.folder)

    def report(
        self, path: PathLike, *, simulate: bool = True, probes: int = 64, sensitivity: int = 0
    ) -> None:
        """Writes a page about the hardening: one HTML file that loads nothing, for a browser or to
        send.

        Parameters
        ----------
        path : path
            File to write; an existing file is replaced.
        simulate, probes, sensitivity
            As for the report of a run.
        """
        write_text(
            path, _native.hardening_report(self.folder, probes if simulate else None, sensitivity)
        )


def harden(
    system: str,
    *,
    policy: PathLike,
    space: str = "starts",
    axes: Mapping[str, float | tuple[float, float] | str] | None = None,
    preset: str = "paper",
    requirements: Mapping[str, str] | None = None,
    stochastic: bool = False,
    action_noise: float = 0.0,
    observation_noise: float = 0.0,
    guard: Guard | PathLike | None = None,
    out: PathLike,
    rounds: int = 3,
    steps: int = 2_000_000,
    budget: int = 300,
    episodes: int = 1000,
    validation: int | None = None,
    risk: int = 2000,
    margin: int = 500,
    searches: Sequence[str] = ("portfolio", "cma-es", "random"),
    nominal: float = 0.25,
    corners: float = 0.1,
    archive: float = 0.25,
    allow: Sequence[str] = (),
    settings: PathLike | None = None,
    device: str = "cpu",
    trainer: str | None = None,
    seed: int = 0,
    resume: bool = False,
    progress: HardenProgress | None = None,
) -> Hardening:
    """Trains a controller of a task on its failures until it fails less often, and measures the
    difference.

    The same as ``mishandle harden``. ``docs/guide/harden.md`` explains rounds, decisions and the
    final comparison. Training needs a reward and a network of this program, so the system is a task
    and the policy one of our controllers, unless a ``trainer`` of yours trains it.
    :class:`ScenarioEnv` retrains policies of other libraries.

    Parameters
    ----------
    system : str
        Name of a task.
    policy : str or path
        Name of a shipped controller, such as ``"ppo"``, or a file (``.safetensors``; with a trainer
        also ``.onnx``).
    space : str
        Name of a space of the task in which the controller shall fail less often, such as
        ``"starts+delay"``.
    axes, preset, requirements, stochastic, action_noise, observation_noise, guard
        As for a task in :func:`falsify`.
    out : path
        File of the accepted controller, with the extension of the one before (``.safetensors``,
        ``.onnx``). The runs are in the folder beside it: ``better.harden`` for
        ``better.safetensors``.
    rounds : int
        Largest number of rounds.
    steps : int
        Environment steps of the training of a round.
    budget : int
        Number of simulations of each search, in a round and in the final comparison.
    episodes, validation : int
        Number of simulations of each measure in the final comparison and in a validation, by
        default half as many.
    risk, margin : int
        Numbers of simulations in the final comparison: of the failure probability, and of the
        search for the smallest disturbance.
    searches : sequence of str
        Searches that look for failures.
    nominal, corners, archive : float
        Shares of the training episodes: without disturbances, at corners of the space, and with
        archived failures.
    allow : sequence of str
        Measures that may get worse: ``"success"``, ``"strict"``, ``"careful"``, ``"noise"`` and
        ``"corners"``.
    settings : path, optional
        Training settings (TOML); by default those by which the controller was trained.
    device : str
        Device of the training's physics: ``"cpu"`` or ``"gpu"``.
    trainer : str, optional
        Command that trains the controller of a round, such as ``"python train.py"``, with the
        arguments of ``docs/guide/harden.md``. It replaces ``settings``, ``device`` and the shares.
    seed : int
        Random seed.
    resume : bool
        Whether to continue the hardening of ``out``, with the arguments of its start. A finished
        one is read again.
    progress : callable, optional
        Gets the phase, the finished part of it and the whole, now and then. Its exceptions, and
        Ctrl-C, end the hardening; ``resume=True`` continues it.

    Returns
    -------
    Hardening
        ``after`` is ``None`` if no round was accepted.

    Raises
    ------
    MishandleError
        If a name or a number is invalid, the controller cannot be trained, or ``out`` exists.
    """
    if not isinstance(system, str):
        raise InvalidTypeError(
            f"a hardening trains a controller in a task, and a {type(system).__name__} is not the "
            "name of a task; retrain a policy of your own environment with mishandle.ScenarioEnv"
        )
    if not isinstance(space, str):
        raise InvalidTypeError(
            "the space of a hardening is one of the task, by name, such as 'starts+delay'; `axes` "
            "narrows or adds axes"
        )
    options: TargetOptions = {
        "axes": {} if axes is None else axes,
        "requirements": {} if requirements is None else requirements
    }
    check_settings(options["axes"])
    if trainer is not None and not isinstance(trainer, str):
        raise InvalidTypeError(
            f"trainer is a {type(trainer).__name__}; expected a command, such as 'python train.py'"
        )
    if not isinstance(given := as_server(policy), (str, os.PathLike)):
        raise InvalidTypeError(
            "a hardening trains one of our controllers, by name or path, not a "
            f"{type(given).__name__}; write a network of skrl or Stable-Baselines3 as a controller "
            "with `mishandle import`, or retrain it with mishandle.ScenarioEnv"
        )
    counts = {
        "rounds": rounds, "steps": steps, "budget": budget, "episodes": episodes, "risk": risk,
        "margin": margin
    }
    for name, count in counts.items():
        check_number(name, count, 1)
    if validation is not None:
        check_number("validation", validation, 1)
    check_number("seed", seed, 0)
    shares = {"nominal": nominal, "corners": corners, "archive": archive}
    for name, share in shares.items():
        if not is_real(share):
            raise InvalidTypeError(f"{name} is {share!r}; it must be a number from 0 to 1")
    for name, names in (("searches", searches), ("allow", allow)):
        if isinstance(names, str) or not all(isinstance(each, str) for each in names):
            raise InvalidTypeError(f"{name} is {names!r}; expected a list of names")
    _check_out(pathlib.Path(out), resume)
    table = {
        **{name: int(count) for name, count in counts.items()},
        **{name: float(share) for name, share in shares.items()},
        "validation": (int(episodes) + 1) // 2 if validation is None else int(validation),
        "searches": list(searches),
        "allow": list(allow),
        "settings": None if settings is None else os.fspath(settings),
        "device": device,
        **({} if trainer is None else {"trainer": trainer}),
    }
    text = _native.harden(
        system, os.fspath(policy), preset=preset, space=space, axes=axis_settings(options),
        noise=(stochastic, action_noise, observation_noise), guard=guard_text(guard),
        requirements=named_requirements(options), seed=int(seed), table=json.dumps(table),
        out=os.fspath(out), is_resumed=resume, progress=progress
    )
    return read(Hardening, text)


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
