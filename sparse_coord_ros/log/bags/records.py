# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads MCAP records from bytes that may be damaged; raises `Damage` with the place."""

import os
import re
import struct
import weakref
import zlib
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Chunk

from sparse_coord_ros.base.errors import BagError, retold
from sparse_coord_ros.base.limits import CHUNK, RECORD
from sparse_coord_ros.log.bags.layout import open_to_read
from sparse_coord_ros.protocol.wire.cdr import rows_at

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""The head of every record: opcode and length of the body."""
MESSAGE = struct.Struct("<HIQQ")
"""The head of a message's body: channel, sequence, log time, publish time."""
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
"""rosbag2 stores times as signed 64 bit nanoseconds."""

_NAMES = {int(opcode): opcode.name.lower().replace("_", " ") for opcode in Opcode}
_BEGIN = re.compile(b"(?=[%s]....\0{4})" % re.escape(bytes(_NAMES)), re.DOTALL)
"""A record's opcode and length, which is below 2**32."""
_WINDOW = 1 << 12
"""Bytes that are searched at a time."""


class Damage(Exception):  # noqa: N818
    """Damaged bytes at an offset; its text is one sentence."""

    def __init__(self, offset: int, problem: str) -> None:
        """Make it from the offset in the file and the problem."""
        super().__init__(f"byte {offset}: {problem}")
        self.problem = problem


class Cut(Damage):
    """The file ends within a record."""


class RecordPlace(NamedTuple):
    """The place of a record in a file.

    Attributes:
        opcode: its kind.
        offset: its beginning.
        length: size of its body in bytes.
    """

    opcode: int
    offset: int
    length: int

    @property
    def body(self) -> int:
        """The offset of its body."""
        return self.offset + HEAD.size

    @property
    def end(self) -> int:
        """Its end, the offset of the next record."""
        return self.body + self.length


class Source:
    """An open MCAP file; reading beyond its end raises Damage.

    Attributes:
        close: closes it; it is also closed when it is deleted.

    Raises:
        BagError: the file is missing, or does not begin as MCAP.
    """

    def __init__(self, path: Path) -> None:
        file = open_to_read(path)
        self._descriptor = file.fileno()
        self.close = weakref.finalize(self, file.close)
        with retold(BagError, Damage, f"cannot read {path}"):
            begin = self.read(0, min(self.size, len(MAGIC)))
        if begin != MAGIC:
            raise BagError(f"{path} is not an MCAP file: it does not start as one")

    @property
    def size(self) -> int:
        """The current size of the file in bytes."""
        return os.fstat(self._descriptor).st_size

    def read(self, offset: int, length: int) -> bytes:
        """Return bytes of the file; raises Damage if they cannot be read."""
        try:
            data = os.pread(self._descriptor, length, offset)
        except OSError as error:
            raise Damage(offset, f"cannot be read: {error.strerror}") from error
        if len(data) != length:
            raise Damage(offset + len(data), "the file has become shorter")
        return data

    def head(self, offset: int, size: int) -> RecordPlace:
        """Return the place of the record at an offset; its body may end beyond `size` bytes.

        Raises:
            Damage: its length is implausible, or its head cannot be read.
        """
        if size - offset < HEAD.size:
            left = size - offset
            raise Cut(
                offset, f"the file ends within a record, of which {left} bytes are left"
            )
        opcode, length = HEAD.unpack(self.read(offset, HEAD.size))
        if length > RECORD.bytes:
            raise Damage(
                offset, f"{describe(opcode)} of {length} bytes, which is implausible"
            )
        return RecordPlace(opcode, offset, length)

    def record(self, offset: int, size: int) -> RecordPlace:
        """Return the record at an offset; raises Damage unless it ends within `size` bytes."""
        record = self.head(offset, size)
        if record.end > size:
            said = f"{describe(record.opcode)} of {record.length} bytes"
            left = size - record.body
            raise Cut(offset, f"{said}, of which {left} are in the file")
        return record

    def places(self, begin: int, end: int) -> Iterator[int]:
        """Yield the places from `begin` on with a known opcode and a plausible length."""
        place = begin
        while place < end:
            try:
                # there may be holes
                place = os.lseek(self._descriptor, place, os.SEEK_DATA)
            except OSError:
                return
            with suppress(Damage):  # unreadable records are skipped
                data = self.read(place, min(_WINDOW + HEAD.size - 1, end - place))
                yield from (place + match.start() for match in _BEGIN.finditer(data))
            place += _WINDOW


def describe(opcode: int) -> str:
    """Return an opcode in words."""
    name = _NAMES.get(opcode)
    if name is None:
        return f"a record of unknown kind {opcode:#04x}"
    return f"a{'n' * (name[0] in 'aeiou')} {name} record"


