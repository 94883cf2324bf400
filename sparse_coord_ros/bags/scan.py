# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One pass over an MCAP file: what is in it, how far it can be read, whether all is right."""

import struct
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Header, Metadata, Schema

from sparse_coord_ros.bags.records import (
    HEAD,
    LATEST_NS,
    MAGIC,
    MESSAGE,
    PIECE,
    Damage,
    Fields,
    Source,
    check_crc,
    chunk_content,
    describe,
    message_heads,
    parse,
)
from sparse_coord_ros.bags.summary import Found, read_summary
from sparse_coord_ros.bags.topics import BagTopic, topic_of

OWN_LIBRARY = "sparse_coord_ros "
"""How the header of a file by `BagWriter` begins: in these every checksum is there."""


class AttachmentPlace(NamedTuple):
    """Where in the file an attachment's data are."""

    name: str
    media_type: str
    log_time_ns: int
    offset: int
    size: int


class Scan:
    """What one pass over a file found; stops at the first damage.

    Attributes:
        damage: what is wrong where, or None.
        end: offset up to which the data section could be read.
        end_found: whether the data section was read to its end.
        whole: whether its checksum holds too.
        closed: whether the file was found finished, its summary right.
        own: whether `BagWriter` wrote it.
        topics: by channel id.
        counts, sizes: number of messages, and bytes of their data, by channel id.
        metadata: the metadata records' texts, in the order of the file.
        attachments: where they are.
        compressions: of the chunks, as MCAP calls them.
        start_ns, end_ns: earliest and latest log time, 0 without messages.
    """

    def __init__(self, source: Source) -> None:
        """Scan a file that begins with MCAP's magic."""
        self.damage: str | None = None
        self.end = len(MAGIC)
        self.end_found = self.whole = self.closed = self.own = False
        self.topics: dict[int, BagTopic] = {}
        self.counts: dict[int, int] = {}
        self.sizes: dict[int, int] = {}
        self.metadata: list[tuple[str, dict[str, str]]] = []
        self.attachments: list[AttachmentPlace] = []
        self.compressions: set[str] = set()
        self.start_ns, self.end_ns = LATEST_NS, 0
        self._source = source
        self._with_crcs = False
        self._found = Found()
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        self._chunk: tuple[Chunk, int, int] | None = None
        self._index: dict[int, bytes] = {}
        self._index_offsets: dict[int, int] = {}
        try:
            self._read()
        except Damage as damage:
            self.damage = str(damage)
        if not any(self.counts.values()):
            self.start_ns = 0

    def _read(self) -> None:
        source = self._source
        source.seek(0)
        source.crc = 0
        source.read(len(MAGIC))
        opcode, length = source.head()
        if opcode != Opcode.HEADER:
            raise Damage(self.end, f"{describe(opcode)} where the header should be")
        header = parse(Header, source.read(length), self.end)
        self.own = header.library.startswith(OWN_LIBRARY)
        # Who writes one checksum writes all, so that a zeroed one does not pass for none.
        self._with_crcs = self.own
        self.end = source.position
        while source.rest:
            crc = source.crc
            opcode, length = source.head()
            if opcode != Opcode.MESSAGE_INDEX:
                self._leave_chunk()
            if opcode == Opcode.DATA_END:
                record = parse(DataEnd, source.read(length), self.end)
                self.end_found = True
                check_crc(
                    record.data_section_crc, crc, self.end, "the data before", required=self.own
                )
                self.whole = True
                if source.rest:
                    self._read_end()
                return
            self._record(opcode, length)
            self.end = source.position
        self._leave_chunk(at_end=True)

    def _read_end(self) -> None:
        found = self._found
        found.counts = {channel: count for channel, count in self.counts.items() if count}
        found.start_ns, found.end_ns = (self.start_ns, self.end_ns) if found.counts else (0, 0)
        read_summary(self._source, found, self._channels, self._schemas, own=self.own)
        for channel in self._channels.values():
            if channel.id not in self.topics:
                self.topics[channel.id] = topic_of(channel, self._schemas, self.end)
                self.counts[channel.id] = self.sizes[channel.id] = 0
        self.closed = True

    def _record(self, opcode: int, length: int) -> None:
        """Take one record of the data section, whole or not at all."""
        source, offset = self._source, self.end
        if opcode == Opcode.CHUNK:
            self._take_chunk(source.read(length), offset)
        elif opcode == Opcode.MESSAGE_INDEX:
            self._take_index(source.read(length), offset)
        elif opcode == Opcode.ATTACHMENT:
            self._take_attachment(length, offset)
        elif opcode == Opcode.METADATA:
            record = parse(Metadata, source.read(length), offset)
            self.metadata.append((record.name, record.metadata))
            self._found.add(Opcode.METADATA_INDEX, (offset, source.position - offset, record.name))
        elif opcode >= 0x80 and not self.own:
            source.read(length)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE) and not (
            self.own or self._found.chunks
        ):
            content = HEAD.pack(opcode, length) + source.read(length)
            self._take(message_heads(content, offset), content, offset)
        else:
            raise Damage(offset, f"{describe(opcode)}, which has no business there")

    def _take_chunk(self, body: bytes, offset: int) -> None:
        chunk = parse(Chunk, body, offset)
        content = chunk_content(chunk, offset, crc_required=self._with_crcs)
        self._with_crcs |= chunk.uncompressed_crc != 0
        times = chunk.message_start_time, chunk.message_end_time
        index = self._take(message_heads(content, offset), content, offset, times)
        self.compressions.add(chunk.compression)
        self._found.chunks += 1
        self._chunk = chunk, offset, self._source.position - offset
        self._index, self._index_offsets = index, {}

    def _take(self, records, content: bytes, offset: int, times=None) -> dict[int, bytes]:
        """Add what `message_heads` found, all or none; returns the messages' index by channel.

        `times`, if not None, should be the messages' first and last log time.
        """
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        topics: dict[int, BagTopic] = {}
        places, heads, others = records
        begun: dict[int, int] = {}
        for opcode, place, begin, end in others:
            if opcode == Opcode.SCHEMA:
                record = parse(Schema, content[begin:end], offset)
                if schemas.setdefault(record.id, self._schemas.get(record.id, record)) != record:
                    raise Damage(offset, f"a second, different schema {record.id}")
            elif opcode == Opcode.CHANNEL:
                record = parse(Channel, content[begin:end], offset)
                known = channels.setdefault(record.id, self._channels.get(record.id, record))
                if known != record:
                    raise Damage(offset, f"a second, different channel {record.id}")
                topic = topic_of(record, {**self._schemas, **schemas}, offset)
                types = {
                    t.type_name
                    for t in (*self.topics.values(), *topics.values())
                    if t.name == topic.name
                }
                if types - {topic.type_name}:
                    raise Damage(offset, f"topic {topic.name!r} has a second type")
                topics[record.id] = topic
                begun.setdefault(record.id, place)
            elif self.own or opcode < 0x80:
                raise Damage(offset, f"{describe(opcode)} within a chunk")
        order = np.argsort(heads["channel"], kind="stable")
        ids, first = np.unique(heads["channel"][order], return_index=True)
        groups = dict(zip(ids.tolist(), np.split(order, first[1:]), strict=False))
        for channel_id, group in groups.items():
            if channel_id not in self.topics and begun.get(channel_id, len(content)) > int(
                places[group[0]]
            ):
                raise Damage(offset, f"a message of the unknown channel {channel_id}")
        start_ns, end_ns = LATEST_NS, 0
        if len(heads):
            if max(heads["log_ns"].max(), heads["publish_ns"].max()) > LATEST_NS:
                raise Damage(offset, "a message with an impossible time")
            start_ns, end_ns = int(heads["log_ns"].min()), int(heads["log_ns"].max())
            if times not in (None, (start_ns, end_ns)):
                raise Damage(offset, "a chunk whose times are not those of its messages")
        self._schemas.update(schemas)
        self._channels.update(channels)
        self.topics.update(topics)
        for channel_id in topics:
            self.counts.setdefault(channel_id, 0)
            self.sizes.setdefault(channel_id, 0)
        index = {}
        for channel_id, group in groups.items():
            self.counts[channel_id] += len(group)
            data = int(heads["length"][group].sum()) - MESSAGE.size * len(group)
            self.sizes[channel_id] += data
            entries = np.empty((len(group), 2), dtype="<u8")
            entries[:, 0], entries[:, 1] = heads["log_ns"][group], places[group]
            head = struct.pack("<HI", channel_id, entries.nbytes)
            index[channel_id] = head + entries.tobytes()
        self.start_ns, self.end_ns = min(self.start_ns, start_ns), max(self.end_ns, end_ns)
        return index

    def _take_index(self, body: bytes, offset: int) -> None:
        """Compare a message index with the chunk before it."""
        channel_id = int.from_bytes(body[:2], "little")
        expected = self._index.pop(channel_id, struct.pack("<HI", channel_id, 0))
        if self._chunk is None or not _same_index(expected, body, in_order=self.own):
            raise Damage(offset, "a message index that is not that of the chunk before it")
        self._index_offsets[channel_id] = offset

    def _leave_chunk(self, *, at_end: bool = False) -> None:
        """Note what the summary has to say about the chunk and the indexes read last."""
        if self._chunk is None:
            return
        chunk, offset, length = self._chunk
        if self._index and self.own and not at_end:
            raise Damage(self.end, f"{len(self._index)} message indexes of a chunk are missing")
        self._found.add(
            Opcode.CHUNK_INDEX,
            (
                chunk.message_start_time,
                chunk.message_end_time,
                offset,
                length,
                sorted(self._index_offsets.items()),
                self.end - offset - length,
                chunk.compression,
                len(chunk.data),
                chunk.uncompressed_size,
            ),
        )
        self._chunk, self._index, self._index_offsets = None, {}, {}

    def _take_attachment(self, length: int, offset: int) -> None:
        """Check an attachment piece by piece: it may be larger than memory."""
        fields = Fields(self._source, length, offset)
        log_ns, create_ns = struct.unpack("<QQ", fields.take(16))
        name, media_type = fields.text(), fields.text()
        size = int.from_bytes(fields.take(8), "little")
        place = self._source.position
        if size != fields.left - 4:
            raise Damage(offset, "an attachment whose fields do not fit into it")
        while fields.left > 4:
            fields.take(min(fields.left - 4, PIECE))
        found = fields.crc
        stored = int.from_bytes(fields.take(4), "little")
        check_crc(stored, found, offset, f"attachment {name!r}", required=self._with_crcs)
        self._with_crcs |= stored != 0
        if log_ns > LATEST_NS:
            raise Damage(offset, f"attachment {name!r} has an impossible time")
        self.attachments.append(AttachmentPlace(name, media_type, log_ns, place, size))
        self._found.add(
            Opcode.ATTACHMENT_INDEX,
            (offset, self._source.position - offset, log_ns, create_ns, size, name, media_type),
        )


def _same_index(expected: bytes, body: bytes, *, in_order: bool) -> bool:
    """Whether two message indexes are equal; some writers sort theirs by time."""
    if expected == body or in_order or len(expected) != len(body):
        return expected == body
    entries = [sorted(struct.iter_unpack("<QQ", index[6:])) for index in (expected, body)]
    return expected[:6] == body[:6] and entries[0] == entries[1]
