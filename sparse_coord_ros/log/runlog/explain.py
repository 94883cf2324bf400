# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Explains each COORDINATE: the question, the answer, the move, and the update of the tables."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import MOVE_TIE
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.corrections import corrections_of
from sparse_coord_ros.core.learners.factored import (
    LEAVING,
    Factored,
    leaves_stand_offs,
)
from sparse_coord_ros.core.learners.mind import Memory, memory_before
from sparse_coord_ros.core.learners.rules import NOT_PERCEIVED, greedy
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.log.runlog.dialogue import Request
from sparse_coord_ros.log.runlog.log import NONE, RunLog
from sparse_coord_ros.log.runlog.percepts import percept_end
from sparse_coord_ros.log.runlog.replay import (
    Replay,
    Trajectory,
    agent_with,
    trajectory_of,
)


class Update(NamedTuple):
    """A robot's update from a transition.

    Attributes:
        next_cell: the cell after its action.
        reward: R_k(t).
        star: entry (cell, action) of Q*, its value before and after.
        coord: entry (own cell, perceived cells, move) of Q^C, before and after; or None.
        corrections: for a factored learner: the peer (from 0) and its cell, and rho of the move
            there before and after; peer and cell are `NOT_PERCEIVED` for failed percepts.
    """

    next_cell: int
    reward: float
    star: tuple[tuple[int, ...], float, float]
    coord: tuple[tuple[int, ...], float, float] | None
    corrections: tuple[tuple[int, int, float, float], ...] = ()


class Coordination(NamedTuple):
    """One COORDINATE.

    Attributes:
        step: the time step.
        robot: the robot's number.
        cell: the robot's cell.
        peers: the peers to ask.
        requests: its requests, in order, with the answers and the wall clock.
        outcome: the end of the percept, in the words of `wire.PerceptEnd`.
        perceived: the cells that it perceived; None: the percept failed.
        move: the primitive action after COORDINATE.
        q_values: the four values by which it chose the move: of Q^C at the joint state, after a
            failed percept of Q* at its cell; empty if they cannot be computed: the robot does not
            publish its tables, the learner's code may not be imported, or the tables are lost.
        waiting_move: the greedy move of these values, if the robot left a stand-off instead;
            None: it left none, or that is not known.
        update: the update from it; None without an update (the robot was left out, or the log
            ends).
        agrees: whether the agent chooses the logged action.
        doubt: the reason why the robot may have had other values; None: it had these.
    """

    step: int
    robot: int
    cell: int
    peers: tuple[int, ...]
    requests: tuple[Request, ...]
    outcome: str
    perceived: tuple[int, ...] | None
    move: int
    q_values: tuple[float, ...] = ()
    waiting_move: int | None = None
    update: Update | None = None
    agrees: bool = True
    doubt: str | None = None


def coordinations(log: RunLog, robot: int) -> list[int]:
    """Return the time steps at which a robot chose COORDINATE, ascending."""
    return [int(step) for step in log.step[log.asked[:, robot]]]


def explained(log: RunLog, robot: int, steps: Sequence[int]) -> Iterator[Coordination]:
    """Yield a robot's COORDINATE of each given time step.

    The tables before and after are computed as in `verify`, from the newest recorded tables up to
    the first of these time steps. The log is followed once for all time steps.

    Args:
        log: the log.
        robot: the robot's number.
        steps: the time steps, ascending.
    """
    doubt = log.why_not_computed(robot)
    first, memory = 0, None
    if doubt is None and steps:
        first, memory = _tables_before(log, robot, steps[0])
    trajectory = trajectory_of(log, robot, first)
    replay = None
    if memory is not None:
        replay = Replay(log, trajectory, agent_with(log, robot, memory))
    elif log.run.known_rule is not None and doubt is None:
        doubt = f"the log does not hold the tables that {log.names[robot]} began with"
    for step in steps:
        place = int(np.searchsorted(trajectory.step, step))
        if step in trajectory.step and log.asked[trajectory.row[place], robot]:
            one = _logged(log, robot, trajectory, place)._replace(doubt=doubt)
            if replay is not None:
                if not log.between(first, step).whole:
                    one = one._replace(doubt="the log lacks messages before it")
                one = _replayed(log, one, trajectory, replay, place)
            yield one


