# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 with Q* and Q^C in factors: values U of a robot alone, and corrections by its peers.

    Q*(x, b)          = U(x, b) + r_bar(x, b)                      for the four moves b
    Q*(x, COORDINATE) = max_b U(x, b) - cost of asking + W(x)
    Q^C(x, z, b)      = U(x, b) + sum over the peers j of rho_j(x, z_j, b)

By its definition Q^C(x, z, b) = E[r^I + gamma max Q*(y, .)] + E[r^C]: the first term, U, does not
depend on where the peers are; the second, rho, is 0 in nearly all joint states. A failed percept
has a row of rho of its own. docs/coordination.md has the rule and its reasons.

Parts of the rule have modules of their own: `own_moves` (U, and the model of moves),
`corrections` (rho), `looking_back` (two questions in a row).
"""

from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import (
    BLIND_ACTION,
    BLIND_EXPLORE,
    LEAVE,
    MOVE_TIE,
    draw,
)
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.sight import is_ruled_out
from sparse_coord_ros.core.game.specs import Spec
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.corrections import (
    correct,
    failed_key,
    gain,
    learn_rho,
    rho_key,
)
from sparse_coord_ros.core.learners.learner import MAP_SAMPLES, Learner
from sparse_coord_ros.core.learners.lone import known_q_star
from sparse_coord_ros.core.learners.looking_back import (
    learn_from_two_questions,
    loss_of_stop,
    note_question,
)
from sparse_coord_ros.core.learners.mind import Memory
from sparse_coord_ros.core.learners.own_moves import (
    count_move,
    learn_u,
    refresh,
    replay,
)
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    Values,
    explores,
    greedy,
    scheduled,
    step_size,
    toward,
)
from sparse_coord_ros.core.learners.table import Table, met, table

MOST_CREDIT = 8
"""How often r^C counts at most by default: of sixteen robots that count it for all, some never
move."""

LEAVING = 0.5
"""The probability with which a robot leaves a stand-off."""

LEAVING_SHARE = 0.25
"""The share of the best move's value that a robot gives up to leave a stand-off."""


