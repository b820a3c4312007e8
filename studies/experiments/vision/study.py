"""Measures the policies that see under each factor at each severity, and writes the table of
studies/notebook/2026-11-29-factors.md.

    python study.py                 every factor and severity, and the nominal images
    python study.py --factors light --policies cube-stacking --jobs 8 --threads 4
    python study.py --table

Each line is saved when it is measured, in the folder of figures, and not measured again with the same file of the
policy, seed and number. `MISHANDLE` names the program (default: mishandle).
"""

import argparse
import concurrent.futures
import hashlib
import json
import os
import pathlib
import shlex
import subprocess
import tempfile
import threading

HERE = pathlib.Path(__file__).parent
ROOT = HERE.parents[2]
PAGE = ROOT / "studies/notebook" / "2026-11-29-factors.md"
BEGIN, END = "<!-- figures -->", "<!-- end of figures -->"
FACTORS = ["camera", "light", "background", "object", "distractors", "occlusion", "image", "posture"]
SEVERITIES = [1, 2, 3, 4, 5]
NOMINAL = "starts"
TASKS = ["point-reaching", "ball-pushing", "peg-in-hole", "door-opening", "cube-stacking"]


def ask(program, *words):
    with tempfile.TemporaryDirectory() as folder:
        command = [*program, *map(str, words), "--json"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode not in (0, 1):
            raise SystemExit(f"{shlex.join(command)}: {done.stderr}")
        return json.loads(done.stdout)


class Figures:
    """The figures of a policy, in a file."""

    def __init__(self, folder, task, controllers):
        self.task, self.controller = task, controllers / task / "vision.onnx"
        self.path = folder / f"factors-{task}.json"
        self.lock = threading.Lock()
        found = json.loads(self.path.read_text()) if self.path.exists() else {}
        digest = hashlib.sha256(self.controller.read_bytes()).hexdigest()
        self.record = found if found.get("sha256") == digest else {"sha256": digest}

    def measure(self, program, space, setting):
        found = self.record.get(space, {})
        if {key: found.get(key) for key in setting} == setting:
            return
        words = [word for key, value in setting.items() for word in (f"--{key}", value)]
        threads = ["--threads", options.threads] if options.threads else []
        result = ask(
            program, "evaluate", self.task, "--controller", self.controller, "--space", space, *words, *threads,
            "-k", "evaluate.control=false", "-k", "evaluate.corners=false",
        )
        rate = result["success_rate"]
        with self.lock:
            self.record[space] = setting | {"success": [rate["value"], rate["low"], rate["high"]]}
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.write_text(json.dumps(self.record, indent=1) + "\n")
            print(self.task, space, self.record[space]["success"], flush=True)


def spaces():
    factors = [f"{NOMINAL}+{factor}-{severity}" for factor in options.factors for severity in options.severities]
    return [NOMINAL, *factors]


def table(figures):
    heads = [f"severity {severity}" for severity in SEVERITIES]
    lines = [f"| policy | factor | {' | '.join(heads)} |", "|---|---|" + "--:|" * len(SEVERITIES)]
    percent = lambda found: "{:.0f} [{:.0f}, {:.0f}]".format(*(100 * value for value in found["success"]))
    for own in figures:
        if NOMINAL in own.record:
            cells = [percent(own.record[NOMINAL])] + [""] * (len(SEVERITIES) - 1)
            lines.append(f"| `{own.task}` | none (n = {own.record[NOMINAL]['episodes']}) | {' | '.join(cells)} |")
        for factor in FACTORS:
            found = [own.record.get(f"{NOMINAL}+{factor}-{severity}") for severity in SEVERITIES]
            if any(found):
                lines.append(f"| | `{factor}` | {' | '.join(percent(each) if each else '' for each in found)} |")
    return lines


def write(lines):
    text = PAGE.read_text()
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise SystemExit(f"{PAGE} lacks {BEGIN} or {END}")
    PAGE.write_text("\n".join([before + begin, *lines, end + after]))


def main():
    program = shlex.split(os.environ.get("MISHANDLE", "mishandle"))
    figures = [Figures(options.figures, task, options.controllers.resolve()) for task in options.policies]
    if options.table:
        write(table(figures))
        return
    setting = {"episodes": options.episodes, "seed": options.seed}
    jobs = [(own, space) for space in spaces() for own in figures]
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        done = [pool.submit(own.measure, program, space, setting) for own, space in jobs]
        for each in done:
            each.result()


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--episodes", type=int, default=100)
parser.add_argument("--factors", nargs="+", default=FACTORS, choices=FACTORS)
parser.add_argument("--severities", nargs="+", type=int, default=SEVERITIES, choices=SEVERITIES)
parser.add_argument("--policies", nargs="+", default=TASKS, choices=TASKS)
parser.add_argument("--controllers", type=pathlib.Path, default=ROOT / "controllers", help="folder with TASK/vision.onnx")
parser.add_argument("--figures", type=pathlib.Path, default=HERE / "figures")
parser.add_argument("--seed", type=int, default=77)
parser.add_argument("--jobs", type=int, default=1, help="measurements at a time")
parser.add_argument("--threads", type=int, help="threads of each")
parser.add_argument("--table", action="store_true", help="write the table of the page, and measure nothing")
options = parser.parse_args()

if __name__ == "__main__":
    main()
