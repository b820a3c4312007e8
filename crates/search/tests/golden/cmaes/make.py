"""Runs CMA-ES of the package `cmaes` and writes evaluations.json: for 200 seeds, the number of evaluations to a threshold.

Run `python make.py` in this folder, in an environment with requirements.txt. All runs start from the center with a standard
deviation of 0.05, so that bounds do not matter, on functions of ../scipy/make.py and an ellipsoid.
"""

import json
import pathlib
import sys
from importlib.metadata import version

import numpy as np
from cmaes import CMA

HERE = pathlib.Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "scipy"))
from make import FUNCTIONS


def ellipsoid(u):
    """An ellipsoid with a condition number of 1e4, rotated by 45 degrees in each pair of neighbors."""
    d = len(u)
    x = [v - 0.4 for v in u]
    y = [(x[i] + x[(i + 1) % d]) * 0.5 ** 0.5 for i in range(d)]
    return sum(10.0 ** (4.0 * i / (d - 1.0)) * v * v for i, v in enumerate(y))


# (function, d, threshold, maximum number of evaluations)
RUNS = [("sphere", 5, 1e-6, 3000), ("rosenbrock", 4, 1e-2, 6000), ("ellipsoid", 7, 1e-3, 8000), ("sphere", 20, 1e-3, 6000)]


def evaluations_to(function, d, threshold, most, seed):
    optimizer, count = CMA(mean=np.full(d, 0.5), sigma=0.05, seed=seed), 0
    while True:
        solutions = []
        for _ in range(optimizer.population_size):
            x = optimizer.ask()
            count += 1
            value = function([float(v) for v in x])
            if count > most or value <= threshold:
                return count
            solutions.append((x, value))
        optimizer.tell(solutions)


if __name__ == "__main__":
    functions = FUNCTIONS | {"ellipsoid": ellipsoid}
    rows = [json.dumps({"function": name, "d": d, "threshold": threshold, "most": most, "evaluations": [
        evaluations_to(functions[name], d, threshold, most, seed) for seed in range(200)]})
        for name, d, threshold, most in RUNS]
    body = ",\n".join(rows)
    text = f'{{"versions": {{"cmaes": "{version("cmaes")}"}}, "runs": [\n{body}\n]}}\n'
    (HERE / "evaluations.json").write_text(text, encoding="utf-8")
