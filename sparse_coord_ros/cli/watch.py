# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord watch`: a learning team on a page in the browser."""

import argparse
from contextlib import suppress
from pathlib import Path

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.cli.computing import Bar
from sparse_coord_ros.cli.options import ALLOW, PAGE, Option, allowed_with, ros_needed
from sparse_coord_ros.cli.page import served
from sparse_coord_ros.core.game.settings import Setting

RATE = Setting(
    "rate",
    float,
    10.0,
    "playback speed of a bag, in time steps a second",
    low=0.001,
    high=1e6,
)
STEP = Setting("step", int, 0, "start a bag at this step", low=0, high=2**53)

EXAMPLE = "sparse_coord watch runs/demo\n  sparse_coord watch runs/demo runs/demo_voi"


OPTIONS = (
    Option(
        "[bags BAG...]",
        Path,
        "run or bag directories, or bag files; several are compared on one page; a bag that is "
        "still being recorded is followed (default: the live team on the ROS topics)",
    ),
    RATE,
    Option(
        "--step N",
        STEP,
        "start a bag at this learning step (default: at the end, with what was learned)",
        {"default": None},
    ),
    ALLOW,
    *PAGE,
)


def execute(options: argparse.Namespace) -> int | None:
    """Run the verb."""
    if not options.bags:
        allowed_with(options, "BAG", ("rate", "step"))
        return _live(options)
    from sparse_coord_ros.show.page.bag_source import BagSource
    from sparse_coord_ros.show.page.message_board import MessageBoard
    from sparse_coord_ros.show.page.training_source import TrainedView
    from sparse_coord_ros.show.sources import open_run

    if len(options.bags) > 1:
        _compare(options)
        return None
    [path] = options.bags
    source: BagSource | TrainedView
    if open_run(path).bag:
        more = {"rate": options.rate, "step": options.step}
        with Bar("kB", "reading the bag") as bar:
            source = BagSource(path, MessageBoard(), **more, progress=bar.show)
    else:
        source = TrainedView(open_run(path), MessageBoard())
    with served(options, source.board), suppress(KeyboardInterrupt):
        source.play()
    return None


def _compare(options: argparse.Namespace) -> None:
    """Show several bags by one clock."""
    from sparse_coord_ros.show.page.bag_source import BagSource
    from sparse_coord_ros.show.page.comparison import Comparison
    from sparse_coord_ros.show.page.message_board import MessageBoard
    from sparse_coord_ros.show.sources import open_run

    for path in options.bags:
        if not open_run(path).bag:
            raise BagError(
                f"{path}: holds no bag; several runs are compared by their bags: record each with "
                "sparse_coord run, or watch it alone"
            )
    sources = []
    for path in options.bags:
        with Bar("kB", f"reading {path}") as bar:
            sources.append(BagSource(path, MessageBoard(), progress=bar.show))
    comparison = Comparison(sources, MessageBoard(), rate=options.rate)
    if options.step is not None:
        comparison.show_step(options.step)
    boards = [source.board for source in sources]
    with (
        served(options, *boards, comparison.board, index="compare.html"),
        suppress(KeyboardInterrupt),
    ):
        comparison.play()


def _live(options: argparse.Namespace) -> int:
    with ros_needed("sparse_coord watch BAG"):
        from sparse_coord_ros.ros.nodes.spin import run_node
        from sparse_coord_ros.ros.nodes.watch import WatchNode
    with served(options) as server:
        return run_node(
            lambda context: WatchNode(context=context, values={}, server=server), []
        )
