# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learned teams driven through the simulator of bodies, without ROS, for counts of episodes.

World, drivers and bodies are the same state machines as in the nodes, in step.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.core.game.draws import EVALUATION
from sparse_coord_ros.core.game.grid import CLEAR
from sparse_coord_ros.core.game.settings import SettingTable, tables_from_yaml
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.evaluation import greedy_team
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS, RunConfig
from sparse_coord_ros.lab.driving.body_simulator import (
    ELSEWHERE,
    IN_DOORWAY,
    BodySimulator,
)
from sparse_coord_ros.lab.driving.cmd_vel_driver import CmdVelDriver
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.steering import Command, Limits, move_seconds
from sparse_coord_ros.protocol.lockstep.bodies import BodiesSide, BodyWorld, Goals

_TABLES = tables_from_yaml(Path(__file__).with_name("settings.yaml"))
DRIVER_SETTINGS = _TABLES["driver"]
"""Settings of a driver for its robot's body."""

NAV2_SETTINGS = _TABLES["nav2_driver"]
"""Settings of a driver that leaves the steering to Nav2."""

DRIVE_SETTINGS = SettingTable([*DRIVER_SETTINGS.values(), RUN_SETTINGS["slips"]])
"""All settings of `drive` for bodies."""


def limits_of(values: dict, side: float) -> Limits:
    """Return the limits of a body.

    Args:
        values: `DRIVER_SETTINGS`.
        side: metres a cell.
    """
    seconds = values["step_seconds"] or move_seconds(
        side, values["speed"], values["turn"]
    )
    return Limits(values["speed"], values["turn"], values["near"] * side, seconds)


class Moment(NamedTuple):
    """The places of all bodies at a time.

    Attributes:
        episode: number of the episode, from 0.
        seconds: the simulated time.
        places: (x, y) of each body, in metres.
    """

    episode: int
    seconds: float
    places: tuple[tuple[float, float], ...]


class DrivenTeam:
    """World, drivers and bodies in one process.

    Args:
        run: the run.
        values: `DRIVER_SETTINGS`, typed.
        seed: of the bodies' noise.
        world: the game.

    Attributes:
        bodies: sends the bodies' goals.
        simulator: simulates the bodies.
        drivers: one a robot.
        moves: number of moves that bodies were sent on.
        followed: the episode whose path is kept; None: none.
        path: where the bodies were at each tick of such episodes.
    """

    def __init__(
        self, run: RunConfig, values: dict, seed: int, world: BodyWorld
    ) -> None:
        self.bodies = BodiesSide(world, self.send)
        count = len(run.scenario.robots)
        metric_map = MetricMap(run, values["radius"])
        self.simulator = BodySimulator(metric_map, count, seed)
        limits = limits_of(values, metric_map.side)
        self._command: Command | None = None
        self.drivers = [
            CmdVelDriver(metric_map, limits, k, self._note) for k in range(count)
        ]
        self.moves = 0
        self.followed: int | None = None
        self.path: list[Moment] = []
        self._goals: list[Goals] = []

    def send(self, goals: Goals) -> None:
        """Take in the bodies' goals."""
        self._goals.append(goals)
        self.moves += 0 if goals.placing else len(goals.bodies)

    def drive(self) -> None:
        """Let the bodies drive until all are there."""
        while self._goals:
            goals = self._goals.pop(0)
            if self.simulator.send(goals):
                self._look()
            for driver in self.drivers:
                driver.take(goals)
            while self._answer():
                pass

    def _answer(self) -> bool:
        """Ask each driver once; return whether one of them did anything."""
        did = False
        for k, driver in enumerate(self.drivers):
            self._command = None
            reached = driver.next(self.simulator.seconds)
            command = self._command
            if reached is not None:
                ticked = self.simulator.reached(k, reached.number)
                self.bodies.reached(reached)
            else:
                ticked = command is not None and self.simulator.told(k, command)
            if ticked:
                self._look()
                if self.followed is not None:
                    places = tuple(body.pose[:2] for body in self.simulator.bodies)
                    self.path.append(
                        Moment(self.followed, self.simulator.seconds, places)
                    )
            did |= command is not None or reached is not None
        return did

    def _note(self, command: Command) -> None:
        self._command = command

    def _look(self) -> None:
        for body, driver in zip(self.simulator.bodies, self.drivers, strict=True):
            driver.sees(self.simulator.seconds, body.seen())


