# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The best asking team found, searched for and shipped, and the other yardsticks of a reward."""

import itertools
import json

import numpy as np
import pytest
from teams import drawn, tables_from_values

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.base.errors import ResultsError
from sparse_coord_ros.base.share import share_file
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.solve import asking_loops, asking_search
from sparse_coord_ros.core.solve.asking_search import (
    LETTERS,
    find_asking_team,
)
from sparse_coord_ros.core.solve.asking_words import in_words
from sparse_coord_ros.core.solve.exact import evaluate_exact
from sparse_coord_ros.core.solve.optimum import independent_bound, joint_optimum
from sparse_coord_ros.core.solve.shipped import (
    RobotPolicy,
    game_digest,
    shipped_asking_team,
    shipped_best_team,
    yardsticks,
)
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths

TINY = "1D.2"
SMALL = "1.D.2\n..#.."
CLIMB = asking_loops.compiled()  # plain where numba is missing
needs_numba = pytest.mark.skipif(not has_numba(), reason="minutes in plain Python")


def tables_of_policies(scenario, robots):
    """Return tables on which Algorithm 1 acts greedily as these policies say."""
    cells = len(scenario.map.cells)
    tables = []
    for k, robot in enumerate(robots):
        q_star = np.zeros((cells, len(ACTIONS)))
        q_coord = np.zeros((cells, cells, PRIMITIVES))
        for x, letter in enumerate(robot.moves):
            q_star[x, LETTERS.index(letter)] = 1.0
        for cell, letters in robot.asks.items():
            q_star[int(cell), COORDINATE] = 2.0
            for z, letter in enumerate(letters):
                q_coord[int(cell), z, LETTERS.index(letter)] = 1.0
        tables.append(tables_from_values(scenario, k, q_star, q_coord))
    return tables


def made(grid=SMALL, robots=None, **settings):
    return drawn(grid, robots, **{"penalty": -100, **settings})


def class_value(scenario, robots):
    """Return what a team of these policies is worth to infinity, averaged over the robots."""
    game = asking_search.game_of(scenario)
    team = asking_search.policies_of(scenario, robots)
    nobody = np.zeros(2, dtype=bool)
    space = asking_search.workspace_of(game)
    return CLIMB(game, team, nobody, space, asking_search.NO_TRIALS)


def every_team(scenario):
    """Yield the value of every team of a tiny map, its moves after percepts chosen at best."""
    cells = len(scenario.map.cells)
    game = asking_search.game_of(scenario)
    places = [
        (k, x)
        for k, robot in enumerate(scenario.robots)
        for x in range(cells)
        if x != robot.goal
    ]
    for choice in itertools.product((2, 3, 8), repeat=len(places)):
        policy = asking_loops.AskingPolicies(
            np.zeros((2, cells), dtype=np.int64),
            np.zeros((2, cells), dtype=bool),
            np.zeros((2, cells, cells), dtype=np.int64),
        )
        for (k, x), option in zip(places, choice, strict=True):
            policy.moves[k, x] = option % 8
            policy.asks[k, x] = option == 8
        space = asking_search.workspace_of(game)
        both = np.ones(2, dtype=bool)
        yield CLIMB(game, policy, both, space, asking_search.NO_TRIALS)


@pytest.mark.parametrize("ask_cost", [pytest.param(0.01, marks=pytest.mark.long), 3])
def test_the_search_finds_the_best_of_every_team(ask_cost):
    scenario = made(TINY, ask_cost=ask_cost)
    found = find_asking_team(scenario, restarts=5)
    assert found.value == pytest.approx(max(every_team(scenario)), abs=1e-6)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"perception": "probability:0.5"},
        {"perception": "range:2"},
        {"common_reward": "each:0.5:2", "ask_cost": 0.1},
        {"interactions": "together:any_doorway", "ask_cost": 0.1},
        {"move_success": 0.5, "discount": 0.9, "goal_reward": 3},
        {"interactions": "swap", "ask_cost": 0.1},
        {"interactions": "block", "ask_cost": 0.1},
        {"interactions": "together+swap+block:anywhere", "perception": "range:2"},
    ],
)
def test_the_value_is_what_exact_evaluation_says(settings):
    scenario = made("1.D.2\n..D..", **settings, horizon=2000)
    found = find_asking_team(scenario, restarts=2)
    worth = evaluate_exact(scenario, tables_of_policies(scenario, found.robots))
    assert worth.mean("returns") == pytest.approx(found.value, abs=1e-6)
    assert class_value(scenario, found.robots) == pytest.approx(found.value, abs=1e-6)
    assert found.value <= joint_optimum(scenario).value + 1e-6
    assert found.value >= shortest_paths(scenario).mean("returns") - 1e-6


