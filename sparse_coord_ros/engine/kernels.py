# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learning and trials as loops over arrays, for numba to compile.

What `learn.agent` and `game.world` do object by object, here step by step on arrays; the choices
and the update are the very functions of `learn.algorithm`. Plain Python runs these loops too, with
the same bits.
"""

from typing import NamedTuple

import numpy as np

from sparse_coord_ros.engine.generator import MOST, jumped, uniform
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.game.links import LOST
from sparse_coord_ros.game.miscoordination import NOWHERE, together
from sparse_coord_ros.game.perception import drawn_peer, succeeds
from sparse_coord_ros.game.streams import (
    BLIND,
    BLIND_ACTION,
    BLIND_EXPLORE,
    DRAWS,
    EXPLORE,
    EXPLORED_ACTION,
    MOTION,
    PEER,
    PERCEPT,
    POLICY,
    PRIMITIVE_TIE,
    REPLAY,
    START,
    TIE,
)
from sparse_coord_ros.game.world import EPISODE_GAP
from sparse_coord_ros.learn.algorithm import greatest, greedy, step_size, updated, weighed
from sparse_coord_ros.learn.factors import (
    Own,
    Terms,
    counted,
    key_of,
    learn_asking,
    learn_correction,
    learn_move,
    refresh,
    replay,
    unseen_key,
)

WIDTHS = tuple(DRAWS.values())
"""Draws that a time step owns [role]."""

NO_ROW = -1
"""In place of a row of Q^C: nothing was perceived."""

FAILED, PERCEIVED = 0, 1
"""In place of a row of Q^C where corrections are learned: how the percept ended."""

FREE_PLACE = -1
"""In place of a key: a free place of a sparse table."""

STEP, EPISODE_START, DONE, PLACED, END = range(5)
"""Entries of `Game.clock`: time step, first step of the episode, transitions (or trials) done,
whether the episode has begun, the step after the last one of the block."""

REWARD, TIME, ASKS, CONFLICTS = range(4)
"""Last axis of a trial's result."""


class CompiledScenario(NamedTuple):
    """A scenario for one learner, as arrays; k is a robot, x its cell.

    Attributes:
        members: the robots that act.
        starts: start cell [k].
        goals: goal cell [k].
        next_cell: where a move leads [x, action].
        places: meeting place of each cell, as of `game.miscoordination` [x].
        percept: probability that a percept succeeds [x, cell of the peer].
        all_peers: whether COORDINATE perceives every peer (footnote 3), or one drawn at random.
        penalties: r^C of a miscoordination [k].
        start_cells: cells where an exploring start can be [k, number].
        start_counts: how many they are [k].
        exploring: probability of an exploring start [time step].
        epsilon: probability of an explored action [time step].
        alpha_by_count: step size [number of the entry's update].
        alpha_by_step: least step size [time step].
        discounts: gamma to the power of [steps].
        actions: how many there are: all, or only the moves for the baselines.
        weights: how much the individual and the common part of a reward and the cost of asking
            count while learning [3].
        budget: transitions to learn from.
        max_steps: steps after which an episode ends.
        move_success: probability that a move succeeds.
        goal_reward: r^I at the goal.
        ask_cost: cost of COORDINATE.
        discount: gamma.
        goal_value: value of being at the goal while learning.
        referee: whether the world says who was in a miscoordination with whom.
        rows_a_step: rows that a sparse table can grow by in a time step.
        most_rows: rows that a sparse table can have.
        replays, share, percept_update: as of `learn.factors.FactorRule`.
        right_of_way: likewise, and False for two robots.
    """

    members: np.ndarray
    starts: np.ndarray
    goals: np.ndarray
    next_cell: np.ndarray
    places: np.ndarray
    percept: np.ndarray
    all_peers: bool
    penalties: np.ndarray
    start_cells: np.ndarray
    start_counts: np.ndarray
    exploring: np.ndarray
    epsilon: np.ndarray
    alpha_by_count: np.ndarray
    alpha_by_step: np.ndarray
    discounts: np.ndarray
    actions: int
    weights: np.ndarray
    budget: int
    max_steps: int
    move_success: float
    goal_reward: float
    ask_cost: float
    discount: float
    goal_value: float
    referee: bool
    rows_a_step: int
    most_rows: int
    replays: int
    share: bool
    percept_update: bool
    right_of_way: bool


