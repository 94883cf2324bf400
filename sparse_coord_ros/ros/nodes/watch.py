# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node `watch`: reads a team's messages, and shows them on a page in the browser.

The team never waits for it. It subscribes to the topics of a team in other processes. Inside a
team's process it reads world and robots directly: receiving every message would slow the team.
"""

import functools
import math
import time
from collections import defaultdict
from collections.abc import Sequence, Set
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import UInt8MultiArray
from std_srvs.srv import SetBool, Trigger

from sparse_coord_ros.core.game.interactions import (
    interactions_of,
    miscoordinates,
)
from sparse_coord_ros.core.game.world import FIRST_STEP, Action, Reward, StepOutcome
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.history import HistoryRecorder
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.core.runs.saved_tables import tables_of, unpack_saved
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.lockstep.robot_side import RobotSide
from sparse_coord_ros.protocol.wire import WORLD, PerceptEnd, SelfReport, services
from sparse_coord_ros.protocol.wire.published_tables import read_tables
from sparse_coord_ros.protocol.wire.status import RunStatus
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.follower import Follower
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS, NodePlace, ParameterNode
from sparse_coord_ros.ros.nodes.ros_messages import messages_of, read_run
from sparse_coord_ros.ros.nodes.spin import run_node
from sparse_coord_ros.show.page.controls import (
    NEXT,
    PAUSE,
    RATE,
    RESET,
    STEP,
    Control,
    Controlled,
)
from sparse_coord_ros.show.page.live_source import LiveView

if TYPE_CHECKING:
    from sparse_coord_ros.ros.nodes.robot import RobotNode
    from sparse_coord_ros.ros.nodes.world_simulator import WorldSimulator
    from sparse_coord_ros.show.page.message_board import MessageBoard
    from sparse_coord_ros.show.page.server import Server

PAGE_SECONDS = 1 / 20
"""Between two updates of the page."""

FAST_RATE = 1 / PAGE_SECONDS
FAST_SECONDS = 0.1
"""Making a frame in a team's own process takes the team's time. A team that is to be faster than
so many time steps a second is shown once in so many seconds; a slower one at each time step."""

GONE_SECONDS = 4.0
"""After so long without a status the world counts as gone; it publishes one every second."""

STOPPED_NOTICE = "the run was stopped before its end; the page waits for the next team"

LATE_TICKS = 10
"""How much later than the next time step's an action, a reward or a state may come. Counted in
ticks of the node: a process that was stopped has the messages in its queue."""

CONTROLS = (PAUSE, STEP, RATE, RESET)


class Controls(Controlled):
    """Requests of a page: calls of the world's services.

    Args:
        node: makes the calls.

    Attributes:
        view: shows the outcome; None: no run is shown.
        rate: the world's rate; None: it is not known.
    """

    def __init__(self, node: Node) -> None:
        super().__init__()
        self.view: LiveView | None = None
        self.rate: float | None = None
        self._clients = {
            PAUSE: node.create_client(SetBool, services.PAUSE.of(WORLD)),
            RESET: node.create_client(Trigger, services.RESET.of(WORLD)),
            STEP: node.create_client(Trigger, services.STEP.of(WORLD)),
            RATE: node.create_client(SetParameters, f"{WORLD}/set_parameters"),
        }

    def call(self) -> None:
        """Make the due calls."""
        for control in self.wishes():
            self._do(control)

    def _do(self, control: Control) -> None:
        client = self._clients.get(control.name)
        if client is None or self.view is None:
            return
        if not client.service_is_ready():
            self.view.notice(
                f"service {client.srv_name} is missing: the world is gone or still starting"
            )
            return
        kind: Any = client.srv_type
        request = kind.Request()
        if control.name == PAUSE:
            request.data = control.value
        elif control.name == RATE:
            request.parameters = [
                Parameter("rate", value=float(control.value)).to_parameter_msg()
            ]
        client.call_async(request).add_done_callback(
            functools.partial(self._on_answer, control)
        )

    def _on_answer(self, control: Control, future: Any) -> None:
        if self.view is None or future.cancelled() or future.exception() is not None:
            return
        response = future.result()
        if control.name == RATE:
            result = response.results[0]
            success = result.successful
            text = result.reason
            if success:
                self.rate = control.value
        else:
            success = response.success
            text = response.message
        self.view.notice("" if success else f"{control.name}: {text}")


class InsideWatch(ParameterNode):
    """Shows a team in this process.

    Args:
        board: the page's board.
        world, robots: the team's nodes.
        place: where the node is made, and with what: see `NodePlace`.
    """

    def __init__(
        self,
        board: "MessageBoard",
        world: "WorldSimulator",
        robots: "Sequence[RobotNode]",
        **place: Unpack[NodePlace],
    ) -> None:
        super().__init__("watch", PARAMETERS["watch"], **place)
        self._board = board
        self._world = world
        self._robots = robots
        self._controls = Controls(self)
        title = world.values["out"]
        controls = (*CONTROLS, NEXT)
        self._view = LiveView(
            world.run, board, source="live", title=title, controls=controls
        )
        self._controls.view = self._view
        world.lockstep.watcher = self._on_transition
        board.source = self._controls
        self._shown = -math.inf
        self.create_timer(PAGE_SECONDS, self._tick)

    def _on_transition(self, seen: TeamTransition) -> None:
        """Receive each transition from the world's side of the lock step."""
        ends: list[PerceptEnd | None] = []
        if any(
            action is not None and action.asked and not action.perceived
            for action in seen.actions
        ):
            reports = [
                None if side is None else side.self_report_of(seen.step)
                for side in self._sides()
            ]
            ends = [
                None if report is None else PerceptEnd.from_number(report.percept)
                for report in reports
            ]
        self._view.take(seen._replace(ends=ends))

    def _sides(self) -> list[RobotSide | None]:
        return [
            None if robot.presence is None else robot.lockstep for robot in self._robots
        ]

    def _tick(self) -> None:
        self._controls.call()
        if self._frame_due():
            self._show(self._world.doing)
        if self._view.slow_due():
            self._show_learned()
        self.done = self._world.done

    def _frame_due(self) -> bool:
        """Return whether it is time for a frame; if so, the next one is counted from now."""
        now = time.monotonic()
        rate = self._world.values["rate"]
        is_fast = not 0 < rate <= FAST_RATE
        if is_fast and now - self._shown < FAST_SECONDS:
            return False
        self._shown = now
        return True

    def _show(self, state: str) -> None:
        world = self._world.lockstep.world
        self._view.state = state
        made = world.transitions
        rate = self._world.values["rate"]
        still = world.step, list(world.cells)
        self._view.show(transitions=made, episode=world.episode, rate=rate, still=still)

    def _show_learned(self) -> None:
        sides = enumerate(self._sides())
        tables = {k: (side.handled, side.agent.tables) for k, side in sides if side}
        asked = np.array(self._view.asked)
        for k, side in enumerate(self._sides()):
            if side is not None:  # in a resumed run it includes earlier counts
                asked[k] = np.maximum(asked[k], side.agent.asked_in)
        self._view.show_learned(
            self._world.lockstep.history.so_far, tables, asked=asked
        )

    def finish(self, *, interrupted: bool) -> None:
        """Show the end."""
        self._world.lockstep.watcher = None
        self._show(wire.RunState.STOPPED if interrupted else wire.RunState.FINISHED)
        self._show_learned()
        self._board.source = None


