# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The factored learner's rule, equation by equation, and the settings credit and referee."""

import numpy as np
import pytest

from sparse_coord_ros.errors import SettingError, TablesError
from sparse_coord_ros.game.actions import COORDINATE, EAST, NORTH, SOUTH
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.game.world import Action, Reward, RewardWeights, World
from sparse_coord_ros.learners.agent import NOBODY, Choice, Decision
from sparse_coord_ros.engine.evaluation import play
from sparse_coord_ros.learn.factored import FactoredAgent, initial_factored
from sparse_coord_ros.learn.factors import UNSEEN, FactorRule, key_of, keys_of, rows_at_most, share_of, states_of
from sparse_coord_ros.learners.registry import Factored, learner_of
from sparse_coord_ros.learn.run_config import make_run
from sparse_coord_ros.engine.run import learn

ASK = Decision(COORDINATE, (1,))
ALPHA = 0.25
"""Every step size here, where the rule has not a greater one."""


def scenario(name="env1", **settings):
    chosen = {"step_size": f"constant:{ALPHA}", "q_coord_init": 40, **settings}
    return learner_of("factored").with_defaults(load_scenario(name).with_settings(chosen))


def agent(rule=None, weights=None, number=0, **settings):
    rule = rule or FactorRule(replays=0)
    weights = weights or RewardWeights(1.0, 1.0, 1.0)
    problem = scenario(**settings)
    tables = initial_factored(problem, weights)
    return FactoredAgent(problem, number, 3, rule=rule, weights=weights, tables=tables)


def paid(common=0.0, individual=0.0, cost=0.0, **more):
    return Reward(individual, common, cost, individual + common + cost, **more)


def moved(one, step, cell, move, to, reward):
    action = Action(move, False, NOBODY, False)
    one.learn(step, Choice(cell, Decision(move), action, None), reward, to)


def asked(one, step, cell, move, to, reward, perceived):
    action = Action(move, True, 1, perceived is not None)
    one.learn(step, Choice(cell, ASK, action, perceived), reward, to)


def test_initial_tables():
    tables = learner_of("factored").tables(scenario(ask_cost=3))
    assert (tables.q_star[:, :4] == 40).all() and (tables.q_star[:, 4] == 37).all()
    assert (tables.q_coord == 40).all() and tables.q_coord.shape == (21, 21, 4)
    assert len(tables.factors.states) == 0


def test_u_learns_from_the_individual_part_alone_and_r_bar_from_the_common_one():
    one = agent()
    moved(one, 1, 2, EAST, 3, paid(common=-20.0, individual=7.0))
    factors = one.tables.factors
    assert factors.individual[2, EAST] == 40 + ALPHA * (7 + 0.95 * 40 - 40)
    assert factors.common[2, EAST] == -20 / 2  # a' is 1 / (n + 1) while that is more
    assert one.tables.q_star[2, EAST] == factors.individual[2, EAST] - 10
    assert len(factors.states) == 0  # nobody was perceived
    for step in range(2, 6):
        moved(one, step, 2, EAST, 3, paid())
    assert one.tables.factors.common[2, EAST] == pytest.approx(-10 * (2 / 3) * (3 / 4) ** 3)


def test_the_goal_bootstraps_on_its_value():
    one = agent(goal_value=100)
    moved(one, 1, 2, EAST, one.goal, paid(individual=10.0))
    assert one.tables.factors.individual[2, EAST] == 40 + ALPHA * (10 + 95 - 40)


def test_a_percept_teaches_rho_w_and_r_bar_but_not_by_the_move_itself():
    one = agent()
    asked(one, 1, 2, SOUTH, 3, paid(common=-20.0, cost=-1.0), (5,))
    u, r_bar, w, states, rho = one.tables.factors
    assert states.tolist() == [[2, 1, 5]]
    assert rho.tolist() == [[0, -20 * ALPHA, 0, 0]]
    assert u[2, SOUTH] == 40 + ALPHA * (0.95 * 40 - 40)  # no cost of asking, no r^C in U
    # The other moves are as good as before: the percept was worth nothing.
    assert w[2] == 0
    assert r_bar[2].tolist() == [0, ALPHA * rho[0, SOUTH], 0, 0]
    assert one.tables.q_star[2, COORDINATE] == u[2].max() - 1 + w[2]
    assert one.tables.q_coord[2, 5].tolist() == (u[2] + rho[0]).tolist()
    assert one.tables.q_coord[2, 6].tolist() == u[2].tolist()