class Factored(NamedTuple):
    """What a learner that learns in factors has beside its tables.

    Attributes:
        u, r_bar, w, value, commons, moved, successor, tried, used: as of `learn.factors.Own`, with
            the robot as first axis.
        askers: who asked the robot in this time step [k]: the sum of 2^j of the robots j.
        partners: as of `game.world.Reward` [k].
        correction: space for Q^C(x, z, .) - U(x, .) [action].
    """

    u: np.ndarray
    r_bar: np.ndarray
    w: np.ndarray
    value: np.ndarray
    commons: np.ndarray
    moved: np.ndarray
    successor: np.ndarray
    tried: np.ndarray
    used: np.ndarray
    askers: np.ndarray
    partners: np.ndarray
    correction: np.ndarray


class Learners(NamedTuple):
    """The tables of all robots.

    Attributes:
        q_star: Q*, [k, x, action].
        q_coord: Q^C, [k, row, action]; a dense table has a row for each joint state.
        star_updates: updates of each entry of Q*.
        coord_updates: updates of each entry of Q^C.
        keys: joint state of each row of a sparse table, or `FREE_PLACE`, [k, row]; the number of
            rows is a power of two. A joint state's number has the cells as its digits: the own
            cell, then the peers'. Dense tables have none: shape (k, 0).
        used: rows in use of a sparse table [k].
        factored: None, or the rest of a learner that learns in factors. Its q_coord is then rho,
            whose rows or keys are those of `learn.factors`, and its star_updates count how often
            each move was tried, and COORDINATE.
    """

    q_star: np.ndarray
    q_coord: np.ndarray
    star_updates: np.ndarray
    coord_updates: np.ndarray
    keys: np.ndarray
    used: np.ndarray
    factored: Factored | None = None


class Game(NamedTuple):
    """A game in progress: the clock, each robot's cell, and whether it has arrived."""

    clock: np.ndarray
    cells: np.ndarray
    arrived: np.ndarray


class Choices(NamedTuple):
    """What each robot chose at this time step.

    Attributes:
        cells: the cell that it was in.
        actions: A_k(t), as of `game.actions`.
        moves: the primitive action that it became.
        rows: the row of Q^C that was perceived, or `NO_ROW`.
    """

    cells: np.ndarray
    actions: np.ndarray
    moves: np.ndarray
    rows: np.ndarray


class Draws(NamedTuple):
    """Where the draws come from; what nothing looks at is never drawn.

    Attributes:
        sources: a generator at a time step's beginning, as of `generator.source_of`,
            [role, k, word]; those that nothing looks at are 0.
        since: that time step [role, k].
        jumps: as of `generator.jump_table`.
        fails: whether percepts can fail.
        block: time steps between two looks at `stop` and at the room that is left.
        stop: its one entry is set where nobody waits for the result any more.
        down: when each robot's link is down, [k, time step modulo its length]; no columns where
            links have no pattern.
        dead_from: the time step from which all links are down.
    """

    sources: np.ndarray
    since: np.ndarray
    jumps: np.ndarray
    fails: bool
    block: int
    stop: np.ndarray
    down: np.ndarray
    dead_from: int


class Record(NamedTuple):
    """The learning history in the making: arrays as of `learn.history.History`, with room.

    Attributes:
        used: its one entry is the number of rows in use; the last one is that of the episode
            under way, or of the one that ended last.
        first_step, length, reward, miscoordinations, asks, arrived: [row], or [row, k].
    """

    used: np.ndarray
    first_step: np.ndarray
    length: np.ndarray
    reward: np.ndarray
    miscoordinations: np.ndarray
    asks: np.ndarray
    arrived: np.ndarray


def drawn(draws: Draws, role: int, k: int, step: int, column: int) -> float:
    """Return a draw of robot k in a role at a time step, which is not before the last one's."""
    source, width = draws.sources[role, k], WIDTHS[role]
    steps = step - draws.since[role, k]
    if (steps + 1) * width > MOST:
        go_on(draws, role, k, step)
        steps = 0
    high, low = jumped(source, draws.jumps[steps * width + column + 1])
    return uniform(high, low)


