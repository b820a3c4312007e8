"""Falsification, evaluation, simulation and replay of systems in Python."""

from __future__ import annotations

import os
import pathlib
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypedDict, Union

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Unpack

from mishandle import _native
from mishandle.arguments import (
    check_applicable,
    check_number,
    check_options,
    check_out,
    check_space,
    check_steps,
    check_termination,
    check_time,
    named_formulas,
    task_formulas,
)
from mishandle.axes import Axis, Value
from mishandle.controllers import load_controller
from mishandle.errors import InvalidStateError, InvalidTypeError, InvalidValueError
from mishandle.formulas import Formula
from mishandle.limits import check_time_limit
from mishandle.policies import policy_hash
from mishandle.ray import RayExecutor
from mishandle.systems import FunctionSystem, NativeSystem, Outcome, Scenario, Source, System, TaskSystem
from mishandle.vectors import environment_system

PathLike = str | os.PathLike[str]
Progress = Callable[[int, int], None]

Formulas = Union[str, Formula, Mapping[str, Union[str, Formula]], None]
"""A requirement, or formulas by name, the requirement first. ``success``, ``strict``, ``safe`` and ``completion`` define
metrics. ``None`` selects the formulas of a task."""

Space = Union[Sequence[Axis], str, None]
"""Axes of the scenarios, or the name of a space of a task, such as ``"starts+sensing"``. ``None`` selects the initial box of a
task."""


@dataclass(frozen=True)
class Estimate:
    """A rate or mean with its 95 % interval."""

    value: float | None
    low: float | None
    high: float | None
    n: int


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


@dataclass(frozen=True)
class Simulation:
    """One simulation with its trace: an array for each signal, with one value per sample."""

    scenario: Scenario
    seed: int
    end: str
    steps: int
    robustness: float | None
    total_reward: float
    trace: dict[str, NDArray[np.float64]]
    exceptions: list[str] = field(default_factory=list)
    """Tracebacks of the exceptions of the call that simulated it, if it crashed."""


@dataclass(frozen=True)
class Replay:
    """A recorded simulation and its repetition. Without differences, everything recorded has the same bits."""

    trial: int
    number: int
    recorded_robustness: float | None
    simulation: Simulation
    differences: list[str]
    build_differences: list[str]


@dataclass
class _Target:
    """A system as the extension module takes it."""

    native: _native.Target
    system: System
    space: Sequence[Axis]
    largest_difference: float
    formula: str | None = None
    """Name or text of the requirement, if it is not the first formula of the target."""
    nominal: Sequence[float | None] | None = None
    """Nominal values of a task; the seed of a simulation draws those that are ``None``."""

    def simulation(self, found: dict[str, Any]) -> Simulation:
        names = [name for name, _ in self.system.signals]
        trace = {name: found["samples"][:, column] for column, name in enumerate(names)}
        keys = ("scenario", "seed", "end", "steps", "robustness", "total_reward")
        exceptions = self.system.exceptions if found["end"].startswith("crashed") else []
        return Simulation(trace=trace, exceptions=list(exceptions), **{key: found[key] for key in keys})


class TargetOptions(TypedDict, total=False):
    """Keyword arguments that describe a system, the same for :func:`falsify`, :func:`evaluate`, :func:`simulate` and
    :func:`replay`."""

    policy: Any
    """Policy of an environment or a task; :func:`mishandle.policies.as_policy` lists the kinds. For a task also the name of
    a shipped controller, such as ``"ppo"``."""
    batched_policy: bool
    """Whether a policy that is a function takes a batch of observations and returns one action per row."""
    signals: Mapping[str, Source | tuple[Source, str]]
    """Signals of an environment: source, or source and unit, by name."""
    units: Mapping[str, str]
    """Units of the signals of a function."""
    steps: int
    """Number of control steps of an episode; by default the time limit of the environment, or the length of the nominal
    trace."""
    control_dt: float
    """Duration of a control step, in seconds; by default that of the environment, or 1. It matters for bounds with units."""
    termination: str
    """Verdict of an episode that ends before the last control step: ``"undecided"`` (formulas may need the missing samples),
    ``"hold"`` (the last sample is repeated) or ``"evaluate"`` (the trace is complete)."""
    time_limit: float
    """Wall-clock time limit of a simulation, in seconds."""
    preset: str
    """Task preset: ``"paper"`` or ``"code"``."""
    rows: int
    """Number of simulations of a task that are stepped together."""
    name: str
    """Name of the target; by default that of the function, the environment or the task."""
    executor: str | RayExecutor
    """``"ray"`` or a :class:`mishandle.ray.RayExecutor` simulates batches on a Ray cluster. The rows of a run do not depend on
    it."""


