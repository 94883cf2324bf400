# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The planner with routes: what it may be worth, and what it finds where that is plain."""

import numpy as np
import pytest
from teams import drawn

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.interactions import NOWHERE
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.solve import routes
from sparse_coord_ros.core.solve.optimum import independent_bound, joint_optimum
from sparse_coord_ros.core.solve.routes import TeamPlan, meeting, route_plan

needs_numba = pytest.mark.skipif(not has_numba(), reason="minutes in plain Python")


def small(**settings):
    return drawn("1.D.2\n..#..", penalty=-100, horizon=60, **settings)


@needs_numba
def test_two_robots_come_near_the_optimum_and_not_above():
    for scenario in (load_scenario("env1", penalty=-100), small()):
        plan = route_plan(scenario, restarts=2)
        optimum = joint_optimum(scenario).value
        assert optimum - 1.5 < plan.value < optimum + 3 * plan.standard_error
        assert sorted(plan.order) == [0, 1]
        assert plan == route_plan(scenario, restarts=2)


def test_compiled_and_plain_are_one(monkeypatch):
    scenario = drawn(
        "1.DD.2\n3.#..4", {"a": (1, 2), "b": (2, 1), "c": (3, 4)}, penalty=-20
    )
    draws = np.random.default_rng(1).random((5, 40, 3))
    ways = TeamPlan((2, 0, 1), (frozenset(),) * 3, one_at_a_time=True)
    found = routes.returns_of(scenario, ways, draws)
    monkeypatch.setattr(routes, "compiled", lambda: routes.play)
    assert routes.returns_of(scenario, ways, draws).tobytes() == found.tobytes()


def test_a_robot_alone_is_worth_its_shortest_path():
    scenario = drawn("1.D.2", {"a": (1, 2)}, penalty=-100)
    draws = np.random.default_rng(2).random((4000, 100, 1))
    means = routes.returns_of(scenario, TeamPlan((0,), (frozenset(),)), draws)
    error = means.std() / len(means) ** 0.5
    assert abs(means.mean() - independent_bound(scenario)) < 4 * error


def test_a_miscoordination_is_paid_when_it_happens():
    scenario = drawn("1.D.2", penalty=-1)  # waiting would cost more
    always = np.zeros((1, 20, 2))
    [returns] = routes.returns_of(
        scenario, TeamPlan((0, 1), (frozenset(),) * 2), always
    )
    assert returns == pytest.approx(200 * 0.95**3 - 0.95)


def test_a_route_keeps_out_of_its_doorways():
    scenario = drawn("1.D.2\n..#..\n..D..", penalty=-100)
    near, far = sorted(scenario.map.doorways)
    goal = scenario.robots[0].goal
    lead = scenario.map.next_cell
    start = scenario.robots[0].start
    assert routes.moves_to(lead, goal, frozenset())[start] == 4
    assert routes.moves_to(lead, goal, frozenset({near}))[start] == 8
    assert routes.moves_to(lead, goal, frozenset({near, far}))[start] == -1
    changes = list(
        TeamPlan((0, 1), (frozenset(), frozenset({far}))).changes([near, far])
    )
    assert len(changes) == len(set(changes)) == 1 + 1 + 4
    assert TeamPlan((1, 0), (frozenset(), frozenset({far}))) in changes
    assert TeamPlan((0, 1), (frozenset(), frozenset())) in changes


def test_doorways_side_by_side_are_one_passage():
    scenario = drawn("1.DDD.2\n..#####\n..D....", penalty=-100)
    cells = scenario.map.number
    found = routes.passages(scenario)
    assert {int(found[cells[0, j]]) for j in (2, 3, 4)} == {cells[0, 2]}
    assert found[cells[2, 2]] == cells[2, 2]
    assert found[cells[0, 0]] == NOWHERE


def test_how_likely_two_robots_meet():
    # One goes from nowhere into doorway 7, the other leaves it.
    assert meeting(NOWHERE, 7, 0.8, 7, NOWHERE, 0.8) == pytest.approx(0.8 * 0.2)
    assert meeting(7, NOWHERE, 0.8, NOWHERE, 7, 0.8) == pytest.approx(0.2 * 0.8)
    assert meeting(7, 7, 1.0, 3, 7, 0.8) == pytest.approx(0.8)  # it stays
    assert meeting(NOWHERE, NOWHERE, 0.8, NOWHERE, NOWHERE, 0.8) == 0.0


@pytest.mark.parametrize("interactions", ["swap", "together+block"])
def test_other_interactions_than_together_are_refused(interactions):
    scenario = load_scenario("env1", interactions=interactions)
    with pytest.raises(SettingError, match="interactions"):
        route_plan(scenario)
