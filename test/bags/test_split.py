# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of several files: by size and time, continued after a crash; every reader reads them."""

import json
import shutil

import pytest
import yaml
from rosbags.highlevel import AnyReader

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.log.bags import BagWriter, QoS, open_bag
from sparse_coord_ros.log.bags.gaps import Gap
from sparse_coord_ros.log.bags.metadata import ROLLED_BACK
from sparse_coord_ros.log.bags.playlist import Playlist
from sparse_coord_ros.log.bags.process import BagProcess
from sparse_coord_ros.log.bags.recover import continued, recover

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


@pytest.mark.parametrize("limit", [{"max_bytes": 1500}, {"max_ns": 10}])
def test_files_by_size_and_time(tmp_path, samples, limit):
    begin(tmp_path / "bag", samples, **limit)[0].close()
    bag = open_bag(tmp_path / "bag")
    assert len(bag.files) > 1
    assert [file.path.name for file in bag.files] == [
        f"bag_{number}.mcap" for number in range(len(bag.files))
    ]
    assert (bag.finished, bag.damage, bag.whole, bag.message_count) == (
        True,
        None,
        True,
        30,
    )
    assert (
        said(bag)
        == by_rosbags(tmp_path / "bag")
        == [(f"/{'ab'[i % 2]}", i) for i in range(30)]
    )
    assert [message.sequence for message in bag.messages({"/a"})] == list(range(15))
    assert len(Playlist(bag, ["/a", "/b"])) == 30
    information = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    information = information["rosbag2_bagfile_information"]
    assert information["relative_file_paths"] == [file.path.name for file in bag.files]
    counts = [file["message_count"] for file in information["files"]]
    assert sum(counts) == information["message_count"] == 30
    topics = information["topics_with_message_count"]
    assert [topic["message_count"] for topic in topics] == [15, 15]
    assert bag.files[1].continued == {"why": "split"}


def test_a_file_of_so_long_ends_before_the_message_that_is_so_much_later(
    tmp_path, samples
):
    begin(tmp_path / "bag", samples, range(25), max_ns=10)[0].close()
    files = [file.summary for file in open_bag(tmp_path / "bag").files]
    assert [(file.start_ns, file.end_ns) for file in files] == [
        (0, 9),
        (10, 19),
        (20, 24),
    ]


def test_what_is_counted_over_several_files(tmp_path, samples):
    """Bytes count over all files; times may be in any order; channel numbers may differ."""
    writer, [a, b] = begin(tmp_path / "bag", samples)
    before = writer.bytes_written
    back = {"why": ROLLED_BACK, "step": "3", "first": "3"}
    writer.begin_file(back)
    assert writer.bytes_written > before
    for sequence, time in enumerate((50, 40, 60)):
        writer.write(b, samples.cdr(STRING), time, time, sequence=100 + sequence)
    writer.close()
    bag = open_bag(tmp_path / "bag")
    assert [file.continued for file in bag.files] == [None, back]
    assert [m.sequence for m in bag.messages({"/b"})] == [*range(15), 100, 101, 102]
    information = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    last = information["rosbag2_bagfile_information"]["files"][1]
    assert last["starting_time"]["nanoseconds_since_epoch"] == 40
    assert last["duration"]["nanoseconds"] == 20


def test_a_damaged_original_is_kept_beside_the_bag_that_goes_on(tmp_path, samples):
    """The repaired file lacks the lost part: the original is not removed."""
    for name, cut in (("whole", 0), ("damaged", 150)):
        directory = tmp_path / name
        begin(directory, samples)[0].abandon()
        [file] = directory.iterdir()
        data = bytearray(file.read_bytes())
        if cut:
            data[-cut:] = bytes(cut)
            file.write_bytes(data)
        assert continued(directory) is not None
        originals = [path for path in directory.iterdir() if ".damaged" in path.name]
        assert [path.read_bytes() for path in originals] == (
            [bytes(data)] if cut else []
        )


