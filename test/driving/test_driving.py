# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies: floor, steering, driver, simulator, and learned teams driven through it."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from teams import learn

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.game.grid import CLEAR
from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.evaluation import play
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.core.solve.advice import WILL_PAY, advice
from sparse_coord_ros.lab.driving.body_simulator import (
    BIAS,
    ELSEWHERE,
    IN_DOORWAY,
    TRACK,
    BodySimulator,
    Noise,
)
from sparse_coord_ros.lab.driving.cmd_vel_driver import CmdVelDriver
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.steering import Command, Limits, move_seconds, steer
from sparse_coord_ros.lab.driving.transform_tree import Tree, parent_of, yaw_of
from sparse_coord_ros.lab.driving.trials import (
    DRIVE_SETTINGS,
    drive,
    limits_of,
    remedies,
)
from sparse_coord_ros.lab.maps.image import read_floor_plan
from sparse_coord_ros.lab.maps.plan import import_map, scenario_of
from sparse_coord_ros.protocol.lockstep.bodies import NO_CELL, BodyGoal, Goals

RUN = make_run(load_scenario("env1"), {})
CELLS = RUN.scenario.map.number
DOOR = next(iter(RUN.scenario.map.doorways))
VALUES = DRIVE_SETTINGS.defaults()
LIMITS = limits_of(VALUES, 1.0)
SURE = Noise(0.0, 0.0)


@pytest.fixture
def metric_map():
    return MetricMap(RUN)


def test_places_keep_bodies_apart_and_within_their_cells(metric_map):
    for cell in range(len(RUN.scenario.map.cells)):
        places = [metric_map.place(k, cell) for k in range(4)]
        for x, y in places:
            assert metric_map.cell(x, y) == cell and not metric_map.blocked(x, y)
        if cell == DOOR:
            assert len(set(places)) == 1
        else:
            apart = [math.dist(a, b) for i, a in enumerate(places) for b in places[:i]]
            assert min(apart) > 2 * metric_map.radius


def test_lanes_keep_away_from_walls_where_there_is_room():
    """As far as the cell allows; in a doorway, and before it, in the middle."""
    grid = RUN.scenario.map
    wide = MetricMap(
        make_run(replace(RUN.scenario, map=replace(grid, radius=0.45)), {})
    )
    assert (wide.radius, MetricMap(RUN, 0.2).radius) == (0.45, 0.2)
    clear = wide.side * (0.5 - CLEAR) - wide.radius
    for cell, (row, column) in enumerate(grid.cells):
        x, y = (
            there - middle
            for there, middle in zip(wide.place(2, cell), centre(cell), strict=True)
        )
        walls = [(row, column + d) not in grid.number for d in (-1, 1)]
        if all(walls):
            assert x == 0.0
        elif cell not in grid.doorways:
            assert not walls[0] or x >= -clear
            assert not walls[1] or x <= clear
    (row, column) = grid.cells[DOOR]
    beside = grid.number[row, column + 1]
    assert wide.place(0, beside)[1] == pytest.approx(wide.place(0, DOOR)[1])


def centre(cell):
    row, column = RUN.scenario.map.cells[cell]
    return column + 0.5, RUN.scenario.map.shape[0] - row - 0.5


def test_a_body_as_wide_as_a_cell_is_refused():
    with pytest.raises(SettingError, match="radius: value is 0.5"):
        MetricMap(RUN, 0.5)


def test_cells_of_places_on_and_off_the_grid(metric_map):
    x, y = metric_map.place(0, CELLS[0, 0])
    assert metric_map.cell(x, y) == CELLS[0, 0]
    assert metric_map.cell(-0.3, 4.6) == CELLS[0, 0]  # off the map
    assert metric_map.cell(2.4, 4.4) == CELLS[0, 1]  # in a wall: the nearest free one
    assert metric_map.cell(-9.0, 4.5) is None and metric_map.cell(math.nan, 0.0) is None
    assert metric_map.blocked(0.1, 4.5) and metric_map.blocked(-5.0, 0.0)


