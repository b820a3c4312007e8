"""psy-taliro with its optimizer DualAnnealing, which is SciPy's without its local search. Its other one is uniform sampling."""

import numpy as np
import staliro
from staliro.optimizers import DualAnnealing
from trial import Trial


class Robustness(staliro.CostFunc[float, None]):
    def __init__(self, trial: Trial) -> None:
        self.trial = trial

    def evaluate(self, inputs: staliro.Inputs) -> staliro.Result[float, None]:
        return staliro.Result(self.trial.one(np.array(inputs.sample.values)), None)


def dual_annealing(trial: Trial) -> None:
    inputs = {f"x{index}": (0.0, 1.0) for index in range(trial.system.dimension)}
    # A seed must be positive.
    options = staliro.TestOptions(runs=1, iterations=trial.budget, seed=trial.seed + 1, static_inputs=inputs)
    staliro.staliro(Robustness(trial), DualAnnealing(min_cost=0.0), options)
