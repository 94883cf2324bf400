# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Contexts, executors, signals and exit codes of every executable."""

import faulthandler
import re
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import Executor
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from sparse_coord_ros.base import errors
from sparse_coord_ros.base.signals import STOPPING
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.environment import (
    check_security,
    ros_domain,
    use_udp,
)
from sparse_coord_ros.ros.nodes.parameters import ParameterNode

READERS_SECONDS = 3.5
"""How long the last messages may take: with a user's own profiles, Fast DDS offers lost ones again
every three seconds."""

POLL_SECONDS = 0.02
"""Between two checks whether the nodes are to end. Python handles signals then, too."""

SPIN_SECONDS = 60.0
"""Of one spinning. Without a limit the EventsExecutor of rclpy 7.1.6 uses a whole core."""

MATCH_SECONDS = 1.0
"""How long the readers of /rosout may take to find the publisher of a node's last message."""

ARGUMENTS = (
    "write --ros-args, then -p NAME:=VALUE, --params-file FILE, -r __node:=NAME or "
    "-r __ns:=/NAME; names have letters, digits and _"
)
"""The remedy for arguments that ROS cannot read."""

OF_RCL = re.compile(r"(\. Error: (Expected lexeme|error not set).*|, at /\S+:\d+.*)$")
"""The part of an error of rcl that only its authors understand."""

PATIENCE_SECONDS = 3.0
SHUTDOWN_SECONDS = 10.0
STDERR = 2
"""Its file descriptor: `sys` has none after the terminal was closed."""


class Stop:
    """A flag that is set when one of the signals `STOPPING` has come.

    One Ctrl-C often arrives twice, from the terminal and from launch. A further signal interrupts
    at once only when the node has had `PATIENCE_SECONDS` to end by itself.
    """

    def __init__(self) -> None:
        self.signal: int | None = None
        self._since = 0.0
        self._at_once = False

    def __bool__(self) -> bool:
        """Return whether a signal has come."""
        return self.signal is not None

    def handle(self, number: int, frame: object) -> None:
        """Note a signal."""
        if self.signal is None:
            self.signal = number
            self._since = time.monotonic()
            if self._at_once:
                raise KeyboardInterrupt
        elif time.monotonic() - self._since > PATIENCE_SECONDS:
            raise KeyboardInterrupt

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Let the first signal interrupt at once, also one that came before."""
        self._at_once = True
        try:
            if self:
                raise KeyboardInterrupt
            yield
        finally:
            self._at_once = False


@contextmanager
def signals() -> Iterator[Stop]:
    """Catch `STOPPING`, so that nodes can send their last messages while ROS still works."""
    stop = Stop()
    ignored = (
        [signal.SIGHUP] if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN else []
    )
    before = {n: signal.signal(n, stop.handle) for n in STOPPING if n not in ignored}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def ros_context(args: Sequence[str] | None = None) -> Iterator[Context]:
    """Open a ROS context of its own, without ROS's signal handlers; it talks by UDP: `use_udp`.

    Args:
        args: the command line: a program's name, then `--ros-args`; None: no arguments.

    Raises:
        RunError: other arguments, or such that ROS cannot read.
    """
    use_udp()
    check_security()
    ros_domain()  # an error now, in one line
    context = Context()
    words = list(args or ())
    try:
        more = remove_ros_args(words)[1:]
        if more:
            raise errors.RunError(
                f"argument {more[0]!r}: is no ROS argument; {ARGUMENTS}"
            )
        none = SignalHandlerOptions.NO
        rclpy.init(args=words, context=context, signal_handler_options=none)
    except RuntimeError as error:  # of rcl: malformed or unknown ROS arguments
        problem = errors.message_of(error)
        what = OF_RCL.sub("", problem.rpartition("failed to initialize rcl: ")[2])
        what = what.removeprefix("Failed to parse ROS arguments: ")
        raise errors.RunError(f"ROS: {what.rstrip(' .')}; {ARGUMENTS}") from None
    try:
        yield context
    finally:
        with limited_shutdown():
            rclpy.try_shutdown(context=context)


@contextmanager
def limited_shutdown() -> Iterator[None]:
    """End the process with exit code 1 if the shutdown of ROS hangs; everything is saved by then.

    Fast DDS 2.14 can deadlock when another participant leaves (eProsima/Fast-DDS issue 6502), and
    then no signal ends the process. The hanging call holds Python's interpreter lock. The watchdog
    runs without it, and so can only print "Timeout" and the stack of each thread.
    """
    faulthandler.dump_traceback_later(SHUTDOWN_SECONDS, exit=True, file=STDERR)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


def make_executor(context: Context) -> Executor:
    """Return an executor of events.

    Raises:
        RunError: this rclpy has none.
    """
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        raise errors.RunError(
            "this rclpy has no EventsExecutor (new in 7.1.2); update ROS 2 Jazzy"
        ) from None
    return EventsExecutor(context=context)


def spin_nodes(
    nodes: Sequence[ParameterNode],
    context: Context,
    until: Callable[[], bool],
    make: Callable[[Context], Executor] = make_executor,
) -> None:
    """Run nodes until a condition holds.

    Args:
        nodes: the nodes.
        context: their context.
        until: the condition.
        make: makes the executor.

    Raises:
        SparseCoordError: a node failed.
    """
    ended = Future()

    def look() -> None:
        """End the spinning when the condition holds, or a node has failed."""
        failures = [node.failure for node in nodes if node.failure is not None]
        if until():
            ended.set_result(None)
        elif failures:
            ended.set_exception(failures[0])

    executor = make(context)
    timer = nodes[0].create_timer(POLL_SECONDS, look)
    try:
        for node in nodes:
            executor.add_node(node)
        while not ended.done():
            executor.spin_until_future_complete(ended, timeout_sec=SPIN_SECONDS)
    finally:
        nodes[0].destroy_timer(timer)
        for node in nodes:
            executor.remove_node(node)
        executor.shutdown()
    ended.result()


def wait_for_readers(publishers: Iterable[Publisher]) -> None:
    """Wait until all readers have the published messages, at most `READERS_SECONDS`.

    A killed reader never confirms this.
    """
    deadline = time.monotonic() + READERS_SECONDS
    for publisher in publishers:
        publisher.wait_for_all_acked(
            Duration(seconds=max(0.0, deadline - time.monotonic()))
        )


def say_on_rosout(node: Node, error: errors.SparseCoordError) -> None:
    """Publish on /rosout the error that ends a node, for users who do not see its terminal.

    The text of an unexpected exception is its traceback. `get_logger().fatal()` would print a
    second line on the terminal, and nothing tells when the readers have what it publishes.
    """
    topic = ros_topics.ROSOUT
    publisher = node.create_publisher(topic.type, topic.name, ros_topics.LATCHED_QOS)
    message = topic.type(
        level=LoggingSeverity.FATAL, name=node.get_logger().name, msg=str(error)
    )
    message.stamp = node.get_clock().now().to_msg()
    if isinstance(error, errors.FaultError) and error.__cause__ is not None:
        message.msg = "".join(traceback.format_exception(error.__cause__))
    deadline = time.monotonic() + MATCH_SECONDS
    readers = node.count_subscribers(publisher.topic_name)
    while publisher.get_subscription_count() < readers and time.monotonic() < deadline:
        time.sleep(POLL_SECONDS)
    publisher.publish(message)
    wait_for_readers([publisher])


@contextmanager
def ending(
    nodes: Sequence[ParameterNode], save: Callable[[], object]
) -> Iterator[None]:
    """Save the nodes' state at any end, report it on /rosout, and destroy the nodes."""
    try:
        yield
    except errors.NameTakenError:
        raise  # another team or robot is there: nothing has begun, nothing is saved
    except Exception as error:
        failure = errors.failure_of(error)
        with suppress(Exception):  # report the first error
            save()
        failed = [node for node in nodes if node.failure is not None] or nodes
        for node in failed[:1]:
            with suppress(Exception):
                say_on_rosout(node, failure)
        raise failure from failure.__cause__
    finally:
        for node in nodes:
            with limited_shutdown():
                node.destroy_node()


