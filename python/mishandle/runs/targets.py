"""Systems as targets: what the arguments of a falsification describe, and its checks before the
first simulation."""

from __future__ import annotations

import hashlib
import json
import os
import pathlib
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypedDict, Union

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.fingerprints import Fingerprint, Watch
from mishandle.base.keywords import check_options
from mishandle.base.limits import check_time_limit
from mishandle.base.packages import package_of
from mishandle.base.pictures import Painter
from mishandle.cluster import RayExecutor
from mishandle.errors import InvalidStateError, InvalidTypeError, InvalidValueError
from mishandle.logs.formulas import Formula
from mishandle.policies.controllers import Controller, load_controller
from mishandle.policies.guards import Guard, guard_text
from mishandle.policies.kinds import policy_hash
from mishandle.policies.servers import PolicyServer, as_server, states_determinism
from mishandle.scenarios.arguments import (
    check_applicable, check_period, check_settings, check_space, check_steps, check_termination,
    check_time, checked_cameras, checked_size, named_formulas, task_formulas
)
from mishandle.scenarios.axes import Axis
from mishandle.scenarios.requests import Request, Scenario
from mishandle.systems.functions import FunctionSystem
from mishandle.systems.interface import Frames, NativeSystem, Source, System
from mishandle.systems.processes import Process
from mishandle.systems.starts import Invalid, Settle
from mishandle.systems.tasks import CoreSystem, TaskSystem
from mishandle.systems.vector_environments import environment_system

Formulas = Union[str, Formula, Mapping[str, Union[str, Formula]], None]
"""A requirement, or formulas by name, the requirement first. ``success``, ``strict``, ``safe`` and
``completion`` define metrics. ``None`` selects the formulas of a task."""

Space = Union[Sequence[Axis], str, None]
"""Axes of the scenarios, or the name of a space of a task, such as ``"starts+sensing"``. ``None``
selects the initial box of a task."""


DEFAULT_SPACES = {"toy/": "starts", "arch/": "instance-2"}
"""The default space of built-in systems that are no tasks, by the prefix of their names."""


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
    """Tracebacks of the exceptions of the call that simulated it, if it crashed, or if a policy
    server did not answer in time."""
    document: results.Simulation | None = field(default=None, repr=False)
    """The result of ``mishandle simulate``, with the explanation; ``None`` in a replay."""


@dataclass
class Target:
    """A system as the extension module takes it."""

    native: _native.Target
    system: System
    space: Sequence[Axis]
    largest_difference: float
    formula: str | None = None
    """Name or text of the requirement, if it is not the first formula of the target."""
    nominal: Sequence[float | None] | None = None
    """Nominal values of a task; the seed of a simulation draws those that are ``None``."""
    not_covered: tuple[str, ...] = ()
    """Parts of the system that its hash does not cover."""

    @property
    def facts(self) -> dict[str, Any]:
        """What results in Python say about the system, besides their documents."""
        return {
            "largest_difference": self.largest_difference,
            "exceptions": self.system.exceptions,
            "not_covered": self.not_covered,
        }

    def simulation(self, found: dict[str, Any]) -> Simulation:
        # Signals that no formula reads may be missing at the end.
        trace = {name: column for (name, _), column in zip(self.system.signals, found["samples"].T)}
        keys = ("scenario", "seed", "end", "steps", "robustness", "total_reward")
        exceptions = (
            self.system.exceptions if found["end"].startswith(("crashed", "timed out")) else []
        )
        document = (
            results.build(results.Simulation, json.loads(found["document"])) if "document" in found
            else None
        )
        return Simulation(
            trace=trace, exceptions=list(exceptions), document=document,
            **{key: found[key] for key in keys}
        )


