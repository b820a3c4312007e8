"""The smallest disturbance that makes a system fail."""

import pathlib
import warnings
from dataclasses import dataclass
from typing import Any

from typing_extensions import Unpack

import mishandle.results as results
from mishandle.base.documents import Call
from mishandle.base.files import PathLike
from mishandle.errors import MishandleError
from mishandle.runs.documents import RunFile, RunOptions, RunResult, write_counterexample
from mishandle.runs.targets import Formulas, Space, Target, make_target


@dataclass(frozen=True, kw_only=True, repr=False)
class Margin(RunResult, results.Margin):
    """The smallest disturbance that violates a requirement."""

    def export(self, path: PathLike) -> pathlib.Path:
        """Writes the witness as a counterexample file (``.json``), for :func:`replay` and
        :func:`regress`.

        An existing file is replaced. Returns the path.
        """
        if self.witness is None:
            raise MishandleError(
                "there is no witness to export: no simulation violates the formula"
            )
        return write_counterexample(self.path, 1, self.witness.simulation, path)


def margin(
    system: Any,
    formula: Formulas = None,
    space: Space = None,
    *,
    budget: int | None = None,
    seed: int | None = None,
    **settings: Unpack[RunOptions],
) -> Margin:
    """Searches for the smallest disturbance with which a system violates a formula.

    The disturbed axes are those of the space with a nominal value, except for initial states
    (``kind="start"``) and categories. Initial states vary in their whole range. The result is an
    upper bound with a witness: a smaller disturbance that violates the formula may exist.
    ``docs/guide/margin.md`` explains the search. The other arguments are those of
    :func:`falsify`; the default space of a task is ``"disturbance"``.

    Parameters
    ----------
    budget : int
        Largest number of simulations (3000). A system that depends on its seed is simulated up to
        100 times more: the witness with other seeds.
    seed : int
        Seed of the search. A deterministic system is simulated with it, one that depends on its
        seed with many derived seeds.

    Examples
    --------
    The gap is too small above 8 m/s, which is 80 % of the way from 0 to 10 m/s:

    >>> from mishandle import Axis
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> space = [Axis("speed", 0, 10, "m/s", nominal=0, kind="input")]
    >>> import tempfile
    >>> found = margin(
    ...     system, "always(gap >= 2)", space, budget=300, out=tempfile.mkdtemp() + "/run.sqlite"
    ... )
    >>> 0.8 < found.witness.amplitude < 0.82
    True
    """
    run = RunFile(settings)
    call = Call("margin", settings, {"margin": {"budget": budget}, "seed": seed})
    made = make_target(system, formula, space, run.target, call)
    result = run.ask(Margin, made)
    if result.categories and not result.each_category:
        fixed = ", ".join(f"{name} = {category}" for name, category in result.categories.items())
        warnings.warn(
            f"a margin varies numeric axes only, so {fixed} stayed; "
            'plan={"margin": {"each_category": True}} searches each category',
            stacklevel=2
        )
    check_tested(made, any(level.minimum_robustness is not None for level in result.levels))
    return result


def check_tested(target: Target, is_tested: bool) -> None:
    """Raises an error if all simulations have no verdict."""
    if is_tested:
        return
    exceptions = target.system.exceptions
    cause = (
        f"; the first exception:\n{exceptions[0]}" if exceptions
        else "; `simulate` shows the end of one of them"
    )
    raise MishandleError(f"no simulation has a verdict, so the system was not tested{cause}")
