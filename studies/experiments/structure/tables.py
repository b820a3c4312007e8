"""Tables of the trials and of the models, in Markdown."""

import math
from collections.abc import Iterable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import wilcoxon

Row = dict[str, str]
Same = dict[tuple[str, str], str]
PRESENT = "whole-bound"
ALPHA = 0.05


def counts(rows: Iterable[Row], same: Same) -> dict[tuple[str, str], dict[int, int]]:
    """Returns simulations by system and variant, then by seed. A trial without a violation counts as its budget."""
    found: dict[tuple[str, str], dict[int, int]] = {}
    for row in rows:
        found.setdefault((row["system"], row["variant"]), {})[int(row["seed"])] = int(row["simulations"])
    return found | {key: found[key[0], kind] for key, kind in same.items() if (key[0], kind) in found}


def paired(first: dict[int, int], second: dict[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    seeds = sorted(first.keys() & second.keys())
    return np.array([first[s] for s in seeds], float), np.array([second[s] for s in seeds], float)


def p_value(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Two-sided Wilcoxon signed-rank test; equal pairs are dropped."""
    return 1.0 if (a == b).all() else float(wilcoxon(a, b, zero_method="wilcox", method="auto").pvalue)


def holm(p: dict[str, float]) -> dict[str, float]:
    """Returns adjusted p-values."""
    adjusted, largest = {}, 0.0
    for rank, name in enumerate(sorted(p, key=lambda name: p[name])):
        largest = max(largest, min(1.0, (len(p) - rank) * p[name]))
        adjusted[name] = largest
    return adjusted


def compare(found: dict[tuple[str, str], dict[int, int]], systems: list[str], variant: str, base: str) -> dict[str, float]:
    """Returns p-values with Holm's correction over the tasks and over the functions."""
    p = {system: p_value(*paired(found[system, variant], found[system, base])) for system in systems}
    groups = ({s: p[s] for s in systems if s.startswith("function/") == of_functions} for of_functions in (True, False))
    return {system: value for group in groups for system, value in holm(group).items()}


def mark(found: dict[tuple[str, str], dict[int, int]], adjusted: dict[str, float], system: str, variant: str) -> str:
    a, b = paired(found[system, variant], found[system, PRESENT])
    text = f"{np.mean(list(found[system, variant].values())):.1f}"
    if adjusted.get(system, 1.0) >= ALPHA:
        return text
    return f"**{text}**" if a.mean() < b.mean() else f"{text} (worse)"


def line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def head(cells: list[str], left: int = 1) -> str:
    return line(cells) + "\n|" + "---|" * left + "--:|" * (len(cells) - left)


def write_trials(rows: list[Row], same: Same) -> None:
    found = counts(rows, same)
    variants = [v for v in dict.fromkeys(variant for _, variant in found)]
    systems = [s for s in dict.fromkeys(row["system"] for row in rows) if all((s, v) in found for v in variants)]
    adjusted = {variant: compare(found, systems, variant, PRESENT) for variant in variants}
    print(head(["system", *variants]))
    for system in systems:
        print(line([f"`{system}`", *(mark(found, adjusted[v], system, v) for v in variants)]))
    for title, group in [("tasks", [s for s in systems if "function/" not in s]), ("functions", [s for s in systems if "function/" in s])]:
        means = {v: [np.mean(list(found[s, v].values())) for s in group] for v in variants}
        print(line([f"mean of {len(group)} {title}", *(f"{np.mean(means[v]):.1f}" for v in variants)]))
        ratios = [float(np.exp(np.mean(np.log(np.array(means[v]) / np.array(means[PRESENT]))))) for v in variants]
        print(line(["geometric mean of the ratios to whole-bound", *(f"{ratio:.2f}" for ratio in ratios)]))
    print()
    for base in (PRESENT, "whole-probability"):
        score = base.rsplit("-", 1)[1]
        for variant in variants:
            if variant == base or base != PRESENT and not variant.endswith(score):
                continue
            print(f"{variant} against {base}: " + verdict(found, systems, variant, base))


def verdict(found: dict[tuple[str, str], dict[int, int]], systems: list[str], variant: str, base: str) -> str:
    adjusted = compare(found, systems, variant, base)
    pairs = {system: paired(found[system, variant], found[system, base]) for system in systems}
    fewer = [s for s in systems if adjusted[s] < ALPHA and pairs[s][0].mean() < pairs[s][1].mean()]
    more = [s for s in systems if adjusted[s] < ALPHA and pairs[s][0].mean() > pairs[s][1].mean()]
    raw = sum(p_value(*pairs[s]) < ALPHA and pairs[s][0].mean() > pairs[s][1].mean() for s in systems)
    tasks = [s for s in systems if not s.startswith("function/")]
    means = [np.array([pairs[s][side].mean() for s in tasks]) for side in (0, 1)]
    ratio, over_tasks = float(np.exp(np.log(means[0] / means[1]).mean())), p_value(np.log(means[0]), np.log(means[1]))
    return f"ratio over the tasks {ratio:.2f}, p = {over_tasks:.2g}; fewer on {fewer}, more on {more} (before Holm on {raw})"


def mean(rows: list[Row], kind: str, key: str, systems: list[str]) -> float:
    values = [float(row[key]) for row in rows if row["kind"] == kind and row["system"] in systems]
    return float(np.nanmean(values)) if values and not np.isnan(values).all() else math.nan


def write_models(rows: list[Row]) -> None:
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    keys = ["rank_correlation", "auc", "log_loss"]
    print("\n" + head(["models", *keys, "predicted violations", "violations"]))
    violated = [s for s in dict.fromkeys(row["system"] for row in rows)]
    for title, group in [("tasks", [s for s in violated if "function/" not in s]), ("functions", [s for s in violated if "function/" in s])]:
        for kind in kinds:
            of = partial(mean, rows, kind, systems=group)
            cells = [f"{of(key):.2f}" for key in keys] + [f"{of('predicted'):.1f}", f"{of('violations'):.1f}"]
            print(line([f"{title}: {kind}", *cells]))
    print("\n" + head(["system", "violations", "most frequent conjunct sets", "and is negative", *kinds]))
    for system in violated:
        own = {row["kind"]: row for row in rows if row["system"] == system}
        one = own[kinds[0]]
        facts = [one["violations"], f"{float(one['sets']):.2f}", f"{float(one['sets_and_fails']):.2f}"]
        print(line([f"`{system}`", *facts, *(f"{float(own[k]['auc']):.2f}/{float(own[k]['log_loss']):.2f}" for k in kinds)]))


def write_confirmation(rows: list[Row], same: Same) -> None:
    found = counts(rows, same)
    systems = list(dict.fromkeys(row["system"] for row in rows))
    variants = list(dict.fromkeys(row["variant"] for row in rows))
    for first, second in [(variants[2], variants[0]), (variants[2], variants[1]), (variants[1], variants[0])]:
        adjusted = compare(found, systems, first, second)
        print("\n" + head(["fresh seeds", first, second, "p (Holm)"]))
        for system in systems:
            a, b = paired(found[system, first], found[system, second])
            print(line([f"`{system}` ({len(a)} seeds)", f"{a.mean():.1f}", f"{b.mean():.1f}", f"{adjusted[system]:.2g}"]))


def write(trials: list[Row], confirmation: list[Row], models: list[Row], same: Same, budget: int) -> None:
    print(f"Restricted mean of the simulations until a violation, of at most {budget}. Bold: significantly fewer than {PRESENT}.\n")
    write_trials(trials, same)
    if confirmation:
        write_confirmation(confirmation, same)
    if models:
        write_models(models)
