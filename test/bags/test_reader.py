# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reader with finished, unfinished, foreign and hostile bags."""

import errno
import io
import os
import struct
import tracemalloc
import zlib

import lz4.frame
import pytest
import zstandard
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.base.limits import CHUNK, Limit
from sparse_coord_ros.log.bags import (
    BagTopic,
    BagWriter,
    Message,
    QoS,
    open_bag,
    type_hash,
)
from sparse_coord_ros.log.bags.records import Damage, chunk_content
from sparse_coord_ros.log.bags.schemas import schema_text

STRING = "std_msgs/msg/String"
LATCHED = QoS(durability="transient_local", depth=1)


@pytest.fixture
def bag(tmp_path, samples):
    """Return a bag that is being written, with 20 messages of two topics handed over."""
    writer = BagWriter(tmp_path / "run", chunk_size=300)
    writer.add_metadata("run", {"seed": "7"})
    a = writer.add_topic("/a", STRING, QoS())
    b = writer.add_topic("/b", STRING, LATCHED)
    for i in range(20):
        writer.write(b if i % 4 == 0 else a, samples.cdr(STRING, i), 1_000 - i, i)
    writer.attach("map.txt", b"#", "text/plain", 3)
    writer.flush()
    yield writer
    writer.close()


def test_everything_that_was_written_is_read(tmp_path, bag, samples):
    """Also from an unfinished bag; finishing it changes only `finished`."""
    writer = bag
    for finished in (False, True):
        bag = open_bag(tmp_path / "run")
        assert (bag.finished, bag.damage, bag.whole, bag.lost_bytes) == (
            finished,
            None,
            True,
            0,
        )
        text = schema_text(STRING)
        digest = type_hash(STRING)
        assert bag.topics == {
            "/a": BagTopic("/a", STRING, text, (QoS(),), digest),
            "/b": BagTopic("/b", STRING, text, (LATCHED,), digest),
        }
        expected = [
            Message(
                "/b" if i % 4 == 0 else "/a",
                samples.cdr(STRING, i),
                1_000 - i,
                i,
                i // 4 if i % 4 == 0 else i - i // 4 - 1,
            )
            for i in range(20)
        ]
        assert list(bag.messages()) == expected
        assert list(bag.messages({"/b", "/nope"})) == expected[::4]
        assert list(bag.messages([])) == []
        assert (bag.counts, bag.message_count) == ({"/a": 15, "/b": 5}, 20)
        assert bag.sizes["/b"] == sum(len(m.data) for m in expected[::4])
        assert (bag.start_ns, bag.end_ns) == (981, 1_000)
        assert bag.metadata["run"] == {"seed": "7"}
        [found] = bag.attachments
        assert (found.name, found.media_type, found.log_time_ns) == (
            "map.txt",
            "text/plain",
            3,
        )
        assert found.data == b"#" and found.size == 1
        assert bag.compressions == ("zstd",)
        assert bag.files[0].size == bag.path.stat().st_size
        writer.close()


def test_topics_without_messages_are_there(tmp_path):
    """Topics without a chunk are in the summary."""
    with BagWriter(tmp_path / "run") as writer:
        writer.add_topic("/a", STRING, QoS())
    bag = open_bag(tmp_path / "run")
    assert (bag.counts, bag.message_count, bag.start_ns, bag.end_ns) == (
        {"/a": 0},
        0,
        0,
        0,
    )
    assert (bag.damage, list(bag.messages()), bag.compressions) == (None, [], ())


