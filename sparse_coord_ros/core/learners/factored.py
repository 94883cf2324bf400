# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 with Q* and Q^C in factors: values U of a robot alone, and corrections by its peers.

    Q*(x, b)          = U(x, b) + r_bar(x, b)                      for the four moves b
    Q*(x, COORDINATE) = max_b U(x, b) - cost of asking + W(x)
    Q^C(x, z, b)      = U(x, b) + sum over the peers j of rho_j(x, z_j, b)

By its definition Q^C(x, z, b) = E[r^I + gamma max Q*(y, .)] + E[r^C]: the first term, U, does not
depend on where the peers are; the second, rho, is 0 in nearly all joint states. A failed percept
has a row of rho of its own. docs/coordination.md has the rule and its reasons.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import inlined, inner, of_learner
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.base.npz import MOST_UPDATES, check_range
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.interactions import interactions_of, stops
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.settings import LARGEST_WHOLE
from sparse_coord_ros.core.game.sight import is_ruled_out
from sparse_coord_ros.core.game.specs import Spec
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.lone import known_q_star
from sparse_coord_ros.core.learners.mind import (
    NO_ROW,
    Memory,
    Rows,
    empty_rows,
    find,
    place,
)
from sparse_coord_ros.core.learners.rules import (
    MAP_SAMPLES,
    NOT_PERCEIVED,
    Task,
    Transition,
    Values,
    greatest,
    map_samples,
    step_size,
)

MOST_CREDIT = 8
"""How often r^C counts at most by default: of sixteen robots that count it for all, some never
move."""

GOLDEN = 0.6180339887498949
"""Golden section: its multiples, modulo 1, spread one draw evenly over the moves to replay."""

STOP = 0.5
"""The weight of a stop, as a share of the value of an arrival. It costs one step, but robots that
stop each other may stand for ever: by that step alone most teams in a lane do."""

LEAVE = Spec("leave", (0.5, 0.25))
"""How robots of a team of more than two leave a stand-off, unless another way was chosen."""

