"""Writes a recording for Rerun and reads it back with Rerun's own reader: ``python
python/tests/rerun_check.py``.

It is not one of the tests that run with all others, because ``pip install '.[rerun]'`` takes half a
gigabyte.
"""

import os
import pathlib
import tempfile

import mishandle
import mujoco
import numpy as np
from mishandle import _native
from rerun.chunk import RrdReader


def columns(path):
    """Returns, by entity and component, pairs of the time in seconds and the value; the time of a
    static value is None."""
    found = {}
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        names = batch.schema.names
        times = [None] * batch.num_rows
        if "time" in names:
            # Nanoseconds.
            times = [scalar.value / 1e9 for scalar in batch["time"]]
        assert not {"log_time", "log_tick"} & set(names), names
        for name in set(names) - {"time"}:
            found.setdefault((chunk.entity_path, name.rpartition(":")[2]), []).extend(
                zip(times, batch[name].to_pylist())
            )
    return found


def series(found, entity, component, shape):
    rows = sorted((time, value) for time, value in found[entity, component] if time is not None)
    return np.array([time for time, _ in rows]), np.array([
        value for _, value in rows
    ]).reshape(shape)


def main():
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        result = mishandle.falsify(
            "ball-balancing", policy="ppo", space="delay", trials=1, budget=50, out="run.sqlite"
        )
        assert result.counterexamples
        path = mishandle.runs.to_rerun(result, pathlib.Path(folder) / "run.rrd")
        scene = _native.recorded_states(
            "run.sqlite", trial=None, number=None, controller=None, target=None, nominal=True
        )
        found = columns(path)
        model = mujoco.MjModel.from_binary_path("scene.mjb", {"scene.mjb": scene["model"]})
        data, kind = mujoco.MjData(model), mujoco.mjtState.mjSTATE_INTEGRATION
        size = mujoco.mj_stateSize(model, kind)
        for root, episode in zip(("failure", "nominal"), scene["episodes"]):
            samples, dt = len(episode["states"]), scene["control_dt"]
            # The position of each body, computed from the recorded state by MuJoCo itself.
            for name in [model.body(index).name for index in range(1, model.nbody)]:
                times, positions = series(
                    found, f"/{root}/bodies/{name}", "translation", (samples, 3)
                )
                assert np.allclose(times, np.arange(samples) * dt, atol=1e-6), times
                for sample in (0, samples // 2, samples - 1):
                    mujoco.mj_setState(
                        model, data, np.ascontiguousarray(episode["states"][sample][:size]), kind
                    )
                    mujoco.mj_kinematics(model, data)
                    assert np.allclose(positions[sample], data.body(name).xpos, atol=1e-6), (
                        root, name, sample
                    )
            # Each signal has the values of the trace.
            for index, name in enumerate(episode["names"]):
                _, values = series(found, f"/{root}/signals/{name}", "scalars", (samples,))
                assert np.array_equal(values, episode["trace"][:, index]), (root, name)
            # When the whole episode is known, both bounds are its robustness.
            for bound in ("low", "high"):
                rows = sorted(
                    (time, value) for time, value in found[f"/{root}/robustness/{bound}", "scalars"]
                    if time is not None
                )
                assert np.isclose(rows[-1][1][0], episode["robustness"]), (
                    root, bound, rows[-1], episode["robustness"]
                )
        (failure, nominal) = scene["episodes"]
        assert failure["robustness"] < 0 < nominal["robustness"]
        # The weight of what rests on the robot and the ground is carried by contacts.
        largest = max(value[0] for _, value in found["/failure/contact_force", "scalars"])
        assert largest > 0
        print(
            f"{path.stat().st_size} bytes, {len({entity for entity, _ in found})} entities: "
            "positions, signals and robustness agree"
        )


if __name__ == "__main__":
    main()
