"""Tests of vector environments as systems."""

import time

from cases import FolderCase
import gymnasium
import mishandle
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from mishandle import Attribute, Axis, InvalidScenario, ResetOption


class Cart(gymnasium.Env):
    """A cart whose position grows by `speed` in each step; the reward is the step number."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float64)
    action_space = gymnasium.spaces.Discrete(2)
    speed = 1.0

    def __init__(self, limit=1000.0):
        self.limit = limit

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        start = (options or {}).get("start", 0.0)
        if start > 0.9:
            raise InvalidScenario("behind the wall")
        if start > 0.6:
            raise RuntimeError("motor")
        self.position, self.steps, self.slow = start, 0, (options or {}).get("slow", 0.0)
        return self.observation(), {"part": {"position": self.position}}

    def step(self, action):
        time.sleep(self.slow)
        self.steps += 1
        self.position += self.speed * (1 if action == 1 else 0)
        info = {"part": {"position": self.position}}
        return self.observation(), float(self.steps), self.position >= self.limit, False, info

    def observation(self):
        return np.array([self.position, self.speed])


def small_cart():
    return Cart(limit=3.0)


SPACE = [Axis("start", 0.0, 1.0), Axis("speed", 0.0, 2.0, kind="model", apply=Attribute("speed"))]
SIGNALS = {"x": ("obs[0]", "m"), "inside": "info.part.position", "reward": "reward"}
KINDS = dict(policy=lambda observation: 1, signals=SIGNALS, steps=5, control_dt=0.1)


class Vectors(FolderCase):
    def vector(self, functions, **options):
        env = AsyncVectorEnv(functions, **options)
        self.addCleanup(env.close)
        return env

    def test_processes_give_the_rows_of_a_single_environment(self):
        options = dict(
            search="random", trials=2, budget=12, plan={"falsify": {"batch": 5}}, termination="hold"
        )
        runs = []
        for number, env in enumerate(
            [small_cart()] + [SyncVectorEnv([small_cart] * 3)] + [
                self.vector([small_cart] * 3, autoreset_mode=mode) for mode in AutoresetMode
            ] + [self.vector([small_cart] * 2, shared_memory=False), self.vector([small_cart])]
        ):
            path = self.folder / f"{number}.sqlite"
            found = mishandle.falsify(env, "always(x <= 4)", SPACE, out=path, **options, **KINDS)
            run = mishandle.open_run(path)
            traces = [run.trace(one.trial, one.simulation) for one in found.counterexamples]
            runs.append(
                (
                    run.columns(),
                    [{name: column.tolist() for name, column in trace.items()} for trace in traces]
                )
            )
        columns, traces = runs[0]
        self.assertTrue(
            {"invalid scenario", "crashed", "terminated"} <= set(columns["end"]),
            set(columns["end"])
        )
        self.assertGreater(len(traces), 0)
        for other in runs[1:]:
            self.assertEqual(other, runs[0])

    def test_our_native_vector_environments_give_the_bits_of_single_ones(self):
        names = [("target_x", 0.3, 0.7), ("target_y", -0.4, 0.4), ("target_z", 0.2, 0.8)]
        space = [
            Axis(name, low, high, "m", apply=ResetOption(f"scenario.{name}"))
            for name, low, high in names
        ]
        kinds = dict(
            policy=mishandle.load_controller("point-reaching/ppo"),
            signals={"distance": ("info.signals.finger_target_distance", "m"), "reward": "reward"},
            steps=20,
        )
        runs = []
        for number, env in enumerate([
            mishandle.TaskEnv("point-reaching"), mishandle.TaskVectorEnv("point-reaching", 4)
        ]):
            path = self.folder / f"{number}.sqlite"
            options = dict(
                search="random", trials=1, budget=6, plan={"falsify": {"batch": 6}}, out=path
            )
            mishandle.falsify(env, "always(distance >= 0.2)", space, **options, **kinds)
            runs.append(mishandle.open_run(path).columns())
        self.assertEqual(*runs)

    def test_a_time_limit_ends_one_simulation(self):
        space = [Axis("slow", 0.0, 1.0, nominal=0.0)]
        env = self.vector([Cart] * 2)
        found = [
            mishandle.simulate(
                env, "always(x >= 0)", space, at={"slow": slow}, time_limit=2.0, **KINDS
            )[0].end
            for slow in (0.0, 1.0)
        ]
        self.assertEqual(found, ["completed", "timed out in control step 0"])

    def test_what_is_out_of_reach_is_refused(self):
        env = self.vector([Cart] * 2)

        def check(message, env=env, space=SPACE, **changes):
            with self.assertRaises(mishandle.MishandleError) as raised:
                mishandle.simulate(env, "always(x >= 0)", space, **{**KINDS, **changes})
            self.assertIn(message, str(raised.exception))

        check("signal `x` is a function", signals={"x": lambda env: env.position})
        check("signal `x` is 'position'", signals={"x": "position"})
        check(
            "can set whole attributes only",
            space=[Axis("a", 0, 1, apply=Attribute("model.mass[0]"))]
        )
        check("no attribute 'sped'", space=[Axis("a", 0, 1, apply=Attribute("sped"))])
        check("applied by a function", space=[Axis("a", 0, 1, apply=lambda env, value: None)])
        task = mishandle.TaskVectorEnv("point-reaching", 2)
        check(
            "applied by an attribute", env=task, signals={"x": "reward"},
            space=[Axis("a", 0, 1, apply=Attribute("dt"))]
        )

    def test_a_vector_environment_that_ignores_masks_is_refused(self):
        class NoMasks(gymnasium.vector.VectorWrapper):
            def reset(self, *, seed=None, options=None):
                options = {
                    key: value for key, value in (options or {}).items() if key != "reset_mask"
                }
                return self.env.reset(seed=seed, options=options)

        env = NoMasks(SyncVectorEnv([Cart] * 2))
        with self.assertRaisesRegex(TypeError, "NoMasks ignores the option 'reset_mask'"):
            mishandle.simulate(env, "always(x >= 0)", [Axis("start", 0, 0.5)], **KINDS)

    def test_a_wrapper_of_a_vector_environment_is_not_skipped(self):
        class Doubled(gymnasium.vector.VectorObservationWrapper):
            def observations(self, observations):
                return 2 * observations

        env = Doubled(SyncVectorEnv([Cart] * 2))
        [found] = mishandle.simulate(
            env, "always(x >= 0)", [Axis("start", 0, 0.5)], at=[0.25], **KINDS
        )
        self.assertEqual(found.trace["x"].tolist(), [0.5, 2.5, 4.5, 6.5, 8.5, 10.5])
