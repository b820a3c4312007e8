"""Plots of runs and traces with matplotlib: ``pip install '.[plots]'`` in a clone of Mishandle.

Each function draws into the given axes, or into new ones, and returns them. matplotlib is imported
when a function is called.
"""

from __future__ import annotations

import bisect
import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Union

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.base.traces import columns_of
from mishandle.errors import InvalidValueError, MissingPackageError
from mishandle.logs.formulas import Formula
from mishandle.runs.explanations import Comparison
from mishandle.runs.run_files import HasPath, Run, RunAxis, open_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes


AnyRun = Union[Run, HasPath, str, "os.PathLike[str]"]
"""A run, the result of a falsification or evaluation, or the path of a run file."""

_VIOLATED, _SATISFIED, _OTHER = "#c0392b", "#2166ac", "0.6"


def plot_robustness_map(
    run: AnyRun, x: str | None = None, y: str | None = None, *, ax: Axes | None = None
) -> Axes:
    """Plots the simulations over two axes of the space, colored by robustness. Crosses mark
    violations.

    Simulations without a robustness, for instance crashed ones, are gray rings.

    Parameters
    ----------
    run : Run, Falsification, Evaluation or path
        The simulations.
    x, y : str, optional
        Names of two axes; by default the first two. ``y="robustness"`` plots the robustness over
        one axis, which is the default for a space with one axis.
    ax : matplotlib.axes.Axes, optional
        Where to plot.

    Examples
    --------
    >>> import tempfile, mishandle
    >>> path = tempfile.mkdtemp() + "/run.sqlite"
    >>> space = [mishandle.Axis("speed", 0, 10, "m/s"), mishandle.Axis("mass", 1, 2, "kg")]
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> found = mishandle.falsify(system, "always(gap >= 2)", space, trials=2, budget=20, out=path)
    >>> plot_robustness_map(found).get_xlabel()
    'speed [m/s]'
    """
    opened = _opened(run)
    columns = opened.columns()
    names = [axis.name for axis in opened.axes]
    x = names[0] if x is None else x
    y = ([name for name in names if name != x] or ["robustness"])[0] if y is None else y
    robustness = np.array(
        [np.nan if value is None else value for value in columns["robustness"]], dtype=np.float64
    )
    horizontal, vertical = (
        robustness if name == "robustness" else _numbers(_axis(opened, name), columns[name])
        for name in (x, y)
    )
    ax = _axes(ax)
    known = np.isfinite(robustness)
    violated = known & np.signbit(robustness)
    if not known.all():
        ax.scatter(
            horizontal[~known], vertical[~known], s=18, facecolors="none", edgecolors=_OTHER,
            label="no verdict"
        )
    satisfied = known & ~violated
    colors = _colors(robustness[known])
    shown = ax.scatter(
        horizontal[satisfied], vertical[satisfied], s=18, c=robustness[satisfied], edgecolors="0.4",
        linewidths=0.3, **colors
    )
    if violated.any():
        marks: dict[str, Any] = {
            "marker": "X", "edgecolors": "black", "linewidths": 0.6, "label": "violation"
        }
        ax.scatter(
            horizontal[violated], vertical[violated], s=36, c=robustness[violated], **marks,
            **colors
        )
    if y == "robustness":
        ax.axhline(0.0, color="black", linewidth=0.8)
    else:
        _figure(ax).colorbar(shown, ax=ax, label="robustness")
    for name, direction in ((x, "x"), (y, "y")):
        _label(ax, direction, None if name == "robustness" else _axis(opened, name), name)
    ax.set_title(opened.formula, fontsize="small", wrap=True)
    if violated.any() or not known.all():
        ax.legend(loc="best", fontsize="small")
    return ax


