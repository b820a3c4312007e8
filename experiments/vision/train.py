"""Trains a policy that sees: behavior cloning of a task's expert, then DAgger, as an ONNX controller.

Round 0 records the expert with images. Each later round records the student, with the expert's action as the
label of each state, and trains on all that was recorded. The student gets joint positions and velocities and
the images; while it trains, an auxiliary head learns the rest of the observation from the images.

    python train.py ball-pushing --out policies/ball-pushing --rounds 30 --epochs 15 --minutes 8

Needs torch, numpy and onnx. The folder has policy.onnx, the student with the highest success rate in its round;
log.jsonl, a line for each round; and evaluation.sqlite, the run of the last evaluation with seeds of its own.
"""

import argparse
import json
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import onnx
import torch
from torch import nn

PROPRIOCEPTION = ["joint_positions", "joint_velocities"]
PROPRIOCEPTION_SIZE = 18


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task")
    parser.add_argument("--out", type=Path, required=True, help="new folder of the policy and its log")
    parser.add_argument("--mishandle", default="mishandle", help="the program")
    parser.add_argument("--cameras", default="over", help="cameras of the policy, joined by commas")
    parser.add_argument("--size", type=int, default=64, help="width and height of the images, pixels")
    parser.add_argument("--space", default="starts", help="space of the recorded scenarios, such as starts+light")
    parser.add_argument("--rounds", type=int, default=8, help="rounds of DAgger after the first one")
    parser.add_argument("--episodes", type=int, default=200, help="episodes of the expert")
    parser.add_argument("--student-episodes", type=int, default=100, help="episodes of the student in each round")
    parser.add_argument("--expert-noise", type=float, default=0.0, help="action noise of the expert's episodes")
    parser.add_argument("--epochs", type=float, default=8.0, help="passes over the data in each round")
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--learning-rate", type=float, default=1e-3)
    parser.add_argument("--channels", type=int, default=32)
    parser.add_argument("--hidden", type=int, default=256)
    parser.add_argument("--auxiliary", type=float, default=1.0, help="weight of the auxiliary loss")
    parser.add_argument("--minutes", type=float, default=30.0, help="time limit")
    parser.add_argument("--threads", type=int, help="threads of the program")
    parser.add_argument("--evaluate", type=int, default=500, help="episodes of the last evaluation")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    return parser.parse_args()


