# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Halting a team: by its world, by a driver, from outside; late drivers, lost orders."""

import json
import re
import signal
import time

import pytest
from browser import open_tab, visit, wait_for
from geometry_msgs.msg import Twist
from patience import PATIENCE_SECONDS
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from sparse_coord_ros.cli.main import main as sparse_coord
from sparse_coord_ros.protocol.lockstep.bodies import NO_GOALS, HaltOrder
from sparse_coord_ros.protocol.wire import RunState
from sparse_coord_ros.ros.nodes import halting, ros_topics
from sparse_coord_ros.ros.nodes.body import BodyNode
from sparse_coord_ros.ros.nodes.driver import DriverNode
from sparse_coord_ros.ros.nodes.halting import ASK_SECONDS, Halting
from sparse_coord_ros.ros.nodes.messages import Converter
from sparse_coord_ros.ros.nodes.watch import WatchNode
from sparse_coord_ros.show.page.controls import HALT as HALTING
from sparse_coord_ros.show.page.controls import Control

from .puppet import puppet

ROBOTS = ("robot_1", "robot_2")
HALT = SetBool.Request(data=True)
GO_ON = SetBool.Request(data=False)


@pytest.fixture
def start_driver(bench):
    """Return a function that starts the driver of a robot."""

    def start(robot, place="team"):
        values = {"robot": robot, "speed": 2.0, "turn": 6.0}
        context = bench.place(place)[0]
        node = DriverNode(context=context, name=f"{robot}_driver", values=values)
        return bench.add(node, place)

    return start


def team_of(bench, tmp_path, start_driver, places):
    """Return a world whose bodies drive at their own speed, and its drivers, some elsewhere."""
    out = str(tmp_path / "out")
    more = {"set": ["steps=4000"], "checkpoint": 2, "body_timeout": 1.0}
    world = bench.world(bodies=True, out=out, **more)
    bench.robots(out=out)
    drivers = {
        robot: start_driver(robot, places.get(robot, "team")) for robot in ROBOTS
    }
    bench.add(BodyNode(context=bench.place()[0], values={"body_rate": 30.0}))
    bench.spin_until(lambda: world.lockstep.world.transitions > 2, "under way")
    return world, drivers


@pytest.fixture
def team(bench, tmp_path, start_driver):
    """Return such a team, all in one place."""
    return team_of(bench, tmp_path, start_driver, {})


def spin_for(bench, seconds):
    end = time.monotonic() + seconds
    bench.spin_until(
        lambda: time.monotonic() > end, "time passes", seconds=seconds + 60.0
    )


def test_one_call_halts_all_and_another_lets_them_go_on(bench, team):
    """The time limits of a move do not run meanwhile, neither the driver's nor the world's."""
    world, drivers = team
    observer = bench.observer()
    commands = [observer.listen(Twist, f"{robot}/cmd_vel") for robot in ROBOTS]
    call = "world_simulator/halt"
    observer.call(SetBool, call, HALT)
    bench.spin_until(
        lambda: observer.call(SetBool, call, HALT).success, "all confirm it"
    )
    assert all(driver.halted for driver in drivers.values())
    assert world.doing == RunState.HALTED
    made = world.lockstep.world.transitions
    failed = world.summary()["moves_failed"]
    stands = [Twist()] * 5  # commands of before may still be under way
    bench.spin_until(
        lambda: all(heard[-5:] == stands for heard in commands), "only these come"
    )
    for heard in commands:
        heard.clear()
    spin_for(bench, 1.3)  # longer than body_timeout
    assert world.lockstep.world.transitions == made
    assert world.summary()["moves_failed"] == failed
    for heard in commands:
        assert len(heard) > 5, "a base that missed a command hears another one"
        assert all(command == Twist() for command in heard)
    answer = observer.call(Trigger, "world_simulator/step")
    assert not answer.success and "halted" in answer.message
    answer = observer.call(SetBool, call, GO_ON)
    bench.spin_until(
        lambda: observer.call(SetBool, call, GO_ON).success, "all confirm it"
    )
    bench.spin_until(lambda: world.lockstep.world.transitions > made + 2, "it goes on")