def plot_search_progress(run: AnyRun, *, ax: Axes | None = None) -> Axes:
    """Plots the minimum robustness so far over the simulations of each trial. Crosses mark
    counterexamples.

    Parameters
    ----------
    run : Run, Falsification or path
        The falsification.
    ax : matplotlib.axes.Axes, optional
        Where to plot.
    """
    opened = _opened(run)
    columns = opened.columns()
    trials, numbers = np.array(columns["trial"]), np.array(columns["number"])
    values = np.array(
        [np.inf if value is None else value for value in columns["robustness"]], dtype=np.float64
    )
    ax = _axes(ax)
    falsified = 0
    for trial in np.unique(trials):
        chosen = trials == trial
        minimum = np.minimum.accumulate(values[chosen])
        is_falsified = bool(minimum[-1] < 0)
        falsified += is_falsified
        color = _VIOLATED if is_falsified else _SATISFIED
        # A trial before its first verdict has no minimum.
        shown = np.where(np.isfinite(minimum), minimum, np.nan)
        ax.step(numbers[chosen], shown, where="post", color=color, alpha=0.7, linewidth=1.0)
        if is_falsified:
            ax.plot(
                numbers[chosen][-1], minimum[-1], "X", color=color, markeredgecolor="black",
                markeredgewidth=0.5
            )
    ax.axhline(0.0, color="black", linewidth=0.8)
    ax.set_xlabel("simulation of the trial")
    ax.set_ylabel("minimum robustness so far")
    ax.set_title(
        f"{opened.search}: {falsified} of {len(np.unique(trials))} trials falsified",
        fontsize="small"
    )
    return ax


def plot_survival(runs: AnyRun | Mapping[str, AnyRun], *, ax: Axes | None = None) -> Axes:
    """Plots the share of trials that have not failed yet (Kaplan-Meier). Ticks mark trials that
    ended without a failure.

    Parameters
    ----------
    runs : Run, Falsification, path, or dict of them
        One run, or several with their names for the legend, such as one for each search.
    ax : matplotlib.axes.Axes, optional
        Where to plot.

    Examples
    --------
    >>> import tempfile, mishandle
    >>> path = tempfile.mkdtemp() + "/run.sqlite"
    >>> system = lambda scenario: {"gap": [10.0, 10.0 - scenario["speed"]]}
    >>> space = [mishandle.Axis("speed", 0, 10, "m/s")]
    >>> found = mishandle.falsify(
    ...     system, "always(gap >= 2)", space, trials=4, budget=50, search="random", out=path
    ... )
    >>> ax = plot_survival({"random": found})
    >>> (ax.get_legend_handles_labels()[1], float(ax.lines[0].get_ydata()[-1]))
    (['random: 4 of 4 failed'], 0.0)
    """
    named = dict(runs) if isinstance(runs, Mapping) else {"": runs}
    ax = _axes(ax)
    styles = ["-", "--", ":", "-."]
    for index, (name, run) in enumerate(named.items()):
        path = run if isinstance(run, (str, os.PathLike)) else run.path
        steps, censored, trials = _native.survival(os.fspath(path))
        numbers, shares = [number for number, _ in steps], [share for _, share in steps]
        label = f"{name + ': ' if name else ''}{trials - len(censored)} of {trials} failed"
        style = styles[index % len(styles)]
        [line] = ax.step(numbers, shares, where="post", linestyle=style, label=label)
        # The share at a time is that of the last step up to it.
        ticks = [shares[bisect.bisect_right(numbers, number) - 1] for number in censored]
        ax.plot(censored, ticks, "|", color=line.get_color(), markersize=9)
    ax.set_ylim(-0.03, 1.03)
    ax.set_xlabel("simulations of the trial")
    ax.set_ylabel("share of trials without a failure")
    ax.legend(loc="best", fontsize="small")
    return ax


def plot_comparison(comparison: Comparison, *, ax: Axes | None = None) -> Axes:
    """Plots the robustness of the second evaluation over that of the first. Crosses are new
    failures, rings are fixed ones.

    Parameters
    ----------
    comparison : Comparison
        Result of :func:`mishandle.compare`.
    ax : matplotlib.axes.Axes, optional
        Where to plot.
    """
    ax = _axes(ax)
    kinds: list[tuple[tuple[bool, bool], str, dict[str, Any]]] = [
        ((True, True), "both succeed", {"s": 8, "color": _SATISFIED}),
        ((False, False), "neither succeeds", {"s": 18, "color": _OTHER, "marker": "s"}),
        ((False, True), "fixed", {"s": 28, "facecolors": "none", "edgecolors": _SATISFIED}),
        ((True, False), "new", {"s": 28, "color": _VIOLATED, "marker": "x"}),
    ]
    pairs = comparison.compared
    for outcome, name, style in kinds:
        chosen = [
            (pair.first_robustness, pair.second_robustness)
            for pair in pairs
            if (pair.first_succeeds, pair.second_succeeds) == outcome
        ]
        shown = [
            (a, b) for a, b in chosen
            if a is not None and b is not None and math.isfinite(a) and math.isfinite(b)
        ]
        if shown:
            ax.scatter(
                [a for a, _ in shown], [b for _, b in shown], label=f"{name} ({len(chosen)})",
                **style
            )
    ax.axline((0.0, 0.0), slope=1.0, color=_OTHER, linewidth=0.8)
    ax.axhline(0.0, color="black", linewidth=0.8, linestyle="--")
    ax.axvline(0.0, color="black", linewidth=0.8, linestyle="--")
    ax.set_xlabel("robustness of the first")
    ax.set_ylabel("robustness of the second")
    ax.legend(loc="best", fontsize="small")
    return ax


