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
