# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bag reader: finished, unfinished and damaged bags, without ROS."""

import contextlib
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Chunk

from sparse_coord_ros.bags.layout import PARTIAL, open_to_read
from sparse_coord_ros.bags.metadata import CONTINUED_RECORD, RECOVERED_RECORD
from sparse_coord_ros.bags.records import (
    HEAD,
    MAGIC,
    MESSAGE,
    Damage,
    Source,
    chunk_content,
    message_heads,
    parse,
)
from sparse_coord_ros.bags.scan import AttachmentPlace, Scan
from sparse_coord_ros.bags.topics import BagTopic
from sparse_coord_ros.errors import BagError, newer_format
from sparse_coord_ros.learn.run_config import RUN_RECORD
from sparse_coord_ros.wire import BAG_FORMAT, FORMAT_KEY

BAG_DIRECTORY = "bag"
"""Name of the bag's directory in that of a run."""

_FOOTER = HEAD.pack(Opcode.FOOTER, 20)
_TAIL_BYTES = len(_FOOTER) + 20 + len(MAGIC)


class Message(NamedTuple):
    """A recorded message.

    Attributes:
        topic: the topic's full name.
        data: the serialised message with its CDR header.
        log_time_ns: time of reception.
        publish_time_ns: time of publication.
        sequence: its place in its channel, from 0 where `BagWriter` wrote it.
    """

    topic: str
    data: bytes
    log_time_ns: int
    publish_time_ns: int
    sequence: int


class Part(NamedTuple):
    """Messages that lie together in a file.

    Attributes:
        content: bytes in which their data are.
        begins: where in it each one's data begin, shape (messages,).
        heads: their heads, of type `records.MESSAGE_HEAD`, same shape.
    """

    content: bytes
    begins: np.ndarray
    heads: np.ndarray


class Attachment(NamedTuple):
    """A file in the bag."""

    name: str
    media_type: str
    data: bytes
    log_time_ns: int


class Attachments(Sequence[Attachment]):
    """The attachments of a bag, each read from its file when it is asked for."""

    def __init__(self, paths: Sequence[Path], places: Sequence[AttachmentPlace]) -> None:
        """Take the file of each attachment, and where in it that is."""
        self.paths = tuple(paths)
        self._places = tuple(places)

    @property
    def names(self) -> tuple[str, ...]:
        """Their names, without reading any."""
        return tuple(place.name for place in self._places)

    @property
    def places(self) -> tuple[AttachmentPlace, ...]:
        """Names, types, sizes and places in the file, without reading any."""
        return self._places

    def __len__(self) -> int:
        """Return the number of attachments."""
        return len(self._places)

    def __getitem__(self, item):
        """Return one attachment, or a tuple of them; raises BagError if the file has changed."""
        if isinstance(item, slice):
            return tuple(self[i] for i in range(*item.indices(len(self))))
        place = self._places[item]
        with _opened(self.paths[item]) as source:
            source.seek(place.offset)
            data = source.read(place.size)
        return Attachment(place.name, place.media_type, data, place.log_time_ns)


