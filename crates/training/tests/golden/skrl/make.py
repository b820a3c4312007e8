"""Writes cases.json: some updates of skrl's SAC, TD3 and DDPG agents, in double precision; and on_policy.json, see there.

    python3 -m venv venv && venv/bin/pip install -r requirements.txt && venv/bin/python make.py

Run it in this folder. The agents are skrl's own; the models are small networks of the layout that ours have, and every agent
learns from one batch again and again with random numbers that are written beside the results. There are two kinds of cases:
"tuned" ones have rates that move everything far in few updates, and their SAC has a squashed policy, which skrl has not;
"default" ones have skrl's default settings, and their SAC has skrl's own GaussianMixin. skrl's default for the smoothing of
TD3 is no noise object, with which its update cannot run; the case without smoothing has one that gives zeros. Numbers are
rounded to ten digits, so that the file does not depend on the order of PyTorch's sums.
"""

import json
import logging
import math

import gymnasium
import make_on_policy
import torch
from torch import nn

logging.disable(logging.CRITICAL)
from skrl.agents.torch.ddpg import DDPG
from skrl.agents.torch.sac import SAC
from skrl.agents.torch.td3 import TD3
from skrl.models.torch import GaussianMixin, Model

OBSERVATIONS, ACTIONS, HIDDEN, ROWS = 3, 2, 5, 12
TUNED_UPDATES, DEFAULT_UPDATES = 4, 20
GAMMA, TAU, ACTOR_RATE, CRITIC_RATE, TEMPERATURE_RATE = 0.97, 0.05, 0.003, 0.01, 0.02
TEMPERATURE, TARGET_ENTROPY, SMOOTHING_STD, SMOOTHING_CLIP = 0.3, -0.4, 0.5, 0.4
LOG_STD_RANGE = (-5.0, 2.0)
SPACES = {
    "observation_space": gymnasium.spaces.Box(-10.0, 10.0, (OBSERVATIONS,)),
    "action_space": gymnasium.spaces.Box(-1.0, 1.0, (ACTIONS,)),
    "device": torch.device("cpu"),
}
generator = torch.Generator().manual_seed(1)


def numbers(tensor):
    return [float(f"{x:.10g}") for x in tensor.detach().flatten().tolist()]


def random(*shape):
    """Numbers that f32 holds exactly, so that both precisions begin at the same point."""
    return torch.randn(*shape, generator=generator, dtype=torch.float32).double()


def layers(inputs, outputs, last):
    network = nn.Sequential(nn.Linear(inputs, HIDDEN), nn.ELU(), nn.Linear(HIDDEN, outputs), *last).double()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.copy_((random(*parameter.shape) * 0.5).float().double())
    return network


class Critic(Model):
    def __init__(self):
        super().__init__(**SPACES)
        self.network = layers(OBSERVATIONS + ACTIONS, 1, [])

    def act(self, inputs, role=""):
        return self.network(torch.cat([inputs["states"], inputs["taken_actions"]], dim=1)), None, {}


class Actor(Model):
    def __init__(self):
        super().__init__(**SPACES)
        self.network = layers(OBSERVATIONS, ACTIONS, [nn.Tanh()])

    def act(self, inputs, role=""):
        return self.network(inputs["states"]), None, {}


class SquashedActor(Model):
    def __init__(self, draws):
        super().__init__(**SPACES)
        self.network = layers(OBSERVATIONS, 2 * ACTIONS, [])
        self.draws = iter(draws)

    def act(self, inputs, role=""):
        mean, raw = self.network(inputs["states"]).chunk(2, dim=1)
        low, high = LOG_STD_RANGE
        normal = torch.distributions.Normal(mean, (low + 0.5 * (high - low) * (1 + torch.tanh(raw))).exp())
        u = normal.mean + normal.stddev * next(self.draws)
        jacobian = 2 * (math.log(2) - u - nn.functional.softplus(-2 * u))
        return torch.tanh(u), (normal.log_prob(u) - jacobian).sum(dim=1, keepdim=True), {}


class OwnActor(GaussianMixin, Model):
    """As in skrl's examples: deviations that do not depend on what is seen, actions clipped after they are drawn."""

    def __init__(self, draws):
        Model.__init__(self, **SPACES)
        GaussianMixin.__init__(self, clip_actions=True)
        self.network = layers(OBSERVATIONS, ACTIONS, [])
        self.log_std_parameter = nn.Parameter(torch.tensor([-0.5, 0.25], dtype=torch.float64))
        self.draws = iter(draws)

    def act(self, inputs, role=""):
        kept = torch.distributions.normal._standard_normal
        torch.distributions.normal._standard_normal = lambda shape, dtype, device: next(self.draws)
        try:
            return super().act(inputs, role)
        finally:
            torch.distributions.normal._standard_normal = kept

    def compute(self, inputs, role=""):
        return self.network(inputs["states"]), self.log_std_parameter, {}


class Noise:
    """Smoothing noise that is drawn beforehand."""

    def __init__(self, draws, std):
        self.draws, self.std = iter(draws), std

    def sample(self, shape):
        return self.std * next(self.draws)


class Memory:
    """One batch, again and again."""

    def __init__(self, batch):
        self.batch = batch

    def create_tensor(self, **_):
        pass

    def sample(self, **_):
        return [self.batch]


def batch():
    terminated = torch.zeros(ROWS, 1, dtype=torch.bool)
    terminated[::5] = True
    return (
        random(ROWS, OBSERVATIONS),
        torch.tanh(random(ROWS, ACTIONS)).float().double(),
        random(ROWS, 1),
        random(ROWS, OBSERVATIONS),
        terminated,
    )


