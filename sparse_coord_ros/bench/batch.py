# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The batch engine's speed, beside a plain C loop of the same work and plain Python.

An agent-step is one robot's part of one time step: a run makes budget x robots of them. Needs no
ROS; without numba, or without a C compiler, those figures are missing and a text says why.
"""

import ctypes
import os
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sparse_coord_ros.core.agent import Tables
from sparse_coord_ros.core.algorithm import ACTIONS, PRIMITIVES
from sparse_coord_ros.core.learners import learner_of
from sparse_coord_ros.core.scenario import Scenario, load_scenario
from sparse_coord_ros.core.simulation import learn
from sparse_coord_ros.core.streams import DRAWS, LEARNING, bit_generator
from sparse_coord_ros.engine.batch import make_problem, run_batch
from sparse_coord_ros.engine.compiled import has_numba
from sparse_coord_ros.engine.processes import in_processes
from sparse_coord_ros.errors import RunError

LEARNER = "coop"
PYTHON_RUNS = 3
"""Learning runs of the plain Python measurement at most: it is hundreds of times slower."""

SOURCE = Path(__file__).parent / "loop.c"
COMPILER = "cc"
# No contraction: a fused multiply-add would round differently from NumPy and numba.
FLAGS = ("-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC")

ENGINE, C_LOOP, PYTHON = "engine (numba)", "plain C loop", "plain Python"


@dataclass(frozen=True)
class Figure:
    """What one way of learning reached.

    Attributes:
        name: ENGINE, C_LOOP or PYTHON.
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
        steps: transitions of a learning run.
        runs: learning runs of a measurement (of plain Python: at most `PYTHON_RUNS`).
        cores: cores that this process may use.
        compile_seconds: what numba takes to compile, once a process; None without numba.
        peak_memory: greatest resident memory of the process that measured the engine, in bytes,
            interpreter and compiler included; None without numba.
        figures: engine and C loop on all cores and on one, plain Python on one.
    """

    scenario: str
    steps: int
    runs: int
    cores: int
    compile_seconds: float | None
    peak_memory: int | None
    figures: tuple[Figure, ...]

    @property
    def engine_to_c(self) -> float | None:
        """Speed of the engine as a share of the C loop's, on all cores; None where one misses."""
        found = {f.name: f.median for f in self.figures if f.threads == self.cores}
        engine, c_loop = found.get(ENGINE), found.get(C_LOOP)
        return engine / c_loop if engine and c_loop else None


def measure(name: str, *, steps: int, runs: int, repeats: int) -> BatchFigures:
    """Measure learning runs of Coop. in a process of its own.

    Args:
        name: a scenario's name.
        steps: transitions of a run.
        runs: runs of a measurement.
        repeats: how often each figure is measured, all figures in turn.
    """
    [figures] = in_processes(_measure, [(name, steps, runs, repeats)], 1)
    return figures


def _measure(name: str, steps: int, runs: int, repeats: int) -> BatchFigures:
    scenario = load_scenario(name).with_settings({"steps": steps})
    cores = len(os.sched_getaffinity(0))
    threads = sorted({cores, 1}, reverse=True)
    ways: dict[tuple[str, int], Callable[[], float]] = {}
    missing: dict[tuple[str, int], str] = {}
    compile_seconds = peak_memory = None
    if has_numba():
        compile_seconds = _compile_seconds(scenario)
        _engine_rate(scenario, runs, cores)
        peak_memory = _peak_memory()  # before anything else takes more
        ways |= {(ENGINE, n): lambda n=n: _engine_rate(scenario, runs, n) for n in threads}
    else:
        missing |= {(ENGINE, n): "numba is not installed" for n in threads}
    try:
        loop = CLoop(scenario)
        ways |= {(C_LOOP, n): lambda n=n: _c_rate(loop, runs, n) for n in threads}
    except RunError as error:
        missing |= {(C_LOOP, n): str(error) for n in threads}
    ways[PYTHON, 1] = lambda: _python_rate(scenario, min(runs, PYTHON_RUNS))
    rates: dict[tuple[str, int], list[float]] = {way: [] for way in ways}
    for _ in range(repeats):
        for way, rate in ways.items():
            rates[way].append(rate())
    order = [(kind, n) for kind in (ENGINE, C_LOOP) for n in threads] + [(PYTHON, 1)]
    figures = tuple(Figure(*way, tuple(rates.get(way, ())), missing.get(way, "")) for way in order)
    return BatchFigures(name, steps, runs, cores, compile_seconds, peak_memory, figures)


def _compile_seconds(scenario: Scenario) -> float:
    """Return how long the first run takes: little else than compiling."""
    short = scenario.with_settings({"steps": 1})
    started = time.perf_counter()
    list(run_batch(short, LEARNER, [0], trials=0, engine="numba", jobs=1))
    return time.perf_counter() - started


