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
    """What `recover` did.

    Attributes:
        path: the bag's directory.
        bag: what was read of the original; all of it is in the whole bag. `bag.whole` says
            whether everything that was in the original's data was restored.
        kept: the original file where it is now (of several the first); None if it is in use as
            it was.
        changed: whether anything was written or renamed.
    """

    path: Path
    bag: Bag
    kept: Path | None
    changed: bool


def recover(path: Path) -> Recovery:
    """Make a bag whole: everything outside of its gaps, indexed, with `metadata.yaml`.

    A bag is mended in place, file by file: the finished one is `<name>_0.mcap`, the original is
    kept as `<file>.damaged`. A whole bag is left as it is; a missing `metadata.yaml` is written.
    What is made of an unfinished or damaged file says so itself (`Bag.recovered`), for good.

    Args:
        path: as of `open_bag`; a file stands for the bag in its directory.

    Raises:
        BagError: nothing can be read, the bag is still being recorded, or the result cannot be
            written; whatever was recorded is there still.
    """
    path = Path(path)
    if path.is_file():
        BagFile(path, checked=False).close()  # what is no bag's file raises
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
            return _mended(bag, files[0].parent)


def continued(directory: Path) -> Bag | None:
    """Make a bag whole that a recorder is to continue, and return it.

    Returns:
        None where there is no bag, or nothing in it: what there is was moved aside.

    Raises:
        BagError: it is being recorded, or cannot be read or mended.
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
        recovery.kept.unlink()  # all of it is in the file that was finished
    return open_bag(directory)


def _holds_anything(file: Path) -> bool:
    with contextlib.suppress(BagError):
        bag = open_bag(file)
        return bool(bag.message_count or bag.attachments or bag.metadata)
    return False


def _mended(bag: Bag, directory: Path) -> Recovery:
    metadata = directory / METADATA_FILE
    kept: list[Path] = []
    renamed = False
    for place, one in enumerate(bag.files):
        stem, number = stem_and_number(one.path)
        file = one.path
        finished = directory / f"{stem}_{number}.mcap"
        if not one.finished or one.damage is not None:
            gaps = [gap for gap in bag.gaps if gap.place == place and gap.end]
            with _draft(Bag([one]), gaps, directory / _DRAFT) as draft:
                kept.append(_keep(file))
                os.replace(draft / finished.name, finished)
                if file != finished:
                    file.unlink(missing_ok=True)  # it is there as `kept`
        elif file.name.endswith(PARTIAL):
            file.rename(file.with_name(file.name.removesuffix(PARTIAL)))
            renamed = True
    mended = open_bag(directory)
    said = read_information(metadata)
    names = [file.path.name for file in mended.files]
    told = said.get("relative_file_paths"), said.get("message_count")
    described = told == (names, mended.message_count)
    if not described:
        if metadata.exists():
            _keep(metadata)
        summaries = [file.summary for file in mended.files]
        write_text(
            metadata, metadata_yaml(bag_information(summaries, mended.topics.values()))
        )
    sync_directory(directory)
    changed = bool(kept) or renamed or not described
    return Recovery(directory, bag, kept[0] if kept else None, changed)


@contextlib.contextmanager
def _draft(bag: Bag, gaps: Sequence[Gap], directory: Path) -> Iterator[Path]:
    """Write all that can be read of a bag's file into a directory, checked, removed at the end.

    Args:
        bag: one file.
        gaps: what cannot be read of it.
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
