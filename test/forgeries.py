# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The corpus: forgeries of recorded runs, and the allowed results of `verify`.

A `Case` is (recorded run, forgeries) -> the outcomes that are right. Cases are drawn with a seed
from all that a bag holds: every field of every topic, every message, every array of every
attachment, metadata, settings, plans. `NO_CLAIM` lists what says nothing about the run: the same
list, for people, is in docs/log.md. Everything else is a claim, and once it is changed `verify`
must not say "identical".
"""

import random
import re
import shutil
from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

from forging import (
    ARRAY_WAYS,
    ATTACHMENT_WAYS,
    MESSAGE_WAYS,
    PERIOD_NS,
    WAYS,
    Bag,
    Forgery,
    Path_,
    attachments_of,
    class_of,
    forged,
    leaves,
    places_of,
    run_text,
    unpacked,
    write,
)
from rclpy._rclpy_pybind11 import RMWError
from rclpy.serialization import deserialize_message

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SparseCoordError
from sparse_coord_ros.log.runlog.verify import FOREIGN, LOST_COPIES, REPEATS


class Outcome(StrEnum):
    """What `verify` says of a bag.

    Identical; identical, but it names foreign messages or lost copies; undecided; it differs;
    it refuses the bag.
    """

    IDENTICAL = "identical"
    NOTED = "identical with a note"
    UNDECIDED = "undecided"
    DIFFERS = "differs"
    REFUSED = "refused"


FOUND = frozenset({Outcome.DIFFERS, Outcome.UNDECIDED, Outcome.REFUSED})
"""Of a claim that was changed."""

NAMED = FOUND | {Outcome.NOTED}
"""Of a message that was added, or of a copy that was taken away: at least it is named."""

ANY = frozenset(Outcome)
"""Of what is no claim: `verify` need not see it, and ends in words."""


class Case(NamedTuple):
    """One forged bag.

    Attributes:
        run: the name of a recorded run.
        forgeries: what is done to its bag.
        right: the outcomes that are right.
    """

    run: str
    forgeries: tuple[Forgery, ...]
    right: frozenset[Outcome]


NAMED_IN_NOTES = (FOREIGN, LOST_COPIES, REPEATS)
"""Beginnings of the notes that name a message too many or a lost one."""


def outcome(directory: Path) -> Outcome:
    """Return the result of `verify` on a bag."""
    try:
        found = sc.verify(directory)
    except SparseCoordError:
        return Outcome.REFUSED
    if found.undecided:
        return Outcome.UNDECIDED
    if not found.same:
        return Outcome.DIFFERS
    noted = any(name.startswith(NAMED_IN_NOTES) for name in found.notes)
    return Outcome.NOTED if noted else Outcome.IDENTICAL


def wrong(
    bag: Bag, cases: Sequence[Case], folder: Path
) -> Iterator[tuple[Case, Outcome]]:
    """Yield the cases of one bag with a wrong result of `verify`."""
    for number, case in enumerate(cases):
        directory = write(forged(bag, case.forgeries), folder / f"{number}")
        said = outcome(directory)
        shutil.rmtree(directory)
        if said not in case.right:
            yield case, said


# What says nothing about the run.

OTHERS = r"/(diagnostics|rosout|parameter_events|scene)|\S+/(_claim|_progress)"
"""Topics that `verify` does not compare: for people, and what nodes tell each other."""

SHOWN = r"/markers|/robot_\d/coordination_map"
"""Topics of which further copies may come, and may be lost."""

NO_CLAIM = (
    ("field", rf"({OTHERS}) .*"),
    ("beside", rf"({OTHERS}) .*"),
    *(
        (f"message {how}", OTHERS)
        for how in ("removed", "doubled", "garbled", "cut", "exchanged")
    ),
    ("message content of the next", OTHERS),
    ("topic removed", OTHERS),
    ("topic renamed", OTHERS),
    ("field", r"/status (name|level|hardware_id|values length|values \* key)"),
    ("field", r"\S+_service_event info stamp \w+"),
    (
        "field",
        r"(\S+_service_event response \* plan|/robot_\d/percept) poses \* header stamp \w+",
    ),
    ("message doubled", rf"{SHOWN}|/status"),
    ("message removed", rf"{SHOWN}|/status"),
    ("message content of the next", rf"{SHOWN}|/status"),
    ("message exchanged", r"/status|\S+_service_event"),
    ("message garbled", r"/status|\S+_service_event|/robot_\d/percept"),
    ("message removed", r"/map"),
    ("message doubled", r"/map"),
    ("record doubled", r"continued"),
    ("beside", r"/status .*|\S+_service_event .*"),
    ("topic renamed", r"/clock"),
)
"""Operations, and patterns of what they are done to, without numbers. An exchange of events or
statuses may be one of different writers, or of the same words."""

ONLY_NAMED = (
    ("field", r"(/markers|/map|/status) .*"),
    (
        "field",
        r"/robot_\d/coordination_map (header|info) .*|/robot_\d/coordination_map data length",
    ),
    ("message doubled", r"/robot_\d/local_state"),
    ("message content of the next", "/map"),
    *(
        (f"message {how}", rf"{SHOWN}|/map|/status")
        for how in ("garbled", "cut", "exchanged")
    ),
    ("message doubled", r"\S+_service_event"),
    ("beside", r".*"),
)
"""A copy that is lost, and a message that may be a stranger's, are named."""