class TargetOptions(TypedDict, total=False):
    """Keyword arguments that describe a system, the same for :func:`falsify`, :func:`evaluate`,
    :func:`simulate` and :func:`replay`."""

    policy: Any
    """Policy of an environment or a task; :func:`mishandle.policies.kinds.as_policy` lists the
    kinds. For a task also the name of a shipped controller, such as ``"ppo"``."""
    batched_policy: bool
    """Whether a policy that is a function takes a batch of observations and returns one action per
    row."""
    cameras: Sequence[str]
    """Cameras of a task or a target file whose images a policy in Python gets. Its observation is
    then a dictionary with ``"state"`` and an image of each camera, bytes of the shape (height,
    width, 3), as that of ``TaskEnv(task, cameras=...)``."""
    image_size: tuple[int, int]
    """Width and height of these images, pixels; (64, 64) by default."""
    signals: Mapping[str, Source | tuple[Source, str]]
    """Signals of an environment: source, or source and unit, by name."""
    units: Mapping[str, str]
    """Units of the signals of a function."""
    frame: Frames
    """Draws samples of a simulation of a function, for reports: ``frame(scenario, trace, samples)``
    returns one array (height, width, 3) of bytes for each sample."""
    settle: Settle
    """Control steps of an environment after its reset and before the first sample, as a number, or
    with an action as a pair. The action is 0, or the value of the space that is nearest to it."""
    invalid: Invalid
    """Says from observation and ``info`` of an environment, after it settled, whether no episode
    can start there. Such a simulation ends as an invalid scenario, without a verdict."""
    steps: int
    """Number of control steps of an episode; by default the time limit of the environment, or the
    length of the nominal trace."""
    control_dt: float
    """Duration of a control step, in seconds; by default that of the environment, or 1. It matters
    for bounds with units."""
    termination: str
    """Verdict of an episode that ends before the last control step: ``"undecided"`` (formulas may
    need the missing samples), ``"hold"`` (the last sample is repeated) or ``"evaluate"`` (the trace
    is complete)."""
    time_limit: float
    """Wall-clock time limit of a simulation, in seconds."""
    preset: str
    """Task preset: ``"paper"`` or ``"code"``."""
    axes: Mapping[str, float | tuple[float, float] | str]
    """Axes that have a narrower range ``(low, high)``, a fixed value or a fixed category, by name.
    With one of our controllers, axes of the task that the space lacks are added to it."""
    stochastic: bool
    """Whether actions of one of our controllers are sampled from its distribution."""
    action_noise: float
    """Standard deviation of the noise that is added to the actions of one of our controllers."""
    observation_noise: float
    """Standard deviation of the noise that is added to the observations of one of our
    controllers."""
    guard: Guard | str | os.PathLike[str]
    """Guard of one of our controllers, or its file: see :class:`mishandle.Guard`."""
    requirements: Mapping[str, str]
    """Requirements by name: texts of formulas, or names of formulas of the target. Each has a
    result of its own from the same simulations, and a search tries to violate any of them unless it
    has a ``formula``."""
    rows: int
    """Number of simulations of a task that are stepped together."""
    name: str
    """Name of the target; by default that of the function, the environment or the task."""
    version: str
    """Version of the system, for what its hash does not cover: another text is another system. See
    ``docs/guide/python.md``."""
    files: Sequence[str | os.PathLike[str]]
    """Files whose contents are a part of the system, such as a program that a function starts."""
    executor: str | RayExecutor
    """``"ray"`` or a :class:`mishandle.RayExecutor` simulates batches on a Ray cluster. The rows of
    a run do not depend on it."""


