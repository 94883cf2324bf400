# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Judges whether a robot node of one's own keeps the contract of docs/interface.md.

python -m tools.conformance [--robot NAME] [--scenario NAME] [--namespace NAMESPACE] [-- COMMAND]

COMMAND starts the robot, as in `-- python my_robot.py --ros-args -r __node:=robot_1`; without one
it is a node that runs already. The world and all peers around it are played by a script, which
also loses a reward, says a state again, speaks for another run, and orders the robot back. One
line is printed for each obligation; the exit code is 0 if none is broken, else 1.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import time
import uuid
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

from nav_msgs.srv import GetPlan
from rclpy.executors import Executor
from std_msgs.msg import String

from sparse_coord_ros.game.actions import PRIMITIVES
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.game.world import Action, Reward, World
from sparse_coord_ros.learn.run_config import make_run
from sparse_coord_ros.lockstep.rollback import WorldRollback
from sparse_coord_ros.lockstep.waiting import REPEAT_SECONDS, Silence
from sparse_coord_ros.lockstep.world_side import WorldSide, WorldState
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.messages import robot_number, status
from sparse_coord_ros.nodes.parameters import PARAMETERS, ParameterNode
from sparse_coord_ros.nodes.spin import exit_code_of, make_executor, ros_context, signals
from sparse_coord_ros.nodes.world_topics import WorldTopics
from sparse_coord_ros.wire import WORLD, Account, PerceptEnd, RunState
from sparse_coord_ros.wire.services import ACTIVE_PERCEPTION
from sparse_coord_ros.wire.status import Order, Progress, Said, read_progress

SETTINGS = {"steps": 100, "max_steps": 8, "starts": "fixed", "epsilon": "constant:1"}
SETTINGS |= {"perception": "always", "link": "up"}
TIMING = {"step_timeout": 2.0, "percept_timeout": 0.5, "checkpoint": 10}
START_SECONDS, END_SECONDS, QUIET_SECONDS = 20.0, 10.0, 0.3

BEGIN, STEP, ASKING = "when-a-world-begins", "a-time-step", "questions"
BACK, END = "going-back", "the-end-of-a-run"
"""Where obligations stand in docs/interface.md."""

OBLIGATIONS = {
    "begins": (BEGIN, "subscribes to its local_state and reward and publishes its action"),
    "progress": (BEGIN, "says its progress when it listens"),
    "acts": (STEP, "answers each state with an action of its time step, within step_timeout"),
    "action": (STEP, "its actions can be read, and say nothing that cannot be"),
    "twice": (STEP, "answers a state once, as often as the state is said"),
    "rests": (STEP, "says nothing at its goal, in an episode's last state, or unasked"),
    "repeats": (STEP, "answers a state that is said again with the same action"),
    "older": (STEP, "does not answer a state that is over"),
    "reward": (STEP, "acts, and says that it has not learned, where a reward is lost"),
    "left out": (STEP, "answers the newest state where the world went on without it"),
    "answers": (ASKING, "tells who asks its time step, and its pose if it is theirs"),
    "asks": (ASKING, "asks only at a time step at which it says COORDINATE"),
    "asks again": (ASKING, "asks a peer again that is not there yet"),
    "percept": (
        ASKING,
        "publishes a percept of whom it perceived with each COORDINATE, and only then",
    ),
    "stranger": (END, "takes no notice of another run"),
    "roll call": (BACK, "says where it is when it is asked to"),
    "goes back": (BACK, "goes back to a checkpoint, if it has named any, and acts from there"),
    "ends": (END, "says nothing more after the run, and leaves nothing behind"),
}
"""What a robot is obliged to, and where that stands."""


class EnoughError(Exception):
    """The robot does not act: nothing more can be judged."""


