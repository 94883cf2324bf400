# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The best asking team found, in words: each robot's route, and where it asks."""

from collections.abc import Sequence

import numpy as np

from sparse_coord_ros.core.game.actions import ACTIONS, PRIMITIVES
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.solve import asking_loops
from sparse_coord_ros.core.solve.asking_loops import AskingPolicies
from sparse_coord_ros.core.solve.asking_search import (
    game_of,
    policies_of,
    workspace_of,
)
from sparse_coord_ros.core.solve.shipped import RobotPolicy


def in_words(scenario: Scenario, robots: Sequence[RobotPolicy]) -> list[str]:
    """Return the team's behaviour in words: a line for each route and each cell to ask in.

    After a robot's route come the cells that it gets to only by stepping aside.
    """
    policy, visited, seen = _acting(scenario, robots)
    lines = []
    for k, robot in enumerate(scenario.robots):
        usual = _usual_moves(policy, k, seen[k])
        way = _way(scenario, robot.start, robot.goal, usual)
        lines.append(f"{robot.name}: {_route(scenario, way, usual, robot.goal)}")
        for x, peer_cells in sorted(seen[k].items()):
            lines.append(_asking(scenario, policy, k, x, peer_cells, int(usual[x])))
        aside = [x for x in np.flatnonzero(visited[k]).tolist() if x not in way]
        if aside:
            moves = [f"{_place(scenario, x)} {ACTIONS[usual[x]]}" for x in aside]
            lines.append(f"  off its way: {', '.join(moves)}")
    return lines


def _acting(
    scenario: Scenario, robots: Sequence[RobotPolicy]
) -> tuple[AskingPolicies, np.ndarray, list[dict[int, list[int]]]]:
    """Return a team's choices in the states that it gets to.

    Returns:
        Its choices; whether a robot acts in a cell, shape (2, cells); and of each robot, the
        peer's cells that it can perceive in each cell where it asks.
    """
    team = policies_of(scenario, robots)
    game = game_of(scenario)
    space = workspace_of(game)
    cells = len(scenario.map.cells)
    count = asking_loops.visit(game, team, space)
    seen: list[dict[int, list[int]]] = [{}, {}]
    for state in np.sort(space.order[:count]):
        here = (int(state // cells), int(state % cells))
        for k in range(2):
            x = here[k]
            z = here[1 - k]
            if x != game.goals[k] and team.asks[k, x] and game.percept[x, z] > 0.0:
                seen[k].setdefault(x, []).append(z)
    return team, space.visited, seen


def _usual_moves(
    policy: AskingPolicies, k: int, seen: dict[int, list[int]]
) -> np.ndarray:
    """Return robot k's move in each cell: its most frequent one where it asks."""
    usual: np.ndarray = policy.moves[k].copy()
    for x, peer_cells in seen.items():
        moves = policy.seen[k, x, peer_cells]
        usual[x] = np.bincount(moves, minlength=PRIMITIVES).argmax()
    return usual


def _asking(
    scenario: Scenario,
    policy: AskingPolicies,
    k: int,
    x: int,
    peer_cells: list[int],
    usual: int,
) -> str:
    """Return robot k's moves after asking in cell x, in words: the usual one first."""
    peer = scenario.robots[1 - k].name
    text = f"  asks in {_place(scenario, x)}: {ACTIONS[usual]}"
    for move in range(PRIMITIVES):
        where = [z for z in peer_cells if policy.seen[k, x, z] == move]
        if move != usual and where:
            places = ", ".join(_place(scenario, z) for z in where)
            text += f"; {ACTIONS[move]} where {peer} is in {places}"
    return text


def _way(scenario: Scenario, start: int, goal: int, moves: np.ndarray) -> list[int]:
    way = [start]
    while way[-1] != goal:
        x = int(scenario.map.next_cell[way[-1], moves[way[-1]]])
        if x in way:
            break
        way.append(x)
    return way


def _route(scenario: Scenario, way: list[int], moves: np.ndarray, goal: int) -> str:
    """Return a way in words: its corners, and the moves between them."""
    text = _place(scenario, way[0])
    for here, there in zip(way, way[1:], strict=False):
        if there == way[-1] or moves[there] != moves[here]:
            text += f" {ACTIONS[moves[here]]} to {_place(scenario, there)}"
    return text if way[-1] == goal else f"{text}, and no further"


def _place(scenario: Scenario, cell: int) -> str:
    row, column = scenario.map.cells[cell]
    return f"({row}, {column})"
