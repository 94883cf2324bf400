# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags cut, flipped and zeroed at random: never an exception, never a silently wrong result."""

import random
import struct
from itertools import accumulate, pairwise
from types import SimpleNamespace

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.log.bags import BagWriter, QoS, open_bag
from sparse_coord_ros.log.bags.recover import recover

STRING = "std_msgs/msg/String"
HEADER = "std_msgs/msg/Header"
LATCHED = QoS(durability="transient_local", depth=1)
COMPRESSIONS = ("zstd", "lz4", "none")
COPIES = 1_002


def write_bag(directory, samples, compression, *, rounds=40, chunk_size=600):
    """Write a bag of several chunks with attachments and metadata between them."""
    draw = random.Random(3)
    with BagWriter(
        directory, compression=compression, chunk_size=chunk_size, name="run"
    ) as bag:
        bag.add_metadata("run", {"seed": "7", "scenario": "cit"})
        channels = [
            (bag.add_topic("/chatter", STRING, QoS()), STRING),
            (bag.add_topic("/_claim", HEADER, LATCHED), HEADER),
        ]
        for i in range(rounds):
            channel, type_name = channels[draw.random() < 0.3]
            bag.write(channel, samples.cdr(type_name, i + 1), 100 * i + 1, 100 * i)
            if i % 15 == 5:
                bag.attach(
                    f"tables/{i}.npz", draw.randbytes(60), "application/x-npz", 100 * i
                )
    return directory / "run_0.mcap"


@pytest.fixture(scope="module")
def originals(tmp_path_factory, samples):
    """Return the bags' bytes and content, by compression."""
    found = {}
    for compression in COMPRESSIONS:
        path = write_bag(tmp_path_factory.mktemp("bags") / "run", samples, compression)
        bag = open_bag(path)
        assert (bag.finished, bag.damage, bag.message_count) == (True, None, 40)
        assert bag.compressions == (compression,)
        found[compression] = content(bag)
    return found


def content(bag):
    """Return a bag's bytes and its content."""
    messages = list(bag.messages())
    parts = [
        len(part.begins) for one in bag.blocks[0] for part in bag.files[0].parts([one])
    ]
    ends = list(accumulate(parts, initial=0))
    return SimpleNamespace(
        data=bag.path.read_bytes(),
        messages=messages,
        chunks={
            (block.offset, block.offset + block.length): messages[begin:end]
            for block, (begin, end) in zip(
                bag.files[0].blocks, pairwise(ends), strict=True
            )
        },
        attachments=[(one, one.data) for one in bag.attachments],
        topics=dict(bag.topics),
        data_end=bag.files[0].readable_bytes,
    )


