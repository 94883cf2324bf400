# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sparse cooperative Q-learning on the leaderboard: `python -m tools.study central`.

The rule is that of examples/sparse_cooperative.py, bit for bit, as loops that numba compiles. It
is central, another class of teams: one choice for both robots, which see each other for nothing.
"""

import functools
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import has_numba, inlined, jit
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game import many_games
from sparse_coord_ros.core.game.many_games import Games, Infos, Outcome, advance, begin
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.schedules import probabilities, step_sizes
from sparse_coord_ros.core.game.streams import EVALUATION, LEARNING
from sparse_coord_ros.core.runs.evaluation import fails
from sparse_coord_ros.studies.benchmark import Entry, Judge, result_of, scenario_of
from sparse_coord_ros.studies.leaderboard import BenchmarkResult, Leaderboard
from sparse_coord_ros.studies.lists import ABOUT, LISTS, Item
from sparse_coord_ros.studies.report.text import Row
from sparse_coord_ros.studies.standings import pooled_share
from tools.study.coordination import Found, Study

PAGE = "leaderboard.md"
TITLE = "sparse cooperative"
MOVES = 4

TUNING_SEED = 3_100_000
TUNING_TEAMS = 6
BUDGETS = (10_000, 100_000)
"""Steps of learning by which settings are chosen, by the mean of the two shares."""

SEED = 4_100_000
TEAMS = 20
STEPS = 100_000
TRIALS = 10_000
"""Greedy trials of a team."""

BLOCK = 1000
"""Steps whose random numbers are drawn at once."""

RESULTS = Path(__file__).resolve().parents[1] / "central.json"


class Tables(NamedTuple):
    """What many teams have learned, each from a game of its own, and room for a step.

    Attributes:
        numbers: of the joint states in which robots coordinate, else -1 [cell][cell].
        own: values of a robot's moves [team][robot][cell][move].
        joint: values of joint moves [team][joint state][MOVES * first move + second move].
        own_updates, joint_updates: how often each was updated.
        moves, next_moves: moves of a step, and the best of the next one [game][robot].
        parts, next_parts: Q_i of these [game][robot].
    """

    numbers: np.ndarray
    own: np.ndarray
    joint: np.ndarray
    own_updates: np.ndarray
    joint_updates: np.ndarray
    moves: np.ndarray
    next_moves: np.ndarray
    parts: np.ndarray
    next_parts: np.ndarray


def places(scenario: Scenario, reach: int) -> np.ndarray:
    """Return numbers of the joint states in which robots coordinate, else -1: (cells, cells).

    There both robots are at most `reach` moves from one doorway.
    """
    cells = len(scenario.map.cells)
    together = np.zeros((cells, cells), dtype=bool)
    for doorway in scenario.map.doorways:
        near = np.arange(cells) == doorway
        for _ in range(reach):
            near = near | near[scenario.map.next_cell].any(axis=1)
        together |= near[:, None] & near
    numbers = together.cumsum().reshape(together.shape) - 1
    return np.where(together, numbers, -1)


def _new_tables(numbers: np.ndarray, teams: int, first_value: float) -> Tables:
    own = (teams, 2, len(numbers), MOVES)
    joint = (teams, numbers.max() + 1, MOVES * MOVES)
    return Tables(
        numbers=numbers,
        own=np.full(own, float(first_value)),
        joint=np.full(joint, 2.0 * first_value),
        own_updates=np.zeros(own, dtype=np.int64),
        joint_updates=np.zeros(joint, dtype=np.int64),
        moves=np.zeros((teams, 2), dtype=np.int64),
        next_moves=np.zeros((teams, 2), dtype=np.int64),
        parts=np.zeros((teams, 2)),
        next_parts=np.zeros((teams, 2)),
    )


# The rule.


@inlined
def state_of(tables: Tables, games: Games, i: int) -> int:
    """Return the number of a game's joint state; -1: each robot is by itself."""
    if games.arrived[i, 0] or games.arrived[i, 1]:
        return -1
    return int(tables.numbers[games.cells[i, 0], games.cells[i, 1]])


@inlined
def best_moves(tables: Tables, games: Games, i: int, state: int, moves: Any) -> None:
    """Fill in the best moves of a game's robots; of equals the first."""
    if state >= 0:
        pairs = tables.joint[i, state]
        best = 0
        for pair in range(1, MOVES * MOVES):
            if pairs[pair] > pairs[best]:
                best = pair
        moves[i, 0] = best // MOVES
        moves[i, 1] = best % MOVES
        return
    for k in range(2):
        values = tables.own[i, k, games.cells[i, k]]
        best = 0
        for move in range(1, MOVES):
            if values[move] > values[best]:
                best = move
        moves[i, k] = best


