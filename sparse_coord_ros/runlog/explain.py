# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each COORDINATE traced: who asked whom, what was answered, and what was learned from it."""

from collections.abc import Collection
from typing import NamedTuple

from sparse_coord_ros.core.frame import Frame, action_numbers
from sparse_coord_ros.core.world import Action
from sparse_coord_ros.runlog.agents import AgentCheck, first_tables
from sparse_coord_ros.runlog.dialogue import Request
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.runlog.percepts import ANSWERED, LATE, REFUSED, check_percepts
from sparse_coord_ros.runlog.rerun import Choice, Update, rerun


class Coordination(NamedTuple):
    """One COORDINATE.

    Attributes:
        step: the time step.
        robot: the robot's number; cell: where it was.
        peers: whom it had to ask.
        requests: what it asked, in order, with the answers and the wall clock.
        outcome: ANSWERED, REFUSED or LATE, by the dialogue.
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
    return log.step[log.asked[:, robot]].tolist()


def explain(log: RunLog, robot: int, step: int) -> Coordination | None:
    """Return what came of a robot's COORDINATE at a time step; None where it chose none.

    The tables before and after are computed again from the start of the log, as `verify` does.
    """
    if step not in log.tracks.actions[robot].first or step not in coordinations(log, robot):
        return None
    begun, odd = first_tables(log, robot)
    doubt = None if odd is None else f"{odd}"
    if begun is None:
        doubt = f"the log does not hold the tables that {log.names[robot]} began with"
    dropped: Collection[int] = ()
    absent = _absences(log, robot)
    if absent and begun is not None:
        check = AgentCheck(
            log, robot, check_percepts(log, log.last_step)[0], absent, log.last_step
        )
        odd = check.follow()
        dropped = check.dropped
        if odd is not None and odd.step <= step:
            doubt = f"{odd}"
    learner = rerun(log, robot, begun, dropped)
    for event in learner:
        if event.step > step:
            break
        if isinstance(event, Choice) and event.step == step:
            if not event.computed.asked:
                return None
            return _coordination(log, robot, event, learner, doubt)
    return None


def _absences(log: RunLog, robot: int) -> frozenset[tuple[int, int]]:
    """Return (robot, step) of the steps that the world made without it while it was under way."""
    states, rewards, _, _ = log.tracks.of(robot)
    made = {t for track in log.tracks.rewards for t in track.first}
    frame = Frame(log.run)
    goal = frame.centres[log.run.scenario.robots[robot].goal]
    return frozenset(
        (robot, t) for t in made if t not in rewards.first and states.first.get(t, goal) != goal
    )


def _coordination(
    log: RunLog, robot: int, choice: Choice, learner, doubt: str | None
) -> Coordination:
    q_star, q_coord = choice.tables
    if choice.perceived is None:
        values = q_star[choice.cell][:4].tolist()
    else:
        values = q_coord[choice.cell, *choice.perceived].tolist()
    after = next(learner, None)
    update = after if isinstance(after, Update) and after.step == choice.step else None
    requests = tuple(
        request
        for request in log.requests
        if (request.asker, request.step) == (robot, choice.step)
    )
    agrees = tuple(map(repr, choice.logged)) == tuple(map(repr, action_numbers(choice.computed)))
    return Coordination(
        step=choice.step,
        robot=robot,
        cell=choice.cell,
        peers=choice.decision.peers,
        requests=requests,
        outcome=_outcome(choice, requests),
        perceived=choice.perceived,
        action=choice.computed,
        q_values=tuple(values),
        update=update,
        agrees=agrees,
        doubt=doubt,
    )


def _outcome(choice: Choice, requests: tuple[Request, ...]) -> str:
    if choice.perceived is not None:
        return ANSWERED
    last = requests[-1].answer if requests else None
    return LATE if last is None or last[0] < choice.step else REFUSED
