"""PushT of gym-pusht with an ACT that LeRobot's own program trained, with disturbed images, and the
results of `lerobot-eval`."""

import importlib.metadata
import json
import shutil
import time

import gym_pusht  # noqa: F401
import gymnasium
import numpy as np
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot_commands import lerobot, train
from recording import BUILD, facts_of, fresh, record

import mishandle
from mishandle import Axis
from mishandle.policies.kinds import policy_hash

EPISODES, STEPS, LENGTH, SEED = 10, 300, 60, 1000
FOLDER = BUILD / "pusht"
# The hash of an environment does not cover the objects of pymunk in it.
VERSION = importlib.metadata.version("gym-pusht")
NAMES = ["agent_x", "agent_y", "block_x", "block_y", "block_angle"]
SPACE = [
    Axis("agent_x", 50, 450), Axis("agent_y", 50, 450), Axis("block_x", 100, 400),
    Axis("block_y", 100, 400),
    Axis("block_angle", -np.pi, np.pi, "rad"),
]  # fmt: skip
# The pusher stays off the walls, whether it pushes well or not.
FORMULA = "always(x >= 20 and x <= 492 and y >= 20 and y <= 492)"
SIGNALS = {
    "x": "obs.agent_pos[0]",
    "y": "obs.agent_pos[1]",
    # Its last digits depend on the addresses of shapes.
    "coverage": lambda env: round(env._get_coverage(), 9),
}
torch.set_num_threads(1)


class Starts(gymnasium.Wrapper):
    """PushT that starts from a state with a name for each number."""

    def reset(self, *, seed=None, options=None):
        state = None if options is None else {"reset_to_state": [options[name] for name in NAMES]}
        return self.env.reset(seed=seed, options=state)


def make():
    return Starts(
        gymnasium.make(
            "gym_pusht/PushT-v0", obs_type="pixels_agent_pos", max_episode_steps=LENGTH,
            disable_env_checker=True
        )
    )


def pushing(env):
    """Returns where a pusher goes: behind the block, then to the goal."""
    inner = env.unwrapped
    agent, block, goal = (
        np.array(each) for each in (inner.agent.position, inner.block.position, inner.goal_pose[:2])
    )
    away = (block - goal) / max(np.linalg.norm(block - goal), 1e-6)
    is_behind = np.dot(agent - block, away) > 40
    return np.clip(goal if is_behind else block + 100 * away, 0, 512).astype(np.float32)


def demonstrations():
    features = {
        "observation.image": {
            "dtype": "image", "shape": (96, 96, 3), "names": ["height", "width", "channels"]
        },
        "observation.state": {"dtype": "float32", "shape": (2,), "names": ["x", "y"]},
        "action": {"dtype": "float32", "shape": (2,), "names": ["x", "y"]},
    }
    data = LeRobotDataset.create(
        "mishandle/pusht", fps=10, features=features, root=FOLDER / "data", use_videos=False
    )
    env = make()
    for episode in range(EPISODES):
        observation, _ = env.reset(seed=episode)
        for _ in range(LENGTH):
            action = pushing(env)
            state = observation["agent_pos"].astype(np.float32)
            data.add_frame({
                "observation.image": observation["pixels"], "observation.state": state,
                "action": action, "task": "push"
            })
            observation, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                break
        data.save_episode()
    data.finalize()
    return FOLDER / "data"


def lerobot_evaluation(path, out):
    """Evaluates a policy with LeRobot's own program. Returns the file of its results."""
    env = {"env.type": "pusht", "env.episode_length": LENGTH}
    run = {
        "eval.n_episodes": 5, "eval.batch_size": 1, "policy.device": "cpu", "seed": SEED,
        "output_dir": out
    }
    lerobot("eval", {"policy.path": path, **env, **run})
    return out / "eval_info.json"


def rewards(policy, seed):
    """Returns the rewards of an episode as LeRobot seeds it."""
    env = make()
    observation, _ = env.reset(seed=seed)
    policy.reset()
    found = []
    while True:
        observation, reward, terminated, truncated, _ = env.step(policy(observation))
        found.append(reward)
        if terminated or truncated:
            return found


def main():
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    started = time.time()
    # An episode ends with actions in the queue of the policy, which the next one must not get.
    path = train(
        demonstrations(), FOLDER / "act", STEPS,
        {"policy.chunk_size": 20, "policy.n_action_steps": 8}
    )
    training = {"episodes": EPISODES, "steps": STEPS, "seconds": time.time() - started}
    policy = mishandle.lerobot.policy(path)
    digest = policy_hash(policy)

    # The same episodes as LeRobot's own program.
    file = lerobot_evaluation(path, FOLDER / "eval")
    theirs = json.loads(file.read_text())["per_task"][0]["metrics"]["sum_rewards"]
    ours = [sum(rewards(policy, SEED + episode)) for episode in range(len(theirs))]
    print("sums of rewards, LeRobot's and ours:", theirs, ours)
    assert np.allclose(theirs, ours, rtol=1e-4, atol=1e-4)
    # Its queue of actions is no part of what it is.
    assert policy_hash(policy) == digest != policy_hash(mishandle.lerobot.policy(path, seed=0))
    imported = mishandle.lerobot.read_evaluation(
        file, start_seed=SEED, out=fresh("pusht_lerobot_eval")
    )
    print("lerobot-eval:", imported.success_rate)

    env = make()
    # `env.dt` is the step of the physics, and the policy acts ten times a second.
    target = dict(
        policy=policy, signals=SIGNALS, control_dt=0.1, termination="hold", version=VERSION
    )
    sight = mishandle.sight(env, steps=LENGTH, control_dt=0.1)
    evaluation = mishandle.evaluate(
        env, FORMULA, [*SPACE, *sight], episodes=20, out=fresh("pusht_evaluation"), **target
    )
    run, started = fresh("pusht"), time.time()
    found = mishandle.falsify(
        env, FORMULA, [*SPACE, *sight], trials=2, budget=10, out=run, **target
    )
    seconds, replay = time.time() - started, None
    if found.counterexamples:
        worst = found.counterexamples[0]
        replay = mishandle.replay(
            run, env, FORMULA, [*SPACE, *sight], trial=worst.trial, number=worst.simulation,
            **target
        )
        assert replay.differences == ()
    facts = {
        "environment": "gym_pusht/PushT-v0",
        "policy": "ACT of LeRobot, trained on a scripted pusher",
        "formula": FORMULA,
        "training": training,
        "lerobot_eval": [
            imported.success_rate.value, imported.success_rate.low, imported.success_rate.high,
            imported.success_rate.n
        ],
        "control": None if evaluation.control is None else evaluation.control.success_rate.value,
        **facts_of(found, evaluation, replay, seconds),
    }
    record("pusht", facts, ["lerobot", "gym-pusht", "torch", "gymnasium", "numpy"])


if __name__ == "__main__":
    main()
