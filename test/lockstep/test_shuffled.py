# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""World and robots over a network that shuffles, doubles, delays and loses messages.

With messages in any order, the tables must be those of `teams.learn`, bit for bit. If messages
are lost for good, exactly their transitions are not learned.
"""

import random

import numpy as np
import pytest
from teams import PROTOCOL, learn, tables_equal

from sparse_coord_ros.core.game.perception import MODELS
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of

from .team import Team


def problem(name, **settings):
    return load_scenario(name).with_settings({**PROTOCOL, **settings})


def played(scenario, seed, **network):
    """Return a team that has played its run without checkpoints."""
    return Team(scenario, seed, checkpoint=0, **network).play()


def sides(team):
    return [team.up[k].side for k in range(team.robots)]


def asks(team, how):
    return [side.asks[how] for side in sides(team)]


ASKED = {
    "step_size": "floored:0.5:0.1:0.01",
    "epsilon": "constant:0.9",
    "max_steps": 20,
    "penalty": -60,
    "q_coord_init": 20,
}
"""Settings with which robots of voi are asked often."""

SEEN = {"peers_seen": "while_learning"}

SHUFFLES = [0, *(pytest.param(k, marks=pytest.mark.long) for k in range(1, 4))]
"""Seeds of the order of delivery."""

CASES = [
    pytest.param("env1", "coop", {"max_steps": 25, "steps": 600}, 0.4, id="two"),
    pytest.param("env1", "noncoop", {"max_steps": 25}, 0.4, id="nobody asks"),
    pytest.param("env1", "cq", {"perception": "always"}, 0.0, id="marked cells"),
    pytest.param("env2-4r", "coop", {"max_steps": 15}, 0.0, id="four"),
    pytest.param("crowd-3r", "coop", {"peers": "all"}, 0.4, id="all are asked"),
    pytest.param("env1", "joint", {"perception": "always"}, 0.2, id="joint"),
    pytest.param("crowd-3r", "coop", {"peers": "all", **SEEN}, 0.4, id="peers seen"),
    pytest.param("env1", "voi", {"steps": 600, **ASKED}, 0.2, id="voi"),
    pytest.param("env2-4r", "voi", ASKED, 0.0, id="voi, four"),
    pytest.param("env2-4r", "voi", {**ASKED, **SEEN}, 0.4, id="voi, peers seen"),
]
"""Each learner that runs live, and the share of messages that come twice."""


@pytest.mark.parametrize("shuffle", SHUFFLES)
@pytest.mark.parametrize(("name", "learner", "settings", "doubled"), CASES)
def test_any_order_gives_the_same_bits(name, learner, settings, doubled, shuffle):
    """Also if messages come twice."""
    given = {"steps": 300, "perception": "probability:0.7", **settings}
    scenario = learner_of(learner).with_defaults(problem(name, **given))
    team = played(scenario, shuffle, learner=learner, doubled=doubled)
    assert tables_equal(team.tables, learn(scenario, learner, 5))
    assert team.check_updates() == set()
    assert (team.world.side.timeouts, team.world.side.stale > 0) == (0, doubled > 0)
    assert [side.dropped for side in sides(team)] == [0] * team.robots
    assert sum(asks(team, "late")) == 0
    for k in range(team.robots):
        outcomes = [cell for robot, _, _, cell in team.percepts if robot == k]
        answered = sum(cell is not None for cell in outcomes)
        assert asks(team, "answered")[k] == answered
        assert asks(team, "refused")[k] == len(outcomes) - answered
        assert (answered > 0) == (learner != "noncoop")


def test_the_cases_show_what_they_are_for():
    """A robot learns from peers' questions; a peer that is behind is asked again."""
    scenario = learner_of("voi").with_defaults(problem("env1", steps=600, **ASKED))
    learned = learn(scenario, "voi", 5)
    assert any(len(tables.memory["steps_keys"]) for tables in learned)
    asking = problem("env1", steps=300, perception="probability:0.7")
    assert sum(asks(played(asking, 0), "repeated")) > 0


def test_one_of_three_that_never_answers_fails_every_percept():
    scenario = problem("crowd-3r", steps=300, peers="all")
    team = played(
        scenario, 4, lost=lambda topic, to, message: (topic, to) == ("ask", 2)
    )
    assert [late > 0 for late in asks(team, "late")] == [True, True, False]
    assert [answered > 0 for answered in asks(team, "answered")] == [False, False, True]
    assert team.check_updates() == set()


def test_perception_that_works_one_way():
    """The shipped models are symmetric; one that is not tells asker and asked apart."""

    def one_way(grid):
        return np.triu(np.ones((len(grid.cells), len(grid.cells))))

    MODELS.register("one_way", one_way)
    scenario = problem("env1", steps=400, perception="one_way")
    team = played(scenario, 1)
    assert tables_equal(team.tables, learn(scenario, "coop", 5))


