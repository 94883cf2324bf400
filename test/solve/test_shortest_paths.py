# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exact worth of shortest paths: golden values, hand-made chains, the joint chain."""

import itertools
import math
import tracemalloc

import numpy as np
import pytest
from teams import walking

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.evaluation import play
from sparse_coord_ros.core.runs.measures import EXACT
from sparse_coord_ros.core.solve import exact
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths

GAMMA = 0.95

# Ties at random: return at penalty -20 and -100, miscoordinations of a trial.
RANDOM = {
    "cit": (111.175895976, 110.580073971, 0.010416929),
    "cmu": (27.018655219, 18.263873170, 0.280366500),
    "env1": (119.683290112, 92.597648245, 0.411506509),
    "env2-2r": (107.512646565, 92.263826912, 0.247149391),
    "env2-4r": (94.454097676, 26.971082469, 1.098280978),
    "isr": (143.550513619, 143.189347530, 0.005626286),
    "mit": (66.868366113, 66.868366113, 0.0),
    "pentagon": (160.981706020, 152.258029729, 0.122170782),
    "suny": (111.321697781, 111.309082993, 0.000231289),
}

MOVES = {"env1": 8, "env2-2r": 10, "env2-4r": 10, "isr": 6, "pentagon": 4, "mit": 18}
MOVES |= {"cit": 10, "suny": 10, "cmu": 31}

# Two 3 x 3 rooms joined by two doorways; the ways of two robots cross, with ties.
ROOMS = "1..#..3\n...D..2\n..#D..4"


@pytest.mark.parametrize("name", RANDOM)
def test_golden_values(name):
    at_20, at_100, steps = RANDOM[name]
    scenario = load_scenario(name, penalty=-20)
    reference = shortest_paths(scenario)
    assert reference.mean("returns") == pytest.approx(at_20, abs=2e-9)
    assert reference.mean("miscoordinations") == pytest.approx(steps, abs=2e-9)
    assert reference.mean("time_to_goal") == pytest.approx(MOVES[name] / 0.8, rel=1e-12)
    dearer = shortest_paths(scenario.with_settings({"penalty": -100}))
    assert dearer.mean("returns") == pytest.approx(at_100, abs=2e-9)
    assert dearer.mean("miscoordinations") == reference.mean("miscoordinations")


def test_a_step_with_two_meetings_counts_once(make):
    grid = "1D2\n###\n3D4"
    robots = {"a": (1, 2), "b": (2, 1), "c": (3, 4), "d": (4, 3)}
    reference = shortest_paths(make(grid, robots, move_success=1))
    assert reference.mean("miscoordinations") == pytest.approx(1, abs=1e-12)


def test_no_doorway_and_one_robot(make):
    assert shortest_paths(make("1..2")).mean("miscoordinations") == 0
    alone = make("1.D.2", {"a": (1, 2)}, interactions="together:any_doorway")
    assert shortest_paths(alone).mean("miscoordinations") == 0


def test_ways_around_a_pillar_by_hand(make):
    """Two robots around a pillar: on the same side in half of the trials."""
    scenario = make(".D.\n1#2\n.D.", move_success=1)
    assert shortest_paths(scenario).mean("miscoordinations") == pytest.approx(
        0.5, abs=1e-12
    )


def test_unequal_shares_of_the_penalty(make):
    """r^C of one robot is -40, of the other 0: on average as if both paid -20."""
    scenario = make("1D2", move_success=1, common_reward="each:2:0")
    reference = shortest_paths(scenario)
    assert reference.mean("returns") == pytest.approx(200 * GAMMA - 20, abs=1e-9)


@pytest.mark.parametrize("interactions", ["together", "together:any_doorway"])
@pytest.mark.parametrize(
    ("grid", "robots"),
    [
        (ROOMS, {"a": (1, 2), "b": (2, 1)}),
        ("1.#3\n.D.2", {"a": (1, 3), "b": (3, 1), "c": (2, [1, 0])}),
        ("1.D.2", {"a": (1, [0, 2]), "b": (2, [0, 2])}),  # both goals are the doorway
        ("1.D.2.3", {"a": (1, [0, 2]), "b": (2, [0, 2]), "c": (3, 1)}),
    ],
)
def test_equals_the_joint_markov_chain(make, interactions, grid, robots):
    """All joint states with their probabilities, carried forward as a trial goes."""
    scenario = make(grid, robots, interactions=interactions, horizon=9, penalty=-7)
    reference = shortest_paths(scenario)
    returns, steps = joint_chain(scenario)
    assert reference.mean("returns") == pytest.approx(returns, abs=1e-9)
    assert reference.mean("miscoordinations") == pytest.approx(steps, abs=1e-9)


def joint_chain(scenario):
    """Return the discounted return and the miscoordinations within the horizon, by brute force."""
    grid = scenario.map
    team = scenario.robots
    goals = tuple(robot.goal for robot in team)
    returns = steps = 0.0
    states = {tuple(robot.start for robot in team): 1.0}
    for t in range(150):
        following = {}
        for state, probability in states.items():
            ways = [successors(scenario, k, x) for k, x in enumerate(state)]
            for joint in itertools.product(*ways):
                after = tuple(y for y, _ in joint)
                share = probability * math.prod(p for _, p in joint)
                doors = [y for y in after if y in grid.doorways]
                crowd = len(doors) > (
                    1
                    if scenario.interactions == "together:any_doorway"
                    else len(set(doors))
                )
                arrivals = sum(
                    y == goal != x
                    for x, y, goal in zip(state, after, goals, strict=True)
                )
                paid = (
                    arrivals
                    * scenario.goal_reward
                    / (1 - scenario.discount)
                    / len(team)
                )
                returns += (
                    scenario.discount**t * share * (paid + crowd * scenario.penalty)
                )
                steps += share * crowd * (t < scenario.horizon)
                if after != goals:
                    following[after] = following.get(after, 0.0) + share
        states = {state: p for state, p in following.items() if p > 1e-15}
    return returns, steps


