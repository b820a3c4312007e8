"""Tests of logs: files that the packages of ROS, MCAP and Arrow write, and damaged ones."""

import json
import random
import struct

from cases import FolderCase
import mishandle
from mishandle.errors import InvalidValueError
import numpy as np
import pyarrow
import pyarrow.parquet
from mcap.writer import CompressionType, Writer as McapWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer
from rosbags.rosbag1 import Writer as Bag1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as Bag2Writer
from rosbags.typesys import Stores, get_typestore

START = 1_764_000_000_123_456_789
WRENCH = """std_msgs/Header header
geometry_msgs/Wrench wrench
float64[] gains
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""


def vector(x, y, z):
    return {"x": x, "y": y, "z": z}


def wrench(index, stamp):
    return {
        "header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "tool"},
        "wrench": {"force": vector(index * 0.5, 0.0, -1.0), "torque": vector(0.0, 0.0, 0.25)},
        "gains": [1.0, 2.0 * index],
    }


def joint_state(store, stamp, names, positions):
    types = store.types
    header = types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9),
        frame_id=""
    )
    empty = np.array([], dtype=np.float64)
    state = types["sensor_msgs/msg/JointState"]
    return state(
        header=header, name=names, position=np.array(positions), velocity=empty, effort=empty
    )


class Files(FolderCase):
    def ros2_mcap(self, name="wrench.mcap", messages=20, **options):
        """Messages whose stamp is 2 ms, and whose publish time is 1 ms, before the recorder
        receives them."""
        path = self.folder / name
        with open(path, "wb") as stream:
            writer = Ros2Writer(stream, **options)
            schema = writer.register_msgdef("geometry_msgs/WrenchStamped", WRENCH)
            text = writer.register_msgdef("std_msgs/String", "string data\n")
            for index in range(messages):
                received = START + index * 10_000_000
                writer.write_message(
                    "/wrench", schema, wrench(index, received - 2_000_000), received,
                    received - 1_000_000
                )
                writer.write_message("/status", text, {"data": "ok"}, received)
            writer.finish()
        return path

    def bag(self, storage=StoragePlugin.SQLITE3, compression=None, name="bag"):
        path = self.folder / name
        store = get_typestore(Stores.ROS2_HUMBLE)
        writer = Bag2Writer(path, version=9, storage_plugin=storage)
        if compression is not None:
            writer.set_compression(compression, CompressionFormat.ZSTD)
        with writer:
            kind = "sensor_msgs/msg/JointState"
            connection = writer.add_connection("/joint_states", kind, typestore=store)
            for index in range(5):
                stamp = START + index * 20_000_000
                message = joint_state(store, stamp - 3_000_000, ["a", "b"], [index, -index / 2])
                writer.write(connection, stamp, store.serialize_cdr(message, kind))
        return path

    def json_mcap(self, topics):
        """One message of each topic every 10 ms."""
        path = self.folder / "state.mcap"
        with open(path, "wb") as stream:
            writer = McapWriter(stream)
            writer.start()
            schema = writer.register_schema("state", "jsonschema", b'{"type": "object"}')
            for topic, messages in topics.items():
                channel = writer.register_channel(topic, "json", schema)
                for index, message in enumerate(messages):
                    stamp = START + index * 10**7
                    writer.add_message(channel, stamp, json.dumps(message).encode(), stamp)
            writer.finish()
        return path

    def data_set(self, version="v3.0", fps=30, jitter=0.0, lengths=(40, 25)):
        """Version 3 has the episodes of a chunk in one file, version 2 one file for each."""
        info = {"codebase_version": version, "fps": fps, "features": {}}
        (self.folder / "meta").mkdir(exist_ok=True)
        (self.folder / "meta" / "info.json").write_text(json.dumps(info))
        chunk = self.folder / "data" / "chunk-000"
        chunk.mkdir(parents=True, exist_ok=True)
        tables = []
        for episode, length in enumerate(lengths):
            frames = np.arange(length)
            state = pyarrow.FixedSizeListArray.from_arrays(
                pyarrow.array(np.arange(2.0 * length, dtype=np.float32)), 2
            )
            tables.append(
                pyarrow.table({
                    "observation.state": state,
                    "action": pyarrow.array(
                        [[float(episode)]] * length, pyarrow.list_(pyarrow.float32())
                    ),
                    "observation.image": pyarrow.array([{"bytes": b"png", "path": None}] * length),
                    "timestamp": pyarrow.array(
                        (frames / fps + jitter * (frames % 2)).astype(np.float32)
                    ),
                    "frame_index": pyarrow.array(frames),
                    "episode_index": pyarrow.array(np.full(length, episode))
                })
            )
        if version.startswith("v3"):
            pyarrow.parquet.write_table(pyarrow.concat_tables(tables), chunk / "file-000.parquet")
        else:
            for episode, table in enumerate(tables):
                pyarrow.parquet.write_table(table, chunk / f"episode_{episode:06d}.parquet")
        return self.folder


class Mcap(Files):
    def test_nested_fields_of_ros_2_are_columns_in_nanoseconds(self):
        for compression in CompressionType:
            log = mishandle.read_log(
                self.ros2_mcap(f"{compression.name}.mcap", compression=compression)
            )
            topic = log.topics["/wrench"]
            self.assertEqual(topic.times.dtype, np.int64)
            self.assertEqual(
                topic.times.tolist(), [START + index * 10_000_000 for index in range(20)]
            )
            self.assertEqual(
                topic.columns["wrench/force/x"].tolist(), [index * 0.5 for index in range(20)]
            )
            self.assertEqual(
                topic.columns["gains[1]"].tolist(), [index * 2.0 for index in range(20)]
            )
            self.assertIn("/wrench/wrench/torque/z", log.signals)
            self.assertEqual(topic.left_out, {"header/frame_id": "it is text"})
            self.assertEqual(log.topics["/status"].columns, {})

    def test_each_time_is_the_one_that_was_requested(self):
        path = self.ros2_mcap()
        for time, earlier in [("log", 0), ("publish", 1_000_000), ("header", 2_000_000)]:
            topic = mishandle.read_log(path, ["/wrench"], plan={"log": {"time": time}}).topics[
                "/wrench"
            ]
            self.assertEqual(int(topic.times[3]), START + 30_000_000 - earlier)
        header = {"log": {"time": "header"}}
        self.assertIn("header.stamp", mishandle.read_log(path, plan=header).not_read["/status"])
        with self.assertRaisesRegex(ValueError, "/status has messages without header.stamp"):
            mishandle.read_log(path, ["/status"], plan=header)
        with self.assertRaisesRegex(ValueError, "log, publish, header"):
            mishandle.read_log(path, plan={"log": {"time": "received"}})

    def test_messages_are_in_the_order_of_their_times(self):
        path = self.folder / "order.mcap"
        with open(path, "wb") as stream:
            writer = McapWriter(stream)
            writer.start()
            channel = writer.register_channel("/x", "json", 0)
            for stamp in (30, 10, 20):
                writer.add_message(channel, stamp, json.dumps({"value": stamp}).encode(), stamp)
            writer.finish()
        topic = mishandle.read_log(path).topics["/x"]
        self.assertEqual(
            (topic.times.tolist(), topic.columns["value"].tolist()),
            ([10, 20, 30], [10.0, 20.0, 30.0])
        )

    def test_fields_that_messages_lack_are_nan(self):
        messages = [{"a": 1}, {"b": [2, {"c": True}]}, {"a": None, "text": "x"}, {"a": 4, "b": []}]
        topic = mishandle.read_log(self.json_mcap({"/state": messages})).topics["/state"]
        nan = np.nan
        np.testing.assert_array_equal(topic.columns["a"], [1, nan, nan, 4])
        np.testing.assert_array_equal(topic.columns["b[0]"], [nan, 2, nan, nan])
        np.testing.assert_array_equal(topic.columns["b[1]/c"], [nan, 1, nan, nan])
        self.assertEqual(topic.left_out, {"text": "it is text"})

    def test_messages_of_protobuf(self):
        from google.protobuf.struct_pb2 import Value
        from google.protobuf.timestamp_pb2 import Timestamp

        path = self.folder / "proto.mcap"
        with open(path, "wb") as stream, ProtobufWriter(stream) as writer:
            for index in range(3):
                writer.write_message("/time", Timestamp(seconds=index, nanos=7), START + index)
                writer.write_message(
                    "/value", Value(number_value=0.0) if index else Value(), START + index
                )
        log = mishandle.read_log(path)
        self.assertEqual(log.topics["/time"].columns["seconds"].tolist(), [0, 1, 2])
        # A number that is set to 0 is a value, and one that is not set is none.
        np.testing.assert_array_equal(log.topics["/value"].columns["number_value"], [np.nan, 0, 0])

    def test_long_arrays_and_unknown_encodings_are_named(self):
        path = self.json_mcap({"/state": [{"ranges": list(range(101)), "x": 1}]})
        topic = mishandle.read_log(path).topics["/state"]
        self.assertEqual((list(topic.columns), list(topic.left_out)), (["x"], ["ranges"]))
        with open(path, "wb") as stream:
            writer = McapWriter(stream)
            writer.start()
            writer.add_message(writer.register_channel("/cbor", "cbor", 0), 1, b"\xa0", 1)
            writer.finish()
        log = mishandle.read_log(path)
        self.assertEqual(log.topics, {})
        self.assertIn("cbor", log.not_read["/cbor"])
        with self.assertRaisesRegex(ValueError, "cbor.*not read"):
            mishandle.read_log(path, ["/cbor"])
        with self.assertRaisesRegex(ValueError, "/other is not in the log; its topics are /cbor"):
            mishandle.read_log(path, ["/other"])

    def test_topics_that_would_fill_the_memory_are_not_read(self):
        def read(*messages):
            return mishandle.read_log(self.json_mcap({"/state": messages}))

        deep = 1
        for _ in range(50):
            deep = {"a": deep}
        self.assertEqual(read(deep).topics["/state"].columns, {})
        many = [{f"key{index}_{part}": 1 for part in range(100)} for index in range(101)]
        self.assertIn("10000 fields", read(*many).not_read["/state"])
        self.assertIn("two fields", read({"a/b": 1, "a": {"b": 2}}).not_read["/state"])


class DamagedMcap(Files):
    def test_a_truncated_file_is_an_error_or_read_up_to_its_end(self):
        path = self.ros2_mcap(messages=200, chunk_size=2000)
        complete = mishandle.read_log(path).topics["/wrench"].times
        data = path.read_bytes()
        lengths = set()
        for length in range(0, len(data) * 6 // 10, len(data) // 40):
            path.write_bytes(data[:length])
            with self.assertRaisesRegex(ValueError, "damaged or truncated after"):
                mishandle.read_log(path)
            try:
                found = mishandle.read_log(path, partial=True).topics["/wrench"].times
            except ValueError as error:
                self.assertIn("no message before its damage", str(error))
                continue
            self.assertEqual(found.tolist(), complete[: len(found)].tolist())
            lengths.add(len(found))
        self.assertGreater(len(lengths), 10)

    def test_changed_bytes_never_crash_and_never_change_a_value(self):
        path = self.ros2_mcap(messages=30, chunk_size=500)
        data = path.read_bytes()
        complete = mishandle.read_log(path).topics["/wrench"].columns["wrench/force/x"].tolist()
        generator = random.Random(1)
        refused = 0
        for _ in range(300):
            changed = bytearray(data)
            changed[generator.randrange(len(data))] ^= 1 << generator.randrange(8)
            path.write_bytes(changed)
            try:
                found = mishandle.read_log(path).topics
            except InvalidValueError:
                refused += 1
                continue
            if "/wrench" in found:
                self.assertEqual(found["/wrench"].columns["wrench/force/x"].tolist(), complete)
        self.assertGreater(refused, 100)

    def test_a_small_chunk_that_states_a_huge_size_is_refused(self):
        import zstandard

        bomb = zstandard.ZstdCompressor().compress(bytes(2**20))
        for stated in (2**40, 10):
            chunk = struct.pack("<QQQII", 0, 1, stated, 0, 4) + b"zstd" + struct.pack(
                "<Q", len(bomb)
            ) + bomb
            path = self.folder / "bomb.mcap"
            magic = b"\x89MCAP0\r\n"
            header = struct.pack("<I", 0) * 2
            path.write_bytes(
                magic + b"\x01" + struct.pack("<Q", 8) + header + b"\x06" + struct.pack(
                    "<Q", len(chunk)
                ) + chunk
            )
            with self.assertRaisesRegex(ValueError, "after decompression|another size"):
                mishandle.read_log(path)

    def test_other_files_are_errors_that_say_what_is_read(self):
        (self.folder / "a.mcap").write_bytes(b"not an MCAP file")
        with self.assertRaisesRegex(ValueError, "no MCAP file"):
            mishandle.read_log(self.folder / "a.mcap")
        (self.folder / "a.hdf5").write_bytes(b"")
        with self.assertRaisesRegex(ValueError, "a.hdf5: the file is empty"):
            mishandle.read_log(self.folder / "a.hdf5")
        with self.assertRaisesRegex(ValueError, r'\["time_unit"\] has no effect on .* no table'):
            mishandle.read_log(self.folder / "a.mcap", plan={"log": {"time_unit": "ns"}})
        with self.assertRaisesRegex(ValueError, r'\["period"\] has no effect on this question'):
            mishandle.read_log(self.folder / "a.mcap", plan={"log": {"period": 0.1}})
        with self.assertRaisesRegex(ValueError, "neither metadata.yaml"):
            mishandle.read_log(self.folder)
        with self.assertRaisesRegex(ValueError, "does not exist"):
            mishandle.read_log(self.folder / "none.mcap")


class Bags(Files):
    def check(self, log):
        topic = log.topics["/joint_states"]
        self.assertEqual(topic.times.tolist(), [START + index * 20_000_000 for index in range(5)])
        self.assertEqual(topic.columns["position[1]"].tolist(), [-index / 2 for index in range(5)])
        self.assertEqual(log.signals[-1], "/joint_states/position[1]")

    def test_both_storages_and_compressions_give_the_same_table(self):
        for number, (storage, compression) in enumerate([
            (StoragePlugin.SQLITE3, None), (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
            (StoragePlugin.SQLITE3, CompressionMode.FILE), (StoragePlugin.MCAP, None),
            (StoragePlugin.MCAP, CompressionMode.STORAGE)
        ]):
            path = self.bag(storage, compression, f"bag{number}")
            self.check(mishandle.read_log(path))
            if storage == StoragePlugin.MCAP:
                # The same file by another package.
                [file] = path.glob("*.mcap")
                self.check(mishandle.read_log(file))
            elif compression is None:
                [file] = path.glob("*.db3")
                self.check(mishandle.read_log(file))

    def test_stamps_of_headers(self):
        path = self.bag()
        log = mishandle.read_log(path, plan={"log": {"time": "header"}})
        times = log.topics["/joint_states"].times
        self.assertEqual(int(times[0]), START - 3_000_000)
        with self.assertRaisesRegex(ValueError, "no publish times"):
            mishandle.read_log(path, plan={"log": {"time": "publish"}})
        with self.assertRaisesRegex(ValueError, "reindex"):
            mishandle.read_log(path, partial=True)

    def test_bags_of_ros_1(self):
        path = self.folder / "old.bag"
        store = get_typestore(Stores.ROS1_NOETIC)
        with Bag1Writer(path) as writer:
            kind = "geometry_msgs/msg/Vector3"
            connection = writer.add_connection("/v", kind, typestore=store)
            for index in range(4):
                message = store.types[kind](x=index, y=0.0, z=0.0)
                writer.write(connection, START + index, store.serialize_ros1(message, kind))
        topic = mishandle.read_log(path).topics["/v"]
        self.assertEqual((topic.times - START).tolist(), [0, 1, 2, 3])
        self.assertEqual(topic.columns["x"].tolist(), [0, 1, 2, 3])

    def test_joints_in_another_order_are_no_table(self):
        store = get_typestore(Stores.ROS2_HUMBLE)
        kind = "sensor_msgs/msg/JointState"
        path = self.folder / "mixed"
        with Bag2Writer(path, version=9) as writer:
            connection = writer.add_connection("/joint_states", kind, typestore=store)
            for index, names in enumerate((["a", "b"], ["b", "a"])):
                message = joint_state(store, START, names, [0.0, 1.0])
                writer.write(connection, START + index, store.serialize_cdr(message, kind))
        self.assertIn("different joints", mishandle.read_log(path).not_read["/joint_states"])

    def test_damaged_bags_are_errors(self):
        path = self.bag()
        [file] = path.glob("*.db3")
        data = file.read_bytes()
        for damaged in (b"", data[: len(data) // 2], b"SQLite format 3\0" + bytes(4096)):
            file.write_bytes(damaged)
            with self.assertRaises(InvalidValueError):
                mishandle.read_log(path)
        (self.folder / "a.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
        with self.assertRaisesRegex(ValueError, "no bag"):
            mishandle.read_log(self.folder / "a.bag")


class DataSets(Files):
    def test_both_versions_give_the_same_episodes(self):
        found = []
        for version in ("v2.1", "v3.0"):
            path = self.data_set(version)
            logs = mishandle.logs.read_logs(path)
            self.assertEqual([len(log.topics[""].times) for log in logs], [40, 25])
            self.assertEqual(
                logs[1].topics[""].columns["observation.state[1]"][:3].tolist(), [1, 3, 5]
            )
            self.assertEqual(logs[1].topics[""].columns["action"][0], 1.0)
            found.append(logs[1].topics[""].times.tolist())
            one = mishandle.read_log(path, episode=1)
            self.assertEqual(one.topics[""].times.tolist(), found[-1])
            for file in (path / "data" / "chunk-000").iterdir():
                file.unlink()
        self.assertEqual(found[0], found[1])

    def test_stamps_of_32_bits_are_frames_divided_by_the_rate(self):
        path = self.data_set(lengths=(100_000,))
        times = mishandle.read_log(path).topics[""].times
        self.assertEqual(times.tolist(), [round(frame * 10**9 / 30) for frame in range(100_000)])

    def test_stamps_that_disagree_with_the_rate_are_kept(self):
        times = mishandle.read_log(self.data_set(jitter=0.001), episode=0).topics[""].times
        self.assertAlmostEqual(times[1] / 1e9, 1 / 30 + 0.001, places=7)

    def test_errors_name_the_way_out(self):
        path = self.data_set()
        with self.assertRaisesRegex(ValueError, "read_logs"):
            mishandle.read_log(path)
        with self.assertRaisesRegex(ValueError, "no episode 2"):
            mishandle.read_log(path, episode=2)
        with self.assertRaisesRegex(ValueError, "leave out topics"):
            mishandle.read_log(path, ["/x"], episode=1)
        [file] = (path / "data" / "chunk-000").iterdir()
        file.write_bytes(file.read_bytes()[:-100])
        with self.assertRaisesRegex(ValueError, "damaged or no Parquet file"):
            mishandle.logs.read_logs(path)
        (path / "meta" / "info.json").write_text('{"codebase_version": "v1.6", "fps": 30}')
        with self.assertRaisesRegex(ValueError, "v2 and v3"):
            mishandle.logs.read_logs(path)
