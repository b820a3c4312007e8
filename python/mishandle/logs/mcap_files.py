"""MCAP files, by the package ``mcap``."""

from __future__ import annotations

import dataclasses
import json
import os
import pathlib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from mishandle.base.packages import needed
from mishandle.errors import InvalidValueError, MishandleError
from mishandle.logs.columns import Tables

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, McapRecord, Schema

MAX_CHUNK = 2**30
"""Largest chunk after decompression, in bytes. Writers make chunks of some MiB; a file of some kB
can state any size."""

Decode = Callable[[bytes], Any]


def read(file: pathlib.Path, tables: Tables, partial: bool) -> None:
    """Reads the messages of a file into tables."""
    channels = _Channels(tables)
    try:
        for record in _records(file):
            channels.take(record)
    except MishandleError:
        raise
    # The package raises errors of many classes for a damaged file, such as struct.error.
    except Exception as error:
        if not partial:
            raise InvalidValueError(
                f"{file} is no MCAP file, or damaged or truncated after {tables.messages} messages "
                f"({type(error).__name__}: {error}); partial=True reads what is before the damage"
            ) from error
        if tables.messages == 0:
            raise InvalidValueError(
                f"{file} has no message before its damage ({type(error).__name__}: {error})"
            ) from error


class _Channels:
    """Schemas and channels of the records so far."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, tuple[str, Decode | None]] = {}

    def take(self, record: McapRecord) -> None:
        """Reads a record, and the message in it if it has one."""
        from mcap.records import Channel, Message, Schema

        if isinstance(record, Message):
            self._tables.messages += 1
            topic, decode = self._channels[record.channel_id]
            if decode is not None and topic not in self._tables.not_read:
                stamps = {"log": record.log_time, "publish": record.publish_time}
                self._tables.add(topic, stamps, decode(record.data))
        elif isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in self._channels:
            self._channels[record.id] = record.topic, self._decoder(record)

    def _decoder(self, channel: Channel) -> Decode | None:
        if not self._tables.is_requested(channel.topic):
            return None
        schema = self._schemas.get(channel.schema_id)
        decode: Decode | None = None
        if channel.message_encoding == "json":
            decode = _json
        elif channel.message_encoding == "cdr":
            decode = _ros2(schema)
        elif channel.message_encoding == "protobuf":
            decode = _protobuf(schema)
        if decode is None:
            encoding = "none" if schema is None else schema.encoding or "none"
            self._tables.not_read[channel.topic] = (
                f"has messages in the encoding {channel.message_encoding or 'none'} with a schema "
                f"in {encoding}, which are not read; cdr with ros2msg, json and protobuf are"
            )
        return decode


def _json(data: bytes) -> Any:
    return json.loads(data)


def _ros2(schema: Schema | None) -> Decode | None:
    with needed("ROS 2 messages need mcap-ros2-support", "logs"):
        from mcap_ros2.decoder import DecoderFactory
    return DecoderFactory().decoder_for("cdr", schema)


def _protobuf(schema: Schema | None) -> Decode | None:
    with needed("Protobuf messages need mcap-protobuf-support", "logs"):
        from mcap_protobuf.decoder import DecoderFactory
    return DecoderFactory().decoder_for("protobuf", schema)


def _records(file: pathlib.Path) -> Iterator[McapRecord]:
    """Yields the records of the data in the order of the file, which a truncated file has, too."""
    with needed("MCAP files need mcap", "logs"):
        from mcap.records import Chunk, DataEnd
        from mcap.stream_reader import StreamReader, breakup_chunk
    with open(file, "rb") as stream:
        # No record is longer than the file.
        limit = os.fstat(stream.fileno()).st_size
        for record in StreamReader(stream, emit_chunks=True, record_size_limit=limit).records:
            if isinstance(record, Chunk):
                yield from breakup_chunk(_decompressed(record), validate_crc=True)
            elif isinstance(record, DataEnd):
                # The rest repeats schemas and channels, for readers that seek.
                return
            else:
                yield record


def _decompressed(chunk: Chunk) -> Chunk:
    """Decompresses a chunk to at most the size that it states."""
    size = chunk.uncompressed_size
    if size > MAX_CHUNK:
        raise InvalidValueError(
            f"a chunk has {size} bytes after decompression; at most {MAX_CHUNK} are read"
        )
    if chunk.compression == "zstd":
        import zstandard

        if zstandard.frame_content_size(chunk.data) not in (-1, size):
            raise ValueError(
                "the compressed data of a chunk has another size than the chunk states"
            )
        data: bytes = (
            zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size) if size
            else b""
        )
    elif chunk.compression == "lz4":
        import lz4.frame

        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise InvalidValueError(
            f"a chunk is compressed by `{chunk.compression}`; zstd and lz4 are read"
        )
    if len(data) != size:
        raise ValueError("the data of a chunk has another size than the chunk states")
    return dataclasses.replace(chunk, compression="", data=data)