class Eye(nn.Module):
    """Points in an image: a spatial softmax of each channel (Levine et al., JMLR 2016), and means."""

    def __init__(self, size, channels):
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(3, channels, 5, stride=2, padding=2), nn.ReLU(),
            nn.Conv2d(channels, channels, 3, padding=1), nn.ReLU(),
            nn.Conv2d(channels, channels, 3, padding=1),
        )
        self.temperature = nn.Parameter(torch.ones(channels, 1))
        line = torch.linspace(-1, 1, size // 2)
        y, x = torch.meshgrid(line, line, indexing="ij")
        self.register_buffer("places", torch.stack([x.flatten(), y.flatten()], 1))

    def forward(self, image):
        # Bytes, as the program gives them: [N, height, width, 3].
        found = self.layers(image.permute(0, 3, 1, 2).float() / 127.5 - 1).flatten(2)
        weights = torch.softmax(found * self.temperature, 2)
        return torch.cat([(weights @ self.places).flatten(1), (weights * found).sum(2)], 1)


class Student(nn.Module):
    def __init__(self, options, state_size, statistics):
        super().__init__()
        cameras = options.cameras.split(",")
        self.eyes = nn.ModuleList(Eye(options.size, options.channels) for _ in cameras)
        features = 3 * options.channels * len(cameras) + PROPRIOCEPTION_SIZE
        wide = options.hidden
        self.trunk = nn.Sequential(nn.Linear(features, wide), nn.ReLU())
        self.auxiliary = nn.Linear(wide, state_size)
        self.head = nn.Sequential(
            nn.Linear(wide + state_size + PROPRIOCEPTION_SIZE, wide), nn.ReLU(),
            nn.Linear(wide, wide), nn.ReLU(), nn.Linear(wide, 9),
        )
        self.register_buffer("mean", statistics[0][:PROPRIOCEPTION_SIZE])
        self.register_buffer("scale", statistics[1][:PROPRIOCEPTION_SIZE])

    def all(self, proprioception, *images):
        """Returns the action and the estimate of the rest of the observation, normalized."""
        body = (proprioception - self.mean) / self.scale
        seen = [eye(image) for eye, image in zip(self.eyes, images)]
        trunk = self.trunk(torch.cat([*seen, body], 1))
        state = self.auxiliary(trunk)
        return self.head(torch.cat([trunk, state, body], 1)), state

    def forward(self, proprioception, *images):
        return self.all(proprioception, *images)[0]


def export(student, options, path):
    """Writes the student as a controller: its metadata says what it gets."""
    cameras = options.cameras.split(",")
    size = options.size
    example = (torch.zeros(1, PROPRIOCEPTION_SIZE), *(torch.zeros(1, size, size, 3, dtype=torch.uint8) for _ in cameras))
    copy = Student(options, student.auxiliary.out_features, (student.mean.cpu(), student.scale.cpu()))
    copy.load_state_dict({key: value.cpu() for key, value in student.state_dict().items()})
    torch.onnx.export(
        copy.eval(), example, str(path), input_names=["proprioception", *cameras], output_names=["action"],
        opset_version=17, dynamo=False,
    )
    model = onnx.load(path)
    onnx.helper.set_model_props(model, {
        "mishandle.task": options.task,
        "mishandle.observation": "proprioception",
        "mishandle.parts": json.dumps(PROPRIOCEPTION),
        "mishandle.images": json.dumps([[camera, camera] for camera in cameras]),
    })
    onnx.save(model, path)


def program(options, *words, seed):
    threads = ["--threads", str(options.threads)] if options.threads else []
    command = [options.mishandle, *map(str, words), "--seed", str(seed), *threads, "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")
    return json.loads(done.stdout)


class Data:
    """All frames so far, on the device: proprioception, the rest of the observation, actions and images."""

    def __init__(self, options):
        self.options = options
        self.parts = []

    def record(self, name, controller, episodes, seed, *more):
        options, folder = self.options, self.options.out / "record"
        shutil.rmtree(folder, ignore_errors=True)
        found = program(
            options, "record", options.task, "--controller", controller, "--episodes", episodes,
            "--space", options.space, "--cameras", options.cameras, "--size", f"{options.size}x{options.size}",
            "--format", "npz", "--out", folder, *more, seed=seed,
        )
        with np.load(folder / "data.npz") as data:
            columns = ["observation.state", "action"]
            columns += [f"observation.images.{camera}" for camera in options.cameras.split(",")]
            arrays = [torch.from_numpy(data[column]) for column in columns]
        shutil.rmtree(folder)
        self.parts.append([array.to(options.device) for array in arrays])
        return found["successes"] / found["simulations"], found["frames"]

    def merge(self):
        self.parts = [[torch.cat(arrays) for arrays in zip(*self.parts)]]
        return self.parts[0]


def train(student, data, statistics, options, end):
    """Trains on all frames, until the epochs or the time are over. Returns the last mean losses."""
    states, actions, *images = data.merge()
    frames = len(states)
    steps = max(1, int(options.epochs * frames / options.batch))
    optimizer = torch.optim.AdamW(student.parameters(), lr=options.learning_rate, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, options.learning_rate, total_steps=steps + 1, pct_start=0.1)
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
    return step + 1, sums.tolist()


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
    noise = ["--action-noise", options.expert_noise] if options.expert_noise else []
    rate, frames = data.record("expert", "expert", options.episodes, 1000 + options.seed, *noise)
    note(round=0, expert=rate, frames=frames)
    states = data.merge()[0]
    scale = states.std(0)
    # What never changes is not magnified.
    statistics = (states.mean(0), torch.where(scale > 1e-3, scale, torch.ones_like(scale)))
    student = Student(options, states.shape[1] - PROPRIOCEPTION_SIZE, statistics).to(options.device)
    note(parameters=sum(own.numel() for own in student.parameters()))
    best, length = -1.0, 0.0
    latest, policy = options.out / "latest.onnx", options.out / "policy.onnx"
    # The last evaluation needs its time.
    limit = lambda: end - 1.5 * length - 20
    for number in range(1, options.rounds + 2):
        steps, losses = train(student, data, statistics, options, limit())
        export(student, options, latest)
        start = time.time()
        rate, frames = data.record("student", latest, options.student_episodes, 2000 + 100 * options.seed + number, "--relabel", "expert")
        length = max(length, (time.time() - start) * options.evaluate / options.student_episodes / 2)
        note(round=number, steps=steps, action_loss=losses[0], state_loss=losses[1], student=rate)
        if rate >= best:
            best = rate
            shutil.copy(latest, policy)
        if time.time() > limit():
            break
    shutil.rmtree(options.out / "record", ignore_errors=True)
    # Seeds that no round used.
    found = program(
        options, "evaluate", options.task, "--controller", policy, "--space", options.space, "--episodes", options.evaluate,
        "--no-control", "--out", options.out / "evaluation.sqlite", seed=9_000_000 + options.seed,
    )
    note(best=best, evaluation=found["success_rate"], bytes=policy.stat().st_size)


if __name__ == "__main__":
    main()
