"""Writes on_policy.json: some updates of skrl's PPO and TRPO agents, in double precision. make.py runs it.

The agents, their Gaussian policy, their memory and their preprocessors are skrl's own; the models are
small networks of the layout that ours have. Each case is a sequence of rollouts, each followed by an update. What was seen,
done and rewarded in them is drawn beforehand; terminations are what skrl is told of episodes' ends under a wrapper that does
not tell time limits apart. The old log-probabilities are those of the policy; for PPO they are moved a little, so that ratios
begin on both sides of the clip. Numbers are rounded to ten digits, so that the file does not depend on the order of PyTorch's sums.
"""

import json
import logging

import gymnasium
import torch
from torch import nn

logging.disable(logging.CRITICAL)
import skrl.agents.torch.trpo.trpo as trpo_module
from skrl.agents.torch.ppo import PPO
from skrl.agents.torch.trpo import TRPO
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.resources.preprocessors.torch import RunningStandardScaler
from skrl.resources.schedulers.torch import KLAdaptiveRL

OBSERVATIONS, ACTIONS, HIDDEN, STEPS, ROWS, ROLLOUTS = 3, 2, 5, 7, 3, 3
SPACES = {
    "observation_space": gymnasium.spaces.Box(-10.0, 10.0, (OBSERVATIONS,)),
    "action_space": gymnasium.spaces.Box(-1.0, 1.0, (ACTIONS,)),
    "device": torch.device("cpu"),
}
generator = torch.Generator().manual_seed(1)

# PyTorch's schedulers no longer take the `verbose` that KLAdaptiveRL passes on.
scheduler_init = torch.optim.lr_scheduler._LRScheduler.__init__
torch.optim.lr_scheduler._LRScheduler.__init__ = lambda self, optimizer, last_epoch=-1, verbose=False: scheduler_init(
    self, optimizer, last_epoch
)


def numbers(tensor):
    return [float(f"{x:.10g}") for x in tensor.detach().double().flatten().tolist()]


def random(*shape):
    """Numbers that f32 holds exactly, so that both precisions begin at the same point."""
    return torch.randn(*shape, generator=generator, dtype=torch.float32).double()


def layers(outputs):
    network = nn.Sequential(nn.Linear(OBSERVATIONS, HIDDEN), nn.ELU(), nn.Linear(HIDDEN, outputs)).double()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.copy_((random(*parameter.shape) * 0.5).float().double())
    return network


class Policy(GaussianMixin, Model):
    def __init__(self):
        Model.__init__(self, **SPACES)
        GaussianMixin.__init__(self)
        self.network = layers(ACTIONS)
        self.log_std = nn.Parameter((random(ACTIONS) * 0.25).float().double())

    def compute(self, inputs, role):
        return self.network(inputs["states"].double()), self.log_std, {}


class Value(DeterministicMixin, Model):
    def __init__(self):
        Model.__init__(self, **SPACES)
        DeterministicMixin.__init__(self)
        self.network = layers(1)

    def compute(self, inputs, role):
        return self.network(inputs["states"].double()), {}


class Memory(RandomMemory):
    """skrl's memory, but in double precision."""

    def create_tensor(self, name, size, dtype=None, keep_dimensions=True):
        return super().create_tensor(name, size, torch.float64 if dtype == torch.float32 else dtype, keep_dimensions)


def parameters(network):
    return numbers(nn.utils.parameters_to_vector(network.parameters()))


def weights(agent):
    policy, value = agent.policy, agent.value
    return {"network": parameters(policy.network), "log_std": numbers(policy.log_std), "critic": parameters(value.network)}


def moments(scaler):
    if not isinstance(scaler, RunningStandardScaler):
        return None
    return {"count": scaler.current_count.item(), "mean": numbers(scaler.running_mean), "variance": numbers(scaler.running_variance)}


def agent_of(make, config):
    """An agent in training; `scaled` in its settings gives it both preprocessors."""
    config = dict(config)
    if config.pop("scaled", False):
        for name, size in [("state", OBSERVATIONS), ("value", 1)]:
            config[f"{name}_preprocessor"] = RunningStandardScaler
            config[f"{name}_preprocessor_kwargs"] = {"size": size, "device": SPACES["device"]}
    silent = {"write_interval": 0, "checkpoint_interval": 0, "directory": "", "experiment_name": ""}
    memory = Memory(memory_size=STEPS, num_envs=ROWS, device=SPACES["device"])
    agent = make(models={"policy": Policy(), "value": Value()}, memory=memory, cfg={**config, "experiment": silent}, **SPACES)
    agent.init()
    agent.set_mode("train")
    return agent


