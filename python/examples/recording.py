"""Prints the result of an example; with `--record`, also writes it to `results`."""

import datetime
import importlib.metadata
import json
import pathlib
import platform
import subprocess
import sys
import time

import mishandle

FOLDER = pathlib.Path(__file__).resolve().parent
POLICIES = FOLDER / "policies"
"""Folder of trained policies; `--train` trains them again."""
BUILD = FOLDER.parents[1] / "target/examples"
"""Folder of run files."""
PAGE = FOLDER.parents[1] / "docs/guide/examples.md"


def fresh(name):
    """Returns the path of a run file that does not exist yet."""
    BUILD.mkdir(parents=True, exist_ok=True)
    path = BUILD / f"{name}.sqlite"
    path.unlink(missing_ok=True)
    return path


def rounded(value):
    """Returns a value with four significant digits in each float."""
    if isinstance(value, float):
        return float(f"{value:.4g}")
    if isinstance(value, dict):
        return {key: rounded(inner) for key, inner in value.items()}
    return [rounded(inner) for inner in value] if isinstance(value, (list, tuple)) else value


def estimate(found):
    return (
        None if found is None or found.value is None
        else [found.value, found.low, found.high, found.n]
    )


def facts_of(found, evaluation, replay, seconds):
    """Returns the figures of a falsification, an evaluation and the replay of the first
    counterexample."""
    facts = {"seconds_falsification": seconds}
    if evaluation is not None:
        facts["success_rate"] = estimate(evaluation.success_rate)
        points = evaluation.corners.points if evaluation.corners is not None else ()
        facts["corners"] = [sum(c.successes for c in points), sum(c.n for c in points)]
    robustness = [
        trial.minimum_robustness for trial in found.trials if trial.minimum_robustness is not None
    ]
    facts |= {
        "trials": len(found.trials),
        "falsified_trials": found.falsified_trials,
        "mean_simulations": found.mean_simulations,
        "simulations": found.simulations,
        "smallest_robustness": min(robustness, default=None),
        "undecided": sum(trial.undecided for trial in found.trials),
        "failed": sum(trial.failed for trial in found.trials),
        "largest_difference": found.largest_difference,
    }
    if replay is not None:
        worst = found.counterexamples[0]
        facts["counterexample"] = worst.scenario
        facts["counterexample_robustness"] = worst.minimum_robustness
        facts["replay_differences"] = replay.differences
    return facts


def facts_of_task(task, name, policy):
    """Evaluates and falsifies a policy on one of our tasks with the task's formulas and initial
    box."""
    evaluation = mishandle.evaluate(
        task, policy=policy, episodes=1000, out=fresh(f"{name}_evaluation")
    )
    run, started = fresh(name), time.time()
    found = mishandle.falsify(
        task, policy=policy, trials=10, budget=300, plan={"falsify": {"batch": 16}}, out=run
    )
    seconds, replay = time.time() - started, None
    if found.counterexamples:
        worst = found.counterexamples[0]
        replay = mishandle.replay(
            run, task, policy=policy, trial=worst.trial, number=worst.simulation
        )
    strict = {"strict_success_rate": estimate(evaluation.strict_success_rate)}
    return {"task": task, **facts_of(found, evaluation, replay, seconds), **strict}


def versions_of(packages):
    found = {package: importlib.metadata.version(package) for package in packages}
    return {"python": platform.python_version(), "mishandle": mishandle.__version__, **found}


def save_training(name, seconds, steps, seed, mean_return, packages):
    """Writes how a policy was trained beside it."""
    facts = {
        "steps": steps,
        "seed": seed,
        "seconds": round(seconds),
        "mean_return": None if mean_return is None else float(mean_return),
        "date": datetime.date.today().isoformat(),
        "versions": versions_of(packages),
    }
    (POLICIES / f"{name}.json").write_text(json.dumps(rounded(facts), indent=2) + "\n")


def read_training(name):
    return json.loads((POLICIES / f"{name}.json").read_text())


def record(name, facts, packages):
    """Prints the facts; with `--record`, writes them to `results/NAME.json` together with date,
    versions and commit."""
    facts = rounded(facts)
    print(json.dumps(facts, indent=2, ensure_ascii=False))
    if "--record" not in sys.argv:
        return
    git = ["git", "-C", str(FOLDER)]
    commit = subprocess.run(
        [*git, "rev-parse", "--short=10", "HEAD"], capture_output=True, text=True, check=True
    ).stdout.strip()
    about = {
        "command": f"cargo xtask examples {name} --record",
        "date": datetime.date.today().isoformat(),
        "commit": commit,
        "versions": versions_of(packages),
    }
    path = FOLDER / "results" / f"{name}.json"
    path.write_text(json.dumps(facts | about, indent=2, ensure_ascii=False) + "\n")
    PAGE.write_text(with_table(PAGE.read_text()))


def with_table(page):
    """Returns the page with the table of all recorded falsifications between its two marks."""
    begin, end = "<!-- table of python/examples/results -->\n", "<!-- end of the table -->\n"
    head, _, rest = page.partition(begin)
    rows = [
        "| example | success rate in random scenarios (95 % interval) | falsified trials | mean "
        "simulations | smallest robustness | replay |",
        "|---|---|---|---|---|---|",
    ]
    for path in sorted((FOLDER / "results").glob("*.json")):
        facts = json.loads(path.read_text())
        if "trials" not in facts:
            continue
        success = "–"
        if "success_rate" in facts:
            rate, low, high, count = facts["success_rate"]
            success = f"{100 * rate:.1f} % ({100 * low:.1f} to {100 * high:.1f} %, n = {count})"
        replay = {None: "no counterexample", True: "same bits", False: "differs"}[
            None if "replay_differences" not in facts else not facts["replay_differences"]
        ]
        mean = facts["mean_simulations"]
        rows.append(
            f"| {path.stem} | {success} | {facts['falsified_trials']} of {facts['trials']} | "
            f"{'–' if mean is None else f'{mean:.1f}'} | {facts['smallest_robustness']:.3f} | "
            f"{replay} |"
        )
    return head + begin + "\n".join(rows) + "\n" + end + rest.partition(end)[2]