def test_a_driver_that_starts_while_all_are_halted_does_not_move(
    bench, team, start_driver
):
    world, drivers = team
    observer = bench.observer()
    observer.call(SetBool, "world_simulator/halt", HALT)
    bench.spin_until(lambda: drivers["robot_2"].halted, "halted")
    bench.destroy(drivers["robot_2"])
    commands = observer.listen(Twist, "robot_2/cmd_vel")
    late = start_driver("robot_2")
    bench.spin_until(lambda: late.on_duty, "it is on duty")
    spin_for(bench, 0.5)
    assert late.halted
    assert all(command == Twist() for command in commands)
    observer.call(SetBool, "world_simulator/halt", GO_ON)
    made = world.lockstep.world.transitions
    bench.spin_until(lambda: world.lockstep.world.transitions > made + 2, "it goes on")


def test_a_driver_that_is_halted_halts_the_team(bench, team):
    world, drivers = team
    observer = bench.observer()
    assert observer.call(SetBool, "robot_1_driver/halt", HALT).success
    bench.spin_until(lambda: drivers["robot_2"].halted, "the other one, too")
    assert world.doing == RunState.HALTED
    assert observer.call(SetBool, "world_simulator/halt", GO_ON)
    bench.spin_until(
        lambda: not any(one.halted for one in drivers.values()), "both go on"
    )


def test_a_world_that_comes_back_finds_the_team_halted(bench, team, tmp_path):
    world, drivers = team
    observer = bench.observer()
    observer.call(SetBool, "world_simulator/halt", HALT)
    bench.spin_until(lambda: all(one.halted for one in drivers.values()), "halted")
    bench.destroy(world)  # as if it had been killed
    bench.spin_until(
        lambda: not observer.count("world_simulator/_claim"), "its name is free"
    )
    out = str(tmp_path / "out")
    again = bench.world(
        bodies=True, resume=True, scenario="", out=out, body_timeout=1.0
    )
    bench.spin_until(lambda: again.bodies.halted, "it hears that they are halted")
    spin_for(bench, 0.5)
    assert all(driver.halted for driver in drivers.values())
    observer.call(SetBool, "world_simulator/halt", GO_ON)
    made = again.lockstep.world.transitions
    bench.spin_until(lambda: again.lockstep.world.transitions > made + 2, "it goes on")


def test_only_a_new_word_of_the_world_counts(bench):
    """The first received order may be old; a repeated one is not new."""
    values = {"robot": "robot_1"}
    driver = bench.add(puppet(DriverNode)(context=bench.place()[0], values=values))
    observer = bench.observer()
    world = bench.world(bodies=True)
    convert = Converter(world.run)
    bench.spin_until(lambda: driver.presence is not None, "the run is known")
    assert observer.call(SetBool, "driver/halt", HALT).success
    for word, halted in [
        (HaltOrder.GO_ON, True),
        (HaltOrder.HALT, True),
        (HaltOrder.GO_ON, False),
        (HaltOrder.NOTHING, False),
        (HaltOrder.HALT, True),
        (HaltOrder.NOTHING, True),
    ]:
        goals = NO_GOALS._replace(halt=word)
        driver.hear("goals", convert.goals_message(goals))
        assert driver.halted == halted, word
    for word in HaltOrder:
        goals = NO_GOALS._replace(halt=word)
        assert convert.read_goals(convert.goals_message(goals)) == goals
    message = convert.goals_message(NO_GOALS)
    del message.name[3], message.position[3]
    assert convert.read_goals(message) == NO_GOALS, (
        "a world of one's own need not say it"
    )


def test_a_word_that_is_lost_is_said_again_and_the_world_tells_who_has_not_confirmed(
    bench,
):
    bench.world(bodies=True)
    observer = bench.observer()
    heard = observer.listen(JointState, "goals", latched=True)
    # a driver, as far as is known
    observer.create_publisher(JointState, "robot_1/reached", 10)
    bench.spin_until(
        lambda: not observer.call(SetBool, "world_simulator/halt", HALT).success,
        "it is seen",
    )
    answer = observer.call(SetBool, "world_simulator/halt", HALT)
    assert answer.message.endswith("not yet confirmed by the drivers of robot_1")
    before = len(heard)
    bench.spin_until(lambda: len(heard) > before + 2, "said again")
    said = dict(zip(heard[-1].name, heard[-1].position, strict=True))
    assert said["halt"] == HaltOrder.HALT
    says = observer.create_publisher(Bool, "robot_1/halted", ros_topics.LATCHED_QOS)
    says.publish(Bool(data=True))
    bench.spin_until(
        lambda: observer.call(SetBool, "world_simulator/halt", HALT).success,
        "confirmed",
    )


