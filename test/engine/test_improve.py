# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Planning on what was learned: the best plan there, and nothing of the true map in it."""

import itertools

import numpy as np
import pytest
from teams import drawn

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.engine import improve as module
from sparse_coord_ros.core.engine.improve import improve, learned_scenario, preferring
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.game.actions import COORDINATE, EAST, NORTH, WEST
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.tables import tables_equal
from sparse_coord_ros.core.runs.evaluation import play
from sparse_coord_ros.core.runs.team import Team
from sparse_coord_ros.core.solve import asking_loops, asking_search
from sparse_coord_ros.core.solve.asking_loops import AskingPolicies
from sparse_coord_ros.core.solve.exact import evaluate_exact
from sparse_coord_ros.core.solve.routes import alone

pytestmark = pytest.mark.usefixtures("compiled_loops")

FACTORED = learner_of("factored")
ENDS = ((1, 2), (1, 2), (2, 1), (2, 1))
needs_numba = pytest.mark.skipif(not has_numba(), reason="minutes in plain Python")


def trained(name="env2-2r", **settings):
    chosen = {"penalty": -100, "steps": 3000, **settings}
    scenario = name if not isinstance(name, str) else load_scenario(name)
    return train(scenario.with_settings(chosen), "factored", 7)


def memories_of(run):
    return [table.memory for table in run.tables]


def improved(run, memories=None):
    return improve(run.scenario, FACTORED, memories or memories_of(run))


def learned(run, memories=None):
    return learned_scenario(run.scenario, FACTORED, memories or memories_of(run))


def changed(memory, **more):
    return {**memory, **more}


def test_the_learned_game_is_what_was_counted_and_felt():
    run = trained("env1", common_reward="each:1:0.5", steps=2000)
    one, other = memories_of(run)
    scenario = learned(run)
    grid = run.scenario.map
    assert scenario.penalties == (-100, -50)
    assert scenario.map.doorways == grid.doorways
    moves = one["moved"] + other["moved"]
    tried = (one["updates"] + other["updates"])[:, :4]
    assert scenario.move_success == moves.sum() / tried[moves > 0].sum() != 0.8
    assert np.array_equal(scenario.map.next_cell[moves > 0], grid.next_cell[moves > 0])
    assert (scenario.map.next_cell == np.arange(len(moves))[:, None])[moves == 0].all()
    weighed = train(run.scenario.with_settings(credit="weight:2"), "factored", 7)
    assert learned(weighed).penalties == (-100, -50)


def test_the_robot_that_moved_most_says_where_a_move_leads():
    run = trained(drawn("1..D..2"), steps=200)
    one, other = memories_of(run)
    moved = one["moved"].copy()
    there = one["successor"].copy()
    moved[0, NORTH] = 10**6
    there[0, NORTH] = 3
    told = (changed(one, moved=moved, successor=there), other)
    assert learned(run, told).map.next_cell[0, NORTH] == 3
    assert learned(run, told).map.distances_to(3)[0] == 1


@needs_numba
def test_the_plan_for_a_corridor_is_the_best_of_all():
    run = trained(drawn("1D.2"), steps=1500, q_coord_init=200)
    scenario = learned(run)
    loops = asking_loops.compiled()
    game = asking_search.game_of(scenario)
    space = asking_search.workspace_of(game)
    both = np.ones(2, dtype=bool)
    choices = itertools.product((NORTH, EAST, WEST, COORDINATE), repeat=3)
    robots = [np.array(choice) for choice in choices]
    best = -np.inf
    for one, other in itertools.product(robots, repeat=2):
        actions = np.array([[*one, NORTH], [NORTH, *other]])  # nobody acts at its goal
        asks = actions == COORDINATE
        team = AskingPolicies(
            np.where(asks, 0, actions), asks, np.zeros((2, 4, 4), dtype=np.int64)
        )
        best = max(best, loops.solve(game, team, both, space, -np.inf))
    found = improved(run)
    assert found.value == pytest.approx(best, abs=1e-6)
    assert found.before <= found.value


@needs_numba
@pytest.mark.parametrize("settings", [{}, {"perception": "probability:0.7"}])
def test_greedy_reading_of_the_tables_is_the_plan(settings):
    run = trained(**settings)
    found = improved(run)
    scenario = learned(run)
    value = evaluate_exact(scenario, found.tables, learner=FACTORED).returns.mean
    assert value == pytest.approx(found.value, abs=1e-3)  # trials end after 100 steps
    before = evaluate_exact(scenario, run.tables, learner=FACTORED).returns.mean
    assert before == pytest.approx(found.before, abs=1e-3)
    assert found.value > found.before + 1
    truth = evaluate_exact(run.scenario, found.tables, learner=FACTORED).returns.mean
    assert (
        truth
        > evaluate_exact(run.scenario, run.tables, learner=FACTORED).returns.mean + 1
    )
    for table, old in zip(found.tables, run.tables, strict=True):
        assert np.array_equal(table.memory["u"], old.memory["u"])
        assert (table.q_star <= old.q_star).all()
        star = table.memory["u"] + table.memory["r_bar"]
        assert table.q_star[:, :4] == pytest.approx(star)


