# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What docs/guarantees.md proves, computed: games of one cell, random games, the paper's maps."""

import itertools

import numpy as np
import pytest
from asking_operator import (
    Game,
    acting,
    algorithm1,
    all_decisions,
    backup,
    chosen,
    distance,
    fixed_point,
    games_of,
    improved,
    informed,
    limit,
    means,
    meetings,
    occupancy,
    values,
)

from sparse_coord_ros.api import train
from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.solve.asking_search import LETTERS
from sparse_coord_ros.core.solve.shipped import shipped_asking_team

# --------------------------------------------------------------------------- games of one cell

GO, WAIT, ASK = range(3)
EITHER = np.array([[0.5, 0.5], [0.0, 0.0]])
"""The start: before the doorway, which is as likely free as taken."""


def doorway(free, taken):
    """Return the game of a robot before a doorway, in which its peer stands every other step.

    Own cell 0 is before the doorway, cell 1 behind it. To go earns `free` or `taken`.
    """
    turns = np.array([[0.0, 1.0], [1.0, 0.0]])
    reward = np.zeros((2, 2, 2))
    reward[0, :, GO] = free, taken
    return Game(
        moves=np.array([[[0.0, 1.0], [1.0, 0.0]], [[0.0, 1.0], [0.0, 1.0]]]),
        peer=np.stack([turns, turns]),
        reward=reward,
        weights=np.full((2, 2), 0.5),
        goals=np.array([False, True]),
        discount=0.5,
        cost=4.0,
    )


TWO = doorway(7.0, -9.0)
NONE = doorway(10.0, -4.0)


def own_weights(game, decisions, start):
    """Return M of a robot that decides so."""
    met = occupancy(game, acting(fixed_point(game, decisions), decisions), start)
    often = met.sum(axis=1, keepdims=True)
    return np.where(often > 0.0, met / np.where(often > 0.0, often, 1.0), game.weights)


@pytest.mark.parametrize(
    ("game", "decision", "q_star"),
    [
        (TWO, GO, (-1.0, -0.5, 1.25)),
        (TWO, WAIT, (-1.0, 0.0, -0.5)),
        (TWO, ASK, (-1.0, 0.125, 0.25)),
        (NONE, GO, (3.0, 1.5, 3.5)),
        (NONE, WAIT, (3.0, 0.0, 1.0)),
        (NONE, ASK, (3.0, 1.25, 2.5)),
    ],
)
def test_the_numbers_of_the_page(game, decision, q_star):
    table = fixed_point(game, np.array([decision, 0]))
    assert means(game, table)[0] == pytest.approx(q_star)


@pytest.mark.parametrize("weights", ["given", "its own"])
@pytest.mark.parametrize(("game", "stable"), [(TWO, [WAIT, ASK]), (NONE, [])])
def test_one_game_has_two_fixed_points_and_one_has_none(game, stable, weights):
    found = []
    for decisions in all_decisions(game):
        table = fixed_point(game, decisions)
        beside = game
        if weights == "its own":
            beside = game._replace(weights=own_weights(game, decisions, EITHER))
        if chosen(beside, table)[0] == decisions[0]:
            found.append(decisions[0])
    assert found == stable


def test_without_a_fixed_point_the_iteration_goes_round():
    for start in itertools.product((-10.0, 10.0), repeat=4):
        table = np.zeros_like(NONE.reward)
        table[0] = np.reshape(start, (2, 2))
        assert limit(improved, NONE, table, applications=200) is None


@pytest.mark.parametrize(("decision", "margin"), [(WAIT, 0.5), (ASK, 0.125)])
def test_near_a_fixed_point_the_iteration_converges_to_it(decision, margin):
    fixed = fixed_point(TWO, np.array([decision, 0]))
    rng = np.random.default_rng(1)
    for _ in range(20):
        near = fixed + rng.uniform(-margin / 2, margin / 2, fixed.shape)
        assert limit(improved, TWO, near) == pytest.approx(fixed, abs=1e-6)


