# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord report`: all that there is to tell of a run, as one page."""

import argparse
from pathlib import Path

from sparse_coord_ros.cli import pictures
from sparse_coord_ros.cli.options import JSON, Option, note

KINDS = (".html", ".htm")

EXAMPLE = "sparse_coord report runs/demo --out demo.html"


OPTIONS = (
    Option("source RUN|BAG", Path, "a run's directory; a bag's, or its file"),
    Option("--no-baselines", bool, "do not let Indiv. and Non-coop. learn the same, to compare"),
    pictures.out_option(KINDS),
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    pictures.check_out(options.out, KINDS)
    with pictures.drawing():
        from sparse_coord_ros.look.report import run_report
        from sparse_coord_ros.look.sources import open_shown

        shown = open_shown(options.source, note)
        page = run_report(shown, baselines=not options.no_baselines)
    pictures.write(options, page)