def plot_trace(
    trace: Any, formula: str | Formula | None = None, *, signals: Sequence[str] | None = None,
    units: Mapping[str, str] | None = None, period: float | None = None,
    axes: Sequence[Axes] | None = None
) -> list[Axes]:
    """Plots signals over time, with the thresholds of a formula. The samples that violate it are
    shaded.

    Dotted values of the robustness depend on windows that are cut at the end of the trace.

    A threshold is a comparison of a signal, or of its absolute value, with a number. The last plot
    shows the robustness at each sample.

    Parameters
    ----------
    trace : dict of arrays, data frame or Simulation
        The signals.
    formula : str or Formula, optional
        The requirement.
    signals : sequence of str, optional
        Which signals to plot; by default those of the formula, or all.
    units : dict of str, optional
        Units of the signals.
    period : float, optional
        Time between two samples, in seconds. Without it, the horizontal axis counts samples.
    axes : sequence of matplotlib.axes.Axes, optional
        Where to plot: one for each signal, and one for the robustness if there is a formula.

    Examples
    --------
    >>> axes = plot_trace(
    ...     {"x": [0.0, 0.5, 1.5, 0.5]}, "always(x <= 1)", units={"x": "m"}, period=0.1
    ... )
    >>> [one.get_ylabel() for one in axes]
    ['x [m]', 'robustness']
    """
    trace = getattr(trace, "trace", trace)
    names = [str(name) for name in getattr(trace, "columns", trace)]
    parsed = Formula(formula) if isinstance(formula, str) else formula
    if signals is None:
        signals = [name for name in names if parsed is None or name in parsed.signals]
    unknown = sorted(set(signals) - set(names))
    if unknown:
        raise InvalidValueError(
            f"the trace has no signal {', '.join(unknown)}; it has {', '.join(names)}"
        )
    # Other columns of a log, such as time stamps, can have no numbers.
    columns = columns_of(trace, [*signals, *(parsed.signals if parsed is not None else [])])
    panels = len(signals) + (parsed is not None)
    if axes is None:
        figure = _pyplot().figure(figsize=(6.4, 1.2 + 1.5 * panels), layout="constrained")
        axes = list(figure.subplots(panels, 1, sharex=True, squeeze=False)[:, 0])
    if len(axes) != panels:
        raise InvalidValueError(f"there are {len(axes)} axes for {panels} plots")
    samples = len(next(iter(columns.values()), []))
    dt = 1.0 if period is None else period
    time = np.arange(samples) * dt
    thresholds = [] if parsed is None else parsed.thresholds(period=dt)
    for name, ax in zip(signals, axes):
        ax.plot(time, columns[name], color="0.15", linewidth=1.2)
        for threshold in (value for signal, value in thresholds if signal == name):
            ax.axhline(threshold, color=_SATISFIED, linestyle="--", linewidth=1.0)
        ax.set_ylabel(_with_unit(name, (units or {}).get(name, "")))
    if parsed is not None:
        found = parsed.robustness_signal(columns, period=period)
        decided = len(parsed.robustness_signal(columns, period=period, decided_only=True))
        low, high = parsed.robustness_bounds(columns, period=period)
        axes[-1].plot(time[:decided], found[:decided], color="0.15", linewidth=1.2)
        # One sample of overlap, so that the lines meet.
        cut = slice(max(decided - 1, 0), None)
        if decided < samples:
            axes[-1].plot(
                time[cut], found[cut], color=_OTHER, linestyle=":", linewidth=1.2,
                label="window cut"
            )
            axes[-1].legend(loc="best", fontsize="small")
        color = _VIOLATED if high < 0 else _SATISFIED if low > 0 or decided > 0 else _OTHER
        axes[-1].plot(
            time[:1], found[:1], "o", color=color, fillstyle="full" if decided > 0 else "none"
        )
        axes[-1].axhline(0.0, color="black", linewidth=0.8)
        axes[-1].set_ylabel("robustness")
        axes[0].set_title(
            f"{parsed}: {_verdict(float(found[0]), low, high, decided > 0)}", fontsize="small",
            wrap=True
        )
        # A trace that more samples could still satisfy does not violate the formula.
        for start, end in _intervals(parsed.violation(columns, period=period)) if high < 0 else []:
            for ax in axes[: len(signals)]:
                ax.axvspan(
                    (start - 0.5) * dt, (end + 0.5) * dt, color=_VIOLATED, alpha=0.2, linewidth=0
                )
    axes[-1].set_xlabel("sample" if period is None else "time [s]")
    return list(axes)