def _point(
    space: Sequence[Axis],
    at: Mapping[str, Value] | Sequence[float] | None,
    nominal: Sequence[float | None] | None = None,
) -> list[float | None]:
    """Returns the numbers of a scenario. Axes that it leaves out have the values ``nominal``."""
    if at is None:
        at = {}
    if not isinstance(at, Mapping):
        if len(at) != len(space):
            raise InvalidValueError(f"the scenario has {len(at)} values; expected {len(space)}")
        return [float(value) for value in at]
    unknown = sorted(set(at) - {axis.name for axis in space})
    if unknown:
        names = ", ".join(axis.name for axis in space)
        raise InvalidValueError(f"the space has no axis {', '.join(unknown)}; its axes: {names}")
    if nominal is None:
        nominal = [axis.nominal_value for axis in space]
    return [axis.number(at[axis.name]) if axis.name in at else value for axis, value in zip(space, nominal)]


def _target(
    system: Any, formula: Formulas, space: Space, options: TargetOptions, check: Callable[[Sequence[Axis]], object]
) -> _Target:
    """Returns the target of the arguments. ``check`` gets the space before the system is called for the first time."""
    check_options(options, list(TargetOptions.__annotations__))
    check_steps(options.get("steps"))
    termination = options.get("termination", "undecided")
    check_termination(termination)
    check_time_limit(options.get("time_limit"))
    executor = options.get("executor")
    if isinstance(executor, str) and executor != "ray":
        raise InvalidValueError(f"there is no executor {executor!r}; expected 'ray' or a RayExecutor")
    policy = options.get("policy")
    if isinstance(policy, (str, os.PathLike)) and os.fspath(policy).endswith(".onnx"):
        # Absolute, because workers of a cluster have other working folders.
        policy = pathlib.Path(policy).absolute()
        if not policy.is_file():
            raise InvalidValueError(f"there is no ONNX file {policy}")
    if isinstance(system, str) and policy is None:
        raise InvalidValueError(f"the task {system} needs a policy")
    if isinstance(system, str) and isinstance(space, str):
        return _task_in_space(system, formula, space, options, check)
    if isinstance(system, str):
        check_applicable(options, TASK_OPTIONS, "a task")
        if isinstance(policy, str):
            is_path = "/" in policy or policy.endswith(".safetensors")
            policy = load_controller(policy if is_path else f"{system}/{policy}")
        system = TaskSystem(
            system,
            policy,
            preset=options.get("preset", "paper"),
            rows=options.get("rows", 64),
            batched_policy=options.get("batched_policy", False),
            time_limit=options.get("time_limit"),
        )
    if isinstance(system, TaskSystem):
        formula = task_formulas(formula, system.formulas, [name for name, _ in system.signals])
        space = system.space if space is None else space
    if isinstance(space, (str, Mapping)) or not all(isinstance(axis, Axis) for axis in space or []):
        raise InvalidTypeError('a space is a list of axes, such as [Axis("speed", 0, 10, "m/s")]')
    if not space:
        raise InvalidValueError("the space has no axes")
    formulas = named_formulas(formula)
    check_space(space, is_environment=hasattr(system, "reset") and hasattr(system, "step"))
    check(space)
    under_test = _system(system, space, policy, options)
    check_time(formulas, under_test.knows_control_dt, under_test.control_dt)
    nominal = {axis.name: _nominal(axis) for axis in space}
    largest_difference = _probe(under_test, under_test, nominal)
    if executor is not None:
        distributed = (RayExecutor() if isinstance(executor, str) else executor).system(under_test)
        largest_difference = max(largest_difference, _probe(under_test, distributed, nominal))
        under_test = distributed
    if largest_difference > 0:
        warnings.warn(
            "the system is not deterministic: two simulations of the same scenario and seed differ by up to "
            f"{largest_difference:g}; replays are not bit-identical",
            stacklevel=4,
        )
    target_name = "python/" + options.get("name", under_test.name)
    content = [target_name, under_test.description(), repr(under_test.signals), repr(sorted(formulas.items()))]
    content += [repr(axis.to_native()) for axis in space]
    content += [repr((under_test.control_dt, under_test.steps, termination))]
    components = []
    if policy is not None:
        components.append(("policy", getattr(policy, "name", type(policy).__name__), policy_hash(policy)))
    native = _native.Target(
        name=target_name,
        content="\n".join(content),
        axes=[axis.to_native() for axis in space],
        signals=under_test.signals,
        formulas=list(formulas.items()),
        control_dt=under_test.control_dt,
        episode_steps=under_test.steps,
        is_deterministic=largest_difference == 0,
        depends_on_seed=under_test.depends_on_seed,
        termination=termination,
        components=components,
        versions=under_test.versions,
        simulate=lambda batch: [outcome.to_native() for outcome in under_test.simulate(batch)],
    )
    return _Target(native, under_test, space, largest_difference)