def make_target(
    system: Any, formula: Formulas, space: Space, options: TargetOptions,
    check: Callable[[Sequence[Axis]], object], *, has_metrics: bool = False
) -> Target:
    """Returns the target of the arguments. ``check`` gets the space before the system is called for
    the first time. ``has_metrics`` says whether the question has a metric of each formula of a
    task, as an evaluation does."""
    check_options(options, list(TargetOptions.__annotations__))
    check_steps(options.get("steps"))
    termination = options.get("termination", "undecided")
    check_termination(termination)
    check_time_limit(options.get("time_limit"))
    check_period(options.get("control_dt"))
    check_settings(options.get("axes", {}))
    executor = options.get("executor")
    if isinstance(executor, str) and executor != "ray":
        raise InvalidValueError(
            f"there is no executor {executor!r}; expected 'ray' or a RayExecutor"
        )
    policy = as_server(options.get("policy"))
    if isinstance(policy, PolicyServer):
        options = {**options, "policy": policy}
        policy.connect()
    if isinstance(policy, (str, os.PathLike)) and os.fspath(policy).endswith(".onnx"):
        # Absolute, because workers of a cluster have other working folders.
        policy = pathlib.Path(policy).absolute()
        if not policy.is_file():
            raise InvalidValueError(f"there is no ONNX file {policy}")
    if isinstance(system, str) and system.startswith(tuple(DEFAULT_SPACES)):
        # It is its own controller, and only the Rust core knows its spaces.
        default = next(
            default for kind, default in DEFAULT_SPACES.items() if system.startswith(kind)
        )
        return _task_in_space(
            system, formula, _named(system, space) or default, {"policy": "", **options}, check
        )
    if isinstance(system, Process):
        return _simulator(system, formula, space, options, check)
    if isinstance(system, (str, os.PathLike)) and os.fspath(system).lower().endswith(".toml"):
        return _robot(pathlib.Path(system), formula, space, options, check)
    if isinstance(system, str) and policy is None:
        raise InvalidValueError(f"the task {system} needs a policy")
    if isinstance(system, str) and options.get("cameras"):
        return _in_core(
            system, formula, _named(system, space), {**options, "policy": policy}, check
        )
    has_file = isinstance(policy, (str, os.PathLike))
    is_native = (
        any(options.get(name) for name in NATIVE_OPTIONS)
        or (has_file and bool(options.get("axes")))
    )
    if isinstance(system, str) and space is None and is_native:
        space = "starts"
    if isinstance(system, str) and isinstance(space, str):
        return _task_in_space(system, formula, space, options, check)
    if isinstance(system, str):
        check_applicable(options, TASK_OPTIONS, "a task")
        if isinstance(policy, (str, pathlib.Path)):
            is_path = "/" in os.fspath(policy) or os.fspath(policy).endswith(".safetensors")
            controller = load_controller(policy if is_path else f"{system}/{policy}")
            if controller.images:
                # The Rust core draws what it sees.
                return _task_in_space(system, formula, "starts", options, check)
            policy = controller if isinstance(policy, str) else policy
        system = TaskSystem(
            system, policy, preset=options.get("preset", "paper"), rows=options.get("rows", 64),
            batched_policy=options.get("batched_policy", False),
            time_limit=options.get("time_limit"),
            space=[axis for axis in space or [] if isinstance(axis, Axis)]
        )
    named = requirements(options)
    known: Formulas = None
    if isinstance(system, TaskSystem):
        known, formula = _formulas_of_task(system, formula, named, has_metrics)
        space = system.space if space is None else space
    if isinstance(space, (str, Mapping)) or not all(isinstance(axis, Axis) for axis in space or []):
        raise InvalidTypeError('a space is a list of axes, such as [Axis("speed", 0, 10, "m/s")]')
    if not space:
        raise InvalidValueError("the space has no axes")
    if formula is None and named:
        formula = " and ".join(f"({text})" for text in named.values())
    formulas = named_formulas(formula)
    is_environment = hasattr(system, "reset") and hasattr(system, "step")
    check_space(space, is_environment, has_steps=is_environment or isinstance(system, System))
    space = _with_settings(space, options)
    check(space)
    given = [f"{name} {digest}" for name, digest in file_hashes(options.get("files", ()))]
    version = options.get("version")
    if version is not None and not isinstance(version, str):
        raise InvalidTypeError(f"version is {version!r}; it must be a text")
    watch = Watch(_roots(system, policy, space, options))
    local = under_test = _system(system, space, policy, options)
    random_axes = under_test.random_axes
    check_time(formulas, under_test.knows_control_dt, under_test.control_dt)
    nominal = {axis.name: axis.nominal_value for axis in space}
    largest_difference = _probe(under_test, under_test, nominal)
    if executor is not None:
        distributed = (RayExecutor() if isinstance(executor, str) else executor).system(under_test)
        largest_difference = max(largest_difference, _probe(under_test, distributed, nominal))
        under_test = distributed
    if largest_difference > 0:
        warnings.warn(
            "the system is not deterministic: two simulations of the same scenario and seed "
            f"differ by up to {largest_difference:g}; replays are not bit-identical",
            stacklevel=3,
        )
    target_name = "python/" + options.get("name", under_test.name)
    found = watch.fingerprints()
    not_covered = tuple(gap for each in found.values() for gap in each.gaps)
    if not_covered and version is None:
        _warn_of_gaps(not_covered)
    # A task is the same system whatever a question needs of it.
    signals = system.own_signals if isinstance(system, TaskSystem) else under_test.signals
    stated = formulas if known is None else named_formulas(known)
    content = [
        target_name, *(each.digest for each in found.values()), repr(signals),
        repr(sorted(stated.items()))
    ]
    content += [repr(axis.to_native()) for axis in space]
    content += [repr((under_test.control_dt, under_test.steps, termination)), repr(version), *given]
    components = []
    if policy is not None:
        components.append(
            ("policy", getattr(policy, "name", type(policy).__name__), _policy_hash(policy, found))
        )
    native = _native.Target(
        name=target_name,
        content="\n".join(content),
        axes=[axis.to_native() for axis in space],
        signals=under_test.signals,
        formulas=list(formulas.items()),
        control_dt=under_test.control_dt,
        episode_steps=under_test.steps,
        is_deterministic=largest_difference == 0 and states_determinism(policy),
        depends_on_seed=under_test.depends_on_seed,
        termination=termination,
        components=components,
        not_covered=list(not_covered),
        versions=_versions(under_test, found, version),
        random_axes=random_axes,
        # Pictures are drawn here, also if a cluster simulates.
        simulate=lambda batch: [
            outcome.to_native()
            for outcome in (under_test if local.recording is None else local).simulate([
                Request(*each) for each in batch
            ])
        ],
        painter=Painter(local) if local.has_pictures else None,
    )
    native = native.with_requirements(requirements(options))
    return Target(native, under_test, space, largest_difference, not_covered=not_covered)


