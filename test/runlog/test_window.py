# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A part of a log equals the whole log there; reading in parts needs no end."""

import shutil

import numpy as np
import pytest
import recordings
from teams import same_bits, tables_equal

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.history import concatenated
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.bags import contents, open_bag
from sparse_coord_ros.log.bags.reader import bag_files
from sparse_coord_ros.log.runlog import read_run, window
from sparse_coord_ros.log.runlog.window import LongLog
from sparse_coord_ros.protocol import wire


@pytest.fixture(scope="module")
def bag(record):
    settings = {"steps": 600, "perception": "probability:0.6"}
    return record(settings=settings, values={"checkpoint": 200}).bag


ARRAYS = ("step", "cells", "action", "move", "peer", "asked", "perceived", "percept")


def test_a_stretch_is_what_the_whole_log_has_there(bag):
    whole = read_run(bag)
    log = LongLog(bag)
    assert len(log.blocks) > 2
    for first, last in ((1, 30), (200, 290), (560, 10_000)):
        part = log.read(first, last)
        due = whole.between(first, last)
        for name in ARRAYS:
            assert np.array_equal(getattr(part, name), getattr(due, name)), name
        assert part.reward.tobytes() == due.reward.tobytes()
    around = log.around(300)
    assert around.step[0] < 300 < around.step[-1]
    log.bag.close()


def test_of_several_files_what_was_superseded_is_left_out(record, tmp_path):
    """A run that went back to a checkpoint is the log of an unbroken run."""
    run = record(
        settings={"steps": 400, "perception": "probability:0.6"},
        values={"checkpoint": 30},
    )
    step = min(n for k, n in read_run(run.bag).tables if n > 200)
    directory = recordings.rolled_back(run, tmp_path / "bag", step, after=60)
    due = read_run(run.bag)
    log = LongLog(directory)
    read = read_run(directory)
    assert read.messages.segments == [-1, step] and not read.problems
    assert read.messages.statuses == due.messages.statuses
    assert (
        log.last_step == due.step[-1]
        and log.table_steps() == LongLog(run.bag).table_steps()
    )
    for first, last in ((1, 30), (step - 30, step + 90), (560, 10_000)):
        part = log.read(first, last)
        same = due.between(first, last)
        assert all(
            np.array_equal(getattr(part, name), getattr(same, name)) for name in ARRAYS
        )
    parts = [part.history for part in log.episodes()]
    assert same_bits(concatenated(parts), due.history())
    log.bag.close()


@pytest.mark.parametrize("size", [1, 20_000, 10**9])
def test_the_history_stretch_by_stretch_is_that_of_the_log(bag, monkeypatch, size):
    monkeypatch.setattr(window, "BYTES_AT_ONCE", size)
    whole = read_run(bag)
    log = LongLog(bag)
    parts = list(log.episodes())
    assert len(parts) >= 3 or size > 1
    assert same_bits(concatenated([part.history for part in parts]), whole.history())
    rows, robots = np.nonzero(whole.asked)
    due = whole.step[rows], robots, whole.cells[rows, robots]
    found = [
        np.concatenate(column)
        for column in zip(*(p.questions for p in parts), strict=True)
    ]
    assert all(np.array_equal(*pair) for pair in zip(found, due, strict=True))
    assert [part.read_to for part in parts] == [part.last_step for part in parts]
    log.bag.close()


def test_what_was_said_at_time_0_is_found_at_once(tmp_path, monkeypatch):
    """A recorder flushes the run before the first time step: into a chunk of the time 0."""

    class Flushed(recordings.Recording):
        def say(self, state):
            super().say(state)
            if state == "waiting":
                self.bag.flush()

    run = make_run(load_scenario("env1").with_settings({"steps": 400}), {"seed": 7})
    Flushed(tmp_path / "bag", run, chunk=50_000)
    read = []
    content = contents.chunk_content

    def counted(*given, **options):
        read.append(given)
        return content(*given, **options)

    monkeypatch.setattr(contents, "chunk_content", counted)
    monkeypatch.setattr(contents, "TOGETHER", 1)
    log = LongLog(tmp_path / "bag")
    assert log.blocks[0].end_ns == 0 and len(log.blocks) > len(read) + 2
    assert next(log.bag.messages(["/run"])).data
    assert not log.empty and log.begin().step[0] == 1
    log.bag.close()


def test_the_whole_log_as_far_as_some_topics_tell(bag):
    """Read once, without a check of every byte; the rest of it is empty, not wrong."""
    due = read_run(bag)
    log = LongLog(bag)
    found = log.whole((*window.MOVES, wire.STATUS))
    for name in ("step", "cells", "action", "asked", "perceived", "reward", "numbers"):
        assert getattr(found, name).tobytes() == getattr(due, name).tobytes(), name
    assert same_bits(found.history(), due.history())
    assert found.messages.statuses == due.messages.statuses
    assert tables_equal(list(found.tables.values()), list(due.tables.values()))
    log.bag.close()


def test_tables_before_a_step(bag):
    log = LongLog(bag)
    steps = log.table_steps()[0]
    assert steps[0] == 0 and len(steps) >= 3
    found = log.tables_before(0, steps[1] - 1)
    assert found.step == 0 and log.tables_before(0, steps[1]).step == steps[1]
    assert log.tables_before(1, -1) is None
    log.bag.close()


def walk(path):
    return open_bag(path, checked=False)


def test_a_file_that_grows_is_walked_on(bag, tmp_path):
    data = bag_files(bag)[0].read_bytes()
    path = tmp_path / "grows.mcap.partial"
    path.write_bytes(data[: len(data) // 2])
    grows = walk(path)
    [before] = map(tuple, grows.blocks)
    assert before and not grows.finished and grows.damage is None and not grows.extend()
    with path.open("ab") as file:
        file.write(data[len(data) // 2 :])
    path.rename(tmp_path / "grows.mcap")  # as its recorder does
    assert grows.extend() and grows.finished and len(grows.blocks[0]) > len(before)
    assert grows.blocks == open_bag(bag).blocks
    assert list(grows.messages()) == list(open_bag(bag).messages())
    grows.close()


def test_a_walk_reads_a_removed_file_and_ends_at_damage(bag, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(bag, copy)
    log = LongLog(copy)
    shutil.rmtree(copy)
    assert len(log.read(1, 50).step) > 30
    log.bag.close()
    data = bytearray(bag_files(bag)[0].read_bytes())
    path = tmp_path / "damaged.mcap"
    [blocks] = open_bag(bag).blocks
    middle = blocks[2].offset + 200
    data[middle : middle + 64] = bytes(64)
    path.write_bytes(data)
    log = LongLog(path)
    assert log.damage is None, "it has not come there yet"
    assert list(log.episodes())
    assert log.blocks == blocks[:2], "what cannot be read is no block any more"
    assert log.damage.startswith(f"damaged at byte {blocks[2].offset}: ")
    assert read_run(path).damage == log.damage and len(log.around(10**6).step)
    log.bag.close()
    # within a chunk, and after one
    for cut in (middle, blocks[1].offset + blocks[1].length):
        path.write_bytes(data[:cut])
        found = walk(path)
        assert not found.finished and found.damage is None
        assert found.blocks == [blocks[:2]]
        found.close()
    path.write_bytes(b"no bag")
    with pytest.raises(BagError, match="is not an MCAP file"):
        walk(path)
