# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of whole runs, made by the lock step's own state machines without any middleware."""

import functools
import shutil
from collections import Counter, deque
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

from geometry_msgs.msg import PoseStamped
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String, UInt8MultiArray

from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.memory import taught
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.core.runs.saved_tables import pack_tables, unpack_saved
from sparse_coord_ros.log.bags import BagWriter, QoS
from sparse_coord_ros.log.bags.metadata import (
    METADATA_RECORD,
    offered_qos_profiles,
)
from sparse_coord_ros.log.bags.reader import continued, open_bag
from sparse_coord_ros.log.bags.writer import DEFAULT_CHUNK_SIZE
from sparse_coord_ros.protocol.lockstep.robot_side import RobotSide
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.protocol.wire import MAP
from sparse_coord_ros.protocol.wire.published_tables import read_tables
from sparse_coord_ros.protocol.wire.status import RunStatus
from sparse_coord_ros.ros.nodes.peers import IMMEDIATE_REPEATS
from sparse_coord_ros.ros.nodes.ros_messages import (
    messages_of,
    set_cell,
    status,
    tables_message,
)

OFTEN = {"q_star_init": 100, "ask_cost": 0, "epsilon": "constant:0.3"}
"""Settings with which COORDINATE is chosen in every fifth step or so."""

TYPES = {
    "local_state": "geometry_msgs/msg/PoseStamped",
    "reward": "sensor_msgs/msg/JointState",
    "action": "sensor_msgs/msg/JointState",
    "percept": "nav_msgs/msg/Path",
    "tables": "std_msgs/msg/UInt8MultiArray",
}
GRID = "nav_msgs/msg/OccupancyGrid"
WALL = 1_700_000_000_000_000_000
STATUS_STEPS = 50