def go_on(draws: Draws, role: int, k: int, step: int) -> None:
    """Let a generator go on to a time step's beginning."""
    source, width = draws.sources[role, k], WIDTHS[role]
    while draws.since[role, k] < step:
        steps = min(step - draws.since[role, k], MOST // width)
        high, low = jumped(source, draws.jumps[steps * width])
        source[0] = high
        source[1] = low
        draws.since[role, k] += steps


def percept_draw(draws: Draws, k: int, step: int) -> float:
    """Return the draw of robot k's percept, `LOST` while its link is down."""
    period = draws.down.shape[1]
    if step >= draws.dead_from or (period > 0 and draws.down[k, step % period]):
        return LOST
    return drawn(draws, PERCEPT, k, step, 0) if draws.fails else 0.0


def begin_block(game: Game, draws: Draws) -> None:
    """Begin the next block of time steps."""
    game.clock[END] += draws.block


def place(problem: CompiledScenario, game: Game, draws: Draws) -> None:
    """Begin an episode: every robot at its start, or at an exploring start."""
    clock = game.clock
    step = clock[STEP]
    exploring = problem.exploring[min(step, len(problem.exploring) - 1)]
    for k in range(len(problem.starts)):
        game.cells[k] = problem.starts[k]
        game.arrived[k] = 1
    for k in problem.members:
        game.arrived[k] = 0
        if exploring > 0.0 and drawn(draws, START, k, step, 0) < exploring:
            pick = int(drawn(draws, START, k, step, 1) * problem.start_counts[k])
            game.cells[k] = problem.start_cells[k, pick]
    clock[EPISODE_START] = step
    clock[PLACED] = 1


def find_row(keys: np.ndarray, key: int) -> int:
    """Return the row of a joint state in a sparse table, or the free place that it would take.

    Open addressing with linear probing; the table must have a free place.
    """
    mask = len(keys) - 1
    row = (key ^ key >> 7 ^ key >> 17) & mask
    while keys[row] != FREE_PLACE and keys[row] != key:
        row = (row + 1) & mask
    return row


def has_room(problem: CompiledScenario, learners: Learners, block: int) -> bool:
    """Whether sparse tables stay half empty whatever a block of so many time steps brings."""
    rows = learners.keys.shape[1]
    if rows > 0:
        for used in learners.used:
            if 2 * min(used + block * problem.rows_a_step, problem.most_rows) > rows:
                return False
    return True


def rehash(old: Learners, new: Learners) -> None:
    """Copy the rows of sparse tables into larger ones, which have no rows yet."""
    for k in range(len(old.keys)):
        for row in range(old.keys.shape[1]):
            key = old.keys[k, row]
            if key != FREE_PLACE:
                place = find_row(new.keys[k], key)
                new.keys[k, place] = key
                for action in range(PRIMITIVES):  # an array assignment would make an array
                    new.q_coord[k, place, action] = old.q_coord[k, row, action]
                    new.coord_updates[k, place, action] = old.coord_updates[k, row, action]
        new.used[k] = old.used[k]


def perceived_row(
    problem: CompiledScenario, learners: Learners, game: Game, k: int, draws: Draws, step: int
) -> int:
    """Return the row of Q^C that robot k's COORDINATE perceives, or `NO_ROW`."""
    cells = game.cells
    x = cells[k]
    size = len(problem.places)
    team = len(cells)
    draw = percept_draw(draws, k, step)
    if problem.all_peers:
        key = x
        for peer in range(team):
            if peer != k:
                if not succeeds(draw, problem.percept[x, cells[peer]]):
                    return NO_ROW
                key = key * size + cells[peer]
    else:
        which = drawn(draws, POLICY, k, step, PEER) if team > 2 else 0.0
        peer = drawn_peer(k, team, which)
        if not succeeds(draw, problem.percept[x, cells[peer]]):
            return NO_ROW
        key = x * size + cells[peer]
    return row_to_learn(learners, k, key)


def row_to_learn(learners: Learners, k: int, key: int) -> int:
    """Return the row of a key in robot k's second table, a new one if there is none."""
    if learners.keys.shape[1] == 0:
        return key
    row = find_row(learners.keys[k], key)
    if learners.keys[k, row] == FREE_PLACE:
        learners.keys[k, row] = key
        learners.used[k] += 1
    return row


def coordinate(
    problem: CompiledScenario,
    learners: Learners,
    factored: Factored | None,
    game: Game,
    choice: Choices,
    draws: Draws,
    step: int,
    epsilon: float,
    k: int,
) -> int:
    """Turn robot k's COORDINATE into a move (Algorithm 1, lines 5 to 10); return it.

    `choice.rows` says whether it perceived; where corrections are learned, `factored.askers` of
    each peer that it asked says so.
    """
    x = game.cells[k]
    if factored is None:
        row = NO_ROW
        if len(game.cells) > 1:
            row = perceived_row(problem, learners, game, k, draws, step)
        choice.rows[k] = row
        if row == NO_ROW:
            return greedy_action(learners.q_star[k, x], PRIMITIVES, draws, k, step, PRIMITIVE_TIE)
        return greedy_action(learners.q_coord[k, row], PRIMITIVES, draws, k, step, PRIMITIVE_TIE)
    seen = PERCEIVED if len(game.cells) > 1 else FAILED
    draw = percept_draw(draws, k, step)
    for peer in range(len(game.cells)):
        if peer != k:
            factored.askers[peer] |= 1 << k
            if not succeeds(draw, problem.percept[x, game.cells[peer]]):
                seen = FAILED
                break
    choice.rows[k] = seen
    values = factored.correction
    correct(learners, factored, k, x, game.cells, seen, problem.right_of_way)
    for b in range(PRIMITIVES):
        values[b] = factored.u[k, x, b] + values[b]
    if seen == FAILED and epsilon > 0.0:
        if drawn(draws, BLIND, k, step, BLIND_EXPLORE) < epsilon:
            return int(drawn(draws, BLIND, k, step, BLIND_ACTION) * PRIMITIVES)
    return greedy_action(values, PRIMITIVES, draws, k, step, PRIMITIVE_TIE)


def greedy_action(
    values: np.ndarray, count: int, draws: Draws, k: int, step: int, column: int
) -> int:
    """Return pi_g's choice, as of `greedy`, which draws only between ties.

    Nearly always there are none; without a branch for each value the processor waits less.
    """
    best = greatest(values, count)
    ties, last = 0, 0
    for action in range(count):
        if values[action] == best:
            ties += 1
            last = action
    if ties == 1:
        return last
    return greedy(values, count, drawn(draws, POLICY, k, step, column))


def correct(
    learners: Learners,
    factored: Factored,
    k: int,
    x: int,
    cells: np.ndarray,
    seen: int,
    right_of_way: bool,
) -> None:
    """Set `factored.correction` to Q^C(x, z, .) - U(x, .) of what robot k perceived."""
    correction = factored.correction
    for b in range(PRIMITIVES):
        correction[b] = 0.0
    size, team = learners.q_star.shape[1], len(cells)
    if seen == FAILED:
        add_row(learners, k, unseen_key(x, size, team), correction)
        return
    for peer in range(team):
        if peer != k and counted(k, peer, x, cells[peer], right_of_way):
            add_row(learners, k, key_of(x, peer, cells[peer], size, team), correction)


def add_row(learners: Learners, k: int, key: int, correction: np.ndarray) -> None:
    """Add a row of rho, if there is one."""
    row, dense = key, learners.keys.shape[1] == 0
    if not dense:
        row = find_row(learners.keys[k], key)
    if dense or learners.keys[k, row] != FREE_PLACE:
        for b in range(PRIMITIVES):
            correction[b] += learners.q_coord[k, row, b]


def choose(
    problem: CompiledScenario,
    learners: Learners,
    factored: Factored | None,
    game: Game,
    choice: Choices,
    draws: Draws,
    step: int,
    epsilon: float,
) -> None:
    """Let every robot that has not arrived choose (Algorithm 1, lines 4 to 10)."""
    if factored is not None:
        for k in range(len(game.cells)):
            factored.askers[k] = 0
            choice.cells[k] = game.cells[k]
    for k in problem.members:
        if game.arrived[k]:
            continue
        x = game.cells[k]
        values = learners.q_star[k, x]
        if epsilon > 0.0 and drawn(draws, POLICY, k, step, EXPLORE) < epsilon:
            action = int(drawn(draws, POLICY, k, step, EXPLORED_ACTION) * problem.actions)
        else:
            action = greedy_action(values, len(ACTIONS), draws, k, step, TIE)
        choice.cells[k] = x
        choice.actions[k] = action
        choice.moves[k] = action
        choice.rows[k] = NO_ROW
        if action == COORDINATE:
            choice.moves[k] = coordinate(
                problem, learners, factored, game, choice, draws, step, epsilon, k
            )


def move(problem: CompiledScenario, game: Game, choice: Choices, draws: Draws, step: int) -> bool:
    """Move every robot that acts; return whether the step ends in a miscoordination."""
    cells = game.cells
    members = problem.members
    for k in members:
        if not game.arrived[k] and drawn(draws, MOTION, k, step, 0) < problem.move_success:
            cells[k] = problem.next_cell[cells[k], choice.moves[k]]
    for i in range(len(members)):
        place = problem.places[cells[members[i]]]
        if place != NOWHERE:
            for j in range(i):
                if together(place, problem.places[cells[members[j]]]):
                    return True
    return False


def find_partners(problem: CompiledScenario, game: Game, partners: np.ndarray) -> None:
    """Set with whom each robot is in a miscoordination, as of `game.world.Reward`."""
    cells = game.cells
    for k in problem.members:
        partners[k] = 0
        place = problem.places[cells[k]]
        if place != NOWHERE:
            for j in problem.members:
                if j != k and together(place, problem.places[cells[j]]):
                    partners[k] |= 1 << j


def learn_tables(
    problem: CompiledScenario,
    learners: Learners,
    choice: Choices,
    k: int,
    y: int,
    reward: float,
    least_alpha: float,
) -> None:
    """Let robot k learn from its move to y (Algorithm 1, lines 12 to 14 and 18)."""
    q_star, q_coord = learners.q_star, learners.q_coord
    x, action, seen = choice.cells[k], choice.actions[k], choice.rows[k]
    if y == problem.goals[k]:
        bootstrap = problem.goal_value
    else:
        bootstrap = greatest(q_star[k, y], len(ACTIONS))
    if seen != NO_ROW:
        primitive = choice.moves[k]
        count = learners.coord_updates[k, seen, primitive] + 1
        learners.coord_updates[k, seen, primitive] = count
        alpha = step_size(problem.alpha_by_count[count], least_alpha)
        q_coord[k, seen, primitive] = updated(
            q_coord[k, seen, primitive], alpha, reward, problem.discount, bootstrap
        )
    count = learners.star_updates[k, x, action] + 1
    learners.star_updates[k, x, action] = count
    alpha = step_size(problem.alpha_by_count[count], least_alpha)
    q_star[k, x, action] = updated(
        q_star[k, x, action], alpha, reward, problem.discount, bootstrap
    )


def learn_factors(
    problem: CompiledScenario,
    learners: Learners,
    factored: Factored,
    choice: Choices,
    draws: Draws,
    step: int,
    k: int,
    y: int,
    individual: float,
    common: float,
    least_alpha: float,
) -> None:
    """Let robot k learn from its move to y what `learn.factored.FactoredAgent.learn` learns."""
    weights, partners = problem.weights, factored.partners[k]
    x, m, seen = choice.cells[k], choice.moves[k], choice.rows[k]
    by_count = problem.alpha_by_count
    goal = problem.goals[k]
    arrival = weights[0] * problem.goal_reward + problem.discount * problem.goal_value
    terms = Terms(
        weights[2] * problem.ask_cost,
        problem.discount,
        goal,
        problem.goal_value,
        arrival,
    )
    own = Own(
        factored.u[k],
        factored.r_bar[k],
        factored.w[k],
        learners.q_star[k],
        factored.value[k],
        learners.star_updates[k],
        factored.commons[k],
        factored.moved[k],
        factored.successor[k],
        factored.tried[k],
        factored.used[k],
    )
    individual = weights[0] * individual
    if partners == 0:
        common = 0.0
    common = weights[1] * common
    asked = seen != NO_ROW
    learn_move(own, x, m, y, individual, common, asked, terms, by_count, least_alpha)
    size, team = learners.q_star.shape[1], len(choice.cells)
    if seen == PERCEIVED or factored.askers[k] != 0:
        for peer in range(team):
            z = choice.cells[peer]
            known = seen == PERCEIVED
            if not known and problem.share and (factored.askers[k] >> peer) & 1:
                known = succeeds(percept_draw(draws, k, step), problem.percept[x, z])
            if known and peer != k:
                share = common if (partners >> peer) & 1 else 0.0
                key = key_of(x, peer, z, size, team)
                learn_row(learners, k, key, m, share, by_count, least_alpha)
    if asked:
        if seen == FAILED:
            learn_row(learners, k, unseen_key(x, size, team), m, common, by_count, least_alpha)
        correct(learners, factored, k, x, choice.cells, seen, problem.right_of_way)
        update = problem.percept_update
        learn_asking(own, x, factored.correction, update, by_count, least_alpha)
    refresh(own, x, terms)
    if problem.replays > 0:
        replay(own, problem.replays, drawn(draws, REPLAY, k, step, 0), terms)


def learn_row(
    learners: Learners,
    k: int,
    key: int,
    m: int,
    common: float,
    by_count: np.ndarray,
    least_alpha: float,
) -> None:
    """Learn one entry of rho, in a new row if there is none."""
    row = row_to_learn(learners, k, key)
    rho, counts = learners.q_coord[k, row], learners.coord_updates[k, row]
    learn_correction(rho, counts, m, common, by_count, least_alpha)


def has_rows(record: Record | None, block: int) -> bool:
    """Whether a record has room for all episodes that can begin in so many time steps."""
    if record is None:
        return True
    return bool(record.used[0] + block <= len(record.length))


def learn(
    problem: CompiledScenario,
    learners: Learners,
    game: Game,
    choice: Choices,
    draws: Draws,
    record: Record | None,
) -> None:
    """Learn until the budget is used up, something needs more room, or it is to stop.

    What needs room are sparse tables and the record. A run in parts is the unbroken run.

    Args:
        problem: the scenario and the budget.
        learners: the tables, changed.
        game: the game in progress, changed.
        choice: space for the robots' choices.
        draws: where the draws come from.
        record: the history, added to; or None. Numba compiles the loop for each by itself, and
            without a record nothing of it is left.
    """
    block = draws.block
    while (
        game.clock[DONE] < problem.budget
        and not draws.stop[0]
        and has_room(problem, learners, block)
        and has_rows(record, block)
    ):
        if game.clock[STEP] >= game.clock[END]:
            begin_block(game, draws)
        learn_block(problem, learners, learners.factored, game, choice, draws, record)


def learn_block(
    problem: CompiledScenario,
    learners: Learners,
    factored: Factored | None,
    game: Game,
    choice: Choices,
    draws: Draws,
    record: Record | None,
) -> None:
    """Learn until the block of time steps, or the budget, is used up (Algorithm 1)."""
    clock, arrived = game.clock, game.arrived
    end = clock[END]
    last = len(problem.epsilon) - 1
    while clock[DONE] < problem.budget and clock[STEP] < end:
        if not clock[PLACED]:
            place(problem, game, draws)
            if record is not None:
                record.first_step[record.used[0]] = clock[STEP]
                record.used[0] += 1
        step = clock[STEP]
        scheduled = min(step, last)
        choose(problem, learners, factored, game, choice, draws, step, problem.epsilon[scheduled])
        conflict = move(problem, game, choice, draws, step)
        if factored is not None:
            if problem.referee:
                find_partners(problem, game, factored.partners)
        least_alpha = problem.alpha_by_step[scheduled]
        if record is not None:
            row = record.used[0] - 1
            record.length[row] += 1
            record.miscoordinations[row] += conflict
        over = True
        for k in problem.members:
            if arrived[k]:
                continue
            y = game.cells[k]
            action = choice.actions[k]
            home = y == problem.goals[k]
            individual = problem.goal_reward if home else 0.0
            common = problem.penalties[k] if conflict else 0.0
            cost = -problem.ask_cost if action == COORDINATE else 0.0
            if record is not None:
                record.reward[row, k] += individual + common + cost
                record.asks[row, k] += action == COORDINATE
                record.arrived[row, k] = home
            if home:
                arrived[k] = 1
            else:
                over = False
            if factored is None:
                reward = weighed(individual, common, cost, problem.weights)
                learn_tables(problem, learners, choice, k, y, reward, least_alpha)
            else:
                learn_factors(
                    problem,
                    learners,
                    factored,
                    choice,
                    draws,
                    step,
                    k,
                    y,
                    individual,
                    common,
                    least_alpha,
                )
        clock[STEP] = step + 1
        clock[DONE] += 1
        if over or clock[STEP] - clock[EPISODE_START] >= problem.max_steps:
            clock[STEP] += EPISODE_GAP
            clock[PLACED] = 0


def play(
    problem: CompiledScenario,
    learners: Learners,
    game: Game,
    choice: Choices,
    draws: Draws,
    results: np.ndarray,
    asked: np.ndarray,
    stays: np.ndarray,
) -> None:
    """Play greedy trials until all are played, or as `learn` does; arguments as `play_block`."""
    block = draws.block
    while (
        game.clock[DONE] < problem.budget
        and not draws.stop[0]
        and has_room(problem, learners, block)
    ):
        begin_block(game, draws)
        play_block(
            problem, learners, learners.factored, game, choice, draws, results, asked, stays
        )


def play_block(
    problem: CompiledScenario,
    learners: Learners,
    factored: Factored | None,
    game: Game,
    choice: Choices,
    draws: Draws,
    results: np.ndarray,
    asked: np.ndarray,
    stays: np.ndarray,
) -> None:
    """Play greedy trials until the block of time steps, or the trials, are used up.

    Args:
        problem: the scenario; `budget` trials of at most `max_steps` steps.
        learners: the learned tables.
        factored: their `factored`.
        game: the game in progress.
        choice: space for the robots' choices.
        draws: where the draws come from.
        results: filled, [trial, k, REWARD to CONFLICTS]; TIME is the horizon, and one more, for
            a robot that does not arrive.
        asked: counted up where COORDINATE is chosen, [k, x].
        stays: counted up where a robot acts, [k, x].
    """
    clock, cells, arrived = game.clock, game.cells, game.arrived
    end = clock[END]
    never = problem.max_steps + 1
    while clock[DONE] < problem.budget and clock[STEP] < end:
        if not clock[PLACED]:
            place(problem, game, draws)
        step = clock[STEP]
        elapsed = step - clock[EPISODE_START]
        result = results[clock[DONE]]
        choose(problem, learners, factored, game, choice, draws, step, 0.0)
        conflict = move(problem, game, choice, draws, step)
        over = True
        discount = problem.discounts[elapsed]
        for k in problem.members:
            common = problem.penalties[k] if conflict else 0.0
            cost = 0.0
            if not arrived[k]:
                stays[k, choice.cells[k]] += 1
                if choice.actions[k] == COORDINATE:
                    cost = -problem.ask_cost
                    result[k, ASKS] += 1
                    asked[k, choice.cells[k]] += 1
            result[k, REWARD] += discount * (common + cost)
            result[k, CONFLICTS] += conflict
            if arrived[k]:
                continue
            if cells[k] == problem.goals[k]:
                arrived[k] = 1
                result[k, TIME] = elapsed + 1
                result[k, REWARD] += discount * problem.goal_reward / (1.0 - problem.discount)
            else:
                over = False
                result[k, TIME] = never
        clock[STEP] = step + 1
        if over or clock[STEP] - clock[EPISODE_START] >= problem.max_steps:
            clock[STEP] += EPISODE_GAP
            clock[PLACED] = 0
            clock[DONE] += 1
