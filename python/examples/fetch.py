"""FetchPush of gymnasium-robotics with a scripted policy: the gripper goes behind the object and
pushes it to the goal."""

import time

import gymnasium
import gymnasium_robotics
import numpy as np
from recording import facts_of, fresh, record

import mishandle
from mishandle import Attribute, Axis

gymnasium.register_envs(gymnasium_robotics)


def pusher(observation):
    """Moves above the point behind the object, down, and then through the object towards the
    goal."""
    gripper, thing = observation["observation"][:3], observation["observation"][3:6]
    to_goal = (observation["desired_goal"] - thing)[:2]
    distance = np.linalg.norm(to_goal)
    direction = to_goal / max(distance, 1e-6)
    offset = (gripper - thing)[:2]
    along, lateral = offset @ direction, offset @ np.array([-direction[1], direction[0]])
    target = np.empty(3)
    if distance < 0.01:
        target[:] = gripper
    elif along < -0.03 and abs(lateral) < 0.015 and gripper[2] < thing[2] + 0.03:
        # Also corrects the sideways error, so that the object does not turn away.
        target[:2] = thing[:2] + 0.05 * direction
        target[2] = thing[2]
        speed = np.clip(distance / 0.1, 0.2, 0.6)
        return np.array([*np.clip(10 * (target - gripper), -1, 1) * speed, 0.0], dtype=np.float32)
    else:
        target[:2] = thing[:2] - 0.08 * direction
        is_above = np.linalg.norm(target[:2] - gripper[:2]) < 0.015
        target[2] = thing[2] + (0.0 if is_above else 0.1)
    return np.array([*np.clip(10 * (target - gripper), -1, 1), 0.0], dtype=np.float32)


def set_object(axis):
    def apply(env, value):
        inner = env.unwrapped
        pose = inner._utils.get_joint_qpos(inner.model, inner.data, "object0:joint")
        pose[axis] = inner.initial_gripper_xpos[axis] + value
        inner._utils.set_joint_qpos(inner.model, inner.data, "object0:joint", pose)
        inner._mujoco.mj_forward(inner.model, inner.data)
        # The environment, too, starts with the object at least 0.1 m from the gripper's axis. The y
        # axis is set last.
        if axis == 1 and np.linalg.norm(pose[:2] - inner.initial_gripper_xpos[:2]) < 0.1:
            raise mishandle.InvalidScenario
        return inner._get_obs()

    return apply


def set_goal(axis):
    def apply(env, value):
        inner = env.unwrapped
        inner.goal[axis] = inner.initial_gripper_xpos[axis] + value
        return inner._get_obs()

    return apply


def set_friction(env, value):
    # A contact has the larger friction of its two geoms, so both the object's and the table's are
    # set.
    model = env.unwrapped.model
    for geom in (OBJECT, model.body("table0").geomadr[0]):
        model.geom_friction[geom, 0] = value


def distance(env, observation):
    return np.linalg.norm(observation["achieved_goal"] - observation["desired_goal"])


# 120 steps are 4.8 s.
ENV = gymnasium.make("FetchPush-v4", max_episode_steps=120)
OBJECT = ENV.unwrapped.model.geom("object0").id
BODY = ENV.unwrapped.model.body("object0").id
# The environment's own ranges of object and goal are ±0.15 m around the gripper.
SPACE = [
    Axis("object_x", -0.15, 0.15, "m", nominal=-0.12, apply=set_object(0)),
    Axis("object_y", -0.15, 0.15, "m", apply=set_object(1)),
    Axis("goal_x", -0.15, 0.15, "m", nominal=0.1, apply=set_goal(0)),
    Axis("goal_y", -0.15, 0.15, "m", nominal=0.1, apply=set_goal(1)),
    Axis(
        "mass", 0.5, 4.0, "kg", kind="model", nominal=2.0,
        apply=Attribute(f"model.body_mass[{BODY}]")
    ),
    Axis("friction", 0.3, 1.5, kind="model", nominal=1.0, apply=set_friction),
]
FORMULA = "eventually[0:100](always[0:20](distance <= 0.05))"
SIGNALS = {"distance": (distance, "m"), "height": ("obs.achieved_goal[2]", "m")}


def main():
    target = dict(policy=pusher, signals=SIGNALS)
    evaluation = mishandle.evaluate(
        ENV, FORMULA, SPACE, episodes=100, out=fresh("fetch_evaluation"), **target
    )
    run, started = fresh("fetch"), time.time()
    found = mishandle.falsify(
        ENV, FORMULA, SPACE, search="dual-annealing", trials=5, budget=100, out=run, **target
    )
    seconds, replay = time.time() - started, None
    if found.counterexamples:
        worst = found.counterexamples[0]
        replay = mishandle.replay(
            run, ENV, FORMULA, SPACE, trial=worst.trial, number=worst.simulation, **target
        )
        trace = replay.repetition.trace
        print("distance of object and goal:", np.round(trace["distance"][::10], 3), "m")
        print("height of the object:", np.round(trace["height"][::10], 3), "m")
    facts = {
        "environment": "FetchPush-v4",
        "policy": "scripted: go behind the object, push",
        "formula": FORMULA,
        **facts_of(found, evaluation, replay, seconds),
    }
    record("fetch", facts, ["gymnasium", "gymnasium-robotics", "mujoco", "numpy"])


if __name__ == "__main__":
    main()
