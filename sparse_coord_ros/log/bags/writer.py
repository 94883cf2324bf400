# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bag writer: raw CDR messages into a rosbag2 directory of MCAP files."""

from collections.abc import Mapping
from pathlib import Path

from mcap.writer import CompressionType, IndexType, Writer

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.log.bags.layout import create_bag_file, write_text
from sparse_coord_ros.log.bags.metadata import (
    LATEST_NS,
    METADATA_FILE,
    METADATA_RECORD,
    FileSummary,
    bag_information,
    metadata_yaml,
    offered_qos_profiles,
    yaml_text,
)
from sparse_coord_ros.log.bags.reader import Bag, stem_and_number
from sparse_coord_ros.log.bags.schemas import schema_text, type_hash
from sparse_coord_ros.log.bags.topics import BagTopic, QoS

DEFAULT_CHUNK_SIZE = 256 * 1024
"""Bytes of uncompressed messages in a chunk: a killed process loses one chunk at most."""


class BagWriter:
    """Writes one bag: a new directory `<name>` with `<name>_0.mcap` and `metadata.yaml`.

    Further files follow by `begin_file`, or if an earlier bag is continued: `<name>_1.mcap` and so
    on.

    Until it is closed the file is `<name>_0.mcap.partial`, alone in its directory. Every chunk is
    handed to the operating system as soon as it is full, and by `flush`: a bag that is never
    closed contains these chunks completely, and `open_bag` reads it up to there. The same calls
    give the same bytes. Not thread-safe: one thread, or one lock, for all calls.

    Args:
        directory: the bag's directory, made here with its parents; must not exist.
        chunk_size: bytes of uncompressed messages after which a chunk is written.
        earlier: the bag in that directory that the writer continues (`reader.continued`).

    Raises:
        BagError: directory or file cannot be made.
    """

    def __init__(
        self,
        directory: Path,
        *,
        chunk_size: int = DEFAULT_CHUNK_SIZE,
        earlier: Bag | None = None,
    ) -> None:
        """Make the directory and start the file, as the class says."""
        self._chunk_size = chunk_size
        self._directory = Path(directory)
        stem = self._directory.name
        self._files: list[FileSummary] = []
        self._topics_before: Mapping[str, BagTopic] = {}
        number = 0
        if earlier is not None:
            stem, last = stem_and_number(earlier.files[-1].path)
            number = last + 1
            self._files += [file.summary for file in earlier.files if file.finished]
            self._topics_before = earlier.topics
        self._stem = stem
        self._number = number
        self._bytes_before = self._messages_before = 0
        self._channels: dict[str, int] = {}
        self._topics: dict[str, BagTopic] = {}
        self._start_file(new=earlier is None)

    def _start_file(self, *, new: bool) -> None:
        """Begin a file, with the known channels; `new`: the bag's first file."""
        self._file_name = f"{self._stem}_{self._number}.mcap"
        self._file = create_bag_file(self._directory, self._file_name, new=new)
        self._writer = Writer(
            self._file,  # type: ignore[arg-type]  # Writer uses only write, tell and flush
            chunk_size=self._chunk_size,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,
            # no attachments: `pymcap-cli doctor` takes an index without entries for damage
            index_types=IndexType.CHUNK | IndexType.MESSAGE | IndexType.METADATA,
        )
        self._add_message = self._writer.add_message
        self._schema_ids: dict[tuple[str, str, bytes], int] = {}
        self._counts: dict[int, int] = {}
        self._start_ns = LATEST_NS
        self._end_ns = 0
        self._writer.start(profile="ros2", library=f"sparse_coord_ros {__version__}")
        for topic in self._topics.values():
            self._register(topic)

    def begin_file(self) -> None:
        """End the file and begin the next.

        Raises:
            BagError: writing failed, or the bag is closed.
        """
        self._file.check_usable()
        self._finish_file()
        self._bytes_before += self._file.tell()
        self._messages_before += sum(self._counts.values())
        self._number += 1
        self._start_file(new=False)

    @property
    def message_count(self) -> int:
        """Number of messages written, those in the unfinished chunk included."""
        return self._messages_before + sum(self._counts.values())

    @property
    def bytes_written(self) -> int:
        """Bytes handed to the operating system, without the unfinished chunk."""
        return self._bytes_before + self._file.tell()

    def add_topic(self, topic: str, type_name: str, qos: QoS) -> int:
        """Return the topic's channel id, registering topic and type if the topic is new.

        Args:
            topic: full topic name, with a leading slash.
            type_name: `package/msg/Type`.
            qos: the profile that the topic's publisher offers.

        Raises:
            BagError: the type's definition is not installed, or the bag is closed or broken.
        """
        self._file.check_usable()
        if topic in self._channels:
            return self._channels[topic]
        digest = type_hash(type_name)
        known = BagTopic(topic, type_name, schema_text(type_name), (qos,), digest)
        return self.add_known_topic(known)

    def add_known_topic(self, topic: BagTopic) -> int:
        """Return the channel id of a new topic, with its description from another bag.

        Raises:
            BagError: the bag is closed or broken.
        """
        self._file.check_usable()
        self._topics[topic.name] = topic
        channel_id = self._channels[topic.name] = self._register(topic)
        return channel_id

    def _register(self, topic: BagTopic) -> int:
        """Write a topic's type and channel into the file, and return the channel."""
        schema = topic.type_name, "ros2msg", topic.schema.encode()
        if schema not in self._schema_ids:
            self._schema_ids[schema] = self._writer.register_schema(*schema)
        profiles = offered_qos_profiles(topic.qos)
        metadata = {
            "offered_qos_profiles": profiles,
            "topic_type_hash": topic.type_hash,
        }
        channel_id = self._writer.register_channel(
            topic.name, "cdr", self._schema_ids[schema], metadata
        )
        self._counts[channel_id] = 0
        return channel_id

    def write(
        self,
        channel_id: int,
        data: bytes,
        log_time_ns: int,
        publish_time_ns: int,
    ) -> None:
        """Append one message; its sequence number is its place in its channel of the file.

        Args:
            channel_id: as `add_topic` returned it.
            data: the serialised message with its CDR header.
            log_time_ns: time of reception in nanoseconds, 0 to 2**63 - 1, in any order.
            publish_time_ns: time of publication, likewise.

        Raises:
            BagError: the bag is closed, or writing failed, after which the bag accepts no more
                messages.
            KeyError: the channel is unknown.
        """
        if self._file.refusal is not None:
            raise BagError(self._file.refusal)
        count = self._counts[channel_id]
        self._add_message(channel_id, log_time_ns, data, publish_time_ns, count)
        self._counts[channel_id] = count + 1
        if log_time_ns < self._start_ns:
            self._start_ns = log_time_ns
        if log_time_ns > self._end_ns:
            self._end_ns = log_time_ns

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Add a metadata record of texts, for example parameters or versions.

        Raises:
            BagError: writing failed, or the bag is closed.
        """
        self._file.check_usable()
        self._writer.add_metadata(name, dict(data))

    def flush(self) -> None:
        """End the current chunk and hand it to the operating system, without fsync.

        Raises:
            BagError: writing failed, or the bag is closed.
        """
        self._file.check_usable()
        self._writer.flush()

    def close(self) -> None:
        """Finish and rename the MCAP file, write `metadata.yaml`; a second call does nothing.

        Raises:
            BagError: writing failed, now or earlier: the file stays `.partial`, or only
                `metadata.yaml` is missing.
        """
        if self._file.closed:
            return
        self._finish_file()
        topics = {**self._topics_before, **self._topics}
        information = bag_information(self._files, topics.values())
        write_text(self._directory / METADATA_FILE, metadata_yaml(information))

    def _finish_file(self) -> None:
        """Finish and rename the file, and close it in any case."""
        counts = {
            topic: self._counts[channel] for topic, channel in self._channels.items()
        }
        file = FileSummary(self._file_name, counts, self._start_ns, self._end_ns)
        try:
            self._file.check_usable()
            self._writer.flush()
            # rosbag2 also stores its information in the file, and reads it from there if the MCAP
            # file is opened alone.
            information = yaml_text(bag_information([file], self._topics.values()))
            self._writer.add_metadata(
                METADATA_RECORD, {"serialized_metadata": information}
            )
            self._writer.finish()
            self._file.finish()
        finally:
            self._file.close()
        self._files.append(file)

    def abandon(self) -> None:
        """Write the current chunk and close the file without finishing it.

        The file stays `.partial`: `open_bag` reads every message.

        Raises:
            BagError: writing failed.
        """
        try:
            if self._file.refusal is None:
                self._writer.flush()
        finally:
            self._file.close()
