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
    robustness: float | None = None
    scenario: Scenario | None = None
    seed: int | None = None
    number: int | None = None

    @property
    def falsified(self) -> bool:
        """Whether the trial found a counterexample."""
        return self.end == "falsified"


@dataclass(frozen=True)
class Falsification:
    """Outcome of a campaign."""

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

    def report(self, path: PathLike, *, simulate: bool = True) -> None:
        """Writes a page about the run; see :meth:`mishandle.Run.report`."""
        open_run(self.path).report(path, simulate=simulate)


@dataclass(frozen=True)
class Corner:
    """Result at one corner of the space, or at its center."""

    scenario: Scenario
    simulations: int
    successes: int


@dataclass(frozen=True)
class Evaluation:
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

    def report(self, path: PathLike, *, simulate: bool = True) -> None:
        """Writes a page about the run; see :meth:`mishandle.Run.report`."""
        open_run(self.path).report(path, simulate=simulate)


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
    search: str = "dual-annealing",
    options: Mapping[str, Any] | None = None,
    trials: int = 10,
    budget: int = 300,
    batch: int = 1,
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
    seed : int
        Random seed of the campaign.
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
        ``time_limit`` (seconds), ``preset`` and ``rows`` (of a task), ``name`` and ``executor``. See
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
        _native.check_falsify(axes, search=search, options=search_options, trials=trials, budget=budget, batch=batch)

    found = make_target(system, formula, space, target, check)
    outcome = _native.falsify(
        found.native,
        formula=found.formula,
        search=search,
        options=search_options,
        trials=trials,
        budget=budget,
        batch=batch,
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
    return Falsification(
        path=pathlib.Path(outcome.pop("path")),
        trials=[Trial(**trial) for trial in outcome.pop("trials")],
        falsification_rate=Estimate(*outcome.pop("falsification_rate")),
        largest_difference=found.largest_difference,
        exceptions=found.system.exceptions,
        **outcome,
    )


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

    return Evaluation(
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

    A run file never imports code: pass the system, formula and space of the run.
    """
    found = make_target(system, formula, space, target, lambda space: None)
    again = _native.replay(found.native, path=os.fspath(path), trial=trial, number=number)
    keys = ("trial", "number", "recorded_robustness", "differences", "build_differences")
    return Replay(simulation=found.simulation(again), **{key: again[key] for key in keys})
