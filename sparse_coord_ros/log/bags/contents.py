# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads one MCAP file, finished or not, up to its end or its first damage."""

import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import accumulate, groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment as AttachmentRecord
from mcap.records import Channel, Chunk, Metadata, Schema

from sparse_coord_ros.base.errors import BagError, retold
from sparse_coord_ros.log.bags.metadata import FileSummary
from sparse_coord_ros.log.bags.records import (
    HEAD,
    LENGTH,
    MAGIC,
    MESSAGE,
    Cut,
    Damage,
    RecordPlace,
    Source,
    chunk_content,
    describe,
    message_heads,
    parse,
)
from sparse_coord_ros.log.bags.topics import BagTopic, topic_of

TOGETHER = 1 << 20
"""Bytes that are read at once."""

_CHUNK_HEAD = struct.Struct("<QQQII")
"""Earliest and latest time, size and checksum of the content, length of the compression's name."""
_CRC_BYTES = 4
_BARE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_PRIVATE = 0x80
"""From this opcode on records are of other programs."""
_FOOTER = HEAD.pack(Opcode.FOOTER, 20)


class Part(NamedTuple):
    """Messages that are together in a file.

    Attributes:
        content: bytes that contain their data.
        begins: offset of each one's data in it, shape (messages,).
        heads: their heads, of type `records.MESSAGE_HEAD`, same shape.
    """

    content: bytes
    begins: np.ndarray
    heads: np.ndarray


class Block(NamedTuple):
    """A chunk with messages, or a message outside of chunks.

    Attributes:
        offset: its offset in the file.
        length: its size in bytes.
        size: the size of its records, decompressed.
        start_ns, end_ns: earliest and latest log time of its messages.
    """

    offset: int
    length: int
    size: int
    start_ns: int
    end_ns: int


@dataclass(frozen=True)
class Attachment:
    """A file in the bag.

    Attributes:
        name: its name.
        media_type: its media type.
        log_time_ns: the log time at which it was attached.
        size: its size in bytes.
        offset: its offset in the bag's file.
        file: that file.
    """

    name: str
    media_type: str
    log_time_ns: int
    size: int
    offset: int = field(compare=False)
    file: "BagFile" = field(repr=False, compare=False)

    @property
    def data(self) -> bytes:
        """Its bytes, read now; raises BagError if the file has changed."""
        return self.file.read(self.offset, self.size)


