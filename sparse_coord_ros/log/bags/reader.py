# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bag reader: MCAP files of any writer, up to their end or their first damage; without ROS.

mcap's `StreamReader` reads the records. The messages in a chunk become columns (`heads`): to make
an object of each message takes ten times as long.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    Footer,
    McapRecord,
    Metadata,
    Schema,
)
from mcap.records import Message as MessageRecord
from mcap.stream_reader import StreamReader, get_chunk_data_stream

from sparse_coord_ros.base.errors import BagError, message_of
from sparse_coord_ros.base.files import refuse_stand_in
from sparse_coord_ros.core.runs.run_config import RUN_FILE, refuse_scenario
from sparse_coord_ros.log.bags.heads import (
    MESSAGE_HEAD,
    DamagedChunk,
    message_heads,
)
from sparse_coord_ros.log.bags.layout import (
    CONVERT,
    PARTIAL,
    RESCUE,
    WANTED,
    being_recorded,
    failing,
    open_to_read,
)
from sparse_coord_ros.log.bags.metadata import LATEST_NS, FileSummary
from sparse_coord_ros.log.bags.topics import BagTopic, topic_of
from sparse_coord_ros.protocol.wire import CLOCK, RUN

BAG_DIRECTORY = "bag"
"""Name of the bag's directory in that of a run."""

MAGIC = b"\x89MCAP0\r\n"
OTHER_BAGS = (b"SQLite format 3\0", b"#ROSBAG V")
"""The first bytes of bags that are not read: ROS 2's .db3, and ROS 1's."""

LONGEST_SIGN = 64
"""Bytes that say what a file is."""

TOGETHER = 1 << 20
"""Bytes of messages that are handed over together."""


class Message(NamedTuple):
    """A recorded message.

    Attributes:
        topic: the topic's full name.
        data: the serialised message with its CDR header.
        log_time_ns: time of reception.
        publish_time_ns: time of publication.
        sequence: its number in its channel, if the writer counts; `BagWriter` does, from 0 in each
            file.
    """

    topic: str
    data: bytes
    log_time_ns: int
    publish_time_ns: int
    sequence: int


class Part(NamedTuple):
    """Messages that are together in a bag.

    Attributes:
        file: number of their file, from 0.
        content: bytes that contain their data.
        begins: offset of each message's data in it, shape (messages,).
        heads: their heads, of type `heads.MESSAGE_HEAD`, same shape; `topic` is the index of their
            topic in `Bag.names`.
    """

    file: int
    content: bytes
    begins: np.ndarray
    heads: np.ndarray

    def data(self, index: int) -> bytes:
        """Return the data of a message."""
        begin = int(self.begins[index])
        return self.content[begin : begin + int(self.heads["size"][index])]


