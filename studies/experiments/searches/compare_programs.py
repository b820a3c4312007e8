"""Compares the default search of two builds of Mishandle on tasks.

    python studies/experiments/searches/compare_programs.py run --before PROGRAM --after PROGRAM
    python studies/experiments/searches/compare_programs.py table

The systems are the tasks of studies/experiments/falsifiers/systems, in the present space. A pilot (seed 1, 5 trials) of the program `before`
leaves out a system where it finds every violation within its first 4 simulations in the mean, or none at all: such a system cannot
show a difference. The others get 60 trials of each program with seed 46. `results.json` has a record per system and program, and
what it has is not run again. The table needs NumPy and SciPy.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile
import tomllib

HERE = pathlib.Path(__file__).parent
SYSTEMS = HERE.parent / "falsifiers" / "systems"
RESULTS = HERE / "results.json"
BUDGET, PILOT, REPORT = 300, (1, 5), (46, 60)
EASY = 4.0


def systems():
    """Returns the arguments of `falsify` for each system, by name."""
    found = {}
    for path in sorted(SYSTEMS.glob("*.toml")):
        for row in tomllib.loads(path.read_text(encoding="utf-8"))["system"]:
            if row["group"] == "task":
                found[row["name"]] = [row["task"], "--controller", row["controller"], "--space", row["space"], "--formula", row["formula"]]
    return found


def trials(program, arguments, seed, count):
    """Returns for each trial the simulations until a violation, or None without one."""
    command = [program, "falsify", *arguments, "--seed", str(seed), "--trials", str(count), "--budget", str(BUDGET)]
    command += ["-k", "falsify.isolate=false", "-k", "report.repeats=0", "--json"]
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(command)}: {done.stderr}")
    return [trial["first_violation"] for trial in json.loads(done.stdout)["trials"]]


def restricted_mean(counts):
    return sum(BUDGET if count is None else count for count in counts) / len(counts)


def run(before, after):
    record = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}

    def measured(name, kind, program, arguments, seed, count):
        known = record.setdefault(name, {})
        if kind not in known:
            known[kind] = trials(program, arguments, seed, count)
            RESULTS.write_text(json.dumps(record) + "\n")
            print(name, kind, restricted_mean(known[kind]), flush=True)
        return known[kind]

    for name, arguments in systems().items():
        measured(name, "pilot", before, arguments, *PILOT)
    for name, arguments in systems().items():
        if EASY < restricted_mean(record[name]["pilot"]) < BUDGET:
            measured(name, "before", before, arguments, *REPORT)
            measured(name, "after", after, arguments, *REPORT)


def holm(values):
    """Returns the p-values with Holm's correction."""
    order = sorted(range(len(values)), key=lambda index: values[index])
    corrected, largest = [0.0] * len(values), 0.0
    for rank, index in enumerate(order):
        largest = max(largest, min(1.0, (len(values) - rank) * values[index]))
        corrected[index] = largest
    return corrected


def table():
    import numpy as np
    from scipy.stats import wilcoxon

    rng = np.random.default_rng(0)
    record = json.loads(RESULTS.read_text())
    names = [name for name in record if "after" in record[name]]
    rows, worse, logs = [], [], []
    for name in names:
        before, after = (np.array([BUDGET if c is None else c for c in record[name][kind]], dtype=float) for kind in ("before", "after"))
        picks = rng.integers(0, len(before), (10_000, len(before)))
        ratios = after[picks].mean(1) / before[picks].mean(1)
        low, high = np.quantile(ratios, [0.025, 0.975])
        difference = after - before
        worse.append(wilcoxon(difference, alternative="greater").pvalue if difference.any() else 1.0)
        logs.append(np.log(ratios))
        found = [sum(c is not None for c in record[name][kind]) for kind in ("before", "after")]
        rows.append((name, found, before.mean(), after.mean(), after.mean() / before.mean(), low, high))
    print("| system | found: before, after | restricted mean: before, after | ratio | p that it is worse, Holm |")
    print("|---|--:|--:|--:|--:|")
    for (name, found, before, after, ratio, low, high), p in zip(rows, holm(worse), strict=True):
        print(f"| `{name}` | {found[0]}, {found[1]} | {before:.1f}, {after:.1f} | {ratio:.2f} [{low:.2f}, {high:.2f}] | {p:.2f} |")
    mean = np.exp(np.mean(logs, axis=0))
    point = np.exp(np.mean([np.log(row[4]) for row in rows]))
    low, high = np.quantile(mean, [0.025, 0.975])
    print(f"\ngeometric mean of the ratios of {len(rows)} systems: {point:.3f} [{low:.3f}, {high:.3f}]")
    easy = [n for n in record if restricted_mean(record[n]["pilot"]) <= EASY]
    none = [n for n in record if restricted_mean(record[n]["pilot"]) >= BUDGET]
    print(f"\nleft out: {len(easy)} found within {EASY:g} simulations, {len(none)} without a violation in the pilot")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=["run", "table"])
    parser.add_argument("--before", help="program of the former build")
    parser.add_argument("--after", help="program of the present build")
    arguments = parser.parse_args()
    if arguments.action == "table":
        table()
    elif arguments.before and arguments.after:
        run(arguments.before, arguments.after)
    else:
        parser.error("run needs --before and --after")


if __name__ == "__main__":
    main()
