# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Exact evaluation: beside many trials, by hand, closed forms, and what it refuses."""

import math

import numpy as np
import pytest
from teams import drawn, tables_from_values, walking

from sparse_coord_ros.base.errors import SettingError, TablesError
from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.mind import team_mind
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.evaluation import play
from sparse_coord_ros.core.runs.team import Team
from sparse_coord_ros.core.solve import exact, exact_loops
from sparse_coord_ros.core.solve.exact import evaluate_best, evaluate_exact, is_quick

GAMMA = 0.95
TRIALS = 10_000
PARTS = 25
ROOMS = "1..D...\n.#.#.#.\n...D..2"


def made(grid=ROOMS, robots=None, **settings):
    return drawn(grid, robots, **settings)


def undecided(scenario, seed=1):
    """Return tables with ties everywhere, between asking and moving too, leaning to the goal."""
    rng = np.random.default_rng(seed)
    cells = len(scenario.map.cells)
    tables = []
    for robot in scenario.robots:
        near = -scenario.map.distances_to(robot.goal)[scenario.map.next_cell].astype(
            float
        )
        q_star = np.column_stack([near, near.max(axis=1)])
        q_star[:, :4] += rng.integers(0, 2, size=(cells, 4))
        q_star[:, 4] = q_star[:, :4].max(axis=1) - (rng.random(cells) < 0.3)
        q_coord = near[:, None, :] + rng.integers(0, 3, size=(cells, cells, 4))
        tables.append(tables_from_values(scenario, len(tables), q_star, q_coord))
    return tables


def misses(scenario, tables):
    """Return what the exact evaluation says otherwise than trials do, by more than 4 errors.

    Every measure of every robot, its square, where robots act and ask, and who arrives.
    """
    found = evaluate_exact(scenario, tables)
    team = Team(scenario, tables[0].rule, compiled=True)
    memories = [table.memory for table in tables]
    mind = team_mind(tables[0].rule, scenario, range(len(tables)), memories)
    trials = team.play(mind, 5, TRIALS)
    said = []

    def compare(what, exactly, samples):
        error = samples.std(ddof=1) / math.sqrt(len(samples))
        if abs(exactly - samples.mean()) > 4 * error + 1e-9:
            said.append(
                f"{what}: {exactly} by the chain, {samples.mean()} ± {error} in trials"
            )

    for k in range(len(tables)):
        compare(f"return of robot {k}", found.returns[0, k], trials.returns[:, k])
    for name in ("returns", "time_to_goal", "asks", "miscoordinations"):
        samples = getattr(trials, name).reshape(TRIALS, -1)
        compare(name, found.mean(name), samples.mean(axis=1))
        square = found.spread(name) ** 2 + found.mean(name) ** 2
        compare(f"square of {name}", square, (samples**2).mean(axis=1))
    share = trials.mean("arrived")
    likely = found.mean("arrived")
    if abs(likely - share) > 4 * math.sqrt(likely * (1 - likely) / TRIALS) + 1 / TRIALS:
        said.append(f"arrival: {likely} by the chain, {share} of trials")
    number = TRIALS // PARTS
    parts = [team.play(mind, seed, number) for seed in range(6, 6 + PARTS)]
    for name in ("asked", "stays"):
        there = np.array([getattr(part, name) for part in parts])
        error = there.std(axis=0, ddof=1) / math.sqrt(PARTS)
        gap = np.abs(getattr(found, name) - there.mean(axis=0))
        # 0.005: of cells that hardly any trial enters
        if (gap > 5 * error + 0.005).any():
            said.append(f"{name}: differs by up to {gap.max()}")
    return said


CASES = {
    "plain": {},
    "failing": {"perception": "probability:0.5"},
    "blind": {"perception": "never"},
    "sight": {"perception": "line_of_sight"},
    "near": {"perception": "range:2", "ask_cost": 3},
    "uneven": {"common_reward": "each:0.5:2", "penalty": -7},
    "any doorway": {"interactions": "together:any_doorway", "penalty": -50},
    "anywhere": {"interactions": "together:anywhere"},
    "swap": {"interactions": "swap", "penalty": -50},
    "block": {"interactions": "block", "common_reward": "each:0.5:2"},
    "block anywhere": {"interactions": "block:anywhere", "perception": "range:2"},
    "together and swap": {"interactions": "together+swap", "penalty": -50},
    "all": {"interactions": "together:any_doorway+swap+block:anywhere", "horizon": 30},
    "short": {"horizon": 12},
    "slow": {"move_success": 0.4, "discount": 0.8, "goal_reward": 3},
}