@pytest.mark.parametrize("side", [0.5, 1.0, 2.5])
def test_a_body_touches_the_wall_beside_it_at_its_radius(side):
    grid = replace(RUN.scenario.map, resolution=side, radius=0.2 * side)
    found = MetricMap(make_run(replace(RUN.scenario, map=grid), {}))
    north = 4.5 * side
    for wall, toward in ((2 * side, -1), (0.0, 1)):  # east, and the end of the map
        for away, touches in ((0.19, True), (0.21, False)):
            x = wall + toward * away * side
            assert found.blocked(x, north) == touches, (wall, away)
    assert found.blocked(side, 5.0 * side - 0.19 * side)
    assert not found.blocked(side, 5.0 * side - 0.21 * side)


@pytest.mark.parametrize("yaw", np.linspace(-3.1, 3.1, 9))
def test_steering_comes_to_any_place_in_time(yaw):
    simulator = BodySimulator(MetricMap(RUN), 1, 1, SURE)
    body = simulator.bodies[0]
    body.put(0.5, 4.5)
    body.pose = Pose(0.5, 4.5, yaw)
    while math.dist(body.pose[:2], (0.5, 3.5)) > LIMITS.near:
        body.command = steer(body.pose, (0.5, 3.5), LIMITS)
        assert 0.0 <= body.command.ahead <= LIMITS.speed
        assert abs(body.command.turn) <= LIMITS.turn
        simulator.tick()
        assert simulator.seconds < move_seconds(1.0, LIMITS.speed, LIMITS.turn)
        assert abs(body.pose.x - 0.5) < 0.1
    assert body.bumps == 0


def test_walls_stop_a_body_and_time_stands_for_one_that_stands():
    simulator = BodySimulator(MetricMap(RUN), 1, 1, SURE)
    body = simulator.bodies[0]
    body.put(0.5, 4.5)
    body.command = Command(1.0, 0.0)
    body.pose = Pose(0.5, 4.5, math.pi)
    for _ in range(20):
        simulator.tick()
    assert body.pose.x == pytest.approx(0.2, abs=0.06) and body.bumps == 1
    assert body.odometry.x > 2.0  # its wheels turned all the same


def test_an_arc_is_a_circle():
    simulator = BodySimulator(MetricMap(RUN, 0.01), 1, 1, SURE, 0.05)
    body = simulator.bodies[0]
    body.put(1.0, 4.0)
    body.command = Command(0.5, 1.0)
    for _ in range(round(math.tau / 0.05)):
        simulator.tick()
    assert math.dist(body.pose[:2], (1.0, 4.0)) < 0.03


def test_noise_makes_odometry_drift_and_comes_from_the_seed():
    found = []
    for seed in (1, 1, 2):
        simulator = BodySimulator(MetricMap(RUN, 0.01), 2, seed, Noise(0.2, 0.01))
        body = simulator.bodies[1]
        body.put(1.0, 4.0)
        body.command = Command(0.3, 0.4)
        for _ in range(10):
            simulator.tick()
        found.append((body.pose, body.seen()))
        assert math.dist(body.pose[:2], body.odometry[:2]) > 1e-3
    assert found[0] == found[1] != found[2]


def test_each_wheel_has_a_size_of_its_own():
    """For good: a straight drive bends by it, far beyond what the noise of each tick adds."""
    wheels = 0.1
    ticks = 900
    ahead = 0.005
    bends = []
    for seed in range(8):
        metric_map = MetricMap(RUN)
        body = BodySimulator(metric_map, 1, seed, Noise(wheels, 0.0)).bodies[0]
        body.put(0.5, 4.5)
        body.command = Command(ahead, 0.0)
        for _ in range(ticks):
            body.tick(0.1)
        bends.append(body.pose.yaw * TRACK * metric_map.radius / (ahead * ticks * 0.1))
    expected = BIAS * wheels * math.sqrt(2)
    assert 0.5 * expected < np.sqrt(np.mean(np.square(bends))) < 2.0 * expected


def test_touches_are_counted_once_where_they_begin(metric_map):
    simulator = BodySimulator(metric_map, 2, 1, SURE)
    x, y = metric_map.place(0, DOOR)
    simulator.bodies[0].put(x, y)
    simulator.bodies[1].put(x + 0.5, y)
    for body, speed in zip(simulator.bodies, (0.0, -1.0), strict=True):
        body.command = Command(speed, 0.0)
    for _ in range(4):
        simulator.tick()
    simulator.put({1: CELLS[0, 0]})
    simulator.bodies[0].put(*metric_map.place(0, CELLS[0, 0]))
    simulator.tick()
    simulator.bodies[0].put(*metric_map.place(1, CELLS[0, 0]))
    simulator.tick()
    assert [touch.where for touch in simulator.touches] == [IN_DOORWAY, ELSEWHERE]