class Factored(Learner):
    """Algorithm 1 with Q* and Q^C in factors."""

    name = "factored"
    title = "Factored"
    summary = "Algorithm 1 for the team's return; Q^C: an individual part plus sparse corrections"
    partners = True
    rules_out = True
    defaults = MappingProxyType(
        {
            "epsilon": "linear:0.3:0.02:0.8",
            "starts": "exploring:1:0:0.5",
            "peers": "all",
            "credit": "team",
            "step_size": "floored:0.6:0.1:0.01",
        }
    )
    values = ("q_star", "value", "u", "alone", "r_bar", "w", "rho")
    given = ("leaves",)
    scratch = ("correction", "found", "there", "obstruction", "obstructed")

    class Mind(NamedTuple):
        """The learned tables; k is a robot, x its cell, b a move, j a peer.

        Attributes:
            q_star: Q* [k, x, action], kept up to date.
            value: max_b Q*(x, b) over all five actions [k, x], kept up to date.
            updates: how often a move was tried [k, x, b], and COORDINATE [k, x, 4].
            u: U [k, x, b].
            r_bar: r^C to be expected without knowing where the peers are [k, x, b].
            w: W, the value of a percept [k, x].
            rho: a row [b] for own cell, peer and its cell; and one for failed percepts.
            door: the last r^C felt on coming to a cell, or staying there, weighed; 0: never any
                [k, x].
            passage: the last r^C felt on coming to a cell in exchange for a peer, likewise.
            narrow: whether a peer ever stopped the robot on its way into a cell [k, x].
            commons: updates of each entry of r_bar [k, x, b].
            moved: how often a move led out of its cell [k, x, b].
            successor: the cell where it led the last time [k, x, b].
            last: of the last step with COORDINATE: the step after it, the move and all robots'
                cells, the peers' `NOT_PERCEIVED` where the percept failed [k, 2 + j].
            tried: the moves that were tried, 4 x + b, in the order of their first time [k, n].
            used: the number of tried moves [k, 0].
            alone: U of a robot that is alone in the world [k, x, b].
            asked: of the last question with an answer: the step after it, and all robots' cells
                then [k, 1 + j].
            leaves: whether the robot leaves stand-offs [k].
            correction: space for Q^C(x, z, .) - U(x, .) [k, b].
            found: space for the rows that it adds up to [k, j].
            there: space for the value of the second of two questions where each move leads
                [k, b].
            obstruction: space for the degree to which each peer is in the way there [k, b, j].
            obstructed: space for their sum [k, b].
        """

        q_star: Any
        value: Any
        updates: Any
        u: Any
        r_bar: Any
        w: Any
        rho: Table
        door: Any
        passage: Any
        narrow: Any
        commons: Any
        moved: Any
        successor: Any
        last: Any
        tried: Any
        used: Any
        alone: Any
        asked: Any
        leaves: Any
        correction: Any
        found: Any
        there: Any
        obstruction: Any
        obstructed: Any

    # A team.

    def with_defaults(self, scenario: Scenario) -> Scenario:
        """As of `Learner`; with more than `MOST_CREDIT` robots r^C counts so often."""
        chosen = super().with_defaults(scenario)
        if len(scenario.robots) > MOST_CREDIT and "credit" not in scenario.given:
            chosen = replace(chosen, credit=Spec("weight", (float(MOST_CREDIT),)))
        return chosen

    def check(self, scenario: Scenario) -> None:
        """Raise `SettingError` unless COORDINATE perceives every peer."""
        super().check(scenario)
        if len(scenario.robots) > 2 and scenario.peers != "all":
            raise SettingError(
                f"setting peers: value is {scenario.peers!r}, allowed with learner factored and "
                "more than two robots: all; set peers=all, or leave it out"
            )

    def rows_of_a_cell(self, scenario: Scenario) -> int:
        """As of `Learner`: one for each peer's cell, and one for failed percepts."""
        return (len(scenario.robots) - 1) * len(scenario.map.cells) + 1

    def check_memory(self, scenario: Scenario, robot: int, memory: Memory) -> None:
        """Raise `ValueError` unless the robot knew as much of its map as the scenario says.

        A robot that knows its map counts all moves as tried from the beginning, in their order.
        """
        tried = memory["tried"]
        prior = "map" if np.array_equal(tried, np.arange(len(tried))) else "none"
        if prior != scenario.prior:
            raise ValueError(
                f"learned with prior={prior}, this scenario has prior={scenario.prior}; set "
                f"prior={prior}"
            )

    # One robot.

    @staticmethod
    def initial(scenario: Scenario, robot: int) -> Any:
        """Return the factors before learning: U is `q_coord_init`, all else 0."""
        cells = len(scenario.map.cells)
        team = len(scenario.robots)
        moves = (cells, PRIMITIVES)
        u = np.full(moves, scenario.q_coord_init)
        q_star = np.full((cells, len(ACTIONS)), scenario.q_coord_init + 0.0)
        q_star[:, COORDINATE] = scenario.q_coord_init - scenario.ask_cost + 0.0
        keys = failed_key(cells, cells, team)
        return Factored.Mind(
            q_star=q_star,
            value=q_star.max(axis=1),
            updates=np.zeros(q_star.shape, dtype=np.int64),
            u=u,
            r_bar=np.zeros(moves),
            w=np.zeros(cells),
            rho=table(keys, np.zeros((1, PRIMITIVES)), team),
            door=np.zeros(cells),
            passage=np.zeros(cells),
            narrow=np.zeros(cells, dtype=bool),
            commons=np.zeros(moves, dtype=np.int64),
            moved=np.zeros(moves, dtype=np.int64),
            successor=np.zeros(moves, dtype=np.int64),
            last=np.zeros(2 + team, dtype=np.int64),
            tried=np.zeros(cells * PRIMITIVES, dtype=np.int64),
            used=np.zeros(1, dtype=np.int64),
            alone=np.zeros(moves),
            asked=np.zeros(1 + team, dtype=np.int64),
            leaves=np.array(leaves_stand_offs(scenario)),
            correction=np.zeros(PRIMITIVES),
            found=np.zeros(team, dtype=np.int64),
            there=np.zeros(PRIMITIVES),
            obstruction=np.zeros((PRIMITIVES, team)),
            obstructed=np.zeros(PRIMITIVES),
        )

    @staticmethod
    def informed(
        mind: Any, scenario: Scenario, robot: int, weights: RewardWeights
    ) -> Any:
        """Return the factors of a robot that knows its map: U, and its model of moves."""
        q_star = known_q_star(scenario, robot, weights, mind.q_star)
        alone = q_star[:, :PRIMITIVES]
        lead = scenario.map.next_cell
        leads = lead != np.arange(len(lead))[:, None]
        return mind._replace(
            q_star=q_star,
            value=q_star.max(axis=1),
            u=alone,
            alone=alone,
            moved=leads * max(1, round(scenario.known_success * MAP_SAMPLES)),
            successor=np.where(leads, lead, 0),
            tried=np.arange(lead.size),
            used=np.array([lead.size]),
        )

    @staticmethod
    def begin_episode(mind: Any, task: Task, k: int) -> None:
        """Forget the last question: no step has number 0."""
        mind.asked[k, 0] = 0

    @staticmethod
    def asking_values(
        mind: Any, task: Task, k: int, cell: int, seen: int, cells: Any, values: Any
    ) -> None:
        """Set the values U + rho, with rho of the perceived peers or of failed percepts."""
        correct(mind, task, k, cell, seen, cells)
        for b in range(PRIMITIVES):
            values[b] = mind.u[k, cell, b] + mind.correction[k, b]

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
        """Return the greedy move, or at random the way out of a stand-off.

        Only after a failed percept the move is explored.
        """
        key = task.keys[k]
        if seen == 0 and explores(task, k, step, BLIND_EXPLORE):
            return int(draw(key, step, BLIND_ACTION) * PRIMITIVES)
        move = greedy(values, PRIMITIVES, key, step, MOVE_TIE)
        if seen == 0 or not mind.leaves[k]:
            return move
        if asks_again(mind, task, k, step, cells):
            out = way_out(mind, k, cell, values, move)
            if out != move and draw(key, step, LEAVE) < LEAVING:
                return out
        return move

    @staticmethod
    def bootstrap(mind: Any, task: Task, k: int, cell: int, now: Transition) -> float:
        """Return max_b Q*(cell, b), which is kept up to date."""
        return float(mind.value[k, cell])

    @staticmethod
    def learn(mind: Any, task: Task, k: int, now: Transition, after: float) -> None:
        """Learn U, r_bar or rho and W; then replay a move."""
        y = now.next_cell
        if was_stopped(mind, task, k, now):
            y = int(mind.successor[k, now.cell, now.move])
            after = task.goal_value if y == task.goals[k] else float(mind.value[k, y])
        brought = brought_by_peers(mind, task, k, now, y)
        count_move(mind, task, k, now, y)
        learn_u(mind, task, k, now, after)
        if now.action == COORDINATE:
            learn_asking(mind, task, k, now, brought)
        else:
            learn_r_bar(mind, task, k, now, brought)
        refresh(mind, task, k, now.cell)
        replay(mind, task, k, now.step)