def _tables_before(log: RunLog, robot: int, step: int) -> tuple[int, Memory | None]:
    """Return the time step of a robot's newest tables up to a given one, and its memory then.

    The memory is None if the log does not hold it, or if the learner's code may not be imported.
    """
    if log.run.known_rule is None:
        return 0, None
    before = [one for one in log.all_tables if one.robot == robot and one.step <= step]
    newest = max(before, key=lambda one: one.step, default=None)
    if newest is not None:
        return newest.step, newest.tables.memory
    if log.run.tables or log.run.greedy:
        return 0, None
    return 0, memory_before(log.run.rule, log.run.scenario, robot)


def _logged(
    log: RunLog, robot: int, trajectory: Trajectory, place: int
) -> Coordination:
    """Return a COORDINATE as logged, without values and update."""
    step = int(trajectory.step[place])
    row = trajectory.row[place]
    asked = tuple(r for r in log.requests if (r.asker, r.step) == (robot, step))
    where = int(trajectory.cell[place])
    peers = tuple(trajectory.peers[place].tolist())
    end = percept_end(log.ended[row, robot])
    perceived = trajectory.perceived_at(place)
    move = int(log.move[row, robot])
    return Coordination(step, robot, where, peers, asked, end, perceived, move)


def _replayed(
    log: RunLog, one: Coordination, trajectory: Trajectory, replay: Replay, place: int
) -> Coordination:
    """Replay a robot up to its COORDINATE and over it; return it with values and update."""
    agent = replay.agent
    cell = one.cell
    perceived = one.perceived
    agrees = replay.advance(place)
    values = tuple(agent.values_asking(cell, perceived)[:PRIMITIVES])
    waiting_move = greedy_move(agent, one.step, values)
    entries: list[tuple[int, ...]] = [(cell, COORDINATE)]
    entries += [] if perceived is None else [(cell, *perceived, one.move)]

    def learned() -> tuple[list[float], dict[tuple[int, int], float]]:
        found = [agent.values(cell)[COORDINATE]]
        if perceived is not None:
            found.append(agent.values_asking(cell, perceived)[one.move])
        rho = {}
        if isinstance(agent.learner, Factored):
            seen = (
                None
                if perceived is None
                else dict(zip(agent.peers, perceived, strict=True))
            )
            rho = corrections_of(
                agent.mind, agent.task, agent.number, cell, seen, one.move
            )
        return found, rho

    before, rho = learned()
    if not agrees or not replay.advance(place + 1):
        move = one.move if replay.other is None else replay.other.move
        return one._replace(move=move, q_values=values, agrees=False)
    one = one._replace(q_values=values)
    if has_left(log.run, perceived, one.move, waiting_move):
        one = one._replace(waiting_move=waiting_move)
    if not trajectory.learned[place]:
        return one
    after, rho_after = learned()
    star, *coord = zip(entries, before, after, strict=True)
    corrections = tuple((*who, rho[who], value) for who, value in rho_after.items())
    reward = float(log.reward[trajectory.row[place], one.robot, -1])
    led = int(trajectory.next_cell[place])
    update = Update(led, reward, star, coord[0] if coord else None, corrections)
    return one._replace(update=update)


def greedy_move(agent: Agent, step: int, values: Sequence[float]) -> int:
    """Return the greedy move of an agent that asks at a time step, by the values of the moves."""
    return greedy(values, PRIMITIVES, agent.task.keys[agent.number], step, MOVE_TIE)


