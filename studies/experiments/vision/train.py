"""Trains a policy that sees: behavior cloning of a task's expert, then DAgger, as an ONNX controller.

Round 0 records the expert with images. Each later round records the student, with the expert's actions as the
labels of each state, and trains on all that was recorded. The student gets joint positions and velocities and
the images; while it trains, an auxiliary head learns the rest of the observation from the images.

    python train.py ball-pushing --out policies/ball-pushing --rounds 30 --minutes 25
    python train.py ball-pushing --out policies/ball-pushing-dr --randomize background-3+light-3+camera-3

Needs torch, numpy and onnx. The folder has round-N.onnx, the student of each round; policy.onnx, the best of them;
log.jsonl, a line for each round; and evaluation.sqlite, the run of the last evaluation. Five disjoint ranges of
seeds: 1,000 for the expert, 2,000 for rounds, 8,000,000 for the choice, 9,000,000 for the last evaluation.
"""

import argparse
import json
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import torch
from students import PROPRIOCEPTION_SIZE, export, load, make
from torch import nn


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task")
    parser.add_argument("--out", type=Path, required=True, help="new folder of the policy and its log")
    parser.add_argument("--mishandle", default="mishandle", help="the program")
    parser.add_argument("--cameras", default="over,wrist", help="cameras of the policy, joined by commas")
    parser.add_argument("--size", type=int, default=64, help="width and height of the images, pixels")
    parser.add_argument("--randomize", metavar="SPACE", help="record half of the episodes in this space, such as light-3+camera-3")
    parser.add_argument("--start", type=Path, help="begin with the weights of this policy.onnx")
    parser.add_argument("--chunk", type=int, default=1, help="actions that the policy predicts, by attention if more than 1")
    parser.add_argument("--decay", type=float, default=0.01, help="decay of the weights in the ensemble of chunks")
    parser.add_argument("--rounds", type=int, default=8, help="rounds of DAgger after the first one")
    parser.add_argument("--episodes", type=int, default=200, help="episodes of the expert")
    parser.add_argument("--student-episodes", type=int, default=100, help="episodes of the student in each round")
    parser.add_argument("--every", type=int, default=2, help="keep one of this number of frames")
    parser.add_argument("--epochs", type=float, default=8.0, help="passes over the data in each round")
    parser.add_argument("--most-steps", type=int, default=2000, help="training steps of a round at most")
    parser.add_argument("--batch", type=int, default=512)
    parser.add_argument("--learning-rate", type=float, default=1e-3, help="of the first round; it falls to a fifth")
    parser.add_argument("--channels", type=int, default=32)
    parser.add_argument("--hidden", type=int, default=256)
    parser.add_argument("--auxiliary", type=float, default=1.0, help="weight of the auxiliary loss")
    parser.add_argument("--minutes", type=float, default=30.0, help="time limit")
    parser.add_argument("--threads", type=int, help="threads of the program")
    parser.add_argument("--choose", type=int, default=100, help="episodes by which each of the three best rounds is compared")
    parser.add_argument("--evaluate", type=int, default=500, help="episodes of the last evaluation; 0 for none")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    return parser.parse_args()


def program(options, *words, seed):
    threads = ["--threads", str(options.threads)] if options.threads else []
    command = [options.mishandle, *map(str, words), "--seed", str(seed), *threads, "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")
    return json.loads(done.stdout)


def spaces(options):
    """Returns the spaces whose episodes a round records, in equal numbers."""
    return ["starts"] + ([f"starts+{options.randomize}"] if options.randomize else [])


def chunks(actions, starts, every, chunk):
    """Returns the rows of the kept frames, and the actions of the `chunk` steps from each on; the last one repeats."""
    rows = np.concatenate([np.arange(start, end, every) for start, end in zip(starts, starts[1:])])
    last = np.concatenate([np.full(end - start, end - 1) for start, end in zip(starts, starts[1:])])[rows]
    ahead = np.minimum(rows[:, None] + np.arange(chunk), last[:, None])
    return rows, actions[ahead]


