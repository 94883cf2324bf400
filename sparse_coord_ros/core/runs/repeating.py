# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command that computes a run again."""

import shlex
from contextlib import suppress

from sparse_coord_ros.base.errors import SparseCoordError
from sparse_coord_ros.core.game.scenario import SETTINGS, Scenario, load_scenario
from sparse_coord_ros.core.runs.run_config import RunConfig


def repeating_command(run: RunConfig) -> str | None:
    """Return the command that computes a run again; None: real bodies made its moves.

    Settings that the scenario has anyway are left out. A scenario that this package does not ship
    is named as its file.
    """
    if run.bodies:
        return None
    shipped = _shipped(run.scenario)
    words = ["sparse_coord", "run" if run.tables else "train"]
    words.append(run.scenario.name if shipped else f"{run.scenario.name}.yaml")
    if shipped:
        words += _moved(run.scenario, shipped)
    words += ["--learner", run.learner, "--seed", str(run.seed)]
    if run.tables:
        words += ["--tables", run.tables]
    if run.greedy:
        words.append("--greedy")
    usual = SETTINGS.defaults()
    for name in SETTINGS:
        value = getattr(run.scenario, name)
        known = getattr(shipped, name) if shipped else usual[name]
        if value != known:
            words += ["--set", f"{name}={value}"]
    return shlex.join(words)


def _moved(scenario: Scenario, shipped: Scenario) -> list[str]:
    """Return the options for starts and goals that are not the shipped scenario's."""
    words = []
    for robot, known in zip(scenario.robots, shipped.robots, strict=True):
        for option, cell, usual in (
            ("--start", robot.start, known.start),
            ("--goal", robot.goal, known.goal),
        ):
            if cell != usual:
                row, column = scenario.map.cells[cell]
                words += [option, f"{robot.name}={row},{column}"]
    return words


def _shipped(scenario: Scenario) -> Scenario | None:
    """Return the scenario of this name, if it has the same map and names of robots."""
    with suppress(SparseCoordError):
        known = load_scenario(scenario.name)
        if (known.map, known.names) == (scenario.map, scenario.names):
            return known
    return None
