"""One trial: corners and Sobol points, then the candidate with the best score of the composed models, one at a time."""

from collections.abc import Callable

import numpy as np
from formulas import Parts
from model import Array, Process
from scipy.stats import qmc
from systems import WINDOWS, System
from variants import VARIANTS, Variant, composed_bound, log_probability

KAPPA = 2.0
"""Standard deviations of the lower confidence bound, as in `portfolio`."""
CANDIDATES = 150
BEST = 6
CORNERS = 8
GAP, GAPS = 0.3, (4, 64)


def design(dimension: int, seed: int) -> Array:
    """Returns all corners of up to 3 axes or else 8 random ones, the center, and 4 to 8 Sobol points, as `portfolio` does."""
    random = np.random.default_rng([seed, dimension])
    if dimension <= 3:
        corners = np.array(np.meshgrid(*[[0.0, 1.0]] * dimension)).reshape(dimension, -1).T
        random.shuffle(corners)
    else:
        half = random.integers(0, 2, (CORNERS // 2, dimension)).astype(float)
        corners = np.concatenate([half, 1.0 - half])
    sobol = qmc.Sobol(dimension, seed=seed).random(8)[: int(np.clip(dimension, 4, 8))]
    return np.concatenate([corners, np.full((1, dimension), 0.5), sobol])


class Models:
    """The processes of a variant's leaves."""

    def __init__(self, variant: Variant, system: System) -> None:
        self.tree = variant.tree(system.terms, WINDOWS)
        self.variant = variant
        self.processes: list[Process] = []
        self.next_fit = 0
        self.dimension = system.dimension

    def learn(self, points: Array, found: list[Parts]) -> None:
        leaves = self.variant.targets(found)
        if not self.processes:
            self.processes = [Process(self.dimension) for _ in leaves]
        refit = len(points) >= self.next_fit
        if refit:
            self.next_fit = len(points) + int(np.clip(GAP * len(points), *GAPS))
        for process, (targets, _) in zip(self.processes, leaves):
            if refit and np.ptp(targets) > 0:
                process.fit(points, targets)
            process.condition(points, targets)
        self.levels = [level for _, level in leaves]
        self.leaves = leaves

    def score(self, points: Array) -> Array:
        """Returns scores; the lowest is the best."""
        return self.composed([process.predict(points) for process in self.processes])

    def composed(self, predictions: list[tuple[Array, Array]]) -> Array:
        if self.variant.score == "bound":
            pairs = zip(predictions, self.levels)
            return composed_bound(self.tree, [mean - level - KAPPA * deviation for (mean, deviation), level in pairs])
        heights = [(mean - level) / deviation for (mean, deviation), level in zip(predictions, self.levels)]
        return -log_probability(self.tree, heights)

    def observed(self) -> Array:
        """Returns the composition of the targets of the evaluated points."""
        return composed_bound(self.tree, [targets - level for targets, level in self.leaves])


def candidates(points: Array, best: Array, random: np.random.Generator) -> Array:
    """Returns points of the box, of its faces and corners, and near the best points, as candidates.rs does."""
    d = points.shape[1]
    anywhere = random.random((CANDIDATES, d))
    faces = random.random((CANDIDATES, d))
    on_face = random.random((CANDIDATES, d)) < random.random((CANDIDATES, 1))
    faces[on_face] = np.round(random.random(on_face.sum()))
    return np.concatenate([anywhere, faces, near(points[best[np.arange(CANDIDATES) % len(best)]], random, 0.3)])


def near(centers: Array, random: np.random.Generator, largest: float) -> Array:
    """Changes some coordinates of each row by a step of random size, some of them to a bound."""
    n, d = centers.shape
    changed = random.random((n, d)) < np.minimum(1.0, random.choice([1.5, 4.0, 20.0], (n, 1)) / d)
    changed[np.arange(n), random.integers(0, d, n)] = True
    steps = largest * (0.01 ** random.random((n, 1))) * random.normal(size=(n, d))
    moved = np.clip(centers + steps, 0.0, 1.0)
    to_face = random.random((n, d)) < 0.15
    moved[to_face] = np.round(random.random(to_face.sum()))
    return np.where(changed, moved, centers)


def propose(models: Models, points: Array, random: np.random.Generator) -> Array:
    best = np.argsort(models.observed(), kind="stable")[:BEST]
    pool = candidates(points, best, random)
    scores = models.score(pool)
    for largest in (0.1, 0.03):
        top = pool[np.argsort(scores)[:5]]
        more = near(np.repeat(top, 10, axis=0), random, largest)
        pool, scores = np.concatenate([pool, more]), np.concatenate([scores, models.score(more)])
    for i in np.argsort(scores):
        if np.abs(points - pool[i]).max(1).min() > 1e-6:
            return pool[i]
    return random.random(points.shape[1])


def trial(system: System, names: list[str], seed: int, budget: int, simulate: Callable[[Array], Parts]) -> tuple[int, bool]:
    """Returns the number of simulations, and whether the last one violates the formula. Several variants take turns; each learns
    from all points."""
    points, found = np.empty((0, system.dimension)), []
    turns = [Models(VARIANTS[name], system) for name in names]
    start = design(system.dimension, seed)
    for step in range(budget):
        if step < len(start):
            point = start[step]
        else:
            models = turns[step % len(turns)]
            models.learn(points, found)
            point = propose(models, points, np.random.default_rng([seed, step]))
        found.append(simulate(point))
        points = np.vstack([points, point])
        if found[-1].robustness < 0:
            return step + 1, True
    return budget, False
