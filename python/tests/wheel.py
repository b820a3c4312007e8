"""Uses an installed wheel: `python wheel.py mujoco mishandle` imports the packages in this order.
See python/test_wheel.sh."""

import dataclasses
import importlib
import pathlib
import sys
import tempfile

for name in sys.argv[1:]:
    importlib.import_module(name)

import mishandle
import mujoco
import numpy as np

# Both libraries are loaded, each from the folder of its own package.
here = pathlib.Path(mishandle.__file__).parent.parent
maps = pathlib.Path("/proc/self/maps").read_text().splitlines()
libraries = {line.split()[-1] for line in maps if "libmujoco" in line}
assert len(libraries) == 2, libraries
assert all(here in pathlib.Path(path).parents for path in libraries), (here, libraries)

# The user's own MuJoCo works.
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body pos='0 0 1'><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
)
data = mujoco.MjData(model)
for _ in range(100):
    mujoco.mj_step(model, data)
fall = 0.5 * 9.81 * data.time**2
assert abs(1 - data.qpos[2] - fall) < 0.02 * fall, data.qpos[2]

# So do a task and a shipped controller.
with tempfile.TemporaryDirectory() as folder:
    found = mishandle.falsify(
        "point-reaching", policy="ppo", search="random", trials=1, budget=10,
        out=f"{folder}/run.sqlite"
    )
    assert found.simulations == 10, found
    # The classes of results are in the wheel, with their types.
    assert (
        isinstance(found, mishandle.results.Falsification)
        and dataclasses.is_dataclass(found.trials[0])
    )
    assert pathlib.Path(mishandle.__file__).with_name("py.typed").is_file()
    table = mishandle.open_run(found.path).columns()
assert np.isfinite(table["robustness"]).all()
print(
    f"{' then '.join(sys.argv[1:])}: mishandle {mishandle.__version__}, mujoco "
    f"{mujoco.__version__}, both work"
)
