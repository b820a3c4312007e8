"""Environment steps per second of PPO with learning included: Mishandle and skrl on point-reaching, one and two threads.

    python studies/experiments/skrl/speed.py --rounds 5 --out studies/experiments/skrl/speed.json

Both sides have the same physics (skrl's agent acts through the Python module), network, rollout, epochs and minibatches:
settings/speed.toml. Runs take turns, and the medians of the rounds are compared; speed is that between the first and the
last iteration, without start and end of the program. On a machine that does other things too, look at the steps per second of
processor time, which the record has beside it. `scaling` is Mishandle's own PPO under its shipped settings for the
task on one and on two threads. The record holds every single run, the machine and the versions.
"""

import argparse
import csv
import json
import os
import pathlib
import platform
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from importlib.metadata import version

from page import insert

HERE = pathlib.Path(__file__).parent
ROOT = HERE.parents[2]
TASK = "point-reaching"
SETTINGS = HERE / "settings/speed.toml"
SHIPPED = ROOT / "controllers/training" / TASK / "ppo.toml"
PROCESSOR = "steps_per_processor_second"
SHARES = ["physics", "inference", "learning"]


def program_run(program, settings, threads, steps):
    """A training by the program: environment steps per second, and where the time of an iteration went."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "settings.toml").write_text(settings, encoding="utf-8")
        command = [program, "train", TASK, "--algorithm", "ppo", "--settings", folder / "settings.toml", "--seed", "1"]
        command += ["--steps", str(steps), "--threads", str(threads)]
        command += ["--csv", folder / "curve.csv", "--out", folder / "controller.safetensors"]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        with open(folder / "curve.csv", newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    # The last iteration ends with a validation.
    first, last = rows[0], rows[-2]
    passed = lambda column: float(last[column]) - float(first[column])
    shares = {share: statistics.mean(float(row[f"{share}_share"]) for row in rows[1:-1]) for share in SHARES}
    processor_secs = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {
        "steps_per_second": passed("environment_steps") / passed("wall_clock_secs"),
        "steps_per_processor_second": float(rows[-1]["environment_steps"]) / processor_secs,
        "shares": shares,
    }


def mishandle(program, environments, threads, steps):
    settings = re.sub(r"(?m)^environments = .*", f"environments = {environments}", SETTINGS.read_text())
    return program_run(program, settings, threads, steps)


def scaling(program, threads, steps):
    """Under the shipped settings, without validations."""
    text = SHIPPED.read_text()
    return program_run(program, f"run.validation_interval = 1_000_000\nrun.validation_episodes = 1\n{text}", threads, steps)


def skrl(environments, threads, steps):
    """The same in a process of its own, since the threads of PyTorch are set once."""
    command = [sys.executable, "-W", "ignore", __file__, "--inside", str(environments), str(threads), str(steps)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def inside(environments, threads, steps):
    import torch

    import agents
    from environment import Environment

    settings = tomllib.loads(SETTINGS.read_text())
    settings["episodes"]["environments"] = environments
    torch.set_num_threads(threads)
    torch.manual_seed(1)

    class Timed(Environment):
        """Knows when each iteration began."""

        times = []

        def step(self, actions):
            if self.steps % self.iteration_steps == 0:
                self.times.append((time.perf_counter(), time.process_time()))
            return super().step(actions)

    env = Timed(TASK, settings, 1, threads, agents.ROLLOUT_STEPS)
    agents.train("ppo", env, settings, steps)
    done = (len(env.times) - 2) * agents.ROLLOUT_STEPS * environments
    wall, processor = (end - start for start, end in zip(env.times[1], env.times[-1]))
    print(json.dumps({"steps_per_second": done / wall, "steps_per_processor_second": done / processor}))


def rounds(arguments):
    """Every run of every round, by what was run."""
    ways = {}
    for environments in arguments.environments:
        for threads in [1, 2]:
            case = (environments, threads, arguments.steps)
            ways[f"mishandle/{environments}/{threads}"] = lambda case=case: mishandle(arguments.program, *case)
            ways[f"skrl/{environments}/{threads}"] = lambda case=case: skrl(*case)
    for threads in [1, 2]:
        steps = 4 * arguments.steps
        ways[f"scaling/{threads}"] = lambda threads=threads, steps=steps: scaling(arguments.program, threads, steps)
    runs = {name: [] for name in ways}
    for number in range(arguments.rounds):
        for name, way in ways.items():
            runs[name].append({**way(), "load_before": os.getloadavg()[0]})
            print(f"round {number + 1}, {name}: {runs[name][-1]['steps_per_second']:.0f}", file=sys.stderr, flush=True)
    return runs


def machine():
    cpus = re.findall(r"(?m)^model name\s*:\s*(.*)", pathlib.Path("/proc/cpuinfo").read_text())
    return {"processor": cpus[0] if cpus else platform.machine(), "cores": os.cpu_count(), "system": platform.platform()}


def record(arguments, runs):
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12"]
    commit = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True).stdout.strip()
    packages = ["torch", "skrl", "gymnasium", "numpy"]
    median = lambda name, of="steps_per_second": statistics.median(run[of] for run in runs[name])
    processor_ratio = lambda ours, theirs: median(ours, PROCESSOR) / median(theirs, PROCESSOR)
    shares = lambda name: {share: round(statistics.median(run["shares"][share] for run in runs[name]), 3) for share in SHARES}
    cases = [
        {
            "environments": environments,
            "threads": threads,
            "mishandle": round(median(ours := f"mishandle/{environments}/{threads}")),
            "skrl": round(median(theirs := f"skrl/{environments}/{threads}")),
            "ratio": round(median(ours) / median(theirs), 2),
            "processor_ratio": round(processor_ratio(ours, theirs), 2),
            "shares": shares(ours),
        }
        for environments in arguments.environments
        for threads in [1, 2]
    ]
    one, two = median("scaling/1"), median("scaling/2")
    return {
        "date": time.strftime("%Y-%m-%d"),
        "commit": commit,
        "program": os.path.relpath(arguments.program, ROOT),
        "machine": machine(),
        "versions": {"python": platform.python_version(), **{name: version(name) for name in packages}},
        "settings": SETTINGS.read_text(),
        "cases": cases,
        "scaling": {"one": round(one), "two": round(two), "ratio": round(two / one, 2), "shares": shares("scaling/1")},
        "runs": runs,
    }


def table(found):
    lines = [
        "| environments | threads | Mishandle, steps/s | skrl, steps/s | ratio | ratio by processor time | physics | inference | learning |",
        "|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    percent = lambda shares: [f"{100 * shares[share]:.0f} %" for share in SHARES]
    for case in found["cases"]:
        cells = [case["environments"], case["threads"], case["mishandle"], case["skrl"], case["ratio"], case["processor_ratio"]]
        lines.append("| " + " | ".join(map(str, [*cells, *percent(case["shares"])])) + " |")
    scaling = found["scaling"]
    lines.append("")
    lines.append(
        f"From one thread to two under the shipped settings: {scaling['one']} to {scaling['two']} steps/s, "
        f"{scaling['ratio']} times; on one thread {', '.join(map(' '.join, zip(SHARES, percent(scaling['shares']))))}."
    )
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=131_072, help="environment steps of a run")
    parser.add_argument("--environments", type=int, nargs="+", default=[16, 64, 512])
    parser.add_argument("--program", default=str(ROOT / "target/release/mishandle"))
    parser.add_argument("--out", type=pathlib.Path, help="where the record goes (JSON); studies/notebook/2026-11-22-skrl.md has its table then")
    parser.add_argument("--inside", type=int, nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.inside:
        return inside(*arguments.inside)
    found = record(arguments, rounds(arguments))
    if arguments.out:
        arguments.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        insert("speed", table(found))
    print(table(found))


if __name__ == "__main__":
    main()
