"""Simulates a model with recorded controls; usage: `replay.py FOLDER`, see python.rs."""

import pathlib
import sys

import mujoco
import numpy as np

folder = pathlib.Path(sys.argv[1])
model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
data = mujoco.MjData(model)
kind = int(mujoco.mjtState.mjSTATE_INTEGRATION)
mujoco.mj_setState(model, data, np.fromfile(folder / "first", dtype="<f8"), kind)
controls = np.fromfile(folder / "controls", dtype="<f8").reshape(-1, model.nu)
states = np.empty((len(controls), mujoco.mj_stateSize(model, kind)), dtype="<f8")
for control, state in zip(controls, states):
    data.ctrl[:] = control
    mujoco.mj_step(model, data)
    mujoco.mj_getState(model, data, state, kind)
states.tofile(folder / "states")

# The contact forces in each state: net force between each pair of parts, and the largest force at a
# point. A line of the file `parts` has a part and its bodies; a line of `pairs` has two parts.
parts = {}
for line in (folder / "parts").read_text().splitlines():
    part, *bodies = line.split()
    parts |= {mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body): part for body in bodies}
pairs = [tuple(line.split()) for line in (folder / "pairs").read_text().splitlines()]
forces = np.zeros((len(states), len(pairs) + 1), dtype="<f8")
other = mujoco.MjData(model)
for state, row in zip(states, forces):
    mujoco.mj_setState(model, other, state, kind)
    mujoco.mj_forward(model, other)
    net = {pair: np.zeros(3) for pair in pairs}
    for index, contact in enumerate(other.contact):
        first, second = (parts[model.geom_bodyid[geom]] for geom in contact.geom)
        local = np.zeros(6)
        mujoco.mj_contactForce(model, other, index, local)
        force = contact.frame.reshape(3, 3).T @ local[:3]
        if (first, second) in net:
            net[first, second] += force
        elif (second, first) in net:
            net[second, first] -= force
        else:
            continue
        row[-1] = max(row[-1], np.linalg.norm(force))
    row[:-1] = [np.linalg.norm(net[pair]) for pair in pairs]
forces.tofile(folder / "forces")