class Driver(CmdVelDriver):
    """A driver whose commands are returned beside its reports."""

    def __init__(self, metric_map, limits, robot):
        self.commands = []
        super().__init__(metric_map, limits, robot, self.commands.append)

    def both(self):
        self.commands.clear()
        reached = self.next(0.0)
        return (self.commands[-1] if self.commands else None), reached


def seen(driver, seconds, x, y, yaw=0.0):
    driver.sees(seconds, Pose(x, y, yaw))
    return driver.both()


def goals(start, end, number=1, *, place=False, since=-9.0):
    return Goals(number, 5, place, since, (BodyGoal(0, start, end),))


def test_a_driver_drives_stops_and_reports(metric_map):
    driver = Driver(metric_map, LIMITS, 0)
    driver.take(goals(CELLS[0, 0], CELLS[1, 0]))
    assert driver.both() == (None, None)  # no pose yet
    command, reached = seen(driver, 10.0, 0.7, 4.7)
    assert command.turn < 0 and reached is None and driver.busy
    assert driver.both() == (None, None)  # nothing new
    command, reached = seen(driver, 11.5, *metric_map.place(0, CELLS[1, 0]))
    assert command == (0.0, 0.0)
    assert reached == (0, 1, CELLS[1, 0], True, 1.5, 11.5)
    assert not driver.busy and seen(driver, 12.0, 0.0, 0.0) == (None, None)


@pytest.mark.parametrize(
    ("x", "y", "cell"),
    [(0.7, 4.6, (0, 0)), (0.7, 3.9, (1, 0)), (1.5, 4.5, (0, 1)), (50.0, 50.0, None)],
    ids=["stayed", "over the border", "drifted", "lost"],
)
def test_when_time_is_over_the_cell_of_the_pose_counts(metric_map, x, y, cell):
    driver = Driver(metric_map, LIMITS, 0)
    driver.take(goals(CELLS[0, 0], CELLS[1, 0]))
    seen(driver, 0.0, 0.7, 4.7)
    assert seen(driver, LIMITS.seconds - 0.1, x, y)[1] is None
    _, reached = seen(driver, LIMITS.seconds, x, y)
    assert (
        reached.cell == (NO_CELL if cell is None else CELLS[cell]) and not reached.there
    )


def test_a_driver_in_a_foreign_cell_goes_round_the_walls(metric_map):
    """The body is on the other side of the wall that the grid has it on."""
    simulator = BodySimulator(metric_map, 1, 1, SURE)
    body = simulator.bodies[0]
    goal = CELLS[0, 3]
    body.put(*metric_map.place(0, CELLS[0, 1]))
    driver = Driver(metric_map, Limits(0.5, 1.5, 0.05, 100.0), 0)
    driver.take(goals(CELLS[1, 3], goal))
    visited = set()
    reached = None
    while reached is None:
        command, reached = seen(driver, simulator.seconds, *body.pose)
        body.command = command
        simulator.tick()
        visited.add(metric_map.cell(*body.pose[:2]))
    assert reached.there and DOOR in visited and body.bumps == 0


def test_a_driver_off_its_line_goes_back_to_it_first(metric_map):
    driver = Driver(metric_map, LIMITS, 0)
    driver.take(goals(CELLS[0, 0], CELLS[1, 0]))
    command, _ = seen(driver, 0.0, 0.2, 4.7, yaw=0.0)
    assert command.turn > 0 and command.ahead > 0  # east and north first, not south


def test_what_is_no_pose_or_an_older_one_is_ignored(metric_map):
    driver = Driver(metric_map, LIMITS, 0)
    driver.sees(5.0, Pose(1.0, 1.0, 0.0))
    driver.sees(4.5, Pose(2.0, 2.0, 0.0))
    driver.sees(6.0, Pose(math.nan, 0.0, 0.0))
    assert driver.pose == (1.0, 1.0, 0.0)
    driver.sees(1.0, Pose(3.0, 3.0, 0.0))  # a new clock
    assert driver.pose == (3.0, 3.0, 0.0)


