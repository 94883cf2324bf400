# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP records out of bytes that may be damaged: whole and right, or `Damage` with the place."""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any, BinaryIO

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Chunk

PIECE = 1024 * 1024
"""Bytes of a long record to read at a time, and the longest name."""
MAGIC = b"\x89MCAP0\r\n"
LARGEST_RECORD = 256 * 1024 * 1024
"""Bytes of a record, or of a chunk's content; more is taken for damage. (Attachments: any.)"""

HEAD = struct.Struct("<BQ")
"""What every record begins with: opcode and length of the body."""
MESSAGE = struct.Struct("<HIQQ")
"""What a message's body begins with: channel, sequence, log time, publish time."""
MESSAGE_HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_ns", "<u8"),
        ("publish_ns", "<u8"),
    ]
)
"""A message record up to its data."""
LATEST_NS = 2**63 - 1
"""rosbag2 holds times as signed 64 bit nanoseconds."""

_NAMES = {int(opcode): opcode.name.lower().replace("_", " ") for opcode in Opcode}


class Damage(Exception):  # noqa: N818
    """The bytes at an offset are not what they should be; its text is one sentence."""

    def __init__(self, offset: int, problem: str) -> None:
        """Take the offset in the file and what is wrong there."""
        super().__init__(f"byte {offset}: {problem}")


class Source:
    """A file from which nothing is read that is not there.

    Attributes:
        size: bytes of the file when it was opened; what is appended later is not read.
        position: offset of the next byte.
        crc: CRC-32 of all bytes read; may be set to 0 to begin anew.
    """

    def __init__(self, file: BinaryIO, size: int) -> None:
        """Take an open file at its beginning."""
        self._file = file
        self.size = size
        self.position = 0
        self.crc = 0

    @property
    def rest(self) -> int:
        """Number of bytes that are left."""
        return self.size - self.position

    def read(self, length: int) -> bytes:
        """Return so many bytes; raises Damage if the file ends before."""
        if length > self.rest:
            raise Damage(self.size, f"the file ends, {length - self.rest} bytes too early")
        data = self._file.read(length)
        if len(data) != length:
            raise Damage(self.position + len(data), "the file has become shorter")
        self.crc = zlib.crc32(data, self.crc)
        self.position += length
        return data

    def seek(self, position: int) -> None:
        """Go to an offset; the checksum does not follow."""
        self._file.seek(position)
        self.position = position

    def head(self) -> tuple[int, int]:
        """Return the next record's opcode and length; raises Damage unless all of it is there."""
        offset = self.position
        if self.rest < HEAD.size:
            raise Damage(
                offset, f"the file ends within a record, of which {self.rest} bytes are left"
            )
        opcode, length = HEAD.unpack(self.read(HEAD.size))
        if length > self.rest:
            raise Damage(
                offset,
                f"{describe(opcode)} of {length} bytes, of which {self.rest} are in the file",
            )
        if length > LARGEST_RECORD and opcode != Opcode.ATTACHMENT:
            raise Damage(offset, f"{describe(opcode)} of {length} bytes, which is implausible")
        return opcode, length


def describe(opcode: int) -> str:
    """Return an opcode in words."""
    name = _NAMES.get(opcode)
    if name is None:
        return f"a record of unknown kind {opcode:#04x}"
    article = "an" if name[0] in "aeiou" else "a"
    return f"{article} {name} record"


class Fields:
    """The fields of one attachment record, taken one after the other.

    Attributes:
        left: bytes of the record that are not taken yet.
        crc: CRC-32 of those that are.
    """

    def __init__(self, source: Source, length: int, offset: int) -> None:
        """Take the file, at the record's body, its length and where the record begins."""
        self.left, self.crc = length, 0
        self._source, self._offset = source, offset

    def take(self, length: int) -> bytes:
        """Return the next bytes; raises Damage if the record has not so many."""
        if length > self.left:
            raise Damage(self._offset, "an attachment whose fields do not fit into it")
        data = self._source.read(length)
        self.left -= length
        self.crc = zlib.crc32(data, self.crc)
        return data

    def text(self) -> str:
        """Return the next text; raises Damage."""
        length = int.from_bytes(self.take(4), "little")
        if length > PIECE:
            raise Damage(self._offset, f"an attachment with a name of {length} bytes")
        try:
            return self.take(length).decode("utf-8")
        except UnicodeDecodeError as error:
            raise Damage(self._offset, "an attachment with a name that is not UTF-8") from error


class _Exact(ReadDataStream):
    """mcap's stream, which would hand back less than asked for, or fail at a huge length."""

    def __init__(self, body: bytes) -> None:
        super().__init__(BytesIO())
        self._body, self._place = body, 0

    @property
    def count(self) -> int:
        """Number of bytes read."""
        return self._place

    def read(self, length: int) -> bytes:
        """Return so many bytes, or raise EndOfFile."""
        begin = self._place
        if length > len(self._body) - begin:
            raise EndOfFile
        self._place += length
        return self._body[begin : self._place]


