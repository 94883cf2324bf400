# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The soak's table, from made-up samples."""

from tools.soak import MEGABYTE, Sample, table


def test_the_table_has_each_process_while_all_are_there():
    """And the speed over time, without the beginning and the end."""
    both = {"run": 70 * MEGABYTE, "robot_1": 40 * MEGABYTE}
    samples = [Sample(0.5 * k, 0, {"run": 70 * MEGABYTE}) for k in range(2)]
    samples += [Sample(1.0 + k, 100 * k, dict(both)) for k in range(1, 12)]
    samples[-1].resident["robot_1"] += 3 * MEGABYTE
    samples.append(Sample(13, 1150, {"run": MEGABYTE}))
    lines = table(samples)
    assert lines[2:4] == [
        "| run | 70.0 | 70.0 | 70.0 | 0.0 |",
        "| robot_1 | 40.0 | 40.0 | 43.0 | 3.0 |",
    ]
    assert lines[-1].endswith(": " + ", ".join(["100"] * 10))
