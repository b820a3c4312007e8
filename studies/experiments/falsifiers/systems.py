"""The systems of the benchmark: functions (functions.py), tasks with a shipped controller, and problems of the ARCH competition. The
folder systems has their facts."""

import functools
import pathlib
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mishandle
import numpy as np
from functions import FUNCTIONS, Function
from numpy.typing import NDArray

HERE = pathlib.Path(__file__).parent
SYSTEMS = HERE / "systems"
FUNCTIONS_FILE = "functions"
ARCH_FILE = "arch"
TASKS = ["point-reaching", "ball-balancing", "ball-catching", "ball-pushing", "door-opening", "peg-in-hole", "cube-stacking"]
# Stands for infinity, for searches of other libraries that need finite values.
NO_VERDICT = 1e3

Point = NDArray[np.float64]
Value = Callable[[Point, float], float]
"""Robustness at a point of the unit cube. With a threshold, a value above it may be a lower bound."""


@dataclass(frozen=True)
class System:
    """What a search minimizes. `levels` has the number of values of each discrete axis, None for a continuous one."""

    name: str
    group: str
    levels: list[int | None]
    facts: dict[str, Any]
    """Measured by survey.py: kind, uniform failure rate, failing corners."""
    make: Callable[[], Value]

    @property
    def dimension(self) -> int:
        return len(self.levels)

    @property
    def corner(self) -> bool:
        """Whether a corner of the space fails."""
        return bool(self.facts.get("failing_corners", 0) > 0)


def of_task(task: str, controller: str, space: str, formula: str, axes: list[str] | None = None) -> mishandle.ask.Objective:
    """Returns the objective of a system that varies these axes of a space, by default all. The others keep their nominal values, so that
    a system stays the same when its space gets more axes."""
    whole = mishandle.ask.Objective(task, formula, space, policy=controller)
    if axes is None:
        return whole
    fixed = {axis.name: axis.nominal for axis in whole.space if axis.name not in axes and axis.nominal is not None}
    return mishandle.ask.Objective(task, formula, space, policy=controller, axes=fixed) if fixed else whole


def discrete_key(levels: list[int | None], point: Point) -> tuple[int, ...] | None:
    """Returns the values of a point in a space without continuous axes; None in other spaces."""
    if any(count is None for count in levels):
        return None
    return tuple(min(int(u * count), count - 1) for u, count in zip(point, levels) if count is not None)


def task_value(objective: mishandle.ask.Objective) -> Value:
    """Simulations do not depend on the seed of a trial, so that those of a discrete space are simulated once. A point has one coordinate
    for each axis that is not fixed."""
    known: dict[tuple[int, ...], float] = {}
    free = np.array([axis.low < axis.high for axis in objective.space])
    levels = [count for count, is_free in zip(objective.levels, free) if is_free]

    def whole(point: Point) -> Point:
        coordinates = np.full(len(free), 0.5)
        coordinates[free] = point
        return coordinates

    def value(point: Point, threshold: float) -> float:
        key = discrete_key(levels, point)
        if key is not None:
            if key not in known:
                known[key] = float(objective([whole(point)])[0])
            return known[key]
        return float(objective([whole(point)], threshold=threshold)[0])

    return value


def function_value(function: Function) -> Value:
    return lambda point, threshold: float(function.values(point[None, :])[0])


@functools.cache
def load() -> list[System]:
    """Returns all systems: the functions, those of each task that was surveyed, then the problems of the ARCH competition."""
    functions = {function.name: function for function in FUNCTIONS}
    files = [SYSTEMS / f"{name}.toml" for name in (FUNCTIONS_FILE, *TASKS, ARCH_FILE)]
    found = []
    for row in (row for file in files if file.exists() for row in tomllib.loads(file.read_text(encoding="utf-8")).get("system", [])):
        if row["group"] == "function":
            function = functions[row["name"]]
            levels = function.axis_levels()
            make = lambda function=function: function_value(function)
        elif row["group"] == "arch":
            levels = [None] * row["dimension"]
            make = lambda name=row["name"]: task_value(mishandle.ask.Objective(name, "success", "instance-2"))
        else:
            levels = [count or None for count in row["levels"]]
            names = [row[key] for key in ("task", "controller", "space", "formula", "axes")]
            make = lambda names=names: task_value(of_task(*names))
        found.append(System(row["name"], row["group"], levels, row, make))
    return found
