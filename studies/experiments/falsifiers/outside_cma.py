"""CMA-ES of the package `cma`, from the center with a standard deviation of 0.3; after its end from a random point."""

import warnings

import cma
import numpy as np
from trial import Trial


def cma_es(trial: Trial) -> None:
    """Discrete axes are whole numbers, which the package knows as integer variables. Batches of 16 are populations of 16."""
    levels = trial.system.levels
    low, high = [0.0] * len(levels), [1.0 if count is None else count - 1.0 for count in levels]
    whole = [index for index, count in enumerate(levels) if count is not None]
    span = np.array([1.0 if count is None else float(count) for count in levels])
    shift = np.array([0.0 if count is None else 0.5 for count in levels])
    options = {"bounds": [low, high], "integer_variables": whole, "verbose": -9}
    if trial.batch == 16:
        options["popsize"] = 16
    random = np.random.default_rng(trial.seed)
    start = np.array(high) / 2
    while True:
        # A seed of 0 means the clock.
        options["seed"] = int(random.integers(1, 2**31))
        options["CMA_stds"] = list(span)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            search = cma.CMAEvolutionStrategy(start, 0.3, options)
            while not search.stop():
                points = search.ask()
                found = [(np.where(shift > 0, np.round(point), point) + shift) / span for point in points]
                search.tell(points, trial.finite(found))
        start = np.array(high) * random.random(len(levels))
