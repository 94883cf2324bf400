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
from typing import Any

from sparse_coord_ros.cli.options import format_table
from sparse_coord_ros.engine.batch import run_batch
from sparse_coord_ros.engine.processes import in_processes
from sparse_coord_ros.errors import SparseCoordError
from sparse_coord_ros.game.scenario import Scenario, load_scenario
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.learn.simulation import learn
from tools.c_loop.loop import CLoop

MEASURED = (
    ("env1", "coop", 1.0),
    ("env1", "factored", 0.5),
    ("env1", "tools.coordination.rules:NoReplay", 0.5),
    ("crowd-8r", "factored", 0.1),
)
"""Scenario, learner, and how many of the runs that were asked for."""

PYTHON_RUNS = 3
"""Learning runs of the plain Python measurement at most: it is hundreds of times slower."""

ENGINE, PYTHON, C_LOOP = "engine (numba)", "plain Python", "plain C loop"


def measure(scenario: str, learner: str, *, steps: int, runs: int, repeats: int) -> dict[str, Any]:
    """Measure learning runs in a process of its own, as which numba begins cold.

    Args:
        scenario: a scenario's name.
        learner: whose learning.
        steps: transitions of a run.
        runs: runs of a measurement.
        repeats: how often each figure is measured, all figures in turn.

    Returns:
        What was measured: `ready_seconds` until the engine could begin; `rates`, for each way its
        threads and its agent-steps a second; `missing`, what cannot be measured here and why.
    """
    [found] = in_processes(measure_here, [(scenario, learner, steps, runs, repeats)], 1)
    return found


def measure_here(name: str, learner: str, steps: int, runs: int, repeats: int) -> dict[str, Any]:
    """Measure in this process; see `measure`."""
    rule = learner_of(learner)
    scenario = rule.with_defaults(load_scenario(name).with_settings({"steps": steps}))
    threads = sorted({len(os.sched_getaffinity(0)), 1}, reverse=True)
    missing: list[str] = []
    ways: dict[tuple[str, int], tuple[int, Callable[[], object]]] = {}
    ready_seconds = None
    try:
        ready_seconds = _seconds(partial(_batch, scenario.with_settings({"steps": 1}), learner, 1))
        ways |= {(ENGINE, n): (runs, partial(_batch, scenario, learner, runs, n)) for n in threads}
    except SparseCoordError as error:
        missing.append(f"{ENGINE}: {error}")
    try:
        if learner == "coop":  # there is one of the paper's learner alone
            loop = CLoop(scenario)
            ways |= {(C_LOOP, n): (runs, partial(loop.learn_runs, runs, n)) for n in threads}
    except SparseCoordError as error:
        missing.append(f"{C_LOOP}: {error}")
    few = min(runs, PYTHON_RUNS)
    ways[PYTHON, 1] = few, lambda: [learn(scenario, learner, seed) for seed in range(few)]
    rates: dict[tuple[str, int], list[float]] = {way: [] for way in ways}
    for _ in range(repeats):
        for way, (count, work) in ways.items():
            rates[way].append(steps * len(scenario.robots) * count / _seconds(work))
    return {
        "title": f"{name}, {rule.title or learner.rpartition(':')[2]}",
        "steps": steps,
        "runs": runs,
        "ready_seconds": ready_seconds,
        "rates": [
            {"way": way, "threads": n, "agent_steps_per_second": found}
            for (way, n), found in rates.items()
        ],
        "missing": missing,
    }


def _batch(scenario: Scenario, learner: str, runs: int, threads: int = 1) -> None:
    for _ in run_batch(scenario, learner, range(runs), trials=0, engine="numba", jobs=threads):
        pass


def _seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def table(found: dict[str, Any]) -> str:
    """Return the table of what `measure` found."""
    medians = {
        (one["way"], one["threads"]): statistics.median(one["agent_steps_per_second"])
        for one in found["rates"]
    }
    rows = []
    for one in found["rates"]:
        way, threads, rates = one["way"], one["threads"], one["agent_steps_per_second"]
        median, c_loop = medians[way, threads], medians.get((C_LOOP, threads))
        rows.append(
            [
                f"{way}, {threads} thread{'s' * (threads > 1)}",
                f"{median / 1e6:.2f}",
                f"{min(rates) / 1e6:.2f} to {max(rates) / 1e6:.2f}",
                f"{median / threads / 1e6:.2f}",
                f"{median / c_loop:.0%}" if c_loop else "-",
            ]
        )
    title = f"{found['title']}, {found['runs']} runs of {found['steps']} steps"
    head = [title, "M agent-steps/s", "range", "per core", f"of the {C_LOOP}"]
    notes = list(found["missing"])
    if found["ready_seconds"] is not None:
        notes.append(f"engine: ready in {found['ready_seconds']:.1f} s, not counted above")
    return "\n".join([format_table(head, rows), *notes])