def test_w_is_what_a_percept_changes_in_the_best_move():
    one = agent()
    for move in range(4):
        asked(one, 1 + move, 2, move, 3, paid(common=-20.0), (5,))
    u, _, w, _, rho = one.tables.factors
    # By the last percept every move was known to be bad.
    assert w[2] == ALPHA * ((u[2] + rho[0]).max() - u[2].max()) < 0


def test_by_count_the_first_steps_of_rho_are_smaller_than_those_of_u():
    one = agent(step_size="floored:0.5:0:0")
    asked(one, 1, 2, SOUTH, 3, paid(common=-20.0), (5,))
    factors = one.tables.factors
    assert factors.corrections[0, SOUTH] == -20 * 2.0**-0.5
    assert factors.individual[2, SOUTH] == 0.95 * 40


def test_a_failed_percept_has_a_row_of_its_own():
    one = agent()
    asked(one, 1, 2, SOUTH, 3, paid(common=-20.0), None)
    factors = one.tables.factors
    assert factors.states.tolist() == [[2, UNSEEN, UNSEEN]]
    assert one.values_asking(2, None)[SOUTH] == factors.individual[2, SOUTH] - 20 * ALPHA
    assert one.values_asking(2, (5,))[SOUTH] == factors.individual[2, SOUTH]


def test_only_after_a_failed_percept_the_move_is_explored():
    one = agent(epsilon="constant:1")
    moves = {one.act(step, 2, ASK, None).move for step in range(60)}
    assert moves == {0, 1, 2, 3}
    asked(one, 1, 2, SOUTH, 3, paid(common=-20.0), (5,))
    for move in (NORTH, EAST):
        asked(one, 2, 2, move, 3, paid(common=-20.0), (5,))
    assert {one.act(step, 2, ASK, (5,)).move for step in range(60)} == {3}


def test_replays_make_u_what_the_own_model_says():
    one = agent(FactorRule(replays=5))
    moved(one, 1, 2, EAST, 3, paid())
    moved(one, 2, 2, EAST, 2, paid())  # it stayed where it was: half of the moves succeed
    u = one.tables.factors.individual
    assert u[2, EAST] == 0.5 * (0.95 * 40) + 0.5 * (0.95 * 40)  # other moves in 2 are still at 40
    moved(one, 3, 3, EAST, one.goal, paid(individual=10.0))
    assert one.tables.factors.individual[3, EAST] == 10 + 0.95 * 200


def test_two_percepts_in_a_row_teach_what_other_moves_would_have_brought():
    one, other = agent(), agent(FactorRule(replays=0, look_back=False))
    for each in (one, other):
        moved(each, 1, 2, EAST, 3, paid(common=-20.0))  # to 3: a doorway, as r^C is felt there
        moved(each, 3, 2, EAST, 2, paid())  # half of the moves east succeed
        moved(each, 5, 2, NORTH, 2, paid())
        asked(each, 7, 2, NORTH, 2, paid(), (5,))
        asked(each, 8, 2, NORTH, 2, paid(), (3,))  # the peer went to 3
    rows = {tuple(x): row for x, row in zip(*one.tables.factors[3:], strict=True)}
    assert rows[2, 1, 5].tolist() == [0, 0, ALPHA * 0.5 * -20, 0]  # W is 0, a wait is worth U
    assert not other.tables.factors.corrections[:, EAST].any()
    before = one.memory().values
    asked(one, 10, 2, NORTH, 2, paid(), (5,))  # not in a row
    assert np.array_equal(one.memory().values, before)


