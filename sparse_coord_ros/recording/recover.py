# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A finished bag from an unfinished or damaged one; the original is kept."""

import contextlib
import itertools
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml

from sparse_coord_ros.errors import BagError
from sparse_coord_ros.recording.files import (
    PARTIAL,
    open_to_read,
    sync_directory,
    take_lock,
    write_text,
)
from sparse_coord_ros.recording.metadata import (
    METADATA_FILE,
    METADATA_RECORD,
    RECOVERED_RECORD,
    TopicSummary,
    bag_information,
    metadata_yaml,
)
from sparse_coord_ros.recording.reader import Bag, bag_file, open_bag
from sparse_coord_ros.recording.writer import BagWriter

_DRAFT = ".recovering"


@dataclass(frozen=True)
class Recovery:
    """What `recover` did.

    Attributes:
        path: the whole bag: its directory, or the file that was whole already.
        bag: what was read of the original; all of it is in the whole bag.
        kept: the original file where it is now; None if it is in use as it was.
        changed: whether anything was written or renamed.
    """

    path: Path
    bag: Bag
    kept: Path | None
    changed: bool

    @property
    def complete(self) -> bool:
        """Whether everything that was in the original's data was restored."""
        return self.bag.whole


def recover(path: Path) -> Recovery:
    """Make a bag whole: everything up to the first damage, indexed, with `metadata.yaml`.

    A directory is mended in place: the finished file is `<name>_0.mcap`, the original is kept as
    `<file>.damaged`. For a file given by its name a bag `<stem>_recovered` is made beside it, and
    the file is left alone. A whole bag is left as it is; a missing `metadata.yaml` is written.
    What is made of an unfinished or damaged bag says so itself (`Bag.recovered`), for good.

    Args:
        path: as of `open_bag`.

    Raises:
        BagError: nothing can be read, the bag is still being recorded, or the result cannot be
            written; whatever was recorded is there still.
    """
    path = Path(path)
    file = bag_file(path)
    with _not_recording(file):
        bag = open_bag(file)
        if not (bag.topics or bag.metadata or bag.attachments):
            raise BagError(f"{file} holds nothing to recover{_because(bag)}")
        try:
            return _in_place(bag, file.parent) if path.is_dir() else _beside(bag)
        except OSError as error:
            raise BagError(f"cannot recover {file}: {error.strerror}; make room") from error


def _in_place(bag: Bag, directory: Path) -> Recovery:
    file = bag.path
    if not bag.finished or bag.damage is not None:
        name = _name(file)
        with _draft(bag, directory / _DRAFT, name) as draft:
            kept = _keep(file)
            metadata = directory / METADATA_FILE
            if metadata.exists():
                _keep(metadata)
            os.replace(draft / f"{name}_0.mcap", directory / f"{name}_0.mcap")
            os.replace(draft / METADATA_FILE, metadata)
            if file.name != f"{name}_0.mcap":
                file.unlink(missing_ok=True)  # it is there as `kept`
            sync_directory(directory)
        return Recovery(directory, bag, kept, True)
    finished = file.with_name(file.name.removesuffix(PARTIAL))
    if finished != file:
        file.rename(finished)
    described = _describes(directory / METADATA_FILE, bag, finished.name)
    if not described:
        _write_metadata(directory / METADATA_FILE, bag, finished.name)
    return Recovery(directory, bag, None, finished != file or not described)


def _beside(bag: Bag) -> Recovery:
    file = bag.path
    if bag.finished and bag.damage is None and file.suffix != PARTIAL:
        return Recovery(file, bag, None, False)
    stem = file.name.removesuffix(PARTIAL).removesuffix(".mcap")
    directory = file.with_name(f"{stem}_recovered")
    if directory.exists():
        raise BagError(f"{directory} exists, nothing is overwritten: move it away")
    with _draft(bag, file.with_name(f".{directory.name}"), _name(file)) as draft:
        os.rename(draft, directory)
        sync_directory(directory.parent)
    return Recovery(directory, bag, file, True)