# Stand-offs.


def leaves_stand_offs(scenario: Scenario) -> bool:
    """Return whether robots leave stand-offs.

    They do in teams of more than two, if percepts do not depend on the robots' cells.
    """
    anywhere = scenario.perception.kind in ("always", "probability")
    return len(scenario.robots) > 2 and anywhere


@jitable
def asks_again(mind: Any, task: Task, k: int, step: int, cells: Any) -> bool:
    """Return whether the robot was answered in the last step, too, and no robot has moved since.

    It notes this answer for the next question.
    """
    again = mind.asked[k, 0] == step
    for robot in range(task.robots):
        again = again and mind.asked[k, 1 + robot] == cells[robot]
        mind.asked[k, 1 + robot] = cells[robot]
    mind.asked[k, 0] = step + 1
    return bool(again)


@jitable
def way_out(mind: Any, k: int, cell: int, values: Values, move: int) -> int:
    """Return the best move that leads away, if its value is close to that of the best move.

    If the best move leaves the robot in its cell, it would stand there for ever.
    """
    if mind.moved[k, cell, move] > 0:
        return move
    out = move
    for b in range(PRIMITIVES):
        if mind.moved[k, cell, b] > 0 and (out == move or values[b] > values[out]):
            out = b
    if values[out] < (1.0 - LEAVING_SHARE) * values[move]:
        return move
    return out


