# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the page is told, as plain data for JSON; described field by field in docs/watch.md.

Every source, live or recorded, makes the same messages by these functions. A message replaces the
one before of its type: the page needs only the newest of each.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np

from sparse_coord_ros.game.actions import ACTIONS
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.history import History
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.look.policy import policy_of
from sparse_coord_ros.look.steps import TimeStep
from sparse_coord_ros.palette import (
    DOORWAY_COLOUR,
    OUTCOME_COLOURS,
    OUTCOME_SIGNS,
    robot_colour,
)
from sparse_coord_ros.runlog.explain import (
    cell_in_words,
    choice_in_words,
    move_in_words,
    reward_in_words,
)
from sparse_coord_ros.version import __version__
from sparse_coord_ros.wire import PerceptEnd

FORMAT = 2
"""Number of the messages' format, in the message `run`."""

POINTS = 240
"""Points of a learning curve at most: each is the mean of as many episodes as that takes."""

DIALOGUE = 40
"""Questions that the page shows."""

SHAPES = ("circle", "square", "triangle", "diamond", "pentagon", "hexagon", "star", "cross")
"""What tells the robots apart beside colour and number."""

Message = dict[str, Any]


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
            name: {"colour": colour, "sign": OUTCOME_SIGNS[name]}
            for name, colour in OUTCOME_COLOURS.items()
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


def frame_message(seen: TimeStep, *, state: str, **more: Any) -> Message:
    """Return a time step; `more` are `transitions`, `episode`, `rate`, `first`, `last`."""
    return {
        "type": "frame",
        "step": seen.step,
        "state": state,
        "cells": list(seen.cells),
        "moves": list(seen.moves),
        "asks": [
            {
                "robot": q.asker,
                "peers": list(q.peers),
                "outcome": q.outcome,
                "ended": q.end.words,
            }
            for q in seen.questions
        ],
        "rewards": [
            None if parts is None else [n if isfinite(n) else None for n in parts]
            for parts in seen.rewards
        ],
        "after": None if seen.after is None else list(seen.after),
        "miscoordination": seen.miscoordination,
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
    }


def dialogue_message(entries: Iterable[Message]) -> Message:
    """Return the newest questions in words, the newest last."""
    return {"type": "dialogue", "entries": list(entries)}


def notice_message(text: str) -> Message:
    """Return a line about what is shown; an empty one takes it away."""
    return {"type": "notice", "text": text}


def in_words(run: RunConfig, seen: TimeStep) -> Iterator[Message]:
    """Yield the questions of a time step in words, as `explain` begins to tell them."""
    names = [robot.name for robot in run.scenario.robots]
    for question in seen.questions:
        k, peers, end, move = question
        whom = ", ".join(names[peer] for peer in peers) or "nobody"
        told, perceived = end.words, None
        cells = [cell for peer in peers if (cell := seen.cells[peer]) is not None]
        if end == PerceptEnd.ANSWERED and cells and len(cells) == len(peers):
            told, perceived = f"answers {', '.join(cell_in_words(run, c) for c in cells)}", cells
        lines = [
            choice_in_words(run, k, seen.cells[k]),
            f"asks {whom}: {told}",
            move_in_words(run, seen.cells[k], perceived, move),
        ]
        reward = seen.rewards[k]
        if reward is not None:
            after = None if seen.after is None else seen.after[k]
            lines.append(reward_in_words(run, reward[-1], after))
        yield {
            "step": seen.step,
            "robot": k,
            "outcome": question.outcome,
            "lines": lines,
        }


def _plain(values: np.ndarray) -> list[Any]:
    """Return numbers with four digits as lists; None where JSON has no such number."""
    found = values.round(4)
    unknown = ~np.isfinite(found)
    if unknown.any():
        found = found.astype(object)
        found[unknown] = None
    plain: list[Any] = found.tolist()
    return plain
