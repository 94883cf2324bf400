# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads MCAP records from bytes that may be damaged; raises `Damage` with the place."""

import os
import struct
import weakref
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream

from sparse_coord_ros.base.errors import BagError, message_of, retold
from sparse_coord_ros.base.files import refuse_stand_in
from sparse_coord_ros.log.bags.layout import CONVERT, WANTED, open_to_read
from sparse_coord_ros.protocol.wire.cdr import rows_at

MAGIC = b"\x89MCAP0\r\n"
OTHER_BAGS = (b"SQLite format 3\0", b"#ROSBAG V")
"""The first bytes of bags that are not read: ROS 2's .db3, and ROS 1's."""

LONGEST_SIGN = 64
"""Bytes that say what a file is."""
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


class Damage(Exception):  # noqa: N818
    """Damaged bytes at an offset; its text is one sentence."""

    def __init__(self, offset: int, problem: str) -> None:
        """Make it from the offset in the file and the problem."""
        super().__init__(f"byte {offset}: {problem}")


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
            begin = self.read(0, min(self.size, LONGEST_SIGN))
        if not begin.startswith(MAGIC):
            refuse_stand_in(path, begin, BagError)
            if begin.startswith(OTHER_BAGS):
                raise BagError(f"{path} is a bag of another format; {CONVERT}")
            raise BagError(
                f"{path} is not an MCAP file: it does not start as one; {WANTED}"
            )

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

    def record(self, offset: int, size: int) -> RecordPlace:
        """Return the place of the record at an offset, of the first `size` bytes of the file.

        Raises:
            Cut: it does not end within these bytes.
            Damage: its head cannot be read.
        """
        if size - offset < HEAD.size:
            raise Cut(offset, "the file ends within a record")
        opcode, length = HEAD.unpack(self.read(offset, HEAD.size))
        record = RecordPlace(opcode, offset, length)
        if record.end > size:
            raise Cut(
                offset, f"{describe(opcode)} of {length} bytes ends beyond the file"
            )
        return record


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
    """Return a record of one of mcap's classes.

    Args:
        kind: a class of `mcap.records` whose `read` needs only a stream.
        body: the record without its head.
        offset: the record's offset in the file, for the error.

    Raises:
        Damage: the fields do not fit into the bytes, or a text is not UTF-8.
    """
    try:
        return kind.read(_Exact(BytesIO(body)))
    except (EndOfFile, OverflowError, UnicodeDecodeError) as error:
        what = f"a {kind.__name__} record whose fields do not fit into it"
        raise Damage(offset, what) from error


def chunk_content(chunk: Chunk, offset: int) -> bytes:
    """Return a chunk's records, decompressed; raises Damage.

    A checksum of 0 means that there is none.
    """
    try:
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    except CRCValidationError as error:
        raise Damage(offset, "the checksum of a chunk is wrong") from error
    except Exception as error:  # of the libraries that decompress
        why = f"a chunk that cannot be decompressed ({message_of(error)})"
        raise Damage(offset, why) from error
    content: bytes = stream.read(size)
    if size != chunk.uncompressed_size:
        due = chunk.uncompressed_size
        raise Damage(offset, f"a chunk of {size} bytes that should be {due}")
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
        place += HEAD.size + length_at(content, place + 1)[0]
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
