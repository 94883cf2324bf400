# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads one MCAP file, finished or not; finds the parts that cannot be read."""

import struct
import zlib
from bisect import bisect_left
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
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, Metadata, Schema

from sparse_coord_ros.base.errors import BagError, retold
from sparse_coord_ros.base.limits import CHUNK, CHUNKS, RECORDS
from sparse_coord_ros.log.bags.gaps import Gap, from_note
from sparse_coord_ros.log.bags.layout import PARTIAL
from sparse_coord_ros.log.bags.metadata import (
    CONTINUED_RECORD,
    RECOVERED_RECORD,
    FileSummary,
)
from sparse_coord_ros.log.bags.records import (
    HEAD,
    LATEST_NS,
    LENGTH,
    MAGIC,
    MESSAGE,
    Cut,
    Damage,
    RecordPlace,
    Source,
    check_crc,
    chunk_content,
    describe,
    message_heads,
    parse,
)
from sparse_coord_ros.log.bags.topics import BagTopic, topic_of

OWN_LIBRARY = "sparse_coord_ros "
"""Beginning of the header of a file by `BagWriter`: such files have every checksum."""

CUT_OFF = "the file ends here, without an end: it was cut off"
SEARCHED = 1 << 24
"""Most bytes of records that a search tries, in addition to the file's size."""
SEARCH = 1 << 12
TRIED = 1 << 11
"""The cost of a search, and of each of its places where a record may begin, in such bytes."""

TOGETHER = 1 << 20
"""Bytes that are read at once."""

