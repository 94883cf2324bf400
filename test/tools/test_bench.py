# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`make bench`: its tables."""

import pytest

from tools.bench import batch
from tools.bench.__main__ import main


def test_batch_beside_plain_python():
    rates = {(batch.ENGINE, 2): [4.0, 6.0], (batch.PYTHON, 1): [0.1]}
    lines = batch.table("env1, Coop.", 0.25, rates).splitlines()
    assert lines[2].split()[3:] == ["threads", "5.00", "4.00", "to", "6.00", "25"]
    assert lines[-2].split()[-1] == "1"
    assert lines[-1].startswith("engine: ready in 0.2 s")


@pytest.mark.long
def test_all_of_it(capfd):
    pytest.importorskip("rclpy")
    assert main(["--steps", "100", "--runs", "20", "--repeats", "1"]) == 0
    assert capfd.readouterr().out.count("range") == 2 + len(batch.MEASURED)