@inlined
def own_parts(
    tables: Tables, games: Games, i: int, state: int, moves: Any, parts: Any
) -> None:
    """Fill in Q_i: a robot's own value, or half of the joint one."""
    for k in range(2):
        if state >= 0:
            pair = moves[i, 0] * MOVES + moves[i, 1]
            parts[i, k] = tables.joint[i, state, pair] / 2
        else:
            parts[i, k] = tables.own[i, k, games.cells[i, k], moves[i, k]]


@inlined
def learn_step(
    tables: Tables,
    games: Games,
    outcome: Outcome,
    infos: Infos,
    i: int,
    draws: Any,
    epsilon: float,
    by_count: Any,
    floor: float,
    discount: float,
) -> None:
    """Make a time step of a game, and learn from it."""
    state = state_of(tables, games, i)
    first = games.cells[i, 0]
    second = games.cells[i, 1]
    first_acts = not games.arrived[i, 0]
    second_acts = not games.arrived[i, 1]
    best_moves(tables, games, i, state, tables.moves)
    for k in range(2):
        if draws[0, i, k] < epsilon:
            tables.moves[i, k] = int(draws[1, i, k] * MOVES)
        if games.arrived[i, k]:
            tables.moves[i, k] = 0
    own_parts(tables, games, i, state, tables.moves, tables.parts)
    advance(games, i, tables.moves, outcome, infos)
    next_state = state_of(tables, games, i)
    best_moves(tables, games, i, next_state, tables.next_moves)
    own_parts(tables, games, i, next_state, tables.next_moves, tables.next_parts)
    errors = tables.parts[i]
    for k in range(2):
        after = 0.0
        if not games.arrived[i, k]:
            after = discount * tables.next_parts[i, k]
        errors[k] = outcome.reward[i, k] + after - tables.parts[i, k]
    if state >= 0:
        pair = tables.moves[i, 0] * MOVES + tables.moves[i, 1]
        tables.joint_updates[i, state, pair] += 1
        alpha = max(by_count[tables.joint_updates[i, state, pair]], floor)
        tables.joint[i, state, pair] += alpha * (errors[0] + errors[1])
        return
    for k in range(2):
        cell = first if k == 0 else second
        acts = first_acts if k == 0 else second_acts
        if acts:
            move = tables.moves[i, k]
            tables.own_updates[i, k, cell, move] += 1
            alpha = max(by_count[tables.own_updates[i, k, cell, move]], floor)
            tables.own[i, k, cell, move] += alpha * errors[k]


def learn_steps(
    tables: Tables,
    games: Games,
    outcome: Outcome,
    infos: Infos,
    draws: Any,
    epsilons: Any,
    by_count: Any,
    floors: Any,
    discount: float,
) -> None:
    """Make some steps of each game; a call that begins an episode is one of them.

    Args:
        tables: of a team for each game, changed.
        games: the games, changed.
        outcome: room.
        infos: room.
        draws: whether a robot explores, and its move: in [0, 1), [step][which][game][robot].
        epsilons: [step].
        by_count: step sizes [update].
        floors: their least values [step].
        discount: gamma.
    """
    for step in range(len(draws)):
        for i in range(len(games.step)):
            if games.ended[i]:
                begin(games, i)
            else:
                learn_step(
                    tables,
                    games,
                    outcome,
                    infos,
                    i,
                    draws[step],
                    epsilons[step],
                    by_count,
                    floors[step],
                    discount,
                )


def play_all(
    tables: Tables,
    games: Games,
    outcome: Outcome,
    infos: Infos,
    returns: Any,
    arrived: Any,
    discount: float,
) -> None:
    """Play greedy trials of each team, one after the other in a game of its own.

    Args:
        tables: what the teams have learned.
        games: of the teams, changed.
        outcome: room.
        infos: room.
        returns: zeros, filled [team][trial][robot].
        arrived: filled likewise.
        discount: gamma.
    """
    for i in range(len(games.step)):
        for trial in range(returns.shape[1]):
            begin(games, i)
            weight = 1.0
            while not games.ended[i]:
                state = state_of(tables, games, i)
                best_moves(tables, games, i, state, tables.moves)
                advance(games, i, tables.moves, outcome, infos)
                for k in range(2):
                    returns[i, trial, k] += weight * outcome.reward[i, k]
                weight *= discount
            for k in range(2):
                arrived[i, trial, k] = games.arrived[i, k]


