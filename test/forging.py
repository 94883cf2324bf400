# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Forged bags: a bag as data, what may be done to it, and a way to write it.

Bags are read and written by the mcap library, arrays by NumPy, messages by rclpy: nothing here
depends on how the package reads, verifies or learns. Checksums and digests of a forgery are right.

A `Forgery` is data: an operation of `OPERATIONS`, its target, and its variant.
"""

import hashlib
import importlib
import io
import json
import math
import re
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from rclpy.serialization import deserialize_message, serialize_message

PERIOD_NS = 100_000_000
"""Nanoseconds of a time step in all runs that are forged."""

RUN_RECORD = "sparse_coord_ros"
RUN_TEXT = "run.yaml"
SCENARIO_TEXT = "scenario.yaml"
OF_THE_CONTAINER = "rosbag2"
"""A metadata record that only repeats what else the file says."""


class RunStatus(NamedTuple):
    """A recorded message."""

    topic: str
    data: bytes
    log_ns: int
    publish_ns: int
    sequence: int


class Attached(NamedTuple):
    """An attachment."""

    name: str
    media_type: str
    data: bytes
    log_ns: int


class Topic(NamedTuple):
    """A channel and its schema."""

    name: str
    type_name: str
    encoding: str
    definition: bytes
    about: dict[str, str]


@dataclass
class File:
    """One MCAP file of a bag."""

    name: str
    finished: bool
    topics: list[Topic] = field(default_factory=list)
    messages: list[RunStatus] = field(default_factory=list)
    attachments: list[Attached] = field(default_factory=list)
    records: list[tuple[str, dict[str, str]]] = field(default_factory=list)

    def copy(self) -> "File":
        """Return a file to be changed: messages and attachments themselves never change."""
        records = [(name, dict(texts)) for name, texts in self.records]
        lists = [*self.topics], [*self.messages], [*self.attachments], records
        return File(self.name, self.finished, *lists)


Bag = list[File]


def read(directory: Path) -> Bag:
    """Return the files of a bag."""
    return [_read_file(path) for path in sorted(directory.glob("*.mcap*"))]


def _read_file(path: Path) -> File:
    found = File(path.name, path.suffix == ".mcap")
    schemas: dict[int, Schema] = {}
    names: dict[int, str] = {}
    with path.open("rb") as stream:
        records = StreamReader(stream).records
        while True:
            try:
                record = next(records, None)
            except McapError:  # the end of an unfinished file
                record = None
            if record is None:
                return found
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                if record.id not in names:
                    schema = schemas[record.schema_id]
                    kind = schema.name, schema.encoding, schema.data
                    found.topics.append(Topic(record.topic, *kind, record.metadata))
                names[record.id] = record.topic
            elif isinstance(record, Message):
                times = record.log_time, record.publish_time
                topic = names[record.channel_id]
                found.messages.append(
                    RunStatus(topic, record.data, *times, record.sequence)
                )
            elif isinstance(record, Attachment):
                data = (
                    _plain(record.data) if record.name.endswith(".npz") else record.data
                )
                about = record.name, record.media_type
                found.attachments.append(Attached(*about, data, record.log_time))
            elif isinstance(record, Metadata) and record.name != OF_THE_CONTAINER:
                found.records.append((record.name, record.metadata))


def write(bag: Bag, directory: Path) -> Path:
    """Write a bag into a directory that does not exist yet, and return that."""
    directory.mkdir()
    for file in bag:
        with (directory / file.name).open("wb") as stream:
            _write_file(file, Writer(stream, compression=CompressionType.NONE))
    return directory


def _write_file(file: File, writer: Writer) -> None:
    writer.start(profile="ros2", library="")
    for name, texts in file.records:
        writer.add_metadata(name, texts)
    channels = {}
    for topic in file.topics:
        schema = writer.register_schema(
            topic.type_name, topic.encoding, topic.definition
        )
        channels[topic.name] = writer.register_channel(
            topic.name, "cdr", schema, topic.about
        )
    for one in file.messages:
        channel = channels[one.topic]
        writer.add_message(channel, one.log_ns, one.data, one.publish_ns, one.sequence)
    for one in file.attachments:
        writer.add_attachment(0, one.log_ns, one.name, one.media_type, one.data)
    writer.flush() if not file.finished else writer.finish()


# What may be done.


class Forgery(NamedTuple):
    """One change of a bag.

    Attributes:
        operation: a key of `OPERATIONS`.
        target: its target; the operation defines its meaning.
        how: one of the ways of the operation.
    """

    operation: str
    target: tuple[Any, ...]
    how: Any = ""

    def apply(self, bag: Bag) -> None:
        """Change the bag."""
        OPERATIONS[self.operation](bag, self.target, self.how)


def forged(bag: Bag, forgeries: Sequence[Forgery]) -> Bag:
    """Return a changed copy of a bag."""
    copy = [file.copy() for file in bag]
    for forgery in forgeries:
        forgery.apply(copy)
    return copy


def places_of(bag: Bag, topic: str) -> list[tuple[File, int]]:
    """Return where a topic's messages are: the file, and the place in it."""
    return [
        (f, n) for f in bag for n, one in enumerate(f.messages) if one.topic == topic
    ]


