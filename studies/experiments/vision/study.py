"""Measures what breaks policies that see, and writes the tables of studies/notebook/2026-11-28-seeing.md.

    python study.py --episodes 100          rates in each space of sight, with a control arm
    python study.py --axes --spaces light --policies cube-stacking/vision --episodes 20
                                            rates with one axis of the spaces alone
    python study.py --tables

Each line is saved when it is measured, in figures/, and not measured again with the same file of the policy, seed and
number. `MISHANDLE` names the program (default: mishandle).
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
ROOT = HERE.parents[2]
FIGURES = HERE / "figures"
PAGE = ROOT / "studies/notebook" / "2026-11-28-seeing.md"
BEGIN, END = "<!-- figures: {} -->", "<!-- end of figures -->"
SPACES = ["light", "camera", "appearance", "clutter", "image", "faults-camera"]
TASKS = ["point-reaching", "ball-pushing", "peg-in-hole", "door-opening", "cube-stacking"]
# Name, task, file.
POLICIES = [(f"{task}/vision", task, ROOT / "controllers" / task / "vision.onnx") for task in TASKS]
POLICIES += [(path.stem, "cube-stacking", path) for path in sorted((HERE / "policies").glob("cube-stacking-*.onnx"))]


def ask(program, *words):
    with tempfile.TemporaryDirectory() as folder:
        command = [*program, *map(str, words), "--json"]
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


def policies(options):
    """The chosen ones: name, task, file, path of the figures, figures of this file."""
    for name, task, file in POLICIES:
        if options.policies and name not in options.policies:
            continue
        path, record = known(name)
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
        if record.get("sha256", digest) != digest:
            record = {}
        record["sha256"] = digest
        yield name, task, file, path, record


def rates(program, options):
    for name, task, file, path, record in policies(options):
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


def axes(program, options):
    """Each axis alone, over the whole of its range, from the starts of the rates."""
    for name, task, file, path, record in policies(options):
        of_starts = {axis["name"] for axis in facts(program, task, file, "starts")}
        for space in options.spaces:
            for axis in facts(program, task, file, f"starts+{space}"):
                setting = {"episodes": options.episodes, "seed": options.seed}
                found = record.setdefault("axes", {}).setdefault(space, {}).get(axis["name"], {})
                if axis["name"] in of_starts or {key: found.get(key) for key in setting} == setting:
                    continue
                try:
                    result = ask(
                        program, "evaluate", task, "--controller", file, "--space", "starts",
                        "--axis", f"{axis['name']}={axis['low']}:{axis['high']}", "-k", "evaluate.control=false",
                        "--episodes", options.episodes, "--seed", options.seed,
                    )
                except SystemExit as error:
                    # Such as the place of a second lamp of strength 0.
                    if "has no effect" not in str(error):
                        raise
                    continue
                record["axes"][space][axis["name"]] = setting | {"success": interval(result["success_rate"])}
                save(path, record)
                print(name, axis["name"], record["axes"][space][axis["name"]]["success"], flush=True)


def facts(program, task, file, space):
    return ask(program, "simulate", task, "--controller", file, "--space", space)["space_axes"]


def percent(values, sign=""):
    value, low, high = (100 * value for value in values)
    return f"{value:{sign}.1f} [{low:{sign}.1f}, {high:{sign}.1f}]"


def rate_table():
    lines = ["| policy | space | n | success, % | control arm, % | difference, % |", "|---|---|--:|--:|--:|--:|"]
    for name, _, _ in POLICIES:
        measured = known(name)[1].get("rates", {})
        for space in filter(measured.get, SPACES):
            found = measured[space]
            cells = [percent(found["success"]), percent(found["control"]), percent(found["difference"], "+")]
            lines.append(f"| `{name}` | `{space}` | {found['episodes']} | " + " | ".join(cells) + " |")
    return lines


def axis_table():
    """The axes with a failure, the worst first."""
    lines = ["| policy | space | n | success with one axis alone, % | axes without a failure |", "|---|---|--:|---|--:|"]
    for name, _, _ in POLICIES:
        for space, measured in known(name)[1].get("axes", {}).items():
            worst = sorted(measured.items(), key=lambda item: item[1]["success"][0])
            broken = [f"`{axis}` {100 * found['success'][0]:.0f}" for axis, found in worst if found["success"][0] < 1]
            count = len(measured) - len(broken)
            episodes = {found["episodes"] for found in measured.values()}
            numbers = ", ".join(map(str, sorted(episodes)))
            lines.append(f"| `{name}` | `{space}` | {numbers} | {', '.join(broken) or '-'} | {count} of {len(measured)} |")
    return lines


def write(name, lines):
    text = PAGE.read_text()
    before, begin, rest = text.partition(BEGIN.format(name))
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise SystemExit(f"{PAGE} lacks {BEGIN.format(name)} or {END}")
    PAGE.write_text("\n".join([before + begin, *lines, end + after]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--spaces", nargs="+", default=SPACES, choices=SPACES)
    parser.add_argument("--policies", nargs="+", metavar="NAME", choices=[name for name, _, _ in POLICIES])
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--axes", action="store_true", help="measure each axis alone instead of the spaces")
    parser.add_argument("--tables", action="store_true", help="write the tables of the page, and measure nothing")
    options = parser.parse_args()
    program = shlex.split(os.environ.get("MISHANDLE", "mishandle"))
    if options.tables:
        write("spaces", rate_table())
        write("axes", axis_table())
    elif options.axes:
        axes(program, options)
    else:
        rates(program, options)


if __name__ == "__main__":
    main()
