# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Progress: lines without a terminal, and a line that moves."""

import time

import pytest
from patience import PATIENCE_SECONDS

from sparse_coord_ros.base import progress
from sparse_coord_ros.base.progress import MovingLine, in_time
from sparse_coord_ros.cli import computing
from sparse_coord_ros.cli.computing import Bar


def test_without_a_terminal_lines_say_what_goes_on(capsys, monkeypatch):
    monkeypatch.setattr(computing, "FIRST_SECONDS", 0.01)
    monkeypatch.setattr(computing, "LINE_SECONDS", 0.01)
    said = ""

    def wait_for(text):
        nonlocal said
        deadline = time.monotonic() + PATIENCE_SECONDS
        while text not in said:
            assert time.monotonic() < deadline, said
            time.sleep(0.001)
            said += capsys.readouterr().err

    with Bar("steps", "compiling") as bar:
        wait_for("compiling: 0 s so far\n")
        bar.show(1000, 2_000_000, "best")
        wait_for("best 1,000 of 2,000,000 steps: 0 s so far\n")
        bar.show(1001, 2_000_000, "best")
        wait_for("best 1,001 of 2,000,000 steps: 0 s so far, about ")
        wait_for(" left\n")


def test_a_moving_line_fits_the_terminal(capsys, monkeypatch):
    """A longer one goes on in the next line, and each drawing would move all up."""
    monkeypatch.setenv("COLUMNS", "40")
    line = MovingLine("steps")
    line.watched = True
    line.show("env2-4r/coop/ask_cost=2 1,000 of 2,000,000 steps, about 3 min left")
    drawn = capsys.readouterr().err.removeprefix("\r")
    assert len(drawn) == 39 and drawn.endswith("of 2,000,000 steps, about 3 min left")


def test_the_time_left_is_that_of_the_work_under_way(monkeypatch):
    line = MovingLine("steps")
    left = []
    for now, done in ((0, 0), (50, 5), (100, 0), (101, 5)):
        monkeypatch.setattr(progress.time, "monotonic", lambda now=now: now)
        left.append(line.words(done, 10)[1])
    assert left == ["", ", about 50 s left", "", ", about 1 s left"]


@pytest.mark.parametrize(
    ("seconds", "words"), [(40, "40 s"), (700, "12 min"), (12_600, "3.5 h")]
)
def test_times_have_the_unit_that_fits(seconds, words):
    assert in_time(seconds) == words
