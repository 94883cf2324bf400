# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord info`: the content of a bag."""

import argparse
from collections.abc import Iterator
from typing import Any

from sparse_coord_ros.base.errors import SparseCoordError, in_line
from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.core.runs.repeating import repeating_command
from sparse_coord_ros.core.runs.run_config import RUN_RECORD
from sparse_coord_ros.log.bags.topics import latched

EXAMPLE = "sparse_coord info runs/demo/bag"


OPTIONS = (shared.BAG, shared.JSON)


def execute(options: argparse.Namespace) -> None:
    """Run the verb; 0, also of a damaged bag: `verify` judges it."""
    from sparse_coord_ros.log.bags.layout import being_recorded
    from sparse_coord_ros.log.bags.reader import open_bag

    bag = open_bag(options.bag, keep=False)
    facts = _information(
        bag, recording=not bag.finished and being_recorded(bag.files[-1].path)
    )
    shared.tell(options, facts, *_lines(facts))


def _information(bag, *, recording: bool) -> dict[str, Any]:
    record = dict(bag.metadata.get(RUN_RECORD, {}))
    versions = {
        name: record.pop(name) for name in list(record) if name.startswith("version_")
    }
    return {
        "file": bag.path,
        "files": [file.path.name for file in bag.files],
        "bytes": sum(file.size for file in bag.files),
        "finished": bag.finished,
        "recording": recording,
        "damage": bag.damage,
        "ends_early": bag.ends_early(f"message {bag.message_count}"),
        "compression": sorted(bag.compressions),
        "run": record,
        "versions": {
            name.removeprefix("version_"): version for name, version in versions.items()
        },
        "repeat": _command(bag),
        "start_seconds": bag.start_ns / 1e9,
        "duration_seconds": (bag.end_ns - bag.start_ns) / 1e9,
        "messages": bag.message_count,
        "topics": [
            {
                "name": name,
                "type": topic.type_name,
                "messages": bag.counts[name],
                "bytes": bag.sizes[name],
                "latched": latched(topic.qos),
                "reliable": all(qos.reliability == "reliable" for qos in topic.qos),
            }
            for name, topic in sorted(bag.topics.items())
        ],
    }


def _command(bag) -> str | None:
    """Return the command that repeats the bag's run; None: none can, or no run is known."""
    from sparse_coord_ros.log.runlog.reading import find_run

    try:
        return repeating_command(find_run(bag).run)
    except SparseCoordError:
        return None


def _lines(facts: dict[str, Any]) -> Iterator[str]:
    yield f"{facts['file']}: {facts['bytes']} bytes, {_state(facts)}"
    if len(facts["files"]) > 1:
        yield f"files: {', '.join(facts['files'])}"
    for what in ("run", "versions"):
        if facts[what]:
            pairs = ", ".join(f"{name} {value}" for name, value in facts[what].items())
            yield in_line(f"{what}: {pairs}")
    if facts["repeat"] is not None:
        yield in_line(f"repeat it: {facts['repeat']}")
    yield (
        f"{facts['messages']} messages in {facts['duration_seconds']:.1f} s of simulated time, "
        f"chunks {', '.join(facts['compression']) or 'none'}\n"
    )
    rows = [
        [
            topic["name"],
            str(topic["messages"]),
            str(topic["bytes"]),
            _qos_in_words(topic),
            topic["type"],
        ]
        for topic in facts["topics"]
    ]
    yield shared.format_table(["topic", "messages", "bytes", "QoS", "type"], rows)


def _qos_in_words(topic: dict[str, Any]) -> str:
    if topic["latched"]:
        return "latched"
    return "reliable" if topic["reliable"] else "best effort"


def _state(facts: dict[str, Any]) -> str:
    if facts["recording"]:
        return "being recorded; shown up to the last part that its recorder has written"
    return facts["ends_early"] or "finished"