def _warn_of_gaps(not_covered: Sequence[str]) -> None:
    warnings.warn(
        f"the hash of the system does not cover {'; '.join(not_covered)}: pass `version`, a text "
        "that you change with them, so that resumed runs and comparisons can tell two versions "
        "apart",
        stacklevel=4,
    )


def _formulas_of_task(
    system: TaskSystem, formula: Formulas, named: Mapping[str, str], has_metrics: bool
) -> tuple[Formulas, Formulas]:
    """Returns all formulas that a question to a task knows, and those that it evaluates. As in the
    Rust core, only an evaluation evaluates careful success if nothing else reads the signals of the
    manner, which are computed only if a formula reads them."""
    all_of_task = system.formulas
    if (
        isinstance(formula, (str, Formula)) and str(formula) not in all_of_task
        and system.reads_manner([str(formula)])
    ):
        system.compute_manner()
    known = task_formulas(formula, all_of_task, [name for name, _ in system.signals])
    texts = (
        {"success": str(known)} if isinstance(known, (str, Formula))
        else {name: str(text) for name, text in known.items()}
    )
    asked = [all_of_task.get(text, text) for text in named.values()]
    is_given = isinstance(formula, Mapping) or formula == "careful" or "careful" in named.values()
    others = {name: text for name, text in texts.items() if name != "careful"}
    if (
        "careful" in texts
        and not (has_metrics or is_given or system.reads_manner([*others.values(), *asked]))
    ):
        return known, others
    if system.reads_manner([*texts.values(), *asked]):
        system.compute_manner()
    return known, known


def requirements(options: TargetOptions) -> dict[str, str]:
    """Returns the named requirements as a dictionary."""
    found = options.get("requirements", {})
    if (
        not isinstance(found, Mapping)
        or not all(isinstance(part, str) for item in found.items() for part in item)
    ):
        raise InvalidTypeError(
            f"requirements is {found!r}; expected a dictionary of formulas by name"
        )
    return dict(found)


def _roots(
    system: Any, policy: Any, space: Sequence[Axis], options: TargetOptions
) -> dict[str, Any]:
    """Returns the functions and objects that decide how a system behaves."""
    if isinstance(system, TaskSystem):
        arguments = {"arguments": system.arguments} if system.arguments else {}
        return {"task": system.facts, "policy": system.policy_source, **arguments}
    if isinstance(system, System):
        return {"system": system.code()}
    applications = {axis.name: axis.apply for axis in space}
    start: dict[str, Any] = {
        name: value for name, value in options.items() if name in ("settle", "invalid")
    }
    return {
        "system": system, "policy": policy, "signals": dict(options.get("signals", {})),
        "axes": applications, **start
    }


def _policy_hash(policy: Any, found: Mapping[str, Fingerprint]) -> str:
    is_file = isinstance(policy, (str, os.PathLike, Controller))
    return policy_hash(policy) if is_file or "policy" not in found else found["policy"].digest


