"""Falsification and evaluation of systems in Python."""

from __future__ import annotations

import os
import pathlib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from typing_extensions import Unpack

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.files import PathLike, write_text
from mishandle.base.interruption import deliver
from mishandle.errors import InvalidTypeError, InvalidValueError, MishandleError
from mishandle.results import Trial
from mishandle.runs.documents import RunFile, RunOptions, RunResult, answer, read
from mishandle.runs.explanations import Explanation
from mishandle.runs.run_files import open_run
from mishandle.runs.targets import Formulas, Space, make_target
from mishandle.scenarios.arguments import check_number
from mishandle.scenarios.axes import Axis


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


@dataclass(frozen=True, kw_only=True)
class Falsification(RunResult, results.Falsification):
    """Counterexamples that the trials of a search found."""

    @property
    def counterexamples(self) -> list[Trial]:
        """The falsified trials, the smallest robustness first."""
        found = [trial for trial in self.trials if trial.falsified]
        return sorted(found, key=lambda trial: (trial.minimum_robustness or 0.0, trial.trial))

    def explain(self, trial: int | None = None, *, axes: int = 30) -> Explanation:
        """Explains the counterexample of a trial; by default, the first one, as ``mishandle
        explain`` does.

        It is simulated again with each axis alone at its nominal value, for at most ``axes`` axes.
        """
        first = sorted(self.counterexamples, key=lambda each: each.trial)
        found = first if trial is None else [each for each in self.trials if each.trial == trial]
        if not found or found[0].simulation is None:
            raise InvalidValueError(
                "no trial found a counterexample" if trial is None
                else f"trial {trial} has no simulation"
            )
        return open_run(self.path).explain(found[0].trial, found[0].simulation, axes=axes)

    def export(
        self, folder: PathLike, *, minimize: bool = False, budget: int | None = None
    ) -> Exports:
        """Writes the failure of each failure mode that is closest to the nominal scenario as a
        counterexample file.

        :func:`mishandle.regress` simulates the files of a folder again. Existing files are
        replaced.

        Parameters
        ----------
        folder : path
            Folder of the files.
        minimize : bool
            Whether to move the scenarios toward the nominal one while they still fail.
        budget : int, optional
            Largest number of simulations that minimize a counterexample; by default 300.
        """
        target = self.remembered if minimize else None
        if minimize and target is None:
            raise MishandleError(
                "a copy of a result does not know its system; minimize with the result itself"
            )
        text, files = _native.export(
            os.fspath(self.path), os.fspath(folder), target=target, budget=budget
        )
        for file, content in files:
            write_text(file, content)
        return read(Exports, text)


@dataclass(frozen=True, kw_only=True)
class Evaluation(RunResult, results.Evaluation):
    """Success rate, dangerous behavior rate and completion time of a controller."""


