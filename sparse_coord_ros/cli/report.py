# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord report`: an HTML report of a run or of results."""

import argparse
from pathlib import Path

from sparse_coord_ros.cli import pictures
from sparse_coord_ros.cli.options import JSON, Option, note

KINDS = (".html", ".htm")

EXAMPLE = "sparse_coord report runs/demo --out demo.html"


OPTIONS = (
    Option(
        "source RUN|BAG|RESULTS",
        Path,
        "run, bag or results directory, or bag file",
    ),
    Option(
        "--no-baselines",
        bool,
        "do not train Indiv. and Non-coop. for comparison",
    ),
    pictures.out_option(KINDS),
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    pictures.check_out(options.out, KINDS)
    with pictures.drawing():
        from sparse_coord_ros.show.report import run_report
        from sparse_coord_ros.show.sources import open_run

        shown = open_run(options.source, note)
        page = run_report(shown, baselines=not options.no_baselines)
    pictures.write(options, page)