def _task_in_space(
    task: str, formula: Formulas, space: str, options: TargetOptions, check: Callable[[Sequence[Axis]], object]
) -> _Target:
    """Returns a task with one of our controllers, which the Rust core simulates: only it has the axes of all spaces."""
    check_applicable(options, ("policy", "preset"), f"a task in the space {space!r}")
    policy = options.get("policy")
    if not isinstance(policy, (str, os.PathLike)):
        raise InvalidTypeError(
            f"the space {space!r} of a task needs the name or path of a controller, not a {type(policy).__name__}; leave out the "
            "space to test another policy from the initial states"
        )
    native = _native.Target.of_task(task, os.fspath(policy), options.get("preset", "paper"), space)
    if formula is not None and not isinstance(formula, (str, Formula)):
        raise InvalidTypeError(f"formulas by name are not possible in the space {space!r} of a task; pass one formula")
    requirement = None if formula is None else str(formula)
    if requirement is not None:
        named = task_formulas(requirement, dict(native.formulas), [name for name, _ in native.signals])
        Formula(requirement if isinstance(named, str) else dict(native.formulas)[requirement])
    axes = [Axis.from_native(axis) for axis in native.axes]
    check(axes)
    nominal = [nominal for *_, nominal, _, _ in native.axes]
    return _Target(native, NativeSystem(native.signals), axes, 0.0, requirement, nominal)


def _system(system: Any, space: Sequence[Axis], policy: Any, options: TargetOptions) -> System:
    if isinstance(system, System):
        return system
    if hasattr(system, "reset") and hasattr(system, "step"):
        check_applicable(options, ENVIRONMENT_OPTIONS, "an environment")
        if policy is None:
            raise InvalidValueError("an environment needs a policy")
        return environment_system(
            system,
            policy,
            space,
            signals=options.get("signals", {}),
            steps=options.get("steps"),
            control_dt=options.get("control_dt"),
            time_limit=options.get("time_limit"),
            batched_policy=options.get("batched_policy", False),
        )
    if callable(system):
        check_applicable(options, FUNCTION_OPTIONS, "a function")
        return FunctionSystem(
            system,
            nominal={axis.name: _nominal(axis) for axis in space},
            control_dt=options.get("control_dt"),
            steps=options.get("steps"),
            units=options.get("units", {}),
            time_limit=options.get("time_limit"),
        )
    raise InvalidTypeError(
        f"a {type(system).__name__} is not a system: expected a function, a Gymnasium environment or the name of a task"
    )


COMMON_OPTIONS = ("time_limit", "termination", "name", "executor")
FUNCTION_OPTIONS = ("control_dt", "steps", "units", *COMMON_OPTIONS)
ENVIRONMENT_OPTIONS = ("policy", "batched_policy", "signals", "steps", "control_dt", *COMMON_OPTIONS)
TASK_OPTIONS = ("policy", "batched_policy", "preset", "rows", *COMMON_OPTIONS)


def _nominal(axis: Axis) -> Value:
    number = axis.nominal_value
    if not isinstance(axis.values, str):
        return axis.values[int(number)]
    return int(number) if axis.values == "integer" else number


def _probe(system: System, other: System, nominal: Scenario) -> float:
    """Returns the largest difference between the nominal scenario in two systems; infinity if it ends differently."""
    first, second = (each.simulate([(nominal, 0)])[0] for each in (system, other))
    for each in (system, other):
        if each.exceptions:
            raise InvalidStateError(f"the nominal scenario {nominal} raised an exception:\n{each.exceptions[0]}")
    _warn_of_nominal(system, nominal, first)
    if (first.end, first.steps, first.samples.shape) != (second.end, second.steps, second.samples.shape):
        return float("inf")
    if first.samples.size == 0 or np.array_equal(first.samples, second.samples, equal_nan=True):
        return 0.0
    if not np.array_equal(np.isnan(first.samples), np.isnan(second.samples)):
        return float("inf")
    return float(np.nanmax(np.abs(first.samples - second.samples)))


def _warn_of_nominal(system: System, nominal: Scenario, outcome: Outcome) -> None:
    """Warns of a nominal scenario without a verdict: probably most scenarios will have none."""
    bad = np.argwhere(~np.isfinite(outcome.samples))
    if len(bad) > 0:
        sample, signal = bad[0]
        value = outcome.samples[sample, signal]
        problem = f"the signal `{system.signals[signal][0]}` is {value} at sample {sample}"
    elif outcome.end in ("completed", "terminated"):
        return
    else:
        problem = f"the simulation ends as {outcome.end!r}"
    warnings.warn(f"the nominal scenario {nominal} has no verdict: {problem}", stacklevel=5)


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
        :class:`mishandle.campaign.TargetOptions`.

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

    found = _target(system, formula, space, target, check)
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
    found = _target(system, formula, space, target, check)
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
    found = _target(system, formula, space, target, lambda space: _point(space, at))
    seeds = [seed + number for number in range(repeat)]
    point = _point(found.space, at, found.nominal)
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
    found = _target(system, formula, space, target, lambda space: None)
    again = _native.replay(found.native, path=os.fspath(path), trial=trial, number=number)
    keys = ("trial", "number", "recorded_robustness", "differences", "build_differences")
    return Replay(simulation=found.simulation(again), **{key: again[key] for key in keys})
