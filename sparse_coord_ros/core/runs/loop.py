# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loop of a team: Algorithm 1 for all its robots, with any learner, in learning and in trials.

`loop_of` makes it of a learner's hooks. It runs as plain Python, or compiled by numba, on the same
arrays. The game is that of `core.game.rules`.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

from sparse_coord_ros.base.compiling import jit, jitable, viewed
from sparse_coord_ros.core.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.interactions import miscoordinates, partners, settle
from sparse_coord_ros.core.game.rules import (
    EPISODE_GAP,
    UNKNOWN_PARTNERS,
    Problem,
    episode_ends,
    led,
    paid_for_ever,
    perceive,
    rewards_of,
    start_of,
)
from sparse_coord_ros.core.learners.learner import with_named_results
from sparse_coord_ros.core.learners.mind import with_views
from sparse_coord_ros.core.learners.rules import (
    NOT_PERCEIVED,
    Task,
    Transition,
    check_action,
    everybody_but,
    greedy_action,
    scheduled,
)

STEP, EPISODE_START, DONE, UNDER_WAY, EPISODES = range(5)
"""Entries of `Run.clock`: the time step, the first step of the episode, the transitions made,
whether the episode has begun, and the number of episodes."""


class Run(NamedTuple):
    """A run in progress; k is a robot.

    Attributes:
        clock: STEP, EPISODE_START, DONE, UNDER_WAY and EPISODES [5].
        keys: the keys of the draws [role, k].
        exploring: probability of an exploring start [time step].
        max_steps: steps after which an episode ends.
        before: X_k(t) at the last step [k].
        wanted: where its move led, before robots stop each other [k].
        cells: the cell of each robot now [k].
        arrived: whether it has reached its goal [k].
        actions: A_k(t) at the last step [k].
        moves: the primitive action that it became [k].
        seen: the peers that it perceived by COORDINATE, the sum of 2^j; 0: it did not ask, or
            the percept failed [k].
        known: the cells of all robots at the last step, as the robot that chooses or learns
            knows them [k].
        known_next: its knowledge of the cells now [k].
        values: space for the values of the moves after COORDINATE [move].
    """

    clock: Any
    keys: Any
    exploring: Any
    max_steps: int
    before: Any
    wanted: Any
    cells: Any
    arrived: Any
    actions: Any
    moves: Any
    seen: Any
    known: Any
    known_next: Any
    values: Any


class Record(NamedTuple):
    """The episodes of a run: a row for each.

    Attributes:
        first_step: its first time step [row].
        length: its transitions [row].
        steps: transitions until robot k arrived; 0: it did not arrive [row, k].
        returns: its discounted return from the episode's first state [row, k].
        asks: how often it chose COORDINATE [row, k].
        arrived: whether it reached its goal [row, k].
        miscoordinations: transitions that ended in a miscoordination [row].
        chosen: in all trials, how often robot k chose an action in a cell [k, x, action].
    """

    first_step: Any
    length: Any
    steps: Any
    returns: Any
    asks: Any
    arrived: Any
    miscoordinations: Any
    chosen: Any


@jitable
def begin(problem: Problem, run: Run) -> None:
    """Begin an episode: every robot at its start, or at an exploring start."""
    step = run.clock[STEP]
    exploring = scheduled(run.exploring, step)
    for k in range(len(run.cells)):
        run.cells[k] = start_of(problem, run.keys, k, step, exploring)
        run.arrived[k] = False
    run.clock[EPISODE_START] = step
    run.clock[UNDER_WAY] = True


@jitable
def set_known(known: Any, cells: Any, k: int, seen: int) -> None:
    """Set the cells that robot k knows: its own, and those of the peers that it sees."""
    for j in range(len(cells)):
        known[j] = cells[j] if j == k or (seen >> j) & 1 else NOT_PERCEIVED


