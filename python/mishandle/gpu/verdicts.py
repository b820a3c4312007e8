"""Verdicts of MuJoCo Warp and MuJoCo C near the boundary between success and failure.

    python -m mishandle.gpu.verdicts [--simulations 1000] [--seed 7] [--jobs 1] [--move 1e-7]
    [--c-only | --gpu-only] [TASK ...]

Each task has a controller and an action noise with which a good part of the simulations fails, if
needed one per formula. Scenarios and seeds are the ones of ``mishandle risk -k
risk.method=monte-carlo`` with the same seed. It prints one row per task and formula:

- ``violated``: simulations that violate the formula in MuJoCo C.
- ``GPU: missed``: violated in MuJoCo C, satisfied on the GPU.
- ``GPU: refuted``: violated or without a verdict on the GPU, not violated in MuJoCo C.
- ``no verdict``: simulations without a verdict on the GPU, and how many of them had too little
  memory for contacts or constraints.
- ``moved: missed``: violated in MuJoCo C, but not if the start moves: each number of the scenario
  by 1e-7 m (``--move``) towards the middle of its range. Seed and noise stay the same.
- ``moved: refuted``: violated only if the start moves.

``moved`` says how many verdicts a change of the size of a 32-bit rounding error flips in MuJoCo C
alone. The last line has all rows as JSON. ``--c-only`` needs no GPU. ``--gpu-only`` leaves out
``moved``. ``--jobs`` is the number of cases at the same time.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.base.documents import Call, document
from mishandle.scenarios.axes import Axis

FORMULAS = ("success", "strict")

MOVE = 1e-7
"""Default move of each number of a scenario, m: about the precision of 32-bit numbers."""

COMMAND = "import sys; from mishandle.command import main; sys.exit(main())"


@dataclass(frozen=True)
class Case:
    """A task with a controller, the standard deviation of the action noise, and the formulas that a
    good part violates then."""

    task: str
    controller: str
    noise: float
    formulas: tuple[str, ...] = FORMULAS


CASES = [
    Case("point-reaching", "ppo", 1.0, ("success",)),
    Case("point-reaching", "ppo", 0.7, ("strict",)),
    Case("cube-stacking", "ppo", 1.4, ("success",)),
    Case("cube-stacking", "ppo", 0.6, ("strict",)),
    Case("peg-in-hole", "ppo", 0.8),
    Case("ball-balancing", "ppo", 1.1),
    Case("ball-catching", "trpo", 0.9, ("success",)),
    Case("ball-catching", "trpo", 0.5, ("strict",)),
    Case("ball-pushing", "ppo", 1.2),
    Case("door-opening", "trpo", 1.2),
    Case("cloth-placing", "ppo", 2.0, ("success",)),
    Case("cloth-placing", "ppo", 0.5, ("strict",)),
]


@dataclass(frozen=True)
class Sample:
    """Size and seed of the sample of a case, the number of threads that simulate it, and the move
    of the starts, m."""

    simulations: int
    seed: int
    threads: int
    move: float = MOVE


@dataclass
class Row:
    """Numbers of simulations of a task and formula. ``None``: not measured."""

    case: Case
    formula: str
    simulations: int
    violated: int
    gpu_missed: int | None = None
    gpu_refuted: int | None = None
    without_verdict: int | None = None
    overflows: int | None = None
    moved_missed: int | None = None
    moved_refuted: int | None = None

    def text(self) -> str:
        """Returns the row of the table."""
        undecided = (
            None if self.without_verdict is None else f"{self.without_verdict} ({self.overflows})"
        )
        counts = [
            self.violated, self.gpu_missed, self.gpu_refuted, undecided, self.moved_missed,
            self.moved_refuted
        ]
        cells = [
            self.case.task, f"{self.case.controller}, {self.case.noise:g}", self.formula,
            self.simulations, *counts
        ]
        return f"| {' | '.join('-' if cell is None else str(cell) for cell in cells)} |"


HEADER = (
    "| task | controller, noise | formula | n | violated | GPU: missed | refuted "
    "| no verdict (memory) | moved: missed | refuted |\n|---|---|---|--:|--:|--:|--:|--:|--:|--:|"
)


def axes_of(case: Case) -> list[Axis]:
    """Returns the axes of the starts of a case."""
    call = Call("simulate", {}).text(target=case.task, controller=case.controller, space="starts")
    return [Axis.from_document(axis) for axis in json.loads(_native.target(call).axes)]


def draws(axes: list[Axis], sample: Sample) -> list[tuple[list[float], int]]:
    """Returns scenario and seed of each simulation of ``mishandle risk`` on these axes."""
    drawn: list[tuple[list[float], int]] = []

    def simulate(batch: "list[_native.Request]") -> "list[_native.Outcome]":
        drawn.extend(
            ([float(scenario[axis.name]) for axis in axes], seed) for scenario, seed, _ in batch
        )
        return [("completed", 0, 0, np.zeros((2, 1)), 1, 0.0, "")] * len(batch)

    # A system that only keeps what it shall simulate.
    table = {
        "simulations": sample.simulations, "method": "monte-carlo", "batch": sample.simulations
    }
    system = {
        "name": "draws", "content": "", "axes": [axis.to_document() for axis in axes],
        "signals": [("zero", "1")], "formulas": [("success", "zero >= 0")], "control_dt": 1.0,
        "episode_steps": 1, "is_deterministic": True, "depends_on_seed": True,
        "termination": "undecided", "components": [], "not_covered": [], "versions": [],
        "random_axes": []
    }
    call = Call("risk", {"plan": {"risk": table}}, {"seed": sample.seed})
    target = _native.Target(call.text(), document(system), simulate=simulate)
    _native.ask(target, out=None, resume=False, progress=None, announce=None, earlier_probes=0)
    # Probes come before the question.
    return drawn[-sample.simulations :]


def moved(scenario: list[float], axes: list[Axis], move: float = MOVE) -> list[float]:
    """Returns a scenario whose numbers have moved towards the middle of their ranges."""
    middles = [(axis.low + axis.high) / 2 for axis in axes]
    return [
        value + move if value < middle else value - move for value, middle in zip(scenario, middles)
    ]


def command(*arguments: object) -> str:
    """Runs the command ``mishandle`` in another process and returns its output."""
    result = subprocess.run(
        [sys.executable, "-c", COMMAND, *map(str, arguments)], capture_output=True, text=True
    )
    if result.returncode not in (0, 1):
        raise RuntimeError(f"{' '.join(map(str, arguments))}: {result.stderr}")
    return result.stdout


def subject(case: Case) -> tuple[object, ...]:
    """Returns the arguments of commands that describe a case."""
    return (case.task, "--controller", case.controller, "--action-noise", case.noise)


def worker(case: Case, threads: int) -> _native.PlanWorker:
    """Returns the simulator of a case: MuJoCo C."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "run.sqlite"
        command("evaluate", *subject(case), "--episodes", 1, "--out", path)
        plan, hashes = _native.recorded_plan(str(path))
    return _native.PlanWorker(plan, hashes, threads)


