# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What was found, and what to do about it."""

from typing import NamedTuple

FINE, HINT, WRONG = "ok", "hint", "wrong"
"""It works; it works, and could be better or may surprise; it does not work."""


class Finding(NamedTuple):
    """One finding.

    Attributes:
        level: FINE, HINT or WRONG.
        part: what it is about, in a word or two.
        text: what was found, one line.
        remedy: what to do; empty: nothing.
    """

    level: str
    part: str
    text: str
    remedy: str = ""
