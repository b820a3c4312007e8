"""The searches of the benchmark, each with the defaults of its library. An outside search runs in the environment of its library."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import mishandle
import numpy as np
from numpy.typing import NDArray
from trial import Finished, Trial

Point = NDArray[np.float64]


@dataclass(frozen=True)
class Search:
    """A search. `run` minimizes by `trial.values` until it ends or Finished is raised."""

    name: str
    run: Callable[[Trial], None]
    environment: str = "requirements"
    """File of requirements, without its extension."""
    batches: tuple[int, ...] = (1,)
    """Batch sizes on which its points depend. A search with 1 alone has the same trials in batches of 16."""
    slow: bool = False
    """Whether a trial takes more than a second without its simulations."""
    packages: tuple[str, ...] = field(default=("mishandle",))


# Searches that do not use values.
WITHOUT_VALUES = ("random", "sobol", "corners")
# Searches with an option for the number of points that they choose without each other's values.
WITH_ROUNDS = ("bayesian", "turbo", "portfolio")


def ours(name: str, **options: Any) -> Callable[[Trial], None]:
    """Returns one of our searches. Batches of 16 are rounds of 16 where the search has rounds; all other options are defaults."""

    def run(trial: Trial) -> None:
        levels = trial.system.levels
        whole = [count is not None for count in levels]
        bounds = [(0, count - 1) if count is not None else (0, 1) for count in levels]
        rounds = {"round-size": 16} if name in WITH_ROUNDS and trial.batch == 16 else {}
        search = mishandle.ask.Search(name, bounds, trial.seed, integrality=whole, **rounds, **options)
        while not search.finished and (points := search.ask(trial.batch)):
            found = trial.values([unit(point, levels) for point in points], learns=name not in WITHOUT_VALUES)
            for point, value in zip(points, found):
                search.tell(point, value)

    return run


def unit(point: Point, levels: list[int | None]) -> Point:
    """Returns the point of the unit cube of a point with whole numbers from 0."""
    return np.array([x if count is None else (x + 0.5) / count for x, count in zip(point, levels)])


def outside(module: str, function: str) -> Callable[[Trial], None]:
    """Returns a search of a module that imports its library when it runs."""
    return lambda trial: getattr(importlib.import_module(module), function)(trial)


SEARCHES = [
    *(Search(name, ours(name), batches=(1, 16) if name in WITH_ROUNDS else (1,)) for name in mishandle.ask.search_names()),
    Search("scipy-dual-annealing", outside("outside_scipy", "dual_annealing"), packages=("scipy",)),
    Search("scipy-differential-evolution", outside("outside_scipy", "differential_evolution"), batches=(1, 16), packages=("scipy",)),
    Search("scipy-direct", outside("outside_scipy", "direct"), packages=("scipy",)),
    Search("cma", outside("outside_cma", "cma_es"), batches=(1, 16), packages=("cma",)),
    Search("optuna-cma-es", outside("outside_optuna", "cma_es"), batches=(1, 16), packages=("optuna", "cmaes")),
    Search("psy-taliro-dual-annealing", outside("outside_psy_taliro", "dual_annealing"), packages=("psy-taliro",)),
    Search("optuna-tpe", outside("outside_optuna", "tpe"), batches=(1, 16), slow=True, packages=("optuna",)),
    Search("botorch-turbo", outside("outside_botorch", "turbo"), "requirements-botorch", (1, 16), True, ("botorch", "torch")),
    Search("stgem-ogan", outside("outside_stgem", "ogan"), "requirements-stgem", slow=True, packages=("stgem", "torch")),
]


def run(search: Search, trial: Trial) -> None:
    """Runs a trial to its end. A search that ends by its own criterion leaves the rest of the budget."""
    try:
        search.run(trial)
    except Finished:
        pass
