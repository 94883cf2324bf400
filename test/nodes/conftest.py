# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the ROS tests: nodes on executors of the test's own, processes, clean-up."""

import functools
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace

import pytest
import ros_types
from live_teams import child_of, command, node_words
from patience import PATIENCE_SECONDS
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from teams import chosen, same_bits, tables_equal

from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import World
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.memory import taught
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.history import HistoryRecorder, load_history
from sparse_coord_ros.core.runs.saved_tables import load_team
from sparse_coord_ros.ros.nodes import parameters
from sparse_coord_ros.ros.nodes.recorder import Recorder
from sparse_coord_ros.ros.nodes.robot import RobotNode
from sparse_coord_ros.ros.nodes.spin import make_executor, ros_context
from sparse_coord_ros.ros.nodes.world_simulator import WorldSimulator

SAY_AGAIN_SECONDS = 0.1
"""Between two repeats of an observer's message."""


PATIENT = {"step_timeout": PATIENCE_SECONDS}
"""Of a run."""


class Bench:
    """Nodes of a team in one context and observers in another, spun in the test's own thread."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack.enter_context(ExitStack())
        self._places: dict[str, tuple] = {}
        self._nodes: dict[Node, object] = {}
        self._finished: set[Node] = set()

    def place(self, name: str = "team", arguments: list[str] | None = None) -> tuple:
        """Return (context, executor) of that name; with a command line's arguments where given."""
        if name not in self._places:
            context = self._stack.enter_context(ros_context(arguments))
            executor = make_executor(context)
            self._stack.callback(executor.shutdown)
            self._places[name] = (context, executor)
        return self._places[name]

    def add(self, node: Node, place: str = "team") -> Node:
        """Let a node be spun, and destroyed at the test's end."""
        executor = self.place(place)[1]
        executor.add_node(node)
        self._nodes[node] = executor
        self._stack.callback(self.destroy, node)
        return node

    def destroy(self, node: Node) -> None:
        """Take a node away."""
        if node in self._nodes:
            self._nodes.pop(node).remove_node(node)
            node.destroy_node()

    def stop(self, node: Node) -> None:
        """End a node as its executable does after a signal."""
        self.spin_until(node.may_stop, f"{node.get_name()} may stop")
        node.finish(interrupted=not node.done)
        self.destroy(node)

    def close(self) -> None:
        """Destroy all nodes and their contexts: another team may have their names."""
        self._stack.close()
        self._places.clear()

    def world(self, *, namespace: str = "", **values) -> WorldSimulator:
        """Start a world simulator; env1 unless `values` say otherwise.

        A new run is patient: on a busy machine no question fails, and no robot is left out.
        """
        values = {"scenario": "env1", **PATIENT, **values}
        context = self.place()[0]
        return self.add(
            WorldSimulator(context=context, namespace=namespace, values=values)
        )

    def robot(
        self, name: str, *, namespace: str = "", place: str = "team", **values
    ) -> RobotNode:
        """Start a robot."""
        context = self.place(place)[0]
        robot = RobotNode(
            context=context, name=name, namespace=namespace, values=values
        )
        return self.add(robot, place)

    def robots(self, count: int = 2, **values) -> list[RobotNode]:
        """Start robot_1 to robot_<count>."""
        return [self.robot(f"robot_{k + 1}", **values) for k in range(count)]

    def recorder(self, out: Path, **values) -> Recorder:
        """Start a recorder."""
        return self.add(
            Recorder(context=self.place()[0], values={"out": str(out), **values})
        )

    def observer(self, namespace: str = "") -> "Observer":
        """Start a node outside of the team, in its own context."""
        context = self.place("observer")[0]
        return self.add(Observer(context, namespace, self), "observer")

    def spin_until(
        self, condition, what: str = "", seconds: float = PATIENCE_SECONDS
    ) -> None:
        """Spin until a condition holds; nodes that are done send their last messages."""
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, (
                f"after {seconds} s still not: {what or condition}"
            )
            for _, executor in list(self._places.values()):
                executor.spin_once(timeout_sec=0.002)
            for node in list(self._nodes):
                if getattr(node, "failure", None) is not None:
                    raise node.failure
                if getattr(node, "done", False) and node not in self._finished:
                    self._finished.add(node)
                    node.finish(interrupted=False)

    @contextmanager
    def spinning(self, *, but: str = ""):
        """Spin all places but one in a thread, while the test waits."""
        over = threading.Event()
        executors = [one for name, (_, one) in self._places.items() if name != but]

        def spin() -> None:
            while not over.is_set():
                for executor in executors:
                    executor.spin_once(timeout_sec=0.002)

        thread = threading.Thread(target=spin)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def spin_until_done(self, *nodes: Node, but: Node | None = None) -> None:
        """Spin until nodes (by default all `but` one) are done and have said their last words.

        Where a recorder is among them they leave too, for which it waits.
        """
        wanted = set(nodes) or {
            node for node in self._nodes if hasattr(node, "done")
        } - {but}
        leave = any(isinstance(node, Recorder) for node in wanted)

        def all_done() -> bool:
            if leave:
                for node in wanted & self._finished:
                    self.destroy(node)
            return wanted <= self._finished

        self.spin_until(all_done, "all done")