LEAST_VALUE_SHARE = 0.36
"""The least value of a cell in a team of more than two, as a share of a lone robot's."""


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
    leaves = True
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
        """As of `Learner`; three more settings have a default that depends on the team.

        With more than two robots, or robots that stop each other, `referee` is on. More than two
        leave stand-offs if percepts do not depend on where the robots are. With more than
        `MOST_CREDIT` robots r^C counts so often.
        """
        chosen = super().with_defaults(scenario)
        given = scenario.given
        team = len(scenario.robots)
        refereed = team > 2 or interactions_of(scenario).blocks
        if refereed and "referee" not in given:
            chosen = replace(chosen, referee=True)
        anywhere = scenario.perception.kind in ("always", "probability")
        if team > 2 and anywhere and "stand_off" not in given:
            chosen = replace(chosen, stand_off=LEAVE)
        if team > MOST_CREDIT and "credit" not in given:
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

    def learned_rows(self, scenario: Scenario, memory: Memory) -> np.ndarray:
        """As of `Learner`: corrections that are not 0."""
        cells = len(scenario.map.cells)
        robots = len(scenario.robots)
        keys = memory["rho_keys"][memory["rho_values"].any(axis=1)]
        return np.bincount(states_of(keys, cells, robots)[:, 0], minlength=cells)

    def check_memory(self, scenario: Scenario, robot: int, memory: Memory) -> None:
        """Check the prior, the successors and counts of moves, r^C, and the last question."""
        cells = len(scenario.map.cells)
        prior = prior_of(memory)
        if prior != scenario.prior:
            raise ValueError(
                f"learned with prior={prior}, this scenario has prior={scenario.prior}; set "
                f"prior={prior}"
            )
        weight = self.weights(scenario).common
        felt = weight * scenario.penalties[robot]
        with_help = weight * (scenario.penalties[robot] + scenario.help_rewards[robot])
        for name in ("door", "passage"):
            if not np.isin(memory[name], [0.0, felt, with_help]).all():
                raise ValueError(f"{name} has an r^C that is neither 0 nor {felt:g}")
        best = memory["q_star"].max(axis=1)
        kept = np.maximum(best, LEAST_VALUE_SHARE * memory["alone"].max(axis=1))
        value = memory["value"]
        if ((value != best) & (value != kept)).any():
            raise ValueError("value is not the maximum of q_star")
        made = memory["updates"][:, :PRIMITIVES]
        modelled = made + map_samples(scenario)
        for name, most in (("commons", made), ("moved", modelled)):
            check_range(memory[name], 0, MOST_UPDATES, name)
            if (memory[name] > most).any():
                raise ValueError(f"{name} counts a move more often than it was tried")
        check_range(memory["used"], 0, len(memory["tried"]) + 1, "used")
        used = int(memory["used"][0])
        tried = np.sort(memory["tried"][:used])
        known = np.array_equal(tried, np.flatnonzero(modelled))
        if not known or memory["tried"][used:].any():
            raise ValueError("tried are not the moves that were counted")
        successor = memory["successor"]
        left = memory["moved"] > 0
        check_range(successor, 0, cells, "successor")
        if (
            successor[~left].any()
            or (successor == np.arange(cells)[:, None])[left].any()
        ):
            raise ValueError(
                "successor is not another cell just where a move led out of its own"
            )
        _check_last(memory["last"], robot, cells)
        check_range(memory["asked"], 0, LARGEST_WHOLE, "asked")
        check_range(memory["asked"][1:], 0, cells, "asked")

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
    def stands_off(
        mind: Mind, task: Task, step: int, cell: int, seen: int, cells: Any, move: int
    ) -> bool:
        """Return whether the robot also asked in the last step, and no robot has moved since.

        If its best move also leaves it in its cell, it would otherwise stand there for ever.
        """
        if seen == 0:
            return False
        again = mind.asked[0] == step
        for robot in range(task.robots):
            again = again and mind.asked[1 + robot] == cells[robot]
            mind.asked[1 + robot] = cells[robot]
        mind.asked[0] = step + 1
        return again and mind.moved[cell][move] == 0

    @staticmethod
    def way_out(mind: Mind, task: Task, cell: int, values: Any, move: int) -> int:
        """Return the best move that leads away, if its value is close to that of the best move."""
        found = move
        for b in range(PRIMITIVES):
            if mind.moved[cell][b] > 0 and (found == move or values[b] > values[found]):
                found = b
        if values[found] < (1.0 - task.leaving_share) * values[move]:
            return move
        return found

    @staticmethod
    def learn(mind: Mind, task: Task, now: Transition) -> None:
        """Learn U, r_bar or rho and W; then replay a move."""
        y = led_to(mind, task, now)
        brought = brought_by_peers(mind, task, now, y)
        learn_move(mind, task, now, y, brought)
        if now.action == COORDINATE:
            learn_asking(mind, task, now, brought)
        refresh(mind, task, now.cell)
        replay(mind, task, now)

    # Parts that an ablation turns off.

    @staticmethod
    def counts(mind: Mind, task: Task, peer: int, cell: int, peer_cell: int) -> bool:
        """Return whether the robot counts the correction of a peer that it perceives.

        Of more than two robots in one cell, only those with higher numbers give way; a pair
        learns who waits by itself.
        """
        return not (task.robots > 2 and cell == peer_cell and task.number < peer)

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
        last = mind.last
        first = last[2 + task.number]
        for b in range(PRIMITIVES):
            look_ahead(mind, task, now, first, b)
        correct(mind, task, first, now.seen, now.cells)
        here = surplus(mind, task, first)
        here = share_of_surplus(mind, task, first, here)
        failed = False
        for peer in range(task.robots):
            if peer != task.number:
                peer_cell = last[2 + peer]
                if peer_cell == NOT_PERCEIVED:
                    failed = True
                else:
                    key = rho_key(first, peer, peer_cell, task.cells, task.robots)
                    learn_first(mind, task, now, first, key, 1 << peer, here)
        if failed:
            key = failed_key(first, task.cells, task.robots)
            learn_first(mind, task, now, first, key, ~(1 << task.number), here)

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


def prior_of(memory: Memory) -> str:
    """Return the setting `prior` of the run in which a robot learned its memory.

    A robot that knows its map counts all moves as tried from the beginning, in their order.
    """
    tried = memory["tried"]
    return "map" if np.array_equal(tried, np.arange(len(tried))) else "none"


