# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recovering: in place, beside a file, after a kill, on a full disk; exit codes."""

import json
import os
import sys

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.log.bags import BagTopic, BagWriter, QoS, open_bag
from sparse_coord_ros.log.bags.gaps import to_note
from sparse_coord_ros.log.bags.recover import recover

STRING = "std_msgs/msg/String"


def write_bag(directory, samples, *, finish, compression="lz4", messages=20):
    """Write a bag with an attachment and metadata; abandon it unless `finish`."""
    writer = BagWriter(directory, compression=compression, chunk_size=300)
    writer.add_metadata("run", {"seed": "7"})
    channel = writer.add_topic("/a", STRING, QoS(durability="transient_local"))
    for i in range(messages):
        writer.write(channel, samples.cdr(STRING, i), i, i)
    writer.attach("map.txt", b"#", "text/plain", 3)
    writer.close() if finish else writer.abandon()
    return directory


def names(directory):
    return sorted(path.name for path in directory.iterdir())


def run(capsys, *arguments):
    """Run the verb; return its exit code and output."""
    code = main(["recover", *map(str, arguments)])
    printed = capsys.readouterr()
    assert "Traceback" not in printed.err
    return code, (printed.out + printed.err).strip()


def check_whole(directory, samples, messages):
    """Whole for this reader, rosbags and mcap, with these many messages."""
    bag = open_bag(directory)
    assert (bag.finished, bag.damage, bag.message_count) == (True, None, messages)
    assert bag.metadata["run"] == {"seed": "7"}
    assert bag.topics["/a"].qos == (QoS(durability="transient_local"),)
    with AnyReader([directory]) as reader:
        found = [(time, bytes(data)) for _, time, data in reader.messages()]
    assert found == [(i, samples.cdr(STRING, i)) for i in range(messages)]
    with bag.path.open("rb") as stream:
        assert make_reader(stream).get_summary().statistics.message_count == messages
    decoded = [m.ros_msg.data for m in read_ros2_messages(bag.path)]
    assert decoded == [samples.message(STRING, i).data for i in range(messages)]
    text = (directory / "metadata.yaml").read_text()
    information = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert information["relative_file_paths"] == [bag.path.name]
    assert information == yaml.safe_load(bag.metadata["rosbag2"]["serialized_metadata"])
    return bag


def test_whole_bag_is_left_alone(tmp_path, samples, capsys):
    bag = write_bag(tmp_path / "run", samples, finish=True)
    before = {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in bag.iterdir()}
    for path in (bag, bag / "run_0.mcap"):
        content = "20 messages of 1 topics, 1 attachments, 0.0 s"
        assert run(capsys, path) == (0, f"{bag} is whole: {content}")
    assert {
        p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in bag.iterdir()
    } == before


def test_unfinished_bag_is_finished(tmp_path, samples, capsys):
    """Nothing was lost: exit code 0; the original is kept, compression and all content too."""
    bag = write_bag(tmp_path / "run", samples, finish=False)
    original = (bag / "run_0.mcap.partial").read_bytes()
    code, printed = run(capsys, bag / "run_0.mcap.partial", "--json")
    assert code == 0
    assert json.loads(printed) == {
        "bag": str(bag),
        "changed": True,
        "complete": True,
        "damage": None,
        "lost_bytes": 0,
        "gaps": [],
        "recovered": None,
        "messages": 20,
        "topics": 1,
        "attachments": 1,
        "original": f"{bag}/run_0.mcap.partial.damaged",
    }
    assert names(bag) == ["metadata.yaml", "run_0.mcap", "run_0.mcap.partial.damaged"]
    assert (bag / "run_0.mcap.partial.damaged").read_bytes() == original
    found = check_whole(bag, samples, 20)
    assert found.compressions == ("lz4",)
    assert [
        (a.name, a.media_type, a.data, a.log_time_ns) for a in found.attachments
    ] == [("map.txt", "text/plain", b"#", 3)]
    code, printed = run(capsys, bag)
    assert code == 0
    assert printed.splitlines()[1:] == ["recovered from a broken bag"]


