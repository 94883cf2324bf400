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

from sparse_coord_ros.base.compiling import of_learner
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
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
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.lone import known_q_star
from sparse_coord_ros.core.learners.looking_back import (
    in_the_way,
    learn_from_two_questions,
    loss_of_stop,
    note_question,
)
from sparse_coord_ros.core.learners.mind import Memory, Rows, empty_rows, place
from sparse_coord_ros.core.learners.own_moves import (
    LEAST_VALUE_SHARE,
    count_move,
    learn_u,
    plan_cell,
    plan_move,
    refresh,
)
from sparse_coord_ros.core.learners.rules import (
    MAP_SAMPLES,
    Task,
    Transition,
    greatest,
    step_size,
    toward,
)

MOST_CREDIT = 8
"""How often r^C counts at most by default: of sixteen robots that count it for all, some never
move."""

GOLDEN = 0.6180339887498949
"""Golden section: its multiples, modulo 1, spread one draw evenly over the moves to replay."""

STOP = 0.5
"""The weight of a stop, as a share of the value of an arrival. It costs one step, but robots that
stop each other may stand for ever: by that step alone most teams in a lane do."""

LEAVING_SHARE = 0.25
"""The share of the best move's value that a robot gives up to leave a stand-off."""


class Factored(Learner):
    """Algorithm 1 with Q* and Q^C in factors."""

    name = "factored"
    title = "Factored"
    summary = "Algorithm 1 for the team's return; Q^C: an individual part plus sparse corrections"
    draws = True
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
    scratch = ("correction", "found", "there", "obstruction")

    class Mind(NamedTuple):
        """The learned tables of a robot; x is a cell, b a move.

        Attributes:
            q_star: Q* [x][action], kept up to date.
            value: max_b Q*(x, b) over all five actions [x], kept up to date.
            updates: how often a move was tried [x][b], and COORDINATE [x][4].
            u: U [x][b].
            r_bar: r^C to be expected without knowing where the peers are [x][b].
            w: W, the value of a percept [x].
            rho: a row [b] for own cell, peer and its cell; and one for failed percepts.
            door: the last r^C felt on coming to a cell, or staying there, weighed; 0: never any.
            passage: the last r^C felt on coming to a cell in exchange for a peer, likewise.
            narrow: whether a peer ever stopped the robot on its way into a cell [x].
            commons: updates of each entry of r_bar [x][b].
            moved: how often a move led out of its cell [x][b].
            successor: the cell where it led the last time [x][b].
            last: of the last step with COORDINATE: the step after it, the move and all robots'
                cells, the peers' `NOT_PERCEIVED` where the percept failed.
            tried: the moves that were tried, x * moves + b, in the order of their first time.
            used: the number of tried moves [0].
            alone: U of a robot that is alone in the world [x][b].
            asked: of the last question with an answer: the step after it, and all robots' cells
                then.
            correction: space for Q^C(x, z, .) - U(x, .) [b].
            found: space for the rows that it adds up to [robot].
            there: space for the value of the second of two questions where each move leads [b].
            obstruction: space for the degree to which each robot is in the way there [b][robot].
        """

        q_star: Any
        value: Any
        updates: Any
        u: Any
        r_bar: Any
        w: Any
        rho: Rows
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
        correction: Any
        found: Any
        there: Any
        obstruction: Any

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

    def leaves_stand_offs(self, scenario: Scenario) -> bool:
        """As of `Learner`: of more than two robots, if percepts do not depend on their cells."""
        anywhere = scenario.perception.kind in ("always", "probability")
        return len(scenario.robots) > 2 and anywhere

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
    def initial(scenario: Scenario, robot: int) -> Mind:
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
            updates=np.zeros(q_star.shape, dtype=np.int32),
            u=u,
            r_bar=np.zeros(moves),
            w=np.zeros(cells),
            rho=empty_rows(keys, np.zeros((1, PRIMITIVES)), team),
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
            correction=np.zeros(PRIMITIVES),
            found=np.zeros(team, dtype=np.int64),
            there=np.zeros(PRIMITIVES),
            obstruction=np.zeros((PRIMITIVES, team)),
        )

    @staticmethod
    def informed(
        mind: Mind, scenario: Scenario, robot: int, weights: RewardWeights
    ) -> Mind:
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
    def begin_episode(mind: Mind, task: Task) -> None:
        """Forget the last question: no step has number 0."""
        mind.asked[0] = 0

    @staticmethod
    def asking_values(
        mind: Mind, task: Task, cell: int, seen: int, cells: Any, values: Any
    ) -> None:
        """Set the values U + rho, with rho of the perceived peers or of failed percepts."""
        correct(mind, task, cell, seen, cells)
        for b in range(PRIMITIVES):
            values[b] = mind.u[cell][b] + mind.correction[b]

    @staticmethod
    def explores(mind: Mind, task: Task, seen: int) -> bool:
        """Return whether the percept failed: only then the move is explored."""
        return seen == 0

    @staticmethod
    def way_out(
        mind: Mind,
        task: Task,
        step: int,
        cell: int,
        seen: int,
        cells: Any,
        values: Any,
        move: int,
    ) -> int:
        """Return the best move that leads away, if its value is close to that of the best move.

        The robot is in a stand-off if it also asked in the last step, no robot has moved since,
        and its best move leaves it in its cell: it would stand there for ever.
        """
        if seen == 0:
            return move
        again = mind.asked[0] == step
        for robot in range(task.robots):
            again = again and mind.asked[1 + robot] == cells[robot]
            mind.asked[1 + robot] = cells[robot]
        mind.asked[0] = step + 1
        if not again or mind.moved[cell][move] > 0:
            return move
        out = move
        for b in range(PRIMITIVES):
            if mind.moved[cell][b] > 0 and (out == move or values[b] > values[out]):
                out = b
        if values[out] < (1.0 - LEAVING_SHARE) * values[move]:
            return move
        return out

    @staticmethod
    def learn(mind: Mind, task: Task, now: Transition) -> None:
        """Learn U, r_bar or rho and W; then replay a move."""
        y = led_to(mind, task, now)
        brought = brought_by_peers(mind, task, now, y)
        count_move(mind, task, now, y)
        learn_u(mind, task, now, y)
        if now.action == COORDINATE:
            learn_asking(mind, task, now, brought)
        else:
            learn_r_bar(mind, task, now, brought)
        refresh(mind, task, now.cell)
        replay(mind, task, now)

    # Parts that an ablation turns off.

    @staticmethod
    def share_of_surplus(mind: Mind, task: Task, first: int, here: float) -> float:
        """Return the gain of waiting at the first question, for each peer in the way.

        The peers share a surplus: if each were credited with all of it, r_bar would say that
        waiting pays without asking, too. A loss counts in full.
        """
        if here > 0.0 and task.robots > 2:
            return here / max(1, in_the_way(mind, task, first))
        return here

    @staticmethod
    def cell_value(mind: Mind, task: Task, cell: int) -> float:
        """Return max_b Q*(cell, b); in a larger team at least a share of a lone robot's.

        There r^C counts so often that the values of a room could fall to 0, and stay there.
        """
        best = greatest(mind.q_star[cell], len(ACTIONS))
        if task.robots > 2:
            return max(best, LEAST_VALUE_SHARE * greatest(mind.alone[cell], PRIMITIVES))
        return best

    @staticmethod
    def update_by_percept(mind: Mind, task: Task, cell: int, floor: float) -> None:
        """Move r_bar of every move toward the correction of the percept."""
        for b in range(PRIMITIVES):
            mind.r_bar[cell][b] = toward(mind.r_bar[cell][b], floor, mind.correction[b])

    @staticmethod
    def was_stopped(mind: Mind, task: Task, now: Transition) -> bool:
        """Return whether a peer stopped the robot on its way to a cell that it knows."""
        if not task.blocks or now.next_cell != now.cell or now.common != 0.0:
            return False
        return now.partners > 0 and mind.moved[now.cell][now.move] > 0

    @staticmethod
    def loss_of_stop(mind: Mind, task: Task) -> float:
        """Return the loss from a stop: a share of the value of arrival."""
        arrival: float = task.goal_reward + task.discount * task.goal_value
        return STOP * arrival

    @staticmethod
    def came_from(mind: Mind, task: Task, now: Transition, y: int) -> bool:
        """Return whether the robot went into a cell where a partner was."""
        if now.cell == y:
            return False
        for peer in range(task.robots):
            its = (now.partners >> peer) & 1
            if peer != task.number and its and now.cells[peer] == y:
                return True
        return False

    @staticmethod
    def look_back(mind: Mind, task: Task, now: Transition) -> None:
        """Learn from two questions in a row the result of each move at the first."""
        learn_from_two_questions(mind, task, now)

    @staticmethod
    def replay(mind: Mind, task: Task, now: Transition) -> None:
        """Set U of moves to their values in the robot's own model (Dyna).

        They are drawn among the moves that were tried. A robot that knows its map replays all
        moves of the cell.
        """
        for number in range(task.replays):
            draw = (now.draw + number * GOLDEN) % 1.0
            pair = mind.tried[int(draw * mind.used[0])]
            x = pair // PRIMITIVES
            if task.map_samples > 0:
                plan_cell(mind, task, x)
            else:
                plan_move(mind, task, x, pair % PRIMITIVES)
            refresh(mind, task, x)


