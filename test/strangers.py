# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a stranger does to a team: damaged data, random messages, a visitor on every topic.

python test/strangers.py [--seconds N] [--seed S] [--lie ROBOT]

publishes on every topic of a team of two and calls its services for a while; the tests use it as a
class. What the visitor says fits no run: its stamps, identities and numbers are those of no team,
so what is learned is to stay as it is. With --lie it serves a robot's `active_perception` too, and
says that the robot is where the asker is.
"""

import argparse
import math
import random
import re
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.serialization import serialize_message

from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import NODE, ROBOT, RunState, services
from sparse_coord_ros.ros.nodes.ros_topics import bind, message_class
from sparse_coord_ros.ros.nodes.spin import ros_context, signals, spin_nodes

ODD_NUMBERS = (0, 1, -1, 2**31 - 1, -(2**31), 2**63 - 1, 2**64 - 1, 10**5, 255, 65_536)
ODD_FLOATS = (math.nan, math.inf, -math.inf, -1.0, 0.0, 1e300, 1e-300, 0.5, 2.0**53)
ODD_TEXTS = (
    *(
        "",
        "map",
        "odom",
        "x" * 999,
        "robot_1",
        "robot_9",
        "../../etc",
        "\x1b[2J",
        "ä\u2028",
    ),
    *(
        "a joined",
        "9 holding",
        "1:1:1",
        "[" * 400,
        "format: 4",
        "learner: os:system",
        "nan",
    ),
)
FAR = (-(2**31), -1, 10**5, 2**31 - 1)
"""Seconds of a stamp that are no time of a short run."""
PAUSE = 0.002
"""Seconds between two words."""


def damaged(chance: random.Random, data: bytes) -> bytes:
    """Return data with some bytes, bits, or numbers changed, or a part cut, doubled or zeroed."""
    changed = bytearray(data)
    for _ in range(chance.choice((0, 1, 1, 1, 2, 3, 8))):
        at = chance.randrange(len(changed) + 1)
        size = chance.choice((1, 2, 4, 8))
        long = chance.choice((1, 4, 50, 500, 5000))
        part = changed[at : at + long]
        number = chance.choice((*ODD_NUMBERS, chance.randrange(1000))) % 256**size
        put = (
            bytes(byte ^ 1 << chance.randrange(8) for byte in part[:1]),
            number.to_bytes(size, "little"),  # a size or a count
            b"",
            bytes(part + part),
            chance.randbytes(min(long, 50)),
            bytes(len(part)),
        )
        kind = chance.randrange(len(put))
        changed[at : at + (len(put[kind]) if kind < 2 else len(part))] = put[kind]
    return bytes(changed)


def message_with(
    chance: random.Random, kind: type, stamp: Callable[[], int] | None = None
) -> Any:
    """Return a message of a type (or a request) whose fields are drawn, odd ones often.

    Args:
        chance: draws.
        kind: the message's class.
        stamp: the seconds of its times; None: any.
    """
    message = kind()
    for name, said in kind.get_fields_and_field_types().items():
        if name == "sec" and stamp is not None:
            setattr(message, name, stamp())
        elif chance.random() < 0.8:
            setattr(message, name, _drawn(chance, said, getattr(message, name), stamp))
    return message


def _drawn(
    chance: random.Random, said: str, before: Any, stamp: Callable[[], int] | None
) -> Any:
    """Return a value of a field's type; `before`: the one that a new message has."""
    several = re.fullmatch(r"sequence<(.+?)(?:, (\d+))?>|(.+)\[(\d+)\]", said)
    if several:
        base, most, of, exactly = several.groups()
        counts = (0, 1, 2, 3) if "/" in said else (0, 1, 2, 3, 9, 200)
        count = int(exactly or min(int(most or 9999), chance.choice(counts)))
        found = [_drawn(chance, base or of, None, stamp) for _ in range(count)]
        return bytes(found) if isinstance(before, bytes) else found
    if "/" in said:
        part = "srv" if re.search("_(Request|Response)$", said) else "msg"
        return message_with(
            chance, message_class(said.replace("/", f"/{part}/")), stamp
        )
    if said.startswith("string"):
        if chance.random() < 0.4:
            labels = (*wire.ACTION.labels, *wire.REWARD.labels, *wire.REACHED.labels)
            return chance.choice((*labels, *wire.BODY_GOALS.labels, *RunState))
        return chance.choice(ODD_TEXTS)
    if said in ("float", "double"):
        return (
            chance.choice((*ODD_FLOATS, chance.uniform(-9, 9)))
            if said == "double"
            else 0.5
        )
    if said == "boolean":
        return chance.random() < 0.5
    if said == "octet":
        return bytes([chance.randrange(4)])
    bits = int(re.sub(r"\D", "", said))
    signed = not said.startswith("u")
    number = chance.choice((*ODD_NUMBERS, chance.randrange(100))) % 2 ** (bits - signed)
    return -number if signed and chance.random() < 0.2 else number


