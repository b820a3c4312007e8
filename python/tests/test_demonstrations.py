"""Tests of recorded demonstrations: data sets of `mishandle record`, read with NumPy, pyarrow,
pandas and Pillow alone."""

import io
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import pandas
import PIL.Image
import pyarrow.parquet

PROGRAM = pathlib.Path(sys.executable).parent / "mishandle"
EPISODES, STEPS, WIDTH, HEIGHT = 3, 300, 12, 8
CAMERAS = ["over", "wrist"]


class DataSets(unittest.TestCase):
    """The same demonstrations in both formats."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        root = pathlib.Path(cls.folder.name)
        words = [
            "record", "ball-balancing", "--controller", "ppo", "-k", "record.relabel=expert",
            "--space", "delay"
        ]
        words += [
            "--episodes", str(EPISODES), "--seed", "3", "--camera", ",".join(CAMERAS), "--size",
            f"{WIDTH}x{HEIGHT}"
        ]
        cls.results = {}
        for name in ["lerobot", "npz"]:
            output = ["-k", f"record.format={name}", "--out", root / name, "--json"]
            found = subprocess.run([PROGRAM, *words, *output], check=True, stdout=subprocess.PIPE)
            cls.results[name] = json.loads(found.stdout)
        cls.meta = root / "lerobot" / "meta"
        cls.info = json.loads((cls.meta / "info.json").read_text())
        cls.stats = json.loads((cls.meta / "stats.json").read_text())
        cls.frames = pyarrow.parquet.read_table(
            root / "lerobot" / "data" / "chunk-000" / "file-000.parquet"
        )
        cls.episodes = pyarrow.parquet.read_table(
            cls.meta / "episodes" / "chunk-000" / "file-000.parquet"
        ).to_pandas()
        # No pickle.
        with np.load(root / "npz" / "data.npz") as arrays:
            cls.arrays = dict(arrays)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def column(self, name):
        return np.array(self.frames[name].to_pylist(), dtype=self.info["features"][name]["dtype"])

    def pixels(self, name):
        """Return the decoded images of a column."""
        images = [
            np.asarray(PIL.Image.open(io.BytesIO(image["bytes"])))
            for image in self.frames[name].to_pylist()
        ]
        return np.stack(images)

    def test_the_result_counts_what_is_in_the_files(self):
        for name, found in self.results.items():
            self.assertEqual(
                [found["format"], found["episodes"], found["frames"]],
                [name, EPISODES, EPISODES * STEPS]
            )
            files = [path for path in pathlib.Path(found["folder"]).rglob("*") if path.is_file()]
            self.assertEqual(found["bytes"], sum(path.stat().st_size for path in files))
            self.assertEqual(found["successes"], self.arrays["success"].sum())
        self.assertEqual(self.info["total_frames"], self.frames.num_rows)
        self.assertEqual(self.info["fps"], 60)
        self.assertEqual(list(self.info["features"]), self.frames.column_names)

    def test_both_formats_have_the_same_frames(self):
        for name in [
            "observation.state", "action", "action.executed", "episode_index", "frame_index"
        ]:
            found, expected = self.column(name), self.arrays[name]
            self.assertEqual((found.dtype, found.shape), (expected.dtype, expected.shape), name)
            self.assertEqual(found.tobytes(), expected.tobytes(), name)
        for camera in CAMERAS:
            name = f"observation.images.{camera}"
            self.assertEqual(self.arrays[name].shape, (EPISODES * STEPS, HEIGHT, WIDTH, 3))
            np.testing.assert_array_equal(self.pixels(name), self.arrays[name])
        names = self.info["features"]["action"]["names"]
        self.assertEqual(names, self.arrays["action.names"].tolist())
        self.assertEqual(names[0], "joint1")

    def test_both_formats_have_the_same_episodes(self):
        starts = self.arrays["episode_starts"]
        np.testing.assert_array_equal(self.episodes["dataset_from_index"], starts[:-1])
        np.testing.assert_array_equal(self.episodes["dataset_to_index"], starts[1:])
        for name in ["seed", "success", "robustness", "end", "simulation", "scenario.action_delay"]:
            np.testing.assert_array_equal(self.episodes[name], self.arrays[name], name)
        self.assertEqual(self.arrays["seed"].dtype, np.uint64)
        last = starts[1:] - 1
        self.assertEqual(np.flatnonzero(self.column("next.done")).tolist(), last.tolist())
        np.testing.assert_array_equal(self.column("next.success")[last], self.arrays["success"])
        np.testing.assert_array_equal(
            self.column("timestamp"), (self.arrays["frame_index"] / 60).astype(np.float32)
        )

    def test_the_task_is_the_index_of_its_table(self):
        tasks = pandas.read_parquet(self.meta / "tasks.parquet")
        self.assertEqual(tasks.index.tolist(), self.arrays["task"].tolist())
        self.assertEqual(tasks["task_index"].tolist(), [0])
        self.assertEqual(self.episodes["tasks"][0].tolist(), tasks.index.tolist())

    def test_statistics_are_those_of_numpy(self):
        self.assertEqual(sorted(self.stats), sorted(self.info["features"]))
        for name, found in self.stats.items():
            if name.startswith("observation.images."):
                values = self.pixels(name).reshape(-1, 3).astype(float) / 255
                shape = (3, 1, 1)
            else:
                values = self.column(name).astype(float).reshape(self.frames.num_rows, -1)
                shape = (values.shape[1],)
            expected = {
                "min": values.min(0), "max": values.max(0), "mean": values.mean(0),
                "std": values.std(0)
            }
            expected |= {
                f"q{share:02}": np.quantile(values, share / 100, axis=0)
                for share in [1, 10, 50, 90, 99]
            }
            self.assertEqual(sorted(found), sorted([*expected, "count"]), name)
            self.assertEqual(found["count"], [self.frames.num_rows])
            for statistic, value in expected.items():
                np.testing.assert_allclose(
                    found[statistic], value.reshape(shape), rtol=1e-9, atol=1e-12,
                    err_msg=f"{name} {statistic}"
                )


if __name__ == "__main__":
    unittest.main()
