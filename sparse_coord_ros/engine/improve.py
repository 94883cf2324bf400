# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learn, exchange, improve: a team plans on what its robots have learned.

After learning each robot says once what it knows: where its moves led and how often, its doorways
(cells where it felt r^C), its tables. From that all compute the same: a game as the team knows it,
and a climb of the *team's* value in it, from the policies learned, by changes of what one robot
does in one cell. Of two robots the value is exact, and the climb is that of `solve.asking_search`;
of more it is that of trials with the same draws. The paper has no such exchange, and this is
planning, on a learned model: what nobody has felt does not exist in it.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.compiling import has_numba
from sparse_coord_ros.engine.batch import CompiledTeam
from sparse_coord_ros.engine.kernels import PLAIN
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.game.grid import GridMap
from sparse_coord_ros.game.links import UP
from sparse_coord_ros.game.miscoordination import NOWHERE
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.specs import Spec
from sparse_coord_ros.learn.agent import Memory, Tables
from sparse_coord_ros.learn.algorithm import asks_surely
from sparse_coord_ros.learn.evaluation import Trials
from sparse_coord_ros.learn.factored import factored_tables
from sparse_coord_ros.learn.factors import UNSEEN, Factors, coordination_table, states_of
from sparse_coord_ros.learn.learners import Learner, check_improvable, check_memory
from sparse_coord_ros.learn.rows import find_row
from sparse_coord_ros.learn.run_config import RUN_FILE, RunConfig, create_output
from sparse_coord_ros.learn.tables import save_team
from sparse_coord_ros.solve.asking_loops import AskingPolicies
from sparse_coord_ros.solve.asking_search import climbed
from sparse_coord_ros.solve.exact import MOST_ROBOTS
from sparse_coord_ros.solve.routes import alone, passages

IMPROVED = "improved"
"""Folder in a run's directory for what the team made of what it learned."""

LEAD = 1.0
"""How much more than any other the action is worth that an improved table says."""

TRIALS, LOOKED_AT = 2000, 200
"""Trials by which more robots are judged; trials after which most changes are given up."""

SURE = 2.0
"""Standard errors that a change has to be better by."""


