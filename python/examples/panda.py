"""PandaPush of panda-gym (PyBullet) with a scripted policy: the gripper goes behind the cube and
pushes it to the target."""

import time

import gymnasium
import numpy as np
import panda_gym  # noqa: F401, registers the environments
from recording import facts_of, fresh, record

import mishandle
from mishandle import Axis


def pusher(observation):
    """Moves above the point behind the cube, down, and then through the cube towards the target."""
    gripper, cube = observation["observation"][:3], observation["achieved_goal"]
    to_goal = (observation["desired_goal"] - cube)[:2]
    distance = np.linalg.norm(to_goal)
    direction = to_goal / max(distance, 1e-6)
    offset = (gripper - cube)[:2]
    along, lateral = offset @ direction, offset @ np.array([-direction[1], direction[0]])
    target = np.array([0.0, 0.0, 0.02])
    limit = 1.0
    if distance < 0.01:
        target[:] = gripper
    elif along < -0.03 and abs(lateral) < 0.015 and gripper[2] < 0.04:
        target[:2] = cube[:2] + 0.05 * direction
        limit = np.clip(distance / 0.1, 0.2, 0.6)
    else:
        target[:2] = cube[:2] - 0.08 * direction
        is_above = np.linalg.norm(target[:2] - gripper[:2]) < 0.015
        target[2] = 0.02 if is_above else 0.12
    return np.clip(10 * (target - gripper), -limit, limit).astype(np.float32)


class Fresh(gymnasium.Wrapper):
    """Makes a new environment at each reset (80 ms).

    PyBullet's solver keeps a state that a reset of panda-gym does not clear: without this wrapper,
    two simulations of a scenario differ by millimeters, and Mishandle warns about it.
    """

    def reset(self, **arguments):
        self.env.close()
        self.env = make()
        return super().reset(**arguments)


def make():
    return gymnasium.make("PandaPush-v3", max_episode_steps=100)


def set_position(body, axis):
    """Returns a function that moves the cube or the target after a reset."""

    def apply(env, value):
        inner = env.unwrapped
        position = inner.sim.get_base_position(body)
        position[axis] = value
        inner.sim.set_base_pose(body, position, np.array([0.0, 0.0, 0.0, 1.0]))
        if body == "target":
            inner.task.goal = position
        return inner._get_obs()

    return apply


def set_friction(env, value):
    env.unwrapped.sim.set_lateral_friction("object", link=-1, lateral_friction=value)


# The environment's own ranges of cube and target are ±0.15 m.
SPACE = [
    Axis("cube_x", -0.15, 0.15, "m", apply=set_position("object", 0)),
    Axis("cube_y", -0.15, 0.15, "m", apply=set_position("object", 1)),
    Axis("target_x", -0.15, 0.15, "m", nominal=0.1, apply=set_position("target", 0)),
    Axis("target_y", -0.15, 0.15, "m", nominal=0.1, apply=set_position("target", 1)),
    Axis("friction", 0.1, 1.5, kind="model", nominal=0.5, apply=set_friction),
]
FORMULA = "eventually(distance <= 0.05)"
SIGNALS = {
    "distance": (
        lambda env, observation: np.linalg.norm(
            observation["achieved_goal"] - observation["desired_goal"]
        ),
        "m"
    ),
    "height": ("obs.achieved_goal[2]", "m"),
}


def main():
    env = Fresh(make())
    # The environment terminates at success, and the trace is complete then.
    target = dict(policy=pusher, signals=SIGNALS, termination="evaluate")
    evaluation = mishandle.evaluate(
        env, FORMULA, SPACE, episodes=60, out=fresh("panda_evaluation"), **target
    )
    run, started = fresh("panda"), time.time()
    found = mishandle.falsify(env, FORMULA, SPACE, trials=5, budget=40, out=run, **target)
    seconds, replay = time.time() - started, None
    if found.counterexamples:
        worst = found.counterexamples[0]
        replay = mishandle.replay(
            run, env, FORMULA, SPACE, trial=worst.trial, number=worst.simulation, **target
        )
        trace = replay.repetition.trace
        print("distance of cube and target:", np.round(trace["distance"][::10], 3), "m")
        print("height of the cube:", np.round(trace["height"][::10], 3), "m")
    facts = {
        "environment": "PandaPush-v3",
        "policy": "scripted: go behind the cube, push",
        "formula": FORMULA,
        **facts_of(found, evaluation, replay, seconds),
    }
    record("panda", facts, ["gymnasium", "panda-gym", "pybullet", "numpy"])


if __name__ == "__main__":
    main()