def _check_last(last: np.ndarray, robot: int, cells: int) -> None:
    """Check the memory of the last step with COORDINATE."""
    step, move, *_ = last
    peers = np.delete(last[2:], robot)
    failed = bool(np.all(peers == NOT_PERCEIVED))
    check_range(step, 0, LARGEST_WHOLE, "last")
    check_range(move, 0, PRIMITIVES, "last")
    check_range(last[2 + robot], 0, cells, "last")
    check_range(peers, NOT_PERCEIVED if failed else 0, cells, "last")


@of_learner
def counts(mind: Any, task: Task, peer: int, cell: int, peer_cell: int) -> bool:
    """As `Factored.counts`."""
    raise NotImplementedError


@of_learner
def share_of_surplus(mind: Any, task: Task, first: int, here: float) -> float:
    """As `Factored.share_of_surplus`."""
    raise NotImplementedError


@of_learner
def cell_value(mind: Any, task: Task, cell: int) -> float:
    """As `Factored.cell_value`."""
    raise NotImplementedError


@of_learner
def update_by_percept(mind: Any, task: Task, cell: int, floor: float) -> None:
    """As `Factored.update_by_percept`."""


@of_learner
def was_stopped(mind: Any, task: Task, now: Transition) -> bool:
    """As `Factored.was_stopped`."""
    raise NotImplementedError


@of_learner
def loss_of_stop(mind: Any, task: Task) -> float:
    """As `Factored.loss_of_stop`."""
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


# Values.


@inner
def rho_key(cell: int, peer: int, peer_cell: int, cells: int, robots: int) -> int:
    """Return the key of a row of rho."""
    return (cell * robots + peer) * cells + peer_cell


@inner
def failed_key(cell: int, cells: int, robots: int) -> int:
    """Return the key of the row of failed percepts of a cell; of cell number `cells` the end."""
    return cells * robots * cells + cell


def states_of(keys: np.ndarray, cells: int, robots: int) -> np.ndarray:
    """Return the states that the keys of rho stand for: shape (rows, 3), int64.

    Args:
        keys: of rows, shape (rows,).
        cells: of the map.
        robots: number of robots.

    Returns:
        The own cell, the peer (from 0) and its cell; twice `NOT_PERCEIVED` for a failed percept.
    """
    seen = keys < failed_key(0, cells, robots)
    own, rest = np.divmod(keys, robots * cells)
    peer, place = np.divmod(rest, cells)
    columns = [
        np.where(seen, own, keys - failed_key(0, cells, robots)),
        np.where(seen, peer, NOT_PERCEIVED),
        np.where(seen, place, NOT_PERCEIVED),
    ]
    return np.stack(columns, axis=1)


def key_of(state: tuple[int, int, int], cells: int, robots: int) -> int:
    """Return the key of a row of rho from its state, as of `states_of`."""
    cell, peer, place = state
    if peer == NOT_PERCEIVED:
        return failed_key(cell, cells, robots)
    return rho_key(cell, peer, place, cells, robots)


def corrections_of(
    mind: Any, task: Task, cell: int, perceived: Mapping[int, int] | None, move: int
) -> dict[tuple[int, int], float]:
    """Return rho of a move, by (peer, its cell); by twice `NOT_PERCEIVED` if the percept failed.

    Args:
        mind: the robot's mind, as lists.
        task: its task.
        cell: the own cell.
        perceived: the cells of the peers, by peer; None: the percept failed.
        move: the primitive action.
    """
    keys = {(NOT_PERCEIVED, NOT_PERCEIVED): failed_key(cell, task.cells, task.robots)}
    if perceived is not None:
        keys = {
            (peer, place): rho_key(cell, peer, place, task.cells, task.robots)
            for peer, place in perceived.items()
        }
    rows = {place: find(mind.rho, key) for place, key in keys.items()}
    return {
        place: 0.0 if row == NO_ROW else mind.rho.values[row][move]
        for place, row in rows.items()
    }


@inlined
def refresh(mind: Any, task: Task, cell: int) -> None:
    """Set Q*(cell, .) from the factors."""
    u = mind.u[cell]
    r_bar = mind.r_bar[cell]
    q_star = mind.q_star[cell]
    for b in range(PRIMITIVES):
        q_star[b] = u[b] + r_bar[b]
    q_star[COORDINATE] = greatest(u, PRIMITIVES) - task.ask_cost + mind.w[cell]
    mind.value[cell] = cell_value(mind, task, cell)


