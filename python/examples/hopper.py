"""Gymnasium's Hopper with a policy of Stable-Baselines3 (PPO, 1 million steps); `--train` trains it
again."""

import sys
import time

import gymnasium
import numpy as np
import torch
from recording import POLICIES, facts_of, fresh, read_training, record, save_training
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecNormalize

import mishandle
from mishandle import Attribute, Axis

STEPS, SEED = 1_000_000, 0
MODEL, MOMENTS = POLICIES / "hopper.zip", POLICIES / "hopper_normalization.pkl"
PACKAGES = ["gymnasium", "mujoco", "stable-baselines3", "torch", "numpy"]
torch.set_num_threads(1)


def train():
    env = VecNormalize(make_vec_env("Hopper-v5", n_envs=8, seed=SEED), gamma=0.99)
    settings = dict(
        n_steps=256, batch_size=128, learning_rate=lambda left: 3e-4 * left,
        policy_kwargs={"log_std_init": -1.0}
    )
    model = PPO("MlpPolicy", env, seed=SEED, device="cpu", **settings)
    started = time.time()
    model.learn(STEPS)
    returns = [episode["r"] for episode in model.ep_info_buffer]
    save_training(
        "hopper", time.time() - started, STEPS, SEED, sum(returns) / len(returns), PACKAGES
    )
    model.save(MODEL, exclude=["policy.optimizer"])
    env.save(str(MOMENTS))


def set_friction(env, value):
    # A contact has the larger friction of its two geoms, so both the foot's and the floor's are
    # set.
    for geom in ("floor", "foot_geom"):
        env.unwrapped.model.geom(geom).friction[0] = value


def push(env, value):
    """Adds to the horizontal velocity of the torso, as a push just before the start would."""
    data = env.unwrapped.data
    velocities = data.qvel.copy()
    velocities[0] += value
    env.unwrapped.set_state(data.qpos.copy(), velocities)
    return env.unwrapped._get_obs()


SPACE = [
    Axis("push", -0.5, 0.5, "m/s", apply=push),
    Axis(
        "torso_mass", 3.3, 4.1, "kg", kind="model", nominal=3.6652,
        apply=Attribute("model.body_mass[1]")
    ),
    Axis("friction", 1.6, 2.0, kind="model", nominal=2.0, apply=set_friction),
    # Gravity along x of 0.2 m/s² is a slope of 1.2°.
    Axis("slope", -0.2, 0.2, "m/s²", kind="model", apply=Attribute("model.opt.gravity[0]")),
]
FORMULAS = {
    "success": "always(height >= 0.7) and eventually(x >= 4)",
    "safe": "height >= 0.7",
}
SIGNALS = {"height": ("data.qpos[1]", "m"), "x": ("data.qpos[0]", "m"), "pitch": ("obs[1]", "rad")}


def main():
    if "--train" in sys.argv:
        train()
    moments = VecNormalize.load(str(MOMENTS), make_vec_env("Hopper-v5", n_envs=1, seed=1000))
    moments.training = moments.norm_reward = False
    # With its environment, the model knows its normalizer of observations, and Mishandle applies
    # it.
    model = PPO.load(MODEL, env=moments, device="cpu")
    mean, deviation = evaluate_policy(model, moments, n_eval_episodes=20)

    # 500 steps are 4 s. The robot may fall: the episode continues, so that formulas have all
    # samples.
    env = gymnasium.make("Hopper-v5", terminate_when_unhealthy=False)
    target = dict(policy=model, signals=SIGNALS, steps=500)
    evaluation = mishandle.evaluate(
        env, FORMULAS, SPACE, episodes=100, out=fresh("hopper_evaluation"), **target
    )
    started = time.time()
    run = fresh("hopper")
    found = mishandle.falsify(
        env, FORMULAS, SPACE, search="dual-annealing", trials=10, budget=50, out=run, **target
    )
    seconds = time.time() - started
    replay = None
    if found.counterexamples:
        worst = found.counterexamples[0]
        replay = mishandle.replay(
            run, env, FORMULAS, SPACE, trial=worst.trial, number=worst.simulation, **target
        )
        trace = replay.repetition.trace
        fell = int(np.argmax(trace["height"] < 0.7)) * env.unwrapped.dt
        print(
            f"falls at {fell:.2f} s" if trace["height"].min() < 0.7 else "does not fall",
            f"at x = {trace['x'][-1]:.2f} m"
        )
    [nominal] = mishandle.simulate(env, FORMULAS, SPACE, **target)
    facts = {
        "environment": "Hopper-v5",
        "policy": f"PPO, {STEPS:,} steps, seed {SEED}",
        "training": read_training("hopper"),
        "return": [float(mean), float(deviation)],
        "formula": FORMULAS["success"],
        "nominal_robustness": nominal.robustness,
        **facts_of(found, evaluation, replay, seconds),
    }
    record("hopper", facts, PACKAGES)


if __name__ == "__main__":
    main()
