# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag writer in its own process, so that writing does not slow the run."""

import contextlib
import socket
import struct
import subprocess
import sys
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.base.signals import held_back
from sparse_coord_ros.log.bags.topics import QoS
from sparse_coord_ros.log.bags.writer import BagWriter

BATCH = 500
"""Messages that are handed over together."""

SEND_BYTES = 1 << 22
"""Wanted buffer between the processes (the system may give less), for the writer's pauses."""

PATIENCE_SECONDS = 30
"""A writer that neither receives nor answers for so long has failed (its disk hangs)."""


class BagProcess:
    """A `BagWriter` in a child process, with the same methods.

    When the run is killed, the messages that it has handed over are written: the child notices
    the end of its input, writes them and leaves the bag unfinished. Messages wait in this process
    until there are `BATCH` of them or `flush` is called. A failure is raised by a later call.

    Args:
        directory: the bag's directory.
        options: the other arguments of `BagWriter`.

    Attributes:
        message_count: number of messages handed over; a few hundred of them may still wait here.
        bytes_written: bytes handed to the operating system by the child's last answer.

    Raises:
        BagError: as `BagWriter`, or the child has ended or hangs.
    """

    def __init__(self, directory: Path, **options: Any) -> None:
        """Start the child and let it begin the bag, as the class says."""
        self._directory = directory
        self._batch: list[tuple[int, bytes, int, int]] = []
        self._refusal: str | None = None
        self._begun = False
        self.message_count = self.bytes_written = 0
        ours, theirs = socket.socketpair()
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BYTES)
        for direction in (socket.SO_SNDTIMEO, socket.SO_RCVTIMEO):
            ours.setsockopt(
                socket.SOL_SOCKET, direction, struct.pack("ll", PATIENCE_SECONDS, 0)
            )
        self._connection = Connection(ours.detach())
        # -P: without modules of the current directory
        command = [sys.executable, "-P", "-m", __name__, str(theirs.fileno())]
        shared: dict[str, Any] = {
            "stdin": subprocess.DEVNULL,
            "pass_fds": [theirs.fileno()],
        }
        try:
            with theirs, held_back():  # for good: the child ends with this process
                self._process = subprocess.Popen(
                    command, start_new_session=True, **shared
                )
        except OSError as error:
            self._connection.close()
            what = f"cannot start the writer process of the bag {directory}"
            raise BagError(f"{what}: {error.strerror}; nothing is recorded") from error
        try:
            self._call("open", str(Path(directory).absolute()), options)
            self._begun = True
        except BagError:
            self._end()
            raise

    def add_topic(self, topic: str, type_name: str, qos: QoS) -> int:
        """Return the topic's channel id; a new topic and its type are registered."""
        return self._call("add_topic", topic, type_name, qos)

    def begin_file(self) -> None:
        """End the file and begin the next."""
        self._call("begin_file")

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Add a metadata record of texts."""
        self._call("add_metadata", name, data)

    def write(
        self, channel_id: int, data: bytes, log_time_ns: int, publish_time_ns: int
    ) -> None:
        """Append one message; the child gets `BATCH` of them at a time."""
        batch = self._batch
        batch.append((channel_id, data, log_time_ns, publish_time_ns))
        if len(batch) >= BATCH:
            self._hand_over()

    def flush(self) -> None:
        """Have the current chunk handed to the operating system, without waiting for it."""
        self._hand_over()
        self._send("flush")

    def close(self) -> None:
        """Finish the bag and end the child; a second call does nothing."""
        if self._process.returncode is not None:
            return
        try:
            self._call("close")
        finally:
            self._end()

    def _hand_over(self) -> None:
        batch = self._batch
        self._batch = []
        self.message_count += len(batch)
        self._send("write_all", batch)

    def _call(self, method: str, *arguments: Any) -> Any:
        """Call a method of the child's writer and return its answer."""
        if self._batch:
            self._hand_over()
        self._send(method, *arguments)
        while True:
            name, value = self._receive()
            if name == method:
                return value

    def _send(self, method: str, *arguments: Any) -> None:
        """Read the child's answers so far, and send it a call."""
        if self._refusal is not None:
            raise BagError(self._refusal)
        try:
            while self._connection.poll():
                self._receive()
            self._connection.send((method, *arguments))
        except OSError as error:
            self._fail(error)

    def _receive(self) -> tuple[str, Any]:
        """Wait for an answer of the child."""
        try:
            name, value, self.bytes_written = self._connection.recv()
        except (OSError, EOFError) as error:
            self._fail(error)
        if name == "refusal":
            self._refusal = value
            raise BagError(value)
        return name, value

    def _fail(self, error: OSError | EOFError) -> NoReturn:
        """Raise BagError: the child hangs, or has ended."""
        what = "has ended"
        remedy = "it is read up to there"
        so = "; the recording ends there, unfinished"
        if not self._begun:
            so = " before it had begun it; nothing is recorded"
            remedy = "see what it says above"
        if isinstance(error, BlockingIOError):
            what = f"has not moved for {PATIENCE_SECONDS:g} s"
            remedy = "check its disk"
        self._refusal = (
            f"the writer process of the bag {self._directory} {what}{so}: {remedy}"
        )
        raise BagError(self._refusal)

    def _end(self) -> None:
        """Wait for the child's end; kill it if it hangs."""
        self._connection.close()
        try:
            self._process.wait(PATIENCE_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def main() -> int:
    """Serve the process at the other end of the socket whose number is the only argument."""
    bag: Any = None
    gone = contextlib.suppress(OSError, EOFError)  # a killed parent wants no answer
    with Connection(int(sys.argv[1])) as connection, gone:
        name = ""
        try:
            while name != "close":
                name, *arguments = connection.recv()
                if name == "write_all":
                    for message in arguments[0]:
                        bag.write(*message)
                    continue
                if name == "open":
                    bag = BagWriter(Path(arguments[0]), **arguments[1])
                value = None if name == "open" else getattr(bag, name)(*arguments)
                with contextlib.suppress(BrokenPipeError):
                    connection.send((name, value, bag.bytes_written))
        except BagError as error:
            connection.send(("refusal", str(error), bag.bytes_written if bag else 0))
            while True:
                connection.recv_bytes()  # until the parent has read the refusal and closes
        finally:
            if bag is not None:
                with contextlib.suppress(BagError):
                    bag.abandon()
    return 0


if __name__ == "__main__":
    sys.exit(main())