def falsify(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    search: str = "portfolio",
    options: Mapping[str, Any] | None = None,
    trials: int = 10,
    budget: int = 300,
    batch: int = 1,
    fixed_seed: int | None = None,
    early_stopping: bool = False,
    keep_going: bool = False,
    isolate: bool | None = None,
    new_mode_rate: float = 0.01,
    repeats: int | None = None,
    seed: int = 0,
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
        Axes of the scenarios; or the name of a space of a task, such as ``"starts+sensing"``, for
        one of our controllers.
    search : str
        One of :func:`mishandle.ask.search_names`.
    options : dict, optional
        Options of the search; the command ``mishandle list NAME`` lists them.
    trials, budget : int
        Number of trials, and largest number of simulations of each.
    batch : int
        Number of simulations that a search proposes at once. It receives the values in the order of
        its points.
    fixed_seed : int, optional
        Random seed of every simulation, so that robustness has no noise; by default each simulation
        has a seed of its own.
    early_stopping : bool
        Whether simulations end as soon as the search does not need the rest: the samples determine
        the robustness, or show that it is above what the search asks for. Environments are checked
        after every ten control steps; a function returns whole traces.
    keep_going : bool
        Whether a trial continues after its first counterexample, to find other failure modes.
    new_mode_rate : float
        With ``keep_going``, a trial ends when less than this fraction of its simulations finds a
        new failure mode; 0 spends the budget.
    isolate : bool, optional
        Whether to move the counterexample of each trial toward nominal, to find the axes that cause
        it (``Trial.cause``): at most 30 simulations, or a tenth of a larger budget. By default only
        without ``keep_going``, where it is the first of each trial.
    repeats : int, optional
        Number of simulations of each counterexample with other seeds, if the system depends on its
        seed; by default 100. In total, they are at most as many as the run has. 0 skips them.
    seed : int
        Random seed of the falsification.
    **settings
        Run file: ``out``, ``resume``, ``any_build``, ``durable`` and ``progress``, see
        :class:`mishandle.runs.RunOptions`. System: ``policy``, ``signals``, ``steps``,
        ``control_dt`` and others, see :class:`mishandle.runs.TargetOptions`.

    Returns
    -------
    Falsification

    Raises
    ------
    MishandleError
        If a name, a number, a formula or the run file is invalid.
    ValueError, TypeError
        If the system, its trace or its signals do not have the stated form.

    Examples
    --------
    >>> import tempfile
    >>> def system(scenario):
    ...     return {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> run = tempfile.mkdtemp() + "/run.sqlite"
    >>> found = falsify(
    ...     system, "always(gap >= 2)", [Axis("speed", 0, 10, "m/s")], trials=3, budget=50, out=run
    ... )
    >>> found.falsified_trials
    3
    >>> found.counterexamples[0].scenario["speed"] > 8
    True
    """
    run = RunFile(settings)
    check_number("seed", seed, 0)
    for name, value in [("trials", trials), ("budget", budget), ("batch", batch)]:
        check_number(name, value, 1)
    if fixed_seed is not None:
        check_number("fixed_seed", fixed_seed, 0)
    if repeats is not None:
        check_number("repeats", repeats, 0)
    search_options = list((options or {}).items())

    def check(space: Sequence[Axis]) -> None:
        axes = [axis.to_native() for axis in space]
        numbers = {"trials": trials, "budget": budget, "batch": batch}
        _native.check_falsify(
            axes, search=search, options=search_options, new_mode_rate=new_mode_rate, **numbers
        )

    found = make_target(system, formula, space, run.target, check)
    text, interruption, notes = _native.falsify(
        found.native, formula=found.formula, search=search, options=search_options, trials=trials,
        budget=budget, batch=batch, fixed_seed=fixed_seed, early_stopping=early_stopping,
        keep_going=keep_going, isolate=isolate, new_mode_rate=new_mode_rate, repeats=repeats,
        seed=seed, out=run.native, progress=run.progress
    )
    result = deliver(answer(Falsification, found, text, notes), interruption)
    undecided = sum(trial.undecided for trial in result.trials)
    if undecided > 0:
        warnings.warn(
            f"{undecided} of {result.simulations} simulations are undecided; if the system ended "
            "them early, "
            'termination="hold" or "evaluate" decides them',
            stacklevel=2
        )
    untested = sum(trial.diverged + trial.invalid + trial.failed for trial in result.trials)
    if untested > result.simulations / 2:
        warnings.warn(
            f"{untested} of {result.simulations} simulations crashed, diverged or have invalid "
            "signals: they have no verdict, so they are neither counterexamples nor evidence of "
            "safety",
            stacklevel=2,
        )
    return result


def evaluate(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    episodes: int = 100,
    until: str | None = None,
    rate: float | None = None,
    control: bool = True,
    batch: int = 64,
    seed: int = 0,
    **settings: Unpack[RunOptions],
) -> Evaluation:
    """Measures how often a system satisfies its formulas in random scenarios and at the corners of
    the space.

    The other arguments are those of :func:`falsify`.

    Parameters
    ----------
    episodes : int
        Number of random scenarios; with ``until``, the largest number.
    until : str, optional
        When the evaluation stops by itself, looking after each batch: ``"decided"`` (the interval
        of the success rate lies on one side of ``rate``) or a width such as ``"width=0.04"``.
        ``sequential`` of the result says what it found; intervals hold at any time.
    rate : float, optional
        The success rate that ``"decided"`` decides about.
    control : bool
        Whether the same starts and seeds are simulated with every other axis at nominal, too:
        ``control`` of the result.

    Examples
    --------
    >>> import tempfile
    >>> run = tempfile.mkdtemp() + "/run.sqlite"
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> found = evaluate(
    ...     system, "always(gap >= 2)", [Axis("speed", 0, 7, "m/s")], episodes=50, out=run
    ... )
    >>> (found.success_rate.value, [point.successes for point in found.corners.points])
    (1.0, [1, 1, 1])
    """
    run = RunFile(settings)
    check_number("seed", seed, 0)
    check_number("episodes", episodes, 1)
    check_number("batch", batch, 1)

    def check(space: Sequence[Axis]) -> None:
        axes = [axis.to_native() for axis in space]
        _native.check_evaluate(axes, episodes=episodes, batch=batch, until=until, rate=rate)

    if isinstance(space, str) and formula is not None:
        raise InvalidTypeError(
            f"an evaluation in the space {space!r} of a task uses the formulas of the task; leave "
            "out `formula`"
        )
    found = make_target(system, formula, space, run.target, check, has_metrics=True)
    text, interruption, notes = _native.evaluate(
        found.native, episodes=episodes, batch=batch, until=until, rate=rate, control=control,
        seed=seed, out=run.native, progress=run.progress
    )
    return deliver(answer(Evaluation, found, text, notes), interruption)
