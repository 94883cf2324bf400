# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The plain C loops: compile loop.c and factored.c and learn with them."""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.engine.batch import make_problem
from sparse_coord_ros.errors import RunError
from sparse_coord_ros.game.actions import ACTIONS, PRIMITIVES
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.streams import (
    BLIND,
    LEARNING,
    MOTION,
    PERCEPT,
    POLICY,
    REPLAY,
    START,
    bit_generator,
)
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.factors import FactorRule, coordination_table, sorted_factors
from sparse_coord_ros.learn.learners import Learner, learner_of

SOURCE = Path(__file__).parent / "loop.c"
FACTORED_SOURCE = Path(__file__).parent / "factored.c"
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


def _problem(scenario: Scenario, learner: Learner) -> tuple[dict[str, np.ndarray], _Problem]:
    """Return a scenario as the C code has it, and the arrays that it only points to: keep them."""
    problem = make_problem(scenario, learner, np.arange(len(scenario.robots)))
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

    roles: tuple[int, ...] = (POLICY, MOTION, PERCEPT, START)
    """The streams that it draws from, in its order."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        kinds = [ctypes.POINTER(_Problem), *[ctypes.c_void_p] * 3]
        self._learn_run = _compiled_loop(SOURCE, "learn_run", kinds)
        self._arrays, self._problem = _problem(scenario, learner_of("coop"))

    def sources(self, seed: int) -> np.ndarray:
        """Return the random generators of a run.

        Shape (robots, roles, 4), uint64: high and low word of PCG64's state and increment.
        """
        words = []
        for k in range(len(self.scenario.robots)):
            for role in self.roles:
                state = bit_generator(seed, k, role, LEARNING).state["state"]
                words += [divmod(state[part], 2**64) for part in ("state", "inc")]
        return np.array(words, dtype=np.uint64).reshape(-1, len(self.roles), 4)

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


class _Rule(ctypes.Structure):
    """`struct rule` of factored.c."""

    _fields_ = [
        ("common_weight", ctypes.c_double),
        *((name, ctypes.c_int32) for name in (*FactorRule._fields, "referee")),
    ]


class FactoredCLoop(CLoop):
    """factored.c, compiled for this machine: learns in factors, the same bits as `learn`.

    Args:
        scenario: the problem, with the learner's defaults: two robots or more.
        learner: one that learns in factors.

    Raises:
        RunError: there is no C compiler, or it fails.
    """

    roles = (POLICY, MOTION, PERCEPT, START, REPLAY, BLIND)

    def __init__(self, scenario: Scenario, learner: Learner) -> None:
        assert learner.factors is not None
        self.scenario = scenario
        rule = learner.factors
        kinds = [ctypes.POINTER(_Problem), ctypes.POINTER(_Rule), *[ctypes.c_void_p] * 6]
        self._learn_run = _compiled_loop(FACTORED_SOURCE, "learn_run_factored", kinds)
        self._arrays, self._problem = _problem(scenario, learner)
        self._rule = _Rule(
            learner.weights(scenario).common,
            *rule._replace(right_of_way=rule.right_of_way and len(scenario.robots) > 2),
            scenario.referee,
        )

    def learn(self, sources: np.ndarray) -> list[Tables]:
        """Learn once; as of `CLoop.learn`."""
        team, cells = len(self.scenario.robots), len(self.scenario.map.cells)
        q_star = np.empty((team, cells, len(ACTIONS)))
        u, r_bar = np.zeros((2, team, cells, PRIMITIVES))
        w = np.zeros((team, cells))
        seen = cells * team * cells
        rho = np.zeros((team, seen + cells, PRIMITIVES))
        filled = [array.ctypes.data for array in (q_star, u, r_bar, w, rho)]
        if self._learn_run(
            ctypes.byref(self._problem), ctypes.byref(self._rule), sources.ctypes.data, *filled
        ):
            raise MemoryError("not enough memory for the counters of factored.c")
        keys = np.arange(seen + cells)  # as of `learn.factors`: failed percepts last
        tables = []
        for k in range(team):
            factors = sorted_factors(u[k], r_bar[k], w[k], keys, rho[k], team)
            tables.append(Tables(q_star[k], coordination_table(factors, k, team), factors))
        return tables


def c_loop_of(learner: str, scenario: Scenario) -> CLoop:
    """Return the C loop of a learner, as of `CLoop`."""
    rule = learner_of(learner)
    return CLoop(scenario) if rule.factors is None else FactoredCLoop(scenario, rule)


def _compiled_loop(source: Path, function: str, kinds: Sequence[Any]) -> Callable[..., int]:
    """Compile a file and return one of its functions, which takes such arguments."""
    compiler = shutil.which(COMPILER)
    if compiler is None:
        raise RunError(f"there is no C compiler ({COMPILER}); install one, e.g. gcc")
    with tempfile.TemporaryDirectory(prefix="sparse_coord_bench_") as folder:
        library = Path(folder) / "loop.so"
        done = subprocess.run(
            [compiler, *FLAGS, "-o", str(library), str(source)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            first = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[0]
            raise RunError(f"{compiler} cannot compile {source}: {first}")
        loop: Callable[..., int] = getattr(ctypes.CDLL(str(library)), function)
    loop.argtypes = list(kinds)  # type: ignore[attr-defined]
    loop.restype = ctypes.c_int  # type: ignore[attr-defined]
    return loop
