# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord benchmark`: judge learners on fixed lists of scenarios."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli.computing import COMPUTING, Bar, computing_of, first_wait
from sparse_coord_ros.cli.options import Option
from sparse_coord_ros.core.game.scenario import SETTINGS
from sparse_coord_ros.core.learners.registry import LEARNERS
from sparse_coord_ros.studies.benchmark import TEAM_RUNS, TEAM_TRIALS, benchmark
from sparse_coord_ros.studies.lists import LISTS, TUNING

EXAMPLE = "sparse_coord benchmark coop voi --lists tuning-pairs --runs 2 --steps 2000"


OPTIONS = (
    Option(
        "learners LEARNER...",
        None,
        f"{', '.join(LEARNERS.registered)}; your own learner as module:Class",
        {"names": lambda: LEARNERS.names},
    ),
    Option(
        "--lists LIST...",
        None,
        f"lists of scenarios, or scenario files; lists: {', '.join(LISTS)}",
        {"default": TUNING},
    ),
    Option("--steps", None, "learning steps (default: 1e5)"),
    shared.changes(
        "change a learning setting, e.g. epsilon=linear:0.2:0.02:0.8; may be repeated"
    ),
    TEAM_RUNS,
    TEAM_TRIALS,
    Option("--seed", shared.SEED, "seed of run 0; run i has seed + i"),
    Option(
        "--out",
        Path,
        "results directory; existing results are kept and not computed again",
    ),
    *COMPUTING,
    shared.ALLOW,
    shared.JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    settings = SETTINGS.parse(shared.settings_of(options))
    waits_for = first_wait(options)
    with Bar("agent-steps", waits_for, quiet=options.json) as bar:
        standings = benchmark(
            options.learners,
            lists=options.lists,
            progress=lambda name, done, total: bar.show(done, total, name),
            **computing_of(options),
            **settings,
        )
    head = ["list", "learner", "peers seen", "share of the gap"]
    head += ["failed teams", "least arrival"]
    shared.tell(
        options,
        {"standings": standings},
        shared.format_table(head, [row_of(standing) for standing in standings]),
        "share of the gap: from fixed shortest paths to the best asking team found (two robots;",
        "no upper bound), or to an upper bound (more robots, files); ±: standard error",
    )


def row_of(standing: Mapping[str, Any]) -> list[str]:
    """Return the row of a standing in the table."""
    names = [standing["list"], standing["learner"]]
    if standing["share"] is None:
        return [*names, *["-"] * 4]
    share = f"{percent(standing['share'])} ± {100 * standing['error']:.1f}"
    failed = f"{standing['failed']} of {standing['teams']}"
    arrived = percent(standing["arrived"])
    return [*names, standing["peers_seen"], share, failed, arrived]