class WatchNode(Follower):
    """Shows the present team, and each next one after it.

    Args:
        server: the page's server; None: one of its own.
        place: where the node is made, and with what: see `NodePlace`.

    Attributes:
        server: the page's server.
        controls: handles the page's requests.
        team: the team's messages; None before a run has begun.

    Raises:
        SparseCoordError: a bad parameter, a taken port.
    """

    tick_seconds = PAGE_SECONDS
    world_timeout = 0.0
    team: "HeardTeam"

    def __init__(
        self, *, server: "Server | None" = None, **place: Unpack[NodePlace]
    ) -> None:
        self._shared = server
        super().__init__("watch", PARAMETERS["watch"], **place)
        self.controls = Controls(self)
        self._transitions = 0
        self.server.board.source = self.controls

    def set_up(self) -> None:
        """Start the page's server, unless there is one."""
        from sparse_coord_ros.show.page.message_board import MessageBoard
        from sparse_coord_ros.show.page.server import Server

        if self._shared is not None:
            self.server = self._shared
            return
        self.server = Server(
            MessageBoard(), host=self.values["host"], port=self.values["port"]
        )
        self.at_end.callback(self.server.close)
        if self.server.warning:
            self.get_logger().warning(self.server.warning)
        self.get_logger().info(f"the page is at {self.server.address}")

    def wait(self) -> None:
        """Report that no team has appeared yet."""
        self.controls.call()
        board = self.server.board
        if board.get("notice") is None:
            where = self.resolve_topic_name(ros_topics.RUN.name)
            board.put(
                "notice",
                text=f"waiting for a team: no world simulator is on {where} yet; "
                "start one: sparse_coord run env1",
            )

    def begin(self, run: RunConfig) -> None:
        """Show the run that is announced."""
        self._transitions = 0
        title = f"team in {self.get_namespace()}"
        view = LiveView(
            run, self.server.board, source="live", title=title, controls=CONTROLS
        )
        self.controls.view = view
        self.team = HeardTeam(self, run, view)
        self.get_logger().info(
            f"{run.scenario.name}: {len(run.scenario.robots)} robots"
        )

    def another_run(self, data: bytes) -> RunConfig:
        """Show another run in place of the current one."""
        run = read_run(data)
        self.team.leave()
        self.presence = None
        return run

    def world_said(self, status: RunStatus) -> None:
        """Show the world's state, and compare the received messages with it."""
        self._transitions = status.transitions
        view = self.team.view
        if view.state != status.state:
            stopped = status.state == wire.RunState.STOPPED
            view.notice(STOPPED_NOTICE if stopped else "")
        view.state = status.state
        self.team.compare(status)

    def go_on(self, now: float) -> None:
        """Show new transitions."""
        self.controls.call()
        team = self.team
        team.tick()
        made = max(self._transitions, team.seen) if team.whole else self._transitions
        team.view.show(transitions=made, episode=team.episode, rate=self.controls.rate)
        if team.view.slow_due():
            team.view.show_learned(team.history.so_far, team.tables)

    def look_for_the_world(self, now: float) -> None:
        """Report that the world is gone; the page waits for the next team."""
        assert self.presence is not None
        view = self.team.view
        over = view.state in (*wire.OVER, "gone")
        silent = self.presence.silent(now) > GONE_SECONDS
        if silent and not over and not self.count_publishers(ros_topics.STATUS.name):
            view.state = "gone"
            view.notice("the world is gone; the page waits for the next team")

    def all_done(self, now: float) -> bool:
        """Return False: another team may always come."""
        return False

    def may_stop(self) -> bool:
        """Stop at once: the node has no state to save."""
        return True


