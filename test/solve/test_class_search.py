# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The class bound: every team of a tiny map, known values, plain and compiled, in words."""

import itertools
import json

import numpy as np
import pytest

from sparse_coord_ros.compiling import has_numba
from sparse_coord_ros.errors import ResultsError, SettingError
from sparse_coord_ros.game.scenario import load_scenario, scenario_from_dict
from sparse_coord_ros.solve import class_loops, class_search
from sparse_coord_ros.solve.class_bound import LETTERS, RobotPolicy, class_tables
from sparse_coord_ros.solve.class_loops import PLAIN
from sparse_coord_ros.solve.class_search import class_bound, class_value, in_words
from sparse_coord_ros.solve.exact import evaluate_exact
from sparse_coord_ros.solve.optimum import joint_optimum
from sparse_coord_ros.solve.reference import shortest_path_reference

TINY = "1D.2"
SMALL = "1.D.2\n..#.."
LOOPS = class_loops.compiled()  # plain where numba is missing
needs_numba = pytest.mark.skipif(not has_numba(), reason="minutes in plain Python")


def made(grid=SMALL, robots=None, **settings):
    robots = robots or {"a": (1, 2), "b": (2, 1)}
    data = {
        "map": {"name": "drawn", "text": f"title: drawn\n---\n{grid}\n"},
        "robots": {name: {"start": s, "goal": g} for name, (s, g) in robots.items()},
        "penalty": -100,
        **settings,
    }
    return scenario_from_dict(data, where="drawn.yaml", name="drawn")


def every_team(scenario):
    """Yield the value of every team of a tiny map, its moves after percepts chosen at best."""
    cells = len(scenario.map.cells)
    game = class_search._game(scenario, (0.5, 0.5))
    places = [
        (k, x) for k, robot in enumerate(scenario.robots) for x in range(cells) if x != robot.goal
    ]
    for choice in itertools.product((0, 2, 3, 8), repeat=len(places)):  # north is staying
        policy = class_loops.ClassTeam(
            np.zeros((2, cells), dtype=np.int64),
            np.zeros((2, cells), dtype=bool),
            np.zeros((2, cells, cells), dtype=np.int64),
        )
        for (k, x), option in zip(places, choice, strict=True):
            policy.moves[k, x], policy.asks[k, x] = option % 8, option == 8
        space = class_search._space(scenario, game)
        yield LOOPS.solve(game, policy, np.ones(2, dtype=bool), space, -np.inf)


@pytest.mark.parametrize("ask_cost", [pytest.param(0.01, marks=pytest.mark.long), 3])
def test_the_search_finds_the_best_of_every_team(ask_cost):
    scenario = made(TINY, ask_cost=ask_cost)
    found = class_bound(scenario, restarts=5, loops=LOOPS)
    assert found.value == pytest.approx(max(every_team(scenario)), abs=1e-6)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"perception": "probability:0.5"},
        {"perception": "range:2"},
        {"common_reward": "each:0.5:2", "ask_cost": 0.1},
        {"conflict": "any_doorway", "ask_cost": 0.1},
        {"move_success": 0.5, "discount": 0.9, "goal_reward": 3},
    ],
)
def test_the_value_is_what_exact_evaluation_says(settings):
    scenario = made("1.D.2\n..D..", **settings, horizon=2000)
    found = class_bound(scenario, restarts=2, loops=LOOPS)
    worth = evaluate_exact(scenario, class_tables(scenario, found.robots))
    assert worth.reward.mean == pytest.approx(found.value, abs=1e-6)
    assert class_value(scenario, found.robots) == pytest.approx(found.value, abs=1e-6)
    assert found.value <= joint_optimum(scenario).value + 1e-6
    assert found.value >= shortest_path_reference(scenario).reward - 1e-6


def test_no_other_moves_after_percepts_are_better():
    scenario = made(ask_cost=0.1)
    found = class_bound(scenario, restarts=3, loops=LOOPS)
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
        assert class_value(scenario, others, loops=LOOPS) <= found.value + 1e-6


@needs_numba
def test_compiled_loops_find_the_same():
    scenario = made(TINY, ask_cost=0.01)
    plain = class_bound(scenario, restarts=2, loops=PLAIN)
    compiled = class_bound(scenario, restarts=2)
    assert compiled.value == pytest.approx(plain.value, abs=1e-9)
    assert (compiled.robots, compiled.agreed) == (plain.robots, plain.agreed)


