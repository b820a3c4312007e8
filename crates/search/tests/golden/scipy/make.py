"""Runs SciPy's optimizers on [0,1]^d and writes the golden files to this folder.

Run `python make.py` in this folder, in an environment with requirements.txt. The result is reproducible on one machine.
nelder_mead.json is the same on every machine. The other files depend on the C library's cosine and exponential, whose
last digit may differ elsewhere, which can change a few of the counts.

nelder_mead.json     the points of many runs of `minimize(method="Nelder-Mead")`: a hash of all, some in full
lbfgsb.json          the points and values of runs of `minimize(method="L-BFGS-B")` with finite differences
dual_annealing.json  for 200 seeds and six functions, the number of evaluations of `dual_annealing` to a threshold
visiting.json        samples of the visiting distribution
evolution.json       for 200 seeds and four runs, the number of evaluations of `differential_evolution` to a threshold
sobol.json           the first points of `scipy.stats.qmc.Sobol` without a scramble: a hash of all, one in full
"""

import os

# NumPy's vectorized sort is not stable and differs between processors; without it ties keep their order.
os.environ["NPY_DISABLE_CPU_FEATURES"] = "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"

# One kernel of OpenBLAS for every processor.
os.environ["OPENBLAS_CORETYPE"] = "Nehalem"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import json
import math
import pathlib
import struct

import numpy as np
import scipy
from scipy.optimize import differential_evolution, dual_annealing, minimize
from scipy.optimize._dual_annealing import VisitingDistribution
from scipy.stats import qmc

# --- the test functions of src/functions.rs, operation for operation ---


def sphere(u):
    total = 0.0
    for x in u:
        total += (x - 0.3) * (x - 0.3)
    return total


def rosenbrock(u):
    total = 0.0
    for a, b in zip(u, u[1:]):
        x, y = 4.0 * a - 2.0, 4.0 * b - 2.0
        total += 100.0 * (y - x * x) * (y - x * x) + (1.0 - x) * (1.0 - x)
    return total


def rastrigin(u):
    total = 0.0
    for a in u:
        x = 10.0 * (a - 0.6)
        total += 10.0 + x * x - 10.0 * math.cos(2.0 * math.pi * x)
    return total


def ackley(u):
    d = float(len(u))
    x = [60.0 * (a - 0.4) for a in u]
    radius = math.sqrt(sum(v * v for v in x) / d)
    ripple = sum(math.cos(2.0 * math.pi * v) for v in x) / d
    return 20.0 + math.e - 20.0 * math.exp(-0.2 * radius) - math.exp(ripple)


def min_max(u):
    worst = max(min(abs(x - 0.2) - 0.125, 2.0 * abs(x - 0.8125) - 0.25) for x in u)
    return math.floor(worst * 64.0) / 64.0


def hole(u):
    squared = 0.0
    for x in u:
        squared += (x - 0.7) * (x - 0.7)
    if squared < 0.0025:
        return 400.0 * squared - 1.0
    decoy = 0.0
    for x in u:
        decoy += (x - 0.2) * (x - 0.2)
    return decoy / (10.0 * float(len(u)))


# --- functions in tests/golden.rs only ---


def noisy(u):
    """A sphere with a fine sawtooth that looks like noise."""
    phase = 0.0
    for i, x in enumerate(u):
        phase += (i + 1.0) * 12345.0 * x
    return sphere(u) + 0.01 * (phase - math.floor(phase))


def cliff(u):
    """A sphere that is infinite where the first coordinate exceeds 0.55."""
    return math.inf if u[0] > 0.55 else sphere(u)


def corner(u):
    """A function with its minimum in the corner (0, 1, 0, 1, ...), where the gradient is not zero."""
    total = 0.0
    for i, x in enumerate(u):
        y = x if i % 2 == 0 else 1.0 - x
        total += (i + 1.0) * y + 0.5 * y * y
    return total


def edge(u):
    """A quartic bowl, coupled between neighbors, whose minimizer has its first coordinate at the bound 1."""
    total = 0.0
    for i, x in enumerate(u):
        y = x - (1.2 if i == 0 else 0.35)
        total += y * y + 3.0 * y * y * y * y
    for a, b in zip(u, u[1:]):
        total += 0.5 * (a - b) * (a - b)
    return total


def flat(u):
    return 1.0


def failing(u):
    return math.inf


FUNCTIONS = {f.__name__: f for f in (
    sphere, rosenbrock, rastrigin, ackley, min_max, hole, noisy, cliff, corner, edge, flat, failing)}


def recorder(name):
    function, calls = FUNCTIONS[name], []

    def objective(x):
        u = [float(v) for v in x]
        value = function(u)
        calls.append((u, value))
        return value

    return objective, calls


def fnv1a(points):
    """The 64-bit FNV-1a hash of the coordinates' bytes, little endian."""
    state = 0xCBF29CE484222325
    for u in points:
        for byte in struct.pack(f"<{len(u)}d", *u):
            state = ((state ^ byte) * 0x100000001B3) % 2**64
    return f"{state:016x}"


