"""Time per sample of online monitors through Python: Mishandle, RTAMT, mstlo and SENTIL, in one
run, with their values compared.

    pip install rtamt==0.4.10 mstlo-python==0.2.2 sentil==0.3.1
    python python/benches/online.py [--rounds 5] [--samples 20000]

Each monitor gets the same samples, one call per sample (mstlo: one per signal), and its answer is
read after each sample. The monitors take turns in each round. The table has medians and ranges of
the CPU time over the rounds, because other programs may share the machine. RTAMT gets the first
tenth of the samples. A peer that is not installed, fails, or has other values is reported as such.

A value is the robustness at a sample that the last sample decided; Mishandle, SENTIL and mstlo with
RoSI also give bounds at each sample. The values must be equal at all decided samples.
"""

import argparse
import logging
import platform
import statistics
import time

import mishandle
import numpy as np

FORMULAS = ["always[50:300](d <= 0.12)", "eventually[0:300](a <= 0.024 and b > 0)"]
HORIZON = 300


def push_each(text, names, rows, has_bounds):
    """Pushes each sample, asks for the bounds or not, and keeps the decided values."""
    monitor = mishandle.OnlineMonitor(text, names)
    values = []
    yield
    for row in rows:
        monitor.push(row)
        if has_bounds:
            monitor.bounds()
        decided = monitor.decided()
        if decided is not None:
            values.append(decided[1])
    yield values


def by_mishandle_decided(text, names, rows):
    """Mishandle, decided values"""
    return push_each(text, names, rows, has_bounds=False)


def by_mishandle_bounds(text, names, rows):
    """Mishandle, decided values and bounds at time 0"""
    return push_each(text, names, rows, has_bounds=True)


def by_mishandle_rows(text, names, rows):
    """Mishandle, `push_many`, last value alone"""
    monitor = mishandle.OnlineMonitor(text, names)
    array = np.array(rows)
    yield
    monitor.push_many(array)
    yield [monitor.decided()[1]]


def by_rtamt(text, names, rows):
    """RTAMT `StlDiscreteTimeOnlineSpecification`, `pastify`"""
    import rtamt

    logging.disable(logging.WARNING)
    monitor = rtamt.StlDiscreteTimeOnlineSpecification()
    for name in names:
        monitor.declare_var(name, "float")
    monitor.spec = text
    monitor.parse()
    monitor.pastify()
    values = []
    yield
    for sample, row in enumerate(rows):
        values.append(monitor.update(sample, list(zip(names, row))))
    yield values[HORIZON:]


def by_sentil(text, names, rows):
    """SENTIL `OnlineMonitor.update`, decided values and bounds"""
    import sentil

    monitor = sentil.OnlineMonitor(text.replace(":", ","))
    values = []
    yield
    for sample, row in enumerate(rows):
        answer = monitor.update(float(sample), dict(zip(names, row)))
        if answer.resolved:
            values.append(answer.value)
    yield values


def mstlo_monitor(text, semantics):
    import mstlo_python

    formula = text.replace("always", "G").replace("eventually", "F").replace(":", ",").replace(
        " and ", " && "
    )
    return mstlo_python.Monitor(mstlo_python.parse_formula(formula), semantics=semantics)


def by_mstlo(text, names, rows):
    """mstlo `DelayedQuantitative`, decided values"""
    monitor = mstlo_monitor(text, "DelayedQuantitative")
    values = []
    yield
    for sample, row in enumerate(rows):
        for name, value in zip(names, row):
            values.extend(
                robustness
                for _, robustness in monitor.update(name, value, float(sample)).verdicts()
            )
    yield values


def by_mstlo_bounds(text, names, rows):
    """mstlo `Rosi`, decided values and bounds at every waiting sample"""
    monitor = mstlo_monitor(text, "Rosi")
    values = []
    yield
    for sample, row in enumerate(rows):
        for name, value in zip(names, row):
            found = monitor.update(name, value, float(sample)).verdicts()
            if found and found[0][1][0] == found[0][1][1]:
                values.append(found[0][1][0])
    yield values


# The share of the samples that a monitor gets.
MONITORS = {
    by_mishandle_decided: 1.0,
    by_mishandle_bounds: 1.0,
    by_mishandle_rows: 1.0,
    by_sentil: 1.0,
    by_mstlo: 1.0,
    by_mstlo_bounds: 0.1,
    by_rtamt: 0.1,
}


def measure(monitor, text, names, rows):
    """Returns the CPU time per sample in microseconds, and the values."""
    steps = monitor(text, names, rows)
    next(steps)
    started = time.process_time()
    values = next(steps)
    return (time.process_time() - started) / len(rows) * 1e6, values


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--samples", type=int, default=20000)
    arguments = parser.parse_args()
    print(
        f"{platform.machine()}, Python {platform.python_version()}, {arguments.samples} samples, "
        f"{arguments.rounds} rounds"
    )
    for text in FORMULAS:
        names = mishandle.Formula(text).signals
        rows = [
            tuple(row)
            for row in np.random.default_rng(1).normal(
                size=(arguments.samples, len(names))
            ).tolist()
        ]
        expected = mishandle.Formula(text).robustness_signal(
            dict(zip(names, np.array(rows).T)), decided_only=True
        )
        times, notes = {monitor: [] for monitor in MONITORS}, {}
        for _ in range(arguments.rounds):
            for monitor, share in MONITORS.items():
                if monitor in notes:
                    continue
                count = int(len(rows) * share)
                try:
                    spent, values = measure(monitor, text, names, rows[:count])
                except Exception as error:  # A peer may fail in any way: the table says how.
                    notes[monitor] = f"failed: {type(error).__name__}: {error}"
                    continue
                times[monitor].append(spent)
                required = expected[: count - HORIZON][
                    -len(values) if monitor is by_mishandle_rows else 0 :
                ]
                if not np.array_equal(values, required):
                    equal = (
                        np.count_nonzero(np.asarray(values) == required)
                        if len(values) == len(required) else 0
                    )
                    notes[monitor] = (
                        f"other values: {len(values)} values, {len(required)} expected, {equal} "
                        "equal"
                    )
        print(f"\n`{text}`\n\n| monitor | µs per sample | values |\n|---|---|---|")
        for monitor, spent in times.items():
            figures = (
                f"{statistics.median(spent):.2f} ({min(spent):.2f} to {max(spent):.2f})" if spent
                else "-"
            )
            print(f"| {monitor.__doc__} | {figures} | {notes.get(monitor, 'equal')} |")


if __name__ == "__main__":
    main()
