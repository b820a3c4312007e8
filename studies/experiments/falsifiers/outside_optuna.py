"""Samplers of Optuna with their defaults. Discrete axes are whole numbers, which Optuna knows."""

import warnings

import numpy as np
import optuna
from trial import Trial

optuna.logging.set_verbosity(optuna.logging.ERROR)


def minimize(trial: Trial, sampler: optuna.samplers.BaseSampler) -> None:
    study = optuna.create_study(sampler=sampler)
    levels = trial.system.levels
    while True:
        asked, points = [], []
        for _ in range(trial.batch):
            one = study.ask()
            points.append(np.array([suggest(one, index, count) for index, count in enumerate(levels)]))
            asked.append(one)
        for one, value in zip(asked, trial.finite(points)):
            study.tell(one, value)


def suggest(one: optuna.Trial, index: int, levels: int | None) -> float:
    if levels is None:
        return one.suggest_float(f"x{index}", 0.0, 1.0)
    return (one.suggest_int(f"x{index}", 0, levels - 1) + 0.5) / levels


def tpe(trial: Trial) -> None:
    """With `constant_liar` in batches, as Optuna's documentation recommends for them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        minimize(trial, optuna.samplers.TPESampler(seed=trial.seed, constant_liar=trial.batch > 1))


def cma_es(trial: Trial) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        minimize(trial, optuna.samplers.CmaEsSampler(seed=trial.seed))