def successors(scenario, k, x):
    distance = scenario.map.distances_to(scenario.robots[k].goal)
    if distance[x] == 0:
        return [(x, 1.0)]
    nearer = [int(y) for y in scenario.map.next_cell[x] if distance[y] < distance[x]]
    p = scenario.move_success
    return [(x, 1 - p), *((y, p / len(nearer)) for y in nearer)]


@pytest.mark.parametrize(
    "settings", [{"discount": 0}, {"discount": 0.999, "move_success": 0.01}]
)
def test_extreme_settings_are_finite(make, settings):
    reference = shortest_paths(make(ROOMS, **settings))
    assert math.isfinite(reference.mean("returns"))
    assert 0 <= reference.mean("miscoordinations") <= 100


def test_a_large_map_takes_little_memory(make):
    rows = ["." * 50] * 48
    scenario = make(
        "\n".join(["1" + "." * 49, *rows, "." * 49 + "2"]), {"a": (1, 2), "b": (2, 1)}
    )
    tracemalloc.start()
    assert shortest_paths(scenario).mean("miscoordinations") == 0
    assert tracemalloc.get_traced_memory()[1] < 20 * 2**20
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("grid", "interactions", "returns", "time", "missed", "arrived"),
    [
        ("1D2", "block", 100 * (GAMMA + GAMMA**3), 3, 0, 1),
        ("1..2", "swap", 200 * GAMMA**2 - 20 * GAMMA, 3, 1, 1),
        ("1..2", "block:anywhere", 0, 100, 0, 0),  # they face each other for ever
        ("1..2", "together:anywhere", 200 * GAMMA**2, 3, 0, 1),
    ],
)
def test_kinds_of_interaction_by_hand(
    make, grid, interactions, returns, time, missed, arrived
):
    scenario = make(grid, move_success=1, interactions=interactions)
    found = shortest_paths(scenario)
    assert found.source == EXACT
    assert found.mean("returns") == pytest.approx(returns, abs=1e-9)
    assert found.mean("time_to_goal") == pytest.approx(time)
    assert found.mean("miscoordinations") == pytest.approx(missed)
    assert found.mean("arrived") == pytest.approx(arrived)


@pytest.mark.parametrize("interactions", ["swap", "block", "together+swap"])
def test_pairs_and_larger_teams_are_worth_what_trials_say(interactions):
    """Tables that lead along shortest paths, in the loops of learning."""
    for name in ("env2-2r", "env2-4r"):
        scenario = load_scenario(name, interactions=interactions)
        found = shortest_paths(scenario)
        assert (found.source == EXACT) == (name == "env2-2r")
        assert (found.error("returns") > 0) == (found.source != EXACT)
        played = play(scenario, walking(scenario), trials=1000, seed=1)
        for measure in ("returns", "time_to_goal", "miscoordinations"):
            error = math.hypot(played.error(measure), found.error(measure))
            gap = abs(played.mean(measure) - found.mean(measure))
            assert gap <= 4 * error + 1e-9, (name, measure)


def test_a_pair_too_large_for_the_joint_chain_is_played(monkeypatch):
    scenario = load_scenario("env1", interactions="together+swap")
    chain = shortest_paths(scenario)
    monkeypatch.setattr(exact, "MOST_STATES", 10)
    played = shortest_paths(scenario.with_settings({"steps": 1}))  # the same game
    assert (chain.trials, played.trials) == (0, 10_000)
    assert abs(played.mean("returns") - chain.mean("returns")) < 4 * played.error(
        "returns"
    )
    gap = abs(played.mean("miscoordinations") - chain.mean("miscoordinations"))
    assert gap < 4 * played.error("miscoordinations")


def test_many_robots_among_many_doorways_are_played(monkeypatch):
    """Their exact measures would take an array for each set of robots in doorways."""
    assert shortest_paths("building-4x2x4-32r-0").source != EXACT
    scenario = load_scenario("env2-4r")
    exactly = shortest_paths(scenario)
    monkeypatch.setattr("sparse_coord_ros.core.solve.shortest_paths.MOST_SETS", 1)
    played = shortest_paths(scenario.with_settings({"steps": 1}))  # the same game
    assert (exactly.trials, played.trials) == (0, 10_000)
    for measure in ("returns", "miscoordinations"):
        gap = abs(played.mean(measure) - exactly.mean(measure))
        assert gap < 4 * played.error(measure)


def test_it_says_who_fails(make):
    stuck = make("1..2", move_success=1, interactions="block:anywhere")
    assert shortest_paths(stuck).failed
    assert shortest_paths(stuck).cells()["all arrive"] == "0 %"
    late = make("1D2", move_success=1, horizon=1)
    assert shortest_paths(late).mean("arrived") == 0


@pytest.mark.parametrize("interactions", ["together", "swap"])
def test_a_robot_stays_in_its_cells_as_in_trials(interactions):
    """By the independent chains, the joint chain, and trials of a larger team."""
    for name in ("env1", "crowd-3r"):
        scenario = load_scenario(name, interactions=interactions, horizon=20)
        found = shortest_paths(scenario)
        played = play(scenario, walking(scenario), trials=2000, seed=1)
        assert np.allclose(found.stays, played.stays, atol=0.15)
        assert found.stays.sum() == pytest.approx(played.stays.sum(), rel=0.02)
        assert (found.asked == 0).all()
