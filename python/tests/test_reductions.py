"""Signals that reduce several values of a control step."""

import unittest
from typing import Any

import gymnasium
import mishandle
import mujoco
import numpy as np
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
from mishandle import Axis
from mishandle.errors import InvalidStateError, InvalidTypeError, InvalidValueError
from mishandle.systems import Reduced

# A ball falls 5 cm onto the ground.
MODEL = """<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom type="plane" size="1 1 0.1" solref="0.005 1"/>
    <body name="ball" pos="0 0 0.1"><freejoint/>
      <geom type="sphere" size="0.05" mass="0.2" solref="0.005 1"/></body>
  </worldbody>
</mujoco>"""

SPACE = [Axis("height", 0.0, 0.1, "m", nominal=0.0)]


class Ball(gymnasium.Env[Any, Any]):
    """A ball on the ground, in control steps of 50 physics steps."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space = gymnasium.spaces.Box(-1, 1, (1,))
    metadata: dict[str, Any] = {}
    dt = 0.05

    def __init__(self, at_once: bool = True, reports: bool = False) -> None:
        self.model = mujoco.MjModel.from_xml_string(MODEL)
        self.data = mujoco.MjData(self.model)
        self.other = mujoco.MjData(self.model)
        self.at_once, self.reports = at_once, reports
        self.forces: list[float] = []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[2] += (options or {}).get("height", 0.0)
        mujoco.mj_forward(self.model, self.data)
        return self.data.qpos[2:3].copy(), {"forces": [0.0]} if self.reports else {}

    def step(self, action: Any) -> Any:
        forces = []
        # A planner simulates the future with other data.
        mujoco.mj_step(self.model, self.other, nstep=10)
        if self.at_once and not self.reports:
            mujoco.mj_step(self.model, self.data, nstep=50)
        else:
            for _ in range(50):
                mujoco.mj_step(self.model, self.data)
                forces.append(contact(self))
        return (
            self.data.qpos[2:3].copy(), 0.0, False, False,
            {"forces": forces} if self.reports else {}
        )


def contact(env: Any) -> float:
    """Returns the largest normal force, N."""
    force = np.zeros(6)
    largest = 0.0
    for index in range(env.data.ncon):
        mujoco.mj_contactForce(env.model, env.data, index, force)
        largest = max(largest, float(force[0]))
    return largest


class StepsItself(Ball):
    """Does not call MuJoCo."""

    def step(self, action: Any) -> Any:
        return self.data.qpos[2:3].copy(), 0.0, False, False, {}


def traces(environment: Any, signals: dict[str, Any]) -> dict[str, Any]:
    [episode] = mishandle.simulate(
        environment, f"always({next(iter(signals))} >= -1000)", SPACE,
        policy=lambda observation: np.zeros(1), signals=signals, steps=8
    )
    return episode.trace


def expected() -> tuple[list[list[float]], list[float]]:
    """Returns the forces of all physics steps of each control step, by a loop of its own, and the
    heights."""
    env = Ball()
    env.reset()
    forces, heights = [[0.0]], [float(env.data.qpos[2])]
    for _ in range(8):
        found = []
        for _ in range(50):
            mujoco.mj_step(env.model, env.data)
            found.append(contact(env))
        forces.append(found)
        heights.append(float(env.data.qpos[2]))
    return forces, heights


class Reductions(unittest.TestCase):
    def test_peaks_between_control_steps_are_seen(self) -> None:
        forces, heights = expected()
        for environment in (Ball(), Ball(at_once=False), SyncVectorEnv([Ball, Ball])):
            found = traces(
                environment,
                {
                    "peak": (Reduced("max", contact), "N"), "least": Reduced("min", contact),
                    "mean": Reduced("mean", contact),
                    "sum": Reduced("sum", contact), "now": contact, "height": "data.qpos[2]",
                    "lowest": Reduced("min", "data.qpos[2]"),
                },
            )
            for name, reduce in (("peak", max), ("least", min), ("sum", sum), ("mean", np.mean)):
                np.testing.assert_allclose(
                    found[name], [reduce(part) for part in forces], rtol=1e-12
                )
            # The physics has the same bits.
            self.assertEqual(list(found["height"]), heights)
            self.assertEqual(list(found["now"]), [part[-1] for part in forces])
            # The impact is invisible without the reduction.
            self.assertGreater(found["peak"].max(), 2 * found["now"].max())
            self.assertLess(found["lowest"].min(), found["height"].min())

    def test_the_function_of_mujoco_is_its_own_again(self) -> None:
        before = (mujoco.mj_step, mujoco.mj_step2)
        traces(Ball(), {"peak": Reduced("max", contact)})
        self.assertEqual(before, (mujoco.mj_step, mujoco.mj_step2))

    def test_a_list_of_info_is_reduced(self) -> None:
        forces, _ = expected()
        for environment in (Ball(reports=True), AsyncVectorEnv([lambda: Ball(reports=True)] * 2)):
            found = traces(
                environment,
                {"peak": Reduced("max", "info.forces"), "total": Reduced("sum", "info.forces")}
            )
            np.testing.assert_allclose(found["peak"], [max(part) for part in forces], rtol=1e-12)
            np.testing.assert_allclose(found["total"], [sum(part) for part in forces], rtol=1e-12)
            environment.close()

    def test_mistakes_are_errors(self) -> None:
        with self.assertRaisesRegex(
            InvalidValueError, "over is 'median'; it must be one of max, min, mean, sum"
        ):
            Reduced("median", contact)
        with self.assertRaisesRegex(InvalidTypeError, "does not have several values"):
            Reduced("max", "reward")
        with self.assertRaisesRegex(
            InvalidStateError, "called neither mujoco.mj_step nor mujoco.mj_step2"
        ):
            traces(StepsItself(), {"peak": Reduced("max", contact)})
        with self.assertRaisesRegex(
            InvalidStateError, "expected a list of the values in the control step"
        ):
            traces(Ball(), {"peak": Reduced("max", "obs[0]")})
        with self.assertRaisesRegex(InvalidTypeError, "it has no observation there"):
            traces(Ball(), {"peak": Reduced("max", lambda env, observation: 0.0)})
        vector = AsyncVectorEnv([Ball])
        with self.assertRaisesRegex(
            InvalidValueError, "the source of the signal `peak` is a function"
        ):
            traces(vector, {"peak": Reduced("max", contact)})
        vector.close()
