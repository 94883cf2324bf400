# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables in the pages that are made from the code: `python docs/blocks.py` writes them anew.

Such a table stands between `<!-- made: NAME -->` and `<!-- end -->`; `BLOCKS` names what makes
it. All columns come from the code, but a last column `meaning`, where the code has no words for
it: this one is written in the page, and kept by the row's first cell.
"""

import re
from collections.abc import Callable, Iterable
from pathlib import Path

from rclpy.qos import DurabilityPolicy

from sparse_coord_ros.core.game.scenario import SETTINGS
from sparse_coord_ros.executables import NODES
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import services
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS, ParameterNode
from sparse_coord_ros.ros.nodes.player import Player
from sparse_coord_ros.ros.nodes.ros_topics import QOS_PROFILES

DOCS = Path(__file__).parent
BLOCK = re.compile(r"<!-- made: ([^\n]+) -->\n(.*?)<!-- end -->", re.DOTALL)
UNTOLD = "?"
"""The meaning of a row that the page does not explain yet."""

WITH_BODIES = (
    *(wire.BODY_GOALS, wire.REACHED, wire.CMD_VEL),
    *(wire.POSE, wire.ODOMETRY),
)
DELIVERIES = {
    wire.Delivery.STEP: "step",
    wire.Delivery.EVENT: "event",
    wire.Delivery.LATCHED: "latched",
    wire.Delivery.TABLES: "tables",
}
OF_TEAM = ("world_simulator", "robot", "recorder")
OF_BODIES = ("driver", "nav2_driver", "nav2_stand_in", "body")
OF_VIEWERS = ("player", "watch")

Rows = Iterable[list[str]]


def table(head: list[str], rows: Rows, old: str) -> str:
    """Return a table; where its last column is `meaning`, with the meanings of the old one."""
    meanings = {}
    for line in old.splitlines():
        cells = [cell.strip() for cell in line.strip("| ").split(" | ")]
        meanings[cells[0]] = cells[-1]
    lines = [head, ["---"] * len(head)]
    for row in rows:
        meaning = [meanings.get(row[0], UNTOLD)] if len(row) < len(head) else []
        lines.append([*row, *meaning])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _type(topic: wire.Topic) -> str:
    package, _, name = topic.type_name.split("/")
    labels = f": {', '.join(topic.labels)}" if topic.labels else ""
    return f"{package}/{name}{labels}"


def _topics(chosen: Iterable[wire.Topic]) -> Callable[[str], str]:
    head = ["topic", "type", "QoS", "in a bag", "meaning"]
    rows = []
    for one in chosen:
        name = f"<robot>/{one.name}" if one.owner == wire.Owner.ROBOT else one.name
        recorded = "yes" if one.recorded else ""
        rows.append([f"`{name}`", _type(one), DELIVERIES[one.delivery], recorded])
    return lambda old: table(head, rows, old)


def _of(owner: wire.Owner) -> list[wire.Topic]:
    return [one for one in wire.TOPICS if one.owner == owner and one not in WITH_BODIES]


def _qos(old: str) -> str:
    """Return the table of the QoS profiles, all of them reliable."""
    rows = []
    for delivery, word in DELIVERIES.items():
        profile = QOS_PROFILES[delivery]
        kept = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        durability = "transient local" if kept else "volatile"
        rows.append([word, durability, f"{profile.depth:,}"])
    return table(["QoS", "durability", "keep last", "meaning"], rows, old)


def _services(old: str) -> str:
    offered = [
        one for one in vars(services).values() if isinstance(one, services.Service)
    ]
    rows = []
    for one in offered:
        package, _, name = one.type_name.split("/")
        rows.append([f"`{one.name}`", f"{package}/{name}"])
    return table(["service", "type", "meaning"], rows, old)


def _nodes(old: str) -> str:
    return table(["executable", "meaning"], [[f"`{name}`"] for name in NODES], old)


def _parameters(nodes: tuple[str, ...]) -> Callable[[str], str]:
    """Return what makes the table of some nodes' parameters; those of scenarios are elsewhere."""
    found: dict[tuple[str, ...], list[str]] = {}
    for node in nodes:
        changeable = Player.changeable if node == "player" else ParameterNode.changeable
        for one in PARAMETERS[node].values():
            if one.name in SETTINGS:
                continue
            default = "" if one.default in ("", [""]) else str(one.default)
            default = default.lower() if one.kind is bool else default
            meaning = f"{one.help} ({one.allowed})" if one.choices else one.help
            meaning = meaning.replace("<", r"\<")
            live = "yes" if one.name in changeable else ""
            key = (f"`{one.name}`", default, live, meaning)
            found.setdefault(key, []).append(node)
    rows = [[row[0], ", ".join(of), *row[1:]] for row, of in found.items()]
    head = ["parameter", "of", "default", "live", "what"]
    return lambda old: table(head, rows, old)


BLOCKS: dict[str, Callable[[str], str]] = {
    "topics of the team": _topics(_of(wire.Owner.TEAM)),
    "topics of each robot": _topics(_of(wire.Owner.ROBOT)),
    "topics with bodies": _topics(WITH_BODIES),
    "QoS": _qos,
    "services": _services,
    "nodes": _nodes,
    "parameters of a team": _parameters(OF_TEAM),
    "parameters with bodies": _parameters(OF_BODIES),
    "parameters of viewers": _parameters(OF_VIEWERS),
}
"""What makes each table, from its old text."""


def made(text: str) -> str:
    """Return a page with its tables made anew."""

    def anew(block: re.Match[str]) -> str:
        name, old = block.groups()
        return f"<!-- made: {name} -->\n{BLOCKS[name](old)}\n<!-- end -->"

    return BLOCK.sub(anew, text)


def pages() -> list[Path]:
    """Return the pages that have such tables."""
    return [
        path for path in sorted(DOCS.glob("*.md")) if BLOCK.search(path.read_text())
    ]


def main() -> None:
    """Write the tables of all pages anew."""
    for path in pages():
        path.write_text(made(path.read_text()))


if __name__ == "__main__":
    main()
