# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learn, exchange, improve: a team plans on its robots' learned models.

After learning each robot says once what it knows: where its moves led and how often, its doorways
(cells where it felt r^C), its tables. From that all compute the same: a game as the team knows it,
and a climb of the *team's* value in it, from the policies learned, by changes of what one robot
does in one cell. Of two robots the value is exact, and the climb is that of
`core.solve.asking_search`; of more it is that of trials with the same draws. The paper has no such
exchange, and this is planning, on a learned model: doorways that no robot has felt are not in it.
It knows robots that are together, in doorways or anywhere; with swap, block or help it is refused.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.game.interactions import NOWHERE
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.specs import Spec
from sparse_coord_ros.core.learners.corrections import key_of, states_of
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.memory import check_memory
from sparse_coord_ros.core.learners.mind import Memory, learned_rows, memory_of, row_of
from sparse_coord_ros.core.learners.policy import asks_surely
from sparse_coord_ros.core.learners.registry import check_improvable
from sparse_coord_ros.core.learners.rules import NOT_PERCEIVED
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.run_config import RUN_FILE, RunConfig, create_output
from sparse_coord_ros.core.runs.tables import save_team
from sparse_coord_ros.core.runs.team import Team
from sparse_coord_ros.core.runs.trials import Trials
from sparse_coord_ros.core.solve.asking_loops import AskingPolicies
from sparse_coord_ros.core.solve.asking_search import climbed
from sparse_coord_ros.core.solve.exact import MOST_ROBOTS
from sparse_coord_ros.core.solve.routes import alone, passages

IMPROVED = "improved"
"""Folder in a run's directory for what the team made of what it learned."""

LEAD = 1.0
LEAD_SHARE = 0.5
"""How much more than any other the action is worth that an improved table says, and by which share
of its value: so much that no robot leaves a stand-off that was planned."""

PLAN_TRIALS = 2000
FIRST_TRIALS = 200
"""Trials by which more robots are judged; trials after which most changes are given up."""

GAIN_ERRORS = 2.0
"""Standard errors that a change has to be better by."""


