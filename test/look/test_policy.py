# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from teams import learn, tables_from_values, untrained

from sparse_coord_ros.base.palette import ROBOT_COLOURS, ink_on, rgb
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.evaluation import greedy_agents
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.core.solve.exact import evaluate_exact
from sparse_coord_ros.protocol.wire.messages import OCCUPIED, Messages
from sparse_coord_ros.show.policy import entered, policy_of, row_asking

ENV1 = load_scenario("env1")


def test_greedy_moves_and_asks():
    q_star = untrained(ENV1).q_star
    q_star[3] = [1, 5, 5, 2, 4]
    q_star[4] = [1, 2, 3, 4, 9]
    q_star[5] = [9, 9, 9, 9, 9]  # nothing was learned here
    q_star[6] = [1, 2, 3, 4, 4]  # as good to ask as to go west
    q_star[7] = [1, 2, 3, 4, 5]  # the goal
    policy = policy_of(tables_from_values(ENV1, 0, q_star), goal=7)
    assert policy.moves[3].tolist() == [False, True, True, False]
    assert policy.moves[4].tolist() == [False, False, False, True]
    assert not policy.moves[[5, 7]].any()
    assert np.flatnonzero(policy.asks).tolist() == [4]
    assert np.flatnonzero(policy.may_ask).tolist() == [4, 6]


def test_a_robot_that_knows_its_map_has_learned_where_it_was():
    """It has greedy moves everywhere, and a greedy robot can go on where it never was."""
    scenario = learner_of("voi").with_defaults(
        ENV1.with_settings(prior="map", steps=40)
    )
    begun = untrained(scenario, "voi")
    goal = scenario.robots[0].goal
    policy = policy_of(begun, goal)
    assert not policy.learned.any()
    assert policy.moves.any(axis=1).sum() == len(policy.moves) - 1
    assert goal in entered(policy, scenario.map, scenario.robots[0].start)
    after = learn(scenario, "voi", 1)[0]
    policy = policy_of(after, goal)
    assert 3 < policy.learned.sum() < 20
    assert policy.learned.tolist() == after.memory["updates"].any(axis=1).tolist()


def at_a_tie():
    """Return a scenario in which asking is free and brings nothing, and a team that knows it."""
    scenario = learner_of("voi").with_defaults(
        ENV1.with_settings(ask_cost=0, penalty=0, steps=600)
    )
    return scenario, learn(scenario, "voi", 1)


def test_pictures_and_the_map_topic_agree_on_who_asks_where():
    """At a tie a robot asks at times, and none of them says that it asks."""
    scenario, tables = at_a_tie()
    frame = Messages(make_run(scenario, {"learner": "voi"}))
    ties = 0
    for robot, table in zip(scenario.robots, tables, strict=True):
        policy = policy_of(table, robot.goal)
        published = (
            np.frombuffer(frame.asking_cells(table.q_star), np.int8)[frame.places]
            == OCCUPIED
        )
        here = np.arange(len(published)) != robot.goal
        np.testing.assert_array_equal(policy.asks[here], published[here])
        ties += (policy.may_ask & ~policy.asks).sum()
    assert ties > 5
    assert evaluate_exact(scenario, tables, learner="voi").mean("asks") > 0


def test_a_robot_may_enter_what_lies_behind_a_tie():
    q_star = untrained(ENV1).q_star
    for x in range(len(q_star)):  # everywhere to the north, but for a tie in cell 8
        q_star[x] = [5, 1, 1, 1, 0]
    q_star[8] = [5, 1, 1, 1, 5]
    policy = policy_of(tables_from_values(ENV1, 0, q_star), goal=0)
    south = int(ENV1.map.next_cell[8, 1])
    assert south in entered(policy, ENV1.map, 8)
    assert south not in entered(policy._replace(may_ask=policy.asks), ENV1.map, 8)


def test_a_baseline_never_asks_and_its_goal_has_no_move():
    tables = learn(ENV1.with_settings(steps=300), "noncoop", 1)
    for robot, table in zip(ENV1.robots, tables, strict=True):
        policy = policy_of(table, robot.goal)
        assert not policy.asks.any() and not policy.moves[robot.goal].any()
        assert policy.moves.any()


@pytest.mark.parametrize(
    ("name", "learner", "peers"),
    [("env1", "coop", "one"), ("env1", "voi", "one"), ("crowd-3r", "voi", "all"),
     ("crowd-3r", "coop", "all")],
)  # fmt: skip
def test_the_row_that_decides_after_a_question(name, learner, peers):
    """The one by which the robot's agent chooses, after a failed percept, too."""
    rule = learner_of(learner)
    asking = {
        "q_star_init": 100,
        "ask_cost": 0,
        "penalty": -100,
        "perception": "probability:0.5",
    }
    scenario = load_scenario(name).with_settings(
        {**asking, "steps": 600, "peers": peers}
    )
    scenario = rule.with_defaults(scenario)
    tables = learn(scenario, learner, 1)
    others = scenario.perceived - 1
    draws = np.random.default_rng(0)
    differ = set()
    for k, agent in enumerate(greedy_agents(scenario, tables, 0, learner)):
        for cell in range(len(scenario.map.cells)):
            for perceived in (
                None,
                tuple(draws.integers(0, cell + 1, others).tolist()),
            ):
                due = agent.values_asking(cell, perceived)[:4]
                row = row_asking(tables[k], cell, perceived)
                assert row.tolist() == pytest.approx(due, abs=1e-9)
                differ.add(bool((row != tables[k].q_star[cell, :4]).any()))
        assert row_asking(tables[k], 0, (0,) * (others + 1)) is None
    assert True in differ


def test_eight_colours_each_with_a_legible_number():
    assert len(set(ROBOT_COLOURS)) == 8

    def luminance(colour):
        return sum(
            w * c**2.2
            for w, c in zip((0.2126, 0.7152, 0.0722), rgb(colour), strict=True)
        )

    for colour in ROBOT_COLOURS:
        low, high = sorted([luminance(colour), luminance(ink_on(colour))])
        assert (high + 0.05) / (low + 0.05) >= 4.5  # WCAG 2, AA