def test_nothing_to_read_is_one_line(tmp_path):
    """No file, an empty directory, several files, no MCAP, not a regular file."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mcap").write_text("not at all a bag\n" * 9)
    for name in ("two/a_0.mcap", "two/b_1.mcap", "same/a_0.mcap", "same/a.mcap"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    os.mkfifo(tmp_path / "pipe")
    for path, message in {
        "none": "cannot read .*none: No such file or directory",
        "empty": "empty is not a bag: it has no .mcap file",
        "two": "two has 2 .mcap files: name one",
        "same": "same has 2 .mcap files: name one",
        "text.mcap": "text.mcap is not an MCAP file",
        "pipe": "cannot read .*pipe: it is not a file",
    }.items():
        with pytest.raises(BagError, match=message):
            open_bag(tmp_path / path)


def test_a_disk_that_fails_is_one_line(tmp_path, bag, monkeypatch):
    def bad_disk(*_):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("sparse_coord_ros.log.bags.records.os.pread", bad_disk)
    with pytest.raises(
        BagError, match=r"\.partial: byte 0: cannot be read: Input/output error$"
    ):
        open_bag(tmp_path / "run")


def test_file_that_changes_while_it_is_read(tmp_path, bag):
    """Messages and attachments end in BagError, not in garbage."""
    bag.close()
    found = open_bag(tmp_path / "run")
    assert len(list(found.messages())) == 20
    os.truncate(found.path, found.blocks[0][-1].offset + 20)
    with pytest.raises(
        BagError, match="run_0.mcap has changed while it was read: byte "
    ):
        list(found.messages())
    os.truncate(found.path, 100)
    with pytest.raises(BagError, match="has changed while it was read"):
        _ = found.attachments[0].data


def test_memory_does_not_grow_with_the_bag(tmp_path, monkeypatch):
    """Ten times as many messages need little more memory, for a few lists."""
    monkeypatch.setattr("sparse_coord_ros.log.bags.contents.TOGETHER", 20_000)
    peaks = []
    for rounds in (2_000, 20_000):
        with BagWriter(tmp_path / str(rounds), chunk_size=20_000) as writer:
            channel = writer.add_topic("/a", STRING, QoS())
            for i in range(rounds):
                writer.write(channel, bytes(50), i, i)
        tracemalloc.start()
        bag = open_bag(tmp_path / str(rounds))
        assert sum(1 for _ in bag.messages()) == rounds
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < peaks[0] + 100_000


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("crcs", [True, False])
def test_files_by_the_mcap_library_are_read(tmp_path, samples, chunked, crcs):
    """Its own defaults: no checksum of the data; chunks are an option, and old QoS spellings."""
    qos = "- history: 3\n  depth: 0\n  reliability: 2\n  durability: 1\n"
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(
            stream,
            compression=CompressionType.LZ4,
            use_chunking=chunked,
            enable_crcs=crcs,
        )
        writer.start(profile="ros2")
        schema = writer.register_schema(STRING, "ros2msg", b"string data")
        for topic in ("/a", "/b"):
            channel = writer.register_channel(
                topic,
                "cdr",
                schema,
                {"offered_qos_profiles": qos if topic == "/a" else ""},
            )
            writer.add_message(channel, 9, samples.cdr(STRING), 8, sequence=77)
        writer.finish()
    bag = open_bag(tmp_path / "a.mcap")
    assert (bag.finished, bag.damage, bag.counts) == (True, None, {"/a": 1, "/b": 1})
    assert [tuple(m) for m in bag.messages(["/a"])] == [
        ("/a", samples.cdr(STRING), 9, 8, 77)
    ]
    profile = QoS("keep_last", 0, "best_effort", "transient_local")
    assert bag.topics["/a"] == BagTopic("/a", STRING, "string data", (profile,), "")
    assert bag.topics["/b"].qos == ()


def test_bags_by_rosbags_are_read(tmp_path, samples):
    """An independent writer of rosbag2's layout."""
    with RosbagsWriter(
        tmp_path / "run", version=9, storage_plugin=StoragePlugin.MCAP
    ) as writer:
        connection = writer.add_connection("/a", STRING, typestore=samples.typestore)
        for i in range(50):
            writer.write(connection, i, samples.cdr(STRING, i))
    bag = open_bag(tmp_path / "run")
    assert (bag.finished, bag.damage, bag.counts) == (True, None, {"/a": 50})
    assert [(m.log_time_ns, m.data) for m in bag.messages()] == [
        (i, samples.cdr(STRING, i)) for i in range(50)
    ]
    assert bag.topics["/a"].type_name == STRING


