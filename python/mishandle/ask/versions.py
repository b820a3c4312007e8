"""Comparison of two versions that stops by itself, and how many simulations it takes."""

from __future__ import annotations

import os
from typing import Any

from typing_extensions import Unpack

import mishandle._native as _native
from mishandle.base.files import PathLike
from mishandle.base.interruption import Progress
from mishandle.errors import InvalidValueError
from mishandle.results import SampleSize
from mishandle.runs.documents import read
from mishandle.runs.explanations import Comparison, compare
from mishandle.runs.targets import Formulas, Space, TargetOptions, make_target
from mishandle.scenarios.arguments import check_number, check_out


def compare_versions(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    baseline: Any,
    until: str = "decided",
    margin: float | None = None,
    measure: str = "success",
    robustness_bounds: tuple[float, float] | None = None,
    episodes: int = 1000,
    batch: int = 64,
    seed: int = 0,
    out: tuple[PathLike, PathLike] | None = None,
    resume: bool = False,
    durable: bool = False,
    progress: Progress | None = None,
    **target: Unpack[TargetOptions],
) -> Comparison:
    """Evaluates two versions on the same scenarios and seeds until a rule decides, and compares
    them.

    A is the baseline, B the other. The interval and the p-value of the difference hold at any time;
    ``sequential`` of the result says what the rule found.

    Parameters
    ----------
    system, formula, space, **target
        See :func:`falsify`.
    baseline
        Version to compare with: another policy if there is a ``policy``, otherwise another
        function.
    until : str
        When it stops, looking after each batch: ``"decided"`` (the interval of the difference
        excludes 0, or lies within ``margin``) or a width such as ``"width=0.04"``.
    margin : float, optional
        The largest difference that counts as none.
    measure : str
        ``"success"``, or ``"robustness"``: its mean, clipped to ``robustness_bounds``.
    robustness_bounds : (float, float), optional
        Bounds of the robustness; values beyond them count as the bound.
    episodes : int
        Largest number of pairs.
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
    check_number("seed", seed, 0)
    check_number("episodes", episodes, 1)
    check_number("batch", batch, 1)
    if out is not None and (isinstance(out, (str, os.PathLike)) or len(out) != 2):
        raise InvalidValueError("`out` must be a pair of paths: the run files of A and of B")
    for path in out or [None]:
        check_out(path, resume, False)
    has_policy = target.get("policy") is not None
    options: TargetOptions = {**target, "policy": baseline} if has_policy else target
    first = make_target(
        system if has_policy else baseline, formula, space, options, lambda space: None,
        has_metrics=True
    )
    second = make_target(system, formula, space, target, lambda space: None, has_metrics=True)
    paths, is_complete = _native.evaluate_pairs(
        first.native, second.native, until=until, margin=margin, measure=measure,
        robustness_bounds=robustness_bounds, episodes=episodes, batch=batch, seed=seed,
        out=None if out is None else (os.fspath(out[0]), os.fspath(out[1])), resume=resume,
        durable=durable, progress=progress
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
    both: float | None = None,
    until: str = "decided",
    rate: float | None = None,
    margin: float | None = None,
    episodes: int = 10_000,
    batch: int = 64,
    replications: int = 1000,
    seed: int = 0,
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
    both : float, optional
        Expected share of pairs in which both succeed; by default the product of both rates, which
        takes the most pairs.
    until, rate, margin
        The rule: see :func:`evaluate` and :func:`compare_versions`.
    episodes : int
        Largest number of simulations or pairs.
    batch : int
        Number of simulations or pairs between two looks.
    replications : int
        Number of replications of the rule.
    seed : int
        Random seed of the replications.

    Examples
    --------
    >>> found = sample_size(0.5, until="width=0.1", replications=50)
    >>> (found.fixed, found.median > found.fixed)
    (381, True)
    """
    check_number("seed", seed, 0)
    pairs = None
    if against is not None:
        share = expect * against if both is None else both
        pairs = (share, expect - share, against - share, 1 - expect - against + share)
    text = _native.sample_size(
        expect=expect, pairs=pairs, until=until, rate=rate, margin=margin, episodes=episodes,
        batch=batch, replications=replications, seed=seed
    )
    return read(SampleSize, text)
