# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot of one's own in plain rclpy that learns by a rule of its own.

It learns the values of moves in its cell (Q-learning). In a cell from which a move was once fined
(r^C) it asks from then on where a peer is, and learns the values of moves there for each answer.

Written from docs/interface.md: python own_learning_robot.py --ros-args -r __node:=robot_1
"""

import copy
import random
import time
from collections import defaultdict
from functools import partial

from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from own_robot import MOVES, STEP, OwnRobot, main
from rclpy.service_introspection import ServiceIntrospectionState

ALPHA, EPSILON, FIRST_VALUE = 0.1, 0.1, 10.0
DID_NOT_ASK, ANSWERED, REFUSED, LATE = range(4)
MEMORY = ("values", "fined", "state", "step", "begun", "transitions", "learned")


def first_values():
    """Return the values of the moves of a new place."""
    return [FIRST_VALUE] * len(MOVES)


class OwnLearningRobot(OwnRobot):
    """Learns when state and reward that follow its last action are there, then acts again."""

    def __init__(self, **place):
        super().__init__(**place)
        self.values, self.fined = defaultdict(first_values), set()
        self.pending = self.reward = self.asked = None
        self.worked_off, self.learned, self.deadline, self.went_back = -1, 0, 0.0, False
        self.peers, self.kept = {}, {}
        self.percept = self.create_publisher(Path, f"{self.name}/percept", STEP)
        self.create_timer(0.02, self.look_at_the_clock)

    def listen(self):
        """Hear the world; at first find the peers, and keep the run's beginning."""
        if not self.kept:
            self.keep(0)
            for number, name in enumerate(self.run["scenario"]["robots"], start=1):
                if name != self.name:
                    client = self.create_client(GetPlan, f"{name}/active_perception")
                    contents = ServiceIntrospectionState.CONTENTS
                    client.configure_introspection(self.get_clock(), STEP, contents)
                    self.peers[number] = client
        super().listen()

    def on_state(self, message):
        """Act, too, where the world says the state again to which this robot went back."""
        went_back, self.went_back = self.went_back, False
        super().on_state(message)
        if went_back and self.step_of(message) == self.step and self.said is None:
            self.work_off()

    def work_off(self):
        """Learn from what led to a state, if the reward is there, and act."""
        self.deadline = time.monotonic() + self.run["percept_timeout"]
        if self.pending is not None and self.pending[0] != self.step - 1:
            self.pending = None  # the world went on without this robot, or began an episode
        self.asked = None
        self.go_on()

    def on_reward(self, message):
        """Take in the reward of the last action; it may come before or after the next state."""
        if self.pending is not None and self.pending[0] == self.step_of(message):
            self.reward = dict(zip(message.name, message.position, strict=True))
            if self.step > self.pending[0]:
                self.go_on()

    def look_at_the_clock(self):
        """Give up what has not come in time: the reward, or a peer's answer."""
        if time.monotonic() < self.deadline:
            return
        if self.asked is not None:
            self.move(None, LATE)
        elif self.pending is not None and self.step > self.pending[0]:
            self.pending = None
            self.go_on()

    def go_on(self):
        """Learn, keep a checkpoint where one is due, and act."""
        if self.pending is not None:
            if self.reward is None:
                return
            self.learn()
        before, self.worked_off = self.worked_off, self.step
        every = self.run["checkpoint"]
        if every and 0 <= before and before // every < self.step // every:
            self.keep(self.step)
        if not self.rests():
            self.choose()

    def learn(self):
        """Move the last move's value towards its reward and the value of where it led to."""
        _, place, move = self.pending
        arrived = self.reward["individual"] > 0
        after = 0.0 if arrived else max(self.values[(*self.cell_of(self.state), None)])
        target = self.reward["total"] + self.run["scenario"]["discount"] * after
        self.values[place][move] += ALPHA * (target - self.values[place][move])
        if self.reward["common"] < 0:
            self.fined.add(place[:2])
        self.pending, self.learned = None, 1

    def choose(self):
        """Ask in a cell where a move was fined, else move."""
        if self.peers and tuple(self.cell_of(self.state)) in self.fined:
            self.asked = random.choice(list(self.peers))
            self.ask(self.step)
        else:
            self.move(None, DID_NOT_ASK)

    def ask(self, step):
        """Ask a peer where it is."""
        request = GetPlan.Request(start=self.state)
        request.goal.header.frame_id = self.name
        answer = self.peers[self.asked].call_async(request)
        answer.add_done_callback(partial(self.on_answer, step))

    def on_answer(self, step, answer):
        """Move; where the peer is not there yet, ask again."""
        if step != self.step or self.asked is None:
            return
        plan = answer.result().plan
        if self.step_of(plan) < step:
            self.ask(step)
        else:
            seen = plan.poses[0] if plan.poses and self.step_of(plan) == step else None
            self.move(seen, REFUSED if seen is None else ANSWERED)

    def move(self, seen, percept):
        """Choose a move by the values of this cell, and of the peer's if it was perceived."""
        peer, self.asked = self.asked or 0, None
        if percept != DID_NOT_ASK:
            poses = [self.state] if seen is None else [self.state, seen]
            self.percept.publish(Path(header=self.state.header, poses=poses))
        there = None if seen is None else tuple(self.cell_of(seen))
        place = (*self.cell_of(self.state), there)
        values = self.values[place]
        best = [number for number, value in enumerate(values) if value == max(values)]
        move = random.randrange(4) if random.random() < EPSILON else random.choice(best)
        self.pending, self.reward = (self.step, place, move), None
        said = {"coordinate": percept != DID_NOT_ASK, "peer": peer, "percept": percept}
        said |= {"perceived": seen is not None, "learned": self.learned}
        self.learned = 0
        self.act(MOVES[move], **said)

    def keep(self, step):
        """Keep a checkpoint: all is learned that happened before a time step."""
        self.kept[step] = copy.deepcopy({name: vars(self)[name] for name in MEMORY})
        self.say_progress()

    def obey(self, name, step, first):
        """Go back to a checkpoint, and hear nothing more of what is taken back."""
        if step in self.kept:
            vars(self).update(copy.deepcopy(self.kept[step]))
            self.said = self.pending = self.asked = None
            self.worked_off, self.went_back = self.step, True
            for ear in self.ears:
                self.destroy_subscription(ear)
            self.listen()
        if step in (-1, *self.kept):
            super().obey(name, step, first)

    def say_progress(self):
        """Say to which time steps this robot can go back."""
        super().say_progress(" ".join(map(str, self.kept)))


if __name__ == "__main__":
    main(OwnLearningRobot)
