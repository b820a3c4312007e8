"""Trains with the paper's off-policy settings, with ours, and with settings between them, and writes the tables.

    python3 studies/experiments/off_policy/ladder.py run ball-balancing --seeds 1 --directions up --minutes 30
    python3 studies/experiments/off_policy/ladder.py table

Run it in the root of the repository, after `cargo build --release`. changes.toml lists the changes from paper/*.toml to the
settings base `best`. A direction is an order of changes: `up` adds one after the other, `without` makes all but one, `alone` makes a
single one and the first (the first saves time), and `long` makes none, or all except the updates, and trains four times as
long. Each training run is appended to records.jsonl.gz when it ends. A run in that file is not repeated, so an interrupted call
can be continued. `table` writes the tables of studies/notebook/2026-11-22-why-off-policy-failed.md and rates.csv;
`cargo run -p mishandle-studies --example comparison_charts` draws the chart.
"""

import argparse
import gzip
import csv
import json
import os
import pathlib
import resource
import subprocess
import tempfile
import time
import tomllib

HERE = pathlib.Path(__file__).parent
RECORDS = HERE / "records.jsonl.gz"
PAGE = HERE.parents[1] / "notebook/2026-11-22-why-off-policy-failed.md"
RATES = HERE / "rates.csv"
RATE_KEYS = ["success_rate", "strict_success_rate"]
ALGORITHMS = ["sac", "td3", "ddpg"]
DIRECTIONS = ["up", "without", "alone", "long"]
TOTAL_STEPS = {"ball-balancing": 196_608, "point-reaching": 327_680}
LONG = 4
CHANGES = tomllib.loads((HERE / "changes.toml").read_text())["change"]


def changes_for(algorithm):
    return [change for change in CHANGES if algorithm in change.get("only", ALGORITHMS)]


def ways(direction, algorithm):
    """Returns the names of the changes in each training run of a direction."""
    names = [change["name"] for change in changes_for(algorithm)]
    if direction == "long":
        return [[], [name for name in names if name != "updates"]]
    if direction == "up":
        return [names[:count] for count in range(len(names) + 1)]
    if direction == "alone":
        return [names[:1] + [name] * (name != names[0]) for name in names]
    return [[other for other in names if other != name] for name in names]


def overlay(own, other):
    for key, value in other.items():
        if isinstance(value, dict) and isinstance(own.get(key), dict):
            overlay(own[key], value)
        else:
            own[key] = value


def training(task, algorithm, direction, names):
    """Returns everything that defines a training run, except its seed."""
    settings = tomllib.loads((HERE / "paper" / f"{algorithm}.toml").read_text())
    reward = "original"
    for change in changes_for(algorithm):
        if change["name"] in names:
            overlay(settings, tomllib.loads(change.get("settings", "")))
            overlay(settings, tomllib.loads(change.get(algorithm, "")))
            reward = change.get("reward", reward)
            for key in change.get("drop", []):
                settings.pop(key, None)
    total_steps = TOTAL_STEPS[task] * (LONG if direction == "long" else 1)
    settings["run"]["total_steps"] = total_steps
    if "exploration_decay" in settings:
        settings["exploration_decay"]["steps"] = total_steps
    return {
        "task": task,
        "algorithm": algorithm,
        "changes": names,
        "reward": reward,
        "settings": as_toml(settings),
    }


def as_toml(settings, prefix=""):
    lines = []
    for key, value in settings.items():
        if isinstance(value, dict):
            lines += as_toml(value, f"{prefix}{key}.")
        else:
            lines.append(f"{prefix}{key} = {json.dumps(value)}")
    return lines


def train(program, definition, seed):
    record = {**definition, "seed": seed}
    task, algorithm, reward = record["task"], record["algorithm"], record["reward"]
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "settings.toml"
        file.write_text("\n".join(record["settings"]) + "\n")
        command = [program, "train", task, "--algorithm", algorithm, "--settings", str(file), "-k", f"train.reward={reward}"]
        command += ["--seed", str(seed), "--threads", "1", "--json", "--out", f"{folder}/policy.safetensors"]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, capture_output=True, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    record["cpu_secs"] = round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1)
    if done.returncode == 0:
        found = json.loads(done.stdout)
        for key in ["environment_steps", "success_rate", "strict_success_rate", "controller_hash"]:
            record[key] = found[key]
    elif "training broke down" in done.stderr:
        record["broke_down"] = done.stderr.strip()
    else:
        raise SystemExit(f"{' '.join(command)}: {done.stderr}")
    return record


def records():
    if not RECORDS.exists():
        return []
    return [json.loads(line) for line in gzip.open(RECORDS, "rt")]


def is_of(record, definition):
    return all(record[key] == value for key, value in definition.items())