def test_without_bodies_there_is_nothing_to_halt(bench):
    world = bench.world()

    def offered():
        of_node = world.get_service_names_and_types_by_node
        return {name for name, _ in of_node("world_simulator", "/")}

    bench.spin_until(
        lambda: "/world_simulator/pause" in offered(), "its services are there"
    )
    assert "/world_simulator/halt" not in offered()


def test_from_the_page_which_may_be_closed_then(bench, team, monkeypatch):
    """A fulfilled request is over: the page does not repeat it later."""
    monkeypatch.setattr(halting, "FIND_SECONDS", 0.5)
    world, drivers = team
    page = WatchNode(context=bench.place("observer")[0], values={"port": 0})
    bench.add(page, "observer")
    board = page.server.board

    def shown():
        return board.get("halting") or {}

    bench.spin_until(lambda: shown().get("possible"), "there is somebody to halt")
    page.controls.control(Control(HALTING, True))
    bench.spin_until(lambda: shown()["said"] == "all robots stand", "all stand")
    assert all(driver.halted for driver in drivers.values())
    bench.spin_until(
        lambda: not page.controls.halting.asking, "it asks nobody any more"
    )
    observer = bench.observer()
    observer.call(SetBool, "world_simulator/halt", GO_ON)
    bench.spin_until(lambda: shown()["said"] == "", "others have let them go on")
    page.controls.control(Control(HALTING, True))
    bench.spin_until(lambda: shown()["said"] == "all robots stand", "all stand again")
    bench.destroy(page)
    spin_for(bench, 0.5)
    assert all(driver.halted for driver in drivers.values()), (
        "nothing goes on by itself"
    )
    again = WatchNode(context=bench.place("observer")[0], values={"port": 0})
    bench.add(again, "observer")
    board = again.server.board
    bench.spin_until(
        lambda: shown().get("said") == "all robots stand", "another page shows it"
    )
    again.controls.control(Control(HALTING, False))
    made = world.lockstep.world.transitions
    bench.spin_until(lambda: world.lockstep.world.transitions > made + 2, "they go on")


def test_the_page_says_who_does_not_answer(bench, team):
    page = WatchNode(context=bench.place("observer")[0], values={"port": 0})
    bench.add(page, "observer")
    board = page.server.board
    bench.observer().create_service(
        SetBool, "deaf/halt", lambda request, response: response
    )
    bench.spin_until(lambda: "deaf" in page.controls.halting.asked, "it is found")
    page.controls.control(Control(HALTING, True))
    silent = "deaf: does not answer; its body may be moving"
    bench.spin_until(
        lambda: (board.get("halting") or {}).get("said") == silent, "who is left"
    )


@pytest.fixture
def obstinate(bench):
    """Return a node whose service `halt` answers that it has not done it, and its requests."""
    asked = []

    def answer(request, response):
        asked.append(request.data)
        response.success = False
        response.message = "not yet"
        return response

    node = bench.observer(namespace="fleet")
    node.create_service(SetBool, "obstinate/halt", answer)
    other = bench.observer(namespace="fleet/other")
    other.create_service(SetBool, "obstinate/halt", answer)
    return asked


def test_who_does_not_do_it_is_asked_again_but_not_for_ever(
    bench, obstinate, monkeypatch
):
    """Another team's nodes, in a namespace below, are not asked."""
    monkeypatch.setattr(halting, "REPEAT_HALT_SECONDS", 0.05)
    calls = Halting(bench.observer(), "/fleet")
    calls.tick(time.monotonic())
    begun = time.monotonic()
    calls.ask(True, begun)

    def asked_often():
        calls.tick(time.monotonic())
        return len(obstinate) > 2

    bench.spin_until(asked_often, "asked again")
    assert [*calls.asked] == calls.left == ["obstinate"] and calls.asking
    assert calls.in_words("obstinate") == "obstinate: not yet"
    assert not calls.world_told
    calls.tick(begun + ASK_SECONDS + 1.0)
    assert not calls.asking and calls.left == ["obstinate"]
    count = len(obstinate)
    calls.tick(begun + ASK_SECONDS + 2.0)
    spin_for(bench, 0.3)
    assert len(obstinate) <= count + 1, "what was under way arrives"


