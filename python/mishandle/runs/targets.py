"""Systems as targets: what the arguments of a falsification describe, and its checks before the
first simulation."""

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
from mishandle.base.documents import Call, Plan, document
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
    check_applicable, check_period, check_space, check_steps, check_termination, check_time,
    checked_cameras, checked_size, named_formulas, task_formulas
)
from mishandle.scenarios.axes import Axis, axes_document
from mishandle.scenarios.requests import Request, Scenario
from mishandle.scenarios.scenes import Mover
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
    nominal: Sequence[float | None] | None = None
    """Nominal values of a task; the seed of a simulation draws those that are ``None``."""
    not_covered: tuple[str, ...] = ()
    """Parts of the system that its hash does not cover."""
    probes: int = 0
    """Number of simulations of the nominal scenario that showed whether it is deterministic."""

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


class ControllerOptions(TypedDict, total=False):
    """Keyword arguments that describe a target with a controller, the same for all questions."""

    policy: Any
    """Policy of an environment or a task; :func:`mishandle.policies.kinds.as_policy` lists the
    kinds. For a task also the name of a shipped controller, such as ``"ppo"``."""
    axes: Mapping[str, float | tuple[float, float] | str]
    """Axes that have a narrower range ``(low, high)``, a fixed value or a fixed category, by name.
    With one of our controllers, axes of the task that the space lacks are added to it."""
    action_noise: float
    """Standard deviation of the noise that is added to the actions of one of our controllers."""
    guard: Guard | str | os.PathLike[str]
    """Guard of one of our controllers, or its file: see :class:`mishandle.Guard`."""
    requirements: Mapping[str, str]
    """Requirements by name: texts of formulas, or names of formulas of the target. Each has a
    result of its own from the same simulations, and a search tries to violate any of them unless it
    has a ``formula``."""
    plan: Plan
    """Rare settings as the tables of a plan, such as ``{"falsify": {"early_stopping": True}}``.
    ``docs/reference/plans.md`` lists the keys; write ``_`` for ``-``."""