def test_a_wait_is_worth_what_the_next_percept_shows():
    one = agent()
    for step in range(4):
        asked(one, 1 + 2 * step, 2, step, 2, paid(common=-20.0), (5,))
    asked(one, 20, 2, NORTH, 2, paid(), (5,))
    before, worth = one.memory().values[0], one.tables.factors.asking[2]
    assert worth < 0
    asked(one, 21, 2, NORTH, 2, paid(), (6,))  # the way is free, waiting is over
    # All moves were tried and led nowhere: each is worth -W more than U says, and no r^C was felt
    # in 6. Of the one that was made r^C is known already.
    owed = -0.95 * worth
    row = [old + ALPHA * (owed - old) for old in before]
    row[NORTH] = before[NORTH] + ALPHA * owed
    assert one.memory().values[0].tolist() == pytest.approx(row)
    assert not one.memory().values[1].any()
    asked(one, 22, 2, NORTH, 2, paid(), (5,))  # a peer in 6 was in nobody's way
    assert not one.memory().values[1].any()


def test_where_a_move_leads_is_worth_what_the_second_percept_would_be_there():
    one, other = agent(FactorRule(replays=0)), agent(FactorRule(replays=0, look_back=False))
    for each in (one, other):
        for step in range(4):  # whoever meets a peer in 7 while in 3 pays for any move
            asked(each, 1 + 2 * step, 3, step, 3, paid(common=-20.0), (7,))
        worth = each.tables.factors.asking[3]
        asked(each, 20, 2, EAST, 3, paid(), (5,))
        asked(each, 21, 3, NORTH, 3, paid(), (7,))
    gain = max(other.values_asking(3, (7,))) - max(other.tables.factors.individual[3])
    assert gain < worth < 0
    before, after = (each.values_asking(2, (5,))[EAST] for each in (other, one))
    assert after - before == pytest.approx(ALPHA * 0.95 * (gain - worth))


def test_peers_share_what_is_in_the_way_as_they_are_to_blame():
    blame = [0.0, -3.0, -1.0, 0.0]
    assert [share_of(1 << j, blame) for j in (1, 2, 3)] == [0.75, 0.25, 0.0]
    assert share_of(~1, blame) == 1.0  # a failed percept's row is of all peers
    assert [share_of(peers, [0.0] * 4) for peers in (1 << 2, ~1)] == [1 / 3, 1.0]


def test_r_c_counts_for_the_team_but_once_where_the_percept_failed():
    assert scenario().common_weight == 2 and scenario("env2-4r").common_weight == 4
    assert scenario("building-3x2x4-16r-0").common_weight == 8
    assert scenario("building-3x2x4-16r-0", credit="team").common_weight == 16
    for perception, failed in (("range:1", -20), ("probability:0.9", -60), ("always", -60)):
        one = agent(weights=RewardWeights(1.0, 3.0, 1.0), perception=perception)
        asked(one, 1, 2, SOUTH, 3, paid(common=-20.0), None)
        asked(one, 3, 2, SOUTH, 3, paid(common=-20.0), (5,))
        assert one.memory().values[:, SOUTH].tolist() == [-60 * ALPHA, failed * ALPHA]


def blind_waits(**settings):
    """Return rho's row of a failed percept in 2, and what it was before a second question."""
    one = agent(**settings)
    moved(one, 1, 2, EAST, 3, paid(common=-20.0))  # half of the moves east lead to 3, a doorway
    moved(one, 3, 2, EAST, 2, paid())
    moved(one, 5, 2, NORTH, 2, paid())
    asked(one, 7, 2, EAST, 2, paid(common=-20.0), None)
    before = one.memory().values[0].copy()
    asked(one, 9, 2, NORTH, 2, paid(), None)
    asked(one, 10, 2, NORTH, 2, paid(), None)
    return one.memory().values[0], before


def test_percepts_that_fail_teach_that_nobody_is_where_a_peer_would_be_seen():
    row, before = blind_waits(perception="range:2")
    assert before[EAST] < row[EAST] < 0  # nobody was in 3, half of the moves would have led there
    row, before = blind_waits(perception="range:0")
    assert row[EAST] == before[EAST] < 0  # 3 is out of sight
    for settings in (
        {"perception": "probability:0.9"},
        {"perception": "always"},
        {"perception": "range:2", "link": "lost:0.1"},
    ):
        row, before = blind_waits(**settings)
        assert row[EAST] == before[EAST] < 0  # it fails at random: a peer may be anywhere


