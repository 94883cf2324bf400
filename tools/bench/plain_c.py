# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learning runs of coop in plain C, with the package's bits: `coop.c`, compiled by `cc`."""

import ctypes
import shutil
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import sparse_coord_ros as sc
from sparse_coord_ros.core.game.schedules import probabilities, step_sizes

NUMBERS = ("seed", "steps", "max_steps", "cells")
MAP = ("next_cell", "doorway", "starts", "goals", "start_cells", "start_counts")
SCHEDULES = ("epsilon", "floors", "exploring", "step_sizes")
REWARDS = (
    "penalty",
    "goal_reward",
    "ask_cost",
    "move_success",
    "discount",
    "goal_value",
)
TABLES = ("q_star", "q_coord", "updates", "coord_updates")


class _Run(ctypes.Structure):
    """The arguments of a run, in the order of `Run` in coop.c."""

    _fields_ = [
        *[(name, ctypes.c_int64) for name in NUMBERS],
        *[(name, ctypes.c_void_p) for name in (*MAP, *SCHEDULES)],
        *[(name, ctypes.c_double) for name in REWARDS],
        *[(name, ctypes.c_void_p) for name in TABLES],
    ]


def has_compiler() -> bool:
    """Return whether this machine has a C compiler."""
    return shutil.which("cc") is not None


def compiled(folder: Path) -> ctypes.CDLL:
    """Return the library, compiled into a folder.

    Contracted operations (a fused multiply and add) would change bits.
    """
    library = folder / "coop.so"
    source = Path(__file__).with_name("coop.c")
    options = ["-O3", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run(["cc", *options, "-o", library, source], check=True)
    return ctypes.CDLL(str(library))


def learn(
    library: ctypes.CDLL, scenario: sc.Scenario, seed: int
) -> dict[str, np.ndarray]:
    """Return the tables that two robots learn by coop.

    Args:
        library: from `compiled`.
        scenario: a scenario of two robots with perception `always` and interactions `together`.
        seed: the run's seed.

    Returns:
        q_star [k][x][action], q_coord [k][x][z][move], and how often each entry was updated.
    """
    arrays = _arrays(scenario)
    values = {name: getattr(scenario, name) for name in REWARDS}
    run = _Run(
        seed=seed,
        steps=scenario.steps,
        max_steps=scenario.max_steps,
        cells=len(scenario.map.cells),
        **values,
        **{name: array.ctypes.data for name, array in arrays.items()},
    )
    library.learn(ctypes.byref(run))
    return {name: arrays[name] for name in TABLES}


def _arrays(scenario: sc.Scenario) -> dict[str, np.ndarray]:
    grid = scenario.map
    cells = len(grid.cells)
    start_cells = np.zeros((2, cells), dtype=np.int64)
    start_counts = np.zeros(2, dtype=np.int64)
    for k, robot in enumerate(scenario.robots):
        free = grid.leading_to(robot.goal)
        start_counts[k] = len(free)
        start_cells[k, : len(free)] = free
    doorway = np.zeros(cells, dtype=np.int64)
    doorway[list(grid.doorways)] = 1
    sizes = step_sizes(scenario.step_size, scenario.steps)
    return {
        "next_cell": np.ascontiguousarray(grid.next_cell, dtype=np.int64),
        "doorway": doorway,
        "starts": np.array([robot.start for robot in scenario.robots]),
        "goals": np.array([robot.goal for robot in scenario.robots]),
        "start_cells": start_cells,
        "start_counts": start_counts,
        "epsilon": probabilities(scenario.epsilon, scenario.steps),
        "floors": sizes.by_step,
        "exploring": probabilities(scenario.starts, scenario.steps),
        "step_sizes": sizes.by_count,
        "q_star": np.full((2, cells, 5), scenario.q_star_init),
        "q_coord": np.full((2, cells, cells, 4), scenario.q_coord_init),
        "updates": np.zeros((2, cells, 5), dtype=np.int32),
        "coord_updates": np.zeros((2, cells, cells, 4), dtype=np.int32),
    }


def line(repeats: int, runs: int = 10, steps: int = 100_000) -> str:
    """Return a line with the agent-steps a processor second on env1, a median."""
    if not has_compiler():
        return "coop in plain C: not measured, there is no cc"
    scenario = sc.load_scenario("env1", steps=steps)
    rates = []
    with tempfile.TemporaryDirectory() as folder:
        library = compiled(Path(folder))
        for _ in range(repeats):
            started = time.process_time()
            for seed in range(runs):
                learn(library, scenario, seed)
            seconds = time.process_time() - started
            rates.append(runs * steps * len(scenario.robots) / seconds / 1e6)
    return f"coop in plain C: {statistics.median(rates):.4g} M agent-steps/s"
