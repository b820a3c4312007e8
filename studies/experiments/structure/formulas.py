"""The robustness of the tasks' formulas as a tree of minima and maxima over predicates and time windows.

A formula is a conjunction of `always[a:b](p and q)`, `eventually[a:b](p and q)` and `eventually[a:b](always[0:h](p and q))`.
"""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TERM = re.compile(r"(always|eventually)\[(\d+):(\d+)\]\((.*)\)")
HOLD = re.compile(r"always\[0:(\d+)\]\((.*)\)")
PREDICATE = re.compile(r"(\w+) (<=|>=|<|>) ([-+.\deE]+)")


@dataclass(frozen=True)
class Term:
    """`hold` is the length of an inner `always`; predicates are pairs of a signal, a sign and a bound."""

    eventually: bool
    first: int
    last: int
    hold: int
    predicates: tuple[tuple[str, float, float], ...]

    def margins(self, columns: dict[str, Array]) -> Array:
        """Returns the robustness of each predicate (rows) at each sample of the outer operator (columns)."""
        rows = np.stack([sign * (columns[name] - bound) for name, sign, bound in self.predicates])
        if self.hold:
            rows = np.lib.stride_tricks.sliding_window_view(rows, self.hold + 1, axis=1).min(2)
        return np.asarray(rows[:, self.first : self.last + 1])


def conjuncts(text: str) -> list[str]:
    """Splits at the `and` outside of parentheses."""
    parts, depth, start = [], 0, 0
    for i, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and text.startswith(" and ", i):
            parts.append(text[start:i])
            start = i + 5
    return [*parts, text[start:]]


def matched(pattern: re.Pattern[str], text: str) -> re.Match[str]:
    found = pattern.fullmatch(text)
    if found is None:
        raise ValueError(f"cannot read {text!r}; formulas.py states the forms that it reads")
    return found


def parse(text: str) -> list[Term]:
    terms = []
    for part in conjuncts(text):
        quantifier, first, last, body = matched(TERM, part).groups()
        inner = HOLD.fullmatch(body)
        hold, body = (int(inner[1]), inner[2]) if inner else (0, body)
        found = [matched(PREDICATE, conjunct).groups() for conjunct in conjuncts(body)]
        predicates = tuple((name, 1.0 if symbol[0] == ">" else -1.0, float(bound)) for name, symbol, bound in found)
        terms.append(Term(quantifier == "eventually", int(first), int(last), hold, predicates))
    return terms


@dataclass(frozen=True)
class Parts:
    """What one simulation says about the parts of a formula."""

    robustness: float
    alone: Array
    """The robustness of each conjunct as if it were the only one. Their minimum is the robustness, or above it if conjuncts of
    an `eventually` hold at different times only."""
    decisive: Array
    """The robustness of each conjunct at the sample that sets the robustness of its term. Their minimum is the robustness."""
    windows: Array
    """The robustness of each conjunct alone in each time window of its term: terms' conjuncts x windows."""


def parts(terms: list[Term], columns: dict[str, Array], n_windows: int) -> Parts:
    robustness, alone, decisive, windows = [], [], [], []
    for term in terms:
        margins = term.margins(columns)
        both = margins.min(0)
        best = np.max if term.eventually else np.min
        robustness.append(best(both))
        alone.append(best(margins, axis=1))
        decisive.append(margins[:, both.argmax()] if term.eventually else alone[-1])
        chunks = np.array_split(np.arange(margins.shape[1]), n_windows)
        windows.append(np.stack([best(margins[:, chunk], axis=1) for chunk in chunks], axis=1))
    return Parts(float(min(robustness)), np.concatenate(alone), np.concatenate(decisive), np.concatenate(windows))
