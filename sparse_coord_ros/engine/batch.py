# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many independent learning runs and their trials, on all cores, bit for bit as single runs.

Run i of a batch with seed S is the single run with seed S + i: the same draws, the same tables.
With numba a run is one compiled loop without the interpreter's lock, and runs go on in threads;
without it `core.simulation` and `core.evaluation` run in processes. Where the iterator is closed,
as by Ctrl-C, neither goes on for longer than a block of draws.
"""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.agent import Tables, initial_tables
from sparse_coord_ros.core.algorithm import ACTIONS, PRIMITIVES
from sparse_coord_ros.core.evaluation import Trials, play
from sparse_coord_ros.core.learners import Learner, learner_of
from sparse_coord_ros.core.perception import percept_probabilities
from sparse_coord_ros.core.scenario import Scenario
from sparse_coord_ros.core.schedules import exploration, exploring_starts, step_sizes
from sparse_coord_ros.core.simulation import learn_agents
from sparse_coord_ros.core.sparse import SparseTable
from sparse_coord_ros.core.streams import (
    DRAWS,
    EVALUATION,
    LEARNING,
    MOTION,
    PERCEPT,
    POLICY,
    START,
    bit_generator,
)
from sparse_coord_ros.core.world import EPISODE_GAP, FIRST_STEP
from sparse_coord_ros.engine import kernels
from sparse_coord_ros.engine.compiled import Loops, compiled, has_numba
from sparse_coord_ros.engine.processes import in_processes
from sparse_coord_ros.errors import SettingError

BLOCK = 2048
"""Time steps whose draws are made at once."""

FIRST_ROWS = 2 * BLOCK
"""Rows of a sparse table at first, a power of two."""

ENGINES = ("auto", "numba", "python")


class Run(NamedTuple):
    """One learning run and its trials.

    Attributes:
        seed: the run's seed.
        tables: what each robot learned.
        visited: joint states of Q^C that each robot has updated, shape (robots,).
        trials: greedy trials with these tables, seeded by the run's seed; None where none.
    """

    seed: int
    tables: list[Tables]
    visited: np.ndarray
    trials: Trials | None


def run_batch(
    scenario: Scenario,
    learner: str | Learner,
    seeds: Sequence[int],
    *,
    trials: int,
    engine: str = "auto",
    jobs: int | None = None,
) -> Iterator[Run]:
    """Learn once for each seed, play greedy trials, and yield the runs in the order of the seeds.

    Args:
        scenario: the problem and its protocol.
        learner: a learner, or its name.
        seeds: one run each.
        trials: trials of each run; 0: none.
        engine: "numba", "python", or "auto": numba where it is installed.
        jobs: threads (or processes); all cores that this process may use where None.

    Raises:
        SettingError: numba is asked for and not installed.
        RunError: a process that computed runs was killed.
    """
    jobs = len(os.sched_getaffinity(0)) if jobs is None else jobs
    rule = learner_of(learner)
    if not uses_numba(engine, rule):
        work = [(scenario, rule, seed, trials) for seed in seeds]
        yield from in_processes(_run_plain, work, jobs)
        return
    # The loops compile when first called: here, where Ctrl-C is heard, and not in a thread.
    CompiledTeam(scenario.with_settings({"steps": 1}), learner, compiled()).run(0, min(trials, 1))
    stop = np.zeros(1, dtype=np.bool_)
    team = CompiledTeam(scenario, learner, compiled(), stop)
    with ThreadPoolExecutor(jobs) as pool:
        try:
            futures = [pool.submit(team.run, seed, trials) for seed in seeds]
            for i, future in enumerate(futures):
                yield future.result()
                futures[i] = None  # a run's tables can be large: keep none that was handed out
        finally:
            stop[0] = True
            pool.shutdown(wait=True, cancel_futures=True)


def uses_numba(engine: str, learner: Learner | None = None) -> bool:
    """Whether an engine setting means numba on this machine, and for a learner if one is named.

    Raises:
        SettingError: numba is asked for, and not installed or no help to the learner.
    """
    if engine == "numba" and learner is not None and not learner.compiled:
        raise SettingError(
            f"setting engine: value is 'numba', but learner {learner.label} has no compiled form; "
            "leave the engine out, or choose 'python'"
        )
    if engine == "numba" and not has_numba():
        raise SettingError(
            "setting engine: value is 'numba', which is not installed; pip install numba, or "
            "leave the engine out: plain Python computes the same bits"
        )
    return engine != "python" and has_numba() and (learner is None or learner.compiled)


def _run_plain(scenario: Scenario, learner: Learner, seed: int, trials: int) -> Run:
    agents = learn_agents(scenario, learner, seed)
    tables = [agent.tables for agent in agents]
    visited = np.array([agent.coord_visited for agent in agents])
    played = play(scenario, tables, trials=trials, seed=seed, learner=learner) if trials else None
    return Run(seed, tables, visited, played)


class Stopped(Exception):  # noqa: N818 - no error: nobody waits for the run any more
    """A run was given up between two blocks."""


class CompiledTeam:
    """One scenario and learner as arrays, for many runs.

    Args:
        scenario: the problem and its protocol.
        learner: a learner, or its name.
        loops: the compiled (or plain) loops.
        stop: where its one entry is set, runs raise `Stopped` at the next block.
    """

    def __init__(
        self,
        scenario: Scenario,
        learner: str | Learner,
        loops: Loops,
        stop: np.ndarray | None = None,
    ) -> None:
        self.scenario = scenario
        self.learner = learner_of(learner)
        self._loops = loops
        self._stop = np.zeros(1, dtype=np.bool_) if stop is None else stop
        everyone = np.arange(len(scenario.robots))
        alone = [everyone[k : k + 1] for k in everyone]
        groups = alone if self.learner.alone else [everyone]
        whole = make_problem(scenario, self.learner, everyone)
        self._learning = [whole._replace(members=members) for members in groups]
        self._trying = whole._replace(
            max_steps=scenario.horizon, exploring=np.zeros(1), epsilon=np.zeros(1)
        )

    def run(self, seed: int, trials: int) -> Run:
        """Learn once and play greedy trials with what was learned."""
        learners = self.learn(seed)
        visited = (learners.coord_updates > 0).any(axis=2).sum(axis=1)
        played = self.play(learners, seed, trials) if trials else None
        return Run(seed, self.tables(learners), visited, played)

    def learn(self, seed: int) -> kernels.Learners:
        """Learn for the scenario's budget."""
        learners = self._initial()
        choice = _choice(len(self.scenario.robots))
        for problem in self._learning:
            game = _game(len(self.scenario.robots), FIRST_STEP)
            kept, draws = self._draws(seed, problem, LEARNING)
            while game.clock[kernels.DONE] < problem.budget:
                learners = self._with_room(learners)
                self._loops.learn(problem, learners, game, choice, draws)
                self._check_wanted()
        return learners

    def play(self, learners: kernels.Learners, seed: int, trials: int) -> Trials:
        """Play greedy trials."""
        scenario = self.scenario
        team = len(scenario.robots)
        problem = self._trying._replace(budget=trials)
        results = np.zeros((trials, team, 4))
        asked, stays = np.zeros((2, team, len(scenario.map.cells)), dtype=np.int64)
        game = _game(team, FIRST_STEP + EPISODE_GAP)
        choice = _choice(team)
        kept, draws = self._draws(seed, problem, EVALUATION)
        while game.clock[kernels.DONE] < trials:
            learners = self._with_room(learners)
            self._loops.play(problem, learners, game, choice, draws, results, asked, stays)
            self._check_wanted()
        times = results[:, :, kernels.TIME]
        return Trials(
            reward=results[:, :, kernels.REWARD],
            time_to_goal=np.minimum(times, float(scenario.horizon)),
            asks=results[:, :, kernels.ASKS],
            arrived=times <= scenario.horizon,
            miscoordinations=results[:, 0, kernels.CONFLICTS],
            asked=asked,
            stays=stays,
        )

    def tables(self, learners: kernels.Learners) -> list[Tables]:
        """Return what each robot learned, in the shapes of `core.agent`."""
        cells = len(self.scenario.map.cells)
        if not self.learner.asks:
            initial = initial_tables(self.scenario, asks=False).q_coord
            return [Tables(q_star, initial) for q_star in learners.q_star]
        if self.scenario.sparse:
            return [
                Tables(q_star, self._sparse_table(learners, k))
                for k, q_star in enumerate(learners.q_star)
            ]
        shape = (cells, cells, PRIMITIVES)
        return [
            Tables(q_star, q_coord.reshape(shape))
            for q_star, q_coord in zip(learners.q_star, learners.q_coord, strict=True)
        ]

    def _sparse_table(self, learners: kernels.Learners, k: int) -> SparseTable:
        """Return robot k's Q^C; rows that trials only looked at are left out."""
        cells, agents = len(self.scenario.map.cells), self.scenario.perceived
        learned = (learners.coord_updates[k] > 0).any(axis=1)
        states = np.unravel_index(learners.keys[k, learned], (cells,) * agents)
        keys = np.stack(states, axis=1).astype(np.int32)
        rows = learners.q_coord[k, learned]
        return SparseTable(cells, agents, self.scenario.q_coord_init, keys, rows)

    def _initial(self) -> kernels.Learners:
        scenario = self.scenario
        team, cells = len(scenario.robots), len(scenario.map.cells)
        star = initial_tables(scenario, asks=self.learner.asks).q_star
        q_star = np.repeat(star[None], team, axis=0)
        if not self.learner.asks:
            rows = 0
        elif scenario.sparse:
            rows = FIRST_ROWS
        else:
            rows = cells * cells
        learners = kernels.Learners(
            q_star=q_star,
            q_coord=np.empty(0),
            star_updates=np.zeros(q_star.shape, dtype=np.int32),
            coord_updates=np.empty(0),
            keys=np.empty(0),
            used=np.zeros(team, dtype=np.int64),
        )
        return self._with_rows(learners, rows)

    def _with_rows(self, learners: kernels.Learners, rows: int) -> kernels.Learners:
        """Return learners whose Q^C has so many rows, all of them new."""
        team = len(learners.used)
        sparse_rows = rows if self.scenario.sparse else 0
        return learners._replace(
            q_coord=np.full((team, rows, PRIMITIVES), self.scenario.q_coord_init),
            coord_updates=np.zeros((team, rows, PRIMITIVES), dtype=np.int32),
            keys=np.full((team, sparse_rows), kernels.FREE_PLACE, dtype=np.int64),
            used=np.zeros(team, dtype=np.int64),
        )

    def _with_room(self, learners: kernels.Learners) -> kernels.Learners:
        """Return learners whose sparse tables stay half empty whatever a block brings."""
        if kernels.has_room(learners, BLOCK):
            return learners
        needed = 2 * (int(learners.used.max()) + BLOCK)
        larger = self._with_rows(learners, 1 << (needed - 1).bit_length())
        self._loops.rehash(learners, larger)
        return larger

    def _check_wanted(self) -> None:
        if self._stop[0]:
            raise Stopped

    def _draws(
        self, seed: int, problem: kernels.CompiledScenario, phase: int
    ) -> tuple[list[np.random.PCG64], kernels.Draws]:
        """Return NumPy's own generators, one an agent and role, and the space of their draws.

        The draws hold addresses of the generators' states: keep the generators while they are
        used. Roles whose draws nothing looks at have none.
        """
        team = len(problem.starts)
        looked_at = {
            POLICY: True,
            MOTION: True,
            PERCEPT: problem.actions > PRIMITIVES,
            START: bool(problem.exploring.any()),
        }
        values = np.zeros(team * BLOCK * sum(DRAWS.values()))
        spaces, generators, parts = [], [], []
        first = 0
        for role, width in DRAWS.items():
            end = first + team * BLOCK * width
            spaces.append(values[first:end].reshape(team, BLOCK, width))
            for k in problem.members if looked_at[role] else ():
                generators.append(bit_generator(seed, int(k), role, phase))
                part = first + k * BLOCK * width
                parts.append((part, part + BLOCK * width))
            first = end
        states = [generator.ctypes.state_address for generator in generators]
        policy, motion, percept, start = spaces
        return generators, kernels.Draws(
            policy,
            motion[:, :, 0],
            percept[:, :, 0],
            start,
            values,
            np.array(states, dtype=np.uint64),
            np.array(parts),
            self._stop,
        )