def test_after_a_failed_percept_one_that_succeeds_teaches_where_a_peer_was_in_the_way():
    one = agent()
    moved(one, 1, 2, EAST, 3, paid(common=-20.0))
    moved(one, 3, 2, NORTH, 2, paid())
    asked(one, 7, 2, NORTH, 2, paid(), None)
    asked(one, 8, 2, NORTH, 2, paid(), (3,))
    rows = {tuple(x): row.tolist() for x, row in zip(*one.tables.factors[3:], strict=True)}
    assert rows[2, UNSEEN, UNSEEN] == [0, 0, ALPHA * -20, 0]
    asked(one, 9, 2, NORTH, 2, paid(), (2,))
    rows = {tuple(x): row.tolist() for x, row in zip(*one.tables.factors[3:], strict=True)}
    assert rows[2, UNSEEN, UNSEEN] == [0, 0, ALPHA * -20, 0]  # the percept before succeeded


def test_credit_weighs_the_common_part():
    one = agent(weights=RewardWeights(1.0, 3.0, 1.0))
    moved(one, 1, 2, EAST, 3, paid(common=-20.0))
    assert one.tables.factors.common[2, EAST] == -30
    for step in range(2, 20):  # a step of r_bar is as small as r^C weighs much
        moved(one, step, 2, EAST, 3, paid())
    last = one.tables.factors.common[2, EAST]
    moved(one, 20, 2, EAST, 3, paid())
    assert one.tables.factors.common[2, EAST] == pytest.approx(last * (1 - ALPHA / 3))


@pytest.mark.parametrize(
    ("name", "settings", "weight"),
    [
        ("env1", {}, 1),
        ("env1", {"credit": "team"}, 2),
        ("env2-4r", {"credit": "team"}, 4),
        ("env2-4r", {"credit": "team", "common_reward": "each:1:0:2:1"}, 3),
        ("env2-4r", {"credit": "weight:2.5"}, 2.5),
        ("env2-4r", {"credit": "weight:0"}, 0),
    ],
)
@pytest.mark.parametrize("learner", ["coop", "noncoop", "factored"])
def test_credit_of_every_learner(name, settings, weight, learner):
    chosen = load_scenario(name).with_settings(settings)
    assert learner_of(learner).weights(chosen) == RewardWeights(1.0, weight, 1.0)


def test_a_bad_credit_is_named():
    plain = load_scenario("env1")
    with pytest.raises(SettingError, match="credit.*'ours'.*own, team, weight:W"):
        plain.with_settings({"credit": "ours"})
    with pytest.raises(SettingError, match="credit: w is '-1'.*from 0"):
        plain.with_settings({"credit": "weight:-1"})


# More than two robots.


def test_defaults_with_more_than_two_robots():
    run = make_run(load_scenario("env2-4r"), {"learner": "factored"})
    assert (run.scenario.peers, run.scenario.referee) == ("all", True)
    assert not make_run(load_scenario("env1"), {"learner": "factored"}).scenario.referee
    assert not make_run(load_scenario("env2-4r"), {}).scenario.referee
    with pytest.raises(SettingError, match="peers: value is 'one'.*peers=all"):
        learn(load_scenario("env2-4r"), "factored", 0)


def test_the_referee_says_who_was_with_whom():
    problem = scenario("env2-4r")
    world = World(problem, 0)
    first, second = sorted(problem.map.doorways)[:2]
    world.cells = [first, second, first, second]
    world._next_cell = [[x] * 4 for x in range(len(problem.map.cells))]
    stay = [Action(0, False, NOBODY, False)] * 4
    assert [r.partners for r in world.advance(stay).rewards] == [4, 8, 1, 2]
    world.cells = [first, second, first, 0]
    rewards = world.advance(stay).rewards
    assert [r.partners for r in rewards] == [4, 0, 1, 0]
    assert [r.common for r in rewards] == [-20.0] * 4


def test_a_robot_learns_only_from_its_own_miscoordination_by_the_peer_in_the_doorway():
    one = agent(name="env2-4r")
    ask = Decision(COORDINATE, (1, 2, 3))
    seen = (5, 6, 7)
    action = Action(EAST, True, NOBODY, True)
    one.learn(1, Choice(2, ask, action, seen), paid(common=-20.0, partners=0b0100), 3)
    factors = one.tables.factors
    assert factors.states.tolist() == [[2, 2, 6]]
    assert factors.corrections.tolist() == [[0, 0, -20 * ALPHA, 0]]
    assert one.tables.q_coord[2, 5, 6, 7, EAST] == factors.individual[2, EAST] - 20 * ALPHA
    assert one.tables.q_coord[2, 5, 5, 7].tolist() == factors.individual[2].tolist()
    other = agent(name="env2-4r")
    moved(other, 1, 2, EAST, 3, paid(common=-20.0, partners=0))
    assert (other.tables.factors.common == 0).all()