class Recording:
    """A team and its recorder in one thread.

    Args:
        directory: of the bag.
        run: the run.
        tables: what the robots begin with.
        lost: (kind, robot, step) of messages that are recorded but do not arrive, once each.
        late: (robot, step) of local states that a robot gets with the next one only.
        deaf: (robot, step) of local states that a robot never gets.
        resets: transitions after which someone resets the world.
        stop: transitions after which someone stops the run; None: nobody.
        finish: whether the recorder closes the bag.
        chunk: bytes of a chunk; None: the writer's.
    """

    def __init__(
        self,
        directory,
        run,
        *,
        tables=None,
        lost=(),
        late=(),
        deaf=(),
        resets=(),
        stop=None,
        finish=True,
        chunk=None,
    ):
        self.bag = BagWriter(
            directory, **({} if chunk is None else {"chunk_size": chunk})
        )
        self.run = run
        self.convert = messages_of(run)
        self.names = [robot.name for robot in run.scenario.robots]
        self.lost = set(lost)
        self.deaf = set(deaf)
        self.resets = set(resets)
        self.late = set(late)
        self.held = {}
        self.lost_now = []
        self.again = {}
        self.queue = deque()
        self.now = 0
        self.tables = {}
        self.bag.add_metadata("sparse_coord_ros", run.record())
        write_run(self.bag, run)
        self.world = WorldSide(run, self)
        begin = [None] * len(self.names)
        if tables is not None:
            scenario = run.scenario
            rule = run.rule
            begin = [
                one.memory if run.greedy else taught(scenario, rule, k, one.memory)
                for k, one in enumerate(tables)
            ]
        self.robots = [
            RobotSide(
                run,
                Agent(
                    run.rule,
                    run.scenario,
                    k,
                    run.seed,
                    memory=begin[k],
                    learning=not run.greedy,
                ),
                LoggedRobot(self, k),
            )
            for k in range(len(self.names))
        ]
        for kind, type_name in TYPES.items():
            for name in self.names:
                self.bag.add_topic(f"/{name}/{kind}", type_name, QoS())
        self.write(f"/{MAP.name}", GRID, self.convert.pack_map(0), 0)
        self.say("waiting")
        for k in range(len(self.names)):
            self.coordination_map(k, 0)
            self.save(k, 0)
        self.say("learning")
        self.world.start()
        self.go(stop)
        self.say("finished" if self.world.finished else "stopped")
        for k, robot in enumerate(self.robots):
            self.save(k, robot.handled)
        if finish:
            self.bag.close()
        else:
            self.bag.abandon()

    def go(self, stop):
        """Let messages arrive; where nothing moves, deadlines pass."""
        while True:
            while self.queue:
                self.queue.popleft()()
            if self.world.finished or self.world.world.transitions == stop:
                for robot in self.robots:
                    robot.expire()
                return
            if self.world.world.transitions in self.resets:
                self.resets.discard(self.world.world.transitions)
                self.world.new_episode()
            elif self.world.complete:
                self.world.advance()
                if self.world.world.transitions % STATUS_STEPS == 0:
                    self.say("learning")
                    for k, robot in enumerate(self.robots):
                        self.coordination_map(k, robot.handled)
            elif any(robot.waiting for robot in self.robots):
                for robot in self.robots:
                    if robot.waiting:
                        robot.expire()
            elif self.lost_now:
                self.lost_now.clear()
                self.world.repeat()
            else:
                assert self.world.missing(), "nobody is missing and nothing moves"
                if not self.world.expire():  # nobody is left
                    self.deaf.clear()
                    self.late.clear()
                    self.world.repeat()

    def write(self, topic, type_name, data, step=None):
        """Record a message."""
        if step is not None:
            self.now = max(self.now, step * self.convert.period)
        at = self.now if step is None else step * self.convert.period
        self.bag.write(self.bag.add_topic(topic, type_name, QoS()), data, at, at)

    def say(self, state):
        """Publish the world's status."""
        world = self.world.world
        side = self.world
        said = RunStatus(
            self.run.id, state, world.step, world.transitions, side.left_out, side.began
        )
        message = status(self.run.scenario.name, state, said.values())
        self.write(
            "/status",
            "diagnostic_msgs/msg/DiagnosticStatus",
            serialize_message(message),
        )

    def coordination_map(self, k, step):
        """Publish a robot's coordination map."""
        asking = self.convert.asking_cells(self.robots[k].agent.q_star)
        data = self.convert.pack_coordination_map(step, asking)
        self.write(f"/{self.names[k]}/coordination_map", GRID, data, step)

    def save(self, k, step):
        """Record a robot's tables."""
        robot = self.robots[k]
        data = pack_tables({k + 1: robot.agent.memory()}, counts=robot.counts)
        if self.tables.get(k) == (step, data):  # the recorder writes them but once
            return
        self.tables[k] = (step, data)
        message = serialize_message(tables_message(data, step, "checkpoint", ""))
        self.write(f"/{self.names[k]}/tables", TYPES["tables"], message, step)

    def arrives(self, kind, k, step):
        """Whether a message arrives."""
        if (kind, k, step) in self.lost:
            self.lost.discard((kind, k, step))
            self.lost_now.append((kind, k, step))
            return False
        return True

    # The world's port.

    def checkpoint(self, step):
        """The world saves where it is: nothing that a bag holds."""

    def state(self, k, step, cell):
        """Publish a local state."""
        data = self.convert.pack_state(step, cell)
        self.write(f"/{self.names[k]}/local_state", TYPES["local_state"], data, step)
        if (k, step) in self.late:
            self.held.setdefault(k, []).append((step, cell))
        elif (k, step) not in self.deaf and self.arrives("local_state", k, step):
            for one in (*self.held.pop(k, []), (step, cell)):
                self.queue.append(lambda one=one: self.robots[k].state(*one))
        if self.run.sees_all:
            for j in range(len(self.names)):
                if j != k:
                    self.queue.append(
                        lambda j=j: self.robots[j].peer_state(k, step, cell)
                    )

    def reward(self, k, step, reward):
        """Publish a reward."""
        data = self.convert.pack_reward(step, reward)
        self.write(f"/{self.names[k]}/reward", TYPES["reward"], data, step)
        if self.arrives("reward", k, step):
            self.queue.append(lambda: self.robots[k].reward(step, reward))

    # Active perception.

    def ask(self, asker, peer, step, cell):
        """Send a request."""
        again = self.again[asker, peer, step] = (
            self.again.get((asker, peer, step), 0) + 1
        )
        if again <= IMMEDIATE_REPEATS and self.arrives("request", asker, step):
            self.queue.append(lambda: self.answer(asker, peer, step, cell))

    def answer(self, asker, peer, step, cell):
        """Let the peer answer, and the answer arrive."""
        answer = self.robots[peer].asked(asker, step, cell)
        self.queue.append(lambda: self.robots[asker].answer(peer, step, answer))


