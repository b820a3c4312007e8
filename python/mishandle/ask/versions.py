"""Comparison of two versions that stops by itself, and how many simulations it takes."""

import os
from typing import Any, Literal

from typing_extensions import Unpack

import mishandle._native as _native
from mishandle.base.documents import Call, Plan
from mishandle.base.files import PathLike
from mishandle.base.interruption import Progress
from mishandle.base.progress import reporting
from mishandle.errors import InvalidValueError
from mishandle.results import SampleSize
from mishandle.runs.documents import read
from mishandle.runs.explanations import Comparison, compare
from mishandle.runs.targets import Formulas, Space, TargetOptions, make_target
from mishandle.scenarios.arguments import check_out


def compare_versions(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    baseline: Any,
    until: str | None = None,
    episodes: int | None = None,
    seed: int | None = None,
    out: tuple[PathLike, PathLike] | None = None,
    resume: bool = False,
    progress: Progress | Literal[False] | None = None,
    **target: Unpack[TargetOptions],
) -> Comparison:
    """Evaluates two versions on the same scenarios and seeds until a rule decides, and compares
    them.

    A is the baseline, B the other. The interval and the p-value of the difference hold at any time;
    ``sequential`` of the result says what the rule found. The other arguments are those of
    :func:`falsify`; ``compare`` in ``plan`` has the margin and the measure of the rule.

    Parameters
    ----------
    baseline
        Version to compare with: another policy if there is a ``policy``, otherwise another
        function.
    until : str
        When it stops, looking after each batch: ``"decided"`` (the interval of the difference
        excludes 0, or lies within the margin; the default) or a width such as ``"width=0.04"``.
    episodes : int
        Largest number of pairs (1000).
    out : (path, path), optional
        Run files of A and B; by default the first free names in the folder ``runs``.
    resume : bool
        Whether to continue the runs in ``out``.

    Examples
    --------
    >>> import tempfile
    >>> from mishandle import Axis
    >>> folder = tempfile.mkdtemp()
    >>> old = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> new = lambda scenario: {"gap": [10.0, 10.0 - 0.9 * scenario["speed"]]}
    >>> runs = (folder + "/old.sqlite", folder + "/new.sqlite")
    >>> found = compare_versions(
    ...     new, "always(gap >= 2)", [Axis("speed", 0, 10, "m/s")], baseline=old, name="car",
    ...     out=runs
    ... )
    >>> (found.sequential.decision, found.sequential.simulations < 1000)
    ('above', True)
    """
    if out is not None and (isinstance(out, (str, os.PathLike)) or len(out) != 2):
        raise InvalidValueError("`out` must be a pair of paths: the run files of A and of B")
    for path in out or [None]:
        check_out(path, resume)
    has_policy = target.get("policy") is not None
    options: TargetOptions = {**target, "policy": baseline} if has_policy else target

    def made(system: Any, options: TargetOptions) -> _native.Target:
        call = Call(
            "compare", options,
            {"seed": seed, "compare": {"until": until}, "evaluate": {"episodes": episodes}},
            {"evaluate": {"episodes": 1000, "control": False}}
        )
        return make_target(system, formula, space, options, call).native

    first, second = made(system if has_policy else baseline, options), made(system, target)
    with reporting(progress) as report:
        paths, is_complete = _native.evaluate_pairs(
            first, second, out=None if out is None else (os.fspath(out[0]), os.fspath(out[1])),
            resume=resume, progress=report
        )
    if not is_complete:
        raise InvalidValueError(
            f"the comparison was interrupted; continue it with resume=True and out={paths}"
        )
    return compare(*paths)


def sample_size(
    expect: float,
    *,
    against: float | None = None,
    until: str | None = None,
    rate: float | None = None,
    episodes: int | None = None,
    seed: int | None = None,
    plan: Plan | None = None,
) -> SampleSize:
    """Returns how many simulations or pairs a question takes, fixed beforehand and with a rule that
    stops by itself.

    No system is simulated. ``docs/guide/compare.md`` explains the numbers.

    Parameters
    ----------
    expect : float
        Expected success rate; in a comparison, that of A.
    against : float, optional
        Expected success rate of B: asks about pairs.
    until, rate
        The rule: see :func:`evaluate` and :func:`compare_versions`.
    episodes : int
        Largest number of simulations or pairs (10,000).
    seed : int
        Random seed of the replications.
    plan : dict
        Rare settings: the tables ``size`` and ``compare`` of a plan.

    Examples
    --------
    >>> found = sample_size(0.5, until="width=0.1", plan={"size": {"replications": 50}})
    >>> (found.fixed, found.median > found.fixed)
    (381, True)
    """
    rule = {"evaluate": {"episodes": episodes, "until": until, "rate": rate}}
    if against is not None:
        rule = {"evaluate": {"episodes": episodes}, "compare": {"until": until}}
    call = Call(
        "evaluate" if against is None else "compare", {"plan": plan}, {**rule, "seed": seed},
        {"evaluate": {"episodes": 10_000}}
    )
    rates = [expect] if against is None else [expect, against]
    return read(SampleSize, _native.sample_size(call.text(), rates))
