# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the page is told, as plain data for JSON.

Every source, live or recorded, makes the same messages by these functions. A message replaces the
one before of its type: the page needs only the newest of each.
"""

from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from sparse_coord_ros.base import palette
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.core.game.actions import ACTIONS, DIRECTIONS, PRIMITIVES
from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.history import History
from sparse_coord_ros.core.runs.measures import Measures
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.core.solve.exact import MOST_ROBOTS, evaluate_best
from sparse_coord_ros.core.solve.shipped import known_optimum, yardsticks
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths
from sparse_coord_ros.core.solve.verdict import verdict_on
from sparse_coord_ros.log.runlog import explain
from sparse_coord_ros.log.runlog.relearned import AskedQuestion
from sparse_coord_ros.protocol.wire import PerceptEnd
from sparse_coord_ros.show.episodes import BUSIEST, played_episode
from sparse_coord_ros.show.narrator import Narrator, failing_in_words, rules_in_words
from sparse_coord_ros.show.page.key_steps import LearnedTeam, kinds_of, shown_by
from sparse_coord_ros.show.page.message_board import Message, MessageBoard
from sparse_coord_ros.show.policy import entered, policy_of
from sparse_coord_ros.show.steps import Question, questions_of

POINTS = 240
"""Points of a learning curve at most: each is the mean of as many episodes as that takes."""

MOST_ENTRIES = 40
"""Questions that the page shows."""

PAGE_TRIALS = 300
"""Trials of a team that cannot be evaluated exactly."""

RECENT = 100
"""Episodes that the headline of a live run tells of."""

MOST_NAMED = 4
"""Robots of a live run that its headline names."""

SHAPES = (
    "circle",
    "square",
    "triangle",
    "diamond",
    "pentagon",
    "hexagon",
    "star",
    "cross",
)
"""What tells the robots apart beside colour and number."""


def run_fields(run: RunConfig) -> Message:
    """Return what stays the same while one run is shown."""
    scenario = run.scenario
    grid = scenario.map
    return {
        "version": __version__,
        "scenario": scenario.name,
        "learner": run.title,
        "label": run.learner,
        "greedy": run.greedy,
        "seed": run.seed,
        "budget": scenario.steps,
        "penalty": scenario.penalty,
        "perception": str(scenario.perception),
        "interactions": scenario.interactions,
        "rules": rules_in_words(scenario),
        "actions": ACTIONS,
        "directions": DIRECTIONS,
        "outcomes": {
            name: {"colour": colour, "sign": palette.OUTCOME_SIGNS[name]}
            for name, colour in palette.OUTCOME_COLOURS.items()
        },
        "doorway_colour": palette.DOORWAY_COLOUR,
        "kinds": kinds_of(scenario),
        "map": {
            **{
                name: getattr(grid, name) for name in ("name", "title", "rows", "cells")
            },
            "doorways": sorted(grid.doorways),
            "under": _floor_plan_under(grid),
        },
        "robots": [
            {
                **vars(robot),
                "colour": palette.robot_colour(k),
                "shape": SHAPES[k % len(SHAPES)],
            }
            for k, robot in enumerate(scenario.robots)
        ],
    }


def _floor_plan_under(grid: GridMap) -> Message | None:
    """Return the floor plan under a map, as a picture; None without one, or the extra `maps`."""
    if grid.resolution is None:
        return None
    with suppress(ImportError):
        from sparse_coord_ros.lab.maps.image import under

        return under(grid)
    return None


def frame_fields(
    seen: TeamTransition, trails: Sequence[Sequence[int]], narrator: Narrator
) -> Message:
    """Return a time step: the robots' cells, their questions, and how they interact.

    Args:
        seen: the time step.
        trails: the last cells of each robot, the oldest first.
        narrator: of the scenario.
    """
    return {
        "step": seen.step,
        "cells": seen.cells,
        "trails": trails,
        "asks": [
            {
                "robot": q.asker,
                "peers": q.peers,
                "outcome": q.outcome,
                "ended": q.end.words,
            }
            for q in questions_of(seen)
        ],
        "after": seen.after,
        "miscoordination": seen.miscoordination,
        **narrator.interacting(seen)._asdict(),
        "interactions": narrator.interactions(seen),
    }


TablesThen = Mapping[int, tuple[int | None, Tables]]
"""By robot, the time step whose earlier transitions are learned, and the tables; None: those of
the run's end."""


