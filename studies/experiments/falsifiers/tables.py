"""Computes the tables and the verdict of studies/notebook/2026-11-23-falsifiers.md from the recorded trials.

    python studies/experiments/falsifiers/tables.py            # prints them
    python studies/experiments/falsifiers/tables.py --update   # and writes them to the page

The bars were set before the benchmark was run. All are about our default search, `portfolio`, in batches of 1:

1. Its restricted mean is at most a third of that of SciPy's dual annealing over the systems without a failing corner, and at most a
   twentieth over those with one.
2. It is on no system significantly worse than `random` (one-sided signed-rank test, 5 %, Holm over the systems).
3. The median over the systems of its restricted mean over that of the best search is at most 1.1, or it does not differ
   significantly from the best search (two-sided, paired by seed, 5 %, Holm over the systems) on at least 80 % of them. The best search
   of a system is known only after the trials, which favors it.

A comparison of two searches uses the seeds that both have. A system takes part in a bar if both searches have at least five seeds, and
in the third bar if all searches but the slow ones have five seeds in common, which are then compared.
"""

import argparse
import csv
import gzip
import pathlib
import statistics
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import measures
import numpy as np
import searches
import systems
from bench import BUDGET, HERE, QUICK_RESULTS, SEEDS
from numpy.typing import NDArray

PAGE = HERE.parents[1] / "notebook/2026-11-23-falsifiers.md"
OURS, RANDOM, ANNEALING = "portfolio", "random", "scipy-dual-annealing"
LEVEL, FEWEST_SEEDS = 0.05, 5

BOTH = ("task", "function")
ARCH = "arch"
ARCH_SEARCHES = ("random", "portfolio", "bayesian", "turbo", "cma-es")
PUBLISHED = HERE / "published.csv"

Bar = tuple[str, bool | None, list[str]]
"""What was measured, the verdict (None without trials), and systems to list."""
Key = tuple[str, int]
"""Name of a search, and batch size."""


@dataclass(frozen=True)
class Row:
    simulations: int
    violated: bool
    proposal_ms: float


