# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord watch`: a team that learns, on a page in the browser."""

import argparse
import threading
from contextlib import suppress
from pathlib import Path

from sparse_coord_ros.cli.options import PAGE, Option, ros_needed
from sparse_coord_ros.cli.page import served
from sparse_coord_ros.core.game.settings import Setting

RATE = Setting(
    "rate", float, 10.0, "of a bag: time steps a second", low=0.001, high=1e6
)
STEP = Setting("step", int, 0, "of a bag: time step to begin at", low=0, high=2**53)

EXAMPLE = (
    "sparse_coord watch runs/demo\n  sparse_coord watch runs/demo runs/demo_factored"
)


OPTIONS = (
    Option(
        "[bags BAG...]",
        Path,
        "a bag's or a run's directory, or a file; one that is still being recorded is followed, "
        "several are shown side by side (default: the team that runs now, over its ROS topics)",
    ),
    RATE,
    Option(
        "--step N",
        STEP.parse,
        "of a bag: time step to begin at (default: what was learned)",
    ),
    *PAGE,
)


def execute(options: argparse.Namespace) -> int | None:
    """Run the verb."""
    if not options.bags:
        return _live(options)
    from sparse_coord_ros.show.page.bag_source import BagSource
    from sparse_coord_ros.show.page.message_board import MessageBoard
    from sparse_coord_ros.show.page.training_source import TrainedView
    from sparse_coord_ros.show.sources import open_run

    first, *others = (
        BagSource(path, MessageBoard(), rate=options.rate, step=options.step)
        if open_run(path).bag
        else TrainedView(open_run(path), MessageBoard())
        for path in options.bags
    )
    boards = [one.board for one in (first, *others)]
    with served(options, *boards), suppress(KeyboardInterrupt):
        for other in others:
            threading.Thread(target=other.play, daemon=True).start()
        first.play()
    return None


def _live(options: argparse.Namespace) -> int:
    with ros_needed("sparse_coord watch BAG"):
        from sparse_coord_ros.ros.nodes.spin import run_node
        from sparse_coord_ros.ros.nodes.watch import WatchNode
    with served(options) as server:
        return run_node(
            lambda context: WatchNode(context=context, values={}, server=server), []
        )