def exit_code_of(run: Callable[[Stop], None]) -> int:
    """Run a function and return an exit code; print an error in one line.

    Args:
        run: the function; it handles the signals that end it.

    Returns:
        0 at its end, 2 after bad input, 1 after an unexpected exception, 130 after an
        impatient second Ctrl-C.
    """
    with signals() as stop:
        try:
            run(stop)
        except Exception as error:
            failure = errors.failure_of(error)
            print(f"error: {failure}", file=sys.stderr, flush=True)
            return failure.exit_code
        except KeyboardInterrupt:
            return errors.EXIT_INTERRUPTED
    return 0


def run_node(
    make: Callable[[Context], ParameterNode],
    args: Sequence[str] | None = None,
    executor: Callable[[Context], Executor] = make_executor,
) -> int:
    """Run one node as a process: until it is `done`, or one of `STOPPING` comes.

    The node's `finish(interrupted)` is called at any end, while ROS still works.

    Args:
        make: makes the node.
        args: the command line; None: that of this process.
        executor: makes its executor.

    Returns:
        The exit code: 0 after the run and after a signal; see `exit_code_of`.
    """

    def run(stop: Stop) -> None:
        with ros_context(sys.argv if args is None else args) as context:
            node = make(context)

            def ended() -> bool:
                return node.done or (bool(stop) and node.may_stop())

            with ending([node], lambda: node.finish(interrupted=True)):
                spin_nodes([node], context, ended, executor)
                node.finish(interrupted=not node.done)

    return exit_code_of(run)
