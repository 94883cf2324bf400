# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reader with finished, unfinished, foreign and damaged bags."""

import errno
import os
from contextlib import closing

import pytest
from mcap.writer import CompressionType, Writer
from recordings import chunks_in
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.log.bags import (
    BagTopic,
    BagWriter,
    Message,
    QoS,
    open_bag,
    type_hash,
)
from sparse_coord_ros.log.bags.layout import RESCUE
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
    writer.flush()
    yield writer
    writer.close()


def test_everything_that_was_written_is_read(tmp_path, bag, samples):
    """Also from an unfinished bag; finishing it changes only `finished`."""
    writer = bag
    for finished in (False, True):
        bag = open_bag(tmp_path / "run")
        assert (bag.finished, bag.damage) == (finished, None)
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
        assert bag.compressions == {"zstd"}
        assert bag.files[0].size == bag.path.stat().st_size
        writer.close()


def test_nothing_to_read_is_one_line(tmp_path):
    """No file, an empty directory, several files, no MCAP."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mcap").write_text("not at all a bag\n" * 9)
    for name in ("two/a_0.mcap", "two/b_1.mcap", "same/a_0.mcap", "same/a.mcap"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    for path, message in {
        "none": "cannot read .*none: No such file or directory",
        "empty": "empty is not a bag: it has no .mcap file",
        "two": "two has 2 .mcap files: name one",
        "same": "same has 2 .mcap files: name one",
        "text.mcap": "text.mcap is not an MCAP file",
    }.items():
        with pytest.raises(BagError, match=message):
            open_bag(tmp_path / path)


def test_a_disk_that_fails_is_one_line(tmp_path, bag, monkeypatch):
    def bad_disk(*_):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("sparse_coord_ros.log.bags.reader.ExactFile.read", bad_disk)
    with pytest.raises(BagError, match=r"\.partial: Input/output error$"):
        open_bag(tmp_path / "run")


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


def foreign_file(path, metadata=None, encoding="cdr"):
    """Write a file that MCAP allows, but no recorder writes."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema(STRING, "ros2msg", b"string data")
        channel = writer.register_channel("/odd", encoding, schema, metadata or {})
        writer.add_message(channel, 1, b"\0" * 4, 1)
        writer.finish()
    return path


@pytest.mark.parametrize("text", ["{[", "7", "- x", "- {depth: -1}"])
def test_qos_profiles_that_nobody_understands_are_left_out(tmp_path, text):
    path = foreign_file(tmp_path / "a.mcap", {"offered_qos_profiles": text})
    bag = open_bag(path)
    assert bag.damage is None and bag.topics["/odd"].qos == ()
    assert bag.message_count == 1


def test_files_of_others_than_ros_2_are_read_too(tmp_path):
    bag = open_bag(foreign_file(tmp_path / "a.mcap", encoding="json"))
    assert bag.damage is None and bag.topics["/odd"].encoding == "json"


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


# Damage.


@pytest.fixture
def chunks(tmp_path, samples):
    """Return the file of a bag with 20 messages in a chunk each, and the chunks' places."""
    with closing(BagWriter(tmp_path / "run")) as writer:
        samples.fill(writer, 20, chunks=True)
    bag = open_bag(tmp_path / "run")
    assert bag.damage is None
    return bag.path, chunks_in(bag.path)


def times(bag):
    return [message.log_time_ns for message in bag.messages()]


@pytest.mark.parametrize("hit", [0, 1, 10, 19])
@pytest.mark.parametrize("at", ["kind", "head", "content", "end"])
def test_a_damaged_chunk_ends_reading(chunks, hit, at):
    path, blocks = chunks
    offset, length = blocks[hit]
    place = {"kind": 0, "head": 30, "content": 60, "end": length - 5}[at]
    data = bytearray(path.read_bytes())
    data[offset + place] ^= 0xFF
    path.write_bytes(data)
    bag = open_bag(path)
    if at == "kind":  # of an unknown kind: such records are skipped
        if hit == 0:  # it had the channels of all others
            assert times(bag) == []
            assert bag.damage.endswith("a message of the unknown channel 1")
        else:
            assert times(bag) == [n for n in range(20) if n != hit]
        return
    assert times(bag) == list(range(hit))
    assert bag.damage.startswith(f"byte {offset}: ")
    assert bag.ends_early("message 7").endswith(
        f"read to message 7, for the rest: {RESCUE}"
    )


def test_junk_between_chunks_ends_reading(chunks):
    path, blocks = chunks
    data = path.read_bytes()
    for junk in (bytes(100), b"junk" * 25):
        begin = blocks[7][0]
        path.write_bytes(data[:begin] + junk + data[begin:])
        bag = open_bag(path)
        assert times(bag) == list(range(7)) and bag.damage.startswith(f"byte {begin}: ")


@pytest.mark.parametrize("beyond", [0, 1, 8, 50])
@pytest.mark.parametrize("name", ["a_0.mcap", "a_0.mcap.partial"])
def test_a_file_that_is_cut_off_is_read_as_far_as_it_goes(
    chunks, tmp_path, beyond, name
):
    path, blocks = chunks
    data = path.read_bytes()
    cut = tmp_path / name
    for hit in (0, 1, 12):
        cut.write_bytes(data[: blocks[hit][0] + beyond])
        bag = open_bag(cut)
        assert times(bag) == list(range(hit))
        assert not bag.finished and bag.damage is None
        assert bag.ends_early("message 3") == (
            "it has no end (cut off, or still being written); read to message 3"
        )


def test_what_tools_add_to_our_files_is_no_damage(chunks):
    """`pymcap-cli add` repeats schemas and channels outside of chunks, and drops checksums."""
    path, _ = chunks
    bag = open_bag(path)
    with path.with_name("other.mcap").open("wb") as stream:
        writer = Writer(stream, use_chunking=False, enable_crcs=False)
        writer.start("ros2", "sparse_coord_ros 3")
        topic = bag.topics["/a"]
        schema = writer.register_schema(
            topic.type_name, "ros2msg", topic.schema.encode()
        )
        channel = writer.register_channel("/a", "cdr", schema)
        for one in bag.messages():
            writer.add_message(channel, one.log_time_ns, one.data, one.publish_time_ns)
        writer.add_metadata("note", {"operator": "me"})
        writer.finish()
    other = open_bag(path.with_name("other.mcap"))
    assert other.damage is None and other.ends_early("") is None
    assert times(other) == times(bag) and other.metadata["note"] == {"operator": "me"}
