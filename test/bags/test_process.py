# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The writer in its own process: its errors when that process fails."""

import os
import re
import signal
import socket
import struct
import subprocess
import sys
from types import SimpleNamespace

import pytest
from patience import PATIENCE_SECONDS

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.base.signals import STOPPING
from sparse_coord_ros.log.bags import QoS, open_bag
from sparse_coord_ros.log.bags.process import BagProcess

STRING = "std_msgs/msg/String"


@pytest.fixture
def started(monkeypatch):
    """Return a writer's child `process`, and a second handle of the parent's socket."""
    found = SimpleNamespace()
    popen = subprocess.Popen
    pair = socket.socketpair

    def start(*arguments, **options):
        found.process = popen(*arguments, **options)
        return found.process

    def connect():
        ours, theirs = pair()
        found.socket = ours.dup()
        return ours, theirs

    monkeypatch.setattr(subprocess, "Popen", start)
    monkeypatch.setattr(socket, "socketpair", connect)
    yield found
    found.socket.close()


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (
            "/bin/false",
            "has ended before it had begun it; nothing is recorded: see what it says",
        ),
        ("/nowhere/python", "No such file or directory; nothing is recorded"),
    ],
)
def test_a_writer_that_does_not_start_is_not_said_to_leave_a_bag(
    tmp_path, monkeypatch, program, words
):
    monkeypatch.setattr(sys, "executable", program)
    with pytest.raises(BagError, match=re.escape(words)) as caught:
        BagProcess(tmp_path / "run")
    assert "it is read up to there" not in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_a_bag_that_cannot_be_made_is_one_error_and_no_traceback(tmp_path, capfd):
    with pytest.raises(BagError, match="exists: choose another name"):
        BagProcess(tmp_path)
    assert capfd.readouterr().err == ""


def test_a_bag_is_continued_in_its_next_file(tmp_path, samples):
    for options in ({}, {"earlier": True}):
        if options:
            options["earlier"] = open_bag(tmp_path / "run")
        writer = BagProcess(tmp_path / "run", **options)
        writer.write(writer.add_topic("/a", STRING, QoS()), samples.cdr(STRING), 1, 1)
        writer.close()
    bag = open_bag(tmp_path / "run")
    assert len(bag.files) == 2 and bag.message_count == 2


def test_a_writer_that_is_killed_leaves_a_bag_to_read(tmp_path, samples, started):
    writer = BagProcess(tmp_path / "run")
    channel = writer.add_topic("/a", STRING, QoS())
    writer.write(channel, samples.cdr(STRING), 1, 1)
    writer.flush()
    writer.add_topic("/b", STRING, QoS())  # answered: all earlier messages are written
    started.process.kill()
    with pytest.raises(
        BagError, match="has ended; .* unfinished: it is read up to there"
    ):
        writer.add_topic("/c", STRING, QoS())
    with pytest.raises(BagError, match="has ended"):
        writer.close()
    assert started.process.returncode is not None
    assert open_bag(tmp_path / "run").message_count == 1


def test_all_that_was_handed_over_is_written_when_the_parent_is_gone(
    tmp_path, samples, started
):
    """The messages in the socket survive, even if the writer was far behind."""
    writer = BagProcess(tmp_path / "run")
    channel = writer.add_topic("/a", STRING, QoS())
    os.kill(started.process.pid, signal.SIGSTOP)
    for i in range(30):
        writer.write(channel, samples.cdr(STRING), i, i)
        if i % 10 == 9:
            writer.flush()
    started.socket.close()
    del writer  # and its end of the socket
    os.kill(started.process.pid, signal.SIGCONT)
    assert started.process.wait(PATIENCE_SECONDS) == 0
    assert open_bag(tmp_path / "run").message_count == 30


def test_a_writer_that_hangs_is_given_up(tmp_path, monkeypatch, started):
    writer = BagProcess(tmp_path / "run")
    monkeypatch.setattr("sparse_coord_ros.log.bags.process.PATIENCE_SECONDS", 0.3)
    patience = struct.pack("ll", 0, 300_000)
    started.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, patience)
    os.kill(started.process.pid, signal.SIGSTOP)
    with pytest.raises(BagError, match="has not moved for 0.3 s; .*: check its disk"):
        writer.add_topic("/a", STRING, QoS())
    with pytest.raises(BagError, match="has not moved"):
        writer.close()
    assert started.process.returncode == -signal.SIGKILL


def test_a_signal_while_the_writer_starts_does_not_reach_it(
    tmp_path, samples, capfd, monkeypatch
):
    """As when a Ctrl-C goes to all processes of a run: the run decides when the writer ends."""
    start = subprocess.Popen

    def interrupted(*arguments, **options):
        process = start(*arguments, **options)
        for number in STOPPING:
            process.send_signal(number)
        return process

    monkeypatch.setattr(subprocess, "Popen", interrupted)
    writer = BagProcess(tmp_path / "run")
    writer.write(writer.add_topic("/a", STRING, QoS()), samples.cdr(STRING), 1, 1)
    writer.close()
    assert open_bag(tmp_path / "run").message_count == 1
    assert capfd.readouterr().err == ""
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, ()) & set(STOPPING)
