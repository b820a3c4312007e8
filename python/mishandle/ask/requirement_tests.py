"""Requirements as tests: what :func:`requirement` states about a function, and how it is decided.
It does not need pytest."""

import contextlib
import contextvars
import dataclasses
import functools
import hashlib
import json
import os
import pathlib
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeVar, cast

from typing_extensions import Unpack

import mishandle._native as _native
from mishandle.ask.falsification import Falsification, falsify
from mishandle.ask.simulations import regress
from mishandle.base.files import write_text
from mishandle.base.fingerprints import Watch
from mishandle.errors import (
    InvalidStateError, InvalidTypeError, InvalidValueError, MissingPackageError
)
from mishandle.plots import close, plot_trace
from mishandle.results import RegressionTest, Trial
from mishandle.runs.documents import write_counterexample
from mishandle.runs.run_files import open_run
from mishandle.runs.targets import (
    Formulas, Space, TargetOptions, file_hashes, make_target
)
from mishandle.scenarios.arguments import check_number, named_formulas

Function = TypeVar("Function", bound=Callable[..., Any])

ATTRIBUTE = "__mishandle_requirement__"
"""Attribute of a function with a requirement."""

_is_tested = contextvars.ContextVar("_is_tested", default=False)
"""Whether the next call of a function with a requirement is that of the plugin."""

STATE = "state.json"
KNOWN = "known"


@dataclasses.dataclass(frozen=True)
class Requirement:
    """What a test requires of a system."""

    formula: Formulas
    space: Space
    system: Any
    search: str
    trials: int
    budget: int | None
    seed: int | None
    counterexamples: str | os.PathLike[str] | None
    options: TargetOptions


@dataclasses.dataclass(frozen=True)
class Limits:
    """What the command line and the settings of a test run say about all requirements. ``None``
    leaves it to the requirement."""

    budget: int | None = None
    seed: int | None = None
    default_budget: int = 300
    default_seed: int = 0
    use_cache: bool = True
    only_replay: bool = False


@dataclasses.dataclass(frozen=True)
class Outcome:
    """The result of a test."""

    passes: bool
    text: str
    """The evidence; of a failure the whole report."""
    simulations: int = 0
    """Number of simulations that were run now."""
    is_cached: bool = False


def requirement(
    formula: Formulas = None,
    space: Space = None,
    *,
    target: Any = None,
    controller: Any = None,
    search: str = "portfolio",
    trials: int = 1,
    budget: int | None = None,
    seed: int | None = None,
    counterexamples: str | os.PathLike[str] | None = None,
    **options: Unpack[TargetOptions],
) -> Callable[[Function], Function]:
    """States a requirement that pytest tests: a search tries to violate it.

    The decorated function returns the system, and can use fixtures and parameters. It returns
    nothing if ``target`` is given. It raises an error unless the plugin for pytest calls it: a
    method of ``unittest.TestCase`` fails, because nothing would be simulated.

    Parameters
    ----------
    formula, space, **options
        See :func:`mishandle.falsify`.
    target, controller : optional
        The system, such as the name of a task, and its policy, such as ``"ppo"``.
    search, trials : optional
        Name of the search, and number of searches.
    budget : int, optional
        Largest number of simulations of each search; by default 300, or the setting
        ``mishandle_budget``.
    seed : int, optional
        Random seed of the searches; by default 0, or the setting ``mishandle_seed``.
    counterexamples : path, optional
        Folder of counterexample files, relative to that of the test, which are simulated first.

    Examples
    --------
    >>> from mishandle import Axis
    >>> @requirement("always(gap >= 2)", [Axis("speed", 0, 10, "m/s")], budget=50)
    ... def test_gap():
    ...     return lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    """
    check_number("trials", trials, 1)
    for name, value in (("budget", budget), ("seed", seed)):
        if value is not None:
            check_number(name, value, 1 if name == "budget" else 0)
    if callable(formula):
        raise InvalidTypeError(
            '@requirement needs a formula: @mishandle.requirement("always(gap >= 2)", space=[...])'
        )
    if controller is not None:
        options = {**options, "policy": controller}
    found = Requirement(
        formula, space, target, search, trials, budget, seed, counterexamples, options
    )

    def decorate(function: Function) -> Function:
        @functools.wraps(function)
        def test(*args: Any, **kwargs: Any) -> Any:
            if not _is_tested.get():
                raise InvalidStateError(
                    f"{function.__name__} has a requirement, which only the plugin for pytest "
                    "tests, and this call would simulate nothing: run it with `pytest -p "
                    "mishandle`; in a unittest.TestCase, write a function instead of a method, or "
                    "call mishandle.falsify"
                )
            _is_tested.set(False)
            return function(*args, **kwargs)

        setattr(test, ATTRIBUTE, found)
        return cast(Function, test)

    return decorate


