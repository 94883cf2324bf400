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
from sparse_coord_ros.game.streams import LEARNING, MOTION, PERCEPT, POLICY, START, bit_generator
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.learners import learner_of

SOURCE = Path(__file__).parent / "loop.c"
ROLES = (POLICY, MOTION, START, PERCEPT)
"""The streams that the loop draws from, in its order."""

COMPILER = "cc"
# No contraction: a fused multiply-add would round differently from NumPy and numba.
FLAGS = ("-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC")

ARRAYS = {
    **dict.fromkeys(("starts", "goals", "next_cell", "places"), np.int32),
    **dict.fromkeys(("percept", "penalties"), np.float64),
    **dict.fromkeys(("start_cells", "start_counts"), np.int32),
    **dict.fromkeys(("exploring", "epsilon", "alpha_by_count", "alpha_by_step"), np.float64),
}
NUMBERS = ("move_success", "goal_reward", "ask_cost", "discount", "goal_value")
COUNTS = ("budget", "max_steps")
SIZES = ("team", "cells", "most_start_cells", "fails")


class _Problem(ctypes.Structure):
    """`struct problem` of loop.c."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ARRAYS),
        *((name, ctypes.c_double) for name in NUMBERS),
        *((name, ctypes.c_int32) for name in COUNTS + SIZES),
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
        known = make_problem(scenario, learner_of("coop"), np.arange(len(scenario.robots)))
        self._arrays = {  # the structure only points to them
            name: np.ascontiguousarray(getattr(known, name), dtype)
            for name, dtype in ARRAYS.items()
        }
        team, most_start_cells = known.start_cells.shape
        sizes = team, len(known.places), most_start_cells, (known.percept < 1.0).any()
        self._problem = _Problem(
            *(array.ctypes.data for array in self._arrays.values()),
            *(getattr(known, name) for name in NUMBERS + COUNTS),
            *map(int, sizes),
        )

    def sources(self, seed: int) -> np.ndarray:
        """Return the random generators of a run.

        Shape (robots, roles, 4), uint64: low and high word of PCG64's state and increment.
        """
        words = []
        for k in range(len(self.scenario.robots)):
            for role in ROLES:
                state = bit_generator(seed, k, role, LEARNING).state["state"]
                words += [divmod(state[part], 2**64)[::-1] for part in ("state", "inc")]
        return np.array(words, dtype=np.uint64).reshape(-1, len(ROLES), 4)

    def learn_runs(self, runs: int, threads: int) -> None:
        """Learn runs of the seeds from 0; they are seeded here, as the engine seeds its own."""
        with ThreadPoolExecutor(threads) as pool:
            for _ in pool.map(lambda seed: self.learn(self.sources(seed)), range(runs)):
                pass

    def learn(self, sources: np.ndarray) -> list[Tables]:
        """Learn once from what `sources` returned, and return the tables of every robot."""
        team, cells = len(self.scenario.robots), len(self.scenario.map.cells)
        q_star = np.full((team, cells, len(ACTIONS)), self.scenario.q_star_init)
        q_coord = np.full((team, cells, cells, PRIMITIVES), self.scenario.q_coord_init)
        counts = (np.zeros(table.shape, dtype=np.int32) for table in (q_star, q_coord))
        arrays = (sources, q_star, q_coord, *counts)
        self._learn_run(ctypes.byref(self._problem), *(array.ctypes.data for array in arrays))
        return [Tables(*tables) for tables in zip(q_star, q_coord, strict=True)]


def _compiled_loop() -> Callable[..., None]:
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
    loop.argtypes = [ctypes.POINTER(_Problem), *[ctypes.c_void_p] * 5]
    loop.restype = None
    return loop
