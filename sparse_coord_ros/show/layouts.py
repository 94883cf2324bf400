# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Layouts of RViz and Foxglove for a team: the shipped files, for its robots and namespace."""

import json
from collections.abc import Sequence
from typing import Any

from sparse_coord_ros.base.palette import robot_colour
from sparse_coord_ros.base.share import share_folder
from sparse_coord_ros.base.yaml_text import parse_yaml, to_yaml

PATTERN = "robot_1"
"""The robot in the shipped files that represents all robots."""


def rviz_config(robots: Sequence[str], namespace: str) -> str:
    """Return rviz/team.rviz for these robots, in a namespace."""
    template = share_folder("rviz") / "team.rviz"
    shown: Any = parse_yaml(template.read_text(), where=str(template))
    displays = shown["Visualization Manager"]["Displays"]
    for group in displays:
        if "Displays" in group:
            pattern = to_yaml(group["Displays"][0])
            group["Displays"] = [
                parse_yaml(pattern.replace(PATTERN, name), where=str(template))
                for name in robots
            ]
    return _within(to_yaml(shown), "Value: /", namespace)


def foxglove_layout(robots: Sequence[str], namespace: str) -> str:
    """Return foxglove/team.json for these robots, in a namespace."""
    shown = json.loads((share_folder("foxglove") / "team.json").read_text())
    for panel in shown["configById"].values():
        if "paths" in panel:
            pattern = json.dumps(panel["paths"][0])
            panel["paths"] = [
                json.loads(pattern.replace(PATTERN, name)) | {"color": robot_colour(k)}
                for k, name in enumerate(robots)
            ]
        if "topics" in panel:
            looks = panel["topics"]
            panel["topics"] = {
                topic: look
                for topic, look in looks.items()
                if not topic.startswith("/robot_")
            }
            for topic, look in looks.items():
                if topic.startswith(f"/{PATTERN}/"):
                    for name in robots:
                        panel["topics"][topic.replace(PATTERN, name)] = look
    text = _within(json.dumps(shown, indent=2), '"/', namespace)
    # all teams share it
    return text.replace(f'"/{namespace}/diagnostics"', '"/diagnostics"')


def _within(text: str, before: str, namespace: str) -> str:
    """Return a text whose topics, each after `before`, are in a namespace."""
    return text.replace(before, f"{before}{namespace}/" if namespace else before)