class Stage(ParameterNode):
    """The world and the peers of a robot under test, which do what a script says.

    Args:
        robot: the robot's name; empty: the scenario's first.
        scenario: the scenario's name or file.
        executor: runs this node; a robot of the same process too.
        ended: returns what the robot's process has left behind: "", once it is gone.
        place: where the node is made.

    Attributes:
        broken: what was seen, by the obligation that it breaks.
        seen: the obligations that were put to the test.
    """

    def __init__(
        self,
        robot: str,
        scenario: str,
        executor: Executor,
        ended: Callable[[], str] = str,
        **place: Any,
    ) -> None:
        super().__init__(WORLD, PARAMETERS[WORLD], values={}, **place)
        game = load_scenario(scenario).with_settings(SETTINGS)
        self.run = replace(make_run(game, TIMING), id=uuid.uuid4().hex)
        self.names = [one.name for one in game.robots]
        self.name = robot or self.names[0]
        self.k = robot_number(self.run, self.name, "give --robot one of them")
        self.world, self._executor, self._ended = World(game, 0), executor, ended
        silence = Silence(time.monotonic())
        self.topics = WorldTopics(self, self.run, self.world, silence, self.checkpoint)
        self.topics.hear_actions(lambda robot, said: None)
        self.side = WorldSide(self.run, self, self.world)
        self.back = WorldRollback(self.side, self, len(self.names))  # type: ignore[arg-type]
        self.convert, self.state_said = self.topics.convert, RunState.WAITING
        self.broken: dict[str, str] = {}
        self.seen: set[str] = set()
        self.progress: Progress | None = None
        self._kept: dict[int, WorldState | None] = {0: None}
        self._lost, self._said_status = -1, 0.0
        self._moves, self._began = random.Random(1), 0
        self._forget()
        listen = self.intake.listen
        listen(interface.ACTION, self._on_action, self.name, unpack=self._read_action)
        listen(interface.PERCEPT, self._on_percept, self.name)
        listen(interface.PROGRESS, self._on_progress, self.name, read=read_progress)
        self._client = self.create_client(GetPlan, ACTIVE_PERCEPTION.of(self.name))
        for number, name in enumerate(self.names):
            if number != self.k:
                answer = partial(self._on_question, number)
                self.create_service(GetPlan, ACTIVE_PERCEPTION.of(name), answer)

    # What is said: the port of the lock step, and the store of the world's checkpoints.

    def state(self, robot: int, step: int, cell: int) -> None:
        """Publish a state; note whether the robot is to answer it."""
        if robot == self.k:
            scenario = self.run.scenario
            self.times[step] += 1
            self.due[step] = (
                cell != scenario.robots[robot].goal
                and step - self._began < scenario.max_steps
                and not self.side.finished
            )
        self.topics.state(robot, step, cell)

    def reward(self, robot: int, step: int, reward: Reward) -> None:
        """Publish a reward, unless it is to be lost; each fourth has a fine, a reason to ask."""
        if robot == self.k and step % 4 == 0:
            fine = self.run.scenario.penalty
            reward = reward._replace(common=fine, total=reward.total + fine - reward.common)
        if (robot, step) != (self.k, self._lost):
            self.topics.reward(robot, step, reward)

    def episode(self, step: int) -> None:
        """An episode begins."""
        self._began = step
        self.topics.episode(step)

    def checkpoint(self, step: int) -> None:
        """Keep where the world is."""
        self._kept[step] = self.side.snapshot(step)

    def steps(self) -> list[int]:
        """Return the steps of the world's checkpoints."""
        return list(self._kept)

    def load(self, step: int) -> WorldState | None:
        """Return a checkpoint."""
        return self._kept[step]

    def counted(self) -> dict[str, int]:
        """Return what earlier processes counted: nothing."""
        return {}

    # What is heard.

    def _forget(self) -> None:
        """Begin the notes anew: of states said and due, of what the robot did."""
        self.times: Counter[int] = Counter()
        self.due: dict[int, bool] = {}
        self.actions: list[tuple[int, Action, Account]] = []
        self.questions: list[int] = []
        self.percepts: dict[int, int] = {}

    def _read_action(self, data: bytes) -> tuple[int, Action, Account]:
        try:
            said = self.convert.unpack_account(data)
        except Exception as error:
            self.expect("action", False, f"an action {error}")
            raise
        return said

    def _on_action(self, said: tuple[int, Action, Account]) -> None:
        self.actions.append(said)
        step, action, account = said
        questions = self.questions.count(step)
        answered = questions > 1 and step % 3 != 0
        self.expect(
            "action",
            action.perceived == (action.asked and answered)
            and (account.percept != PerceptEnd.DID_NOT_ASK) == action.asked,
            f"step {step}: coordinate={action.asked:d} perceived={action.perceived:d} "
            f"percept={account.percept} after {questions} questions",
        )
        if questions:
            self.expect("asks again", questions > 1, f"step {step}: one question, then an action")

    def _on_percept(self, message: Any) -> None:
        stamp = message.header.stamp
        self.percepts[self.convert.step(stamp.sec, stamp.nanosec)] = len(message.poses)

    def _on_progress(self, said: Progress) -> None:
        self.progress = said
        self.back.heard(self.k, said)

    def _on_question(self, peer: int, request: Any, response: Any) -> Any:
        """Answer: at first not there yet, then its cell; at each third step a refusal."""
        stamp = request.start.header.stamp
        step = self.convert.step(stamp.sec, stamp.nanosec)
        self.questions.append(step)
        there = self.questions.count(step) > 1
        cells = (self.world.cells[peer],) if there and step % 3 else ()
        response.plan = self.convert.path(step if there else step - 1, cells)
        return response

    # Judging.

    def expect(self, what: str, kept: bool, seen: str) -> None:
        """Put an obligation to the test; `seen` says what was seen if it is not kept."""
        self.seen.add(what)
        if not kept:
            self.broken.setdefault(what, seen)

    def wait(self, condition: Callable[[], object], seconds: float) -> bool:
        """Spin until a condition holds; return whether it does. The status is said meanwhile."""
        deadline = time.monotonic() + seconds
        while not condition() and time.monotonic() < deadline:
            if time.monotonic() - self._said_status > 1.0:
                self.say()
            self._executor.spin_once(timeout_sec=0.002)
            if self.failure is not None:
                raise self.failure
        return bool(condition())

    def say(self) -> None:
        """Say the status."""
        self._said_status = time.monotonic()
        self.topics.say(self.state_said, self.side, self.back.order)

    def quiet(self) -> None:
        """Wait for what should not come, and judge what came since the notes were begun."""
        self.wait(lambda: False, QUIET_SECONDS)
        acted = {step: action for step, action, _ in self.actions}
        asked = {step for step, action in acted.items() if action.asked}
        for step, count in Counter(step for step, *_ in self.actions).items():
            due = self.due.get(step, False)
            self.expect("rests", due, f"an action of step {step}, where none is due")
            self.expect(
                "twice", count <= max(1, self.times[step]), f"step {step}: {count} actions"
            )
        for step in {*self.questions}:  # left out, it may have asked and not acted
            kept = step in asked or (step in self.due and step not in acted)
            self.expect("asks", kept, f"a question at step {step} without COORDINATE")
        for step in asked.union(self.percepts):
            count = 1 + acted[step].perceived if step in asked else 0
            poses = self.percepts.get(step, 0)
            self.expect("percept", poses == count, f"step {step}: {poses} poses, not {count}")

    def answer(self, step: int) -> tuple[int, Action, Account] | None:
        """Return the robot's first action of a time step; None: it does not come in time.

        As the world does, say everything again meanwhile.
        """

        def found() -> Any:
            return next((said for said in self.actions if said[0] == step), None)

        deadline = time.monotonic() + self.run.step_timeout
        while not self.wait(found, REPEAT_SECONDS) and time.monotonic() < deadline:
            self.side.repeat()
        return found()

    # The script.

    def peers_act(self) -> None:
        """Let each peer move."""
        for peer in self.side.missing():
            if peer != self.k:
                action = Action(self._moves.randrange(PRIMITIVES), False, -1, False)
                self.side.action(peer, self.world.step, action)

    def turn(self, what: str = "acts") -> Account:
        """Make a time step; return what the robot said of itself at it.

        Raises:
            EnoughError: it did not act, which breaks an obligation.
        """
        step = self.world.step
        said = self.answer(step)
        self.expect(what, said is not None, f"no action of step {step}")
        if said is None:
            raise EnoughError
        self._ask()
        self.side.action(self.k, step, said[1])
        self.peers_act()
        self.side.advance()
        return said[2]

    def _ask(self) -> None:
        """Ask the robot, as a peer of this step, of the next or the last one, or as a person."""
        step = self.world.step
        asked = (step, step + 1, step - 1, 0)[step % 4]
        peer = (self.k + 1) % len(self.names)
        request = GetPlan.Request(start=self.convert.pose(asked, self.world.cells[peer]))
        request.goal.header.frame_id = self.names[peer] if asked else ""
        future = self._client.call_async(request)
        self.wait(future.done, self.run.step_timeout)
        said = future.result().plan if future.done() else None
        due = self.convert.path(step, (self.world.cells[self.k],) if asked in (step, 0) else ())
        self.expect("answers", said == due, f"at step {step}, asked of step {asked}: {said}")

    def turns(self, count: int) -> None:
        """Make time steps, then some more until an episode is under way."""
        while count > 0 or self.world.step - self._began not in (2, 3):
            self.turn()
            count -= 1

    def play(self) -> None:
        """Put all obligations to the test, one after the other, as far as the robot acts."""
        with suppress(EnoughError):
            self._begins()
            self.turns(20)
            self._said_again()
            self._lost_reward()
            self._left_out()
            self._stranger()
            self._arrives()
            self._ordered("roll call", together=False)
            self._goes_back()
            self._ends()

    def lacks(self) -> str:
        """Return what the robot lacks for the world to begin."""
        return next((one for one in self.topics.missing() if one.split()[0] == self.name), "")

    def _begins(self) -> None:
        self.topics.open(resumed=False)
        there = self.wait(lambda: not self.lacks(), START_SECONDS)
        lacks = f"after {START_SECONDS:g} s there is no node {self.lacks()}"
        self.expect("begins", there, f"{lacks}; a robot's node has the robot's name")
        if not there:
            raise EnoughError
        said = self.wait(lambda: self.progress is not None, self.run.step_timeout)
        self.expect("progress", said, "no progress")
        self.state_said = RunState.LEARNING
        self.side.start()

    def _said_again(self) -> None:
        step, cell = self.world.step, self.world.cells[self.k]
        first = self.answer(step)
        self.state(self.k, step, cell)

        def mine() -> list[tuple[int, Action, Account]]:
            return [said for said in self.actions if said[0] == step]

        again = self.wait(lambda: len(mine()) > 1, self.run.step_timeout)
        self.expect("repeats", again and mine()[1] == first, f"{mine()[1:] or 'nothing'}")
        self.turn()
        before = self.answer(self.world.step), len(self.actions)
        self.topics.state(self.k, step, cell)
        self.wait(lambda: False, QUIET_SECONDS)
        self.expect(
            "older", len(self.actions) == before[1], f"an answer to step {step}, said late"
        )
        self.turns(1)

    def _lost_reward(self) -> None:
        self._lost = self.world.step
        self.turn()
        learned = self.turn("reward").learned
        self.expect("reward", not learned, f"learned=1 after the lost reward of step {self._lost}")
        self.turns(1)

    def _left_out(self) -> None:
        self.turn()
        for _ in range(2):
            self.peers_act()
            self.side.expire()
            if self.side.complete:
                self.side.advance()
        self.turn("left out")
        self.turns(1)

    def _stranger(self) -> None:
        order, step = Order("of_another_run", 0, 1), self.world.step
        said = Said("another", RunState.FINISHED, step, self.run.scenario.steps, order=order)
        another = replace(self.run, id="another").to_yaml()
        self.announce(interface.RUN).publish(String(data=another))
        self.announce(interface.STATUS).publish(status("x", said.state, said.values()))
        self.wait(lambda: False, QUIET_SECONDS)
        for _ in range(2):
            self.turn("stranger")
        obeyed = self.progress is not None and self.progress.obeyed == order.name
        self.expect("stranger", not obeyed, "obeyed an order of another run")
        self.turns(1)

    def _arrives(self) -> None:
        step, goal = self.world.step, self.run.scenario.robots[self.k].goal
        self.answer(step)
        self.peers_act()
        self.world.cells[self.k], self.world.arrived[self.k] = goal, True
        paid = self.run.scenario.goal_reward
        self.reward(self.k, step, Reward(paid, 0.0, 0.0, paid))
        self.side.advance()
        self.quiet()
        self.side.new_episode()
        self.turns(1)

    def _ordered(self, what: str, *, together: bool) -> None:
        """Give an order and judge whether the robot obeys it and acts then."""
        self.quiet()
        self.back.go_back(together=together)
        self._forget()
        self.back.waiting &= {self.k}
        self.say()
        order = self.back.order

        def obeyed() -> bool:
            said = self.progress
            return said is not None and said.obeyed == order.name and not self.lacks()

        done = self.wait(obeyed, self.run.step_timeout)
        self.expect(what, done, f"no progress that has obeyed the order {tuple(order)}")
        self.back.go_on(anyway=True)
        self.say()
        self.turn(what)
        self.turns(2)

    def _goes_back(self) -> None:
        self.expect("goes back", True, "")
        if self.progress is not None and self.progress.checkpoints:
            self.back.said = [self.progress] * len(self.names)
            self._ordered("goes back", together=True)

    def _ends(self) -> None:
        while not self.side.finished:
            self.turn()
        self.state_said = RunState.FINISHED
        self.say()
        self.quiet()
        self.wait(lambda: not self._ended(), END_SECONDS)
        self.expect("ends", not self._ended(), self._ended())

    def report(self) -> int:
        """Print a line for each obligation, and return the exit code."""
        for what, (place, text) in OBLIGATIONS.items():
            word, more = "not seen" if what not in self.seen else "kept", ""
            if what in self.broken:
                word, more = "BROKEN", f": {self.broken[what]} (docs/interface.md#{place})"
            print(f"{word:8}  {what:10}  {text}{more}")
        return 1 if self.broken else 0