def roll_out(agent):
    """Fills the memory by skrl's own record_transition; gives what the memory then holds."""
    states, actions = random(STEPS + 1, ROWS, OBSERVATIONS), random(STEPS, ROWS, ACTIONS)
    rewards, moved = random(STEPS, ROWS, 1), random(STEPS, ROWS, 1) * (0.1 if isinstance(agent, PPO) else 0.0)
    terminated = random(STEPS, ROWS, 1) > 1.0
    for step in range(STEPS):
        with torch.no_grad():
            scaled = agent._state_preprocessor(states[step])
            _, log_prob, _ = agent.policy.act({"states": scaled, "taken_actions": actions[step]}, role="policy")
            agent._current_log_prob = (log_prob + moved[step]).float().double()
            agent.record_transition(
                states[step], actions[step], rewards[step], states[step + 1], terminated[step],
                torch.zeros_like(terminated[step]), {}, 0, 1,
            )  # fmt: skip
    held = agent.memory.get_tensor_by_name
    return {
        "observations": numbers(states[:STEPS]),
        "last_observations": numbers(states[STEPS]),
        "actions": numbers(actions),
        "rewards": numbers(rewards),
        "terminated": terminated.flatten().tolist(),
        "log_probs": numbers(held("log_prob")),
        "values": numbers(held("values")),
    }


def estimates(agent):
    """What the update made of the rollout: normalised advantages, and returns on the critic's scale."""
    held = agent.memory.get_tensor_by_name
    return {"advantages": numbers(held("advantages")), "targets": numbers(held("returns"))}


class Watch:
    """Remembers what an update computes by the way: losses, the policy's gradient in TRPO, steps tried."""

    def __enter__(self):
        self.losses, self.gradient, self.tries = [], None, 0
        self.kept = torch.Tensor.backward, torch.autograd.grad, trpo_module.vector_to_parameters

        def backward(loss, *arguments, **options):
            self.losses.append(loss.item())
            return self.kept[0](loss, *arguments, **options)

        def grad(*arguments, **options):
            found = self.kept[1](*arguments, **options)
            self.gradient = self.gradient or found
            return found

        def vector_to_parameters(*arguments):
            self.tries += 1
            return self.kept[2](*arguments)

        torch.Tensor.backward, torch.autograd.grad, trpo_module.vector_to_parameters = backward, grad, vector_to_parameters
        return self

    def __exit__(self, *_):
        torch.Tensor.backward, torch.autograd.grad, trpo_module.vector_to_parameters = self.kept


def rounded(x):
    return float(f"{x:.10g}")


def ppo_update(agent):
    steps = [0]
    step = agent.optimizer.step
    agent.optimizer.step = lambda *arguments: (steps.__setitem__(0, steps[0] + 1), step(*arguments))
    with Watch() as watch:
        agent._update(0, 1)
    agent.optimizer.step = step
    gradients = lambda module: numbers(torch.cat([p.grad.flatten() for p in module.parameters()]))
    return {
        "minibatches": steps[0],
        "last_loss": rounded(watch.losses[-1]),
        "last_gradient": gradients(agent.policy.network) + numbers(agent.policy.log_std.grad) + gradients(agent.value.network),
        "learning_rate": rounded(agent.optimizer.param_groups[0]["lr"]),
    }


def divergence(old, new, states):
    """KL(old ‖ new), by PyTorch's own formula."""
    of = lambda policy: torch.distributions.Normal(policy.network(states), policy.log_std.exp())
    return torch.distributions.kl_divergence(of(old), of(new)).sum(dim=-1).mean().item()


def trpo_update(agent):
    before = numbers(nn.utils.parameters_to_vector(agent.policy.parameters()))
    with Watch() as watch:
        agent._update(0, 1)
    moved = numbers(nn.utils.parameters_to_vector(agent.policy.parameters())) != before
    log_std, *network = watch.gradient
    return {
        "fraction": 0.5 ** (watch.tries - 1) if moved else 0.0,
        "gradient": numbers(torch.cat([part.flatten() for part in network])) + numbers(log_std),
        "last_loss": rounded(watch.losses[-1]),
    }


