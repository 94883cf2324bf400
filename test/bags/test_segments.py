# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of several files, the segments of a run; continued after a crash."""

import shutil
from contextlib import closing

import pytest
import yaml
from rosbags.highlevel import AnyReader

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.log.bags import BagWriter, QoS, open_bag
from sparse_coord_ros.log.bags.process import BagProcess
from sparse_coord_ros.log.bags.reader import continued

STRING = "std_msgs/msg/String"


def begin(directory, samples, times=range(30), **options):
    writer = BagWriter(directory, chunk_size=200, **options)
    channels = [writer.add_topic(f"/{name}", STRING, QoS()) for name in "ab"]
    write(writer, channels, samples, times)
    return writer, channels


def write(writer, channels, samples, times):
    for time in times:
        writer.write(channels[time % 2], samples.cdr(STRING, time), time, time)


def by_rosbags(directory):
    with AnyReader([directory]) as reader:
        return [(c.topic, time) for c, time, _ in reader.messages()]


def said(bag):
    return [(message.topic, message.log_time_ns) for message in bag.messages()]


def test_what_is_counted_over_several_files(tmp_path, samples):
    """Bytes count over all files; times may be in any order; channel numbers may differ."""
    writer, [a, b] = begin(tmp_path / "bag", samples)
    before = writer.bytes_written
    writer.begin_file()
    assert writer.bytes_written > before
    for time in (50, 40, 60):
        writer.write(b, samples.cdr(STRING), time, time)
    writer.close()
    bag = open_bag(tmp_path / "bag")
    assert [m.sequence for m in bag.messages({"/b"})] == [*range(15), 0, 1, 2]
    assert bag.counts == {"/a": 15, "/b": 18}
    information = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    last = information["rosbag2_bagfile_information"]["files"][1]
    assert last["starting_time"]["nanoseconds_since_epoch"] == 40
    assert last["duration"]["nanoseconds"] == 20


def test_a_bag_begins_with_its_earliest_message(tmp_path, samples, monkeypatch):
    """A file without messages has no beginning; time 0 is one."""
    writer, _ = begin(tmp_path / "later", samples, range(5, 10))
    writer.begin_file()
    writer.close()
    assert open_bag(tmp_path / "later").start_ns == 5
    monkeypatch.setattr("sparse_coord_ros.log.bags.reader.TOGETHER", 0)
    writer, channels = begin(tmp_path / "zero", samples, [0] * 20)
    write(writer, channels, samples, range(7, 30))
    writer.close()
    assert open_bag(tmp_path / "zero").files[0].start_ns == 0


def test_files_come_by_their_numbers_and_finished_ones_first(tmp_path, samples):
    directory = tmp_path / "bag"
    writer, channels = begin(directory, samples, range(1))
    for number in range(1, 12):
        writer.begin_file()
        write(writer, channels, samples, [number])
    writer.close()
    assert [time for _, time in said(open_bag(directory))] == list(range(12))
    data = (directory / "bag_3.mcap").read_bytes()
    (directory / "bag_3.mcap.partial").write_bytes(data[: len(data) // 2])
    bag = open_bag(directory)
    assert bag.files[3].path.name == "bag_3.mcap" and bag.message_count == 12


def test_a_topic_that_says_nothing_any_more_is_still_counted(tmp_path, samples):
    directory = tmp_path / "bag"
    begin(directory, samples)[0].close()
    with closing(BagWriter(directory, earlier=continued(directory))) as writer:
        channel = writer.add_topic("/b", STRING, QoS())  # here it has the number of /a
        writer.write(channel, samples.cdr(STRING), 30, 30)
    text = (directory / "metadata.yaml").read_text()
    topics = yaml.safe_load(text)["rosbag2_bagfile_information"][
        "topics_with_message_count"
    ]
    counts = {one["topic_metadata"]["name"]: one["message_count"] for one in topics}
    assert counts == {"/a": 15, "/b": 16}
    assert said(open_bag(directory))[-2:] == [("/b", 29), ("/b", 30)]


def test_a_killed_recorder_goes_on_in_the_next_file(tmp_path, samples):
    """Its unfinished file stays as it is, and is read as far as it goes."""
    directory = tmp_path / "bag"
    begin(directory, samples)[0].abandon()
    earlier = continued(directory)
    assert (earlier.end_ns, len(earlier.files)) == (29, 1)
    writer, _ = begin(directory, samples, range(30, 40), earlier=earlier)
    writer.close()
    bag = open_bag(directory)
    assert said(bag) == [(f"/{'ab'[i % 2]}", i) for i in range(40)]
    assert bag.finished
    assert sorted(path.name for path in directory.iterdir()) == [
        "bag_0.mcap.partial",
        "bag_1.mcap",
        "metadata.yaml",
    ]
    assert by_rosbags(directory) == [(f"/{'ab'[i % 2]}", i) for i in range(30, 40)]


def test_a_bag_that_is_being_recorded_is_not_continued(tmp_path, samples):
    writer, _ = begin(tmp_path / "bag", samples)
    with pytest.raises(BagError, match="is being recorded: stop its recorder first"):
        continued(tmp_path / "bag")
    writer.close()
    assert continued(tmp_path / "bag") is not None


@pytest.mark.parametrize("size", [0, None])
def test_a_bag_that_never_began_is_begun_anew(tmp_path, size):
    directory = tmp_path / "bag"
    BagWriter(directory).abandon()
    if size is not None:
        (directory / "bag_0.mcap.partial").write_bytes(b"")
    assert continued(directory) is None
    assert not directory.exists()
    assert continued(tmp_path / "none") is None


@pytest.mark.parametrize("writer_of", [BagWriter, BagProcess])
def test_a_bag_that_was_deleted_is_said_to_be_lost(tmp_path, samples, writer_of):
    directory = tmp_path / "bag"
    writer = writer_of(directory)
    channel = writer.add_topic("/a", STRING, QoS())
    writer.write(channel, samples.cdr(STRING, 0), 0, 0)
    writer.flush()
    shutil.rmtree(directory)
    with pytest.raises(BagError) as caught:
        writer.close()
    gone = f"{directory}/bag_0.mcap.partial was deleted while it was recorded"
    assert str(caught.value) == gone
    assert not directory.exists()


def test_a_directory_that_was_moved_has_all(tmp_path, samples):
    """Its new place contains all files."""
    writer = begin(tmp_path / "bag", samples)[0]
    (tmp_path / "bag").rename(tmp_path / "moved")
    with pytest.raises(BagError, match="cannot finish .*; all is in it"):
        writer.close()
    assert [path.name for path in tmp_path.iterdir()] == ["moved"]
    assert len(said(open_bag(tmp_path / "moved"))) == 30
