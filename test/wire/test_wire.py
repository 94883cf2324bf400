# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The wire has one vocabulary, which no other module spells, and says what makes sense."""

import ast
from pathlib import Path

import numpy as np

import sparse_coord_ros
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import PerceptEnd, services
from sparse_coord_ros.protocol.wire.cdr import Fixed, Free, Layout

PACKAGE = Path(sparse_coord_ros.__file__).parent
TOPICS = wire.TOPICS
ODD = {topic.type_name for topic in TOPICS} | {
    wire.LOCAL_STATE.name,
    wire.COORDINATION_MAP.name,
    services.ACTIVE_PERCEPTION.name,
    wire.ROSOUT.name,
    wire.PARAMETER_EVENTS.name,
}
"""Names that mean nothing else."""


def test_only_the_vocabulary_spells_topics_and_types():
    spelled = set()
    for path in PACKAGE.rglob("*.py"):
        if "wire" in path.parts or "studies" in path.parts:  # tables/ of a report
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and node.value in ODD:
                spelled.add((path.name, node.value))
    assert not spelled


def test_names_and_labels_are_there_once():
    assert len({(topic.name, topic.owner) for topic in TOPICS}) == len(set(TOPICS))
    labels = [label for topic in TOPICS for label in topic.labels]
    assert len({*wire.ACTION.labels}) == len(wire.ACTION.labels) and "percept" in labels


def test_a_percept_of_which_nobody_says_how_it_ended():
    assert PerceptEnd.untold(perceived=True, peers=2) is PerceptEnd.ANSWERED
    assert PerceptEnd.untold(perceived=False, peers=2) is PerceptEnd.REFUSED
    assert PerceptEnd.untold(perceived=False, peers=0) is PerceptEnd.NOBODY_TO_ASK


def test_a_message_has_a_layout_only_where_all_its_fixed_fields_fit():
    layout = Layout([Fixed("<u4", 7), Free("x", "<i4"), Fixed("<u4", 9)])
    good = layout.pack(3)
    fitting = []
    for place in range(len(good)):
        data = good[:place] + bytes([good[place] ^ 1]) + good[place + 1 :]
        [fits] = layout.read(data, np.array([0]))[0].tolist()
        assert fits == (layout.unpack(data) is not None)
        fitting.append(fits)
    assert sum(fitting) == 4, "those of the free field"
