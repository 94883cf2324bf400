# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord replay`: a recorded run again over ROS 2."""

import argparse
import re

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.cli.options import BAG, Option, ros_needed

NAMES = {"bag": "BAG", "rate": "--rate", "position": "--start"}
"""Names of the player's parameters on the command line."""
PARAMETER = re.compile(r"^(?:node player: )?parameter (\w+)")
"""The name of one at the beginning of an error."""

EXAMPLE = "sparse_coord replay runs/demo/bag --rate 2 --start 12.5"


OPTIONS = (
    BAG,
    Option("--rate R", None, "playback speed as a factor", {"default": "1"}),
    Option(
        "--start T",
        None,
        "start this many seconds after the bag's first message",
        {"default": "0"},
    ),
    Option("--loop", bool, "restart at the end"),
    Option(
        "--wait",
        bool,
        "wait through gaps without messages (default: jump over those of more than 5 s)",
    ),
    Option(
        "--step",
        bool,
        "start paused; space resumes, the right arrow or /player/step plays the next time step",
    ),
)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    with ros_needed():
        from sparse_coord_ros.ros.nodes.player import Player
        from sparse_coord_ros.ros.nodes.spin import run_node
    values = {
        "bag": str(options.bag),
        "rate": options.rate,
        "position": options.start,
        "loop": options.loop,
        "start_paused": options.step,
        "wait": options.wait,
    }

    def make(context) -> Player:
        try:
            return Player(context=context, values=values, keyboard=True)
        except SettingError as error:
            text = PARAMETER.sub(
                lambda match: NAMES.get(match[1], match[1]), str(error)
            )
            raise SettingError(text) from None

    return run_node(make, [])
