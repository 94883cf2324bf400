# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bag reader: finished and unfinished bags, damaged ones up to there; without ROS."""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.core.runs.run_config import RUN_FILE
from sparse_coord_ros.log.bags.contents import Attachment, BagFile, Block, Part
from sparse_coord_ros.log.bags.layout import (
    CONVERT,
    PARTIAL,
    RESCUE,
    being_recorded,
    failing,
)
from sparse_coord_ros.log.bags.records import MESSAGE
from sparse_coord_ros.log.bags.topics import BagTopic
from sparse_coord_ros.protocol.wire import CLOCK

BAG_DIRECTORY = "bag"
"""Name of the bag's directory in that of a run."""


class Message(NamedTuple):
    """A recorded message.

    Attributes:
        topic: the topic's full name.
        data: the serialised message with its CDR header.
        log_time_ns: time of reception.
        publish_time_ns: time of publication.
        sequence: its place in its channel; `BagWriter` counts from 0 in each file.
    """

    topic: str
    data: bytes
    log_time_ns: int
    publish_time_ns: int
    sequence: int


class Bag:
    """The content of a bag: of one file, or of several one after the other.

    Args:
        files: its files in their order.
        blocks: for each file, the blocks to read; None: all.

    Attributes:
        files: its files.
        path: the file; for several files their directory.

    Raises:
        BagError: files do not belong together, or contain a run in another format.
    """

    def __init__(
        self,
        files: Sequence[BagFile],
        blocks: Sequence[Sequence[Block]] | None = None,
    ) -> None:
        self.files = tuple(files)
        self._blocks = blocks
        self.path = files[0].path if len(files) == 1 else files[0].path.parent
        topics: dict[str, BagTopic] = {}
        for file in self.files:
            for topic in file.topics.values():
                if topics.setdefault(topic.name, topic).schema != topic.schema:
                    what = f"topic {topic.name} has another definition than in the file before"
                    remedy = "these are no parts of one bag; name one"
                    raise BagError(f"{file.path}: {what}: {remedy}")

    @property
    def finished(self) -> bool:
        """True if its recorder closed its last file."""
        return self.files[-1].finished

    @property
    def damage(self) -> str | None:
        """The first damage that reading has found, with its place; None: there is none.

        A bag that is only unfinished is not damaged.
        """
        for file in self.files:
            if file.damage is not None:
                several = len(self.files) > 1
                return f"{file.path.name}: {file.damage}" if several else file.damage
        return None

    def ends_early(self, read_to: str) -> str | None:
        """Return in one line that the bag is damaged, or has no end; None: neither.

        Args:
            read_to: how far it was read, such as `time step 30`.
        """
        if self.damage is not None:
            why = f"damaged at {self.damage}"
            return f"{why}; read to {read_to}, for the rest: {RESCUE}"
        if not self.finished:
            return f"it has no end (cut off, or still being written); read to {read_to}"
        return None

    @property
    def topics(self) -> dict[str, BagTopic]:
        """The topics by name."""
        found: dict[str, BagTopic] = {}
        for file in self.files:
            for topic in file.topics.values():
                found.setdefault(topic.name, topic)
        return found

    @property
    def clock(self) -> str | None:
        """The topic of the clock, with any name; None: the bag has no clock.

        Its type identifies it. Of several, it is the one with the usual name, else the one with
        most messages.
        """
        topics = self.topics
        counts = self.counts
        found = sorted(
            name for name in topics if topics[name].type_name == CLOCK.type_name
        )
        return max(
            found, key=lambda one: (one == f"/{CLOCK.name}", counts[one]), default=None
        )

    @property
    def channels(self) -> Mapping[int, str]:
        """The topic of each channel, by the number in the heads of `parts`."""
        return dict(enumerate(self.topics, start=1))

    @property
    def counts(self) -> Counter[str]:
        """Messages by topic."""
        return Counter(
            {n: sum(file.counts[n] for file in self.files) for n in self.topics}
        )

    @property
    def sizes(self) -> Counter[str]:
        """Bytes of the messages' data by topic."""
        return Counter(
            {n: sum(file.sizes[n] for file in self.files) for n in self.topics}
        )

    @property
    def message_count(self) -> int:
        """Messages of all topics."""
        return self.counts.total()

    @property
    def start_ns(self) -> int:
        """Earliest log time; 0 without messages."""
        return min(
            (block.start_ns for blocks in self.blocks for block in blocks), default=0
        )

    @property
    def end_ns(self) -> int:
        """Latest log time; 0 without messages."""
        return max(
            (block.end_ns for blocks in self.blocks for block in blocks), default=0
        )

    @property
    def blocks(self) -> Sequence[Sequence[Block]]:
        """The places of the messages in each file."""
        return (
            [file.blocks for file in self.files]
            if self._blocks is None
            else self._blocks
        )

    @property
    def compressions(self) -> tuple[str, ...]:
        """The compressions of its chunks: some of `zstd`, `lz4` and `none`."""
        return tuple(
            sorted({name for file in self.files for name in file.compressions})
        )

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """Its attachments; their data are read on access."""
        return tuple(one for file in self.files for one in file.attachments)

    @property
    def metadata(self) -> dict[str, Mapping[str, str]]:
        """The texts of the first metadata record of each name."""
        records = [record for file in self.files for record in file.metadata]
        return dict(reversed(records))

    def between(self, first_ns: int, last_ns: int) -> "Bag":
        """Return the blocks with messages of some log times, as a bag."""

        def inside(block: Block) -> bool:
            return block.end_ns >= first_ns and block.start_ns <= last_ns

        return Bag(
            self.files,
            [list(filter(inside, each)) for each in self.blocks],
        )

    def extend(self) -> bool:
        """Read on in the last file if it has grown; return whether it has new records."""
        return self.files[-1].extend()

    def close(self) -> None:
        """Close files that are still open."""
        for file in self.files:
            file.close()

    def messages(
        self,
        topics: Collection[str] | None = None,
        files: Iterable[int] | None = None,
    ) -> Iterator[Message]:
        """Yield the messages up to the first damage, in the order of the file.

        Args:
            topics: names of the topics to yield; None: all.
            files: numbers (from 0) of the files to read; None: all.

        Raises:
            BagError: the file has changed since it was opened, or cannot be read.
        """
        if topics is not None and not topics:
            return
        for part in self.parts(files):
            names = self.channels
            mine = [
                one for one, name in names.items() if topics is None or name in topics
            ]
            here = np.isin(part.heads["channel"], mine)
            heads = part.heads[here]
            begins = part.begins[here]
            ends = begins + heads["length"].astype(np.int64) - MESSAGE.size
            fields = (
                heads[name] for name in ("channel", "log_ns", "publish_ns", "sequence")
            )
            columns = (column.tolist() for column in (begins, ends, *fields))
            content = part.content
            for begin, end, channel, log_ns, publish_ns, sequence in zip(
                *columns, strict=True
            ):
                yield Message(
                    names[channel], content[begin:end], log_ns, publish_ns, sequence
                )

    def parts(self, files: Iterable[int] | None = None) -> Iterator[Part]:
        """Yield the messages up to the first damage, many together, with the bag's channels.

        Args:
            files: numbers (from 0) of the files to read; None: all.

        Raises:
            BagError: the file has changed since it was opened, or cannot be read.
        """
        table = np.zeros(1 << 16, dtype=np.uint16)
        for place in range(len(self.files)) if files is None else files:
            file = self.files[place]
            for part in file.parts(tuple(self.blocks[place])):
                numbers = {name: channel for channel, name in self.channels.items()}
                for channel, topic in file.topics.items():
                    table[channel] = numbers[topic.name]
                part.heads["channel"] = table[part.heads["channel"]]
                yield part


