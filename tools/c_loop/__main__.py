# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Part of `make bench`: measure the batch engine on env1, beside a plain C loop of the same work.

`python -m tools.c_loop --runs 100 --repeats 1`, in a checkout.
"""

import sys
from collections.abc import Sequence
from dataclasses import asdict

from sparse_coord_ros.bench import batch
from sparse_coord_ros.cli import bench
from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.errors import EXIT_BAD_INPUT, SparseCoordError
from tools.c_loop.loop import CLoop


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, measure, and return the exit code."""
    parser = shared.Parser(prog="python -m tools.c_loop", description=__doc__)
    bench.add_sizes(parser)
    try:
        steps, repeats, runs, as_json = bench.sizes_of(parser.parse_args(arguments))
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    rivals = [(CLoop.name, CLoop)]
    figures = batch.measure(bench.SCENARIO, steps=steps, runs=runs, repeats=repeats, rivals=rivals)
    if as_json:
        shared.print_json({**asdict(figures), "engine_to_c": figures.against(CLoop.name)})
    else:
        print(bench.batch_table(figures, CLoop.name))
    return 0


if __name__ == "__main__":
    sys.exit(main())
