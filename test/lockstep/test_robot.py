# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One robot's side of the lock step, message by message."""

import numpy as np
import pytest
from teams import tables_from_values

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.lockstep.robot_side import Answer, RobotSide
from sparse_coord_ros.protocol.wire import COUNTS, PerceptEnd, SelfReport

SOUTH = 1
EAST = 2
ASKING_CELL = 5
GOAL = 20
SETTINGS = {
    "step_size": "constant:0.5",
    "epsilon": "constant:0",
    "max_steps": 50,
    "steps": 100,
}


class Port:
    """Records the robot's actions."""

    def __init__(self):
        self.done = []
        self.episodes = []
        self.reports = []

    def ask(self, peer, step, cell):
        self.done.append(("ask", peer, step, cell))

    def act(self, step, action, report):
        self.done.append(("act", step, action))
        self.reports.append(tuple(report))

    def percept(self, step, cell, perceived):
        self.done.append(("percept", step, cell, perceived))

    def episode(self, step):
        self.episodes.append(step)

    def checkpoint(self, step):
        self.done.append(("checkpoint", step))

    def take(self):
        done = self.done
        self.done = []
        return done


def make_robot(*, run=None, **settings):
    """Return robot 1 of env1 (goal: cell 20) and its port; it goes south, and asks in cell 5."""
    scenario = load_scenario("env1").with_settings({**SETTINGS, **settings})
    q_star = np.tile([0.0, 9.0, 1.0, 2.0, 3.0], (21, 1))
    q_star[ASKING_CELL] = [0, 1, 2, 3, 50]
    q_coord = np.zeros((21, 21, 4))
    q_coord[ASKING_CELL, :, EAST] = 7.0
    memory = tables_from_values(scenario, 0, q_star, q_coord).memory
    agent = Agent(Coop(), scenario, 0, 0, memory=memory)
    port = Port()
    return RobotSide(make_run(scenario, run or {}), agent, port), port


@pytest.fixture
def made():
    return make_robot()


@pytest.fixture
def robot(made):
    return made[0]


@pytest.fixture
def port(made):
    return made[1]


GO = Action(SOUTH, False, -1, False)


def q_star(robot, cell, action):
    return float(robot.agent.tables.q_star[cell, action])


LEARNED = 0.5 * 9 + 0.5 * (4 + 0.95 * 9)
"""Q*(x, south) after the reward 4 for a move to a cell with value 9."""


def test_a_state_is_answered_once(robot, port):
    robot.state(1, 0)
    assert port.take() == [("act", 1, GO)]
    assert robot.newest == (1, 0)
    assert robot.waiting is None


@pytest.mark.parametrize("gap", [2, 3, 50])
def test_nothing_is_learned_across_a_gap(robot, port, gap):
    before = robot.agent.tables.q_star.copy()
    robot.state(1, 0)
    robot.reward(1, Reward(4.0, 0.0, 0.0, 4.0))
    robot.state(1 + gap, 1)
    assert (robot.agent.tables.q_star == before).all()
    assert port.take() == [("act", 1, GO), ("act", 1 + gap, GO)]
    assert robot.dropped == 0


def test_an_arrived_robot_learns_rests_and_answers(robot, port):
    robot.state(1, 0)
    robot.reward(1, Reward(10.0, 0.0, 0.0, 10.0))
    robot.state(2, GOAL)
    assert q_star(robot, 0, SOUTH) == 0.5 * 9 + 0.5 * (10 + 0.95 * 200)
    robot.state(3, GOAL)
    robot.state(3, GOAL)
    assert [done[1] for done in port.take()] == [1]
    assert robot.asked(1, 3, 4) == Answer(3, GOAL)
    robot.state(5, 0)
    assert port.take() == [("act", 5, GO)]


def walk(robot, first, steps):
    """Let a robot make so many transitions between free cells."""
    robot.state(first, 0)
    for step in range(first, first + steps):
        robot.reward(step, Reward(0.0, 0.0, 0.0, 0.0))
        robot.state(step + 1, 1)


def test_no_action_after_the_episode_s_last_step():
    robot, port = make_robot(max_steps=3)
    walk(robot, 1, 3)
    assert [done[1] for done in port.take()] == [1, 2, 3]
    walk(robot, 6, 2)
    assert [done[1] for done in port.take()] == [6, 7, 8]


def test_no_action_after_the_budget():
    robot, port = make_robot(steps=3)
    walk(robot, 1, 3)
    assert [done[1] for done in port.take()] == [1, 2, 3]
    assert robot.agent.tables.q_star[1, SOUTH] != 9.0  # the last transition is learned
    robot.state(*robot.newest)  # the last state comes twice
    assert port.take() == []


