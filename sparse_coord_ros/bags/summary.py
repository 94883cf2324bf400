# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The end of an MCAP file, compared with what was found in the file before it."""

import zlib
from collections import Counter
from hashlib import blake2b

from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Footer,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from sparse_coord_ros.bags.records import HEAD, MAGIC, Damage, Source, check_crc, describe, parse

_KINDS: dict[int, type] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.STATISTICS: Statistics,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
}
_FOOTER_BYTES = 20


class Found:
    """What was found in a data section, as far as the summary repeats it.

    Of the entries of the indexes only their number and the sum of their hashes are kept, so that
    memory does not grow with the file.

    Attributes:
        counts: messages by channel id, of channels that have any.
        start_ns, end_ns: earliest and latest log time, 0 without messages.
        chunks: number of chunks.
    """

    def __init__(self) -> None:
        """Nothing yet."""
        self.counts: dict[int, int] = {}
        self.start_ns = self.end_ns = 0
        self.chunks = 0
        self.numbers: Counter[int] = Counter()
        self._hashes: Counter[int] = Counter()

    def add(self, opcode: int, entry: tuple) -> None:
        """Add an entry of the index of this kind."""
        self.numbers[opcode] += 1
        digest = blake2b(repr(entry).encode(), digest_size=16).digest()
        self._hashes[opcode] += int.from_bytes(digest, "little")

    def same(self, other: "Found", opcode: int) -> bool:
        """Whether both have the same entries of a kind."""
        return (
            self.numbers[opcode] == other.numbers[opcode]
            and self._hashes[opcode] == other._hashes[opcode]
        )


def read_summary(
    source: Source,
    found: Found,
    channels: dict[int, Channel],
    schemas: dict[int, Schema],
    *,
    own: bool,
) -> None:
    """Check summary, footer and magic, which end the file.

    Args:
        source: the file, after its data section.
        found: what was found there.
        channels: the channels found there; those only the summary has are added.
        schemas: likewise.
        own: whether every checksum and index must be there, as `BagWriter` writes them.

    Raises:
        Damage: a byte is wrong, missing or too many, or summary and data disagree.
    """
    start = source.position
    summary = _Summary(found, channels, schemas, own=own)
    source.crc = 0
    while True:
        offset = source.position
        if not source.rest:
            raise Damage(offset, "the file ends before its footer")
        crc = source.crc
        opcode, length = source.head()
        if opcode == Opcode.FOOTER:
            break
        summary.take(opcode, source.read(length), offset)
    if length != _FOOTER_BYTES:
        raise Damage(offset, f"a footer of {length} bytes")
    body = source.read(length)
    footer = parse(Footer, body, offset)
    crc = zlib.crc32(HEAD.pack(opcode, length) + body[:-4], crc)
    check_crc(footer.summary_crc, crc, offset, "the summary", required=own)
    places = 0 if offset == start else start, summary.offsets_start
    if (footer.summary_start, footer.summary_offset_start) != places:
        raise Damage(offset, "a footer that does not say where the summary is")
    summary.compare(start)
    if source.rest != len(MAGIC) or source.read(len(MAGIC)) != MAGIC:
        raise Damage(source.size, "the file does not end with MCAP's magic bytes")


class _Summary:
    """The summary's records, and what is to be compared when all are there."""

    def __init__(self, found, channels, schemas, *, own: bool) -> None:
        self.offsets_start = 0
        self._data = found
        self._channels, self._schemas = channels, schemas
        self._own = own
        self._read = Found()
        self._repeated: dict[int, set[int]] = {Opcode.CHANNEL: set(), Opcode.SCHEMA: set()}
        self._statistics: Statistics | None = None
        self._groups: dict[int, tuple[int, int]] = {}
        self._stated: dict[int, tuple[int, int]] = {}

    def take(self, opcode: int, body: bytes, offset: int) -> None:
        """Take one record."""
        kind = _KINDS.get(opcode)
        if kind is None:
            if opcode >= 0x80 and not self._own:
                return
            raise Damage(offset, f"{describe(opcode)}, which has no business in the summary")
        record = parse(kind, body, offset)
        begin, _ = self._groups.get(opcode, (offset, 0))
        self._groups[opcode] = begin, offset + HEAD.size + len(body) - begin
        if kind is SummaryOffset:
            self.offsets_start = begin
            self._stated[record.group_opcode] = record.group_start, record.group_length
        elif kind is Statistics:
            self._statistics = record
        elif kind in (Channel, Schema):
            known = self._channels if kind is Channel else self._schemas
            self._repeated[opcode].add(record.id)
            if known.setdefault(record.id, record) != record:
                raise Damage(offset, f"the summary has another {describe(opcode)} {record.id}")
        else:
            self._read.add(opcode, _entry(record))

    def compare(self, start: int) -> None:
        """Raise Damage unless all records together say what was found."""
        for opcode in (Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX):
            absent = not (self._own or self._read.numbers[opcode])
            if not (absent or self._read.same(self._data, opcode)):
                raise Damage(start, f"the summary's {_name(opcode)} is not that of the data")
        for opcode, known in (
            (Opcode.CHANNEL, self._channels),
            (Opcode.SCHEMA, self._schemas),
        ):
            if self._repeated[opcode] != set(known) and (self._own or self._repeated[opcode]):
                raise Damage(start, f"the summary does not repeat every {_name(opcode)}")
        for code, (begin, length) in self._stated.items():
            if self._groups.get(code, (begin, 0)) != (begin, length):
                raise Damage(start, f"the summary's {_name(code)} records are elsewhere")
        statistics, data = self._statistics, self._data
        if statistics is None:
            if self._own:
                raise Damage(start, "the summary has no statistics")
            return
        counts = {c: n for c, n in statistics.channel_message_counts.items() if n}
        stated = (
            ("messages", statistics.message_count, sum(data.counts.values())),
            ("messages in its channels", counts, data.counts),
            ("chunks", statistics.chunk_count, data.chunks),
            ("attachments", statistics.attachment_count, data.numbers[Opcode.ATTACHMENT_INDEX]),
            ("metadata records", statistics.metadata_count, data.numbers[Opcode.METADATA_INDEX]),
            ("channels", statistics.channel_count, len(self._channels)),
            ("schemas", statistics.schema_count, len(self._schemas)),
            ("ns as first time", statistics.message_start_time, data.start_ns),
            ("ns as last time", statistics.message_end_time, data.end_ns),
        )
        for what, said, found in stated:
            if said != found:
                raise Damage(start, f"the summary says {said} {what}, but there are {found}")


def _name(opcode: int) -> str:
    return Opcode(opcode).name.lower().replace("_", " ") if opcode in set(Opcode) else str(opcode)


def _entry(record: ChunkIndex | AttachmentIndex | MetadataIndex) -> tuple:
    """Return an index's entry as `Found.add` takes it from the data section."""
    if isinstance(record, ChunkIndex):
        return (
            record.message_start_time,
            record.message_end_time,
            record.chunk_start_offset,
            record.chunk_length,
            sorted(record.message_index_offsets.items()),
            record.message_index_length,
            record.compression,
            record.compressed_size,
            record.uncompressed_size,
        )
    if isinstance(record, AttachmentIndex):
        return (
            record.offset,
            record.length,
            record.log_time,
            record.create_time,
            record.data_size,
            record.name,
            record.media_type,
        )
    return record.offset, record.length, record.name