def case(make, settings, config, seed=None):
    """Some rollouts, each followed by an update; with a seed, its own draws instead of the next."""
    if seed is not None:
        generator.manual_seed(seed)
    agent = agent_of(make, config)
    update = ppo_update if make is PPO else trpo_update
    start, rollouts = weights(agent), []
    for _ in range(ROLLOUTS):
        rollout = roll_out(agent)
        told = update(agent)
        if make is TRPO:
            # Where observations are scaled, they have been scaled anew since: no outside figure then.
            states = agent.memory.get_tensor_by_name("states").reshape(-1, OBSERVATIONS)
            scaled = moments(agent._state_preprocessor) is not None
            told["kl"] = None if scaled else rounded(divergence(agent.backup_policy, agent.policy, states))
        rollouts.append({
            **rollout, **estimates(agent), **told, "end": weights(agent),
            "observation_moments": moments(agent._state_preprocessor), "value_moments": moments(agent._value_preprocessor),
        })  # fmt: skip
    return {"settings": settings, "start": start, "rollouts": rollouts}


SCALED = "policy.normalize_observations = true\ncritic.normalize_values = true\n"
# Ten conjugate gradients, which is the default, enlarge rounding too much for single precision, PyTorch's own as well.
FEW, few = "cg_iterations = 5\n", {"conjugate_gradient_steps": 5}
ADAPTIVE = {"learning_rate_scheduler": KLAdaptiveRL}


def main():
    document = {
        "made_by": "skrl 0.10.2",
        "common": f"""base = "skrl-0.10"
rollout_steps = {STEPS}
episodes.environments = {ROWS}
policy.hidden = [{HIDDEN}]
critic.hidden = [{HIDDEN}]
""",
        "ppo": {
            "defaults": case(PPO, "", {}),
            "clips and entropy": case(
                PPO,
                "value_clip = 0.2\nentropy_coef = 0.05\ncritic.loss_coef = 2.0\nlearning_rate = 0.01\n"
                'learning_rate_schedule = "adaptive"\n',
                {
                    "clip_predicted_values": True,
                    "value_clip": 0.2,
                    "entropy_loss_scale": 0.05,
                    "value_loss_scale": 2.0,
                    "learning_rate": 0.01,
                    **ADAPTIVE,
                },
            ),
            "divergence ends epochs": case(
                PPO,
                "kl_threshold = 0.02\nlearning_rate = 0.003\nlearning_rate_schedule = \"adaptive\"\ntarget_kl = 0.02\nminibatch_count = 5\n",
                {
                    "kl_threshold": 0.02,
                    "learning_rate": 0.003,
                    "mini_batches": 5,
                    **ADAPTIVE,
                    "learning_rate_scheduler_kwargs": {"kl_threshold": 0.02},
                },
            ),
            "the paper's": case(
                PPO,
                SCALED + "epochs = 16\nminibatch_count = 8\nlearning_rate = 0.0005\nlearning_rate_schedule = \"adaptive\"\ntarget_kl = 0.02\n"
                "max_grad_norm = 1.0\nvalue_clip = 0.2\ncritic.loss_coef = 2.0\n",
                {
                    "scaled": True,
                    "learning_epochs": 16,
                    "mini_batches": 8,
                    "learning_rate": 5e-4,
                    "grad_norm_clip": 1.0,
                    "clip_predicted_values": True,
                    "value_loss_scale": 2.0,
                    **ADAPTIVE,
                    "learning_rate_scheduler_kwargs": {"kl_threshold": 0.02},
                },
            ),
        },
        "trpo": {
            "defaults": case(TRPO, "", {}),
            "backtracks": case(
                TRPO, FEW + "max_kl = 2.0\naccept_ratio = 0.8\n", {**few, "max_kl_divergence": 2.0, "accept_ratio": 0.8}
            ),
            # Shares of the expected improvement that only the compounded expectation lets pass.
            "compounds": case(TRPO, FEW + "accept_ratio = 0.999\n", {**few, "accept_ratio": 0.999}),
            "fails": case(
                TRPO, FEW + "max_kl = 2.0\nline_search_steps = 1\n", {**few, "max_kl_divergence": 2.0, "max_backtrack_steps": 1}
            ),
            "the paper's": case(
                TRPO,
                FEW + SCALED + "epochs = 16\nminibatch_count = 8\nmax_grad_norm = 1.0\ncritic.loss_coef = 2.0\n",
                {**few, "scaled": True, "learning_epochs": 16, "mini_batches": 8, "grad_norm_clip": 1.0, "value_loss_scale": 2.0},
            ),
            # Moved scales, so that the old policy's own surrogate is not 0: what a step has to improve on decides here.
            "begins elsewhere": case(
                TRPO,
                FEW + SCALED + "max_kl = 0.05\naccept_ratio = 0.9\n",
                {**few, "scaled": True, "max_kl_divergence": 0.05, "accept_ratio": 0.9},
                seed=1,
            ),
        },
    }
    with open("on_policy.json", "w", encoding="utf-8") as file:
        json.dump(document, file, separators=(",", ":"))
        file.write("\n")