@contextlib.contextmanager
def tested() -> Iterator[None]:
    """Allows one call of a function with a requirement, whose result the caller tests."""
    before = _is_tested.set(True)
    try:
        yield
    finally:
        _is_tested.reset(before)


@dataclasses.dataclass(frozen=True)
class Test:
    """A requirement with its system and its folder."""

    requirement: Requirement
    system: Any
    folder: pathlib.Path
    """Folder of the run, the counterexamples and the state of the test."""
    source: pathlib.Path
    """File of the test."""
    again: str
    """Command that runs this test alone."""
    limits: Limits

    __test__ = False

    @property
    def budget(self) -> int:
        return self.limits.budget or self.requirement.budget or self.limits.default_budget

    @property
    def seed(self) -> int:
        for seed in (self.limits.seed, self.requirement.seed):
            if seed is not None:
                return seed
        return self.limits.default_seed

    def run(self) -> Outcome:
        """Decides the test: from the cache, by the known counterexamples, or by a search."""
        key = self._key()
        cached = (
            self._cached(key) if self.limits.use_cache and not self.limits.only_replay else None
        )
        if cached is not None:
            return cached
        outcome = self._known()
        if outcome.passes and not self.limits.only_replay:
            searched = self._search()
            outcome = dataclasses.replace(
                searched, simulations=outcome.simulations + searched.simulations
            )
        if key is not None and not self.limits.only_replay:
            state = {"key": key, "passes": outcome.passes, "text": outcome.text}
            write_text(self.folder / STATE, json.dumps(state, indent=1))
        return outcome

    @property
    def _is_native(self) -> bool:
        """Whether the Rust core simulates the system, so that the command line can, too."""
        policy = self.requirement.options.get("policy")
        return (
            isinstance(self.system, (str, os.PathLike))
            and isinstance(policy, (str, os.PathLike, type(None)))
        )

    def _arguments(self) -> dict[str, Any]:
        return {
            "formula": self.requirement.formula, "space": self.requirement.space,
            **self.requirement.options
        }

    def _key(self) -> str | None:
        """Returns a hash of all that decides the outcome; ``None`` if a part of the system has no
        hash."""
        required, system = self.requirement, self.system
        options: dict[str, Any] = dict(required.options)
        files = file_hashes(options.pop("files", ()))
        policy = options.pop("policy", None)
        parts: list[Any] = [
            _native.__version__, required.search, required.trials, self.budget, self.seed, files
        ]
        space = required.space
        parts.append(
            [axis.to_document() for axis in space]
            if isinstance(space, Sequence) and not isinstance(space, str) else space
        )
        if required.formula is not None:
            parts.append(
                sorted((name, str(text)) for name, text in named_formulas(required.formula).items())
            )
        if self._is_native:
            target = make_target(system, required.formula, space, required.options)
            parts.append(target.native.hashes)
        else:
            roots = {"system": system, "policy": policy, "options": options}
            if not isinstance(space, str) and space is not None:
                roots["axes"] = {axis.name: axis.apply for axis in space}
            found = Watch(roots).fingerprints()
            if any(each.gaps for each in found.values()) and options.get("version") is None:
                return None
            parts.append([
                (name, each.digest, sorted(each.packages.items())) for name, each in found.items()
            ])
        known = [path.read_bytes() for path in self._known_files()]
        parts.append([hashlib.sha256(content).hexdigest() for content in known])
        return hashlib.sha256(repr(parts).encode("utf-8", "surrogatepass")).hexdigest()

    def _cached(self, key: str | None) -> Outcome | None:
        try:
            state = json.loads((self.folder / STATE).read_text(encoding="utf-8"))
            if key is not None and state["key"] == key:
                return Outcome(bool(state["passes"]), str(state["text"]), is_cached=True)
        except (OSError, ValueError, KeyError, TypeError):
            pass
        return None

    def _folders(self) -> list[pathlib.Path]:
        given = self.requirement.counterexamples
        folders = [self.folder / KNOWN]
        if given is not None:
            folder = self.source.parent / given
            if not folder.is_dir():
                raise InvalidValueError(f"there is no folder of counterexamples {folder}")
            folders.insert(0, folder)
        return folders

    def _known_files(self) -> list[pathlib.Path]:
        given = self.requirement.counterexamples
        return sorted((self.source.parent / given).glob("*.json")) if given is not None else []

    def _known(self) -> Outcome:
        """Simulates the known counterexamples."""
        simulations, notes = 0, []
        for folder in self._folders():
            if not any(folder.glob("*.json")):
                continue
            found = regress(folder, self.system, **self._arguments())
            simulations += len(found.tests)
            fails = [test for test in found.tests if test.result == "still fails"]
            if fails:
                worst = min(
                    fails, key=lambda test: test.robustness if test.robustness is not None else 0.0
                )
                return Outcome(False, self._known_text(folder / worst.file, worst), simulations)
            undecided = [test for test in found.tests if test.result == "no verdict"]
            if undecided:
                text = "\n".join(f"{test.file}: {test.reason}" for test in undecided)
                return Outcome(
                    False, f"a known counterexample has no verdict now, so it is not fixed\n{text}",
                    simulations
                )
            # The space or the formula is another one now.
            notes += [
                f"{test.file}: {test.reason}" for test in found.tests if test.result == "error"
            ]
        text = "".join(f"\nnot simulated: {note}" for note in notes)
        return Outcome(True, f"{simulations} known counterexamples satisfy it{text}", simulations)

    def _known_text(self, file: pathlib.Path, found: RegressionTest) -> str:
        lines = [
            f"a known counterexample still violates {self._formula()}",
            f"robustness {found.robustness:.6g}: {found.reason}"
        ]
        lines += _scenario(json.loads(file.read_text(encoding="utf-8")))
        return "\n".join([*lines, *self._files(file)])

    def _search(self) -> Outcome:
        required = self.requirement
        self.folder.mkdir(parents=True, exist_ok=True)
        run = self.folder / "run.sqlite"
        # Another process can run the same test.
        part = self.folder / f"run-{os.getpid()}.sqlite"
        part.unlink(missing_ok=True)
        try:
            arguments = self._arguments()
            arguments["plan"] = {
                "falsify": {"isolate": False}, "report": {"repeats": 0},
                **(arguments.get("plan") or {})
            }
            found = falsify(
                self.system, search=required.search, trials=required.trials, budget=self.budget,
                seed=self.seed, out=part, **arguments
            )
            os.replace(part, run)
        finally:
            part.unlink(missing_ok=True)
        if found.counterexamples:
            return Outcome(
                False, self._report(found, found.counterexamples[0], run), found.simulations
            )
        if found.exceptions:
            # A violation could be where the system crashes.
            return Outcome(False, self._crash(found), found.simulations)
        if all(trial.minimum_robustness is None for trial in found.trials):
            return Outcome(
                False,
                f"none of {found.simulations} simulations has a verdict about {self._formula()}",
                found.simulations
            )
        why = _native.inconclusive_text(_without_verdict(found))
        if why is not None:
            return Outcome(
                False,
                f"no conclusion about {self._formula()}: {_ends(found)}; "
                f"{why.removeprefix('no conclusion: ')}",
                found.simulations
            )
        reasons = [
            f"{each.name}: {each.asks_nothing}" for each in found.requirements or []
            if each.asks_nothing is not None
        ]
        if not found.requirements and found.asks_nothing is not None:
            reasons = [found.asks_nothing]
        if reasons:
            return Outcome(
                False,
                f"no conclusion about {self._formula()}: not violated: asks nothing: "
                + "; ".join(reasons), found.simulations
            )
        least = min(
            trial.minimum_robustness for trial in found.trials
            if trial.minimum_robustness is not None
        )
        text = (
            f"not violated in {found.simulations} simulations, least robustness {least:.6g}, seed "
            f"{self.seed}"
        )
        return Outcome(True, text + _caveats(found), found.simulations)

    def _report(self, found: Falsification, trial: Trial, run: pathlib.Path) -> str:
        simulation = trial.first_violation if trial.simulation is None else trial.simulation
        if simulation is None:
            raise InvalidValueError(f"trial {trial.trial} has no simulation")
        content = _native.counterexample(os.fspath(run), trial.trial, simulation)
        name = hashlib.sha256(content.encode()).hexdigest()[:8]
        (self.folder / KNOWN).mkdir(parents=True, exist_ok=True)
        file = write_counterexample(
            run, trial.trial, simulation, self.folder / KNOWN / f"{name}.json"
        )
        lines = [
            f"violated: {self._formula()}",
            f"robustness {trial.minimum_robustness:.6g}, seed {trial.seed}, found after "
            f"{_simulations(found.simulations)} by {found.search}",
            *_scenario(json.loads(content)),
        ]
        explained = open_run(run).explain(trial.trial, simulation, plan={"report": {"axes": 0}})
        lines += map(str, explained.sentences)
        open_run(run).report(self.folder / "report.html", plan={"report": {"simulations": False}})
        picture = self._picture(run, trial.trial, simulation)
        text = "\n".join([*lines, *self._files(file)]) + _caveats(found)
        return text + f"\npage: {_shown(self.folder / 'report.html')}" + (
            f"\npicture: {_shown(picture)}" if picture else ""
        )

    def _crash(self, found: Falsification) -> str:
        """Returns the report about a system that raised an exception."""
        lines = [
            f"the system raised an exception: {sum(trial.failed for trial in found.trials)} of "
            f"{found.simulations} simulations failed"
        ]
        first = next(
            (
                trial.first_unevaluated for trial in found.trials
                if trial.first_unevaluated is not None
            ),
            None
        )
        if first is not None:
            nominal = {axis.name: axis.nominal for axis in found.space_axes}
            values = [
                {"axis": name, "value": value, "nominal": nominal.get(name)}
                for name, value in first.scenario.items()
            ]
            lines += [*_scenario({"scenario": values}), f"    seed {first.seed}"]
        return "\n".join([*lines, found.exceptions[0].rstrip()])

    def _formula(self) -> str:
        formula = self.requirement.formula
        if isinstance(formula, Mapping):
            return "; ".join(f"{name}: {text}" for name, text in formula.items())
        return "the first formula of the target" if formula is None else str(formula)

    def _files(self, file: pathlib.Path) -> list[str]:
        lines = [f"counterexample: {_shown(file)}", f"replay: {self.again} --mishandle-replay"]
        if self._is_native:
            lines.append(f"    or: mishandle replay {shlex.quote(_shown(file))}")
        return lines

    def _picture(self, run: pathlib.Path, trial: int, simulation: int) -> pathlib.Path | None:
        """Draws the counterexample: its scene if it has one, otherwise its signals."""
        png, svg = self.folder / "counterexample.png", self.folder / "counterexample.svg"
        png.unlink(missing_ok=True)
        svg.unlink(missing_ok=True)
        chosen = ["--trial", str(trial), "--simulation", str(simulation)]
        if (
            self._is_native
            and _command("render", os.fspath(run), *chosen, "--out", os.fspath(png))
            and png.is_file()
        ):
            return png
        opened = open_run(run)
        trace = opened.trace(trial, simulation)
        if trace is None:
            return None
        try:
            axes = plot_trace(
                trace, opened.formula, units=dict(opened.signals), period=opened.control_dt
            )
            figure: Any = axes[0].figure
            figure.savefig(png)
            close(figure)
            return png
        except MissingPackageError:
            log = self.folder / "trace.csv"
            steps = range(len(next(iter(trace.values()), [])))
            rows = [",".join(["time", *trace])]
            rows += [
                ",".join([
                    repr(step * opened.control_dt),
                    *(repr(float(column[step])) for column in trace.values())
                ])
                for step in steps
            ]
            write_text(log, "\n".join(rows) + "\n")
            return (
                svg
                if _command("formula", opened.formula, os.fspath(log), "--out", os.fspath(svg))
                and svg.is_file()
                else None
            )