def _game(team: int, step: int) -> kernels.Game:
    clock = np.zeros(6, dtype=np.int64)
    clock[kernels.STEP] = step
    return kernels.Game(clock, np.zeros(team, dtype=np.int64), np.zeros(team, dtype=np.int8))


def _choice(team: int) -> kernels.Choices:
    return kernels.Choices(*np.zeros((4, team), dtype=np.int64))


def make_problem(
    scenario: Scenario, learner: Learner, members: np.ndarray
) -> kernels.CompiledScenario:
    """Return a scenario as arrays.

    Args:
        scenario: the problem and its protocol.
        learner: the learner.
        members: numbers of the robots that move.
    """
    grid, robots = scenario.map, scenario.robots
    cells = len(grid.cells)
    doorway = np.zeros(cells, dtype=np.bool_)
    doorway[sorted(grid.doorways)] = True
    free = [np.flatnonzero(grid.distances_to(robot.goal) > 0) for robot in robots]
    start_cells = np.zeros((len(robots), max(map(len, free))), dtype=np.int64)
    for k, choices in enumerate(free):
        start_cells[k, : len(choices)] = choices
    alpha = step_sizes(scenario.step_size, scenario.steps)
    discounts = [1.0]
    for _ in range(scenario.horizon):
        discounts.append(discounts[-1] * scenario.discount)
    return kernels.CompiledScenario(
        members=members,
        starts=np.array([robot.start for robot in robots]),
        goals=np.array([robot.goal for robot in robots]),
        next_cell=np.ascontiguousarray(grid.next_cell, dtype=np.int64),
        doorway=doorway,
        percept=percept_probabilities(scenario.perception, grid),
        all_peers=scenario.peers == "all",
        any_doorway=scenario.conflict == "any_doorway",
        penalties=np.array(scenario.penalties),
        start_cells=start_cells,
        start_counts=np.array([len(choices) for choices in free]),
        exploring=exploring_starts(scenario.starts, scenario.steps),
        epsilon=exploration(scenario.epsilon, scenario.steps),
        alpha_by_count=alpha.by_count,
        alpha_by_step=alpha.by_step,
        discounts=np.array(discounts),
        actions=len(ACTIONS) if learner.asks else PRIMITIVES,
        weights=np.array(learner.weights(scenario)),
        budget=scenario.steps,
        max_steps=scenario.max_steps,
        move_success=scenario.move_success,
        goal_reward=scenario.goal_reward,
        ask_cost=scenario.ask_cost,
        discount=scenario.discount,
        goal_value=scenario.goal_value,
    )
