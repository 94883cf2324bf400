# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options of whatever computes many runs: by what, and where."""

import argparse

from sparse_coord_ros.engine.batch import ENGINES
from sparse_coord_ros.engine.cluster import check_place
from sparse_coord_ros.experiments.store import JOBS


def add_computing(parser: argparse.ArgumentParser) -> None:
    """Add --engine, --jobs and --scheduler."""
    parser.add_argument(
        "--engine",
        choices=ENGINES,
        default="auto",
        help="numba, python, or auto: numba where it is installed; the results are the same",
    )
    parser.add_argument("--jobs", help=f"{JOBS.help} (default: all cores)")
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="compute on a Dask cluster, whose scheduler has this address, e.g. "
        "tcp://10.0.0.1:8786 (default: on this machine); the results are the same",
    )


def jobs_of(options: argparse.Namespace) -> int | None:
    """Return --jobs.

    Raises:
        SettingError: a bad one, or one beside --scheduler.
    """
    jobs = None if options.jobs is None else JOBS.parse(options.jobs)
    check_place(jobs, options.scheduler)
    return jobs
