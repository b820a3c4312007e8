"""Continues a policy that sees on the failures of a hardening: the trainer of `mishandle harden`.

    mishandle harden cube-stacking --controller vision.onnx --space starts+light-3 --steps 1500 \\
        --trainer 'python trainer.py' --out better.onnx

Each of two passes records the policy with the expert's actions as labels, a third of the episodes from random starts
and the others in the space with the failures of the archive, and trains half of the steps on all frames. A step is one
of the optimizer. Needs torch, numpy and onnx.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import onnx
import torch
from students import PROPRIOCEPTION_SIZE, export, load, make, weights_of
from train import Data, train

PASSES = 2


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ["target", "space"]:
        parser.add_argument(f"--{name}", required=True)
    for name in ["controller", "archive", "out"]:
        parser.add_argument(f"--{name}", type=Path, required=True)
    for name in ["seed", "steps", "threads"]:
        parser.add_argument(f"--{name}", type=int, required=True)
    for name in ["axis", "set"]:
        parser.add_argument(f"--{name}", action="append", default=[])
    parser.add_argument("--mishandle", default="mishandle", help="the program")
    parser.add_argument("--episodes", type=int, default=90, help="episodes of a pass")
    parser.add_argument("--every", type=int, default=2, help="keep one of this number of frames")
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--learning-rate", type=float, default=3e-4)
    parser.add_argument("--auxiliary", type=float, default=1.0, help="weight of the auxiliary loss")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    return parser.parse_args()


def sizes(options):
    """Reads what the policy sees, and the sizes of its layers, from its file. Returns the size of the state."""
    model = onnx.load(options.controller)
    facts = {entry.key: entry.value for entry in model.metadata_props}
    options.task, options.chunk = options.target, 1
    options.cameras = ",".join(camera for _, camera in json.loads(facts["mishandle.images"]))
    weights = weights_of(options.controller)
    options.size = next(
        entry.type.tensor_type.shape.dim[1].dim_value for entry in model.graph.input if entry.name in options.cameras
    )
    options.channels = len(weights["eyes.0.layers.0.bias"])
    options.hidden = len(weights["trunk.0.bias"])
    return len(weights["auxiliary.bias"])


def main():
    options = arguments()
    torch.manual_seed(options.seed)
    torch.set_num_threads(options.threads)
    state_size = sizes(options)
    nothing = torch.zeros(PROPRIOCEPTION_SIZE + state_size)
    student = make(options, state_size, (nothing, nothing)).to(options.device)
    load(student, options.controller)
    bounds = [word for name in ["axis", "set"] for value in getattr(options, name) for word in ("--axis", value)]
    options.epochs, options.most_steps = float("inf"), max(1, options.steps // PASSES)
    with tempfile.TemporaryDirectory() as folder:
        out, options.out = options.out, Path(folder)
        data = Data(options)
        for number in range(PASSES):
            current = options.out / f"{number}.onnx"
            export(student, options, current)
            third, seed = options.episodes // 3, options.seed + number
            plain = data.record_in("starts", current, third, seed, "-k", "record.relabel=expert")
            found = data.record_in(
                options.space, current, options.episodes - third, seed, "-k", "record.relabel=expert",
                "-k", f"record.archive={options.archive.resolve()}", *bounds,
            )
            print(f"pass {number + 1}: success {plain} from starts, {found} in the space with the archive", flush=True)
            states = data.merge()[0]
            if number == 0:
                scale = states.std(0)
                statistics = (states.mean(0), torch.where(scale > 1e-3, scale, torch.ones_like(scale)))
            steps, losses = train(student, data, statistics, options, number / PASSES, time.time() + 1e9)
            print(f"pass {number + 1}: {steps} steps, losses {losses}", flush=True)
        export(student, options, out)


if __name__ == "__main__":
    main()