class Visitor:
    """Publishes on every topic of a team, and asks every service.

    Args:
        node: a node of its own, which nobody else uses.
        robots: the names of the team's robots.
        seed: of what it says.

    Attributes:
        said: how many messages and requests it has sent.
    """

    def __init__(self, node: Node, robots: Sequence[str], seed: int) -> None:
        self._chance = random.Random(seed)
        self.node = node
        self.said = 0
        owners = {ROBOT: tuple(robots), NODE: (*robots, wire.WORLD, wire.RECORDER)}
        self._publishers = []
        for topic in wire.TOPICS:
            ros = bind(topic)
            for name in (topic.of(owner) for owner in owners.get(topic.owner, ())):
                self._publishers.append(
                    (ros, node.create_publisher(ros.type, name, ros.qos))
                )
            if topic.owner not in owners:
                publisher = node.create_publisher(ros.type, topic.name, ros.qos)
                self._publishers.append((ros, publisher))
        asked = [(one, name) for name in robots for one in (_ASK, services.SAVE)]
        self._clients = []
        for service, name in asked:
            kind = message_class(service.type_name)
            self._clients.append(node.create_client(kind, service.of(name)))

    def step(self) -> None:
        """Say one thing, and now and then ask one."""
        chance = self._chance
        topic, publisher = chance.choice(self._publishers)
        data = chance.randbytes(chance.randrange(200))
        if chance.random() < 0.8:
            data = serialize_message(message_with(chance, topic.type, self._far))
            # With damage a stamp or an identity might fit by chance: 1 in 10^6 of what is said.
            data = damaged(chance, data) if chance.random() < 0.3 else data
        try:
            publisher.publish(data)
            self.said += 1
        except rclpy_implementation.RCLError:
            pass  # more bytes than the type can have: Fast DDS does not send them
        if chance.random() < 0.1:
            client = chance.choice(self._clients)
            request = message_with(chance, client.srv_type.Request, self._far)
            client.remove_pending_request(client.call_async(request))
            self.said += 1

    def _far(self) -> int:
        return self._chance.choice(FAR)


_ASK = services.ACTIVE_PERCEPTION


def lie(node: Node, robot: str) -> None:
    """Serve a robot's `active_perception` too: it is where the asker is."""

    def answer(request: Any, response: Any) -> Any:
        response.plan.header = request.start.header
        response.plan.poses = [request.start]
        return response

    node.create_service(message_class(_ASK.type_name), _ASK.of(robot), answer)


def main(arguments: Sequence[str] | None = None) -> int:
    """Visit a team for a while."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--lie", metavar="ROBOT", help="only lie, as this robot")
    options = parser.parse_args(arguments)
    end = time.monotonic() + options.seconds
    with ros_context() as context, signals() as stop:
        node = rclpy.create_node("stranger", context=context)
        if options.lie:
            lie(node, options.lie)
            spin_nodes([node], context, lambda: bool(stop))
        else:
            visitor = Visitor(node, ("robot_1", "robot_2"), options.seed)
            while not stop and time.monotonic() < end:
                visitor.step()
                time.sleep(PAUSE)
            print(f"said {visitor.said}", flush=True)
        node.destroy_node()
    return 0


if __name__ == "__main__":
    sys.exit(main())
