"""PPO of skrl on our point-reaching task: 64 environments that are stepped together."""

import sys
import time

import gymnasium
import torch
from recording import POLICIES, facts_of_task, read_training, record, save_training
from skrl.agents.torch.ppo import PPO
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.resources.preprocessors.torch import RunningStandardScaler
from skrl.resources.schedulers.torch import KLAdaptiveLR
from skrl.trainers.torch import SequentialTrainer
from skrl.utils import set_seed
from torch import nn

import mishandle

STEPS, SEED, ENVIRONMENTS, ROLLOUT = 1_500_000, 0, 64, 64
MODEL = POLICIES / "point_reaching_skrl.pt"
PACKAGES = ["gymnasium", "skrl", "torch", "numpy"]
torch.set_num_threads(1)


def layers(inputs, outputs):
    return nn.Sequential(
        nn.Linear(inputs, 64), nn.ELU(), nn.Linear(64, 64), nn.ELU(), nn.Linear(64, outputs)
    )


class Policy(GaussianMixin, Model):
    def __init__(self, **spaces):
        Model.__init__(self, device="cpu", **spaces)
        GaussianMixin.__init__(self)
        self.network = layers(self.num_observations, self.num_actions)
        self.log_std = nn.Parameter(torch.full((self.num_actions,), -0.5))

    def compute(self, inputs, role=""):
        return self.network(inputs["observations"]), {"log_std": self.log_std}


class Value(DeterministicMixin, Model):
    def __init__(self, **spaces):
        Model.__init__(self, device="cpu", **spaces)
        DeterministicMixin.__init__(self)
        self.network = layers(self.num_observations, 1)

    def compute(self, inputs, role=""):
        return self.network(inputs["observations"]), {}


def make_agent(environments):
    # The default autoreset mode, NEXT_STEP: the last observation of an episode is in its
    # transition, as skrl expects.
    env = wrap_env(
        gymnasium.make_vec("mishandle/PointReaching-v0", num_envs=environments), wrapper="gymnasium"
    )
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
    scaler = {"device": "cpu"}
    settings = {
        "rollouts": ROLLOUT, "learning_epochs": 5, "mini_batches": 4, "discount_factor": 0.99,
        "grad_norm_clip": 1.0,
        "learning_rate": 1e-3, "learning_rate_scheduler": KLAdaptiveLR,
        "learning_rate_scheduler_kwargs": {"kl_threshold": 0.01}, "time_limit_bootstrap": True,
        "observation_preprocessor": RunningStandardScaler,
        "observation_preprocessor_kwargs": {"size": env.observation_space, **scaler},
        "value_preprocessor": RunningStandardScaler,
        "value_preprocessor_kwargs": {"size": 1, **scaler},
        "experiment": {"write_interval": 0, "checkpoint_interval": 0},
    }  # fmt: skip
    memory = RandomMemory(memory_size=ROLLOUT, num_envs=environments, device="cpu")
    models = {"policy": Policy(**spaces), "value": Value(**spaces)}
    return env, PPO(models=models, memory=memory, device="cpu", cfg=settings, **spaces)


def train():
    env, agent = make_agent(ENVIRONMENTS)
    trainer = SequentialTrainer(
        cfg={"timesteps": STEPS // ENVIRONMENTS, "headless": True, "disable_progressbar": True},
        env=env, agents=agent
    )
    started = time.time()
    trainer.train()
    save_training("point_reaching_skrl", time.time() - started, STEPS, SEED, None, PACKAGES)
    names = ("policy", "observation_preprocessor")
    torch.save({name: agent.checkpoint_modules[name].state_dict() for name in names}, MODEL)


def main():
    set_seed(SEED)
    if "--train" in sys.argv:
        train()
    _, agent = make_agent(1)
    for name, weights in torch.load(MODEL).items():
        agent.checkpoint_modules[name].load_state_dict(weights)
    facts = facts_of_task("point-reaching", "point_reaching_skrl", agent)
    record(
        "point_reaching_skrl", {"training": read_training("point_reaching_skrl"), **facts}, PACKAGES
    )


if __name__ == "__main__":
    main()
