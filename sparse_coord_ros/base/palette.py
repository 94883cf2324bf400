# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One colour for each robot, wherever robots are shown: pictures, films, pages, RViz.

The colour-blind can tell them apart too; in greyscale the robots' numbers help. The first five are
from Okabe & Ito (2008), whose vermilion is the doorways' colour.
"""

ROBOT_COLOURS = (
    "#0072B2",  # blue
    "#E69F00",  # orange
    "#009E73",  # green
    "#CC79A7",  # pink
    "#56B4E9",  # sky blue
    "#882255",  # wine
    "#444444",  # grey
    "#B5A800",  # dark yellow
)
LINE_COLOURS = (
    "#111111",  # black
    "#7A3DB8",  # purple
    "#8C5A2B",  # brown
    "#4A7C7E",  # grey green
)
"""Colours of lines that are no robot's: runs, learners."""

DOORWAY_COLOUR = "#D55E00"
WALL_COLOUR = "#404040"

ANSWERED = "answered"
REFUSED = "refused"
FAILED = "failed"
"""The shown end of a question: the peer answered; it refused; no answer came in time, or there was
no peer to ask."""

OUTCOME_COLOURS = {ANSWERED: "#2E7D32", REFUSED: "#D55E00", FAILED: "#888888"}
OUTCOME_SIGNS = {ANSWERED: "✓", REFUSED: "✗", FAILED: "?"}
"""Signs that distinguish the outcomes without colour."""

EXCHANGE_SIGN = "⇄"
"""Between two robots that exchange their cells."""


def robot_colour(number: int) -> str:
    """Return the colour of a robot (from 0) as #RRGGBB."""
    return ROBOT_COLOURS[number % len(ROBOT_COLOURS)]


def rgb(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue of #RRGGBB, each from 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue


def ink_on(colour: str) -> str:
    """Return black or white, whichever is more legible on #RRGGBB."""
    red, green, blue = (share**2.2 for share in rgb(colour))
    luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    return "#000000" if luminance > 0.2 else "#FFFFFF"
