"""Shows a recorded simulation in MuJoCo's viewer: `viewer.py FOLDER SPEED`. `mishandle render --view` writes the folder."""

import array
import json
import pathlib
import sys
import time

try:
    import mujoco
    import mujoco.viewer
except ImportError:
    sys.exit(3)

SPACE, RIGHT, LEFT = 32, 262, 263


def load(folder):
    facts = json.loads((folder / "scene.json").read_text())
    assets = {name: (folder / f"asset-{index}").read_bytes() for index, name in enumerate(facts["assets"])}
    model = mujoco.MjModel.from_xml_string((folder / "model.xml").read_text(), assets)
    numbers = array.array("d", (folder / "states.f64").read_bytes())
    width = len(numbers) // max(facts["rows"], 1)
    rows = [numbers[row * width : (row + 1) * width] for row in range(facts["rows"])]
    return model, rows, facts["control_dt"]


class Playback:
    """The sample that is shown. Keys change it while another thread draws."""

    def __init__(self, samples):
        self.samples, self.sample, self.is_paused = samples, 0, False

    def key(self, code):
        if code == SPACE:
            self.is_paused = not self.is_paused
        elif code in (RIGHT, LEFT):
            self.is_paused = True
            self.step(1 if code == RIGHT else -1)

    def step(self, steps):
        self.sample = (self.sample + steps) % self.samples


def main(folder, speed):
    model, rows, control_dt = load(pathlib.Path(folder))
    data = mujoco.MjData(model)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    size = mujoco.mj_stateSize(model, kind)
    playback = Playback(len(rows))
    with mujoco.viewer.launch_passive(
        model, data, key_callback=playback.key, show_left_ui=False, show_right_ui=False
    ) as viewer:
        while viewer.is_running():
            start = time.monotonic()
            with viewer.lock():
                mujoco.mj_setState(model, data, list(rows[playback.sample][:size]), kind)
                mujoco.mj_forward(model, data)
            viewer.sync()
            if not playback.is_paused:
                # The last sample stays for a second, so that the end is seen.
                is_last = playback.sample + 1 == playback.samples
                pause = 1.0 if is_last else control_dt / float(speed)
                playback.step(1)
            else:
                pause = 0.02
            time.sleep(max(0.0, pause - (time.monotonic() - start)))


if __name__ == "__main__":
    main(*sys.argv[1:])