# --- Nelder-Mead ---

STATUS = {0: "Converged", 1: "EvaluationLimit", 2: "IterationLimit"}


def nelder_mead_run(name, start, simplex=None, **options):
    objective, calls = recorder(name)
    d = len(start)
    given = dict(options)
    if simplex is not None:
        given["initial_simplex"] = np.array(simplex)
    with np.errstate(invalid="ignore"):
        result = minimize(objective, start, method="Nelder-Mead", bounds=[(0.0, 1.0)] * d, options=given)
    points = [u for u, _ in calls]
    shown = sorted({*range(min(len(points), d + 2)), *range(0, len(points), 40), len(points) - 1})
    return {
        "function": name, "start": start, "simplex": simplex, "options": options,
        "n": len(points), "hash": fnv1a(points), "points": {str(i): points[i] for i in shown},
        "finish": STATUS[result.status],
    }


def nelder_mead():
    rng = np.random.default_rng(20240501)
    uniform = lambda *shape: rng.uniform(size=shape).tolist()
    runs = []
    names = ["sphere", "rosenbrock", "min_max", "hole", "noisy", "cliff", "corner", "edge", "flat", "failing"]
    for name in names:
        for d in range(1, 7):
            if name == "rosenbrock" and d == 1:
                continue
            runs.append(nelder_mead_run(name, uniform(d)))
    for d in range(1, 7):
        for start in ([0.0] * d, [1.0] * d, [0.97] * d, [float(i % 2) for i in range(d)]):
            runs.append(nelder_mead_run("edge", start))
            runs.append(nelder_mead_run("min_max", start))
        wide = (np.array(uniform(d + 1, d)) * 1.6 - 0.3).tolist()
        runs.append(nelder_mead_run("noisy", uniform(d), simplex=wide))
        runs.append(nelder_mead_run("sphere", uniform(d), adaptive=True))
        runs.append(nelder_mead_run("edge", uniform(d), adaptive=True, xatol=1e-8, fatol=1e-10))
        runs.append(nelder_mead_run("noisy", uniform(d), maxfev=300, xatol=0.0, fatol=0.0))
        runs.append(nelder_mead_run("hole", uniform(d), maxfev=d))
        runs.append(nelder_mead_run("cliff", [0.6] * d, maxfev=50 + d))
        runs.append(nelder_mead_run("sphere", uniform(d), maxiter=30))
        runs.append(nelder_mead_run("failing", uniform(d), maxfev=17, maxiter=9))
    return runs


# --- L-BFGS-B ---


def lbfgsb_run(name, start, **options):
    objective, calls = recorder(name)
    d = len(start)
    with np.errstate(invalid="ignore"):
        result = minimize(objective, start, method="L-BFGS-B", bounds=[(0.0, 1.0)] * d, options=options)
    assert len(calls) % (d + 1) == 0, "every point has d neighbors"
    rounds = [calls[i:i + d + 1] for i in range(0, len(calls), d + 1)]
    # After infinite values SciPy may continue with NaN points, which our search never proposes.
    lost = next((i for i, r in enumerate(rounds) if any(map(math.isnan, r[0][0]))), None)
    rounds = rounds[:lost]
    return {
        "function": name, "start": start, "options": options,
        "points": [r[0][0] for r in rounds],
        "values": [[value for _, value in r] for r in rounds],
        "result": None if lost else {
            "x": result.x.tolist(), "value": float(result.fun), "success": bool(result.success)},
    }


def lbfgsb():
    rng = np.random.default_rng(20240502)
    runs = []
    for name in ["sphere", "rosenbrock", "rastrigin", "ackley", "hole", "corner", "edge", "min_max", "noisy", "cliff"]:
        for d in (1, 2, 3, 5):
            if name == "rosenbrock" and d == 1:
                continue
            runs.append(lbfgsb_run(name, rng.uniform(size=d).tolist()))
    runs.append(lbfgsb_run("cliff", [0.7, 0.2, 0.9]))
    runs.append(lbfgsb_run("cliff", [0.55, 0.2, 0.9]))
    runs.append(lbfgsb_run("rosenbrock", [0.05, 0.9, 0.1, 0.95, 0.2, 0.6]))
    runs.append(lbfgsb_run("rosenbrock", [0.0, 1.0, 0.0, 1.0], maxcor=3))
    runs.append(lbfgsb_run("edge", [1.0, 1.0, 1.0]))
    runs.append(lbfgsb_run("edge", [0.0, 0.0, 0.0, 0.0], ftol=0.0, gtol=1e-12))
    runs.append(lbfgsb_run("rosenbrock", [0.1, 0.2, 0.3], maxiter=7))
    runs.append(lbfgsb_run("rosenbrock", [0.1, 0.2, 0.3], maxfun=40))
    return runs