def table_fields(run: RunConfig, tables: TablesThen) -> list[Message | None]:
    """Return what each robot's tables say; None for a robot without tables."""
    robots: list[Message | None] = [None] * len(run.scenario.robots)
    for k, (step, robot_tables) in tables.items():
        robot = run.scenario.robots[k]
        policy = policy_of(robot_tables, robot.goal)
        robots[k] = {
            "step": step,
            "q_star": plain(robot_tables.q_star),
            "moves": (policy.moves & policy.learned[:, None]).astype(int).tolist(),
            "asks": np.flatnonzero(policy.asks).tolist(),
            "enters": entered(policy, run.scenario.map, robot.start).tolist(),
        }
    return robots


def put_so_far(board: MessageBoard, run: RunConfig, history: History) -> None:
    """Show in words what robots would do by their tables on the board, and how they fare.

    Of tables of the run's end `put_end` says more.
    """
    tables = board.get("tables")
    if tables is None or not all(tables["robots"]):
        return
    robots = tables["robots"]
    if any(robot["step"] is None for robot in robots):
        return
    counts = [len(set(robot["asks"]) & set(robot["enters"])) for robot in robots]
    if len(robots) > MOST_NAMED:
        asking = sum(count > 0 for count in counts)
        lines = [f"So far {asking} robot{'s' * (asking != 1)} would ask on their ways."]
    else:
        where = ", ".join(
            f"{robot.name} in {count} cell{'s' * (count != 1)}"
            for robot, count in zip(run.scenario.robots, counts, strict=True)
        )
        lines = [f"So far, on their ways, robots would ask: {where}."]
    if history.episodes and history.present.all():
        recent = slice(-RECENT, None)
        count = min(RECENT, history.episodes)
        lines.append(
            f"In the last {count} episodes a robot asked "
            f"{history.asks[recent].mean():.2f} times, with "
            f"{history.miscoordinations[recent].mean():.2f} miscoordinations of the team."
        )
    put_learned(board, lines)


def put_tables(board: MessageBoard, run: RunConfig, tables: TablesThen) -> None:
    """Show what the robots' tables say; a page may point at cells to see more of them."""
    board.look = partial(pointed_fields, run, tables)
    board.put("tables", robots=table_fields(run, tables))


def pointed_fields(
    run: RunConfig, tables: TablesThen, cell: int, peer_cell: int
) -> Message:
    """Return the values of one cell: Q*, and Q^C where the peer is perceived in another one.

    Args:
        run: the run.
        tables: what the robots have learned.
        cell: the cell of the robot.
        peer_cell: the cell of its peer.

    Returns:
        For each robot None, if its tables are not known; else `q_star`, `q_coord` (None: it never
        asks, or has more than one peer) and the best moves without and with the answer.

    Raises:
        SettingError: there is no such cell.
    """
    cells = len(run.scenario.map.cells)
    team = len(run.scenario.robots)
    for number in (cell, peer_cell):
        if not 0 <= number < cells:
            raise SettingError(f"cell is {number}, allowed: 0 to {cells - 1}")
    robots: list[Message | None] = [None] * team
    for k, (_, robot_tables) in tables.items():
        q_star = robot_tables.q_star[cell]
        moves = q_star[:PRIMITIVES]
        q_coord = None
        if team == 2 and run.rule.asks:
            cells_of_team = [peer_cell, peer_cell]
            cells_of_team[k] = cell
            q_coord = np.array(
                robot_tables.values_asking(cell, 1 << (1 - k), cells_of_team)
            )
        robots[k] = {
            "q_star": plain(q_star),
            "q_coord": None if q_coord is None else plain(q_coord),
            "without": np.flatnonzero(moves == moves.max()).tolist(),
            "with": None
            if q_coord is None
            else np.flatnonzero(q_coord == q_coord.max()).tolist(),
        }
    return {"cell": cell, "peer_cell": peer_cell, "robots": robots}


