"""ACT of LeRobot on our point-reaching task, trained by LeRobot's own program on a data set that
`mishandle.record` wrote."""

import shutil
import time

import gymnasium
import numpy as np
import torch
from lerobot_commands import train
from recording import BUILD, facts_of, fresh, record

import mishandle
from mishandle import Axis, ResetOption

EPISODES, STEPS, SIZE = 20, 300, (32, 32)
FOLDER = BUILD / "point_reaching_lerobot"
FORMULA = "always[50:300](distance <= 0.12)"
SIGNALS = {"distance": ("info.signals.finger_target_distance", "m")}
torch.set_num_threads(1)


def trained():
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    mishandle.record(
        "point-reaching", policy="expert", cameras=["over"], size=SIZE, episodes=EPISODES,
        out=FOLDER / "data"
    )
    return train(
        FOLDER / "data", FOLDER / "act", STEPS,
        {"policy.chunk_size": 100, "policy.n_action_steps": 50}
    )


def make():
    return mishandle.TaskEnv("point-reaching", cameras=["over"], image_size=SIZE)


def check_rows(env, space, target):
    """Checks that two rows of a vector environment act as two environments do: each has its own
    queue of actions."""
    rows = gymnasium.vector.SyncVectorEnv([make, make])
    start, points = "always[20:60](distance <= 0.12)", [[0.1, 0.5, 0.5], [0.9, 0.5, 0.5]]
    alone, together = (
        mishandle.ask.Objective(each, start, space, steps=60, control_dt=env.dt, **target)(points)
        for each in (env, rows)
    )
    print("alone and together:", alone, together)
    assert abs(alone[0] - alone[1]) > 0.01 and np.allclose(alone, together, atol=1e-4)


def main():
    started = time.time()
    policy = mishandle.lerobot.policy(trained())
    training = {"episodes": EPISODES, "steps": STEPS, "seconds": time.time() - started}
    env = make()
    # The initial box of the task, as the data has it.
    space = [
        Axis(name, low, high, "m", apply=ResetOption(f"scenario.{name}"))
        for name, low, high in [
            ("target_x", 0.3, 0.7), ("target_y", -0.4, 0.4), ("target_z", 0.4, 0.8)
        ]
    ]
    target = dict(policy=policy, signals=SIGNALS)
    check_rows(env, space, target)
    evaluation = mishandle.evaluate(
        env, FORMULA, space, episodes=10, out=fresh("point_reaching_lerobot_evaluation"), **target
    )
    run, started = fresh("point_reaching_lerobot"), time.time()
    lit = [*space, *mishandle.sight(env, spaces=["light-3", "image-3"])]
    found = mishandle.falsify(
        env, FORMULA, lit, trials=1, budget=5, plan={"falsify": {"isolate": False}}, out=run,
        **target
    )
    seconds, replay = time.time() - started, None
    if found.counterexamples:
        worst = found.counterexamples[0]
        replay = mishandle.replay(
            run, env, FORMULA, lit, trial=worst.trial, number=worst.simulation, **target
        )
        assert replay.differences == ()
    assert found.largest_difference == 0.0 and evaluation.not_covered == ()
    facts = {
        "environment": "mishandle/PointReaching-v0",
        "policy": "ACT of LeRobot, which sees the state and the camera over the table",
        "formula": FORMULA,
        "training": training,
        **facts_of(found, evaluation, replay, seconds),
    }
    record("point_reaching_lerobot", facts, ["lerobot", "torch", "gymnasium", "numpy"])


if __name__ == "__main__":
    main()