def test_what_was_recovered_says_so_for_good(tmp_path, samples, capsys):
    """Complete or not; a later recovery does not make it complete again."""
    assert (
        open_bag(write_bag(tmp_path / "good", samples, finish=True)).recovered is None
    )
    bag = write_bag(tmp_path / "run", samples, finish=False)
    recover(bag)
    complete = {"gaps": "[]"}
    assert open_bag(bag).recovered == complete
    assert open_bag(bag).metadata_records[0] == ("recovered", complete)
    file = bag / "run_0.mcap"
    os.truncate(file, open_bag(bag).files[0].readable_bytes - 200)
    cut = open_bag(bag)
    assert cut.recovered == complete and not cut.whole
    recover(bag)
    lost = {"gaps": to_note(cut.gaps)}
    assert open_bag(bag).recovered == lost
    gaps = tuple(gap._replace(recovered=True) for gap in cut.gaps)
    assert gaps and open_bag(bag).gaps == gaps and open_bag(bag).whole
    before = file.read_bytes()
    code, printed = run(capsys, bag)
    assert (code, file.read_bytes()) == (1, before)
    whole, told, named = printed.splitlines()
    assert named == f"lost: {gaps[0].text}" and " of the original" in named
    assert whole.startswith(f"{bag} is whole: ")
    assert told == "recovered from a broken bag"
    assert json.loads(run(capsys, bag, "--json")[1])["recovered"] == lost
    with file.open("r+b") as stream:  # only the index: no messages are lost
        stream.seek(-60, os.SEEK_END)
        stream.write(bytes(20))
    index = open_bag(bag)
    assert index.whole
    code, printed = run(capsys, bag)
    assert (code, f"before, it was {told}" in printed.splitlines()) == (1, True)
    twice = open_bag(bag)
    assert twice.recovered == lost
    assert [name for name, _ in twice.metadata_records] == [
        "recovered",
        "run",
        "rosbag2",
    ]
    os.truncate(file, open_bag(bag).files[0].readable_bytes - 100)
    more = open_bag(bag).gaps
    recover(bag)
    assert len(more) == 2 and open_bag(bag).recovered["gaps"] == to_note(more)


