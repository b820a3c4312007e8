"""Trains with skrl and with Mishandle under the same settings, and compares the learning curves.

    python studies/experiments/skrl/curves.py run --tasks ball-balancing --algorithms ppo --seeds 1-3
    python studies/experiments/skrl/curves.py report

`run` trains every pair without a file in curves/: a CSV for each task, algorithm, side and seed, with the environment steps
and the mean return of the episodes that ended since the previous row. It needs requirements.txt, the Python module
(`pip install ./python`) and the program. `report` needs only NumPy. It writes curves/summary.json, bands.csv, and the table
of studies/notebook/2026-11-22-skrl.md; `cargo run -p mishandle-studies --example comparison_charts` draws the chart.

skrl's agents act in the task through the module. Both sides treat timeouts as terminations: skrl by itself, Mishandle by the
settings base `skrl-0.10`. Both sides read settings/ALGORITHM.toml.
"""

import argparse
import csv
import os
import pathlib
import subprocess
import sys
import tempfile
import tomllib

HERE = pathlib.Path(__file__).parent
ROOT = HERE.parents[2]
CURVES = HERE / "curves"
TASKS = ["point-reaching", "ball-balancing"]
ALGORITHMS = ["ppo", "trpo", "sac", "td3", "ddpg"]
SIDES = ["mishandle", "skrl"]
# Control steps per iteration of `mishandle train`: a rollout, or `steps_per_iteration`.
ITERATION_STEPS = {"ppo": 16, "trpo": 16, "sac": 64, "td3": 64, "ddpg": 64}


def settings_path(algorithm):
    return HERE / "settings" / f"{algorithm}.toml"


def curve_path(task, algorithm, side, seed):
    return CURVES / f"{task}-{algorithm}-{side}-s{seed}.csv"


def write(path, rows):
    """Writes all of a curve or nothing."""
    path.parent.mkdir(exist_ok=True)
    partial = path.with_suffix(".partial")
    with open(partial, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["environment_steps", "mean_return"])
        writer.writerows([steps, f"{mean:.4f}"] for steps, mean in rows)
    os.replace(partial, path)


def train_mishandle(program, task, algorithm, seed, steps):
    with tempfile.TemporaryDirectory() as folder:
        curve, out = pathlib.Path(folder) / "curve.csv", pathlib.Path(folder) / "controller.safetensors"
        command = [program, "train", task, "--algorithm", algorithm, "--settings", settings_path(algorithm)]
        command += ["--seed", str(seed), "--threads", "1", "--csv", curve, "--out", out]
        command += ["--steps", str(steps)] if steps else []
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        with open(curve, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    return [(int(row["environment_steps"]), float(row["mean_return"])) for row in rows if row["mean_return"]]


def train_skrl(task, algorithm, seed, steps):
    import torch

    import agents
    from environment import Environment

    settings = tomllib.loads(settings_path(algorithm).read_text())
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    env = Environment(task, settings, seed, 1, ITERATION_STEPS[algorithm])
    agents.train(algorithm, env, settings, steps or settings["run"]["total_steps"])
    return [(done, mean) for done, mean in env.points if mean is not None]


def run(arguments):
    first, last = arguments.seeds
    for seed in range(first, last + 1):
        for task in arguments.tasks:
            for algorithm in arguments.algorithms:
                for side in arguments.sides:
                    path = curve_path(task, algorithm, side, seed)
                    if path.exists():
                        continue
                    if side == "skrl":
                        rows = train_skrl(task, algorithm, seed, arguments.steps)
                    else:
                        rows = train_mishandle(arguments.program, task, algorithm, seed, arguments.steps)
                    write(path, rows)
                    print(f"{path.name}: {rows[-1][1]:.1f} at the end" if rows else f"{path.name}: no episode", flush=True)


def seeds(text):
    first, _, last = text.partition("-")
    return int(first), int(last or first)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    verb = verbs.add_parser("run", help="train what has no curve yet")
    verb.add_argument("--tasks", nargs="+", choices=TASKS, default=TASKS)
    verb.add_argument("--algorithms", nargs="+", choices=ALGORITHMS, default=ALGORITHMS)
    verb.add_argument("--sides", nargs="+", choices=SIDES, default=SIDES)
    verb.add_argument("--seeds", type=seeds, default=(1, 10), metavar="FIRST-LAST")
    verb.add_argument("--steps", type=int, help="environment steps, if others than the settings say")
    verb.add_argument("--program", default=str(ROOT / "target/release/mishandle"))
    verbs.add_parser("report", help="summary, picture and table of the curves there are")
    arguments = parser.parse_args()
    if arguments.verb == "run":
        run(arguments)
    else:
        import report

        report.write()


if __name__ == "__main__":
    sys.path.insert(0, str(HERE))
    main()