class TargetOptions(ControllerOptions, total=False):
    """Keyword arguments that describe any system, the same for all questions."""

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
    system: Any, formula: Formulas, space: Space, options: TargetOptions, call: Call | None = None,
    *, check: Callable[[Sequence[Axis]], object] = lambda space: None
) -> Target:
    """Returns the target of the arguments, with the plan of the call. ``check`` gets the space
    before the system is called for the first time."""
    check_options(options, list(TargetOptions.__annotations__))
    call = Call("simulate", options) if call is None else call
    check_steps(options.get("steps"))
    termination = options.get("termination", "undecided")
    check_termination(termination)
    check_time_limit(options.get("time_limit"))
    check_period(options.get("control_dt"))
    executor = options.get("executor")
    if isinstance(executor, str) and executor != "ray":
        raise InvalidValueError(
            f"there is no executor {executor!r}; expected 'ray' or a RayExecutor"
        )
    policy = as_server(options.get("policy"))
    if isinstance(policy, PolicyServer):
        options = {**options, "policy": policy}
        policy.connect()
    has_metrics = call.question in ("evaluate", "compare")
    if isinstance(system, (str, os.PathLike, Process)):
        made = _in_core(system, formula, space, options, call)
        if made is not None:
            check(made.space)
            return made
    if isinstance(policy, (str, os.PathLike)) and os.fspath(policy).endswith(".onnx"):
        # Absolute, because workers of a cluster have other working folders.
        policy = pathlib.Path(policy).absolute()
        if not policy.is_file():
            raise InvalidValueError(f"there is no ONNX file {policy}")
    if isinstance(system, (str, os.PathLike)):
        check_applicable(options, TASK_OPTIONS, "a task")
        if isinstance(policy, str):
            policy = load_controller(policy if os.path.exists(policy) else f"{system}/{policy}")
        system = TaskSystem(
            os.fspath(system), policy, preset=call.take("preset", "paper"),
            rows=options.get("rows", 64), batched_policy=options.get("batched_policy", False),
            time_limit=options.get("time_limit"),
            space=[axis for axis in space or [] if isinstance(axis, Axis)]
        )
    named = call.table("requirements")
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
    # Axes that a fixed value deprives of their effect are gone.
    applications = {axis.name: axis.apply for axis in space}
    space = [
        Axis.from_document(axis, applications[axis["name"]])
        for axis in json.loads(_native.check_question(call.text(), axes_document(space)))
    ]
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
    # A function was called once for its signals.
    probes = 2 + isinstance(local, FunctionSystem)
    if executor is not None:
        distributed = (RayExecutor() if isinstance(executor, str) else executor).system(under_test)
        largest_difference = max(largest_difference, _probe(under_test, distributed, nominal))
        probes += 2
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
    content.append(axes_document(space))
    content += [repr((under_test.control_dt, under_test.steps, termination)), repr(version), *given]
    components = []
    if policy is not None:
        components.append(
            ("policy", getattr(policy, "name", type(policy).__name__), _policy_hash(policy, found))
        )
    native = _native.Target(
        call.text(),
        document({
            "name": target_name, "content": "\n".join(content),
            "axes": [axis.to_document() for axis in space], "signals": under_test.signals,
            "formulas": list(formulas.items()), "control_dt": under_test.control_dt,
            "episode_steps": under_test.steps,
            "is_deterministic": largest_difference == 0 and states_determinism(policy),
            "depends_on_seed": under_test.depends_on_seed, "termination": termination,
            "components": components, "not_covered": not_covered,
            "versions": _versions(under_test, found, version), "random_axes": random_axes
        }),
        # Pictures and poses are made here, also if a cluster simulates.
        simulate=lambda batch: [
            outcome.to_native()
            for outcome in (
                under_test if local.recording is None and local.motion is None else local
            ).simulate([
                Request(*each) for each in batch
            ])
        ],
        painter=Painter(local) if local.has_pictures else None,
        mover=Mover(local) if local.has_scene else None,
    )
    return Target(
        native, under_test, space, largest_difference, not_covered=not_covered, probes=probes
    )


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


def _in_core(
    system: Any, formula: Formulas, space: Space, options: TargetOptions, call: Call
) -> Target | None:
    """Returns the target of a name, which the Rust core resolves and simulates; ``None`` if it is a
    task that Python simulates."""
    policy = options.get("policy")
    has_controller = policy is None or isinstance(policy, (str, os.PathLike))
    if isinstance(system, Process):
        if not has_controller:
            raise InvalidTypeError(
                "the policy of a Process is the path of an ONNX model or of a controller, not a "
                f"{type(policy).__name__}; a policy in Python can be a program that a target file "
                "names"
            )
    elif not isinstance(space, str) and not _native.is_file(os.fspath(system)) and (
        isinstance(formula, Mapping) or space is not None
        or any(name in options for name in OF_PYTHON)
        or (not has_controller and not options.get("cameras"))
        or (formula is not None and call.question in ("evaluate", "compare"))
    ):
        return None
    if space is not None and not isinstance(space, str):
        raise InvalidTypeError(
            f"the space of {system} is one of its own, by name; `mishandle list NAME` lists them"
        )
    if isinstance(formula, Mapping):
        raise InvalidTypeError(
            f"formulas by name are not possible for {system}; pass one formula, or `requirements`"
        )
    if formula is not None and call.question in ("evaluate", "compare"):
        raise InvalidTypeError(
            f"an evaluation uses the formulas of {system}; leave out `formula`, or pass "
            "`requirements`"
        )
    table = "falsify" if call.question in ("simulate", "regress") else call.question
    asked: dict[str, Any] = {} if formula is None else {table: {"formula": str(formula)}}
    if not has_controller:
        text = call.text(
            target=_absolute(system), space=space, action_noise=options.get("action_noise"), **asked
        )
        return _seeing(text, os.fspath(system), options)
    native = _native.target(controller_text(system, space, options, call, **asked))
    return _of_core(native, NativeSystem(native.signals), ())