def right_of(bag: Bag, forgery: Forgery) -> frozenset[Outcome]:
    """Return the outcomes that are right after a forgery of a bag."""
    if _superseded(bag, forgery) or _unowed(bag, forgery):
        return ANY
    operation, target, how = forgery
    if operation in ("message", "topic", "record"):
        operation = f"{operation} {how}"
        target = target[:1]
    elif operation in ("field", "beside"):
        topic, _, path, *_ = target
        target = (topic, *_template(path))
    words = " ".join(str(one) for one in target)
    for patterns, right in ((NO_CLAIM, ANY), (ONLY_NAMED, NAMED)):
        if any(
            op == operation and re.fullmatch(pattern, words) for op, pattern in patterns
        ):
            return right
    return FOUND


def _superseded(bag: Bag, forgery: Forgery) -> bool:
    """Whether a forgery is of what a roll-back has superseded: it is not compared."""
    name = forgery.target[0]
    if forgery.operation in ("field", "message", "beside"):
        file, place = places_of(bag, name)[forgery.target[1]]
        step = file.messages[place].log_ns // PERIOD_NS
    elif forgery.operation == "attachment" and TABLES.fullmatch(name):
        file = attachments_of(bag, name)[0][0]
        step = int(TABLES.fullmatch(name)[2])
    else:
        return False
    later = bag[bag.index(file) + 1 :]
    firsts = [
        int(texts["first"])
        for one in later
        for _, texts in one.records
        if "first" in texts
    ]
    return any(step >= first for first in firsts)


def _unowed(bag: Bag, forgery: Forgery) -> bool:
    """Whether tables are removed that say nothing more, or what a robot said last of all.

    Nobody can tell whether a robot that the world stopped has acted once more.
    """
    name = forgery.target[0]
    if forgery[::2] == ("attachment", "removed"):
        return not _owed(bag, name)
    if forgery.operation in ("field", "message") and name.endswith(
        ("/action", "/percept")
    ):
        last = len(places_of(bag, name)) - 1
        return not _finished(bag) and forgery.target[1] == last
    return False


def _finished(bag: Bag) -> bool:
    return [one.message for one in _decoded(bag, "/status")][-1] == "finished"


TABLES = re.compile(r"tables/(\w+)_(\d+)\.npz")


def _owed(bag: Bag, name: str) -> bool:
    """Whether an attachment must be there; last tables of a robot that rested say nothing new."""
    match = TABLES.fullmatch(name)
    if match is None:
        return True
    robot = match[1]
    step = int(match[2])
    found = [TABLES.fullmatch(one.name) for file in bag for one in file.attachments]
    steps = sorted(
        {int(one[2]) for one in found if one is not None and one[1] == robot}
    )
    acted = [
        f.messages[n].log_ns // PERIOD_NS for f, n in places_of(bag, f"/{robot}/action")
    ]
    return step != steps[-1] or max(acted, default=0) > steps[-2]


