"""The commands of LeRobot that the examples run."""

import os
import pathlib
import subprocess
import sys

ACT = {
    "policy.type": "act", "policy.device": "cpu", "policy.push_to_hub": "false",
    # LeRobot would download a backbone.
    "policy.pretrained_backbone_weights": "null",
    "policy.dim_model": 64, "policy.n_heads": 4, "policy.dim_feedforward": 128,
    "policy.n_encoder_layers": 2,
    "policy.n_vae_encoder_layers": 1, "policy.latent_dim": 8,
}  # fmt: skip
"""A small ACT, to train on a CPU."""


def lerobot(command, options):
    """Runs a command of LeRobot, without the network."""
    words = [f"--{name}={value}" for name, value in options.items()]
    program = pathlib.Path(sys.executable).parent / f"lerobot-{command}"
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1"}
    subprocess.run([program, *words], check=True, env=environment)


def train(data, out, steps, options):
    """Trains an ACT on a data set. Returns the folder of the policy."""
    facts = {"dataset.repo_id": f"mishandle/{data.name}", "dataset.root": data, "output_dir": out}
    run = {"steps": steps, "save_freq": steps, "batch_size": 8, "num_workers": 0, "eval_freq": 0}
    lerobot("train", {**facts, **run, **ACT, **options})
    return out / "checkpoints/last/pretrained_model"
