# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tests whether a user's robot node keeps the contract of docs/own_robot.md.

A script plays the world, and peers that stand still. It also loses a reward, repeats a state,
publishes messages of another run, and orders the robot back.
"""

import os
import signal
import subprocess
import time
import uuid
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

from nav_msgs.srv import GetPlan
from rclpy.executors import Executor
from std_msgs.msg import String

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action, Reward, World
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.lockstep.timeouts import REPEAT_SECONDS
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide, WorldState
from sparse_coord_ros.protocol.wire import WORLD, PerceptEnd, RunState, SelfReport
from sparse_coord_ros.protocol.wire.services import ACTIVE_PERCEPTION
from sparse_coord_ros.protocol.wire.status import (
    NO_ROLLBACK,
    Order,
    Progress,
    RunStatus,
    read_progress,
)
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.messages import robot_number, status
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS, ParameterNode
from sparse_coord_ros.ros.nodes.spin import Stop, make_executor, ros_context
from sparse_coord_ros.ros.nodes.world_topics import WorldTopics

SETTINGS = {"steps": 100, "max_steps": 8, "starts": "fixed", "epsilon": "constant:1"}
SETTINGS |= {"perception": "always"}
TIMING = {"step_timeout": 2.0, "percept_timeout": 0.5, "checkpoint": 10}
START_SECONDS = 20.0
END_SECONDS = 10.0
QUIET_SECONDS = 0.3
STATUS_SECONDS = 0.2


KEPT = "kept"
BROKEN = "BROKEN"
NOT_SEEN = "not seen"
"""The verdicts on an obligation; the last: the robot never came into a case of it."""


class ObligationResult(NamedTuple):
    """One obligation, and how the robot kept it.

    Attributes:
        name: of the obligation.
        text: the obligation.
        verdict: `KEPT`, `BROKEN` or `NOT_SEEN`.
        seen: the robot's behaviour if it broke the obligation, else empty.
        place: its heading in docs/own_robot.md.
    """

    name: str
    text: str
    verdict: str
    seen: str
    place: str

    def __str__(self) -> str:
        """Return one line."""
        more = f": {self.seen} (docs/own_robot.md#{self.place})" if self.seen else ""
        return f"{self.verdict:8}  {self.name:10}  {self.text}{more}"


class EnoughError(Exception):
    """The robot does not act: the test cannot continue."""


@dataclass
class Note:
    """The messages and actions at a time step.

    Attributes:
        states: how often the robot's state was published.
        due: whether the robot has to act on it.
        said: its actions.
        questions: number of its questions.
        poses: number of poses in its percept; 0: no percept.
    """

    states: int = 0
    due: bool = False
    said: list[tuple[int, Action, SelfReport]] = field(default_factory=list)
    questions: int = 0
    poses: int = 0


class ScriptedWorld(WorldTopics):
    """The world and the peers of a robot under test, which follow a script.

    Args:
        robot: the robot's name; empty: the scenario's first.
        scenario: the scenario's name or file.
        executor: runs the node of this world; a robot of the same process too.
        ended: returns an error while the robot's process is left; "" once it is gone.
        checkpoints: whether the robot must keep checkpoints.
        place: where the node is made.

    Attributes:
        node: the world's node.
        broken: observed violations, by obligation.
        seen: the obligations that were put to the test.
    """

    def __init__(
        self,
        robot: str,
        scenario: str,
        executor: Executor,
        ended: Callable = str,
        *,
        checkpoints: bool = False,
        **place: Any,
    ) -> None:
        game = load_scenario(scenario).with_settings(SETTINGS)
        self.run = replace(make_run(game, TIMING), id=uuid.uuid4().hex)
        self.names = game.names
        self.name = robot or self.names[0]
        self.k = robot_number(self.run, self.name, "give --robot one of them")
        self.node = ParameterNode(WORLD, PARAMETERS[WORLD], values={}, **place)
        self.world = World(game, 0)
        self._executor = executor
        self._ended = ended
        self._checkpoints = checkpoints
        super().__init__(self.node, self.run, self.world, self.keep)
        self.side = WorldSide(self.run, self, self.world)
        self.broken: dict[str, str] = {}
        self.seen: set[str] = set()
        self.notes: defaultdict[int, Note] = defaultdict(Note)
        self.progress = Progress("", 0, 0)
        self.kept: dict[int, WorldState | None] = {0: None}
        self.doing = RunState.WAITING
        self.order = Order()
        self._lost = -1
        self.node.create_timer(
            STATUS_SECONDS, lambda: self.say(self.doing, self.side, self.order)
        )
        listen = self.node.subscriber.listen
        action = ros_topics.ACTION
        read = self.convert.unpack_self_report
        self.actions = [
            listen(action, self._on_action, name, unpack=read) for name in self.names
        ]
        listen(ros_topics.PERCEPT, self._on_percept, self.name)
        tell = partial(setattr, self, "progress")
        listen(ros_topics.PROGRESS, tell, self.name, read=read_progress)
        self._client = self.node.create_client(GetPlan, ACTIVE_PERCEPTION.of(self.name))
        for number, name in enumerate(self.names):
            if number != self.k:
                answer = partial(self._on_question, number)
                self.node.create_service(GetPlan, ACTIVE_PERCEPTION.of(name), answer)

    # Messages sent, also by the lock step, and messages received.

    def state(self, robot: int, step: int, cell: int) -> None:
        """Publish a state; note whether the robot has to act on it."""
        if robot == self.k:
            game = self.run.scenario
            note = self.notes[step]
            home = cell == game.robots[robot].goal
            note.states += 1
            note.due = not (home or self._age >= game.max_steps or self.side.finished)
        super().state(robot, step, cell)

    def reward(self, robot: int, step: int, reward: Reward) -> None:
        """Publish a reward, unless it is to be lost; every fourth has a fine, a reason to ask."""
        if robot == self.k and step % 4 == 0:
            fine = self.run.scenario.penalty
            reward = reward._replace(
                common=fine, total=reward.total + fine - reward.common
            )
        if (robot, step) != (self.k, self._lost):
            super().reward(robot, step, reward)

    def keep(self, step: int) -> None:
        """Save the world's state at a time step."""
        self.kept[step] = self.side.snapshot(step)

    def _on_action(self, said: tuple[int, Action, SelfReport]) -> None:
        self.notes[said[0]].said.append(said)

    def _on_percept(self, message: Any) -> None:
        self.notes[self._step_of(message)].poses = len(message.poses)

    def _on_question(self, peer: int, request: Any, response: Any) -> Any:
        """Answer: first "not at this step yet", then the cell; at every third step a refusal."""
        step = self._step_of(request.start)
        self.notes[step].questions += 1
        there = self.notes[step].questions > 1
        cells = (self.world.cells[peer],) if there and step % 3 else ()
        response.plan = self.convert.path(step if there else step - 1, cells)
        return response

    def _step_of(self, message: Any) -> int:
        return self.convert.step(message.header.stamp.sec, message.header.stamp.nanosec)

    # Judging.

    def expect(self, what: str, kept: bool, seen: str) -> None:
        """Test an obligation; `seen` describes the violation if it is broken."""
        self.seen.add(what)
        if not kept:
            self.broken.setdefault(what, seen)

    def wait(self, condition: Callable[[], object], seconds: float) -> bool:
        """Spin until a condition holds; return whether it does."""
        deadline = time.monotonic() + seconds
        while not condition() and time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.002)
            if self.node.failure is not None:
                raise self.node.failure
        return bool(condition())

    def quiet(self) -> None:
        """Wait for unexpected messages, then judge the robot's behaviour at each time step."""
        self.wait(lambda: False, QUIET_SECONDS)
        for topic in self.node.subscriber.dropped:
            self.expect(
                "action",
                False,
                f"what it says on {topic} cannot be read, as said above",
            )
        for step, note in self.notes.items():
            self._judge(step, note)

    def _judge(self, step: int, note: Note) -> None:
        said = note.said
        questions = note.questions
        poses = note.poses
        asked = any(action.asked for _, action, _ in said)
        if said:
            _, action, report = said[0]
            answered = asked and questions > 1 and step % 3 != 0
            ended = (report.percept != PerceptEnd.DID_NOT_ASK) == asked
            told = f"coordinate={asked:d} perceived={action.perceived:d} percept={report.percept}"
            right = action.perceived == answered and ended
            self.expect(
                "action", right, f"step {step}: {told} after {questions} questions"
            )
            self.expect(
                "rests", note.due, f"an action of step {step}, where none is due"
            )
            once = len(said) <= max(1, note.states) and said.count(said[0]) == len(said)
            self.expect(
                "repeats",
                once,
                f"step {step}: {len(said)} actions, {note.states} states",
            )
        if questions:  # a robot that is left out may ask and not act
            left_out = bool(note.states and not said)
            self.expect(
                "asks", asked or left_out, f"a question at step {step}, no COORDINATE"
            )
            again = questions > 1 or left_out
            self.expect(
                "asks again", again, f"step {step}: one question, then an action"
            )
        if asked or poses:
            due = 1 + action.perceived if asked else 0
            self.expect(
                "percept", poses == due, f"step {step}: {poses} poses, not {due}"
            )

    def answer(self, step: int) -> tuple[int, Action, SelfReport] | None:
        """Return the robot's first action of a time step; None: it does not come in time.

        Meanwhile all messages are repeated, as the world does.
        """
        said = self.notes[step].said
        deadline = time.monotonic() + self.run.step_timeout
        while (
            not self.wait(lambda: said, REPEAT_SECONDS) and time.monotonic() < deadline
        ):
            self.side.repeat()
        return said[0] if said else None

    # The script.

    def play(self) -> None:
        """Put all obligations to the test, one after the other, as far as the robot acts."""
        with suppress(EnoughError):
            for what, (_, _, provoke) in OBLIGATIONS.items():
                if provoke is not None:
                    provoke(self, what)
                    while not (self.side.finished or self._age in (2, 3)):
                        self.turn()

    @property
    def _age(self) -> int:
        """The age of the episode in time steps."""
        return self.world.step - self.world.position().episode_start

    def turn(self, what: str = "acts") -> SelfReport:
        """Make a time step; return the robot's self-report.

        Raises:
            EnoughError: it did not act, which breaks an obligation.
        """
        step = self.world.step
        said = self.answer(step)
        self.expect(what, said is not None, f"no action of step {step}")
        if said is None:
            self.quiet()
            raise EnoughError
        self._ask()
        self.side.action(self.k, step, said[1])
        self.side.advance()
        return said[2]

    def _ask(self) -> None:
        """Ask the robot, as a peer of this step, of the next or the last one, or as a person."""
        step = self.world.step
        asked = (step, step + 1, step - 1, 0)[step % 4]
        peer = (self.k + 1) % len(self.names)
        request = GetPlan.Request(
            start=self.convert.pose(asked, self.world.cells[peer])
        )
        request.goal.header.frame_id = self.names[peer] if asked else ""
        future = self._client.call_async(request)
        self.wait(future.done, self.run.step_timeout)
        said = future.result().plan if future.done() else None
        due = self.convert.path(
            step, (self.world.cells[self.k],) if asked in (step, 0) else ()
        )
        self.expect(
            "answers", said == due, f"at step {step}, asked of step {asked}: {said}"
        )

    def goes_on(self, what: str) -> None:
        """Make time steps."""
        for _ in range(20):
            self.turn(what)

    def lacks(self) -> str:
        """Return the missing topic or service of the robot that the world waits for."""
        return next((one for one in self.missing() if one.split()[0] == self.name), "")

    def begins(self, what: str) -> None:
        """Wait for the robot as a world does, and begin."""
        self.open(resumed=False)
        there = self.wait(lambda: not self.lacks(), START_SECONDS)
        lacks = f"after {START_SECONDS:g} s there is no node {self.lacks()}"
        self.expect(what, there, f"{lacks}; a robot's node has the robot's name")
        if not there:
            raise EnoughError
        said = self.wait(lambda: self.progress.life, self.run.step_timeout)
        self.expect(what, said, "no progress")
        self.doing = RunState.LEARNING
        self.side.start()

    def says_again(self, what: str) -> None:
        """Repeat a state on which the robot has acted, then once more after its time step."""
        step = self.world.step
        cell = self.world.cells[self.k]
        self.answer(step)
        self.state(self.k, step, cell)
        again = self.wait(lambda: len(self.notes[step].said) > 1, self.run.step_timeout)
        self.expect(
            what, again, f"no action when the state of step {step} was said again"
        )
        self.turn()
        self.answer(self.world.step)
        super().state(self.k, step, cell)
        self.quiet()

    def goes_on_without(self, what: str) -> None:
        """Make two time steps without the robot."""
        self.side.advance()
        self.side.advance()
        self.turn(what)

    def loses_a_reward(self, what: str) -> None:
        """Lose a reward."""
        self._lost = self.world.step
        self.turn()
        learned = self.turn(what).learned
        self.expect(
            what, not learned, f"learned=1 after the lost reward of step {self._lost}"
        )

    def ends_episode(self, what: str) -> None:
        """Let the robot arrive while it chooses, publish nothing, and begin an episode."""
        step = self.world.step
        robot = self.run.scenario.robots[self.k]
        self.answer(step)
        self.world.cells[self.k] = robot.goal
        self.world.arrived[self.k] = True
        paid = self.run.scenario.goal_reward
        self.reward(self.k, step, Reward(paid, 0.0, 0.0, paid))
        self.side.advance()
        self.quiet()
        self.side.new_episode()

    def hears_another_run(self, what: str) -> None:
        """Publish run and status of another run, with an order and its end."""
        order = Order("of_another_run", NO_ROLLBACK, 1)
        values = RunStatus(
            "another", RunState.FINISHED, self.world.step, 100, order=order
        ).values()
        another = replace(self.run, id="another").to_yaml()
        publishers = (
            self.node.announce(ros_topics.RUN),
            self.node.announce(ros_topics.STATUS),
        )
        publishers[0].publish(String(data=another))
        publishers[1].publish(status("x", RunState.FINISHED, values))
        self.wait(lambda: False, QUIET_SECONDS)
        for publisher in publishers:  # robots wait until every world hears them
            self.node.destroy_publisher(publisher)
        self.expect(
            what, self.progress.obeyed != order.name, "obeyed an order of another run"
        )
        self.turn(what)

    def asks_for_progress(self, what: str) -> None:
        """Ask for the robot's progress, then begin an episode."""
        self._order(what, NO_ROLLBACK, self.side.snapshot())

    def orders_back(self, what: str) -> None:
        """Order the robot back to its newest checkpoint that the world has too."""
        named = self.progress.checkpoints
        if self._checkpoints:
            self.expect(
                what, any(named), "its _progress names no checkpoint; they are required"
            )
        if named:
            step = max(self.kept.keys() & {*named})
            self._order(what, step, self.kept[step])

    def _order(self, what: str, step: int, state: WorldState | None) -> None:
        """Give an order and judge whether the robot obeys it and acts then."""
        self.quiet()
        self.notes.clear()
        self.side.go_on_from(state)
        self.order = Order(uuid.uuid4().hex, step, self.world.step)
        obeyed = self.wait(
            lambda: self.progress.obeyed == self.order.name, self.run.step_timeout
        )
        done = obeyed and self.wait(lambda: not self.lacks(), self.run.step_timeout)
        self.expect(
            what, done, f"no progress that has obeyed the order {tuple(self.order)}"
        )
        if step == NO_ROLLBACK:
            self.side.begin_at(
                self.world.step + 1 + EPISODE_GAP, self.world.transitions
            )
        self.order = Order()
        self.side.start()
        self.turn(what)

    def ends(self, what: str) -> None:
        """Finish the run."""
        while not self.side.finished:
            self.turn()
        self.doing = RunState.FINISHED
        self.quiet()
        self.wait(lambda: not self._ended(), END_SECONDS)
        self.expect(what, not self._ended(), self._ended())

    def judged(self) -> Iterator[ObligationResult]:
        """Yield how each obligation was kept."""
        for name, (place, text, _) in OBLIGATIONS.items():
            broken = self.broken.get(name, "")
            kept = KEPT if name in self.seen else NOT_SEEN
            yield ObligationResult(
                name, text, BROKEN if broken else kept, broken, place
            )