class Loops(NamedTuple):
    """The loops, ready to be called."""

    learn_steps: Any
    play_all: Any


@functools.cache
def loops() -> Loops:
    """Return the loops, compiled where numba is installed."""
    plain = Loops(learn_steps, play_all)
    return Loops(*jit(plain)) if has_numba() else plain


# Learning and judging.


def learn(
    scenario: Scenario, teams: int, seed: int, *, reach: int, first_value: float
) -> Tables:
    """Return what teams learned in the scenario's steps.

    Args:
        scenario: the problem, of two robots.
        teams: how many there are.
        seed: team i learns in the game of seed + i; also of exploration.
        reach: moves from a doorway within which robots coordinate.
        first_value: where the values of a robot begin.
    """
    games, outcome, infos = _games(scenario, teams, seed, LEARNING)
    shown = many_games.new_observations(games)
    every = np.ones(teams, dtype=np.bool_)
    many_games.loops().begin_all(games, every, shown, outcome, infos)
    tables = _new_tables(places(scenario, reach), teams, first_value)
    random = np.random.default_rng(seed)
    epsilons = probabilities(scenario.epsilon, scenario.steps)
    sizes = step_sizes(scenario.step_size, scenario.steps)
    for first in range(0, scenario.steps, BLOCK):
        last = min(first + BLOCK, scenario.steps)
        loops().learn_steps(
            tables,
            games,
            outcome,
            infos,
            random.random((last - first, 2, teams, 2)),
            epsilons[first:last],
            sizes.by_count,
            sizes.by_step[first:last],
            scenario.discount,
        )
    return tables