# Cases are drawn.


def drawn(run: str, bag: Bag, seed: int, count: int | None = None) -> Iterator[Case]:
    """Yield cases of a run: one of each kind in any order, up to a number of them.

    Args:
        run: the run's name.
        bag: its bag.
        seed: other seeds draw other messages, elements and ways of the same kinds.
        count: how many; None: all kinds.
    """
    draw = random.Random(f"{run} {seed}")
    kinds = [
        *_field_kinds(bag),
        *_message_kinds(bag),
        *_array_kinds(bag),
        *_other_kinds(bag),
    ]
    draw.shuffle(kinds)
    left = len(kinds) if count is None else count
    for kind in kinds:
        if left == 0:
            return
        forgery = kind(draw)
        if forgery is not None and _changes(bag, forgery):
            left -= 1
            yield Case(run, (forgery,), right_of(bag, forgery))


def _changes(bag: Bag, forgery: Forgery) -> bool:
    """Whether a forgery can be made, and changes anything."""
    try:
        return forged(bag, [forgery]) != bag
    except RMWError:  # no message of that type can say so
        return False


def _decoded(bag: Bag, topic: str) -> list[Any]:
    kind = class_of(bag, topic)
    said = [file.messages[place].data for file, place in places_of(bag, topic)]
    return [deserialize_message(data, kind) for data in said]


def _template(path: Path_) -> Path_:
    return tuple("*" if isinstance(step, int) else step for step in path)


def _field_kinds(bag: Bag) -> Iterator[Any]:
    """Yield a kind for each field of each topic: a change in any message, and a changed copy."""
    for topic in _topics(bag):
        places: dict[Path_, list[tuple[int, Path_, Any]]] = {}
        for number, message in enumerate(_decoded(bag, topic)):
            for path, value in leaves(message):
                places.setdefault(_template(path), []).append((number, path, value))
        for found in places.values():
            yield lambda draw, t=topic, found=found: _field_of(draw, t, found)
        every = [place for found in places.values() for place in found]
        for where in ("before", "behind"):
            yield lambda draw, t=topic, every=every, w=where: _copy_of(
                draw, t, every, w
            )


def _topics(bag: Bag) -> list[str]:
    named = {one.name for file in bag for one in file.topics}
    return sorted(name for name in named if places_of(bag, name))


def _way(draw: random.Random, path: Path_, value: Any) -> str | None:
    if path[-1] != "length":
        return draw.choice(WAYS)
    ways = ["shorter", "longer"] if value else []
    return draw.choice(ways) if ways else None


def _field_of(draw: random.Random, topic: str, found: list[Any]) -> Forgery | None:
    number, path, value = draw.choice(found)
    how = _way(draw, path, value)
    if how is None:
        return None
    return Forgery("field", (topic, number, path), how)


def _copy_of(
    draw: random.Random, topic: str, every: list[Any], where: str
) -> Forgery | None:
    number, path, value = draw.choice(every)
    how = _way(draw, path, value)
    return None if how is None else Forgery("beside", (topic, number, path, where), how)


def _message_kinds(bag: Bag) -> Iterator[Any]:
    """Yield a kind for each topic and way."""
    for topic in _topics(bag):
        count = len(places_of(bag, topic))
        for how in MESSAGE_WAYS:
            # nothing shows that a last one is missing
            last = count - (how == "cut out")
            if last > 0:
                yield lambda draw, t=topic, n=last, how=how: Forgery(
                    "message", (t, draw.randrange(n)), how
                )
        for how in ("removed", "renamed"):
            yield lambda draw, t=topic, how=how: Forgery("topic", (t,), how)