# --- dual annealing ---

# (function, d, threshold, maximum number of evaluations)
BENCHMARKS = [
    ("sphere", 4, 1e-3, 2000),
    ("rosenbrock", 3, 1e-3, 4000),
    ("rastrigin", 3, 0.5, 4000),
    ("ackley", 3, 1.0, 4000),
    ("min_max", 3, -0.15, 4000),
    ("hole", 2, -0.5, 8000),
]
N_SEEDS = 200


class Over(Exception):
    pass


def evaluations_to(name, d, threshold, most, seed):
    """The number of the first evaluation at or below the threshold; most + 1 if it is later."""
    function, count = FUNCTIONS[name], 0

    def objective(x):
        nonlocal count
        count += 1
        if count > most or function([float(v) for v in x]) <= threshold:
            raise Over
        return function([float(v) for v in x])

    try:
        dual_annealing(objective, [(0.0, 1.0)] * d, rng=np.random.default_rng(seed), maxiter=100_000)
    except Over:
        return count
    raise AssertionError("the limit is reached first")


def benchmarks(n_seeds=N_SEEDS):
    return [
        {"function": name, "d": d, "threshold": threshold, "most": most,
         "evaluations": [evaluations_to(name, d, threshold, most, seed) for seed in range(n_seeds)]}
        for name, d, threshold, most in BENCHMARKS
    ]


# --- the visiting distribution ---


def visiting():
    samples = []
    for seed, (visit, temperature) in enumerate(
            [(2.62, 5230.0), (2.62, 100.0), (2.62, 1.0), (2.62, 0.1), (1.7, 50.0), (2.9, 50.0)]):
        rng = np.random.default_rng(seed)
        distribution = VisitingDistribution(np.zeros(1), np.ones(1), visit, rng)
        jumps = np.sort(distribution.visit_fn(temperature, 1000))
        distribution = VisitingDistribution(np.zeros(3), np.ones(3), visit, rng)
        center = np.array([0.1, 0.5, 0.9])
        all_move = np.sort([distribution.visiting(center, 0, temperature)[0] for _ in range(1000)])
        one_moves = np.sort([distribution.visiting(center, 5, temperature)[2] for _ in range(1000)])
        short = lambda values: [float(f"{v:.7g}") for v in values]
        samples.append({"visit": visit, "temperature": temperature, "jumps": short(jumps),
                        "first_of_all": short(all_move), "last_alone": short(one_moves)})
    return samples


# --- differential evolution ---

# (function, d, strategy, members per coordinate, threshold, maximum number of evaluations)
EVOLUTIONS = [
    ("sphere", 4, "best1bin", 5, 1e-3, 4000),
    ("rosenbrock", 3, "rand1bin", 10, 1e-2, 8000),
    ("rastrigin", 3, "best1bin", 15, 1.0, 8000),
    ("edge", 3, "rand1bin", 8, 0.21, 4000),
]


def evolution_to(name, d, strategy, popsize, threshold, most, seed):
    """As evaluations_to, for `differential_evolution`."""
    function, count = FUNCTIONS[name], 0

    def objective(x):
        nonlocal count
        count += 1
        value = function([float(v) for v in x])
        if count > most or value <= threshold:
            raise Over
        return value

    try:
        differential_evolution(objective, [(0.0, 1.0)] * d, strategy=strategy, popsize=popsize, tol=0.0, maxiter=100_000,
                               updating="deferred", polish=False, rng=np.random.default_rng(seed))
    except Over:
        return count
    raise AssertionError("the limit is reached first")


def evolutions(n_seeds=200):
    return [
        {"function": name, "d": d, "strategy": strategy, "population": popsize * d, "threshold": threshold, "most": most,
         "evaluations": [evolution_to(name, d, strategy, popsize, threshold, most, seed) for seed in range(n_seeds)]}
        for name, d, strategy, popsize, threshold, most in EVOLUTIONS
    ]


# --- Sobol ---


def sobol():
    runs = []
    for d in (1, 2, 3, 10, 128, 1024):
        points = qmc.Sobol(d, scramble=False, bits=53).random(512)
        runs.append({"d": d, "n": len(points), "hash": fnv1a(points.tolist()), "last": points[-1].tolist()})
    return runs


def write(name, content):
    versions = {"scipy": scipy.__version__, "numpy": np.__version__}
    rows = ",\n".join(json.dumps(row) for row in content)
    text = f'{{"versions": {json.dumps(versions)}, "runs": [\n{rows}\n]}}\n'
    # JSON has no infinity.
    (pathlib.Path(__file__).parent / name).write_text(text.replace("Infinity", '"inf"'), encoding="utf-8")


if __name__ == "__main__":
    write("nelder_mead.json", nelder_mead())
    write("lbfgsb.json", lbfgsb())
    write("visiting.json", visiting())
    write("dual_annealing.json", benchmarks())
    write("sobol.json", sobol())
    write("evolution.json", evolutions())
