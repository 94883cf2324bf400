# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each setting of a scenario does what its help says, whatever legal value it has."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from teams import drawn, plain_run, untrained

from sparse_coord_ros.core.game.actions import EAST, WEST
from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.core.game.scenario import SETTINGS, load_scenario
from sparse_coord_ros.core.game.world import Action, World
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.mind import rows_in
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths

SURE = {"move_success": 1, "starts": "fixed"}
MEET = (Action(EAST, True, 1, True), Action(WEST, False, -1, False))
"""The first robot asks, and both go to the cell between them."""

share = st.floats(0.05, 0.95)


def first_rewards(grid="1D2", **changes):
    """Return the rewards of a step in which both go to the cell between them."""
    return World(drawn(grid, **SURE, **changes), 0).advance(MEET).rewards


def crossing(**changes):
    """Return the exact measures of robots that pass each other, three moves from their goals."""
    return shortest_paths(drawn("1..2", **{"move_success": 1, **changes}))


def learned(steps=1, grid="1..2", learner="noncoop", **changes):
    """Return a run that has learned."""
    run = plain_run(drawn(grid, steps=steps, **{**SURE, **changes}), learner, 1)
    run.advance(steps)
    return run


def first_value(run):
    """Return the one value of Q* of the first robot that an update has changed."""
    [value] = run.memories[0]["q_star"][run.memories[0]["updates"] > 0]
    return value


def steps(value):
    assert learned(steps=value, max_steps=7).history.length.sum() == value


def goal_reward(value):
    world = World(drawn("12", **SURE, goal_reward=value), 0)
    assert world.advance(MEET).rewards[0].individual == value


def penalty(value):
    assert [one.common for one in first_rewards(penalty=value)] == [value, value]


def common_reward(value):
    factors = list(map(float, value.split(":")[1:])) or [1.0, 1.0]
    paid = [one.common for one in first_rewards(common_reward=value)]
    assert paid == [-20 * factor for factor in factors]


def ask_cost(value):
    assert [one.ask_cost for one in first_rewards(ask_cost=value)] == [-value, 0.0]


def discount(value):
    worth = 10 / (1 - value)
    assert crossing(discount=value).mean("returns") == pytest.approx(worth * value**2)


def move_success(value):
    found = crossing(move_success=value, horizon=900).mean("time_to_goal")
    assert found == pytest.approx(3 / value, rel=0.01)


def interactions(value):
    kinds = value.split("+")
    outcome = {}
    for place, grid in {
        "doorway": "1D2",
        "cell": "1.2",
        "exchange": "12..\n....",
    }.items():
        ends = {"a": (1, [0, len(grid.split()[0]) - 1]), "b": (2, [0, 0])}
        if place == "exchange":
            ends = {"a": (1, [1, 3]), "b": (2, [1, 0])}
        world = World(drawn(grid, ends, **SURE, interactions=value), 0)
        outcome[place] = world.advance(MEET).miscoordination
        stopped = len(set(world.cells)) == 2
        if place == "doorway":
            assert stopped == any(kind.startswith("block") for kind in kinds)
        if place == "cell":
            assert stopped == ("block:anywhere" in kinds)
    met = any(kind.startswith("together") for kind in kinds)
    blocked = any(kind.startswith("block") for kind in kinds)
    if not blocked:
        assert outcome["doorway"] == met
        assert outcome["cell"] == ("together:anywhere" in kinds)
        assert outcome["exchange"] == ("swap" in kinds)


def perception(value):
    """A robot asks for a peer that is 1 to 5 cells away."""
    percepts = Percepts(drawn("1....2", perception=value), 3)
    kind, _, number = value.partition(":")
    for away in range(1, 6):
        seen = np.mean([percepts.sees(t, 0, 0, away) for t in range(400)])
        due = {"always": 1, "never": 0, "line_of_sight": 1}.get(kind)
        if kind == "range":
            due = float(away <= float(number))
        if kind == "probability":
            assert abs(seen - float(number)) < 0.12
        else:
            assert seen == due


def peers(value):
    scenario = load_scenario("crowd-3r", peers=value, epsilon="constant:1")
    agent = Agent(learner_of("coop"), scenario, 0, 1)
    asked = [agent.decide(t, 3).peers for t in range(1, 60)]
    asked = [found for found in asked if found]
    assert asked and {len(found) for found in asked} == {2 if value == "all" else 1}


def credit(value):
    """The value of the first move into the doorway falls by r^C times its weight."""
    kind, _, number = value.partition(":")
    weight = {"own": 1, "team": 2}.get(kind) or float(number)
    values = []
    for felt in (0, -20):
        run = plain_run(
            drawn(
                "1D2",
                **SURE,
                credit=value,
                penalty=felt,
                epsilon="constant:1",
                step_size="constant:1",
                goal_value=0,
                q_star_init=0,
                max_steps=1,
                steps=60,
            ),
            "noncoop",
            4,
        )
        run.advance(60)
        values.append(run.memories[0]["q_star"][0, EAST])
    # the last time that it went there its peer came, or did not
    assert values[1] - values[0] in (0.0, pytest.approx(-20 * weight))
    assert learner_of("coop").task(drawn(credit=value)).weights.common == weight


