# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the compiled loops and the compiled form of a learner share: the game as arrays, and draws.

The loops of `engine.kernels` play the game of all robots. What a learner does of its own, the
functions at the end of this module, is static methods of its `Minds`. Plain Python runs all this
too, with the same bits.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from sparse_coord_ros.compiling import delegated, inlined, inner, nothing
from sparse_coord_ros.game.generator import MOST, jumped, uniform
from sparse_coord_ros.game.links import LOST
from sparse_coord_ros.game.miscoordination import NOWHERE, together
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.streams import DRAWS, PERCEPT, POLICY
from sparse_coord_ros.learn.algorithm import Values, greatest, greedy
from sparse_coord_ros.learn.rows import Rows

if TYPE_CHECKING:
    from sparse_coord_ros.learn.agent import Memory, Tables
    from sparse_coord_ros.learn.learners import Learner

WIDTHS = tuple(DRAWS.values())
"""Draws that a time step owns [role]."""

NO_ROW = -1
"""In place of a row of Q^C: nothing was perceived."""

STEP, EPISODE_START, DONE, PLACED, END = range(5)
"""Entries of `Game.clock`: time step, first step of the episode, transitions (or trials) done,
whether the episode has begun, the step after the last one of the block."""


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
        paired: whether a trial has the same draws whatever happened in those before it.
        max_steps: steps after which an episode ends.
        move_success: probability that a move succeeds.
        goal_reward: r^I at the goal.
        ask_cost: cost of COORDINATE.
        discount: gamma.
        goal_value: value of being at the goal while learning.
        referee: whether the world says who was in a miscoordination with whom.
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
    paired: bool
    max_steps: int
    move_success: float
    goal_reward: float
    ask_cost: float
    discount: float
    goal_value: float
    referee: bool


class GameState(NamedTuple):
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
        rows: the row of Q^C that was perceived; `NO_ROW`: nothing was asked, or it failed.
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


class State(NamedTuple):
    """A run under way in the compiled loops, but for what the robots know.

    Attributes:
        problem: the scenario.
        game: the joint state, changed.
        choice: what robots chose, changed.
        draws: where the draws come from.
    """

    problem: CompiledScenario
    game: GameState
    choice: Choices
    draws: Draws


class Transition(NamedTuple):
    """What a robot learns from, beside its cell and choice.

    Attributes:
        step: the time step t.
        k: the robot.
        y: X_k(t+1).
        reward: r^I_k, r^C and minus the cost of asking, or 0.
        floor: least step size.
    """

    step: int
    k: int
    y: int
    reward: Values
    floor: float


@inlined
def drawn(draws: Draws, role: int, k: int, step: int, column: int) -> float:
    """Return a draw of robot k in a role at a time step, which is not before the last one's."""
    source, width = draws.sources[role, k], WIDTHS[role]
    steps = step - draws.since[role, k]
    if (steps + 1) * width > MOST:
        go_on(draws, role, k, step)
        steps = 0
    high, low = jumped(source, draws.jumps[steps * width + column + 1])
    return uniform(high, low)


