"""The systems of the ablation: shipped controllers under formulas with several predicates, and functions whose parts are known."""

import json
import math
import pathlib
import tomllib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from formulas import Parts, Term, parse, parts
from mishandle import _native
from mishandle.base.documents import Call
from numpy.typing import NDArray

Array = NDArray[np.float64]

WINDOWS = 4
FILE = pathlib.Path(__file__).parent / "systems.toml"


@dataclass(frozen=True)
class System:
    """`terms` has (eventually, number of conjuncts) for each term of the formula, in the order of the rows of `Parts`."""

    name: str
    dimension: int
    terms: list[tuple[bool, int]]
    simulate: Callable[[Array], Parts]


def task_system(task: str, controller: str, space: str, formula: str, share: float) -> System:
    """Returns a task whose axes vary in this share of their ranges, around the nominal values."""
    call = Call("simulate", {}).text(target=task, controller=controller, space=space, falsify={"formula": formula})
    target = _native.target(call)
    found_axes = json.loads(target.axes)
    axes = [(axis["low"], axis["high"], axis["values"] == "logarithmic") for axis in found_axes]
    nominal = [axis["nominal"] for axis in found_axes]
    text = dict(target.formulas)[formula]
    names = [name for name, _ in target.signals]
    terms = parse(text)

    def scenario(point: Array) -> list[float]:
        return [value(axis, middle, share, u) for axis, middle, u in zip(axes, nominal, point)]

    def simulate(point: Array) -> Parts:
        [found] = _native.simulate(target, values=scenario(point), repeat=1)
        if found["robustness"] is None:
            return without_verdict(sum(len(term.predicates) for term in terms))
        result = parts(terms, dict(zip(names, np.asarray(found["samples"]).T)), WINDOWS)
        if abs(result.robustness - found["robustness"]) > 1e-9:
            raise ValueError(f"the parts give {result.robustness}, the simulation {found['robustness']}")
        return result

    suffix = "" if share == 1 else f"/{share:g}"
    return System(f"{task}/{controller}/{space}/{formula}{suffix}", len(axes), shape(terms), simulate)


def without_verdict(count: int) -> Parts:
    """Returns the parts of a simulation that became unstable: all that is known of it is that it is no violation."""
    return Parts(math.inf, np.full(count, math.inf), np.full(count, math.inf), np.full((count, WINDOWS), math.inf))


def value(axis: tuple[float, float, bool], nominal: float | None, share: float, u: float) -> float:
    low, high, logarithmic = axis
    if logarithmic:
        low, high = math.log(low), math.log(high)
    middle = 0.5 * (low + high) if nominal is None else math.log(nominal) if logarithmic else nominal
    ends = middle + share * (low - middle), middle + share * (high - middle)
    found = ends[0] + u * (ends[1] - ends[0])
    return float(np.clip(math.exp(found) if logarithmic else found, *axis[:2]))


def shape(terms: list[Term]) -> list[tuple[bool, int]]:
    return [(term.eventually, len(term.predicates)) for term in terms]


def function_system(name: str, dimension: int, eventually: bool, margins: Callable[[Array], Array]) -> System:
    """`margins` returns conjuncts x samples; the samples are divided into windows as those of a trace."""

    def simulate(point: Array) -> Parts:
        rows = margins(point)
        names = [f"p{i}" for i in range(len(rows))]
        term = Term(eventually, 0, rows.shape[1] - 1, 0, tuple((name, 1.0, 0.0) for name in names))
        return parts([term], dict(zip(names, rows)), WINDOWS)

    count = len(margins(np.full(dimension, 0.5)))
    return System(f"function/{name}", dimension, [(eventually, count)], simulate)


def column(*values: float) -> Array:
    """Conjuncts of one time: the same in all windows."""
    return np.repeat(np.array(values)[:, None], WINDOWS, axis=1)


def ramps(x: Array) -> Array:
    """Three conjuncts in units of 0.1, 1 and 100. The last one fails in an octahedron in three axes, volume 0.0029."""
    far = abs(x[2] - 0.37) + abs(x[3] - 0.61) + abs(x[4] - 0.52)
    return column(0.1 * (1.05 - x[0]), 1.1 - x[1], 100.0 * (far - 0.13))


def masked(x: Array) -> Array:
    """A small margin that never fails hides a ball of radius 0.2 in four axes: volume 0.0079."""
    center = np.array([0.31, 0.72, 0.64, 0.25])
    return column(0.02 + 0.002 * math.sin(5.0 * x[0] + 3.0 * x[1]), 5.0 * (np.linalg.norm(x[:4] - center) - 0.2))


def masked_flat(x: Array) -> Array:
    """A constant margin hides a slope in eight axes (a plateau). Fails where their mean, with signs, exceeds 0.5."""
    signs = np.array([1, -1, 1, 1, -1, -1, 1, -1])
    return column(0.02, 0.5 - float(np.mean((2.0 * x - 1.0) * signs)))


def switching(x: Array) -> Array:
    """Twelve samples of two conjuncts in six axes: a ball for each quarter of the time, with different centers."""
    centers = np.random.default_rng(5).random((4, 6))
    radii = np.array([0.18, 0.2, 0.32, 0.15])
    far = np.linalg.norm(x[None, :] - centers, axis=1)
    return np.stack([np.repeat(far - radii, 3), np.repeat(0.3 + 0.2 * np.cos(4.0 * x[:4]), 3)])


def arrival(x: Array) -> Array:
    """The time of the only good moment moves through the windows, its height is smooth: windows hurt here."""
    center = np.array([0.7, 0.35, 0.6, 0.45])
    moment = 40.0 * (0.5 + 0.45 * math.sin(9.0 * x[0] + 4.0 * x[1]))
    height = np.linalg.norm(x[:4] - center) - 0.2
    return (height - 0.5 * np.abs(np.arange(40) - round(moment)))[None, :]


def both_fail(x: Array) -> Array:
    """Two moments that must both fail, in different units: the maximum of a ramp and a valley in other axes."""
    first = 30.0 * (0.93 - 0.5 * (x[0] + x[1]))
    second = 0.1 * (abs(x[2] - 0.7) - 0.05)
    return np.array([[first, first, second, second]])


def overlap(x: Array) -> Array:
    """Two conjuncts that each hold at some time, but not together where the first ends before the second starts."""
    time = np.linspace(0.0, 1.0, 41)
    end = 0.5 + 0.3 * float(np.linalg.norm(x[:3] - np.array([0.3, 0.6, 0.7])))
    start = 0.56 - 0.2 * abs(x[3] - 0.4)
    return np.stack([end - time, time - start])


FUNCTIONS: list[tuple[str, int, bool, Callable[[Array], Array]]] = [
    ("ramps", 6, False, ramps),
    ("masked", 4, False, masked),
    ("masked-flat", 8, False, masked_flat),
    ("switching", 6, False, switching),
    ("arrival", 4, True, arrival),
    ("both-fail", 4, True, both_fail),
    ("overlap", 4, True, overlap),
]


def load(share: float | None = None) -> list[System]:
    """Returns all systems; with a share, the tasks vary in this share of their ranges."""
    functions = [function_system(*row) for row in FUNCTIONS]
    rows = tomllib.loads(FILE.read_text(encoding="utf-8"))["system"] if FILE.exists() else []
    keys = ("task", "controller", "space", "formula")
    return functions + [task_system(*(row[key] for key in keys), row["share"] if share is None else share) for row in rows]
