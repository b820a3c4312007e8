"""3-D replays in pages of environments with a MuJoCo model."""

import base64
import hashlib
import json
import re
import struct
import sys
import types
import zlib
from typing import Any

from cases import FolderCase
import gymnasium
import mishandle
import mujoco
import numpy as np
from mishandle import Axis

SCENE = """<mujoco><option timestep="0.01"/><asset>
<mesh name="hat" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1"/>
<hfield name="hills" nrow="3" ncol="4" size="2 1 .2 .1" elevation="0 0 0 0 0 1 1 0 0 0 0 0"/>
</asset><worldbody>
<geom type="hfield" hfield="hills" pos="0 3 -1"/>
<body name="post &amp; sign" pos="0 .5 0"><geom type="box" size=".05 .05 .2" rgba="1 0 0 1"/></body>
<body name="cart"><joint name="slide" type="slide" axis="1 0 0" range="-2 2" limited="true"/>
<geom type="box" size=".1 .05 .05"/>
<body name="pole" pos="0 0 .05"><joint type="hinge" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 .6" size=".02"/>
<geom type="mesh" mesh="hat" pos=".1 0 .6" mass="1e-4"/></body></body>
<body name="ball" pos="0 -.5 .5"><freejoint/><geom size=".05"/></body>
<body name="mark" mocap="true"><site size=".02"/></body>
</worldbody><actuator><motor joint="slide" gear="10"/></actuator></mujoco>"""


class Cart(gymnasium.Env[Any, Any]):
    """A pole on a cart, with a model of its own; the mark follows its tip."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))
    dt = 0.05

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(SCENE)
        self.data = mujoco.MjData(self.model)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[1] = (options or {}).get("lean", 0.0)
        self.data.qvel[2:] = [0.1, 0.2, 0.3, 4.0, 5.0, 6.0]
        return np.array([self.data.qpos[1]]), {}

    def step(self, action: Any) -> Any:
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data, 5)
        self.data.mocap_pos[0] = [0.6 * np.sin(self.data.qpos[1]), 0.0, 0.7]
        return np.array([self.data.qpos[1]]), 0.0, False, False, {}


def blocks(page: str) -> list[tuple[dict[str, Any], bytes]]:
    """Returns head and bytes of each block of a page."""
    found = []
    for text in re.findall(r"<template>([^<]*)</template>", page):
        data = zlib.decompress(base64.b64decode(text))
        end = 4 + struct.unpack("<I", data[:4])[0]
        found.append((json.loads(data[4:end]), data[end:]))
    return found


def poses(scene: dict[str, Any], head: dict[str, Any], data: bytes) -> dict[str, Any]:
    """Returns the poses of each body at each sample of a simulation, as the script reads them."""
    at = 0

    def column(width: float) -> list[float]:
        nonlocal at
        values, total = [], 0
        for _ in range(head["samples"]):
            value, shift = 0, 0
            while True:
                byte = data[at]
                at, value, shift = at + 1, value | (byte & 127) << shift, shift + 7
                if byte < 128:
                    break
            total += -(value + 1) // 2 if value % 2 else value // 2
            values.append(total * width)
        return values

    widths = [scene["grid"]] * 3 + [1 / 32767] * 4
    return {name: np.array([column(width) for width in widths]).T for name in scene["bodies"]}


def bodies(model: Any, positions: Any, mark: Any = None) -> list[Any]:
    """Returns position and quaternion of each body, from MuJoCo's Python."""
    state = mujoco.MjData(model)
    state.qpos[:] = positions
    if mark is not None:
        state.mocap_pos[:] = mark
    mujoco.mj_forward(model, state)
    return list(zip(state.xpos.copy(), state.xquat.copy()))


def simulated(lean: float, steps: int) -> list[Any]:
    """Returns the bodies of a cart at each sample."""
    env, found = Cart(), []
    observation, _ = env.reset(options={"lean": lean})
    for step in range(steps + 1):
        if step > 0:
            observation = env.step(push(observation))[0]
        found.append(bodies(env.model, env.data.qpos, env.data.mocap_pos))
    return found


def push(observation: Any) -> Any:
    return [0.1 * observation[0]]


def balance(observation: Any) -> Any:
    """Balances an inverted pendulum."""
    x, angle, v, turn = observation
    return np.clip([0.3 * x + 6.0 * angle + 0.4 * v + 1.0 * turn], -3.0, 3.0)