@pytest.mark.parametrize("seed", SHUFFLES)
@pytest.mark.parametrize(
    "kinds",
    [
        ("state",),
        ("peer_state",),
        ("action",),
        ("reward",),
        ("state", "action", "reward"),
    ],
)
def test_repetition_heals_lost_messages(kinds, seed):
    """Except a robot's last messages, which come once: arrivals, and the run's end."""
    seen = SEEN if "peer_state" in kinds else {}
    scenario = problem("env1", steps=600, perception="probability:0.7", **seen)
    draws = random.Random(seed)

    def lost(topic, to, message):
        if topic not in kinds or draws.random() >= 0.08:
            return False
        if topic == "action":
            return True
        if topic == "peer_state":
            return not (team.over or team.world.side.world.arrived[to])
        if team.over or message[1] == scenario.robots[to].goal:
            return False
        return topic == "state" or message[1].individual == 0.0

    team = Team(scenario, seed, checkpoint=0, lost=lost)
    team.play()
    assert {topic for topic, _, _ in team.losses} == set(kinds)
    assert len(team.losses) > 20
    assert tables_equal(team.tables, learn(scenario, "coop", 5))
    assert team.check_updates() == set()
    assert team.world.side.timeouts == 0
    assert [side.dropped for side in sides(team)] == [0, 0]


def first(kind, wanted, after=20):
    """Lose the first message of a kind (to robot 0, after some steps) and all its repetitions."""
    gone = []

    def lost(topic, to, message):
        step = message[0]
        if (topic, to) != (kind, 0) or step <= after:
            return False
        if not gone and wanted(message):
            gone.append(step)
        return gone == [step]

    return lost


@pytest.mark.parametrize("arrival", [False, True])
def test_a_reward_lost_for_good_is_one_transition_not_learned(arrival):
    scenario = problem("env1", steps=600, perception="probability:0.7")
    lost = first("reward", lambda message: (message[1].individual > 0) is arrival)
    team = played(scenario, 3, lost=lost)
    assert team.check_updates() == {(0, team.losses[0][2][0])}
    assert [side.dropped for side in sides(team)] == [1, 0]
    assert (team.world.side.timeouts, team.world.side.world.transitions) == (0, 600)
    assert not tables_equal(team.tables, learn(scenario, "coop", 5))


def test_a_state_lost_for_good_is_two_transitions_not_learned():
    """The transitions to it and from it are not learned; the world continues without the robot."""
    scenario = problem("env1", steps=600)
    lost = first("state", lambda message: message[1] != scenario.robots[0].goal)
    team = played(scenario, 3, lost=lost)
    step = team.losses[0][2][0]
    assert step not in {one for one, *_ in team.happened[0]}  # no action, no reward
    assert team.check_updates() == {(0, step - 1)}
    assert (team.world.side.timeouts, team.world.side.absent) == (1, set())


def test_a_peers_state_lost_for_good_is_as_an_own_state_lost_for_good():
    scenario = problem("env1", steps=600, **SEEN)
    lost = first("peer_state", lambda message: message[1] != scenario.robots[1].goal)
    team = played(scenario, 3, lost=lost)
    step = team.losses[0][2][0]
    assert step not in {one for one, *_ in team.happened[0]}  # no action, no reward
    assert team.check_updates() == {(0, step - 1)}
    assert (team.world.side.timeouts, team.world.side.absent) == (1, set())
    assert [side.dropped for side in sides(team)] == [1, 0]


@pytest.mark.parametrize("direction", ["ask", "answer"])
def test_a_team_that_never_answers_learns_as_without_perception(direction):
    """Every deadline becomes a failed percept: the tables of perception "never", bit for bit."""
    scenario = problem("env2-4r", steps=400, perception="always")
    team = played(scenario, 4, lost=lambda topic, to, message: topic == direction)
    blind = problem("env2-4r", steps=400, perception="never")
    assert tables_equal(team.tables, learn(blind, "coop", 5))
    assert team.check_updates() == set()
    assert min(asks(team, "late")) > 0 and len(team.percepts) == sum(asks(team, "late"))
    assert sum(asks(team, "answered") + asks(team, "refused")) == 0
    assert all(cell is None for *_, cell in team.percepts)


def test_a_robot_that_stands_still_for_a_while_is_left_out_and_taken_back():
    scenario = problem("env2-4r", steps=600, perception="probability:0.7", max_steps=80)
    seen = []

    def wakes(team):
        seen.append((set(team.world.side.absent), team.world.side.world.step))
        team.asleep.clear()

    team = Team(scenario, 8, checkpoint=0)
    team.play([(900, lambda team: team.asleep.add(1)), (4000, wakes)])
    ((absent, back),) = seen
    assert absent == {1} and team.world.side.absent == set()
    assert sum(asks(team, "late")) > 0 and team.world.side.timeouts > 0
    team.check_updates()
    learned = [step for step, *_ in team.up[1].side.agent.learned]
    assert max(learned) > back + 50
