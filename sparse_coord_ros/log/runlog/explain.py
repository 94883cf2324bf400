# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Explains each COORDINATE: the question, the answer, the move, and the update of the tables."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import MOVE_TIE
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.mind import Memory, memory_before
from sparse_coord_ros.core.learners.rules import greedy
from sparse_coord_ros.core.learners.voi import Voi, by_policy
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.log.runlog.percept_check import percept_end
from sparse_coord_ros.log.runlog.replay import (
    Replay,
    Trajectory,
    agent_with,
    trajectory_of,
)
from sparse_coord_ros.protocol.wire import PERCEPT


class Update(NamedTuple):
    """A robot's update from a transition.

    Attributes:
        next_cell: the cell after its action.
        reward: R_k(t).
        star: entry (cell, action) of Q*, its value before and after.
        coord: entry (own cell, peers' cells, move) of Q^C, before and after; or None.
        later: row (own cell, peers' cells) of Q^C, before and after the next step: robots of
            `voi` learn then, when they know where their peers went; or None.
    """

    next_cell: int
    reward: float
    star: tuple[tuple[int, ...], float, float]
    coord: tuple[tuple[int, ...], float, float] | None
    later: tuple[tuple[int, ...], list[float], list[float]] | None


class Reason(NamedTuple):
    """The reason for the move of a robot that asked.

    Attributes:
        star: the row of Q* by which it asked.
        alone: U of a robot of `voi`: the values of the moves if it meets nobody; else None.
        values: the values by which COORDINATE chose a move: those of Q^C at the joint state,
            after a failed percept those of Q* at its cell; or what the learner made of them.
        move: their greedy move.
        by_policy: whether it asked only to learn, and made the move of its policy, which chose one
            without asking: by Q*, or to explore.
        impatient: whether it waits in vain: waiting has lost value.
    """

    star: tuple[float, ...]
    alone: tuple[float, ...] | None
    values: tuple[float, ...]
    move: int
    by_policy: bool
    impatient: bool


class Coordination(NamedTuple):
    """One COORDINATE.

    Attributes:
        step: the time step.
        robot: the robot's number.
        cell: the robot's cell.
        peers: the peers to ask.
        outcome: the end of the percept, in the words of `wire.PerceptEnd`.
        perceived: the cells that it perceived; None: the percept failed.
        move: the primitive action after COORDINATE.
        reason: the reason for the move; None if it cannot be computed: the robot does not publish
            its tables, the learner's code may not be imported, or the tables are lost.
        update: the update from it; None without an update (the robot was left out, or the log
            ends).
        agrees: whether the agent chooses the logged action.
        doubt: the reason why the robot may have had other values; None: it had these.
    """

    step: int
    robot: int
    cell: int
    peers: tuple[int, ...]
    outcome: str
    perceived: tuple[int, ...] | None
    move: int
    reason: Reason | None = None
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
    first = 0
    memory = None
    if doubt is None and steps:
        first, memory = _tables_before(log, robot, steps[0])
    trajectory = trajectory_of(log, robot, first)
    replay = None
    if memory is not None:
        replay = Replay(log, trajectory, agent_with(log, robot, memory))
    elif log.run.known_rule is not None and doubt is None:
        doubt = f"the log does not hold the tables that {log.names[robot]} began with"
    for step in steps:
        index = int(np.searchsorted(trajectory.step, step))
        if step in trajectory.step and log.asked[trajectory.row[index], robot]:
            coordination = _logged(log, robot, trajectory, index)._replace(doubt=doubt)
            if replay is not None:
                if not log.between(first, step).whole:
                    coordination = coordination._replace(
                        doubt="the log lacks messages before it"
                    )
                coordination = _replayed(log, coordination, trajectory, replay, index)
            yield coordination


def _tables_before(log: RunLog, robot: int, step: int) -> tuple[int, Memory | None]:
    """Return the time step of a robot's newest tables up to a given one, and its memory then.

    The memory is None if the log does not hold it, or if the learner's code may not be imported.
    """
    if log.run.known_rule is None:
        return 0, None
    newest = log.tables_before(robot, step)
    if newest is not None:
        return newest.step, newest.tables.memory
    if log.run.tables or log.run.greedy:
        return 0, None
    return 0, memory_before(log.run.rule, log.run.scenario, robot)


def _logged(
    log: RunLog, robot: int, trajectory: Trajectory, index: int
) -> Coordination:
    """Return a COORDINATE as logged, without values and update."""
    step = int(trajectory.step[index])
    row = trajectory.row[index]
    cell = int(trajectory.cell[index])
    peers = tuple(trajectory.peers[index].tolist())
    end = percept_end(log.column(PERCEPT.name)[row, robot])
    perceived = trajectory.perceived_at(index)
    move = int(log.move[row, robot])
    return Coordination(step, robot, cell, peers, end, perceived, move)