def test_the_change_by_one_application_says_how_near_a_table_is():
    for game, rng in drawn_games():
        decisions = rng.integers(0, 3, len(game.goals))
        table = fixed_point(game, decisions)
        table += rng.normal(scale=0.1, size=table.shape)
        best = chosen(game, table)
        far = distance(improved(game, table), table) / (1.0 - game.discount)
        exact = fixed_point(game, best)
        assert distance(table, exact) <= far + 1e-6
        assert regret(game, exact, best) <= 2 * far + 1e-6


def test_small_steps_stay_where_both_are_as_good():
    table = np.zeros_like(NONE.reward)
    for _ in range(5000):
        table += 0.01 * (improved(NONE, table) - table)
    assert means(NONE, table)[0, [GO, ASK]] == pytest.approx([3.0, 3.0], abs=0.05)


@pytest.mark.parametrize(
    ("game", "earned"), [(TWO, (-1.0, 0.0, 0.25)), (NONE, (3.0, 0.0, 2.5))]
)
def test_a_fixed_point_need_not_be_best_nor_the_best_fixed(game, earned):
    found = [
        (EITHER * values(game, fixed_point(game, decisions), decisions)).sum()
        for decisions in all_decisions(game)
    ]
    assert found == pytest.approx(earned)


def test_algorithm1_never_asks_there():
    table = limit(algorithm1, TWO, np.zeros_like(TWO.reward))
    assert chosen(TWO, table)[0] == WAIT


def test_decisions_that_change_make_jumps():
    """A change of 1e-6 moves the result by 0.5: no factor bounds it."""
    table = np.array([[[1.0, 0.0], [0.0, 1.0]], [[0.0, 0.0], [0.0, 0.0]]])
    table[0] *= 3.0  # too little to ask
    more = table.copy()
    more[0, 0, WAIT] += 1e-6
    before, after = improved(TWO, table), improved(TWO, more)
    assert distance(before, after) > 0.5
    assert (after < before - 0.5).any()  # though no entry fell


# ------------------------------------------------------------------------------- random games


def drawn_games(number=30, cells=4, peers=3, moves=2):
    """Yield games drawn at random; the last cell ends them; and a generator for more."""
    rng = np.random.default_rng(7)
    for _ in range(number):
        goals = np.arange(cells) == cells - 1
        reward = rng.normal(size=(cells, peers, moves))
        reward[goals] = 0.0
        game = Game(
            moves=rng.dirichlet(np.full(cells, 0.5), (cells, moves)),
            peer=rng.dirichlet(np.full(peers, 0.5), (cells, peers)),
            reward=reward,
            weights=rng.dirichlet(np.ones(peers), cells),
            goals=goals,
            discount=0.8,
            cost=0.5,
        )
        yield game, rng


def two_tables(game, rng):
    """Return two tables, which may be near each other."""
    apart = rng.choice([1e-3, 1.0, 10.0])
    one = rng.normal(scale=3.0, size=game.reward.shape)
    return one, one + rng.normal(scale=apart, size=one.shape)


def kappa(game):
    """Return how much more likely than in the mean a peer may be in a cell."""
    leads = game.moves.any(axis=1) & ~game.goals & ~game.goals[:, None]
    x, y = np.nonzero(leads)
    likely = game.peer[x]
    mean = np.broadcast_to(game.weights[y][:, None, :], likely.shape)
    happens = likely > 0.0
    return (likely[happens] / mean[happens]).max()


def test_decisions_that_stay_make_a_contraction():
    for game, rng in drawn_games():
        one, other = two_tables(game, rng)
        for decisions in all_decisions(game):
            before, after = (backup(game, q, decisions) for q in (one, other))
            apart = game.discount * distance(one, other)
            assert distance(before, after) <= apart + 1e-12
            most = backup(game, np.maximum(one, other), decisions)
            assert (most >= before - 1e-12).all()


def test_algorithm1_is_a_contraction():
    for game, rng in drawn_games(300):
        one, other = two_tables(game, rng)
        found = distance(algorithm1(game, one), algorithm1(game, other))
        assert found <= game.discount * distance(one, other) + 1e-12