def cell_in_words(run: RunConfig, cell: int | None) -> str:
    """Return a cell's number, row and column; None: it is unknown."""
    if cell is None:
        return "an unknown cell"
    row, column = run.scenario.map.cells[cell]
    return f"cell {cell} [{row}, {column}]"


def choice_in_words(run: RunConfig, robot: int, cell: int | None) -> str:
    """Return a sentence: a robot (from 0) chooses COORDINATE in a cell."""
    return f"{run.scenario.robots[robot].name} in {cell_in_words(run, cell)} chooses COORDINATE"


LEAVES = (
    "asked twice in a row, saw that no robot moved, and leaves at random "
    f"(probability {LEAVING:g})"
)
"""The reason why a robot that left a stand-off did not make the greedy move."""

MAY_HAVE_LEFT = (
    "may have left at random: asked twice in a row, and saw that no robot moved"
)
"""The text for a move with unknown values."""


def has_left(
    run: RunConfig, perceived: Sequence[int] | None, move: int, greedy_move: int
) -> bool:
    """Return whether a robot that asked left a stand-off by its move.

    There is no other reason for a move that is not greedy: after an answer a robot that learns by
    `factored` does not explore.
    """
    return perceived is not None and _moves_as_factored(run) and move != greedy_move


def _moves_as_factored(run: RunConfig) -> bool:
    """Return whether robots that ask move as those of `factored` do."""
    rule = run.known_rule
    return rule is not None and rule.move_after_asking is Factored.move_after_asking


def may_have_left(
    run: RunConfig,
    robot: int,
    cells: Sequence[Sequence[int | None]],
    answered: Sequence[bool],
    move: int,
) -> bool:
    """Return whether a robot with unknown values may have left a stand-off by its move.

    Args:
        run: the run.
        robot: the robot's number.
        cells: the cells of all robots, in the time step before and in that of the move.
        answered: whether it got an answer, in both.
        move: the primitive action.
    """
    if not _moves_as_factored(run) or not leaves_stand_offs(run.scenario):
        return False
    before, now = cells
    stood = None not in now and list(before) == list(now)
    if not all(answered) or not stood:
        return False
    cell = now[robot]
    return bool(run.scenario.map.next_cell[cell, move] != cell)


def move_in_words(
    run: RunConfig,
    cell: int | None,
    perceived: Sequence[int] | None,
    move: int,
    waiting_move: int | None = None,
) -> str:
    """Return the move after COORDINATE, and the row of the tables that decided.

    Args:
        run: the run.
        cell: the robot's cell; None: the cell, or its tables, are unknown.
        perceived: the cells of the peers that it perceived; None: the percept failed.
        move: the primitive action.
        waiting_move: the greedy move of the row, if the robot left a stand-off; else None.
    """
    if cell is None:
        return f"goes {ACTIONS[move]}"
    row = f"Q*[{cell}]"
    if perceived is not None:
        row = f"Q^C[{', '.join(map(str, (cell, *perceived)))}]"
    elif isinstance(run.known_rule, Factored):
        row = f"U + rho[{cell}; failed percept]"
    if waiting_move is not None:
        by_row = f"by {row} it would go {ACTIONS[waiting_move]}"
        return f"goes {ACTIONS[move]}, though {by_row}"
    return f"goes {ACTIONS[move]} by {row}"


def row_in_words(values: Iterable[float]) -> str:
    """Return the values of the moves, with their names."""
    return ", ".join(f"{a} {v:.6g}" for a, v in zip(ACTIONS, values, strict=False))


def reward_in_words(run: RunConfig, reward: float, next_cell: int | None) -> str:
    """Return a robot's reward and its next cell."""
    return f"reward {reward:g}, to {cell_in_words(run, next_cell)}"


