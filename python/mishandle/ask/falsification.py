"""Falsification and evaluation of systems in Python."""

import os
import pathlib
import warnings
from dataclasses import dataclass
from typing import Any

from typing_extensions import Unpack

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.documents import Call, Plan
from mishandle.base.files import PathLike, write_text
from mishandle.errors import InvalidValueError
from mishandle.results import Trial
from mishandle.runs.documents import RunFile, RunOptions, RunResult, read
from mishandle.runs.explanations import Explanation
from mishandle.runs.run_files import open_run
from mishandle.runs.targets import Formulas, Space, make_target


class Exports(results.Exports):
    """Exported counterexamples."""

    @property
    def paths(self) -> list[pathlib.Path]:
        """The written files."""
        return [pathlib.Path(each.file) for each in self.files if each.file is not None]

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: int) -> pathlib.Path:
        return self.paths[index]


@dataclass(frozen=True, kw_only=True, repr=False)
class Falsification(RunResult, results.Falsification):
    """Counterexamples that the trials of a search found."""

    @property
    def counterexamples(self) -> list[Trial]:
        """The falsified trials, the smallest robustness first. ``trial.physics`` says whether one
        depends on the solver of the physics."""
        found = [trial for trial in self.trials if trial.falsified]
        return sorted(found, key=lambda trial: (trial.minimum_robustness or 0.0, trial.trial))

    def explain(self, trial: int | None = None, *, plan: Plan | None = None) -> Explanation:
        """Explains the counterexample of a trial; by default, the first one, as ``mishandle
        explain`` does: see :meth:`mishandle.runs.Run.explain`."""
        first = sorted(self.counterexamples, key=lambda each: each.trial)
        found = first if trial is None else [each for each in self.trials if each.trial == trial]
        if not found or found[0].simulation is None:
            raise InvalidValueError(
                "no trial found a counterexample" if trial is None
                else f"trial {trial} has no simulation"
            )
        return open_run(self.path).explain(found[0].trial, found[0].simulation, plan=plan)

    def export(self, folder: PathLike, *, plan: Plan | None = None) -> Exports:
        """Writes the failure of each failure mode that is closest to the nominal scenario as a
        counterexample file.

        The physics of tasks and robots in files is checked first: the same simulation with half the
        physics step, another collision algorithm, and the start moved by 1e-6 m or rad. A failure
        that vanishes in one of these is left out (``files[i].physics.depends_on_solver``); if all
        do, that is an error.

        :func:`mishandle.regress` simulates the files of a folder again. Existing files are
        replaced.

        Parameters
        ----------
        folder : path
            Folder of the files.
        plan : dict, optional
            Rare settings: ``{"regress": {"minimize": True}}`` moves the scenarios toward the
            nominal one while they still fail, each in at most ``budget`` simulations (300).
        """
        text, files = _native.export(
            os.fspath(self.path), os.fspath(folder), Call("export", {"plan": plan}).text(),
            target=self.remembered
        )
        for file, content in files:
            write_text(file, content)
        return read(Exports, text)


@dataclass(frozen=True, kw_only=True, repr=False)
class Evaluation(RunResult, results.Evaluation):
    """Success rate, dangerous behavior rate and completion time of a controller."""


