# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`make bench`: live runs, the batch engine and the environments, each beside its baseline.

`python -m tools.bench batch --runs 100 --repeats 1`, in a checkout.
"""

import argparse
import sys
from collections.abc import Sequence

from tools.bench import batch, environments


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, measure, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench", description=__doc__)
    parts = ("live", "batch", "environments", "all")
    parser.add_argument(
        "part", nargs="?", choices=parts, default="all", help="what to measure"
    )
    parser.add_argument(
        "--steps", type=int, default=10_000, help="of a run (default: 10000)"
    )
    parser.add_argument(
        "--repeats", type=int, default=3, help="of each figure (default: 3)"
    )
    parser.add_argument(
        "--runs", type=int, default=1000, help="of a batch (default: 1000)"
    )
    parser.add_argument(
        "--games", type=int, default=1024, help="of an environment (default: 1024)"
    )
    options = parser.parse_args(arguments)
    steps = options.steps
    repeats = options.repeats
    if options.part in ("live", "all"):
        from tools.bench import live

        print(live.ways(steps, repeats), end="\n\n", flush=True)
        print(live.teams(steps, repeats), end="\n\n", flush=True)
    if options.part in ("environments", "all"):
        for scenario in environments.MEASURED:
            found = environments.measured(scenario, options.games, steps, repeats)
            print(found, end="\n\n", flush=True)
    if options.part in ("batch", "all"):
        for scenario, learner, share in batch.MEASURED:
            found = batch.measured(
                scenario, learner, steps, int(options.runs * share), repeats
            )
            print(found, end="\n\n", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
