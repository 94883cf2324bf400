# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The fast writer of MCAP files makes the bytes that mcap's own makes."""

import io
import random

import pytest
from mcap.writer import CompressionType, Writer

from sparse_coord_ros.recording.mcap_file import McapFile

TOPICS = ("/clock", "/robot_1/action", "/map")


def play(write, *, seed):
    """Make random calls of every kind: messages of any order in time, and empty ones too."""
    rng = random.Random(seed)
    channels = []
    for _ in range(rng.randrange(0, 120)):
        kind = rng.choices(("message", "topic", "flush", "attach", "metadata"), (80, 3, 5, 3, 3))[
            0
        ]
        if kind == "topic":
            data = rng.randbytes(rng.randrange(300))
            schema = write["schema"]("package/msg/Type", "ros2msg", data)
            channels.append(write["channel"](rng.choice(TOPICS), "cdr", schema, {"qos": "1"}))
        elif kind == "flush":
            write["flush"]()
        elif kind == "attach":
            write["attach"](rng.randrange(9), "map.txt", "text/plain", rng.randbytes(50))
        elif kind == "metadata":
            write["metadata"]("run", {"seed": str(rng.random()), "": ""})
        elif channels:
            write["message"](
                rng.choice(channels),
                rng.randrange(2**63),
                rng.randbytes(rng.randrange(80)),
                rng.randrange(2**63),
                rng.randrange(2**32),
            )
    write["finish"]()


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("seed", range(30))
def test_makes_the_bytes_of_mcaps_own_writer(seed, compression):
    mine, theirs = io.BytesIO(), io.BytesIO()
    size = (1, 500, 10**6)[seed % 3]
    file = McapFile(
        mine, chunk_size=size, compression=compression, profile="ros2", library="a library"
    )
    calls = (file.add_schema, file.add_channel, file.add_message, file.end_chunk, file.finish)
    names = ("schema", "channel", "message", "flush", "finish")
    more = {"attach": file.add_attachment, "metadata": file.add_metadata}
    play(dict(zip(names, calls, strict=True)) | more, seed=seed)

    writer = Writer(theirs, chunk_size=size, compression=compression, enable_data_crcs=True)
    writer.start(profile="ros2", library="a library")
    calls = (
        writer.register_schema,
        writer.register_channel,
        writer.add_message,
        writer.flush,
        writer.finish,
    )
    more = {"attach": lambda *args: writer.add_attachment(0, *args)}
    more["metadata"] = writer.add_metadata
    play(dict(zip(names, calls, strict=True)) | more, seed=seed)
    assert mine.getvalue() == theirs.getvalue()