def test_on_a_new_clock_the_time_of_a_move_begins_anew(metric_map):
    driver = Driver(metric_map, LIMITS, 0)
    driver.take(goals(CELLS[0, 0], CELLS[1, 0]))
    assert seen(driver, 100.0, 0.7, 4.7)[1] is None
    assert seen(driver, 1.0, 0.7, 4.7)[1] is None
    assert seen(driver, 0.9 + LIMITS.seconds, 0.7, 4.7)[1] is None
    _, reached = seen(driver, 1.0 + LIMITS.seconds, 0.7, 4.7)
    assert reached.seconds == pytest.approx(LIMITS.seconds)


def test_placing_waits_for_whoever_does_it(metric_map):
    driver = Driver(metric_map, LIMITS, 0)
    driver.take(goals(CELLS[0, 0], CELLS[0, 0], place=True))
    for k in range(5):
        assert seen(driver, 100.0 * k, 4.5, 4.5) == (None, None)
    command, reached = seen(driver, 900.0, 0.6, 4.4)
    assert command is None and reached.there and reached.cell == CELLS[0, 0]


def test_in_step_time_passes_when_all_that_drive_are_told(metric_map):
    simulator = BodySimulator(metric_map, 2, 1, SURE)
    move = Command(0.1, 0.0)
    assert not simulator.told(0, move)  # too early: no goal, and forgotten
    assert simulator.send(goals(CELLS[0, 0], CELLS[1, 0])) and simulator.ticks == 1
    assert not simulator.send(goals(CELLS[0, 0], CELLS[1, 0]))  # the same again
    assert simulator.told(0, move) and simulator.ticks == 2
    assert simulator.send(
        Goals(2, 5, False, 0.0, (BodyGoal(0, 0, 1), BodyGoal(1, 4, 5)))
    )
    assert (
        not simulator.told(0, move) and simulator.told(1, move) and simulator.ticks == 4
    )
    assert not simulator.told(0, Command(0.0, 0.0)) and not simulator.told(1, move)
    # the other one need not wait
    assert simulator.reached(0, 2) and simulator.ticks == 5
    assert not simulator.reached(0, 1)


def test_a_driver_waits_for_a_pose_that_follows_its_goal(metric_map):
    """A pose that was under way when the goal was sent is of the time before."""
    driver = Driver(metric_map, LIMITS, 0)
    driver.sees(7.0, Pose(0.7, 4.7, 0.0))
    driver.take(goals(CELLS[0, 0], CELLS[1, 0], since=7.1))
    assert driver.both() == (None, None)
    assert seen(driver, 7.1, 0.7, 4.7) == (None, None)
    assert seen(driver, 7.2, 0.7, 4.7)[0] is not None
    driver.take(goals(CELLS[0, 0], CELLS[1, 0], number=3, since=7.2))
    assert [seen(driver, 7.2, 0.7, 4.7)[0] is not None for _ in range(6)].count(
        True
    ) == 1


def test_a_goal_overtakes_the_poses_of_a_long_drive_of_others(metric_map):
    """Else the body would be steered by where it was before, and by its luck in the queue."""
    driver = Driver(metric_map, LIMITS, 0)
    driver.sees(7.0, Pose(0.7, 4.7, 0.0))
    driver.take(goals(CELLS[0, 0], CELLS[1, 0], since=9.0))
    assert driver.both() == (None, None)
    for k in range(1, 21):
        assert seen(driver, 7.0 + k / 10, 0.7, 4.7) == (None, None)
    assert seen(driver, 9.1, 0.7, 4.7)[0] is not None


