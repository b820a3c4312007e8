"""Test functions on [0,1]^d with a known violating volume: a value below 0 is a violation.

    python studies/experiments/falsifiers/functions.py      # counts the violations of the functions without a closed form again

The first group has a closed form for the volume. The second group has the usual test functions of global optimization on half of
each side of their usual box, at a random place in it, so that a minimum in its center can be anywhere, less a threshold. Its volumes are counts of uniform points: COUNTED of COUNT_POINTS, from
NumPy's `default_rng(COUNT_SEED)`. The thresholds are quantiles of other uniform points, rounded to four digits.

References: Surjanovic and Bingham, Virtual Library of Simulation Experiments, https://www.sfu.ca/~ssurjano (formulas and boxes);
P. Hall, Biometrika 19, 1927 (distribution of a sum of uniform numbers).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
COUNT_POINTS, COUNT_SEED = 4_000_000, 1
PLACE_SEED = 2026
# Draws of a place. With the first one, these functions fail in the center of the box, where some
# searches start.
DRAWS = {"levy-5": 2, "griewank-8": 2}


@dataclass(frozen=True)
class Function:
    """A function of the rows of an array. `volume` is the fraction of the unit cube with values below 0."""

    name: str
    dimension: int
    values: Callable[[Points], Points]
    volume: float
    counted: int | None = None
    """Violations among COUNT_POINTS uniform points; without it, the volume has a closed form."""
    levels: list[int | None] = field(default_factory=list)

    def axis_levels(self) -> list[int | None]:
        return self.levels or [None] * self.dimension


def place(name: str, dimension: int, margin: float) -> Points:
    """Returns a random point that is `margin` away from the faces."""
    draws = np.random.default_rng([PLACE_SEED, *name.encode()]).random((DRAWS.get(name, 1), dimension))
    return margin + (1 - 2 * margin) * np.asarray(draws[-1])


def ball_radius(dimension: int, volume: float) -> float:
    unit_ball = math.pi ** (dimension / 2) / math.gamma(dimension / 2 + 1)
    return float((volume / unit_ball) ** (1 / dimension))


def distance(points: Points, center: Points) -> Points:
    return np.sqrt(((points - center) ** 2).sum(axis=1))


def largest(points: Points, center: Points) -> Points:
    return np.abs(points - center).max(axis=1)


def uniform_sum_tail(count: int, bound: float) -> float:
    """Returns the probability that the sum of `count` uniform numbers exceeds `bound` (Irwin and Hall)."""
    rest = count - bound
    terms = [(-1) ** k * math.comb(count, k) * (rest - k) ** count for k in range(math.floor(rest) + 1)]
    return math.fsum(terms) / math.factorial(count)


def in_ball(name: str, dimension: int, volume: float, value: Callable[[Points, float], Points]) -> Function:
    """Violations are a ball inside the box; `value` gets distances from its center, and its radius."""
    radius = ball_radius(dimension, volume)
    center = place(name, dimension, radius)
    return Function(name, dimension, lambda points: value(distance(points, center), radius), volume)


def in_cube(name: str, dimension: int, volume: float, value: Callable[[Points, float], Points]) -> Function:
    """Violations are a cube inside the box; `value` gets largest differences of a coordinate, and half of its side."""
    half = volume ** (1 / dimension) / 2
    center = place(name, dimension, half)
    return Function(name, dimension, lambda points: value(largest(points, center), half), volume)


def at_bounds(name: str, dimension: int, bounds: int, volume: float) -> Function:
    """Violations are the part in the box of a ball whose center has `bounds` coordinates at 0 or 1."""
    radius = ball_radius(dimension, volume * 2**bounds)
    center = place(name, dimension, radius)
    center[:bounds] = np.round(place(name + "/bounds", bounds, 0.0))
    return Function(name, dimension, lambda points: distance(points, center) - radius, volume)


def valley(name: str, dimension: int, volume: float) -> Function:
    """Largest difference of neighboring coordinates: a parallelepiped of determinant 1 whose sides no axis has."""
    half = volume ** (1 / dimension) / 2
    center = place(name, dimension, half * dimension)

    def values(points: Points) -> Points:
        offset = points - center
        return np.abs(np.diff(offset, axis=1, prepend=0.0)).max(axis=1) - half

    return Function(name, dimension, values, volume)


def signs(name: str, dimension: int, bound: float) -> Function:
    """Mean of disturbances with random signs: fails where most have about the same sign as theirs."""
    sign = 2 * np.round(place(name, dimension, 0.0)) - 1
    volume = uniform_sum_tail(dimension, dimension * (1 + bound) / 2)
    return Function(name, dimension, lambda points: bound - ((2 * points - 1) * sign).mean(axis=1), volume)


def two_basins(name: str, dimension: int, volume: float) -> Function:
    """A wide basin without a violation, and a narrow one with the violations."""
    radius = ball_radius(dimension, volume)
    narrow = place(name, dimension, radius)
    wide = np.where(narrow < 0.5, narrow + 0.45, narrow - 0.45)

    def values(points: Points) -> Points:
        return np.minimum(0.05 + 0.5 * distance(points, wide), 2 * (distance(points, narrow) - radius))

    return Function(name, dimension, values, volume)


def mixed(name: str, whole: int, levels: int, real: int, volume_of_real: float) -> Function:
    """Whole numbers that must match, and real numbers that must be in a cube."""
    half = volume_of_real ** (1 / real) / 2
    center = place(name, real, half)
    match = np.floor(levels * place(name + "/levels", whole, 0.0))

    def values(points: Points) -> Points:
        found = np.minimum(np.floor(levels * points[:, :whole]), levels - 1)
        return np.abs(found - match).sum(axis=1) / levels + largest(points[:, whole:], center) - half

    volume = volume_of_real / levels**whole
    kinds: list[int | None] = [levels] * whole + [None] * real
    return Function(name, whole + real, values, volume, levels=kinds)


def slope(far: Points, radius: float) -> Points:
    return far - radius


def stairs(far: Points, radius: float) -> Points:
    return np.floor((far - radius) / 0.1) * 0.1 + np.where(far < radius, 0.0, 0.05)


def cliff(far: Points, half: float) -> Points:
    return np.where(far < half, -0.5, 0.3 + far - half)


def plateau(far: Points, radius: float) -> Points:
    return np.minimum(far - radius, 0.15)


def needle(far: Points, radius: float) -> Points:
    return np.where(far < radius, -1.0, 2.0 - far)


CLOSED_FORM = [
    in_ball("ball-2", 2, 0.003, slope),
    in_ball("ball-5", 5, 1e-3, slope),
    in_ball("ball-10", 10, 1e-6, slope),
    in_ball("stairs-5", 5, 1e-3, stairs),
    in_ball("plateau-3", 3, 1e-3, plateau),
    in_ball("needle-2", 2, 0.01, needle),
    in_ball("needle-5", 5, 0.005, needle),
    in_cube("cliff-2", 2, 1e-3, cliff),
    in_cube("cliff-5", 5, 1e-3, cliff),
    valley("valley-2", 2, 1e-3),
    valley("valley-5", 5, 1e-4),
    two_basins("two-basins-3", 3, 1e-3),
    mixed("mixed-5", 3, 5, 2, 0.1),
    at_bounds("face-5", 5, 2, 1e-3),
    at_bounds("corner-3", 3, 3, 1e-3),
    at_bounds("corner-6", 6, 6, 1e-5),
    signs("signs-10", 10, 0.55),
    signs("signs-20", 20, 0.5),
]


def ackley(x: Points) -> Points:
    root = np.sqrt((x**2).mean(axis=1))
    return -20 * np.exp(-0.2 * root) - np.exp(np.cos(2 * np.pi * x).mean(axis=1)) + 20 + np.e


def branin(x: Points) -> Points:
    a, b = x.T
    return (b - 5.1 / (4 * np.pi**2) * a**2 + 5 / np.pi * a - 6) ** 2 + 10 * (1 - 1 / (8 * np.pi)) * np.cos(a) + 10


def goldstein_price(x: Points) -> Points:
    a, b = x.T
    first = 1 + (a + b + 1) ** 2 * (19 - 14 * a + 3 * a**2 - 14 * b + 6 * a * b + 3 * b**2)
    second = 30 + (2 * a - 3 * b) ** 2 * (18 - 32 * a + 12 * a**2 + 48 * b - 36 * a * b + 27 * b**2)
    return np.log(first * second)


def griewank(x: Points) -> Points:
    index = np.sqrt(np.arange(1, x.shape[1] + 1))
    return (x**2).sum(axis=1) / 4000 - np.cos(x / index).prod(axis=1) + 1


def hartmann6(x: Points) -> Points:
    weights = np.array([1.0, 1.2, 3.0, 3.2])
    scales = np.array(
        [[10, 3, 17, 3.5, 1.7, 8], [0.05, 10, 17, 0.1, 8, 14], [3, 3.5, 1.7, 10, 17, 8], [17, 8, 0.05, 10, 0.1, 14]]
    )
    centers = 1e-4 * np.array(
        [
            [1312, 1696, 5569, 124, 8283, 5886],
            [2329, 4135, 8307, 3736, 1004, 9991],
            [2348, 1451, 3522, 2883, 3047, 6650],
            [4047, 8828, 8732, 5743, 1091, 381],
        ]
    )
    return -sum(w * np.exp(-(s * (x - c) ** 2).sum(axis=1)) for w, s, c in zip(weights, scales, centers))


def levy(x: Points) -> Points:
    w = 1 + (x - 1) / 4
    inner = ((w[:, :-1] - 1) ** 2 * (1 + 10 * np.sin(np.pi * w[:, :-1] + 1) ** 2)).sum(axis=1)
    last = (w[:, -1] - 1) ** 2 * (1 + np.sin(2 * np.pi * w[:, -1]) ** 2)
    return np.sin(np.pi * w[:, 0]) ** 2 + inner + last


def michalewicz(x: Points) -> Points:
    index = np.arange(1, x.shape[1] + 1)
    return -(np.sin(x) * np.sin(index * x**2 / np.pi) ** 20).sum(axis=1)


def rastrigin(x: Points) -> Points:
    return 10 * x.shape[1] + (x**2 - 10 * np.cos(2 * np.pi * x)).sum(axis=1)


def rosenbrock(x: Points) -> Points:
    return (100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2).sum(axis=1)


def schwefel(x: Points) -> Points:
    return 418.9829 * x.shape[1] - (x * np.sin(np.sqrt(np.abs(x)))).sum(axis=1)


def styblinski_tang(x: Points) -> Points:
    return (x**4 - 16 * x**2 + 5 * x).sum(axis=1) / 2


Box = list[tuple[float, float]]

# Name, formula, usual box, threshold, and violations among COUNT_POINTS points.
USUAL: list[tuple[str, Callable[[Points], Points], Box, float, int]] = [
    ("branin-2", branin, [(-5, 10), (0, 15)], 0.6923, 4_133),
    ("goldstein-price-2", goldstein_price, [(-2, 2)] * 2, 4.418, 4_292),
    ("rosenbrock-4", rosenbrock, [(-5, 10)] * 4, 48.24, 4_085),
    ("rastrigin-4", rastrigin, [(-5.12, 5.12)] * 4, 11.76, 3_860),
    ("levy-5", levy, [(-10, 10)] * 5, 0.8247, 4_061),
    ("michalewicz-5", michalewicz, [(0, math.pi)] * 5, -3.011, 4_268),
    ("schwefel-3", schwefel, [(-500, 500)] * 3, 379.5, 3_926),
    ("styblinski-tang-6", styblinski_tang, [(-5, 5)] * 6, -157.2, 4_019),
    ("hartmann-6", hartmann6, [(0, 1)] * 6, -1.878, 4_221),
    ("griewank-8", griewank, [(-600, 600)] * 8, 14.35, 3_884),
    ("ackley-10", ackley, [(-32.768, 32.768)] * 10, 14.68, 4_362),
]


def usual(name: str, formula: Callable[[Points], Points], box: Box, threshold: float, counted: int) -> Function:
    """Returns a function on a random part of its box with half of each side, less its threshold."""
    low, high = np.array(box, dtype=float).T
    start = low + 0.5 * (high - low) * place(name, len(box), 0.0)

    def values(points: Points) -> Points:
        return np.asarray(formula(start + 0.5 * (high - low) * points)) - threshold

    return Function(name, len(box), values, counted / COUNT_POINTS, counted)


COUNTED = [usual(*row) for row in USUAL]
FUNCTIONS = CLOSED_FORM + COUNTED


def count(function: Function, points: int, seed: int) -> int:
    """Returns the number of violations among uniform points."""
    random = np.random.default_rng(seed)
    chunks = range(0, points, 100_000)
    return sum(int((function.values(random.random((min(100_000, points - at), function.dimension))) < 0).sum()) for at in chunks)


def main() -> None:
    for function in COUNTED:
        print(f"{function.name}: {count(function, COUNT_POINTS, COUNT_SEED)}, recorded {function.counted}")


if __name__ == "__main__":
    main()
