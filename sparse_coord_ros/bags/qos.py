# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service of a recorded topic, and the text in which rosbag2 stores it.

A player offers what the recording says: without `transient_local` in the bag a replayed `map` is
no longer latched.
"""

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from sparse_coord_ros.errors import BagError
from sparse_coord_ros.limits import METADATA, Dumper, yaml_value

# rmw's RMW_DURATION_INFINITE, 2**63 - 1 ns: what rosbag2 records for a publisher without a
# deadline, lifespan or lease.
_INFINITE = {"sec": 9223372036, "nsec": 854775807}

_POLICIES = {
    "reliability": ("reliable", "best_effort"),
    "durability": ("transient_local", "volatile"),
    "history": ("keep_last", "keep_all"),
}
"""In the order of rmw's numbers from 1, by which rosbag2 called them before version 9."""


@dataclass(frozen=True)
class QoS:
    """The quality of service that a topic's publisher offers.

    Attributes:
        reliability: `reliable` or `best_effort`.
        durability: `volatile`, or `transient_local` for a latched topic.
        history: `keep_last` or `keep_all`.
        depth: messages kept with `keep_last`, 0 or more; ignored with `keep_all`.
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "keep_last"
    depth: int = 10

    def as_mapping(self) -> dict[str, Any]:
        """Return the profile with the keys, order and policy names of rosbag2 version 9."""
        return {
            "history": self.history,
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": dict(_INFINITE),
            "lifespan": dict(_INFINITE),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(_INFINITE),
            "avoid_ros_namespace_conventions": False,
        }


def offered_qos_profiles(profiles: Iterable[QoS]) -> str:
    """Return the profiles as the YAML text of a channel's `offered_qos_profiles`.

    Args:
        profiles: one profile for each publisher of the topic; none gives `[]`.

    Returns:
        A YAML sequence as rosbag2 (metadata version 9) writes it, without a final newline.
    """
    return yaml_text([profile.as_mapping() for profile in profiles])


@functools.lru_cache
def profiles_from_text(text: str) -> tuple[QoS, ...]:
    """Return the profiles of a channel's `offered_qos_profiles`, in any version's spelling.

    Raises:
        BagError: the text is not YAML, or not a list of profiles.
    """
    try:
        entries = yaml_value(text, where="QoS", limit=METADATA, error=BagError) or []
        return tuple(_profile(entry) for entry in entries)
    except (BagError, ValueError, OverflowError, TypeError, AttributeError) as error:
        raise BagError("its QoS profiles cannot be read") from error


def _profile(entry: dict[str, Any]) -> QoS:
    values: dict[str, Any] = {"depth": int(entry.get("depth", QoS.depth))}
    if values["depth"] < 0:
        raise ValueError
    for name, allowed in _POLICIES.items():
        value = entry.get(name)
        if isinstance(value, int) and 1 <= value <= len(allowed):
            value = allowed[value - 1]
        # Else it is what rosbag2 calls unknown, system_default or best_available.
        values[name] = value if value in allowed else getattr(QoS, name)
    return QoS(**values)


class _Rosbag2Dumper(Dumper):
    """PyYAML laid out as yaml-cpp does, so that bags compare equal to rosbag2's as text."""

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        """Indent sequences below their key."""
        super().increase_indent(flow, False)


_Rosbag2Dumper.add_representer(
    type(None), lambda dumper, _: dumper.represent_scalar("tag:yaml.org,2002:null", "~")
)
_Rosbag2Dumper.add_representer(
    str,
    lambda dumper, text: dumper.represent_scalar(
        "tag:yaml.org,2002:str", text, style=None if text else '"'
    ),
)


def yaml_text(value: Any) -> str:
    """Return a plain value as YAML in rosbag2's layout, without a final newline."""
    layout: dict[str, Any] = {"sort_keys": False, "default_flow_style": False, "width": 2**31}
    text = yaml.dump(value, Dumper=_Rosbag2Dumper, allow_unicode=True, **layout)
    return text.rstrip("\n")


def latched(profiles: Sequence[QoS]) -> bool:
    """Whether a late subscriber gets the last message."""
    return any(qos.durability == "transient_local" for qos in profiles)