def hostile_file(path, metadata=None, encoding="cdr", data=b"\0" * 4, time=1):
    """Write a file that MCAP allows, but no recorder writes."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema(STRING, "ros2msg", b"string data")
        writer.add_message(writer.register_channel("/good", "cdr", schema), 1, data, 1)
        writer.flush()
        channel = writer.register_channel("/bad", encoding, schema, metadata or {})
        writer.add_message(channel, time, data, 1)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"metadata": {"offered_qos_profiles": "{["}},
            "topic '/bad': its QoS profiles cannot",
        ),
        (
            {"metadata": {"offered_qos_profiles": "7"}},
            "topic '/bad': its QoS profiles cannot",
        ),
        (
            {"metadata": {"offered_qos_profiles": "- x"}},
            "topic '/bad': its QoS profiles cannot",
        ),
        (
            {"metadata": {"offered_qos_profiles": "[" * 400}},
            "topic '/bad': its QoS profiles",
        ),
        (
            {"metadata": {"offered_qos_profiles": "- {depth: -1}"}},
            "topic '/bad': its QoS profiles cannot",
        ),
        ({"time": 2**64 - 1}, "a message with an impossible time"),
    ],
)
def test_what_cannot_be_understood_is_a_gap(tmp_path, options, message):
    """Its checksum is right, and the records around it are read."""
    bag = open_bag(hostile_file(tmp_path / "a.mcap", **options))
    [gap] = bag.gaps
    assert message in gap.why and bag.damage == f"byte {gap.begin}: {gap.why}"
    assert (gap.begin, gap.end) == places_of(bag.path.read_bytes(), 0x06)[1]
    assert (gap.file, gap.place, gap.first_ns, gap.last_ns) == ("a.mcap", 0, 1, None)
    assert [m.topic for m in bag.messages()] == ["/good"]
    assert (bag.finished, bag.whole, bag.lost_bytes) == (
        True,
        False,
        gap.end - gap.begin,
    )
    unchecked = open_bag(bag.path, checked=False)
    assert [m.topic for m in unchecked.messages()] == ["/good"]
    assert unchecked.gaps == bag.gaps
    unchecked.close()


def test_files_of_others_than_ros_2_are_refused_not_called_damaged(tmp_path):
    path = hostile_file(tmp_path / "a.mcap", encoding="json")
    with pytest.raises(BagError) as caught:
        open_bag(path)
    assert str(caught.value) == (
        f"{path}: this MCAP file is not a ROS 2 bag: topic '/bad' is encoded as 'json', not cdr"
    )


def test_the_directory_of_a_run_stands_for_its_bag(tmp_path, bag):
    """`run` prints that directory; a bag in the directory itself comes first."""
    bag.close()
    run = tmp_path / "runs"
    run.mkdir()
    inner = (tmp_path / "run").rename(run / "bag")
    assert open_bag(run).path == inner / "run_0.mcap"
    (run / "own.mcap").write_bytes((inner / "run_0.mcap").read_bytes())
    assert open_bag(run).path == run / "own.mcap"
    (inner / "run_0.mcap").unlink()
    (run / "own.mcap").unlink()
    with pytest.raises(BagError, match="runs is not a bag: it has no .mcap file"):
        open_bag(run)


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
@pytest.mark.parametrize("stated", [0, 10, CHUNK.bytes, CHUNK.bytes + 1, 2**63])
def test_chunk_that_does_not_hold_what_it_says(compression, stated):
    """A bomb is not unpacked: at most the stated size, and no implausible one."""
    data = {
        "zstd": zstandard.compress(bytes(1_000_000)),
        "lz4": lz4.frame.compress(bytes(1_000_000)),
        "": b"12345",
    }[compression]
    chunk = Chunk(compression, data, 0, 0, 0, stated)
    with pytest.raises(Damage, match="^byte 7: a chunk "):
        chunk_content(chunk, 7, crc_required=False)


def test_zstd_frame_without_a_size_is_read():
    """Streaming writers leave it out."""
    compressor = zstandard.ZstdCompressor(write_content_size=False)
    chunk = Chunk(
        "zstd", compressor.compress(b"abc" * 99), 0, 0, zlib.crc32(b"abc" * 99), 297
    )
    assert chunk_content(chunk, 0, crc_required=True) == b"abc" * 99


@pytest.mark.parametrize("length", [2**64 - 1, 2**62, 2**31, 10_000])
def test_huge_lengths_take_no_memory(tmp_path, length):
    """Neither a record's nor those inside an attachment."""
    start = b"\x89MCAP0\r\n" + struct.pack("<BQII", 1, 8, 0, 0)
    for name, record in {
        "chunk": struct.pack("<BQ", 6, length) + bytes(99),
        "attachment": struct.pack("<BQQQI", 9, 99, 0, 0, min(length, 2**32 - 1))
        + bytes(99),
        "data": struct.pack("<BQQQIIQ", 9, 99, 0, 0, 0, 0, length) + bytes(99),
        "content": struct.pack("<BQQQQIIQ", 6, 99, 0, 0, 0, 0, 0, length) + bytes(99),
        "texts": struct.pack("<BQII", 12, 99, 0, min(length, 2**32 - 1)) + bytes(99),
    }.items():
        path = tmp_path / f"{name}.mcap"
        path.write_bytes(start + record)
        bag = open_bag(path)
        assert bag.damage.startswith(f"byte {len(start)}: a")
        [gap] = bag.gaps
        assert (bag.message_count, gap.begin, gap.end) == (
            0,
            len(start),
            path.stat().st_size,
        )