class BagFile:
    """One MCAP file of a bag.

    Attributes:
        path: the file.
        finished: whether it has its end, as far as it was read.
        damage: the first damage, its place and one sentence; None: none was found.
        size: its size in bytes.
        counts: number of messages by topic.
        start_ns, end_ns: log times of its earliest and latest message; 0 without any.
        begins_ns: log time of its first message on a topic `run`; None: there is none.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.finished = False
        self.damage: str | None = None
        self.size = 0
        self.counts: Counter[str] = Counter()
        self.start_ns = self.end_ns = 0
        self.begins_ns: int | None = None
        self.read_to = 0
        self.schemas: dict[int, Schema] = {}
        self.topic_of = np.full(1 << 16, -1)  # by channel

    @property
    def filled(self) -> bool:
        """True if it has messages."""
        return self.counts.total() > 0

    @property
    def summary(self) -> FileSummary:
        """Its description in `metadata.yaml`."""
        return FileSummary(
            self.path.name, dict(self.counts), self.start_ns, self.end_ns
        )

    def records(self) -> Iterator[McapRecord]:
        """Yield the records from where reading has ended so far, chunks whole."""
        if self.finished:
            return
        whole = self.path.with_name(self.path.name.removesuffix(PARTIAL))
        if not self.path.exists() and whole.exists():
            self.path = whole  # its recorder has finished it meanwhile
        with open_to_read(self.path) as file, failing(f"cannot read {self.path}"):
            self.size = file.seek(0, 2)
            file.seek(self.read_to)
            if not self.read_to:
                check_begin(self.path, file.read(LONGEST_SIGN))
                file.seek(len(MAGIC))
                self.read_to = len(MAGIC)
            stream: Any = ExactFile(file)
            reader = StreamReader(stream, skip_magic=True, emit_chunks=True)
            try:
                for record in reader.records:
                    yield record
                    self.read_to = file.tell()
                    if isinstance(record, Footer):
                        self.finished = True
                        return
            except EndOfFile:
                # Where the file has its end, a record that ends beyond it is damaged.
                if _tail(file) == MAGIC:
                    self.note_damage(DamagedChunk("a record ends beyond the file"))
            except OSError:
                raise
            except Exception as error:  # the library may raise any exception
                self.note_damage(error)

    def note_damage(self, error: Exception) -> None:
        """Note that the next record is damaged."""
        self.damage = f"byte {self.read_to}: {message_of(error)}"

    def note(self, heads: np.ndarray, names: Sequence[str]) -> None:
        """Count messages."""
        start_ns = int(heads["log_ns"].min())
        self.start_ns = min(self.start_ns, start_ns) if self.filled else start_ns
        self.end_ns = max(self.end_ns, int(heads["log_ns"].max()))
        counts = np.bincount(heads["topic"])
        for topic in np.flatnonzero(counts).tolist():
            self.counts[names[topic]] += int(counts[topic])
            if self.begins_ns is None and names[topic].endswith(f"/{RUN.name}"):
                self.begins_ns = int(heads["log_ns"][heads["topic"] == topic][0])


def check_begin(path: Path, begin: bytes) -> None:
    """Raise BagError if a file does not begin as an MCAP file."""
    if begin.startswith(MAGIC):
        return
    refuse_stand_in(path, begin, BagError)
    if begin.startswith(OTHER_BAGS):
        raise BagError(f"{path} is a bag of another format; {CONVERT}")
    raise BagError(f"{path} is not an MCAP file: it does not start as one; {WANTED}")


class ExactFile:
    """A file of which a read that comes too short raises EndOfFile."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def read(self, length: int) -> bytes:
        """Return bytes of this number."""
        data = self._file.read(length)
        if len(data) < length:
            raise EndOfFile
        return data


def _tail(file: BinaryIO) -> bytes:
    """Return the last bytes of a file, of the magic's length."""
    file.seek(-min(len(MAGIC), file.seek(0, 2)), 2)
    return file.read()


