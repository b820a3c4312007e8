"""TuRBO-1 from the parts of BoTorch, with the constants of BoTorch's tutorial.

Eriksson et al., Scalable Global Optimization via Local Bayesian Optimization, NeurIPS 2019. The tutorial is
https://botorch.org/docs/tutorials/turbo_1: 2 d Sobol points, a Gaussian process with a Matérn kernel in a trust region around the
best point, and Thompson sampling of a batch. A region that is too small restarts the search, as in the paper.
"""

import math
import warnings

import numpy as np
import torch
from botorch.fit import fit_gpytorch_mll
from botorch.generation import MaxPosteriorSampling
from botorch.models import SingleTaskGP
from gpytorch.constraints import Interval
from gpytorch.kernels import MaternKernel, ScaleKernel
from gpytorch.likelihoods import GaussianLikelihood
from gpytorch.mlls import ExactMarginalLogLikelihood
from torch.quasirandom import SobolEngine
from trial import Trial

SUCCESSES, LARGEST, SMALLEST, FIRST = 10, 1.6, 0.5**7, 0.8


class Region:
    """The length of the trust region."""

    def __init__(self, dimension: int, batch: int) -> None:
        self.failures_allowed = math.ceil(max(4.0 / batch, dimension / batch))
        self.length, self.best = FIRST, -math.inf
        self.failures = self.successes = 0

    def update(self, values: torch.Tensor) -> None:
        if values.max() > self.best + 1e-3 * abs(self.best):
            self.successes, self.failures = self.successes + 1, 0
        else:
            self.successes, self.failures = 0, self.failures + 1
        if self.successes == SUCCESSES:
            self.length, self.successes = min(2 * self.length, LARGEST), 0
        elif self.failures == self.failures_allowed:
            self.length, self.failures = self.length / 2, 0
        self.best = max(self.best, float(values.max()))


def fitted(x: torch.Tensor, y: torch.Tensor) -> SingleTaskGP:
    kernel = ScaleKernel(MaternKernel(nu=2.5, ard_num_dims=x.shape[1], lengthscale_constraint=Interval(0.005, 4.0)))
    likelihood = GaussianLikelihood(noise_constraint=Interval(1e-8, 1e-3))
    standard = (y - y.mean()) / (y.std() if len(y) > 1 and y.std() > 0 else 1.0)
    model = SingleTaskGP(x, standard, covar_module=kernel, likelihood=likelihood, outcome_transform=None)
    fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
    return model


def proposals(model: SingleTaskGP, x: torch.Tensor, y: torch.Tensor, length: float, batch: int, seed: int) -> torch.Tensor:
    """Returns a batch by Thompson sampling of candidates that differ from the best point in about 20 coordinates."""
    d = x.shape[1]
    center = x[y.argmax()]
    weights = model.covar_module.base_kernel.lengthscale.squeeze(0).detach()
    weights = weights / weights.mean()
    weights = weights / torch.prod(weights.pow(1.0 / d))
    low, high = (torch.clamp(center + side * weights * length / 2, 0.0, 1.0) for side in (-1, 1))
    count = min(5000, max(2000, 200 * d))
    moved = low + (high - low) * SobolEngine(d, scramble=True, seed=seed).draw(count).to(x)
    mask = torch.rand(count, d) <= min(20.0 / d, 1.0)
    rows = torch.where(mask.sum(dim=1) == 0)[0]
    mask[rows, torch.randint(0, d, (len(rows),))] = True
    candidates = torch.where(mask, moved, center.expand(count, d))
    with torch.no_grad():
        return MaxPosteriorSampling(model=model, replacement=False)(candidates, num_samples=batch)


def turbo(trial: Trial) -> None:
    torch.set_num_threads(1)
    torch.manual_seed(trial.seed)
    torch.set_default_dtype(torch.float64)
    random = np.random.default_rng(trial.seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        while True:
            restart(trial, random)


def restart(trial: Trial, random: np.random.Generator) -> None:
    """Runs one trust region until it is too small. Values are negated, because BoTorch maximizes."""
    d = trial.system.dimension
    seed = lambda: int(random.integers(2**31))
    region = Region(d, trial.batch)
    x = SobolEngine(d, scramble=True, seed=seed()).draw(2 * d).to(torch.float64)
    y = -torch.tensor(trial.finite(list(x.numpy())), dtype=torch.float64).unsqueeze(1)
    region.best = float(y.max())
    while region.length >= SMALLEST:
        found = proposals(fitted(x, y), x, y, region.length, trial.batch, seed())
        values = -torch.tensor(trial.finite(list(found.numpy())), dtype=torch.float64).unsqueeze(1)
        region.update(values)
        x, y = torch.cat([x, found]), torch.cat([y, values])
