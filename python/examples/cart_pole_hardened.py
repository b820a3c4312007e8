"""Hardens a linear policy of CartPole by random search: poles of other lengths, and actions that
arrive late."""

import pathlib
import tempfile

import gymnasium
import numpy as np

import mishandle
from mishandle import Attribute, Axis, ScenarioEnv

STEPS, CONTROL_DT = 200, 0.02
# Both are shares of what the environment allows.
FORMULA = "always(abs(angle) <= 1 and abs(position) <= 1)"
SIGNALS = {
    "angle": lambda env: env.state[2] / env.theta_threshold_radians,
    "position": lambda env: env.state[0] / env.x_threshold
}


def environment():
    return gymnasium.make("CartPole-v1", max_episode_steps=STEPS)


def space():
    """Returns the axes: the length of the pole, and a delay of the action of up to three control
    steps."""
    faults = mishandle.faults(
        environment(), sensing=False, actuation=False, delays=True, control_dt=CONTROL_DT
    )
    late = [axis for axis in faults if axis.name == "action_delay"]
    return [length(0.25, 1.5), *late]


def length(low, high):
    return Axis("length", low, high, "m", kind="model", nominal=0.5, apply=Attribute("length"))


class Linear:
    """Pushes to the right if a weighted sum of the observation is positive."""

    def __init__(self, weights):
        self.weights = np.asarray(weights, dtype=np.float64)

    def __call__(self, observation):
        return int(self.weights @ observation > 0.0)


def steps_of(env, weights, seed):
    """Returns the number of control steps until the pole falls."""
    policy = Linear(weights)
    observation, _ = env.reset(seed=seed)
    for step in range(1, STEPS + 1):
        observation, _, terminated, truncated, _ = env.step(policy(observation))
        if terminated or truncated:
            return step
    return STEPS


def train(env, weights, spread, *, iterations, candidates, episodes, seed):
    """Improves weights by the cross-entropy method. All candidates of an iteration get the same
    episodes."""
    random = np.random.default_rng(seed)
    mean, deviation = np.array(weights, dtype=np.float64), np.full(len(weights), spread)
    for _ in range(iterations):
        seeds = random.integers(2**31, size=episodes).tolist()
        tried = mean + deviation * random.normal(size=(candidates, len(mean)))
        tried[0] = mean
        scores = [np.mean([steps_of(env, each, seed) for seed in seeds]) for each in tried]
        best = tried[np.argsort(scores)[-candidates // 4 :]]
        mean, deviation = best.mean(axis=0), best.std(axis=0) + 0.02
    return mean


def evaluate(weights, axes, seed, episodes, out):
    """Returns the evaluation of a policy in random scenarios."""
    options = {
        "policy": Linear(weights), "signals": SIGNALS, "termination": "hold",
        "control_dt": CONTROL_DT
    }
    return mishandle.evaluate(
        environment(), FORMULA, axes, episodes=episodes, seed=seed, out=out, name="cart-pole",
        **options
    )


def harden(folder, *, iterations=20, candidates=16, episodes=12, evaluated=1000, seed=0):
    """Trains without scenarios, then with them, and compares both policies on seeds that training
    did not use."""
    sizes = {"iterations": iterations, "candidates": candidates, "episodes": episodes}
    before = train(environment(), np.zeros(4), 1.0, seed=seed, **sizes)
    # Failures to train on; the seeds of the comparison are others.
    archive = folder / "archive.sqlite"
    evaluate(before, space(), seed + 1, evaluated, archive)
    env = ScenarioEnv(environment(), space(), archive, steps=STEPS, control_dt=CONTROL_DT)
    after = train(env, before, 0.3, seed=seed + 2, **sizes)
    env.close()
    found = {}
    for name, axes in (("space", space()), ("nearly nominal", [length(0.49, 0.51)])):
        runs = [folder / f"{name}-{which}.sqlite" for which in ("before", "after")]
        for weights, run in zip((before, after), runs):
            evaluate(weights, axes, seed + 1000, evaluated, run)
        found[name] = mishandle.compare(*runs).success
    return found


def percent(rate):
    return f"{100 * rate.value:.1f} % ({100 * rate.low:.1f} to {100 * rate.high:.1f} %)"


def main():
    with tempfile.TemporaryDirectory() as folder:
        found = harden(pathlib.Path(folder))
    for name, success in found.items():
        print(
            f"{name}: success before {percent(success.first)}, after {percent(success.second)}, n "
            f"= {success.first.n}"
        )
        print(
            f"    difference {percent(success.difference)}; only before {success.first_only}, "
            f"only after {success.second_only}"
        )
        print(f"    p = {success.p_value:.2g}")


if __name__ == "__main__":
    main()
