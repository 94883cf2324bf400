# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Live runs of the nine scenarios: every reader opens their bags, and these prove themselves."""

from collections import Counter

import pytest
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader

from sparse_coord_ros.bags import open_bag
from sparse_coord_ros.experiments.catalogue import LARGE, SMALL
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.simulation import learn, tables_equal
from sparse_coord_ros.learn.tables import load_team
from sparse_coord_ros.nodes.spin import ros_context
from sparse_coord_ros.nodes.team import run_team
from sparse_coord_ros.runlog import verify

SEED, STEPS = 3, 60
EVENT = "/active_perception/_service_event"


@pytest.mark.parametrize(
    "name",
    [
        name if name == "env2-4r" else pytest.param(name, marks=pytest.mark.long)
        for name in SMALL + LARGE
    ],
)
def test_a_recorded_run(name, tmp_path):
    out = tmp_path / "out"
    values = {"scenario": name, "seed": SEED, "set": [f"steps={STEPS}"], "out": str(out)}
    with ros_context() as context:
        run_team({**values, "record": True, "claim_window": 0.0}, context=context)
    bag = open_bag(out / "bag")
    assert bag.damage is None
    counts = {topic: count for topic, count in bag.counts.items() if count}
    assert counts["/clock"] > STEPS

    with AnyReader([out / "bag"]) as reader:
        seen = Counter()
        for connection, _, data in reader.messages():
            seen[connection.topic] += 1
            # rosbags opens a bag with service events but does not know their type by its name.
            if not connection.topic.endswith(EVENT):
                reader.deserialize(data, connection.msgtype)
    assert seen == counts
    plain = [topic for topic in counts if not topic.endswith(EVENT)]
    decoded = Counter(m.channel.topic for m in read_ros2_messages(bag.path, topics=plain))
    assert decoded == {topic: counts[topic] for topic in plain}

    assert verify(out / "bag").same
    scenario = load_scenario(name).with_settings({"steps": STEPS})
    assert tables_equal(load_team(out, scenario), learn(scenario, "coop", SEED))
