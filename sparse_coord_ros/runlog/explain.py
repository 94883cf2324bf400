# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each COORDINATE traced: who asked whom, what was answered, and what was learned from it."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.game.world import Action
from sparse_coord_ros.learn.agent import NOBODY
from sparse_coord_ros.learn.algorithm import COORDINATE
from sparse_coord_ros.runlog.agents import first_tables
from sparse_coord_ros.runlog.dialogue import Request
from sparse_coord_ros.runlog.follower import Follower
from sparse_coord_ros.runlog.log import NONE, RunLog
from sparse_coord_ros.runlog.percepts import ENDED
from sparse_coord_ros.runlog.story import Story, tell
from sparse_coord_ros.wire import ANSWERED, LATE, PERCEPT_ENDS, REFUSED


class Update(NamedTuple):
    """What a robot has learned from a transition.

    Attributes:
        next_cell: where its action led.
        reward: R_k(t).
        star: entry (cell, action) of Q*, its value before and after.
        coord: entry (own cell, perceived cells, move) of Q^C, before and after; or None.
        corrections: of a learner that learns in factors: the peer (from 0) and its cell, and rho
            of the move there before and after; both `UNSEEN` for failed percepts.
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
        robot: the robot's number; cell: where it was.
        peers: whom it had to ask.
        requests: what it asked, in order, with the answers and the wall clock.
        outcome: how the percept ended, in the words of `wire.PERCEPT_ENDS`.
        perceived: the cells that it perceived, or None.
        action: the primitive action that COORDINATE became.
        q_values: the four values that the action was chosen by, before learning: of Q^C at the
            joint state where it perceived, else of Q* at its cell.
        update: what it learned from it; None where it did not (left out, or the log ends).
        agrees: whether computing it again gives the logged action.
        doubt: why the numbers may be others than the robot had; None where they are not.
    """

    step: int
    robot: int
    cell: int
    peers: tuple[int, ...]
    requests: tuple[Request, ...]
    outcome: str
    perceived: tuple[int, ...] | None
    action: Action
    q_values: tuple[float, ...]
    update: Update | None
    agrees: bool
    doubt: str | None


def coordinations(log: RunLog, robot: int) -> list[int]:
    """Return the time steps at which a robot chose COORDINATE, ascending."""
    steps: list[int] = log.step[log.asked[:, robot]].tolist()
    return steps


def explain(log: RunLog, robot: int, step: int) -> Coordination | None:
    """Return what came of a robot's COORDINATE at a time step; None where it chose none.

    The tables before and after are computed again from the start of the log, as `verify` does.
    """
    return next(explained(log, robot, [step]))


def explained(log: RunLog, robot: int, steps: Sequence[int]) -> Iterator[Coordination | None]:
    """Yield the same of several time steps, ascending; the log is followed once for all."""
    story = tell(log, robot)
    begun, odd = first_tables(log, robot)
    doubt = None if odd is None else f"{odd}"
    if begun is None:
        doubt = f"the log does not hold the tables that {log.names[robot]} began with"
        begun = log.run.rule.tables(log.run.scenario)
    follower = Follower(log, robot, story, begun)
    for step in steps:
        place = int(np.searchsorted(story.step, step))
        here = story.step[place : place + 1] == step
        if not here.any() or story.action[place] != COORDINATE:
            yield None
            continue
        unknown = log.tracks.format == 1 and not story.told[:place].all()
        left_out = (
            "the robot was left out before, and a bag of format 1 does not say what it learned"
        )
        yield _coordination(
            log, robot, story, follower, place, doubt or (left_out if unknown else None)
        )


def _coordination(
    log: RunLog, robot: int, story: Story, follower: Follower, place: int, doubt: str | None
) -> Coordination:
    """Follow a robot to an action that is COORDINATE, and over it."""
    step = int(story.step[place])
    agrees = follower.advance(place)
    values = follower.values(place)
    seen = tuple(story.seen[place].tolist())
    perceived = seen if seen and NONE not in seen else None
    entries = _entries(story, place, perceived)
    before = [follower.entry(*state, action=a) for state, a in entries]
    rho = follower.corrections(place)
    agrees = agrees and follower.advance(place + 1)
    update = None
    if story.learned[place] and agrees:
        after = [follower.entry(*state, action=a) for state, a in entries]
        changes = [
            ((*state, a), b, c) for (state, a), b, c in zip(entries, before, after, strict=True)
        ]
        update = Update(
            int(story.next_cell[place]),
            float(story.reward[place, -1]),
            changes[0],
            changes[1] if perceived is not None else None,
            tuple((*who, rho[who], after) for who, after in follower.corrections(place).items()),
        )
    computed = follower.other
    move = int(story.move[place]) if computed is None else computed.move
    peers = tuple(story.peers[place].tolist())
    requests = tuple(r for r in log.requests if (r.asker, r.step) == (robot, step))
    return Coordination(
        step=step,
        robot=robot,
        cell=int(story.cell[place]),
        peers=peers,
        requests=requests,
        outcome=_outcome(log, robot, story, place, perceived, requests),
        perceived=perceived,
        action=Action(move, True, peers[0] if len(peers) == 1 else NOBODY, perceived is not None),
        q_values=tuple(values),
        update=update,
        agrees=agrees,
        doubt=doubt,
    )


def _entries(
    story: Story, place: int, perceived: tuple[int, ...] | None
) -> list[tuple[tuple[int, ...], int]]:
    """Return which entries of Q* and, where it perceived, of Q^C an action changes."""
    cell = int(story.cell[place])
    entries: list[tuple[tuple[int, ...], int]] = [((cell,), COORDINATE)]
    if perceived is not None:
        entries.append(((cell, *perceived), int(story.move[place])))
    return entries


def _outcome(
    log: RunLog,
    robot: int,
    story: Story,
    place: int,
    perceived: tuple[int, ...] | None,
    requests: tuple[Request, ...],
) -> str:
    """Return how the percept ended: as the robot says, in bags of format 1 by the dialogue."""
    if log.tracks.format > 1:
        code = log.numbers[story.row[place], robot, ENDED]
        return PERCEPT_ENDS[int(code)] if code in range(len(PERCEPT_ENDS)) else f"percept={code:g}"
    if perceived is not None:
        return PERCEPT_ENDS[ANSWERED]
    last = requests[-1].answer if requests else None
    late = last is None or last[0] < int(story.step[place])
    return PERCEPT_ENDS[LATE if late else REFUSED]
