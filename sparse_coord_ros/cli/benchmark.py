# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord benchmark`: judge learners on fixed lists of scenarios."""

import argparse
from pathlib import Path

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli import pictures
from sparse_coord_ros.cli.computing import COMPUTING, Bar, computing_of, first_wait
from sparse_coord_ros.cli.options import Option, note
from sparse_coord_ros.core.game.scenario import SETTINGS
from sparse_coord_ros.core.learners.registry import LEARNERS
from sparse_coord_ros.studies.benchmark import (
    TEAM_RUNS,
    TEAM_TRIALS,
    Entry,
    benchmark,
    read_entries,
)
from sparse_coord_ros.studies.lists import LISTS, TUNING

EXAMPLE = (
    "sparse_coord benchmark coop factored --lists tuning-pairs --runs 2 --steps 2000"
)


OPTIONS = (
    Option(
        "learners LEARNER...",
        None,
        f"{', '.join(LEARNERS.registered)}; your own learner as module:Class; a .yaml file of "
        "entries, with titles and settings; or a folder of run directories",
        {"names": lambda: LEARNERS.names},
    ),
    Option(
        "--lists LIST...",
        None,
        "lists of scenarios",
        {"choices": tuple(LISTS), "default": TUNING},
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
    Option("--save FILE", Path, "write the results to one JSON file"),
    *COMPUTING,
    shared.ALLOW,
    shared.JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    if options.save is not None:
        pictures.check_out(options.save, option="--save")
    entries = [entry for name in options.learners for entry in _entries(name)]
    settings = SETTINGS.parse(shared.settings_of(options))
    learners = [entry.learner for entry in entries if entry.learner]
    waits_for = first_wait(learners, options)
    with Bar("agent-steps", waits_for, quiet=options.json) as bar:
        found = benchmark(
            entries,
            lists=options.lists,
            progress=lambda name, done, total: bar.show(done, total, name),
            say=note,
            **computing_of(options),
            **settings,
        )
    if options.save is not None:
        found.save(options.save)
    rows = found.rows()
    shared.tell(
        options,
        found.to_dict(),
        shared.format_table(list(rows[0]), [list(row.values()) for row in rows]),
        "share of the gap: from fixed shortest paths to the best asking team found (two robots;",
        "no upper bound), or to an upper bound (more robots); in parentheses a standard error",
    )


def _entries(name: str) -> list[Entry]:
    """Return the entries of an argument: a file of entries, a folder of runs, or a learner."""
    if name.endswith((".yaml", ".yml")):
        return read_entries(Path(name))
    if Path(name).is_dir():
        return [Entry(Path(name).name, runs=name)]
    return [Entry(name, name)]
