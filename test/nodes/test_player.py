# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The player: bytes, order, types, QoS and clock of a bag; services, parameters, keys, errors."""

import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections import defaultdict
from contextlib import closing

import pytest
from nav_msgs.srv import GetPlan
from patience import PATIENCE_SECONDS
from rcl_interfaces.msg import Log, Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from recordings import chunks_in
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32, String
from std_srvs.srv import SetBool, Trigger

from sparse_coord_ros.base.errors import BagError, RunError
from sparse_coord_ros.cli.main import main as sparse_coord
from sparse_coord_ros.log.bags import BagTopic, BagWriter, QoS, open_bag, type_hash
from sparse_coord_ros.ros.nodes.player import REMEDY, Player, main
from sparse_coord_ros.ros.nodes.player_topics import chosen_topics

LATCHED = QoS(durability="transient_local", depth=1)
EVENTS = "/robot_1/active_perception/_service_event"
"""Service events, as a bag of rosbag2 may hold them."""
TYPES = {
    "/clock": ("rosgraph_msgs/msg/Clock", QoS()),
    "/map": ("std_msgs/msg/String", LATCHED),
    "/robot_1/action": ("std_msgs/msg/Int32", QoS(depth=100)),
    "/robot_2/action": ("std_msgs/msg/Int32", QoS(reliability="best_effort", depth=5)),
    EVENTS: ("nav_msgs/srv/GetPlan_Event", QoS(depth=100)),
    "/rosout": ("rcl_interfaces/msg/Log", QoS(depth=10)),
}
CLASSES = {"/map": String, "/rosout": Log, "/clock": Clock, EVENTS: GetPlan.Event}


def content(step):
    """Yield the messages of a time step: topic and message."""
    if step % 10 == 0:
        yield "/map", String(data=f"map {step}")
    clock = Clock()
    clock.clock.sec, clock.clock.nanosec = divmod(step * 100_000_000, 1_000_000_000)
    yield "/clock", clock
    for robot in (1, 2):
        yield f"/robot_{robot}/action", Int32(data=1000 * robot + step)
    if step % 7 == 0:
        yield EVENTS, GetPlan.Event()
        yield "/rosout", Log(msg=f"step {step}")


def write_bag(directory, *, steps=50, types=TYPES, close=True):
    """Write a bag of 0.1 s a step; returns its directory."""
    writer = BagWriter(directory)
    channels = {}
    for name, (type_name, qos) in types.items():
        topic = BagTopic(name, type_name, "", (qos,), type_hash(type_name))
        channels[name] = writer.add_known_topic(topic)
    for step in range(steps):
        for topic, message in content(step):
            if topic in channels:
                at = step * 100_000_000
                writer.write(channels[topic], serialize_message(message), at, at)
        if step == steps // 2:
            writer.flush()
    if close:
        writer.close()
    else:
        writer.abandon()
    return directory


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bags") / "run")


class Audience:
    """A player, and a node that receives the bytes of its topics."""

    def __init__(self, bench, bag, **values):
        self.bench = bench
        self.observer = bench.observer()
        values = {"bag": str(bag), "start_paused": True, **values}
        self.player = bench.add(Player(context=bench.place()[0], values=values))
        self.heard = []
        self.wait(lambda: self.player.begun, "the first step is shown")

    def listen(self, *topics, latched=False):
        """Take topics from now on, or with what they latch, and wait until all are matched."""
        publishers = self.player.played.publishers
        subscriptions = {}
        for topic in topics:
            offered = publishers[topic].qos_profile.reliability
            durability = (
                DurabilityPolicy.TRANSIENT_LOCAL
                if latched
                else DurabilityPolicy.VOLATILE
            )
            qos = QoSProfile(depth=1000, reliability=offered, durability=durability)

            def take(data, topic=topic):
                self.heard.append((topic, data))

            subscriptions[topic] = self.observer.create_subscription(
                publishers[topic].msg_type, topic, take, qos, raw=True
            )
        self.wait(
            lambda: all(
                publishers[topic].get_subscription_count()
                == 1
                == own.get_publisher_count()
                for topic, own in subscriptions.items()
            ),
            "player and audience know each other",
        )
        return self

    def wait(self, condition, what):
        self.bench.spin_until(condition, what)

    def texts(self):
        """Return the messages since the last call, as (topic, its text or number)."""
        found = [(topic, value(topic, data)) for topic, data in self.heard]
        self.heard.clear()
        return found

    def wait_for(self, *expected):
        """Wait until exactly these messages are received, in any order of topics."""
        self.wait(lambda: len(self.heard) >= len(expected), expected)
        assert sorted(self.texts()) == sorted(expected)

    def set(self, name, number):
        parameter = ParameterValue(
            type=ParameterType.PARAMETER_DOUBLE, double_value=number
        )
        request = SetParameters.Request(
            parameters=[Parameter(name=name, value=parameter)]
        )
        return self.observer.call(
            SetParameters, "player/set_parameters", request
        ).results[0]

    def pause(self, data):
        return self.observer.call(
            SetBool, "player/pause", SetBool.Request(data=data)
        ).message

    def step(self):
        response = self.observer.call(Trigger, "player/step")
        return response.success, response.message