def _replayed(
    log: RunLog,
    logged: Coordination,
    trajectory: Trajectory,
    replay: Replay,
    index: int,
) -> Coordination:
    """Replay a robot up to its COORDINATE and over it; return it with values and update."""
    agent = replay.agent
    cell = logged.cell
    agrees = replay.advance(index)
    reason = reason_of(replay, logged.step, cell, logged.perceived)
    known = _known(log, trajectory, index)
    star = agent.values(cell)[COORDINATE]
    row = agent.values_asking(cell, known)
    if not agrees or not replay.advance(index + 1):
        move = logged.move if replay.other is None else replay.other.move
        return logged._replace(
            move=move, reason=reason._replace(move=move), agrees=False
        )
    logged = logged._replace(reason=reason)
    if not trajectory.learned[index]:
        return logged
    coord = later = None
    if _is_voi(agent.learner):
        learned = _a_step_later(log, trajectory, replay, index, known)
        if learned is not None:
            later = (cell, *(known or ())), row, learned
    elif known is not None:
        learned = agent.values_asking(cell, known)
        coord = (cell, *known, logged.move), row[logged.move], learned[logged.move]
    update = Update(
        next_cell=int(trajectory.next_cell[index]),
        reward=float(log.column("total")[trajectory.row[index], logged.robot]),
        star=((cell, COORDINATE), star, agent.values(cell)[COORDINATE]),
        coord=coord,
        later=later,
    )
    return logged._replace(update=update)


def _known(log: RunLog, trajectory: Trajectory, index: int) -> tuple[int, ...] | None:
    """Return the peers' cells from which a robot learns; None: it knows none."""
    if not log.run.sees_all:
        return trajectory.perceived_at(index)
    cells = log.cells[trajectory.row[index]]
    return tuple(cells[trajectory.peers[index]].tolist())


def _a_step_later(
    log: RunLog,
    trajectory: Trajectory,
    replay: Replay,
    index: int,
    known: tuple[int, ...] | None,
) -> list[float] | None:
    """Return the row of Q^C of an action after the next step; None: it did not learn from that."""
    step = int(trajectory.step[index])
    follows = step + 1 in trajectory.step[index + 1 : index + 2]
    if not (follows and trajectory.learned[index + 1]):
        return None
    agent = agent_with(log, replay.agent.number, replay.agent.memory())
    ahead = Replay(log, trajectory, agent)
    ahead.reached = index + 1
    if not ahead.advance(index + 2):
        return None
    return agent.values_asking(int(trajectory.cell[index]), known)


def reason_of(
    replay: Replay, step: int, cell: int, perceived: tuple[int, ...] | None
) -> Reason:
    """Return the reason for the move of a robot that asks.

    Args:
        replay: its replay, which has reached the question.
        step: the time step.
        cell: the robot's cell.
        perceived: the cells of the peers that it perceived; None: the percept failed.
    """
    agent = replay.agent
    key = agent.task.keys[agent.number]
    values = agent.values_asking(cell, perceived)
    of_policy = COORDINATE
    impatient = False
    if replay.other is None and replay.decide().action == COORDINATE:
        if _moves_as_voi(agent.learner):
            of_policy = by_policy(agent.values(cell), agent.task, agent.number, step)
        replay.act()
        impatient = _moves_as_voi(agent.learner) and values != agent.values_at_last
        values = agent.values_at_last
    move = greedy(values, PRIMITIVES, key, step, MOVE_TIE)
    alone = None
    if _is_voi(agent.learner):
        alone = tuple(agent.mind.u[agent.number, cell].tolist())
    return Reason(
        star=tuple(agent.values(cell)),
        alone=alone,
        values=tuple(values),
        move=move,
        by_policy=of_policy != COORDINATE,
        impatient=impatient,
    )


def _is_voi(learner: Learner) -> bool:
    """Return whether robots learn as those of `voi` do."""
    return learner.learn is Voi.learn


def _moves_as_voi(learner: Learner) -> bool:
    """Return whether robots that ask move as those of `voi` do."""
    return learner.move_after_asking is Voi.move_after_asking


def moves_otherwise(run: RunConfig) -> bool:
    """Return whether robots that ask may make another move than the greedy one of their tables."""
    rule = run.known_rule
    if rule is None or rule.move_after_asking is Learner.move_after_asking:
        return False
    if not _moves_as_voi(rule):
        return True
    asks_to_learn = not (run.greedy or run.sees_all)
    return asks_to_learn or len(run.scenario.robots) > 2


def cell_in_words(run: RunConfig, cell: int | None) -> str:
    """Return a cell's number, row and column; None: it is unknown."""
    if cell is None:
        return "an unknown cell"
    row, column = run.scenario.map.cells[cell]
    return f"cell {cell} [{row}, {column}]"


def choice_in_words(run: RunConfig, robot: int, cell: int | None) -> str:
    """Return a sentence: a robot (from 0) chooses COORDINATE in a cell."""
    return f"{run.scenario.robots[robot].name} in {cell_in_words(run, cell)} chooses COORDINATE"


ASKS_TO_LEARN = (
    "asks in every step while it learns; its policy chose a move without asking"
)

IMPATIENT = "has waited in vain: nobody moved, and waiting loses value"


def why_in_words(reason: Reason | None) -> Iterator[str]:
    """Yield the reasons why a robot may not have made the greedy move of its tables."""
    if reason is not None and reason.by_policy:
        yield ASKS_TO_LEARN
    if reason is not None and reason.impatient:
        yield IMPATIENT