def test_cut_bag_loses_its_tail(tmp_path, samples, capsys):
    """Exit code 1 with the amount; a second damage does not overwrite the first original."""
    bag = write_bag(tmp_path / "run", samples, finish=True)
    file = bag / "run_0.mcap"
    for number, ending in enumerate((".damaged", ".damaged2")):
        chunks = open_bag(bag).files[0].readable_bytes
        os.truncate(file, chunks // 2 + number)
        cut = file.read_bytes()
        read = open_bag(bag)
        assert 0 < read.message_count < 20
        code, printed = run(capsys, bag)
        assert code == 1
        lines = printed.splitlines()
        assert lines[0].startswith(
            f"{bag} holds what could be read: {read.message_count} messages of 1 to"
        )
        before = ["before, it was recovered", "lost: run_0.mcap, bytes "] * number
        assert [line[:24] for line in lines[1:-2]] == before
        assert lines[-2] == f"lost: {read.gaps[-1].text}"
        assert read.gaps[-1].end == len(cut) and read.lost_bytes
        assert lines[-1] == f"the original is {file}{ending}"
        assert (bag / f"run_0.mcap{ending}").read_bytes() == cut
        assert (bag / "metadata.yaml.damaged").exists()
        check_whole(bag, samples, read.message_count)


def test_changed_metadata_are_told_from_lost_messages(tmp_path, samples, capsys):
    bag = write_bag(tmp_path / "run", samples, finish=True)
    file = bag / "run_0.mcap"
    file.write_bytes(file.read_bytes().replace(b"seed", b"sEed", 1))
    code, printed = run(capsys, bag)
    assert (code, "every message is there, but metadata may be wrong" in printed) == (
        1,
        True,
    )
    assert open_bag(bag).message_count == 20


@pytest.mark.parametrize(
    "state", ["no metadata.yaml", "bad metadata.yaml", "other metadata.yaml", "no name"]
)
def test_finished_file_gets_what_is_missing(tmp_path, samples, capsys, state):
    """A recorder that was killed while it closed the bag: the file itself is not changed."""
    bag = write_bag(tmp_path / "run", samples, finish=True)
    original = (bag / "run_0.mcap").read_bytes()
    metadata = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").unlink()
    if state == "bad metadata.yaml":
        (bag / "metadata.yaml").write_text("{[")
    if state == "other metadata.yaml":  # of more messages than there are
        assert "message_count: 20" in metadata
        changed = metadata.replace("message_count: 20", "message_count: 21")
        (bag / "metadata.yaml").write_text(changed)
    if state == "no name":
        (bag / "run_0.mcap").rename(bag / "run_0.mcap.partial")
    assert run(capsys, bag)[0] == 0
    kept = ["metadata.yaml.damaged"] if state.split()[0] in ("bad", "other") else []
    assert names(bag) == ["metadata.yaml", *kept, "run_0.mcap"]
    assert (bag / "run_0.mcap").read_bytes() == original
    assert (bag / "metadata.yaml").read_text() == metadata
    check_whole(bag, samples, 20)


def test_nothing_readable(tmp_path, capsys):
    """Exit code 2 and one line; no file is written."""
    (tmp_path / "run").mkdir()
    file = tmp_path / "run" / "run_0.mcap"
    for data, message in {
        b"": "is not an MCAP file",
        b"\x89MCAP0\r\n": "holds nothing to recover: byte 8",
        b"\x89MCAP0\r\n" + bytes(500): "holds nothing to recover: byte 8",
    }.items():
        file.write_bytes(data)
        code, printed = run(capsys, tmp_path / "run")
        assert (code, message in printed, "\n" in printed) == (2, True, False)
    assert run(capsys, tmp_path / "none")[0] == 2
    assert names(tmp_path / "run") == ["run_0.mcap"]


def test_sequence_numbers_and_foreign_types_are_carried_over(tmp_path):
    """A gap in the original stays a gap; no definition needs to be installed.

    Contradictions in the original stay, too.
    """
    topic = BagTopic(
        "/a",
        "own_msgs/msg/Own",
        "int8 x",
        (QoS(), QoS(depth=1)),
        "RIHS01_ab",
        "ros2idl",
    )
    writer = BagWriter(tmp_path / "run")
    for seed in "78":
        writer.add_metadata("run", {"seed": seed})
    channel = writer.add_known_topic(topic)
    for sequence in (5, 7, 6):
        writer.write(channel, b"\0\1\0\0x", 1, 2, sequence)
    writer.abandon()
    assert recover(tmp_path / "run").bag.whole
    bag = open_bag(tmp_path / "run")
    assert bag.topics == {"/a": topic}
    assert [message.sequence for message in bag.messages()] == [5, 7, 6]
    seeds = [texts["seed"] for name, texts in bag.metadata_records if name == "run"]
    assert seeds == ["7", "8"] and bag.metadata["run"] == {"seed": "7"}


def test_bag_that_is_being_recorded_is_refused(tmp_path, samples):
    """Its recorder would continue to write into the kept original."""
    writer = BagWriter(tmp_path / "run")
    writer.write(writer.add_topic("/a", STRING, QoS()), samples.cdr(STRING), 0, 0)
    writer.flush()
    with pytest.raises(
        BagError, match="run_0.mcap.partial is being recorded: stop its recorder"
    ):
        recover(tmp_path / "run")
    assert names(tmp_path / "run") == ["run_0.mcap.partial"]
    writer.close()
    assert not recover(tmp_path / "run").changed


def test_full_disk_changes_nothing(tmp_path, samples, monkeypatch):
    bag = write_bag(tmp_path / "run", samples, finish=False)

    class FullDisk(BagWriter):
        def close(self):
            raise BagError("cannot write: No space left on device")

    monkeypatch.setattr(sys.modules[recover.__module__], "BagWriter", FullDisk)
    with pytest.raises(BagError, match="No space left"):
        recover(bag)
    assert names(bag) == ["run_0.mcap.partial"]
    assert open_bag(bag).message_count == 20


def test_a_copy_that_lacks_something_takes_no_place(tmp_path, samples, monkeypatch):
    bag = write_bag(tmp_path / "run", samples, finish=False)
    before = {path.name: path.read_bytes() for path in bag.iterdir()}
    write = BagWriter.write

    def forgetful(writer, channel, data, log_ns, *more):
        if log_ns != 13:
            write(writer, channel, data, log_ns, *more)

    monkeypatch.setattr(BagWriter, "write", forgetful)
    with pytest.raises(BagError, match="does not read back"):
        recover(bag)
    assert {path.name: path.read_bytes() for path in bag.iterdir()} == before


def test_a_file_of_another_name_leaves_one_bag(tmp_path, samples, capsys):
    bag = write_bag(tmp_path / "run", samples, finish=True)
    (bag / "run_0.mcap").rename(bag / "other.mcap")
    os.truncate(bag / "other.mcap", (bag / "other.mcap").stat().st_size - 9)
    assert run(capsys, bag)[0] in (0, 1)
    assert names(bag) == [
        "metadata.yaml",
        "metadata.yaml.damaged",
        "other.mcap.damaged",
    ] + [f"{open_bag(bag).path.name}"]