def test_a_missed_end_is_mended_by_repetition():
    """A robot that believes the episode over acts when the world asks again."""
    robot, port = make_robot(max_steps=3)
    walk(robot, 1, 3)
    port.take()
    robot.state(4, 1)
    assert port.take() == [("act", 4, GO)]


# Asking.


def asking(robot, port, step=1):
    robot.state(step, ASKING_CELL)
    assert port.take() == [("ask", 1, step, ASKING_CELL)]
    assert robot.waiting == ("percept", step)
    assert robot.asking == 1


def test_an_answer_becomes_the_percept(robot, port):
    asking(robot, port)
    robot.answer(1, 1, Answer(1, 17))
    action = Action(EAST, True, 1, True)
    assert port.take() == [("percept", 1, ASKING_CELL, (17,)), ("act", 1, action)]
    assert robot.asks == {"answered": 1, "refused": 0, "late": 0, "repeated": 0}
    assert (robot.waiting, robot.asking) == (None, -1)
    robot.reward(1, Reward(4.0, 0.0, 0.0, 4.0))
    robot.state(2, 1)
    assert robot.agent.tables.q_coord[ASKING_CELL, 17, EAST] == 0.5 * 7 + 0.5 * (
        4 + 0.95 * 9
    )
    assert q_star(robot, ASKING_CELL, 4) == 0.5 * 50 + 0.5 * (4 + 0.95 * 9)


@pytest.mark.parametrize("answer", [Answer(1, None), Answer(2, 17), Answer(2, None)])
def test_a_refusal_is_a_failed_percept(robot, port, answer):
    """So is the state of a later step: only states of the same step are a joint state."""
    asking(robot, port)
    robot.answer(1, 1, answer)
    action = Action(3, True, 1, False)
    assert port.take() == [("percept", 1, ASKING_CELL, None), ("act", 1, action)]
    assert robot.asks == {"answered": 0, "refused": 1, "late": 0, "repeated": 0}


@pytest.mark.parametrize("cell", [None, 17])
def test_a_peer_behind_is_asked_again(robot, port, cell):
    asking(robot, port, step=3)
    robot.answer(1, 3, Answer(2, cell))
    assert port.take() == [("ask", 1, 3, ASKING_CELL)]
    assert robot.asks["repeated"] == 1
    assert robot.waiting == ("percept", 3)
    robot.answer(1, 3, Answer(3, 17))
    assert port.take()[0] == ("percept", 3, ASKING_CELL, (17,))


def test_a_repeated_state_does_not_ask_twice(robot, port):
    asking(robot, port)
    robot.state(1, ASKING_CELL)
    assert port.take() == []


def test_the_deadline_of_a_percept(robot, port):
    asking(robot, port)
    robot.expire()
    action = Action(3, True, 1, False)
    assert port.take() == [("percept", 1, ASKING_CELL, None), ("act", 1, action)]
    assert robot.asks["late"] == 1
    robot.answer(1, 1, Answer(1, 17))
    assert port.take() == []
    assert robot.asks["answered"] == 0


def test_the_deadline_of_a_reward(robot, port):
    before = robot.agent.tables.q_star.copy()
    robot.state(1, 0)
    robot.state(2, 1)
    port.take()
    robot.expire()
    assert robot.dropped == 1
    assert port.take() == [("act", 2, GO)]
    robot.reward(1, Reward(4.0, 0.0, 0.0, 4.0))
    assert (robot.agent.tables.q_star == before).all()


def test_a_deadline_with_nothing_to_wait_for(robot, port):
    robot.expire()
    robot.state(1, 0)
    port.take()
    robot.expire()
    assert port.take() == []
    assert (robot.dropped, robot.asks["late"]) == (0, 0)


def test_the_world_goes_on_while_the_robot_asks(robot, port):
    asking(robot, port)
    robot.state(2, 1)
    assert port.take() == [("act", 2, GO)]
    assert sum(robot.asks.values()) == 0, "no action came of it"
    robot.answer(1, 1, Answer(1, 17))
    assert port.take() == []


# Answering.


def test_answers_by_step(robot):
    robot.state(4, 0)
    assert robot.asked(1, 4, 3) == Answer(4, 0)
    assert robot.asked(1, 5, 3) == Answer(4, None)  # not there yet
    assert robot.asked(1, 3, 3) == Answer(4, None)  # past that
    assert robot.asked(1, 4, None) == Answer(4, None)  # the asker is nowhere


def test_before_any_state_there_is_nothing_to_say(robot):
    assert robot.asked(1, 1, 3) == Answer(0, None)
    assert robot.asked(1, 0, None) == Answer(0, None)