def numbered_anew(bag: Bag, topic: str) -> None:
    """Give a topic's messages the numbers that a recorder gives them: from 0, one by one."""
    for number, (file, place) in enumerate(places_of(bag, topic)):
        file.messages[place] = file.messages[place]._replace(sequence=number)


def message_class(topic: str, type_name: str) -> Any:
    """Return the class of a topic's messages."""
    if topic.endswith("/_service_event"):
        return importlib.import_module("nav_msgs.srv").GetPlan.Event
    package, kind, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


def class_of(bag: Bag, topic: str) -> Any:
    """Return the class of a topic's messages in a bag."""
    [type_name] = {
        one.type_name for file in bag for one in file.topics if one.name == topic
    }
    return message_class(topic, type_name)


Path_ = tuple[str | int, ...]
"""Names of fields and places in sequences, from a message to something in it."""


def leaves(message: Any, path: Path_ = ()) -> Iterator[tuple[Path_, Any]]:
    """Yield all numbers and texts of a message with where they are, and all lengths."""
    if hasattr(message, "get_fields_and_field_types"):
        for name in message.get_fields_and_field_types():
            yield from leaves(getattr(message, name), (*path, name))
    elif isinstance(message, str | bytes | bool | int | float | np.number):
        yield path, message
    else:
        yield (*path, "length"), len(message)
        for place, one in enumerate(message):
            yield from leaves(one, (*path, place))


def _follow(message: Any, path: Path_) -> Any:
    for step in path:
        message = getattr(message, step) if isinstance(step, str) else message[step]
    return message


def _field(bag: Bag, target: tuple[Any, ...], how: str) -> None:
    """Change a field: (topic, number of the message, path)."""
    topic, number, path = target
    file, place = places_of(bag, topic)[number]
    said = file.messages[place]
    kind = class_of(bag, topic)
    message = deserialize_message(said.data, kind)
    before = repr([*leaves(message)])
    owner = _follow(message, path[:-1])
    last = path[-1]
    if last == "length":
        values = list(owner)
        changed = values[:-1] if how == "shorter" else [*values, deepcopy(values[-1])]
        owner = _follow(message, path[:-2])
        last = path[-2]
        value = changed
    else:
        value = other_value(_follow(message, path), how)
    if isinstance(last, str):
        setattr(owner, last, value)
    else:
        owner[last] = value
    data = serialize_message(message)
    # else it has fewer bits
    if repr([*leaves(deserialize_message(data, kind))]) != before:
        file.messages[place] = said._replace(data=data)


def other_value(value: Any, how: str) -> Any:
    """Return another number or text of the same type.

    Args:
        value: the number or text.
        how: "near", "negative", "nan" or "far"; of texts and truths all are the same.
    """
    if isinstance(value, str):
        return f"{value}x" if how != "far" else "x"
    if isinstance(value, bool | np.bool_):
        return not value
    if isinstance(value, float | np.floating):
        kind = type(value)
        far = kind(value * 2 + 3)
        near = np.nextafter(value, kind(np.inf))
        found = {"near": near, "negative": -value, "nan": kind("nan"), "far": far}[how]
        return kind(found) if math.isfinite(value) else kind(1.0)
    if isinstance(value, bytes):
        return bytes([value[0] ^ 1])
    changed = {"near": int(value) ^ 1, "far": int(value) ^ 6}.get(how, int(value) ^ 3)
    return type(value)(changed)


WAYS = ("near", "negative", "nan", "far")
MESSAGE_WAYS = (
    *(
        "removed",
        "cut out",
        "doubled",
        "exchanged",
        "content of the next",
        "later",
        "published",
    ),
    *("another number", "garbled", "cut"),
)


