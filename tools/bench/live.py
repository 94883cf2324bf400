# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps a second of live runs, beside bare rclpy nodes that pass the same messages."""

import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.cli import live
from sparse_coord_ros.cli.options import format_table
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run import learn
from tools.bench import ceiling
from tools.bench.rates import in_turn, spread

SCENARIO = "env1"
TEAMS = (2, 4, 8, 16, 32)
"""Robots of the teams whose speed is measured, each on the same generated building."""

ONE = "one process"
MANY = "processes"
BARE = ", bare rclpy nodes"
LEARNING = ", learning"
RECORDING = ", learning and recording"


def ways(steps: int, repeats: int) -> str:
    """Return a table: steps a second of each way to run env1."""
    measured: dict[str, Callable[[], float]] = {
        "without ROS (train)": lambda: _simulated(steps),
        ONE + BARE: lambda: ceiling.one_process(steps),
        ONE + LEARNING: lambda: _live(steps, record=False),
        ONE + RECORDING: lambda: _live(steps, record=True),
        MANY + BARE: lambda: ceiling.separate_processes(steps),
        MANY + LEARNING: lambda: _live(steps, record=False, processes=True),
        MANY + RECORDING: lambda: _live(steps, record=True, processes=True),
    }
    rates = in_turn(measured, repeats)
    medians = {name: statistics.median(found) for name, found in rates.items()}
    rows = []
    for name, found in rates.items():
        bare = medians.get(name.split(",")[0] + BARE)
        rows.append(
            [
                name,
                *spread(found),
                percent(medians[name] / bare, whole=True) if bare else "-",
            ]
        )
    head = [
        f"{SCENARIO}, 2 robots",
        "steps/s",
        "range",
        "of bare nodes",
    ]
    return format_table(head, rows)


def teams(steps: int, repeats: int) -> str:
    """Return a table: steps a second of teams in one process, without recording."""
    ways = {robots: partial(_team, robots, steps // robots) for robots in TEAMS}
    rows = [
        [str(robots), *spread(found), f"{statistics.median(found) * robots:.0f}"]
        for robots, found in in_turn(ways, repeats).items()
    ]
    head = ["robots in one process, learning", "steps/s", "range", "agent-steps/s"]
    return format_table(head, rows)


def _team(robots: int, steps: int) -> float:
    return _live(max(100, steps), record=False, scenario=f"building-4x2x4-{robots}r-0")


def _simulated(steps: int) -> float:
    scenario = load_scenario(SCENARIO).with_settings({"steps": steps})
    started = time.perf_counter()
    learn(scenario, "coop", 0)
    return steps / (time.perf_counter() - started)


def _live(
    steps: int, *, record: bool, processes: bool = False, scenario: str = SCENARIO
) -> float:
    with tempfile.TemporaryDirectory(prefix="sparse_coord_bench_") as folder:
        values = {
            "scenario": scenario,
            "steps": steps,
            "out": str(Path(folder) / "run"),
            "record": record,
        }
        return live.run(values, processes=processes, quiet=True)["steps_per_second"]
