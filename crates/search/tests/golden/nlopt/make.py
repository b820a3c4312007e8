"""Runs Gablonsky's DIRECT of NLopt on [0,1]^d and writes direct.json, the points of many runs: a hash of all, some in full.

Run `python make.py` in this folder, in an environment with requirements.txt. The functions are those of ../scipy/make.py,
plus a small slope. Without it, many values are equal, and the order of equal values differs from ours.

SciPy has the same program, but release 1.17.1 also divides rectangles above the convex hull.
"""

import json
import pathlib
import sys

import nlopt

HERE = pathlib.Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "scipy"))
from make import FUNCTIONS, fnv1a

NAMES = ["sphere", "rosenbrock", "rastrigin", "ackley", "hole", "corner", "edge", "noisy"]


def run(name, d, biased):
    points = []

    def objective(x, _):
        u = [float(v) for v in x]
        points.append(u)
        tilt = 0.0
        for i, v in enumerate(u):
            tilt += 0.001 * (i + 1.0) * v
        return FUNCTIONS[name](u) + tilt

    optimizer = nlopt.opt(nlopt.GN_ORIG_DIRECT_L if biased else nlopt.GN_ORIG_DIRECT, d)
    optimizer.set_min_objective(objective)
    optimizer.set_lower_bounds([0.0] * d)
    optimizer.set_upper_bounds([1.0] * d)
    optimizer.set_maxeval(100 * d)
    optimizer.optimize([0.5] * d)
    shown = sorted({*range(min(len(points), 2 * d + 3)), *range(0, len(points), 100), len(points) - 1})
    return {"function": name, "d": d, "locally_biased": biased, "n": len(points), "hash": fnv1a(points),
            "points": {str(i): points[i] for i in shown}}


if __name__ == "__main__":
    runs = [run(name, d, biased) for name in NAMES for biased in (True, False) for d in (1, 2, 3, 5, 10)
            if d > 1 or name != "rosenbrock"]
    version = f"{nlopt.version_major()}.{nlopt.version_minor()}.{nlopt.version_bugfix()}"
    rows = ",\n".join(json.dumps(row) for row in runs)
    text = f'{{"versions": {{"nlopt": "{version}"}}, "runs": [\n{rows}\n]}}\n'
    (HERE / "direct.json").write_text(text, encoding="utf-8")
