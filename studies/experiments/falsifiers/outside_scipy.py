"""Searches of SciPy with its defaults; `maxfun` and `maxiter` leave the end to the budget of the trial."""

import numpy as np
from scipy import optimize
from trial import Trial

NO_LIMIT = 10**6


def dual_annealing(trial: Trial) -> None:
    optimize.dual_annealing(trial.one, [(0, 1)] * trial.system.dimension, rng=trial.seed)


def direct(trial: Trial) -> None:
    # SciPy reserves memory for `maxfun` points.
    optimize.direct(trial.one, [(0, 1)] * trial.system.dimension, maxfun=trial.budget, maxiter=NO_LIMIT)


def differential_evolution(trial: Trial) -> None:
    """Discrete axes are whole numbers, which SciPy knows. In batches, a generation is evaluated at once."""
    levels = trial.system.levels
    bounds = [(0, 1) if count is None else (0, count - 1) for count in levels]

    def unit(x: np.ndarray) -> np.ndarray:
        return np.array([u if count is None else (u + 0.5) / count for u, count in zip(x, levels)])

    common = dict(bounds=bounds, rng=trial.seed, maxiter=NO_LIMIT, polish=False, integrality=[count is not None for count in levels])
    if trial.batch == 1:
        optimize.differential_evolution(lambda x: trial.one(unit(x)), **common)
        return
    columns = lambda x: np.array(trial.finite([unit(column) for column in x.T]))
    optimize.differential_evolution(columns, vectorized=True, updating="deferred", **common)