class Bag:
    """A bag of one file, or of several one after the other.

    What it says is known as far as `read` has gone.

    Args:
        paths: its files in their order.

    Attributes:
        files: its files.
        path: the file; for several files their directory.
        topics: by name.
        names: the topics' names, in the order in which they were found.
        sizes: bytes of the messages' data by topic.
        metadata: the texts of the first metadata record of each name.
        compressions: the compressions of its chunks: some of `zstd`, `lz4` and `none`.
        parts: the messages, if they are kept.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.files = tuple(map(BagFile, paths))
        self.path = paths[0] if len(paths) == 1 else paths[0].parent
        self.topics: dict[str, BagTopic] = {}
        self.names: list[str] = []
        self.sizes: Counter[str] = Counter()
        self.metadata: dict[str, Mapping[str, str]] = {}
        self.compressions: set[str] = set()
        self.parts: list[Part] = []

    def read(self) -> Iterator[Part]:
        """Yield the messages that were not read yet, in the order of the files.

        Raises:
            BagError: a file cannot be read, or does not begin as MCAP.
        """
        for number, file in enumerate(self.files):
            waiting: list[tuple[bytes, np.ndarray, np.ndarray]] = []
            loose: list[MessageRecord] = []
            for record in file.records():
                try:
                    if isinstance(record, MessageRecord):
                        self._check_channel(file, record.channel_id)
                        loose.append(record)
                    elif isinstance(record, Chunk):
                        waiting.append(self._messages(file, record))
                    else:
                        self._take(file, record)
                except Exception as error:  # the libraries may raise any exception
                    file.note_damage(error)
                    break
                size = sum(len(content) for content, _, _ in waiting)
                if size > TOGETHER or len(loose) > 1000:
                    yield from self._together(number, waiting, loose)
            yield from self._together(number, waiting, loose)

    def _together(
        self,
        number: int,
        waiting: list[tuple[bytes, np.ndarray, np.ndarray]],
        loose: list[MessageRecord],
    ) -> Iterator[Part]:
        """Yield what waits, as one part, and forget it."""
        if loose:
            waiting.append(_outside_of_chunks(loose))
        contents = [content for content, _, _ in waiting]
        starts = np.cumsum([0, *map(len, contents)])
        begins = [
            offsets + start
            for (_, offsets, _), start in zip(waiting, starts, strict=False)
        ]
        heads = [chunk_heads for _, _, chunk_heads in waiting]
        waiting.clear()
        loose.clear()
        if not sum(map(len, heads)):
            return
        file = self.files[number]
        part = Part(
            number, b"".join(contents), np.concatenate(begins), np.concatenate(heads)
        )
        part.heads["topic"] = file.topic_of[part.heads["channel"]]
        file.note(part.heads, self.names)
        sizes = np.bincount(part.heads["topic"], part.heads["size"])
        for topic in np.flatnonzero(sizes).tolist():
            self.sizes[self.names[topic]] += int(sizes[topic])
        yield part

    def _messages(
        self, file: BagFile, chunk: Chunk
    ) -> tuple[bytes, np.ndarray, np.ndarray]:
        """Return a chunk's content and its messages; any exception: it is damaged."""
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        content = stream.read(size)
        if size != chunk.uncompressed_size:
            raise DamagedChunk("a chunk has another size than it says")
        self.compressions.add(chunk.compression or "none")
        begins, heads, others = message_heads(content)
        for opcode, body in others:
            if opcode == Opcode.SCHEMA:
                self._take(file, Schema.read(body))
            elif opcode == Opcode.CHANNEL:
                self._take(file, Channel.read(body))
        for channel in np.unique(heads["channel"]).tolist():
            self._check_channel(file, channel)
        return content, begins, heads

    def _check_channel(self, file: BagFile, channel: int) -> None:
        if file.topic_of[channel] < 0:
            raise DamagedChunk(f"a message of the unknown channel {channel}")

    def _take(self, file: BagFile, record: McapRecord) -> None:
        """Take in a record that is no message."""
        if isinstance(record, Schema):
            file.schemas[record.id] = record
        elif isinstance(record, Channel):
            if record.topic not in self.topics:
                self.topics[record.topic] = topic_of(record, file.schemas)
                self.names.append(record.topic)
                self.sizes[record.topic] = 0
            file.counts[record.topic] += 0
            file.topic_of[record.id] = self.names.index(record.topic)
        elif isinstance(record, Metadata):
            self.metadata.setdefault(record.name, record.metadata)

    @property
    def finished(self) -> bool:
        """True if its last file has its end."""
        return self.files[-1].finished

    @property
    def damage(self) -> str | None:
        """The first damage, with its place; None: none was found.

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
            read_to: how far it was read, such as `step 30`.
        """
        if self.damage is not None:
            why = f"damaged at {self.damage}"
            return f"{why}; read to {read_to}, for the rest: {RESCUE}"
        if not self.finished:
            return f"it has no end (cut off, or still being written); read to {read_to}"
        return None

    @property
    def ends_ns(self) -> list[int]:
        """For each file the log time from which later files supersede it.

        A further file begins with the run at the time of a checkpoint, to which the team has gone
        back. What files before it have from then on is superseded.
        """
        begins = [file.begins_ns for file in self.files]
        ends = []
        for number in range(len(begins)):
            later = [ns for ns in begins[number + 1 :] if ns is not None]
            ends.append(min(later, default=LATEST_NS))
        return ends

    @property
    def counts(self) -> Counter[str]:
        """Messages by topic."""
        return Counter(
            {name: sum(file.counts[name] for file in self.files) for name in self.names}
        )

    @property
    def message_count(self) -> int:
        """Messages of all topics."""
        return self.counts.total()

    @property
    def start_ns(self) -> int:
        """Earliest log time; 0 without messages."""
        return min((file.start_ns for file in self.files if file.filled), default=0)

    @property
    def end_ns(self) -> int:
        """Latest log time; 0 without messages."""
        return max(file.end_ns for file in self.files)

    @property
    def clock(self) -> str | None:
        """The topic of the clock, with any name; None: the bag has no clock.

        Its type identifies it. Of several, it is the one with the usual name, else the one with
        most messages.
        """
        clocks = sorted(
            name
            for name, topic in self.topics.items()
            if topic.type_name == CLOCK.type_name
        )
        if f"/{CLOCK.name}" in clocks:
            return f"/{CLOCK.name}"
        return max(clocks, key=self.counts.__getitem__, default=None)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Yield the messages that were kept, in the order of the files.

        Args:
            topics: names of the topics to yield; None: all.
        """
        for part in self.parts:
            for index in self.chosen(part, topics).tolist():
                yield self.message(part, index)

    def chosen(self, part: Part, topics: Collection[str] | None) -> np.ndarray:
        """Return the indices of the messages of some topics in a part."""
        if topics is None:
            return np.arange(len(part.heads))
        numbers = [number for number, name in enumerate(self.names) if name in topics]
        return np.flatnonzero(np.isin(part.heads["topic"], numbers))

    def message(self, part: Part, index: int) -> Message:
        """Return a message of a part."""
        head = part.heads[index]
        numbers = (int(head[name]) for name in ("log_ns", "publish_ns", "sequence"))
        return Message(self.names[head["topic"]], part.data(index), *numbers)


def not_superseded(
    times: np.ndarray, ends: np.ndarray | int, *, states: np.ndarray | bool
) -> np.ndarray:
    """Return which messages no later file supersedes, shape (n,), bool.

    An episode may end with the states of the very time at which a later file begins.

    Args:
        times: time of each message, shape (n,).
        ends: from when on later files supersede its file (`Bag.ends_ns`), in the same unit.
        states: whether it is a local state.
    """
    return (times < ends) | (states & (times == ends))


def _outside_of_chunks(
    messages: Sequence[MessageRecord],
) -> tuple[bytes, np.ndarray, np.ndarray]:
    """Return messages as the content of a chunk has them."""
    content = b"".join(message.data for message in messages)
    sizes = [len(message.data) for message in messages]
    heads = np.zeros(len(messages), MESSAGE_HEAD)
    heads["size"] = sizes
    for name, values in (
        ("channel", [message.channel_id for message in messages]),
        ("sequence", [message.sequence for message in messages]),
        ("log_ns", [message.log_time for message in messages]),
        ("publish_ns", [message.publish_time for message in messages]),
    ):
        heads[name] = values
    return content, np.cumsum([0, *sizes[:-1]]), heads


def open_bag(path: Path, *, keep: bool = True) -> Bag:
    """Read a bag.

    Args:
        path: a bag's directory, that of a run with a `bag` in it, an `.mcap` or an
            `.mcap.partial` file.
        keep: keep the messages; else they are only counted.

    Returns:
        The bag; if it is damaged, as far as it can be read.

    Raises:
        BagError: the file is missing, the directory contains no bag file or several that are not
            parts of one bag, or a file does not begin as MCAP.
    """
    bag = Bag(bag_files(Path(path)))
    for part in bag.read():
        if keep:
            bag.parts.append(part)
    return bag


def continued(directory: Path) -> Bag | None:
    """Read the bag in a directory that a recorder will continue with a further file.

    Files of a recorder that was killed before it had written a message are removed.

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
    """Return whether a file of a bag contains a message."""
    return file.stat().st_size > 0 and any(True for _ in Bag([file]).read())


_NUMBERED = re.compile(rf"(.+)_(0|[1-9][0-9]*)\.mcap({re.escape(PARTIAL)})?")


def bag_files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag's directory in order, or the file itself.

    Several files are one bag if their names differ in their numbers only. If a finished and an
    unfinished file of one name exist, the finished one counts. If the directory holds no bag
    file, its subdirectory `bag` is searched, where `run` writes.

    Raises:
        BagError: there is no bag, or there are several.
        RunError: the path is the name of a scenario.
    """
    refuse_scenario(path)
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