@functools.cache
def loop_of(learner: Any) -> Callable[..., None]:
    """Return the loop of a learner, in plain Python."""
    begin_episode = learner.begin_episode
    decide = learner.decide
    asking_values = learner.asking_values
    move_after_asking = learner.move_after_asking
    bootstrap = learner.bootstrap
    learn = learner.learn
    wants_partners = learner.partners

    def loop(
        problem: Problem,
        task: Task,
        run: Run,
        mind: Any,
        record: Record,
        budget: int,
        stop: Any,
    ) -> None:
        """Make transitions, and learn from them if `task.learning`.

        It returns when the budget is made, when no row is left for the next episode, or when
        `task.full` or `stop` is set.

        Args:
            problem: the game.
            task: what the robots know of it.
            run: the run in progress, changed.
            mind: what the robots remember, changed.
            record: the episodes, added to.
            budget: transitions to make from the run's beginning on.
            stop: set where the run is not wanted any more [0].
        """
        clock = run.clock
        cells = run.cells
        before = run.before
        team = len(cells)
        factor = 1.0  # gamma^n after n steps of an episode
        for _ in range(clock[STEP] - clock[EPISODE_START]):
            factor *= problem.discount
        while clock[DONE] < budget and not task.full[0] and not stop[0]:
            if not clock[UNDER_WAY]:
                if clock[EPISODES] == len(record.length):
                    return
                begin(problem, run)
                record.first_step[clock[EPISODES]] = clock[STEP]
                clock[EPISODES] += 1
                factor = 1.0
                for k in range(team):
                    begin_episode(mind, task, k)
            step = clock[STEP]
            row = clock[EPISODES] - 1
            elapsed = step + 1 - clock[EPISODE_START]

            # Each robot chooses a move, and makes it (lines 4 to 10).
            for k in range(team):
                before[k] = cells[k]
            for k in range(team):
                if run.arrived[k]:
                    continue
                cell = before[k]
                if task.learning:
                    action = decide(mind, task, k, step, cell)
                    check_action(action, task.actions)
                else:
                    action = greedy_action(mind, task, k, step, cell)
                    record.chosen[k, cell, action] += 1
                move = action
                seen = 0
                if action == COORDINATE:
                    seen = perceive(problem, run.keys, k, step, before)
                    set_known(run.known, before, k, seen)
                    asking_values(mind, task, k, cell, seen, run.known, run.values)
                    move = move_after_asking(
                        mind, task, k, step, cell, seen, run.known, run.values
                    )
                    check_action(move, PRIMITIVES)
                    record.asks[row, k] += 1
                run.actions[k] = action
                run.moves[k] = move
                run.seen[k] = seen
                cells[k] = led(problem, run.keys, k, step, cell, move)

            # Robots stop each other; each one has its reward, and learns (lines 11 to 18).
            for k in range(team):
                run.wanted[k] = cells[k]
            settle(problem.interactions, before, cells)
            conflict = miscoordinates(problem.interactions, before, cells)
            record.length[row] += 1
            record.miscoordinations[row] += conflict
            over = True
            for k in range(team):
                acts = not run.arrived[k]
                next_cell = cells[k]
                home = acts and next_cell == problem.goals[k]
                asked = acts and run.actions[k] == COORDINATE
                individual, common, asking = rewards_of(
                    problem, k, conflict, home, asked
                )
                paid = paid_for_ever(problem, home, common, asking)
                record.returns[row, k] += factor * paid
                if task.learning and acts:
                    seen = run.seen[k]
                    seen_next = 0
                    if task.sees_all:
                        seen = everybody_but(k, team)
                        seen_next = seen
                    set_known(run.known, before, k, seen)
                    set_known(run.known_next, cells, k, seen_next)
                    met = UNKNOWN_PARTNERS
                    if wants_partners:
                        met = partners(
                            problem.interactions, before, run.wanted, cells, k
                        )
                    now = Transition(
                        step=step,
                        cell=before[k],
                        action=run.actions[k],
                        move=run.moves[k],
                        answered=run.seen[k] != 0,
                        seen=seen,
                        cells=run.known,
                        next_cell=next_cell,
                        next_cells=run.known_next,
                        individual=individual,
                        common=common,
                        asking=asking,
                        partners=met,
                    )
                    after = task.goal_value
                    if not home:
                        after = bootstrap(mind, task, k, next_cell, now)
                    learn(mind, task, k, now, after)
                if home:
                    run.arrived[k] = True
                    record.arrived[row, k] = True
                    record.steps[row, k] = elapsed
                over = over and run.arrived[k]
            factor *= problem.discount

            # The next time step, or the next episode (lines 19 and 20).
            clock[STEP] = step + 1
            clock[DONE] += 1
            if episode_ends(over, elapsed, run.max_steps):
                clock[STEP] += EPISODE_GAP
                clock[UNDER_WAY] = False

    return loop


@functools.cache
def plain(learner: Any) -> Callable[..., None]:
    """Return the loop of a learner in plain Python, on views of the arrays."""
    loop = loop_of(with_named_results(learner))

    def on_views(
        problem: Problem,
        task: Task,
        run: Run,
        mind: Any,
        record: Record,
        budget: int,
        stop: Any,
    ) -> None:
        loop(
            viewed(problem),
            viewed(task),
            viewed(run),
            with_views(mind),
            viewed(record),
            budget,
            viewed(stop),
        )

    return on_views


@functools.cache
def compiled(learner: Any) -> Callable[..., None]:
    """Return the loop of a learner, compiled by numba when it is first called."""
    return jit([loop_of(learner)], learner)[0]