def _engine_rate(scenario: Scenario, runs: int, threads: int) -> float:
    started = time.perf_counter()
    for _ in run_batch(scenario, LEARNER, range(runs), trials=0, engine="numba", jobs=threads):
        pass
    return _rate(scenario, runs, started)


def _c_rate(loop: "CLoop", runs: int, threads: int) -> float:
    """Return the rate of the C loop; its generators are seeded as the engine seeds its own."""
    started = time.perf_counter()
    with ThreadPoolExecutor(threads) as pool:
        for _ in pool.map(lambda seed: loop.learn(loop.sources(seed)), range(runs)):
            pass
    return _rate(loop.scenario, runs, started)


def _python_rate(scenario: Scenario, runs: int) -> float:
    started = time.perf_counter()
    for seed in range(runs):
        learn(scenario, LEARNER, seed)
    return _rate(scenario, runs, started)


def _rate(scenario: Scenario, runs: int, started: float) -> float:
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


_SIZES = ("team", "cells", "most_start_cells")
_INTEGERS = ("budget", "max_steps", "any_doorway")
_ARRAYS = (
    ("starts", np.int32),
    ("goals", np.int32),
    ("next_cell", np.int32),
    ("doorway", np.uint8),
    ("percept", np.float64),
    ("penalties", np.float64),
    ("start_cells", np.int32),
    ("start_counts", np.int32),
    ("exploring", np.float64),
    ("epsilon", np.float64),
    ("alpha_by_count", np.float64),
    ("alpha_by_step", np.float64),
)
_NUMBERS = ("move_success", "goal_reward", "ask_cost", "discount", "goal_value")
_INITIAL = ("q_star_init", "q_coord_init")


class _Problem(ctypes.Structure):
    """`struct problem` of loop.c."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in _SIZES + _INTEGERS),
        *((name, ctypes.c_void_p) for name, _ in _ARRAYS),
        *((name, ctypes.c_double) for name in _NUMBERS + _INITIAL),
    ]


class CLoop:
    """loop.c, compiled for this machine: learns Coop. on one scenario, the same bits as `learn`.

    Args:
        scenario: the problem: two robots or more, of which COORDINATE perceives one.

    Raises:
        RunError: there is no C compiler, or it fails.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._learn_run = _compiled_loop()
        problem = make_problem(scenario, learner_of(LEARNER), np.arange(len(scenario.robots)))
        sizes = (len(problem.starts), len(problem.doorway), problem.start_cells.shape[1])
        initial = {name: getattr(scenario, name) for name in _INITIAL}
        # Kept: the structure only points to them.
        self._arrays = {
            name: np.ascontiguousarray(getattr(problem, name), dtype=dtype)
            for name, dtype in _ARRAYS
        }
        self._problem = _Problem(
            **dict(zip(_SIZES, sizes, strict=True)),
            **initial,
            **{name: getattr(problem, name) for name in _INTEGERS + _NUMBERS},
            **{name: array.ctypes.data for name, array in self._arrays.items()},
        )

    def sources(self, seed: int) -> np.ndarray:
        """Return the random generators of a run.

        Shape (robots, roles, 4), uint64: high and low word of PCG64's state and increment.
        """
        words = []
        for k in range(len(self.scenario.robots)):
            for role in sorted(DRAWS):
                state = bit_generator(seed, k, role, LEARNING).state["state"]
                words += [divmod(state[part], 2**64) for part in ("state", "inc")]
        return np.array(words, dtype=np.uint64).reshape(-1, len(DRAWS), 4)

    def learn(self, sources: np.ndarray) -> list[Tables]:
        """Learn once and return the tables of every robot.

        Args:
            sources: what `sources` returned.

        Raises:
            MemoryError: the C code got no memory.
        """
        team, cells = len(self.scenario.robots), len(self.scenario.map.cells)
        q_star = np.empty((team, cells, len(ACTIONS)))
        q_coord = np.empty((team, cells, cells, PRIMITIVES))
        failed = self._learn_run(
            ctypes.byref(self._problem),
            sources.ctypes.data,
            q_star.ctypes.data,
            q_coord.ctypes.data,
        )
        if failed:
            raise MemoryError("not enough memory for the counters of loop.c")
        return [Tables(*tables) for tables in zip(q_star, q_coord, strict=True)]


def _compiled_loop() -> Callable[..., int]:
    compiler = shutil.which(COMPILER)
    if compiler is None:
        raise RunError(f"there is no C compiler ({COMPILER}); install one, e.g. gcc")
    with tempfile.TemporaryDirectory(prefix="sparse_coord_bench_") as folder:
        library = Path(folder) / "loop.so"
        done = subprocess.run(
            [compiler, *FLAGS, "-o", str(library), str(SOURCE)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            first = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[0]
            raise RunError(f"{compiler} cannot compile {SOURCE}: {first}")
        learn_run = ctypes.CDLL(str(library)).learn_run
    learn_run.argtypes = [ctypes.POINTER(_Problem), *[ctypes.c_void_p] * 3]
    learn_run.restype = ctypes.c_int
    return learn_run