def parse(kind: Any, body: bytes, offset: int) -> Any:
    """Return a record of one of mcap's classes, made of exactly these bytes.

    Args:
        kind: a class of `mcap.records` whose `read` takes a stream only.
        body: the record without its head.
        offset: where in the file the record begins, for the error.

    Raises:
        Damage: the fields do not fill the bytes, or a text is not UTF-8.
    """
    stream = _Exact(body)
    try:
        record = kind.read(stream)
    except UnicodeDecodeError as error:
        raise Damage(offset, f"a {kind.__name__} record with a text that is not UTF-8") from error
    except (EndOfFile, struct.error) as error:
        raise Damage(
            offset, f"a {kind.__name__} record whose fields do not fit into it"
        ) from error
    if stream.count != len(body):
        raise Damage(
            offset, f"a {kind.__name__} record with {len(body) - stream.count} bytes too many"
        )
    return record


def check_crc(expected: int, found: int, offset: int, what: str, *, required: bool) -> None:
    """Raise Damage if a stored checksum does not hold; 0: there is none, unless required."""
    if expected != found and (expected or required):
        raise Damage(offset, f"the checksum of {what} is {found:#010x}, not {expected:#010x}")


def chunk_content(chunk: Chunk, offset: int, *, crc_required: bool) -> bytes:
    """Return a chunk's records, decompressed; raises Damage, never takes more than it says."""
    size = chunk.uncompressed_size
    if size > LARGEST_RECORD:
        raise Damage(offset, f"a chunk of {size} bytes, which is implausible")
    try:
        if chunk.compression == "":
            content = chunk.data
        elif chunk.compression == "zstd":
            content = _zstd(chunk.data, size)
        elif chunk.compression == "lz4":
            content = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        else:
            raise Damage(offset, f"a chunk of unknown compression {chunk.compression!r:.40}")
    except (zstandard.ZstdError, RuntimeError, ValueError, EOFError, MemoryError) as error:
        raise Damage(offset, f"a chunk that {chunk.compression} cannot decompress") from error
    if len(content) != size:
        raise Damage(offset, f"a chunk of {len(content)} bytes that should be {size}")
    check_crc(
        chunk.uncompressed_crc, zlib.crc32(content), offset, "the chunk", required=crc_required
    )
    return content


def _zstd(data: bytes, size: int) -> bytes:
    # The frame itself names a size, for which the library would make room.
    stated = zstandard.frame_content_size(data)
    if stated not in (-1, size):
        raise ValueError
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=max(size, 1))


_LENGTH = struct.Struct("<Q")


def message_heads(content: bytes, offset: int) -> tuple[np.ndarray, np.ndarray, list]:
    """Return places and heads (`MESSAGE_HEAD`) of the messages in a chunk's content, and the rest.

    The rest are the other records, as `chunk_records` yields them.

    Raises:
        Damage: a record does not fit into the content.
    """
    places: list[int] = []
    place, size = 0, len(content)
    append, length_at = places.append, _LENGTH.unpack_from
    last = size - HEAD.size
    while place <= last:
        append(place)
        place += HEAD.size + length_at(content, place + 1)[0]
    found = np.array(places, dtype=np.int64)
    data = np.frombuffer(content, dtype=np.uint8)
    is_message = data[found] == Opcode.MESSAGE
    others: list = []
    if place != size or not is_message.all():
        others = [one for one in chunk_records(content, offset) if one[0] != Opcode.MESSAGE]
        found = found[is_message]
    return found, rows_at(content, found, MESSAGE_HEAD), others


def rows_at(content: bytes, places: np.ndarray, kind: np.dtype) -> np.ndarray:
    """Return what lies at some places of bytes, as an array of a structured type."""
    if not len(places):
        return np.empty(0, dtype=kind)
    count = len(content) - kind.itemsize + 1
    # A view that begins anew at every byte; taking rows of it copies each with one memcpy.
    every = np.ndarray((count,), np.dtype(("V", kind.itemsize)), content, strides=(1,))
    return every[places].view(kind)


def chunk_records(content: bytes, offset: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield opcode, place, and body's begin and end of each record in a chunk's content."""
    place, size = 0, len(content)
    while place < size:
        begin = place + HEAD.size
        if begin > size:
            raise Damage(offset, f"a chunk that ends within a record at {place} in it")
        opcode, length = HEAD.unpack_from(content, place)
        end = begin + length
        if end > size or (opcode == Opcode.MESSAGE and length < MESSAGE.size):
            raise Damage(offset, f"a chunk with an impossible length at {place} in it")
        yield opcode, place, begin, end
        place = end