def violations(
    simulator: _native.PlanWorker, scenarios: list[list[float]], seeds: list[int]
) -> dict[str, NDArray[np.bool_]]:
    """Returns which simulations violate each formula. Those without a verdict do not."""
    requests: list[_native.RequestTuple] = [
        (list(values), seed, False, None) for values, seed in zip(scenarios, seeds)
    ]
    # Verdict: robustness of the requirement, of success and of strict success.
    verdicts = [episode[4][1:3] for episode in simulator.rollout(requests)]
    found = np.array([
        [robustness is not None and np.signbit(robustness) for robustness in verdict]
        for verdict in verdicts
    ])
    return {formula: found[:, column] for column, formula in enumerate(FORMULAS)}


def in_c(case: Case, sample: Sample) -> list[Row]:
    """Measures the columns of MuJoCo C."""
    axes = axes_of(case)
    scenarios, seeds = map(list, zip(*draws(axes, sample)))
    simulator = worker(case, sample.threads)
    plain = violations(simulator, scenarios, seeds)
    shifted = violations(
        simulator, [moved(scenario, axes, sample.move) for scenario in scenarios], seeds
    )
    return [
        Row(
            case,
            formula,
            sample.simulations,
            int(plain[formula].sum()),
            moved_missed=int((plain[formula] & ~shifted[formula]).sum()),
            moved_refuted=int((shifted[formula] & ~plain[formula]).sum()),
        )
        for formula in case.formulas
    ]