_CHUNK_HEAD = struct.Struct("<QQQII")
"""Earliest and latest time, size and checksum of the content, length of the compression's name."""
_CRC_BYTES = 4
_BARE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_OTHERS = {Opcode.HEADER, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT}
_OTHERS |= {Opcode.METADATA, Opcode.DATA_END}
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

    After damage, a bad record is skipped by its length if another record follows it.
    Otherwise the next valid record is searched: with the right kind, length and checksum,
    and the record after it. The end of a file that is not checked may be a record that is being
    written: that is no gap.

    Args:
        path: the file.
        checked: read every byte, compare every checksum, count the messages.

    Attributes:
        path: the file.
        finished: whether its recorder closed it: the file has its end.
        size: its size in bytes.
        readable_bytes: the end of its readable data.
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
        self._checked = False
        self._grows = not checked
        self._lost: list[tuple[int, int, str]] = []
        self._flaw: str | None = None
        self.size = 0
        self.readable_bytes = len(MAGIC)
        self.topics: dict[int, BagTopic] = {}
        self.counts: Counter[str] = Counter()
        self.sizes: Counter[str] = Counter()
        self.metadata: list[tuple[str, Mapping[str, str]]] = []
        self.attachments: list[Attachment] = []
        self.blocks: list[Block] = []
        self.compressions: set[str] = set()
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._known = np.zeros(1 << 16, dtype=bool)
        self._own = False
        # A writer of one checksum writes all. So a zeroed checksum is damage, not an absent one.
        self._crcs = False
        self._altered = False
        # The record that ends the data, and the checksum of the data.
        self._end: tuple[RecordPlace, int] | None = None
        self._tried = 0
        self._contents = 0
        self._source = Source(path)
        with retold(BagError, BagError, f"{path}"):
            self.extend()
            if checked:
                self._check()

    @property
    def summary(self) -> FileSummary:
        """Its description in `metadata.yaml`."""
        start_ns = min((block.start_ns for block in self.blocks), default=0)
        end_ns = max((block.end_ns for block in self.blocks), default=0)
        return FileSummary(self.path.name, dict(self.counts), start_ns, end_ns)

    @property
    def gaps(self) -> list[Gap]:
        """The gaps that are known so far, beginning with those that `recover` has left out."""
        found = []
        if self.recovered is not None:
            found += from_note(self.recovered.get("gaps", ""))
        offsets = [block.offset for block in self.blocks]
        for begin, end, why in self._lost:
            at = bisect_left(offsets, begin)
            first_ns = self.blocks[at - 1].end_ns if at else None
            last_ns = self.blocks[at].start_ns if at < len(offsets) else None
            if first_ns is not None and last_ns is not None:
                # The messages of two chunks may overlap in time.
                first_ns, last_ns = sorted([first_ns, last_ns])
            found.append(Gap(begin, end, why, first_ns, last_ns, self.path.name))
        return found

    @property
    def damage(self) -> str | None:
        """The first gap, or a damaged end of the file: place and one sentence; None: neither."""
        if not self._lost:
            return self._flaw
        begin, _, why = self._lost[0]
        return f"byte {begin}: {why}"

    @property
    def whole(self) -> bool:
        """True if every record of the data was read; the summary may be damaged."""
        return not self._lost and not self._altered

    @property
    def recovered(self) -> Mapping[str, str] | None:
        """The note of `recover`, if it made this file of a damaged one; else None.

        Its key `gaps` holds the gaps of the original, see `gaps.from_note`.
        """
        return dict(reversed(self.metadata)).get(RECOVERED_RECORD)

    @property
    def continued(self) -> Mapping[str, str] | None:
        """Why this file continues a bag (see `metadata.CONTINUED_RECORD`); None: it does not."""
        return dict(reversed(self.metadata)).get(CONTINUED_RECORD)

    def extend(self) -> bool:
        """Read on to the current end of the file; return whether it has new records."""
        before = self.readable_bytes
        size = self._source.size
        if size == self.size:
            return False
        self.size = size
        self.finished = _has_end(self._source, size)
        while self._end is None and self.readable_bytes < self.size:
            if not self._step():
                break
        return self.readable_bytes != before

    def _step(self) -> bool:
        """Read the next record, or note a damaged part; return False at a record being written."""
        begin = self.readable_bytes
        try:
            record = self._source.record(begin, self.size)
            self._take(record)
        except Damage as damage:
            found = self._after_damage(begin)
            being_written = self._grows and not self.finished
            if found is None and isinstance(damage, Cut) and being_written:
                return False
            stop, end = found or (self.size, self.size)
            self._lose(begin, stop, damage.problem)
        else:
            stop = begin
            end = record.end
        # The record that ends the data is not part of them.
        self.readable_bytes = end if self._end is None else stop
        return True

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._source.close()

    def read(self, offset: int, length: int) -> bytes:
        """Return bytes of the file; raises BagError if they no longer exist."""
        try:
            return self._source.read(offset, length)
        except Damage as damage:
            raise self._changed(damage) from damage

    def parts(self, blocks: Sequence[Block]) -> Iterator[Part]:
        """Yield the messages of blocks; small blocks together.

        In a file that is not checked, unreadable messages are left out and noted as gaps.

        Raises:
            BagError: the file was checked, and has changed since.
        """
        totals = accumulate(block.size for block in blocks)
        for _, near in groupby(
            zip(blocks, totals, strict=True), lambda one: one[1] // TOGETHER
        ):
            group = [block for block, _ in near]
            try:
                part = self._part(group)
            except Damage as damage:
                if len(group) > 1:
                    for block in group:
                        yield from self.parts([block])
                elif self._checked:
                    raise self._changed(damage) from damage
                else:
                    [block] = group
                    end = block.offset + block.length
                    self._lose(block.offset, end, damage.problem)
            else:
                yield part

    def _changed(self, damage: Damage) -> BagError:
        return BagError(f"{self.path} has changed while it was read: {damage}")

    def _lose(self, begin: int, end: int, why: str) -> None:
        """Note unreadable bytes; neighbouring gaps become one."""
        lost = self._lost
        blocks = self.blocks
        if not lost and self.finished:
            with suppress(Damage):  # repeats the definitions of lost chunks
                summary = self._source.read(self.size - len(MAGIC) - 20, 8)
                self._check_summary(int.from_bytes(summary, "little"))
        at = bisect_left(blocks, begin, key=lambda block: block.offset)
        if blocks[at : at + 1] and blocks[at].offset < end:
            del blocks[at]
        at = bisect_left(lost, begin, key=lambda gap: gap[0])
        if at and lost[at - 1][1] >= begin:
            at -= 1
            begin, before, why = lost.pop(at)
            end = max(end, before)
        if lost[at : at + 1] and lost[at][0] <= end:
            end = lost.pop(at)[1]
        lost.insert(at, (begin, end, why))

    def _after_damage(self, begin: int) -> tuple[int, int] | None:
        """Return the end of a damaged part, and the offset of the next record; None: none follows.

        A bad record of the right length is skipped. Otherwise the next whole record is searched.
        """
        self._tried += TRIED
        with suppress(Damage):
            record = self._source.head(begin, self.size)
            fits = record.end <= self.size and self._framed(record)
            if fits and self._tried < SEARCHED + self.size:
                return record.end, record.end
            if record.opcode == Opcode.CHUNK:
                self._block(record)  # raises Damage if its fields do not fit into it
                return None  # the end of the file cuts this chunk off
        return self._next_whole_record(begin + 1)

    def _next_whole_record(self, begin: int) -> tuple[int, int] | None:
        """Read the next whole, valid record; return its place and its end.

        Returns:
            None if no such record follows, or if a forged file makes the search too long.
        """
        self._tried += SEARCH
        for place in self._source.places(begin, self.size):
            if self._tried > SEARCHED + self.size:
                return None
            self._tried += TRIED
            with suppress(Damage):
                record = self._source.record(place, self.size)
                if not self._framed(record):
                    continue
                self._tried += record.length
                if record.opcode == Opcode.CHUNK:
                    block, _ = self._block(record)
                    self._part([block])
                self._take(record)
                return place, record.end
        return None

    def _framed(self, record: RecordPlace) -> bool:
        """Return whether a record's length fits its own fields, or another record follows."""
        with suppress(Damage):
            if record.opcode == Opcode.CHUNK:
                return self._block(record) is not None
        try:
            return self._belongs(self._source.head(record.end, self.size))
        except Cut:
            return True  # the file ends there
        except Damage:
            return False

    def _content(self, block: Block) -> bytes:
        """Return the records of a block; raises Damage."""
        data = self._source.read(block.offset, block.length)
        if data[0] != Opcode.CHUNK:
            return data
        chunk = parse(Chunk, data[HEAD.size :], block.offset)
        content = chunk_content(chunk, block.offset, crc_required=self._crcs)
        self._crcs |= chunk.uncompressed_crc != 0
        self.compressions.add(chunk.compression or "none")
        return content

    def _part(self, blocks: Sequence[Block]) -> Part:
        """Return the messages of blocks, as one part; raises Damage."""
        contents = [self._content(block) for block in blocks]
        starts = np.cumsum([0, *map(len, contents[:-1])])
        part = self._understand(b"".join(contents), starts, blocks[0].offset)
        times = part.heads["log_ns"]
        firsts = np.searchsorted(part.begins, starts, side="right")
        if len(times) and not _times_fit(blocks, times, firsts):
            raise Damage(
                blocks[0].offset, "a chunk whose times are not those of its messages"
            )
        return part

    def _belongs(self, record: RecordPlace) -> bool:
        """Return whether a record of this kind may be at its place."""
        if (record.opcode == Opcode.HEADER) != (record.offset == len(MAGIC)):
            return False
        foreign = record.opcode >= 0x80 or record.opcode in _BARE
        return not self._own if foreign else record.opcode in _OTHERS

    def _take(self, record: RecordPlace) -> None:
        """Read one record, completely or not at all; raises Damage."""
        if not self._belongs(record):
            raise Damage(
                record.offset, f"{describe(record.opcode)}, which is not allowed there"
            )
        if len(self.metadata) + len(self.attachments) > RECORDS:
            raise BagError(
                f"more than {RECORDS:,} attachments and metadata records are not read"
            )
        match record.opcode:
            case Opcode.HEADER:
                header = parse(Header, self._body(record), record.offset)
                self._own = self._crcs = header.library.startswith(OWN_LIBRARY)
            case Opcode.METADATA:
                found = parse(Metadata, self._body(record), record.offset)
                self.metadata.append((found.name, found.metadata))
            case Opcode.DATA_END:
                end = parse(DataEnd, self._body(record), record.offset)
                self._end = record, end.data_section_crc
            case Opcode.CHUNK:
                self._take_chunk(record)
            case Opcode.ATTACHMENT:
                self._take_attachment(record)
            case Opcode.MESSAGE_INDEX:  # unused, but its length tells it from damage
                size = int.from_bytes(self._source.read(record.body + 2, 4), "little")
                if size != record.length - 6:
                    raise Damage(
                        record.offset, "a message index whose fields do not fit into it"
                    )
            case opcode if opcode in _BARE:
                self._take_bare(record)

    def _body(self, record: RecordPlace) -> bytes:
        return self._source.read(record.body, record.length)

    def _block(self, record: RecordPlace) -> tuple[Block, int]:
        """Return the place of a chunk and the checksum of its content; raises Damage."""
        head = self._source.read(record.body, min(record.length, 64))
        with suppress(struct.error):
            start_ns, end_ns, content, crc, name = _CHUNK_HEAD.unpack_from(head)
            [size] = LENGTH.unpack_from(head, _CHUNK_HEAD.size + name)
            if _CHUNK_HEAD.size + name + LENGTH.size + size == record.length:
                length = record.end - record.offset
                return Block(record.offset, length, content, start_ns, end_ns), crc
        raise Damage(record.offset, "a chunk record whose fields do not fit into it")

    def _take_chunk(self, record: RecordPlace) -> None:
        block, crc = self._block(record)
        self._contents += min(block.size, CHUNK.bytes)  # more is damage, and is refused
        if self._contents > CHUNKS.bytes + CHUNKS.elements * self.size:
            problem = f"a chunk of {block.size} bytes after too many for this file"
            raise Damage(record.offset, problem)
        # A recorder writes its topics before the first message, and the run at time 0.
        early = not (self.topics and block.end_ns)
        is_empty = not block.size and not crc
        if is_empty or (early and not len(self._part([block]).heads)):
            return
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
        what = f"attachment {found.name!r}"
        crc = zlib.crc32(body[:-_CRC_BYTES])
        check_crc(expected, crc, record.offset, what, required=self._crcs)
        self._crcs |= expected != 0
        if found.log_time > LATEST_NS:
            raise Damage(record.offset, f"{what} has an impossible time")
        size = len(found.data)
        where = size, record.end - _CRC_BYTES - size, self
        self.attachments.append(
            Attachment(found.name, found.media_type, found.log_time, *where)
        )

    def _check(self) -> None:
        """Read the blocks, and compare the checksums of the file."""
        most = RECORDS + self.size
        for part in self.parts(tuple(self.blocks)):
            self._count(part.heads)
            if self.counts.total() > most:
                raise BagError(
                    f"more than {most:,} messages in {self.size:,} bytes are not read"
                )
        self._checked = True
        closed = self.path.suffix != PARTIAL
        if self._end is None:
            if closed:
                self._lose(self.size, self.size, CUT_OFF)
            return
        end, expected = self._end
        try:
            if not self._lost:
                self._check_data(end, expected)
            if end.end < self.size:
                self._check_summary(end.end)
            elif closed:
                raise Damage(self.size, CUT_OFF)
        except Damage as damage:
            self._flaw = str(damage)

    def _check_data(self, end: RecordPlace, expected: int) -> None:
        """Compare the checksum of the data before the record that ends them; raises Damage."""
        self._altered = True
        crc = 0
        for place in range(0, end.offset, TOGETHER):
            data = self._source.read(place, min(TOGETHER, end.offset - place))
            crc = zlib.crc32(data, crc)
        check_crc(expected, crc, end.offset, "the data before", required=self._own)
        self._altered = False

    def _check_summary(self, offset: int) -> None:
        """Check the end of a file; only its channels are used."""
        crc = 0
        read = self._source.read
        definitions = []
        record = self._source.record(offset, self.size)
        while record.opcode != Opcode.FOOTER:
            if record.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                definitions.append(record)
            crc = zlib.crc32(read(offset, record.end - offset), crc)
            offset = record.end
            record = self._source.record(offset, self.size)
        data = read(offset, record.end - offset)
        footer = parse(Footer, data[HEAD.size :], offset)
        crc = zlib.crc32(data[:-4], crc)
        check_crc(footer.summary_crc, crc, offset, "the summary", required=self._own)
        for one in definitions:
            self._define(one.opcode, self._body(one), one.offset)
        left = self.size - record.end
        if left != len(MAGIC) or read(record.end, left) != MAGIC:
            raise Damage(self.size, "the file does not end with MCAP's magic bytes")

    def _define(self, opcode: int, body: bytes, offset: int) -> None:
        """Register a schema or a channel; raises Damage if it contradicts an earlier one."""
        if opcode == Opcode.SCHEMA:
            schema = parse(Schema, body, offset)
            if self._schemas.setdefault(schema.id, schema) != schema:
                raise Damage(offset, f"a second, different schema {schema.id}")
            return
        channel = parse(Channel, body, offset)
        known = self._channels.get(channel.id)
        if known not in (None, channel):
            raise Damage(offset, f"a second, different channel {channel.id}")
        if known is None:
            topic = topic_of(channel, self._schemas, offset)
            for other in self.topics.values():
                if other.name == topic.name and other.type_name != topic.type_name:
                    raise Damage(offset, f"topic {topic.name!r} has a second type")
            self._channels[channel.id] = channel
            self.topics[channel.id] = topic
            self.counts[topic.name] += 0
            self._known[channel.id] = True

    def _understand(self, content: bytes, starts: np.ndarray, offset: int) -> Part:
        """Return the messages among records, and register the channels that the records define."""
        places, heads, others = message_heads(content, starts, offset)
        for times in (heads["log_ns"], heads["publish_ns"]):
            if times.max(initial=0) > LATEST_NS:
                raise Damage(offset, "a message with an impossible time")
        for opcode, begin, end in others:
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._define(opcode, content[begin:end], offset)
            elif self._own or opcode < 0x80:
                raise Damage(offset, f"{describe(opcode)} within a chunk")
        known = self._known[heads["channel"]]
        if not known.all():
            channel = heads["channel"][~known][0]
            raise Damage(offset, f"a message of the unknown channel {channel}")
        return Part(content, places + HEAD.size + MESSAGE.size, heads)

    def _count(self, heads: np.ndarray) -> None:
        """Count messages, and the bytes of their data."""
        counts = np.bincount(heads["channel"])
        sizes = np.bincount(heads["channel"], heads["length"] - MESSAGE.size)
        for channel in np.flatnonzero(counts).tolist():
            name = self.topics[channel].name
            self.counts[name] += int(counts[channel])
            self.sizes[name] += int(sizes[channel])


def _times_fit(blocks: Sequence[Block], times: np.ndarray, firsts: np.ndarray) -> bool:
    """Return whether the times of blocks are those of their messages.

    Args:
        blocks: the blocks.
        times: the log times of all their messages, in order; at least one.
        firsts: the number of each block's first message, shape (blocks,).
    """
    if firsts[-1] >= len(times):
        return False
    begins = [block.start_ns for block in blocks]
    ends = [block.end_ns for block in blocks]
    earliest = np.minimum.reduceat(times, firsts)
    latest = np.maximum.reduceat(times, firsts)
    return bool((earliest == begins).all() and (latest == ends).all())


def _has_end(source: Source, size: int) -> bool:
    """Return whether a file has the end that `BagWriter.close` writes."""
    tail = len(_FOOTER) + 20 + len(MAGIC)
    with suppress(Damage):  # it is shorter
        data = source.read(size - tail, tail)
        return data.startswith(_FOOTER) and data.endswith(MAGIC)
    return False
