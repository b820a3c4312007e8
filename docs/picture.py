"""Draws docs/tasks.png: each task at one moment of an episode.

Run in the repository's root, with the packages mujoco==3.17.0 and pillow, and MUJOCO_GL=egl without a display:
    python docs/picture.py
"""

import subprocess
import tempfile
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

# Task, controller, start, the samples that are drawn over each other, camera (azimuth, elevation, distance, look at).
MOMENTS = [
    ("point-reaching", "expert", [0.6, -0.3, 0.5], 60, (140, -18, 1.9, [0.3, -0.05, 0.5])),
    ("ball-balancing", "expert", [0.45, 0.1], 30, (140, -18, 1.7, [0.25, 0.0, 0.75])),
    ("ball-pushing", "expert", [0.5, 0.05], 95, (140, -25, 2.1, [0.5, 0.0, 0.45])),
]
SIZE = 420


def output(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def draw(task, controller, start, sample, camera):
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.xml"
        output("target/release/mishandle", "tasks", task, "--mjcf", str(scene))
        model = mujoco.MjModel.from_xml_path(str(scene))
    arguments = [task, controller, *map(str, start)]
    rows = output("cargo", "run", "-q", "--example", "one_episode", "--", *arguments).splitlines()
    data = mujoco.MjData(model)
    data.qpos[:] = np.array(rows[sample].split(","), dtype=float)
    if task == "point-reaching":
        data.mocap_pos[0] = start
    mujoco.mj_forward(model, data)
    model.vis.headlight.ambient[:] = 0.45
    view = mujoco.MjvCamera()
    view.azimuth, view.elevation, view.distance = camera[:3]
    view.lookat[:] = camera[3]
    model.vis.global_.offwidth = model.vis.global_.offheight = SIZE
    option = mujoco.MjvOption()
    option.geomgroup[3] = 0
    option.sitegroup[4] = 0
    with mujoco.Renderer(model, SIZE, SIZE) as renderer:
        renderer.update_scene(data, view, option)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 0
        image = renderer.render()
    background = image.sum(axis=2) == 0
    image = image.copy()
    image[background] = 255
    return Image.fromarray(image)


panels = [draw(*moment) for moment in MOMENTS]
picture = Image.new("RGB", (SIZE * len(panels), SIZE), "white")
for i, panel in enumerate(panels):
    picture.paste(panel, (SIZE * i, 0))
picture.quantize(128).save("docs/tasks.png", optimize=True)
