# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checks whether a robot of the learner `core.learners.factored` can have learned a memory."""

import numpy as np

from sparse_coord_ros.base.npz import MOST_UPDATES, check_range
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.settings import LARGEST_WHOLE
from sparse_coord_ros.core.learners.mind import Memory
from sparse_coord_ros.core.learners.own_moves import LEAST_VALUE_SHARE
from sparse_coord_ros.core.learners.rules import NOT_PERCEIVED, map_samples


def check_factored_memory(
    scenario: Scenario, robot: int, memory: Memory, weight: float
) -> None:
    """Raise `ValueError` unless a robot can have learned this memory.

    Args:
        scenario: the problem.
        robot: the robot, from 0.
        memory: its memory; types, shapes and counts are right already.
        weight: how often r^C counts.
    """
    cells = len(scenario.map.cells)
    _check_prior(scenario, memory)
    _check_common(scenario, robot, memory, weight)
    _check_value(memory)
    _check_counts(memory, map_samples(scenario))
    _check_successor(memory, cells)
    _check_last(memory["last"], robot, cells)
    check_range(memory["asked"], 0, LARGEST_WHOLE, "asked")
    check_range(memory["asked"][1:], 0, cells, "asked")


def _check_prior(scenario: Scenario, memory: Memory) -> None:
    """Check that the robot knew as much of its map as robots of the scenario do.

    A robot that knows its map counts all moves as tried from the beginning, in their order.
    """
    tried = memory["tried"]
    prior = "map" if np.array_equal(tried, np.arange(len(tried))) else "none"
    if prior != scenario.prior:
        raise ValueError(
            f"learned with prior={prior}, this scenario has prior={scenario.prior}; set "
            f"prior={prior}"
        )


def _check_common(
    scenario: Scenario, robot: int, memory: Memory, weight: float
) -> None:
    """Check the r^C that was felt in cells and passages."""
    felt = weight * scenario.penalties[robot]
    for name in ("door", "passage"):
        if not np.isin(memory[name], [0.0, felt]).all():
            raise ValueError(f"{name} has an r^C that is neither 0 nor {felt:g}")


def _check_value(memory: Memory) -> None:
    """Check that `value` is the maximum of Q*, or the least value of a cell."""
    best = memory["q_star"].max(axis=1)
    kept = np.maximum(best, LEAST_VALUE_SHARE * memory["alone"].max(axis=1))
    value = memory["value"]
    if ((value != best) & (value != kept)).any():
        raise ValueError("value is not the maximum of q_star")


def _check_counts(memory: Memory, samples: int) -> None:
    """Check the counts of moves, and the list of those that were tried.

    Args:
        memory: the memory.
        samples: for how many samples of each move the map counts.
    """
    made = memory["updates"][:, :PRIMITIVES]
    modelled = made + samples
    for name, most in (("commons", made), ("moved", modelled)):
        check_range(memory[name], 0, MOST_UPDATES, name)
        if (memory[name] > most).any():
            raise ValueError(f"{name} counts a move more often than it was tried")
    check_range(memory["used"], 0, len(memory["tried"]) + 1, "used")
    used = int(memory["used"][0])
    tried = np.sort(memory["tried"][:used])
    known = np.array_equal(tried, np.flatnonzero(modelled))
    if not known or memory["tried"][used:].any():
        raise ValueError("tried are not the moves that were counted")


def _check_successor(memory: Memory, cells: int) -> None:
    """Check that a move has a successor, another cell, just if it ever led out of its cell."""
    successor = memory["successor"]
    left = memory["moved"] > 0
    check_range(successor, 0, cells, "successor")
    itself = successor == np.arange(cells)[:, None]
    if successor[~left].any() or itself[left].any():
        raise ValueError(
            "successor is not another cell just where a move led out of its own"
        )


def _check_last(last: np.ndarray, robot: int, cells: int) -> None:
    """Check the memory of the last step with COORDINATE."""
    step, move, *_ = last
    peers = np.delete(last[2:], robot)
    failed = bool(np.all(peers == NOT_PERCEIVED))
    check_range(step, 0, LARGEST_WHOLE, "last")
    check_range(move, 0, PRIMITIVES, "last")
    check_range(last[2 + robot], 0, cells, "last")
    check_range(peers, NOT_PERCEIVED if failed else 0, cells, "last")