def test_after_more_poses_than_a_queue_holds_their_clock_is_another_one(metric_map):
    driver = Driver(metric_map, LIMITS, 0)
    driver.take(goals(CELLS[0, 0], CELLS[1, 0], since=99.0))
    said = [seen(driver, 3.0 + k / 10, 0.7, 4.7)[0] for k in range(22)]
    assert [command is not None for command in said] == [False] * 19 + [True] * 3
    driver.take(goals(CELLS[0, 0], CELLS[1, 0], number=2, since=99.0))
    assert seen(driver, 5.3, 0.7, 4.7)[0] is not None, "it is known by now"
    driver.take(goals(CELLS[0, 0], CELLS[1, 0], number=3, since=5.3))
    assert seen(driver, 5.3, 0.7, 4.7)[0] is None
    assert seen(driver, 5.4, 0.7, 4.7)[0] is not None
    driver.take(goals(CELLS[0, 0], CELLS[1, 0], number=4, since=99.0))
    assert seen(driver, 5.5, 0.7, 4.7)[0] is None, "the clocks have agreed since"


def test_a_clock_that_goes_back_is_another_one_at_once(metric_map):
    driver = Driver(metric_map, LIMITS, 0)
    driver.sees(99.0, Pose(0.7, 4.7, 0.0))
    driver.take(goals(CELLS[0, 0], CELLS[1, 0], since=99.0))
    assert seen(driver, 3.0, 0.7, 4.7)[0] is not None


def test_a_driver_says_again_what_a_body_that_stands_still_did_not_hear(metric_map):
    driver = Driver(metric_map, LIMITS, 0)
    driver.take(goals(CELLS[0, 0], CELLS[1, 0]))
    first = seen(driver, 7.2, 0.7, 4.7)
    said = [seen(driver, 7.2, 0.7, 4.7) for _ in range(8)]
    assert first[0] is not None
    assert [k for k, one in enumerate(said, 1) if one != (None, None)] == [4, 8]
    assert said[3] == said[7] == first
    ended = seen(driver, 7.3, *metric_map.place(0, CELLS[1, 0]))[1]
    said = [seen(driver, 7.3, *metric_map.place(0, CELLS[1, 0]))[1] for _ in range(4)]
    assert ended is not None and said == [None, None, None, ended]


def test_a_simulator_that_comes_back_goes_on_with_the_teams_time(metric_map):
    simulator = BodySimulator(metric_map, 2, 1, SURE)
    simulator.send(goals(CELLS[0, 0], CELLS[1, 0], number=70, since=42.0))
    assert simulator.seconds == pytest.approx(42.1)
    simulator.send(goals(CELLS[0, 0], CELLS[1, 0], number=71, since=41.0))
    assert simulator.seconds == pytest.approx(42.2)


def test_a_simulator_says_for_whom_it_stands_still(metric_map):
    simulator = BodySimulator(metric_map, 2, 1, SURE)
    assert simulator.waits_for == {0, 1}
    goals = [BodyGoal(k, CELLS[0, 0], CELLS[1, 0]) for k in (0, 1)]
    simulator.send(Goals(1, 1, False, 7.0, tuple(goals)))
    simulator.told(1, Command(0.1, 0.0))
    assert simulator.waits_for == {0}


def test_transforms_make_a_pose():
    tree = Tree()
    tree.hear("/map", "odom", Pose(1.0, 2.0, math.pi / 2), 3.0)
    tree.hear("odom", "base_footprint", Pose(1.0, 0.0, 0.0), 4.0)
    assert tree.find("map", "base_link") is None
    tree.hear("base_footprint", "base_link", Pose(0.0, 0.5, 0.0), None)
    seconds, pose = tree.find("map", "/base_link")
    assert seconds == 4.0 and pose == pytest.approx((0.5, 3.0, math.pi / 2))
    tree.hear("base_link", "map", Pose(0.0, 0.0, 0.0), 1.0)
    assert tree.find("nowhere", "base_link") is None  # round in a circle
    assert yaw_of(0.0, 0.0, math.sin(0.4), math.cos(0.4)) == pytest.approx(0.8)


def test_a_localisation_is_where_the_odometry_s_frame_is():
    tree = Tree()
    odometry = Pose(1.0, 2.0, 0.3)
    seen = Pose(-4.0, 7.0, 2.9)
    tree.hear("map", "odom", parent_of(seen, odometry), 5.0)
    tree.hear("odom", "base_link", odometry, 5.0)
    assert tree.find("map", "base_link")[1] == pytest.approx(seen)
    assert tree.way == ["base_link", "odom"]


@pytest.fixture(scope="module")
def team():
    run = make_run(load_scenario("env1", penalty=-100, steps=3000), {})
    return run, learn(run.scenario, "coop", 1)