@pytest.fixture
def processes(start_node, tmp_path):
    """Start a team with bodies as processes; return them by name."""
    out = str(tmp_path / "out")
    more = {"scenario": "env1", "bodies": True, "steps": 100000, "out": out}
    found = {
        "world_simulator": start_node("world_simulator", "world_simulator", **more)
    }
    for robot in ROBOTS:
        found[robot] = start_node("robot", robot, out=out)
        found[f"{robot}_driver"] = start_node("driver", f"{robot}_driver", robot=robot)
    found["body"] = start_node("body", "body", body_rate=20.0)
    found["world_simulator"].wait_for("0 %  ")
    return found


@pytest.fixture
def command(bench, capfd, monkeypatch):
    """Return a function that runs `sparse_coord halt` while a bench is spun, all but one place.

    It ends as soon as all have confirmed; `timeout`: the seconds that it takes where one does not.
    """
    monkeypatch.setattr(halting, "FIND_SECONDS", 0.5)

    def halt(*words, but="", timeout=PATIENCE_SECONDS):
        with bench.spinning(but=but):
            words = ["--timeout", str(timeout), *words]
            code = sparse_coord(["halt", "--json", *words])
        return code, json.loads(capfd.readouterr().out)

    return halt


@pytest.mark.filterwarnings("ignore:failed to send response")
def test_the_command_says_who_has_not_confirmed(bench, tmp_path, start_driver, command):
    """A driver that hangs cannot answer: its body may be moving."""
    world, _ = team_of(bench, tmp_path, start_driver, places={"robot_2": "hangs"})
    code, said = command(but="hangs", timeout=4)
    assert code == 1 and not said["confirmed"]
    told = said["nodes"]["world_simulator"]
    assert not told["done"]
    assert told["said"].endswith("not yet confirmed by the drivers of robot_2")
    code, said = command()
    assert (code, said["confirmed"], said["world_told"]) == (0, True, True)
    # The world confirms for its drivers. The command may end before it has found all of them.
    drivers = {f"{robot}_driver" for robot in ROBOTS}
    assert {"world_simulator"} <= {*said["nodes"]} <= {"world_simulator", *drivers}
    code, said = command("--go-on")
    assert (code, said["confirmed"]) == (0, True)
    bench.destroy(world)
    code, said = command(timeout=4)
    assert (code, said["confirmed"], said["world_told"]) == (1, False, False)
    answers = {name: one["said"] for name, one in said["nodes"].items()}
    answers.pop("world_simulator", None)  # it may still be seen for some seconds
    assert answers == {f"{robot}_driver": "stands" for robot in ROBOTS}


def test_where_no_team_is_the_command_ends_with_one_line(
    own_domain, capfd, monkeypatch
):
    monkeypatch.setattr(halting, "ASK_SECONDS", 0.5)
    assert sparse_coord(["halt", "--namespace", "nowhere"]) == 2
    [line] = capfd.readouterr().err.splitlines()
    what = "error: there is no world with bodies and no driver in namespace /nowhere; "
    assert line.startswith(what)


@pytest.mark.long
def test_the_buttons_of_the_page(processes, start):
    """The first one stops, however often it is pressed; only the second one lets them continue."""
    page = start("cli.main", "watch", "--port", "0")
    page.wait_for("watch it at ")
    state = "document.getElementById('state').dataset.state"
    press = "document.getElementById('{}').click()"
    seen = "document.getElementById('{}').getClientRects().length > 0"
    address = re.search(r"watch it at (http\S+)", page.output)[1]
    with open_tab() as tab:
        visit(tab, address)
        wait_for(tab, seen.format("halt"))
        assert not tab.evaluate(seen.format("go-on"))
        for _ in range(2):
            tab.evaluate(press.format("halt"))
        wait_for(tab, f"{state} === 'halted'")
        said = "document.getElementById('halting-said').textContent"
        wait_for(tab, f"{said} === 'all robots stand'")
        for robot in ROBOTS:
            processes[f"{robot}_driver"].wait_for(f"the body of {robot} stops")
        visit(tab, address)
        wait_for(tab, f"{state} === 'halted' && {seen.format('go-on')}")
        tab.evaluate(press.format("go-on"))
        wait_for(tab, f"{state} === 'learning'")
        for robot in ROBOTS:
            processes[f"{robot}_driver"].wait_for(f"the body of {robot} may continue")
        page.send_signal(signal.SIGINT)
        assert page.exit_code() == 0
        wait_for(tab, f"{state} === 'not connected'")
        tab.evaluate(press.format("halt"))
        assert (
            tab.evaluate(said)
            == "not connected: the robots were not told; stop them by hand"
        )
