# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The factored learner's rule, equation by equation, and the setting credit."""

import numpy as np
import pytest
from teams import memories_equal

from sparse_coord_ros.base.errors import SettingError, TablesError
from sparse_coord_ros.core.game.actions import COORDINATE, EAST, NORTH, SOUTH
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action, Reward, RewardWeights, World
from sparse_coord_ros.core.learners.agent import NOBODY, Agent, Choice, Decision
from sparse_coord_ros.core.learners.corrections import failed_key, rho_key
from sparse_coord_ros.core.learners.factored import Factored
from sparse_coord_ros.core.learners.looking_back import share_of
from sparse_coord_ros.core.learners.memory import taught
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.rules import NOT_PERCEIVED
from sparse_coord_ros.core.runs.evaluation import play
from sparse_coord_ros.core.runs.run import learn
from sparse_coord_ros.core.runs.run_config import make_run

ASK = Decision(COORDINATE, (1,))
ALPHA = 0.25
"""Every step size here, where the rule has not a greater one."""


class Thrice(Factored):
    """r^C counts three times."""

    def weights(self, scenario):
        return RewardWeights(1.0, 3.0, 1.0)


class Half(Factored):
    """r^C counts half."""

    def weights(self, scenario):
        return RewardWeights(1.0, 0.5, 1.0)


def scenario(name="env1", **settings):
    chosen = {
        "step_size": f"constant:{ALPHA}",
        "q_coord_init": 40,
        "credit": "own",
        **settings,
    }
    return learner_of("factored").with_defaults(
        load_scenario(name).with_settings(chosen)
    )


def agent(learner=Factored, number=0, *, replays=0, **settings):
    """Return an agent; without replays, of which it learns more than from a transition."""
    one = Agent(learner(), scenario(**settings), number, 3)
    one.task = one.task._replace(replays=replays)
    return one


def forget_question(one):
    """Let a robot forget its last question, so that it does not look back to it."""
    one.mind.last[one.number, 0] = 0


def rows(one):
    """Return the rows of rho that are not 0, by own cell, peer and its cell."""
    memory = one.memory()
    states = {
        key: state for state, key in keys_of(one.task.cells, one.task.robots).items()
    }
    pairs = zip(memory["rho_keys"].tolist(), memory["rho_values"].tolist(), strict=True)
    return {states[key]: row for key, row in pairs if any(row)}


def keys_of(cells, robots):
    """Return the key of every row of rho, by own cell, peer and its cell."""
    found = {
        (x, j, z): rho_key(x, j, z, cells, robots)
        for x in range(cells)
        for j in range(robots)
        for z in range(cells)
    }
    for x in range(cells):
        found[x, NOT_PERCEIVED, NOT_PERCEIVED] = failed_key(x, cells, robots)
    return found


def paid(common=0.0, individual=0.0, cost=0.0, **more):
    return Reward(individual, common, cost, individual + common + cost, **more)


def moved(one, step, cell, move, to, reward):
    action = Action(move, False, NOBODY, False)
    one.learn(step, Choice(cell, Decision(move), action, None), reward, to)


def asked(one, step, cell, move, to, reward, perceived):
    action = Action(move, True, 1, perceived is not None)
    one.learn(step, Choice(cell, ASK, action, perceived), reward, to)


def test_initial_tables():
    tables = agent(ask_cost=3).tables
    assert (tables.q_star[:, :4] == 40).all() and (tables.q_star[:, 4] == 37).all()
    assert (tables.q_coord == 40).all() and tables.q_coord.shape == (21, 21, 4)
    assert len(tables.memory["rho_keys"]) == 0