@of_learner
def update_by_percept(mind: Any, task: Task, cell: int, floor: float) -> None:
    """As `Factored.update_by_percept`."""


@of_learner
def was_stopped(mind: Any, task: Task, now: Transition) -> bool:
    """As `Factored.was_stopped`."""
    raise NotImplementedError


@of_learner
def came_from(mind: Any, task: Task, now: Transition, y: int) -> bool:
    """As `Factored.came_from`."""
    raise NotImplementedError


@of_learner
def look_back(mind: Any, task: Task, now: Transition) -> None:
    """As `Factored.look_back`."""


@of_learner
def replay(mind: Any, task: Task, now: Transition) -> None:
    """As `Factored.replay`."""


# Learning.


@inlined
def led_to(mind: Any, task: Task, now: Transition) -> int:
    """Return the cell where the move of a step leads a robot alone.

    That is the next cell; if a peer stopped the robot, the cell where the move led before.
    """
    if was_stopped(mind, task, now):
        cell: int = mind.successor[now.cell][now.move]
        return cell
    return now.next_cell


@inlined
def brought_by_peers(mind: Any, task: Task, now: Transition, y: int) -> float:
    """Return r^C, or the loss from a stop on the way to cell y; note the place."""
    if y != now.next_cell:
        mind.narrow[y] = True
        return -loss_of_stop(mind, task)
    if now.partners == 0 or now.common == 0.0:
        return 0.0
    if not task.swaps:
        mind.door[y] = now.common
    elif now.seen != 0:
        if came_from(mind, task, now, y):
            mind.passage[y] = now.common
        else:
            mind.door[y] = now.common
    return now.common


