# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A whole team without ROS: processes that die and come back, over an unreliable network.

Every process runs the state machines that the nodes run. Topics are FIFO queues, one for each
publisher; the next queue is drawn. A process receives the messages that are published while it
runs, and the last message of a latched topic. A robot that comes back receives states and rewards
only some time later.
"""

import random
from collections import defaultdict, deque

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.lockstep.attempts import RobotAttempts, WorldAttempts
from sparse_coord_ros.protocol.lockstep.robot_side import RobotSide
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.protocol.wire.status import NO_ATTEMPT

WORLD = -1
OF_THE_WORLD = ("state", "peer_state", "reward")
"""What the world says to robots."""

QUIET = 60
"""Deliveries without a time step after which the world repeats itself."""
PATIENCE = 600
"""Deliveries without a time step after which deadlines pass."""
LATEST_EAR = 300
"""Longest time, by the team's clock, until a robot that comes back receives the world."""
TOO_LONG = 60_000
"""Deliveries after which a team that has not ended has a deadlock."""


class KilledError(Exception):
    """The process is gone."""


class SpyAgent(Agent):
    """Records the transitions from which it learned."""

    def learn(self, step, choice, reward, next_cell, team):
        done = (step, choice.cell, reward.total, next_cell)
        self.__dict__.setdefault("learned", []).append(done)
        super().learn(step, choice, reward, next_cell, team)


class Store:
    """Checkpoints in memory, kept as those on disk are."""

    def __init__(self, disks, who):
        self.disks = disks
        self.who = who
        self.killed = None
        disks.setdefault(who, {})

    def steps(self):
        return [*sorted(self.disks[self.who], reverse=True), 0]

    def load(self, step):
        return self.disks[self.who][step] if step else None

    def save(self, state):
        if self.killed == "before":
            raise KilledError
        self.disks[self.who][state.step] = state
        if self.killed == "after":
            raise KilledError

    def forget_after(self, step):
        self.keep(lambda one: one <= step)

    def forget_before(self, step):
        self.keep(lambda one: one >= step)

    def keep(self, wanted):
        mine = self.disks[self.who]
        for step in [step for step in mine if not wanted(step)]:
            del mine[step]


class WorldProcess:
    def __init__(self, team):
        self.team = team
        self.life = team.new_life()
        self.store = Store(team.disks, WORLD)
        self.side = WorldSide(team.run, self)
        self.attempts = WorldAttempts(self.side, self.store, range(team.robots))
        self.started = False
        self.newest = 0
        self.restarts = 0
        self.say()

    # The port.

    def state(self, robot, step, cell):
        if step > self.newest + 1:
            self.team.ends(step - EPISODE_GAP)
        self.newest = step
        self.team.publish("state", self, robot, (step, cell))
        if self.team.run.sees_all:
            for peer in range(self.team.robots):
                if peer != robot:
                    self.team.publish("peer_state", self, peer, (step, cell, robot))

    def reward(self, robot, step, reward):
        self.team.publish("reward", self, robot, (step, reward))
        cells = self.side.world.cells  # those of the next step
        self.team.happened[robot].add((step, reward.total, cells[robot]))

    def checkpoint(self, step):
        self.store.save(self.side.snapshot(step))

    # What the node does.

    def say(self):
        said = self.attempts.order, self.attempts.oldest
        for robot in range(self.team.robots):
            self.team.publish("status", self, robot, said, latched=True)

    def begin(self):
        self.attempts.begin()
        self.team.stalled = 0  # the nodes have time to obey
        self.say()

    def on_progress(self, robot, said):
        attempts = self.attempts
        attempts.reports[robot] = said
        if attempts.order.attempt == NO_ATTEMPT:
            if not attempts.silent:
                self.begin()
        elif said.attempt == NO_ATTEMPT:
            self.restarts += 1
            self.begin()
        self.store.forget_before(attempts.oldest)
        if not attempts.waiting and self.team.all_listen:
            self.go_on()

    def go_on(self):
        if self.side.held or not self.started:
            self.started = True
            self.side.start()

    def on_action(self, robot, step, action):
        if self.started and self.side.action(robot, step, action):
            self.side.advance()

    def expire(self):
        if self.started and self.side.held:
            self.go_on()
            self.team.disturbed = True
        elif self.started and not self.side.finished and self.side.expire():
            self.team.disturbed = True
            if self.side.complete:
                self.side.advance()


