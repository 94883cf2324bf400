# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's three measures: by hand, against exact values, for teams that never arrive."""

import math
import statistics

import numpy as np
import pytest
from teams import tables_from_values, untrained, walking

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.evaluation import (
    Evaluation,
    Measure,
    check_tables,
    fails,
    play,
    summary,
)
from sparse_coord_ros.core.runs.trials import Trials

GAMMA = 0.95


def test_sure_moves_by_hand(make):
    """Both enter the doorway of 1..D..2 at step 3 and arrive at step 6."""
    scenario = make(move_success=1)
    result = summary(play(scenario, walking(scenario), trials=3, seed=0))
    assert result.returns.mean == pytest.approx(
        200 * GAMMA**5 - 20 * GAMMA**2, rel=1e-12
    )
    assert result.miscoordinations.mean == 1
    assert result.time_to_goal.mean == 6
    assert result.returns.spread == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("trials", "missed", "failed"),
    [
        (1000, 0, False),
        (1000, 1, False),
        (1000, 2, True),
        (500, 1, True),
        (3000, 3, False),
        (7000, 7, False),
        (7000, 8, True),
    ],
)
def test_a_failed_team_misses_more_than_one_trial_of_a_thousand(trials, missed, failed):
    any_measure = Measure(0.0, 0.0, 0.0)
    found = Evaluation(trials, *[any_measure] * 4, not_arrived=missed)
    assert fails(found.all_arrived) == failed


@pytest.mark.parametrize("perception", ["always", "never", "probability:0.5"])
def test_asking_every_step_by_hand(make, perception):
    """Robot 1 acts once in each of the first five cells, robot 2 in each of the last five."""
    scenario = make("1....2", move_success=1, perception=perception, ask_cost=0.5)
    tables = walking(scenario, coordinate=1e9)
    result = summary(play(scenario, tables, trials=3, seed=0))
    costs = 0.5 * sum(GAMMA**t for t in range(5))
    assert result.returns.mean == pytest.approx(200 * GAMMA**4 - costs, rel=1e-12)
    assert result.asks.mean == 5
    assert result.time_to_goal.mean == 5
    trials = play(scenario, tables, trials=3, seed=0)
    assert trials.stays.tolist() == [[3] * 5 + [0], [0] + [3] * 5]
    assert (trials.asked == trials.stays).all()


def test_a_perceived_peer_means_acting_on_q_coord(make):
    scenario = make("1....2", move_success=1)
    north = np.tile([1.0, 0.0, 0.0, 0.0], (6, 6, 1))  # a wall
    tables = []
    for k, pair in enumerate(walking(scenario, coordinate=1e9)):
        tables.append(tables_from_values(scenario, k, pair.q_star, north))
    assert summary(play(scenario, tables, trials=1, seed=0)).not_arrived == 1
    blind = scenario.with_settings({"perception": "never"})
    assert summary(play(blind, tables, trials=1, seed=0)).not_arrived == 0


def test_tables_that_do_not_fit():
    scenario = load_scenario("env1")
    other = load_scenario("isr")
    good = untrained(scenario)
    with pytest.raises(TablesError, match="1 robots.*env1"):
        summary(play(scenario, [good], trials=1, seed=0))
    foreign = untrained(other)
    with pytest.raises(TablesError, match="robot 2 of scenario env1 .*q_star"):
        summary(play(scenario, [good, foreign], trials=1, seed=0))


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["q_star", "q_coord_values"])
def test_tables_of_no_numbers(name, value):
    scenario = load_scenario("crowd-3r")
    good = untrained(scenario)
    row = {
        "q_coord_keys": np.zeros(1, dtype=np.int64),
        "q_coord_values": np.ones((1, 4)),
        "q_coord_updates": np.ones((1, 4), dtype=np.int64),
    }
    memory = {n: array.copy() for n, array in (good.memory | row).items()}
    memory[name][0, 1] = value
    bad = Tables(scenario, good.rule, 1, memory)
    with pytest.raises(TablesError, match=f"robot 2 of .*{name} has values"):
        check_tables(scenario, [good, bad, good], "coop")


def test_the_standard_error_is_that_of_independent_trials():
    """Trials whose means are 1, 2 and 6: the sample's deviation over the root of their number."""
    means = [1.0, 2.0, 6.0]
    values = np.array([[mean - 1, mean + 1] for mean in means])
    nothing = np.zeros((2, 4), dtype=np.int64)
    trials = Trials(
        values, values, values, values > 0, np.array(means), nothing, nothing
    )
    result = summary(trials)
    expected = statistics.stdev(means) / math.sqrt(3)
    assert result.returns.standard_error == pytest.approx(expected, rel=1e-12)
    assert result.miscoordinations.standard_error == pytest.approx(expected, rel=1e-12)
    assert result.returns.spread == pytest.approx(
        statistics.pstdev(values.ravel()), rel=1e-12
    )
    assert result.miscoordinations.spread == pytest.approx(
        statistics.pstdev(means), rel=1e-12
    )
