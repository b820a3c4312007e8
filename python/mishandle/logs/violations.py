"""The samples of a trace that make it violate a formula."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native

Mask = NDArray[np.bool_]


def violation(nodes: Sequence["_native.Node"], values: Sequence[NDArray[np.float64]]) -> Mask:
    """Returns the samples that make a trace violate a formula.

    Parameters
    ----------
    nodes : sequence of Node
        Syntax tree of the formula, each operator before its operands.
    values : sequence of arrays
        Robustness of each node at each sample.
    """
    samples = len(values[0])
    result = np.zeros(samples, dtype=bool)
    # For each node, the samples at which its value is a cause, and whether the cause is that it
    # holds.
    pending: list[tuple[Mask, bool] | None] = [None] * len(nodes)
    first = np.zeros(samples, dtype=bool)
    first[:1] = values[0][:1] < 0
    pending[0] = (first, False)
    for (operator, window, operands, _), causes in zip(nodes, pending):
        if causes is None:
            continue
        at, holds = causes
        if operator == "not":
            pending[operands[0]] = (at, not holds)
        elif operator in ("and", "or"):
            # All operands of a conjunction that holds are causes, and those operands of one that
            # fails which fail.
            for operand in operands:
                pending[operand] = (at & _agreeing(values[operand], holds), holds)
        elif operator in ("always", "eventually", "historically", "once") and window is not None:
            reached = _reached(at, window, operator in ("always", "eventually"))
            pending[operands[0]] = (reached & _agreeing(values[operands[0]], holds), holds)
        elif operator == "implies" and not holds:
            pending[operands[1]] = (at, False)
        else:
            result |= at
    return result


def _agreeing(values: NDArray[np.float64], holds: bool) -> Mask:
    return values > 0 if holds else values < 0


def _reached(at: Mask, window: tuple[int, int | None], ahead: bool) -> Mask:
    """Returns the samples in the windows of the samples ``at``.

    >>> _reached(np.array([True, False, False, False]), (1, 2), True).tolist()
    [False, True, True, False]
    >>> _reached(np.array([False, False, False, True]), (1, None), False).tolist()
    [True, True, True, False]
    """
    samples = len(at)
    starts = np.flatnonzero(at) if ahead else samples - 1 - np.flatnonzero(at)
    begin, end = window
    firsts = np.minimum(starts + begin, samples)
    lasts = np.full(len(starts), samples) if end is None else np.minimum(starts + end + 1, samples)
    edges = np.zeros(samples + 1, dtype=np.int64)
    np.add.at(edges, firsts, 1)
    np.add.at(edges, np.maximum(lasts, firsts), -1)
    reached: Mask = np.cumsum(edges[:-1]) > 0
    return reached if ahead else reached[::-1]
