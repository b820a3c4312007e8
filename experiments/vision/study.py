"""Measures what breaks policies that see, and writes the tables of README.md.

    python study.py --episodes 100                  rates in each space of sight, with a control arm
    python study.py --searches                      searches against random scenarios, at equal budget
    python study.py --tables

Each line is saved when it is measured, in figures/, and not measured again with the same file of the policy, seed and
numbers. `MISHANDLE` names the program (default: mishandle).
"""

import argparse
import hashlib
import json
import os
import pathlib
import shlex
import subprocess
import tempfile

HERE = pathlib.Path(__file__).parent
ROOT = HERE.parent.parent
FIGURES = HERE / "figures"
BEGIN, END = "<!-- figures: vision -->", "<!-- end of figures -->"
SPACES = ["light", "camera", "appearance", "clutter", "image", "faults-camera"]
TASKS = ["point-reaching", "ball-pushing", "peg-in-hole", "door-opening", "cube-stacking"]
# Name, task, file.
POLICIES = [(f"{task}/vision", task, ROOT / "controllers" / task / "vision.onnx") for task in TASKS]
POLICIES += [(path.stem, "cube-stacking", path) for path in sorted((HERE / "policies").glob("cube-stacking-*.onnx"))]
SEARCHES = ["random", "portfolio", "cma-es"]
# Spaces in which the policy succeeds too often for a few random scenarios to be enough.
SEARCHED = [("cube-stacking/vision", "camera"), ("cube-stacking/vision", "clutter"), ("cube-stacking-light", "light")]


def ask(program, *words):
    with tempfile.TemporaryDirectory() as folder:
        command = [*program, *map(str, words), "--json", "--out", f"{folder}/run.sqlite"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode not in (0, 1):
            raise SystemExit(f"{shlex.join(command)}: {done.stderr}")
        return json.loads(done.stdout)


def known(name):
    path = FIGURES / f"{name.replace('/', '-')}.json"
    return path, json.loads(path.read_text()) if path.exists() else {}


def save(path, record):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record, indent=1) + "\n")


def interval(rate):
    return [rate["value"], rate["low"], rate["high"]]


def rates(program, options):
    for name, task, file in POLICIES:
        if options.policies and name not in options.policies:
            continue
        path, record = known(name)
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
        if record.get("sha256", digest) != digest:
            record = {}
        record["sha256"] = digest
        for space in options.spaces:
            setting = {"episodes": options.episodes, "seed": options.seed}
            found = record.setdefault("rates", {}).get(space, {})
            if {key: found.get(key) for key in setting} == setting:
                continue
            result = ask(
                program, "evaluate", task, "--controller", file, "--space", f"starts+{space}",
                "--episodes", options.episodes, "--seed", options.seed,
            )
            control = result["control"]
            record["rates"][space] = setting | {
                "success": interval(result["success_rate"]),
                "control": interval(control["success_rate"]),
                "difference": interval(control["difference"]),
            }
            save(path, record)
            print(name, space, record["rates"][space], flush=True)


def searches(program, options):
    files = {name: (task, file) for name, task, file in POLICIES}
    for name, space in SEARCHED:
        task, file = files[name]
        path, record = known(name)
        for search in SEARCHES:
            setting = {"trials": options.trials, "budget": options.budget, "seed": options.seed}
            found = record.setdefault("searches", {}).setdefault(space, {}).get(search, {})
            if {key: found.get(key) for key in setting} == setting:
                continue
            result = ask(
                program, "falsify", task, "--controller", file, "--space", f"starts+{space}", "--search", search,
                "--trials", options.trials, "--budget", options.budget, "--seed", options.seed,
            )
            record["searches"][space][search] = setting | {
                key: result[key] for key in ["falsified_trials", "median_simulations", "restricted_mean_simulations"]
            }
            save(path, record)
            print(name, space, search, record["searches"][space][search], flush=True)


def percent(values, sign=""):
    value, low, high = (100 * value for value in values)
    return f"{value:{sign}.1f} [{low:{sign}.1f}, {high:{sign}.1f}]"


def tables():
    lines = ["| policy | space | n | success, % | control arm, % | difference, % |", "|---|---|--:|--:|--:|--:|"]
    for name, _, _ in POLICIES:
        for space, found in known(name)[1].get("rates", {}).items():
            cells = [percent(found["success"]), percent(found["control"]), percent(found["difference"], "+")]
            lines.append(f"| `{name}` | `{space}` | {found['episodes']} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--spaces", nargs="+", default=SPACES, choices=SPACES)
    parser.add_argument("--policies", nargs="+", metavar="NAME", choices=[name for name, _, _ in POLICIES])
    parser.add_argument("--searches", action="store_true", help="run the searches instead of the rates")
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--budget", type=int, default=60)
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--tables", action="store_true", help="write the tables of README.md")
    options = parser.parse_args()
    program = shlex.split(os.environ.get("MISHANDLE", "mishandle"))
    if options.tables:
        readme = HERE / "README.md"
        before, begin, rest = readme.read_text().partition(BEGIN)
        _, end, after = rest.partition(END)
        if not (begin and end):
            raise SystemExit(f"{readme} lacks {BEGIN} or {END}")
        readme.write_text(f"{before}{BEGIN}\n{tables()}\n{END}{after}")
    elif options.searches:
        searches(program, options)
    else:
        rates(program, options)


if __name__ == "__main__":
    main()
