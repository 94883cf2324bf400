# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where in an MCAP file its chunks and attachments lie, found without reading what is in them.

`open_bag` checks every byte, which takes a minute for a bag of a million time steps. A walk reads
the heads of records only: milliseconds, finished file or not, and it goes on where the file has
grown since. What it hands out is checked when it is read.
"""

import os
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema

from sparse_coord_ros.bags.layout import open_to_read
from sparse_coord_ros.bags.reader import Attachments, Bag, Part, bag_file
from sparse_coord_ros.bags.records import (
    HEAD,
    LARGEST_RECORD,
    MAGIC,
    MESSAGE,
    PIECE,
    Damage,
    chunk_content,
    describe,
    message_heads,
    parse,
)
from sparse_coord_ros.bags.scan import AttachmentPlace
from sparse_coord_ros.bags.topics import BagTopic, topic_of
from sparse_coord_ros.errors import BagError

_TIMES = struct.Struct("<QQ")
_LENGTH = struct.Struct("<I")
_SIZE = struct.Struct("<Q")


class NoChunks(BagError):  # noqa: N818
    """The file holds messages outside of chunks: only `open_bag` reads it."""


Heard = Callable[[float], None]
"""Hears which share of what is read was read."""


class ChunkPlace(NamedTuple):
    """A chunk of a file.

    Attributes:
        offset: of its record.
        length: bytes of the record's body.
        start_ns, end_ns: earliest and latest log time of its messages.
    """

    offset: int
    length: int
    start_ns: int
    end_ns: int


class Walk:
    """What is where in a bag; the file stays open, so that it may be renamed or removed meanwhile.

    Args:
        path: a bag's directory, that of a run with a `bag` in it, an `.mcap` or `.mcap.partial`.

    Attributes:
        path: the MCAP file.
        chunks: the chunks with messages, in the order of the file.
        finished: whether the end of the data was reached, so that no more will come.
        damage: where the file cannot be read any further, and why; None: nowhere yet.
        topics: by channel, as far as chunks or the summary told.

    Raises:
        BagError: there is no such file, or it does not begin as MCAP.
        NoChunks: it holds messages outside of chunks.
    """

    def __init__(self, path: Path) -> None:
        self.path = bag_file(Path(path))
        self._file: BinaryIO = open_to_read(self.path)
        self.chunks: list[ChunkPlace] = []
        self.finished = False
        self.damage: str | None = None
        self.topics: dict[int, BagTopic] = {}
        self._schemas: dict[int, Schema] = {}
        self._attachments: list[AttachmentPlace] = []
        self._metadata: list[tuple[str, dict[str, str]]] = []
        self._position = len(MAGIC)
        try:
            if self._read(0, len(MAGIC)) != MAGIC:
                raise BagError(f"{self.path} is not an MCAP file: it does not begin like one")
        except Damage:
            raise BagError(
                f"{self.path} is not an MCAP file: it does not begin like one"
            ) from None
        self.extend()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def extend(self) -> bool:
        """Walk on to where the file ends now; return whether there was anything new."""
        before = self._position
        try:
            size = os.fstat(self._file.fileno()).st_size
            while not self.finished and self.damage is None:
                if size - self._position < HEAD.size:
                    break
                opcode, length = HEAD.unpack(self._read(self._position, HEAD.size))
                if length > LARGEST_RECORD and opcode != Opcode.ATTACHMENT:
                    what = f"{describe(opcode)} of {length} bytes"
                    raise Damage(self._position, f"{what}, which is implausible")
                if length > size - self._position - HEAD.size:
                    break  # it is being written, or the file was cut here
                self._record(opcode, self._position + HEAD.size, length)
                self._position += HEAD.size + length
        except Damage as damage:
            self.damage = str(damage)
        except OSError as error:
            self.damage = f"byte {self._position}: cannot be read ({error.strerror})"
        return self._position != before

    def _read(self, offset: int, length: int) -> bytes:
        data = os.pread(self._file.fileno(), length, offset)
        if len(data) != length:
            raise Damage(offset + len(data), "the file has become shorter")
        return data

    def _record(self, opcode: int, begin: int, length: int) -> None:
        if opcode == Opcode.CHUNK:
            if length < _TIMES.size:
                raise Damage(begin, "a chunk record whose fields do not fit into it")
            start_ns, end_ns = _TIMES.unpack(self._read(begin, _TIMES.size))
            place = ChunkPlace(begin - HEAD.size, length, start_ns, end_ns)
            # A recorder tells of its topics before the first message, and of the run at time 0.
            first = [] if self.topics and end_ns else list(self.parts([place]))
            if end_ns or any(len(part.heads) for part in first):
                self.chunks.append(place)
        elif opcode == Opcode.ATTACHMENT:
            self._attachments.append(self._attachment(begin, length))
        elif opcode == Opcode.METADATA:
            record = parse(Metadata, self._read(begin, length), begin - HEAD.size)
            self._metadata.append((record.name, record.metadata))
        elif opcode == Opcode.MESSAGE:
            raise NoChunks(f"{self.path}: holds messages outside of chunks")
        elif opcode == Opcode.DATA_END:
            self.finished = True

    def _attachment(self, begin: int, length: int) -> AttachmentPlace:
        head = self._read(begin, min(length, 2 * _TIMES.size + 2 * PIECE))
        texts = []
        place = _TIMES.size
        try:
            log_ns = _TIMES.unpack_from(head)[0]
            for _ in range(2):
                (size,) = _LENGTH.unpack_from(head, place)
                place += _LENGTH.size
                texts.append(head[place : place + size].decode())
                place += size
            (size,) = _SIZE.unpack_from(head, place)
        except (struct.error, UnicodeDecodeError):
            size = -1
        place += _SIZE.size
        if size != length - place - _LENGTH.size:
            raise Damage(begin - HEAD.size, "an attachment whose fields do not fit into it")
        return AttachmentPlace(texts[0], texts[1], log_ns, begin + place, size)

    def parts(
        self, places: Sequence[ChunkPlace], size: int = 0, heard: Heard | None = None
    ) -> Iterator[Part]:
        """Yield the messages of chunks in parts of whole chunks, of at least `size` bytes each.

        At the first damage they end; `damage` says so, and nothing behind it is read any more.
        """
        total, read = sum(place.length for place in places), 0
        group: list[ChunkPlace] = []
        waiting: list[bytes] = []
        for place in places:
            try:
                chunk = parse(
                    Chunk, self._read(place.offset + HEAD.size, place.length), place.offset
                )
                waiting.append(chunk_content(chunk, place.offset, crc_required=False))
                group.append(place)
            except (Damage, OSError) as error:
                self._end_at(place, error)
                break
            read += place.length
            if sum(map(len, waiting)) > size:
                yield from self._part(group, waiting)
                group, waiting = [], []
                if heard is not None:
                    heard(read / total)
        if group:
            yield from self._part(group, waiting)
            if heard is not None:
                heard(read / total)

    def _part(self, group: Sequence[ChunkPlace], contents: Sequence[bytes]) -> Iterator[Part]:
        """Yield the messages among chunks' records; note the topics that they tell of."""
        content, offset = b"".join(contents), group[0].offset
        try:
            places, heads, others = message_heads(content, offset)
            for opcode, _, begin, end in others:
                if opcode == Opcode.SCHEMA:
                    schema = parse(Schema, content[begin:end], offset)
                    self._schemas[schema.id] = schema
                elif opcode == Opcode.CHANNEL:
                    channel = parse(Channel, content[begin:end], offset)
                    self.topics[channel.id] = topic_of(channel, self._schemas, offset)
        except Damage as damage:
            self._end_at(group[0], damage)
            return
        yield Part(content, places + HEAD.size + MESSAGE.size, heads)

    def _end_at(self, place: ChunkPlace, error: Damage | OSError) -> None:
        """Read nothing any more from a chunk on that cannot be read."""
        self.damage = str(error) if isinstance(error, Damage) else f"{error.strerror}"
        self.chunks = [one for one in self.chunks if one.offset < place.offset]

    @property
    def attachments(self) -> Attachments:
        """The attachments found so far."""
        return Attachments([self.path] * len(self._attachments), self._attachments)

    def attached(self, place: AttachmentPlace) -> bytes:
        """Return an attachment's bytes; raises BagError."""
        try:
            return self._read(place.offset, place.size)
        except Damage as damage:
            raise BagError(f"{self.path}: {damage}") from None

    def bag(
        self, first_ns: int = 0, last_ns: int | None = None, heard: Heard | None = None
    ) -> "PartOfBag":
        """Return the chunks that have messages of some log times, as a bag of their own."""
        chosen = [
            place
            for place in self.chunks
            if place.end_ns >= first_ns and (last_ns is None or place.start_ns <= last_ns)
        ]
        names = {channel: topic.name for channel, topic in self.topics.items()}
        nothing = dict.fromkeys(names.values(), 0)
        first_texts: dict[str, dict[str, str]] = {}
        for name, texts in self._metadata:
            first_texts.setdefault(name, texts)
        return PartOfBag(
            path=self.path,
            finished=self.finished,
            damage=self.damage,
            topics={topic.name: topic for topic in self.topics.values()},
            metadata_records=tuple(self._metadata),
            metadata=first_texts,
            attachments=self.attachments,
            counts=nothing,
            sizes=nothing,
            message_count=0,
            start_ns=min((place.start_ns for place in chosen), default=0),
            end_ns=max((place.end_ns for place in chosen), default=0),
            compressions=(),
            file_bytes=self._position,
            readable_bytes=self._position,
            lost_bytes=0,
            whole=self.finished,
            _names=names,
            walk=self,
            chosen=tuple(chosen),
            heard=heard,
        )


@dataclass(frozen=True, kw_only=True)
class PartOfBag(Bag):
    """Some chunks of a bag; its messages are not counted, nor checked beyond what is read."""

    walk: Walk = field(repr=False)
    chosen: tuple[ChunkPlace, ...] = field(repr=False)
    heard: Heard | None = field(repr=False)

    def parts(self, size: int = 0) -> Iterator[Part]:
        """Yield the messages in parts of whole chunks, as `Bag.parts`."""
        return self.walk.parts(self.chosen, size, self.heard)
