"""Runs scikit-learn's GaussianProcessRegressor and writes the golden file to this folder.

Run `python make.py` in this folder, in an environment with requirements.txt. Numbers have ten significant digits, so that
the file is the same on every machine.

posterior.json  for sets of points, targets and hyperparameters: the log marginal likelihood, posterior means and standard
                deviations, and leave-one-out means
"""

import os

os.environ["OPENBLAS_CORETYPE"] = "Nehalem"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import json
import pathlib

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

# (points, dimension, variance of the process, noise as a fraction of it, mean)
CASES = [(5, 1, 1.0, 1e-2, 0.0), (12, 2, 0.7, 1e-4, 0.3), (40, 3, 2.5, 0.3, -1.0), (70, 6, 1.3, 1e-3, 0.1)]


def rounded(values):
    return [float(f"{value:.10g}") for value in np.ravel(values)]


def regressor(lengths, variance, noise):
    kernel = ConstantKernel(variance) * Matern(length_scale=lengths, nu=2.5) + WhiteKernel(variance * noise)
    return GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None)


def latent(model, points):
    """Mean and standard deviation without the noise, which scikit-learn's WhiteKernel adds at new points."""
    mean, deviation = model.predict(points, return_std=True)
    return mean, np.sqrt(deviation**2 - model.kernel_.k2.noise_level)


def case(rng, n, d, variance, noise, mean):
    points = rng.random((n, d)).round(6)
    lengths = (0.2 + rng.random(d) * np.sqrt(d)).round(6)
    targets = (np.sin(5.0 * points).sum(axis=1) + 0.1 * rng.standard_normal(n)).round(6)
    queries = np.vstack([rng.random((6, d)), np.zeros((1, d)), points[:1]]).round(6)
    model = regressor(lengths, variance, noise).fit(points, targets - mean)
    means, deviations = latent(model, queries)
    likelihood = model.log_marginal_likelihood_value_
    left_out = []
    for i in range(n):
        rest = np.arange(n) != i
        other = regressor(lengths, variance, noise).fit(points[rest], targets[rest] - mean)
        left_out.append(other.predict(points[i : i + 1])[0] + mean)
    return {
        "points": points.tolist(),
        "targets": targets.tolist(),
        "lengths": lengths.tolist(),
        "variance": variance,
        "noise": noise,
        "mean": mean,
        "queries": queries.tolist(),
        "posterior_means": rounded(means + mean),
        "posterior_deviations": rounded(deviations),
        "log_likelihood": rounded([likelihood])[0],
        "leave_one_out": rounded(left_out),
    }


def main():
    rng = np.random.default_rng(7)
    cases = [case(rng, *numbers) for numbers in CASES]
    pathlib.Path("posterior.json").write_text(json.dumps({"cases": cases}, indent=1) + "\n")


main()
