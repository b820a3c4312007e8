"""Time that a falsifier adds to each simulation of the same environment, for Mishandle and
Ψ-TaLiRo.

CPU time of the process without the time inside the system. Both get the same function; Mishandle
also gets the environment.
"""

import statistics
import time

import gymnasium
import numpy as np
from recording import fresh, record
from staliro import TestOptions, Trace, blackbox, optimizers, staliro
from staliro.specifications.rtamt import parse_discrete

import mishandle
from mishandle import Axis

STEPS, SIMULATIONS, REPEATS = 200, 200, 5
# Random scenarios do not violate it, so that all simulations are done.
FORMULA = "always(speed <= 100)"
SPACE = [Axis("x_init", 0.1, 3.0), Axis("y_init", 0.1, 1.0)]
clock = time.process_time
inside = 0.0


class Timed(gymnasium.Wrapper):
    """Adds up the time inside the environment."""

    def reset(self, **arguments):
        global inside
        started = clock()
        found = self.env.reset(**arguments)
        inside += clock() - started
        return found

    def step(self, action):
        global inside
        started = clock()
        found = self.env.step(action)
        inside += clock() - started
        return found


ENV = gymnasium.make("Pendulum-v1")
ACTION = np.zeros(1, dtype=np.float32)


def simulate(scenario):
    """The system as a function; its whole time counts as the system's."""
    global inside
    started = clock()
    observation, _ = ENV.reset(seed=0, options=scenario)
    speeds = [float(observation[2])]
    for _ in range(STEPS):
        observation, _, _, _, _ = ENV.step(ACTION)
        speeds.append(float(observation[2]))
    inside += clock() - started
    return {"speed": speeds}


def with_function():
    mishandle.falsify(
        simulate, FORMULA, SPACE, search="random", trials=1, budget=SIMULATIONS,
        out=fresh("overhead")
    )


def with_environment():
    mishandle.falsify(
        Timed(ENV), FORMULA, SPACE, policy=lambda observation: ACTION, signals={"speed": "obs[2]"},
        search="random",
        trials=1, budget=SIMULATIONS, out=fresh("overhead"),
    )  # fmt: skip


def with_a_loop():
    """What a loop over the same steps takes outside the environment, with the clock that this
    script adds."""
    env = Timed(ENV)
    for seed in range(SIMULATIONS):
        observation, _ = env.reset(seed=seed, options={"x_init": 1.0, "y_init": 1.0})
        speeds = [float(observation[2])]
        for _ in range(STEPS):
            observation, _, _, _, _ = env.step(ACTION)
            speeds.append(float(observation[2]))


def with_psy_taliro():
    @blackbox(step_size=0.05)
    def model(inputs):
        speeds = simulate(dict(inputs.static))["speed"]
        return Trace(
            times=[0.05 * sample for sample in range(STEPS + 1)],
            states=[{"speed": speed} for speed in speeds]
        )

    options = TestOptions(
        iterations=SIMULATIONS, static_inputs={axis.name: (axis.low, axis.high) for axis in SPACE}
    )
    staliro(model, parse_discrete("always (speed <= 100)"), optimizers.UniformRandom(), options)


WAYS = {
    "mishandle, function": with_function,
    "psy-taliro, function": with_psy_taliro,
    "mishandle, environment": with_environment,
    "no falsifier, environment": with_a_loop,
}


def main():
    global inside
    milliseconds = {name: [] for name in WAYS}
    for repeat in range(REPEATS + 1):
        for name, run in WAYS.items():
            inside, started = 0.0, clock()
            run()
            if repeat > 0:  # The first is a warm-up.
                milliseconds[name].append((clock() - started - inside) / SIMULATIONS * 1e3)
    medians = {name: statistics.median(values) for name, values in milliseconds.items()}
    facts = {
        "environment": "Pendulum-v1",
        "steps": STEPS,
        "simulations": SIMULATIONS,
        "repeats": REPEATS,
        "milliseconds_per_simulation": medians,
        "ranges": {name: [min(values), max(values)] for name, values in milliseconds.items()},
        "ratio": medians["psy-taliro, function"] / medians["mishandle, function"],
    }
    record("overhead", facts, ["gymnasium", "psy-taliro", "numpy"])


if __name__ == "__main__":
    main()
