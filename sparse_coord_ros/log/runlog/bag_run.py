# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The run of a bag."""

from contextlib import suppress
from typing import NamedTuple

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.core.runs import run_config
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.log.bags.reader import Bag
from sparse_coord_ros.log.runlog.decode import Decoder
from sparse_coord_ros.protocol.wire import RUN

REMEDY = "give the bag that 'sparse_coord run' or the recorder wrote"


class BagRun(NamedTuple):
    """The run of a bag.

    Attributes:
        run: the run.
        prefix: the beginning of the names of its topics.
    """

    run: RunConfig
    prefix: str


def find_run(bag: Bag) -> BagRun:
    """Return the run of a bag.

    Raises:
        BagError: the bag contains no run, or several, or has another format.
        RunError, ScenarioError, SettingError: the run is not one of this version.
    """
    named = [one for one in bag.topics.values() if one.name.endswith(f"/{RUN.name}")]
    topics = [one.name for one in named if one.type_name == RUN.type_name]
    no_run = f"{bag.path}: is not a bag of this package"
    if len(topics) > 1:
        several = f"it has several topics 'run' ({', '.join(sorted(topics))})"
        raise BagError(f"{no_run}: {several}; {REMEDY}")
    said = None
    with suppress(ValueError, StopIteration):
        said = str(Decoder(bag.topics)(*next(bag.messages(topics))[:2]).data)
    if said is None:
        damage = "" if bag.damage is None else f"; {bag.damage}"
        none = f"no {RUN.type_name} on the topic '{RUN.name}'"
        why = f"it holds no run of this software ({none}{damage})"
        raise BagError(f"{no_run}: {why}; {REMEDY}")
    run = run_config.run_from_yaml(said, where=str(bag.path))
    return BagRun(run, topics[0].removesuffix(RUN.name))