@pytest.mark.parametrize(
    ("name", "number", "right_of_way", "counted"),
    [
        ("env2-4r", 0, True, []),
        ("env2-4r", 2, True, [0, 1]),
        ("env2-4r", 2, False, [0, 1, 3]),
        ("env1", 0, True, [1]),
    ],
)
def test_of_several_robots_in_one_cell_the_higher_numbers_give_way(
    name, number, right_of_way, counted
):
    """They see the same: were it not so, each would wait for the others for ever."""
    rule = FactorRule(right_of_way=right_of_way)
    one = agent(rule, name=name, number=number)
    peers = [j for j in range(one._robots) if j != number]
    for j in peers:
        one._rho[key_of(2, j, 2, one._cells, one._robots)] = [0.0, -(10.0**j), 0.0, 0.0]
        one._rho[key_of(2, j, 7, one._cells, one._robots)] = [0.0, -7.0, 0.0, 0.0]
    expected = [0.0, -sum(10.0**j for j in counted), 0.0, 0.0]
    assert one.correction(2, (2,) * len(peers)) == expected
    assert one.correction(2, (7,) * len(peers)) == [0.0, -7.0 * len(peers), 0.0, 0.0]
    if right_of_way:
        row = one.tables.q_coord[(2, *(2 for _ in peers))]
        assert (row - one.tables.factors.individual[2]).tolist() == expected


def test_numbers_of_rows():
    cells, robots = 7, 4
    states = [[x, j, z] for x in range(cells) for j in range(robots) for z in range(cells)]
    states += [[x, UNSEEN, UNSEEN] for x in range(cells)]
    keys = keys_of(np.array(states, dtype=np.int32), cells, robots)
    assert len(set(keys.tolist())) == len(states)
    assert (np.diff(keys) > 0).all()
    assert states_of(keys, cells, robots).tolist() == states
    assert rows_at_most(cells, robots) == len(states) - cells * cells  # nobody is its own peer


# Files.


def test_tables_of_another_kind_are_refused():
    problem = scenario()
    coop = [learner_of("coop").tables(problem)] * 2
    own = [learner_of("factored").tables(problem)] * 2
    with pytest.raises(TablesError, match="form of learner coop.* factored needs"):
        play(problem, coop, trials=2, seed=0, learner="factored")
    with pytest.raises(TablesError, match="form of learner factored.* coop needs"):
        play(problem, own, trials=2, seed=0, learner="coop")
    with pytest.raises(TablesError, match="form of learner coop.* indiv needs that of noncoop"):
        play(problem, coop, trials=2, seed=0, learner="indiv")


def test_learning_goes_on_from_tables():
    problem = scenario(steps=1500, penalty=-60, epsilon="constant:0.6", max_steps=20)
    tables = learn(problem, "factored", 0)
    one = Factored().agent(problem, 0, 9, tables=tables[0])
    assert one.coord_visited == 0 < len(one.tables.factors.states)
    assert one.tables.factors.corrections.tobytes() == tables[0].factors.corrections.tobytes()
    greedy = Factored().agent(problem, 0, 9, tables=tables[0], learning=False)
    moved(greedy, 1, 2, EAST, 3, paid(common=-20.0))
    assert greedy.tables.factors.common.tobytes() == tables[0].factors.common.tobytes()


@pytest.mark.parametrize("cells", [(UNSEEN, 2), (2, UNSEEN - 1), (2, 10**6)])
def test_a_memory_of_impossible_cells_is_refused(cells):
    memory = agent().memory()
    last = np.array([8, EAST, *cells])
    with pytest.raises(ValueError, match="last has numbers out of range"):
        agent().go_on_from(memory._replace(more={**memory.more, "last": last}))
    agent().go_on_from(
        memory._replace(more={**memory.more, "last": np.array([8, EAST, 2, UNSEEN])})
    )