def test_no_other_moves_after_percepts_are_better():
    scenario = made(ask_cost=0.1)
    found = find_asking_team(scenario, restarts=3)
    assert any(robot.asks for robot in found.robots)
    rng = np.random.default_rng(0)
    for _ in range(20):
        others = [
            RobotPolicy(
                robot.moves,
                {
                    x: "".join(rng.choice(list(LETTERS), len(text)))
                    for x, text in robot.asks.items()
                },
            )
            for robot in found.robots
        ]
        assert class_value(scenario, others) <= found.value + 1e-6


@pytest.mark.parametrize("seed", (6, 9))
def test_no_single_other_choice_is_better_where_climbing_ends(seed):
    scenario = made("1.D.2\n..D..", ask_cost=0.1)
    game = asking_search.game_of(scenario)
    rng = np.random.default_rng(seed)
    team = asking_search.random_policies(scenario, rng)
    both = np.ones(2, dtype=bool)
    space = asking_search.workspace_of(game)
    options = asking_loops.OPTIONS
    cells = len(scenario.map.cells)
    best = CLIMB(game, team, both, space, rng.permutation(2 * cells * options))
    for k, x, move, asks in itertools.product(
        range(2), range(cells), range(4), (False, True)
    ):
        other = asking_loops.AskingPolicies(*(array.copy() for array in team))
        other.moves[k, x] = move
        other.asks[k, x] = asks
        fresh = asking_search.workspace_of(game)
        value = CLIMB(game, other, both, fresh, asking_search.NO_TRIALS)
        assert value <= best + 2 * asking_loops.LEAST_GAIN


@needs_numba
def test_compiled_loops_find_the_same(monkeypatch):
    scenario = made(TINY, ask_cost=0.01)
    compiled = find_asking_team(scenario, restarts=1)
    monkeypatch.setattr(asking_loops, "compiled", lambda: asking_loops.climb)
    plain = find_asking_team(scenario, restarts=1)
    assert compiled.value == pytest.approx(plain.value, abs=1e-9)
    assert (compiled.robots, compiled.agreed) == (plain.robots, plain.agreed)


@needs_numba
@pytest.mark.parametrize(
    ("name", "value"), [("env1", 121.1958), ("pentagon", 160.9817)]
)
def test_known_values(name, value):
    scenario = load_scenario(name, penalty=-20)
    found = find_asking_team(scenario, restarts=5, seed=3)
    assert found.value == pytest.approx(value, abs=1e-4)
    assert found.value == pytest.approx(shipped_asking_team(scenario).value, abs=1e-6)
    assert 1 <= found.agreed <= found.restarts == 5


def test_of_equally_good_moves_after_a_percept_the_first_is_chosen():
    scenario = made("1..\n.D.\n..2", {"a": (1, 2), "b": (2, 1)}, penalty=0, ask_cost=0)
    game = asking_search.game_of(scenario)
    asking = np.ones((2, 9), dtype=bool)
    seen = np.full((2, 9, 9), 3)
    team = asking_loops.AskingPolicies(np.zeros((2, 9), dtype=np.int64), asking, seen)
    far = [scenario.map.distances_to(robot.goal) for robot in scenario.robots]
    space = asking_search.workspace_of(game)
    space.value[:] = np.add.outer(0.9 ** far[0], 0.9 ** far[1]).ravel()
    asking_loops.best_at(game, team, np.ones(2, dtype=bool), space, 0 * 9 + 8)
    # east and west: as good
    assert (LETTERS[seen[0, 0, 8]], LETTERS[seen[1, 8, 0]]) == (
        "s",
        "n",
    )