BEGIN = "when-a-world-begins"
STEP = "a-time-step"
ASKING = "questions"
BACK = "going-back"
END = "the-end-of-a-run"
"""Where obligations stand in docs/own_robot.md."""

OBLIGATIONS: dict[str, tuple[str, str, Callable[[ScriptedWorld, str], None] | None]] = {
    "begins": (
        BEGIN,
        "hears its topics, publishes its own, and says its progress",
        ScriptedWorld.begins,
    ),
    "acts": (
        STEP,
        "answers each state with an action of its step, in time",
        ScriptedWorld.goes_on,
    ),
    "action": (STEP, "its actions are readable and possible", None),
    "repeats": (
        STEP,
        "repeats its action when a state is repeated in time",
        ScriptedWorld.says_again,
    ),
    "reward": (
        STEP,
        "acts without learning after a lost reward",
        ScriptedWorld.loses_a_reward,
    ),
    "left out": (
        STEP,
        "answers the newest state if left out before",
        ScriptedWorld.goes_on_without,
    ),
    "rests": (
        STEP,
        "is silent at its goal and in an episode's last state",
        ScriptedWorld.ends_episode,
    ),
    "answers": (
        ASKING,
        "answers with its step, and its pose if the asker is at that step",
        None,
    ),
    "asks": (ASKING, "asks only when its action is COORDINATE", None),
    "asks again": (ASKING, "asks again if the peer is at an earlier step", None),
    "percept": (ASKING, "publishes whom it perceived with each COORDINATE", None),
    "stranger": (
        END,
        "ignores messages of another run",
        ScriptedWorld.hears_another_run,
    ),
    "progress": (
        BACK,
        "reports its progress when the world asks",
        ScriptedWorld.asks_for_progress,
    ),
    "goes back": (
        BACK,
        "returns to a checkpoint that it reported",
        ScriptedWorld.orders_back,
    ),
    "ends": (
        END,
        "is silent after the run and leaves no process",
        ScriptedWorld.ends,
    ),
}
"""The obligations of a robot: each with its place in docs/interface.md, its text, and its test, in
this order (None: all other tests test it)."""


