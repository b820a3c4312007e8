"""Relations between the results of pairs of scenarios: metamorphic relations."""

import pathlib
from dataclasses import dataclass
from typing import Any

from typing_extensions import Unpack

import mishandle.results as results
from mishandle.ask.margins import check_tested
from mishandle.base.documents import Call
from mishandle.base.files import PathLike
from mishandle.runs.documents import RunFile, RunOptions, RunResult, write_counterexample
from mishandle.runs.targets import Formulas, Space, make_target


@dataclass(frozen=True, kw_only=True, repr=False)
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
    seed: int | None = None,
    **settings: Unpack[RunOptions],
) -> Metamorphic:
    """Compares pairs of scenarios: what must hold if a scenario is changed.

    Source cases are random scenarios. The change gives the follow-up case, with the same seed. A
    follow-up case outside of the bounds of an axis is counted and not simulated. A pair without two
    verdicts is no evidence. ``docs/guide/metamorphic.md`` explains the relations, which ``plan``
    states. The other arguments are those of :func:`falsify`.

    Examples
    --------
    The gap depends on the difference of two speeds, so the same speed more on both changes nothing:

    >>> from mishandle import Axis
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - (scenario["own"] - scenario["front"])]}
    >>> space = [Axis("own", 0, 20, "m/s"), Axis("front", 0, 20, "m/s")]
    >>> import tempfile
    >>> out = tempfile.mkdtemp() + "/run.sqlite"
    >>> faster = {"change": {"own": "+1", "front": "+1"}, "holds": "robustness-within:1e-9"}
    >>> plan = {"metamorphic": {"pairs": 50, "relations": {"faster": faster}}}
    >>> metamorphic(system, "always(gap >= 2)", space, plan=plan, out=out).is_broken
    False
    """
    run = RunFile(settings)
    call = Call("metamorphic", settings, {"seed": seed})
    made = make_target(system, formula, space, run.target, call)
    result = run.ask(Metamorphic, made)
    check_tested(made, any(relation.broken_rate.n > 0 for relation in result.relations))
    return result
