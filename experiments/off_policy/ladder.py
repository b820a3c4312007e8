"""Trains with the paper's off-policy settings, with ours, and with what lies between, and makes the table of it.

    python3 experiments/off_policy/ladder.py run ball-balancing --seeds 1 --directions up --minutes 30
    python3 experiments/off_policy/ladder.py table

Run it in the root of the repository, after `cargo build --release`. changes.toml lists the changes from paper/*.toml to the
preset `best`. A direction is a way through them: `up` makes one after the other, `without` makes all but one, `alone` makes a
single one and the first, which is there to save time, and `long` makes none, or all but that of the updates, and trains for
four times as long. Each training is appended to records.jsonl when it is done; one that is there is not done again, so that a
run goes on where it was stopped. `table` makes the tables and the picture
of docs/why_off_policy_failed.md of those records.
"""

import argparse
import json
import os
import pathlib
import resource
import subprocess
import tempfile
import time
import tomllib

HERE = pathlib.Path(__file__).parent
RECORDS = HERE / "records.jsonl"
PAGE = HERE.parent.parent / "docs" / "why_off_policy_failed.md"
PICTURE = PAGE.with_suffix(".svg")
ALGORITHMS = ["sac", "td3", "ddpg"]
DIRECTIONS = ["up", "without", "alone", "long"]
TOTAL_STEPS = {"ball-balancing": 196_608, "point-reaching": 327_680}
LONG = 4
CHANGES = tomllib.loads((HERE / "changes.toml").read_text())["change"]


def changes_for(algorithm):
    return [change for change in CHANGES if algorithm in change.get("only", ALGORITHMS)]


def ways(direction, algorithm):
    """Which changes are made in each training of a direction, by their names."""
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
    """All that a training is made with, but for its seed."""
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


def train(program, made_with, seed):
    record = {**made_with, "seed": seed}
    task, algorithm, reward = record["task"], record["algorithm"], record["reward"]
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "settings.toml"
        file.write_text("\n".join(record["settings"]) + "\n")
        command = [program, "train", task, "--algorithm", algorithm, "--settings", str(file), "--reward", reward]
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
    return [json.loads(line) for line in RECORDS.read_text().splitlines()]


def is_of(record, made_with):
    return all(record[key] == value for key, value in made_with.items())


def run(arguments):
    started = time.monotonic()
    for seed in arguments.seeds:
        for direction in arguments.directions:
            for algorithm in arguments.algorithms:
                chosen = ways(direction, algorithm)
                for names in [chosen[0], chosen[-1]] if arguments.ends else chosen:
                    if arguments.small and direction != "long" and names and "networks" not in names:
                        continue
                    made_with = training(arguments.task, algorithm, direction, names)
                    if any(is_of(record, made_with) and record["seed"] == seed for record in records()):
                        continue
                    if time.monotonic() - started > 60 * arguments.minutes:
                        return
                    record = train(arguments.program, made_with, seed)
                    with RECORDS.open("a") as file:
                        file.write(json.dumps(record) + "\n")
                    rates = record.get("success_rate"), record.get("strict_success_rate")
                    print(direction, algorithm, seed, *rates, names[-1:], flush=True)


def cell(found, task, algorithm, direction, names):
    """Success and strict success of all seeds, in percent; how many seeds, if not one."""
    own = [record for record in found if is_of(record, training(task, algorithm, direction, names))]
    if not own:
        return "–"
    if all("broke_down" in record for record in own):
        return "broke down"
    rates = [[100.0 * record.get(key, 0.0) for record in own] for key in ["success_rate", "strict_success_rate"]]
    text = " / ".join(f"{sum(rate) / len(rate):.0f}" for rate in rates)
    return text if len(own) == 1 else f"{text} ({len(own)})"


def row(found, task, label, name):
    """A row of a table: the change `name`, or none at all."""
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
    """A table of some trainings: `rows` has their labels, directions and numbers in the direction."""
    heads = [algorithm.upper() for algorithm in ALGORITHMS]
    lines = [f"| {head} | " + " | ".join(heads) + " |", "|---|" + "--:|" * len(heads)]
    for label, direction, index in rows:
        cells = [cell(found, task, algorithm, direction, ways(direction, algorithm)[index]) for algorithm in ALGORITHMS]
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def between(text, mark, inside):
    """The text with `inside` between the comments of `mark`."""
    begin, end = f"<!-- {mark} -->\n", f"<!-- end of {mark} -->"
    before, rest = text.split(begin)
    return before + begin + inside + "\n" + end + rest.split(end)[1]


def picture(found, task):
    """Success on the way up, a row of bars for each algorithm, as SVG."""
    width, height, left, top = 46, 70, 60, 20
    shapes = []
    for row_index, algorithm in enumerate(ALGORITHMS):
        base = top + (row_index + 1) * (height + 16)
        shapes.append(f'<text x="4" y="{base - height / 2:.0f}">{algorithm.upper()}</text>')
        shapes.append(f'<path d="M{left} {base}h{width * (len(CHANGES) + 1)}" stroke="#888"/>')
        names = [change["name"] for change in changes_for(algorithm)]
        for column, name in enumerate([None] + [change["name"] for change in CHANGES]):
            if name is not None and name not in names:
                continue
            way = names[: names.index(name) + 1] if name else []
            own = [record for record in found if is_of(record, training(task, algorithm, "up", way))]
            x = left + column * width + 4
            for key, color in [("success_rate", "#9ecae1"), ("strict_success_rate", "#3182bd")]:
                share = sum(record.get(key, 0.0) for record in own) / max(len(own), 1)
                bar = height * share
                shapes.append(f'<rect x="{x}" y="{base - bar:.1f}" width="{width - 8}" height="{bar:.1f}" fill="{color}"/>')
    base = top + len(ALGORITHMS) * (height + 16)
    for column, name in enumerate(["paper"] + [change["name"] for change in CHANGES]):
        x = left + column * width + width / 2
        shapes.append(f'<text transform="translate({x:.0f} {base + 12}) rotate(40)">{name}</text>')
    size = f'width="{left + width * (len(CHANGES) + 1) + 60}" height="{base + 80}"'
    style = '<style>text { font: 12px sans-serif; fill: #555 }</style>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{style}\n' + "\n".join(shapes) + "\n</svg>\n"


def write_tables(_):
    found, text = records(), PAGE.read_text()
    PICTURE.write_text(picture(found, "ball-balancing"))
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
    runs.add_argument("--ends", action="store_true", help="the first and the last of each direction alone")
    runs.add_argument("--small", action="store_true", help="no change without that of the networks: the large ones are slow")
    runs.add_argument("--minutes", type=float, default=45.0, help="no training begins after these")
    runs.add_argument("--program", default="target/release/mishandle")
    commands.add_parser("table").set_defaults(what=write_tables)
    arguments = parser.parse_args()
    os.nice(15)
    arguments.what(arguments)


if __name__ == "__main__":
    main()