def _array_kinds(bag: Bag) -> Iterator[Any]:
    """Yield a kind for each array of a robot's files (the first, the last, any) and each way."""
    files: dict[str, dict[str, dict[str, Any]]] = {}
    for file in bag:
        for one in file.attachments:
            if one.name.endswith(".npz"):
                robot = re.split(r"[/_.]", one.name.replace("robot_", "robot"))[1]
                group = f"{one.name.split('/')[0]} {robot}"
                files.setdefault(group, {})[one.name] = unpacked(one.data)
    for group in files.values():
        names = sorted(
            {name for arrays in group.values() for name in arrays} - {"format"}
        )
        for array in names:
            having = {
                name: arrays[array] for name, arrays in group.items() if array in arrays
            }
            for which in (0, -1, None):
                yield lambda draw, a=array, h=having, w=which: _entry_of(draw, a, h, w)
            for how in ARRAY_WAYS:
                yield lambda draw, a=array, h=having, how=how: Forgery(
                    "array", (draw.choice(sorted(h)), a), how
                )


def _entry_of(
    draw: random.Random, array: str, having: dict[str, Any], which: int | None
) -> Forgery | None:
    filled = [name for name in having if having[name].size]
    if not filled:
        return None
    name = draw.choice(filled) if which is None else filled[which]
    place = draw.randrange(having[name].size)
    return Forgery("entry", (name, array, place), draw.choice(WAYS))


def _other_kinds(bag: Bag) -> Iterator[Any]:
    """Yield the kinds of attachments as a whole and of metadata."""
    names = sorted({one.name for file in bag for one in file.attachments})
    for name in names:
        for how in ATTACHMENT_WAYS:
            yield lambda draw, n=name, how=how: Forgery("attachment", (n,), how)
    records = {name: texts for file in bag for name, texts in file.records}
    for name, texts in records.items():
        for how in ("removed", "doubled"):
            yield lambda draw, n=name, how=how: Forgery("record", (n,), how)
        for key in texts:
            for how in ("changed", "removed"):
                yield lambda draw, n=name, k=key, how=how: Forgery(
                    "record", (n, k), how
                )


# Cases that are named one by one.

TEXTS = (
    ("/run", "seed: 7", "seed: 8"),
    ("run.yaml", "learner: ", "learner: x"),
    ("run.yaml", "checkpoint: ", "checkpoint: 1"),
    ("scenario.yaml", "penalty: -", "penalty: -1"),
    ("scenario.yaml", "discount: 0.9", "discount: 0.8"),
    ("map.txt", "D", "."),
)
"""Where, and what is replaced there alone."""

OTHER_SETTINGS = {
    ("seed",): 8,
    ("id",): "another",
    ("greedy",): True,
    ("step_period",): 0.2,
    ("resolution",): 2.0,
    ("checkpoint",): 37,
    ("scenario", "steps"): 77,
    ("scenario", "goal_reward"): 11.0,
    ("scenario", "ask_cost"): 2.0,
    ("scenario", "discount"): 0.9,
    ("scenario", "move_success"): 0.4,
    ("scenario", "perception"): "never",
    ("scenario", "link"): "dead:1",
    ("scenario", "max_steps"): 4,
    ("scenario", "starts"): "fixed",
    ("scenario", "step_size"): "constant:0.3",
    ("scenario", "epsilon"): "constant:0.9",
    ("scenario", "q_coord_init"): 123.0,
    ("scenario", "goal_value"): 123.0,
    ("scenario", "robots", "robot_1", "goal"): [0, 0],
}
"""Settings that are said in all places, so that only the computation can tell; in every run."""

FREE_SETTINGS = {
    ("step_timeout",): 9.0,
    ("percept_timeout",): 0.7,
    ("recorded",): True,
    ("clock",): "none",
    ("slips",): True,
    ("scenario", "horizon"): 50,
    ("versions", "numpy"): "9.9",
    ("versions", "sparse_coord_ros"): "9.9",
}
"""Settings on which nothing depends that a log holds, or that nobody can check."""


def named(run: str, bag: Bag) -> Iterator[Case]:
    """Yield the cases of settings, and of texts in one place alone."""
    for path, value in OTHER_SETTINGS.items():
        right = ANY if path in _without_effect(bag) else FOUND
        yield Case(run, (Forgery("setting", path, value),), right)
    for path, value in FREE_SETTINGS.items():
        yield Case(run, (Forgery("setting", path, value),), ANY)
    for where, old, new in TEXTS:
        yield Case(run, (Forgery("text", (where,), (old, new)),), FOUND)