@needs_numba
def test_it_plans_with_the_learned_map_not_with_the_true_one():
    """Nobody ever came to one of the two doorways: the plan goes through the other."""
    grid = "1.#.2\n..D..\n..#..\n..D.."
    robots = {"robot_1": (1, 2), "robot_2": (2, 1)}
    run = trained(drawn(grid, robots), steps=2000)
    upper, lower = sorted(run.scenario.map.doorways)

    def visits(found):
        trials = play(run.scenario, found.tables, trials=20, seed=1, learner=FACTORED)
        return trials.stays[:, [upper, lower]].sum(axis=0)

    blind = []
    for memory in memories_of(run):
        moved = memory["moved"].copy()
        there = memory["successor"].copy()
        moved[run.scenario.map.next_cell == upper] = 0
        there[moved == 0] = 0
        blind.append(changed(memory, moved=moved, successor=there))
    assert visits(improved(run))[0] > 0
    assert visits(improved(run, blind))[0] == 0 < visits(improved(run, blind))[1]


@needs_numba
def test_a_doorway_that_nobody_felt_is_free():
    run = trained(drawn("1.D.2"), steps=2000)
    careless = [
        changed(one, door=np.zeros_like(one["door"])) for one in memories_of(run)
    ]
    found = improved(run, careless)
    assert improved(run).doorways == (2,) and found.doorways == ()
    assert found.value > improved(run).value + 1
    asked = [table.q_star.argmax(axis=1)[:4] == COORDINATE for table in found.tables]
    assert not np.any(asked)


@pytest.fixture
def few_trials(monkeypatch):
    monkeypatch.setattr(module, "PLAN_TRIALS", 200)
    monkeypatch.setattr(module, "FIRST_TRIALS", 50)


@needs_numba
def test_more_robots_climb_by_trials_all_to_the_same_plan(few_trials):
    run = trained("crowd-4r", steps=3000)
    found = improved(run)
    again = improved(run)
    assert found.value > found.before
    assert tables_equal(list(found.tables), list(again.tables))
    team = Team(learned(run), FACTORED, compiled=True)
    before = team.play(
        team.initial(memories_of(run)), 0, 200, paired=True
    ).returns.mean()
    assert before == found.before
    values = [
        play(learned(run), tables, trials=500, seed=3, learner=FACTORED).returns.mean()
        for tables in (run.tables, found.tables)
    ]
    assert values[1] > values[0]
    for table in found.tables:
        star = table.memory["u"] + table.memory["r_bar"]
        assert table.q_star[:, :4] == pytest.approx(star)


@needs_numba
def test_a_robot_of_three_takes_another_route(few_trials):
    """Two doorways, and a learned policy by which all meet in one of them."""
    grid = "1.#.2\n..D..\n3.#..\n..D.."
    robots = {"robot_1": (1, 2), "robot_2": (2, 1), "robot_3": (3, 2)}
    run = trained(drawn(grid, robots), steps=2000)
    upper, lower = sorted(run.scenario.map.doorways)
    after = alone(learned(run), [[lower], [lower], [lower]])
    lead = run.scenario.map.next_cell
    through_one = []
    for memory, worth in zip(memories_of(run), after, strict=True):
        u = worth[lead] * 0.8 + worth[:, None] * 0.2
        star = np.column_stack([u, np.full(len(u), -100.0)])
        more = {"u": u, "r_bar": 0 * u, "w": star[:, 4] - u.max(axis=1) + 1}
        through_one.append(changed(memory, q_star=star, value=star.max(axis=1), **more))
    found = improved(run, through_one)
    trials = play(run.scenario, found.tables, trials=50, seed=1, learner=FACTORED)
    assert found.value > found.before + 10
    assert trials.stays[:, lower].any()


@needs_numba
def test_robots_that_take_turns_in_a_passage_never_meet(few_trials):
    """Four at two ends, two of them in one cell."""
    run = trained(
        drawn("1.DD.2", {f"robot_{k}": ends for k, ends in enumerate(ENDS)}), steps=2000
    )
    memories = module.one_at_a_time(learned(run), FACTORED, memories_of(run))
    team = Team(run.scenario, FACTORED, compiled=True)
    trials = team.play(team.initial(memories), 0, 300)
    assert trials.arrived.all() and trials.miscoordinations.sum() == 0
    assert improved(run).value > trials.returns.mean() - 3


@needs_numba
def test_paired_trials_have_the_same_draws_whatever_happened_before():
    run = trained("env1", steps=100)
    team = Team(run.scenario, FACTORED, compiled=True)
    minds = team.initial(memories_of(run))
    minds.q_star[:, :, :4] = alone(run.scenario, [(), ()])[
        :, run.scenario.map.next_cell
    ]
    minds.q_star[:, :, COORDINATE] = -1
    times = []
    for paired in (True, False):
        there = minds.q_star.copy()
        first = team.play(minds, 0, 40, paired=paired).time_to_goal[:, 0]
        minds.q_star[1, :, NORTH] = 1000  # the other robot never arrives
        times.append((first, team.play(minds, 0, 40, paired=paired).time_to_goal[:, 0]))
        minds.q_star[:] = there
    assert np.array_equal(*times[0]) and not np.array_equal(*times[1])


def test_preferring():
    values = np.array([5.0, 7.0, 6.5, 1.0, 3.0])
    assert preferring(values, 2).tolist() == [3.25, 3.25, 6.5, 1.0, 3.0]
    assert values[1] == 7


def test_what_it_needs():
    coop = learner_of("coop")
    with pytest.raises(SettingError, match="^improve: learner coop"):
        improve(load_scenario("env1"), coop, [])