@inlined
def learn_r_bar(mind: Any, task: Task, now: Transition, brought: float) -> None:
    """Learn r_bar from a move without a question; `brought` as of `brought_by_peers`."""
    x = now.cell
    b = now.move
    count = mind.commons[x][b] + 1
    mind.commons[x][b] = count
    alpha = max(1.0 / (count + 1), now.floor / max(1.0, task.credit))
    mind.r_bar[x][b] = toward(mind.r_bar[x][b], alpha, brought)


@inlined
def learn_asking(mind: Any, task: Task, now: Transition, brought: float) -> None:
    """Learn from COORDINATE: rho of the percept, and W; `brought` as of `brought_by_peers`."""
    learn_percept(mind, task, now, brought)
    if mind.last[0] == now.step:
        look_back(mind, task, now)
    note_question(mind, task, now)
    x = now.cell
    correct(mind, task, x, now.seen, now.cells)
    count = mind.updates[x][COORDINATE] + 1
    mind.updates[x][COORDINATE] = count
    alpha = step_size(task, count, now.floor)
    mind.w[x] = toward(mind.w[x], alpha, gain(mind.u[x], mind.correction))
    update_by_percept(mind, task, x, now.floor)


@inlined
def learn_percept(mind: Any, task: Task, now: Transition, brought: float) -> None:
    """Learn rho of the move after a question: of each peer, or of the failed percept.

    If a failed percept rules out a peer in the own cell, it learns r^C as often as it was felt,
    without the credit.
    """
    x = now.cell
    if now.seen == 0:
        if is_ruled_out(task.sight, x, x) and brought == now.common:
            brought = now.felt if now.partners != 0 else 0.0
        key = failed_key(x, task.cells, task.robots)
        learn_rho(mind, task, now, place(mind.rho, key), now.move, brought)
        return
    for peer in range(task.robots):
        if peer != task.number:
            its = brought if (now.partners >> peer) & 1 else 0.0
            key = rho_key(x, peer, now.cells[peer], task.cells, task.robots)
            learn_rho(mind, task, now, place(mind.rho, key), now.move, its)