class BagFile:
    """The content of one MCAP file.

    In a file that is not checked, only the heads of records are read, one after the other:
    milliseconds for a bag of a million steps. The content of a chunk is checked when it is read.
    The file stays open, so that it may be renamed or removed meanwhile, and `extend` continues
    when it has grown.

    Reading ends at the first damage. A record that the end of an unfinished file cuts off is no
    damage: it may be being written.

    Args:
        path: the file.
        checked: read every chunk, and count the messages.

    Attributes:
        path: the file.
        finished: whether its recorder closed it: the file has its end.
        damage: the first damage, its place and one sentence; None: none was found.
        size: its size in bytes.
        topics: by channel.
        counts, sizes: number of messages, and bytes of their data, by topic; if checked.
        metadata: name and texts of each metadata record, in the order of the file.
        attachments: in the order of the file.
        blocks: the places of the messages, in the order of the file.
        compressions: of the chunks that were read: some of `zstd`, `lz4` and `none`.

    Raises:
        BagError: the file is missing, does not begin as MCAP, or contains messages that are not of
            ROS 2.
    """

    def __init__(self, path: Path, *, checked: bool) -> None:
        self.path = path
        self.finished = False
        self.damage: str | None = None
        self.size = 0
        self._read_to = len(MAGIC)
        self.topics: dict[int, BagTopic] = {}
        self.counts: Counter[str] = Counter()
        self.sizes: Counter[str] = Counter()
        self.metadata: list[tuple[str, Mapping[str, str]]] = []
        self.attachments: list[Attachment] = []
        self.blocks: list[Block] = []
        self.compressions: set[str] = set()
        self._ended = False
        self._schemas: dict[int, Schema] = {}
        self._known = np.zeros(1 << 16, dtype=bool)
        self._source = Source(path)
        with retold(BagError, BagError, f"{path}"):
            self.extend()
            if checked:
                for part in self.parts(tuple(self.blocks)):
                    self._count(part.heads)

    @property
    def summary(self) -> FileSummary:
        """Its description in `metadata.yaml`."""
        start_ns = min((block.start_ns for block in self.blocks), default=0)
        end_ns = max((block.end_ns for block in self.blocks), default=0)
        return FileSummary(self.path.name, dict(self.counts), start_ns, end_ns)

    def extend(self) -> bool:
        """Read on to the current end of the file; return whether it has new records."""
        before = self._read_to
        size = self._source.size
        if size == self.size:
            return False
        self.size = size
        self.finished = _has_end(self._source, size)
        while not self._ended and self.damage is None and self._read_to < size:
            try:
                record = self._source.record(self._read_to, size)
                self._take(record)
            except Damage as damage:
                if isinstance(damage, Cut) and not self.finished:
                    break
                self.damage = str(damage)
            else:
                self._read_to = record.end
        return self._read_to != before

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._source.close()

    def read(self, offset: int, length: int) -> bytes:
        """Return bytes of the file; raises BagError if they no longer exist."""
        with retold(BagError, Damage, f"{self.path} has changed while it was read"):
            return self._source.read(offset, length)

    def parts(self, blocks: Sequence[Block]) -> Iterator[Part]:
        """Yield the messages of blocks, up to the first damage; small blocks together."""
        totals = accumulate(block.size for block in blocks)
        for _, near in groupby(
            zip(blocks, totals, strict=True), lambda one: one[1] // TOGETHER
        ):
            group = [block for block, _ in near]
            with suppress(Damage):
                yield self._part(group)
                continue
            yield from self._up_to_damage(group)
            if self.damage is not None:
                return

    def _up_to_damage(self, blocks: Sequence[Block]) -> Iterator[Part]:
        """Yield the messages of blocks, one by one; note the damage, and forget what follows."""
        for block in blocks:
            try:
                part = self._part([block])
            except Damage as damage:
                self.damage = str(damage)
                end = block.offset
                self.blocks = [one for one in self.blocks if one.offset < end]
                self.attachments = [one for one in self.attachments if one.offset < end]
                return
            yield part

    def _content(self, block: Block) -> bytes:
        """Return the records of a block; raises Damage."""
        data = self._source.read(block.offset, block.length)
        if data[0] != Opcode.CHUNK:
            return data
        chunk = parse(Chunk, data[HEAD.size :], block.offset)
        self.compressions.add(chunk.compression or "none")
        return chunk_content(chunk, block.offset)

    def _part(self, blocks: Sequence[Block]) -> Part:
        """Return the messages of blocks, as one part; raises Damage."""
        contents = [self._content(block) for block in blocks]
        starts = np.cumsum([0, *map(len, contents[:-1])])
        return self._understand(b"".join(contents), starts, blocks[0].offset)

    def _take(self, record: RecordPlace) -> None:
        """Read one record, completely or not at all; raises Damage."""
        match record.opcode:
            case opcode if opcode < _PRIVATE and opcode not in set(Opcode):
                raise Damage(record.offset, describe(opcode))
            case Opcode.DATA_END | Opcode.FOOTER:
                self._ended = True
            case Opcode.METADATA:
                found = parse(Metadata, self._body(record), record.offset)
                self.metadata.append((found.name, found.metadata))
            case Opcode.CHUNK:
                self._take_chunk(record)
            case Opcode.ATTACHMENT:
                self._take_attachment(record)
            case opcode if opcode in _BARE:
                self._take_bare(record)

    def _body(self, record: RecordPlace) -> bytes:
        return self._source.read(record.body, record.length)

    def _take_chunk(self, record: RecordPlace) -> None:
        head = self._source.read(record.body, min(record.length, 64))
        try:
            start_ns, end_ns, size, _, name = _CHUNK_HEAD.unpack_from(head)
            [data] = LENGTH.unpack_from(head, _CHUNK_HEAD.size + name)
        except struct.error:
            data = name = -1
        if _CHUNK_HEAD.size + name + LENGTH.size + data != record.length:
            why = "a chunk record whose fields do not fit into it"
            raise Damage(record.offset, why)
        length = record.end - record.offset
        block = Block(record.offset, length, size, start_ns, end_ns)
        # A recorder writes its topics before the first message, and the run at time 0.
        early = not (self.topics and end_ns)
        if size and not (early and not len(self._part([block]).heads)):
            self.blocks.append(block)

    def _take_bare(self, record: RecordPlace) -> None:
        """Read a message outside of chunks, or the definition of a channel."""
        data = self._source.read(record.offset, HEAD.size + record.length)
        heads = self._understand(data, np.zeros(1, dtype=int), record.offset).heads
        for log_ns in heads["log_ns"].tolist():
            self.blocks.append(
                Block(record.offset, len(data), len(data), log_ns, log_ns)
            )

    def _take_attachment(self, record: RecordPlace) -> None:
        body = self._body(record)
        found = parse(AttachmentRecord, body, record.offset)
        expected = int.from_bytes(body[-_CRC_BYTES:], "little")
        if expected not in (0, zlib.crc32(body[:-_CRC_BYTES])):
            what = f"the checksum of attachment {found.name!r} is wrong"
            raise Damage(record.offset, what)
        size = len(found.data)
        where = size, record.end - _CRC_BYTES - size, self
        self.attachments.append(
            Attachment(found.name, found.media_type, found.log_time, *where)
        )

    def _define(self, opcode: int, body: bytes, offset: int) -> None:
        """Register a schema or a channel; other records define nothing."""
        if opcode == Opcode.SCHEMA:
            schema = parse(Schema, body, offset)
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = parse(Channel, body, offset)
            topic = topic_of(channel, self._schemas, offset)
            self.topics[channel.id] = topic
            self.counts[topic.name] += 0
            self._known[channel.id] = True

    def _understand(self, content: bytes, starts: np.ndarray, offset: int) -> Part:
        """Return the messages among records, and register the channels that the records define."""
        places, heads, others = message_heads(content, starts, offset)
        for opcode, begin, end in others:
            self._define(opcode, content[begin:end], offset)
        if not self._known[heads["channel"]].all():
            self._define_before(offset)
        known = self._known[heads["channel"]]
        if not known.all():
            channel = heads["channel"][~known][0]
            raise Damage(offset, f"a message of the unknown channel {channel}")
        return Part(content, places + HEAD.size + MESSAGE.size, heads)

    def _define_before(self, offset: int) -> None:
        """Register the channels that are defined in the blocks before an offset."""
        for block in self.blocks:
            if block.offset >= offset:
                return
            content = self._content(block)
            _, _, others = message_heads(content, np.zeros(1, dtype=int), block.offset)
            for opcode, begin, end in others:
                self._define(opcode, content[begin:end], block.offset)

    def _count(self, heads: np.ndarray) -> None:
        """Count messages, and the bytes of their data."""
        counts = np.bincount(heads["channel"])
        sizes = np.bincount(heads["channel"], heads["length"] - MESSAGE.size)
        for channel in np.flatnonzero(counts).tolist():
            name = self.topics[channel].name
            self.counts[name] += int(counts[channel])
            self.sizes[name] += int(sizes[channel])


def _has_end(source: Source, size: int) -> bool:
    """Return whether a file has the end that `BagWriter.close` writes."""
    tail = len(_FOOTER) + 20 + len(MAGIC)
    with suppress(Damage):  # it is shorter
        data = source.read(size - tail, tail)
        return data.startswith(_FOOTER) and data.endswith(MAGIC)
    return False
