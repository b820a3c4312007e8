"""Falsification, evaluation, simulation and replay of systems in Python."""

from __future__ import annotations

import os
import pathlib
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from typing_extensions import Unpack

from mishandle import _native
from mishandle.arguments import check_number, check_out
from mishandle.axes import Axis, Value
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.explanations import Estimate, Explanation
from mishandle.runs import open_run
from mishandle.systems import Scenario
from mishandle.targets import Formulas, Simulation, Space, TargetOptions, make_target, scenario_numbers

PathLike = str | os.PathLike[str]
Progress = Callable[[int, int], None]

@dataclass(frozen=True)
class Trial:
    """Outcome of one trial. The last fields belong to the simulation with the minimum robustness."""

    trial: int
    end: str
    simulations: int
    first_violation: int | None = None
    robustness: float | None = None
    scenario: Scenario | None = None
    seed: int | None = None
    number: int | None = None

    @property
    def falsified(self) -> bool:
        """Whether the trial found a counterexample."""
        return self.first_violation is not None


class Remembering:
    """A result that remembers its system, so that it can simulate more. A copy from pickle has forgotten it."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if not name.startswith("_")}

    def _remember(self, target: _native.Target) -> None:
        # The dataclasses are frozen, and the system is not a field: it cannot be compared or copied.
        self.__dict__["_target"] = target


class _Result(Remembering):
    """A result with a run file."""

    path: pathlib.Path

    def report(self, path: PathLike, *, simulate: bool = True, probes: int = 64) -> None:
        """Writes a page about the run: one HTML file that loads nothing, for a browser or to send.

        Parameters
        ----------
        path : path
            File to write; an existing file is replaced.
        simulate : bool
            Whether to measure with the system of this result: sizes of failing patches, repeats with other seeds, noise, corners.
        probes : int
            Number of random scenarios that estimate the size of a failing patch.
        """
        target: _native.Target | None = self.__dict__.get("_target")
        if target is None or not simulate:
            open_run(self.path).report(path, simulate=simulate, probes=probes)
            return
        html = _native.report(target, os.fspath(self.path), probes)
        pathlib.Path(path).write_text(html, encoding="utf-8")


@dataclass(frozen=True)
class Falsification(_Result):
    """Outcome of a falsification."""

    path: pathlib.Path
    trials: list[Trial]
    falsified_trials: int
    falsification_rate: Estimate
    mean_simulations: float | None
    median_simulations: int | None
    simulations: int
    diverged: int
    invalid: int
    failed: int
    undecided: int
    largest_difference: float = 0.0
    exceptions: list[str] = field(default_factory=list)

    @property
    def counterexamples(self) -> list[Trial]:
        """The falsified trials, the smallest robustness first."""
        found = [trial for trial in self.trials if trial.falsified]
        return sorted(found, key=lambda trial: (trial.robustness or 0.0, trial.trial))

    def explain(self, trial: int | None = None) -> Explanation:
        """Explains the counterexample of a trial; by default, the first one, as ``mishandle explain`` does."""
        first = sorted(self.counterexamples, key=lambda each: each.trial)
        found = first if trial is None else [each for each in self.trials if each.trial == trial]
        if not found or found[0].number is None:
            raise InvalidValueError("no trial found a counterexample" if trial is None else f"trial {trial} has no simulation")
        return open_run(self.path).explain(found[0].trial, found[0].number)

    def export(self, folder: PathLike) -> list[pathlib.Path]:
        """Writes the failure of each failure mode that is closest to the nominal scenario as a counterexample file.

        :func:`mishandle.regress` simulates the files of a folder again. Existing files are replaced. Returns the files.
        """
        target = pathlib.Path(folder)
        target.mkdir(parents=True, exist_ok=True)
        files = []
        for index, mode in enumerate(open_run(self.path).failure_modes(), start=1):
            file = target / f"{self.path.stem}-mode-{index}.json"
            file.write_text(_native.counterexample(os.fspath(self.path), *mode.failures[0]), encoding="utf-8")
            files.append(file)
        return files


@dataclass(frozen=True)
class Corner:
    """Result at one corner of the space, or at its center."""

    scenario: Scenario
    simulations: int
    successes: int


@dataclass(frozen=True)
class Evaluation(_Result):
    """Metrics of random scenarios, and results at the corners."""

    path: pathlib.Path
    simulations: int
    success_rate: Estimate
    strict_success_rate: Estimate | None
    dangerous_behavior_rate: Estimate | None
    dangerous_episode_rate: Estimate | None
    task_completion_time: Estimate | None
    corners: list[Corner]
    diverged: int
    invalid: int
    failed: int
    undecided: int
    largest_difference: float = 0.0
    exceptions: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Replay:
    """A recorded simulation and its repetition. Without differences, everything recorded has the same bits."""

    trial: int
    number: int
    recorded_robustness: float | None
    simulation: Simulation
    differences: list[str]
    build_differences: list[str]


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
    early_stopping: bool = False,
    keep_going: bool = False,
    new_mode_rate: float = 0.01,
    seed: int = 0,
    out: PathLike | None = None,
    resume: bool = False,
    durable: bool = False,
    progress: Progress | None = None,
    **target: Unpack[TargetOptions],
) -> Falsification:
    """Searches for scenarios in which a system violates a formula.

    Parameters
    ----------
    system : function, gymnasium.Env, gymnasium.vector.VectorEnv or str
        A function from a scenario (a dictionary: value by axis name) to a trace (a dictionary of arrays or a data frame), with
        the keyword argument ``seed`` if it takes one; an environment; or the name of a task.
    formula : str or dict of str
        The requirement; or formulas by name, the requirement first; or the name of a formula of a task, such as ``"strict"``.
    space : sequence of Axis or str
        Axes of the scenarios; or the name of a space of a task, such as ``"starts+sensing"``, for one of our controllers.
    search : str
        One of :func:`mishandle.search_names`.
    options : dict, optional
        Options of the search; the command ``mishandle searches NAME`` lists them.
    trials, budget : int
        Number of trials, and largest number of simulations of each.
    batch : int
        Number of simulations that a search proposes at once. It receives the values in the order of its points.
    early_stopping : bool
        Whether simulations of our tasks end as soon as the search does not need the rest. Your own systems run to the end.
    keep_going : bool
        Whether a trial continues after its first counterexample, to find other failure modes.
    new_mode_rate : float
        With ``keep_going``, a trial ends when less than this fraction of its simulations finds a new failure mode; 0 spends the
        budget.
    seed : int
        Random seed of the falsification.
    out : path, optional
        Run file; by default the first free name in the folder ``runs``.
    resume : bool
        Whether to continue the run in ``out``. Its recorded simulations are not repeated.
    durable : bool
        Whether each batch is synced to the disk, so that a power failure loses none.
    progress : callable, optional
        Gets the numbers of finished and of all simulations after each batch.
    **target
        Arguments that describe the system, the same for all functions: ``policy``, ``batched_policy``, ``signals``, ``units``
        (of the signals of a function), ``steps`` (control steps of an episode), ``control_dt`` (seconds), ``termination``,
        ``time_limit`` (seconds), ``preset``, ``axes`` and ``rows`` (of a task), ``name`` and ``executor``. See
        :class:`mishandle.targets.TargetOptions`.

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
    >>> found = falsify(system, "always(gap >= 2)", [Axis("speed", 0, 10, "m/s")], trials=3, budget=50, out=run)
    >>> found.falsified_trials
    3
    >>> found.counterexamples[0].scenario["speed"] > 8
    True
    """
    check_out(out, resume)
    check_number("seed", seed, 0)
    for name, value in [("trials", trials), ("budget", budget), ("batch", batch)]:
        check_number(name, value, 1)
    search_options = list((options or {}).items())

    def check(space: Sequence[Axis]) -> None:
        axes = [axis.to_native() for axis in space]
        numbers = {"trials": trials, "budget": budget, "batch": batch}
        _native.check_falsify(axes, search=search, options=search_options, new_mode_rate=new_mode_rate, **numbers)

    found = make_target(system, formula, space, target, check)
    outcome = _native.falsify(
        found.native,
        formula=found.formula,
        search=search,
        options=search_options,
        trials=trials,
        budget=budget,
        batch=batch,
        early_stopping=early_stopping,
        keep_going=keep_going,
        new_mode_rate=new_mode_rate,
        seed=seed,
        out=(None if out is None else os.fspath(out), resume, durable),
        progress=progress,
    )
    if outcome["undecided"] > 0:
        warnings.warn(
            f"{outcome['undecided']} of {outcome['simulations']} simulations are undecided; if the system ended them early, "
            'termination="hold" or "evaluate" decides them',
            stacklevel=2,
        )
    untested = outcome["diverged"] + outcome["invalid"] + outcome["failed"]
    if untested > outcome["simulations"] / 2:
        warnings.warn(
            f"{untested} of {outcome['simulations']} simulations crashed, diverged or have invalid signals: they have no verdict, so they "
            "are neither counterexamples nor evidence of safety",
            stacklevel=2,
        )
    result = Falsification(
        path=pathlib.Path(outcome.pop("path")),
        trials=[Trial(**trial) for trial in outcome.pop("trials")],
        falsification_rate=Estimate(*outcome.pop("falsification_rate")),
        largest_difference=found.largest_difference,
        exceptions=found.system.exceptions,
        **outcome,
    )
    result._remember(found.native)
    return result


def evaluate(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    episodes: int = 100,
    batch: int = 64,
    seed: int = 0,
    out: PathLike | None = None,
    resume: bool = False,
    durable: bool = False,
    progress: Progress | None = None,
    **target: Unpack[TargetOptions],
) -> Evaluation:
    """Measures how often a system satisfies its formulas in random scenarios and at the corners of the space.

    The arguments are those of :func:`falsify`; ``episodes`` is the number of random scenarios.

    Examples
    --------
    >>> import tempfile
    >>> run = tempfile.mkdtemp() + "/run.sqlite"
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> found = evaluate(system, "always(gap >= 2)", [Axis("speed", 0, 7, "m/s")], episodes=50, out=run)
    >>> (found.success_rate.value, [corner.successes for corner in found.corners])
    (1.0, [1, 1, 1])
    """
    check_out(out, resume)
    check_number("seed", seed, 0)
    check_number("episodes", episodes, 1)
    check_number("batch", batch, 1)

    def check(space: Sequence[Axis]) -> None:
        _native.check_evaluate([axis.to_native() for axis in space], episodes=episodes, batch=batch)

    if isinstance(space, str) and formula is not None:
        raise InvalidTypeError(f"an evaluation in the space {space!r} of a task uses the formulas of the task; leave out `formula`")
    found = make_target(system, formula, space, target, check)
    outcome = _native.evaluate(
        found.native,
        episodes=episodes,
        batch=batch,
        seed=seed,
        out=(None if out is None else os.fspath(out), resume, durable),
        progress=progress,
    )
    def rate(key: str) -> Estimate | None:
        return None if outcome[key] is None else Estimate(*outcome[key])

    result = Evaluation(
        path=pathlib.Path(outcome["path"]),
        simulations=outcome["simulations"],
        success_rate=Estimate(*outcome["success_rate"]),
        strict_success_rate=rate("strict_success_rate"),
        dangerous_behavior_rate=rate("dangerous_behavior_rate"),
        dangerous_episode_rate=rate("dangerous_episode_rate"),
        task_completion_time=rate("task_completion_time"),
        corners=[Corner(**corner) for corner in outcome["corners"]],
        diverged=outcome["diverged"],
        invalid=outcome["invalid"],
        failed=outcome["failed"],
        undecided=outcome["undecided"],
        largest_difference=found.largest_difference,
        exceptions=found.system.exceptions,
    )
    result._remember(found.native)
    return result


def simulate(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    at: Mapping[str, Value] | Sequence[float] | None = None,
    repeat: int = 1,
    seed: int = 0,
    **target: Unpack[TargetOptions],
) -> list[Simulation]:
    """Simulates one scenario, ``repeat`` times with different seeds. Axes that ``at`` leaves out are nominal.

    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> [found] = simulate(system, "always(gap >= 2)", [Axis("speed", 0, 10, "m/s")], at={"speed": 9})
    >>> (found.robustness, found.trace["gap"].tolist())
    (-1.0, [10.0, 1.0])
    """
    check_number("seed", seed, 0)
    check_number("repeat", repeat, 1)
    found = make_target(system, formula, space, target, lambda space: scenario_numbers(space, at))
    seeds = [seed + number for number in range(repeat)]
    point = scenario_numbers(found.space, at, found.nominal)
    simulations = _native.simulate(found.native, formula=found.formula, scenarios=[point] * repeat, seeds=seeds)
    return [found.simulation(simulation) for simulation in simulations]


@dataclass(frozen=True)
class Repeats:
    """Simulations of one scenario with different seeds."""

    simulations: int
    failures: int
    failure_rate: Estimate
    """Failure rate of the simulations with a verdict, with its Wilson interval."""
    quantiles: dict[float, float] | None
    """Quantiles of the robustness by probability; ``None`` without a verdict."""

    @classmethod
    def of(cls, report: _native.RepeatTuple) -> Repeats:
        """Returns the repeats of a report of the extension module."""
        count, failures, rate, quantiles = report
        probabilities = (0.0, 0.05, 0.5, 0.95, 1.0)
        return cls(count, failures, Estimate(*rate), None if quantiles is None else dict(zip(probabilities, quantiles)))


def repeat(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    at: Mapping[str, Value] | Sequence[float] | None = None,
    repeats: int = 100,
    seed: int = 0,
    **target: Unpack[TargetOptions],
) -> Repeats:
    """Measures how often one scenario fails: simulates it with the seeds ``seed``, ``seed + 1``, and so on.

    The arguments are those of :func:`simulate`.

    >>> import random
    >>> def system(scenario, seed):
    ...     return {"gap": [10.0, 2.0 + random.Random(seed).gauss(0.0, 1.0)]}
    >>> found = repeat(system, "always(gap >= 2)", [Axis("speed", 0, 10, "m/s")], at={"speed": 5}, repeats=200)
    >>> found.failure_rate.low < 0.5 < found.failure_rate.high
    True
    """
    simulations = simulate(system, formula, space, at=at, repeat=repeats, seed=seed, **target)
    return Repeats.of(_native.repeat_report([found.robustness for found in simulations]))


@dataclass(frozen=True)
class Regression:
    """A counterexample file, simulated again."""

    file: pathlib.Path
    fails: bool
    robustness: float
    recorded_robustness: float
    scenario: Scenario
    seed: int
    same_target: bool
    """Whether the system has the hash of the recorded one."""
    failure_rate: Estimate | None
    """Failure rate with other seeds; ``None`` without repeats, or if the system does not depend on its seed."""
    sentences: list[str]
    """Why it fails or passes."""


def regress(
    folder: PathLike,
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    repeats: int = 0,
    **target: Unpack[TargetOptions],
) -> list[Regression]:
    """Simulates the counterexample files of a folder with a system, such as a new version of a policy.

    Parameters
    ----------
    folder : path
        Folder with files ``*.json`` of :meth:`Falsification.export` or of ``mishandle counterexamples export``.
    system, formula, space, **target
        See :func:`falsify`. The axes must be those of the files.
    repeats : int
        Number of further simulations of each file with other seeds.

    Examples
    --------
    >>> import tempfile
    >>> folder, space = tempfile.mkdtemp(), [Axis("speed", 0, 10, "m/s")]
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> found = falsify(system, "always(gap >= 2)", space, trials=1, budget=50, name="car", out=folder + "/run.sqlite")
    >>> [file.name for file in found.export(folder)]
    ['run-mode-1.json']
    >>> [test.fails for test in regress(folder, system, "always(gap >= 2)", space, name="car")]
    [True]
    >>> better = lambda scenario: {"gap": [10.0, 10.0 - 0.5 * scenario["speed"]]}
    >>> [test.fails for test in regress(folder, better, "always(gap >= 2)", space, name="car")]
    [False]
    """
    check_number("repeats", repeats, 0)
    files = sorted(pathlib.Path(folder).glob("*.json"))
    if not files:
        raise InvalidValueError(f"there is no counterexample (*.json) in {os.fspath(folder)}; write some with `export`")
    made = make_target(system, formula, space, target, lambda space: None)
    tests = []
    for file in files:
        found = _native.regress(made.native, os.fspath(file), repeats)
        rate = found.pop("failure_rate")
        failure_rate = None if rate is None else Estimate(*rate)
        tests.append(Regression(file=file, fails=found["robustness"] < 0, failure_rate=failure_rate, **found))
    return tests


def replay(
    path: PathLike,
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    trial: int | None = None,
    number: int | None = None,
    **target: Unpack[TargetOptions],
) -> Replay:
    """Repeats a recorded simulation and compares everything recorded.

    ``path`` is a run file, or a counterexample file (``.json``) of an ``export``, which has one simulation. A file never imports code:
    pass the system, formula and space of the run.
    """
    is_counterexample = os.fspath(path).lower().endswith(".json")
    if is_counterexample and not (trial is None and number is None):
        raise InvalidValueError("a counterexample file has one simulation; leave out `trial` and `number`")
    found = make_target(system, formula, space, target, lambda space: None)
    if is_counterexample:
        again = _native.replay_counterexample(found.native, os.fspath(path))
    else:
        again = _native.replay(found.native, path=os.fspath(path), trial=trial, number=number)
    keys = ("trial", "number", "recorded_robustness", "differences", "build_differences")
    return Replay(simulation=found.simulation(again), **{key: again[key] for key in keys})
