# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the page is told, as plain data for JSON; described field by field in docs/watch.md.

Every source, live or recorded, makes the same messages by these functions. A message replaces the
one before of its type: the page needs only the newest of each.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from sparse_coord_ros.game.actions import ACTIONS
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.history import History
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.look.policy import policy_of
from sparse_coord_ros.palette import (
    ANSWERED,
    DOORWAY_COLOUR,
    FAILED,
    OUTCOME_COLOURS,
    OUTCOME_SIGNS,
    REFUSED,
    robot_colour,
)
from sparse_coord_ros.version import __version__

FORMAT = 1
"""Number of the messages' format, in the message `run`."""

POINTS = 240
"""Points of a learning curve at most: each is the mean of as many episodes as that takes."""

SHAPES = ("circle", "square", "triangle", "diamond", "pentagon", "hexagon", "star", "cross")
"""What tells the robots apart beside colour and number."""

Message = dict[str, Any]


@dataclass(frozen=True)
class Ask:
    """One question as it is shown.

    Attributes:
        robot: who asks, from 0.
        peers: whom it asks.
        outcome: `palette.ANSWERED`, REFUSED or FAILED.
        ended: how it ended in the words of `wire.PERCEPT_ENDS`.
    """

    robot: int
    peers: tuple[int, ...]
    outcome: str
    ended: str


@dataclass(frozen=True)
class Moment:
    """One time step of the team; None where nobody said it.

    Attributes:
        step: t.
        cells: X_k(t).
        moves: the primitive actions; None of robots that did not act.
        asks: the questions.
        rewards: R_k(t) as (individual, common, cost of asking, total).
        after: X_k(t+1), or where the transition led.
        miscoordination: whether it ended in one.
    """

    step: int
    cells: Sequence[int | None]
    moves: Sequence[int | None]
    asks: Sequence[Ask] = ()
    rewards: Sequence[tuple[float, float, float, float] | None] = ()
    after: Sequence[int | None] | None = None
    miscoordination: bool = False


def run_message(run: RunConfig, *, source: str, title: str, controls: Sequence[str]) -> Message:
    """Return what stays the same while one run is shown."""
    scenario = run.scenario
    grid = scenario.map
    return {
        "type": "run",
        "format": FORMAT,
        "version": __version__,
        "source": source,
        "title": title,
        "controls": list(controls),
        "scenario": scenario.name,
        "learner": run.learner,
        "learner_title": run.rule.title or run.learner,
        "greedy": run.greedy,
        "seed": run.seed,
        "budget": scenario.steps,
        "penalty": scenario.penalty,
        "perception": str(scenario.perception),
        "actions": list(ACTIONS),
        "outcomes": {
            name: {"colour": OUTCOME_COLOURS[name], "sign": OUTCOME_SIGNS[name]}
            for name in (ANSWERED, REFUSED, FAILED)
        },
        "doorway_colour": DOORWAY_COLOUR,
        "map": {
            "name": grid.name,
            "title": grid.title,
            "rows": list(grid.rows),
            "cells": [list(place) for place in grid.cells],
            "doorways": sorted(grid.doorways),
        },
        "robots": [
            {
                "name": robot.name,
                "start": robot.start,
                "goal": robot.goal,
                "colour": robot_colour(k),
                "shape": SHAPES[k % len(SHAPES)],
            }
            for k, robot in enumerate(scenario.robots)
        ],
    }


def frame_message(moment: Moment, *, state: str, **more: Any) -> Message:
    """Return a time step; `more` are `transitions`, `episode`, `rate`, `first`, `last`."""
    rewards = [None if one is None else [_number(n) for n in one] for one in moment.rewards]
    return {
        "type": "frame",
        "step": moment.step,
        "state": state,
        "cells": list(moment.cells),
        "moves": list(moment.moves),
        "asks": [
            {"robot": a.robot, "peers": list(a.peers), "outcome": a.outcome, "ended": a.ended}
            for a in moment.asks
        ],
        "rewards": rewards,
        "after": None if moment.after is None else list(moment.after),
        "miscoordination": moment.miscoordination,
        **more,
    }


def tables_message(
    run: RunConfig,
    tables: Mapping[int, tuple[int, Tables]],
    rings: Mapping[int, np.ndarray] | None = None,
) -> Message:
    """Return what the robots' tables say.

    Args:
        run: the run.
        tables: by robot, the time step whose earlier transitions are learned, and the tables.
        rings: by robot, where it asks by a newer account than the tables, shape (cells,), bool.
    """
    robots: list[Message | None] = []
    for k, robot in enumerate(run.scenario.robots):
        if k not in tables:
            robots.append(None)
            continue
        step, own = tables[k]
        policy = policy_of(own, robot.goal)
        asks = policy.asks if rings is None or k not in rings else rings[k]
        robots.append(
            {
                "step": step,
                "q_star": _plain(own.q_star),
                "moves": policy.moves.astype(int).tolist(),
                "asks": np.flatnonzero(asks).tolist(),
            }
        )
    return {"type": "tables", "robots": robots}