def test_a_person_gets_the_newest_state_whatever_the_model():
    robot, port = make_robot(perception="never")
    robot.state(4, 0)
    assert robot.asked(1, 0, None) == Answer(4, 0)
    assert robot.asked(1, 4, 3) == Answer(4, None)


def test_the_model_decides_from_both_places():
    robot, port = make_robot(perception="line_of_sight")
    robot.state(1, 0)  # the north-west corner
    assert robot.asked(1, 1, 3).cell is None  # behind the wall
    assert robot.asked(1, 1, 1).cell == 0


def test_checkpoints_and_episodes_are_told_before_the_action():
    robot, port = make_robot(run={"checkpoint": 5})
    robot.state(4, 0)
    assert port.take() == [("act", 4, GO)]
    robot.state(5, 1)
    assert port.take() == [], "not before the reward, which belongs to what was learned"
    robot.reward(4, Reward(4.0, 0.0, 0.0, 4.0))
    assert port.take() == [("checkpoint", 5), ("act", 5, GO)]
    assert robot.handled == 5
    robot.state(12, 0)
    assert port.take() == [("checkpoint", 12), ("act", 12, GO)]
    assert port.episodes == [4, 12]


def test_no_checkpoint_at_the_first_state_or_where_none_is_wanted():
    for checkpoint, first in ((5, 7), (0, 1)):
        robot, port = make_robot(run={"checkpoint": checkpoint})
        assert robot.handled == 0
        robot.state(first, 0)
        assert port.take() == [("act", first, GO)]


# Its self-report.


def test_each_action_says_how_its_percept_ended_and_whether_it_has_learned(robot, port):
    robot.state(1, 0)  # goes: nothing learned before
    robot.reward(1, Reward(0.0, 0.0, 0.0, 0.0))
    robot.state(2, ASKING_CELL)
    robot.answer(1, 2, Answer(2, 17))
    robot.state(3, ASKING_CELL)  # no reward comes
    robot.expire()
    robot.answer(1, 3, Answer(3, None))
    robot.reward(3, Reward(0.0, 0.0, 0.0, 0.0))
    robot.state(4, ASKING_CELL)
    robot.expire()
    robot.reward(4, Reward(0.0, 0.0, 0.0, 0.0))
    robot.state(5, 20)
    assert port.reports == [
        (PerceptEnd.DID_NOT_ASK, False),
        (PerceptEnd.ANSWERED, True),
        (PerceptEnd.REFUSED, False),
        (PerceptEnd.LATE, True),
    ]
    robot.state(4, ASKING_CELL)
    assert robot.counts == {
        **{"answered": 1, "refused": 1, "late": 1, "repeated": 0},
        **{"dropped": 1, "learned": 3, "step": 5},
    }
    assert set(robot.counts) == set(COUNTS)


def test_what_a_robot_said_of_itself_is_known_until_the_step_is_over(robot):
    robot.state(1, 0)
    said = SelfReport(PerceptEnd.DID_NOT_ASK, False)
    assert robot.self_report_of(1) == said and robot.self_report_of(2) is None
    robot.state(2, ASKING_CELL)
    robot.expire()  # the reward does not come
    assert robot.self_report_of(1) is None
    assert robot.self_report_of(2) is None, "it asks"
    robot.answer(1, 2, Answer(2, 3))
    assert robot.self_report_of(2) == SelfReport(PerceptEnd.ANSWERED, False)
    robot.reward(2, Reward(4.0, 0.0, 0.0, 4.0))
    robot.state(3, GOAL)
    assert robot.self_report_of(3) is None, "it rests"


def test_an_action_said_again_says_the_same_of_itself(robot, port):
    robot.state(1, 0)
    robot.reward(1, Reward(0.0, 0.0, 0.0, 0.0))
    robot.state(2, 1)
    robot.state(2, 1)
    assert port.reports == [
        (PerceptEnd.DID_NOT_ASK, False),
        (PerceptEnd.DID_NOT_ASK, True),
        (PerceptEnd.DID_NOT_ASK, True),
    ]


def test_a_reward_is_for_one_transition_only(robot):
    """The earlier action's reward does not replace one that has not come yet."""
    robot.state(1, 0)
    robot.reward(1, Reward(0.0, 0.0, 0.0, 0.0))
    robot.state(2, 1)
    robot.state(3, 2)
    assert robot.waiting == ("reward", 2) and robot.learned == 1


