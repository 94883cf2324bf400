# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The plain C loop of the paper's learner: compile loop.c and learn with it."""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from sparse_coord_ros.engine.batch import make_problem
from sparse_coord_ros.errors import RunError
from sparse_coord_ros.game.actions import ACTIONS, PRIMITIVES
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.streams import (
    LEARNING,
    MOTION,
    PERCEPT,
    POLICY,
    START,
    bit_generator,
)
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.learners import learner_of

SOURCE = Path(__file__).parent / "loop.c"
ROLES = (POLICY, MOTION, PERCEPT, START)
"""The streams that the loop draws from, in its order."""

COMPILER = "cc"
# No contraction: a fused multiply-add would round differently from NumPy and numba.
FLAGS = ("-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC")

_SIZES = ("team", "cells", "most_start_cells")
_INTEGERS = ("budget", "max_steps", "fails")
_ARRAYS = (
    ("starts", np.int32),
    ("goals", np.int32),
    ("next_cell", np.int32),
    ("places", np.int32),
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


def _problem(scenario: Scenario) -> tuple[dict[str, np.ndarray], _Problem]:
    """Return a scenario as the C code has it, and the arrays that it only points to: keep them."""
    problem = make_problem(scenario, learner_of("coop"), np.arange(len(scenario.robots)))
    sizes = (len(problem.starts), len(problem.places), problem.start_cells.shape[1])
    arrays = {
        name: np.ascontiguousarray(getattr(problem, name), dtype=dtype) for name, dtype in _ARRAYS
    }
    fails = bool((problem.percept < 1.0).any())
    integers = {name: getattr(problem, name) for name in _INTEGERS if name != "fails"}
    return arrays, _Problem(
        **dict(zip(_SIZES, sizes, strict=True)),
        **{name: getattr(scenario, name) for name in _INITIAL},
        **integers,
        fails=fails,
        **{name: getattr(problem, name) for name in _NUMBERS},
        **{name: array.ctypes.data for name, array in arrays.items()},
    )


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
        self._arrays, self._problem = _problem(scenario)

    def sources(self, seed: int) -> np.ndarray:
        """Return the random generators of a run.

        Shape (robots, roles, 4), uint64: high and low word of PCG64's state and increment.
        """
        words = []
        for k in range(len(self.scenario.robots)):
            for role in ROLES:
                state = bit_generator(seed, k, role, LEARNING).state["state"]
                words += [divmod(state[part], 2**64) for part in ("state", "inc")]
        return np.array(words, dtype=np.uint64).reshape(-1, len(ROLES), 4)

    def learn_runs(self, runs: int, threads: int) -> None:
        """Learn runs of the seeds from 0; they are seeded here, as the engine seeds its own."""
        with ThreadPoolExecutor(threads) as pool:
            for _ in pool.map(lambda seed: self.learn(self.sources(seed)), range(runs)):
                pass

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
    """Compile loop.c and return its function."""
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
        loop = ctypes.CDLL(str(library)).learn_run
    loop.argtypes = [ctypes.POINTER(_Problem), *[ctypes.c_void_p] * 3]
    loop.restype = ctypes.c_int
    found: Callable[..., int] = loop
    return found