def asked_message(asked: np.ndarray, until: int) -> Message:
    """Return how often each robot asked in each cell, shape (K, cells), up to a time step."""
    return {"type": "asked", "until": until, "robots": asked.tolist()}


def curves_message(history: History, *, until: float | None = None) -> Message:
    """Return the learning curves, thinned.

    Args:
        history: the episodes so far. Each point is the mean over `window` episodes in the order
            of their beginnings; the last one over what is left.
        until: which share of the log has been read, from 0 to 1; None: all there is.
    """
    first, count = history.first_step, history.episodes
    order: Any = slice(None)
    if (first[1:] < first[:-1]).any():  # of robots that learned alone, one after the other
        order = np.argsort(first, kind="stable")
    window = max(1, -(-count // POINTS))
    begins = np.arange(0, count, window)
    sizes = np.diff(np.append(begins, count))

    def means(values: np.ndarray, weights: np.ndarray | None = None) -> list[Any]:
        """Return each point's mean; of robots only over the episodes in which they were there."""
        if not count:
            return []
        sums = np.add.reduceat(values[order].astype(float, copy=False), begins, axis=0)
        counts = sizes.reshape(-1, *[1] * (sums.ndim - 1)).astype(np.float64)
        if weights is not None:
            counts = np.add.reduceat(weights[order].astype(float), begins, axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            found = sums / counts
        return _plain(found.T)

    own = history.present
    return {
        "type": "curves",
        "episodes": history.episodes,
        "window": window,
        "read": 1.0 if until is None else round(until, 4),
        "step": first[order][begins].tolist(),
        "length": means(history.length),
        "miscoordinations": means(history.miscoordinations),
        "reward": means(history.reward, own),
        "asks": means(history.asks, own),
        "arrived": means(history.arrived, own),
        "totals": {
            "transitions": int(history.length.sum()),
            "miscoordinations": int(history.miscoordinations.sum()),
            "asks": history.asks.sum(axis=0).tolist(),
            "reward": history.reward.sum(axis=0).tolist(),
        },
    }


def dialogue_message(entries: Sequence[Mapping[str, Any]]) -> Message:
    """Return the newest questions in words, the newest last."""
    return {"type": "dialogue", "entries": list(entries)}


def notice_message(text: str, *, level: str = "info") -> Message:
    """Return a line about the source; levels: info, warning."""
    return {"type": "notice", "level": level, "text": text}


def in_words(run: RunConfig, moment: Moment) -> Iterator[Message]:
    """Yield the questions of a time step in words, as `explain` begins to tell them."""
    names = [robot.name for robot in run.scenario.robots]
    for ask in moment.asks:
        k = ask.robot
        here = moment.cells[k]
        lines = [f"{names[k]} in {_cell(run, here)} chooses COORDINATE"]
        whom = ", ".join(names[peer] for peer in ask.peers) or "nobody"
        seen = [moment.cells[peer] for peer in ask.peers]
        source = "" if here is None else f" by Q*[{here}]"
        if ask.outcome == ANSWERED and seen and None not in seen:
            lines.append(f"asks {whom}: answers {', '.join(_cell(run, cell) for cell in seen)}")
            source = f" by Q^C[{', '.join(str(cell) for cell in (here, *seen))}]"
        else:
            lines.append(f"asks {whom}: {ask.ended}")
        move = moment.moves[k]
        if move is not None:
            lines.append(f"goes {ACTIONS[move]}{source}")
        reward = moment.rewards[k] if k < len(moment.rewards) else None
        if reward is not None:
            after = None if moment.after is None else moment.after[k]
            where = "" if after is None else f", to {_cell(run, after)}"
            lines.append(f"reward {reward[3]:g}{where}")
        yield {"step": moment.step, "robot": k, "outcome": ask.outcome, "lines": lines}


def _cell(run: RunConfig, cell: int | None) -> str:
    if cell is None or not 0 <= cell < len(run.scenario.map.cells):
        return "an unknown cell"
    row, column = run.scenario.map.cells[cell]
    return f"cell {cell} [{row}, {column}]"


def _number(value: float) -> float | None:
    """Return a number that JSON has, or None."""
    return value if isfinite(value) else None


def _plain(values: np.ndarray) -> list[Any]:
    """Return numbers with four digits as lists; None where JSON has no such number."""
    found = values.round(4)
    unknown = ~np.isfinite(found)
    if unknown.any():
        found = found.astype(object)
        found[unknown] = None
    plain: list[Any] = found.tolist()
    return plain
