"""Measures controllers under each kind of disturbance, and writes the tables of README.md.

    python studies/experiments/second/measure.py --episodes 300 ball-balancing/ppo-2 ball-balancing/expert
    python studies/experiments/second/measure.py --tables

Each argument is TASK/NAME of a shipped controller, or TASK/NAME=FILE. A condition that `figures/` already has with the same
controller, number of episodes and seed is not measured again: remove its file after a change of the task or the program.
`MISHANDLE` names the program (default: mishandle).
"""

import argparse
import hashlib
import json
import os
import pathlib
import shlex
import sqlite3
import subprocess
import tempfile

HERE = pathlib.Path(__file__).parent
ROOT = HERE.parents[2]
FIGURES = HERE / "figures"
BEGIN, END = "<!-- figures: second -->", "<!-- end of figures -->"
# Trial 2 has the corners.
FAILED = "SELECT number FROM simulations WHERE trial = 1 AND coalesce(success, -1) < 0 ORDER BY number"
TASKS = ["point-reaching", "ball-balancing", "ball-catching", "ball-pushing", "peg-in-hole", "door-opening", "cube-stacking", "cloth-placing"]
ALGORITHMS = ["ppo-2", "trpo-2", "sac-2", "td3-2", "ddpg-2"]
DELAYS = ["--axis", "action_delay=0:2", "--axis", "observation_delay=0:2"]
CONDITIONS = {
    "starts": [],
    "action noise 0.5": ["--action-noise", "0.5"],
    "observation noise 0.01": ["-k", "observation-noise=0.01"],
    "delay": ["--space", "starts+delay", *DELAYS],
    "sensing": ["--space", "starts+sensing"],
    "dynamics": ["--space", "starts+dynamics"],
    "drift": ["--space", "starts+drift"],
    "events": ["--space", "starts+events"],
    "faults-sensing": ["--space", "starts+faults-sensing"],
    "faults-actuation": ["--space", "starts+faults-actuation"],
    "delay+dynamics+sensing": ["--space", "starts+delay+dynamics+sensing", *DELAYS],
}
# Conditions whose goal counts only scenarios that the expert meets with the same seed.
OF_EXPERT = ["events", "faults-sensing", "faults-actuation", "delay+dynamics+sensing"]
# Largest share of failures, percent: of PPO, and of the other algorithms.
GOALS = {
    "action noise 0.5": (3, None),
    "observation noise 0.01": (2, 10),
    "delay": (2, 10),
    "sensing": (2, 10),
    "dynamics": (2, 10),
    "drift": (2, 10),
    "events": (10, None),
    "faults-sensing": (10, None),
    "faults-actuation": (10, None),
}


def evaluate(program, task, controller, condition, episodes, seed):
    """Returns the figures of a controller under a condition."""
    with tempfile.TemporaryDirectory() as folder:
        command = [*program, "evaluate", task, "--controller", controller, "--episodes", str(episodes), "--seed", str(seed), "-k", "evaluate.control=false"]
        command += CONDITIONS[condition] + ["--json"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode != 0:
            raise SystemExit(f"{shlex.join(command)}: {done.stderr}")
        result = json.loads(done.stdout)
        (run,) = pathlib.Path(folder, "runs").glob("*.sqlite")
        with sqlite3.connect(f"file:{run}?mode=ro", uri=True) as rows:
            failed = [number for (number,) in rows.execute(FAILED)]
        if len(failed) != round((1 - result["success_rate"]["value"]) * episodes):
            raise SystemExit(f"{shlex.join(command)}: the rows of the run do not agree with its rate")
    figures = {"episodes": episodes, "seed": seed, "failed": failed}
    for key in ["success_rate", "strict_success_rate", "careful_success_rate"]:
        rate = result.get(key)
        figures[key] = rate and [rate["value"], rate["low"], rate["high"]]
    corners = result.get("corners")
    if corners and condition == "starts":
        figures["corners"] = {key: corners[key] for key in ["n", "succeeding", "center_succeeds"]}
    return figures


def file_hash(path):
    return hashlib.sha256(pathlib.Path(path).read_bytes()).hexdigest()


def measure(program, spec, episodes, seed, conditions):
    """Measures a controller under the conditions that its figures lack."""
    name, _, file = spec.partition("=")
    task, controller = name.split("/")
    file = os.path.abspath(file) if file else ROOT / "controllers" / task / f"{controller}.safetensors"
    known = controller == "expert"
    digest = None if known else file_hash(file)
    path = FIGURES / task / f"{controller}.json"
    record = json.loads(path.read_text()) if path.exists() else {}
    if record.get("sha256", digest) != digest:
        record = {}
    record = {"sha256": digest, "conditions": record.get("conditions", {})}
    for condition in conditions:
        found = record["conditions"].get(condition, {})
        if (found.get("episodes"), found.get("seed")) == (episodes, seed):
            continue
        argument = controller if known else str(file)
        record["conditions"][condition] = evaluate(program, task, argument, condition, episodes, seed)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(record, indent=1) + "\n")
        print(task, controller, condition, record["conditions"][condition]["success_rate"], flush=True)


