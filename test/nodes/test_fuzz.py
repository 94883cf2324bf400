# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Random bytes and random valid messages at every topic and service of a team."""

import itertools
import math
import random
import time
from pathlib import Path

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from rclpy._rclpy_pybind11 import RCLError
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String, UInt8MultiArray

from sparse_coord_ros import wire
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.game.world import Action, Reward
from sparse_coord_ros.learn.run_config import make_run
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.messages import (
    Converter,
    read_claim,
    read_run,
    read_tables_message,
    status,
    tables_message,
)
from sparse_coord_ros.nodes.parameters import RCLError as KnownRCLError
from sparse_coord_ros.wire import Account, services
from sparse_coord_ros.wire.status import Said, read_status

NAMES = ("robot_1", "robot_2")
SETTINGS = {"steps": 60, "epsilon": "constant:1"}
SECONDS = 300.0
SPARE_KIB = 30_000


def damaged(chance, data):
    """Return a message with some bytes changed, cut off or added."""
    data = bytearray(data)
    for _ in range(chance.randrange(4)):
        if data:
            data[chance.randrange(len(data))] = chance.randrange(256)
    if chance.random() < 0.2:
        del data[chance.randrange(len(data) + 1) :]
    if chance.random() < 0.1:
        data += chance.randbytes(chance.randrange(20))
    return bytes(data)


def test_what_random_bytes_bring_about_is_an_exception_or_fits():
    """Every reader of the nodes, on messages with a few bytes changed."""
    chance = random.Random(1)
    convert = Converter(make_run(load_scenario("env1"), {}))
    values = Said("ab", "learning", 7, 5).values()
    texts = {
        convert.unpack_state: convert.pack_state(7, 3),
        convert.unpack_reward: convert.pack_reward(7, Reward(1.0, 0.0, -1.0, 0.0)),
        convert.unpack_action: convert.pack_action(7, Action(2, True, 1, True), Account(1, True)),
        typed(interface.STATUS, read_status): serialize_message(status("a", "learning", values)),
        typed(interface.CLAIM, read_claim): serialize_message(Header(frame_id="ab joined")),
        typed(interface.RUN, read_run): serialize_message(String(data="format: 2")),
        typed(interface.TABLES, read_tables_message): serialize_message(
            tables_message(b"npz", 7, "final")
        ),
    }
    passed = dropped = 0
    for read, text in texts.items():
        for _ in range(400):
            try:
                said = read(damaged(chance, text))
            except Exception:  # what `Intake` drops
                dropped += 1
                continue
            passed += 1
            if read == convert.unpack_state:
                assert said[0] >= 0 and 0 <= said[1] < len(convert.grid.cells)
            elif read == convert.unpack_reward:
                assert said[0] >= 0 and all(map(math.isfinite, said[1]))
            elif read == convert.unpack_action:
                assert said[0] >= 0 and said[1].move in range(4) and said[1].peer in (-1, 0, 1)
    assert passed > 300
    assert dropped > 300


def typed(topic, read):
    return lambda data: read(deserialize_message(data, topic.type))


class Fuzzer:
    """Says random things on every topic and asks random things of every service of a team."""

    def __init__(self, bench):
        self._chance, self.node = random.Random(2), bench.observer()
        topics = [(topic, topic.name) for topic in interface.recorded(wire.TEAM)]
        kinds = (*interface.recorded(wire.ROBOT), interface.CLAIM, interface.TABLES)
        topics += [(topic, topic.of(name)) for topic in kinds for name in NAMES]
        topics += [(interface.CLAIM, interface.CLAIM.of("world_simulator"))]
        self._publishers = [
            (topic, self.node.create_publisher(topic.type, name, topic.qos))
            for topic, name in topics
        ]
        self._clients = [
            self.node.create_client(GetPlan, services.ACTIVE_PERCEPTION.of(name)) for name in NAMES
        ]

    def step(self):
        """Say one thing."""
        topic, publisher = self._chance.choice(self._publishers)
        data = self._chance.randbytes(self._chance.randrange(200))
        if self._chance.random() < 0.7:
            valid = serialize_message(self._valid(topic))
            data = damaged(self._chance, valid) if self._chance.random() < 0.5 else valid
        try:
            publisher.publish(data)
        except (RCLError, KnownRCLError):
            pass  # more bytes than the type can have: Fast DDS does not send them
        if self._chance.random() < 0.1:
            client = self._chance.choice(self._clients)
            request = GetPlan.Request()
            request.start.header.stamp = self._stamp()
            request.goal.header.frame_id = self._chance.choice(["", "robot_9", "x" * 99])
            request.start.pose.position.x = self._number()
            client.remove_pending_request(client.call_async(request))

    def _number(self):
        return self._chance.choice([math.nan, math.inf, -1.0, 1e300, self._chance.random()])

    def _stamp(self):
        """Return a time far from the run's."""
        return Time(sec=self._chance.choice([-(2**31), -1, 10**5, 2**31 - 1]))

    def _valid(self, topic):
        header = Header(stamp=self._stamp(), frame_id=self._chance.choice(["map", "", "odom"]))
        if topic.type is PoseStamped:
            return PoseStamped(header=header)
        if topic.type is JointState:
            names = self._chance.sample([*wire.ACTION.labels, *wire.REWARD.labels], 9)
            return JointState(header=header, name=names, position=[self._number() for _ in names])
        if topic is interface.CLAIM:
            return Header(frame_id=f"{self._chance.randrange(99)} joined")
        if topic is interface.STATUS:
            pairs = {"run": self._chance.choice(["", "x"]), "step": "9", "transitions": "99999"}
            values = [KeyValue(key=k, value=v) for k, v in pairs.items()]
            state = self._chance.choice(
                [wire.RunState.FINISHED, wire.RunState.STOPPED, wire.RunState.LEARNING]
            )
            return DiagnosticStatus(message=state, values=values)
        if topic is interface.TABLES:
            return UInt8MultiArray(data=self._chance.randbytes(50))
        return topic.type()


def resident():
    """Return this process's memory in KiB."""
    text = Path("/proc/self/status").read_text()
    return int(text.split("VmRSS:")[1].split()[0])


@pytest.mark.long
@pytest.mark.timeout(900)
def test_minutes_of_fuzz_change_nothing(bench, tmp_path, simulate, assert_same_tables, capfd):
    """A team under fire, which may finish then; neither does it take ever more memory."""
    settings = [f"{name}={value}" for name, value in SETTINGS.items()]
    world = bench.world(out=str(tmp_path), set=settings, rate=20 / SECONDS, recorded=True)
    recorder = bench.recorder(tmp_path / "bag")
    bench.robots(out=str(tmp_path))
    bench.spin_until(lambda: world.lockstep.complete, "the first barrier")
    fuzzer = Fuzzer(bench)
    begun, memory, turns = time.monotonic(), [], itertools.count()

    def over():
        if next(turns) % 6 == 0:  # a turn takes in one message of each executor
            fuzzer.step()
        if time.monotonic() - begun > SECONDS * 0.4 and not memory:
            memory.append(resident())
        return time.monotonic() - begun > SECONDS

    bench.spin_until(over, "all is said", seconds=SECONDS + 60)
    assert resident() - memory[0] < SPARE_KIB
    bench.destroy(fuzzer.node)
    world.values["rate"] = 0.0
    bench.spin_until_done()
    assert recorder.error is None
    assert world.summary()["timeouts"] == 0
    assert world.summary()["messages_dropped"] > 0
    assert_same_tables(tmp_path, simulate("env1", SETTINGS))
    assert "Traceback" not in capfd.readouterr().err