class Observer(Node):
    """Subscribes to topics and calls services, and keeps the received messages."""

    def __init__(self, context, namespace: str, bench: Bench) -> None:
        super().__init__("observer", context=context, namespace=namespace)
        self._bench = bench

    def listen(self, kind: type, topic: str, *, latched: bool = False) -> list:
        """Return a list to which messages will be appended."""
        messages: list = []
        durability = (
            DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        )
        qos = QoSProfile(
            depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=durability
        )
        # rclpy looks at the callback's signature, and a builtin has none.
        self.create_subscription(
            kind, topic, lambda message: messages.append(message), qos
        )
        return messages

    def say(self, publisher, message, condition, what: str) -> None:
        """Publish a message again and again until a condition holds.

        A publisher that knows a subscription may be unknown to that one yet, which then drops
        what it hears; and on a busy machine a message that is best effort may be lost at any time.
        """
        due = 0.0

        def heard() -> bool:
            nonlocal due
            if time.monotonic() >= due:
                due = time.monotonic() + SAY_AGAIN_SECONDS
                publisher.publish(message)
            return condition()

        self._bench.spin_until(heard, what)

    def call(self, kind: type, service: str, request=None):
        """Return a service's response."""
        client = self.create_client(kind, service)
        self._bench.spin_until(client.service_is_ready, f"service {service} is there")
        future = client.call_async(kind.Request() if request is None else request)
        self._bench.spin_until(future.done, f"service {service} answers")
        return future.result()

    def count(self, topic: str) -> int:
        """Return the number of known publishers of a topic."""
        return len(self.get_publishers_info_by_topic(self.resolve_topic_name(topic)))


@pytest.fixture(scope="session")
def built_types(tmp_path_factory):
    """Return the folder with the types of nav2_msgs and tf2_msgs, built where that can be."""
    given = os.environ.get("SPARSE_COORD_TYPES")
    prefix = Path(given) if given else tmp_path_factory.mktemp("types")
    try:
        ros_types.build(prefix)
    except OSError as error:
        pytest.skip(f"the types of nav2_msgs cannot be built here: {error}")
    return prefix


@pytest.fixture(scope="module")
def types(built_types):
    """Let this process and its children find the types of nav2_msgs and tf2_msgs."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in ros_types.environment(built_types).items():
            patch.setenv(name, value)
        patch.setattr(sys, "path", [*sys.path])
        ros_types.load(built_types)
        yield


@pytest.fixture
def bench(own_domain):
    """Return a bench."""
    with ExitStack() as stack:
        yield Bench(stack)


@pytest.fixture(scope="module")
def module_bench():
    """Return a bench that the tests of a module share."""
    with ExitStack() as stack:
        yield Bench(stack)


@pytest.fixture(scope="session")
def simulate():
    """Return a function that computes a run by the simulation without ROS."""

    def simulation(
        name: str, settings: dict, *, seed: int = 0, learner: str = "coop", tables=None
    ):
        rule = learner_of(learner)
        scenario = rule.with_defaults(load_scenario(name).with_settings(settings))
        everyone = range(len(scenario.robots))
        before = [None] * len(everyone) if tables is None else deepcopy(tables)
        agents = [
            Agent(
                rule,
                scenario,
                k,
                seed,
                memory=None
                if before[k] is None
                else taught(scenario, rule, k, before[k].memory),
            )
            for k in everyone
        ]
        percepts = Percepts(scenario, seed)
        world = World(scenario, seed)
        recorder = HistoryRecorder(scenario)
        said = SimpleNamespace(scenario=scenario, actions={}, rewards={}, percepts={})
        for agent in agents:
            agent.begin_episode()
        while world.transitions < scenario.steps:
            step = world.step
            choices = [chosen(agent, world, percepts) for agent in agents]
            actions = [None if choice is None else choice.action for choice in choices]
            before_step = tuple(world.cells)
            outcome = world.advance(actions)
            team = (before_step, tuple(world.cells))
            for agent, choice in zip(agents, choices, strict=True):
                if choice is not None:
                    reward = outcome.rewards[agent.number]
                    cell = world.cells[agent.number]
                    agent.learn(step, choice, reward, cell, team)
            recorder.add(world.episode, step, actions, outcome)
            for k in everyone:
                if actions[k] is not None:
                    said.actions[k, step] = actions[k]
                    said.rewards[k, step] = outcome.rewards[k]
                    if actions[k].asked:
                        said.percepts[k, step] = (choices[k].cell, choices[k].perceived)
            if outcome.episode_over and world.transitions < scenario.steps:
                world.begin_episode()
                for agent in agents:
                    agent.begin_episode()
        said.tables = [agent.tables for agent in agents]
        said.history = recorder.so_far
        return said

    return simulation


@pytest.fixture(scope="session")
def assert_same_tables():
    """Return a check that tables and history of a run are, byte for byte, the simulation's."""

    def check(out: Path, said) -> None:
        assert tables_equal(
            load_team(out, said.scenario, said.tables[0].rule), said.tables
        )
        assert same_bits(load_history(out), said.history)

    return check