def figures(task, controller):
    path = FIGURES / task / f"{controller}.json"
    return json.loads(path.read_text())["conditions"] if path.exists() else {}


def percent(rate):
    return "-" if rate is None else f"{100 * rate[0]:.1f}"


def of_expert(name, condition, own, expert):
    """Returns the success rate in the scenarios that the expert meets, and their number, as text; bold below the goal."""
    if own is None or expert is None or own["seed"] != expert["seed"]:
        return "-"
    # More episodes of the same seed begin with those of fewer.
    common = min(own["episodes"], expert["episodes"])
    own_failed, expert_failed = ({number for number in found["failed"] if number <= common} for found in (own, expert))
    met = common - len(expert_failed)
    lost = len(own_failed - expert_failed)
    if met == 0:
        return "none"
    text = f"{100 * (met - lost) / met:.1f} of {met}"
    goal = GOALS.get(condition, (None, None))[name != "ppo-2"]
    return f"**{text}**" if goal is not None and 100 * lost > goal * met else text


def tables():
    """Returns the tables as Markdown."""
    others = [condition for condition in CONDITIONS if condition not in ["starts", *OF_EXPERT]]
    lines = ["| task | controller | starts: success, strict, careful | corners | " + " | ".join(others) + " |"]
    lines.append("|---|---|---|---|" + "--:|" * len(others))
    found = [(task, name, figures(task, name)) for name in [*ALGORITHMS, "ppo", "hardened", "expert"] for task in TASKS]
    for task, name, conditions in found:
        if "starts" not in conditions:
            continue
        starts = conditions.get("starts", {})
        rates = ", ".join(percent(starts.get(f"{kind}success_rate")) for kind in ["", "strict_", "careful_"])
        corners = starts.get("corners")
        corner = "-"
        if corners:
            center = "" if corners["center_succeeds"] else ", not the center"
            corner = f"{corners['succeeding']} of {corners['n']}{center}"
        cells = [marked(name, condition, conditions.get(condition)) for condition in others]
        lines.append(f"| `{task}` | `{name}` | {rates} | {corner} | " + " | ".join(cells) + " |")
    lines += ["", "| task | controller | " + " | ".join(f"{c} | {c}: of those the expert meets" for c in OF_EXPERT) + " |"]
    lines.append("|---|---|" + "--:|" * (2 * len(OF_EXPERT)))
    for task, name, conditions in found:
        if not conditions:
            continue
        expert = figures(task, "expert")
        cells = []
        for condition in OF_EXPERT:
            own = conditions.get(condition)
            cells += [percent(own and own["success_rate"]), of_expert(name, condition, own, expert.get(condition)) if name != "expert" else ""]
        lines.append(f"| `{task}` | `{name}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def marked(name, condition, found):
    """Returns a success rate, in bold if it misses the goal."""
    goal = GOALS.get(condition, (None, None))[name != "ppo-2"]
    text = percent(found and found["success_rate"])
    missed = found and goal is not None and name != "expert" and 100 * (1 - found["success_rate"][0]) > goal + 1e-9
    return f"**{text}**" if missed else text


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("controllers", nargs="*", metavar="TASK/NAME[=FILE]")
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=900)
    parser.add_argument("--conditions", nargs="+", default=list(CONDITIONS), choices=list(CONDITIONS))
    parser.add_argument("--tables", action="store_true", help="write the tables of README.md")
    arguments = parser.parse_args()
    program = shlex.split(os.environ.get("MISHANDLE", "mishandle"))
    for spec in arguments.controllers:
        measure(program, spec, arguments.episodes, arguments.seed, arguments.conditions)
    if arguments.tables:
        readme = HERE / "README.md"
        before, begin, rest = readme.read_text().partition(BEGIN)
        _, end, after = rest.partition(END)
        if not (begin and end):
            raise SystemExit(f"{readme} lacks {BEGIN} or {END}")
        readme.write_text(f"{before}{BEGIN}\n{tables()}\n{END}{after}")


if __name__ == "__main__":
    main()
