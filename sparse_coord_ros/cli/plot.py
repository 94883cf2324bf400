# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord plot`: pictures of runs, bags and results."""

import argparse
from functools import partial
from pathlib import Path

from sparse_coord_ros.cli import pictures
from sparse_coord_ros.cli.computing import read_bag
from sparse_coord_ros.cli.options import ALLOW, JSON, Option, note
from sparse_coord_ros.core.game.settings import Setting

DPI = Setting(
    "dpi", int, 110, "resolution of a PNG, in dots per inch", low=20, high=600
)

EXAMPLE = "sparse_coord plot runs/demo --what policy,curves --out demo.png"


OPTIONS = (
    Option(
        "sources RUN|BAG|RESULTS...",
        Path,
        "run directories or bags, drawn side by side; or one results directory",
    ),
    Option(
        "--what",
        None,
        "plots of a run: policy (moves, and where robots ask), curves (of learning); with a comma "
        "between: both (the default); a plot of results: conditions (the default), asks, or the "
        "name of an experiment",
    ),
    DPI,
    pictures.out_option(pictures.KINDS),
    ALLOW,
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    kind = pictures.check_out(options.out, pictures.KINDS)
    with pictures.drawing():
        from sparse_coord_ros.show import figures
        from sparse_coord_ros.show.charts import rendered
        from sparse_coord_ros.show.sources import is_results, open_run
        from sparse_coord_ros.studies.experiment_figures import results_figure

        if len(options.sources) == 1 and is_results(options.sources[0]):
            what, figure = results_figure(options.sources[0], options.what, note)
        else:
            read = partial(read_bag, quiet=options.json)
            runs = [open_run(path, note, read) for path in options.sources]
            for run in runs:
                _ = run.config  # refused before its parts are looked for
            whats = figures.parse_whats(options.what, runs)
            what = ",".join(whats)
            figure = figures.runs_figure(runs, whats)
        note(f"drawing {what}")
        data = rendered(figure, kind, options.dpi)
    pictures.write(options, data, what=what)
