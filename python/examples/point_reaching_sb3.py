"""PPO of Stable-Baselines3 on our point-reaching task: 64 environments that are stepped
together."""

import sys
import time

import gymnasium
import torch
from recording import POLICIES, facts_of_task, read_training, record, save_training
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

import mishandle
import mishandle.sb3

STEPS, SEED, ENVIRONMENTS = 1_500_000, 0, 64
MODEL, MOMENTS = (
    POLICIES / "point_reaching_sb3.zip", POLICIES / "point_reaching_sb3_normalization.pkl"
)
PACKAGES = ["gymnasium", "stable-baselines3", "torch", "numpy"]
torch.set_num_threads(1)


def environments(count=ENVIRONMENTS):
    env = gymnasium.make_vec(
        "mishandle/PointReaching-v0", num_envs=count, autoreset_mode="SameStep"
    )
    return VecMonitor(mishandle.sb3.vec_env(env))


def train():
    env = VecNormalize(environments(), gamma=0.99)
    model = PPO(
        "MlpPolicy", env, seed=SEED, device="cpu", gamma=0.99, n_steps=64, batch_size=1024,
        n_epochs=5,
        learning_rate=lambda left: 1e-3 * left + 1e-5,
        policy_kwargs={"net_arch": [64, 64], "activation_fn": torch.nn.ELU, "log_std_init": -0.5},
    )  # fmt: skip
    started = time.time()
    model.learn(STEPS)
    returns = [episode["r"] for episode in model.ep_info_buffer]
    save_training(
        "point_reaching_sb3", time.time() - started, STEPS, SEED, sum(returns) / len(returns),
        PACKAGES
    )
    model.save(MODEL, exclude=["policy.optimizer"])
    env.save(str(MOMENTS))


def main():
    if "--train" in sys.argv:
        train()
    # With its environment, the model knows its normalizer of observations, and Mishandle applies
    # it.
    model = PPO.load(MODEL, env=VecNormalize.load(str(MOMENTS), environments(1)), device="cpu")
    facts = facts_of_task("point-reaching", "point_reaching_sb3", model)
    record(
        "point_reaching_sb3", {"training": read_training("point_reaching_sb3"), **facts}, PACKAGES
    )


if __name__ == "__main__":
    main()