def test_a_driven_team_does_what_the_evaluation_says(team):
    run, tables = team
    driven = drive(run, tables, episodes=12, seed=4, values=VALUES)
    grid = play(run.scenario, tables, trials=12, seed=4, learner="coop")
    assert np.array_equal(driven.times, grid.time_to_goal)
    assert np.array_equal(driven.arrived.all(axis=1), grid.arrived)
    assert np.array_equal(driven.asks, grid.asks)
    assert np.array_equal(driven.miscoordinations, grid.miscoordinations)
    driven_team = driven.team
    assert (
        driven_team.bodies.failed
        == driven_team.bodies.lost
        == driven_team.simulator.bumps
        == 0
    )
    assert (driven.in_doorways >= (driven.miscoordinations > 0)).all()
    assert (driven.seconds > driven.steps).all()


def test_driving_is_repeatable_and_seeded(team):
    run, tables = team
    runs = [
        drive(run, tables, episodes=3, seed=s, values=VALUES, followed=1)
        for s in (4, 4, 5)
    ]
    assert runs[0].team.path == runs[1].team.path != runs[2].team.path
    assert {moment.episode for moment in runs[0].team.path} == {0}


def test_bodies_without_time_stay_where_they_are(team):
    run, tables = team
    values = VALUES | {"step_seconds": 0.3, "slips": False}
    driven = drive(run, tables, episodes=1, seed=4, values=values)
    sent = driven.team.bodies
    assert sent.failed > 0.5 * driven.team.moves and sent.lost == 0


@pytest.mark.parametrize(
    "interactions",
    ["together", "together:any_doorway", "swap+block", "together+block:anywhere"],
)
def test_interactions_that_a_remedy_names_are_allowed(team, interactions):
    run, tables = team
    driven = drive(run, tables, episodes=1, seed=4, values=VALUES)
    scenario = load_scenario("env1", interactions=interactions)
    run = make_run(scenario, {})
    touched = replace(driven, elsewhere=np.array([1]))
    *_, sentence = remedies(run, touched)
    wanted = sentence.partition("interactions=")[2].rstrip(".")
    blocks = {kind: at for kind, at in scenario.kinds.items() if kind == "block"}
    kinds = {"together": "anywhere", "swap": "", **blocks}
    assert load_scenario("env1", interactions=wanted).kinds == kinds


@pytest.mark.parametrize(
    ("interactions", "remedy"),
    [
        ("together", "at a higher penalty, such as --set penalty=-200."),
        ("together:any_doorway+block", "at a higher penalty, such as --set"),
        ("swap", "let them learn with --set interactions=together+swap."),
        ("block", "which hold one robot each: take larger cells."),
        ("swap+block:anywhere", "which hold one robot each: take larger cells."),
    ],
)
def test_a_higher_penalty_is_a_remedy_only_where_it_is_paid(team, interactions, remedy):
    run, tables = team
    driven = drive(run, tables, episodes=1, seed=4, values=VALUES)
    run = make_run(load_scenario("env1", interactions=interactions), {})
    none = np.array([0])
    driven = replace(driven, in_doorways=np.array([1]), elsewhere=none)
    [sentence] = remedies(run, driven)
    assert remedy in sentence


@pytest.mark.long
def test_bodies_in_the_office_that_the_page_opens_with_do_not_touch():
    """Coordination clearly pays there, and the team learns it."""
    file = Path(__file__).parents[2] / "examples" / "office.yaml"
    chosen = yaml.safe_load(file.read_text())["import_map"]
    pairs = list(zip(chosen["start"], chosen["goal"], strict=True))
    plan = read_floor_plan(file)
    made = import_map(plan, cell=chosen["cell"], radius=chosen["radius"], robots=pairs)
    scenario, *_ = scenario_of(made, pairs, {})
    assert advice(scenario).kind == WILL_PAY
    learned = train(scenario, "voi", progress=False)
    run = make_run(scenario, {"learner": "voi"})
    driven = drive(run, learned.tables, episodes=100, seed=0, values=VALUES)
    assert driven.arrived.all()
    assert driven.team.simulator.touches == [] and driven.team.simulator.bumps == 0