def value(topic, data):
    message = deserialize_message(data, CLASSES.get(topic, Int32))
    if topic == "/clock":
        return message.clock.sec * 10 + message.clock.nanosec // 100_000_000
    return message.msg if topic == "/rosout" else message.data


@pytest.fixture
def hasty(monkeypatch):
    """Do not wait for volatile readers of latched topics, which never say that they have it."""
    monkeypatch.setattr("sparse_coord_ros.ros.nodes.spin.READERS_SECONDS", 0.1)


def test_everything_comes_back_as_it_was_recorded(bench, bag, hasty):
    recorded = defaultdict(list)
    for message in open_bag(bag).messages():
        recorded[message.topic].append(message.data)
    del recorded["/rosout"]
    there = Audience(bench, bag, rate=1000).listen(*recorded)
    assert there.set("position", 0.0).successful
    there.pause(False)
    bench.spin_until_done(there.player)
    count = sum(map(len, recorded.values()))
    there.wait(lambda: len(there.heard) >= count, f"{count} messages")
    heard = defaultdict(list)
    for topic, data in there.heard:
        heard[topic].append(data)
    assert heard == recorded


def test_types_and_qos_are_those_of_the_bag_and_latched_stays_latched(bench, bag):
    there = Audience(bench, bag)
    names = [name for name in TYPES if name != "/rosout"]
    infos = there.observer.get_publishers_info_by_topic
    there.wait(
        lambda: all(["player"] == [i.node_name for i in infos(n)] for n in names),
        "infos",
    )
    for name in names:
        type_name, qos = TYPES[name]
        (info,) = infos(name)
        assert info.topic_type == type_name
        assert info.qos_profile.reliability.name.lower() == qos.reliability
        assert info.qos_profile.durability.name.lower() == qos.durability
        assert there.player.played.publishers[name].qos_profile.depth == qos.depth
    assert [info.node_name for info in infos("/rosout")].count("player") == 1, "its own"
    there.listen("/map", latched=True)
    there.wait_for(("/map", "map 0"))


def test_steps_pauses_rates_and_positions(bench, bag, hasty):
    topics = ("/clock", "/robot_1/action", "/map")
    there = Audience(bench, bag, rate=0.01).listen(*topics)
    assert there.step() == (True, "paused at 0.100 s: 3 messages")
    there.wait_for(("/clock", 1), ("/robot_1/action", 1001))
    assert there.pause(False) == "playing at rate 0.01 at 0.100 s"
    assert there.texts() == []
    assert there.set("rate", 1000.0).successful
    bench.spin_until_done(there.player)
    there.wait(lambda: len(there.heard) == 48 + 48 + 4, "the rest")
    there.heard.clear()
    assert there.pause(True) == "paused at 4.900 s"
    assert there.step() == (False, f"the bag has ended at 4.900 s; {REMEDY}")
    assert there.set("position", 2.5).successful
    there.wait_for(
        ("/map", "map 20"), ("/clock", 24), ("/clock", 25), ("/robot_1/action", 1025)
    )
    assert there.set("position", 4.0).successful
    there.wait_for(
        ("/map", "map 30"),
        ("/clock", 39),
        ("/map", "map 40"),
        ("/clock", 40),
        ("/robot_1/action", 1040),
    )
    assert there.set("position", 0.35).successful
    there.wait_for(("/map", "map 0"), ("/clock", 3))
    assert there.step() == (True, "paused at 0.400 s: 3 messages")
    assert there.player.get_parameter("position").value == 0.35


def test_bad_changes_are_refused(bench, bag):
    there = Audience(bench, bag)
    for name, number, reason in (
        ("position", 4.91, "value is 4.91, allowed: a number from 0 to 4.9"),
        ("position", -1.0, "value is -1.0, allowed: a number from 0 to 4.9"),
        ("position", float("nan"), "value is nan"),
        ("rate", 0.0, "out of range Min: 0.01"),
        ("loop", True, "read-only"),
    ):
        assert there.player.describe_parameter(name).read_only == (name == "loop")
        before = there.player.values[name]
        result = there.set(name, number)
        assert not result.successful and reason in result.reason
        assert there.player.values[name] == before


