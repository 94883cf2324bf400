# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`make bench`: live runs beside bare rclpy nodes, the batch engine beside plain C loops.

`python -m tools.bench batch --runs 100 --repeats 1`, in a checkout.
"""

import argparse
import sys
from collections.abc import Sequence

from sparse_coord_ros.cli.options import add_json, print_json
from tools.bench import batch


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, measure, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench", description=__doc__)
    parts = ("live", "batch", "all")
    parser.add_argument("part", nargs="?", choices=parts, default="all", help="what to measure")
    parser.add_argument("--steps", type=int, default=10_000, help="of a run (default: 10000)")
    parser.add_argument("--repeats", type=int, default=3, help="of each figure (default: 3)")
    parser.add_argument("--runs", type=int, default=1000, help="of a batch (default: 1000)")
    add_json(parser)
    options = parser.parse_args(arguments)
    steps, repeats = max(100, options.steps), max(1, options.repeats)
    found: dict[str, object] = {}

    def show(name: str, data: object, table: str) -> None:
        found[name] = data
        if not options.json:
            print(table, end="\n\n", flush=True)

    if options.part != "batch":
        from tools.bench import live

        rates = live.measure(steps, repeats)
        show("live", rates, live.table(rates))
        teams = live.measure_teams(steps, repeats)
        show("teams", teams, live.teams_table(teams))
    if options.part != "live":
        for scenario, learner, share in batch.MEASURED:
            runs = max(2, int(options.runs * share))
            one = batch.measure(scenario, learner, steps=steps, runs=runs, repeats=repeats)
            show(one["title"], one, batch.table(one))
    if options.json:
        print_json(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