@inlined
def correct(mind: Any, task: Task, cell: int, seen: int, cells: Any) -> None:
    """Set `mind.correction` to Q^C(x, z, .) - U(x, .), and `mind.found` to its rows of rho."""
    for b in range(PRIMITIVES):
        mind.correction[b] = 0.0
    if seen == 0:
        add_row(mind, failed_key(cell, task.cells, task.robots))
        return
    for peer in range(task.robots):
        mind.found[peer] = NO_ROW
        if peer != task.number and counts(mind, task, peer, cell, cells[peer]):
            key = rho_key(cell, peer, cells[peer], task.cells, task.robots)
            mind.found[peer] = add_row(mind, key)


@inlined
def add_row(mind: Any, key: int) -> int:
    """Add a row of rho to `mind.correction`, if there is one; return it, or `NO_ROW`."""
    row = find(mind.rho, key)
    if row != NO_ROW:
        for b in range(PRIMITIVES):
            mind.correction[b] += mind.rho.values[row][b]
    return row


@inner
def gain(u: Values, correction: Values) -> float:
    """Return the change of the best move's value by a percept."""
    best = u[0] + correction[0]
    for b in range(1, PRIMITIVES):
        best = max(best, u[b] + correction[b])
    return best - greatest(u, PRIMITIVES)


@inner
def best_move(values: Values) -> int:
    """Return the best of the four moves, of equal ones the first."""
    best = 0
    for b in range(1, PRIMITIVES):
        if values[b] > values[best]:
            best = b
    return best


# Learning.


@inner
def toward(value: float, alpha: float, target: float) -> float:
    """Return a value moved toward a target by a share of the way."""
    return value + alpha * (target - value)


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
    """Return r^C, or the loss from a stop on the way to cell y; note the place.

    Help has no place of its own: the robot felt it while the peer was in another cell.
    """
    if y != now.next_cell:
        mind.narrow[y] = True
        return -loss_of_stop(mind, task)
    if now.partners == 0 or now.common == 0.0:
        return 0.0
    if now.common > 0.0:
        return now.common
    if not task.swaps:
        mind.door[y] = now.common
    elif now.seen != 0:
        if came_from(mind, task, now, y):
            mind.passage[y] = now.common
        else:
            mind.door[y] = now.common
    return now.common


@inlined
def learn_move(mind: Any, task: Task, now: Transition, y: int, brought: float) -> None:
    """Learn U and the model from a move and, if the robot did not ask, r_bar.

    Args:
        mind: the robot's mind.
        task: its task.
        now: the step.
        y: the cell where the move leads a robot alone.
        brought: r^C or the loss from a stop, as of `brought_by_peers`.
    """
    x = now.cell
    b = now.move
    count = mind.updates[x][b] + 1
    mind.updates[x][b] = count
    if count == 1 and task.map_samples == 0:
        mind.tried[mind.used[0]] = x * PRIMITIVES + b
        mind.used[0] += 1
    if y != x:
        mind.moved[x][b] += 1
        mind.successor[x][b] = y
    after = task.goal_value if y == task.goal else mind.value[y]
    if task.map_samples > 0:
        plan_cell(mind, task, x)
    else:
        alpha = step_size(task, count, now.floor)
        target = now.individual + task.discount * after
        mind.u[x][b] = toward(mind.u[x][b], alpha, target)
    if now.action != COORDINATE:
        count = mind.commons[x][b] + 1
        mind.commons[x][b] = count
        alpha = max(1.0 / (count + 1), now.floor / max(1.0, task.credit))
        mind.r_bar[x][b] = toward(mind.r_bar[x][b], alpha, brought)


@inlined
def plan_cell(mind: Any, task: Task, x: int) -> None:
    """Set U of all moves in a cell to their values in the model."""
    for b in range(PRIMITIVES):
        plan_move(mind, task, x, b)


@inlined
def plan_move(mind: Any, task: Task, x: int, b: int) -> None:
    """Set U of a move, and its value to a robot alone, by the model."""
    s = mind.successor[x][b]
    share = mind.moved[x][b] / (mind.updates[x][b] + task.map_samples)
    arrival = task.goal_reward + task.discount * task.goal_value
    there = arrival if s == task.goal else task.discount * mind.value[s]
    here = task.discount * mind.value[x]
    mind.u[x][b] = share * there + (1.0 - share) * here
    if task.robots > 2:
        there = arrival
        if s != task.goal:
            there = task.discount * greatest(mind.alone[s], PRIMITIVES)
        here = task.discount * greatest(mind.alone[x], PRIMITIVES)
        mind.alone[x][b] = share * there + (1.0 - share) * here


