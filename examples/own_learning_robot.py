# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Your own robot in plain rclpy that learns by its own rule.

It learns the values of moves in its cell (Q-learning). If a move from a cell once cost r^C, it
asks a peer there from then on, and learns the values of moves for each answer.

Written from docs/own_robot.md: python own_learning_robot.py --ros-args -r __node:=robot_1
"""

import copy
import random
import time
from collections import defaultdict

from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from own_robot import CONTENTS, MOVES, STEP, OwnRobot, main

ALPHA = 0.1
EPSILON = 0.1
FIRST_VALUE = 10.0
DID_NOT_ASK, ANSWERED, REFUSED, LATE = range(4)
MEMORY = ("values", "fined", "learned", "state", "step", "begun", "transitions")


def first_values():
    """Return the values of the moves of a new place."""
    return [FIRST_VALUE] * len(MOVES)


class OwnLearningRobot(OwnRobot):
    """Learns when state and reward that follow its last action are there, then acts again."""

    def __init__(self, **place):
        super().__init__(**place)
        self.values = defaultdict(first_values)
        self.fined = set()
        self.learned = 0
        self.acted = self.reward = self.asked = self.deadline = None
        self.checkpoints = {0: self.memory()}
        self.peers = {}
        self.percept = self.create_publisher(Path, "~/percept", STEP)
        self.create_timer(0.02, self.work_off)

    def on_run(self, message):
        """Find the peers in the run."""
        super().on_run(message)
        for number, name in enumerate(self.run["scenario"]["robots"], start=1):
            if name != self.name and number not in self.peers:
                self.peers[number] = self.create_client(
                    GetPlan, f"{name}/active_perception"
                )
                self.peers[number].configure_introspection(
                    self.get_clock(), STEP, CONTENTS
                )

    def on_state(self, message):
        """Give the reward some time, from when a state is new."""
        if self.deadline is None or self.step_of(message) > self.step:
            self.deadline = time.monotonic() + self.run["percept_timeout"]
            self.asked = None
        super().on_state(message)

    def on_reward(self, message):
        """Take in the reward of the last action; it may come before or after the next state."""
        if self.acted and self.acted[0] == self.step_of(message):
            self.reward = dict(zip(message.name, message.position, strict=True))
            self.work_off()

    def work_off(self):
        """Go on with a state as far as all that it takes is there, or has not come in time."""
        if self.said or self.deadline is None:
            return
        late = time.monotonic() > self.deadline
        # else left out, or a new episode
        if self.acted and self.acted[0] == self.step - 1:
            if self.reward:
                self.learn()
            elif not late:
                return
        self.acted = None
        every = self.run["checkpoint"]
        if every and self.step // every > max(self.checkpoints) // every:
            self.checkpoints[self.step] = self.memory()
            self.say_progress()
        if self.asked and late:
            self.move(None, LATE)
        elif not self.asked and not self.rests():
            self.choose()

    def learn(self):
        """Move the last move's value towards its reward and the value of where it led to."""
        _, place, move = self.acted
        arrived = self.reward["individual"] > 0
        after = 0.0 if arrived else max(self.values[self.cell_of(self.state), None])
        target = self.reward["total"] + self.run["scenario"]["discount"] * after
        self.values[place][move] += ALPHA * (target - self.values[place][move])
        if self.reward["common"] < 0:
            self.fined.add(place[0])
        self.learned = 1

    def choose(self):
        """Ask in a cell where a move was fined, else move."""
        if self.cell_of(self.state) in self.fined:
            self.asked = random.choice(list(self.peers))
            self.deadline = time.monotonic() + self.run["percept_timeout"]
            self.ask()
        else:
            self.move(None, DID_NOT_ASK)

    def ask(self):
        """Ask a peer where it is."""
        request = GetPlan.Request(start=self.state)
        request.goal.header.frame_id = self.name
        self.peers[self.asked].call_async(request).add_done_callback(self.on_answer)

    def on_answer(self, answer):
        """Move; where the peer is not there yet, ask again."""
        plan = answer.result().plan
        if self.asked and self.step_of(plan) < self.step:
            self.ask()
        elif self.asked:
            self.move(plan.poses[0], ANSWERED) if plan.poses else self.move(
                None, REFUSED
            )

    def move(self, seen, percept):
        """Choose a move by the values of this cell, and of the peer's if it was perceived."""
        peer = self.asked or 0
        self.asked = None
        if percept != DID_NOT_ASK:
            poses = [self.state, seen] if seen else [self.state]
            self.percept.publish(Path(header=self.state.header, poses=poses))
        place = self.cell_of(self.state), self.cell_of(seen) if seen else None
        values = self.values[place]
        best = [number for number, value in enumerate(values) if value == max(values)]
        move = random.randrange(4) if random.random() < EPSILON else random.choice(best)
        self.acted = (self.step, place, move)
        self.reward = None
        said = {
            "percept": percept,
            "coordinate": percept != DID_NOT_ASK,
            "perceived": bool(seen),
        }
        self.act(**MOVES[move], peer=peer, learned=self.learned, **said)
        self.learned = 0

    def memory(self):
        """Return the learned tables, and their place in the run."""
        return copy.deepcopy({name: vars(self)[name] for name in MEMORY})

    def go_back(self, step):
        """Go back to a checkpoint, and drop messages from after it."""
        if step in self.checkpoints:
            vars(self).update(copy.deepcopy(self.checkpoints[step]))
            self.checkpoints = {
                k: kept for k, kept in self.checkpoints.items() if k <= step
            }
            self.said = self.acted = self.asked = self.deadline = None
            self.destroy_subscription(self.rewards)
            self.destroy_subscription(self.states)
            self.listen()


if __name__ == "__main__":
    main(OwnLearningRobot)