def left(child: subprocess.Popen[bytes]) -> str:
    """Return what is left of the robot's session, or how it ended; "": nothing, and well."""
    if child.poll() is None:
        return "its process runs on after the run"
    if child.returncode:
        return f"its exit code is {child.returncode}"
    with suppress(ProcessLookupError):
        os.killpg(child.pid, 0)
        return "it has left processes behind"
    return ""


def main(words: Sequence[str]) -> int:
    """Judge a robot."""
    own, command = list(words), []
    if "--" in own:
        at = own.index("--")
        own, command = own[:at], own[at + 1 :]
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--robot", default="", help="its name; the scenario's first robot")
    parser.add_argument("--scenario", default="env1")
    parser.add_argument("--namespace", default="")
    options = parser.parse_args(own)
    codes = []

    def judge() -> None:
        with signals() as stop, ros_context() as context, stop.at_once():
            place = {"context": context, "namespace": options.namespace}
            executor = make_executor("events", context)
            child = subprocess.Popen(command, start_new_session=True) if command else None
            ended = partial(left, child) if child else str
            try:
                stage = Stage(options.robot, options.scenario, executor, ended, **place)
                executor.add_node(stage)
                stage.play()
                codes.append(stage.report())
                stage.destroy_node()
            finally:
                executor.shutdown()
                if child:
                    with suppress(ProcessLookupError):
                        os.killpg(child.pid, signal.SIGKILL)
                    child.wait()

    return exit_code_of(judge) or codes[0]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