@dataclass(frozen=True)
class Improvement:
    """The result of planning on a team's learned model.

    Attributes:
        tables: of each robot: what it learned, but for its factors r_bar, W and rho where it acts:
            they are so low that greedy reading gives the improved policy.
        before: value of the learned team on the learned model, averaged over the robots.
        value: value of the improved team there.
        doorways: cells where a robot has felt r^C; the plan knows no others.
    """

    tables: tuple[Tables, ...]
    before: float
    value: float
    doorways: tuple[int, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class LearnedMap(GridMap):
    """A map as a team knows it.

    Attributes:
        lead: where a successful move leads; the cell itself where none ever led out of it.
        felt: cells where a robot has felt r^C.
    """

    lead: np.ndarray
    felt: frozenset[int]

    @property
    def next_cell(self) -> np.ndarray:
        """As of `GridMap`."""
        return self.lead

    @property
    def doorways(self) -> frozenset[int]:
        """As of `GridMap`."""
        return self.felt


def improve(
    scenario: Scenario, learner: Learner, memories: Sequence[Memory]
) -> Improvement:
    """Return the team's plan from its knowledge; the same bits for each robot.

    Of the scenario it takes what a robot knows before it learns: starts and goals, discount, cost
    of asking, the percept model; of the map nothing but where cells lie.

    Args:
        scenario: the problem.
        learner: the learner.
        memories: each robot's memory.

    Raises:
        SettingError: the robots do not learn the model that it needs.
        TablesError: what they remember is not of this scenario.
    """
    check_improvable(scenario, learner)
    for k, memory in enumerate(memories):
        check_memory(scenario, learner, k, memory)
    learned = learned_scenario(scenario, learner, memories)
    if len(memories) == MOST_ROBOTS and not scenario.sparse:
        before, value, found = _of_a_pair(learned, learner, memories)
    else:
        before, value, found = _by_trials(learned, learner, memories)
    tables = tuple(
        Tables(scenario, learner, k, memory) for k, memory in enumerate(found)
    )
    return Improvement(tables, before, value, tuple(sorted(learned.map.doorways)))


def save_improved(directory: Path, run: RunConfig, found: Improvement) -> Path:
    """Write the improved team as a run's directory within the run's directory.

    Raises:
        RunError: it exists already.
        OSError: it cannot be written.
    """
    folder = create_output(directory / IMPROVED)
    write_whole(folder / RUN_FILE, run.to_yaml())
    save_team(folder, [table.memory for table in found.tables])
    return folder


def learned_scenario(
    scenario: Scenario, learner: Learner, memories: Sequence[Memory]
) -> Scenario:
    """Return the game as the team knows it; arguments as of `improve`.

    r^C of each robot is the mean that it was paid. If the robots know their map (`prior: map`)
    the moves are those of the map.
    """
    lead, success = _learned_moves(memories)
    if scenario.prior == "map":
        lead = scenario.map.next_cell
        success = scenario.known_success
    door = np.array([memory["door"] for memory in memories])
    # Together anywhere is, as far as the team knows, together where it felt r^C.
    interactions = scenario.interactions
    if interactions == "together:anywhere":
        interactions = "together"
    felt = door.sum(axis=1) / np.maximum(1, (door != 0.0).sum(axis=1))
    paid = felt / (learner.weights(scenario).common or 1.0)
    same = {field.name: getattr(scenario.map, field.name) for field in fields(GridMap)}
    return replace(
        scenario,
        map=LearnedMap(
            **same,
            lead=lead,
            felt=frozenset(np.flatnonzero(door.any(axis=0)).tolist()),
        ),
        move_success=success,
        interactions=interactions,
        penalty=-1.0,
        common_reward=Spec("each", tuple((-paid).tolist())),
    )


def _learned_moves(memories: Sequence[Memory]) -> tuple[np.ndarray, float]:
    """Return the learned successors of moves, (cells, moves), and their success rate.

    The robot that made a move most often says where it leads. Moves succeed as often as those did
    that ever led anywhere; the others are walls.
    """
    updates = np.array([memory["updates"] for memory in memories])
    tried = updates[:, :, :PRIMITIVES].sum(axis=0)
    moved = np.array([memory["moved"] for memory in memories])
    successor = np.array([memory["successor"] for memory in memories])
    most = moved.argmax(axis=0)[None]
    leads = moved.any(axis=0)
    there = np.take_along_axis(successor, most, 0)[0]
    cells = np.arange(len(tried))
    success = float(moved.sum() / max(1, tried[leads].sum()))
    return np.where(leads, there, cells[:, None]), success


def _of_a_pair(
    learned: Scenario, learner: Learner, memories: Sequence[Memory]
) -> tuple[float, float, list[Memory]]:
    """Climb by exact values; return the value before and after, and the new memories."""
    team = _policies_learned(learned, learner, memories)
    before, value, better, visited = climbed(learned, team)
    improved = [
        _following(learned, learner, k, memory, better, visited[k])
        for k, memory in enumerate(memories)
    ]
    return before, value, improved


def _policies_learned(
    learned: Scenario, learner: Learner, memories: Sequence[Memory]
) -> AskingPolicies:
    """Return the greedy policies of a pair."""
    tables = [Tables(learned, learner, k, memory) for k, memory in enumerate(memories)]
    cells = range(len(learned.map.cells))
    asks = np.array([asks_surely(table.q_star.T) for table in tables])
    best = np.array([table.q_star[:, :PRIMITIVES].argmax(axis=1) for table in tables])
    unseen = [[table.values_asking(x, 0, ()) for x in cells] for table in tables]
    moves = np.where(asks, np.argmax(unseen, axis=2), best)
    seen = np.array([np.argmax(np.asarray(table.q_coord), axis=-1) for table in tables])
    return AskingPolicies(moves, asks, seen)


def _following(
    learned: Scenario,
    learner: Learner,
    k: int,
    memory: Memory,
    team: AskingPolicies,
    visited: np.ndarray,
) -> Memory:
    """Return the memory of robot k that acts by the policy of a pair.

    Args:
        learned: the game as the team knows it.
        learner: the learner.
        k: the robot, from 0.
        memory: its memory.
        team: the policies.
        visited: whether the robot acts in a cell, shape (cells,).
    """
    star = memory["q_star"].copy()
    chosen = np.where(team.asks[k], COORDINATE, team.moves[k])
    for x in np.flatnonzero(visited).tolist():
        star[x] = preferring(star[x], chosen[x])
    after: dict[tuple[int, int, int], int] = {}
    for x in np.flatnonzero(team.asks[k]).tolist():
        for z in range(len(learned.map.cells)):
            after[x, 1 - k, z] = team.seen[k, x, z]
        after[x, NOT_PERCEIVED, NOT_PERCEIVED] = team.moves[k, x]
    return _acting(learned, learner, memory, star, after)


def _by_trials(
    learned: Scenario, learner: Learner, memories: Sequence[Memory]
) -> tuple[float, float, list[Memory]]:
    """Climb from the learned team and from `one_at_a_time`; return the better, as `_of_a_pair`."""
    starts = memories, one_at_a_time(learned, learner, memories)
    climbs = [_climb(learned, learner, start) for start in starts]
    _, value, improved = max(climbs, key=lambda climb: climb[1])
    return climbs[0][0], value, improved


def one_at_a_time(
    learned: Scenario, learner: Learner, memories: Sequence[Memory]
) -> list[Memory]:
    """Return the memories of robots that take turns, each on its shortest path.

    Doorways side by side are a passage. A robot whose next move enters a passage asks first, and
    makes way if it perceives a peer inside, or a peer of lower number in front of it.
    """
    passage = passages(learned)
    routes = _on_routes(learned, [()] * len(memories))
    return [
        _taking_turns(learned, learner, k, memory, routes[k], passage)
        for k, memory in enumerate(memories)
    ]


def _taking_turns(
    learned: Scenario,
    learner: Learner,
    k: int,
    memory: Memory,
    u: np.ndarray,
    passage: np.ndarray,
) -> Memory:
    """Return the memory of one robot of `one_at_a_time`.

    Args:
        learned: the game as the team knows it.
        learner: the learner.
        k: the robot, from 0.
        memory: its memory.
        u: its U on the shortest path, [cell, move].
        passage: the passage of each cell, or `NOWHERE`.
    """
    goal = learned.robots[k].goal
    ahead = passage[learned.map.next_cell]
    star = np.column_stack([u, u.max(axis=1) - LEAD])
    after: dict[tuple[int, int, int], int] = {}
    for x, move in enumerate(u.argmax(axis=1).tolist()):
        entered = ahead[x, move]
        if x == goal or entered in (NOWHERE, passage[x]):
            continue
        star[x] = preferring(star[x], COORDINATE)
        staying_out = np.where(ahead[x] == entered, -np.inf, u[x])
        makes_way = int(staying_out.argmax())
        for peer, cell in _going_first(learned, k, passage, entered):
            after[x, peer, cell] = makes_way
    blank = rows_as_learned({}, len(u), len(learned.robots))
    return _acting(learned, learner, {**memory, "u": u, **blank}, star, after)


def _going_first(
    learned: Scenario, k: int, passage: np.ndarray, entered: int
) -> Iterator[tuple[int, int]]:
    """Yield the peers and their cells for which robot k makes way at a passage."""
    inside = passage == entered
    in_front = (passage[learned.map.next_cell] == entered).any(axis=1)
    for peer, robot in enumerate(learned.robots):
        if peer == k:
            continue
        first = inside | in_front if peer < k else inside.copy()
        first[robot.goal] = False
        for cell in np.flatnonzero(first).tolist():
            yield peer, cell


def _climb(
    learned: Scenario, learner: Learner, memories: Sequence[Memory]
) -> tuple[float, float, list[Memory]]:
    """Climb by trials with the same draws; as `_of_a_pair`."""
    team = Team(learned, learner, compiled=has_numba())
    minds = team.initial(memories)
    best = team.play(minds, 0, PLAN_TRIALS, paired=True)
    before = float(best.returns.mean())
    better = True
    while better:
        better = False
        for change in _changes(learned, team, minds, best.stays):
            undo = _made(change)
            found = _better(team, minds, best)
            if found is None:
                _made(undo)
            else:
                best = found
                better = True
    improved = []
    for k in range(len(memories)):
        memory = memory_of(team.mind(minds, k))
        star = memory["q_star"]
        u = memory["u"]
        improved.append(_with_values(learned, learner, memory, star, u))
    return before, float(best.returns.mean()), improved


def _better(team: Team, minds: Any, best: Trials) -> Trials | None:
    """Return trials of the robots' current policies if they are better, else None."""
    few = team.play(minds, 0, FIRST_TRIALS, paired=True)
    if few.returns.mean() <= best.returns[:FIRST_TRIALS].mean():
        return None
    found = team.play(minds, 0, PLAN_TRIALS, paired=True)
    gain = (found.returns - best.returns).mean(axis=1)
    error = gain.std() / PLAN_TRIALS**0.5
    return found if gain.mean() > GAIN_ERRORS * error else None


Change = list[tuple[Any, np.ndarray]]
"""Rows of the robots' minds, lists or arrays, and the values to write to each."""


def _made(change: Change) -> Change:
    """Write the values of a change; return the change that undoes it."""
    undo = [(row, np.array(row)) for row, _ in change]
    for row, values in change:
        row[:] = values
    return undo


def _changes(
    learned: Scenario, team: Team, minds: Any, stays: np.ndarray
) -> Iterator[Change]:
    """Yield changes of one robot's policy: routes, then actions, then corrections.

    Each is made from what the minds hold when it is asked for, with all changes that were kept.

    Args:
        learned: the game as the team knows it.
        team: scenario, learner and form.
        minds: the robots' minds.
        stays: steps that each robot acts in each cell, shape (robots, cells).
    """
    each = [team.mind(minds, k) for k in range(len(stays))]
    yield from _other_routes(learned, each)
    for k, mind in enumerate(each):
        yield from _other_actions(learned, mind, stays[k])
    for k, mind in enumerate(each):
        yield from _other_corrections(mind, stays[k], len(each))


def _other_routes(learned: Scenario, minds: Sequence[Any]) -> Iterator[Change]:
    """Yield another route of one robot: U of a robot alone that avoids one doorway, or none."""
    avoided: list[tuple[int, ...]] = [()]
    avoided += [(doorway,) for doorway in sorted(learned.map.doorways)]
    for cells in avoided:
        routes = _on_routes(learned, [cells] * len(minds))
        for mind, route in zip(minds, routes, strict=True):
            yield _other_route(mind, route)


def _other_route(mind: Any, route: np.ndarray) -> Change:
    """Return the change of a robot that takes another route, with U of that, [cell, move]."""
    u = np.array(mind.u)
    star = np.array(mind.q_star)
    new = np.column_stack([route, route.max(axis=1)])
    star += new - np.column_stack([u, u.max(axis=1)])
    change = [(mind.q_star[x], row) for x, row in enumerate(star)]
    return change + [(mind.u[x], row) for x, row in enumerate(route)]


def _on_routes(learned: Scenario, avoided: Sequence[Collection[int]]) -> np.ndarray:
    """Return U of robots alone that keep out of cells, shape (robots, cells, moves)."""
    after = alone(learned, avoided)
    p = learned.move_success
    routes: np.ndarray = (
        p * after[:, learned.map.next_cell] + (1.0 - p) * after[:, :, None]
    )
    return routes


def _other_actions(learned: Scenario, mind: Any, stays: np.ndarray) -> Iterator[Change]:
    """Yield another action of one robot in one cell where it acts."""
    lead = learned.map.next_cell
    for x in np.flatnonzero(stays > 0).tolist():
        row = mind.q_star[x]
        for action in range(len(ACTIONS)):
            waits_for_ever = action < PRIMITIVES and lead[x, action] == x
            if action != np.argmax(row) and not waits_for_ever:
                yield [(row, preferring(np.array(row), action))]


def _other_corrections(mind: Any, stays: np.ndarray, robots: int) -> Iterator[Change]:
    """Yield no correction, or another move, for one cell of a peer that is in the way.

    In the robot's own cell it acts and asks.
    """
    keys = learned_rows(mind.rho).keys
    states = states_of(keys, len(stays), robots)
    for key, (x, peer, _) in zip(keys.tolist(), states, strict=True):
        row = mind.rho.values[row_of(mind.rho, key)]
        u = np.array(mind.u[x])
        in_the_way = peer != NOT_PERCEIVED and row[u.argmax()] < 0.0
        if in_the_way and stays[x] and asks_surely(mind.q_star[x]):
            yield [(row, np.zeros(PRIMITIVES))]
            for move in range(PRIMITIVES):
                yield [(row, preferring(u + np.array(row), move) - u)]


def preferring(values: np.ndarray, chosen: int) -> np.ndarray:
    """Return values with the chosen one greatest: others are lowered as far as needed."""
    most = min(values[chosen] - LEAD, (1.0 - LEAD_SHARE) * values[chosen])
    lowered: np.ndarray = np.minimum(values, most)
    lowered[chosen] = values[chosen]
    return lowered


def _acting(
    scenario: Scenario,
    learner: Learner,
    memory: Memory,
    star: np.ndarray,
    after: Mapping[tuple[int, int, int], int],
) -> Memory:
    """Return a memory that acts by other values.

    Args:
        scenario: the game.
        learner: the learner.
        memory: its memory.
        star: its new Q*, shape (cells, 5).
        after: its move by own cell, peer and the peer's cell, as of `states_of`.
    """
    u = memory["u"]
    cells = len(memory["u"])
    robots = len(scenario.robots)
    states = states_of(memory["rho_keys"], cells, robots)
    rows = dict(zip(map(tuple, states.tolist()), memory["rho_values"], strict=True))
    for state, move in after.items():
        lone = u[state[0]]
        row = rows.get(state, np.zeros(PRIMITIVES))
        rows[state] = preferring(lone + row, move) - lone
    planned = {**memory, **rows_as_learned(rows, cells, robots)}
    return _with_values(scenario, learner, planned, star, u)


def rows_as_learned(
    rows: Mapping[tuple[int, int, int], np.ndarray], cells: int, robots: int
) -> dict[str, np.ndarray]:
    """Return rows of rho, by what `states_of` says, as fields of a memory; without rows of 0."""
    known = {
        key_of(state, cells, robots): row for state, row in rows.items() if row.any()
    }
    keys = sorted(known)
    values = np.array([known[key] for key in keys]).reshape(-1, PRIMITIVES)
    return {
        "rho_keys": np.array(keys, dtype=np.int64),
        "rho_values": values,
        "rho_updates": np.ones(values.shape, dtype=np.int64),
    }


def _with_values(
    scenario: Scenario,
    learner: Learner,
    memory: Memory,
    star: np.ndarray,
    u: np.ndarray,
) -> Memory:
    """Return a memory with another Q*, and factors that give it."""
    changed = {
        "q_star": star,
        "value": star.max(axis=1),
        "r_bar": star[:, :PRIMITIVES] - u,
        "w": star[:, COORDINATE] - u.max(axis=1) + _cost(scenario, learner),
    }
    return {**memory, **changed}


def _cost(scenario: Scenario, learner: Learner) -> float:
    """Return the cost of asking, weighed by the learner."""
    return learner.weights(scenario).ask_cost * scenario.ask_cost