@contextlib.contextmanager
def _draft(bag: Bag, directory: Path, name: str) -> Iterator[Path]:
    """Write all that can be read of a bag into a directory, checked, removed at the end."""
    shutil.rmtree(directory, ignore_errors=True)
    compression = bag.compressions[0] if len(bag.compressions) == 1 else "zstd"
    try:
        with BagWriter(directory, compression=compression, name=name) as writer:
            if (note := _note(bag)) is not None:
                writer.add_metadata(RECOVERED_RECORD, note)
            for record, texts in bag.metadata_records:
                if record not in (METADATA_RECORD, RECOVERED_RECORD):
                    writer.add_metadata(record, texts)
            for attachment in bag.attachments:
                writer.attach(
                    attachment.name, attachment.data, attachment.media_type, attachment.log_time_ns
                )
            channels = {t.name: writer.add_known_topic(t) for t in bag.topics.values()}
            for topic, data, log_ns, publish_ns, sequence in bag.messages():
                writer.write(channels[topic], data, log_ns, publish_ns, sequence)
        copy = open_bag(directory)
        if copy.damage or copy.counts != bag.counts:
            raise BagError(f"what was recovered of {bag.path} does not read back: {copy.damage}")
        yield directory
    finally:
        shutil.rmtree(directory, ignore_errors=True)


def _note(bag: Bag) -> dict[str, str] | None:
    """Return what is to be known of a bag's recoveries, this one and earlier; None: no fault."""
    notes = [texts for name, texts in bag.metadata_records if name == RECOVERED_RECORD]
    if not bag.finished or bag.damage is not None:
        complete = "true" if bag.whole else "false"
        notes.append(
            {
                "complete": complete,
                "damage": bag.damage or "",
                "lost_bytes": str(bag.lost_bytes),
            }
        )
    if not notes:
        return None
    lost = [note.get("lost_bytes", "") for note in notes]
    return {
        "complete": "true" if all(n.get("complete") == "true" for n in notes) else "false",
        "damage": "; ".join(filter(None, (note.get("damage") for note in notes))),
        "lost_bytes": str(sum(int(text) for text in lost if text.isdecimal())),
    }


def recovered_text(note: Mapping[str, str]) -> str:
    """Return `Bag.recovered` in words."""
    text = "recovered from a broken bag, " + (
        "complete" if note.get("complete") == "true" else "a part of it is lost"
    )
    if note.get("lost_bytes", "0") != "0":
        text += f" ({note['lost_bytes']} bytes)"
    return f"{text}; damage at {note['damage']}" if note.get("damage") else text


def _name(file: Path) -> str:
    return file.name.removesuffix(PARTIAL).removesuffix(".mcap").removesuffix("_0") or "bag"


def _because(bag: Bag) -> str:
    return f": {bag.damage}" if bag.damage else ""


def _keep(file: Path) -> Path:
    """Give a file a second name that ends with `.damaged`, or `.damaged2` and so on."""
    for number in itertools.count(1):
        kept = file.with_name(f"{file.name}.damaged{number if number > 1 else ''}")
        if kept.exists():
            continue
        try:
            os.link(file, kept)
        except OSError:  # no second names in this file system
            file.rename(kept)
        return kept
    raise AssertionError


def _describes(metadata: Path, bag: Bag, file_name: str) -> bool:
    """Whether a `metadata.yaml` is there and fits the bag."""
    try:
        information = yaml.safe_load(metadata.read_bytes())["rosbag2_bagfile_information"]
        return (
            file_name in information["relative_file_paths"]
            and information["message_count"] == bag.message_count
        )
    except (OSError, yaml.YAMLError, ValueError, TypeError, KeyError, RecursionError):
        return False


def _write_metadata(metadata: Path, bag: Bag, file_name: str) -> None:
    if metadata.exists():
        _keep(metadata)
    topics = [
        TopicSummary(t.name, t.type_name, bag.counts[t.name], t.qos, t.type_hash)
        for t in bag.topics.values()
    ]
    information = bag_information(
        file_name, topics, start_time_ns=bag.start_ns, end_time_ns=bag.end_ns
    )
    write_text(metadata, metadata_yaml(information))


@contextlib.contextmanager
def _not_recording(file: Path) -> Iterator[None]:
    """Hold the lock of a file that is not being recorded; raises BagError."""
    with open_to_read(file) as held:
        if not take_lock(held, exclusive=True):
            raise BagError(f"{file} is being recorded: stop its recorder first")
        yield