def parameters(models):
    """The parameters of networks, log σ apart."""
    told = {}
    for name, model in models.items():
        told[name] = numbers(nn.utils.parameters_to_vector(model.network.parameters()))
        if isinstance(model, OwnActor):
            told["log_std"] = numbers(model.log_std_parameter)
    return told


def keep_gradients(optimizer, told, models):
    """Adds what `models` are moved by to `told`, before each step of their optimizer."""
    step = optimizer.step

    def keep_and_step():
        for name, model in models.items():
            told.setdefault(name, []).append(numbers(torch.cat([p.grad.flatten() for p in model.network.parameters()])))
            if isinstance(model, OwnActor):
                told.setdefault("log_std", []).append(numbers(model.log_std_parameter.grad))
        step()

    optimizer.step = keep_and_step


def case(make, policy, critics, draws, config, updates):
    data = batch()
    models = {"policy": policy, **critics}
    if make is not SAC:
        models["target_policy"] = Actor()
    for name in critics:
        models[f"target_{name}"] = Critic()
    common = {
        "batch_size": ROWS,
        "experiment": {"write_interval": 1, "checkpoint_interval": 0, "directory": "", "experiment_name": ""},
    }
    start = parameters({name: model for name, model in models.items() if "target" not in name})
    agent = make(models=models, memory=Memory(data), cfg={**common, **config}, **SPACES)
    agent._rnn, agent._rnn_sequence_length, agent._tensors_names, agent.write_interval = False, 1, [], 1
    agent._backward_compatibility, agent.clip_actions_min, agent.clip_actions_max = False, -1.0, 1.0
    told = {"critic_losses": [], "policy_losses": [], "temperatures": []}
    agent.track_data = lambda name, value: name.startswith("Loss / ") and told.setdefault(name, []).append(value)
    gradients = {}
    keep_gradients(agent.policy_optimizer, gradients, {"policy": policy})
    keep_gradients(agent.critic_optimizer, gradients, critics)
    for _ in range(updates):
        agent._update(0, 1)
        if make is SAC:
            told["temperatures"].append(float(f"{agent._entropy_coefficient.item():.6g}"))
    states, actions, rewards, next_states, terminated = data
    rounded = lambda values: [float(f"{x:.10g}") for x in values]
    return {
        "gamma": agent._discount_factor,
        "observations": numbers(states),
        "actions": numbers(actions),
        "returns": numbers(rewards),
        "discounts": numbers(agent._discount_factor * terminated.logical_not().double()),
        "next_observations": numbers(next_states),
        "draws": [numbers(draw) for draw in draws],
        "start": start,
        "critic_losses": rounded(told["Loss / Critic loss"]),
        "policy_losses": rounded(told["Loss / Policy loss"]),
        "temperatures": told["temperatures"],
        "gradients": gradients,
        "end": parameters(models),
    }


def tuned():
    draws = [random(ROWS, ACTIONS) for _ in range(2 * TUNED_UPDATES)]
    twins = lambda: {"critic_1": Critic(), "critic_2": Critic()}
    common = {
        "discount_factor": GAMMA,
        "polyak": TAU,
        "actor_learning_rate": ACTOR_RATE,
        "critic_learning_rate": CRITIC_RATE,
    }
    entropy = {
        "entropy_learning_rate": TEMPERATURE_RATE,
        "initial_entropy_value": TEMPERATURE,
        "target_entropy": TARGET_ENTROPY,
    }
    smoothing = {
        "smooth_regularization_noise": Noise(draws, SMOOTHING_STD),
        "smooth_regularization_clip": SMOOTHING_CLIP,
    }
    return {
        "sac": case(SAC, SquashedActor(draws), twins(), draws, {**common, **entropy}, TUNED_UPDATES),
        "td3": case(TD3, Actor(), twins(), draws[:TUNED_UPDATES], {**common, **smoothing}, TUNED_UPDATES),
        "ddpg": case(DDPG, Actor(), {"critic": Critic()}, [], common, TUNED_UPDATES),
    }


def default():
    draws = [random(ROWS, ACTIONS) for _ in range(2 * DEFAULT_UPDATES)]
    twins = lambda: {"critic_1": Critic(), "critic_2": Critic()}
    smoothing = lambda std: {"smooth_regularization_noise": Noise(draws, std)}
    once = draws[:DEFAULT_UPDATES]
    return {
        "sac": case(SAC, OwnActor(draws), twins(), draws, {}, DEFAULT_UPDATES),
        "td3": case(TD3, Actor(), twins(), once, smoothing(SMOOTHING_STD), DEFAULT_UPDATES),
        "td3_without_smoothing": case(TD3, Actor(), twins(), once, smoothing(0.0), DEFAULT_UPDATES),
        "ddpg": case(DDPG, Actor(), {"critic": Critic()}, [], {}, DEFAULT_UPDATES),
    }


def main():
    document = {
        "made_by": "skrl 0.10.2",
        "hidden": HIDDEN,
        "tau": TAU,
        "actor_learning_rate": ACTOR_RATE,
        "critic_learning_rate": CRITIC_RATE,
        "temperature_learning_rate": TEMPERATURE_RATE,
        "temperature": TEMPERATURE,
        "target_entropy": TARGET_ENTROPY,
        "smoothing_std": SMOOTHING_STD,
        "smoothing_clip": SMOOTHING_CLIP,
        "tuned": tuned(),
        "default": default(),
    }
    with open("cases.json", "w", encoding="utf-8") as file:
        json.dump(document, file, separators=(",", ":"))
        file.write("\n")


if __name__ == "__main__":
    main()
    make_on_policy.main()
