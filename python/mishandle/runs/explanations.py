"""Explanations and comparisons of recorded simulations."""

import json
import os
import pathlib
from dataclasses import dataclass, field
from typing import NamedTuple

import mishandle._native as _native
import mishandle.results as results
from mishandle.base.files import write_text
from mishandle.runs.printed import Printed


class Explanation(results.Explanation):
    """When, where and by which predicate a formula is violated or satisfied; ``str`` gives
    sentences."""

    def __str__(self) -> str:
        lines = list(self.sentences)
        if self.axes_at_nominal is not None and self.axes_at_nominal.axes:
            removing = [each.axis for each in self.axes_at_nominal.axes if each.violated is False]
            lines.append(
                "Axes that remove the failure alone, back at nominal: "
                f"{', '.join(removing) or 'none'}."
            )
        return "\n".join(lines)


class ComparedRobustness(NamedTuple):
    """Robustness of a simulation in both evaluations, and whether both succeed."""

    first_robustness: float | None
    second_robustness: float | None
    first_succeeds: bool
    second_succeeds: bool


@dataclass(frozen=True, kw_only=True, repr=False)
class Comparison(Printed, results.Comparison):
    """Two evaluations of the same scenarios and seeds, compared pair by pair."""

    shown: str = field(default="", compare=False)

    @property
    def compared(self) -> tuple[ComparedRobustness, ...]:
        """All pairs, also those at the corners, from the run files."""
        pairs = _native.compared_pairs(self.first.run, self.second.run)
        return tuple(ComparedRobustness(*pair) for pair in pairs)

    @property
    def paths(self) -> tuple[pathlib.Path, pathlib.Path]:
        """The two run files."""
        return pathlib.Path(self.first.run), pathlib.Path(self.second.run)

    def report(self, path: str | os.PathLike[str]) -> None:
        """Writes a page about the comparison: one HTML file that loads nothing. An existing file is
        replaced."""
        html = _native.comparison_page(self.first.run, self.second.run)
        write_text(path, html)


def compare(first: str | os.PathLike[str], second: str | os.PathLike[str]) -> Comparison:
    """Compares the run files of two evaluations with the same system, space, formula and seed.

    Parameters
    ----------
    first, second : path
        Run files of :func:`mishandle.evaluate`, for example of two policies.

    Raises
    ------
    MishandleError
        If the runs differ in more than the controller, or one is not complete.
    """
    text, lines = _native.compare(os.fspath(first), os.fspath(second))
    return results.build(Comparison, {**json.loads(text), "shown": lines})


def diff(first: str | os.PathLike[str], second: str | os.PathLike[str]) -> results.RunDifference:
    """Returns how two run files differ, of any questions: plan, target, program, results, and
    simulations with another verdict.

    Parameters
    ----------
    first, second : path
        Run files, A and B. ``same_records`` of the result says whether their simulations are the
        same to the bit.
    """
    return results.build(
        results.RunDifference, json.loads(_native.diff(os.fspath(first), os.fspath(second)))
    )