def in_words(log: RunLog, one: Coordination) -> Iterator[str]:
    """Yield the lines of a COORDINATE: question, answer, move, update."""
    yield f"time step {one.step}: {choice_in_words(log.run, one.robot, one.cell)}"
    if one.doubt is not None and one.q_values:
        yield f"  (the numbers may be wrong: {one.doubt}; see 'sparse_coord verify')"
    yield from _question(log, one)
    yield from _move(log, one)
    if one.q_values:
        yield from _learned(log, one)


def _question(log: RunLog, one: Coordination) -> Iterator[str]:
    """Yield the lines of the question, and of the percept that came of it."""
    if not one.requests:
        peers = ", ".join(log.names[peer] for peer in one.peers) or "no peer"
        yield f"  was to ask {peers}; no request is in the log"
    for request in one.requests:
        yield f"  asks {log.names[request.peer]}: {_answer(log, one, request)}"
    if one.perceived is None:
        yield f"  perceives nothing ({one.outcome})"
    else:
        cells = ", ".join(cell_in_words(log.run, cell) for cell in one.perceived)
        yield f"  perceives {cells}"


def _move(log: RunLog, one: Coordination) -> Iterator[str]:
    """Yield the lines of the move after the percept, and of the reason for it."""
    run = log.run
    if one.waiting_move is not None:
        yield f"  {LEAVES}"
    cell = None if log.why_not_computed(one.robot) else one.cell
    waiting_move = one.waiting_move
    if not one.q_values and _may_have_left(log, one):
        yield f"  {MAY_HAVE_LEFT}"
        cell = None
        waiting_move = None
    move = move_in_words(run, cell, one.perceived, one.move, waiting_move)
    if one.q_values:
        yield f"  {move}: {row_in_words(one.q_values)}"
        if not one.agrees:
            yield "  (the log says another action; see 'sparse_coord verify')"
    else:
        yield f"  {move}" + ("" if one.doubt is None else f"; {one.doubt}")


def _may_have_left(log: RunLog, one: Coordination) -> bool:
    """Return `may_have_left` for a COORDINATE."""
    row = log.row_of[one.step]
    if row == 0 or log.step[row - 1] != one.step - 1:
        return False
    rows = [row - 1, row]
    cells = log.cells[rows].tolist()
    answered = (log.asked & log.perceived)[rows, one.robot].tolist()
    is_known = NONE not in cells[1]
    return is_known and may_have_left(log.run, one.robot, cells, answered, one.move)


def _answer(log: RunLog, one: Coordination, request: Request) -> str:
    if request.answer is None:
        return "no answer is in the log"
    step, position = request.answer
    if step != one.step:
        said = (
            "not there yet (at" if step < one.step else "has gone on (to"
        ) + f" time step {step})"
    elif position is None:
        said = "refused"
    elif (cell := log.frame.cell(*position)) is None:
        said = f"answers {position}, which is no free cell"
    else:
        said = f"answers {cell_in_words(log.run, cell)}"
    return (
        said
        if request.seconds is None
        else f"{said}, after {request.seconds * 1e3:.3f} ms"
    )


def _learned(log: RunLog, one: Coordination) -> Iterator[str]:
    update = one.update
    if update is None:
        yield "  does not learn from it: the reward was late, or the next action is unknown"
        return
    yield f"  {reward_in_words(log.run, update.reward, update.next_cell)}"
    if log.run.greedy:
        yield "  does not learn: the run is greedy"
        return
    for table, changed in (("Q^C", update.coord), ("Q*", update.star)):
        if changed is None:
            yield "  Q^C stays unchanged: the question failed"
            continue
        (*state, action), before, after = changed
        yield f"  {table}[{', '.join(map(str, state))}; {ACTIONS[action]}] {before!r} -> {after!r}"
    for peer, place, before, after in update.corrections:
        where = (
            "failed percept"
            if peer == NOT_PERCEIVED
            else f"{log.names[peer]} in {place}"
        )
        yield f"  correction rho[{one.cell}; {where}; {ACTIONS[one.move]}] {before!r} -> {after!r}"
