# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A whole team in one process: world simulator, robots and recorder on one executor."""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.context import Context

from sparse_coord_ros.base.errors import BagError, NameTakenError
from sparse_coord_ros.core.runs.run_config import RunConfig, create_output
from sparse_coord_ros.log.bags.reader import BAG_DIRECTORY
from sparse_coord_ros.protocol.lockstep.node_checkpoints import check_robots
from sparse_coord_ros.protocol.wire import RECORDER, WORLD
from sparse_coord_ros.ros.nodes.direct_recording import DirectRecording
from sparse_coord_ros.ros.nodes.outputs import begin_with, gather, holds_run, run_of
from sparse_coord_ros.ros.nodes.parameters import (
    TEAM_PARAMETERS,
    ParameterNode,
    of_node,
    run_from_parameters,
    team_values,
)
from sparse_coord_ros.ros.nodes.recorder import Recorder
from sparse_coord_ros.ros.nodes.robot import RobotNode
from sparse_coord_ros.ros.nodes.spin import (
    Stop,
    ending,
    exit_code_of,
    ros_context,
    spin_nodes,
)
from sparse_coord_ros.ros.nodes.world_simulator import WorldSimulator

if TYPE_CHECKING:
    from sparse_coord_ros.show.page.message_board import MessageBoard


def team_run(values: dict[str, Any]) -> RunConfig:
    """Return the run of a team, completely checked before any file is written.

    Args:
        values: all of `TEAM_PARAMETERS`; `recorded` is set to the value of `record`.

    Raises:
        SparseCoordError: bad input.
    """
    if holds_run(values["out"]):
        run = run_of(values)
        check_robots(Path(values["out"]), run.scenario)
        values["record"] = values["recorded"] = run.recorded
        return run
    values["recorded"] = values["record"]
    run = run_from_parameters(values)
    if values["tables"]:
        begin_with(Path(values["tables"]), run, 0)
    return run


def run_team(
    values: Mapping[str, Any],
    *,
    context: Context,
    namespace: str = "",
    stop: Callable[[], bool] = lambda: False,
    page: "MessageBoard | None" = None,
) -> dict[str, Any]:
    """Run a team until its step budget is used up or `stop` returns True.

    Args:
        values: some of `TEAM_PARAMETERS` and of the scenario's settings; `out` is the output
            directory: it does not exist, or it holds the run, which goes on.
        context: the ROS context.
        namespace: the team's namespace.
        stop: called several times a second.
        page: the board of a page that shows the team; None: none.

    Returns:
        The summary, as in `summary.yaml`. `interrupted`: whether the run was stopped early.
        `recording_error`, if present: the error that ended the recording.

    Raises:
        SparseCoordError: bad input.
    """
    values = team_values(values)
    run = team_run(values)
    out = Path(values["out"] or f"{run.scenario.name}_{datetime.now():%Y%m%d_%H%M%S}")
    if not holds_run(values["out"]):
        create_output(out)
    direct = DirectRecording() if values["record"] else None
    shared: dict[str, Any] = {
        "context": context,
        "namespace": namespace,
        "direct": direct,
    }
    shared["shared_clients"] = {}
    shared["shared_states"] = {name: {} for name in run.scenario.names}
    nodes: list[ParameterNode] = []
    recorder = None
    with ending(nodes, lambda: gather(out, run.scenario, interrupted=True)):
        if values["record"]:
            recorders = of_node(RECORDER, values)
            recorder = Recorder(
                values={**recorders, "out": str(out / BAG_DIRECTORY)}, **shared
            )
            nodes.append(recorder)
        values["out"] = str(out)
        world = WorldSimulator(values=of_node(WORLD, values), **shared)
        nodes.append(world)
        robots_values = of_node("robot", values)
        for name in run.scenario.names:
            nodes.append(RobotNode(name=name, values=robots_values, **shared))
        if page is not None:
            from sparse_coord_ros.ros.nodes.watch import InsideWatch

            robots = [node for node in nodes if isinstance(node, RobotNode)]
            nodes.append(InsideWatch(page, world, robots, values={}, **shared))
        interrupted = _spin(nodes, context, stop)
        error = recorder.error if recorder is not None else None
        return gather(out, run.scenario, interrupted=interrupted, recording_error=error)


class _TeamEnd:
    """The end of a team's nodes, one kind after the other.

    The world ends first, then the robots when they have learned all its transitions, then the
    page, and the recorder.

    Args:
        nodes: the nodes.
        stop: whether the team is to stop before the run's end.

    Attributes:
        left: the nodes that have not ended, in the order of their ends.
        failures: the errors so far.
        stopped: the team was stopped before the run's end.
    """

    def __init__(
        self, nodes: Sequence[ParameterNode], stop: Callable[[], bool]
    ) -> None:
        self.left = sorted(nodes, key=lambda node: isinstance(node, Recorder))
        self.failures: list[Exception] = []
        self.stopped = False
        self._stop = stop

    def over(self) -> bool:
        """End the nodes that are done, or may stop; return whether all have ended."""
        self._end([node for node in self.left if node.done])
        if self.left and (self._stop() or self.failures):
            self.stopped = True
            kind = type(self.left[0])
            alike = [node for node in self.left if isinstance(node, kind)]
            if all(node.may_stop() for node in alike):
                self._end(alike)
        return not self.left

    def fail(self, error: Exception) -> None:
        """Note an error, and end the nodes that failed, or all nodes if the error is no node's."""
        self.failures.append(error)
        failed = [node for node in self.left if node.failure is not None]
        self._end(failed or self.left[:])

    def _end(self, nodes: Iterable[ParameterNode]) -> None:
        for node in nodes:
            self.left.remove(node)
            try:
                node.finish(interrupted=not node.done)
            except Exception as error:  # the other nodes still save their state
                self.failures.append(error)


def _spin(
    nodes: Sequence[ParameterNode],
    context: Context,
    stop: Callable[[], bool],
) -> bool:
    """Spin until every node has ended; return whether they were stopped before the run's end.

    Each node saves and reports; then the first error is raised. One executor has all nodes until
    the last has ended: a new executor would miss the messages that wait in the old one.
    """
    end = _TeamEnd(nodes, stop)
    while end.left:
        alive = [node for node in nodes if node.failure is None]
        try:
            spin_nodes(alive, context, end.over)
        except NameTakenError:
            raise
        except Exception as error:
            end.fail(error)
    if end.failures:
        raise end.failures[0]
    return end.stopped


def main() -> int:
    """Run the executable `team`.

    Returns:
        The exit code: 0 after the run and after a signal, 2 on bad input or a broken recording.
    """
    return exit_code_of(_run)


def _run(stop: Stop) -> None:
    with ros_context(sys.argv) as context:
        node = ParameterNode("team", TEAM_PARAMETERS, context=context)
        values = node.values
        namespace = node.get_namespace()
        node.destroy_node()
        summary = run_team(
            values, context=context, namespace=namespace, stop=lambda: bool(stop)
        )
    if "recording_error" in summary:
        raise BagError(summary["recording_error"])