def test_a_start_in_the_middle_and_a_loop(bench, bag):
    there = Audience(bench, bag, position=4.8, loop=True, rate=1000)
    there.listen("/map", latched=True).wait_for(("/map", "map 40"))
    there.pause(False)
    there.wait(lambda: len(there.heard) >= 12, "two rounds")
    rounds = [("/map", f"map {step}") for step in range(0, 50, 10)]
    assert there.texts()[:12] == (rounds * 3)[:12]
    assert not there.player.done


def test_rosout_is_not_played(bag):
    assert "/rosout" not in chosen_topics(open_bag(bag))


def test_beside_a_live_run_it_plays_nothing(bench, bag):
    live = bench.observer()
    live.create_publisher(Clock, "/clock", 1)
    heard = live.listen(String, "/map", latched=True)
    player = Player(context=bench.place()[0], values={"bag": str(bag)})
    bench.add(player)
    with pytest.raises(RunError, match="publishes /clock: .* ROS_DOMAIN_ID"):
        bench.spin_until_done(player)
    assert heard == []


def test_without_a_recorded_clock_the_log_times_are_the_clock(bench, tmp_path):
    types = {name: TYPES[name] for name in ("/map", "/robot_1/action")}
    there = Audience(bench, write_bag(tmp_path / "bag", types=types))
    clock = there.observer.listen(Clock, "/clock")
    publisher = there.player.played.clock
    there.wait(
        lambda: publisher.get_subscription_count() == 1, "the clock has a reader"
    )
    there.step()
    there.set("position", 2.5)
    there.set("position", 2.55)
    there.step()
    there.wait(lambda: len(clock) >= 4, "four times")
    times = [m.clock.sec * 1000 + m.clock.nanosec // 1_000_000 for m in clock]
    assert times == [100, 2500, 2550, 2600]


def test_types_that_are_not_installed_are_named_once_and_left_out(
    bench, tmp_path, capfd
):
    strange = {
        "/map": ("no_such_msgs/msg/Thing", ""),
        "/other": ("std_msgs/msg/Char", "RIHS01_" + "0" * 64),
        "/robot_2/action": ("Int32", ""),
    }
    with closing(BagWriter(tmp_path / "bag")) as writer:
        for name, (type_name, digest) in strange.items():
            topic = BagTopic(name, type_name, "", (QoS(),), digest)
            writer.write(writer.add_known_topic(topic), bytes(8), 0, 0)
        channel = writer.add_topic("/robot_1/action", *TYPES["/robot_1/action"])
        writer.write(channel, serialize_message(Int32()), 0, 0)
    there = Audience(bench, tmp_path / "bag")
    assert set(there.player.played.publishers) == {"/robot_1/action"}
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "WARN" in line]
    assert "not played: /map (type no_such_msgs/msg/Thing is not installed), " in line
    assert "/other (type std_msgs/msg/Char is installed in another version), " in line
    assert "/robot_2/action (type Int32 is not installed)" in line


@pytest.mark.parametrize("damage", ["partial", "flipped"])
def test_what_is_readable_of_a_broken_bag_is_played(bench, tmp_path, capfd, damage):
    write_bag(tmp_path / "bag", close=damage != "partial")
    (file,) = (tmp_path / "bag").glob("*.mcap*")
    data = bytearray(file.read_bytes())
    if damage == "flipped":
        data[chunks_in(file)[-1][0] + 60] ^= 1
    file.write_bytes(data)
    readable = [m for m in open_bag(file).messages() if m.topic == "/robot_1/action"]
    assert 0 < len(readable) <= 50
    there = Audience(bench, file, rate=1000).listen("/robot_1/action")
    there.set("position", 0.0)
    there.pause(False)
    bench.spin_until_done(there.player)
    there.wait(lambda: len(there.heard) >= len(readable), "all")
    assert [data for _, data in there.heard] == [message.data for message in readable]
    warnings = [line for line in capfd.readouterr().err.splitlines() if "WARN" in line]
    assert len(warnings) == 1
    assert ("it has no end" if damage == "partial" else "damaged at byte ") in warnings[
        0
    ]


