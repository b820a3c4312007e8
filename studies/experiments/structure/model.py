"""A Gaussian process for the ablation: the prior, the fit and the asinh transform of the search `portfolio`, in NumPy."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

Array = NDArray[np.float64]

# As in crates/search/src/gp/fit.rs: bounds of lengths and noise, and their priors.
SHORTEST, LONGEST = 0.02, 30.0
NOISE = (1e-6, 1.0)
COMMON_DEVIATION, LENGTH_DEVIATION = math.sqrt(3.0), 0.4
NOISE_PRIOR = (-7.0, 2.5)
EFFORT_FIRST, EFFORT = 16, 8
# Weight of the prior of the variance, in observations (regression.rs).
PRIOR_OBSERVATIONS = 2.0


def median_and_scale(values: Array) -> tuple[float, float]:
    """Median and interquartile range over that of the normal distribution; the standard deviation if at least half are equal."""
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    scale = (high - low) / 1.349
    return float(middle), float(scale if scale > 0 else max(values.std(), 1e-300))


def finite(values: Array) -> Array:
    """Replaces infinite values, of simulations without a verdict, by the largest finite one."""
    known = values[np.isfinite(values)]
    return np.minimum(values, known.max() if len(known) else 0.0)


def asinh_targets(values: Array) -> tuple[Array, float]:
    """Returns targets with mean 0 and variance 1, and the target of a value of 0."""
    values = finite(values)
    if values.max() <= values.min():
        return np.zeros(len(values)), 0.0 if values[0] == 0 else -3.0 * math.copysign(1.0, values[0])
    center, scale = median_and_scale(values)
    targets = np.arcsinh((values - center) / scale)
    return standardized(targets, math.asinh(-center / scale))


def standardized(targets: Array, level: float) -> tuple[Array, float]:
    mean, deviation = targets.mean(), targets.std()
    deviation = deviation if deviation > 0 else 1.0
    return (targets - mean) / deviation, float((level - mean) / deviation)


def matern(squared: Array) -> Array:
    root = np.sqrt(5.0 * squared)
    return (1.0 + root + root * root / 3.0) * np.exp(-root)


def posterior_variance(squares: float, n: int) -> float:
    return float((squares + PRIOR_OBSERVATIONS) / (n + PRIOR_OBSERVATIONS))


@dataclass
class Process:
    """Matern-5/2 with one length for each axis, whose hyperparameters are refitted now and then."""

    dimension: int
    parameters: Array = field(init=False)
    fitted: bool = False

    def __post_init__(self) -> None:
        self.prior_length = math.sqrt(2.0) + 0.5 * math.log(self.dimension)
        self.parameters = np.append(np.full(self.dimension, self.prior_length), NOISE_PRIOR[0])

    def fit(self, points: Array, targets: Array) -> None:
        """Moves the hyperparameters to a larger posterior density."""
        squares = np.ascontiguousarray(((points[:, None, :] - points[None, :, :]) ** 2).transpose(2, 0, 1))
        longest = math.log(LONGEST * math.sqrt(self.dimension))
        bounds = [(math.log(SHORTEST), longest)] * self.dimension + [(math.log(NOISE[0]), math.log(NOISE[1]))]
        options = {"maxfun": EFFORT if self.fitted else EFFORT_FIRST, "ftol": 1e-4, "gtol": 1e-2}
        found = minimize(self._density, self.parameters, (squares, targets), "L-BFGS-B", jac=True, bounds=bounds, options=options)
        if np.isfinite(found.fun):
            self.parameters, self.fitted = found.x, True

    def _density(self, parameters: Array, squares: Array, targets: Array) -> tuple[float, Array]:
        n, d = len(targets), self.dimension
        weights, noise = np.exp(-2.0 * parameters[:d]), math.exp(parameters[d])
        root = np.sqrt(5.0 * np.tensordot(weights, squares, 1))
        decay = np.exp(-root)
        correlation = (1.0 + root + root * root / 3.0) * decay
        correlation[np.diag_indices(n)] += noise
        try:
            factor = cho_factor(correlation, lower=True)
        except np.linalg.LinAlgError:
            return 1e10, np.zeros(d + 1)
        inverse = cho_solve(factor, np.eye(n))
        mean = inverse.sum(0) @ targets / inverse.sum()
        alpha = inverse @ (targets - mean)
        variance = posterior_variance((targets - mean) @ alpha, n)
        value = 0.5 * (n + PRIOR_OBSERVATIONS) * math.log(variance) + np.log(np.diag(factor[0])).sum()
        outer = inverse - np.outer(alpha, alpha) / variance
        # d correlation / d log length_k = 5/3 (1 + root) exp(-root) (difference_k / length_k)^2
        slope = (5.0 / 3.0) * (1.0 + root) * decay * outer
        gradient = np.empty(d + 1)
        gradient[:d] = 0.5 * weights * np.tensordot(squares, slope, ([1, 2], [0, 1]))
        gradient[d] = 0.5 * noise * np.trace(outer)
        return self._add_priors(parameters, value, gradient)

    def _add_priors(self, parameters: Array, value: float, gradient: Array) -> tuple[float, Array]:
        d = self.dimension
        away = parameters[:d] - self.prior_length
        common = away.mean()
        own = away - common
        common_variance = COMMON_DEVIATION**2 + LENGTH_DEVIATION**2 / d
        value += 0.5 * common**2 / common_variance + 0.5 * (own @ own) / LENGTH_DEVIATION**2
        gradient[:d] += common / common_variance / d + own / LENGTH_DEVIATION**2
        noise = (parameters[d] - NOISE_PRIOR[0]) / NOISE_PRIOR[1]
        gradient[d] += noise / NOISE_PRIOR[1]
        return float(value + 0.5 * noise**2), gradient

    def condition(self, points: Array, targets: Array) -> None:
        """Sets the data of the predictions."""
        n = len(targets)
        self._factors, noise = np.exp(-self.parameters[:-1]), math.exp(self.parameters[-1])
        self._scaled = points * self._factors
        self._norms = (self._scaled**2).sum(1)
        correlation = matern(self._squared(self._scaled, self._norms)) + (noise + 1e-10) * np.eye(n)
        self._root = solve_triangular(np.linalg.cholesky(correlation), np.eye(n), lower=True)
        inverse = self._root.T @ self._root
        self._mean = float(inverse.sum(0) @ targets / inverse.sum())
        self._alpha = inverse @ (targets - self._mean)
        self._variance = posterior_variance((targets - self._mean) @ self._alpha, n)
        self._noise, self._diagonal, self._targets = noise, np.diag(inverse).copy(), targets

    def _squared(self, scaled: Array, norms: Array) -> Array:
        return np.maximum(norms[:, None] + self._norms[None, :] - 2.0 * scaled @ self._scaled.T, 0.0)

    def predict(self, points: Array) -> tuple[Array, Array]:
        """Returns posterior means and standard deviations."""
        scaled = points * self._factors
        cross = matern(self._squared(scaled, (scaled**2).sum(1)))
        white = cross @ self._root.T
        variance = self._variance * np.maximum(1.0 - (white**2).sum(1), 1e-12)
        return self._mean + cross @ self._alpha, np.sqrt(variance)

    def leave_one_out(self) -> tuple[Array, Array]:
        """Returns mean and standard deviation at each point without its value (Rasmussen and Williams, section 5.4.2)."""
        return self._targets - self._alpha / self._diagonal, np.sqrt(self._variance / self._diagonal)
