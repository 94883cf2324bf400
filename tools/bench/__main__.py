# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Measure an installation: the median of each figure, and its range.

`python -m tools.bench engine live --beside ../old/.venv/bin/python --repeats 5`, in a checkout.
Each figure is measured in a process of its own; figures and installations take turns.
"""

import argparse
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from sparse_coord_ros.base.compiling import FOLDER_VARIABLE
from sparse_coord_ros.cli.options import format_table
from tools.bench import plain_c

HERE = Path(__file__).parent


class Figure(NamedTuple):
    """A figure of the table.

    Attributes:
        title: what is measured, with its unit.
        call: the function of measure.py and its arguments.
        compiles: whether it begins with no compiled loops on disk.
    """

    title: str
    call: tuple[str, ...]
    compiles: bool = False


FURTHER = ("cq", "hysteretic", "voi", "joint", "indiv", "noncoop")
FIGURES = {
    "compiling": (
        Figure("compile coop first, s", ("compiling", "coop"), compiles=True),
        *(Figure(f"compile {name} then, s", ("compiling", name)) for name in FURTHER),
        Figure("20 runs of coop, s", ("many", "coop"), compiles=True),
    ),
    "start": (
        Figure("import sparse_coord_ros, ms", ("start", "import")),
        Figure("sparse_coord --help, ms", ("start", "help")),
    ),
    "engine": (
        Figure("coop, M agent-steps/s", ("engine", "coop")),
        Figure("voi, M agent-steps/s", ("engine", "voi")),
    ),
    "plain": (
        Figure("coop, plain Python, us a step", ("plain", "coop")),
        Figure("voi, plain Python, us a step", ("plain", "voi")),
    ),
    "live": (
        Figure("live, one process, steps/s", ("live", "--no-record")),
        Figure("live, one process, recorded, steps/s", ("live",)),
        Figure("live, processes, steps/s", ("live", "--processes", "--no-record")),
        Figure("live, processes, recorded, steps/s", ("live", "--processes")),
    ),
    "scaling": tuple(
        Figure(f"voi, {robots} robots on 257 cells, s", ("scaling", robots))
        for robots in ("4", "8", "16", "32")
    ),
    "environments": (
        Figure("VectorGame of env1, M agent-steps/s", ("vector", "env1")),
        Figure("VectorGame of crowd-8r, M agent-steps/s", ("vector", "crowd-8r")),
    ),
}
"""The figures of each part."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, measure, print a table, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench", description=__doc__)
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"{', '.join(FIGURES)}; default: all"
    )
    parser.add_argument(
        "--beside", metavar="PYTHON", help="the Python of an installation to compare"
    )
    parser.add_argument(
        "--repeats", type=int, default=3, help="of each figure (default: 3)"
    )
    options = parser.parse_args(arguments)
    unknown = set(options.parts) - set(FIGURES)
    if unknown:
        parser.error(f"no such part: {', '.join(unknown)}; parts: {', '.join(FIGURES)}")
    parts = options.parts or list(FIGURES)
    figures = [figure for part in parts for figure in FIGURES[part]]
    pythons = [sys.executable]
    if options.beside:
        pythons.append(options.beside)
    print(table(figures, pythons, options.repeats))
    if "engine" in parts:
        print(plain_c.line(options.repeats))
    return 0


def table(figures: Sequence[Figure], pythons: Sequence[str], repeats: int) -> str:
    """Measure the figures of some installations; return a table."""
    repeated = list(measured(figures, pythons, repeats))
    rows = []
    for number, figure in enumerate(figures):
        row = [figure.title]
        for installation in range(len(pythons)):
            row += spread([values[number][installation] for values in repeated])
        rows.append(row)
    head = ["medians", "here", "range", "beside it", "range"]
    return format_table(head[: len(rows[0])], rows)


def measured(
    figures: Sequence[Figure], pythons: Sequence[str], repeats: int
) -> Iterator[list[list[float]]]:
    """Yield for each repeat the numbers [figure][installation]."""
    with tempfile.TemporaryDirectory(prefix="sparse_coord_bench_") as folder:
        caches = [Path(folder) / str(number) for number in range(len(pythons))]
        for _ in range(repeats):
            yield [
                [
                    measure(figure, python, cache)
                    for python, cache in zip(pythons, caches, strict=True)
                ]
                for figure in figures
            ]


def measure(figure: Figure, python: str, cache: Path) -> float:
    """Return a figure of an installation; NaN: the one beside this one does not have it.

    Args:
        figure: the figure.
        python: the installation's Python.
        cache: the folder of its compiled loops.
    """
    if figure.compiles:
        shutil.rmtree(cache, ignore_errors=True)
    command = [python, str(HERE / "measure.py"), *figure.call]
    environment = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        **os.environ,
        FOLDER_VARIABLE: str(cache),
    }
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode and python != sys.executable:
        return math.nan
    done.check_returncode()
    return float(done.stdout)


def spread(numbers: Sequence[float]) -> tuple[str, str]:
    """Return the median of some numbers, and from where to where they go."""
    median = f"{statistics.median(numbers):.4g}"
    return median, f"{min(numbers):.4g} to {max(numbers):.4g}"


if __name__ == "__main__":
    sys.exit(main())