class RobotProcess:
    def __init__(self, team, number, again):
        self.team = team
        self.number = number
        self.life = team.new_life()
        self.store = Store(team.disks, number)
        self.side = RobotSide(team.run, self.fresh(), self)
        self.attempts = None
        self.joined = False
        self.joins = team.clock + (team.random.randint(0, LATEST_EAR) if again else 0)

    def fresh(self):
        return SpyAgent(
            self.team.rule, self.team.scenario, self.number, self.team.run.seed
        )

    # The port.

    def ask(self, peer, step, cell):
        self.team.publish("ask", self, peer, (self.number, self.life, step, cell))

    def act(self, step, action, report):
        self.team.publish("action", self, WORLD, (self.number, step, action))

    def percept(self, step, cell, perceived):
        self.team.percepts.append((self.number, step, cell, perceived))

    def episode(self, step):
        pass

    def checkpoint(self, step):
        self.store.save(self.side.snapshot())
        self.say()

    # What the node does.

    def say(self):
        said = self.attempts.progress()
        self.team.publish("progress", self, WORLD, (self.number, said), latched=True)

    @property
    def ready(self):
        """Return whether it subscribes now: it has an order, and its time has come."""
        begun = self.attempts is not None and self.attempts.attempt != NO_ATTEMPT
        return begun and not self.joined and self.team.clock >= self.joins

    def join(self):
        """Subscribe now; messages in flight are not received."""
        for (topic, _, to), queue in self.team.queues.items():
            if to == self.number and topic in OF_THE_WORLD:
                queue.clear()
        self.joined = True
        self.say()

    def on_state(self, step, cell):
        if self.joined:
            self.side.state(step, cell)

    def on_peer_state(self, step, cell, peer):
        if self.joined:
            self.side.peer_state(peer, step, cell)

    def on_reward(self, step, reward):
        if self.joined:
            self.side.reward(step, reward)

    def on_status(self, order, oldest):
        if self.attempts is None:
            self.attempts = RobotAttempts(
                self.side, self.store, self.fresh, order.attempt
            )
            self.say()
        elif self.attempts.obey(order):
            self.joined = False
            later = self.team.clock + self.team.random.randint(0, 9)
            self.joins = max(self.joins, later)
        self.store.forget_before(oldest)

    def on_ask(self, asker, life, step, cell):
        answer = self.side.asked(asker, step, cell)
        self.team.publish("answer", self, asker, (self.number, life, step, answer))

    def on_answer(self, peer, life, step, answer):
        if life == self.life:
            self.side.answer(peer, step, answer)

    def expire(self):
        if self.side.waiting is not None:
            self.team.disturbed |= self.side.waiting[0] != "state"
            self.side.expire()


