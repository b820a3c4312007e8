"""Simulation of chosen scenarios, and of recorded ones again."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from typing_extensions import Unpack

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.documents import Call
from mishandle.base.files import PathLike, write_text
from mishandle.errors import InvalidValueError
from mishandle.results import Regression
from mishandle.runs.documents import read
from mishandle.runs.run_files import Run
from mishandle.runs.targets import Formulas, Simulation, Space, TargetOptions, make_target
from mishandle.scenarios.arguments import check_number, scenario_numbers
from mishandle.scenarios.axes import Value


@dataclass(frozen=True, kw_only=True)
class Replay(results.Replay):
    """A recorded simulation and its repetition. Without differences, everything recorded has the
    same bits."""

    repetition: Simulation
    """The repeated simulation with its trace."""
    recorded_robustness: float | None
    """Robustness in the file."""
    build_differences: tuple[str, ...]
    """Differences between the program that made the file and this one."""


def simulate(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    at: Mapping[str, Value] | Sequence[float] | None = None,
    repeat: int = 1,
    seed: int | None = None,
    **target: Unpack[TargetOptions],
) -> list[Simulation]:
    """Simulates one scenario. Axes that ``at`` leaves out are nominal.

    One simulation has the seed ``seed``. With ``repeat``, there are several with seeds that are
    derived from it, the same as those of :func:`repeat`.

    >>> from mishandle import Axis
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> [found] = simulate(
    ...     system, "always(gap >= 2)", [Axis("speed", 0, 10, "m/s")], at={"speed": 9}
    ... )
    >>> (found.robustness, found.trace["gap"].tolist())
    (-1.0, [10.0, 1.0])
    """
    check_number("repeat", repeat, 1)
    found = make_target(
        system, formula, space, target, Call("simulate", target, {"seed": seed}),
        check=lambda space: scenario_numbers(space, at)
    )
    point = scenario_numbers(found.space, at, found.nominal)
    simulations = _native.simulate(found.native, values=point, repeat=repeat)
    return [found.simulation(simulation) for simulation in simulations]


def repeat(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    at: Mapping[str, Value] | Sequence[float] | None = None,
    repeats: int | None = None,
    seed: int | None = None,
    **target: Unpack[TargetOptions],
) -> results.Simulation:
    """Measures how often one scenario fails with seeds that are derived from ``seed``, and how much
    of the robustness is noise.

    ``repeats`` of the result counts the failures, ``noise`` says which share of the variance comes
    from the scenario. A system without randomness is simulated once.

    Parameters
    ----------
    system, formula, space, at, **target
        See :func:`simulate`. ``simulate.scenarios`` of ``plan`` is the number of random scenarios
        that measure the noise, each of them simulated twice (200); 0 skips this.
    repeats : int, optional
        Number of simulations of the scenario; by default 100.
    seed : int
        Random seed, of which the seeds of the simulations are derived.

    Examples
    --------
    >>> import random
    >>> from mishandle import Axis
    >>> def system(scenario, seed):
    ...     return {"gap": [10.0, 2.0 + random.Random(seed).gauss(0.0, 1.0)]}
    >>> found = repeat(
    ...     system, "always(gap >= 2)", [Axis("speed", 0, 10, "m/s")], at={"speed": 5}, repeats=200
    ... )
    >>> found.repeats.failure_rate.low < 0.5 < found.repeats.failure_rate.high
    True
    """
    if repeats is not None:
        check_number("repeats", repeats, 1)
    found = make_target(
        system, formula, space, target, Call("simulate", target, {"seed": seed}),
        check=lambda space: scenario_numbers(space, at)
    )
    point = scenario_numbers(found.space, at, found.nominal)
    text = _native.repeat(found.native, values=point, repeats=repeats)
    return read(results.Simulation, text)


def regress(
    folder: PathLike,
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    baseline: Any = None,
    repeats: int = 0,
    junit: PathLike | None = None,
    **target: Unpack[TargetOptions],
) -> Regression:
    """Simulates the counterexample files of a folder with a system, such as a new version of a
    policy.

    Parameters
    ----------
    folder : path
        Folder with files ``*.json`` of :meth:`Falsification.export` or of ``mishandle
        regress --add``.
    system, formula, space, **target
        See :func:`falsify`. The axes must be the axes of the files. ``regress.max_failure_rate`` of
        ``plan`` is, with ``repeats``, the largest failure rate of a test that passes (0).
    baseline : optional
        Version to compare with: another policy if there is a ``policy``, otherwise another
        function. Only a test that fails although it passes with the baseline is then a ``"new
        failure"``.
    repeats : int
        Number of further simulations of each file with other seeds, which decide the test.
    junit : path, optional
        File for the results as JUnit XML, which continuous integration shows as tests; an existing
        file is replaced.

    Examples
    --------
    >>> import tempfile
    >>> from mishandle import Axis, falsify
    >>> folder, space = tempfile.mkdtemp(), [Axis("speed", 0, 10, "m/s")]
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> found = falsify(
    ...     system, "always(gap >= 2)", space, trials=1, budget=50, name="car",
    ...     out=folder + "/run.sqlite"
    ... )
    >>> [file.name for file in found.export(folder).paths]
    ['run-mode-1.json']
    >>> [
    ...     test.result
    ...     for test in regress(folder, system, "always(gap >= 2)", space, name="car").tests
    ... ]
    ['still fails']
    >>> better = lambda scenario: {"gap": [10.0, 10.0 - 0.5 * scenario["speed"]]}
    >>> found = regress(
    ...     folder, better, "always(gap >= 2)", space, name="car", baseline=system,
    ...     junit=folder + "/report.xml"
    ... )
    >>> (
    ...     found.passes, found.tests[0].result,
    ...     open(folder + "/report.xml").read().count("<testcase")
    ... )
    (1, 'fixed', 1)
    """
    check_number("repeats", repeats, 0)
    made = make_target(system, formula, space, target, Call("regress", target))
    other = None
    if baseline is not None:
        has_policy = target.get("policy") is not None
        options: TargetOptions = {**target, "policy": baseline} if has_policy else target
        other = make_target(
            system if has_policy else baseline, formula, space, options, Call("regress", options)
        ).native
    text, xml = _native.regress(
        made.native, os.fspath(folder), baseline=other, repeats=repeats
    )
    found = read(Regression, text)
    if not found.tests:
        raise InvalidValueError(
            f"there is no counterexample (*.json) in {os.fspath(folder)}; write some with `export`"
        )
    if junit is not None:
        write_text(junit, xml)
    return found


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

    ``path`` is a run file, or a counterexample file (``.json``) of an ``export``, which has one
    simulation. A file never imports code: pass the system, formula and space of the run.
    """
    is_counterexample = os.fspath(path).lower().endswith(".json")
    if is_counterexample and not (trial is None and number is None):
        raise InvalidValueError(
            "a counterexample file has one simulation; leave out `trial` and `number`"
        )
    # A counterexample file comes from a search.
    is_evaluation = not is_counterexample and Run(path).is_evaluation
    call = Call("evaluate" if is_evaluation else "simulate", target)
    found = make_target(system, formula, space, target, call)
    if is_counterexample:
        again = _native.replay_counterexample(found.native, os.fspath(path))
    else:
        again = _native.replay(found.native, path=os.fspath(path), trial=trial, number=number)
    text, simulation, robustness, build_differences = again
    return Replay(
        **vars(read(results.Replay, text)), repetition=found.simulation(simulation),
        recorded_robustness=robustness, build_differences=tuple(build_differences)
    )
