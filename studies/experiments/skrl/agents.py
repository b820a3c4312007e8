"""skrl's own agents with its own defaults, but for what the settings files of this folder state."""

import logging

import torch
from torch import nn

logging.disable(logging.CRITICAL)
from skrl.agents.torch.ddpg import DDPG
from skrl.agents.torch.ppo import PPO
from skrl.agents.torch.sac import SAC
from skrl.agents.torch.td3 import TD3
from skrl.agents.torch.trpo import TRPO
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.resources.noises.torch import GaussianNoise
from skrl.trainers.torch import SequentialTrainer

AGENTS = {"ppo": PPO, "trpo": TRPO, "sac": SAC, "td3": TD3, "ddpg": DDPG}
ON_POLICY = ["ppo", "trpo"]
# skrl's default, and so the preset's.
ROLLOUT_STEPS = 16


def layers(inputs, hidden, outputs, *last):
    sizes = [inputs, *hidden]
    pairs = [[nn.Linear(a, b), nn.ELU()] for a, b in zip(sizes, sizes[1:])]
    return nn.Sequential(*sum(pairs, []), nn.Linear(sizes[-1], outputs), *last)


class Gaussian(GaussianMixin, Model):
    """As in skrl's examples: deviations are parameters."""

    def __init__(self, hidden, initial_log_std, clip_actions, spaces):
        Model.__init__(self, device="cpu", **spaces)
        GaussianMixin.__init__(self, clip_actions=clip_actions)
        self.network = layers(self.num_observations, hidden, self.num_actions)
        self.log_std = nn.Parameter(torch.full((self.num_actions,), initial_log_std))

    def compute(self, inputs, role=""):
        return self.network(inputs["states"]), self.log_std, {}


class Deterministic(DeterministicMixin, Model):
    def __init__(self, hidden, spaces):
        Model.__init__(self, device="cpu", **spaces)
        DeterministicMixin.__init__(self, clip_actions=True)
        self.network = layers(self.num_observations, hidden, self.num_actions, nn.Tanh())

    def compute(self, inputs, role=""):
        return self.network(inputs["states"]), {}


class Value(DeterministicMixin, Model):
    """Of observations, or of observations and actions."""

    def __init__(self, hidden, of_actions, spaces):
        Model.__init__(self, device="cpu", **spaces)
        DeterministicMixin.__init__(self)
        self.of_actions = of_actions
        inputs = self.num_observations + (self.num_actions if of_actions else 0)
        self.network = layers(inputs, hidden, 1)

    def compute(self, inputs, role=""):
        observation = inputs["states"]
        if self.of_actions:
            observation = torch.cat([observation, inputs["taken_actions"]], dim=1)
        return self.network(observation), {}


def models(algorithm, settings, spaces):
    hidden, critic_hidden = settings["policy"]["hidden"], settings["critic"]["hidden"]
    if algorithm in ON_POLICY:
        policy = Gaussian(hidden, settings["policy"]["initial_log_std"], False, spaces)
        return {"policy": policy, "value": Value(critic_hidden, False, spaces)}
    if algorithm == "sac":
        actor = lambda: Gaussian(hidden, 0.0, True, spaces)
    else:
        actor = lambda: Deterministic(hidden, spaces)
    names = ["critic"] if algorithm == "ddpg" else ["critic_1", "critic_2"]
    made = {"policy": actor()}
    for name in names:
        made[name], made[f"target_{name}"] = (Value(critic_hidden, True, spaces) for _ in range(2))
    if algorithm != "sac":
        made["target_policy"] = actor()
    return made


def config(algorithm, settings):
    """What differs from skrl's defaults, in skrl's terms."""
    options = {"experiment": {"write_interval": 0, "checkpoint_interval": 0}}
    names = {"gamma": "discount_factor", "initial_temperature": "initial_entropy_value"}
    options |= {theirs: settings[ours] for ours, theirs in names.items() if ours in settings}
    if "exploration_std" in settings:
        std, decay = settings["exploration_std"][0], settings["exploration_decay"]
        options["exploration"] = {
            "noise": GaussianNoise(0.0, std, "cpu"),
            "initial_scale": 1.0,
            "final_scale": decay["share"],
            "timesteps": decay["steps"] // settings["episodes"]["environments"],
        }
    if "smoothing_std" in settings:
        options["smooth_regularization_noise"] = GaussianNoise(0.0, settings["smoothing_std"], "cpu")
    return options


def train(algorithm, env, settings, total_steps):
    """Trains an agent for as many environment steps."""
    on_policy = algorithm in ON_POLICY
    size = ROLLOUT_STEPS if on_policy else settings["replay"]["capacity"] // env.num_envs
    agent = AGENTS[algorithm](
        models=models(algorithm, settings, env.spaces),
        memory=RandomMemory(memory_size=size, num_envs=env.num_envs, device="cpu"),
        cfg=config(algorithm, settings),
        device="cpu",
        **env.spaces,
    )
    timesteps = total_steps // env.num_envs
    cfg = {"timesteps": timesteps, "headless": True, "disable_progressbar": True}
    SequentialTrainer(env=env, agents=agent, cfg=cfg).train()
    return agent