@pytest.mark.parametrize("case", CASES)
def test_trials_say_the_same(case):
    scenario = made(**CASES[case])
    assert misses(scenario, undecided(scenario)) == []


def test_an_arrived_robot_pays_too():
    scenario = made(".D1\n..2", {"a": (1, [0, 1]), "b": (2, [0, 0])}, ask_cost=0)
    assert misses(scenario, undecided(scenario)) == []


@pytest.mark.parametrize("horizon", [7, 1000])
def test_one_robot_is_negative_binomial(horizon):
    scenario = made("1.....", {"a": (1, [0, 5])}, horizon=horizon)
    tables = walking(scenario)
    found = evaluate_exact(scenario, tables)
    moves = 5
    p = 0.8
    times = np.arange(moves, min(horizon, 400) + 1)
    chance = np.array(
        [math.comb(t - 1, moves - 1) * p**moves * (1 - p) ** (t - moves) for t in times]
    )
    late = max(0.0, 1 - chance.sum())
    mean = chance @ times + late * horizon
    worth = 200 * GAMMA ** (times - 1.0)
    assert found.mean("time_to_goal") == pytest.approx(mean, rel=1e-12)
    assert found.spread("time_to_goal") == pytest.approx(
        math.sqrt(chance @ times**2 + late * horizon**2 - mean**2), rel=1e-9
    )
    assert found.mean("returns") == pytest.approx(chance @ worth, rel=1e-12)
    assert found.spread("returns") == pytest.approx(
        math.sqrt(chance @ worth**2 - (chance @ worth) ** 2), rel=1e-9
    )
    assert found.mean("arrived") == pytest.approx(1 - late, rel=1e-12)
    assert (found.mean("miscoordinations"), found.mean("asks")) == (0, 0)
    if horizon == 1000:
        factor = p / (1 - GAMMA * (1 - p))
        assert found.mean("returns") == pytest.approx(
            200 * factor**5 * GAMMA**4, rel=1e-12
        )
        assert found.spread("time_to_goal") == pytest.approx(
            math.sqrt(5 * 0.2) / 0.8, rel=1e-9
        )


def test_one_robot_that_asks_nobody():
    scenario = made("1..", {"a": (1, [0, 2])}, move_success=1)
    tables = walking(scenario, coordinate=9.0)
    north = np.tile([1.0, 0.0, 0.0, 0.0], (*tables[0].q_coord.shape[:2], 1))
    # North is a wall; no peer is perceived, so it is not used.
    tables[0] = tables_from_values(scenario, 0, tables[0].q_star, north)
    found = evaluate_exact(scenario, tables)
    assert found.mean("returns") == pytest.approx(200 * GAMMA - 1 - GAMMA, rel=1e-12)
    assert found.mean("asks") == 2


def test_the_step_of_the_last_arrival_counts():
    """Both goals are the doorway's cell: the step that ends in it is a miscoordination."""
    scenario = made("1D2", {"a": (1, [0, 1]), "b": (2, [0, 1])}, move_success=1)
    found = evaluate_exact(scenario, walking(scenario))
    assert found.mean("returns") == pytest.approx(200 - 20, rel=1e-12)
    assert (found.mean("miscoordinations"), found.mean("arrived")) == (1, 1)


def test_half_a_team_that_never_arrives():
    scenario = made("1..D..2", horizon=37, move_success=1)
    tables = walking(scenario)
    tables[0].q_star[:, 0] = 1.0
    found = evaluate_exact(scenario, tables)
    assert found.returns.tolist() == [[0, pytest.approx(200 * GAMMA**5)]]
    assert (found.mean("time_to_goal"), found.spread("time_to_goal")) == (
        (37 + 6) / 2,
        (37 - 6) / 2,
    )
    assert found.mean("arrived") == 0


def test_a_very_long_horizon_ends_when_nothing_changes():
    short, long = (made(horizon=horizon) for horizon in (3000, 1_000_000))
    tables = walking(short)
    assert (
        evaluate_exact(short, tables).to_dict()
        == evaluate_exact(long, tables).to_dict()
    )


