# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages in a chunk of an MCAP file, as columns."""

import struct
from io import BytesIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from sparse_coord_ros.protocol.wire.cdr import rows_at

LENGTH = struct.Struct("<Q")
RECORD = 1 + LENGTH.size
"""Size of the head of every record: opcode and length of the body."""

WRITTEN = np.dtype(
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

MESSAGE_HEAD = np.dtype(
    [
        ("channel", "u2"),
        ("topic", "i4"),
        ("size", "i8"),
        ("sequence", "u4"),
        ("log_ns", "i8"),
        ("publish_ns", "i8"),
    ]
)
"""A message without its data: channel, index of its topic in `Bag.names`, size of the data,
sequence number, log time, publish time."""


class DamagedChunk(Exception):  # noqa: N818
    """A chunk that cannot be read; its text is the reason."""


def message_heads(
    content: bytes,
) -> tuple[np.ndarray, np.ndarray, list[tuple[int, ReadDataStream]]]:
    """Return the messages and the other records in the content of a chunk.

    Returns:
        The offset of each message's data, shape (messages,); their heads, of type `MESSAGE_HEAD`,
        same shape; for each other record its opcode and its body.

    Raises:
        DamagedChunk: a record does not fit into the content.
    """
    offsets: list[int] = []
    offset = 0
    size = len(content)
    append = offsets.append
    length_at = LENGTH.unpack_from
    while offset <= size - RECORD:
        append(offset)
        offset += RECORD + length_at(content, offset + 1)[0]
    if offset != size:
        raise DamagedChunk("the last record of a chunk does not fit into it")
    begins = np.array(offsets, dtype=np.int64)
    ends = np.append(begins[1:], size)
    opcodes = np.frombuffer(content, dtype=np.uint8)[begins]
    is_message = opcodes == Opcode.MESSAGE
    others = []
    for number in np.flatnonzero(~is_message).tolist():
        body = content[begins[number] + RECORD : ends[number]]
        others.append((int(opcodes[number]), ReadDataStream(BytesIO(body))))
    begins = begins[is_message]
    sizes = ends[is_message] - begins - WRITTEN.itemsize
    if (sizes < 0).any():
        raise DamagedChunk("a message has no room for its channel and times")
    written = rows_at(content, begins, WRITTEN)
    heads = np.zeros(len(begins), MESSAGE_HEAD)
    for name in ("channel", "sequence", "log_ns", "publish_ns"):
        heads[name] = written[name]
    heads["size"] = sizes
    return begins + WRITTEN.itemsize, heads, others