def places_of(data, wanted):
    """Return (begin, end) of each record of one kind in the bytes of a file."""
    found = []
    place = 8
    while place < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, place)
        if opcode == wanted:
            found.append((place, place + 9 + length))
        place += 9 + length
    return found


def test_a_zeroed_checksum_among_others(tmp_path):
    """Another library's file with checksums: that of a chunk cannot be left out by zeroing it."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=1, compression=CompressionType.NONE)
    writer.start("ros2", "another library")
    schema = writer.register_schema(STRING, "ros2msg", b"string data")
    channel = writer.register_channel("/a", "cdr", schema)
    for at in range(3):
        writer.add_message(channel, at, bytes([0, 1, 0, 0, at]), at)
    writer.finish()
    data = bytearray(stream.getvalue())
    file = tmp_path / "other.mcap"
    file.write_bytes(data)
    assert open_bag(file).damage is None
    begin, _ = places_of(data, 0x06)[1]
    assert struct.unpack_from("<I", data, begin + 9 + 24)[0] != 0
    struct.pack_into("<I", data, begin + 9 + 24, 0)
    file.write_bytes(data)
    assert "the checksum of the chunk is" in open_bag(file).damage


@pytest.mark.parametrize(
    ("kind", "place", "what"),
    [
        (0x06, 9 + 24, "the chunk"),
        (0x09, -4, "attachment 'map.txt'"),
        (0x0F, -4, "the data before"),
        (0x02, -4, "the summary"),
    ],
)
def test_every_checksum_of_an_own_bag_is_there(tmp_path, bag, kind, place, what):
    """In other files 0 means that there is none."""
    bag.close()
    file = tmp_path / "run" / "run_0.mcap"
    data = bytearray(file.read_bytes())
    begin, end = places_of(data, kind)[0]
    at = begin + place if place > 0 else end + place
    assert struct.unpack_from("<I", data, at)[0] != 0
    struct.pack_into("<I", data, at, 0)
    file.write_bytes(data)
    assert f"the checksum of {what} is" in open_bag(file).damage


@pytest.mark.parametrize(
    ("place", "said"),
    [
        (0, "a message index whose fields do not fit"),
        (9, "a chunk whose times are not those of its messages"),
        (17, "a chunk whose times are not those of its messages"),
    ],
)
def test_a_chunk_that_says_something_else(tmp_path, bag, place, said):
    """A message index is not read: a chunk that became one would be lost unnoticed."""
    file = tmp_path / "run" / "run_0.mcap.partial"
    data = bytearray(file.read_bytes())
    begin, _ = places_of(data, 0x06)[1]
    data[begin + place] ^= 1
    changed = tmp_path / "changed.mcap.partial"
    changed.write_bytes(data)
    assert f"byte {begin}: {said}" in open_bag(changed).damage


def test_something_after_the_end(tmp_path, bag):
    bag.close()
    file = tmp_path / "run" / "run_0.mcap"
    data = file.read_bytes()
    for changed in (data + b"x", data[:-1], data[:-1] + b"x"):
        file.write_bytes(changed)
        assert "the file does not end with MCAP's magic bytes" in open_bag(file).damage


def test_a_topic_with_a_second_type(tmp_path):
    """A topic has one type, in all its chunks and channels."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=1, compression=CompressionType.NONE)
    writer.start("ros2", "another library")
    for number, kind in enumerate((STRING, "std_msgs/msg/Bool")):
        schema = writer.register_schema(kind, "ros2msg", b"bool data")
        channel = writer.register_channel("/a", "cdr", schema)
        writer.add_message(channel, number, bytes(5), number)
    writer.finish()
    (tmp_path / "other.mcap").write_bytes(stream.getvalue())
    bag = open_bag(tmp_path / "other.mcap")
    assert "topic '/a' has a second type" in bag.damage
    assert bag.counts == {"/a": 1}