def _versions(
    system: System, found: Mapping[str, Fingerprint], version: str | None
) -> list[tuple[str, str]]:
    """Returns the versions of the packages that the code of a system names, and its own version."""
    versions = dict(system.versions)
    for package in [
        package_of("sys"), *(item for each in found.values() for item in each.packages.items())
    ]:
        if package is not None:
            versions[package[0]] = package[1]
    if version is not None:
        versions["the system"] = version
    return sorted(versions.items())


def file_hashes(files: Sequence[str | os.PathLike[str]]) -> list[tuple[str, str]]:
    """Returns the name and the SHA-256 of each file."""
    if isinstance(files, (str, os.PathLike)):
        raise InvalidTypeError(f"files is {files!r}; expected a list of paths")
    found = []
    for file in map(pathlib.Path, files):
        try:
            found.append((file.name, hashlib.sha256(file.read_bytes()).hexdigest()))
        except OSError as error:
            raise InvalidValueError(
                f"the file {file} in `files` cannot be read: {error.strerror}"
            ) from error
    return found


def _with_settings(space: Sequence[Axis], options: TargetOptions) -> Sequence[Axis]:
    """Returns a space whose axes have the ranges and values in ``axes``."""
    if not options.get("axes"):
        return space
    settled = _native.with_settings([axis.to_native() for axis in space], axis_settings(options))
    # Axes that a fixed value deprives of their effect are gone.
    applications = {axis.name: axis.apply for axis in space}
    return [Axis.from_native(native, applications[native[1]]) for native in settled]


def _robot(
    path: pathlib.Path, formula: Formulas, space: Space, options: TargetOptions,
    check: Callable[[Sequence[Axis]], object]
) -> Target:
    """Returns a robot that a file describes, which the Rust core simulates, with the policy of the
    file, another file or a policy in Python."""
    name = _named(str(path), space)
    policy = options.get("policy", "")
    if not isinstance(policy, (str, os.PathLike)):
        return _in_core(str(path.absolute()), formula, name, options, check)
    # Absolute, because workers of a cluster have other working folders.
    policy = str(pathlib.Path(policy).absolute()) if os.fspath(policy) else ""
    return _task_in_space(str(path.absolute()), formula, name, {**options, "policy": policy}, check)


def _simulator(
    process: Process, formula: Formulas, space: Space, options: TargetOptions,
    check: Callable[[Sequence[Axis]], object]
) -> Target:
    """Returns a simulator that is a program, which the Rust core asks, with the policy of a file if
    it needs one."""
    if space is not None and not isinstance(space, str):
        raise InvalidTypeError("the space of a Process is one that its program states, by name")
    policy = options.get("policy", "")
    if not isinstance(policy, (str, os.PathLike)):
        raise InvalidTypeError(
            "the policy of a Process is the path of an ONNX model or of a controller, not a "
            f"{type(policy).__name__}; a policy in Python can be a program that a target file names"
        )
    policy = str(pathlib.Path(policy).absolute()) if os.fspath(policy) else ""
    return _task_in_space(
        process.target, formula, space or "", {**options, "policy": policy}, check,
        folder=str(process.folder)
    )


def _named(target: str, space: Space) -> str:
    """Returns the name of a space of a target; empty for its first one."""
    if space is not None and not isinstance(space, str):
        raise InvalidTypeError(
            f"the space of {target} is one of its own, by name; `mishandle list {target}` "
            "lists them"
        )
    return space or ""


