# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Part of `make bench`: measure the batch engine beside plain C loops of the same work.

`python -m tools.c_loop --runs 100 --repeats 1`, in a checkout.
"""

import sys
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial

from sparse_coord_ros.bench import batch
from sparse_coord_ros.cli import bench
from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli.verbs import Parser
from sparse_coord_ros.errors import EXIT_BAD_INPUT, SparseCoordError
from tools.c_loop.loop import CLoop, c_loop_of

MEASURED = (
    (bench.SCENARIO, "coop", 1.0),
    (bench.SCENARIO, "factored", 0.5),
    (bench.SCENARIO, "tools.coordination.rules:NoReplay", 0.5),
    ("crowd-8r", "factored", 0.1),
)
"""Scenario, learner, and how many of the runs that were asked for."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, measure, and return the exit code."""
    parser = Parser(prog="python -m tools.c_loop", description=__doc__)
    bench.add_sizes(parser)
    try:
        steps, repeats, runs, as_json = bench.sizes_of(parser.parse_args(arguments))
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    measured = []
    for scenario, learner, factor in MEASURED:
        figures = batch.measure(
            scenario,
            steps=steps,
            runs=max(2, int(runs * factor)),
            repeats=repeats,
            rivals=[(CLoop.name, partial(c_loop_of, learner))],
            learner=learner,
        )
        measured.append({**asdict(figures), "engine_to_c": figures.against(CLoop.name)})
        if not as_json:
            print(bench.batch_table(figures, CLoop.name), end="\n\n", flush=True)
    if as_json:
        shared.print_json(measured)
    return 0


if __name__ == "__main__":
    sys.exit(main())