def record(opcode, body):
    return struct.pack("<BQ", opcode, len(body)) + body


def text(said):
    return struct.pack("<I", len(said)) + said


def schema(data=b"int8 x"):
    return record(
        3, struct.pack("<H", 1) + text(b"a/msg/A") + text(b"ros2msg") + text(data)
    )


def channel(of=1, topic=b"/a"):
    return record(4, struct.pack("<HH", 1, of) + text(topic) + text(b"cdr") + text(b""))


def message(number):
    return record(5, struct.pack("<HIQQ", number, 0, 1, 1) + b"data")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (schema() + channel() + message(1)[:-1], "of which the last does not fit"),
        (schema() + channel() + record(5, b"short"), "a message without room for"),
        (schema() + channel() + message(3), "a message of the unknown channel 3"),
        (schema() + schema(b"int9 x"), "a second, different schema 1"),
        (schema() + channel() + channel(topic=b"/b"), "a second, different channel 1"),
        (schema() + channel(of=9), "topic '/a' has no type"),
        (schema(b"\xff") + channel(), "topic '/a': 'utf-8' codec can't decode"),
        (record(7, bytes(6)), "a message index record within a chunk"),
    ],
)
def test_a_chunk_that_makes_no_sense(tmp_path, content, problem):
    """It has no checksum, and in its file nothing else is wrong."""
    times = struct.pack("<QQQI", 1, 1, len(content), 0)
    chunk = times + text(b"") + struct.pack("<Q", len(content)) + content
    start = b"\x89MCAP0\r\n" + record(1, text(b"") + text(b""))
    path = tmp_path / "a.mcap.partial"
    path.write_bytes(start + record(6, chunk))
    bag = open_bag(path)
    assert problem in bag.damage and (bag.message_count, list(bag.messages())) == (
        0,
        [],
    )


def chunk(content, times=(1, 1), crc=0):
    fields = struct.pack("<QQQI", *times, len(content), crc) + text(b"")
    return record(6, fields + struct.pack("<Q", len(content)) + content)


START = b"\x89MCAP0\r\n" + record(1, text(b"") + text(b""))
FIRST = chunk(schema() + channel() + message(1))


def both_ways(path, data):
    """Return a bag that is read checked and unchecked, with equal results."""
    path.write_bytes(data)
    bag = open_bag(path)
    lazy = open_bag(path, checked=False)
    assert list(lazy.messages()) == list(bag.messages())
    assert lazy.gaps == bag.gaps
    return bag