def test_u_learns_from_the_individual_part_alone_and_r_bar_from_the_common_one():
    one = agent()
    moved(one, 1, 2, EAST, 3, paid(common=-20.0, individual=7.0))
    memory = one.memory()
    assert memory["u"][2, EAST] == 40 + ALPHA * (7 + 0.95 * 40 - 40)
    assert memory["r_bar"][2, EAST] == -20 / 2  # a' is 1 / (n + 1) while that is more
    assert one.tables.q_star[2, EAST] == memory["u"][2, EAST] - 10
    assert not rows(one)  # no peer was perceived
    for step in range(2, 6):
        moved(one, step, 2, EAST, 3, paid())
    assert one.memory()["r_bar"][2, EAST] == pytest.approx(-10 * (2 / 3) * (3 / 4) ** 3)


def test_the_goal_bootstraps_on_its_value():
    one = agent(goal_value=100)
    moved(one, 1, 2, EAST, one.goal, paid(individual=10.0))
    assert one.memory()["u"][2, EAST] == 40 + ALPHA * (10 + 95 - 40)


def test_a_percept_teaches_rho_w_and_r_bar_but_not_by_the_move_itself():
    one = agent()
    asked(one, 1, 2, SOUTH, 3, paid(common=-20.0, cost=-1.0), (5,))
    memory = one.memory()
    u = memory["u"]
    r_bar = memory["r_bar"]
    w = memory["w"]
    rho = memory["rho_values"]
    assert rows(one) == {(2, 1, 5): [0, -20 * ALPHA, 0, 0]}
    # no cost of asking, no r^C in U
    assert u[2, SOUTH] == 40 + ALPHA * (0.95 * 40 - 40)
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
    memory = one.memory()
    u = memory["u"]
    w = memory["w"]
    rho = memory["rho_values"]
    # By the last percept every move was known to be bad.
    assert w[2] == ALPHA * ((u[2] + rho[0]).max() - u[2].max()) < 0


def test_by_count_the_first_steps_of_rho_are_smaller_than_those_of_u():
    one = agent(step_size="floored:0.5:0:0")
    asked(one, 1, 2, SOUTH, 3, paid(common=-20.0), (5,))
    memory = one.memory()
    assert memory["rho_values"][0, SOUTH] == -20 * 2.0**-0.5
    assert memory["u"][2, SOUTH] == 0.95 * 40


def test_a_failed_percept_has_a_row_of_its_own():
    one = agent()
    asked(one, 1, 2, SOUTH, 3, paid(common=-20.0), None)
    memory = one.memory()
    assert list(rows(one)) == [(2, NOT_PERCEIVED, NOT_PERCEIVED)]
    assert one.values_asking(2, None)[SOUTH] == memory["u"][2, SOUTH] - 20 * ALPHA
    assert one.values_asking(2, (5,))[SOUTH] == memory["u"][2, SOUTH]


def test_only_after_a_failed_percept_the_move_is_explored():
    one = agent(epsilon="constant:1")
    moves = {one.act(step, 2, ASK, None).move for step in range(60)}
    assert moves == {0, 1, 2, 3}
    asked(one, 1, 2, SOUTH, 3, paid(common=-20.0), (5,))
    for move in (NORTH, EAST):
        asked(one, 2, 2, move, 3, paid(common=-20.0), (5,))
    assert {one.act(step, 2, ASK, (5,)).move for step in range(60)} == {3}


def test_replays_make_u_what_the_own_model_says():
    one = agent(replays=1)
    moved(one, 1, 2, EAST, 3, paid())
    # it stayed where it was: half of the moves succeed
    moved(one, 2, 2, EAST, 2, paid())
    u = one.memory()["u"]
    # other moves in 2 are still at 40
    assert u[2, EAST] == 0.5 * (0.95 * 40) + 0.5 * (0.95 * 40)
    moved(one, 3, 3, EAST, one.goal, paid(individual=10.0))
    assert one.memory()["u"][3, EAST] == 10 + 0.95 * 200