def on_gpu(case: Case, sample: Sample) -> list[Row]:
    """Measures the columns of the GPU. MuJoCo C repeats every simulation."""
    return [_on_gpu(case, sample, formula) for formula in case.formulas]


def _on_gpu(case: Case, sample: Sample, formula: str) -> Row:
    method = (
        "--formula", formula, "-k", "risk.method=monte-carlo", "--simulations", sample.simulations,
        "--seed", sample.seed
    )
    screen = (
        "-k", "screening.device=gpu", "-k", f"screening.rows={sample.simulations}", "-k",
        "screening.confirm=1", "--threads",
        sample.threads
    )
    with tempfile.TemporaryDirectory() as folder:
        out = ("--out", f"{folder}/run.sqlite")
        found = json.loads(command("risk", *subject(case), *method, *screen, *out, "--json"))
    screening, failures = found["screening"], found["screening"]["findings"]["failure"]
    confirmed, missed = failures["flagged"], failures["audit_sample"]
    return Row(
        case, formula, sample.simulations, confirmed + missed, gpu_missed=missed,
        gpu_refuted=screening["flagged"] - confirmed, without_verdict=screening["without_verdict"],
        overflows=screening["overflows"]
    )


def both(case: Case, sample: Sample) -> list[Row]:
    """Measures all columns.

    Raises
    ------
    RuntimeError
        If the two ways to simulate in MuJoCo C differ: then the scenarios or seeds are not the
        same.
    """
    rows = on_gpu(case, sample)
    for row, c in zip(rows, in_c(case, sample)):
        if row.violated != c.violated:
            raise RuntimeError(
                f"{case.task}, {row.formula}: {row.violated} violations in `risk`, {c.violated} "
                "without it"
            )
        row.moved_missed, row.moved_refuted = c.moved_missed, c.moved_refuted
    return rows


def measured(
    cases: list[Case], sample: Sample, jobs: int, measure: Callable[[Case, Sample], list[Row]]
) -> Iterator[list[Row]]:
    """Measures several cases at the same time and returns their rows in the order of the cases."""
    with ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(lambda case: measure(case, sample), cases)


def main() -> None:
    """Prints a table, and the same rows as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tasks", nargs="*", metavar="TASK", help="default: all tasks")
    parser.add_argument(
        "--simulations", type=int, default=1000,
        help="number of simulations of each task, at least 100"
    )
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--jobs", type=int, default=1, help="number of cases at the same time")
    parser.add_argument("--move", type=float, default=MOVE, help="move of the starts, m, above 0")
    engines = parser.add_mutually_exclusive_group()
    engines.add_argument(
        "--c-only", action="store_true", help="measure the columns of MuJoCo C only"
    )
    engines.add_argument(
        "--gpu-only", action="store_true", help="measure the columns of the GPU only"
    )
    options = parser.parse_args()
    known = sorted({case.task for case in CASES})
    if unknown := sorted(set(options.tasks) - set(known)):
        parser.error(f"unknown task {unknown[0]}; expected one of {', '.join(known)}")
    if options.simulations < 100:
        parser.error("expected at least 100 simulations")
    if not 0 < options.move < 1:
        parser.error("expected a move above 0 and below 1 m")
    measure = in_c if options.c_only else on_gpu if options.gpu_only else both
    cases = [case for case in CASES if case.task in options.tasks or not options.tasks]
    threads = max(1, (os.cpu_count() or 1) // options.jobs)
    rows = []
    print(HEADER)
    for found in measured(
        cases, Sample(options.simulations, options.seed, threads, options.move), options.jobs,
        measure
    ):
        rows += found
        print("\n".join(row.text() for row in found), flush=True)
    print(json.dumps([asdict(row) for row in rows]))


if __name__ == "__main__":
    main()
