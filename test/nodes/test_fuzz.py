# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Random bytes and random valid messages at every topic and service of a team."""

import itertools
import math
import random
import time
from pathlib import Path

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header, String
from strangers import Visitor, damaged

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.wire import SelfReport
from sparse_coord_ros.protocol.wire.status import RunStatus, read_status
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.guard import read_claim
from sparse_coord_ros.ros.nodes.messages import (
    Converter,
    read_run,
    read_tables_message,
    status,
    tables_message,
)

NAMES = ("robot_1", "robot_2")
SETTINGS = {"steps": 60, "epsilon": "constant:1"}
SECONDS = 300.0
SPARE_KIB = 30_000


def test_what_random_bytes_bring_about_is_an_exception_or_fits():
    """Every reader of the nodes, on messages with a few bytes changed."""
    chance = random.Random(1)
    convert = Converter(make_run(load_scenario("env1"), {}))
    values = RunStatus("ab", "learning", 7, 5).values()
    texts = {
        convert.unpack_state: convert.pack_state(7, 3),
        convert.unpack_reward: convert.pack_reward(7, Reward(1.0, 0.0, -1.0, 0.0)),
        convert.unpack_action: convert.pack_action(
            7, Action(2, True, 1, True), SelfReport(1, True)
        ),
        typed(ros_topics.STATUS, read_status): serialize_message(
            status("a", "learning", values)
        ),
        typed(ros_topics.CLAIM, read_claim): serialize_message(
            Header(frame_id="ab joined")
        ),
        read_run: serialize_message(String(data="format: 1")),
        typed(ros_topics.TABLES, read_tables_message): serialize_message(
            tables_message(b"npz", 7, "final", "ab")
        ),
    }
    passed = dropped = 0
    for read, text in texts.items():
        for _ in range(400):
            try:
                said = read(damaged(chance, text))
            except Exception:  # what `Subscriber` drops
                dropped += 1
                continue
            passed += 1
            if read == convert.unpack_state:
                assert said[0] >= 0 and 0 <= said[1] < len(convert.grid.cells)
            elif read == convert.unpack_reward:
                assert said[0] >= 0 and all(map(math.isfinite, said[1]))
            elif read == convert.unpack_action:
                assert (
                    said[0] >= 0
                    and said[1].move in range(4)
                    and said[1].peer in (-1, 0, 1)
                )
    assert passed > 300
    assert dropped > 300


def typed(topic, read):
    return lambda data: read(deserialize_message(data, topic.type))


def resident():
    """Return this process's memory in KiB."""
    text = Path("/proc/self/status").read_text()
    return int(text.split("VmRSS:")[1].split()[0])


@pytest.mark.long
@pytest.mark.timeout(900)
def test_minutes_of_fuzz_change_nothing(
    bench, tmp_path, simulate, assert_same_tables, capfd
):
    """The team finishes in spite of the messages; and its memory does not grow."""
    settings = [f"{name}={value}" for name, value in SETTINGS.items()]
    world = bench.world(
        out=str(tmp_path), set=settings, rate=20 / SECONDS, recorded=True
    )
    recorder = bench.recorder(tmp_path / "bag")
    bench.robots(out=str(tmp_path))
    bench.spin_until(lambda: world.lockstep.complete, "the first barrier")
    visitor = Visitor(bench.observer(), NAMES, 2)
    begun = time.monotonic()
    memory = []
    turns = itertools.count()

    def over():
        if next(turns) % 6 == 0:  # a turn takes in one message of each executor
            visitor.step()
        if time.monotonic() - begun > SECONDS * 0.4 and not memory:
            memory.append(resident())
        return time.monotonic() - begun > SECONDS

    bench.spin_until(over, "all is said", seconds=SECONDS + 60)
    assert resident() - memory[0] < SPARE_KIB
    bench.destroy(visitor.node)
    world.values["rate"] = 0.0
    bench.spin_until_done()
    assert recorder.error is None
    assert world.summary()["timeouts"] == 0
    assert world.summary()["messages_dropped"] > 0
    assert_same_tables(tmp_path, simulate("env1", SETTINGS))
    assert "Traceback" not in capfd.readouterr().err