def test_with_a_peer_drawn_anew_in_each_step_both_are_the_same():
    for game, rng in drawn_games():
        law = game.weights[0]
        drawn = game._replace(
            peer=np.broadcast_to(law, game.peer.shape),
            weights=np.broadcast_to(law, game.weights.shape),
        )
        table, _ = two_tables(game, rng)
        assert improved(drawn, table) == pytest.approx(algorithm1(drawn, table))


def test_in_the_end_all_tables_lie_in_the_band():
    """At most those of an informed robot, less by at most gamma kappa c / (1 - gamma)."""
    games = [TWO, NONE, *(game for game, _ in drawn_games(20))]
    rng = np.random.default_rng(8)
    for game in games:
        band = game.discount * kappa(game) * game.cost / (1.0 - game.discount)
        best = informed(game)
        table = rng.normal(scale=20.0, size=game.reward.shape)
        for _ in range(200):
            table = improved(game, table)
        for _ in range(20):
            table = improved(game, table)
            assert (table <= best + 1e-6).all()
            assert (table >= best - band - 1e-6).all()


def test_questions_for_free_are_always_asked():
    for game, rng in drawn_games(10):
        table, _ = two_tables(game, rng)
        found = limit(improved, game._replace(cost=0.0), table)
        assert found == pytest.approx(informed(game))


def test_if_the_peer_does_not_matter_the_robot_never_asks():
    for game, rng in drawn_games(10):
        alone = game._replace(reward=np.repeat(game.reward[:, :1], 3, axis=1))
        table, _ = two_tables(game, rng)
        found = limit(improved, alone, table)
        assert found == pytest.approx(informed(alone))
        assert (chosen(alone, found) < 2).all()


def test_without_a_way_back_it_ends_after_as_many_applications_as_cells():
    for game, rng in drawn_games(10, cells=5):
        moves = game.moves * np.triu(np.ones((5, 5)), 1)[:, None, :]
        moves[-1, :, -1] = 1.0
        ahead = game._replace(moves=moves / moves.sum(axis=2, keepdims=True))
        ends = []
        for table in two_tables(game, rng):
            for _ in range(4):
                table = improved(ahead, table)
            ends.append(table)
        assert ends[0] == pytest.approx(ends[1], abs=1e-12)
        assert improved(ahead, ends[0]) == pytest.approx(ends[0], abs=1e-12)


def test_a_small_change_gains_what_its_own_means_say():
    """J' = sum over x of o(x) (Q*(x, d'(x)) - Q*(x, d(x)))."""
    for game, rng in drawn_games(10):
        cells = np.arange(len(game.goals))
        start = rng.dirichlet(np.ones(game.weights.size)).reshape(game.weights.shape)
        old, new = rng.integers(0, 3, (2, len(cells)))
        table = fixed_point(game, old)
        met = occupancy(game, acting(table, old), start)
        star = means(game._replace(weights=own_weights(game, old, start)), table)
        gain = met.sum(axis=1) @ (star[cells, new] - star[cells, old])
        small = 1e-5
        likely = (1 - small) * acting(table, old) + small * acting(table, new)
        asks = (1 - small) * (old == ASK) + small * (new == ASK)
        often = occupancy(game, likely, start)
        earned = (often * (likely * game.reward).sum(axis=2)).sum()
        paid = game.cost * (often.sum(axis=1) @ asks)
        before = (start * values(game, table, old)).sum()
        assert (earned - paid - before) / small == pytest.approx(gain, abs=1e-3)


# --------------------------------------------------------------------------- the paper's maps


def walking(scenario):
    """Return a team on shortest paths."""
    team = []
    for robot in scenario.robots:
        far = scenario.map.distances_to(robot.goal)[scenario.map.next_cell]
        team.append(np.repeat(np.eye(4)[far.argmin(axis=1)][:, None], len(far), axis=1))
    return team


