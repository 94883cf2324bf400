# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord info` of bags that are being recorded, were cut off, or hold large files."""

import json

import pytest

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.log.bags import BagWriter, QoS

STRING = "std_msgs/msg/String"


@pytest.fixture
def recording(tmp_path, samples):
    """Return the writer of a bag `out/bag` that is being recorded."""
    writer = BagWriter(tmp_path / "out" / "bag")
    writer.write(writer.add_topic("/a", STRING, QoS()), samples.cdr(STRING), 1, 1)
    writer.flush()
    yield writer
    writer.close()


@pytest.fixture
def info(tmp_path, capsys):
    """Return a function that runs `info` on that run's directory and returns its output."""

    def run(*arguments):
        assert main(["info", str(tmp_path / "out"), *arguments]) == 0
        return capsys.readouterr().out

    return run


def test_a_bag_that_is_being_recorded_or_never_closed(recording, info):
    assert "being recorded" in info().splitlines()[0]
    assert json.loads(info("--json"))["recording"]
    recording.abandon()
    head = info().splitlines()[0]
    assert head.endswith(
        "it has no end (cut off, or still being written); read to message 1"
    )
    assert not json.loads(info("--json"))["recording"]


def test_what_a_stranger_wrote_does_nothing_to_the_terminal(recording, info):
    odd = "\x1b[2J\nrun: seed 7"
    recording.add_metadata("sparse_coord_ros", {"seed": odd, f"version_{odd}": odd})
    recording.write(recording.add_topic(f"/b{odd}", STRING, QoS()), b"", 2, 2)
    recording.close()
    lines = info().split("\n")
    assert [
        line for line in lines if not line.isprintable() or line == "run: seed 7"
    ] == []
    assert sum("\\x1b[2J\\nrun: seed 7" in line for line in lines) == 3


@pytest.mark.parametrize("verb", ["info", "verify", "explain", "replay"])
def test_an_empty_name_is_not_this_directory(verb, capsys):
    """For example from an unset shell variable."""
    with pytest.raises(SystemExit) as ended:
        main([verb, ""])
    assert ended.value.code == 2
    line = capsys.readouterr().err
    assert line.startswith("error: argument BAG: is empty: give a path;")
