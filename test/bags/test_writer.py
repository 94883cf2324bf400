# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags read back by two independent readers, rosbags and mcap with mcap_ros2."""

import errno
import json
import os
import random
import resource
import subprocess
import sys
from collections import defaultdict
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory
from patience import PATIENCE_SECONDS
from rosbags.highlevel import AnyReader

from sparse_coord_ros.base.errors import BagError, SparseCoordError
from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.log.bags import BagWriter, QoS, layout, open_bag, type_hash
from sparse_coord_ros.log.bags.metadata import offered_qos_profiles
from sparse_coord_ros.log.bags.schemas import schema_text

TYPES = (
    "geometry_msgs/msg/PoseStamped",
    "sensor_msgs/msg/JointState",
    "nav_msgs/msg/Path",
    "nav_msgs/msg/OccupancyGrid",
    "visualization_msgs/msg/MarkerArray",
    "diagnostic_msgs/msg/DiagnosticArray",
    "diagnostic_msgs/msg/DiagnosticStatus",
    "std_msgs/msg/String",
    "rosgraph_msgs/msg/Clock",
    "rcl_interfaces/msg/Log",
    "rcl_interfaces/msg/ParameterEvent",
)
LATCHED = QoS(durability="transient_local", depth=1)
STRING = "std_msgs/msg/String"


def topic_of(type_name):
    """Return the topic that a type is recorded on here."""
    return "/" + type_name.rsplit("/", 1)[1].lower()


def write_all_types(directory, samples, rounds=3, **options):
    """Write a bag with messages of every type, and a metadata record."""
    with closing(BagWriter(directory, **options)) as bag:
        channels = {
            name: bag.add_topic(
                topic_of(name), name, LATCHED if "Grid" in name else QoS()
            )
            for name in TYPES
        }
        bag.add_metadata("run", {"seed": "7", "scenario": "cit"})
        for step in range(rounds):
            for place, (name, channel) in enumerate(channels.items()):
                time_ns = step * 1_000 + place
                bag.write(
                    channel,
                    samples.cdr(name, step + 1),
                    10_000 + time_ns,
                    5_000 + time_ns,
                )
    return directory


@pytest.fixture(scope="module")
def bag_directory(tmp_path_factory, samples):
    """Return a finished bag with messages of every type."""
    return write_all_types(tmp_path_factory.mktemp("bags") / "run", samples)


def mcap_reader(directory, **options):
    """Return mcap's indexed reader of a bag, checking all CRCs."""
    path = directory / f"{directory.name}_0.mcap"
    return SeekingReader(path.open("rb"), validate_crcs=True, **options)