def found_team(scenario):
    """Return decisions and moves of the best asking team found."""
    decided, team = [], []
    for robot in shipped_asking_team(scenario).robots:
        decisions = np.array([LETTERS.index(letter) for letter in robot.moves])
        moves = np.repeat(decisions[:, None], len(decisions), axis=1)
        for cell, letters in robot.asks.items():
            decisions[int(cell)] = 4
            moves[int(cell)] = [LETTERS.index(letter) for letter in letters]
        decided.append(decisions)
        team.append(np.eye(4)[moves])
    return decided, team


def tables_to_begin_with(game):
    rng = np.random.default_rng(5)
    yield np.full(game.reward.shape, 200.0)
    for _ in range(4):
        yield rng.uniform(0.0, 200.0, game.reward.shape)


def regret(game, table, decisions):
    """Return by how much the best decision of a cell beats the one made, at most."""
    star = means(game, table)
    made = star[np.arange(len(star)), decisions]
    return (star.max(axis=1) - made)[~game.goals].max()


@pytest.fixture(scope="module")
def env1():
    return load_scenario("env1", penalty=-100)


def test_the_best_team_of_env1_is_a_fixed_point_reached_from_everywhere(env1):
    decided, team = found_team(env1)
    starts = [robot.start for robot in env1.robots]
    earned = []
    for k, game in enumerate(games_of(env1, team)):
        table = fixed_point(game, decided[k])
        assert regret(game, table, decided[k]) < 1e-6
        earned.append(values(game, table, decided[k])[starts[k], starts[1 - k]])
        for begin in tables_to_begin_with(game):
            assert limit(improved, game, begin, applications=60) == pytest.approx(table)
    assert np.mean(earned) == pytest.approx(shipped_asking_team(env1).value, abs=1e-6)


def test_in_env1_the_distance_shrinks_by_gamma(env1):
    decided, team = found_team(env1)
    for k, game in enumerate(games_of(env1, team)):
        one, *others = tables_to_begin_with(game)
        for other in others:
            before, after = (backup(game, q, decided[k]) for q in (one, other))
            assert distance(before, after) <= 0.95 * distance(one, other) + 1e-9


def test_what_the_best_team_of_env1_loses_to_an_informed_robot(env1):
    """At most the sum of o(x, z) (max Q_d - V_d), o of the informed robot."""
    decided, team = found_team(env1)
    starts = [robot.start for robot in env1.robots]
    found = []
    for k, game in enumerate(games_of(env1, team)):
        begin = np.zeros_like(game.weights)
        begin[starts[k], starts[1 - k]] = 1.0
        table = fixed_point(game, decided[k])
        better = informed(game)
        earned = (begin * values(game, table, decided[k])).sum()
        loss = (begin * better.max(axis=2)).sum() - earned
        always = np.full(len(table), 4)
        met = occupancy(game, acting(better, always), begin)
        gap = table.max(axis=2) - values(game, table, decided[k])
        bound = met[~game.goals].ravel() @ gap[~game.goals].ravel()
        assert loss <= bound + 1e-6
        assert 400 < kappa(game) < 600
        found += [loss, bound]
    assert np.round(found, 2) == pytest.approx([2.37, 2.48, 1.16, 1.16])


def learned_and_exact(scenario, tables):
    """Yield how far what each robot learned is from the exact values of its decisions.

    Four numbers: the mean difference of Q^C, weighted by visits; the greatest one in joint states
    with at least 0.015 visits an episode; the number of cells in which another decision is better
    by the exact means; what small changes in these would gain from the start on.
    """
    decided = [table.q_star.argmax(axis=1) for table in tables]
    team = [acting(tables[k].q_coord, decided[k]) for k in range(2)]
    often = meetings(scenario, team, arrivals=False)
    starts = [robot.start for robot in scenario.robots]
    for k, game in enumerate(games_of(scenario, team, arrivals=True)):
        table = fixed_point(game, decided[k])
        apart = abs(tables[k].q_coord - table).max(axis=2)
        met = np.where(game.goals[:, None], 0.0, often[k])
        star = means(game, table)
        worse = star.max(axis=1) - star[np.arange(len(star)), decided[k]]
        worse[game.goals] = 0.0
        begin = np.zeros_like(met)
        begin[starts[k], starts[1 - k]] = 1.0
        visits = occupancy(game, team[k], begin).sum(axis=1)
        yield (
            (met * apart).sum() / met.sum(),
            apart[met > 0.015].max(),
            (worse > 0.01).sum(),
            visits @ worse,
        )