@dataclass(frozen=True)
class Results:
    """Trials by search, system and seed."""

    systems: list[systems.System]
    """Functions and tasks, of which bars and means are made."""
    arch: list[systems.System]
    """Problems of the ARCH competition, which have a table of their own."""
    trials: dict[Key, dict[str, dict[int, Row]]]

    def values(self, key: Key, system: str, seeds: Sequence[int] | None = None) -> NDArray[np.float64]:
        """Returns restricted numbers of simulations by seed."""
        found = self.trials[key][system]
        rows = [found[seed] for seed in (sorted(found) if seeds is None else seeds)]
        return measures.restricted([row.simulations for row in rows], [row.violated for row in rows], BUDGET)

    def pair(self, first: Key, second: Key, system: str) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Returns the trials of two searches with the same seeds; None if there are too few."""
        both = [self.trials.get(key, {}).get(system, {}) for key in (first, second)]
        seeds = sorted(both[0].keys() & both[1].keys())
        if len(seeds) < FEWEST_SEEDS:
            return None
        return self.values(first, system, seeds), self.values(second, system, seeds)

    def keys(self, batch: int) -> list[Key]:
        """Returns the recorded searches in batches of this size. Most have the same trials in any batch size."""
        own = [(search.name, batch if batch in search.batches else 1) for search in searches.SEARCHES]
        return [key for key in own if key in self.trials]

    def mean(self, key: Key, system: str) -> float | None:
        found = self.trials.get(key, {}).get(system, {})
        return float(self.values(key, system).mean()) if len(found) >= FEWEST_SEEDS else None


def read(results: pathlib.Path) -> Results:
    trials: dict[Key, dict[str, dict[int, Row]]] = {}
    for file in sorted((results / "rows").glob("*.csv.gz")):
        name, batch = file.name.removesuffix(".csv.gz").rsplit("-", 1)
        of: dict[str, dict[int, Row]] = defaultdict(dict)
        with gzip.open(file, "rt", newline="", encoding="utf-8") as lines:
            for row in csv.DictReader(lines):
                of[row["system"]][int(row["seed"])] = Row(int(row["simulations"]), row["violated"] == "1", float(row["proposal_ms"]))
        trials[name, int(batch)] = of
    every = systems.load()
    of_arch = [system for system in every if system.group == ARCH]
    return Results([system for system in every if system.group in BOTH], of_arch, trials)


def markdown(head: Sequence[str], rows: Sequence[Sequence[Any]], text_columns: int = 1) -> str:
    align = ["---"] * text_columns + ["--:"] * (len(head) - text_columns)
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in [head, align, *rows])


def interval(low: float, high: float, digits: int = 0) -> str:
    return f"{low:.{digits}f} to {high:.{digits}f}"


def ratio_bar(results: Results, groups: Sequence[str], corner: bool, most: float) -> Bar:
    """Returns the first bar over the systems with or without a failing corner: text, verdict, and the systems that miss it alone."""
    ours, theirs, missed, pairs = [], [], [], []
    for system in results.systems:
        pair = results.pair((OURS, 1), (ANNEALING, 1), system.name)
        if system.group not in groups or system.corner != corner or pair is None:
            continue
        means = [float(side.mean()) for side in pair]
        pairs.append(pair)
        ours.append(means[0])
        theirs.append(means[1])
        if means[0] > most * means[1]:
            missed.append(f"`{system.name}` ({means[0]:.1f} of {means[1]:.1f})")
    if not ours:
        return "no trials", None, []
    ratio = sum(ours) / sum(theirs)
    alone = [first / second for first, second in zip(ours, theirs)]
    these, like_these = (interval(*each, 2) for each in measures.ratio_intervals(pairs))
    text = (
        f"{np.mean(ours):.1f} of {np.mean(theirs):.1f} simulations over {len(ours)} systems: ratio {ratio:.3f} ({these} over seeds, "
        f"{like_these} over seeds and systems), median of the systems {statistics.median(alone):.3f}; {len(ours) - len(missed)} of {len(ours)} systems meet it alone"
    )
    return text, ratio <= most, missed


def random_bar(results: Results) -> Bar:
    names, p_values, means, full = [], [], [], 0
    for system in results.systems:
        pair = results.pair((OURS, 1), (RANDOM, 1), system.name)
        if pair is not None:
            names.append(system.name)
            full += len(pair[0]) >= SEEDS
            p_values.append(measures.paired_p(*pair, alternative="greater"))
            means.append([float(side.mean()) for side in pair])
    if not names:
        return "no trials", None, []
    worse = [index for index, p in enumerate(measures.holm(p_values)) if p < LEVEL]
    alone = [index for index, p in enumerate(p_values) if p < LEVEL]
    listed = [f"`{names[i]}` ({means[i][0]:.1f} against {means[i][1]:.1f}, p = {p_values[i]:.2g} before Holm)" for i in alone]
    text = f"worse on {len(worse)} of {len(names)} systems, of which {full} have {SEEDS} seeds; before Holm's correction on {len(alone)}"
    return text, not worse, listed


def best_search(results: Results, system: str, batch: int) -> tuple[Key, list[int]] | None:
    """Returns the search with the least restricted mean over the seeds that all fast searches have; None without enough of them."""
    keys = [(search.name, batch if batch in search.batches else 1) for search in searches.SEARCHES if not search.slow]
    found = [set(results.trials.get(key, {}).get(system, {})) for key in keys]
    seeds = sorted(set.intersection(*found))
    if len(seeds) < FEWEST_SEEDS:
        return None
    return min(keys, key=lambda key: (results.values(key, system, seeds).mean(), key[0] != OURS)), seeds


def best_bar(results: Results) -> Bar:
    names, ratios, p_values, listed, seeds = [], [], [], [], []
    for system in results.systems:
        best = best_search(results, system.name, 1)
        if best is None:
            continue
        pair = results.values((OURS, 1), system.name, best[1]), results.values(best[0], system.name, best[1])
        names.append(system.name)
        seeds.append(len(best[1]))
        ratios.append(float(pair[0].mean() / pair[1].mean()))
        p_values.append(measures.paired_p(*pair))
        listed.append(f"`{system.name}` ({pair[0].mean():.1f} against {pair[1].mean():.1f} of `{best[0][0]}`)")
    if not names:
        return "no trials", None, []
    adjusted = measures.holm(p_values)
    differ = [index for index, p in enumerate(adjusted) if p < LEVEL]
    same = 1 - len(differ) / len(names)
    before = 1 - sum(p < LEVEL for p in p_values) / len(names)
    median = statistics.median(ratios)
    text = (
        f"median ratio {median:.2f}; no significant difference on {100 * same:.0f} % of {len(names)} systems "
        f"({100 * before:.0f} % before Holm's correction)"
    )
    # The p-value of pairs that all differ in the same direction.
    least = measures.paired_p(np.zeros(min(seeds)), np.arange(1.0, min(seeds) + 1))
    if least * len(names) >= LEVEL:
        return f"{text}; {min(seeds)} seeds cannot show a difference", True if median <= 1.1 else None, []
    return text, median <= 1.1 or same >= 0.8, [listed[index] for index in differ]


def bars(results: Results) -> str:
    third = ("1, no corner fails: at most a third of SciPy's dual annealing", False, 1 / 3)
    twentieth = ("1, a corner fails: at most a twentieth", True, 1 / 20)
    found = [(name, ratio_bar(results, BOTH, corner, most)) for name, corner, most in (third, twentieth)]
    found += [
        ("2, never significantly worse than random", random_bar(results)),
        ("3, close to the best search of each system", best_bar(results)),
    ]
    parts = [
        (f"{name}, {group}s only", ratio_bar(results, [group], corner, most))
        for name, corner, most in (third, twentieth)
        for group in BOTH
    ]
    verdict = {True: "pass", False: "**fail**", None: "not measured"}
    table = markdown(["bar", "measured", "verdict"], [[name, text, verdict[ok]] for name, (text, ok, _) in found + parts], 2)
    heads = [
        "Systems without a failing corner that miss a third alone",
        "Systems with a failing corner that miss a twentieth alone",
        "Systems where `portfolio` is worse than `random` before Holm's correction",
        "Systems where `portfolio` differs significantly from the best search",
    ]
    lists = [f"{head}: {', '.join(each) or 'none'}." for head, (_, (_, _, each)) in zip(heads, found)]
    return table + "\n\n" + "\n\n".join(lists)


GROUPS: list[tuple[str, Callable[[systems.System], bool]]] = [
    ("tasks", lambda system: system.group == "task" and not system.corner),
    ("tasks, a corner fails", lambda system: system.group == "task" and system.corner),
    ("functions", lambda system: system.group == "function" and not system.corner),
    ("functions, a corner fails", lambda system: system.group == "function" and system.corner),
]


def common(results: Results, keys: Sequence[Key], chosen: Sequence[systems.System]) -> dict[str, list[int]]:
    """Returns the seeds that all searches have, of the systems where these are enough."""
    found = {}
    for system in chosen:
        seeds = set.intersection(*(set(results.trials[key].get(system.name, {})) for key in keys))
        if len(seeds) >= FEWEST_SEEDS:
            found[system.name] = sorted(seeds)
    return found


def overview(results: Results, batch: int, slow: bool) -> str:
    """Returns restricted mean and success rate of each search over each group. Slow searches have systems and seeds of their own."""
    by_name = {search.name: search for search in searches.SEARCHES}
    keys = [key for key in results.keys(batch) if slow or not by_name[key[0]].slow]
    if not keys:
        return "No trials."
    columns = [(name, common(results, keys, [system for system in results.systems if of(system)])) for name, of in GROUPS]
    columns = [(name, seeds) for name, seeds in columns if seeds]
    rows = []
    for key in keys:
        cells = []
        for _, seeds in columns:
            values = np.concatenate([results.values(key, system, of) for system, of in seeds.items()])
            found = [results.trials[key][system][seed] for system, of in seeds.items() for seed in of]
            low, high = measures.mean_interval(values)
            rate = measures.wilson_interval(sum(row.violated for row in found), len(found))
            share = sum(row.violated for row in found) / len(found)
            cells.append(f"{values.mean():.1f} ({interval(low, high)}); {100 * share:.0f} % ({interval(100 * rate[0], 100 * rate[1])})")
        every = [row for of in results.trials[key].values() for row in of.values()]
        each = sum(row.proposal_ms for row in every) / sum(row.simulations for row in every)
        rows.append([f"`{key[0]}`", *cells, f"{each:.2f}"])
    counts = [f"{name}: {len(seeds)} systems, {sum(map(len, seeds.values()))} trials" for name, seeds in columns]
    return markdown(["search", *counts, "ms per proposal"], rows)


def comparison(results: Results) -> str:
    """Returns a row for each system: our default search against random search, SciPy's dual annealing and the best search.

    The first three have the seeds in common that a row states, and the best search those of all searches.
    """
    rows = []
    for system in results.systems:
        if results.mean((OURS, 1), system.name) is None:
            continue
        others = [name for name in (RANDOM, ANNEALING) if results.mean((name, 1), system.name) is not None]
        found = [set(results.trials[name, 1][system.name]) for name in (OURS, *others)]
        seeds = sorted(set.intersection(*found))
        ours = results.values((OURS, 1), system.name, seeds)
        low, high = measures.mean_interval(ours)
        cells = [f"`{system.name}`", system.facts["kind"] + (", corner" if system.corner else ""), system.dimension, len(ours)]
        cells.append(f"{ours.mean():.1f} ({interval(low, high, 1)})")
        for other in (RANDOM, ANNEALING):
            theirs = results.values((other, 1), system.name, seeds) if other in others else None
            cells.append("" if theirs is None else f"{theirs.mean():.1f}")
            cells.append("" if theirs is None else f"{measures.a12(ours, theirs):.2f}")
        best = best_search(results, system.name, 1)
        cells.append("" if best is None else f"`{best[0][0]}` {results.values(best[0], system.name, best[1]).mean():.1f}")
        rows.append(cells)
    head = ["system", "kind", "axes", "seeds", "portfolio", "random", "A12", "SciPy's dual annealing", "A12", "best search"]
    return markdown(head, rows, 2)


def kinds(results: Results) -> str:
    """Returns the number of systems of each kind."""
    rows = []
    for name, of in GROUPS:
        found = [system.facts["kind"] for system in results.systems if of(system)]
        rows.append([name, *(found.count(kind) for kind in ("smooth", "cliff", "seam", "needle")), len(found)])
    return markdown(["group", "smooth", "cliff", "seam", "needle", "all"], rows)


def arch(results: Results) -> str:
    """Returns a row for each problem of the ARCH competition: restricted mean and falsified trials of our searches, over the seeds
    that all of them have. The controls are in no mean."""
    keys = [(name, 1) for name in ARCH_SEARCHES if (name, 1) in results.trials]
    seeds = common(results, keys, results.arch) if keys else {}
    if not seeds:
        return "No trials."
    rows, counted = [], []
    for system in (system for system in results.arch if system.name in seeds):
        of = seeds[system.name]
        cells = []
        for key in keys:
            values = results.values(key, system.name, of)
            falsified = sum(results.trials[key][system.name][seed].violated for seed in of)
            cells.append(f"{values.mean():.1f} ({interval(*measures.mean_interval(values))}); {falsified}")
        if not system.facts["control"]:
            counted.append([results.values(key, system.name, of).mean() for key in keys])
        name = f"`{system.name}`" + (" (control)" if system.facts["control"] else "")
        rows.append([name, system.dimension, len(of), *cells])
    if counted:
        rows.append(["mean without controls", "", "", *(f"{mean:.1f}" for mean in np.mean(counted, axis=0))])
    return markdown(["problem", "axes", "seeds", *(f"`{name}`" for name, _ in keys)], rows)


def published() -> str:
    """Returns figures that others published about these problems."""
    with open(PUBLISHED, newline="", encoding="utf-8") as lines:
        found = list(csv.DictReader(lines))
    rows = [
        [f"`arch/{row['problem']}`", f"{row['tool']} {row['year']}", f"{row['falsified']} of {row['runs']}", row["mean"], row["median"]] for row in found
    ]
    return markdown(["problem", "tool", "runs that falsified", "mean simulations of these", "median"], sorted(rows), 2)


def missing(results: Results) -> str:
    """Returns what the benchmark still lacks."""
    lines = []
    for search in searches.SEARCHES:
        for batch in search.batches:
            found = results.trials.get((search.name, batch), {})
            trials = sum(map(len, found.values()))
            lines.append([f"`{search.name}`", batch, len(found), trials])
    return markdown(["search", "batch", "systems", "trials"], lines)


def tables(results: Results) -> dict[str, str]:
    return {
        "bars": bars(results),
        "kinds": kinds(results),
        "overview": overview(results, 1, slow=False),
        "batches": overview(results, 16, slow=False),
        "slow": overview(results, 1, slow=True),
        "systems": comparison(results),
        "arch": arch(results),
        "published": published(),
        "trials": missing(results),
    }


def insert(page: str, name: str, text: str) -> str:
    """Replaces the text between the comments of a name."""
    start, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
    before, rest = page.split(start)
    return f"{before}{start}\n{text}\n\n{end}{rest.split(end)[1]}"


def main() -> None:
    parser = argparse.ArgumentParser(description="computes the tables of studies/notebook/2026-11-23-falsifiers.md")
    parser.add_argument("--results", type=pathlib.Path, default=HERE / "results")
    parser.add_argument("--update", action="store_true", help="write the tables to the page")
    parser.add_argument("--quick", action="store_true", help="of the trials of bench.py --quick")
    arguments = parser.parse_args()
    found = tables(read(QUICK_RESULTS if arguments.quick else arguments.results))
    print("\n\n".join(f"{name}\n\n{text}" for name, text in found.items()))
    if arguments.update:
        page = PAGE.read_text(encoding="utf-8")
        for name, text in found.items():
            page = insert(page, name, text)
        PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