@inlined
def learn_asking(mind: Any, task: Task, now: Transition, brought: float) -> None:
    """Learn from COORDINATE: rho of the percept, and W.

    Args:
        mind: the robot's mind.
        task: its task.
        now: the step.
        brought: r^C or the loss from a stop, as of `brought_by_peers`.
    """
    x = now.cell
    if now.seen == 0:
        if is_ruled_out(task.sight, x, x) and brought == now.common:
            brought = now.felt if now.partners != 0 else 0.0
        key = failed_key(x, task.cells, task.robots)
        learn_rho(mind, task, now, place(mind.rho, key), now.move, brought)
    else:
        for peer in range(task.robots):
            if peer != task.number:
                its = brought if (now.partners >> peer) & 1 else 0.0
                key = rho_key(x, peer, now.cells[peer], task.cells, task.robots)
                learn_rho(mind, task, now, place(mind.rho, key), now.move, its)
    if mind.last[0] == now.step:
        look_back(mind, task, now)
    note_question(mind, task, now)
    correct(mind, task, x, now.seen, now.cells)
    count = mind.updates[x][COORDINATE] + 1
    mind.updates[x][COORDINATE] = count
    alpha = step_size(task, count, now.floor)
    mind.w[x] = toward(mind.w[x], alpha, gain(mind.u[x], mind.correction))
    update_by_percept(mind, task, x, now.floor)


@inlined
def learn_rho(
    mind: Any, task: Task, now: Transition, row: int, b: int, common: float
) -> None:
    """Learn one entry of rho from the r^C that its peer caused."""
    updates = mind.rho.updates[row]
    values = mind.rho.values[row]
    count = updates[b] + 1
    updates[b] = count
    values[b] = toward(values[b], step_of_rho(task, count, now.floor), common)


@inlined
def step_of_rho(task: Task, count: int, floor: float) -> float:
    """Return the step size of an entry's update: less than U's, which counts from 1."""
    return step_size(task, min(count + 1, len(task.step_sizes) - 1), floor)


@inlined
def note_question(mind: Any, task: Task, now: Transition) -> None:
    """Note the question of this step, for the next one."""
    mind.last[0] = now.step + 1
    mind.last[1] = now.move
    for robot in range(task.robots):
        known = robot == task.number or now.seen != 0
        mind.last[2 + robot] = now.cells[robot] if known else NOT_PERCEIVED


# Looking back.


@inlined
def surplus(mind: Any, task: Task, cell: int) -> float:
    """Return the value of the percept of `mind.correction` in a cell one step later.

    It is counted beyond the average of percepts there.
    """
    value: float = task.discount * (gain(mind.u[cell], mind.correction) - mind.w[cell])
    return value


@inlined
def look_ahead(mind: Any, task: Task, now: Transition, first: int, b: int) -> None:
    """Set the value of a second question where a move leads, and the peers in the way there.

    Args:
        mind: the robot's mind; `there` and `obstruction` are set.
        task: the robot's task.
        now: the step with the second question.
        first: the cell of the first question.
        b: the move.
    """
    s = mind.successor[first][b]
    known = mind.moved[first][b] > 0 and s != task.goal
    mind.there[b] = 0.0
    for peer in range(task.robots):
        mind.obstruction[b][peer] = 0.0
    if not known:
        return
    correct(mind, task, s, now.seen, now.cells)
    mind.there[b] = surplus(mind, task, s)
    if now.seen != 0:
        best = best_move(mind.u[s])
        for peer in range(task.robots):
            row = mind.found[peer]
            if row != NO_ROW:
                mind.obstruction[b][peer] = min(0.0, mind.rho.values[row][best])


@inlined
def in_the_way(mind: Any, task: Task, first: int) -> int:
    """Return the number of peers in the way at the first of two questions."""
    count = 0
    best = best_move(mind.u[first])
    for peer in range(task.robots):
        peer_cell = mind.last[2 + peer]
        if peer != task.number and peer_cell != NOT_PERCEIVED:
            key = rho_key(first, peer, peer_cell, task.cells, task.robots)
            row = find(mind.rho, key)
            if row != NO_ROW and mind.rho.values[row][best] < 0.0:
                count += 1
    return count