@needs_numba
def test_who_steps_aside_for_both_would_rather_not():
    """env1 at -20: the robot that asks pays for what both gain."""
    scenario = load_scenario("env1", penalty=-20)
    found = find_asking_team(scenario, restarts=3)
    asking = [bool(robot.asks) for robot in found.robots]
    assert sorted(asking) == [False, True]
    k = asking.index(True)
    assert found.gains[k] > 1 > found.gains[1 - k] == 0
    stubborn = list(found.robots)
    stubborn[k] = RobotPolicy(found.robots[k].moves, {})
    worth = [
        evaluate_exact(scenario, tables_of_policies(scenario, team)).returns[0, k]
        for team in (found.robots, stubborn)
    ]
    assert worth[1] - worth[0] <= found.gains[k] + 1e-6
    peer = scenario.robots[1 - k].name
    assert f"where {peer} is in" in "\n".join(in_words(scenario, found.robots))


def test_a_search_that_was_cut_off_goes_on(tmp_path):
    scenario = made()
    whole = find_asking_team(scenario, restarts=4)
    file = tmp_path / "search.json"
    first = find_asking_team(scenario, restarts=2, file=file)
    assert first.restarts == 2
    done = []
    found = find_asking_team(
        scenario,
        restarts=4,
        file=file,
        progress=lambda *entry: done.append(entry),
    )
    assert done == [(3, 4), (4, 4)]
    assert (found.value, found.agreed, found.restarts) == (whole.value, whole.agreed, 4)
    assert len(json.loads(file.read_text())["values"]) == 4
    before = file.read_bytes()
    again = find_asking_team(scenario, restarts=4, file=file)
    assert (again, file.read_bytes()) == (found, before)


@pytest.mark.parametrize(
    "change",
    [
        {"values": []},
        {"format": 99},
        {"game": "another"},
        {"seed": 1},
        {"robots": [{"moves": "nnnn", "asks": {}}]},
        {"robots": [{"moves": "x", "asks": {}}] * 2},
        {"robots": [{"moves": "nnnn", "asks": {"9": "nnnn"}}] * 2},
    ],
)
def test_another_file_is_refused(tmp_path, change):
    scenario = made(TINY)
    file = tmp_path / "search.json"
    find_asking_team(scenario, restarts=1, file=file)
    file.write_text(json.dumps({**json.loads(file.read_text()), **change}))
    with pytest.raises(
        ResultsError,
        match="search.json",
    ):
        find_asking_team(scenario, restarts=1, file=file)


def test_words_say_what_the_team_does():
    scenario = made("1.D.2\n..#..", {"a": (1, 2), "b": (2, 1)})
    # Robot a steps south where b is in the doorway or behind it; b walks straight on.
    cells = {position: x for x, position in enumerate(scenario.map.cells)}
    moves = {"a": list("e" * len(cells)), "b": list("w" * len(cells))}
    for position in ((1, 0), (1, 1), (1, 3), (1, 4)):
        moves["a"][cells[position]] = "n"
    table = ["e"] * len(cells)
    for position in ((0, 2), (0, 3)):
        table[cells[position]] = "s"
    team = [
        RobotPolicy("".join(moves["a"]), {str(cells[(0, 1)]): "".join(table)}),
        RobotPolicy("".join(moves["b"]), {}),
    ]
    assert in_words(scenario, team) == [
        "a: (0, 0) east to (0, 4)",
        "  asks in (0, 1): east; south where b is in (0, 2), (0, 3)",
        "  off its way: (1, 1) north",
        "b: (0, 4) west to (0, 0)",
    ]


SHIPPED = json.loads(
    share_file("config", "asking_teams.json").read_text(encoding="utf-8")
)
DEAREST = [title.split(",")[0] for title in SHIPPED["teams"] if title.endswith("-100")]
PENALTIES = (0, -0.1, -1, -10, -20, -100)