def test_a_robot_that_rests_waits_for_no_answer_any_more():
    """The world continued without it, into the episode's last state."""
    robot, port = make_robot(max_steps=1)
    robot.state(1, ASKING_CELL)
    assert robot.waiting == ("percept", 1)
    robot.state(2, ASKING_CELL)
    assert robot.waiting is None
    port.take()
    robot.answer(1, 1, Answer(1, 7))
    assert port.take() == []
    assert set(robot.asks.values()) == {0}


def test_a_robot_that_does_not_learn_says_so(robot, port):
    robot.agent.learning = False
    robot.state(1, 0)
    robot.reward(1, Reward(4.0, 0.0, 0.0, 4.0))
    robot.state(2, 1)
    assert port.reports == [(PerceptEnd.DID_NOT_ASK, False)] * 2
    assert (robot.counts["learned"], robot.counts["dropped"]) == (0, 0)


def test_a_robot_that_goes_on_from_any_moment_does_and_counts_the_same():
    """It chooses the same action again at the time step of the snapshot."""
    reward = Reward(4.0, 0.0, 0.0, 4.0)
    messages = [
        *(("state", 1, 0), ("reward", 1, reward)),
        *(
            ("state", 2, ASKING_CELL),
            ("answer", 1, 2, Answer(2, 3)),
            ("reward", 2, reward),
        ),
        ("state", 3, 6),
    ]
    whole, whole_port = make_robot()
    snapshots = []
    for name, *values in messages:
        getattr(whole, name)(*values)
        snapshots.append(whole.snapshot())
    assert whole.asks["answered"] == 1
    assert [learned for _, learned in whole_port.reports] == [False, True, True]
    for number, snapshot in enumerate(snapshots):
        robot, port = make_robot()
        robot.go_on_from(robot.agent, snapshot)
        begin = max(n for n in range(number + 1) if messages[n][0] == "state")
        for name, *values in messages[begin:]:
            getattr(robot, name)(*values)
        assert robot.counts == whole.counts, number
        own = port.reports
        assert own == whole_port.reports[-len(own) :], number
        assert (robot.agent.tables.q_star == whole.agent.tables.q_star).all(), number


def test_each_time_that_a_peer_is_asked_again_is_counted(robot, port):
    robot.state(2, ASKING_CELL)
    for _ in range(3):
        robot.answer(1, 2, Answer(1, 3))
    robot.answer(1, 2, Answer(2, 3))
    assert port.take()[:4] == [("ask", 1, 2, ASKING_CELL)] * 4
    assert robot.asks == {"answered": 1, "refused": 0, "late": 0, "repeated": 3}


SEEN = {"peers_seen": "while_learning"}


def test_who_sees_its_peers_while_learning_learns_without_a_question():
    """It acts, and learns, when it has the states of all robots."""
    robot, port = make_robot(**SEEN)
    robot.state(1, 2)
    assert port.take() == []
    robot.peer_state(1, 1, 7)
    assert port.take() == [("act", 1, Action(SOUTH, False, -1, False))]
    robot.reward(1, Reward(0.0, 0.0, 0.0, 0.0))
    robot.peer_state(1, 2, 8)
    assert (robot.learned, robot.waiting) == (0, None)
    robot.state(2, 3)
    assert robot.learned == 1
    assert robot.agent.memory()["q_coord_updates"].sum() == 1
    assert port.take() == [("act", 2, Action(SOUTH, False, -1, False))]


def test_it_asks_as_always():
    """A failed percept stays one: it moves by Q*, and learns Q^C."""
    robot, port = make_robot(**SEEN)
    robot.peer_state(1, 1, 7)
    robot.state(1, ASKING_CELL)
    assert port.take() == [("ask", 1, 1, ASKING_CELL)]
    robot.answer(1, 1, Answer(1, None))
    assert port.take()[-1] == ("act", 1, Action(3, True, 1, False))
    robot.state(2, 6)
    robot.reward(1, Reward(0.0, 0.0, -1.0, -1.0))
    assert robot.waiting == ("reward", 1)
    robot.peer_state(1, 2, 8)
    assert robot.learned == 1
    assert robot.agent.memory()["q_coord_updates"].sum() == 1


def test_a_peers_state_that_does_not_come_is_a_transition_not_learned():
    robot, port = make_robot(**SEEN)
    robot.peer_state(1, 1, 7)
    robot.state(1, 2)
    robot.state(2, 3)
    robot.reward(1, Reward(0.0, 0.0, 0.0, 0.0))
    port.take()
    robot.expire()
    assert (robot.learned, robot.dropped, port.take()) == (0, 1, [])
    robot.peer_state(1, 2, 8)  # the world repeats it
    assert port.take() == [("act", 2, Action(SOUTH, False, -1, False))]
