"""Runs RTAMT on random formulas and traces with fixed seeds and writes its results to the .json files in this folder.

values.json: formulas, traces and the robustness at every sample, by the discrete-time offline monitor.
trees.json: formulas without redundant parentheses, and RTAMT's syntax tree of each, fully in parentheses.
differences.json: formulas that RTAMT parses differently from arithmetic, since it gives `+` a higher precedence than `-`
and `*` a higher one than `/`. Each is stored with the parentheses that correct it, and with its robustness with and
without them. In the other two files all such formulas have the parentheses.

The files contain nothing that RTAMT rejects or computes wrongly: bounded operators on a bare variable (it appends to the
caller's list), traces of one sample, `unless` without an interval, NaN from the difference of two infinities. Its parser
rejects `a - 1` until it has parsed a few formulas and accepts it afterwards, so the order of the formulas matters.
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

# Name, spellings and binding power of each operator, and the calls that take operands in parentheses.
INFIX = {
    "*": (["*"], 24), "/": (["/"], 24), "+": (["+"], 23), "-": (["-"], 23),
    "<=": (["<="], 22), ">=": ([">="], 22), "<": (["<"], 22), ">": ([">"], 22), "==": (["=="], 22), "!==": (["!=="], 22),
    "until": (["until", "U"], 12), "unless": (["unless", "W"], 11), "since": (["since", "S"], 10),
    "and": (["and", "&"], 9), "or": (["or", "|"], 8), "implies": (["implies", "->"], 7), "iff": (["iff", "<->"], 6),
    "xor": (["xor"], 5),
}
PREFIX = {
    "not": (["not", "!"], 21), "always": (["always", "G"], 20), "eventually": (["eventually", "F"], 19),
    "historically": (["historically", "H"], 18), "once": (["once", "O"], 17), "prev": (["prev", "Y"], 16),
    "next": (["next", "X"], 15), "s_prev": (["s_prev", "sY"], 14), "s_next": (["s_next", "sX"], 13),
}
POWER = {name: power for name, (_, power) in (INFIX | PREFIX).items()}
# In RTAMT the first of each pair has a higher precedence than the second.
UNEQUAL = {"+": "-", "*": "/"}
TIMED = ["always", "eventually", "historically", "once", "until", "unless", "since"]
COMPARISONS = ["<=", ">=", "<", ">", "==", "!=="]
LOGIC = ["and", "or", "implies", "iff", "xor"]
FACTORS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


def column(rng, samples):
    """Samples of a signal: multiples of 1/8, so that sums and differences are exact."""
    return [rng.randrange(-40, 41) / 8 for _ in range(samples)]


def number(rng):
    value = rng.randrange(-16, 17) / 4
    return rng.choice([str(value), f"{value:.3e}", str(int(value))])


def arithmetic(rng, depth):
    """A tree over signals and numbers: text, or a list of operator, interval and operands."""
    kind = rng.randrange(8) if depth else rng.randrange(2)
    if kind == 0:
        return number(rng)
    if kind < 3:
        return rng.choice(SIGNALS)
    sub = lambda: arithmetic(rng, depth - 1)
    if kind < 6:
        return [rng.choice(["+", "-", "*"]), "", sub(), sub()]
    return rng.choice([
        ["/", "", sub(), ["+", "", ["abs", "", sub()], "1"]],
        ["sqrt", "", ["abs", "", sub()]],
        ["exp", "", ["/", "", sub(), "10"]],
        ["pow", "", sub(), rng.choice(["2", "3"])],
        ["abs", "", sub()],
    ])


def interval(rng, clock, samples):
    """An interval as text: inside the trace, a point, across its end or beyond; bounds with or without units."""
    shape = rng.randrange(6)
    begin = rng.randrange(samples)
    if shape == 0:
        begin, end = 0, rng.randrange(samples)
    elif shape == 1:
        end = begin
    elif shape == 2:
        end = begin + samples
    elif shape == 3:
        begin, end = samples, samples + rng.randrange(samples)
    elif shape == 4:
        begin, end = 0, 0
    else:
        end = begin + rng.randrange(4)
    units = rng.choice([("", ""), ("", ""), ("", clock["bound_unit"]), ("ms", "ms"), ("us", "ms"), ("ns", "us")])
    bounds = []
    for steps, unit in zip((begin, end), units):
        reference = unit or (units[1] or clock["unit"])
        value = steps * clock["period_ns"] / FACTORS[reference]
        bounds.append((f"{value:g}" if value != int(value) else str(int(value))) + rng.choice(["", " "]) * bool(unit) + unit)
    return "[" + bounds[0] + rng.choice([":", ",", ", ", " : "]) + bounds[1] + "]"


def formula(rng, depth, clock, samples, untimed=False):
    sub = lambda: formula(rng, depth - 1, clock, samples)
    if depth == 0:
        if rng.randrange(8) == 0:
            return ["+", "", rng.choice(SIGNALS), "0"]
        return [rng.choice(COMPARISONS), "", arithmetic(rng, 2), arithmetic(rng, 1)]
    kind = rng.randrange(10)
    if kind < 2:
        return [rng.choice(LOGIC), "", sub(), sub()]
    if kind == 2:
        return [rng.choice(["not", "not", "next", "prev", "s_next", "s_prev"]), "", sub()]
    if kind == 3:
        return [rng.choice(["rise", "fall"]), "", sub()]
    if kind == 4:
        return [rng.choice(COMPARISONS), "", sub(), sub()]
    name = rng.choice(TIMED)
    window = interval(rng, clock, samples) if rng.randrange(4) or name == "unless" else ""
    return [name, window, sub()] if name in PREFIX else [name, window, sub(), sub()]


def write(rng, tree, parent=None, right=False):
    """The tree as text, with the necessary parentheses and random redundant ones."""
    if isinstance(tree, str):
        return tree if not tree.startswith("-") or rng.randrange(2) else tree.replace("-", "- ", 1)
    name, window, *operands = tree
    if name in INFIX:
        spellings, power = INFIX[name]
        left = write(rng, operands[0], name)
        text = f"{left} {rng.choice(spellings)}{window} {write(rng, operands[1], name, True)}"
        outer = POWER.get(parent, 0)
        needed = power < outer or (right and power == outer) or name == UNEQUAL.get(parent)
    elif name in PREFIX:
        spellings, _ = PREFIX[name]
        operand = write(rng, operands[0], name)
        text = f"{rng.choice(spellings)}{window} {operand}"
        needed = parent is not None
    else:
        return f"{name}({', '.join(write(rng, operand) for operand in operands)})"
    return f"({text})" if needed or rng.randrange(10) == 0 else text


def specification(text, clock):
    spec = rtamt.StlDiscreteTimeOfflineSpecification()
    spec.ast.unit = clock["unit"]
    spec.set_sampling_period(clock["period"], clock["period_unit"], 0.1)
    parse(spec, text)
    assert len(spec.ast.specs) == 1, text
    return spec


def evaluate(text, clock, columns):
    """The robustness at every sample, or None if RTAMT fails or computes a NaN in a sub-formula."""
    try:
        spec = specification(text, clock)
        samples = len(columns[0])
        dataset = dict(zip(SIGNALS, copy.deepcopy(columns)), time=list(range(samples)))
        values = [value for _, value in spec.evaluate(dataset)]
    except (rtamt.RTAMTException, AssertionError, ArithmeticError, ValueError):
        return None
    results = (value for key, signal in spec.ast.offline_results.items() if key != "time" for value in signal)
    if any(math.isnan(value) for value in results):
        return None
    # RTAMT must not have modified its input, or later operands would have been read from modified lists.
    assert all(dataset[name] == column for name, column in zip(SIGNALS, columns)), text
    assert len(values) == samples, text
    return values


def as_text(values):
    """Numbers as text that parses exactly with every JSON parser, including infinities."""
    return " ".join(str(value) for value in values)


CLOCKS = [
    {"period": 1, "period_unit": "s", "unit": "s", "bound_unit": "s"},
    {"period": 0.1, "period_unit": "s", "unit": "s", "bound_unit": "ms"},
    {"period": 20, "period_unit": "ms", "unit": "ms", "bound_unit": "s"},
]
for clock in CLOCKS:
    clock["period_ns"] = round(clock["period"] * FACTORS[clock["period_unit"]])


# Windows with many samples of a longer trace, and specifications of the tasks.
LONG = [
    f"{name}{window} (b > 0.5)" if name in PREFIX else f"(a > -4.5) {name}{window} (b > 4)"
    for name in TIMED for window in ["[0:30]", "[3:66]", "[10:110]", "[100:170]"]
] + [
    "always[50:300](a <= 0.12)",
    "eventually[0:300](a <= 0.024 and b > 0)",
    "eventually[0:90](always[0:30](a <= 4 and b >= -4.5 and c <= 4.5))",
    "always[0:100]((a > -4) until[0:50] (b > 0))",
]


def make_long():
    rng = random.Random(20240603)
    for text in LONG:
        columns = [column(rng, 150) for _ in SIGNALS]
        yield case(text, CLOCKS[0], columns, evaluate(text, CLOCKS[0], columns))


def case(text, clock, columns, values):
    return {
        "formula": text,
        "period_secs": clock["period_ns"] / 1e9,
        "unit": clock["unit"],
        "trace": [as_text(column) for column in columns],
        "robustness": as_text(values),
    }


def make_values():
    rng = random.Random(20240601)
    cases = []
    reached = set()
    while len(cases) < 500:
        clock = CLOCKS[len(cases) % 3]
        samples = rng.choice([2, 3, 5, 8, 8, 12, 12, 20])
        text = write(rng, formula(rng, rng.choice([0, 1, 1, 2, 2, 3]), clock, samples))
        if len(text) > 400:
            continue
        columns = [column(rng, samples) for _ in SIGNALS]
        values = evaluate(text, clock, columns)
        if values is None:
            continue
        reached |= {word for name, (words, _) in (INFIX | PREFIX).items() for word in words if f"{word} " in text or f"{word}[" in text}
        reached |= {name for name in ["abs", "sqrt", "exp", "pow", "rise", "fall"] if f"{name}(" in text}
        cases.append(case(text, clock, columns, values))
    expected = {word for words, _ in (INFIX | PREFIX).values() for word in words} | {"abs", "sqrt", "exp", "pow", "rise", "fall"}
    assert expected <= reached, expected - reached
    return cases


def is_read_unequally(word, before):
    """Whether this operator follows the other one of its pair and RTAMT would bind it tighter."""
    for earlier in reversed(before):
        if earlier == UNEQUAL.get(word):
            return True
        if POWER.get(earlier, 0) < POWER.get(word, 0):
            return False
    return False


def make_trees():
    """Random infix and prefix operators over names, with few parentheses; `unless` is left out, which RTAMT expands."""
    rng = random.Random(20240602)
    infix = [word for name, (words, _) in INFIX.items() if name != "unless" for word in words]
    prefix = [word for words, _ in PREFIX.values() for word in words]

    def operand(depth):
        kind = rng.randrange(10)
        if kind < 2 and depth:
            return f"({expression(depth - 1)})"
        if kind < 5:
            return f"{rng.choice(prefix)} {operand(depth)}"
        if kind == 5:
            return f"{rng.choice(['rise', 'fall', 'abs', 'sqrt', 'exp'])}({expression(depth - 1) if depth else 'a'})"
        return rng.choice(["a", "b", "c", "2", "1.5e-3"])

    def expression(depth):
        text, before = operand(depth), []
        for _ in range(rng.choice([0, 1, 1, 2, 3])):
            word = rng.choice(infix)
            if is_read_unequally(word, before):
                text, before = f"({text})", []
            text += f" {word} {operand(depth)}"
            before.append(word)
        return text

    pairs = {}
    while len(pairs) < 500:
        text = expression(2)
        if 3 <= len(text) <= 160 and text not in pairs:
            try:
                pairs[text] = specification(text, CLOCKS[0]).ast.specs[0].name
            except (rtamt.RTAMTException, AssertionError):
                continue
    return list(pairs.items())


DIFFERENCES = {
    "a - b + c": "(a - b) + c",
    "a / b * c": "(a / b) * c",
    "a - b + c - a + b": "((a - b) + c - a) + b",
    "a / b * c / a * b": "((a / b) * c / a) * b",
    "a - b / c * a + c": "(a - (b / c) * a) + c",
    "always(a / b * c - b + c > a)": "always(((a / b) * c - b) + c > a)",
}


def make_differences():
    """Samples that are powers of two, so that no order of the arithmetic rounds."""
    columns = [[8.0, 4.0], [2.0, 4.0], [4.0, 0.5]]
    clock = CLOCKS[0]
    for text, mended in DIFFERENCES.items():
        without, right = (evaluate(text, clock, columns) for text in (text, mended))
        yield case(text, clock, columns, without) | {"mended": mended, "mended_robustness": as_text(right)}


if __name__ == "__main__":
    quiet()
    save(HERE / "values.json", make_values() + list(make_long()))
    save(HERE / "trees.json", make_trees())
    save(HERE / "differences.json", make_differences())