def play(
    scenario: Scenario, tables: Tables, trials: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the returns of greedy trials and who arrived, shape (teams, trials, robots) each.

    Args:
        scenario: the problem.
        tables: what the teams have learned.
        trials: of each team.
        seed: of the game of the first team; the others follow.
    """
    teams = len(tables.own)
    games, outcome, infos = _games(scenario, teams, seed, EVALUATION)
    returns = np.zeros((teams, trials, 2))
    arrived = np.zeros((teams, trials, 2), dtype=np.bool_)
    loops().play_all(tables, games, outcome, infos, returns, arrived, scenario.discount)
    return returns, arrived


def _games(
    scenario: Scenario, games: int, seed: int, phase: int
) -> tuple[Games, Outcome, Infos]:
    made = many_games.room_for_games(scenario, games, phase=phase, in_halves=True)
    for i in range(games):
        many_games.seed_one(made, i, scenario, seed + i, phase)
    return made, many_games.new_outcome(made), many_games.new_infos(made)


@dataclass(frozen=True)
class Trial:
    """Settings that were tried.

    Attributes:
        reach: moves from a doorway within which robots coordinate.
        first_value: where the values of a robot begin.
        settings: of learning.
    """

    reach: int
    first_value: float
    settings: Mapping[str, object]

    def __str__(self) -> str:
        """Return it in words."""
        return ", ".join(f"{name}={value}" for name, value in self.said().items())

    def said(self) -> dict[str, object]:
        """Return all that was chosen, by name."""
        chosen = {"reach": self.reach, "first_value": self.first_value}
        return {**chosen, **self.settings}

    def teams(
        self, scenario: Scenario, teams: int, steps: int, seed: int
    ) -> tuple[np.ndarray, int]:
        """Return what teams of a scenario earn, shape (teams,), and how many of them fail."""
        changed = scenario.with_settings({**self.settings, "steps": steps})
        tables = learn(
            changed, teams, seed, reach=self.reach, first_value=self.first_value
        )
        returns, arrived = play(changed, tables, TRIALS, seed)
        shares = arrived.all(axis=2).mean(axis=1)
        failed = sum(fails(share) for share in shares)
        return returns.mean(axis=(1, 2)), failed


PROTOCOL: Mapping[str, object] = {
    "epsilon": "linear:0.3:0.02:0.8",
    "starts": "exploring:1:0:0.5",
    "step_size": "floored:0.6:0.1:0.01",
}

TRIED = (
    Trial(2, 20, PROTOCOL),
    Trial(0, 20, PROTOCOL),
    Trial(1, 20, PROTOCOL),
    Trial(3, 20, PROTOCOL),
    Trial(2, 0, PROTOCOL),
    Trial(2, 20, {}),
    Trial(2, 20, {**PROTOCOL, "epsilon": "constant:0.1"}),
    Trial(2, 20, {**PROTOCOL, "step_size": "constant:0.1"}),
    Trial(2, 20, {**PROTOCOL, "step_size": "floored:0.6:0.2:0.01"}),
    Trial(2, 20, {**PROTOCOL, "starts": "fixed"}),
    Trial(2, 20, {**PROTOCOL, "starts": "exploring:1:0:0.3"}),
    Trial(3, 20, {**PROTOCOL, "step_size": "constant:0.1"}),
)
"""Twelve trials; the first has the settings of the example."""

CHOSEN = TRIED[2]
"""The best of them."""


def _tuning(_found: Found) -> Iterator[Row]:
    """Yield each trial; the best is marked."""
    items = LISTS["tuning-pairs"]
    tried = [
        [_results(trial, items, TUNING_TEAMS, steps, TUNING_SEED) for steps in BUDGETS]
        for trial in TRIED
    ]
    shares = [[_share(one) for one in own] for own in tried]
    means = [sum(mean for mean, _ in own) / len(own) for own in shares]
    for trial, own, stood, mean in zip(TRIED, tried, shares, means, strict=True):
        row: dict[str, str | None] = {
            "learner": TITLE,
            "settings": str(trial),
            "chosen": "yes" if mean == max(means) else None,
        }
        for steps, found, (share, error) in zip(BUDGETS, own, stood, strict=True):
            failed = sum(one.failed for one in found)
            said = f"{percent(share)} ({100 * error:.1f}); {failed}"
            row[f"2r, {steps:,} steps"] = said
        yield row


def _share(found: Sequence[BenchmarkResult]) -> tuple[float, float]:
    """Return the share of the gap in sampled buildings, and its standard error."""
    learned = [np.array(one.returns) for one in found]
    low = np.array([one.paths for one in found])
    high = np.array([one.top for one in found])
    share = pooled_share(learned, low, high)
    return share.mean, share.standard_error


def _results(
    trial: Trial, items: Sequence[Item], teams: int, steps: int, seed: int
) -> tuple[BenchmarkResult, ...]:
    """Return what teams are worth in each scenario; empty: the learner cannot learn them all."""
    scenarios = [scenario_of(item) for item in items]
    if not all(map(_can_learn, scenarios)):
        return ()
    found = []
    for item, scenario in zip(items, scenarios, strict=True):
        returns, failed = trial.teams(scenario, teams, steps, seed)
        found.append(result_of(item, scenario, tuple(returns.tolist()), failed))
    return tuple(found)


def _can_learn(scenario: Scenario) -> bool:
    """Return whether the learner fits: two robots, which it sees at all times."""
    return len(scenario.robots) == 2 and scenario.perception.kind == "always"


class CentralJudge(Judge):
    """How the learner is judged: as others are, but by trials."""

    def learned(
        self, entry: Entry, items: Sequence[Item], steps: int
    ) -> tuple[BenchmarkResult, ...]:
        """Let teams learn in each scenario; empty: the learner cannot learn all of them."""
        return _results(CHOSEN, items, self.runs, steps, self.seed)

    def seconds(self, entry: Entry, item: Item) -> float:
        """Return the processor time of one learning run; the loops are compiled already."""
        scenario = scenario_of(item).with_settings(
            {**CHOSEN.settings, "steps": self.steps}
        )
        began = time.process_time()
        learn(
            scenario,
            1,
            self.seed,
            reach=CHOSEN.reach,
            first_value=CHOSEN.first_value,
        )
        return time.process_time() - began


def _central(_found: Found) -> Iterator[Row]:
    """Yield how the learner stands in each list of the leaderboard; the results are kept."""
    judge = CentralJudge(STEPS, TEAMS, TRIALS, SEED, None, {})
    entry = Entry(TITLE, TITLE, CHOSEN.said())
    places = [judge.place(entry, name, LISTS[name]) for name in ABOUT]
    board = Leaderboard(tuple(places), SEED, TRIALS)
    board.save(RESULTS)
    for place in places:
        row = place.row()
        del row["entry"]
        yield row


STUDIES = (
    Study("central_tuned", (2, 2), 2, _tuning, TUNING_SEED, PAGE),
    Study("central", (2, 2), 2, _central, SEED, PAGE),
)