def test_two_percepts_in_a_row_teach_what_other_moves_would_have_brought():
    one = agent()
    other = agent()
    for each in (one, other):
        # to 3: a doorway, as r^C is felt there
        moved(each, 1, 2, EAST, 3, paid(common=-20.0))
        moved(each, 3, 2, EAST, 2, paid())  # half of the moves east succeed
        moved(each, 5, 2, NORTH, 2, paid())
        asked(each, 7, 2, NORTH, 2, paid(), (5,))
        if each is other:
            forget_question(each)
        asked(each, 8, 2, NORTH, 2, paid(), (3,))  # the peer went to 3
    # W is 0, a wait is worth U
    assert rows(one)[2, 1, 5] == [
        0,
        0,
        ALPHA * 0.5 * -20,
        0,
    ]
    assert not any(row[EAST] for row in rows(other).values())
    before = rows(one)
    asked(one, 10, 2, NORTH, 2, paid(), (5,))  # not in a row
    assert rows(one) == before


def test_a_wait_is_worth_what_the_next_percept_shows():
    one = agent()
    for step in range(4):
        asked(one, 1 + 2 * step, 2, step, 2, paid(common=-20.0), (5,))
    asked(one, 20, 2, NORTH, 2, paid(), (5,))
    before = one.memory()["rho_values"][0]
    worth = one.memory()["w"][2]
    assert worth < 0
    asked(one, 21, 2, NORTH, 2, paid(), (6,))  # the way is free, waiting is over
    # All moves were tried and led nowhere: each is worth -W more than U says, and no r^C was felt
    # in 6. Of the one that was made r^C is known already.
    owed = -0.95 * worth
    row = [old + ALPHA * (owed - old) for old in before]
    row[NORTH] = before[NORTH] + ALPHA * owed
    assert one.memory()["rho_values"][0].tolist() == pytest.approx(row)
    assert not one.memory()["rho_values"][1].any()
    asked(one, 22, 2, NORTH, 2, paid(), (5,))  # a peer in 6 was in nobody's way
    assert not one.memory()["rho_values"][1].any()


def test_where_a_move_leads_is_worth_what_the_second_percept_would_be_there():
    one = agent()
    other = agent()
    for each in (one, other):
        for step in range(4):  # whoever meets a peer in 7 while in 3 pays for any move
            asked(each, 1 + 2 * step, 3, step, 3, paid(common=-20.0), (7,))
        worth = each.memory()["w"][3]
        asked(each, 20, 2, EAST, 3, paid(), (5,))
        if each is other:
            forget_question(each)
        asked(each, 21, 3, NORTH, 3, paid(), (7,))
    gain = max(other.values_asking(3, (7,))) - max(other.tables.memory["u"][3])
    assert gain < worth < 0
    before, after = (each.values_asking(2, (5,))[EAST] for each in (other, one))
    assert after - before == pytest.approx(ALPHA * 0.95 * (gain - worth))


def test_peers_share_what_is_in_the_way_as_they_are_to_blame():
    one = agent(name="env2-4r")
    for obstruction, shares in (
        ([0.0, -3.0, -1.0, 0.0], [0.75, 0.25, 0.0]),
        ([0.0] * 4, [1 / 3] * 3),
    ):
        one.mind.obstruction[0, EAST] = obstruction
        one.mind.obstructed[0, EAST] = sum(obstruction)
        found = [share_of(one.mind, one.task, 0, j, j + 1, EAST) for j in (1, 2, 3)]
        assert found == shares
        # a failed percept's row is of all peers
        assert share_of(one.mind, one.task, 0, 0, 4, EAST) == 1.0


