# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An MCAP file, written: chunks of messages with their indexes, and a summary at the end.

The bytes are those that mcap's own `Writer` makes of the same calls. That one builds an object and
ten small writes of each message, which is most of what recording costs; here a message is packed
at once, and what is counted is counted once a chunk.
"""

import struct
import zlib
from collections.abc import Iterable, Mapping
from typing import Any, Protocol

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import CompressionType

from sparse_coord_ros.recording.records import HEAD, MAGIC, MESSAGE

_MESSAGE = struct.Struct(HEAD.format + MESSAGE.format.removeprefix("<"))
_INDEX = struct.Struct(HEAD.format + "HI")
"""How the record of a message and that of a message index begin."""
_MESSAGE_OPCODE, _INDEX_OPCODE = int(Opcode.MESSAGE), int(Opcode.MESSAGE_INDEX)
_BODY = MESSAGE.size


class Output(Protocol):
    """What the file is written to."""

    def write(self, data: bytes) -> None:
        """Take all bytes, or raise."""

    def tell(self) -> int:
        """Return how many were taken."""


class McapFile:
    """Writes one MCAP file from its beginning to its end; nothing but records, see the module.

    Args:
        output: where to; all bytes of a record come in one call.
        chunk_size: bytes of uncompressed records after which a chunk is written.
        compression: of chunks.
        profile: what the header says of the file's contents.
        library: what it says of the writer.
    """

    def __init__(
        self,
        output: Output,
        *,
        chunk_size: int,
        compression: CompressionType,
        profile: str,
        library: str,
    ) -> None:
        """Begin the file."""
        self._output, self._chunk_size, self._compression = output, chunk_size, compression
        self._crc = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunk = bytearray()
        self._places: dict[int, list[int]] = {}  # of a channel: time, place, time, place ...
        self._counts: dict[int, int] = {}
        self._start_ns = self._end_ns = 0
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._write(MAGIC)
        self._write(_bytes_of(Header(profile, library)))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a message type and return its number."""
        schema = Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        self._schemas.append(schema)
        self._to_chunk(schema)
        return schema.id

    def add_channel(
        self, topic: str, encoding: str, schema_id: int, metadata: Mapping[str, str]
    ) -> int:
        """Add a topic and return its channel."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            schema_id=schema_id,
            metadata=dict(metadata),
        )
        self._channels.append(channel)
        self._to_chunk(channel)
        return channel.id

    def add_message(
        self, channel_id: int, log_ns: int, data: bytes, publish_ns: int, sequence: int
    ) -> None:
        """Add a message to the chunk, and write that where it is full."""
        chunk, places = self._chunk, self._places.get(channel_id)
        if places is None:
            places = self._places[channel_id] = []
        places += (log_ns, len(chunk))
        size = _BODY + len(data)
        chunk += _MESSAGE.pack(_MESSAGE_OPCODE, size, channel_id, sequence, log_ns, publish_ns)
        chunk += data
        if len(chunk) > self._chunk_size:
            self.end_chunk()

    def add_attachment(self, log_ns: int, name: str, media_type: str, data: bytes) -> None:
        """Add a file; it says not when it was made: bytes must not depend on the clock."""
        begin = self._output.tell()
        attachment = Attachment(
            create_time=0, log_time=log_ns, name=name, media_type=media_type, data=data
        )
        self._attachments.append(
            AttachmentIndex(
                offset=begin,
                length=self._write(_bytes_of(attachment)),
                create_time=0,
                log_time=log_ns,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Add a record of texts."""
        begin = self._output.tell()
        length = self._write(_bytes_of(Metadata(name=name, metadata=dict(data))))
        self._metadata.append(MetadataIndex(offset=begin, length=length, name=name))

    def end_chunk(self) -> None:
        """Write the chunk under way and where its messages are; without a message it goes on."""
        if not self._places:
            return
        content, self._chunk = bytes(self._chunk), bytearray()
        places, self._places = self._places, {}
        times = [time for of_channel in places.values() for time in of_channel[::2]]
        first, last = min(times), max(times)
        self._start_ns = min(self._start_ns, first) if self._counts else first
        self._end_ns = max(self._end_ns, last)
        for channel_id, of_channel in places.items():
            self._counts[channel_id] = self._counts.get(channel_id, 0) + len(of_channel) // 2
        chunk = Chunk(
            *_compressed(content, self._compression),
            message_start_time=first,
            message_end_time=last,
            uncompressed_crc=zlib.crc32(content),
            uncompressed_size=len(content),
        )
        begin = self._output.tell()
        length = self._write(_bytes_of(chunk))
        indexes, offsets = bytearray(), {}
        for channel_id, of_channel in places.items():
            offsets[channel_id] = begin + length + len(indexes)
            size = 8 * len(of_channel)
            indexes += _INDEX.pack(_INDEX_OPCODE, _INDEX.size - HEAD.size + size, channel_id, size)
            indexes += struct.pack(f"<{len(of_channel)}Q", *of_channel)
        self._write(bytes(indexes))
        self._chunks.append(
            ChunkIndex(
                chunk_start_offset=begin,
                chunk_length=length,
                message_start_time=first,
                message_end_time=last,
                message_index_offsets=offsets,
                message_index_length=len(indexes),
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=len(content),
            )
        )

    def finish(self) -> None:
        """Write the last chunk and the summary; the output stays open."""
        self.end_chunk()
        self._write(_bytes_of(DataEnd(self._crc)))
        statistics = Statistics(
            message_count=sum(self._counts.values()),
            schema_count=len(self._schemas),
            channel_count=len(self._channels),
            attachment_count=len(self._attachments),
            metadata_count=len(self._metadata),
            chunk_count=len(self._chunks),
            message_start_time=self._start_ns,
            message_end_time=self._end_ns,
            channel_message_counts=self._counts,
        )
        groups: list[tuple[Opcode, Iterable[Any]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ]
        begin = self._output.tell()
        summary, offsets = b"", b""
        for opcode, records in groups:
            group = b"".join(map(_bytes_of, records))
            offset = SummaryOffset(
                group_opcode=opcode, group_start=begin + len(summary), group_length=len(group)
            )
            summary += group
            offsets += _bytes_of(offset)
        footer = Footer(
            summary_start=begin, summary_offset_start=begin + len(summary), summary_crc=0
        )
        summary += offsets
        without_crc = _bytes_of(footer)[: -struct.calcsize("<I")]
        footer.summary_crc = zlib.crc32(without_crc, zlib.crc32(summary))
        self._write(summary)
        self._write(_bytes_of(footer))
        self._write(MAGIC)

    def _to_chunk(self, record: Schema | Channel) -> None:
        self._chunk += _bytes_of(record)
        if len(self._chunk) > self._chunk_size:
            self.end_chunk()

    def _write(self, data: bytes) -> int:
        """Write bytes and return their number."""
        self._crc = zlib.crc32(data, self._crc)
        self._output.write(data)
        return len(data)


def _bytes_of(record: Any) -> bytes:
    """Return a record of mcap's as bytes."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data


def _compressed(content: bytes, compression: CompressionType) -> tuple[str, bytes]:
    """Return what a chunk calls its compression, and the content compressed."""
    if compression == CompressionType.ZSTD:
        return "zstd", zstandard.compress(content)
    if compression == CompressionType.LZ4:
        return "lz4", lz4.frame.compress(content)
    return "", content