class LoggedRobot:
    """A robot's port."""

    def __init__(self, recording, k):
        self.all = recording
        self.k = k

    def ask(self, peer, step, cell):
        self.all.ask(self.k, peer, step, cell)

    def act(self, step, action, report):
        everything = self.all
        k = self.k
        data = everything.convert.pack_action(step, action, report)
        everything.write(f"/{everything.names[k]}/action", TYPES["action"], data, step)
        if everything.arrives("action", k, step):
            everything.queue.append(lambda: everything.world.action(k, step, action))

    def percept(self, step, cell, perceived):
        everything = self.all
        data = everything.convert.pack_percept(step, (cell, *(perceived or ())))
        topic = f"/{everything.names[self.k]}/percept"
        everything.write(topic, TYPES["percept"], data, step)

    def episode(self, step):
        """Record the coordination map."""
        self.all.coordination_map(self.k, step)

    def checkpoint(self, step):
        self.all.save(self.k, step)


def cell_pose(messages, step, cell):
    """Return a cell's centre at a time step."""
    pose = PoseStamped()
    set_cell(pose, messages, step, cell)
    return pose


def write_run(writer, run):
    """Write the run into a bag, at its beginning."""
    channel = writer.add_topic("/run", "std_msgs/msg/String", QoS())
    writer.write(channel, serialize_message(String(data=run.to_yaml())), 0, 0)


def write_tables(writer, run, name, step, packed):
    """Write a robot's tables, the bytes of an .npz file, into a bag."""
    channel = writer.add_topic(f"/{name}/tables", TYPES["tables"], QoS())
    message = tables_message(packed, step, "checkpoint", "")
    at = step * messages_of(run).period
    writer.write(channel, serialize_message(message), at, at)


def chunks_in(path):
    """Return the (offset, length) of each chunk of a whole MCAP file."""
    with open(path, "rb") as file:
        found = make_reader(file).get_summary().chunk_indexes
    return sorted((one.chunk_start_offset, one.chunk_length) for one in found)


@functools.cache
def content(bag):
    """Return a bag and its messages, read once for all tests that change them."""
    source = open_bag(bag)
    return source, tuple(source.messages())


def rewritten(bag, directory, change=lambda messages: messages):
    """Write a bag anew, changed, with all checksums right, in one file without `metadata.yaml`."""
    shutil.rmtree(directory, ignore_errors=True)
    directory.mkdir(parents=True)
    source, messages = content(bag)
    with (directory / f"{directory.name}_0.mcap").open("wb") as stream:
        new = Writer(
            stream,
            chunk_size=DEFAULT_CHUNK_SIZE,
            compression=CompressionType.NONE,
            enable_data_crcs=True,
        )
        new.start(profile="ros2", library=f"sparse_coord_ros {__version__}")
        for name, texts in source.metadata.items():
            if name != METADATA_RECORD:
                new.add_metadata(name, texts)
        channels = {one.name: channel_of(new, one) for one in source.topics.values()}
        numbers = Counter()
        for one in change(list(messages)):
            number = numbers[one.topic]
            numbers[one.topic] += 1
            times = one.log_time_ns, one.publish_time_ns
            new.add_message(channels[one.topic], times[0], one.data, times[1], number)
        new.finish()
    return directory


