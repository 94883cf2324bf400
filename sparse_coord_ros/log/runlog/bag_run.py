# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The run of a bag."""

from typing import NamedTuple

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.core.runs.run_config import RunConfig, run_from_yaml
from sparse_coord_ros.log.bags.reader import Bag
from sparse_coord_ros.log.runlog.decode import Decoder
from sparse_coord_ros.protocol.wire import RUN


class BagRun(NamedTuple):
    """The run of a bag.

    Attributes:
        run: the run.
        prefix: the beginning of the names of its topics.
    """

    run: RunConfig
    prefix: str


def find_run(bag: Bag) -> BagRun:
    """Return the run of a bag: its first message on a topic `run`.

    The bag's files are read up to there, whatever was read of the bag.

    Raises:
        BagError: the bag contains no run.
        RunError, ScenarioError, SettingError: the run is not one of this version.
    """
    again = Bag([file.path for file in bag.files])
    for part in again.read():
        for name in again.topics:
            if not name.endswith(f"/{RUN.name}"):
                continue
            for place in again.chosen(part, [name]).tolist():
                try:
                    said = str(Decoder(again.topics)(name, part.data(place)).data)
                except (ValueError, AttributeError):
                    continue
                run = run_from_yaml(said, where=str(bag.path))
                return BagRun(run, name.removesuffix(RUN.name))
    damage = "" if again.damage is None else f"; {again.damage}"
    what = f"it has no {RUN.type_name} on a topic '{RUN.name}'{damage}"
    remedy = "give the bag that 'sparse_coord run' or the recorder wrote"
    raise BagError(f"{bag.path}: is no recorded run: {what}; {remedy}")
