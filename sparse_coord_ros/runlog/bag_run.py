# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which run a bag is of, and whether all places of the bag that say so agree."""

from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

from sparse_coord_ros.bags.reader import Bag
from sparse_coord_ros.bags.recover import recovered_text
from sparse_coord_ros.errors import BagError, SparseCoordError
from sparse_coord_ros.game.scenario import parse_yaml, scenario_from_dict
from sparse_coord_ros.learn.run_config import (
    MAP_FILE,
    RUN_FILE,
    RUN_RECORD,
    SCENARIO_FILE,
    RunConfig,
    run_from_yaml,
)
from sparse_coord_ros.runlog.decode import Decoder
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.wire import RUN

REMEDY = "give the bag that 'sparse_coord run' or the recorder wrote"


class BagRun(NamedTuple):
    """Which run a bag is of.

    Attributes:
        run: the run.
        prefix: what the names of its topics begin with.
        said: the text on the topic `run`; None: there is no message.
    """

    run: RunConfig
    prefix: str
    said: str | None


def find_run(bag: Bag, decode: Decoder) -> BagRun:
    """Return the run of a bag.

    Raises:
        BagError: the bag holds no run, or several, or is of another format.
        RunError, ScenarioError, SettingError: the run is not one of this version.
    """
    named = [name for name in bag.topics if name.endswith(f"/{RUN.name}")]
    topics = [name for name in named if bag.topics[name].type_name == RUN.type_name]
    if len(topics) > 1:
        raise BagError(
            f"{bag.path}: is not a bag of this package: it has several topics 'run' "
            f"({', '.join(sorted(topics))}); {REMEDY}"
        )
    text = said = None
    for message in bag.messages(topics):
        try:
            text = said = decode(message.topic, message.data).data
        except ValueError:
            pass
        break
    if text is None and any(one.name == RUN_FILE for one in bag.attachments):
        text = _attached(bag, RUN_FILE).decode(errors="replace")
    if text is None:
        odd = "".join(f"; {name} is a {bag.topics[name].type_name}" for name in named)
        odd = "" if topics else odd
        raise BagError(
            f"{bag.path}: is not a bag of this package: it holds no run of this software (neither "
            f"a {RUN.type_name} on the topic '{RUN.name}' nor the attachment {RUN_FILE}{odd}"
            f"{'' if bag.damage is None else f'; {bag.damage}'}); {REMEDY}"
        )
    prefix = topics[0].removesuffix(RUN.name) if topics else "/"
    try:
        run = run_from_yaml(text, where=f"{bag.path} (run)")
    except SparseCoordError as error:
        if not bag.metadata.get(RUN_RECORD):
            raise BagError(f"{bag.path}: is not a bag of this package: {error}") from None
        raise
    return BagRun(run, prefix, said)


def check_bag_run(bag: Bag, source: BagRun) -> Iterator[Difference]:
    """Yield what is wrong with the file, and in what its places say another run.

    Args:
        bag: the bag.
        source: its run.
    """
    yield from _about_the_file(bag)
    yield from _copies(bag, source.run, source.said)
    yield from _record(bag, source.run)


def _about_the_file(bag: Bag) -> Iterator[Difference]:
    if bag.damage is not None:
        yield Difference(None, None, "file", bag.damage, "an undamaged file")
    elif bag.recovered is not None:
        logged = recovered_text(bag.recovered)
        yield Difference(None, None, "file", logged, "a file that its recorder closed")
    elif not bag.finished:
        yield Difference(None, None, "file", "unfinished", "a file that its recorder closed")


def _copies(bag: Bag, run: RunConfig, said: str | None) -> Iterator[Difference]:
    """Compare the topic `run` and the attached files with the run."""
    if said is None:
        yield Difference(None, None, f"topic {RUN.name}", MISSING, "the run's settings")
    if any(count > 1 and name.endswith(f"/{RUN.name}") for name, count in bag.counts.items()):
        yield Difference(None, None, f"topic {RUN.name}", "twice", "once")
    scenario = run.scenario
    due = {RUN_FILE: said, SCENARIO_FILE: scenario.to_dict(), MAP_FILE: scenario.map.to_text()}
    found = Counter(one.name for one in bag.attachments)
    for name, expected in due.items():
        where = f"attachment {name}"
        if found[name] > 1:
            yield Difference(None, None, where, "twice", "once")
        if not found[name]:
            yield Difference(None, None, where, MISSING, "of the run")
            continue
        text = _attached(bag, name).decode(errors="replace")
        if name == RUN_FILE:
            if said is not None and text != said:
                yield _first_line(where, text, said)
        elif (_scenario(text) if name == SCENARIO_FILE else text) != expected:
            yield Difference(None, None, where, "another one", "the scenario of the run")


def _record(bag: Bag, run: RunConfig) -> Iterator[Difference]:
    """Compare the metadata record with the run."""
    records = [texts for name, texts in bag.metadata_records if name == RUN_RECORD]
    due = run.record()
    if not records:
        yield Difference(None, None, f"metadata {RUN_RECORD}", MISSING, "scenario, seed, learner")
    if len(records) > 1:
        yield Difference(None, None, f"metadata {RUN_RECORD}", "twice", "once")
    for record in records:
        for key in sorted(set(due) & set(record)):
            if record[key] != due[key]:
                yield Difference(None, None, f"metadata {key}", repr(record[key]), repr(due[key]))


def _attached(bag: Bag, name: str) -> bytes:
    return next(one.data for one in bag.attachments if one.name == name)


def _scenario(text: str) -> dict[str, Any] | None:
    """Return the scenario that a text holds, with what an older one lacks; None: it holds none."""
    try:
        data = parse_yaml(text, where=SCENARIO_FILE)
        found = scenario_from_dict(data, where=SCENARIO_FILE, name="scenario")
    except (SparseCoordError, RecursionError):
        return None
    return found.to_dict()


def _first_line(where: str, text: str, said: str) -> Difference:
    pairs = zip(text.splitlines(), said.splitlines(), strict=False)
    theirs, ours = next(((a, b) for a, b in pairs if a != b), ("another length", "its text"))
    return Difference(
        None, None, where, repr(theirs.strip()), f"as topic {RUN.name} {ours.strip()!r}"
    )