def controller_text(
    system: Any, space: str | None, options: TargetOptions | ControllerOptions, call: Call,
    **arguments: Any
) -> str:
    """Returns the document of a call about a target with one of our controllers, or its own."""
    check_applicable(options, CONTROLLER_OPTIONS, "a target with a controller of ours or its own")
    policy, is_process = options.get("policy"), isinstance(system, Process)
    return call.text(
        guard=guard_text(options.get("guard")),
        target=system.target if is_process else _absolute(system),
        folder=system.folder if is_process else None, space=space,
        controller=None if policy is None else _absolute(policy),
        action_noise=options.get("action_noise"), **arguments
    )


def _absolute(name: str | os.PathLike[str]) -> str:
    """Returns the absolute path of a file, because a run outlives the present folder; other names
    as they are."""
    return os.path.abspath(name) if os.path.isfile(name) else os.fspath(name)


def _seeing(call: str, target: str, options: TargetOptions) -> Target:
    """Returns a task, or a robot that a file describes, with a policy in Python, in a space that
    the Rust core knows."""
    check_applicable(options, ROBOT_OPTIONS, "a target with a policy in Python in its own space")
    policy, version = options["policy"], options.get("version")
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
        described = {
            "name": options.get("name", system.name),
            "policy": getattr(policy, "name", type(policy).__name__),
            "hash": hashlib.sha256(parts.encode()).hexdigest(),
            "not_covered": found["policy"].gaps, "images": images,
            "versions": _versions(system, found, version), "is_deterministic": is_deterministic
        }
        return _native.policy_target(call, system, document(described)), found["policy"].gaps

    native, _ = make(True)
    axes = json.loads(native.axes)
    nominal = [axis["nominal"] for axis in axes]
    first, second = (_native.simulate(native, values=nominal, repeat=1)[0] for _ in range(2))
    if system.exceptions:
        raise InvalidStateError(
            f"the nominal scenario raised an exception:\n{system.exceptions[0]}"
        )
    _warn_of_nominal(
        [name for name, _ in native.signals], dict(zip([axis["name"] for axis in axes], nominal)),
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
    return _of_core(native, system, gaps, probes=2)


def _of_core(
    native: _native.Target, system: System, not_covered: tuple[str, ...], probes: int = 0
) -> Target:
    system.signals = native.signals
    axes = [Axis.from_document(axis) for axis in json.loads(native.axes)]
    nominal = [None if axis.nominal is None else float(axis.nominal) for axis in axes]
    return Target(native, system, axes, 0.0, nominal, not_covered, probes)


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


COMMON_OPTIONS = ("plan", "axes", "requirements")
CONTROLLER_OPTIONS = ("policy", "action_noise", "guard", *COMMON_OPTIONS)
OF_PYTHON = ("rows", "time_limit", "termination", "name", "executor", "version", "files")
"""Options with which a task and its controller are a system in Python."""
PYTHON_OPTIONS = (*OF_PYTHON[1:], *COMMON_OPTIONS)
FUNCTION_OPTIONS = ("control_dt", "steps", "units", "frame", *PYTHON_OPTIONS)
ENVIRONMENT_OPTIONS = (
    "policy", "batched_policy", "signals", "steps", "control_dt", "settle", "invalid",
    *PYTHON_OPTIONS
)
ROBOT_OPTIONS = (
    "policy", "batched_policy", "cameras", "image_size", "name", "version", "files", "action_noise",
    *COMMON_OPTIONS
)
TASK_OPTIONS = ("policy", "batched_policy", "rows", *PYTHON_OPTIONS)


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
