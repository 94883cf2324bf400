# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bag of a live run, read by independent readers, contains the whole run."""

from collections import Counter, defaultdict
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader

from sparse_coord_ros.core.runs.run_config import run_from_yaml
from sparse_coord_ros.log.runlog import read_run, verify
from sparse_coord_ros.protocol.wire import ACTION, REWARD
from sparse_coord_ros.ros.nodes.ros_messages import messages_of
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team

SEED = 5
STEPS = 120
CHECKPOINT = 50
PERIOD_NS = 100_000_000
NAMES = ("robot_1", "robot_2")
MAPS = {f"/{name}/coordination_map" for name in NAMES}
SHOWN = {f"/world_simulator/{topic}" for topic in ("map", "markers")}
LATCHED = {"/run", "/status"} | SHOWN | MAPS
STEP_TOPICS = {
    f"/{name}/{topic}"
    for name in NAMES
    for topic in ("local_state", "reward", "action", "percept")
}
TABLES = {f"/robot_{k}/tables" for k in (1, 2)}
TEAM_TOPICS = LATCHED | STEP_TOPICS | TABLES | {"/diagnostics"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Record a run in which percepts fail now and then."""
    out = tmp_path_factory.mktemp("recorded") / "out"
    values = {
        "scenario": "env1",
        "seed": SEED,
        "steps": STEPS,
        "perception": "probability:0.6",
        "out": str(out),
        "record": True,
        "checkpoint": CHECKPOINT,
    }
    with ros_context() as context:
        run_team(values, context=context)
    run = run_from_yaml((out / "run.yaml").read_text(), where="run.yaml")
    topics = defaultdict(list)
    with AnyReader([out / "bag"]) as reader:
        for connection, time_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            topics[connection.topic].append((time_ns, message))
    return SimpleNamespace(
        out=out, bag=out / "bag", run=run, topics=topics, log=read_run(out)
    )


def step_of(time_ns):
    assert time_ns % PERIOD_NS == 0
    return time_ns // PERIOD_NS


def test_rosbags_decodes_everything(recorded):
    metadata = yaml.safe_load((recorded.bag / "metadata.yaml").read_text())
    information = metadata["rosbag2_bagfile_information"]
    counts = {
        topic["topic_metadata"]["name"]: topic["message_count"]
        for topic in information["topics_with_message_count"]
    }
    assert set(counts) == TEAM_TOPICS | {"/rosout", "/parameter_events"}
    assert {name: len(messages) for name, messages in recorded.topics.items()} == {
        name: count for name, count in counts.items() if count
    }
    assert all(counts[name] for name in TEAM_TOPICS)


def test_mcap_ros2_decodes_everything(recorded):
    """By the loop of its documentation; as many messages as rosbags finds."""
    [path] = recorded.bag.glob("*.mcap")
    found = defaultdict(list)
    for one in read_ros2_messages(str(path)):
        found[one.channel.topic].append(one.ros_msg)
    counts = {name: len(messages) for name, messages in recorded.topics.items()}
    assert {name: len(messages) for name, messages in found.items()} == counts


def test_an_independent_reader_finds_what_the_log_says(recorded):
    """The log itself is verified against the simulation: `verify`."""
    assert verify(recorded.out).same
    convert = messages_of(recorded.run)
    log = recorded.log
    rows = {step: row for row, step in enumerate(log.step.tolist())}
    for k, name in enumerate(NAMES):
        counts = Counter()
        for kind in ("local_state", "reward", "action", "percept"):
            for time_ns, message in recorded.topics[f"/{name}/{kind}"]:
                counts[kind] += 1
                row = rows[step_of(time_ns)]
                if kind == "local_state":
                    at = message.pose.position
                    assert convert.cell(at.x, at.y) == log.cells[row, k]
                elif kind == "reward":
                    assert list(message.position) == log.rewards[row, k].tolist()
                    assert message.name == list(REWARD.labels)
                elif kind == "action":
                    assert list(message.position) == log.numbers[row, k].tolist()
                    assert message.name == list(ACTION.labels)
                else:
                    cells = [
                        convert.cell(p.pose.position.x, p.pose.position.y)
                        for p in message.poses
                    ]
                    assert cells[0] == log.cells[row, k]
                    assert (len(cells) > 1) == log.perceived[row, k]
        acted = np.isfinite(log.rewards[:, k, 0]).sum()
        asked = log.asked[:, k].sum()
        perceived = log.perceived[:, k].sum()
        assert counts["local_state"] == (log.cells[:, k] >= 0).sum()
        assert counts["reward"] == counts["action"] == acted
        assert counts["percept"] == asked > perceived > 0


def test_the_run_is_in_the_bag(recorded):
    ((_, message),) = recorded.topics["/run"]
    assert run_from_yaml(message.data, where="topic run") == recorded.run
    assert recorded.run.recorded
    (path,) = recorded.bag.glob("*.mcap")
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert not list(reader.iter_attachments())
        records = {record.name: record.metadata for record in reader.iter_metadata()}
    assert records["sparse_coord_ros"]["scenario"] == "env1"
    assert records["sparse_coord_ros"]["seed"] == str(SEED)
    assert (
        records["sparse_coord_ros"]["version_numpy"] == recorded.run.versions["numpy"]
    )
    assert "serialized_metadata" in records["rosbag2"]


def test_latched_topics_stay_latched(recorded):
    (path,) = recorded.bag.glob("*.mcap")
    with path.open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    profiles = {
        channel.topic: yaml.safe_load(channel.metadata["offered_qos_profiles"])
        for channel in channels
    }
    for name in TEAM_TOPICS - TABLES:
        (profile,) = profiles[name]
        assert profile["reliability"] == "reliable"
        assert profile["durability"] == (
            "transient_local" if name in LATCHED else "volatile"
        )
        assert profile["history"] == "keep_last"
        assert (profile["depth"] == 1) == (name in LATCHED)