class Process:
    """A child process whose output goes to a file."""

    def __init__(self, module: str, arguments: list[str], log: Path) -> None:
        self._log = log
        with log.open("wb") as file:
            name = (
                "sparse_coord"
                if module == "cli.main"
                else module.removeprefix("nodes.")
            )
            self._popen = subprocess.Popen(
                command(name, *arguments),
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self.pid = self._popen.pid

    def running(self) -> bool:
        """Return whether it has not ended."""
        return self._popen.poll() is None

    def send_signal(self, number: int) -> None:
        """Send a signal."""
        self._popen.send_signal(number)

    def child(self, module: str) -> SimpleNamespace:
        """Return the child process that runs a module of `nodes`, or one with its full name."""
        pid = child_of(self.pid, module)
        return SimpleNamespace(pid=pid, send_signal=functools.partial(os.kill, pid))

    @property
    def output(self) -> str:
        """Return its output, on stdout and stderr."""
        return self._log.read_text(errors="replace")

    def wait_for(self, text: str, times: int = 1) -> None:
        """Wait until it has printed a text, so many times."""
        deadline = time.monotonic() + PATIENCE_SECONDS
        while self.output.count(text) < times:
            assert self.running() and time.monotonic() < deadline, (
                f"no {text!r}: {self.output}"
            )
            time.sleep(0.01)

    def exit_code(self, seconds: float = PATIENCE_SECONDS) -> int:
        """Wait for its end."""
        return self._popen.wait(seconds)


@pytest.fixture
def start(own_domain, tmp_path):
    """Return a function that starts a module of the package as a process."""
    processes: list[Process] = []

    def starter(module: str, *arguments: str) -> Process:
        log = tmp_path / f"process_{len(processes)}.log"
        processes.append(Process(module, list(arguments), log))
        return processes[-1]

    yield starter
    for process in processes:
        if process.running():
            process.send_signal(signal.SIGKILL)
            process.exit_code()


@pytest.fixture
def start_node(start):
    """Return a function that starts a node as a process; parameters as keywords."""

    def starter(module: str, name: str, **parameters) -> Process:
        return start(f"nodes.{module}", *node_words(name, **parameters))

    return starter


@pytest.fixture
def ended_by(bench, monkeypatch, capfd):
    """Return a function that runs an executable here, and ends it by a signal after its start."""

    def end(main, number, name, *parameters):
        """Return the exit code, and the text on stderr.

        Args:
            main: the executable's function.
            number: of the signal.
            name: the node's.
            parameters: the node's, as `name:=value`.
        """
        words = [word for one in parameters for word in ("-p", one)]
        named = ["-r", f"__node:={name}"]
        monkeypatch.setattr(sys, "argv", ["node", "--ros-args", *named, *words])
        observer = bench.observer()

        def signal_it():
            deadline = time.monotonic() + PATIENCE_SECONDS
            while name not in observer.get_node_names() and time.monotonic() < deadline:
                time.sleep(0.02)
            os.kill(os.getpid(), number)

        thread = threading.Thread(target=signal_it)
        thread.start()
        try:
            return main(), capfd.readouterr().err
        finally:
            thread.join()

    return end


def _descendants() -> list[str]:
    """Return the live processes that tests have started, adopted orphans among them."""
    mark = f"ROS_LOG_DIR={os.environ['ROS_LOG_DIR']}".encode()
    found = []
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit() or int(folder.name) == os.getpid():
            continue
        try:
            if mark in (folder / "environ").read_bytes().split(b"\0"):
                command = (folder / "cmdline").read_bytes().replace(b"\0", b" ")
                found.append(f"{folder.name}: {command.decode(errors='replace')}")
        except OSError:  # it has just ended, or is not ours
            continue
    return found


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """Let nodes of this process begin without looking for others for a second."""
    monkeypatch.setattr(parameters, "DISCOVERY_SECONDS", 0.0)


@pytest.fixture(autouse=True)
def in_own_domain(own_domain):
    """Give each test a ROS domain of its own."""


@pytest.fixture(autouse=True)
def no_process_left():
    """Check that a test leaves no process behind; one that it started itself is `start`'s.

    What ends as its parent has ended (a recorder's writer, a browser's helpers) needs a moment.
    """
    # other tests' process pools leave multiprocessing's own tracker
    before = _descendants()
    yield
    deadline = time.monotonic() + PATIENCE_SECONDS
    while left := [one for one in _descendants() if one not in before]:
        assert time.monotonic() < deadline, f"processes left behind: {left}"
        time.sleep(0.02)