def test_empty_chunks_are_not_unpacked(tmp_path, monkeypatch):
    """200,000 of them once took 25 s. One that has a checksum is not empty."""
    both_ways(tmp_path / "a.mcap.partial", START + FIRST)
    monkeypatch.setattr("sparse_coord_ros.log.bags.contents.chunk_content", None)
    (tmp_path / "b.mcap.partial").write_bytes(START + chunk(b"", (0, 0)) * 50)
    assert open_bag(tmp_path / "b.mcap.partial").gaps == ()
    monkeypatch.undo()
    bag = both_ways(
        tmp_path / "c.mcap.partial", START + FIRST + chunk(b"", (0, 0), 7) + FIRST
    )
    assert len(bag.gaps) == 1 and bag.message_count == 2


@pytest.mark.parametrize("limit", [0, 1, 2])
def test_chunks_hold_no_more_than_a_limit(tmp_path, monkeypatch, limit):
    """There is a limit per byte of the file: a small file cannot unpack to gigabytes."""
    data = START + FIRST * 3
    size = len(schema() + channel() + message(1))
    most = Limit("", limit * size, 0) if limit != 1 else Limit("", size - len(data), 1)
    monkeypatch.setattr("sparse_coord_ros.log.bags.contents.CHUNKS", most)
    bag = both_ways(tmp_path / "a.mcap.partial", data)
    assert bag.message_count == limit and bag.lost_bytes == (3 - limit) * len(FIRST)
    assert "after too many for this file" in bag.damage


def test_a_chunk_of_nothing_but_zeros_is_no_list_of_records(tmp_path):
    bag = both_ways(tmp_path / "a.mcap.partial", START + FIRST + chunk(bytes(1_000)))
    assert bag.damage.endswith("an empty record in a chunk")


def test_searching_ends(tmp_path, monkeypatch):
    """A forged file may begin a record at every byte."""
    monkeypatch.setattr("sparse_coord_ros.log.bags.contents.SEARCHED", 0)
    monkeypatch.setattr("sparse_coord_ros.log.bags.contents.SEARCH", 300)
    monkeypatch.setattr("sparse_coord_ros.log.bags.contents.TRIED", 1)
    data = START + FIRST + (b"junk!" + FIRST) * 50
    bag = both_ways(tmp_path / "a.mcap.partial", data)
    [*_, last] = bag.gaps
    assert 10 < bag.message_count == len(bag.gaps) < 40 and last.end == len(data)


@pytest.mark.parametrize(("cost", "found"), [(1, 2), (1 << 10, 1)])
def test_searching_among_many_beginnings_ends(tmp_path, monkeypatch, cost, found):
    monkeypatch.setattr("sparse_coord_ros.log.bags.contents.SEARCHED", 0)
    monkeypatch.setattr("sparse_coord_ros.log.bags.contents.SEARCH", 1)
    monkeypatch.setattr("sparse_coord_ros.log.bags.contents.TRIED", cost)
    many = (b"\6\1" + bytes(7)) * 1000
    assert (
        both_ways(
            tmp_path / "a.mcap.partial", START + FIRST + many + FIRST
        ).message_count
        == found
    )


ATTACHED = record(
    9, bytes(16) + text(b"a") + text(b"") + struct.pack("<Q", 3) + b"abc" + bytes(4)
)


@pytest.mark.parametrize("end", [b"", b"x"])
def test_the_last_record_behind_broken_framing_is_found(tmp_path, end):
    """At the end of the file, or if too few bytes are left to identify a record."""
    path = tmp_path / "a.mcap.partial"
    begin = len(START + FIRST)
    path.write_bytes(START + FIRST + b"junk!" + ATTACHED + end)
    for checked in (True, False):
        bag = open_bag(path, checked=checked)
        assert [one.data for one in bag.attachments] == [b"abc"]
        assert bag.gaps[0][:2] == (begin, begin + 5)


