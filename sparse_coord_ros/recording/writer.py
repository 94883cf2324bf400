# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bag writer: raw CDR messages into a rosbag2 directory with one MCAP file."""

from collections.abc import Mapping
from pathlib import Path

from mcap.writer import Writer

from sparse_coord_ros import __version__
from sparse_coord_ros.errors import BagError
from sparse_coord_ros.recording.files import chunk_compression, create_bag_file, write_whole
from sparse_coord_ros.recording.metadata import TopicSummary, bag_information, metadata_yaml
from sparse_coord_ros.recording.qos import QoS, offered_qos_profiles, yaml_text
from sparse_coord_ros.recording.schemas import schema_text, type_hash

DEFAULT_CHUNK_SIZE = 256 * 1024
"""Bytes of uncompressed messages in a chunk: what a killed process loses at most."""

# rosbag2 holds times as signed 64 bit nanoseconds.
_MAX_TIME_NS = 2**63 - 1


class BagWriter:
    """Writes one bag: a new directory with `<name>_0.mcap` and, once closed, `metadata.yaml`.

    Every chunk is handed to the operating system as soon as it is full, and by `flush`: a bag
    that is never closed holds these chunks complete, but has no summary and no `metadata.yaml`,
    which marks it as unfinished. As a context manager the writer closes the bag on success and
    abandons it on an exception, so that a broken run does not look whole. The same calls give the
    same bytes. Not thread-safe: one thread, or one lock, for all calls.

    Args:
        directory: the bag's directory, made here with its parents; must not exist.
        compression: of chunks: `zstd`, `lz4` or `none`.
        chunk_size: bytes of uncompressed messages after which a chunk is written.
        name: stem of the MCAP file; the directory's name by default.

    Raises:
        BagError: an argument is not as above, or directory or file cannot be made.
    """

    def __init__(
        self,
        directory: Path,
        *,
        compression: str = "zstd",
        chunk_size: int = DEFAULT_CHUNK_SIZE,
        name: str | None = None,
    ) -> None:
        """Make the directory and start the file, as the class says."""
        compression_type = chunk_compression(compression)
        if isinstance(chunk_size, bool) or not isinstance(chunk_size, int) or chunk_size < 1:
            raise BagError(f"chunk_size is {chunk_size!r}: give a number of bytes, 1 or more")
        self._directory = Path(directory)
        stem = self._directory.name if name is None else name
        if not stem or "/" in stem or "\0" in stem:
            raise BagError(f"bag name is {stem!r}: give a file name, without directories")
        self._file_name = f"{stem}_0.mcap"
        self._file = create_bag_file(self._directory, self._file_name)
        self._writer = Writer(
            self._file,  # type: ignore[arg-type]  # of a stream, Writer uses write, tell and flush
            chunk_size=chunk_size,
            compression=compression_type,
            enable_data_crcs=True,
        )
        self._add_message = self._writer.add_message
        self._schema_ids: dict[str, int] = {}
        self._channels: dict[str, tuple[int, str, QoS]] = {}
        self._counts: dict[int, int] = {}
        self._start_ns = _MAX_TIME_NS
        self._end_ns = 0
        self._writer.start(profile="ros2", library=f"sparse_coord_ros {__version__}")

    @property
    def message_count(self) -> int:
        """Number of messages written, those in the unfinished chunk included."""
        return sum(self._counts.values())

    @property
    def bytes_written(self) -> int:
        """Bytes handed to the operating system; the unfinished chunk is not among them."""
        return self._file.tell()

    def add_topic(self, topic: str, type_name: str, qos: QoS) -> int:
        """Return the topic's channel id, registering topic and type if they are new.

        Args:
            topic: full topic name, with a leading slash.
            type_name: `package/msg/Type`, or `package/srv/Service_Event` for service events.
            qos: what the topic's publisher offers.

        Raises:
            BagError: the topic is known with another type or profile, its name is not absolute,
                the type's definition is not installed, or the bag is closed or broken.
        """
        self._file.check_usable()
        if topic in self._channels:
            channel_id, *known = self._channels[topic]
            if known != [type_name, qos]:
                raise BagError(
                    f"topic {topic} is in the bag as {known[0]} with {known[1]}, not {type_name} "
                    f"with {qos}: record one type and one profile a topic"
                )
            return channel_id
        if not topic.startswith("/"):
            raise BagError(f"topic {topic!r} is not a full name: give it with a leading slash")
        if type_name not in self._schema_ids:
            text = schema_text(type_name).encode()
            self._schema_ids[type_name] = self._writer.register_schema(type_name, "ros2msg", text)
        channel_id = self._writer.register_channel(
            topic,
            "cdr",
            self._schema_ids[type_name],
            {
                "offered_qos_profiles": offered_qos_profiles([qos]),
                "topic_type_hash": _recorded_hash(type_name),
            },
        )
        self._channels[topic] = (channel_id, type_name, qos)
        self._counts[channel_id] = 0
        return channel_id

    def write(self, channel_id: int, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Append one message; its sequence number is its place in its channel, from 0.

        Args:
            channel_id: as `add_topic` returned it.
            data: the serialised message with its CDR header.
            log_time_ns: time of reception in nanoseconds, 0 to 2**63 - 1, in any order.
            publish_time_ns: time of publication, likewise.

        Raises:
            BagError: the channel is unknown, a time is out of range, the bag is closed, or
                writing failed, after which the bag takes no more messages.
        """
        if self._file.refusal is not None:
            raise BagError(self._file.refusal)
        try:
            sequence = self._counts[channel_id]
        except KeyError:
            raise BagError(
                f"channel {channel_id!r} is not in {self._file.path}: give an id that add_topic "
                "returned"
            ) from None
        if not (0 <= log_time_ns <= _MAX_TIME_NS and 0 <= publish_time_ns <= _MAX_TIME_NS):
            raise BagError(
                f"times of a message in channel {channel_id} are {log_time_ns} and "
                f"{publish_time_ns}: give nanoseconds from 0 to {_MAX_TIME_NS}"
            )
        self._add_message(channel_id, log_time_ns, data, publish_time_ns, sequence)
        self._counts[channel_id] = sequence + 1
        if log_time_ns < self._start_ns:
            self._start_ns = log_time_ns
        if log_time_ns > self._end_ns:
            self._end_ns = log_time_ns

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Add a metadata record of texts, for example parameters or versions.

        Raises:
            BagError: a key or value is not a text, writing failed, or the bag is closed.
        """
        self._file.check_usable()
        for key, value in data.items():
            if not (isinstance(key, str) and isinstance(value, str)):
                raise BagError(f"metadata {name}: {key!r} is {value!r}: give texts only")
        self._writer.add_metadata(name, dict(data))

    def attach(self, name: str, data: bytes, media_type: str, log_time_ns: int = 0) -> None:
        """Add a file as an attachment, for example a scenario as `application/yaml`.

        Raises:
            BagError: writing failed, or the bag is closed.
        """
        self._file.check_usable()
        # The creation time stays 0, "not available": the bytes must not depend on the clock.
        self._writer.add_attachment(0, log_time_ns, name, media_type, data)

    def flush(self) -> None:
        """End the current chunk and hand it to the operating system, without fsync.

        Raises:
            BagError: writing failed, or the bag is closed.
        """
        self._file.check_usable()
        self._writer.flush()

    def close(self) -> None:
        """Finish the MCAP file and write `metadata.yaml`; a second call does nothing.

        Raises:
            BagError: writing failed, now or earlier; the bag stays unfinished.
        """
        if self._file.closed:
            return
        try:
            self._file.check_usable()
            information = bag_information(
                self._file_name,
                [
                    TopicSummary(topic, kind, self._counts[channel], (qos,), _recorded_hash(kind))
                    for topic, (channel, kind, qos) in self._channels.items()
                ],
                start_time_ns=self._start_ns,
                end_time_ns=self._end_ns,
            )
            self._writer.flush()
            # rosbag2 stores its information in the file too, and reads it from there if the
            # MCAP file is opened alone.
            self._writer.add_metadata("rosbag2", {"serialized_metadata": yaml_text(information)})
            self._writer.finish()
        finally:
            self._file.close()
        write_whole(self._directory / "metadata.yaml", metadata_yaml(information))

    def abandon(self) -> None:
        """Write the current chunk and close the file without finishing it.

        Readers that scan (mcap's `NonSeekingReader`) see every message, others refuse the file.

        Raises:
            BagError: writing failed.
        """
        if self._file.closed:
            return
        try:
            if self._file.refusal is None:
                self._writer.flush()
        finally:
            self._file.close()

    def __enter__(self) -> "BagWriter":
        """Return the writer itself."""
        return self

    def __exit__(self, exception_type: type[BaseException] | None, *_: object) -> None:
        """Close the bag, or abandon it if the block raised."""
        if exception_type is None:
            self.close()
        else:
            self.abandon()


def _recorded_hash(type_name: str) -> str:
    """Return the hash to record; rosbags cannot open a bag that has one for a service event.

    It registers these types under another name, `package/srv/msg/Service_Event`, and then does
    not find the one whose hash it wants to compare.
    """
    return "" if "/srv/" in type_name else type_hash(type_name)