def channel_of(writer, topic):
    """Return the channel of a bag's topic in another file."""
    schema = writer.register_schema(topic.type_name, "ros2msg", topic.schema.encode())
    about = {
        "offered_qos_profiles": offered_qos_profiles(topic.qos),
        "topic_type_hash": topic.type_hash,
    }
    return writer.register_channel(topic.name, "cdr", schema, about)


def copied(writer, source, messages, *, prefix=""):
    """Write messages of a bag into another one, which gets all its topics."""
    channels = {
        topic.name: writer.add_known_topic(topic._replace(name=prefix + topic.name))
        for topic in source.topics.values()
    }
    for one in messages:
        writer.write(
            channels[one.topic], one.data, one.log_time_ns, one.publish_time_ns
        )


def rolled_back(run, directory, step, *, after, missed=0, killed=False, late=()):
    """Write a bag of two files: so many steps after a checkpoint the team went back to it.

    The recorder that writes the second file misses the first steps if it is told to. Of `late`
    topics the first file lacks the last two steps. `killed` leaves it unfinished.
    """
    bag = open_bag(run.bag)
    period = run.run.step_period * 1e9

    def before(found):
        return [one for one in found if one.log_time_ns < (step + after) * period]

    def written(message):
        return not message.topic.endswith(late) or (
            message.log_time_ns < (step + after - 2) * period
        )

    if killed:
        writer = BagWriter(directory)
        for name, texts in bag.metadata.items():
            if name != METADATA_RECORD:
                writer.add_metadata(name, texts)
        messages = filter(written, before(bag.messages()))
        copied(writer, bag, messages)
        writer.abandon()
    else:
        rewritten(run.bag, directory, before)
    with closing(BagWriter(directory, earlier=continued(directory))) as writer:
        at = round(step * period)
        begun = next(bag.messages(["/run"]))
        tables = [
            one
            for one in bag.messages()
            if one.topic.endswith("/tables") and one.log_time_ns == at
        ]
        messages = [begun._replace(log_time_ns=at), *tables]
        messages += [
            m
            for m in bag.messages()
            if m.log_time_ns >= (step + missed) * period and m not in tables
        ]
        copied(writer, bag, messages)
    return directory


def each(topic, kind, change, which=slice(None)):
    """Return a change of a topic's decoded messages."""

    def changed(messages):
        places = [place for place, one in enumerate(messages) if one.topic == topic]
        for place in places[which]:
            message = deserialize_message(messages[place].data, kind)
            change(message)
            messages[place] = messages[place]._replace(data=serialize_message(message))
        return messages

    return changed


def with_tables(message, number, change):
    """Return a message in which `change` has altered a robot's tables and counts."""
    said = read_tables(deserialize_message(message.data, UInt8MultiArray))
    [saved] = unpack_saved(said.packed, [number], where="")
    change(saved.memory, saved.counts)
    data = pack_tables({number: saved.memory}, counts=saved.counts)
    new = tables_message(data, said.step, said.occasion, said.attempt)
    return message._replace(data=serialize_message(new))


def recorded(directory, name="env1", settings=None, *, values=None, **options):
    """Record a run in which robots often ask; return its bag, run, protocols and robots' names."""
    scenario = load_scenario(name).with_settings(
        {"steps": 400, **OFTEN, **(settings or {})}
    )
    run = make_run(scenario, {"seed": 7, "checkpoint": 150, **(values or {})})
    run = replace(run, id="")
    recording = Recording(directory / "bag", run, **options)
    return SimpleNamespace(
        bag=directory / "bag", run=run, recording=recording, names=recording.names
    )