def test_every_message_decodes_with_both_readers(bag_directory, samples):
    """Fields equal what went in, by both decoders; log times and order are kept."""
    by_rosbags = defaultdict(list)
    by_mcap = defaultdict(list)
    with AnyReader([bag_directory]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            by_rosbags[connection.topic].append((time, message))
    reader = mcap_reader(bag_directory, decoder_factories=[DecoderFactory()])
    for _, channel, message, decoded in reader.iter_decoded_messages():
        by_mcap[channel.topic].append((message.log_time, decoded))
    for place, type_name in enumerate(TYPES):
        for found in (by_rosbags[topic_of(type_name)], by_mcap[topic_of(type_name)]):
            assert [time for time, _ in found] == [
                10_000 + place + 1_000 * i for i in range(3)
            ]
            for seed, (_, message) in enumerate(found, start=1):
                assert samples.same(samples.message(type_name, seed), message), (
                    type_name
                )


def test_channels_carry_schema_hash_and_qos(bag_directory):
    """The file itself contains the information for rosbag2 and Foxglove."""
    reader = mcap_reader(bag_directory)
    header = reader.get_header()
    summary = reader.get_summary()
    assert (header.profile, header.library) == (
        "ros2",
        f"sparse_coord_ros {__version__}",
    )
    assert {s.name: s.data.decode() for s in summary.schemas.values()} == {
        name: schema_text(name) for name in TYPES
    }
    assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
    for channel in summary.channels.values():
        name = summary.schemas[channel.schema_id].name
        assert channel.topic == topic_of(name)
        assert channel.message_encoding == "cdr"
        assert channel.metadata == {
            "offered_qos_profiles": offered_qos_profiles(
                (LATCHED if "Grid" in name else QoS(),)
            ),
            "topic_type_hash": type_hash(name),
        }


def test_file_is_complete(bag_directory):
    """Statistics, indexes, sequence numbers, CRCs, metadata."""
    reader = mcap_reader(bag_directory)
    summary = reader.get_summary()
    statistics = summary.statistics
    assert statistics.message_count == 33
    assert (statistics.channel_count, statistics.schema_count) == (11, 11)
    assert (statistics.message_start_time, statistics.message_end_time) == (
        10_000,
        12_010,
    )
    assert all(index.message_index_offsets for index in summary.chunk_indexes)
    sequences = {}
    for _, channel, message in reader.iter_messages():
        sequences.setdefault(channel.topic, []).append(message.sequence)
        assert message.publish_time == message.log_time - 5_000
    assert set(map(tuple, sequences.values())) == {(0, 1, 2)}
    records = {record.name: record.metadata for record in reader.iter_metadata()}
    assert records["run"] == {"seed": "7", "scenario": "cit"}
    with (bag_directory / "run_0.mcap").open("rb") as stream:
        scanned = list(NonSeekingReader(stream, validate_crcs=True).iter_messages())
    assert len(scanned) == 33


def test_same_calls_give_same_bytes(tmp_path, samples):
    """Neither clock nor process leaves a trace."""
    options = {"chunk_size": 2_000}
    one = write_all_types(tmp_path / "a" / "run", samples, rounds=9, **options)
    two = write_all_types(tmp_path / "b" / "run", samples, rounds=9, **options)
    assert sorted(p.name for p in one.iterdir()) == ["metadata.yaml", "run_0.mcap"]
    for path in one.iterdir():
        assert path.read_bytes() == (two / path.name).read_bytes()
    summary = mcap_reader(one).get_summary()
    assert len(summary.chunk_indexes) > 3
    assert {i.compression for i in summary.chunk_indexes} == {"zstd"}
    assert len(list(mcap_reader(one).iter_messages())) == 99


@pytest.mark.long
def test_doctor_finds_nothing(tmp_path, samples):
    """A third reader of MCAP, which searches for errors in files."""
    doctor = Path(sys.executable).with_name("pymcap-cli")
    if not doctor.exists():
        pytest.skip("pymcap-cli is not installed")
    directory = write_all_types(tmp_path / "run", samples, rounds=9, chunk_size=2_000)
    done = subprocess.run(
        [doctor, "doctor", "--format", "jsonl", directory / "run_0.mcap"],
        capture_output=True,
        text=True,
        timeout=PATIENCE_SECONDS,
    )
    assert done.returncode == 0, done.stdout
    found = [json.loads(line) for line in done.stdout.splitlines()]
    codes = {line["code"] for line in found if "code" in line}
    assert codes <= {"SMALL_CHUNKS", "NO_ATTACHMENTS"}, done.stdout


def test_existing_directory_is_refused_and_untouched(bag_directory):
    """No directory is overwritten, not even one without a bag."""
    before = {path.name: path.read_bytes() for path in bag_directory.iterdir()}
    with pytest.raises(BagError, match=f"{bag_directory} exists: choose another name"):
        BagWriter(bag_directory)
    with pytest.raises(
        BagError, match=r"cannot make .*/run_0.mcap/a/a_0\.mcap: Not a dir"
    ):
        BagWriter(bag_directory / "run_0.mcap" / "a")
    assert {path.name: path.read_bytes() for path in bag_directory.iterdir()} == before
    assert issubclass(BagError, SparseCoordError)


def test_topics_are_registered_once(tmp_path):
    """A second call returns the same channel."""
    with closing(BagWriter(tmp_path / "run")) as bag:
        first = bag.add_topic("/a", STRING, QoS())
        assert bag.add_topic("/a", STRING, QoS()) == first
        assert bag.add_topic("/b", STRING, LATCHED) != first
        with pytest.raises(BagError, match="no definition of nav_msgs/msg/Nope"):
            bag.add_topic("/c", "nav_msgs/msg/Nope", QoS())
    statistics = mcap_reader(tmp_path / "run").get_summary().statistics
    assert (statistics.channel_count, statistics.schema_count) == (2, 1)


def test_closed_bag_takes_nothing_more(tmp_path):
    """A second close does nothing."""
    bag = BagWriter(tmp_path / "run")
    channel = bag.add_topic("/a", STRING, QoS())
    bag.close()
    bag.close()
    bag.abandon()
    size = bag.bytes_written
    for call in (
        lambda: bag.write(channel, b"", 0, 0),
        lambda: bag.add_topic("/b", STRING, QoS()),
        lambda: bag.add_metadata("a", {}),
        bag.flush,
    ):
        with pytest.raises(BagError, match="run_0.mcap is closed: open a new one"):
            call()
    assert bag.bytes_written == size == (tmp_path / "run" / "run_0.mcap").stat().st_size


def unfinished_times(directory):
    """Return the log times in an unfinished bag's file, the only one in its directory."""
    [path] = directory.iterdir()
    assert path.name == f"{directory.name}_0.mcap.partial"
    bag = open_bag(directory)
    assert (bag.path, bag.finished, bag.damage) == (path, False, None)
    return [message.log_time_ns for message in bag.messages()]


def test_file_gets_its_name_when_it_is_whole(tmp_path):
    """A finished file of that name from another source is not overwritten."""
    with closing(BagWriter(tmp_path / "run")):
        assert [p.name for p in (tmp_path / "run").iterdir()] == ["run_0.mcap.partial"]
    names = ["metadata.yaml", "run_0.mcap"]
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == names
    bag = BagWriter(tmp_path / "other")
    (tmp_path / "other" / "other_0.mcap").write_text("precious")
    with pytest.raises(
        BagError, match=r"cannot finish .*partial as other_0.mcap: File exists"
    ):
        bag.close()
    assert (tmp_path / "other" / "other_0.mcap").read_text() == "precious"
    assert open_bag(tmp_path / "other" / "other_0.mcap.partial").finished


def test_an_abandoned_bag_has_all_its_messages(tmp_path, samples):
    """A broken run must not look whole; its messages are still there."""
    bag = BagWriter(tmp_path / "run", chunk_size=1_000)
    samples.fill(bag, 500)
    assert 480 < len(unfinished_times(tmp_path / "run")) < 500, "but for the last chunk"
    bag.abandon()
    assert unfinished_times(tmp_path / "run") == [*range(500)]
    with pytest.raises(BagError, match="is closed"):
        bag.flush()


@contextmanager
def small_disk():
    """Let no file of this process grow beyond 50,000 bytes; pytest's own output may be longer."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_full_disk_is_a_clear_error_and_stays_one(tmp_path):
    """The first failure names file, size and cause; the file ends with its last whole chunk."""
    bag = BagWriter(tmp_path / "run", chunk_size=10_000)
    channel = bag.add_topic("/a", STRING, QoS())
    message = "cannot write .*run_0.mcap.partial beyond 50000 bytes: File too large; .* make room"
    with small_disk(), pytest.raises(BagError, match=message) as caught:
        for i in range(1_000):
            bag.write(channel, random.randbytes(100), i, i)
    assert caught.value.__cause__.errno == errno.EFBIG
    for call in (lambda: bag.write(channel, b"", 0, 0), bag.flush, bag.close):
        with pytest.raises(BagError, match=message):
            call()
    bag.close()
    times = unfinished_times(tmp_path / "run")
    assert 200 < len(times) < 400
    assert times == list(range(len(times)))


@pytest.mark.parametrize("room", [0, 7, 28, 400, 1_700])
def test_disk_full_while_closing_leaves_every_message(
    tmp_path, samples, monkeypatch, room
):
    """At any place in the last records: all flushed messages can be read."""
    disk = Disk()
    monkeypatch.setattr(layout, "open", disk.open, raising=False)
    bag = BagWriter(tmp_path / "run")
    samples.fill(bag, 10)
    bag.flush()
    disk.room = room
    with pytest.raises(BagError, match="No space left on device"):
        bag.close()
    assert unfinished_times(tmp_path / "run") == list(range(10))


class Disk:
    """A disk with one file, and space for a number of further bytes; at first for many."""

    def __init__(self):
        self.room = 1 << 30

    def open(self, *arguments, **options):
        self.file = open(*arguments, **options)
        return self

    def write(self, data):
        if not self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = self.file.write(data[: self.room])
        self.room -= written
        return written

    def __getattr__(self, name):
        return getattr(self.file, name)


def test_metadata_yaml_that_cannot_be_written_is_an_error(tmp_path):
    """The MCAP file is whole by then and can be read alone."""
    bag = BagWriter(tmp_path / "run")
    (tmp_path / "run" / "metadata.yaml").mkdir()
    with pytest.raises(BagError, match="cannot write .*metadata.yaml: Is a directory"):
        bag.close()
    with (tmp_path / "run" / "run_0.mcap").open("rb") as stream:
        assert make_reader(stream).get_summary().statistics.message_count == 0
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == [
        "metadata.yaml",
        "run_0.mcap",
    ]


def test_the_disk_has_file_names_and_metadata(tmp_path, samples, monkeypatch):
    """A finished bag survives a power cut: the file, `metadata.yaml`, and both names."""
    synced = []
    real = os.fsync

    def fsync(descriptor):
        synced.append(os.path.basename(os.readlink(f"/proc/self/fd/{descriptor}")))
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    with closing(BagWriter(tmp_path / "run")) as writer:
        writer.write(writer.add_topic("/a", STRING, QoS()), samples.cdr(STRING), 1, 1)
    assert synced == ["run_0.mcap.partial", "run", "metadata.yaml.partial", "run"]