def _without_effect(bag: Bag) -> set[tuple[str, ...]]:
    """Return settings on which nothing in a log depends."""
    found = set()
    if "\nbodies: true\n" in run_text(bag):
        found.add(("scenario", "move_success"))
    if "\nlearner: cq\n" in run_text(bag):
        found.add(("scenario", "q_coord_init"))
    return found


def everywhere(run: str, bag: Bag, seed: int, count: int) -> Iterator[Case]:
    """Yield cases in which an element is changed in all tables of a robot."""
    draw = random.Random(f"{run} everywhere {seed}")
    tables = [
        one for file in bag for one in file.attachments if TABLES.fullmatch(one.name)
    ]
    while count:
        one = draw.choice(tables)
        arrays = {
            n: a for n, a in unpacked(one.data).items() if a.size and n != "format"
        }
        array = draw.choice(sorted(arrays))
        place = draw.randrange(arrays[array].size)
        group = one.name.rpartition("_")[0]
        forgery = Forgery("entry", (group, array, place), draw.choice(WAYS))
        if _changes(bag, forgery):
            count -= 1
            yield Case(run, (forgery,), FOUND)


def pairs(cases: Sequence[Case], seed: int, count: int) -> Iterator[Case]:
    """Yield cases with two forgeries, the first of which must be found by itself."""
    draw = random.Random(seed)
    found = [one for one in cases if one.right == FOUND and _is_entry(one)]
    for _ in range(count if len(found) > 1 else 0):
        one, other = draw.sample(found, 2)
        yield Case(one.run, one.forgeries + other.forgeries, FOUND)


def _is_entry(case: Case) -> bool:
    """Whether a forgery changes a number in place, so that another one still finds its target."""
    return case.forgeries[0].operation in ("entry", "field", "record")


# Honest logs.

NOT_FALSE = ANY - {Outcome.DIFFERS, Outcome.REFUSED}
"""Of an honest log: identical, or undecided."""

EVERY_STEP = r"/clock|/robot_\d/(local_state|reward|action|percept)|\S+_service_event"


def lost(run: str, bag: Bag, seed: int, count: int) -> Iterator[Case]:
    """Yield cases of a recorder that stood still and lost messages, and says so, or does not."""
    draw = random.Random(f"{run} lost {seed}")
    topics = [topic for topic in _topics(bag) if re.fullmatch(EVERY_STEP, topic)]
    tables = sorted(
        {t.rpartition("_")[0] + "_" for t in _names(bag) if TABLES.fullmatch(t)}
    )
    last = max(one.log_ns for file in bag for one in file.messages) // PERIOD_NS
    while count:
        first = draw.randrange(1, last)
        end = draw.choice([last + 9, draw.randrange(first + 1, last + 9)])
        gone = draw.sample([*topics, *tables], draw.randrange(1, 6))
        silent = tuple(Forgery("lost", (name, first, end)) for name in gone)
        if forged(bag, silent) == bag:
            continue
        count -= 1
        said = tuple(one._replace(how="named") for one in silent)
        yield Case(run, said, NOT_FALSE)
        messages = tuple(one for one in silent if one.target[0] in topics)
        if first < last - 5 and forged(bag, messages) != bag:
            yield Case(run, messages, FOUND)


def _names(bag: Bag) -> list[str]:
    return [one.name for file in bag for one in file.attachments]


def cut_off(run: str, bag: Bag, seed: int, count: int) -> Iterator[Case]:
    """Yield cases of a recorder that was killed, or stopped before the run's end; many at once."""
    draw = random.Random(f"{run} cut {seed}")
    messages = len(bag[-1].messages)
    for _ in range(count):
        number = draw.choice([draw.randrange(1, 60), draw.randrange(1, messages)])
        how = draw.choice(["killed", "stopped"])
        yield Case(run, (Forgery("cut", (number,), how),), NOT_FALSE)