@inlined
def learn_first(
    mind: Any,
    task: Task,
    now: Transition,
    first: int,
    key: int,
    peers: int,
    here: float,
) -> None:
    """Learn the results of the moves at the first question, for one row of rho.

    Each move that was tried would have led to its successor, or left the robot in its cell. Where
    a peer is now, and r^C was once paid there, the move would have cost r^C. (For the actual move
    r^C is learned already.) The new cell counts with the value of a second question there, and
    so does waiting, if peers are in the way.

    Args:
        mind: the robot's mind.
        task: the robot's task.
        now: the step with the second question.
        first: the cell of the first question.
        key: of the row of the percept there.
        peers: the peers of the row, the sum of 2^j; all peers for a failed percept.
        here: the value of the second question in the first cell.
    """
    row = place(mind.rho, key)
    rho = mind.rho.values[row]
    updates = mind.rho.updates[row]
    owed = here if rho[best_move(mind.u[first])] < 0.0 else 0.0
    for b in range(PRIMITIVES):
        made = mind.updates[first][b] + task.map_samples
        if made == 0:
            continue
        share = mind.moved[first][b] / made
        s = mind.successor[first][b]
        stopped = would_stop(mind, task, now, peers, first, s)
        brought = (1.0 - share) * owed
        if stopped:
            brought += share * here
        else:
            brought += share * mind.there[b] * share_of(mind, task, peers, b)
        if b == mind.last[1]:
            rho[b] += step_of_rho(task, updates[b], now.floor) * brought
        elif now.seen != 0 or (
            is_empty(task, now, first) and (share == 0.0 or is_empty(task, now, s))
        ):
            if is_met(task, now, peers, first):
                brought += (1.0 - share) * mind.door[first]
            if stopped:
                brought -= share * loss_of_stop(mind, task)
            elif is_met(task, now, peers, s):
                brought += share * mind.door[s]
            elif task.swaps and would_exchange(mind, task, now, peers, first, s):
                brought += share * mind.passage[s]
            if brought != 0.0 or rho[b] != 0.0:
                learn_rho(mind, task, now, row, b, brought)


@inlined
def share_of(mind: Any, task: Task, peers: int, b: int) -> float:
    """Return these peers' share of the obstruction; if no peer is in the way, shares are equal.

    Args:
        mind: the robot's mind.
        task: the robot's task.
        peers: the sum of 2^j.
        b: the move.
    """
    count = 0
    some = 0.0
    whole = 0.0
    for j in range(task.robots):
        whole += mind.obstruction[b][j]
        if (peers >> j) & 1:
            count += 1
            some += mind.obstruction[b][j]
    return some / whole if whole < 0.0 else count / (task.robots - 1)


@inlined
def is_met(task: Task, now: Transition, peers: int, cell: int) -> bool:
    """Return whether one of the peers (the sum of 2^j) was perceived in a cell."""
    if now.seen == 0:
        return False
    for j in range(task.robots):
        if (peers >> j) & 1 and now.cells[j] == cell:
            return True
    return False


@inlined
def would_exchange(
    mind: Any, task: Task, now: Transition, peers: int, first: int, s: int
) -> bool:
    """Return whether the robot would have exchanged cells with a peer, going from first to s."""
    if now.seen == 0:
        return False
    for j in range(task.robots):
        if (peers >> j) & 1 and mind.last[2 + j] == s and now.cells[j] == first:
            return True
    return False


@inlined
def would_stop(
    mind: Any, task: Task, now: Transition, peers: int, first: int, s: int
) -> bool:
    """Return whether a peer would have stopped the robot on its way from first to s."""
    if not task.blocks or now.seen == 0 or not mind.narrow[s]:
        return False
    for j in range(task.robots):
        if (peers >> j) & 1:
            before = mind.last[2 + j]
            if stops(s, first, before, now.cells[j], j < task.number):
                return True
    return False


@inlined
def is_empty(task: Task, now: Transition, cell: int) -> bool:
    """Return whether a failed percept proves that a cell is empty; only with one peer."""
    return task.robots == 2 and is_ruled_out(task.sight, now.cell, cell)