@dataclass(frozen=True)
class Improvement:
    """What planning on the learned model makes of a team.

    Attributes:
        tables: of each robot: what it learned, but for its factors r_bar, W and rho where it acts:
            they are so low that greedy reading gives the improved policy.
        before: what the learned team is worth on the learned model, averaged over the robots.
        value: what the improved one is worth there.
        doorways: cells where somebody has felt r^C; the plan knows no others.
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
        felt: cells where somebody has felt r^C.
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


def improve(scenario: Scenario, learner: Learner, memories: Sequence[Memory]) -> Improvement:
    """Return what the robots make of what they have learned; the same bits for each of them.

    Of the scenario it takes what a robot knows before it learns: starts and goals, discount, cost
    of asking, the percept model; of the map nothing but where cells lie.

    Args:
        scenario: the problem.
        learner: who learned.
        memories: what each robot remembers.

    Raises:
        SettingError: the robots do not learn what it needs.
        TablesError: what they remember is not of this scenario.
    """
    check_improvable(scenario, learner)
    for k, memory in enumerate(memories):
        check_memory(scenario, learner, k, memory)
    team = len(memories)
    learned = learned_scenario(scenario, learner, memories)
    tables = [factored_tables(memory, k, team) for k, memory in enumerate(memories)]
    dense = all(isinstance(table.q_coord, np.ndarray) for table in tables)
    if team == MOST_ROBOTS and dense and scenario.link == UP:
        before, value, found = _of_a_pair(learned, learner, tables)
    else:
        before, value, found = _by_trials(learned, learner, memories)
    return Improvement(tuple(found), before, value, tuple(sorted(learned.map.doorways)))


def save_improved(directory: Path, run: RunConfig, found: Improvement) -> Path:
    """Write what a run's robots made of what they learned, as a run's directory in its own.

    Raises:
        RunError: it exists already.
        OSError: it cannot be written.
    """
    folder = create_output(directory / IMPROVED)
    write_whole(folder / RUN_FILE, run.to_yaml())
    save_team(folder, found.tables)
    return folder


def learned_scenario(scenario: Scenario, learner: Learner, memories: Sequence[Memory]) -> Scenario:
    """Return the game as the team knows it; arguments as of `improve`.

    Where a move leads says the robot that made it most often. Moves succeed as often as those did
    that ever led anywhere; the others are walls. r^C is for each robot what it felt, on average.
    """
    cells = np.arange(len(scenario.map.cells))
    tried = np.array([memory.star_updates[:, :PRIMITIVES] for memory in memories]).sum(axis=0)
    moved, successor, door = (
        np.array([memory.more[name] for memory in memories])
        for name in ("moved", "successor", "door")
    )
    most, leads = moved.argmax(axis=0)[None], moved.any(axis=0)
    felt = door.sum(axis=1) / np.maximum(1, (door != 0.0).sum(axis=1))
    paid = felt / (learner.weights(scenario).common or 1.0)
    same = {field.name: getattr(scenario.map, field.name) for field in fields(GridMap)}
    return replace(
        scenario,
        map=LearnedMap(
            **same,
            lead=np.where(leads, np.take_along_axis(successor, most, 0)[0], cells[:, None]),
            felt=frozenset(np.flatnonzero(door.any(axis=0)).tolist()),
        ),
        move_success=float(moved.sum() / max(1, tried[leads].sum())),
        penalty=-1.0,
        common_reward=Spec("each", tuple((-paid).tolist())),
    )


def _of_a_pair(
    learned: Scenario, learner: Learner, tables: Sequence[Tables]
) -> tuple[float, float, list[Tables]]:
    """Climb by exact values: the value before and after, and the improved tables."""
    agents = [
        learner.agent(learned, k, 0, tables=table, learning=False)
        for k, table in enumerate(tables)
    ]
    cells = range(len(learned.map.cells))
    asks = np.array([asks_surely(table.q_star.T) for table in tables])
    best = np.array([table.q_star[:, :PRIMITIVES].argmax(axis=1) for table in tables])
    unseen = [[agent.values_asking(x, None)[:PRIMITIVES] for x in cells] for agent in agents]
    moves = np.where(asks, np.argmax(unseen, axis=2), best)
    seen = np.array([np.argmax(np.asarray(table.q_coord), axis=-1) for table in tables])
    before, value, team, visited = climbed(learned, AskingPolicies(moves, asks, seen))
    improved = []
    for k, table in enumerate(tables):
        star = table.q_star.copy()
        chosen = np.where(team.asks[k], COORDINATE, team.moves[k])
        for x in np.flatnonzero(visited[k]).tolist():
            star[x] = preferring(star[x], chosen[x])
        after: dict[tuple[int, int, int], int] = {}
        for x in np.flatnonzero(team.asks[k]).tolist():
            after |= {(x, 1 - k, z): team.seen[k, x, z] for z in cells}
            after[x, UNSEEN, UNSEEN] = team.moves[k, x]
        assert table.factors is not None
        improved.append(_acting(learned, learner, k, table.factors, star, after))
    return before, value, improved


def _by_trials(
    learned: Scenario, learner: Learner, memories: Sequence[Memory]
) -> tuple[float, float, list[Tables]]:
    """Climb from what was learned, and from `one_at_a_time`: the better; as `_of_a_pair`."""
    starts = memories, one_at_a_time(learned, learner, memories)
    climbs = [_climb(learned, learner, start) for start in starts]
    _, value, tables = max(climbs, key=lambda climb: climb[1])
    return climbs[0][0], value, tables


def one_at_a_time(learned: Scenario, learner: Learner, memories: Sequence[Memory]) -> list[Memory]:
    """Return what robots remember that take turns, on shortest ways.

    Doorways side by side are a passage. Who is before one on its way asks, and makes way if it
    perceives a peer inside, or one of lower number before it.
    """
    passage = passages(learned)
    ahead = passage[learned.map.next_cell]
    goals = [robot.goal for robot in learned.robots]
    starts = []
    for k, u in enumerate(_on_routes(learned, [()] * len(memories))):
        star = np.column_stack([u, u.max(axis=1) - LEAD])
        after: dict[tuple[int, int, int], int] = {}
        for x, move in enumerate(u.argmax(axis=1).tolist()):
            entered = ahead[x, move]
            if x == goals[k] or entered in (NOWHERE, passage[x]):
                continue
            star[x] = preferring(star[x], COORDINATE)
            waits = int(np.where(ahead[x] == entered, -np.inf, u[x]).argmax())
            inside, before = passage == entered, (ahead == entered).any(axis=1)
            for j in range(len(goals)):
                first = inside | before & (j < k)
                first[goals[j]] = False
                after |= {(x, j, z): waits for z in np.flatnonzero(first).tolist() if j != k}
        nothing = np.empty((0, 3), dtype=np.int32), np.empty((0, PRIMITIVES))
        begun = Factors(u, np.zeros_like(u), np.zeros(len(u)), *nothing)
        acting = _acting(learned, learner, k, begun, star, after)
        starts.append(remembering(memories[k], acting))
    return starts


def _climb(
    learned: Scenario, learner: Learner, memories: Sequence[Memory]
) -> tuple[float, float, list[Tables]]:
    """Climb by trials with the same draws; as `_of_a_pair`."""
    team = CompiledTeam(learned, learner, loops=None if has_numba() else PLAIN)
    minds: Any = team.remembered(memories)
    best = team.play(minds, 0, TRIALS, paired=True)
    before, better = float(best.reward.mean()), True
    while better:
        better = False
        for change in _changes(learned, minds, best.stays):
            old = [place.copy() for place, _ in change]
            for place, new in change:
                place[:] = new
            found = _better(team, minds, best)
            if found is not None:
                best, better = found, True
                continue
            for (place, _), value in zip(change, old, strict=True):
                place[:] = value
    own, star, highest = minds.own, minds.q_star, minds.own.u.max(axis=2)
    own.r_bar[:] = star[:, :, :PRIMITIVES] - own.u
    own.w[:] = star[:, :, COORDINATE] - highest + _cost(learned, learner)
    return before, float(best.reward.mean()), team.tables(minds)


def _better(team: CompiledTeam, minds: Any, best: Trials) -> Trials | None:
    """Return trials of what the robots would do now, where that is better; else None."""
    few = team.play(minds, 0, LOOKED_AT, paired=True)
    if few.reward.mean() <= best.reward[:LOOKED_AT].mean():
        return None
    found = team.play(minds, 0, TRIALS, paired=True)
    gain = (found.reward - best.reward).mean(axis=1)
    return found if gain.mean() > SURE * gain.std() / TRIALS**0.5 else None


def _changes(
    learned: Scenario, minds: Any, stays: np.ndarray
) -> Iterator[list[tuple[np.ndarray, np.ndarray]]]:
    """Yield changes of what one robot does, as arrays and what to write to them.

    First another route: U of a robot alone that keeps out of one doorway, or of none. Then in one
    cell another action. Then, where it asks, another move, or no correction, for one peer's cell
    if that is in the way.

    Args:
        learned: the game as the team knows it.
        minds: what the robots do.
        stays: steps that each robot acts in each cell, shape (robots, cells).
    """
    star, u, lead = minds.q_star, minds.own.u, learned.map.next_cell
    for avoided in ((), *((doorway,) for doorway in sorted(learned.map.doorways))):
        for k, route in enumerate(_on_routes(learned, [avoided] * len(u))):
            gained = np.column_stack([route, route.max(axis=1)])
            gained -= np.column_stack([u[k], u[k].max(axis=1)])
            yield [(star[k], star[k] + gained), (u[k], route)]
    for k, x in np.argwhere(stays > 0).tolist():
        for action in range(len(ACTIONS)):
            waits_for_ever = action < PRIMITIVES and lead[x, action] == x
            if action != star[k, x].argmax() and not waits_for_ever:
                yield [(star[k, x], preferring(star[k, x], action))]
    yield from _corrections(minds, stays)


def _on_routes(learned: Scenario, avoided: Sequence[Collection[int]]) -> np.ndarray:
    """Return U of robots alone that keep out of cells, shape (robots, cells, moves)."""
    after, p = alone(learned, avoided), learned.move_success
    routes: np.ndarray = p * after[:, learned.map.next_cell] + (1.0 - p) * after[:, :, None]
    return routes


def _corrections(minds: Any, stays: np.ndarray) -> Iterator[list[tuple[np.ndarray, np.ndarray]]]:
    star, u, rows = minds.q_star, minds.own.u, minds.rows
    team, cells = stays.shape
    for k in range(team):
        keys, _, _ = rows.learned(k)
        for key, (x, j, _) in zip(keys.tolist(), states_of(keys, cells, team), strict=True):
            row = rows.values[k, find_row(rows.keys[k], key) if rows.hashed else key]
            in_the_way = j != UNSEEN and row[u[k, x].argmax()] < 0.0
            if in_the_way and stays[k, x] and asks_surely(star[k, x]):
                yield [(row, np.zeros(PRIMITIVES))]
                for move in range(PRIMITIVES):
                    yield [(row, preferring(u[k, x] + row, move) - u[k, x])]


def preferring(values: np.ndarray, chosen: int) -> np.ndarray:
    """Return values of which the chosen one leads: the others are lowered as far as need be."""
    lowered: np.ndarray = np.minimum(values, values[chosen] - LEAD)
    lowered[chosen] = values[chosen]
    return lowered


def _acting(
    scenario: Scenario,
    learner: Learner,
    k: int,
    learned: Factors,
    star: np.ndarray,
    after: Mapping[tuple[int, int, int], int],
) -> Tables:
    """Return the tables of robot k that acts by other values.

    Args:
        scenario: the game.
        learner: who learned.
        k: the robot, from 0.
        learned: the factors that it changes.
        star: its new Q*, shape (cells, 5).
        after: its move by own cell, peer and the peer's cell, as of `Factors.states`.
    """
    u, _, _, states, rho = learned
    rows = dict(zip(map(tuple, states.tolist()), rho, strict=True))
    for state, move in after.items():
        lone = u[state[0]]
        row = rows.get(state, np.zeros(PRIMITIVES))
        rows[state] = preferring(lone + row, move) - lone
    cost = _cost(scenario, learner)
    kept = sorted(state for state, row in rows.items() if row.any())
    factors = Factors(
        individual=u,
        common=star[:, :PRIMITIVES] - u,
        asking=star[:, COORDINATE] - u.max(axis=1) + cost,
        states=np.array(kept, dtype=np.int32).reshape(len(kept), 3),
        corrections=np.array([rows[state] for state in kept]).reshape(len(kept), PRIMITIVES),
    )
    return Tables(star, coordination_table(factors, k, len(scenario.robots)), factors)


def remembering(memory: Memory, table: Tables) -> Memory:
    """Return what a robot remembers, but other tables."""
    assert table.factors is not None
    u, r_bar, w, states, rho = table.factors
    more = {**memory.more, "u": u, "r_bar": r_bar, "w": w}
    counts = np.ones(rho.shape, dtype=np.int64)
    return memory._replace(
        q_star=table.q_star, states=states, values=rho, updates=counts, more=more
    )


def _cost(scenario: Scenario, learner: Learner) -> float:
    """Return what asking costs, as the learner weighs it."""
    return learner.weights(scenario).ask_cost * scenario.ask_cost