class Replays(FolderCase):
    def page(self, env: Any, formula: str, space: list[Axis], **options: Any) -> tuple[str, Any]:
        found = mishandle.falsify(
            env, formula, space, search="random", trials=1, budget=20,
            out=self.folder / "run.sqlite", **options
        )
        self.assertEqual(found.falsified_trials, 1)
        plan = {"report": {"replay": True, "probes": 0}}
        found.report(self.folder / "page.html", plan=plan)
        return (self.folder / "page.html").read_text(), found

    def check(self, page: str, role: str, truth: list[Any], model: Any) -> None:
        """Checks the poses of a simulation at five instants."""
        [scene, _], *simulations = blocks(page)
        index = [each["role"] for each in scene["simulations"]].index(role)
        found = poses(scene, *simulations[index])
        last = min(simulations[index][0]["samples"], len(truth)) - 1
        self.assertGreaterEqual(last, 4)
        for sample in [0, last // 4, last // 2, 3 * last // 4, last]:
            for name, rows in found.items():
                place, turn = truth[sample][model.body(name).id]
                p, q = rows[sample][:3], rows[sample][3:]
                self.assertLess(np.linalg.norm(p - place), 1e-4, (role, name, sample))
                angle = 2 * np.arccos(min(abs(q @ turn) / np.linalg.norm(q), 1.0))
                self.assertLess(angle, 1e-3, (role, name, sample))

    def check_policy(self, page: str) -> None:
        [script] = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        self.assertIn(f"script-src 'sha256-{digest}'", page)

    def test_a_page_has_the_poses_of_mujoco(self) -> None:
        page, found = self.page(
            Cart(), "always(abs(lean) <= 1)", [Axis("lean", 0.0, 0.8, nominal=0.0)], policy=push,
            steps=20, signals={"lean": "data.qpos[1]"}
        )
        self.check_policy(page)
        lean = found.trials[0].cause.scenario["lean"]
        for role, value in [("minimal", lean), ("ghost", 0.0)]:
            self.check(page, role, simulated(value, 20), Cart().model)
        scene, data = blocks(page)[0]
        self.assertIn("post & sign", scene["bodies"])
        kinds = [shape["kind"] for shape in scene["shapes"]]
        # A scene without a plane gets one.
        self.assertEqual(
            sorted(kinds),
            ["box", "box", "capsule", "mesh", "mesh", "plane", "sphere", "sphere"]
        )
        names = [scene["bodies"][body] for body in scene["traced"]]
        self.assertEqual((names, scene["isMobile"]), (["pole", "ball"], False))
        [first, count] = scene["meshes"][0]["vertices"]
        hills = np.frombuffer(data[4 * first : 4 * (first + count)], "<f4").reshape(-1, 3)
        # MuJoCo turns a mesh to its axes of inertia; its shape turns it back.
        [shape] = [shape for shape in scene["shapes"] if shape["mesh"] == 0]
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, shape["quaternion"])
        placed = hills @ turn.reshape(3, 3).T + shape["position"]
        corners = [(placed.min(axis=0), [-2, 2, -1]), (placed.max(axis=0), [2, 4, -0.8])]
        for found, expected in corners:
            self.assertTrue(np.allclose(found, expected, atol=1e-5), found)

    def test_an_axis_that_changes_shapes_has_a_note(self) -> None:
        size = "model.geom_size[2][0]"
        axis = Axis("size", 0.05, 0.2, nominal=0.05, apply=mishandle.Attribute(size))
        page, _ = self.page(
            Cart(), "always(size <= 0.1)", [axis], policy=push, steps=5, signals={"size": size}
        )
        self.assertIn("An axis changes shapes of the scene", page)

    def test_an_environment_of_gymnasium_has_a_replay(self) -> None:
        # Gymnasium imports it to write pictures to files, which nothing here does.
        sys.modules.setdefault("imageio", types.ModuleType("imageio"))
        try:
            env = gymnasium.make("InvertedPendulum-v5", max_episode_steps=100)
        except Exception as error:
            self.skipTest(f"gymnasium[mujoco] is not whole: {error}")
        axis = Axis("turn", 0.0, 4.0, nominal=0.0, apply=mishandle.Attribute("init_qvel[1]"))
        signals = {"x": "data.qpos[0]", "angle": "data.qpos[1]"}
        page, _ = self.page(
            env, "always(abs(angle) <= 0.1)", [axis], policy=balance, signals=signals
        )
        self.check_policy(page)
        [scene, _], *simulations = blocks(page)
        order = [[signal["name"] for signal in scene["signals"]].index(name) for name in signals]
        model = env.unwrapped.model
        for role in ["minimal", "ghost"]:
            index = [each["role"] for each in scene["simulations"]].index(role)
            head, data = simulations[index]
            series = np.frombuffer(data[head["integers"] :], "<f4").reshape(-1, head["values"])
            positions = series[len(scene["predicates"]) :][order].T
            self.check(page, role, [bodies(model, each) for each in positions], model)

    def test_other_systems_have_no_replay(self) -> None:
        page, _ = self.page(
            lambda scenario: {"x": scenario["speed"] * np.arange(5.0)}, "always(x <= 2)",
            [Axis("speed", 0.0, 1.0, nominal=0.0)]
        )
        self.assertNotIn("<script>", page)