@needs_numba
@pytest.mark.parametrize(
    ("name", "penalty", "value"),
    [
        ("env1", -20, 121.1958),
        ("env1", -100, 118.5092),
        ("pentagon", -20, 160.9817),
        ("pentagon", -100, 158.8504),
    ],
)
def test_known_values(name, penalty, value):
    scenario = load_scenario(name).with_settings({"penalty": penalty})
    found = class_bound(scenario, restarts=5, seed=3)
    assert found.value == pytest.approx(value, abs=1e-4)
    assert 1 <= found.agreed <= found.restarts == 5
    worth = evaluate_exact(scenario, class_tables(scenario, found.robots))
    assert worth.reward.mean == pytest.approx(found.value, abs=1e-6)


@needs_numba
def test_who_steps_aside_for_both_would_rather_not():
    """env1 at -20: the robot that asks pays for what both gain."""
    scenario = load_scenario("env1")
    found = class_bound(scenario, restarts=3)
    asking = [bool(robot.asks) for robot in found.robots]
    assert sorted(asking) == [False, True]
    k = asking.index(True)
    assert found.gains[k] > 1 > found.gains[1 - k] == 0
    stubborn = list(found.robots)
    stubborn[k] = RobotPolicy(found.robots[k].moves, {})
    worth = [
        evaluate_exact(scenario, class_tables(scenario, team)).robots[k]
        for team in (found.robots, stubborn)
    ]
    assert worth[1] - worth[0] <= found.gains[k] + 1e-6
    peer = scenario.robots[1 - k].name
    assert f"where {peer} is in" in "\n".join(in_words(scenario, found.robots))


def test_a_search_that_was_cut_off_goes_on(tmp_path):
    scenario = made()
    whole = class_bound(scenario, restarts=4, loops=LOOPS)
    file = tmp_path / "search.json"
    first = class_bound(scenario, restarts=2, loops=LOOPS, file=file)
    assert first.restarts == 2
    done = []
    found = class_bound(
        scenario,
        restarts=4,
        loops=LOOPS,
        file=file,
        progress=lambda now, of, best: done.append((now, of, best)),
    )
    assert [entry[:2] for entry in done] == [(3, 4), (4, 4)]
    assert (found.value, found.agreed, found.restarts) == (whole.value, whole.agreed, 4)
    assert len(json.loads(file.read_text())["values"]) == 4
    before = file.read_bytes()
    again = class_bound(scenario, restarts=4, loops=LOOPS, file=file)
    assert (again, file.read_bytes()) == (found, before)


@pytest.mark.parametrize(
    "change",
    [
        lambda data: "{}",
        lambda data: "no JSON",
        lambda data: json.dumps({**data, "values": []}),
        lambda data: json.dumps({**data, "format": 99}),
        lambda data: json.dumps({**data, "game": "another"}),
        lambda data: json.dumps({**data, "robots": data["robots"][:1]}),
        lambda data: json.dumps({**data, "robots": [{"moves": "x", "asks": {}}] * 2}),
    ],
)
def test_another_file_is_refused(tmp_path, change):
    scenario = made(TINY)
    file = tmp_path / "search.json"
    class_bound(scenario, restarts=1, loops=LOOPS, file=file)
    file.write_text(change(json.loads(file.read_text())))
    with pytest.raises(ResultsError, match="search.json: is .*give another file"):
        class_bound(scenario, restarts=1, loops=LOOPS, file=file)


def test_another_seed_is_refused(tmp_path):
    file = tmp_path / "search.json"
    class_bound(made(TINY), restarts=1, loops=LOOPS, file=file)
    with pytest.raises(ResultsError, match="another game or seed"):
        class_bound(made(TINY), restarts=1, seed=1, loops=LOOPS, file=file)


def test_only_two_robots():
    with pytest.raises(SettingError, match="env2-4r has 4 robots, allowed: 2"):
        class_bound(load_scenario("env2-4r"))


def test_words_and_picture_show_what_the_team_does(tmp_path):
    from matplotlib.figure import Figure

    from sparse_coord_ros.experiments.report.map_pictures import draw_team

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
    figure = Figure()
    axes = figure.subplots()
    found = class_bound(scenario, restarts=1, loops=LOOPS)
    draw_team(axes, scenario, found)
    assert f"class bound {found.value:.2f}" in axes.get_title()
    figure.savefig(tmp_path / "team.png")
    assert (tmp_path / "team.png").stat().st_size > 1000
