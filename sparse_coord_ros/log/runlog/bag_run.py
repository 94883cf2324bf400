# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The run of a bag, and a check that all copies of it in the bag agree."""

from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

from sparse_coord_ros.base.errors import BagError, SparseCoordError
from sparse_coord_ros.core.runs import run_config
from sparse_coord_ros.core.runs.run_config import RUN_FILE, RUN_RECORD, RunConfig
from sparse_coord_ros.log.bags.contents import Attachment
from sparse_coord_ros.log.bags.reader import Bag
from sparse_coord_ros.log.runlog.decode import Decoder
from sparse_coord_ros.log.runlog.difference import MISSING, TWICE, Difference
from sparse_coord_ros.protocol.wire import RUN

REMEDY = "give the bag that 'sparse_coord run' or the recorder wrote"


class BagRun(NamedTuple):
    """The run of a bag.

    Attributes:
        run: the run.
        prefix: the beginning of the names of its topics.
        text: the text on the topic `run`; None: no message.
    """

    run: RunConfig
    prefix: str
    text: str | None


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
    attached = (_text(one) for one in bag.attachments if one.name == RUN_FILE)
    text = next(attached, None) if said is None else said
    if text is None:
        damage = "" if bag.damage is None else f"; {bag.damage}"
        none = f"neither a {RUN.type_name} on the topic '{RUN.name}'"
        why = f"it holds no run of this software ({none} nor the attachment {RUN_FILE}{damage})"
        raise BagError(f"{no_run}: {why}; {REMEDY}")
    prefix = topics[0].removesuffix(RUN.name) if topics else "/"
    try:
        run = run_config.run_from_yaml(text, where=f"{bag.path} (run)")
    except SparseCoordError as error:
        if not bag.metadata.get(RUN_RECORD):
            raise BagError(f"{no_run}: {error}") from None
        raise
    return BagRun(run, prefix, said)


def check_bag_run(bag: Bag, source: BagRun) -> Iterator[Difference]:
    """Yield the places of a bag with another run, or without one.

    Args:
        bag: the bag.
        source: its run.
    """
    run = source.run
    said = source.text
    announced = [
        count for name, count in bag.counts.items() if name.endswith(f"/{RUN.name}")
    ]
    records = [texts for name, texts in bag.metadata_records if name == RUN_RECORD]
    yield from _once(
        f"topic {RUN.name}", 0 if said is None else max(announced), "the settings"
    )
    for name, text in run_config.bag_files(run, said or run.to_yaml()).items():
        attached = [_text(one) for one in bag.attachments if one.name == name]
        yield from _once(f"attachment {name}", len(attached), "of the run")
        for found in attached[:1]:
            if found != text and (name != RUN_FILE or said is not None):
                yield _difference(f"attachment {name}", *_first_line(found, text))
    yield from _once(f"metadata {RUN_RECORD}", len(records), "scenario, seed, learner")
    due = run.record()  # keys that a later version adds are not compared
    for record in records:
        for key in sorted(due):
            if record.get(key) != due[key]:
                logged = repr(record[key]) if key in record else MISSING
                yield _difference(f"metadata {key}", logged, repr(due[key]))


def _once(where: str, count: int, due: str) -> Iterator[Difference]:
    if count == 0:
        yield _difference(where, MISSING, due)
    elif count > 1:
        yield _difference(where, TWICE, "once")


def _difference(quantity: str, logged: str, computed: str) -> Difference:
    return Difference(None, None, quantity, logged, computed)


def _text(attachment: Attachment) -> str:
    return attachment.data.decode(errors="replace")


def _first_line(text: str, due: str) -> tuple[str, str]:
    """Return the first different line of two texts, from both."""
    pairs = zip(text.splitlines(), due.splitlines(), strict=False)
    lines = next(((a, b) for a, b in pairs if a != b), ("another length", "its text"))
    return repr(lines[0].strip()), f"{lines[1].strip()!r}, as topic {RUN.name} has it"
