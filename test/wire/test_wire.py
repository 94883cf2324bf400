# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The wire has one vocabulary: no other module spells its topics or types."""

import ast
from pathlib import Path

import sparse_coord_ros
from sparse_coord_ros import wire
from sparse_coord_ros.wire import services

PACKAGE = Path(sparse_coord_ros.__file__).parent
TOPICS = wire.TOPICS
ODD = {topic.type_name for topic in TOPICS} | {
    wire.LOCAL_STATE.name,
    wire.COORDINATION_MAP.name,
    wire.SERVICE_EVENTS.name,
    services.ACTIVE_PERCEPTION.name,
    wire.CLOCK.name,
    wire.ROSOUT.name,
    wire.PARAMETER_EVENTS.name,
    wire.TABLES_FOLDER,
}
"""Names that mean nothing else."""


def test_only_the_vocabulary_spells_topics_and_types():
    spelled = set()
    for part in ("bags", "runlog", "nodes", "lockstep", "cli", "bench"):
        for path in sorted((PACKAGE / part).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Constant) and node.value in ODD:
                    spelled.add((path.name, node.value))
    assert not spelled


def test_names_and_labels_are_there_once():
    assert len({(topic.name, topic.owner) for topic in TOPICS}) == len(set(TOPICS))
    labels = [label for topic in TOPICS for label in topic.labels]
    assert len({*wire.ACTION.labels}) == len(wire.ACTION.labels) and "percept" in labels
    assert wire.tables_attachment("robot_1", 7) == "tables/robot_1_7.npz"
