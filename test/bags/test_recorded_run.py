# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bag of a live run, read by independent readers, tells the whole run."""

from collections import Counter, defaultdict
from types import SimpleNamespace

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.reader import read_ros2_messages
from nav_msgs.srv import GetPlan
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader

from sparse_coord_ros.game.world import World
from sparse_coord_ros.learn.agent import Agent
from sparse_coord_ros.learn.run_config import run_from_yaml
from sparse_coord_ros.learn.simulation import Team
from sparse_coord_ros.learn.tables import unpack_counts, unpack_tables
from sparse_coord_ros.nodes.messages import Converter
from sparse_coord_ros.nodes.spin import ros_context
from sparse_coord_ros.nodes.team import run_team

SEED, STEPS, CHECKPOINT = 5, 250, 100
PERIOD_NS = 200_000_000
NAMES = ("robot_1", "robot_2")
CLAIMS = {f"/{name}/claim" for name in ("world_simulator", *NAMES)}
MAPS = {f"/{name}/coordination_map" for name in NAMES}
PROGRESS = {f"/{name}/progress" for name in NAMES}
LATCHED = {"/run", "/status", "/map", "/markers", "/scene"} | MAPS | PROGRESS | CLAIMS
EVENTS = {f"/{name}/active_perception/_service_event" for name in NAMES}
STEP_TOPICS = {
    f"/{name}/{topic}"
    for name in NAMES
    for topic in ("local_state", "reward", "action", "percept")
}
TEAM_TOPICS = LATCHED | STEP_TOPICS | {"/clock", "/diagnostics"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Record a run of 250 steps in which percepts fail now and then."""
    out = tmp_path_factory.mktemp("recorded") / "out"
    values = {
        "scenario": "env1",
        "seed": SEED,
        "set": [f"steps={STEPS}", "perception=probability:0.6"],
        "step_period": 0.2,
        "out": str(out),
        "record": True,
        "checkpoint": CHECKPOINT,
        "claim_window": 0.0,
    }
    with ros_context() as context:
        run_team(values, context=context)
    run = run_from_yaml((out / "run.yaml").read_text(), where="run.yaml")
    topics = defaultdict(list)
    with AnyReader([out / "bag"]) as reader:
        for connection, time_ns, data in reader.messages():
            # rosbags opens a bag with service events but does not know their type by its name.
            event = connection.topic in EVENTS
            message = bytes(data) if event else reader.deserialize(data, connection.msgtype)
            topics[connection.topic].append((time_ns, message))
    return SimpleNamespace(out=out, bag=out / "bag", run=run, topics=topics, said=said_in(run))


def said_in(run):
    """Return what the simulation without ROS says, by (robot, step)."""
    scenario = run.scenario
    team = Team(scenario, run.seed, [Agent(scenario, k, run.seed) for k in range(2)])
    world = World(scenario, run.seed)
    said = SimpleNamespace(states={}, actions={}, rewards={}, percepts={})

    def note_states():
        said.states.update({(k, world.step): cell for k, cell in enumerate(world.cells)})

    def note_tables():
        for k, agent in enumerate(team.agents):
            said.tables[k, world.step] = pack(agent, world.step)

    said.tables = {(k, 0): pack(agent, 0) for k, agent in enumerate(team.agents)}
    said.episodes = [world.step]
    note_states()
    while world.transitions < scenario.steps:
        step = world.step
        choices, actions = team.act(world)
        outcome = world.advance(actions)
        team.learn(choices, world, outcome)
        for k in range(2):
            if choices[k] is not None:
                cell, _, said.actions[k, step], perceived = choices[k]
                said.rewards[k, step] = outcome.rewards[k]
                if actions[k].asked:
                    said.percepts[k, step] = (cell, perceived)
        note_states()
        if world.step // CHECKPOINT > step // CHECKPOINT:
            note_tables()
        if outcome.episode_over and world.transitions < scenario.steps:
            before = world.step
            world.begin_episode()
            said.episodes.append(world.step)
            note_states()
            if world.step // CHECKPOINT > before // CHECKPOINT:
                note_tables()
    note_tables()
    return said


def pack(agent, step):
    """Return what the tables of an agent are as arrays of bytes, and the step."""
    return (agent.tables.q_star.tobytes(), agent.tables.q_coord.tobytes(), step)


def step_of(time_ns):
    assert time_ns % PERIOD_NS == 0
    return time_ns // PERIOD_NS


def by_robot_and_step(recorded, topic):
    """Return messages by (robot, step): there is one of each."""
    found = {}
    for k, name in enumerate(NAMES):
        for time_ns, message in recorded.topics[f"/{name}/{topic}"]:
            assert (k, step_of(time_ns)) not in found
            found[k, step_of(time_ns)] = message
    return found


def test_rosbags_decodes_everything(recorded):
    metadata = yaml.safe_load((recorded.bag / "metadata.yaml").read_text())
    information = metadata["rosbag2_bagfile_information"]
    counts = {
        topic["topic_metadata"]["name"]: topic["message_count"]
        for topic in information["topics_with_message_count"]
    }
    assert set(counts) == TEAM_TOPICS | EVENTS | {"/rosout", "/parameter_events"}
    assert {name: len(messages) for name, messages in recorded.topics.items()} == {
        name: count for name, count in counts.items() if count
    }
    assert all(counts[name] for name in TEAM_TOPICS | EVENTS)


def test_mcap_ros2_decodes_everything_but_service_events(recorded):
    (path,) = recorded.bag.glob("*.mcap")
    wanted = sorted(set(recorded.topics) - EVENTS)
    counts = Counter()
    for message in read_ros2_messages(path, topics=wanted):
        counts[message.channel.topic] += 1
        assert message.ros_msg is not None
    assert counts == {name: len(recorded.topics[name]) for name in wanted}


def test_both_readers_say_the_same(recorded):
    (path,) = recorded.bag.glob("*.mcap")
    for name in NAMES:
        theirs = list(read_ros2_messages(path, topics=[f"/{name}/action"]))
        ours = recorded.topics[f"/{name}/action"]
        assert len(theirs) == len(ours)
        for one, (time_ns, other) in zip(theirs, ours, strict=True):
            assert one.log_time_ns == time_ns
            assert list(one.ros_msg.name) == list(other.name)
            assert list(one.ros_msg.position) == list(other.position)


def test_a_local_state_for_each_robot_and_step(recorded):
    convert = Converter(recorded.run)
    states = by_robot_and_step(recorded, "local_state")
    assert set(states) == set(recorded.said.states)
    for (k, step), message in states.items():
        position = message.pose.position
        assert convert.cell(position.x, position.y) == recorded.said.states[k, step]
        assert message.header.frame_id == "map"


def test_a_reward_for_each_action(recorded):
    rewards = by_robot_and_step(recorded, "reward")
    assert set(rewards) == set(recorded.said.rewards)
    for key, message in rewards.items():
        assert tuple(message.position) == recorded.said.rewards[key][:4]
        assert message.name == ["individual", "common", "ask_cost", "total"]


def test_an_action_for_each_robot_and_step_where_one_is_due(recorded):
    vectors = [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)]
    actions = by_robot_and_step(recorded, "action")
    assert set(actions) == set(recorded.said.actions)
    for key, message in actions.items():
        action = recorded.said.actions[key]
        numbers = (*vectors[action.move], action.asked, action.peer + 1, action.perceived)
        assert tuple(message.position[:5]) == numbers
        account = dict(zip(message.name[5:], message.position[5:], strict=True))
        assert set(account) == {"percept", "learned"}
        ends = (1, 2) if action.asked else (0,)  # answered or refused
        assert account["percept"] in ends
        assert (account["percept"] == 1) == action.perceived
        assert account["learned"] == (key != min(one for one in actions if one[0] == key[0]))


def test_a_percept_for_each_question(recorded):
    convert = Converter(recorded.run)
    percepts = by_robot_and_step(recorded, "percept")
    assert set(percepts) == set(recorded.said.percepts)
    for key, message in percepts.items():
        positions = [stamped.pose.position for stamped in message.poses]
        cells = [convert.cell(position.x, position.y) for position in positions]
        own, perceived = recorded.said.percepts[key]
        assert cells == [own, *(perceived or ())]
    outcomes = Counter(perceived is None for _, perceived in recorded.said.percepts.values())
    assert set(outcomes) == {True, False}, "some percepts fail, some do not"
    summary = yaml.safe_load((recorded.out / "summary.yaml").read_text())
    asks = summary["asks"].values()
    assert sum(counts["refused"] for counts in asks) == outcomes[True]
    assert sum(counts["answered"] for counts in asks) == outcomes[False]


def test_the_dialogue_is_there(recorded):
    """Each question is there four times: sent, received, answered, its answer received."""
    for k, name in enumerate(NAMES):
        topic = f"/{name}/active_perception/_service_event"
        asked = sum(robot != k for robot, _ in recorded.said.percepts)
        messages = [deserialize_message(m, GetPlan.Event) for _, m in recorded.topics[topic]]
        events = Counter(message.info.event_type for message in messages)
        assert set(events) == {0, 1, 2, 3}
        assert all(count >= asked for count in events.values())


def test_log_times_are_those_of_the_steps(recorded):
    last = max(step for _, step in recorded.said.states) * PERIOD_NS
    for name in STEP_TOPICS:
        for time_ns, message in recorded.topics[name]:
            stamp = message.header.stamp
            assert time_ns == stamp.sec * 1_000_000_000 + stamp.nanosec
    for time_ns, message in recorded.topics["/clock"]:
        assert time_ns == message.clock.sec * 1_000_000_000 + message.clock.nanosec
    clocks = [step_of(time_ns) for time_ns, _ in recorded.topics["/clock"]]
    assert clocks == sorted({step for _, step in recorded.said.states})
    times = [time_ns for messages in recorded.topics.values() for time_ns, _ in messages]
    assert max(times) == last


def test_the_run_is_in_the_bag(recorded):
    ((_, message),) = recorded.topics["/run"]
    assert run_from_yaml(message.data, where="topic run") == recorded.run
    assert recorded.run.recorded
    (path,) = recorded.bag.glob("*.mcap")
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        attachments = {attachment.name: attachment for attachment in reader.iter_attachments()}
        records = {record.name: record.metadata for record in reader.iter_metadata()}
    assert attachments["run.yaml"].media_type == "application/yaml"
    assert attachments["run.yaml"].data == (recorded.out / "run.yaml").read_bytes()
    scenario = recorded.run.scenario
    assert yaml.safe_load(attachments["scenario.yaml"].data) == scenario.to_dict()
    assert attachments["map.txt"].data.decode() == scenario.map.to_text()
    assert records["sparse_coord_ros"]["scenario"] == "env1"
    assert records["sparse_coord_ros"]["seed"] == str(SEED)
    assert records["sparse_coord_ros"]["version_numpy"] == recorded.run.versions["numpy"]
    assert "serialized_metadata" in records["rosbag2"]


def test_the_tables_are_in_the_bag(recorded):
    """At the join, at each checkpoint and at the end, bit for bit those of the simulation."""
    (path,) = recorded.bag.glob("*.mcap")
    found = {}
    with path.open("rb") as file:
        for attachment in make_reader(file).iter_attachments():
            if attachment.name.startswith("tables/"):
                assert attachment.media_type == "application/x-npz"
                name, step = attachment.name[len("tables/") : -len(".npz")].rsplit("_", 1)
                k = NAMES.index(name)
                assert (k, int(step)) not in found
                (pair,) = unpack_tables(attachment.data, [k + 1], where=attachment.name)
                count = unpack_counts(attachment.data)["step"]
                found[k, int(step)] = (pair.q_star.tobytes(), pair.q_coord.tobytes(), count)
    assert len(found) >= 2 * 4
    assert found == recorded.said.tables


def test_latched_topics_are_there_at_each_episode(recorded):
    episodes = {step * PERIOD_NS for step in recorded.said.episodes}
    assert len(episodes) > 2
    for topic in ("/map", "/markers", *MAPS):
        assert episodes <= {time_ns for time_ns, _ in recorded.topics[topic]}


def test_the_status_tells_the_course(recorded):
    states = [message.message for _, message in recorded.topics["/status"]]
    assert states[-2:] == ["learning", "finished"]
    values = {v.key: v.value for v in recorded.topics["/status"][-1][1].values}
    assert values["transitions"] == str(STEPS)
    assert values["left_out"] == "0" and values["began"] in ("start", "arrived", "steps")


def test_latched_topics_stay_latched(recorded):
    (path,) = recorded.bag.glob("*.mcap")
    with path.open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    profiles = {
        channel.topic: yaml.safe_load(channel.metadata["offered_qos_profiles"])
        for channel in channels
    }
    for name in TEAM_TOPICS:
        (profile,) = profiles[name]
        assert profile["reliability"] == "reliable"
        assert profile["durability"] == ("transient_local" if name in LATCHED else "volatile")
        assert profile["history"] == "keep_last"
        assert (profile["depth"] == 1) == (name in LATCHED)