def open_bag(path: Path, *, checked: bool = True) -> Bag:
    """Open a bag.

    Args:
        path: a bag's directory, that of a run with a `bag` in it, an `.mcap` or an
            `.mcap.partial` file.
        checked: read all of it once, and count the messages; else only find the places of
            records, see `BagFile`.

    Returns:
        The bag; if it is damaged, as far as it can be read.

    Raises:
        BagError: the file is missing, the directory contains no bag file or several that are not
            parts of one bag, or a file does not begin as MCAP, contains messages that are not of
            ROS 2, or a run in another format than this version's.
    """
    return Bag([BagFile(file, checked=checked) for file in bag_files(Path(path))])


def continued(directory: Path) -> Bag | None:
    """Open the bag in a directory that a recorder will continue with a further file.

    Files of a recorder that was killed before it had written anything are removed.

    Returns:
        None if there is none: no directory, or an empty one, which is removed.

    Raises:
        BagError: the bag is being recorded, or cannot be read.
    """
    if not directory.is_dir():
        return None
    with failing(f"cannot continue {directory}"):
        files = bag_files(directory) if any(directory.iterdir()) else []
        for file in files:
            if being_recorded(file):
                raise BagError(f"{file} is being recorded: stop its recorder first")
        while files and not _begun(files[-1]):
            files.pop().unlink()
        if not files:
            directory.rmdir()
            return None
    return open_bag(directory)


def _begun(file: Path) -> bool:
    """Return whether a file of a bag contains anything."""
    if file.stat().st_size == 0:
        return False
    bag = open_bag(file, checked=False)
    bag.close()
    return bool(bag.files[0].blocks)


_NUMBERED = re.compile(rf"(.+)_(0|[1-9][0-9]*)\.mcap({re.escape(PARTIAL)})?")


def bag_files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag's directory in order, or the file itself; raises BagError.

    Several files are one bag if their names differ in their numbers only. If a finished and an
    unfinished file of one name exist, the finished one counts. If the directory holds no bag
    file, its subdirectory `bag` is searched, where `run` writes.
    """
    if not path.is_dir():
        return [path]
    for directory in (path, path / BAG_DIRECTORY):
        there = [*directory.glob(f"[!.]*.mcap{PARTIAL}"), *directory.glob("[!.]*.mcap")]
        files = list({file.name.removesuffix(PARTIAL): file for file in there}.values())
        named = {stem_and_number(file) for file in files}
        if len(named) < len(files) or len({stem for stem, _ in named}) > 1:
            problem = f"bag {directory} has {len(files)} .mcap files"
            raise BagError(f"{problem}: name one, or move it to another directory")
        if files:
            return sorted(files, key=stem_and_number)
    if (path / RUN_FILE).is_file():
        raise BagError(
            f"{path} holds a run without a bag; 'sparse_coord run' records one, 'train' and "
            "--no-record do not"
        )
    for other in sorted(path.glob("*")):
        if other.suffix in (".db3", ".bag", ".zstd"):
            raise BagError(
                f"{path} is a bag of another format ({other.name}); {CONVERT}"
            )
    remedy = "give a bag's directory or its file"
    raise BagError(f"{path} is not a bag: it has no .mcap file; {remedy}")


def stem_and_number(file: Path) -> tuple[str, int]:
    """Return the stem and the number in a file's name; `bag` and 0 without them."""
    match = _NUMBERED.fullmatch(file.name)
    if match is not None:
        return match[1], int(match[2])
    return file.name.removesuffix(PARTIAL).removesuffix(".mcap") or "bag", 0
