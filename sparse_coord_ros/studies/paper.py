# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of the paper's tables (`paper.yaml`)."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import yaml

PAPER_MEASURES = ("returns", "time_to_goal", "miscoordinations")
"""What the paper's tables show."""


PENALTY = -20
"""r^C of the paper's Tables 1 to 3; ours is larger, so that asking pays."""


@cache
def paper_rows() -> Mapping[str, Mapping[str, Any]]:
    """Return the paper's numbers: scenario -> learner -> measure -> [mean, spread]."""
    text = Path(__file__).with_name("paper.yaml").read_text(encoding="utf-8")
    rows: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return rows