def packed(content):
    data = zstandard.compress(content)
    fields = struct.pack("<QQQI", 1, 1, len(content), 0) + text(b"zstd")
    return record(6, fields + struct.pack("<Q", len(data)) + data)


@pytest.mark.parametrize(
    ("records", "said"),
    [
        (record(12, text(b"a") + text(b"")) * 5, "3 attachments and metadata records"),
        (packed(message(1) * 5_000), "[0-9]{3} messages in [0-9]{3} bytes"),
    ],
    ids=["metadata", "messages"],
)
def test_a_bag_has_not_too_many_of_anything(tmp_path, monkeypatch, records, said):
    both_ways(tmp_path / "a.mcap.partial", START + FIRST + records)
    monkeypatch.setattr("sparse_coord_ros.log.bags.contents.RECORDS", 3)
    with pytest.raises(
        BagError, match=f"a.mcap.partial: more than {said} are not read"
    ):
        open_bag(tmp_path / "a.mcap.partial")


def test_holes_and_what_lies_in_them_take_no_time(tmp_path):
    """A hole of 100 GB, between two chunks or in an attachment."""
    path = tmp_path / "a.mcap.partial"
    first = START + FIRST
    far = 100 * 2**30
    for junk in (
        b"junk!",
        record(9, b"")[:1] + struct.pack("<Q", far - len(first) - 9),
    ):
        path.write_bytes(first + junk)
        with open(path, "r+b") as file:
            file.seek(far)
            file.write(FIRST)
        bag = open_bag(path)
        assert bag.message_count == 2 and [gap[:2] for gap in bag.gaps] == [
            (len(first), far)
        ]
        path.unlink()


@pytest.mark.parametrize(
    ("tail", "lost"), [(b"", 0), (struct.pack("<BQ", 0x85, 35), 1)]
)
def test_chunks_that_are_read_together_are_judged_each_by_itself(tmp_path, tail, lost):
    """No record reaches into the next chunk, and the last one need not have a message."""
    one = message(1)
    defines = chunk(schema() + channel(), (5, 5))
    assert len(one) == 35
    data = START + FIRST + chunk(one + tail) + chunk(one + one) + defines * (not lost)
    found = both_ways(tmp_path / "a.mcap.partial", data)
    first = START + FIRST
    before = both_ways(tmp_path / "b.mcap.partial", first).message_count
    assert found.message_count == before + 3 - lost
    assert [gap.begin for gap in found.gaps] == [len(first)] * lost


def test_what_only_looks_like_a_chunk_hides_nothing(tmp_path):
    """Its lengths fit together, its checksum does not, and a true chunk is within it."""
    hides = chunk(FIRST, crc=7)
    bag = both_ways(
        tmp_path / "a.mcap.partial", START + FIRST + b"junk!" + hides + FIRST
    )
    assert bag.message_count == 3 and bag.lost_bytes == 5 + len(hides) - len(FIRST)


def test_a_gap_between_chunks_that_overlap_in_time(tmp_path):
    def of(*times):
        sent = [record(5, struct.pack("<HIQQ", 1, 0, at, at) + b"data") for at in times]
        return chunk(schema() + channel() + b"".join(sent), (min(times), max(times)))

    bad = chunk(b"bad", (4, 6), crc=7)
    [gap] = both_ways(
        tmp_path / "a.mcap.partial", START + of(1, 9) + bad + of(5, 12)
    ).gaps
    assert (gap.first_ns, gap.last_ns) == (5, 9)


@pytest.mark.parametrize("tail", [FIRST[:-9], ATTACHED[:-3]])
def test_a_file_that_has_not_grown_is_not_searched_again(tmp_path, monkeypatch, tail):
    """Nor is an incomplete chunk searched for records."""
    path = tmp_path / "a.mcap.partial"
    path.write_bytes(START + FIRST + tail)
    bag = open_bag(path, checked=False)
    monkeypatch.setattr("sparse_coord_ros.log.bags.records.Source.places", None)
    assert not bag.extend() and not bag.gaps
