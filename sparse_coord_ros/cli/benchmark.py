# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord benchmark`: judge learners on buildings that no search has seen."""

import argparse
from pathlib import Path
from typing import Any

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli.computing import COMPUTING, Bar, computing_of
from sparse_coord_ros.cli.options import Option, note
from sparse_coord_ros.core.game.scenario import SETTINGS
from sparse_coord_ros.core.game.unseen import SPLITS, TEAMS
from sparse_coord_ros.core.learners.registry import LEARNERS
from sparse_coord_ros.studies.benchmark import (
    TEAM_RUNS,
    TEAM_TRIALS,
    Benchmark,
    benchmark,
)
from sparse_coord_ros.studies.standings import Standing

EXAMPLE = "sparse_coord benchmark coop factored --robots 2 --runs 2 --steps 2000"


OPTIONS = (
    Option(
        "learners LEARNER...",
        None,
        f"{', '.join(LEARNERS.registered)}; or one of your own as module:Class",
        {"names": lambda: LEARNERS.names},
    ),
    Option(
        "--split",
        SPLITS,
        "buildings to choose rules by, to check them by, or for closing figures alone",
    ),
    Option(
        "--robots N...", int, "sizes of teams", {"choices": TEAMS, "default": TEAMS}
    ),
    Option("--kinds", bool, "a row for each kind of building too"),
    Option("--steps", None, "step budget in transitions (default: 1e5)"),
    shared.changes("change a setting of learning, e.g. epsilon=linear:0.2:0.02:0.8"),
    TEAM_RUNS,
    TEAM_TRIALS,
    Option("--seed", shared.SEED, "seed of run 0; run i has seed + i"),
    Option(
        "--out", Path, "results directory; what it holds already is not computed again"
    ),
    *COMPUTING,
    shared.JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    by = computing_of(options)
    found = [_judge(options, learner, by) for learner in options.learners]
    rows = []
    for one in found:
        stood = one.standings() | (one.standings(by_kind=True) if options.kinds else {})
        rows += [
            [one.learner, *_row(where, standing)] for where, standing in stood.items()
        ]
    head = [
        "learner",
        "teams of",
        "buildings",
        "reward (s.e.)",
        "shortest paths",
        "best known",
    ]
    head += ["share of the gap", "worst", "below the paths", "failed teams"]
    head += ["asks", "miscoord."]
    shared.tell(
        options,
        {"benchmarks": [one.to_dict() for one in found]},
        shared.format_table(head, rows),
        "best known: two robots: the best asking team found; more: a planner that sees all robots",
        "for free. Neither is an upper bound, so a share may exceed 100 %",
        "share: of the pooled gap (a bootstrap over buildings and teams); worst: of one building",
        "0 of n (< p): the share of such teams is below p, as sure as 95 %",
    )


def _judge(options: argparse.Namespace, learner: str, by: dict[str, Any]) -> Benchmark:
    with Bar("agent-steps", quiet=options.json) as bar:
        return benchmark(
            learner,
            split=options.split,
            robots=options.robots,
            progress=lambda name, done, total: bar.show(done, total, name),
            say=note,
            **by,
            **SETTINGS.parse(shared.settings_of(options)),
        )


def _row(where: str, one: Standing) -> list[str]:
    share = one.share
    return [
        where,
        f"{one.buildings}",
        f"{one.reward.mean:.2f} ({one.reward.standard_error:.2f})",
        f"{one.paths:.2f}",
        f"{one.best_known:.2f}",
        f"{share.mean:.1%} ({share.standard_error:.1%})",
        f"{one.worst:.1%}",
        one.of_teams(one.below),
        one.of_teams(one.failed),
        f"{one.asks:.2f}",
        f"{one.miscoordinations:.3f}",
    ]
