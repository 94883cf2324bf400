# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 once more, from the log alone: an agent fed with what its robot was told."""

from collections.abc import Collection, Iterator
from copy import deepcopy
from typing import NamedTuple

from sparse_coord_ros.core.agent import Agent, Decision, Tables
from sparse_coord_ros.core.frame import Frame, action_from, reward_from
from sparse_coord_ros.core.world import Action, Reward
from sparse_coord_ros.runlog.log import RunLog


class Handled(NamedTuple):
    """The robot has worked off a local state: all that happened before it is learned."""

    step: int
    before: int
    tables: Tables


class Choice(NamedTuple):
    """The robot has acted.

    Attributes:
        step: the time step.
        cell: where it was.
        decision: A_k(t), computed.
        perceived: what it perceived, logged.
        computed: the action as computed; logged: as logged, its five numbers.
        tables: those that it acted on; they change with what it learns.
    """

    step: int
    cell: int
    decision: Decision
    perceived: tuple[int, ...] | None
    computed: Action
    logged: tuple[float, ...]
    tables: Tables


class Update(NamedTuple):
    """The robot has learned from a transition.

    Attributes:
        step: the time step of the action.
        next_cell: where it led.
        reward: R_k(t).
        star: entry (cell, action) of Q*, its value before and after.
        coord: entry (own cell, perceived cells, move) of Q^C, before and after; or None.
    """

    step: int
    next_cell: int
    reward: float
    star: tuple[tuple[int, ...], float, float]
    coord: tuple[tuple[int, ...], float, float] | None


def rerun(
    log: RunLog, k: int, tables: Tables | None, dropped: Collection[int] = ()
) -> Iterator[Handled | Choice | Update]:
    """Run robot k's agent through the log.

    It learns from a transition when the log has both states, the action and the reward, as the
    robot does. A state that is no cell of the map, or an action that is none, ends the walk.

    Args:
        log: the log.
        k: the robot's number.
        tables: what it began with; the scenario's initial ones where None.
        dropped: time steps of actions that it is taken not to have learned from.
    """
    run, tracks = log.run, log.tracks
    frame = Frame(run)
    agent = run.rule.agent(
        run.scenario, k, run.seed, tables=deepcopy(tables), learning=not run.greedy
    )
    rewards, actions = tracks.rewards[k].first, tracks.actions[k].first
    percepts = tracks.percepts[k].first
    pending: Choice | None = None
    before = 0
    for step, position in sorted(tracks.states[k].first.items()):
        cell = frame.cell(*position)
        if cell is None:
            return
        known = pending is not None and step == pending.step + 1 and pending.step in rewards
        if known and pending.step not in dropped:
            yield _learn(agent, pending, reward_from(rewards[pending.step]), cell)
        pending = None
        yield Handled(step, before, agent.tables)
        before = step
        if step not in actions:
            continue
        decision = agent.decide(step, cell)
        perceived = None
        if decision.peers and len(percepts.get(step, ())) == 1 + len(decision.peers):
            seen = [frame.cell(*place) for place in percepts[step][1:]]
            perceived = None if None in seen else tuple(seen)
        action = agent.act(step, cell, decision, perceived)
        pending = Choice(step, cell, decision, perceived, action, actions[step], agent.tables)
        yield pending
        try:
            action_from(pending.logged)
        except ValueError:
            return


def _learn(agent: Agent, done: Choice, reward: Reward, next_cell: int) -> Update:
    """Let the agent learn, and say what it changed."""
    q_star, q_coord = agent.tables
    action = action_from(done.logged)
    star = (done.cell, done.decision.action)
    coord = None
    if done.perceived is not None:
        coord = (done.cell, *done.perceived, action.move)
    before = float(q_star[star]), None if coord is None else float(q_coord[coord])
    agent.learn(done.step, done.cell, done.decision, action, done.perceived, reward, next_cell)
    changed = None if coord is None else (coord, before[1], float(q_coord[coord]))
    return Update(
        done.step, next_cell, reward.total, (star, before[0], float(q_star[star])), changed
    )