def falsify(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    search: str | None = None,
    trials: int | None = None,
    budget: int | None = None,
    seed: int | None = None,
    **settings: Unpack[RunOptions],
) -> Falsification:
    """Searches for scenarios in which a system violates a formula.

    Parameters
    ----------
    system : function, gymnasium.Env, gymnasium.vector.VectorEnv or str
        A function from a scenario (a dictionary: value by axis name) to a trace (a dictionary of
        arrays or a data frame), with the keyword argument ``seed`` if it takes one; an environment;
        or the name of a task.
    formula : str or dict of str
        The requirement; or formulas by name, the requirement first; or the name of a formula of a
        task, such as ``"strict"``.
    space : sequence of Axis or str
        Axes of the scenarios; or the name of a space of a task, such as ``"starts+sensing"``.
    search : str
        One of :func:`mishandle.ask.search_names`; by default ``"portfolio"``.
    trials, budget : int
        Number of trials (3), and largest number of simulations of each (300).
    seed : int
        Random seed of the falsification; by default 0.
    **settings
        Run file: see :class:`mishandle.runs.RunOptions`. System: ``policy``, ``signals``,
        ``steps`` and others, see :class:`mishandle.runs.TargetOptions`. Rare settings: ``plan``.
        Its ``falsify.batch`` is 1 by default, so that a search uses each value at once.

    Raises
    ------
    MishandleError
        If a name, a number, a formula or the run file is invalid.
    ValueError, TypeError
        If the system, its trace or its signals do not have the stated form.

    Examples
    --------
    >>> import tempfile
    >>> from mishandle import Axis
    >>> def system(scenario):
    ...     return {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> found = falsify(
    ...     system, "always(gap >= 2)", [Axis("speed", 0, 10, "m/s")], trials=3, budget=50,
    ...     plan={"falsify": {"early_stopping": True}}, out=tempfile.mkdtemp() + "/run.sqlite"
    ... )
    >>> found.falsified_trials
    3
    >>> found.counterexamples[0].scenario["speed"] > 8
    True
    """
    run = RunFile(settings)
    given = {"search": search, "trials": trials, "budget": budget}
    call = Call(
        "falsify", settings, {"falsify": given, "seed": seed},
        {"falsify": {"batch": 1}}
    )
    made = make_target(system, formula, space, run.target, call)
    result = run.ask(Falsification, made, waits=False)
    for caveat in _caveats(result):
        warnings.warn(caveat, stacklevel=2)
    return result


def _caveats(result: Falsification) -> list[str]:
    """Returns what speaks against a search that found nothing."""
    caveats, count = [], result.simulations
    undecided = sum(trial.undecided for trial in result.trials)
    if undecided > 0:
        caveats.append(
            f"{undecided} of {count} simulations are undecided; if the system ended them early, "
            'termination="hold" or "evaluate" decides them'
        )
    untested = sum(trial.diverged + trial.invalid + trial.failed for trial in result.trials)
    if untested > count / 2:
        caveats.append(
            f"{untested} of {count} simulations crashed, diverged or have invalid signals: they "
            "have no verdict, so they are neither counterexamples nor evidence of safety"
        )
    return caveats


def evaluate(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    episodes: int | None = None,
    until: str | None = None,
    rate: float | None = None,
    seed: int | None = None,
    **settings: Unpack[RunOptions],
) -> Evaluation:
    """Measures how often a system satisfies its formulas in random scenarios and at the corners of
    the space.

    The other arguments are those of :func:`falsify`.

    Parameters
    ----------
    episodes : int
        Number of random scenarios (100); with ``until``, the largest number.
    until : str, optional
        When the evaluation stops by itself, looking after each batch: ``"decided"`` (the interval
        of the success rate lies on one side of ``rate``) or a width such as ``"width=0.04"``.
        ``sequential`` of the result says what it found; intervals hold at any time.
    rate : float, optional
        The success rate that ``"decided"`` decides about.

    Examples
    --------
    >>> import tempfile
    >>> from mishandle import Axis
    >>> run = tempfile.mkdtemp() + "/run.sqlite"
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> found = evaluate(
    ...     system, "always(gap >= 2)", [Axis("speed", 0, 7, "m/s")], episodes=50, out=run
    ... )
    >>> (found.success_rate.value, [point.successes for point in found.corners.points])
    (1.0, [1, 1, 1])
    """
    run = RunFile(settings)
    given = {"episodes": episodes, "until": until, "rate": rate}
    call = Call("evaluate", settings, {"evaluate": given, "seed": seed})
    made = make_target(system, formula, space, run.target, call)
    return run.ask(Evaluation, made, waits=False)