def damaged(data, draw):
    """Return data that are cut, or in which bits are flipped or a range is zeroed."""
    kind = draw.randrange(4)
    if kind == 0:
        return data[: draw.randrange(len(data))]
    changed = bytearray(data)
    if kind == 1:
        for _ in range(draw.choice((1, 1, 1, 2, 5))):
            changed[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    elif kind == 2:
        begin = draw.randrange(len(data))
        end = min(len(data), begin + draw.choice((1, 4, 8, 50, 500)))
        changed[begin:end] = bytes(end - begin)
    else:  # a length or a count, anywhere
        begin = draw.randrange(len(data) - 8)
        changed[begin : begin + 8] = struct.pack(
            "<Q", draw.choice((2**64 - 1, 2**40, 2**28, 1))
        )
    return bytes(changed)


def check_read(bag, original, copy):
    """Check that the read data were written, and that all undamaged data are read; return them.

    The first chunk and the end of a finished file define the topics.
    """
    messages = list(bag.messages())
    assert messages == [one for one in original.messages if one in messages]
    assert bag.message_count == len(messages) == sum(bag.counts.values())
    attachments = [(one, one.data) for one in bag.attachments]
    assert attachments == [one for one in original.attachments if one in attachments]
    for name, topic in bag.topics.items():
        assert topic == original.topics[name]
    whole = [
        place
        for place in original.chunks
        if copy[slice(*place)] == original.data[slice(*place)]
    ]
    end = original.data[original.data_end :]
    if next(iter(original.chunks)) in whole or copy.endswith(end):
        due = [one for place in whole for one in original.chunks[place]]
        assert [one for one in messages if one in due] == due
    for gap in bag.gaps:
        assert gap.begin <= gap.end <= len(copy) and "\n" not in gap.why
    lazy = open_bag(bag.path, checked=False)
    assert list(lazy.messages()) == messages
    if bag.path.suffix != ".partial" and bag.finished:
        assert lazy.gaps == bag.gaps
    return messages


def check_recovered(directory, expected, attachments):
    """Two independent readers open the recovered bag, and find exactly the readable content."""
    with AnyReader([directory]) as reader:
        assert [
            (connection.topic, time, bytes(data))
            for connection, time, data in reader.messages()
        ] == [(m.topic, m.log_time_ns, m.data) for m in expected]
    [path] = directory.glob("*.mcap")
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = [
            (channel.topic, message.data, message.sequence)
            for _, channel, message in reader.iter_messages(log_time_order=False)
        ]
        assert found == [(m.topic, m.data, m.sequence) for m in expected]
        names = [attachment.name for attachment in reader.iter_attachments()]
    assert names == attachments
    bag = open_bag(directory)
    assert (bag.finished, bag.damage) == (True, None)


@pytest.mark.long
def test_a_thousand_damaged_bags(tmp_path, originals):
    """A third of them are unfinished, a third are recovered."""
    draw = random.Random(1)
    reported = recovered = 0
    reads = set()
    for number in range(COPIES):
        original = originals[COMPRESSIONS[number % 3]]
        unfinished = number % 9 < 3
        data = original.data[: original.data_end] if unfinished else original.data
        copy = damaged(data, draw)
        directory = tmp_path / str(number)
        directory.mkdir()
        path = directory / ("run_0.mcap.partial" if unfinished else "run_0.mcap")
        path.write_bytes(copy)
        try:
            bag = open_bag(directory)
        except BagError as error:
            assert "MCAP" in str(error) and "\n" not in str(error)
            assert copy[:8] != data[:8]
            continue
        read = check_read(bag, original, copy)
        reads.add(len(read))
        if bag.damage is not None:
            reported += 1
            assert bag.damage.startswith("byte ") and "\n" not in bag.damage
            assert int(bag.damage.split()[1].rstrip(":")) <= len(copy)
        elif unfinished and copy != data:
            # Only the end, and the texts of header and metadata, have no checksum yet.
            assert len(read) == 40 or data.startswith(copy)
        else:
            assert copy == data and len(read) == 40
        if number % 9 in (0, 1, 2, 6) and (
            bag.topics or bag.metadata or bag.attachments
        ):
            recovery = recover(directory)
            assert recovery.bag.whole == bag.whole
            check_recovered(directory, read, [one.name for one in bag.attachments])
            if bag.damage is not None:
                assert recovery.kept.read_bytes() == copy
            recovered += 1
    assert reported > 850 and recovered > 300
    assert len(reads) > 4


@pytest.mark.parametrize("hit", range(5))
@pytest.mark.parametrize("finish", [False, True])
def test_no_chunk_depends_on_another(tmp_path, samples, hit, finish):
    """The first two, and the end of a finished file, define the topics."""
    writer = BagWriter(tmp_path / "bag")
    samples.fill(writer, 5, chunks=True)
    writer.close() if finish else writer.abandon()
    [file] = (tmp_path / "bag").glob("*.mcap*")
    block = open_bag(file).files[0].blocks[hit]
    data = bytearray(file.read_bytes())
    data[block.offset + block.length - 3] ^= 1
    file.write_bytes(data)
    for checked in (True, False):
        bag = open_bag(file, checked=checked)
        assert [m.log_time_ns for m in bag.messages()] == [
            i for i in range(5) if i != hit
        ]
        assert [(gap.begin, gap.end) for gap in bag.gaps] == [
            (block.offset, block.offset + block.length)
        ]


@pytest.fixture(scope="module")
def tiny(tmp_path_factory, samples):
    """Return a tiny bag of three chunks."""
    path = tmp_path_factory.mktemp("tiny") / "run"
    with BagWriter(path, compression="none", chunk_size=1) as bag:
        bag.attach("a", b"1", "text/plain")
        samples.fill(bag, 3)
    return content(open_bag(path))


def test_every_flipped_byte_is_found(tmp_path, tiny):
    """One flipped bit anywhere is reported (in every tenth byte, for the time)."""
    draw = random.Random(2)
    path = tmp_path / "run_0.mcap"
    for place in range(draw.randrange(10), len(tiny.data), 10):
        copy = bytearray(tiny.data)
        copy[place] ^= 1 << draw.randrange(8)
        path.write_bytes(copy)
        if place < 8:
            with pytest.raises(BagError, match="is not an MCAP file"):
                open_bag(path)
            continue
        bag = open_bag(path)
        assert bag.damage is not None, place
        check_read(bag, tiny, copy)