@dataclass
class _Heard:
    """Messages received of one time step, by robot.

    Attributes:
        cells: the local states.
        actions: the actions, with how their percepts ended.
        rewards: the rewards.
        since: the tick of the node at which the first local state came.
    """

    cells: dict[int, int] = field(default_factory=dict)
    actions: dict[int, tuple[Action, PerceptEnd | None]] = field(default_factory=dict)
    rewards: dict[int, Reward] = field(default_factory=dict)
    since: int = 0


class HeardTeam:
    """The messages of one run's team, by topic.

    Args:
        node: makes the subscriptions.
        run: the team's run.
        view: shows it.

    Attributes:
        view: as above.
        history: the episodes that were heard.
        seen: transitions heard; episode: number of the newest one.
        without: (robot, step) pairs without the robot's action although it had not arrived.
        whole: whether, as far as known, no message was missed since the run's first time step.
        tables: the newest announced tables of each robot, with their time step.
        pending: the messages that are not processed yet, by time step.
    """

    def __init__(self, node: ParameterNode, run: RunConfig, view: LiveView) -> None:
        self.view = view
        self._node = node
        self._run = run
        self._goals = [robot.goal for robot in run.scenario.robots]
        self._interactions = interactions_of(run.scenario)
        self.history = HistoryRecorder(run.scenario)
        self.seen = self.episode = self.without = self._ticks = 0
        self.whole = True
        self.tables: dict[int, tuple[int, Tables]] = {}
        view.known = view.newest = self.tables
        self.pending: defaultdict[int, _Heard] = defaultdict(_Heard)
        self._newest: int | None = None
        self._last_made: int | None = None
        self._status: RunStatus | None = None
        messages = messages_of(run)
        steps = (
            (ros_topics.LOCAL_STATE, messages.unpack_state, self._on_state),
            (ros_topics.ACTION, messages.unpack_action, self._on_action),
            (ros_topics.REWARD, messages.unpack_reward, self._on_reward),
        )
        self._subscriptions = []
        for k, robot in enumerate(run.scenario.robots):
            for topic, unpack, then in steps:
                heard = node.subscriber.listen_packed(
                    topic, unpack, functools.partial(then, k), robot.name
                )
                self._subscriptions.append(heard)
            heard = node.subscriber.listen(
                ros_topics.TABLES,
                functools.partial(self._on_tables, k),
                robot.name,
                read=functools.partial(self._read_tables, k),
            )
            self._subscriptions.append(heard)

    def leave(self) -> None:
        """Destroy the subscriptions."""
        for subscription in self._subscriptions:
            self._node.subscriber.leave(subscription)

    def _on_action(self, k: int, step: int, action: Action, report: SelfReport) -> None:
        self.pending[step].actions[k] = action, PerceptEnd.from_number(report.percept)
        self.catch_up()

    def _on_reward(self, k: int, step: int, reward: Reward) -> None:
        self.pending[step].rewards[k] = reward
        self.catch_up()

    def _on_state(self, k: int, step: int, cell: int) -> None:
        if not self.pending[step].cells:
            if self._newest is None and step != FIRST_STEP:
                self._lack(
                    f"heard from time step {step} on: the curves lack earlier episodes"
                )
            elif self._newest is not None and step <= self._newest:
                self._forget(self._newest)
                self._lack(
                    "the run went back to a checkpoint: the curves include episodes that were "
                    "taken back"
                )
            self._newest = step
            self.pending[step].since = self._ticks
        self.pending[step].cells.setdefault(k, cell)
        self.catch_up()

    def compare(self, status: RunStatus) -> None:
        """Compare the received messages with the world's counts, as soon as possible."""
        self._status = status
        self.catch_up()

    def tick(self) -> None:
        """Process transitions whose waiting time is over; called at each tick of the node."""
        self._ticks += 1
        self.catch_up()

    def catch_up(self) -> None:
        """Process every complete transition; wait a moment for late messages.

        A robot's states come in their order, but its action or reward may come after the next
        state: they have other topics.
        """
        while known := sorted(
            step for step, heard in self.pending.items() if heard.cells
        ):
            self._check(known[0])
            if len(known) == 1 or not self._settle(*known[:2]):
                return
            self._forget(known[0])

    def _settle(self, step: int, after: int) -> bool:
        """Process a time step if no message of it is awaited; return whether it was processed.

        `after` is the next received time step; a gap between them means that an episode ended.
        """
        here = self.pending[step]
        then = self.pending[after]
        late = self._ticks - then.since > LATE_TICKS
        if after != step + 1:
            return late or not here.actions
        known = len(here.cells) == len(then.cells) == len(self._goals)
        acting = {k for k, cell in here.cells.items() if cell != self._goals[k]}
        acted = here.actions.keys() & here.rewards.keys()
        if not late and not (known and acting <= acted):
            return False
        if known and acted:
            self._settle_transition(step, here, then, acted)
            self.without += len(acting - acted)
        else:
            self._lack_of(step)
            self._begin_where_due(step)
        return True

    def _check(self, step: int) -> None:
        """Compare with the world's counts, if they are for the first unprocessed time step."""
        status = self._status
        if status is None or status.step != step:
            return
        self._status = None
        if (self.seen, self.without) != (status.transitions, status.left_out):
            self._lack_of(step)

    def _lack_of(self, step: int) -> None:
        self._lack(
            f"messages were missed up to time step {step}: the curves lack these episodes"
        )

    def _lack(self, text: str) -> None:
        """Show, as long as the run is shown, that the curves differ from the run."""
        if self.whole:
            self.whole = False
            self.view.lack(text)

    def _forget(self, until: int) -> None:
        """Drop all messages of time steps up to one."""
        for old in [step for step in self.pending if step <= until]:
            del self.pending[old]

    def _begin_where_due(self, step: int) -> None:
        """Begin an episode if a time step does not continue the one before."""
        if self._last_made is not None and step != self._last_made + 1:
            self.episode += 1
        self._last_made = step

    def _settle_transition(
        self, step: int, here: _Heard, then: _Heard, acted: Set[int]
    ) -> None:
        robots = range(len(self._goals))
        acts = [here.actions[k] if k in acted else (None, None) for k in robots]
        rewards = [here.rewards.get(k) for k in robots]
        actions, ends = zip(*acts, strict=True)
        after = tuple(then.cells[k] for k in robots)
        cells = tuple(here.cells[k] for k in robots)
        met = miscoordinates(self._interactions, cells, after)
        arrived = tuple(k for k in sorted(acted) if after[k] == self._goals[k])
        self._begin_where_due(step)
        self.history.add(
            self.episode, step, actions, StepOutcome((), met, arrived, False)
        )
        self.seen += 1
        self.view.take(TeamTransition(step, cells, actions, after, met, rewards, ends))

    def _read_tables(self, k: int, message: UInt8MultiArray) -> tuple[int, Tables]:
        """Return a robot's tables in a message, and their time step."""
        published = read_tables(message)
        [saved] = unpack_saved(published.packed, [k + 1], where=ros_topics.TABLES.name)
        run = self._run
        tables = tables_of(run.scenario, run.known_rule, k, saved.memory)
        return published.step, tables

    def _on_tables(self, k: int, dated: tuple[int, Tables]) -> None:
        if k not in self.tables or dated[0] >= self.tables[k][0]:
            self.tables[k] = dated


def main() -> int:
    """Run the node `watch`."""
    return run_node(lambda context: WatchNode(context=context))
