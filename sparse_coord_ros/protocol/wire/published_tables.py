# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The content of a message on `tables`: a robot's tables, live and in bags."""

from typing import Any, NamedTuple


class PublishedTables(NamedTuple):
    """A robot's tables as it publishes them.

    Attributes:
        packed: the bytes of an .npz file.
        step: the tables contain all learning before this time step.
        occasion: one of `wire.Occasion`.
        attempt: the attempt of the run (`Order.attempt`).
    """

    packed: bytes
    step: int
    occasion: str
    attempt: str


def read_tables(message: Any) -> PublishedTables:
    """Return the tables in a decoded std_msgs/UInt8MultiArray.

    Raises:
        ValueError: the message has another layout.
    """
    dimensions = message.layout.dim
    labels = [dimension.label for dimension in dimensions]
    if len(labels) != 3 or labels[0] != "npz":
        raise ValueError(f"has the dimensions {labels}, not npz, occasion and attempt")
    return PublishedTables(
        bytes(message.data), dimensions[1].size, labels[1], labels[2]
    )
