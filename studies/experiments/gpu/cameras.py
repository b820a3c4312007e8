"""Speed of the cameras on a GPU, and differences of their images from those of the CPU.

    python studies/experiments/gpu/cameras.py dump FOLDER       on any machine: states of the expert, scenarios and the images of the CPU
    python studies/experiments/gpu/cameras.py measure FOLDER    on a machine with a GPU; prints a line of JSON per figure

``measure`` needs Warp, NumPy and the modules of the folder ``mishandle/gpu/cameras`` only.
"""

from __future__ import annotations

import contextlib
import io
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

TASKS = ("point-reaching", "cube-stacking", "peg-in-hole", "ball-balancing", "ball-catching", "ball-pushing", "door-opening")
TASKS += ("cloth-placing", "cloth-placing-7x7")
STATES = 64
SETS = {"nominal": 32, "hard": 32, "all": 12}
"""Scenarios of each set: nominal; random with hard shadows and one ray per pixel; random on all axes."""

REPEATS = 7
ROWS = 8192
"""States of a timed call, of two cameras each."""

ROW_NAMES = ("shapes", "lamps", "sky", "cameras")


def episode_states(task: str, episodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns states of episodes of the expert, and those one control step before."""
    from mishandle import _native

    now, before = [], []
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run.mishandle"
        command = ["mishandle", "evaluate", task, "--controller", "expert", "--episodes", str(episodes), "--seed", "48", "--out", str(run)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for number in range(1, episodes + 1):
            found = _native.recorded_states(run, trial=None, number=number, controller=None, target=None, nominal=False)
            states = found["episodes"][0]["states"]
            steps = np.linspace(1, len(states) - 1, STATES // episodes).astype(int)
            now.append(states[steps])
            before.append(states[steps - 1])
    return np.concatenate(now), np.concatenate(before)


def dump(folder: Path) -> None:
    from mishandle.gpu.cameras import Cameras

    folder.mkdir(parents=True, exist_ok=True)
    for task in TASKS:
        cameras = Cameras(task, device="cpu")
        native = cameras._native
        states, before = episode_states(task, 4)
        out = {"tables": native.compression_tables()}
        out |= dict(zip(("bodies", "vertices"), native.poses(states)))
        out |= dict(zip(("before_bodies", "before_vertices"), native.poses(before)))
        out |= dict(zip(("triangles", "nodes", "vertex_bodies", "places"), native.cloths()))
        for name, count in SETS.items():
            values = native.values([{}] * count) if name == "nominal" else cameras.draw(48, count)
            if name == "hard":
                for axis in ("lens_aperture", "shutter", "lamp_radius"):
                    values[:, cameras.axes.index(axis)] = 0.0
            starts, places = states[:count], np.arange(count)
            out |= {f"{name}_{row}": array for row, array in zip(ROW_NAMES, native.rows(values, starts))}
            numbers = [places.astype(np.int32), places.astype(np.uint64) + 7, places.astype(np.uint64)]
            images = native.images(states[:count], before[:count], values, starts, *numbers)
            out[f"{name}_images"] = images.reshape(2 * count, 64, 64, 3)
        np.savez_compressed(folder / f"{task}.npz", **out)
        print(task, {name: array.shape for name, array in out.items() if name.endswith("shapes")}, flush=True)


def renderer(found: dict[str, np.ndarray], device: str, size: int = 64):
    from mishandle.gpu.cameras.renderer import Renderer

    cloths = tuple(found[name] for name in ("triangles", "nodes", "vertex_bodies", "places"))
    return Renderer(device, (size, size), [0, 1], cloths, found["tables"])


def differences(found: dict[str, np.ndarray], name: str, device: str) -> dict[str, object]:
    """Compares images of a set with those of the CPU: shares of pixels by their largest difference of red, green and blue."""
    from mishandle.gpu.cameras.renderer import wp

    own = renderer(found, device)
    count = SETS[name]
    poses, before = (own.poses(found[f"{part}bodies"][:count], found[f"{part}vertices"][:count]) for part in ("", "before_"))
    sights = own.sights({row: found[f"{name}_{row}"] for row in ROW_NAMES})
    places = np.arange(count)
    rows, steps = wp.array(places.astype(np.int32), device=device), wp.array(places.astype(np.uint64), device=device)
    seeds = wp.array(places.astype(np.uint64) + 7, device=device)
    images = own.render(poses, sights, rows, seeds, steps, before=before).numpy()
    expected = found[f"{name}_images"]
    change = np.abs(images.astype(int) - expected.astype(int)).max(axis=-1)
    # A pixel at an edge differs from a neighbor by more than 8 in the image of the CPU.
    wide = expected.astype(int)
    jumps = [np.abs(np.diff(wide, axis=axis, append=wide.take([-1], axis))).max(axis=-1) > 8 for axis in (1, 2)]
    edge = jumps[0] | jumps[1]
    edge |= np.roll(jumps[0], 1, 1) | np.roll(jumps[1], 1, 2)
    large = change > 2
    shares = {str(k): float((change == k).mean()) for k in range(3)} | {"more": float(large.mean())}
    return {"pixels": change.size, "shares": shares, "largest": int(change.max()), "more_at_edges": int((large & edge).sum()), "more": int(large.sum())}


def speed(found: dict[str, np.ndarray], name: str, device: str, size: int, rows: int) -> dict[str, object]:
    """Returns images per second of whole calls, with poses and scenarios on the device."""
    from mishandle.gpu.cameras.renderer import wp

    own = renderer(found, device, size)
    of_state = np.arange(rows) % STATES
    poses = own.poses(found["bodies"][of_state], found["vertices"][of_state])
    before = own.poses(found["before_bodies"][of_state], found["before_vertices"][of_state])
    arrays = {row: found[f"{name}_{row}"] for row in ROW_NAMES}
    if size != 64:
        arrays["cameras"] = arrays["cameras"].copy()
        cameras = arrays["cameras"].reshape(-1, 74)
        # The slopes of a pinhole with one ray per pixel.
        cameras[:, 13] *= 64 / size
        cameras[:, 36] = (0.5 - 0.5 * size) * cameras[:, 13]
        cameras[:, 37] = -cameras[:, 36]
    sights = own.sights(arrays)
    numbers = (np.arange(rows) % SETS[name]).astype(np.int32)
    # Neighbors have other states and other scenarios.
    numbers = np.random.default_rng(0).permutation(numbers)
    of_row = wp.array(numbers, device=device)
    seeds, steps = (wp.array(np.arange(rows, dtype=np.uint64), device=device) for _ in range(2))
    times = []
    for _ in range(REPEATS + 2):
        wp.synchronize()
        start = time.perf_counter()
        images = own.render(poses, sights, of_row, seeds, steps, before=before)
        wp.synchronize()
        times.append(time.perf_counter() - start)
    times = sorted(times[2:])
    count = int(images.shape[0])
    figures = {"images": count, "size": size, "shapes": int(sights.shapes.shape[1]), "rays": sights.samples}
    return figures | {"images_per_s": round(count / statistics.median(times)), "slowest": round(count / times[-1]), "fastest": round(count / times[0])}


def profile(found: dict[str, np.ndarray], name: str, device: str, rows: int) -> dict[str, float]:
    """Returns the time of each kernel in a call, ms."""
    from mishandle.gpu.cameras.renderer import wp

    text = io.StringIO()
    own = renderer(found, device)
    of_state = np.arange(rows) % STATES
    poses = own.poses(found["bodies"][of_state], found["vertices"][of_state])
    sights = own.sights({row: found[f"{name}_{row}"] for row in ROW_NAMES})
    of_row = wp.array((np.arange(rows) % SETS[name]).astype(np.int32), device=device)
    numbers = wp.array(np.arange(rows, dtype=np.uint64), device=device)
    own.render(poses, sights, of_row, numbers, numbers, before=poses)
    with contextlib.redirect_stdout(text), wp.ScopedTimer("render", cuda_filter=wp.TIMING_KERNEL, print=False) as timer:
        own.render(poses, sights, of_row, numbers, numbers, before=poses)
    times: dict[str, float] = {}
    for result in timer.timing_results:
        kernel = result.name.split()[-1]
        times[kernel] = times.get(kernel, 0.0) + result.elapsed
    return {kernel: round(value, 3) for kernel, value in times.items()}


def say(figure: str, **values: object) -> None:
    print(json.dumps({"figure": figure, **values}), flush=True)


def measure(folder: Path, device: str, rows: int) -> None:
    files = {task: dict(np.load(folder / f"{task}.npz")) for task in TASKS}
    for task, found in files.items():
        for name in SETS:
            say("differences", task=task, set=name, **differences(found, name, device))
    for task, found in files.items():
        for name in SETS:
            say("speed", task=task, set=name, **speed(found, name, device, 64, rows if name != "all" else rows // 4))
    for size in (96, 128):
        say("speed", task="cube-stacking", set="nominal", **speed(files["cube-stacking"], "nominal", device, size, rows // 4))
    for task in ("cube-stacking", "cloth-placing"):
        for name in ("nominal", "hard"):
            say("profile", task=task, set=name, rows=rows, ms=profile(files[task], name, device, rows))


if __name__ == "__main__":
    command, folder, *rest = sys.argv[1:]
    if command == "dump":
        dump(Path(folder))
    else:
        measure(Path(folder), rest[0] if rest else "cuda", int(rest[1]) if len(rest) > 1 else ROWS)