def _in_core(
    target: str, formula: Formulas, space: str, options: TargetOptions,
    check: Callable[[Sequence[Axis]], object]
) -> Target:
    """Returns a task, or a robot that a file describes, with a policy in Python, in a space that
    the Rust core knows."""
    if target.endswith(".toml"):
        check_applicable(options, ROBOT_OPTIONS, "a robot in a file with a policy in Python")
    else:
        check_applicable(
            options, ("preset", *ROBOT_OPTIONS), "a task with a policy in Python that sees"
        )
    policy, version = options["policy"], options.get("version")
    if isinstance(policy, (str, os.PathLike)):
        raise InvalidTypeError(
            f"`cameras` are those of a policy in Python; {os.fspath(policy)} says itself what it "
            "sees: leave them out"
        )
    cameras = checked_cameras(options.get("cameras", ()))
    if "image_size" in options and not cameras:
        raise InvalidTypeError(
            "the argument `image_size` has no effect without `cameras`; leave it out"
        )
    size = checked_size("image_size", options.get("image_size", (64, 64)))
    images = [(camera, *size) for camera in cameras]
    system = CoreSystem(target, policy, options.get("batched_policy", False), images)
    given = [f"{name} {digest}" for name, digest in file_hashes(options.get("files", ()))]
    given += [repr(image) for image in images]
    watch = Watch({"policy": policy})

    def make(is_deterministic: bool) -> tuple[_native.Target, tuple[str, ...]]:
        found = watch.fingerprints()
        parts = "\n".join([_policy_hash(policy, found), repr(version), *given])
        made = _native.policy_target(
            target, system, images=images, preset=options.get("preset", "paper"),
            name=options.get("name", system.name),
            identified=(
                getattr(policy, "name", type(policy).__name__),
                hashlib.sha256(parts.encode()).hexdigest(), list(found["policy"].gaps)
            ),
            space=space, axes=axis_settings(options),
            noise=(options.get("action_noise", 0.0), options.get("observation_noise", 0.0)),
            versions=_versions(system, found, version), is_deterministic=is_deterministic
        )
        return made, found["policy"].gaps

    native, _ = make(True)
    nominal = [axis[5] for axis in native.axes]
    first, second = (
        _native.simulate(native, formula=None, values=nominal, repeat=1, seed=0)[0]
        for _ in range(2)
    )
    if system.exceptions:
        raise InvalidStateError(
            f"the nominal scenario raised an exception:\n{system.exceptions[0]}"
        )
    _warn_of_nominal(
        [name for name, _ in native.signals], dict(zip([axis[0] for axis in native.axes], nominal)),
        first["samples"], first["end"]
    )
    is_deterministic = (
        first["end"] == second["end"]
        and np.array_equal(first["samples"], second["samples"], equal_nan=True)
    )
    if not is_deterministic:
        warnings.warn(
            "the policy is not deterministic: two simulations of the same scenario and seed "
            "differ; replays are not bit-identical",
            stacklevel=4,
        )
    # What the simulations changed is a state of the policy.
    native, gaps = make(is_deterministic and states_determinism(policy))
    if gaps and version is None:
        _warn_of_gaps(gaps)
    return _in_named_space(native, system, formula, space, options, check, gaps)


def _task_in_space(
    task: str, formula: Formulas, space: str, options: TargetOptions,
    check: Callable[[Sequence[Axis]], object], folder: str | None = None
) -> Target:
    """Returns a task with one of our controllers, which the Rust core simulates: only it has the
    axes of all spaces. ``folder`` is the working folder of a simulator, which the Rust core
    asks."""
    check_applicable(
        options, ("policy", "preset", "axes", "requirements", *NATIVE_OPTIONS),
        f"a task in the space {space!r}"
    )
    policy = options.get("policy")
    if not isinstance(policy, (str, os.PathLike)):
        raise InvalidTypeError(
            f"the space {space!r} of a task needs the name or path of a controller, not a "
            f"{type(policy).__name__}; leave out the space to test another policy from the initial "
            "states, or give a policy that sees its `cameras`"
        )
    noise = (
        options.get("stochastic", False), options.get("action_noise", 0.0),
        options.get("observation_noise", 0.0)
    )
    preset = options.get("preset", "paper")
    guard = guard_text(options.get("guard"))
    native = _native.Target.of_task(
        task, os.fspath(policy), preset, space, axis_settings(options), noise, folder, guard
    )
    return _in_named_space(native, NativeSystem(native.signals), formula, space, options, check)


def _in_named_space(
    native: _native.Target, system: System, formula: Formulas, space: str, options: TargetOptions,
    check: Callable[[Sequence[Axis]], object], not_covered: tuple[str, ...] = ()
) -> Target:
    """Returns a target that the Rust core simulates in a space that it knows by name."""
    system.signals = native.signals
    if formula is not None and not isinstance(formula, (str, Formula)):
        raise InvalidTypeError(
            f"formulas by name are not possible in the space {space!r} of a task; pass one formula"
        )
    requirement = None if formula is None else str(formula)
    if requirement is not None:
        named = task_formulas(
            requirement, dict(native.formulas), [name for name, _ in native.signals]
        )
        Formula(requirement if isinstance(named, str) else dict(native.formulas)[requirement])
    axes = [Axis.from_native(axis) for axis in native.axes]
    check(axes)
    nominal = [axis[5] for axis in native.axes]
    native = native.with_requirements(requirements(options))
    return Target(native, system, axes, 0.0, requirement, nominal, not_covered)


