# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The log of a bag that grows, and its learning history part by part."""

import numpy as np
from recordings import chunks_in

from sparse_coord_ros.core.runs.history import concatenated
from sparse_coord_ros.log.bags.reader import bag_files
from sparse_coord_ros.log.runlog import growing, read_run
from sparse_coord_ros.log.runlog.growing import GrowingLog

ARRAYS = ("step", "cells", "action", "move", "peer", "asked", "perceived", "percept")


def equal(one, other):
    return all(np.array_equal(getattr(one, n), getattr(other, n)) for n in ARRAYS)


def test_what_a_file_grows_by_is_read_and_its_end_under_another_name(record, tmp_path):
    [file] = bag_files(record(settings={"steps": 600}, chunk=5000).bag)
    data = file.read_bytes()
    path = tmp_path / "a_0.mcap.partial"
    offset, _ = chunks_in(file)[15]
    path.write_bytes(data[: offset + 100])
    log = GrowingLog(path)
    begun = log.last_step
    assert 0 < begun < 600 and not log.finished and "it has no end" in log.so_far.damage
    assert not log.extend()
    path.write_bytes(data[:-1000])
    assert log.extend() and log.last_step > begun
    path.write_bytes(data)
    path.rename(tmp_path / "a_0.mcap")
    log.extend()
    assert log.finished and log.so_far.damage is None
    assert equal(log.so_far, read_run(file))


def test_the_history_in_parts_is_that_of_the_whole_log(record, monkeypatch):
    bag = record(settings={"steps": 600}).bag
    monkeypatch.setattr(growing, "PART_STEPS", 50)
    parts = list(GrowingLog(bag).episodes())
    whole = read_run(bag)
    assert len(parts) > 3
    history = concatenated([part.history for part in parts])
    for one, due in zip(history, whole.history(), strict=True):
        assert np.array_equal(one, due)
    assert sum(len(part.questions.step) for part in parts) == whole.asked.sum()