# Learning.


@jitable
def was_stopped(mind: Any, task: Task, k: int, now: Transition) -> bool:
    """Return whether a peer stopped the robot on its way to a cell that it knows."""
    if not task.blocks or now.next_cell != now.cell or common_of(task, now) != 0.0:
        return False
    return bool(now.partners > 0 and mind.moved[k, now.cell, now.move] > 0)


@jitable
def common_of(task: Task, now: Transition) -> float:
    """Return r^C as it counts in learning."""
    return float(task.weights[1] * now.common)


@jitable
def brought_by_peers(mind: Any, task: Task, k: int, now: Transition, y: int) -> float:
    """Return r^C, or the loss from a stop; note the place.

    Args:
        mind: the team's mind.
        task: its task.
        k: the robot.
        now: the step.
        y: the cell where the move leads a robot alone: the next cell, if no peer stopped it.
    """
    if y != now.next_cell:
        mind.narrow[k, y] = True
        return -loss_of_stop(task)
    common = common_of(task, now)
    if now.partners == 0 or common == 0.0:
        return 0.0
    if not task.swaps:
        mind.door[k, y] = common
    elif now.seen != 0:
        if came_from(task, k, now, y):
            mind.passage[k, y] = common
        else:
            mind.door[k, y] = common
    return common


@jitable
def came_from(task: Task, k: int, now: Transition, y: int) -> bool:
    """Return whether the robot went into a cell where a partner was."""
    if now.cell == y:
        return False
    for peer in range(task.robots):
        its = (now.partners >> peer) & 1
        if peer != k and its and now.cells[peer] == y:
            return True
    return False


@jitable
def learn_r_bar(mind: Any, task: Task, k: int, now: Transition, brought: float) -> None:
    """Learn r_bar from a move without a question; `brought` as of `brought_by_peers`."""
    x = now.cell
    b = now.move
    count = int(mind.commons[k, x, b]) + 1
    mind.commons[k, x, b] = count
    floor = scheduled(task.floors, now.step)
    alpha = max(1.0 / (count + 1), floor / max(1.0, task.weights[1]))
    mind.r_bar[k, x, b] = toward(mind.r_bar[k, x, b], alpha, brought)


@jitable
def learn_asking(
    mind: Any, task: Task, k: int, now: Transition, brought: float
) -> None:
    """Learn from COORDINATE: rho of the percept, W and r_bar.

    `brought` as of `brought_by_peers`.
    """
    learn_percept(mind, task, k, now, brought)
    if mind.last[k, 0] == now.step:
        learn_from_two_questions(mind, task, k, now)
    note_question(mind, task, k, now)
    x = now.cell
    correct(mind, task, k, x, now.seen, now.cells)
    count = int(mind.updates[k, x, COORDINATE]) + 1
    mind.updates[k, x, COORDINATE] = count
    alpha = step_size(task, count, now.step)
    value = gain(mind.u[k, x], mind.correction[k])
    mind.w[k, x] = toward(mind.w[k, x], alpha, value)
    floor = scheduled(task.floors, now.step)
    for b in range(PRIMITIVES):
        mind.r_bar[k, x, b] = toward(mind.r_bar[k, x, b], floor, mind.correction[k, b])


@jitable
def learn_percept(
    mind: Any, task: Task, k: int, now: Transition, brought: float
) -> None:
    """Learn rho of the move after a question: of each peer, or of the failed percept.

    If a failed percept rules out a peer in the own cell, it learns r^C as often as it was felt,
    without the credit.
    """
    x = now.cell
    if now.seen == 0:
        if is_ruled_out(task.sight, x, x) and brought == common_of(task, now):
            brought = now.common if now.partners != 0 else 0.0
        key = failed_key(x, task.cells, task.robots)
        row = met(mind.rho, task, k, key)
        learn_rho(mind, task, k, now, row, now.move, brought)
        return
    for peer in range(task.robots):
        if peer != k:
            its = brought if (now.partners >> peer) & 1 else 0.0
            key = rho_key(x, peer, int(now.cells[peer]), task.cells, task.robots)
            row = met(mind.rho, task, k, key)
            learn_rho(mind, task, k, now, row, now.move, its)