def move_in_words(
    run: RunConfig,
    cell: int | None,
    perceived: Sequence[int] | None,
    move: int,
    reason: Reason | None = None,
) -> str:
    """Return the move after COORDINATE, and the row of the tables that decided.

    Args:
        run: the run.
        cell: the robot's cell; None: the cell, or its tables, are unknown.
        perceived: the cells of the peers that it perceived; None: the percept failed.
        move: the primitive action.
        reason: the reason for the move; None: it is not known.
    """
    if cell is None:
        return f"goes {ACTIONS[move]}"
    if perceived is not None:
        row = _joint(cell, perceived)
    elif run.known_rule is not None and _is_voi(run.known_rule):
        row = _joint(cell, None)
    else:
        row = f"Q*[{cell}]"
    if reason is not None and reason.by_policy:
        return f"goes {ACTIONS[move]} by its policy, not by {row}"
    if reason is not None and reason.move != move:
        by_row = f"by {row} it would go {ACTIONS[reason.move]}"
        return f"goes {ACTIONS[move]}, though {by_row}"
    return f"goes {ACTIONS[move]} by {row}"


def _joint(cell: int, known: Sequence[int] | None) -> str:
    """Return the name of a row of Q^C: the own cell, and the peers' cells, if they are known."""
    if known is None:
        return f"Q^C[{cell}, no answer]"
    return f"Q^C[{', '.join(map(str, (cell, *known)))}]"


def row_in_words(values: Iterable[float]) -> str:
    """Return the values of actions, with their names."""
    return ", ".join(f"{a} {v:.6g}" for a, v in zip(ACTIONS, values, strict=False))


def reward_in_words(run: RunConfig, reward: float, next_cell: int | None) -> str:
    """Return a robot's reward and its next cell."""
    return f"reward {reward:g}, to {cell_in_words(run, next_cell)}"


def in_words(log: RunLog, coordination: Coordination) -> Iterator[str]:
    """Yield the lines of a COORDINATE: question, answer, move, update."""
    choice = choice_in_words(log.run, coordination.robot, coordination.cell)
    yield f"step {log.made_before(coordination.step)}: {choice}"
    if coordination.doubt is not None and coordination.reason is not None:
        yield f"  (the numbers may be wrong: {coordination.doubt}; see 'sparse_coord verify')"
    if coordination.reason is not None:
        yield f"  Q*[{coordination.cell}]: {row_in_words(coordination.reason.star)}"
    if coordination.reason is not None and coordination.reason.alone is not None:
        yield f"  U[{coordination.cell}], alone: {row_in_words(coordination.reason.alone)}"
    yield from _question(log, coordination)
    yield from _move(log, coordination)
    if coordination.reason is not None:
        yield from _learned(log, coordination)


def _question(log: RunLog, coordination: Coordination) -> Iterator[str]:
    """Yield the lines of the question, and of the percept that came of it."""
    peers = ", ".join(log.names[peer] for peer in coordination.peers) or "no peer"
    yield f"  asks {peers}"
    if coordination.perceived is None:
        yield f"  perceives nothing ({coordination.outcome})"
    else:
        cells = ", ".join(
            cell_in_words(log.run, cell) for cell in coordination.perceived
        )
        yield f"  perceives {cells}"


def _move(log: RunLog, coordination: Coordination) -> Iterator[str]:
    """Yield the lines of the move after the percept, and of the reason for it."""
    reason = coordination.reason
    for why in why_in_words(reason):
        yield f"  {why}"
    cell: int | None = coordination.cell
    if log.why_not_computed(coordination.robot) or (
        reason is None and moves_otherwise(log.run)
    ):
        cell = None
    move = move_in_words(
        log.run, cell, coordination.perceived, coordination.move, reason
    )
    if reason is not None:
        yield f"  {move}: {row_in_words(reason.values)}"
        if not coordination.agrees:
            yield "  (the log says another action; see 'sparse_coord verify')"
    else:
        yield f"  {move}" + (
            "" if coordination.doubt is None else f"; {coordination.doubt}"
        )


def _learned(log: RunLog, coordination: Coordination) -> Iterator[str]:
    update = coordination.update
    if update is None and not log.run.greedy:
        yield "  does not learn from it: the reward was late, or the next action is unknown"
        return
    if update is not None:
        yield f"  {reward_in_words(log.run, update.reward, update.next_cell)}"
    if update is None or log.run.greedy:
        yield "  does not learn: the run is greedy"
        return
    for table, changed in (("Q^C", update.coord), ("Q*", update.star)):
        if changed is None:
            continue
        (*state, action), before, after = changed
        yield f"  {table}[{', '.join(map(str, state))}; {ACTIONS[action]}] {before!r} -> {after!r}"
    if update.later is not None:
        (cell, *known), row, learned = update.later
        yield f"  a step later, when it knows what came of it, {_joint(cell, known or None)}:"
        for name, old, new in zip(ACTIONS, row, learned, strict=False):
            yield f"    {name} {old!r} -> {new!r}"