def test_a_bag_of_no_messages_is_refused(bench, tmp_path):
    bag = write_bag(tmp_path / "bag", steps=0, types={"/map": TYPES["/map"]})
    with pytest.raises(BagError, match="no message to play on /map"):
        Player(context=bench.place()[0], values={"bag": str(bag)})


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["nowhere"], "nowhere"),
        (["{bag}", "--rate", "fast"], "error: --rate: value is 'fast'"),
        (
            ["{bag}", "--start", "5"],
            "--start: value is 5.0, allowed: a number from 0 to 4.9",
        ),
    ],
)
def test_the_verb_refuses_bad_input(bag, capfd, arguments, text):
    assert sparse_coord(["replay", *[a.format(bag=bag) for a in arguments]]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("error: ")
    assert text in line


def test_the_verb_plays_to_the_end_and_says_how_well(bag, capfd):
    options = ["--rate", "100", "--start", "2", str(bag)]
    assert sparse_coord(["replay", *options]) == 0
    err = capfd.readouterr().err
    assert " messages on 5 topics, 50 time steps, 4.9 s" in err
    assert "ended at 4.900 s" in err
    assert "ms late" in err


def test_a_signal_ends_it_cleanly(ended_by, bag):
    given = (f"bag:={bag}", "rate:=0.01")
    code, said = ended_by(main, signal.SIGTERM, "player", *given)
    assert code == 0
    assert "stopped at" in said and "Traceback" not in said


ON_TERMINAL = (
    "import fcntl, runpy, sys, termios\n"
    "fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
    "sys.argv = ['executables', 'sparse_coord', 'replay', *sys.argv[1:]]\n"
    "runpy.run_module('sparse_coord_ros.executables', run_name='__main__')\n"
)


class Terminal:
    """`sparse_coord replay` at a terminal of its own."""

    def __init__(self, *arguments):
        self.ours, self.theirs = pty.openpty()
        self.before = termios.tcgetattr(self.theirs)
        self.process = subprocess.Popen(
            [sys.executable, "-c", ON_TERMINAL, *arguments],
            stdin=self.theirs,
            stdout=self.theirs,
            stderr=self.theirs,
            start_new_session=True,
        )
        self.output = ""

    def wait_for(self, text):
        """Wait for an output, and forget it and what was before."""
        deadline = time.monotonic() + PATIENCE_SECONDS
        while text not in self.output:
            left = deadline - time.monotonic()
            assert left > 0, f"no {text!r} in {self.output}"
            if select.select([self.ours], [], [], left)[0]:
                self.output += os.read(self.ours, 65536).decode()
        self.output = self.output.partition(text)[2]

    def type(self, keys):
        os.write(self.ours, keys)

    def end(self):
        """Wait for the end; return exit code and whether the terminal is as it was."""
        code = self.process.wait(PATIENCE_SECONDS)
        return code, termios.tcgetattr(self.theirs) == self.before

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        os.close(self.ours)
        os.close(self.theirs)


@pytest.fixture
def terminal(own_domain):
    opened = []

    def start(*arguments):
        opened.append(Terminal(*arguments))
        return opened[-1]

    yield start
    for one in opened:
        one.close()


def test_keys(terminal, bag):
    shell = terminal(str(bag), "--step", "--start", "3")
    shell.wait_for("space: pause or resume")
    shell.type(b"\x1b[C")
    shell.wait_for("paused at 3.")
    shell.type(b"\x1b[C")
    shell.wait_for("messages")
    shell.type(b"\x1b[D")
    shell.wait_for("paused at 0.000 s")
    shell.type(b"x\x1bOC\x1b[2~")
    shell.wait_for("paused at 0.100 s: 3 messages")
    shell.type(b"\x1b[6~")
    shell.wait_for("paused at 4.900 s")
    shell.type(b"\x1b[C")
    shell.wait_for(
        "has ended at 4.900 s; seek back: parameter position, keys left or Home"
    )
    shell.type(b"\x1b[5~\x1b[C")
    shell.wait_for("paused at 0.000 s")
    shell.wait_for("paused at 0.100 s: 3 messages")
    shell.type(b"\x1b[B\x1b[B")
    shell.wait_for("paused at 0.100 s")
    shell.type(b" ")
    shell.wait_for("playing at rate 0.25")
    shell.type(b"\x1b[A ")
    shell.wait_for("playing at rate 0.5")
    shell.wait_for("paused at")
    shell.type(b"\x1b[H")
    shell.wait_for("paused at 0.000 s")
    shell.type(b"q")
    shell.wait_for("ended at 0.000 s")
    assert shell.end() == (0, True)


def test_keys_are_heard_at_the_highest_rate(terminal, tmp_path):
    """With more messages than can be published, all the time."""
    with closing(BagWriter(tmp_path / "bag")) as writer:
        channel = writer.add_topic("/map", "std_msgs/msg/String", QoS())
        for number in range(2_000):
            writer.write(channel, serialize_message(String(data="map")), number, number)
    shell = terminal(str(tmp_path / "bag"), "--rate", "1000", "--loop")
    shell.wait_for("q: quit")
    time.sleep(0.4)  # it lets subscribers come, and plays
    shell.type(b" ")
    shell.wait_for("paused at")
    shell.type(b" ")
    shell.wait_for("playing at rate 1000")
    shell.type(b"q")
    shell.wait_for("ended at")
    assert shell.end() == (0, True)