class Data:
    """All kept frames so far, on the device: proprioception, the rest of the observation, actions and images."""

    def __init__(self, options):
        self.options = options
        self.parts = []

    def record(self, controller, episodes, seed, *more):
        """Records in random starts, and half of the episodes in the randomized space. Returns the two success rates."""
        found = spaces(self.options)
        return [self.record_in(space, controller, episodes // len(found), seed, *more) for space in found]

    def record_in(self, space, controller, episodes, seed, *more):
        options, folder = self.options, self.options.out / "record"
        shutil.rmtree(folder, ignore_errors=True)
        found = program(
            options, "record", options.task, "--controller", controller, "--episodes", episodes,
            "--space", space, "--camera", options.cameras, "--size", f"{options.size}x{options.size}",
            "-k", "record.format=npz", "--out", folder, *more, seed=seed,
        )
        with np.load(folder / "data.npz") as data:
            rows, actions = chunks(data["action"], data["episode_starts"], options.every, options.chunk)
            arrays = [data["observation.state"][rows], actions]
            arrays += [data[f"observation.images.{camera}"][rows] for camera in options.cameras.split(",")]
        shutil.rmtree(folder)
        self.parts.append([torch.from_numpy(array).to(options.device) for array in arrays])
        return round(found["successes"] / found["simulations"], 4)

    def merge(self):
        self.parts = [[torch.cat(arrays) for arrays in zip(*self.parts)]]
        return self.parts[0]


def train(student, data, statistics, options, progress, end):
    """Trains on all frames, until the steps or the time are over. Returns the steps and the last mean losses."""
    states, actions, *images = data.merge()
    frames = len(states)
    steps = max(1, int(min(options.most_steps, options.epochs * frames / options.batch)))
    rate = options.learning_rate * (1 - 0.8 * min(1.0, progress))
    optimizer = torch.optim.AdamW(student.parameters(), lr=rate, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, rate, total_steps=steps + 1, pct_start=0.1)
    student.train()
    sums = torch.zeros(2, device=options.device)
    for step in range(steps):
        rows = torch.randint(frames, (options.batch,), device=options.device)
        target = ((states[rows] - statistics[0]) / statistics[1])[:, PROPRIOCEPTION_SIZE:]
        action, state = student.all(states[rows][:, :PROPRIOCEPTION_SIZE], *(image[rows] for image in images))
        # The task clips actions, so a saturated one has no error beyond the limit.
        error = nn.functional.smooth_l1_loss(action.clamp(-1.2, 1.2), actions[rows], beta=0.1)
        beyond = (action.abs() - 1.2).clamp(min=0).square().mean()
        estimate = nn.functional.smooth_l1_loss(state, target)
        optimizer.zero_grad(set_to_none=True)
        (error + beyond + options.auxiliary * estimate).backward()
        nn.utils.clip_grad_norm_(student.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        sums = 0.98 * sums + 0.02 * torch.stack([error.detach(), estimate.detach()])
        if step % 50 == 0 and time.time() > end:
            break
    return step + 1, [round(value, 5) for value in sums.tolist()]


def choose(options, rates, note):
    """Returns the best of the three rounds with the highest rates, by seeds of their own."""
    found = {}
    for number in sorted(rates, key=lambda number: (rates[number], number))[-3:]:
        answers = [
            program(
                options, "record", options.task, "--controller", options.out / f"round-{number}.onnx", "--space", space,
                "--episodes", options.choose, "-k", "record.format=npz", "--out", options.out / f"choice-{number}-{space}",
                seed=8_000_000 + options.seed,
            )
            for space in spaces(options)
        ]
        found[number] = [round(answer["successes"] / answer["simulations"], 4) for answer in answers]
        note(choice=number, success=found[number])
    return max(found, key=lambda number: (sum(found[number]), number))


def main():
    options = arguments()
    torch.manual_seed(options.seed)
    # TF32 keeps a tenth of a pixel in the spatial softmax, bfloat16 would not.
    torch.set_float32_matmul_precision("high")
    begin = time.time()
    end = begin + 60 * options.minutes
    options.out.mkdir(parents=True)
    log = open(options.out / "log.jsonl", "w")

    def note(**facts):
        line = json.dumps({"minutes": round((time.time() - begin) / 60, 2), **facts})
        print(line, flush=True)
        print(line, file=log, flush=True)

    data = Data(options)
    rates = data.record("expert", options.episodes, 1000 + options.seed)
    states = data.merge()[0]
    note(round=0, expert=rates, frames=len(states))
    scale = states.std(0)
    # What never changes is not magnified.
    statistics = (states.mean(0), torch.where(scale > 1e-3, scale, torch.ones_like(scale)))
    student = make(options, states.shape[1] - PROPRIOCEPTION_SIZE, statistics).to(options.device)
    if options.start:
        load(student, options.start)
    note(parameters=sum(own.numel() for own in student.parameters()))
    success, length = {}, 0.0
    # The choice takes three times as many episodes as it names.
    limit = lambda: end - length - 20
    for number in range(1, options.rounds + 2):
        steps, losses = train(student, data, statistics, options, (time.time() - begin) / (end - begin), limit())
        export(student, options, options.out / f"round-{number}.onnx")
        start = time.time()
        rates = data.record(
            options.out / f"round-{number}.onnx", options.student_episodes, 2000 + 100 * options.seed + number,
            "-k", "record.relabel=expert",
        )
        episodes = 3 * options.choose * len(rates) + options.evaluate
        length = max(length, (time.time() - start) * episodes / options.student_episodes)
        note(round=number, steps=steps, action_loss=losses[0], state_loss=losses[1], student=rates)
        success[number] = sum(rates)
        if time.time() > limit():
            break
    number = choose(options, success, note)
    policy = options.out / "policy.onnx"
    shutil.copy(options.out / f"round-{number}.onnx", policy)
    if options.evaluate:
        found = program(
            options, "evaluate", options.task, "--controller", policy, "--episodes", options.evaluate,
            "-k", "evaluate.control=false", "--out", options.out / "evaluation.sqlite", seed=9_000_000 + options.seed,
        )
        note(round=number, evaluation=found["success_rate"], bytes=policy.stat().st_size)
    else:
        note(round=number, bytes=policy.stat().st_size)


if __name__ == "__main__":
    main()
