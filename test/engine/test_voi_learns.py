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


def judged(interactions, **settings):
    """Return the share of the pooled gap that is closed, and the least arrival of a team."""
    gained = gap = 0.0
    arrived = []
    for (kind, number, game), (paths, best) in BUILDINGS.items():
        if game == interactions:
            scenario = load_scenario(f"unseen2-{kind}-2r-{number}").with_settings(
                interactions=game, steps=50_000, **settings
            )
            teams = learned(scenario)
            gained += np.mean([team.mean("returns") for team in teams]) - paths
            gap += best - paths
            arrived += [team.mean("arrived") for team in teams]
    return gained / gap, min(arrived)


@pytest.mark.usefixtures("compiled_loops")
@pytest.mark.parametrize("interactions", ["together", "swap"])
def test_it_closes_most_of_the_gap_and_no_team_fails(interactions):
    share, arrived = judged(interactions)
    assert share > 0.97
    assert not fails(arrived)


@pytest.mark.usefixtures("compiled_loops")
def test_where_robots_stop_each_other_few_trials_end_in_a_stand_off():
    share, arrived = judged("block:anywhere")
    assert share > 0.96
    assert arrived > 0.97


@pytest.mark.usefixtures("compiled_loops")
@pytest.mark.parametrize("peers_seen", ["when_asked", "while_learning"])
def test_where_half_of_the_questions_fail_it_learns_more_than_algorithm_1(peers_seen):
    """coop earns 105.1 there, robots that ignore each other 92.6."""
    scenario = load_scenario("env1", steps=50_000, penalty=-100).with_settings(
        perception="probability:0.5", peers_seen=peers_seen
    )
    teams = learned(scenario)
    assert np.mean([team.mean("returns") for team in teams]) > 107
    assert not fails(min(team.mean("arrived") for team in teams))