@inner
def go_on(draws: Draws, role: int, k: int, step: int) -> None:
    """Let a generator go on to a time step's beginning."""
    source, width = draws.sources[role, k], WIDTHS[role]
    while draws.since[role, k] < step:
        steps = min(step - draws.since[role, k], MOST // width)
        high, low = jumped(source, draws.jumps[steps * width])
        source[0] = high
        source[1] = low
        draws.since[role, k] += steps


@inlined
def percept_draw(draws: Draws, k: int, step: int) -> float:
    """Return the draw of robot k's percept, `LOST` while its link is down."""
    period = draws.down.shape[1]
    if step >= draws.dead_from or (period > 0 and draws.down[k, step % period]):
        return LOST
    return drawn(draws, PERCEPT, k, step, 0) if draws.fails else 0.0


@inlined
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


@inlined
def find_partners(state: State, partners: np.ndarray) -> None:
    """Set with whom each robot is in a miscoordination, as of `game.world.Reward`."""
    problem, game = state.problem, state.game
    cells = game.cells
    for k in problem.members:
        partners[k] = 0
        place = problem.places[cells[k]]
        if place != NOWHERE:
            for j in problem.members:
                if j != k and together(place, problem.places[cells[j]]):
                    partners[k] |= 1 << j


@inner
def epsilon_at(state: State, step: int) -> float:
    """Return the probability of an explored action at a time step."""
    schedule = state.problem.epsilon
    epsilon: float = schedule[min(step, len(schedule) - 1)]
    return epsilon


class Minds(Protocol):
    """The compiled form of a learner: what all robots know, as a named tuple of arrays.

    Beside what is here it has static methods, one for each `delegated` function of this module
    (`begin_step` and `end_step` where it needs them), which are compiled into the loops. They may
    call what `compiling.inner` marks. What they compute must be the bits of the plain agent: let
    both call the same functions of rows.
    `learn.agent.TableMinds` is Algorithm 1's.

    Attributes:
        q_star: Q* [k, x, action].
        star_updates: updates of each of its entries, int32.
        rows: the second table.
    """

    q_star: np.ndarray
    star_updates: np.ndarray
    rows: Rows

    def _replace(self, **fields: Any) -> "Minds":
        """Return the same with other arrays."""

    @staticmethod
    def roles() -> tuple[int, ...]:
        """Return the roles of random streams, beside the game's, that it draws from."""

    @classmethod
    def initial(cls, scenario: Scenario, learner: "Learner", block: int) -> "Minds":
        """Return what robots know before learning; hashed tables with room for a block."""

    def tables(self, scenario: Scenario, learner: "Learner") -> "list[Tables]":
        """Return what each robot has learned."""

    def memory(self, k: int, scenario: Scenario) -> "Memory":
        """Return what robot k has learned, as its plain agent remembers it; a copy."""

    def remember(self, memories: "Sequence[Memory]", scenario: Scenario) -> "Minds":
        """Return what robots know that remember all this; self is as `initial` returns it."""


@delegated
def begin_step(state: State, minds: Any) -> None:
    """Begin a time step, before anybody chooses."""
    getattr(minds, "begin_step", nothing)(state, minds)


@delegated
def coordinate(state: State, minds: Any, step: int, k: int, epsilon: float) -> int:
    """Turn robot k's COORDINATE into a move (Algorithm 1, lines 5 to 10); return it.

    Sets `state.choice.rows[k]` where the percept succeeds.

    Args:
        state: the run under way.
        minds: what the robots know.
        step: the time step t.
        k: the robot.
        epsilon: probability of an explored action; 0 in trials.
    """
    move: int = minds.coordinate(state, minds, step, k, epsilon)
    return move


@delegated
def end_step(state: State, minds: Any) -> None:
    """End a time step: robots have moved, and are about to learn."""
    getattr(minds, "end_step", nothing)(state, minds)


@delegated
def learn(state: State, minds: Any, now: Transition) -> None:
    """Let a robot learn from a time step (Algorithm 1, lines 12 to 14 and 18).

    Args:
        state: the run under way; its choices are those of the step.
        minds: what the robots know, changed.
        now: what it learns from.
    """
    minds.learn(state, minds, now)


@delegated
def bootstrap(state: State, minds: Any, step: int, k: int, y: int) -> float:
    """Return what robot k expects from cell y on, which is not its goal: as `Agent.bootstrap`."""
    value: float = minds.bootstrap(state, minds, step, k, y)
    return value


@inlined
def worth_of(state: State, minds: Any, step: int, k: int, y: int) -> float:
    """Return what follows robot k's step to cell y: the goal's value, or what it expects."""
    if y == state.problem.goals[k]:
        value: float = state.problem.goal_value
        return value
    return bootstrap(state, minds, step, k, y)
