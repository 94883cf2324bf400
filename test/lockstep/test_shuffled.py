# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""World and robots over a network that shuffles, doubles, delays and loses messages.

Whatever order messages come in, the tables must be those of `learn.simulation.learn`, bit for bit;
where messages are lost for good, exactly the transitions that they belonged to are not learned.
"""

import random
from collections import defaultdict, deque

import numpy as np
import pytest

from sparse_coord_ros.game.perception import MODELS
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.agent import Agent
from sparse_coord_ros.learn.factors import FactorRule
from sparse_coord_ros.learn.learners import Factored, learner_of
from sparse_coord_ros.learn.run_config import make_run
from sparse_coord_ros.learn.simulation import learn, tables_equal
from sparse_coord_ros.lockstep.robot_side import RobotSide
from sparse_coord_ros.lockstep.world_side import WorldSide

PROTOCOL = {
    "starts": "random",
    "step_size": "power:0.6",
    "epsilon": "linear:1:0.05:0.8",
    "q_star_init": 30,
    "q_coord_init": 200,
    "goal_value": 200,
    "max_steps": 1000,
}


def problem(name, **settings):
    return load_scenario(name).with_settings({**PROTOCOL, **settings})


PATIENCE = 3000
"""Deliveries without a time step after which deadlines pass (requests go to and fro meanwhile)."""

REPEAT = 250
"""Deliveries without a time step after which the world repeats itself, where it does."""


class SpyAgent(Agent):
    """Remembers what it learned from, as {step: (cell, reward, next cell)}."""

    def decide(self, step, cell):
        self.decided = step
        return super().decide(step, cell)

    def learn(self, step, cell, decision, action, perceived, reward, next_cell):
        seen = self.__dict__.setdefault("learned", {})
        assert self.decided not in seen
        seen[self.decided] = (cell, reward.total, next_cell)
        super().learn(step, cell, decision, action, perceived, reward, next_cell)


class Deaf(Factored):
    """Learns nothing from being asked."""

    name = None
    factors = FactorRule(share=False)


class RobotPort:
    def __init__(self, network, number):
        self.network, self.number = network, number

    def ask(self, peer, step, cell):
        self.network.put(("ask", self.number), (peer, step, cell))

    def act(self, step, action, account):
        self.network.put(("action", self.number), (step, action))

    def episode(self, step):
        pass

    def checkpoint(self, step):
        pass

    def percept(self, step, cell, perceived):
        self.network.percepts.append((self.number, step, cell, perceived))


class Network:
    """One FIFO queue a topic, or a direction of a service; which is served next is random.

    Args:
        scenario: the problem.
        shuffle: seed of the order of delivery.
        learner: "coop", "noncoop" or "factored", whose agents do not say what they learned.
        doubled: share of messages that come twice, at once or later.
        lost: tells from (topic, robot, message) whether a message is lost.
        heals: whether the world repeats itself when nothing moves any more.
    """

    def __init__(self, scenario, shuffle, *, learner="coop", doubled=0.0, lost=None, heals=False):
        run = make_run(scenario, {"seed": 5, "learner": learner})
        self.scenario, self.random = scenario, random.Random(shuffle)
        self.doubled, self.heals = doubled, heals
        self.lost = lost or (lambda topic, robot, message: False)
        self.queues = defaultdict(deque)
        self.held, self.holds = [], set()
        self.percepts, self.history, self.losses = [], defaultdict(dict), []
        self.repeats, self.step, self.stalled = 0, 0, 0
        self.world = WorldSide(run, self)
        numbers = range(len(scenario.robots))
        rule = learner_of(learner)
        if rule.factors is not None:
            self.agents = [rule.agent(scenario, k, run.seed) for k in numbers]
        else:
            self.agents = [SpyAgent(scenario, k, run.seed, asks=rule.asks) for k in numbers]
        self.robots = [RobotSide(run, self.agents[k], RobotPort(self, k)) for k in numbers]
        self.world.start()

    # The world's port.

    def state(self, robot, step, cell):
        self.history[robot].setdefault(step, {})["cell"] = cell
        self.put(("state", robot), (step, cell))

    def reward(self, robot, step, reward):
        self.history[robot][step]["reward"] = reward.total
        self.put(("reward", robot), (step, reward))

    def episode(self, step):
        pass

    # Delivery.

    def put(self, key, message):
        if self.lost(*key, message):
            self.losses.append((*key, message))
        elif key in self.holds:
            self.held.append((key, message))
        else:
            self.queues[key].append(message)

    def release(self):
        self.holds = set()
        for key, message in self.held:
            self.queues[key].append(message)

    def deliver(self):
        """Deliver one message; return whether there was one."""
        waiting = sorted(key for key, queue in self.queues.items() if queue)
        if not waiting:
            return False
        key = self.random.choice(waiting)
        message = self.queues[key].popleft()
        times = 1
        if self.random.random() < self.doubled:
            if self.random.random() < 0.5:
                times = 2
            else:
                self.queues[key].append(message)
        for _ in range(times):
            getattr(self, f"on_{key[0]}")(key[1], *message)
        return True

    def on_state(self, robot, step, cell):
        self.robots[robot].state(step, cell)

    def on_reward(self, robot, step, reward):
        self.robots[robot].reward(step, reward)

    def on_action(self, robot, step, action):
        if self.world.action(robot, step, action):
            self.world.advance()

    def on_ask(self, robot, peer, step, cell):
        self.put(("answer", robot), (peer, step, self.robots[peer].asked(robot, step, cell)))

    def on_answer(self, robot, peer, step, answer):
        self.robots[robot].answer(peer, step, answer)

    # Whole runs.

    def run(self, messages=None):
        """Deliver until the budget is used up and all is quiet, or so many messages."""
        while messages is None or messages > 0:
            if messages is not None:
                messages -= 1
            moves = self.deliver()
            if self.world.world.step != self.step:
                self.step, self.stalled = self.world.world.step, 0
            self.stalled += 1
            if moves and self.stalled % REPEAT:
                continue
            if self.heals and self.stalled < PATIENCE and not self.world.finished:
                self.repeats += 1
                self.stalled += -self.stalled % REPEAT  # nothing moves: straight to the next one
                self.world.repeat()
            elif (not moves or self.stalled >= PATIENCE) and not self.deadline():
                assert self.world.finished, "deadlock: nothing moves before the end"
                return

    def deadline(self):
        """Pass the robots' deadlines or, where they have none, the world's."""
        late = [robot for robot in self.robots if robot.waiting is not None]
        for robot in late:
            robot.expire()
        if late or self.world.finished:
            return bool(late)
        before = self.world.timeouts
        self.world.expire()
        return self.world.timeouts > before

    @property
    def tables(self):
        return [agent.tables for agent in self.agents]

    def transitions(self):
        """Return what could have been learned: (robot, step) with a reward from the world."""
        return {
            (robot, step)
            for robot, steps in self.history.items()
            for step, seen in steps.items()
            if "reward" in seen
        }

    def learned(self):
        """Return what the robots learned, each checked against what really happened."""
        for robot, agent in enumerate(self.agents):
            history = self.history[robot]
            for step, (cell, reward, next_cell) in agent.learned.items():
                assert cell == history[step]["cell"]
                assert reward == history[step]["reward"]
                assert next_cell == history[step + 1]["cell"]
        return {(k, step) for k, agent in enumerate(self.agents) for step in agent.learned}


CASES = [
    ("env1", {"perception": "probability:0.7", "steps": 800}),
    ("env1", {"perception": "probability:0.7", "steps": 600, "max_steps": 25}),
    ("env1", {"perception": "line_of_sight", "steps": 600, "starts": "fixed", "max_steps": 60}),
    ("env2-4r", {"perception": "probability:0.7", "steps": 500}),
    ("env2-4r", {"perception": "probability:0.7", "steps": 400, "max_steps": 15}),
    ("crowd-3r", {"perception": "probability:0.7", "steps": 400, "peers": "all"}),
    (
        "env2-4r",
        {"perception": "range:4", "steps": 300, "peers": "all", "common_reward": "each:1:0:2:3"},
    ),
]


@pytest.mark.parametrize("shuffle", range(4))
@pytest.mark.parametrize(("name", "settings"), CASES)
def test_any_order_gives_the_same_bits(name, settings, shuffle):
    scenario = problem(name, **settings)
    network = Network(scenario, shuffle)
    network.run()
    assert tables_equal(network.tables, learn(scenario, "coop", 5))
    assert network.learned() == network.transitions()
    assert (network.world.timeouts, network.world.stale) == (0, 0)
    assert [robot.dropped for robot in network.robots] == [0] * len(network.robots)
    asks = [robot.asks for robot in network.robots]
    assert sum(ask["late"] for ask in asks) == 0
    assert sum(ask["repeated"] for ask in asks) > 0  # some requests came before the state
    for k, ask in enumerate(asks):
        outcomes = [cell for robot, _, _, cell in network.percepts if robot == k]
        assert ask["answered"] == sum(cell is not None for cell in outcomes) > 0
        assert ask["refused"] == sum(cell is None for cell in outcomes) > 0


@pytest.mark.parametrize("doubled", [0.1, 0.6])
@pytest.mark.parametrize("shuffle", range(3))
@pytest.mark.parametrize(("name", "settings"), CASES)
def test_doubled_messages_change_no_bit(name, settings, shuffle, doubled):
    scenario = problem(name, **settings)
    network = Network(scenario, shuffle, doubled=doubled)
    network.run()
    assert tables_equal(network.tables, learn(scenario, "coop", 5))
    assert network.learned() == network.transitions()
    assert network.world.timeouts == 0
    assert network.world.stale > 0


@pytest.mark.parametrize("shuffle", range(3))
def test_all_peers_are_those_of_one_time_step(shuffle):
    """What is perceived is the joint state of the step, however late the requests come."""
    scenario = problem("crowd-3r", steps=400, peers="all")
    network = Network(scenario, shuffle, doubled=0.3)
    network.run()
    assert len(network.percepts) > 20
    for robot, step, cell, perceived in network.percepts:
        cells = [network.history[k][step]["cell"] for k in range(3)]
        assert cells.pop(robot) == cell
        assert perceived == tuple(cells)


def test_one_of_three_that_never_answers_fails_every_percept():
    scenario = problem("crowd-3r", steps=300, peers="all")
    network = Network(scenario, 4)
    network.lost = lambda topic, robot, message: topic == "ask" and message[0] == 2
    network.run()
    assert [robot.asks["late"] > 0 for robot in network.robots] == [True, True, False]
    assert [robot.asks["answered"] > 0 for robot in network.robots] == [False, False, True]
    assert network.learned() == network.transitions()


def test_perception_that_works_one_way(monkeypatch):
    """The shipped models are symmetric; one that is not tells asker and asked apart."""
    one_way = lambda grid: np.triu(np.ones((len(grid.cells), len(grid.cells))))  # noqa: E731
    monkeypatch.setitem(MODELS._known, "never", one_way)
    scenario = problem("env1", steps=400, perception="never")
    network = Network(scenario, 1)
    network.run()
    assert tables_equal(network.tables, learn(scenario, "coop", 5))


def test_percepts_are_those_of_the_simulation_whatever_the_order():
    scenario = problem("env2-4r", perception="probability:0.7", steps=300)
    networks = [Network(scenario, shuffle) for shuffle in (0, 1)]
    for network in networks:
        network.run()
    one, other = (sorted(network.percepts, key=str) for network in networks)
    assert one == other
    assert networks[0].percepts != networks[1].percepts  # the order did differ


@pytest.mark.parametrize("name", ["env1", "env2-4r"])
def test_noncoop(name):
    scenario = problem(name, steps=400, max_steps=50)
    network = Network(scenario, 1, learner="noncoop", doubled=0.2)
    network.run()
    assert tables_equal(network.tables, learn(scenario, "noncoop", 5))
    assert network.percepts == []


@pytest.mark.parametrize("shuffle", range(4))
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("env1", {"perception": "probability:0.7", "steps": 1500}),
        ("env1", {"perception": "line_of_sight", "steps": 3000, "max_steps": 40, "credit": 3}),
        ("env2-4r", {"perception": "probability:0.7", "steps": 800, "conflict": "any_doorway"}),
        ("env2-4r", {"perception": "range:5", "steps": 800, "peers": "all"}),
        ("env2-4r", {"steps": 600, "referee": False}),
    ],
)
def test_factored_learns_from_being_asked_whatever_the_order(name, settings, shuffle):
    given = {"step_size": "floored:0.5:0.1:0.01", "epsilon": "constant:0.9", "max_steps": 20}
    given |= {"penalty": -60, "q_coord_init": 20, **settings}
    scenario = learner_of("factored").with_defaults(problem(name, **given))
    network = Network(scenario, shuffle, learner="factored", doubled=0.2 * (shuffle % 2))
    network.run()
    learned = learn(scenario, "factored", 5)
    assert tables_equal(network.tables, learned)
    assert any(len(tables.factors.states) for tables in learned)
    assert not tables_equal(learned, learn(scenario, Deaf, 5))  # being asked did teach something
    assert (network.world.timeouts, network.world.stale > 0) == (0, shuffle % 2 == 1)


# Losses that the world heals.


def heals(kinds, share, seed):
    """Lose messages of some topics, but no robot's last words: arrivals, and the run's end."""
    draws = random.Random(seed)

    def lost(topic, robot, message):
        if topic not in kinds or draws.random() >= share:
            return False
        world = network.world
        if topic == "action":
            return True
        if world.finished or message[1] == network.scenario.robots[robot].goal:
            return False
        return topic == "state" or message[1].individual == 0.0

    network = Network(problem("env1", steps=600, perception="probability:0.7"), seed, heals=True)
    network.lost = lost
    return network


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "kinds", [("state",), ("action",), ("reward",), ("state", "action", "reward")]
)
def test_repetition_heals_lost_messages(kinds, seed):
    network = heals(kinds, 0.08, seed)
    network.run()
    assert {topic for topic, _, _ in network.losses} == set(kinds)
    assert len(network.losses) > 20
    assert network.repeats > 0
    assert tables_equal(network.tables, learn(network.scenario, "coop", 5))
    assert network.learned() == network.transitions()
    assert network.world.timeouts == 0
    assert [robot.dropped for robot in network.robots] == [0, 0]


def test_repetition_when_nothing_is_lost_changes_nothing():
    network = Network(problem("env1", steps=300), 2)
    repeated = 0
    while network.deliver():
        if network.random.random() < 0.2 and not network.world.finished:
            network.world.repeat()
            repeated += 1
    assert repeated > 100
    assert tables_equal(network.tables, learn(network.scenario, "coop", 5))


# Losses for good.


def first(kind, wanted=lambda message: True, after=20):
    """Lose the first message of a kind (of robot 0, after some steps) and all its repetitions."""
    gone = []

    def lost(topic, robot, message):
        step = message[0]
        if topic != kind or robot != 0 or step <= after:
            return False
        if not gone and wanted(message):
            gone.append(step)
        return gone == [step]

    return lost


@pytest.mark.parametrize("heal", [False, True])
@pytest.mark.parametrize("arrival", [False, True])
def test_a_reward_lost_for_good_is_one_transition_not_learned(heal, arrival):
    def wanted(message):
        return (message[1].individual > 0) is arrival

    scenario = problem("env1", steps=600, perception="probability:0.7")
    network = Network(scenario, 3, lost=first("reward", wanted), heals=heal)
    network.run()
    step = network.losses[0][2][0]
    assert network.transitions() - network.learned() == {(0, step)}
    assert [robot.dropped for robot in network.robots] == [1, 0]
    assert network.world.timeouts == 0
    assert network.world.world.transitions == 600
    assert not tables_equal(network.tables, learn(scenario, "coop", 5))


def test_a_state_lost_for_good_is_two_transitions_not_learned():
    """Neither the one that led there nor the one from there; the world goes on without."""
    scenario = problem("env1", steps=600)
    not_goal = lambda message: message[1] != scenario.robots[0].goal  # noqa: E731
    network = Network(scenario, 3, lost=first("state", not_goal))
    network.run()
    step = network.losses[0][2][0]
    assert (0, step) not in network.transitions()  # no action, no reward
    assert network.transitions() - network.learned() == {(0, step - 1)}
    assert network.world.timeouts == 1
    assert network.world.absent == set()
    assert network.world.world.transitions == 600


@pytest.mark.parametrize("direction", ["ask", "answer"])
@pytest.mark.parametrize("name", ["env1", "env2-4r"])
def test_a_team_that_never_answers_learns_as_without_perception(name, direction):
    """Every deadline becomes a failed percept: the tables of perception "never", bit for bit."""
    scenario = problem(name, steps=400, perception="always")
    network = Network(scenario, 4, lost=lambda topic, robot, message: topic == direction)
    network.run()
    blind = problem(name, steps=400, perception="never")
    assert tables_equal(network.tables, learn(blind, "coop", 5))
    assert network.learned() == network.transitions()
    for robot in network.robots:
        assert robot.asks["late"] > 0
        assert robot.asks["answered"] == robot.asks["refused"] == robot.dropped == 0
    assert all(cell is None for *_, cell in network.percepts)
    assert len(network.percepts) == sum(robot.asks["late"] for robot in network.robots)


def test_one_robot_that_never_answers():
    scenario = problem("env2-4r", steps=400, perception="always")
    network = Network(scenario, 4)
    network.lost = lambda topic, robot, message: topic == "ask" and message[0] == 2
    network.run()
    assert network.learned() == network.transitions()
    assert [robot.asks["late"] > 0 for robot in network.robots] == [True, True, False, True]
    assert all(robot.asks["answered"] > 0 for robot in network.robots)
    assert network.world.world.transitions == 400


def test_a_late_robot_is_left_out_and_taken_back():
    scenario = problem("env1", steps=600, perception="probability:0.7")
    network = Network(scenario, 6)
    network.run(messages=300)
    late = network.robots[1]
    network.holds = {("action", 1)}
    while network.world.absent != {1}:
        network.run(messages=1)
    (missed,) = {message[0] for _, message in network.held}
    assert network.world.timeouts == 1
    before = network.world.world.transitions
    network.run(messages=100)
    assert network.world.world.transitions > before + 10  # the other one goes on
    assert late.waiting == ("reward", missed)
    network.release()
    network.run(messages=20)
    assert network.world.absent == set()
    assert network.world.stale == 1
    network.run()
    assert late.dropped == 1
    assert network.world.timeouts == 1
    assert network.learned() == network.transitions()
    assert (1, missed) not in network.learned()
    assert max(network.agents[1].learned) > missed + 100  # it learns again
    assert network.world.world.transitions == 600


@pytest.mark.parametrize("name", ["env1", "env2-4r"])
def test_a_robot_that_is_away_for_a_while(name):
    """Its process stopped: it hears, says and answers nothing; later it is back."""
    scenario = problem(name, steps=600, perception="probability:0.7", max_steps=80)
    away = []

    def lost(topic, robot, message):
        if not away:
            return False
        return robot == 1 or (topic == "ask" and message[0] == 1)

    network = Network(scenario, 8, lost=lost, heals=True)
    network.run(messages=500)
    before = network.world.world.transitions
    away.append(True)
    network.run(messages=600)
    assert 1 in network.world.absent
    assert network.world.world.transitions > before + 20
    last = max(network.agents[1].learned)
    assert sum(robot.asks["late"] for robot in network.robots) > 0
    away.clear()
    back = network.world.world.step
    network.run()
    assert network.world.absent == set()
    learned = network.learned()
    assert not {step for robot, step in learned if robot == 1} & set(range(last + 1, back - 1))
    assert max(network.agents[1].learned) > back + 50
    assert network.world.timeouts > 0
    assert network.world.world.transitions == 600
    assert network.learned() <= network.transitions()


def test_a_team_without_any_robot_is_waited_for():
    network = Network(problem("env1", steps=50), 0, lost=lambda topic, *_: topic == "action")
    with pytest.raises(AssertionError, match="deadlock"):
        network.run()
    assert network.world.world.transitions == 0
    assert network.world.timeouts == 0
    assert network.world.absent == set()