@dataclass(frozen=True)
class Bag:
    """A bag, checked byte by byte by `open_bag`: one file, or several one after the other.

    Attributes:
        path: the MCAP file; of several their directory.
        finished: whether its recorder closed it: footer and summary are there.
        damage: None if every byte checked out; otherwise one sentence: the byte offset and what
            is wrong there. A bag that is unfinished is not damaged by that alone.
        topics: by name.
        metadata_records: name and texts of each metadata record, rosbag2's own included, in the
            order of the file; a name may be there more than once.
        metadata: their texts by name; of several with one name the first.
        attachments: read when they are asked for.
        counts: messages by topic.
        sizes: bytes of the messages' data by topic.
        message_count: messages of all topics.
        start_ns, end_ns: earliest and latest log time; 0 without messages.
        compressions: of its chunks: some of `zstd`, `lz4` and `none`.
        file_bytes: size of the file.
        readable_bytes: where the readable part of the data ends.
        lost_bytes: bytes of the file, from there on, of which nothing can be read.
        whole: whether all that was recorded was read, though index or summary be damaged.
    """

    path: Path
    finished: bool
    damage: str | None
    topics: Mapping[str, BagTopic]
    metadata_records: Sequence[tuple[str, Mapping[str, str]]]
    metadata: Mapping[str, Mapping[str, str]]
    attachments: Attachments
    counts: Mapping[str, int]
    sizes: Mapping[str, int]
    message_count: int
    start_ns: int
    end_ns: int
    compressions: tuple[str, ...]
    file_bytes: int
    readable_bytes: int
    lost_bytes: int
    whole: bool
    _names: Mapping[int, str] = field(repr=False)
    _files: tuple["Bag", ...] = ()

    @property
    def files(self) -> tuple["Bag", ...]:
        """Its files, each as a bag of its own, in their order."""
        return self._files or (self,)

    @property
    def continued(self) -> Mapping[str, str] | None:
        """Why this file continues a bag (see `metadata.CONTINUED_RECORD`); None: it does not."""
        return self.metadata.get(CONTINUED_RECORD)

    @property
    def recovered(self) -> Mapping[str, str] | None:
        """What `recover` noted when it made this bag of a broken one; None if it did not.

        Keys: `complete` (`true`, or `false` where something was lost), `damage` (what was wrong
        where in the original, or empty) and `lost_bytes`.
        """
        return self.metadata.get(RECOVERED_RECORD)

    @property
    def channels(self) -> Mapping[int, str]:
        """The topic of each channel, by the number in the messages' heads."""
        return self._names

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Yield the messages up to the first damage, in the order of the file.

        Args:
            topics: names of the topics to yield; None: all.

        Raises:
            BagError: the file has changed since it was opened, or cannot be read.
        """
        names = {
            channel_id: name
            for channel_id, name in self._names.items()
            if topics is None or name in topics
        }
        if not names:
            return
        for part in self.parts():
            fields = ("channel", "length", "log_ns", "publish_ns", "sequence")
            columns = (part.heads[name].tolist() for name in fields)
            for begin, channel_id, length, log_ns, publish_ns, sequence in zip(
                part.begins.tolist(), *columns, strict=True
            ):
                name = names.get(channel_id)
                if name is not None:
                    data = part.content[begin : begin + length - MESSAGE.size]
                    yield Message(name, data, log_ns, publish_ns, sequence)

    def parts(self, size: int = 0) -> Iterator[Part]:
        """Yield the messages up to the first damage in parts of whole chunks.

        Args:
            size: put chunks together until their content has so many bytes.

        Raises:
            BagError: the file has changed since it was opened, or cannot be read.
        """
        if self._files:
            for place in range(len(self._files)):
                yield from self.parts_of(place, size)
            return
        waiting, length_of_all = [], 0
        with _opened(self.path) as source:
            source.seek(len(MAGIC))
            while (offset := source.position) < self.readable_bytes:
                opcode, length = source.head()
                if opcode == Opcode.CHUNK:
                    chunk = parse(Chunk, source.read(length), offset)
                    waiting.append(chunk_content(chunk, offset, crc_required=False))
                elif opcode == Opcode.MESSAGE:
                    waiting.append(HEAD.pack(opcode, length) + source.read(length))
                else:
                    source.seek(source.position + length)
                    continue
                length_of_all += len(waiting[-1])
                if length_of_all > size:
                    yield _part(b"".join(waiting), offset)
                    waiting, length_of_all = [], 0
            if waiting:
                yield _part(b"".join(waiting), offset)

    def parts_of(self, place: int, size: int = 0) -> Iterator[Part]:
        """Yield the parts of one of the files (from 0), with the channels of the whole."""
        file = self.files[place]
        if file is self:
            yield from self.parts(size)
            return
        numbers = {name: channel for channel, name in self._names.items()}
        table = np.zeros(1 << 16, dtype=np.uint16)
        for channel, name in file.channels.items():
            table[channel] = numbers[name]
        for part in file.parts(size):
            heads = part.heads.copy()
            heads["channel"] = table[heads["channel"]]
            yield part._replace(heads=heads)


def _part(content: bytes, offset: int) -> Part:
    places, heads, _ = message_heads(content, offset)
    return Part(content, places + HEAD.size + MESSAGE.size, heads)


def open_bag(path: Path) -> Bag:
    """Read through a bag once, check every byte, and say what is in it.

    Args:
        path: a bag's directory, that of a run with a `bag` in it, an `.mcap` or an
            `.mcap.partial` file.

    Returns:
        The bag; if it is damaged, as far as it can be read.

    Raises:
        BagError: there is no such file, none in the directory or several that are not parts of
            one bag, or a file does not begin as MCAP, holds other messages than those of ROS 2, or
            is a run's in a format newer than this version's.
    """
    files = bag_files(Path(path))
    if len(files) > 1:
        return _joined([_open_file(file) for file in files])
    return _open_file(files[0])


def _open_file(path: Path) -> Bag:
    with _opened(path) as source:
        finished = _closed(source)
        try:
            scan = Scan(source)
        except BagError as error:
            raise BagError(f"{path}: {error}") from error
        size = source.size
    number = dict(reversed(scan.metadata)).get(RUN_RECORD, {}).get(FORMAT_KEY, "1")
    if re.fullmatch("[1-9][0-9]{0,8}", number) and int(number) > BAG_FORMAT:
        raise BagError(newer_format(str(path), int(number), BAG_FORMAT))
    damage = scan.damage
    if damage is None and not scan.closed and path.suffix != PARTIAL:
        damage = f"byte {size}: the file ends here, without an end: it was cut off"
    first_texts: dict[str, Mapping[str, str]] = {}
    for name, texts in scan.metadata:
        first_texts.setdefault(name, texts)
    names = {channel_id: topic.name for channel_id, topic in scan.topics.items()}
    counts = dict.fromkeys(names.values(), 0)
    sizes = dict.fromkeys(names.values(), 0)
    for channel_id, name in names.items():
        counts[name] += scan.counts[channel_id]
        sizes[name] += scan.sizes[channel_id]
    return Bag(
        path=path,
        finished=finished,
        damage=damage,
        topics={topic.name: topic for topic in scan.topics.values()},
        metadata_records=tuple(scan.metadata),
        metadata=first_texts,
        attachments=Attachments([path] * len(scan.attachments), scan.attachments),
        counts=counts,
        sizes=sizes,
        message_count=sum(counts.values()),
        start_ns=scan.start_ns,
        end_ns=scan.end_ns,
        compressions=tuple(sorted(name or "none" for name in scan.compressions)),
        file_bytes=size,
        readable_bytes=scan.end,
        lost_bytes=0 if scan.end_found else size - scan.end,
        whole=scan.whole or (damage is None and not finished),
        _names=names,
    )


def _joined(files: Sequence[Bag]) -> Bag:
    """Return several files as one bag."""
    names: dict[str, int] = {}
    for file in files:
        for name in file.channels.values():
            names.setdefault(name, len(names) + 1)
    topics: dict[str, BagTopic] = {}
    for file in files:
        for name, topic in file.topics.items():
            if topics.setdefault(name, topic).schema != topic.schema:
                raise BagError(
                    f"{file.path}: topic {name} has another definition than in the file before: "
                    "these are no parts of one bag; name one"
                )
    filled = [file for file in files if file.message_count]
    damaged = [f"{file.path.name}: {file.damage}" for file in files if file.damage is not None]
    records = [record for file in files for record in file.metadata_records]
    first_texts: dict[str, Mapping[str, str]] = {}
    for name, texts in records:
        if name != RECOVERED_RECORD:
            first_texts.setdefault(name, texts)
    if files[-1].recovered is not None:  # what was lost before is a gap between the files
        first_texts[RECOVERED_RECORD] = files[-1].recovered
    return Bag(
        path=files[0].path.parent,
        finished=all(file.finished for file in files),
        damage=damaged[0] if damaged else None,
        topics=topics,
        metadata_records=tuple(records),
        metadata=first_texts,
        attachments=Attachments(
            [path for file in files for path in file.attachments.paths],
            [place for file in files for place in file.attachments.places],
        ),
        counts={name: sum(file.counts.get(name, 0) for file in files) for name in topics},
        sizes={name: sum(file.sizes.get(name, 0) for file in files) for name in topics},
        message_count=sum(file.message_count for file in files),
        start_ns=min((file.start_ns for file in filled), default=0),
        end_ns=max((file.end_ns for file in filled), default=0),
        compressions=tuple(sorted({name for file in files for name in file.compressions})),
        file_bytes=sum(file.file_bytes for file in files),
        readable_bytes=sum(file.readable_bytes for file in files),
        lost_bytes=sum(file.lost_bytes for file in files),
        whole=all(file.whole for file in files),
        _names={number: name for name, number in names.items()},
        _files=tuple(files),
    )


_NUMBERED = re.compile(rf"(.+)_(0|[1-9][0-9]*)\.mcap({re.escape(PARTIAL)})?")


def bag_files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag's directory in order, or the file itself; raises BagError.

    Several are one bag where their names differ in their numbers only. Where a finished and an
    unfinished file of one name lie beside each other, it is the finished one. In a directory
    without any, they are those of the directory `bag` there, as `run` leaves it.
    """
    if not path.is_dir():
        return [path]
    for directory in (path, path / BAG_DIRECTORY):
        try:
            files = sorted(p for p in directory.iterdir() if not p.name.startswith("."))
        except (FileNotFoundError, NotADirectoryError):
            break
        except OSError as error:
            raise BagError(f"cannot read the bag {directory}: {error.strerror}") from error
        found = {
            file.name.removesuffix(PARTIAL): file
            for ending in (f".mcap{PARTIAL}", ".mcap")
            for file in files
            if file.name.endswith(ending)
        }
        if len(found) < 2:
            if found:
                return list(found.values())
            continue
        matches = [_NUMBERED.fullmatch(name) for name in found]
        if None in matches or len({match[1] for match in matches if match}) > 1:
            raise BagError(f"bag {directory} has {len(found)} .mcap files: name one")
        return [found[name] for name in sorted(found, key=number_of)]
    raise BagError(
        f"{path} is not a bag: it has no .mcap file; give a bag's directory or its file"
    )