def _message(bag: Bag, target: tuple[Any, ...], how: str) -> None:
    """Change a message as a whole: (topic, number of the message)."""
    topic, number = target
    places = places_of(bag, topic)
    file, place = places[number]
    said = file.messages[place]
    later = (*places[number + 1 :], *places[:number])
    after, next_place = next(
        ((f, n) for f, n in later if f.messages[n].data != said.data), (file, place)
    )
    other = after.messages[next_place]
    if how in ("removed", "cut out"):
        del file.messages[place]
    elif how == "doubled":
        file.messages.insert(place, said)
    elif how == "exchanged":
        file.messages[place] = other
        after.messages[next_place] = said
    elif how == "content of the next":
        file.messages[place] = said._replace(data=other.data)
    elif how == "later":
        file.messages[place] = said._replace(
            log_ns=said.log_ns + 7, publish_ns=said.log_ns + 7
        )
    elif how == "published":
        file.messages[place] = said._replace(publish_ns=said.publish_ns + 7)
    elif how == "another number":
        file.messages[place] = said._replace(sequence=said.sequence + 3)
    elif how == "garbled":
        middle = len(said.data) // 2
        data = (
            said.data[:middle]
            + bytes([said.data[middle] ^ 0x55])
            + said.data[middle + 1 :]
        )
        file.messages[place] = said._replace(data=data)
    elif how == "cut":
        file.messages[place] = said._replace(data=said.data[: len(said.data) // 2])
    else:
        raise KeyError(how)
    if how in ("removed", "doubled", "exchanged"):
        numbered_anew(bag, topic)


def _beside(bag: Bag, target: tuple[Any, ...], how: str) -> None:
    """Put a changed copy of a message before or behind it: (topic, number, path, where)."""
    topic, number, path, where = target
    file, place = places_of(bag, topic)[number]
    said = file.messages[place]
    _field(bag, (topic, number, path), how)
    copy = file.messages[place]
    file.messages[place] = said
    file.messages.insert(place + (where == "behind"), copy)
    numbered_anew(bag, topic)


def _topic(bag: Bag, target: tuple[Any, ...], how: str) -> None:
    """Remove all messages of a topic, or call it otherwise: (topic,)."""
    [topic] = target
    for file in bag:
        if how == "removed":
            file.messages = [one for one in file.messages if one.topic != topic]
            continue
        name = f"{topic}_other"
        file.topics = [
            t._replace(name=name) if t.name == topic else t for t in file.topics
        ]
        file.messages = [
            m._replace(topic=name) if m.topic == topic else m for m in file.messages
        ]


def _lost(bag: Bag, target: tuple[Any, ...], how: str) -> None:
    """Remove what comes in some time steps: (topic or robot's tables, first, step after the last).

    What is "named" the recorder says: it stood still, from the first of these time steps on.
    """
    name, first, end = target
    if how == "named":
        bag[-1].records.append(("stalled", {"step": str(first), "seconds": "9.0"}))
    gone = range(first * PERIOD_NS, end * PERIOD_NS)
    for file in bag:
        file.messages = [
            m for m in file.messages if m.topic != name or m.log_ns not in gone
        ]
        file.attachments = [
            a
            for a in file.attachments
            if not a.name.startswith(name) or a.log_ns not in gone
        ]
    numbered_anew(bag, name)
    _time_anew(bag)


UNSTAMPED = re.compile(
    r"/(run|status|markers|scene)|\S+/(_service_event|_claim|_progress)"
)
"""Topics whose messages begin with no time of the run: a recorder logs them at the newest one."""


def _time_anew(bag: Bag) -> None:
    """Log messages without a stamp at the newest one before, as a recorder does."""
    for file in bag:
        newest = 0
        for place, one in enumerate(file.messages):
            if UNSTAMPED.fullmatch(one.topic):
                at = min(newest, one.log_ns)
                file.messages[place] = one._replace(log_ns=at, publish_ns=at)
            newest = max(newest, file.messages[place].log_ns)


def _cut(bag: Bag, target: tuple[Any, ...], how: str) -> None:
    """Let the recorder end early: of the last file so many messages are left, (number,).

    A recorder that is "stopped" finishes its file, one that is "killed" does not.
    """
    [count] = target
    file = bag[-1]
    file.finished = how == "stopped"
    file.messages = file.messages[:count]
    end = file.messages[-1].log_ns
    file.attachments = [one for one in file.attachments if one.log_ns < end]


# Attachments.


def unpacked(data: bytes) -> dict[str, np.ndarray]:
    """Return the arrays of an .npz file."""
    with np.load(io.BytesIO(data)) as file:
        return {name: file[name] for name in file.files}


def packed(arrays: dict[str, np.ndarray]) -> bytes:
    """Return arrays as an .npz file whose digest is right."""
    head = arrays["format"]
    rest = {n: a for n, a in arrays.items() if n != "format"}
    digest = hashlib.sha256()
    for name in sorted(rest):
        array = rest[name]
        digest.update(json.dumps([name, array.dtype.str, array.shape]).encode())
        digest.update(array.tobytes())
    texts = [*head.tolist()[:2], digest.hexdigest()]
    file = io.BytesIO()
    np.savez(file, format=np.array(texts), **rest)
    return file.getvalue()


def _plain(data: bytes) -> bytes:
    """Return an .npz file as `packed` writes it, so that equal arrays are equal bytes."""
    return packed(unpacked(data))


def attachments_of(bag: Bag, name: str) -> list[tuple[File, int]]:
    """Return where attachments of a name are: the file, and the place in it."""
    return [
        (f, n) for f in bag for n, one in enumerate(f.attachments) if one.name == name
    ]


def _entry(bag: Bag, target: tuple[Any, ...], how: str) -> None:
    """Change an element of an array: (attachment, array, place in the flat array).

    Where the attachment is a folder and a robot, such as "tables/robot_1", it is all of these.
    """
    name, array_name, at = target

    def change(arrays: dict[str, np.ndarray]) -> None:
        flat = arrays[array_name].reshape(-1).copy()
        if at < len(flat):
            flat[at] = other_value(flat[at], how)
        arrays[array_name] = flat.reshape(arrays[array_name].shape)

    every = {one.name for file in bag for one in file.attachments}
    for one in sorted(every):
        if one == name or one.startswith(f"{name}_"):
            _change_arrays(bag, one, change)


ARRAY_WAYS = ("removed", "longer", "other type", "renamed", "zeros", "of another file")


def _array(bag: Bag, target: tuple[Any, ...], how: str) -> None:
    """Change an array as a whole: (attachment, array)."""
    name, array_name = target

    def change(arrays: dict[str, np.ndarray]) -> None:
        array = arrays[array_name]
        if how == "removed":
            del arrays[array_name]
        elif how == "longer":
            arrays[array_name] = np.concatenate(
                [array.reshape(-1), array.reshape(-1)[:1] + 1]
            )
        elif how == "other type":
            arrays[array_name] = array.astype("f4" if array.dtype.kind == "f" else "i2")
        elif how == "renamed":
            arrays[f"{array_name}_other"] = arrays.pop(array_name)
        elif how == "zeros":
            arrays[array_name] = np.zeros_like(array)
        elif how == "of another file":
            arrays[array_name] = _elsewhere(bag, name, array_name, array)
        else:
            raise KeyError(how)

    _change_arrays(bag, name, change)


def _elsewhere(bag: Bag, name: str, array_name: str, array: np.ndarray) -> np.ndarray:
    """Return the array of that name in another attachment that differs; else the same one."""
    for file in bag:
        for one in file.attachments:
            if one.name != name and one.name.endswith(".npz"):
                found = unpacked(one.data).get(array_name, array)
                if found.tobytes() != array.tobytes():
                    return found
    return array


def _change_arrays(
    bag: Bag, name: str, change: Callable[[dict[str, np.ndarray]], None]
) -> None:
    for file, place in attachments_of(bag, name):
        one = file.attachments[place]
        arrays = unpacked(one.data)
        change(arrays)
        file.attachments[place] = one._replace(data=packed(arrays))


ATTACHMENT_WAYS = (
    *(
        "removed",
        "doubled",
        "forged before",
        "forged behind",
        "of another",
        "renamed",
        "garbled",
    ),
)


def _attachment(bag: Bag, target: tuple[Any, ...], how: str) -> None:
    """Change an attachment as a whole: (attachment,)."""
    [name] = target
    file, place = attachments_of(bag, name)[0]
    one = file.attachments[place]
    if how == "removed":
        del file.attachments[place]
    elif how == "doubled":
        file.attachments.insert(place, one)
    elif how in ("forged before", "forged behind"):
        copy = one._replace(data=_other_content(one))
        file.attachments.insert(place + (how == "forged behind"), copy)
    elif how == "of another":
        others = [a.data for f in bag for a in f.attachments if a.name != name]
        file.attachments[place] = one._replace(data=others[len(name) % len(others)])
    elif how == "renamed":
        file.attachments[place] = one._replace(
            name=one.name.replace("robot_1", "robot_9") + "_"
        )
    elif how == "garbled":
        half = len(one.data) // 2
        file.attachments[place] = one._replace(
            data=one.data[:half] + b"?" + one.data[half:]
        )
    else:
        raise KeyError(how)


def _other_content(one: Attached) -> bytes:
    """Return an attachment's content in which one number, or the text, is another."""
    if not one.name.endswith(".npz"):
        return one.data + b"\n"
    arrays = unpacked(one.data)
    name = next(n for n in arrays if n.startswith("q_star"))
    arrays[name] = arrays[name] + 1.0
    return packed(arrays)


# What the run is.


def _record(bag: Bag, target: tuple[Any, ...], how: str) -> None:
    """Change a metadata record, or a text of it: (record,) or (record, key)."""
    name, *key = target
    for file in bag:
        place = next(
            (n for n, record in enumerate(file.records) if record[0] == name), None
        )
        if place is None:
            continue
        texts = file.records[place][1]
        if key:
            changed = {k: f"{t}1" if k == key[0] else t for k, t in texts.items()}
            kept = {k: t for k, t in texts.items() if k != key[0]}
            file.records[place] = name, kept if how == "removed" else changed
        elif how == "removed":
            del file.records[place]
        else:
            file.records.insert(place, file.records[place])


def _setting(bag: Bag, target: tuple[Any, ...], how: Any) -> None:
    """Say another value of a setting, wherever the bag says it: its path in run.yaml."""
    run = yaml.safe_load(run_text(bag))
    owner = run
    for key in target[:-1]:
        owner = owner[key]
    if owner[target[-1]] == how:
        return
    owner[target[-1]] = how
    _say_run(bag, yaml.safe_dump(run, sort_keys=False, allow_unicode=True), run)


def run_text(bag: Bag) -> str:
    """Return the text of run.yaml in a bag."""
    file, place = attachments_of(bag, RUN_TEXT)[0]
    return file.attachments[place].data.decode()


def _say_run(bag: Bag, text: str, run: dict[str, Any]) -> None:
    """Put a run into a bag, in all the places."""
    kind = importlib.import_module("std_msgs.msg").String
    texts = {
        RUN_TEXT: text,
        SCENARIO_TEXT: yaml.safe_dump(run["scenario"], sort_keys=False),
    }
    for file in bag:
        for place, one in enumerate(file.messages):
            if one.topic == "/run":
                data = serialize_message(kind(data=text))
                file.messages[place] = one._replace(data=data)
        for place, attached in enumerate(file.attachments):
            if attached.name in texts:
                data = texts[attached.name].encode()
                file.attachments[place] = attached._replace(data=data)
        for name, record in file.records:
            if name == RUN_RECORD:
                record.update(seed=str(run["seed"]), learner=run["learner"])


def _text(bag: Bag, target: tuple[Any, ...], how: tuple[str, str]) -> None:
    """Replace a part of a text in one place alone: the topic, or (attachment,)."""
    [where] = target
    old, new = how
    for file in bag:
        for place, one in enumerate(file.messages):
            if one.topic == where:
                text = deserialize_message(one.data, class_of(bag, where))
                text.data = _replaced(text.data, old, new)
                file.messages[place] = one._replace(data=serialize_message(text))
        for place, attached in enumerate(file.attachments):
            if attached.name == where:
                data = _replaced(attached.data.decode(), old, new).encode()
                file.attachments[place] = attached._replace(data=data)


def _replaced(text: str, old: str, new: str) -> str:
    assert old in text, f"{old!r} is not in the text"
    return text.replace(old, new)


def _plan(bag: Bag, target: tuple[Any, ...], how: str) -> None:
    """Put tables in the place of a plan, or where there is none: (attachment, plan)."""
    source, plan = target
    file, place = attachments_of(bag, source)[-1]
    data = file.attachments[place].data
    if how == "without counts":
        arrays = unpacked(data)
        mine = ("moved_", "updates_")
        data = packed({n: a for n, a in arrays.items() if not n.startswith(mine)})
    for file, place in attachments_of(bag, plan):
        file.attachments[place] = file.attachments[place]._replace(data=data)
        return
    bag[-1].attachments.append(Attached(plan, "application/x-npz", data, 0))


OPERATIONS: dict[str, Callable[[Bag, tuple[Any, ...], Any], None]] = {
    "field": _field,
    "message": _message,
    "beside": _beside,
    "topic": _topic,
    "lost": _lost,
    "cut": _cut,
    "entry": _entry,
    "array": _array,
    "attachment": _attachment,
    "record": _record,
    "setting": _setting,
    "text": _text,
    "plan": _plan,
}
"""What may be done, by name. Each is given the bag, the target and how."""
