# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The value of information: a robot asks where knowing is worth its price.

Cells: x of the robot, z_j of peer j; a step later y and z'_j. Moves: b. c: the cost of a question.

    (1) U(x, b)      = E[ r^I + gamma max_b' U(y, b') ]             a robot that meets nobody
    (2) Q^C(x, z, b) = U(x, b) + min_j rho_j(x, z_j, b)             it knows z: the worst peer
    (3) Q*(x, b)     = mean over z of Q^C(x, z, b)                  it does not ask
    (4) Q*(x, ask)   = mean over z of A(x, z) - c                   it asks
        A(x, z)      = p max_b Q^C(x, z, b) + (1 - p) Q^C(x, z, n)

rho_j is what peer j changes. The means are over the cells z in which the robot finds its peers
when it comes to x. p is the share of questions that are answered there, n the move of a robot
without an answer. With several peers the least of them and 0 counts, see `worst`. Each step of a
peer from z_j to z'_j teaches rho_j, for all moves of the cell x that the robot knows:

    (5) U + rho_j    <- sum_y P(y | x, b, z'_j) [ r^C + gamma V_j(y, z'_j) ]
    (6) V_j(y, z')   =  A(y, z') - c                    if it asks in y, with j as its only peer
                        (U + rho_j)(y, z', m)           if not; m: the best move of (3)

At the goal the value of the arrival, r^I included, is in place of r^I + gamma max U, and of
gamma V_j. For a move that was not made, a step counts by its probability (`weight_of`). A robot
that does not know z learns of "no answer" (`NOT_PERCEIVED`) as of a cell. In teams of more than
two, robots that face each other lose patience: see `patience`.

This is Algorithm 1 with two changes: Q^C bootstraps on what the robot will do, where line 13 takes
max Q*; and what a peer did teaches all moves of the cell, not only the one that was made.
docs/learners.md derives each line.
"""

from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import MOVE_TIE, REPLAY, draw
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.specs import Spec
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.lone import known_q_star
from sparse_coord_ros.core.learners.rules import (
    NOT_PERCEIVED,
    Task,
    Transition,
    Values,
    epsilon_greedy,
    greatest,
    greedy,
    step_size,
    toward,
)
from sparse_coord_ros.core.learners.table import Table, find, met, table

WALL = 6
"""Tries after which a move that never led out of its cell is one into a wall. It may have slipped:
an open door that is taken for a wall may never be tried again, where a longer way is open."""

MAP_TRIES = 20
"""For how many tries of each move a known map counts."""

OWN_TRIES = 2
"""For how many tries the model of all moves counts in the model of moves given z'."""

MOST_WEIGHT = 2.0
"""The most that a step counts for a move that was not made."""

PATIENCE = 4
"""Answers in a row in which nobody moved before waiting loses value."""

MOST_CREDIT = 8
"""How often r^C counts at most by default."""

FORBIDDEN = -1e9
"""The value of moving into a wall without an answer: a robot would do it for ever."""

NOT_FELT = 1e9
"""In place of r^C: it was never felt."""

STEP, CELL, MOVE, PARTNERS, COMMON, CELLS = range(6)
"""Entries of `last`: the time step t, X(t), its move, the peers with which it interacted, r^C, and
from `CELLS` on the cells of all robots at t."""

NO_STEP = -2.0
"""The time step of `last` before the first one."""

RHO, FELT = 0, PRIMITIVES
"""Columns of the values of `pairs`: rho_j of each move; the mean r^C of steps that ended here."""

MADE, TRIED, LED = 0, PRIMITIVES, 2 * PRIMITIVES
"""First columns of its counts of moves b: made with the peer in z; tried, and led out, with the
peer in z afterwards."""

ASKED, ANSWERED, ENDED = range(3 * PRIMITIVES, 3 * PRIMITIVES + 3)
"""Columns of its other counts: questions, those with an answer, and steps that ended here."""


class Voi(Learner):
    """Algorithm 1 with the value of information."""

    name = "voi"
    summary = "asks where knowing its peers' cells is worth more than a question costs"
    partners = True
    slow = 10
    defaults = MappingProxyType(
        {
            "epsilon": "linear:0.3:0.02:0.8",
            "starts": "exploring:1:0:0.5",
            "peers": "all",
            "credit": "team",
            "step_size": "floored:0.6:0.1:0.01",
        }
    )
    values = ("q_star", "u", "gain", "blind", "pairs")
    scratch = ("row",)

    class Mind(NamedTuple):
        """What robots remember; k is a robot, x its cell, b a move, j a peer.

        Attributes:
            q_star: Q*, by (3) and (4) [k, x, action].
            updates: how often b was tried [k, x, b]; how often it asked [k, x, 4].
            u: U, by (1) [k, x, b].
            tries: `updates` of moves, and the tries for which the map counts [k, x, b].
            led: how often b led out of x in these tries [k, x, b].
            to: the cell where it led [k, x, b].
            visited: the cells that it has visited, in the order of their first time [k, n].
            count: how many they are [k, 0].
            gain: Q* - U of moves, but for walls; of COORDINATE Q* + c - max_b U [k, x, action].
            blind: the mean of Q^C - U over the cells z of peers that do not answer [k, x, b].
            arrivals: how often it met its peers on coming to x [k, x].
            pairs: a row for x, j and z: rho_j, r^C, and counts, in the columns above.
            steps: a row [b] for x, j, z and z': how often b was made (`updates`), and the mean r^C
                of it when it led out (`values`); when it led home for z' `task.cells`: see
                `step_key`.
            last: the last step: `STEP`, `CELL`, `MOVE`, `PARTNERS`, `COMMON`, `CELLS` [k, 5 + j].
            stood: of the last answer: how many in a row found nobody moved, and the cells of all
                robots [k, 1 + j].
            row: space for a row [k, b].
        """

        q_star: Any
        updates: Any
        u: Any
        tries: Any
        led: Any
        to: Any
        visited: Any
        count: Any
        gain: Any
        blind: Any
        arrivals: Any
        pairs: Table
        steps: Table
        last: Any
        stood: Any
        row: Any

    def with_defaults(self, scenario: Scenario) -> Scenario:
        """Return it with its defaults; with more than `MOST_CREDIT` robots r^C counts so often."""
        chosen = super().with_defaults(scenario)
        if len(scenario.robots) > MOST_CREDIT and "credit" not in scenario.given:
            chosen = replace(chosen, credit=Spec("weight", (float(MOST_CREDIT),)))
        return chosen

    def check(self, scenario: Scenario) -> None:
        """Raise `SettingError` unless COORDINATE perceives every peer."""
        super().check(scenario)
        if len(scenario.robots) > 2 and scenario.peers != "all":
            raise SettingError(
                f"setting peers: value is {scenario.peers!r}, allowed with learner voi and "
                "more than two robots: all; set peers=all, or leave it out"
            )

    def rows_of_a_cell(self, scenario: Scenario) -> int:
        """Return the rows of a cell in its tables: one for each peer's cell."""
        return (len(scenario.robots) - 1) * len(scenario.map.cells)

    # One robot.

    @staticmethod
    def initial(scenario: Scenario, robot: int) -> Any:
        """Return what a robot remembers before learning: U and Q* of moves are `q_coord_init`."""
        cells = len(scenario.map.cells)
        team = len(scenario.robots)
        places = cells * team * (cells + 1)
        moves = (cells, PRIMITIVES)
        nothing = np.zeros((1, PRIMITIVES + 1))
        nothing[0, FELT] = NOT_FELT
        not_felt = np.full((1, PRIMITIVES), NOT_FELT)
        u = np.full(moves, float(scenario.q_coord_init))
        q_star = np.full((cells, len(ACTIONS)), float(scenario.q_coord_init))
        q_star[:, COORDINATE] -= scenario.ask_cost
        return Voi.Mind(
            q_star=q_star,
            updates=np.zeros(q_star.shape, dtype=np.int64),
            u=u,
            tries=np.zeros(moves, dtype=np.int64),
            led=np.zeros(moves, dtype=np.int64),
            to=np.repeat(np.arange(cells), PRIMITIVES).reshape(moves),
            visited=np.zeros(cells, dtype=np.int64),
            count=np.zeros(1, dtype=np.int64),
            gain=np.zeros(q_star.shape),
            blind=np.zeros(moves),
            arrivals=np.zeros(cells, dtype=np.int64),
            pairs=table(places, nothing, 3 * team, ENDED + 1),
            steps=table(places * (cells + 2), not_felt, 2 * team),
            last=np.full(CELLS + team, NO_STEP),
            stood=np.zeros(1 + team, dtype=np.int64),
            row=np.zeros(PRIMITIVES),
        )

    @staticmethod
    def informed(
        mind: Any, scenario: Scenario, robot: int, weights: RewardWeights
    ) -> Any:
        """Return what a robot that knows its map remembers: U, and its model of moves."""
        q_star = known_q_star(scenario, robot, weights, mind.q_star)
        lead = scenario.map.next_cell
        cells = np.arange(len(lead))
        leads = lead != cells[:, None]
        return mind._replace(
            q_star=q_star,
            u=q_star[:, :PRIMITIVES].copy(),
            tries=np.full(leads.shape, MAP_TRIES),
            led=leads * max(1, round(scenario.known_success * MAP_TRIES)),
            to=lead.copy(),
            visited=cells,
            count=np.array([len(cells)]),
        )

    @staticmethod
    def begin_episode(mind: Any, task: Task, k: int) -> None:
        """Forget the last answer."""
        mind.stood[k, :] = -1

    @staticmethod
    def decide(mind: Any, task: Task, k: int, step: int, cell: int) -> int:
        """Return A_k(t): while it learns it asks in every step, to know its peers' cells.

        Where robots see their peers while they learn, it explores by epsilon instead.
        """
        if task.sees_all:
            return epsilon_greedy(mind.q_star[k, cell], task, k, step)
        return COORDINATE

    @staticmethod
    def asking_values(
        mind: Any, task: Task, k: int, cell: int, seen: int, cells: Any, values: Any
    ) -> None:
        """Set the values Q^C, by (2); without an answer their means, see `know_nothing`."""
        if seen == 0:
            know_nothing(mind, k, cell, values)
        else:
            know(mind, task, k, cell, cells, values)

    @staticmethod
    def move_after_asking(
        mind: Any,
        task: Task,
        k: int,
        step: int,
        cell: int,
        seen: int,
        cells: Any,
        values: Values,
    ) -> int:
        """Return the greedy move; while it learns the move of its policy, which explores.

        While it learns it asks in every step, also where its policy would not ask.
        """
        action = by_policy(mind.q_star[k, cell], task, k, step)
        if action != COORDINATE:
            return action
        if seen != 0 and task.robots > 2:
            patience(mind, task, k, cell, cells, values)
        return greedy(values, PRIMITIVES, task.keys[k], step, MOVE_TIE)

    @staticmethod
    def bootstrap(mind: Any, task: Task, k: int, cell: int, now: Transition) -> float:
        """Return 0: the value of the next cell depends on where the peers are, see `learn`."""
        return 0.0

    @staticmethod
    def learn(mind: Any, task: Task, k: int, now: Transition, after: float) -> None:
        """Learn from the own move, and from the steps that peers made until now."""
        x = now.cell
        follows = mind.last[k, STEP] + 1 == now.step
        if follows:
            learn_from_peers(mind, task, k, now)
        count_move(mind, k, now)
        if now.action == COORDINATE:
            count_question(mind, task, k, now)
        learn_alone(mind, task, k, x)
        if not follows or mind.last[k, CELL] != x:
            learn_means(mind, task, k, now)
        note_step(mind, task, k, now)
        if now.next_cell == task.goals[k]:
            learn_from_arrival(mind, task, k, now)
        refresh(mind, task, k, x)
        chance = draw(task.keys[k], now.step, REPLAY)
        again = int(mind.visited[k, int(chance * mind.count[k, 0])])
        learn_alone(mind, task, k, again)
        refresh(mind, task, k, again)


@jitable
def by_policy(values: Values, task: Task, k: int, step: int) -> int:
    """Return what the policy of a robot that asks would do: ask, or make a move without asking.

    A robot that learns by answers alone asks in every step, whatever its policy does: see
    `Voi.decide`.

    Args:
        values: the row Q*_k(x, .).
        task: the task.
        k: the robot.
        step: the time step t.
    """
    if task.learning and not task.sees_all:
        return epsilon_greedy(values, task, k, step)
    return COORDINATE


# Keys of the tables.


@jitable
def pair_key(task: Task, x: int, j: int, z: int) -> int:
    """Return the key of an own cell, a peer and its cell, which may be `NOT_PERCEIVED`, -1."""
    return (x * task.robots + j) * (task.cells + 1) + z + 1


@jitable
def step_key(task: Task, x: int, j: int, z: int, z_next: int) -> int:
    """Return the key of an own cell, a peer and its step from z to z'.

    On arrival z' is not known: it then is `task.cells`, which is no cell.
    """
    return pair_key(task, x, j, z) * (task.cells + 2) + z_next + 1


# A robot alone.


@jitable
def count_move(mind: Any, k: int, now: Transition) -> None:
    """Count a step in the model of moves."""
    x = now.cell
    if greatest(mind.tries[k, x], PRIMITIVES) == 0.0:
        mind.visited[k, mind.count[k, 0]] = x
        mind.count[k, 0] += 1
    mind.updates[k, x, now.move] += 1
    mind.tries[k, x, now.move] += 1
    if now.next_cell != x:
        mind.led[k, x, now.move] += 1
        mind.to[k, x, now.move] = now.next_cell


@jitable
def count_question(mind: Any, task: Task, k: int, now: Transition) -> None:
    """Count a question, and whether it was answered."""
    mind.updates[k, now.cell, COORDINATE] += 1
    for j in range(task.robots):
        if j != k:
            key = pair_key(task, now.cell, j, int(now.cells[j]))
            counts = mind.pairs.updates[k, met(mind.pairs, task, k, key)]
            counts[ASKED] += 1
            counts[ANSWERED] += now.answered


@jitable
def share_answered(mind: Any, k: int, row: int, z: int) -> float:
    """Return the share of questions that were answered with the peer in z, by a row of `pairs`.

    One answer is counted before the first question. Where the robot knows no z, it had none.
    """
    if z == NOT_PERCEIVED:
        return 0.0
    counts = mind.pairs.updates[k, row]
    return float((counts[ANSWERED] + 1) / (counts[ASKED] + 1))


@jitable
def is_known(led: int, tries: int) -> bool:
    """Return whether the robot knows where a move leads: it led out, or it is one into a wall."""
    return led > 0 or tries >= WALL


@jitable
def is_wall(led: int, tries: int) -> bool:
    """Return whether a move is one into a wall: many tries never led out."""
    return led == 0 and tries >= WALL


@jitable
def arrival_value(task: Task) -> float:
    """Return the value of an arrival: its reward, and that of being at the goal."""
    return float(
        task.weights.individual * task.goal_reward + task.discount * task.goal_value
    )


@jitable
def price(task: Task) -> float:
    """Return c."""
    return float(task.weights.ask_cost * task.ask_cost)


@jitable
def learn_alone(mind: Any, task: Task, k: int, x: int) -> None:
    """Set U of the moves in a cell by the model of moves: equation (1)."""
    here = task.discount * greatest(mind.u[k, x], PRIMITIVES)
    for b in range(PRIMITIVES):
        if is_known(mind.led[k, x, b], mind.tries[k, x, b]):
            y = int(mind.to[k, x, b])
            there = task.discount * greatest(mind.u[k, y], PRIMITIVES)
            if y == task.goals[k]:
                there = arrival_value(task)
            share = mind.led[k, x, b] / mind.tries[k, x, b]
            mind.u[k, x, b] = share * there + (1.0 - share) * here


# Peers.


@jitable
def worst(mind: Any, task: Task, k: int, x: int, cells: Any, values: Any) -> None:
    """Set min_j rho_j(x, z_j, b); more than 0 only with one peer."""
    for b in range(PRIMITIVES):
        values[b] = 0.0
    for j in range(task.robots):
        if j != k:
            row = find(mind.pairs, k, pair_key(task, x, j, int(cells[j])))
            for b in range(PRIMITIVES):
                value = mind.pairs.values[k, row, RHO + b]
                if task.robots == 2 or value < values[b]:
                    values[b] = value


@jitable
def know(mind: Any, task: Task, k: int, x: int, cells: Any, values: Any) -> None:
    """Set Q^C(x, z, .), by (2)."""
    worst(mind, task, k, x, cells, values)
    for b in range(PRIMITIVES):
        values[b] += mind.u[k, x, b]


@jitable
def know_nothing(mind: Any, k: int, x: int, values: Any) -> None:
    """Set the values of the moves without an answer: means of Q^C, and no waiting at walls."""
    for b in range(PRIMITIVES):
        values[b] = mind.u[k, x, b] + mind.blind[k, x, b]
        if is_wall(mind.led[k, x, b], mind.tries[k, x, b]):
            values[b] = FORBIDDEN


@jitable
def move_without_answer(mind: Any, k: int, x: int, share: float) -> int:
    """Return n, the best move without an answer; any move where all questions are answered."""
    if share == 1.0:
        return 0
    row = mind.row[k]
    know_nothing(mind, k, x, row)
    return best_move(row)


@jitable
def worth_of_asking(values: Values, share: float, n: int) -> float:
    """Return A, by (4), from a row of Q^C, p and n."""
    return float(share * greatest(values, PRIMITIVES) + (1.0 - share) * values[n])


@jitable
def best_move(values: Values) -> int:
    """Return the best move of a row, the first of equally good ones: by (3) it is m."""
    best = 0
    for b in range(1, PRIMITIVES):
        if values[b] > values[best]:
            best = b
    return best


@jitable
def value_of(mind: Any, task: Task, k: int, y: int, pair: int, z: int) -> float:
    """Return V_j(y, z'), by (6); `pair` is the row of `pairs` for y, j, z'."""
    rho = mind.pairs.values[k, pair]
    m = best_move(mind.q_star[k, y])
    if mind.q_star[k, y, COORDINATE] <= mind.q_star[k, y, m]:
        return float(mind.u[k, y, m] + rho[RHO + m])
    share = share_answered(mind, k, pair, z)
    n = move_without_answer(mind, k, y, share)
    row = mind.row[k]
    for b in range(PRIMITIVES):
        row[b] = mind.u[k, y, b] + rho[RHO + b]
    return worth_of_asking(row, share, n) - price(task)


@jitable
def learn_from_peers(mind: Any, task: Task, k: int, now: Transition) -> None:
    """Learn from the last step, as its robot now knows where its peers went."""
    for j in range(task.robots):
        if j != k:
            z_next = int(now.cells[j])
            learn_from_peer(
                mind, task, k, now, j, z_next, common_with(mind, task, k, j)
            )


@jitable
def learn_from_arrival(mind: Any, task: Task, k: int, now: Transition) -> None:
    """Learn r^C of an arrival: where the peers went is not known."""
    for j in range(task.robots):
        if j != k:
            z = int(now.cells[j])
            row = met(mind.steps, task, k, step_key(task, now.cell, j, z, task.cells))
            mind.steps.updates[k, row, now.move] += 1
            alpha = step_size(task, int(mind.steps.updates[k, row, now.move]), now.step)
            common = common_with(mind, task, k, j)
            feel(mind.steps.values[k, row], now.move, common, alpha)


@jitable
def common_with(mind: Any, task: Task, k: int, j: int) -> float:
    """Return the r^C of the last step that is due to a peer, as often as it counts.

    It counts for all robots that pay it, as the setting `credit` says, where questions are
    answered. A robot that gets no answers counts its own loss alone: two that see nothing would
    else both give way.
    """
    last = mind.last[k]
    if (int(last[PARTNERS]) >> j) & 1 == 0:
        return 0.0
    z = int(last[CELLS + j])
    pair = find(mind.pairs, k, pair_key(task, int(last[CELL]), j, z))
    share = share_answered(mind, k, pair, z)
    weight = task.weights.common
    return float((share * weight + (1.0 - share) * min(weight, 1.0)) * last[COMMON])


@jitable
def feel(row: Any, b: int, common: float, alpha: float) -> None:
    """Move a mean of r^C toward the one that was felt; the first one counts whole."""
    if row[b] == NOT_FELT:
        row[b] = common
    else:
        row[b] = toward(row[b], alpha, common)


@jitable
def learn_from_peer(
    mind: Any,
    task: Task,
    k: int,
    now: Transition,
    j: int,
    z_next: int,
    common: float,
) -> None:
    """Learn rho_j of all moves in x from a step of peer j: equation (5).

    Args:
        mind: the team's mind; `last` is that step.
        task: its task.
        k: the robot.
        now: the transition after that step.
        j: the peer.
        z_next: the peer's cell after that step, z'.
        common: r^C of that step, if they interacted.
    """
    x = int(mind.last[k, CELL])
    move = int(mind.last[k, MOVE])
    z = int(mind.last[k, CELLS + j])
    y = now.cell
    step = met(mind.steps, task, k, step_key(task, x, j, z, z_next))
    pair = met(mind.pairs, task, k, pair_key(task, x, j, z))
    given = met(mind.pairs, task, k, pair_key(task, x, j, z_next))
    ended = met(mind.pairs, task, k, pair_key(task, y, j, z_next))
    made = mind.pairs.updates[k, pair]
    went = mind.steps.updates[k, step]
    # Count the step.
    made[MADE + move] += 1
    went[move] += 1
    # Of arrivals it does not know where the peer went: it counts no move that leads home.
    if mind.to[k, x, move] != task.goals[k]:
        mind.pairs.updates[k, given, TRIED + move] += 1
        mind.pairs.updates[k, given, LED + move] += y != x
    mind.pairs.updates[k, ended, ENDED] += 1
    alpha = step_size(task, int(mind.pairs.updates[k, ended, ENDED]), now.step)
    feel(mind.pairs.values[k, ended], FELT, common, alpha)
    if y != x:
        alpha = step_size(task, int(went[move]), now.step)
        feel(mind.steps.values[k, step], move, common, alpha)
    # Learn from it.
    total = made[MADE] + made[MADE + 1] + made[MADE + 2] + made[MADE + 3]
    share = (went[0] + went[1] + went[2] + went[3]) / total
    alpha = step_size(task, int(total) + 1, now.step)
    r = felt_in(mind, k, given)
    stays = r + task.discount * value_of(mind, task, k, x, given, z_next)
    rho = mind.pairs.values[k, pair]
    for b in range(PRIMITIVES):
        if is_known(mind.led[k, x, b], mind.tries[k, x, b]):
            out = chance_to_leave(mind, k, x, b, given)
            leaving = 0.0
            if out > 0.0:
                leaving = out * after_leaving(mind, task, k, j, b, z_next, step)
            target = leaving + (1.0 - out) * stays
            size = min(1.0, alpha * weight_of(made, went, share, b, move))
            rho[RHO + b] = toward(rho[RHO + b], size, target - mind.u[k, x, b])


@jitable
def chance_to_leave(mind: Any, k: int, x: int, b: int, given: int) -> float:
    """Return P(y != x | x, b, z') by the counts of the row `given` and of the model of moves."""
    out = mind.led[k, x, b] / mind.tries[k, x, b]
    led = mind.pairs.updates[k, given, LED + b] + OWN_TRIES * out
    return float(led / (mind.pairs.updates[k, given, TRIED + b] + OWN_TRIES))


@jitable
def felt_in(mind: Any, k: int, row: int) -> float:
    """Return the mean r^C of steps that ended in the cells of a row of `pairs`; 0: none did."""
    r = float(mind.pairs.values[k, row, FELT])
    return r if r != NOT_FELT else 0.0


@jitable
def after_leaving(
    mind: Any, task: Task, k: int, j: int, b: int, z_next: int, step: int
) -> float:
    """Return r^C + gamma V_j(y, z') for a move that leads out of x, to y.

    r^C is that of b with this step of the peer, the row `step`; if it never was felt, that of the
    cells where the step ends. On arrival it is that of b with the peer in z.
    """
    x = int(mind.last[k, CELL])
    y = int(mind.to[k, x, b])
    if y == task.goals[k]:
        z = int(mind.last[k, CELLS + j])
        arrival = find(mind.steps, k, step_key(task, x, j, z, task.cells))
        r = mind.steps.values[k, arrival, b]
        return arrival_value(task) + (r if r != NOT_FELT else 0.0)
    pair = find(mind.pairs, k, pair_key(task, y, j, z_next))
    r = mind.steps.values[k, step, b]
    if r == NOT_FELT:
        r = felt_in(mind, k, pair)
    return float(r + task.discount * value_of(mind, task, k, y, pair, z_next))


@jitable
def weight_of(made: Any, went: Any, share: float, b: int, move: int) -> float:
    """Return how much a peer's step counts for a move; 1 for the one that was made.

    It is P(z' | x, z, b) / P(z' | x, z, move): the peer's step may depend on the move, where
    robots stop each other. Each probability counts P(z' | x, z) as one try.

    Args:
        made: how often each move was made in x, with the peer in z.
        went: how often the peer then went to z'.
        share: P(z' | x, z).
        b: the move.
        move: the move that was made.
    """
    likely = (went[b] + share) / (made[MADE + b] + 1)
    made_likely = (went[move] + share) / (made[MADE + move] + 1)
    return float(min(MOST_WEIGHT, likely / made_likely))


@jitable
def learn_means(mind: Any, task: Task, k: int, now: Transition) -> None:
    """Move the means of (3) and (4) toward the values with the peers where they are now."""
    x = now.cell
    count = int(mind.arrivals[k, x]) + 1
    mind.arrivals[k, x] = count
    alpha = step_size(task, count, now.step)
    row = mind.row[k]
    worst(mind, task, k, x, now.cells, row)
    for b in range(PRIMITIVES):
        mind.gain[k, x, b] = toward(mind.gain[k, x, b], alpha, row[b])
    share = 1.0
    for j in range(task.robots):
        if j != k:
            z = int(now.cells[j])
            pair = find(mind.pairs, k, pair_key(task, x, j, z))
            share = min(share, share_answered(mind, k, pair, z))
    if share < 1.0:
        size = (1.0 - share) * alpha
        for b in range(PRIMITIVES):
            mind.blind[k, x, b] = toward(mind.blind[k, x, b], size, row[b])
    n = move_without_answer(mind, k, x, share)
    know(mind, task, k, x, now.cells, row)
    asking = worth_of_asking(row, share, n)
    worth = asking - greatest(mind.u[k, x], PRIMITIVES)
    mind.gain[k, x, COORDINATE] = toward(mind.gain[k, x, COORDINATE], alpha, worth)


@jitable
def note_step(mind: Any, task: Task, k: int, now: Transition) -> None:
    """Note a step: what the peers did in it is known after the next one."""
    last = mind.last[k]
    last[STEP] = now.step
    last[CELL] = now.cell
    last[MOVE] = now.move
    last[PARTNERS] = now.partners
    last[COMMON] = now.common
    for j in range(task.robots):
        last[CELLS + j] = now.cells[j]


@jitable
def refresh(mind: Any, task: Task, k: int, x: int) -> None:
    """Set Q*(x, .), by (3) and (4)."""
    for b in range(PRIMITIVES):
        mind.q_star[k, x, b] = mind.u[k, x, b] + mind.gain[k, x, b]
        if is_wall(mind.led[k, x, b], mind.tries[k, x, b]):
            mind.q_star[k, x, b] = FORBIDDEN
    worth = greatest(mind.u[k, x], PRIMITIVES) + mind.gain[k, x, COORDINATE]
    mind.q_star[k, x, COORDINATE] = worth - price(task)


# Stand-offs.


@jitable
def patience(mind: Any, task: Task, k: int, x: int, cells: Any, values: Any) -> None:
    """Take the value of waiting times gamma^(w - 4), after w > 4 answers in which nobody moved.

    It waits by moves into walls. Only values above 0 lose.

    Nobody: neither the robot nor the peer in its way, the worst one of its best move alone. Two
    robots that face each other with others behind them see a way out in pairs; the team has
    none, and learning does not show it, as robots that explore break it up.
    """
    way = best_move(mind.u[k, x])
    in_way = -1
    lowest = 0.0
    for j in range(task.robots):
        if j != k:
            row = find(mind.pairs, k, pair_key(task, x, j, int(cells[j])))
            rho = mind.pairs.values[k, row, RHO + way]
            if in_way < 0 or rho < lowest:
                in_way = j
                lowest = rho
    stood = mind.stood[k]
    count = 0
    if stood[1 + k] == x and stood[1 + in_way] == cells[in_way]:
        count = int(stood[0]) + 1
    stood[0] = count
    for j in range(task.robots):
        stood[1 + j] = cells[j]
    left = 1.0
    for _ in range(PATIENCE, count):
        left *= task.discount
    for b in range(PRIMITIVES):
        if is_wall(mind.led[k, x, b], mind.tries[k, x, b]) and values[b] > 0.0:
            values[b] *= left