@pytest.mark.parametrize("name", DEAREST)
def test_a_shipped_team_is_worth_what_is_said(name):
    scenario = load_scenario(name, penalty=-100)
    bound = shipped_asking_team(scenario)
    assert bound.game == game_digest(scenario)
    found = evaluate_exact(scenario, tables_of_policies(scenario, bound.robots))
    # Trials end at the horizon; what comes later is worth less than this.
    late = (
        (1 - found.mean("arrived")) * 2 * scenario.goal_reward / (1 - scenario.discount)
    )
    assert abs(found.mean("returns") - bound.value) < 1e-6 + late
    assert bound.value <= joint_optimum(scenario).value + 1e-6
    assert bound.value >= shortest_paths(scenario).mean("returns") - 1e-6
    assert 1 <= bound.agreed <= bound.restarts
    assert all(gain >= 0 for gain in bound.gains)


KINDS = [title for title in SHIPPED["teams"] if "interactions" in title]


@pytest.mark.parametrize("title", KINDS)
def test_teams_that_swap_or_block_are_worth_what_is_said(title):
    name, _, kind = title.partition(", penalty -100, interactions ")
    given = {"interactions": kind, "penalty": -100}
    scenario = load_scenario(name).with_settings(given)
    bound = shipped_asking_team(scenario)
    assert class_value(scenario, bound.robots) == pytest.approx(bound.value, abs=1e-6)
    assert bound.value <= joint_optimum(scenario).value + 1e-6
    assert bound.value >= shortest_paths(scenario).mean("returns")


@pytest.mark.parametrize("name", ["env1", "env2-2r", "pentagon", "isr", "cit"])
def test_every_penalty_of_figure_4_is_there(name):
    scenarios = [load_scenario(name, penalty=penalty) for penalty in PENALTIES]
    bounds = [shipped_asking_team(scenario) for scenario in scenarios]
    assert all(bound.restarts >= 30 for bound in bounds)
    values = [bound.value for bound in bounds]
    assert values == sorted(values, reverse=True)
    assert values[0] == pytest.approx(independent_bound(scenarios[0]), abs=1e-6)


def test_it_is_of_the_game_and_not_of_the_learning():
    scenario = load_scenario("env1")
    bound = shipped_asking_team(scenario)
    other = {
        "steps": 5,
        "horizon": 7,
        "epsilon": "constant:0.5",
        "goal_value": 0,
        "peers": "all",
    }
    assert shipped_asking_team(scenario.with_settings(other)) == bound
    for name, value in {
        "penalty": -21,
        "ask_cost": 2,
        "discount": 0.9,
        "move_success": 0.9,
        "goal_reward": 9,
        "interactions": "together:any_doorway",
        "perception": "range:2",
        "common_reward": "each:1:2",
    }.items():
        assert shipped_asking_team(scenario.with_settings({name: value})) is None, name
    assert shipped_asking_team(load_scenario("env2-4r")) is None


@pytest.mark.parametrize("name", ["env2-4r", "crowd-4r", "crowd-6r", "crowd-8r"])
def test_the_shipped_teams(name):
    scenario = load_scenario(name).with_settings(
        {"penalty": -100, "steps": 7, "max_steps": 9}
    )
    team = shipped_best_team(scenario)
    assert team.value + 5 * team.standard_error < independent_bound(scenario)
    assert team.seed >= 950_000 and team.trials >= 10_000
    assert str(team).startswith(f"{team.value:.2f} (")
    assert shipped_best_team(scenario.with_settings({"ask_cost": 2})) is None
    assert shipped_best_team(load_scenario("env1")) is None


@pytest.mark.parametrize(
    ("name", "names"),
    [
        ("env1", ["best asking team found", "exact joint optimum"]),
        ("crowd-4r", ["best learned team", "bound (robots alone)"]),
    ],
)
def test_the_known_ones_best_last(name, names):
    found = yardsticks(load_scenario(name).with_settings({"penalty": -100}))
    assert [name for name, _ in found] == names
    assert [value for _, value in found] == sorted(value for _, value in found)