def _verdict(robustness: float, low: float, high: float, is_decided: bool) -> str:
    """Returns the robustness at the first sample as text, or what is known of it if the trace is
    too short.

    >>> _verdict(-0.5, -0.5, -0.5, True), _verdict(-0.5, -math.inf, -0.5, False), _verdict(
    ...     0.5, -math.inf, 0.5, False
    ... )
    ('-0.5', 'at most -0.5', 'undecided')
    """
    if is_decided:
        return f"{robustness:.4g}"
    return f"at most {high:.4g}" if high < 0 else f"at least {low:.4g}" if low > 0 else "undecided"


def _intervals(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Returns the first and last index of each run of true values.

    >>> _intervals(np.array([True, True, False, True]))
    [(0, 1), (3, 3)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(start), int(end) - 1) for start, end in zip(edges[::2], edges[1::2])]


def _colors(robustness: NDArray[np.float64]) -> dict[str, Any]:
    """Returns a scale of colors: blue above 0 and red below, each up to its own extreme. Values
    near 0 differ from the white background."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap, Normalize, TwoSlopeNorm

    reds, blues = colormaps["Reds_r"](np.linspace(0, 0.65, 128)), colormaps["Blues"](
        np.linspace(0.35, 1, 128)
    )
    low, high = (
        (float(robustness.min()), float(robustness.max())) if len(robustness) > 0 else (0.0, 1.0)
    )
    if low < 0 < high:
        return {
            "cmap": ListedColormap(np.concatenate([reds, blues])),
            "norm": TwoSlopeNorm(0.0, vmin=low, vmax=high)
        }
    return {"cmap": ListedColormap(reds if low < 0 else blues), "norm": Normalize(low, high)}


def _opened(run: AnyRun) -> Run:
    if isinstance(run, Run):
        return run
    return open_run(run if isinstance(run, (str, os.PathLike)) else run.path)


def _axis(run: Run, name: str) -> RunAxis:
    for axis in run.axes:
        if axis.name == name:
            return axis
    raise InvalidValueError(
        f"the run has no axis {name!r}; its axes: {', '.join(axis.name for axis in run.axes)}"
    )


def _numbers(axis: RunAxis, values: Sequence[Any]) -> NDArray[np.float64]:
    return np.array(
        [axis.names.index(value) if isinstance(value, str) else value for value in values],
        dtype=np.float64
    )


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _label(ax: Axes, direction: str, axis: RunAxis | None, name: str) -> None:
    """Labels one direction of a plot, with a logarithmic scale or names as the axis of the space
    has."""
    getattr(ax, f"set_{direction}label")(_with_unit(name, axis.unit) if axis is not None else name)
    if axis is None:
        return
    if axis.values == "logarithmic":
        getattr(ax, f"set_{direction}scale")("log")
    if axis.names:
        getattr(ax, f"set_{direction}ticks")(range(len(axis.names)), labels=axis.names)


def _pyplot() -> Any:
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise MissingPackageError("plots need matplotlib", "plots") from error
    return pyplot


def close(figure: Any) -> None:
    """Forgets a figure, which pyplot keeps otherwise."""
    _pyplot().close(figure)


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    axes: Axes = _pyplot().figure(figsize=(5.6, 4.2), layout="constrained").add_subplot()
    return axes


def _figure(ax: Axes) -> Any:
    return ax.get_figure()