def left(child: subprocess.Popen[bytes]) -> str:
    """Return an error if the robot's session still runs or ended badly, else an empty text."""
    if child.poll() is None:
        return "its process is still running after the run"
    with suppress(ProcessLookupError):
        os.killpg(child.pid, 0)
        return "it has left processes behind"
    return f"its exit code is {child.returncode}" if child.returncode else ""


def judge(
    command: Sequence[str],
    stop: Stop,
    *,
    robot: str = "",
    scenario: str = "env1",
    namespace: str = "",
    checkpoints: bool = False,
) -> list[ObligationResult]:
    """Judge a robot, and return how it kept each obligation.

    Args:
        command: starts the robot, which is ended after the test; empty: it runs already.
        stop: ends the test at a signal.
        robot: its name; empty: that of the scenario's first robot.
        scenario: the scenario's name or file.
        namespace: of the robot.
        checkpoints: as of `ScriptedWorld`.

    Raises:
        SparseCoordError: the scenario has no such robot.
        OSError: the command cannot be started.
    """
    with ros_context() as context, stop.at_once():
        executor = make_executor("events", context)
        child = subprocess.Popen(command or ["true"], start_new_session=True)
        try:
            place = {"context": context, "namespace": namespace}
            ended = partial(left, child)
            scripted = ScriptedWorld(
                robot, scenario, executor, ended, checkpoints=checkpoints, **place
            )
            executor.add_node(scripted.node)
            scripted.play()
            scripted.node.destroy_node()
            return list(scripted.judged())
        finally:
            executor.shutdown()
            with suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