def test_tables_that_do_not_fit_are_refused():
    with pytest.raises(
        TablesError,
        match="robot 1 of scenario env1 .*q_star",
    ):
        evaluate_exact(load_scenario("env1"), walking(load_scenario("isr")))


class Stubborn(Coop):
    """Goes north after an answer, whatever it learned."""

    name = "stubborn"

    @staticmethod
    def asking_values(mind, task, k, cell, seen, cells, values):
        for b in range(4):
            values[b] = float(b == 0) if seen != 0 else mind.q_star[k, cell, b]


def test_a_learner_of_ones_own_is_evaluated_as_it_chooses():
    scenario = made()
    tables = undecided(scenario)
    found = evaluate_exact(scenario, tables, learner=Stubborn())
    assert found.mean("returns") != evaluate_exact(scenario, tables).mean("returns")
    played = play(scenario, tables, trials=300, seed=1, learner=Stubborn())
    assert abs(found.mean("returns") - played.mean("returns")) < 4 * played.error(
        "returns"
    )


@pytest.mark.parametrize(
    ("name", "learner", "settings"),
    [
        (
            "env1",
            "voi",
            {
                "perception": "probability:0.6",
                "common_reward": "each:1:0.5",
                "horizon": 20,
            },
        ),
        (
            "env2-2r",
            "coop",
            {
                "interactions": "together:any_doorway",
                "move_success": 0.7,
                "horizon": 15,
            },
        ),
    ],
)
def test_a_batch_has_the_same_values_and_so_has_plain_python(
    monkeypatch, name, learner, settings
):
    scenario = load_scenario(name).with_settings(
        {"steps": 3000, "penalty": -100, **settings}
    )
    scenario = learner_of(learner).with_defaults(scenario)
    how = {"engine": "numba", "jobs": 1, "history": True}
    [run] = run_batch(scenario, learner, [7], trials=2, **how)
    found = evaluate_exact(scenario, run.tables, learner=learner)
    assert run.measures == found
    monkeypatch.setattr(exact, "loop_for", lambda *_: exact_loops.carry)
    plain = evaluate_exact(scenario, run.tables, learner=learner)
    assert plain.to_dict() == found.to_dict()


def test_a_batch_has_exact_values_where_they_are_quick():
    assert [is_quick(load_scenario(name)) for name in ("env1", "cmu")] == [True, True]
    assert not is_quick(load_scenario("env2-4r"))
    assert not is_quick(load_scenario("cmu").with_settings({"horizon": 1000}))


def test_cells_that_nobody_comes_to_do_not_count(monkeypatch):
    """A hall that no greedy robot enters changes no bit; where percepts lead to counts."""
    small = made("1..D..2\n#.###.#")
    hall = made("1..D..2\n#.###.#\n.......\n.......\n.......")
    asks = [walking(scenario, coordinate=9.0) for scenario in (small, hall)]
    for tables, scenario in zip(asks, (small, hall), strict=True):
        aside = scenario.map.number[1, 1]
        q_star = tables[0].q_star
        q_coord = tables[0].q_coord
        q_coord[1, 4] = [0, 9, 0, 0]  # it steps aside where its peer is behind the door
        q_star[aside] = [9, 0, 0, 0, 0]
        tables[0] = tables_from_values(scenario, 0, q_star, q_coord)
    found, same = (
        evaluate_exact(s, t) for s, t in zip((small, hall), asks, strict=True)
    )
    assert found.stays[0, small.map.number[1, 1]] > 0
    assert same.to_dict() == found.to_dict()
    assert same.stays[:, : small.map.number[1, 5] + 1].tolist() == found.stays.tolist()
    monkeypatch.setattr(exact, "MOST_STATES", 81)
    assert evaluate_exact(hall, asks[1]).to_dict() == found.to_dict()
    with pytest.raises(SettingError, match="900 joint states"):
        evaluate_exact(hall, [Agent(Coop(), hall, k, 0).tables for k in range(2)])


def test_what_takes_longer_than_trials_is_played(monkeypatch):
    scenario = made()
    tables = walking(scenario)
    assert evaluate_best(scenario, tables, trials=7).how == "exact"
    monkeypatch.setattr(exact, "MOST_OUTCOMES", 100)
    told = []
    found = evaluate_best(
        scenario, tables, trials=7, progress=lambda *done: told.append(done)
    )
    assert (found.how, told) == ("7 trials", [(trial, 7) for trial in range(7)])
