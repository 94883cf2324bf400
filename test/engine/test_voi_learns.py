# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learner voi learns: in buildings and with seeds that nothing was chosen on."""

import numpy as np
import pytest

from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.measures import fails

SEEDS = range(971_000, 971_006)

BUILDINGS = {
    ("door", 970_001, "together"): (101.60, 135.55),
    ("corridor", 970_001, "together"): (102.27, 136.05),
    ("rooms", 970_005, "together"): (139.06, 156.83),
    ("crossing", 970_004, "together"): (100.17, 134.92),
    ("door", 970_001, "block:anywhere"): (7.67, 130.35),
    ("corridor", 970_001, "block:anywhere"): (38.32, 134.69),
    ("rooms", 970_002, "block:anywhere"): (0.02, 124.17),
    ("crossing", 970_001, "block:anywhere"): (118.63, 148.83),
    ("door", 970_001, "swap"): (113.64, 140.08),
    ("corridor", 970_001, "swap"): (118.28, 144.68),
    ("rooms", 970_002, "swap"): (99.90, 130.12),
    ("crossing", 970_002, "swap"): (117.19, 143.80),
}
"""What shortest paths earn, and the best asking team found (`find_asking_team`, 20 restarts)."""


def learned(scenario, seeds=SEEDS):
    """Return the measures of a team for each seed."""
    rule = learner_of("voi")
    problem = rule.with_defaults(scenario)
    runs = run_batch(problem, rule, seeds, trials=300, engine="auto", history=False)
    return [run.measures for run in runs]


@pytest.mark.parametrize(
    ("interactions", "peers_seen", "least"),
    [
        ("together", "when_asked", 0.97),
        ("together", "while_learning", 0.97),
        ("swap", "when_asked", 0.97),
        ("block:anywhere", "when_asked", 0.95),
        ("block:anywhere", "while_learning", 0.95),
    ],
)
def test_it_closes_most_of_the_gap_and_no_team_fails(interactions, peers_seen, least):
    gained = gap = failed = 0.0
    for (kind, number, game), (paths, best) in BUILDINGS.items():
        if game == interactions:
            scenario = load_scenario(f"unseen2-{kind}-2r-{number}").with_settings(
                interactions=game, peers_seen=peers_seen, steps=50_000
            )
            teams = learned(scenario)
            gained += np.mean([team.mean("returns") for team in teams]) - paths
            gap += best - paths
            failed += sum(fails(team.mean("arrived")) for team in teams)
            print(kind, game, peers_seen, (np.mean([team.mean("returns") for team in teams]) - paths)/(best-paths))
    print(interactions, peers_seen, gained/gap, failed)
    assert failed == 0
    assert gained / gap > least