def run(arguments):
    started = time.monotonic()
    for seed in arguments.seeds:
        for direction in arguments.directions:
            for algorithm in arguments.algorithms:
                chosen = ways(direction, algorithm)
                for names in [chosen[0], chosen[-1]] if arguments.ends else chosen:
                    if arguments.small and direction != "long" and names and "networks" not in names:
                        continue
                    definition = training(arguments.task, algorithm, direction, names)
                    if any(is_of(record, definition) and record["seed"] == seed for record in records()):
                        continue
                    if time.monotonic() - started > 60 * arguments.minutes:
                        return
                    record = train(arguments.program, definition, seed)
                    with gzip.open(RECORDS, "at") as file:
                        file.write(json.dumps(record) + "\n")
                    rates = record.get("success_rate"), record.get("strict_success_rate")
                    print(direction, algorithm, seed, *rates, names[-1:], flush=True)


def cell(found, task, algorithm, direction, names):
    """Returns success and strict success of all seeds, in percent, and the number of seeds if it is not one."""
    own = [record for record in found if is_of(record, training(task, algorithm, direction, names))]
    if not own:
        return "–"
    if all("broke_down" in record for record in own):
        return "broke down"
    rates = [[100.0 * record.get(key, 0.0) for record in own] for key in ["success_rate", "strict_success_rate"]]
    text = " / ".join(f"{sum(rate) / len(rate):.0f}" for rate in rates)
    return text if len(own) == 1 else f"{text} ({len(own)})"


def row(found, task, label, name):
    """Returns the row of the change `name`; None stands for no change."""
    cells = []
    for direction in ["up", "without", "alone"]:
        for algorithm in ALGORITHMS:
            names = [change["name"] for change in changes_for(algorithm)]
            if name is None:
                cells.append(cell(found, task, algorithm, "up", names if direction == "without" else []))
            elif name not in names:
                cells.append("")
            else:
                way = ways(direction, algorithm)[names.index(name) + (direction == "up")]
                cells.append(cell(found, task, algorithm, direction, way))
    return f"| {label} | " + " | ".join(cells) + " |"


def table(found, task):
    heads = [f"{algorithm.upper()} {direction}" for direction in ["up", "without", "alone"] for algorithm in ALGORITHMS]
    lines = ["| change | " + " | ".join(heads) + " |", "|---|" + "--:|" * len(heads)]
    lines.append(row(found, task, "none", None))
    lines += [row(found, task, change["name"], change["name"]) for change in CHANGES]
    return "\n".join(lines)


def small_table(found, task, head, rows):
    """Returns a table of some training runs: `rows` has their labels, directions and indices in the direction."""
    heads = [algorithm.upper() for algorithm in ALGORITHMS]
    lines = [f"| {head} | " + " | ".join(heads) + " |", "|---|" + "--:|" * len(heads)]
    for label, direction, index in rows:
        cells = [cell(found, task, algorithm, direction, ways(direction, algorithm)[index]) for algorithm in ALGORITHMS]
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def between(text, mark, inside):
    """Returns the text with `inside` between the comments of `mark`."""
    begin, end = f"<!-- {mark} -->\n", f"<!-- end of {mark} -->"
    before, rest = text.split(begin)
    return before + begin + inside + "\n" + end + rest.split(end)[1]


def write_rates(found, task):
    """Writes the rates of the direction `up` as a tidy CSV: a row for each algorithm and change, mean over the seeds."""
    with RATES.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["algorithm", "change", "success_rate", "strict_success_rate"])
        for label in ["paper", *(change["name"] for change in CHANGES)]:
            for algorithm in ALGORITHMS:
                names = ["paper", *(change["name"] for change in changes_for(algorithm))]
                if label not in names:
                    continue
                way = names[1 : names.index(label) + 1]
                own = [record for record in found if is_of(record, training(task, algorithm, "up", way))]
                rates = [sum(record.get(key, 0.0) for record in own) / max(len(own), 1) for key in RATE_KEYS]
                writer.writerow([algorithm, label, *rates])


def write_tables(_):
    found, text = records(), PAGE.read_text()
    write_rates(found, "ball-balancing")
    ends = [("the paper's settings", "up", 0), ("`best`", "up", -1)]
    longer = [("the paper's settings", "long", 0), ("all changes but updates", "long", 1)]
    text = between(text, "all", table(found, "ball-balancing"))
    text = between(text, "long", small_table(found, "ball-balancing", "four times as long", longer))
    text = between(text, "ends", small_table(found, "point-reaching", "point-reaching", ends))
    PAGE.write_text(between(text, "minutes", f"{sum(record['cpu_secs'] for record in found) / 60:.0f} minutes"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    runs = commands.add_parser("run")
    runs.set_defaults(what=run)
    runs.add_argument("task", choices=TOTAL_STEPS)
    runs.add_argument("--seeds", type=int, nargs="+", default=[1])
    runs.add_argument("--directions", nargs="+", choices=DIRECTIONS, default=["up"])
    runs.add_argument("--algorithms", nargs="+", choices=ALGORITHMS, default=ALGORITHMS)
    runs.add_argument("--ends", action="store_true", help="only the first and the last of each direction")
    runs.add_argument("--small", action="store_true", help="skip changes with large networks, which are slow")
    runs.add_argument("--minutes", type=float, default=45.0, help="start no training run after this time")
    runs.add_argument("--program", default="target/release/mishandle")
    commands.add_parser("table").set_defaults(what=write_tables)
    arguments = parser.parse_args()
    os.nice(15)
    arguments.what(arguments)


if __name__ == "__main__":
    main()