def bag_file(path: Path) -> Path:
    """Return the one MCAP file of a bag, as `bag_files`; raises BagError where it has several."""
    files = bag_files(path)
    if len(files) > 1:
        raise BagError(f"bag {path} has {len(files)} files: name one")
    return files[0]


def number_of(name: str) -> int:
    """Return the number in the name of a bag's file; 0 where there is none."""
    match = _NUMBERED.fullmatch(name)
    return int(match[2]) if match else 0


class _opened:  # noqa: N801
    """A file to read from; whatever is wrong with it comes out as BagError."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> Source:
        self._file = open_to_read(self._path)
        with contextlib.ExitStack() as failing:
            failing.callback(self._file.close)
            try:
                size = os.fstat(self._file.fileno()).st_size
                magic = self._file.read(len(MAGIC))
                self._file.seek(0)
            except OSError as error:
                raise BagError(f"cannot read {self._path}: {error.strerror}") from error
            if magic != MAGIC:
                raise BagError(f"{self._path} is not an MCAP file: it does not begin like one")
            failing.pop_all()
        return Source(self._file, size)

    def __exit__(self, kind, error, trace) -> None:
        self._file.close()
        if isinstance(error, Damage):
            raise BagError(f"{self._path} has changed while it was read: {error}") from error
        if isinstance(error, OSError):
            raise BagError(f"cannot read {self._path}: {error.strerror}") from error


def _closed(source: Source) -> bool:
    """Whether the file ends as its recorder's `close` leaves it."""
    if source.size < len(MAGIC) + _TAIL_BYTES:
        return False
    source.seek(source.size - _TAIL_BYTES)
    tail = source.read(_TAIL_BYTES)
    return tail.startswith(_FOOTER) and tail.endswith(MAGIC)
