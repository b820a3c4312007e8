"""highway-env with a scripted driver that keeps a time gap and overtakes."""

import time

import gymnasium
import highway_env
import numpy as np
from recording import facts_of, fresh, record

import mishandle
from mishandle import Axis, ResetOption

gymnasium.register_envs(highway_env)
LANES, LANE_WIDTH, CAR_LENGTH, CAR_WIDTH = 3, 4.0, 5.0, 2.0
LEFT, IDLE, RIGHT, FASTER, SLOWER = range(5)


def drive(observation):
    """Keeps a gap of 1 s, changes to a free lane if there is one, and otherwise drives up to 30
    m/s."""
    ego, others = observation[0], observation[1:][observation[1:, 0] > 0]
    y, speed, dx, dy, closing = ego[2], ego[3], others[:, 1], others[:, 2], -others[:, 3]
    ahead = (abs(dy) < LANE_WIDTH / 2) & (dx > 0)
    gap = np.min(dx[ahead] - CAR_LENGTH, initial=np.inf)
    approach = np.max(closing[ahead], initial=0.0)
    if gap > 5.0 + 1.0 * speed + 2.0 * approach:
        return FASTER if speed < 30 else IDLE

    def is_free(side):
        beside = abs(dy - side * LANE_WIDTH) < LANE_WIDTH / 2
        # Cars behind need 10 m and their closing distance in 2 s.
        return not np.any(
            beside & (dx > -10 + 2.0 * np.minimum(closing, 0)) & (
                dx < 15 + 2.0 * np.maximum(closing, 0)
            )
        )

    if y > LANE_WIDTH / 2 and is_free(-1):
        return LEFT
    if y < LANE_WIDTH * (LANES - 1.5) and is_free(1):
        return RIGHT
    return SLOWER


def set_speed(env, value):
    inner = env.unwrapped
    inner.vehicle.speed = value
    return inner.observation_type.observe()


def slow_leader(env, value):
    """Gives the next car in the ego's lane another speed, which it keeps."""
    inner = env.unwrapped
    ego = inner.vehicle
    ahead = [
        car for car in inner.road.vehicles
        if car.lane_index == ego.lane_index and car.position[0] > ego.position[0]
    ]
    if not ahead:
        raise mishandle.InvalidScenario
    leader = min(ahead, key=lambda car: car.position[0])
    leader.speed = leader.target_speed = value
    return inner.observation_type.observe()


def clearance(env):
    """Returns the smallest distance of the ego's rectangle from another, along the axis where it is
    larger, in m."""
    ego = env.vehicle.position
    offsets = [abs(car.position - ego) for car in env.road.vehicles if car is not env.vehicle]
    return min(max(dx - CAR_LENGTH, dy - CAR_WIDTH) for dx, dy in offsets)


SPACE = [
    Axis("cars", 5, 15, values="integer", nominal=8, apply=ResetOption("config.vehicles_count")),
    Axis("density", 0.8, 1.6, nominal=1.0, apply=ResetOption("config.vehicles_density")),
    Axis("ego_speed", 20, 30, "m/s", nominal=25, apply=set_speed),
    Axis("leader_speed", 10, 25, "m/s", nominal=22, apply=slow_leader),
]
FORMULAS = {
    "success": "always(crashed <= 0.5 and clearance >= 0)",
    "strict": "always(crashed <= 0.5 and clearance >= 1) and eventually(traveled >= 400)",
}
SIGNALS = {
    "crashed": "info.crashed",
    "clearance": (clearance, "m"),
    "speed": ("info.speed", "m/s"),
    "traveled": (lambda env: env.vehicle.position[0], "m"),
}


def main():
    observation = {
        "type": "Kinematics", "normalize": False, "absolute": False, "vehicles_count": 8,
        "see_behind": True
    }
    config = {
        "observation": observation, "lanes_count": LANES, "policy_frequency": 2, "duration": 1000
    }
    env = gymnasium.make("highway-fast-v0", config=config)
    # 30 steps are 15 s. The environment states twice its control frequency as `render_fps`, so the
    # step is given here. It terminates at a collision; the last sample is held until the end.
    target = dict(policy=drive, signals=SIGNALS, steps=30, control_dt=0.5, termination="hold")
    evaluation = mishandle.evaluate(
        env, FORMULAS, SPACE, episodes=40, out=fresh("highway_evaluation"), **target
    )
    run, started = fresh("highway"), time.time()
    found = mishandle.falsify(
        env, FORMULAS, SPACE, search="dual-annealing", trials=5, budget=30, out=run, **target
    )
    seconds, replay = time.time() - started, None
    if found.counterexamples:
        worst = found.counterexamples[0]
        replay = mishandle.replay(
            run, env, FORMULAS, SPACE, trial=worst.trial, number=worst.simulation, **target
        )
        for name, values in replay.repetition.trace.items():
            print(name, np.round(values, 1).tolist())
    facts = {
        "environment": "highway-fast-v0",
        "policy": "scripted: keep a gap of 1 s, overtake",
        "formula": FORMULAS["success"],
        **facts_of(found, evaluation, replay, seconds),
    }
    record("highway", facts, ["gymnasium", "highway-env", "numpy"])


if __name__ == "__main__":
    main()
