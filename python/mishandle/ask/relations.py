"""Relations between the results of pairs of scenarios: metamorphic relations."""

from __future__ import annotations

import pathlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict

from typing_extensions import NotRequired, Unpack

import mishandle._native as _native
import mishandle.results as results
from mishandle.ask.margins import untested
from mishandle.base.files import PathLike
from mishandle.base.interruption import after_the_batch, deliver
from mishandle.errors import InvalidTypeError, InvalidValueError, MishandleError
from mishandle.runs.documents import RunFile, RunOptions, RunResult, answer, write_counterexample
from mishandle.runs.targets import Formulas, Space, make_target
from mishandle.scenarios.arguments import check_number
from mishandle.scenarios.axes import Axis


class Relation(TypedDict):
    """A metamorphic relation: how the follow-up case differs from the source case, and what must
    hold between their results."""

    change: Mapping[str, str | float]
    """The change of each axis: an offset ``"+0.02"``, a factor ``"*0.8"`` or ``"-20%"``, a value
    ``"=0.3"`` or ``0.3``, a category."""
    holds: NotRequired[str]
    """``"same-verdict"`` (default), ``"not-better"``, ``"not-worse"``, the last two also with a
    tolerance of the robustness as in ``"not-worse:0.05"``, or ``"robustness-within:0.05"``."""


@dataclass(frozen=True, kw_only=True)
class Metamorphic(RunResult, results.Metamorphic):
    """Relations between the results of pairs of scenarios."""

    @property
    def is_broken(self) -> bool:
        """Whether a pair breaks a relation."""
        return any(relation.broken > 0 for relation in self.relations)

    def export(self, path: PathLike, case: results.PairCase) -> pathlib.Path:
        """Writes a case that violates the formula as a counterexample file (``.json``), for
        :func:`replay` and :func:`regress`.

        ``case`` is that of a broken pair, such as ``found.relations[0].worst[0].follow_up``. An
        existing file is replaced.
        """
        return write_counterexample(self.path, case.trial, case.simulation, path)


def metamorphic(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    change: Mapping[str, str | float] | None = None,
    holds: str = "same-verdict",
    relations: Mapping[str, Relation] | None = None,
    pairs: int = 100,
    batch: int = 64,
    seed: int = 0,
    **settings: Unpack[RunOptions],
) -> Metamorphic:
    """Compares pairs of scenarios: what must hold if a scenario is changed.

    Source cases are random scenarios. The change gives the follow-up case, with the same seed. A
    follow-up case outside of the bounds of an axis is counted and not simulated. A pair without two
    verdicts is no evidence. ``docs/guide/metamorphic.md`` explains the relations.

    Parameters
    ----------
    system, formula, space, **settings
        See :func:`falsify`.
    change : dict
        The change of each axis, of one relation: see :class:`Relation`.
    holds : str
        What must hold between the two results, of the same relation.
    relations : dict
        Several relations by name, instead of ``change``.
    pairs : int
        Number of source cases.
    batch : int
        Number of simulations that run together. The result does not depend on it.
    seed : int
        Seed of the source cases.

    Returns
    -------
    Metamorphic

    Raises
    ------
    MishandleError
        If a name, a number or a formula is invalid, all follow-up cases are out of bounds, or no
        pair has two verdicts.

    Examples
    --------
    The gap depends on the difference of two speeds, so the same speed more on both changes nothing:

    >>> system = lambda scenario: {"gap": [10.0, 10.0 - (scenario["own"] - scenario["front"])]}
    >>> space = [Axis("own", 0, 20, "m/s"), Axis("front", 0, 20, "m/s")]
    >>> import tempfile
    >>> out = tempfile.mkdtemp() + "/run.sqlite"
    >>> faster = {"own": "+1", "front": "+1"}
    >>> found = metamorphic(
    ...     system, "always(gap >= 2)", space, change=faster, holds="robustness-within:1e-9",
    ...     out=out
    ... )
    >>> found.is_broken
    False
    """
    run = RunFile(settings)
    check_number("seed", seed, 0)
    check_number("pairs", pairs, 1)
    check_number("batch", batch, 1)
    asked = native_relations(change, holds, relations)

    def check(space: Sequence[Axis]) -> None:
        _native.check_metamorphic(
            [axis.to_native() for axis in space], relations=asked, pairs=pairs, batch=batch,
            seed=seed
        )

    made = make_target(system, formula, space, run.target, check)
    with after_the_batch(run.progress) as report:
        text, interruption, notes = _native.metamorphic(
            made.native, formula=made.formula, relations=asked, pairs=pairs, batch=batch, seed=seed,
            out=run.native, progress=report
        )
    result = answer(Metamorphic, made, text, notes)
    if interruption is None and all(relation.broken_rate.n == 0 for relation in result.relations):
        raise untested(made.system.exceptions)
    return deliver(result, interruption)


def native_relations(
    change: Mapping[str, str | float] | None, holds: str, relations: Mapping[str, Relation] | None
) -> list[tuple[str, dict[str, str], str]]:
    """Returns the relations as names and texts."""
    if (change is None) == (relations is None):
        raise InvalidValueError(
            'expected either change, such as {"x": "+0.02"}, or relations, such as {"shift": '
            '{"change": {"x": "+0.02"}}}'
        )
    given = (
        {"relation": Relation(change=change, holds=holds)} if change is not None
        else dict(relations or {})
    )
    found = []
    for name, relation in given.items():
        if (
            not isinstance(relation, Mapping) or "change" not in relation
            or set(relation) > {"change", "holds"}
        ):
            raise InvalidTypeError(
                f'the relation {name} is {relation!r}; it must be a dict with the key "change" '
                'and, optionally, "holds"'
            )
        if not isinstance(relation["change"], Mapping):
            raise InvalidTypeError(
                f'the change of {name} is {relation["change"]!r}; it must be a dict, such as '
                '{"x": "+0.02"}'
            )
        texts = {axis: change_text(value) for axis, value in relation["change"].items()}
        found.append((name, texts, relation.get("holds", "same-verdict")))
    if not found:
        raise MishandleError("there is no relation; expected at least one")
    return found


def change_text(value: str | float) -> str:
    """Returns the change of an axis as text: a number is a value."""
    return value if isinstance(value, str) else f"={float(value)!r}"