def test_r_c_counts_for_the_team_but_once_where_the_percept_failed():
    factored = learner_of("factored")
    for name, weight in (("env1", 2), ("env2-4r", 4), ("building-3x2x4-16r-0", 8)):
        assert factored.with_defaults(load_scenario(name)).common_weight == weight
    assert scenario("building-3x2x4-16r-0", credit="team").common_weight == 16
    for perception, failed in (
        ("range:1", -20),
        ("probability:0.9", -60),
        ("always", -60),
    ):
        one = agent(Thrice, perception=perception)
        asked(one, 1, 2, SOUTH, 3, paid(common=-20.0), None)
        asked(one, 3, 2, SOUTH, 3, paid(common=-20.0), (5,))
        assert one.memory()["rho_values"][:, SOUTH].tolist() == [
            -60 * ALPHA,
            failed * ALPHA,
        ]


def blind_waits(**settings):
    """Return rho's row of a failed percept in 2, and what it was before a second question."""
    one = agent(**settings)
    # half of the moves east lead to 3, a doorway
    moved(one, 1, 2, EAST, 3, paid(common=-20.0))
    moved(one, 3, 2, EAST, 2, paid())
    moved(one, 5, 2, NORTH, 2, paid())
    asked(one, 7, 2, EAST, 2, paid(common=-20.0), None)
    before = one.memory()["rho_values"][0].copy()
    asked(one, 9, 2, NORTH, 2, paid(), None)
    asked(one, 10, 2, NORTH, 2, paid(), None)
    return one.memory()["rho_values"][0], before


def test_percepts_that_fail_teach_that_nobody_is_where_a_peer_would_be_seen():
    row, before = blind_waits(perception="range:2")
    # nobody was in 3, half of the moves would have led there
    assert before[EAST] < row[EAST] < 0
    row, before = blind_waits(perception="range:0")
    assert row[EAST] == before[EAST] < 0  # 3 is out of sight
    for settings in (
        {"perception": "probability:0.9"},
        {"perception": "always"},
    ):
        row, before = blind_waits(**settings)
        # it fails at random: a peer may be anywhere
        assert row[EAST] == before[EAST] < 0


def test_after_a_failed_percept_one_that_succeeds_teaches_where_a_peer_was_in_the_way():
    one = agent()
    moved(one, 1, 2, EAST, 3, paid(common=-20.0))
    moved(one, 3, 2, NORTH, 2, paid())
    asked(one, 7, 2, NORTH, 2, paid(), None)
    asked(one, 8, 2, NORTH, 2, paid(), (3,))
    assert rows(one)[2, NOT_PERCEIVED, NOT_PERCEIVED] == [0, 0, ALPHA * -20, 0]
    asked(one, 9, 2, NORTH, 2, paid(), (2,))
    # the percept before succeeded
    assert rows(one)[2, NOT_PERCEIVED, NOT_PERCEIVED] == [
        0,
        0,
        ALPHA * -20,
        0,
    ]


def test_credit_weighs_the_common_part():
    one = agent(Thrice)
    moved(one, 1, 2, EAST, 3, paid(common=-20.0))
    assert one.memory()["r_bar"][2, EAST] == -30
    for step in range(2, 20):  # a step of r_bar is as small as r^C weighs much
        moved(one, step, 2, EAST, 3, paid())
    last = one.memory()["r_bar"][2, EAST]
    moved(one, 20, 2, EAST, 3, paid())
    assert one.memory()["r_bar"][2, EAST] == pytest.approx(last * (1 - ALPHA / 3))


def test_where_it_weighs_less_than_once_steps_are_no_greater():
    one = agent(Half)
    for step in range(20):
        moved(one, step, 2, EAST, 3, paid(common=-20.0))
    last = one.memory()["r_bar"][2, EAST]
    moved(one, 20, 2, EAST, 3, paid())
    assert one.memory()["r_bar"][2, EAST] == pytest.approx(last * (1 - ALPHA))


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


# More than two robots.


def test_defaults_with_more_than_two_robots():
    run = make_run(load_scenario("env2-4r"), {"learner": "factored"})
    assert run.scenario.peers == "all"
    with pytest.raises(SettingError, match="setting peers"):
        learn(load_scenario("env2-4r"), "factored", 0)


