# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The batch engine's speed, beside plain Python and a plain C loop of the same work.

An agent-step is one robot's part of one time step: a run makes budget x robots of them.
"""

import os
import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from sparse_coord_ros.cli.options import format_table
from sparse_coord_ros.engine.batch import run_batch
from sparse_coord_ros.engine.processes import in_processes
from sparse_coord_ros.game.plugins import allow_named
from sparse_coord_ros.game.scenario import Scenario, load_scenario
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.learn.simulation import learn
from tools.c_loop.loop import CLoop

MEASURED = (
    ("env1", "coop", 1.0),
    ("env1", "factored", 0.5),
    ("env1", "tools.study.rules:NoReplay", 0.5),
    ("crowd-8r", "factored", 0.1),
)
"""Scenario, learner, and how many of the runs that were asked for."""

PYTHON_RUNS = 3
"""Learning runs of the plain Python measurement: it is hundreds of times slower."""

ENGINE, PYTHON, C_LOOP = "engine (numba)", "plain Python", "plain C loop"


class Measured(NamedTuple):
    """What was measured.

    Attributes:
        title: scenario, learner, and the work.
        ready_seconds: until the engine could begin.
        rates: agent-steps a second, an entry a repeat, by way and threads.
    """

    title: str
    ready_seconds: float
    rates: dict[tuple[str, int], list[float]]


def measure(scenario: str, learner: str, steps: int, runs: int, repeats: int) -> Measured:
    """Measure learning runs in a process of its own, as which numba begins cold.

    Args:
        scenario: a scenario's name.
        learner: whose learning.
        steps: transitions of a run.
        runs: runs of a measurement.
        repeats: how often each figure is measured, all figures in turn.

    Raises:
        SparseCoordError: numba or a C compiler is missing.
    """
    [found] = in_processes(_measure_here, [(scenario, learner, steps, runs, repeats)], 1)
    return found


def _measure_here(name: str, learner: str, steps: int, runs: int, repeats: int) -> Measured:
    allow_named(learner)
    rule = learner_of(learner)
    scenario = rule.with_defaults(load_scenario(name).with_settings({"steps": steps}))
    ready = _seconds(partial(_batch, scenario.with_settings({"steps": 1}), learner, 1))
    ways: dict[tuple[str, int], tuple[int, Callable[[], object]]] = {}
    for threads in sorted({len(os.sched_getaffinity(0)), 1}, reverse=True):
        ways[ENGINE, threads] = runs, partial(_batch, scenario, learner, runs, threads)
        if learner == "coop":  # there is one of the paper's learner alone
            ways[C_LOOP, threads] = runs, partial(CLoop(scenario).learn_runs, runs, threads)
    seeds = range(PYTHON_RUNS)
    ways[PYTHON, 1] = PYTHON_RUNS, lambda: [learn(scenario, learner, seed) for seed in seeds]
    rates: dict[tuple[str, int], list[float]] = {way: [] for way in ways}
    for _ in range(repeats):
        for way, (count, work) in ways.items():
            rates[way].append(steps * len(scenario.robots) * count / _seconds(work))
    whose = rule.title or learner.rpartition(":")[2]
    return Measured(f"{name}, {whose}, {runs} runs of {steps} steps", ready, rates)


def _batch(scenario: Scenario, learner: str, runs: int, threads: int = 1) -> None:
    for _ in run_batch(scenario, learner, range(runs), trials=0, engine="numba", jobs=threads):
        pass


def _seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def table(found: Measured) -> str:
    """Return the table of what was measured."""
    medians = {way: statistics.median(rates) for way, rates in found.rates.items()}
    rows = [
        [
            f"{way}, {threads} thread{'s' * (threads > 1)}",
            f"{median / 1e6:.2f}",
            f"{min(found.rates[way, threads]) / 1e6:.2f} to "
            f"{max(found.rates[way, threads]) / 1e6:.2f}",
            f"{median / threads / 1e6:.2f}",
            f"{median / medians[C_LOOP, threads]:.0%}" if (C_LOOP, threads) in medians else "-",
        ]
        for (way, threads), median in medians.items()
    ]
    head = [found.title, "M agent-steps/s", "range", "per core", f"of the {C_LOOP}"]
    ready = f"engine: ready in {found.ready_seconds:.1f} s, not counted above"
    return f"{format_table(head, rows)}\n{ready}"
