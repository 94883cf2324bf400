# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The batch engine's speed, beside plain Python and, where one is given, a rival.

An agent-step is one robot's part of one time step: a run makes budget x robots of them. Needs no
ROS; without numba the engine's figures are missing and a text says why.
"""

import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

from sparse_coord_ros.compiling import has_numba
from sparse_coord_ros.engine.batch import run_batch
from sparse_coord_ros.engine.processes import in_processes
from sparse_coord_ros.errors import RunError
from sparse_coord_ros.game.scenario import Scenario, load_scenario
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.learn.simulation import learn

LEARNER = "coop"
PYTHON_RUNS = 3
"""Learning runs of the plain Python measurement at most: it is hundreds of times slower."""

ENGINE, PYTHON = "engine (numba)", "plain Python"


class Rival(Protocol):
    """Another implementation of the same learning."""

    name: str

    def rate(self, runs: int, threads: int) -> float:
        """Learn some runs on some threads and return the agent-steps a second."""


@dataclass(frozen=True)
class Figure:
    """What one way of learning reached.

    Attributes:
        name: ENGINE, PYTHON or the rival's.
        threads: threads that it used.
        agent_steps_per_second: one value a repeat; none where it cannot be measured.
        missing: why there is none, else "".
    """

    name: str
    threads: int
    agent_steps_per_second: tuple[float, ...] = ()
    missing: str = ""

    @property
    def median(self) -> float | None:
        """The median of the repeats; None where there is none."""
        if not self.agent_steps_per_second:
            return None
        return statistics.median(self.agent_steps_per_second)


@dataclass(frozen=True)
class BatchFigures:
    """The measurement of the batch engine.

    Attributes:
        scenario: the scenario's name.
        learner: the learner's name in files.
        steps: transitions of a learning run.
        runs: learning runs of a measurement (of plain Python: at most `PYTHON_RUNS`).
        cores: cores that this process may use.
        ready_seconds: what numba takes to compile the loops, or to find them on disk; None
            without numba.
        peak_memory: greatest resident memory of the process that measured the engine, in bytes,
            interpreter and compiler included; None without numba.
        figures: engine and rival on all cores and on one, plain Python on one.
    """

    scenario: str
    learner: str
    steps: int
    runs: int
    cores: int
    ready_seconds: float | None
    peak_memory: int | None
    figures: tuple[Figure, ...]

    def against(self, name: str) -> float | None:
        """Speed of the engine as a share of another's, on all cores; None where one misses."""
        found = {f.name: f.median for f in self.figures if f.threads == self.cores}
        engine, other = found.get(ENGINE), found.get(name)
        return engine / other if engine and other else None


def measure(
    name: str,
    *,
    steps: int,
    runs: int,
    repeats: int,
    rivals: Sequence[tuple[str, Callable[[Scenario], Rival]]] = (),
    learner: str = LEARNER,
) -> BatchFigures:
    """Measure learning runs in a process of its own.

    Args:
        name: a scenario's name.
        steps: transitions of a run.
        runs: runs of a measurement.
        repeats: how often each figure is measured, all figures in turn.
        rivals: names of others, and what makes them of a scenario, or raises `RunError`.
        learner: whose learning.
    """
    [figures] = in_processes(measure_here, [(name, steps, runs, repeats, rivals, learner)], 1)
    return figures


def measure_here(
    name: str,
    steps: int,
    runs: int,
    repeats: int,
    rivals: Sequence[tuple[str, Callable[[Scenario], Rival]]] = (),
    learner: str = LEARNER,
) -> BatchFigures:
    """Measure in this process; see `measure`."""
    scenario = load_scenario(name).with_settings({"steps": steps})
    scenario = learner_of(learner).with_defaults(scenario)
    cores = len(os.sched_getaffinity(0))
    threads = sorted({cores, 1}, reverse=True)
    ways: dict[tuple[str, int], Callable[[], float]] = {}
    missing: dict[tuple[str, int], str] = {}
    ready_seconds = peak_memory = None
    if has_numba():
        ready_seconds = _ready_seconds(scenario, learner)
        _engine_rate(scenario, learner, runs, cores)
        peak_memory = _peak_memory()  # before anything else takes more
        ways |= {(ENGINE, n): partial(_engine_rate, scenario, learner, runs, n) for n in threads}
    else:
        missing |= {(ENGINE, n): "numba is not installed" for n in threads}
    for rival, make in rivals:
        try:
            other = make(scenario)
            ways |= {(rival, n): partial(other.rate, runs, n) for n in threads}
        except RunError as error:
            missing |= {(rival, n): str(error) for n in threads}
    ways[PYTHON, 1] = partial(_python_rate, scenario, learner, min(runs, PYTHON_RUNS))
    rates: dict[tuple[str, int], list[float]] = {way: [] for way in ways}
    for _ in range(repeats):
        for way, rate in ways.items():
            rates[way].append(rate())
    order = [(kind, n) for kind in (ENGINE, *(rival for rival, _ in rivals)) for n in threads]
    figures = tuple(
        Figure(*way, tuple(rates.get(way, ())), missing.get(way, ""))
        for way in [*order, (PYTHON, 1)]
    )
    return BatchFigures(name, learner, steps, runs, cores, ready_seconds, peak_memory, figures)


def _ready_seconds(scenario: Scenario, learner: str) -> float:
    """Return how long the first run takes: little else than making the loops ready."""
    short = scenario.with_settings({"steps": 1})
    started = time.perf_counter()
    list(run_batch(short, learner, [0], trials=0, engine="numba", jobs=1))
    return time.perf_counter() - started


def _engine_rate(scenario: Scenario, learner: str, runs: int, threads: int) -> float:
    started = time.perf_counter()
    for _ in run_batch(scenario, learner, range(runs), trials=0, engine="numba", jobs=threads):
        pass
    return agent_steps_rate(scenario, runs, started)


def _python_rate(scenario: Scenario, learner: str, runs: int) -> float:
    started = time.perf_counter()
    for seed in range(runs):
        learn(scenario, learner, seed)
    return agent_steps_rate(scenario, runs, started)


def agent_steps_rate(scenario: Scenario, runs: int, started: float) -> float:
    """Return the agent-steps a second of runs since `started`, of `time.perf_counter`."""
    agent_steps = scenario.steps * len(scenario.robots) * runs
    return agent_steps / (time.perf_counter() - started)


def _peak_memory() -> int:
    """Return this process's greatest resident memory, in bytes.

    Linux's own account and not getrusage, whose figure a process inherits from its parent.
    """
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    raise OSError("no VmHWM in /proc/self/status")