@dataclass
class Drive:
    """Results of driven episodes; E episodes of K robots.

    Attributes:
        team: counts over all episodes.
        steps: time steps of each episode, shape (E,).
        seconds: simulated seconds of each episode, shape (E,).
        arrived: whether each robot arrived within the horizon, shape (E, K).
        times: steps until it arrived; the horizon where it did not; shape (E, K).
        miscoordinations: steps that ended with two robots in one doorway, shape (E,).
        in_doorways, elsewhere: how often bodies began to touch each other there, shape (E,).
        asks: how often robots chose COORDINATE, shape (E, K).
        drift: metres between odometry and body at each episode's end, shape (E, K).
    """

    team: DrivenTeam
    steps: np.ndarray
    seconds: np.ndarray
    arrived: np.ndarray
    times: np.ndarray
    miscoordinations: np.ndarray
    in_doorways: np.ndarray
    elsewhere: np.ndarray
    asks: np.ndarray
    drift: np.ndarray


def drive(
    run: RunConfig,
    tables: Sequence[Tables],
    *,
    episodes: int,
    seed: int,
    values: dict,
    followed: int = 0,
    progress: Callable[[int], None] = lambda done: None,
) -> Drive:
    """Drive a learned team through greedy episodes from the scenario's starts.

    Args:
        run: the run that learned them.
        tables: the tables of every robot.
        episodes: how many, one at least.
        seed: of every draw: the team's and the grid's as in an evaluation, and the bodies'.
        values: `DRIVE_SETTINGS`, typed.
        followed: of so many episodes, the first ones, the path is kept.
        progress: called with the number of episodes that are done.

    Raises:
        SparseCoordError: tables that do not fit, bodies that do not fit.
    """
    scenario = run.scenario
    team = greedy_team(scenario, tables, seed, run.learner)
    horizon = scenario.horizon
    slips = values["slips"]
    world = BodyWorld(scenario, seed, slips=slips, phase=EVALUATION, max_steps=horizon)
    driven_team = DrivenTeam(run, values, seed, world)
    simulator = driven_team.simulator
    sent = driven_team.bodies
    rows: list[tuple[Any, ...]] = []
    for episode in range(episodes):
        team.begin_episode(world)
        driven_team.followed = episode if episode < followed else None
        touched = len(simulator.touches)
        before = sent.seconds
        times = np.full(len(tables), horizon)
        asks = np.zeros(len(tables), dtype=np.int64)
        steps = miscoordinations = 0
        while not world.episode_over:
            actions = team.act(world)
            while not sent.made(actions):
                driven_team.drive()
            outcome = world.advance(actions)
            steps += 1
            miscoordinations += outcome.miscoordination
            asks += [action is not None and action.asked for action in actions]
            times[list(outcome.arrived)] = steps
        seconds = sent.seconds - before
        arrived = list(world.arrived)
        places = [touch.where for touch in simulator.touches[touched:]]
        touches = places.count(IN_DOORWAY), places.count(ELSEWHERE)
        drift = [
            math.dist(body.pose[:2], body.odometry[:2]) for body in simulator.bodies
        ]
        rows.append(
            (steps, seconds, arrived, times, miscoordinations, *touches, asks, drift)
        )
        progress(episode + 1)
    # in the order of its fields
    return Drive(driven_team, *map(np.array, zip(*rows, strict=True)))


def remedies(run: RunConfig, driven: Drive) -> list[str]:
    """Return a sentence for each kind of touch, with what helps."""
    sentences = []
    if driven.team.simulator.bumps:
        radius = driven.team.simulator.metric_map.radius
        sentences.append(
            f"Bodies of radius {radius:g} m touched walls: cells of {run.resolution:g} m "
            f"leave {run.resolution / 2 - radius:.2g} m on each side; take cells of "
            f"{radius / (0.5 - CLEAR):.2g} m or more."
        )
    if driven.in_doorways.any():
        sentences.append(_remedy_in_doorways(run))
    if driven.elsewhere.any():
        sentences.append(_remedy_elsewhere(run))
    return sentences


def _remedy_in_doorways(run: RunConfig) -> str:
    """Return a sentence on bodies that touched in doorways."""
    what = "Bodies touched in doorways"
    kinds = run.scenario.kinds
    if "together" in kinds:
        return (
            f"{what}: let the team learn longer, or at a higher penalty, such as --set "
            f"penalty={2 * run.scenario.penalty:g}."
        )
    if "block" in kinds:
        return f"{what}, which hold one robot each: take larger cells."
    wanted = f"together+{run.scenario.interactions}"
    return (
        f"{what}, where robots may be together: let them learn with --set "
        f"interactions={wanted}."
    )


def _remedy_elsewhere(run: RunConfig) -> str:
    """Return a sentence on bodies that touched outside of doorways."""
    what = "Bodies touched outside of doorways"
    kinds = run.scenario.interactions.split("+")
    if {"together:anywhere", "swap"} <= set(kinds):
        return f"{what}: let the team learn longer, or take larger cells."
    blocks = [kind for kind in kinds if kind.startswith("block")]
    wanted = "+".join(["together:anywhere", "swap", *blocks])
    return (
        f"{what}, where robots may share and exchange cells: let them learn with "
        f"--set interactions={wanted}."
    )