def axis_settings(options: TargetOptions) -> dict[str, Any]:
    """Returns the settings of axes as the native code takes them."""
    return {
        name: tuple(setting) if isinstance(setting, list) else setting
        for name, setting in options.get("axes", {}).items()
    }


def _system(system: Any, space: Sequence[Axis], policy: Any, options: TargetOptions) -> System:
    if isinstance(system, System):
        return system
    if hasattr(system, "reset") and hasattr(system, "step"):
        check_applicable(options, ENVIRONMENT_OPTIONS, "an environment")
        if policy is None:
            raise InvalidValueError("an environment needs a policy")
        return environment_system(
            system, policy, space, signals=options.get("signals", {}), steps=options.get("steps"),
            control_dt=options.get("control_dt"), time_limit=options.get("time_limit"),
            batched_policy=options.get("batched_policy", False), settle=options.get("settle"),
            invalid=options.get("invalid")
        )
    if callable(system):
        check_applicable(options, FUNCTION_OPTIONS, "a function")
        return FunctionSystem(
            system, nominal={axis.name: axis.nominal_value for axis in space},
            control_dt=options.get("control_dt"), steps=options.get("steps"),
            units=options.get("units", {}), time_limit=options.get("time_limit"),
            frame=options.get("frame")
        )
    raise InvalidTypeError(
        f"a {type(system).__name__} is not a system: expected a function, a Gymnasium environment "
        "or the name of a task"
    )


NATIVE_OPTIONS = ("stochastic", "action_noise", "observation_noise", "guard")
COMMON_OPTIONS = (
    "time_limit", "termination", "name", "executor", "axes", "requirements", "version", "files"
)
FUNCTION_OPTIONS = ("control_dt", "steps", "units", "frame", *COMMON_OPTIONS)
ENVIRONMENT_OPTIONS = (
    "policy", "batched_policy", "signals", "steps", "control_dt", "settle", "invalid",
    *COMMON_OPTIONS
)
ROBOT_OPTIONS = (
    *(
        "policy", "batched_policy", "cameras", "image_size", "axes", "requirements", "name",
        "version", "files"
    ),
    *("action_noise", "observation_noise"),
)
TASK_OPTIONS = ("policy", "batched_policy", "preset", "rows", *COMMON_OPTIONS)


def _probe(system: System, other: System, nominal: Scenario) -> float:
    """Returns the largest difference between the nominal scenario in two systems; infinity if it
    ends differently."""
    first, second = (each.simulate([Request(nominal, 0)])[0] for each in (system, other))
    for each in (system, other):
        if each.exceptions:
            raise InvalidStateError(
                f"the nominal scenario {nominal} raised an exception:\n{each.exceptions[0]}"
            )
    _warn_of_nominal([name for name, _ in system.signals], nominal, first.samples, first.end)
    if (first.end, first.steps, first.samples.shape) != (
        second.end, second.steps, second.samples.shape
    ):
        return float("inf")
    if first.samples.size == 0 or np.array_equal(first.samples, second.samples, equal_nan=True):
        return 0.0
    if not np.array_equal(np.isnan(first.samples), np.isnan(second.samples)):
        return float("inf")
    return float(np.nanmax(np.abs(first.samples - second.samples)))


def _warn_of_nominal(
    signals: Sequence[str], nominal: Mapping[str, Any], samples: NDArray[np.float64], end: str
) -> None:
    """Warns of a nominal scenario without a verdict: probably most scenarios will have none."""
    bad = np.argwhere(~np.isfinite(samples))
    if len(bad) > 0:
        sample, signal = bad[0]
        problem = f"the signal `{signals[signal]}` is {samples[sample, signal]} at sample {sample}"
    elif end in ("completed", "terminated"):
        return
    else:
        problem = f"the simulation ends as {end!r}"
    warnings.warn(f"the nominal scenario {nominal} has no verdict: {problem}", stacklevel=5)