def test_the_world_says_who_was_with_whom():
    problem = scenario("env2-4r")
    world = World(problem, 0)
    first, second = sorted(problem.map.doorways)[:2]
    world.cells = [first, second, first, second]
    world.led = lambda k, move: world.cells[k]
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
    u = one.memory()["u"]
    assert rows(one) == {(2, 2, 6): [0, 0, -20 * ALPHA, 0]}
    assert one.tables.q_coord[2, 5, 6, 7, EAST] == u[2, EAST] - 20 * ALPHA
    assert one.tables.q_coord[2, 5, 5, 7].tolist() == u[2].tolist()
    other = agent(name="env2-4r")
    moved(other, 1, 2, EAST, 3, paid(common=-20.0, partners=0))
    assert (other.memory()["r_bar"] == 0).all()


@pytest.mark.parametrize(
    ("name", "number", "counted"),
    [
        ("env2-4r", 0, []),
        ("env2-4r", 2, [0, 1]),
        ("env1", 0, [1]),
    ],
)
def test_of_several_robots_in_one_cell_the_higher_numbers_give_way(
    name, number, counted
):
    """They see the same: were it not so, each would wait for the others for ever."""
    one = agent(name=name, number=number)
    cells = one.task.cells
    robots = one.task.robots
    begun = one.memory()
    rho = {}
    for peer in one.peers:
        rho[rho_key(2, peer, 2, cells, robots)] = [0.0, -(10.0**peer), 0.0, 0.0]
        rho[rho_key(2, peer, 7, cells, robots)] = [0.0, -7.0, 0.0, 0.0]
    keys = sorted(rho)
    values = np.array([rho[key] for key in keys])
    one.go_on_from(
        begun
        | {"rho_keys": np.array(keys), "rho_values": values}
        | {"rho_updates": np.ones(values.shape, dtype=np.int64)}
    )
    expected = [40.0, 40.0 - sum(10.0**peer for peer in counted), 40.0, 40.0]
    assert one.values_asking(2, (2,) * len(one.peers)) == expected
    elsewhere = [40.0, 40.0 - 7.0 * len(one.peers), 40.0, 40.0]
    assert one.values_asking(2, (7,) * len(one.peers)) == elsewhere
    assert one.tables.q_coord[(2, *(2 for _ in one.peers))].tolist() == expected


def test_rows_are_numbered_in_the_order_of_their_states():
    keys = np.array(list(keys_of(7, 4).values()))
    assert (np.diff(keys) > 0).all()


# Files.

KINDS = ("coop", "noncoop", "factored")


def test_tables_of_another_kind_are_refused():
    problem = scenario()
    made = {
        name: [Agent(learner_of(name), problem, k, 0).tables for k in range(2)]
        for name in KINDS
    }
    for name in KINDS:
        for other in set(KINDS) - {name}:
            with pytest.raises(
                TablesError, match="tables do not match robot 1 of scenario env1"
            ):
                play(problem, made[name], trials=2, seed=0, learner=other)


def test_learning_begins_with_tables_but_counts_from_0():
    problem = scenario(steps=1500, penalty=-60, epsilon="constant:0.6", max_steps=20)
    learned = learn(problem, "factored", 0)[0].memory
    begun = taught(problem, Factored(), 0, learned)
    one = Agent(Factored(), problem, 0, 9, memory=begun)
    memory = one.memory()
    assert learned["rho_values"].any()
    for name in ("q_star", "u", "r_bar", "w", "rho_keys", "rho_values"):
        assert memory[name].tobytes() == learned[name].tobytes(), name
    for name in ("updates", "rho_updates", "moved", "commons", "used", "tried"):
        assert learned[name].any() and not memory[name].any(), name
    greedy = Agent(Factored(), problem, 0, 9, memory=learned, learning=False)
    moved(greedy, 1, 2, EAST, 3, paid(common=-20.0))
    assert memories_equal(greedy.memory(), learned)