class Team:
    """A run, with faults.

    Args:
        scenario: the problem.
        seed: seed of the network.
        learner: the learner.
        checkpoint: steps between two checkpoints.
        doubled, lost: shares of the messages that come twice, or not at all; `lost` may also be a
            function of (topic, receiver, message).

    Attributes:
        happened: for each robot the (step, reward, next cell) that the world has published.
        percepts: (robot, step, cell, perceived cells) of each COORDINATE.
        losses: (topic, receiver, message) of lost messages.
        clock: deliveries, and `QUIET` for each time that there was none to make.
    """

    def __init__(
        self,
        scenario,
        seed,
        *,
        learner="coop",
        checkpoint=40,
        doubled=0.0,
        lost=0.0,
    ):
        self.run = make_run(
            scenario, {"seed": 5, "learner": learner, "checkpoint": checkpoint}
        )
        self.scenario = self.run.scenario
        self.rule = learner_of(learner)
        self.random = random.Random(seed)
        self.doubled = doubled
        self.lost = lost
        self.robots = len(scenario.robots)
        self.happened = defaultdict(set)
        self.percepts = []
        self.losses = []
        self.disks = {}
        self.lives = 0
        self.disturbed = False
        self.queues = defaultdict(deque)
        self.kept = {}
        self.missed = set()
        self.up = {}
        self.asleep = set()
        self.deliveries = self.clock = self.stalled = self.repeated = 0
        self.mark = None
        self.faults = []
        for who in (*range(self.robots), WORLD):
            self.start(who, again=False)

    def new_life(self):
        self.lives += 1
        return f"life {self.lives}"

    # Processes.

    def start(self, who, *, again=True):
        for key in [key for key in self.queues if key[2] == who]:
            del self.queues[key]
        if who == WORLD:
            self.up[who] = WorldProcess(self)
        else:
            self.up[who] = RobotProcess(self, who, again)
        for (topic, publisher, to), message in self.kept.items():
            if to == who and any(one.life == publisher for one in self.up.values()):
                self.queues[topic, publisher, to].append(message)

    def kill(self, who):
        self.up.pop(who, None)
        self.asleep.discard(who)

    def kill_all(self):
        for who in list(self.up):
            self.kill(who)

    def resume_all(self):
        self.queues.clear()
        self.kept.clear()
        for who in (*range(self.robots), WORLD):
            self.start(who)

    # The network.

    def publish(self, topic, process, to, message, *, latched=False):
        key = (topic, process.life, to)
        if latched:
            self.kept[key] = message
        elif self.loses(topic, to, message):
            self.losses.append((topic, to, message))
            self.disturbed |= topic in ("ask", "answer")
            # the world does not wait for an arrived robot
            if topic in OF_THE_WORLD:
                self.disturbed |= process.side.world.arrived[to]
                self.missed.add((topic, message[0]))
            return
        self.queues[key].append(message)

    def loses(self, topic, to, message):
        """Return whether a message is lost."""
        if callable(self.lost):
            return self.lost(topic, to, message)
        return self.random.random() < self.lost

    def deliver(self):
        """Deliver one message; return whether there was one."""
        ready = sorted(
            key
            for key, queue in self.queues.items()
            if queue and key[2] not in self.asleep
        )
        if not ready:
            return False
        key = self.random.choice(ready)
        message = self.queues[key].popleft()
        who = self.up.get(key[2])
        times = 1
        latched = key[0] in ("status", "progress")
        if self.random.random() < self.doubled and not latched:
            if self.random.random() < 0.5:
                times = 2
            else:  # the second one comes later
                self.queues[key].append(message)
        for _ in range(times):
            if who is None or self.up.get(key[2]) is not who:
                break
            try:
                getattr(who, f"on_{key[0]}")(*message)
            except KilledError:
                self.kill(key[2])
        return True

    # The course of a run.

    @property
    def world(self):
        return self.up.get(WORLD)

    @property
    def all_listen(self):
        """Return whether all running robots receive the world."""
        return all(one.joined for who, one in self.up.items() if who != WORLD)

    @property
    def over(self):
        return (
            self.world is not None and self.world.started and self.world.side.finished
        )

    def play(self, faults=()):
        """Run until the budget is used up; `faults`: (after so many deliveries, function)."""
        self.faults = sorted(faults, key=lambda fault: fault[0])
        while not (self.over and not self.faults and self.settled()):
            self.deliveries += 1
            assert self.deliveries < TOO_LONG, "deadlock"
            while self.faults and self.faults[0][0] <= self.deliveries:
                self.faults.pop(0)[1](self)
            for robot in [one for who, one in self.up.items() if who != WORLD]:
                if robot.ready:
                    robot.join()
            moved = self.deliver()
            world = self.world
            mark = None if world is None else (world.life, world.side.world.step)
            if mark != self.mark:
                self.mark = mark
                self.stalled = 0
                self.repeated = 0
            passed = 1 if moved else QUIET
            self.clock += passed
            self.stalled += passed
            if self.stalled >= PATIENCE:
                self.stalled = self.repeated = 0
                self.deadline()
            elif world is not None and self.stalled - self.repeated >= QUIET:
                self.repeated = self.stalled
                if world.started and not world.side.held and WORLD not in self.asleep:
                    world.side.repeat()
        self.ends(self.world.side.world.step)
        return self

    def later(self, deliveries, fault):
        """Let a fault happen after so many further deliveries."""
        self.faults.append((self.deliveries + deliveries, fault))
        self.faults.sort(key=lambda one: one[0])

    def deadline(self):
        """Pass the robots' deadlines or, if they have none, the world's."""
        awake = [who for who in self.up if who not in self.asleep]
        late = [
            who
            for who in awake
            if who != WORLD and self.up[who].side.waiting is not None
        ]
        for who in late or awake:
            try:
                self.up[who].expire()
            except KilledError:
                self.kill(who)

    def ends(self, step):
        """An episode's last messages come once; without one its last step is not learned."""
        self.disturbed |= not self.missed.isdisjoint(
            {("state", step), ("peer_state", step), ("reward", step - 1)}
        )

    def settled(self):
        """Return whether no more messages will come."""
        waits = any(queue for key, queue in self.queues.items() if key[2] in self.up)
        late = any(one.side.waiting for who, one in self.up.items() if who != WORLD)
        return not waits and not late

    @property
    def tables(self):
        return [self.up[k].side.agent.tables for k in range(self.robots)]

    def check_updates(self):
        """Check that learned transitions happened; return the (robot, step) without learning."""
        missed = set()
        for k in range(self.robots):
            agent = self.up[k].side.agent
            learned = {
                (step, *rest) for step, _, *rest in agent.__dict__.get("learned", [])
            }
            assert learned <= self.happened[k]
            missed |= {(k, step) for step, *_ in self.happened[k] - learned}
        return missed