class _Exact(ReadDataStream):
    """mcap's stream, which itself may return fewer bytes than requested."""

    def read(self, length: int) -> bytes:
        """Return `length` bytes, or raise EndOfFile."""
        data = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data


def parse(kind: Any, body: bytes, offset: int) -> Any:
    """Return a record of one of mcap's classes from exactly these bytes.

    Args:
        kind: a class of `mcap.records` whose `read` needs only a stream.
        body: the record without its head.
        offset: the record's offset in the file, for the error.

    Raises:
        Damage: the fields do not fill the bytes, or a text is not UTF-8.
    """
    stream = _Exact(BytesIO(body))
    what = f"a {kind.__name__} record"
    try:
        record = kind.read(stream)
    except (EndOfFile, OverflowError, UnicodeDecodeError) as error:
        raise Damage(offset, f"{what} whose fields do not fit into it") from error
    if more := len(body) - stream.count:
        raise Damage(offset, f"{what} with {more} bytes too many")
    return record


def check_crc(
    expected: int, found: int, offset: int, what: str, *, required: bool
) -> None:
    """Raise Damage if a stored checksum is wrong; 0 means no checksum, unless required."""
    if expected != found and (expected or required):
        raise Damage(
            offset, f"the checksum of {what} is {found:#010x}, not {expected:#010x}"
        )


def chunk_content(chunk: Chunk, offset: int, *, crc_required: bool) -> bytes:
    """Return a chunk's records, decompressed up to the size that it states; raises Damage."""
    size = chunk.uncompressed_size
    if size > CHUNK.bytes:
        raise Damage(offset, f"a chunk of {size} bytes, allowed: {CHUNK.bytes}")
    try:
        if chunk.compression == "":
            content = chunk.data
        elif chunk.compression == "zstd":
            # The frame itself states a size, and the library would allocate this memory.
            if zstandard.frame_content_size(chunk.data) not in (-1, size):
                raise ValueError
            unpack = zstandard.ZstdDecompressor().decompress
            content = unpack(chunk.data, max_output_size=max(size, 1))
        elif chunk.compression == "lz4":
            content = lz4.frame.LZ4FrameDecompressor().decompress(
                chunk.data, max_length=size + 1
            )
        else:
            raise Damage(
                offset, f"a chunk of unknown compression {chunk.compression!r:.40}"
            )
    except (
        zstandard.ZstdError,
        RuntimeError,
        ValueError,
        EOFError,
        MemoryError,
    ) as error:
        raise Damage(
            offset, f"a chunk that {chunk.compression} cannot decompress"
        ) from error
    if len(content) != size:
        raise Damage(offset, f"a chunk of {len(content)} bytes that should be {size}")
    crc = zlib.crc32(content)
    check_crc(chunk.uncompressed_crc, crc, offset, "the chunk", required=crc_required)
    return content


LENGTH = struct.Struct("<Q")


def message_heads(
    content: bytes, starts: np.ndarray, offset: int
) -> tuple[np.ndarray, np.ndarray, list[tuple[int, int, int]]]:
    """Return the messages and the other records in the content of chunks.

    Args:
        content: the content of one or more chunks.
        starts: offset of each chunk's first record in it.
        offset: their offset in the file, for the error.

    Returns:
        The offset of each message record, shape (messages,), int64; their heads, of type
        `MESSAGE_HEAD`, same shape; for each other record its opcode and its body's beginning and
        end.

    Raises:
        Damage: a record does not fit into the content.
    """
    places: list[int] = []
    place = 0
    size = len(content)
    append = places.append
    length_at = LENGTH.unpack_from
    while place <= size - HEAD.size:
        append(place)
        length = length_at(content, place + 1)[0]
        if not length:
            raise Damage(offset, "an empty record in a chunk")
        place += HEAD.size + length
    begins = np.array(places, dtype=np.int64)
    at = np.searchsorted(begins, starts)
    if place != size or at[-1] == len(begins) or (begins[at] != starts).any():
        raise Damage(offset, "records of which the last does not fit into their chunk")
    ends = np.append(begins[1:], size)
    opcodes = np.frombuffer(content, dtype=np.uint8)[begins]
    is_message = opcodes == Opcode.MESSAGE
    if (ends[is_message] - begins[is_message] < MESSAGE_HEAD.itemsize).any():
        raise Damage(offset, "a message without room for its channel and times")
    columns = opcodes, begins + HEAD.size, ends
    others = list(
        zip(*(column[~is_message].tolist() for column in columns), strict=True)
    )
    begins = begins[is_message]
    return begins, rows_at(content, begins, MESSAGE_HEAD), others