def curve_fields(history: History) -> Message:
    """Return the learning curves, thinned.

    Each point is the mean over `window` episodes in the order of their beginnings; the last one
    over what is left.
    """
    first = history.first_step
    count = history.episodes
    order: Any = slice(None)
    # Robots that learn alone do so one after the other.
    if (first[1:] < first[:-1]).any():
        order = np.argsort(first, kind="stable")
    window = _window(count)
    begins = np.arange(0, count, window)

    def means(values: np.ndarray, weights: np.ndarray) -> list[Any]:
        """Return each point's mean; of robots only over the episodes in which they were there."""
        return _means(values[order], weights[order], begins)

    ones = np.ones(count)
    present = history.present
    return {
        "episodes": count,
        "window": window,
        "step": history.steps_before[order][begins].tolist(),
        "length": means(history.length, ones),
        "miscoordinations": means(history.miscoordinations, ones),
        "asks": means(history.asks, present),
    }


def _window(count: int) -> int:
    """Return over how many of so many episodes a point of a curve is the mean."""
    return max(1, -(-count // POINTS))


def _means(values: np.ndarray, weights: np.ndarray, begins: np.ndarray) -> list[Any]:
    """Return the mean of each group of episodes, by where the groups begin."""
    if not len(values):
        return []
    sums, counts = (
        np.add.reduceat(array.astype(float, copy=False), begins, axis=0)
        for array in (values, weights)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        return plain((sums / counts).T)


def measured(run: RunConfig, tables: Sequence[Tables]) -> Measures:
    """Return the value of tables: exact for one or two robots, else by `PAGE_TRIALS` trials.

    Raises:
        TablesError: the tables do not fit the run.
    """
    return evaluate_best(run.scenario, tables, trials=PAGE_TRIALS, learner=run.rule)


def evaluation_fields(
    run: RunConfig, tables: Sequence[Tables], measures: Measures, step: int | None
) -> Message:
    """Return the evaluation of tables.

    Args:
        run: the run.
        tables: of every robot.
        measures: their value.
        step: of which time step they are; None: of the run's end.
    """
    scenario = run.scenario
    verdict = verdict_on(scenario, run.rule, measures)
    optimum = known_optimum(scenario).value
    return {
        "step": step,
        "learner": run.title,
        **measures.to_dict(),
        "cells": measures.cells(optimum=optimum),
        "failing": failing_in_words(measures),
        "askers": _askers(run, tables),
        "verdict": verdict.text,
        "headline": verdict.headline,
        "yardsticks": yardsticks(scenario),
        "ignoring": _ignoring(scenario),
    }


def _ignoring(scenario: Scenario) -> float | None:
    """Return what a robot earns if robots ignore each other; None for teams that need trials."""
    if len(scenario.robots) > MOST_ROBOTS:
        return None
    return shortest_paths(scenario).mean("returns")


def _askers(run: RunConfig, tables: Sequence[Tables]) -> list[int]:
    """Return the robots (from 0) that ask in a cell to which they come greedily."""
    askers = []
    for k, (robot, robot_tables) in enumerate(
        zip(run.scenario.robots, tables, strict=True)
    ):
        policy = policy_of(robot_tables, robot.goal)
        reached = entered(policy, run.scenario.map, robot.start)
        if policy.asks[reached].any():
            askers.append(k)
    return askers


def put_learned(
    board: MessageBoard,
    lines: Sequence[str],
    *,
    first: int | None = None,
    step: int | None = None,
) -> None:
    """Show the headline: what was learned.

    Args:
        board: where the message goes.
        lines: sentences.
        first: where the episode begins that shows it; None outside a bag.
        step: the time step of its question; None: there is none.
    """
    board.put("learned", lines=lines, first=first, step=step)


def put_end(
    board: MessageBoard, run: RunConfig, tables: Sequence[Tables], measures: Measures
) -> tuple[TeamTransition, ...]:
    """Show the value of a finished run's tables, and in words what they do in a greedy episode.

    Args:
        board: where the messages go.
        run: the run.
        tables: of every robot.
        measures: their value.

    Returns:
        The episode's transitions, with time steps from 0.
    """
    value = evaluation_fields(run, tables, measures, None)
    episode = played_episode(run.scenario, tables, BUSIEST, seed=0, learner=run.rule)
    first = episode.steps[0].step if episode.steps else 0
    steps = tuple(seen._replace(step=seen.step - first) for seen in episode.steps)
    question = shown_by(steps, LearnedTeam(run, tables), Narrator(run.scenario))
    put_learned(board, [headline(question, value)])
    board.put("evaluation", **value)
    return steps


def headline(question: str, evaluation: Message | None) -> str:
    """Return what a team learned: a question whose answer changes a move; else the verdict.

    Args:
        question: in words; empty: there is none.
        evaluation: the fields of `evaluation_fields`; None: not known so far.
    """
    if evaluation is None or (question and not evaluation["failing"]):
        return question
    head: str = evaluation["headline"]
    return head


def asked_of(seen: TeamTransition, question: Question) -> AskedQuestion | None:
    """Return the question as `explain` takes it; None if the asker's cell is not known."""
    cell = seen.cells[question.asker]
    if cell is None:
        return None
    cells = tuple(at for peer in question.peers if (at := seen.cells[peer]) is not None)
    whole = (
        question.end == PerceptEnd.ANSWERED and len(cells) == len(question.peers) > 0
    )
    return AskedQuestion(question.asker, cell, cells if whole else None)


def in_words(
    run: RunConfig,
    seen: TeamTransition,
    known: Container[int],
    narrator: Narrator,
    rows: Mapping[int, str],
    reasons: Mapping[int, explain.Reason],
    made: int | None,
) -> Iterator[Message]:
    """Yield the questions of a time step: as a sentence, and as `explain` begins to tell them.

    Args:
        run: the run.
        seen: the time step.
        known: numbers of the robots whose tables are known; for the others no reason is given.
        narrator: of the scenario.
        rows: by robot, the row of its tables that decided, in words.
        reasons: by robot, the reason for its move, if that is known.
        made: learning steps before; None: not known so far.
    """
    for question in questions_of(seen):
        k, peers, end, move = question
        cell = seen.cells[k]
        after = None if seen.after is None else seen.after[k]
        whom = ", ".join(narrator.names[peer] for peer in peers) or "no peer"
        asked = asked_of(seen, question)
        outcome = end.words
        perceived = None if asked is None else asked.perceived
        if perceived is not None:
            cells = ", ".join(
                explain.cell_in_words(run, perceived_cell)
                for perceived_cell in perceived
            )
            outcome = f"answers {cells}"
        lines = [explain.choice_in_words(run, k, cell), f"asks {whom}: {outcome}"]
        reason = reasons.get(k)
        lines += explain.why_in_words(reason)
        by_cell = cell if k in known else None
        if reason is None and explain.moves_otherwise(run):
            by_cell = None
        by = explain.move_in_words(run, by_cell, perceived, move, reason)
        lines.append(by if by_cell is None else by + rows.get(k, ""))
        reward = seen.rewards[k] if seen.rewards else None
        if reward is not None:
            lines.append(explain.reward_in_words(run, reward.total, after))
        words = {"text": narrator.question(seen, question), "lines": lines}
        yield {
            "step": seen.step,
            "made": made,
            "robot": k,
            "outcome": question.outcome,
            **words,
        }


def plain(values: np.ndarray) -> list[Any]:
    """Return numbers with four digits as lists; None in place of NaN and infinity."""
    numbers = values.round(4)
    unknown = ~np.isfinite(numbers)
    if unknown.any():
        numbers = numbers.astype(object)
        numbers[unknown] = None
    rows: list[Any] = numbers.tolist()
    return rows