def test_files_come_by_their_numbers_and_finished_ones_first(tmp_path, samples):
    directory = tmp_path / "bag"
    writer, channels = begin(directory, samples, range(1))
    for number in range(1, 12):
        writer.begin_file({"why": "split"})
        write(writer, channels, samples, [number])
    writer.close()
    assert [time for _, time in said(open_bag(directory))] == list(range(12))
    data = (directory / "bag_3.mcap").read_bytes()
    (directory / "bag_3.mcap.partial").write_bytes(data[: len(data) // 2])
    bag = open_bag(directory)
    assert bag.files[3].path.name == "bag_3.mcap" and bag.message_count == 12


@pytest.mark.parametrize("last", [False, True])
def test_only_a_last_file_that_was_recovered_makes_a_bag_recovered(
    tmp_path, samples, last
):
    """A loss at the end of an earlier file is a gap between files."""
    note = {"gaps": "[]"}
    writer, channels = begin(tmp_path / "bag", samples, range(3))
    if not last:
        writer.add_metadata("recovered", note)
    writer.begin_file({"why": "restarted"})
    if last:
        writer.add_metadata("recovered", note)
    write(writer, channels, samples, range(3, 6))
    writer.close()
    assert open_bag(tmp_path / "bag").recovered == (note if last else None)


def test_a_topic_that_says_nothing_any_more_is_still_counted(tmp_path, samples):
    directory = tmp_path / "bag"
    begin(directory, samples)[0].close()
    with BagWriter(directory, earlier=continued(directory)) as writer:
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
    directory = tmp_path / "bag"
    begin(directory, samples)[0].abandon()
    earlier = continued(directory)
    assert (earlier.end_ns, len(earlier.files)) == (29, 1)
    writer, _ = begin(directory, samples, range(30, 40), earlier=earlier)
    writer.close()
    bag = open_bag(directory)
    assert (
        said(bag)
        == by_rosbags(directory)
        == [(f"/{'ab'[i % 2]}", i) for i in range(40)]
    )
    assert bag.files[1].continued == {"why": "restarted"}
    assert [message.sequence for message in bag.messages({"/b"})] == list(range(20))
    assert sorted(path.name for path in directory.iterdir()) == [
        "bag_0.mcap",
        "bag_1.mcap",
        "metadata.yaml",
    ]


def test_recover_mends_every_file(tmp_path, samples, capsys):
    directory = tmp_path / "bag"
    writer, _ = begin(directory, samples, max_ns=10)
    writer.abandon()
    (directory / "bag_1.mcap").rename(directory / "bag_1.mcap.partial")
    data = (directory / "bag_1.mcap.partial").read_bytes()
    (directory / "bag_1.mcap.partial").write_bytes(data[:-100])
    assert open_bag(directory).message_count == 30
    recovery = recover(directory)
    assert recovery.changed
    assert said(open_bag(directory)) == by_rosbags(directory)
    assert len(said(open_bag(directory))) == 30
    assert not recover(directory).changed
    assert main(["info", str(directory), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["files"] == ["bag_0.mcap", "bag_1.mcap", "bag_2.mcap"]


def test_a_bag_that_never_began_is_moved_aside(tmp_path):
    directory = tmp_path / "bag"
    BagWriter(directory).abandon()
    assert continued(directory) is None
    assert not directory.exists()
    assert (tmp_path / "bag.damaged").exists()
    assert continued(tmp_path / "none") is None


@pytest.mark.parametrize("writer_of", [BagWriter, BagProcess])
@pytest.mark.parametrize("split", [False, True])
@pytest.mark.parametrize("taken", [False, True])
def test_a_directory_that_was_deleted_loses_only_what_was_closed(
    tmp_path, samples, writer_of, split, taken
):
    """The open file is copied completely to an unused name, and one line names its place."""
    directory = tmp_path / "out" / "bag"
    rescued = tmp_path / "out" / "bag_rescued"
    writer = writer_of(directory, chunk_size=200)
    channel = writer.add_topic("/a", STRING, QoS())
    for time in range(30):
        if time == 20 and split:
            writer.begin_file({"why": "split"})
        if time == 25:
            writer.flush()
            writer.add_metadata("all of it", {})  # a process has written by then
            shutil.rmtree(tmp_path / "out")
            if taken:
                rescued.mkdir(parents=True)
                rescued = rescued.with_name("bag_rescued2")
        writer.write(channel, samples.cdr(STRING, time), time, time)
    if split:
        writer.begin_file({"why": "split"})
        writer.write(channel, samples.cdr(STRING, 30), 30, 30)
    with pytest.raises(BagError) as caught:
        writer.close()
    first = "bag_1.mcap" if split else "bag_0.mcap"
    assert str(caught.value) == (
        f"the bag {directory} was deleted while it was recorded; what was still open, {first} and "
        f"what came after it, is in {rescued}"
    )
    bag = open_bag(rescued)
    assert bag.finished and [time for _, time in said(bag)] == list(
        range(20 * split, 30 + split)
    )
    assert by_rosbags(rescued) == said(bag)


@pytest.mark.parametrize(
    ("removed", "named", "first", "last"),
    [
        ([0], "bag_0.mcap", None, 10),
        ([1, 2], "bag_1.mcap to bag_2.mcap", 9, 30),
        ([4], "bag_4.mcap", 39, None),
    ],
)
def test_a_missing_file_is_a_gap(
    tmp_path, samples, capsys, removed, named, first, last
):
    """The other files' numbers and `metadata.yaml` show it, also after a recovery."""
    directory = tmp_path / "bag"
    begin(directory, samples, range(50), max_ns=10)[0].close()
    assert len(open_bag(directory).files) == 5 and not open_bag(directory).gaps
    for number in removed:
        (directory / f"bag_{number}.mcap").unlink()
    why = "is missing" if len(removed) == 1 else "are missing"
    for _ in range(2):
        bag = open_bag(directory)
        gap = Gap(0, 0, why, first, last, named, removed[0])
        assert (bag.gaps, bag.damage, bag.whole) == ((gap,), f"{named} {why}", False)
        assert main(["info", str(directory)]) == 0
        assert f"lost: {gap.text}\n" in capsys.readouterr().out
        assert main(["recover", str(directory)]) == 1
        assert f"lost: {gap.text}\n" in capsys.readouterr().out
        assert [time for _, time in by_rosbags(directory)] == [
            time for _, time in said(bag)
        ]
    assert open_bag(directory / "bag_3.mcap").gaps == ()


@pytest.mark.parametrize("hit", [0, 1, 2])
def test_a_gap_lies_between_its_neighbours_in_other_files(tmp_path, samples, hit):
    """If the only chunk of a file is lost; the recovered bag has the same gap."""
    writer = BagWriter(tmp_path / "bag", max_ns=10)
    write(
        writer,
        [writer.add_topic(f"/{name}", STRING, QoS()) for name in "ab"],
        samples,
        range(30),
    )
    writer.close()
    path = tmp_path / "bag" / f"bag_{hit}.mcap"
    [block] = open_bag(path).files[0].blocks
    data = bytearray(path.read_bytes())
    data[block.offset + block.length - 5] ^= 1
    path.write_bytes(data)
    due = [(None, 10), (9, 20), (19, None)][hit]
    [gap] = open_bag(tmp_path / "bag").gaps
    assert (gap.begin, gap.end) == (block.offset, block.offset + block.length)
    assert (gap.file, gap.place, gap.first_ns, gap.last_ns) == (path.name, hit, *due)
    recover(tmp_path / "bag")
    bag = open_bag(tmp_path / "bag")
    assert bag.gaps == (gap._replace(recovered=True),) and bag.message_count == 20


def test_a_directory_that_was_moved_is_not_copied(tmp_path, samples):
    """Its new place contains all files."""
    writer = begin(tmp_path / "bag", samples)[0]
    (tmp_path / "bag").rename(tmp_path / "moved")
    with pytest.raises(BagError, match="cannot finish .*; all is in it"):
        writer.close()
    assert [path.name for path in tmp_path.iterdir()] == ["moved"]
    assert len(said(open_bag(tmp_path / "moved"))) == 30


def test_each_recovered_file_notes_its_own_gaps(tmp_path, samples):
    begin(tmp_path / "bag", samples, max_ns=10)[0].close()
    for name in ("bag_0.mcap", "bag_2.mcap"):
        path = tmp_path / "bag" / name
        block = open_bag(path).files[0].blocks[1]
        data = bytearray(path.read_bytes())
        data[block.offset + block.length - 5] ^= 1
        path.write_bytes(data)
    recover(tmp_path / "bag")
    assert [(gap.file, gap.place) for gap in open_bag(tmp_path / "bag").gaps] == [
        ("bag_0.mcap", 0),
        ("bag_2.mcap", 2),
    ]