@pytest.mark.skipif(not has_numba(), reason="minutes in plain Python")
@pytest.mark.parametrize(
    ("name", "mean", "most", "cells", "gain"),
    [
        ("env1", 3.0, 60.0, 0, 0.01),
        pytest.param("pentagon", 6.0, 100.0, 15, 1.5, marks=pytest.mark.long),
        pytest.param("env2-2r", 4.0, 150.0, 15, 1.5, marks=pytest.mark.long),
    ],
)
def test_what_voi_learns_is_near_a_fixed_point(name, mean, most, cells, gain):
    settings = {"penalty": -100, "steps": 100_000, "peers_seen": "while_learning"}
    scenario = load_scenario(name, **settings)
    for seed in range(3):
        tables = train(scenario, "voi", seed=seed).tables
        for found in learned_and_exact(scenario, tables):
            assert (np.array(found) <= (mean, most, cells, gain)).all()


def settles(game):
    """Return whether the iteration of T ends, from values of 200 on."""
    begin = np.full(game.reward.shape, 200.0)
    return limit(improved, game, begin, applications=700) is not None


@pytest.mark.long
def test_in_env2_it_goes_round_if_a_question_costs_12():
    for cost, settled in ((1, True), (12, False)):
        scenario = load_scenario("env2-2r", penalty=-100, ask_cost=cost)
        for game in games_of(scenario, walking(scenario)):
            assert settles(game) == settled


def nineteen_maps(ask_cost=1):
    """Yield the name of a map, a robot's problem beside a peer on a shortest path, the start."""
    names = ["env1", "env2-2r"]
    for kind in ("door", "doors", "corridor", "rooms", "loop", "crossing"):
        names += [f"unseen1-{kind}-2r-{seed}" for seed in (1, 3, 5)]
    for name in names:
        scenario = load_scenario(name, penalty=-100, ask_cost=ask_cost)
        if len(scenario.map.cells) <= 45:
            starts = [robot.start for robot in scenario.robots]
            for k, game in enumerate(games_of(scenario, walking(scenario))):
                begin = np.zeros_like(game.weights)
                begin[starts[k], starts[1 - k]] = 1.0
                yield name, game, begin


def earned_by(game, table, begin):
    """Return what a robot earns that acts on a table: it need not be the table of its values."""
    decisions = chosen(game, table)
    likely = acting(table, decisions)
    met = occupancy(game, likely, begin)
    asks = decisions == game.reward.shape[2]
    earned = (met * (likely * game.reward).sum(axis=2)).sum()
    return earned - game.cost * (met.sum(axis=1) @ asks)


@pytest.mark.long
@pytest.mark.parametrize(("cost", "settled"), [(1, 38), (5, 36), (12, 22)])
def test_how_often_it_settles_in_19_maps(cost, settled):
    found = [settles(game) for _, game, _ in nineteen_maps(cost)]
    assert (len(found), sum(found)) == (38, settled)


@pytest.mark.long
def test_what_both_operators_earn_in_19_maps():
    corridors, others = [], []
    for name, game, begin in nineteen_maps():
        first = np.full(game.reward.shape, 200.0)
        found = [limit(operator, game, first) for operator in (algorithm1, improved)]
        earned = [earned_by(game, table, begin) for table in found]
        best = (begin * informed(game).max(axis=2)).sum()
        (corridors if "corridor" in name else others).append([*earned, best])
    assert (len(corridors), len(others)) == (6, 32)
    assert np.mean(corridors, axis=0) == pytest.approx(
        [96.66, 110.49, 115.27], abs=0.01
    )
    assert np.mean(others, axis=0) == pytest.approx([130.01, 130.07, 131.80], abs=0.01)
