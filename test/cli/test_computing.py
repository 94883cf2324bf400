# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Progress without a terminal."""

import time

import pytest
from patience import PATIENCE_SECONDS

from sparse_coord_ros.base.progress import in_time
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


@pytest.mark.parametrize(
    ("seconds", "words"), [(40, "40 s"), (700, "12 min"), (12_600, "3.5 h")]
)
def test_times_have_the_unit_that_fits(seconds, words):
    assert in_time(seconds) == words
