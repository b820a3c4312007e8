"""Bags of ROS 1 and ROS 2, by the package ``rosbags``."""

import pathlib

from mishandle.base.packages import needed
from mishandle.errors import InvalidValueError
from mishandle.logs.columns import Tables


def read(file: pathlib.Path, tables: Tables) -> None:
    """Reads the messages of a bag into tables."""
    with needed("bags of ROS need rosbags", "logs"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    try:
        # Bags of older versions contain no definitions of their types, which are mostly those of
        # ROS 2 Humble.
        with AnyReader([file], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            connections = []
            for connection in reader.connections:
                if not tables.is_requested(connection.topic):
                    continue
                if connection.msgtype in reader.typestore.fielddefs:
                    connections.append(connection)
                else:
                    tables.not_read[connection.topic] = (
                        f"has messages of the type {connection.msgtype}, which the bag does not "
                        "define"
                    )
            # No connection would mean all.
            for connection, stamp, data in reader.messages(connections) if connections else ():
                tables.messages += 1
                if connection.topic not in tables.not_read:
                    tables.add(
                        connection.topic, {"log": stamp},
                        reader.deserialize(data, connection.msgtype)
                    )
    # The package raises errors of many classes for a damaged bag, such as those of SQLite.
    except Exception as error:
        raise InvalidValueError(
            f"{file} is no bag, or damaged after {tables.messages} messages "
            f"({type(error).__name__}: {error})"
        ) from error
