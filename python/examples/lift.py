"""robosuite's Lift (on the CPU, without a renderer) with a scripted policy for its
operational-space controller."""

import time

import gymnasium
import numpy as np
import robosuite
from recording import facts_of, fresh, record
from robosuite.controllers import load_composite_controller_config

import mishandle
from mishandle import Attribute, Axis


class Lift(gymnasium.Env):
    """robosuite's own interface as a Gymnasium environment."""

    def __init__(self):
        controller = load_composite_controller_config(controller="BASIC")
        self.sim_env = robosuite.make(
            "Lift", robots="Panda", controller_configs=controller, has_renderer=False,
            has_offscreen_renderer=False,
            use_camera_obs=False, control_freq=20, horizon=1000, ignore_done=True, hard_reset=False,
            seed=0,
        )  # fmt: skip
        low, high = self.sim_env.action_spec
        self.action_space = gymnasium.spaces.Box(low.astype(np.float32), high.astype(np.float32))
        self.observation_space = gymnasium.spaces.Dict()
        self.dt = 0.05

    @property
    def model(self):
        return self.sim_env.sim.model

    @property
    def cube_height(self):
        """Height of the cube's center above the table, in m."""
        body = self.sim_env.sim.data.body_xpos[self.sim_env.cube_body_id]
        return body[2] - self.sim_env.model.mujoco_arena.table_offset[2]

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        # Without it, the placement and the noise of the arm's initial joints depend on earlier
        # resets.
        self.sim_env.rng = np.random.default_rng(seed)
        self.sim_env.placement_initializer.rng = self.sim_env.rng
        for robot in self.sim_env.robots:
            robot.rng = self.sim_env.rng
        return self.sim_env.reset(), {}

    def step(self, action):
        observation, reward, _, info = self.sim_env.step(action)
        return observation, reward, False, False, info


class Lifter:
    """Moves above the cube, down, closes the gripper and lifts."""

    def __init__(self):
        self.reset()

    def reset(self):
        self.steps_closed = 0

    def __call__(self, observation):
        offset = observation["robot0_eef_pos"] - observation["cube_pos"]
        action = np.zeros(7)
        if self.steps_closed > 0 or (np.linalg.norm(offset[:2]) < 0.01 and abs(offset[2]) < 0.012):
            self.steps_closed += 1
            action[6] = 1.0
            action[2] = 0.4 if self.steps_closed > 8 else 0.0
            return action
        target_height = 0.0 if np.linalg.norm(offset[:2]) < 0.015 else 0.08
        error = np.array([*-offset[:2], target_height - offset[2]])
        action[:3] = np.clip(8 * error, -1, 1)
        action[6] = -1.0
        return action


def place(axis):
    def apply(env, value):
        inner = env.unwrapped.sim_env
        pose = inner.sim.data.get_joint_qpos(inner.cube.joints[0]).copy()
        pose[axis] = value
        inner.sim.data.set_joint_qpos(inner.cube.joints[0], pose)
        inner.sim.forward()
        return inner._get_observations(force_update=True)

    return apply


def set_friction(env, value):
    # A contact has the larger friction of its two geoms, so the pads of the gripper are set, too.
    model = env.unwrapped.model
    for name in model.geom_names:
        if "cube" in name or "finger" in name or "pad" in name:
            model.geom_friction[model.geom_name2id(name), 0] = value


ENV = Lift()
CUBE = ENV.sim_env.cube_body_id
SPACE = [
    Axis("cube_x", -0.1, 0.1, "m", apply=place(0)),
    Axis("cube_y", -0.1, 0.1, "m", apply=place(1)),
    Axis(
        "mass", 0.05, 2.0, "kg", kind="model", nominal=0.07,
        apply=Attribute(f"model.body_mass[{CUBE}]")
    ),
    Axis("friction", 0.1, 1.5, kind="model", nominal=1.0, apply=set_friction),
]
# The environment's own success is a cube 4 cm above its start.
FORMULA = "eventually[0:80](always[0:20](height >= 0.06))"
SIGNALS = {"height": ("cube_height", "m")}


def main():
    target = dict(policy=Lifter(), signals=SIGNALS, steps=100)
    # A simulation takes seconds, so there are few, and no evaluation.
    [nominal] = mishandle.simulate(ENV, FORMULA, SPACE, **target)
    run, started = fresh("lift"), time.time()
    found = mishandle.falsify(
        ENV, FORMULA, SPACE, search="dual-annealing", trials=3, budget=15, out=run, **target
    )
    seconds, replay = time.time() - started, None
    if found.counterexamples:
        worst = found.counterexamples[0]
        replay = mishandle.replay(
            run, ENV, FORMULA, SPACE, trial=worst.trial, number=worst.simulation, **target
        )
        print("height of the cube:", np.round(replay.repetition.trace["height"][::5], 3), "m")
    facts = {
        "environment": "Lift",
        "policy": "scripted: grasp and lift",
        "formula": FORMULA,
        "nominal_robustness": nominal.robustness,
        **facts_of(found, None, replay, seconds),
    }
    record("lift", facts, ["robosuite", "mujoco", "gymnasium", "numpy"])


if __name__ == "__main__":
    main()
