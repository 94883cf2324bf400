# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A finished bag from an unfinished or damaged one; the original is kept."""

import contextlib
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.base.files import free_name, take_lock
from sparse_coord_ros.log.bags.gaps import Gap, to_note
from sparse_coord_ros.log.bags.layout import (
    PARTIAL,
    failing,
    open_to_read,
    sync_directory,
    write_text,
)
from sparse_coord_ros.log.bags.metadata import (
    METADATA_FILE,
    METADATA_RECORD,
    RECOVERED_RECORD,
    bag_information,
    metadata_yaml,
    read_information,
)
from sparse_coord_ros.log.bags.reader import (
    Bag,
    BagFile,
    bag_files,
    open_bag,
    stem_and_number,
)
from sparse_coord_ros.log.bags.writer import BagWriter

_DRAFT = ".recovering"


@dataclass(frozen=True)
class Recovery:
    """The result of `recover`.

    Attributes:
        path: the bag's directory.
        bag: the original as far as it was read; the recovered bag contains all of that.
            `bag.whole`: whether the original had no gap.
        kept: the path of the kept original (the first of several files); None: no file was
            replaced.
        changed: whether a file was written or renamed.
    """

    path: Path
    bag: Bag
    kept: Path | None
    changed: bool


def recover(path: Path) -> Recovery:
    """Make a bag whole: everything outside of its gaps, indexed, with `metadata.yaml`.

    The files are replaced one by one: the finished file is `<name>_0.mcap`, the original is kept
    as `<file>.damaged`. A whole bag is not changed; a missing `metadata.yaml` is written. A file
    that replaces an unfinished or damaged one has a note of it (`Bag.recovered`).

    Args:
        path: as in `open_bag`; a file stands for the bag in its directory.

    Raises:
        BagError: the bag cannot be read or is still being recorded, or the result cannot be
            written; the recorded files are kept.
    """
    path = Path(path)
    if path.is_file():
        BagFile(path, checked=False).close()  # raises if the file is not a bag
        path = path.parent
    files = bag_files(path)
    with contextlib.ExitStack() as held:
        for file in files:
            held.enter_context(_not_recording(file))
        bag = open_bag(path)
        if not (bag.topics or bag.metadata or bag.attachments):
            why = f": {bag.damage}" if bag.damage else ""
            raise BagError(f"{files[0]} holds nothing to recover{why}")
        with failing(f"cannot recover {files[0]}", "; make room"):
            return _finished(bag, files[0].parent)


def continued(directory: Path) -> Bag | None:
    """Recover a bag that a recorder will continue, and return it.

    Returns:
        None if there is no bag, or only an empty one, which is moved aside.

    Raises:
        BagError: the bag is being recorded, or cannot be read or recovered.
    """
    if not directory.is_dir():
        return None
    try:
        files = bag_files(directory)
    except BagError:
        if any(directory.iterdir()):
            raise
        directory.rmdir()
        return None
    while files and not _holds_anything(files[-1]):
        with _not_recording(files[-1]):
            _keep(files[-1])
            files.pop().unlink(missing_ok=True)
    if not files:
        directory.rename(free_name(directory.with_name(f"{directory.name}.damaged")))
        return None
    recovery = recover(directory)
    if recovery.bag.whole and recovery.kept is not None:
        recovery.kept.unlink()  # the finished file contains all of it
    return open_bag(directory)


def _holds_anything(file: Path) -> bool:
    with contextlib.suppress(BagError):
        bag = open_bag(file)
        return bool(bag.message_count or bag.attachments or bag.metadata)
    return False


def _finished(bag: Bag, directory: Path) -> Recovery:
    """Finish each file of a bag, and write `metadata.yaml` if it is missing or wrong."""
    kept: list[Path] = []
    renamed = False
    for place, file in enumerate(bag.files):
        if not file.finished or file.damage is not None:
            gaps = [gap for gap in bag.gaps if gap.place == place and gap.end]
            kept.append(_replace_by_whole(file, gaps, directory))
        elif file.path.name.endswith(PARTIAL):
            whole = file.path.name.removesuffix(PARTIAL)
            file.path.rename(file.path.with_name(whole))
            renamed = True
    described = _describe(open_bag(directory), directory / METADATA_FILE)
    sync_directory(directory)
    changed = bool(kept) or renamed or described
    return Recovery(directory, bag, kept[0] if kept else None, changed)


def _replace_by_whole(file: BagFile, gaps: Sequence[Gap], directory: Path) -> Path:
    """Write a finished file in the place of another one, and return the kept original.

    Args:
        file: the unfinished or damaged file.
        gaps: its unreadable parts.
        directory: the bag's directory.
    """
    stem, number = stem_and_number(file.path)
    finished = directory / f"{stem}_{number}.mcap"
    with _draft(Bag([file]), gaps, directory / _DRAFT) as draft:
        kept = _keep(file.path)
        os.replace(draft / finished.name, finished)
        if file.path != finished:
            file.path.unlink(missing_ok=True)  # `kept` is its second name
    return kept


def _describe(bag: Bag, metadata: Path) -> bool:
    """Write `metadata.yaml` if it does not describe a bag; return whether it was written."""
    known = read_information(metadata)
    names = [file.path.name for file in bag.files]
    same_files = known.get("relative_file_paths") == names
    if same_files and known.get("message_count") == bag.message_count:
        return False
    if metadata.exists():
        _keep(metadata)
    summaries = [file.summary for file in bag.files]
    information = bag_information(summaries, bag.topics.values())
    write_text(metadata, metadata_yaml(information))
    return True


@contextlib.contextmanager
def _draft(bag: Bag, gaps: Sequence[Gap], directory: Path) -> Iterator[Path]:
    """Write the readable part of a bag's file to a temporary directory, and check it.

    Args:
        bag: one file.
        gaps: its unreadable parts.
        directory: a new one.
    """
    shutil.rmtree(directory, ignore_errors=True)
    compression = bag.compressions[0] if len(bag.compressions) == 1 else "zstd"
    try:
        name, number = stem_and_number(bag.path)
        with BagWriter(
            directory, compression=compression, name=name, number=number
        ) as writer:
            writer.add_metadata(RECOVERED_RECORD, {"gaps": to_note(gaps)})
            for record, texts in bag.metadata_records:
                if record not in (METADATA_RECORD, RECOVERED_RECORD):
                    writer.add_metadata(record, texts)
            for one in bag.attachments:
                writer.attach(one.name, one.data, one.media_type, one.log_time_ns)
            channels = {t.name: writer.add_known_topic(t) for t in bag.topics.values()}
            for topic, data, log_ns, publish_ns, sequence in bag.messages():
                writer.write(channels[topic], data, log_ns, publish_ns, sequence)
        copy = open_bag(directory / f"{name}_{number}.mcap")
        if copy.damage or copy.counts != bag.counts:
            raise BagError(
                f"what was recovered of {bag.path} does not read back: {copy.damage}"
            )
        yield directory
    finally:
        shutil.rmtree(directory, ignore_errors=True)


def _keep(file: Path) -> Path:
    """Give a file a second name that ends with `.damaged`, or `.damaged2` and so on."""
    kept = free_name(file.with_name(f"{file.name}.damaged"))
    try:
        os.link(file, kept)
    except OSError:  # no second names in this file system
        file.rename(kept)
    return kept


@contextlib.contextmanager
def _not_recording(file: Path) -> Iterator[None]:
    """Hold the lock of a file that is not being recorded; raises BagError."""
    with open_to_read(file) as held:
        if not take_lock(held, exclusive=True):
            raise BagError(f"{file} is being recorded: stop its recorder first")
        yield