def _command(*words: str) -> bool:
    """Runs the command line in a process of its own. Returns whether it succeeded."""
    code = "import sys; from mishandle.command import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, check=False, timeout=300
    )
    return done.returncode == 0


def _shown(path: pathlib.Path) -> str:
    """Returns a path from the working folder, if that is shorter."""
    try:
        return os.fspath(path.relative_to(pathlib.Path.cwd()))
    except ValueError:
        return os.fspath(path)


def _scenario(counterexample: Mapping[str, Any]) -> list[str]:
    """Returns the values of a counterexample file beside the nominal ones, as lines."""
    lines = []
    for axis in counterexample["scenario"]:
        name, unit = axis["axis"], axis.get("unit") or ""
        value, nominal = (_value(axis.get(key)) for key in ("value", "nominal"))
        lines.append(f"    {name} = {value} {unit}".rstrip() + f" (nominal {nominal})")
    return ["scenario:", *lines]


def _simulations(count: int) -> str:
    return "1 simulation" if count == 1 else f"{count} simulations"


def _value(value: Any) -> str:
    return "random" if value is None else value if isinstance(value, str) else f"{value:.6g}"


def _without_verdict(found: Falsification) -> str:
    return json.dumps(dataclasses.asdict(found.without_verdict))


def _ends(found: Falsification) -> str:
    return _native.without_verdict_text(_without_verdict(found))


def _caveats(found: Falsification) -> str:
    notes = []
    if found.largest_difference > 0:
        notes.append(
            "the system is not deterministic (two simulations of the same scenario and seed "
            f"differ by {found.largest_difference:g}): this outcome can be another one next time"
        )
    if found.without_verdict.share or found.without_verdict.invalid_starts:
        notes.append(_ends(found))
    return "".join(f"\nnote: {note}" for note in notes)
