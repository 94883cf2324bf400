# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Teams on several hosts: the same bits with any network; with network namespaces."""

import os
import re
import subprocess
import sys

import hosts
import pytest
from hosts import CONDITIONS, refusal


@pytest.mark.long
@pytest.mark.parametrize(
    "number", range(len(CONDITIONS)), ids=[c.name for c in CONDITIONS]
)
def test_a_team_on_three_hosts_learns_the_same_bits(number):
    why = refusal()
    if why:
        pytest.skip(f"this machine allows no network namespaces: {why}")
    others = {
        k: v
        for k, v in os.environ.items()
        if not k.startswith(("FASTRTPS_", "FASTDDS_"))
    }
    done = subprocess.run(
        [sys.executable, hosts.__file__, "--only", str(number)],
        env=others,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    row = done.stdout.splitlines()[-1]
    steps, timeouts = re.fullmatch(
        r"\| .* \| (\d+) \| (\d+) \| the same bits \|", row
    ).groups()
    assert int(steps) > 0
    assert int(timeouts) == 0