def max_steps(value):
    run = learned(steps=400, grid="1........2", max_steps=value, epsilon="constant:0.9")
    assert run.history.length.max() == value


def horizon(value):
    assert crossing(horizon=value).mean("arrived") == (value >= 3)


def starts(value):
    kind, _, number = value.partition(":")
    world = World(drawn("1.......2", starts=value, steps=4000), 2)
    away = []
    for _ in range(300):
        away.append(world.cells[0] != 0)
        assert world.cells[0] != 8, "its goal"
        world.begin_episode()
    drawn_share = {"fixed": 0.0, "random": 1.0}.get(kind)
    due = (float(number) if drawn_share is None else drawn_share) * 7 / 8
    assert abs(np.mean(away) - due) < 0.1


def step_size(value):
    """An update moves the value 20 by so much toward 0.95 x 20."""
    run = learned(step_size=value, q_star_init=20)
    assert first_value(run) == pytest.approx(20 - float(value.partition(":")[2]))


def epsilon(value):
    scenario = drawn("1..2", epsilon=value)
    memory = untrained(scenario).memory
    memory["q_star"][:, EAST] = 50
    agent = Agent(learner_of("coop"), scenario, 0, 1, memory=memory)
    chosen = [agent.decide(t, 0).action for t in range(1, 500)]
    explored = 1 - np.mean(np.equal(chosen, EAST))
    assert abs(explored - 0.8 * float(value.partition(":")[2])) < 0.1


def q_star_init(value):
    assert (untrained(drawn(q_star_init=value)).q_star == value).all()


def q_coord_init(value):
    assert (untrained(drawn(q_coord_init=value)).q_coord == value).all()


def prior(value):
    """With the map a robot knows which way leads to its goal; without, all moves are equal."""
    moves = untrained(drawn("1..2", prior=value)).q_star[:3, :4]
    knows = (moves.argmax(axis=1) == EAST).all() and np.ptp(moves) > 0
    assert knows == (value == "map")


def prior_success(value):
    """One move from its goal a robot tries until it succeeds."""
    told = untrained(drawn("12", prior="map", prior_success=value)).q_star[0, EAST]
    assert told == pytest.approx(value * 200 / (1 - 0.95 * (1 - value)))


def goal_value(value):
    run = learned(
        grid="12",
        step_size="constant:1",
        goal_value=value,
        epsilon="constant:1",
        steps=30,
    )
    reached = run.memories[0]["updates"][0, EAST] > 0
    assert reached
    assert run.memories[0]["q_star"][0, EAST] == pytest.approx(10 + 0.95 * value)


def peers_seen(value):
    """Robots that are never answered learn Q^C all the same if they see their peers."""
    run = learned(steps=80, learner="coop", perception="never", peers_seen=value)
    assert (min(map(rows_in, run.memories)) > 0) == (value == "while_learning")


numbers = st.integers(0, 400).map(lambda number: number / 4)
LEGAL = {
    steps: st.integers(1, 300),
    goal_reward: numbers,
    penalty: numbers.map(lambda number: -number),
    common_reward: st.one_of(
        st.just("same"),
        st.tuples(numbers, numbers).map(lambda two: "each:{}:{}".format(*two)),
    ),
    ask_cost: numbers,
    discount: share,
    move_success: st.floats(0.2, 1),
    interactions: st.sampled_from(
        [
            "together",
            "together:anywhere",
            "together:any_doorway",
            "swap",
            "block",
            "block:anywhere",
            "together+swap",
            "together:anywhere+swap",
            "together+block",
        ]
    ),
    perception: st.one_of(
        st.sampled_from(["always", "never", "line_of_sight", "range:1", "range:3"]),
        share.map(lambda p: f"probability:{p:.3f}"),
    ),
    peers: st.sampled_from(["one", "all"]),
    credit: st.one_of(
        st.sampled_from(["own", "team"]), numbers.map("weight:{}".format)
    ),
    max_steps: st.integers(1, 60),
    horizon: st.integers(1, 9),
    starts: st.one_of(
        st.sampled_from(["fixed", "random"]), share.map("mixed:{:.3f}".format)
    ),
    step_size: share.map("constant:{:.4f}".format),
    epsilon: share.map("constant:{:.4f}".format),
    q_star_init: numbers,
    q_coord_init: numbers,
    prior: st.sampled_from(["none", "map"]),
    prior_success: share,
    goal_value: numbers,
    peers_seen: st.sampled_from(["when_asked", "while_learning"]),
}
"""For each setting, by the function that checks its effect, some of its legal values."""


def test_no_setting_is_forgotten():
    assert {effect.__name__ for effect in LEGAL} == set(SETTINGS)


@pytest.mark.parametrize("effect", LEGAL, ids=lambda effect: effect.__name__)
@settings(max_examples=6)
@given(data=st.data())
def test_a_setting_does_what_its_help_says(effect, data):
    effect(data.draw(LEGAL[effect]))
