"""Runs RTAMT's dense-time offline monitor on random formulas and signals with a fixed seed and writes values.json.

A case has a formula, the times and values of each signal, and the times and values of RTAMT's result, which hold until
the next time. Times and bounds are multiples of 1/8, so that sums of them are exact.

RTAMT holds the last value of every signal forever, while we close a window without an end where its operand's windows
would be cut. So no operator without an interval that reads later values contains another one that does. Also left out
are `iff` and `xor`, which have other values in RTAMT, signals that start late, since RTAMT computes windows at times
before the start of its operand, and what RTAMT rejects.
"""

import copy
import math
import pathlib
import random
import sys

import rtamt

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from rtamt_reference import SIGNALS, parse, quiet, save

AHEAD = ["always", "eventually", "until", "unless"]
BEHIND = ["historically", "once", "since"]
CASES = 400


def number(rng):
    return str(rng.randrange(-16, 17) / 4)


def arithmetic(rng, depth):
    kind = rng.randrange(8) if depth else rng.randrange(3)
    if kind == 0:
        return number(rng)
    if kind < 3:
        return rng.choice(SIGNALS)
    sub = lambda: arithmetic(rng, depth - 1)
    if kind < 6:
        return f"({sub()} {rng.choice(['+', '-', '*'])} {sub()})"
    return rng.choice([
        f"({sub()} / (abs({sub()}) + 1))", f"sqrt(abs({sub()}))", f"exp(({sub()} / 10))", f"pow({sub()}, 2)",
        f"abs({sub()})",
    ])


def interval(rng, end):
    begin = rng.choice([0, 0, rng.randrange(end + 1)])
    return f"[{begin / 8:g}:{(begin + rng.choice([0, 1, rng.randrange(end + 1)])) / 8:g}]"


def formula(rng, depth, end):
    """A formula, and whether its value depends on later values."""
    if depth == 0:
        comparison = rng.choice(["<=", ">=", "<", ">", "==", "!=="])
        return f"({arithmetic(rng, 2)} {comparison} {arithmetic(rng, 1)})", False
    (x, x_ahead), (y, y_ahead) = formula(rng, depth - 1, end), formula(rng, rng.randrange(depth), end)
    kind = rng.randrange(8)
    if kind == 0:
        return f"(not {x})", x_ahead
    if kind < 3:
        return f"({x} {rng.choice(['and', 'or', 'implies'])} {y})", x_ahead or y_ahead
    name = rng.choice(AHEAD + BEHIND)
    is_binary = name in ["until", "unless", "since"]
    reads_ahead = name in AHEAD
    is_open = name in AHEAD and (x_ahead or (is_binary and y_ahead))
    window = interval(rng, end) if is_open or name == "unless" or rng.randrange(3) else ""
    reads_ahead = reads_ahead or x_ahead or (is_binary and y_ahead)
    return (f"({x} {name}{window} {y})" if is_binary else f"({name}{window} {x})"), reads_ahead


def samples(rng, end):
    times = [0] + sorted(rng.sample(range(1, end + 1), rng.randrange(min(end, 6) + 1)))
    return [[time / 8, rng.randrange(-16, 17) / 4] for time in times]


def evaluate(text, signals):
    """RTAMT's result, or None if it fails or has a NaN."""
    try:
        spec = parse(rtamt.StlDenseTimeOfflineSpecification(), text)
        result = spec.evaluate(*([name, copy.deepcopy(signal)] for name, signal in zip(SIGNALS, signals)))
    except Exception as error:  # RTAMT raises all kinds
        print(f"{type(error).__name__}: {error}: {text}")
        return None
    return None if any(math.isnan(value) for _, value in result) else result


def as_text(samples):
    return [" ".join(f"{sample[part]}" for sample in samples) for part in (0, 1)]


def make():
    rng = random.Random(20261127)
    cases = []
    while len(cases) < CASES:
        end = rng.choice([1, 4, 8, 16, 32])
        text, _ = formula(rng, rng.choice([0, 1, 1, 2, 2, 3]), end)
        signals = [samples(rng, end) for _ in SIGNALS]
        result = evaluate(text, signals)
        if len(text) > 300 or result is None or not any(name in text for name in SIGNALS):
            continue
        cases.append({"formula": text, "signals": [as_text(signal) for signal in signals], "robustness": as_text(result)})
    return cases


if __name__ == "__main__":
    quiet()
    save(HERE / "values.json", make())
