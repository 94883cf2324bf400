# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The batch engine's speed, beside plain Python.

An agent-step is one robot's part of one time step: a run makes budget x robots of them.
"""

import os
import statistics
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from sparse_coord_ros.cli.options import format_table
from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.engine.processes import in_processes
from sparse_coord_ros.core.game.plugins import allow_named
from sparse_coord_ros.core.game.scenario import Scenario, load_scenario
from sparse_coord_ros.core.learners.factored import Factored
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.run import learn
from tools.bench.rates import in_turn, spread

MEASURED = (
    ("env1", "coop", 1.0),
    ("env1", "factored", 0.5),
    ("env1", "tools.bench.batch:NoReplay", 0.5),
    ("crowd-8r", "factored", 0.1),
)
"""Scenario, learner, and how many of the runs that were asked for."""

PYTHON_RUNS = 3
"""Learning runs of the plain Python measurement: it is hundreds of times slower."""


class NoReplay(Factored):
    """A learner of one's own: factored that does not learn from its own model."""

    @staticmethod
    def replay(mind: Any, task: Any, now: Any) -> None:
        """Replay nothing."""


ENGINE = "engine (numba)"
PYTHON = "plain Python"


def measured(scenario: str, learner: str, steps: int, runs: int, repeats: int) -> str:
    """Return the table of learning runs in a process of its own, as which numba begins cold.

    Args:
        scenario: a scenario's name.
        learner: the learner.
        steps: transitions of a run.
        runs: runs of a measurement.
        repeats: how often each figure is measured, all figures in turn.

    Raises:
        SparseCoordError: numba is missing.
    """
    [found] = in_processes(
        _measured_here, [(scenario, learner, steps, runs, repeats)], 1
    )
    return found


def _measured_here(name: str, learner: str, steps: int, runs: int, repeats: int) -> str:
    allow_named(learner)
    rule = learner_of(learner)
    scenario = rule.with_defaults(load_scenario(name).with_settings({"steps": steps}))
    ready = seconds_of(
        partial(learn_batch, scenario.with_settings({"steps": 1}), learner, 1)
    )
    ways: dict[tuple[str, int], Callable[[], float]] = {}

    def add(way: str, threads: int, count: int, work: Callable[[], object]) -> None:
        agent_steps = steps * len(scenario.robots) * count
        ways[way, threads] = lambda: agent_steps / 1e6 / seconds_of(work)

    for threads in sorted({len(os.sched_getaffinity(0)), 1}, reverse=True):
        add(
            ENGINE,
            threads,
            runs,
            partial(learn_batch, scenario, learner, runs, threads),
        )
    seeds = range(PYTHON_RUNS)
    add(
        PYTHON,
        1,
        PYTHON_RUNS,
        lambda: [learn(scenario, learner, seed) for seed in seeds],
    )
    title = f"{name}, {rule.title or learner.rpartition(':')[2]}, {runs} runs of {steps} steps"
    return table(title, ready, in_turn(ways, repeats))


def learn_batch(scenario: Scenario, learner: str, runs: int, threads: int = 1) -> None:
    """Let teams learn, compiled."""
    for _ in run_batch(
        scenario, learner, range(runs), trials=0, engine="numba", jobs=threads
    ):
        pass


def seconds_of(work: Callable[[], object]) -> float:
    """Return how long some work takes."""
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def table(
    title: str, ready_seconds: float, rates: Mapping[tuple[str, int], list[float]]
) -> str:
    """Return the table of measurements.

    Args:
        title: scenario, learner, and the work.
        ready_seconds: until the engine could begin.
        rates: 10^6 agent-steps a second, an entry a repeat, by way and threads.
    """
    plain = statistics.median(rates[PYTHON, 1])
    rows = [
        [
            f"{way}, {threads} thread{'s' * (threads > 1)}",
            *spread(found, 2),
            f"{statistics.median(found) / threads / plain:.0f}",
        ]
        for (way, threads), found in rates.items()
    ]
    head = [title, "M agent-steps/s", "range", f"a core, times {PYTHON}"]
    ready = f"engine: ready in {ready_seconds:.1f} s, not counted above"
    return f"{format_table(head, rows)}\n{ready}"
