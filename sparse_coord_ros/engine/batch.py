# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many independent learning runs and their trials, on all cores, bit for bit as single runs.

Run i of a batch with seed S is the single run with seed S + i: the same draws, the same tables.
With numba a run is one compiled loop without the interpreter's lock, and runs go on in threads;
without it `learn.simulation` and `learn.evaluation` run in processes. Where the iterator is
closed, as by Ctrl-C, neither goes on for longer than a block of time steps.
"""

import functools
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.compiling import compile_once, has_numba, is_compiled
from sparse_coord_ros.engine import kernels
from sparse_coord_ros.engine.cluster import Cluster
from sparse_coord_ros.engine.compiled import Loops, compiled
from sparse_coord_ros.engine.generator import jump_table, source_of
from sparse_coord_ros.engine.processes import in_processes
from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.game.links import UP, link_of
from sparse_coord_ros.game.miscoordination import meeting_places, miscoordinated
from sparse_coord_ros.game.perception import drawn_peer, percept_probabilities
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.schedules import exploration, exploring_starts, step_sizes
from sparse_coord_ros.game.streams import (
    BLIND,
    DRAWS,
    EVALUATION,
    LEARNING,
    MOTION,
    PEER,
    PERCEPT,
    POLICY,
    REPLAY,
    START,
    Stream,
)
from sparse_coord_ros.game.world import EPISODE_GAP, FIRST_STEP, UNKNOWN_PARTNERS, Action, Position
from sparse_coord_ros.kept import is_kept
from sparse_coord_ros.learn.agent import NOBODY, Memory, Tables, initial_tables
from sparse_coord_ros.learn.evaluation import Trials, play
from sparse_coord_ros.learn.factors import (
    FactorMemory,
    FactorRule,
    coordination_table,
    keys_below,
    keys_of,
    rows_at_most,
    sorted_factors,
    states_of,
)
from sparse_coord_ros.learn.history import History, concatenated
from sparse_coord_ros.learn.learners import Learner, learner_of
from sparse_coord_ros.learn.simulation import Glimpse, Learning, LearningState, groups_of
from sparse_coord_ros.learn.sparse import SparseTable
from sparse_coord_ros.solve.exact import ExactMeans, exact_means

BLOCK = 2048
"""Time steps between two looks at whether anybody waits for the run and its tables have room."""

FIRST_ROWS = 2 * BLOCK
"""Rows of a sparse table at first, a power of two."""

DENSE_ROWS = 2**19
"""Rows of a robot's rho, 16 MiB, above which only those that it learned are kept."""

MOST_ROWS = 2**62
"""Rows of a sparse table over the joint state: as many as memory holds."""

JUMPS = jump_table()
"""As of `kernels.Draws`."""

ENGINES = ("auto", "numba", "python")


class Run(NamedTuple):
    """One learning run and its trials.

    Attributes:
        seed: the run's seed.
        tables: what each robot learned.
        visited: joint states of Q^C that each robot has updated, shape (robots,).
        trials: greedy trials with these tables, seeded by the run's seed; None where none.
        history: the learning history; None where it was not asked for.
        exact: what such a trial brings on average; None without trials, and where nobody knows.
    """

    seed: int
    tables: list[Tables]
    visited: np.ndarray
    trials: Trials | None
    history: History | None = None
    exact: ExactMeans | None = None


def run_batch(
    scenario: Scenario,
    learner: str | Learner,
    seeds: Sequence[int],
    *,
    trials: int,
    engine: str = "auto",
    jobs: int | None = None,
    history: bool = False,
    cluster: Cluster | None = None,
) -> Iterator[Run]:
    """Learn once for each seed, play greedy trials, and yield the runs in the order of the seeds.

    Args:
        scenario: the problem and its protocol.
        learner: a learner, or its name.
        seeds: one run each.
        trials: trials of each run; 0: none.
        engine: "numba", "python", or "auto": numba where it is installed.
        jobs: threads (or processes); all cores that this process may use where None.
        history: whether each run comes with its learning history.
        cluster: whose workers compute; None: this machine.

    Raises:
        SettingError: numba is asked for and not installed.
        RunError: a process that computed runs was killed, or the cluster is lost.
    """
    rule = learner_of(learner)
    if cluster is not None:
        shares = cluster.shares(seeds, agent_steps(scenario), len(seeds))
        asked = [(scenario, rule, share, trials, engine, history) for share in shares]
        for runs in cluster.in_order(_runs_of, asked):
            yield from runs
        return
    jobs = len(os.sched_getaffinity(0)) if jobs is None else jobs
    if not uses_numba(engine, rule):
        work = [(scenario, rule, seed, trials, history) for seed in seeds]
        if jobs == 1 or len(work) == 1:  # here: a learner of a script is in no other process
            yield from (_run_plain(*one) for one in work)
        else:
            yield from in_processes(_run_plain, work, jobs)
        return
    prepare(scenario, rule, history=history)
    stop = np.zeros(1, dtype=np.bool_)
    team = CompiledTeam(scenario, learner, compiled(), stop)
    with ThreadPoolExecutor(jobs) as pool:
        try:
            futures = [pool.submit(team.run, seed, trials, gathering=history) for seed in seeds]
            futures.reverse()
            while futures:  # a run's tables can be large: keep none that was handed out
                yield futures.pop().result()
        finally:
            stop[0] = True
            pool.shutdown(wait=True, cancel_futures=True)


def agent_steps(scenario: Scenario) -> int:
    """Return the steps of one learning run, of all robots."""
    return scenario.steps * len(scenario.robots)


def _runs_of(
    scenario: Scenario,
    learner: Learner,
    seeds: Sequence[int],
    trials: int,
    engine: str,
    history: bool,
) -> list[Run]:
    """Compute some runs in a thread of a cluster's worker."""
    return list(
        run_batch(scenario, learner, seeds, trials=trials, engine=engine, jobs=1, history=history)
    )


def uses_numba(engine: str, learner: Learner | None = None) -> bool:
    """Whether an engine setting means numba on this machine, and for a learner if one is named.

    Raises:
        SettingError: there is no such engine; or numba is asked for, and not installed or no help
            to the learner.
    """
    if engine not in ENGINES:
        raise SettingError(f"setting engine: value is {engine!r}, allowed: {', '.join(ENGINES)}")
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


def _run_plain(
    scenario: Scenario, learner: Learner, seed: int, trials: int, gathering: bool
) -> Run:
    learning = Learning(scenario, learner, seed, gathering=gathering)
    learning.advance(scenario.steps)
    tables = learning.tables
    played = play(scenario, tables, trials=trials, seed=seed, learner=learner) if trials else None
    exact = exact_means(scenario, tables, learner) if trials else None
    history = learning.history if gathering else None
    return Run(seed, tables, learning.visited, played, history, exact)


def prepare(
    scenario: Scenario, learner: str | Learner, *, engine: str = "auto", history: bool = False
) -> None:
    """Compile the loops for a learner where that has not been done in this process.

    Does nothing where plain Python is going to compute. What shows progress calls it before its
    clock starts: it takes some seconds, once a process, and Ctrl-C ends it at once.

    Args:
        scenario: the problem.
        learner: a learner, or its name.
        engine: as of `run_batch`.
        history: whether the loop is needed that gathers the learning history.

    Raises:
        SettingError: numba is asked for and not installed.
    """
    if uses_numba(engine, learner_of(learner)):
        key = _loops_key(learner, history)
        compile_once(key, lambda: _warm_up(scenario, learner, history))


def is_prepared(*, learner: str | Learner = "coop", history: bool = False) -> bool:
    """Whether the loops for a learner need no compiling: they are, in this process or on disk."""
    key = _loops_key(learner, history)
    return is_compiled(key) or is_kept(key)


def is_loaded(*, learner: str | Learner = "coop", history: bool = False) -> bool:
    """Whether the loops for a learner are ready in this process."""
    return is_compiled(_loops_key(learner, history))


def _loops_key(learner: str | Learner, history: bool) -> str:
    """Return what tells the compiled loops apart: numba compiles one for each kind of tables."""
    tables = "tables" if learner_of(learner).factors is None else "factors"
    return f"{tables}_with_history" if history else tables


def _warm_up(scenario: Scenario, learner: str | Learner, history: bool) -> None:
    """Call each loop once: that is when numba compiles it."""
    team = CompiledTeam(scenario.with_settings({"steps": 1}), learner, compiled())
    team.run(0, 1, gathering=history)


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
        self.loops = loops
        self._stop = np.zeros(1, dtype=np.bool_) if stop is None else stop
        whole = make_problem(scenario, self.learner, np.arange(len(scenario.robots)))
        groups = [np.array(members) for members in groups_of(scenario, self.learner)]
        self.learning = [whole._replace(members=members) for members in groups]
        self._trying = whole._replace(
            max_steps=scenario.horizon, exploring=np.zeros(1), epsilon=np.zeros(1)
        )

    def run(self, seed: int, trials: int, *, gathering: bool = False) -> Run:
        """Learn once and play greedy trials with what was learned."""
        learning = CompiledLearning(self, seed, gathering=gathering)
        learning.advance(self.scenario.steps)
        visited, tables = learning.visited, self.tables(learning.learners)
        played = self.play(learning.learners, seed, trials) if trials else None
        exact = exact_means(self.scenario, tables, self.learner) if trials else None
        history = learning.history if gathering else None
        return Run(seed, tables, visited, played, history, exact)

    def learn(self, seed: int) -> kernels.Learners:
        """Learn for the scenario's budget."""
        learning = CompiledLearning(self, seed, gathering=False)
        learning.advance(self.scenario.steps)
        return learning.learners

    def play(self, learners: kernels.Learners, seed: int, trials: int) -> Trials:
        """Play greedy trials."""
        scenario = self.scenario
        team = len(scenario.robots)
        problem = self._trying._replace(budget=trials)
        results = np.zeros((trials, team, 4))
        asked, stays = np.zeros((2, team, len(scenario.map.cells)), dtype=np.int64)
        game = _game(team, FIRST_STEP + EPISODE_GAP)
        choice = _choice(team)
        draws = self.draws(seed, problem, EVALUATION)
        while game.clock[kernels.DONE] < trials:
            learners = self.with_room(learners)
            self.loops.play(problem, learners, game, choice, draws, results, asked, stays)
            self.check_wanted()
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
        """Return what each robot learned, in the shapes of `learn.agent`."""
        cells = len(self.scenario.map.cells)
        if learners.factored is not None:
            return [self._factored_tables(learners, k) for k in range(len(learners.used))]
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

    def _factored_tables(self, learners: kernels.Learners, k: int) -> Tables:
        """Return robot k's tables, with their factors."""
        own = learners.factored
        assert own is not None
        robots = len(learners.used)
        rows, keys = self._learned_rows(learners, k)
        rho = learners.q_coord[k, rows]
        factors = sorted_factors(own.u[k], own.r_bar[k], own.w[k], keys, rho, robots)
        return Tables(learners.q_star[k], coordination_table(factors, k, robots), factors)

    @property
    def _hashed(self) -> bool:
        """Whether the second tables are sparse."""
        if self.learner.factors is not None:
            return self._rows_of_rho > DENSE_ROWS
        return self.scenario.sparse

    @property
    def _rows_of_rho(self) -> int:
        return keys_below(len(self.scenario.map.cells), len(self.scenario.robots))

    def _learned_rows(self, learners: kernels.Learners, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of robot k's second table that it has updated, and their keys."""
        rows = np.flatnonzero(_updated(learners.coord_updates[k]))
        return rows, learners.keys[k, rows] if self._hashed else rows

    def _sparse_table(self, learners: kernels.Learners, k: int) -> SparseTable:
        """Return robot k's Q^C; rows that trials only looked at are left out."""
        cells, agents = len(self.scenario.map.cells), self.scenario.perceived
        rows, numbers = self._learned_rows(learners, k)
        states = np.unravel_index(numbers, (cells,) * agents)
        keys = np.stack(states, axis=1).astype(np.int32)
        values = learners.q_coord[k, rows]
        return SparseTable(cells, agents, self.scenario.q_coord_init, keys, values)

    def initial(self) -> kernels.Learners:
        """Return the tables before learning."""
        scenario = self.scenario
        team, cells = len(scenario.robots), len(scenario.map.cells)
        star = self.learner.tables(scenario).q_star
        q_star = np.repeat(star[None], team, axis=0)
        if not self.learner.asks:
            rows = 0
        elif self._hashed:
            rows = FIRST_ROWS if self.learner.factors is None else self._rows_for(0)
        elif self.learner.factors is not None:
            rows = self._rows_of_rho
        else:
            rows = cells * cells
        learners = kernels.Learners(
            q_star=q_star,
            q_coord=np.empty(0),
            star_updates=np.zeros(q_star.shape, dtype=np.int32),
            coord_updates=np.empty(0),
            keys=np.empty(0),
            used=np.zeros(team, dtype=np.int64),
            factored=self._initial_factored(q_star) if self.learner.factors else None,
        )
        return self._with_rows(learners, rows)

    def _initial_factored(self, q_star: np.ndarray) -> kernels.Factored:
        team, cells, _ = q_star.shape
        whole = np.zeros((3, team, cells, PRIMITIVES), dtype=np.int64)
        return kernels.Factored(
            u=np.full((team, cells, PRIMITIVES), self.scenario.q_coord_init),
            r_bar=np.zeros((team, cells, PRIMITIVES)),
            w=np.zeros((team, cells)),
            value=q_star.max(axis=2),
            commons=whole[0],
            moved=whole[1],
            successor=whole[2],
            tried=np.zeros((team, cells * PRIMITIVES), dtype=np.int64),
            used=np.zeros((team, 1), dtype=np.int64),
            askers=np.zeros(team, dtype=np.int64),
            partners=np.full(team, UNKNOWN_PARTNERS, dtype=np.int64),
            correction=np.zeros(PRIMITIVES),
        )

    def memories(self, learners: kernels.Learners) -> tuple[Memory, ...]:
        """Return what each robot has learned, as an agent of `learn.agent` remembers it."""
        return tuple(self._memory(learners, k) for k in range(len(self.scenario.robots)))

    def _memory(self, learners: kernels.Learners, k: int) -> Memory:
        cells, agents = len(self.scenario.map.cells), self.scenario.perceived
        rows, keys = self._learned_rows(learners, k)
        order = np.argsort(keys)
        own, factors = learners.factored, None
        if own is None:
            found = np.unravel_index(keys[order], (cells,) * agents)
            states = np.stack(found, axis=1).astype(np.int32)
        else:
            states = states_of(keys[order], cells, len(learners.used))
            arrays = (own.u, own.r_bar, own.w, own.commons, own.moved, own.successor)
            learned = [array[k].copy() for array in arrays]
            factors = FactorMemory._make([*learned, own.tried[k, : own.used[k, 0]].copy()])
        return Memory(
            learners.q_star[k].copy(),
            learners.star_updates[k].astype(np.int64),
            states,
            learners.q_coord[k, rows[order]],
            learners.coord_updates[k, rows[order]].astype(np.int64),
            factors,
        )

    def remembered(self, memories: Sequence[Memory]) -> kernels.Learners:
        """Return tables to go on learning in from what each robot remembers."""
        learners = self.initial()
        for k, memory in enumerate(memories):
            learners.q_star[k] = memory.q_star
            learners.star_updates[k] = memory.star_updates
        if not self.learner.asks:
            return learners
        cells = len(self.scenario.map.cells)
        shape = (cells,) * self.scenario.perceived
        keys = []
        for k, memory in enumerate(memories):
            own = learners.factored
            if own is None or memory.factors is None:
                keys.append(np.ravel_multi_index(memory.states.T, shape))
                continue
            keys.append(keys_of(memory.states, cells, len(memories)))
            *arrays, tried = memory.factors
            targets = (own.u, own.r_bar, own.w, own.commons, own.moved, own.successor)
            for space, array in zip(targets, arrays, strict=True):
                space[k] = array
            own.value[k] = memory.q_star.max(axis=1)
            own.tried[k, : len(tried)] = tried
            own.used[k] = len(tried)
        # A table with all that is remembered, in any order; `rehash` finds the places.
        most = max(1, *map(len, keys))
        listed = self._with_rows(learners, most)
        for k, memory in enumerate(memories):
            target = listed if self._hashed else learners
            rows = np.arange(len(keys[k])) if self._hashed else keys[k]
            target.q_coord[k, rows] = memory.values
            target.coord_updates[k, rows] = memory.updates
            if self._hashed:
                listed.keys[k, rows] = keys[k]
                listed.used[k] = len(rows)
        return self._larger(listed) if self._hashed else learners

    def _with_rows(self, learners: kernels.Learners, rows: int) -> kernels.Learners:
        """Return learners whose Q^C has so many rows, all of them new."""
        team = len(learners.used)
        sparse_rows = rows if self._hashed else 0
        q_coord = np.zeros((team, rows, PRIMITIVES))  # no memory until it is written to
        if learners.factored is None:
            q_coord[:] = self.scenario.q_coord_init
        return learners._replace(
            q_coord=q_coord,
            coord_updates=np.zeros((team, rows, PRIMITIVES), dtype=np.int32),
            keys=np.full((team, sparse_rows), kernels.FREE_PLACE, dtype=np.int64),
            used=np.zeros(team, dtype=np.int64),
        )

    def with_room(self, learners: kernels.Learners) -> kernels.Learners:
        """Return learners whose sparse tables stay half empty whatever a block brings."""
        if kernels.has_room(self._trying, learners, BLOCK):
            return learners
        return self._larger(learners)

    def _larger(self, learners: kernels.Learners) -> kernels.Learners:
        larger = self._with_rows(learners, self._rows_for(int(learners.used.max())))
        self.loops.rehash(learners, larger)
        return larger

    def _rows_for(self, used: int) -> int:
        """Return how many rows leave room for a block, a power of two."""
        problem = self._trying
        needed = 2 * min(used + BLOCK * problem.rows_a_step, problem.most_rows)
        return 1 << (needed - 1).bit_length()

    def check_wanted(self) -> None:
        """Raise `Stopped` where nobody waits for the run any more."""
        if self._stop[0]:
            raise Stopped

    def draws(
        self, seed: int, problem: kernels.CompiledScenario, phase: int, first: int = 0
    ) -> kernels.Draws:
        """Return where the draws come from; the first block begins with the time step `first`."""
        team = len(problem.starts)
        links = [link_of(self.scenario.link, seed, k, phase) for k in range(team)]
        fails = bool(team == 1 or (problem.percept < 1.0).any() or self.scenario.link != UP)
        looked_at = {
            POLICY: True,
            MOTION: True,
            PERCEPT: problem.actions > PRIMITIVES and fails,
            START: bool(problem.exploring.any()),
            REPLAY: phase == LEARNING and problem.replays > 0,
            BLIND: phase == LEARNING and self.learner.factors is not None and fails,
        }
        sources = np.zeros((len(DRAWS), team, 4), dtype=np.uint64)
        for role, width in DRAWS.items():
            for k in problem.members.tolist() if looked_at[role] else ():
                sources[role, k] = source_of(seed, k, role, phase, first * width)
        return kernels.Draws(
            sources=sources,
            since=np.full((len(DRAWS), team), first),
            jumps=JUMPS,
            fails=fails,
            block=BLOCK,
            stop=self._stop,
            down=np.array([link.pattern for link in links]),
            dead_from=links[0].dead_from,
        )


class CompiledLearning:
    """A learning run in progress: as `learn.simulation.Learning`, by the loops of a team.

    Args:
        team: scenario, learner and loops.
        seed: the run's seed.
        state: where to go on; None: at the beginning.
        gathering: whether to gather the history.

    Attributes:
        done: transitions made, by each group of robots.
        learners: the tables of all robots.
    """

    def __init__(
        self,
        team: CompiledTeam,
        seed: int,
        state: LearningState | None = None,
        *,
        gathering: bool = True,
    ) -> None:
        robots = len(team.scenario.robots)
        self.done = 0
        self._team, self._seed = team, seed
        self._choice = _choice(robots)
        self._gathering = gathering
        self._games = [_game(robots, FIRST_STEP) for _ in team.learning]
        self._records = [_record(2 * BLOCK, robots) for _ in team.learning if gathering]
        if state is None:
            self.learners = team.initial()
        else:
            self.learners = team.remembered(state.memories)
            self.done = state.positions[0].transitions
            self._games = [_game_at(position) for position in state.positions]
            self._records = [_record_of(history) for history in state.histories if gathering]
        self._draws = [
            team.draws(seed, problem, LEARNING, int(game.clock[kernels.END]))
            for problem, game in zip(team.learning, self._games, strict=True)
        ]

    def advance(self, until: int) -> None:
        """Let every group of robots learn until it has made so many transitions.

        Raises:
            Stopped: nobody waits for the run any more.
        """
        team = self._team
        for number, (problem, game) in enumerate(zip(team.learning, self._games, strict=True)):
            part = problem._replace(budget=until)
            draws = self._draws[number]
            while game.clock[kernels.DONE] < until:
                self.learners = team.with_room(self.learners)
                record = self._record_with_rows(number) if self._gathering else None
                team.loops.learn(part, self.learners, game, self._choice, draws, record)
                team.check_wanted()
        self.done = max(self.done, until)

    def glimpse(self) -> Glimpse:
        """Let every group of robots make one transition, and return it."""
        team = self._team
        positions = [_position(game) for game in self._games]
        robots = len(team.scenario.robots)
        cells, after = [0] * robots, [0] * robots
        actions: list[Action | None] = [None] * robots
        self.advance(self.done + 1)
        chosen = self._choice
        for problem, game, before in zip(team.learning, self._games, positions, strict=True):
            for k in problem.members.tolist():
                acted = not (before.under_way and before.arrived[k])
                cells[k] = int(chosen.cells[k]) if acted else before.cells[k]
                after[k] = int(game.cells[k])
                if acted:
                    actions[k] = self._action(k, before.step)
        return Glimpse(
            positions[0].step, tuple(cells), tuple(actions), tuple(after), self._met(after)
        )

    def _action(self, k: int, step: int) -> Action:
        """Return what a robot did at the time step that was made last."""
        chosen, scenario = self._choice, self._team.scenario
        asked = int(chosen.actions[k]) == COORDINATE
        peer = NOBODY
        robots = len(scenario.robots)
        if asked and robots > 1 and scenario.peers != "all":
            draw = Stream(self._seed, k, POLICY).at(step)[PEER]
            peer = drawn_peer(k, robots, draw)
        failed = kernels.NO_ROW if self.learners.factored is None else kernels.FAILED
        perceived = asked and int(chosen.rows[k]) != failed
        return Action(int(chosen.moves[k]), asked, peer, perceived)

    def _met(self, cells: Sequence[int]) -> bool:
        """Whether a joint state is a miscoordination; robots that learn alone never meet."""
        scenario = self._team.scenario
        if self._team.learner.alone:
            return False
        return bool(miscoordinated(meeting_places(scenario)[list(cells)]))

    @property
    def asked(self) -> np.ndarray:
        """How often each robot has learned from COORDINATE in each cell, shape (robots, cells)."""
        counts: np.ndarray = self.learners.star_updates[:, :, COORDINATE].copy()
        return counts

    def play(self, trials: int) -> Trials:
        """Play greedy trials with what was learned so far."""
        self.learners = self._team.with_room(self.learners)
        return self._team.play(self.learners, self._seed, trials)

    @property
    def tables(self) -> list[Tables]:
        """What every robot has learned so far; it may go on learning in them."""
        return self._team.tables(self.learners)

    @property
    def visited(self) -> np.ndarray:
        """Joint states of Q^C that each robot has updated, shape (robots,), int64."""
        return np.asarray(np.sum(_updated(self.learners.coord_updates), axis=1))

    @property
    def history(self) -> History:
        """The episodes so far."""
        return concatenated(self._histories())

    def state(self) -> LearningState:
        """Return where the run is."""
        positions = tuple(_position(game) for game in self._games)
        return LearningState(positions, self._team.memories(self.learners), self._histories())

    def _histories(self) -> tuple[History, ...]:
        pairs = zip(self._records, self._team.learning, strict=True)
        return tuple(_history(record, problem.members) for record, problem in pairs)

    def _record_with_rows(self, number: int) -> kernels.Record:
        """Return a group's record, with room for whatever a block brings."""
        record = self._records[number]
        if not kernels.has_rows(record, BLOCK):
            rows, robots = record.reward.shape
            more = _record(rows + BLOCK, robots)
            arrays = [np.concatenate(pair) for pair in zip(record[1:], more[1:], strict=True)]
            self._records[number] = kernels.Record(record.used, *arrays)
        return self._records[number]


def _updated(counts: np.ndarray) -> np.ndarray:
    """Return which rows have a count that is not 0, shape of `counts` but for the last axis."""
    words = counts.view(np.int64)  # two int32 each: half as many to look at
    updated: np.ndarray = functools.reduce(np.bitwise_or, np.moveaxis(words, -1, 0)) != 0
    return updated


def _record(rows: int, robots: int) -> kernels.Record:
    whole = np.zeros((3, rows), dtype=np.int64)
    asks, arrived = np.zeros((rows, robots), np.int64), np.zeros((rows, robots), np.bool_)
    sums = np.zeros((rows, robots))
    used = np.zeros(1, dtype=np.int64)
    return kernels.Record(used, whole[0], whole[1], sums, whole[2], asks, arrived)


def _record_of(history: History) -> kernels.Record:
    record = _record(history.episodes + 2 * BLOCK, history.robots)
    record.used[0] = history.episodes
    for name in kernels.Record._fields[1:]:
        getattr(record, name)[: history.episodes] = getattr(history, name)
    return record


def _history(record: kernels.Record, members: np.ndarray) -> History:
    episodes = int(record.used[0])
    present = np.zeros((episodes, record.reward.shape[1]), dtype=np.bool_)
    present[:, members] = True
    names = kernels.Record._fields[1:]
    arrays = {name: getattr(record, name)[:episodes].copy() for name in names}
    return History(**arrays, present=present)


def _position(game: kernels.Game) -> Position:
    clock, team = game.clock, len(game.cells)
    transitions, step = int(clock[kernels.DONE]), int(clock[kernels.STEP])
    if not clock[kernels.PLACED]:
        nothing = (0,) * team, (False,) * team
        return Position(transitions, step, False, step, *nothing)
    cells = tuple(game.cells.tolist())
    arrived = tuple(map(bool, game.arrived.tolist()))
    return Position(transitions, step, True, int(clock[kernels.EPISODE_START]), cells, arrived)


def _game_at(position: Position) -> kernels.Game:
    """Return the game at a position; the next block of time steps begins there."""
    game = _game(len(position.cells), position.step)
    game.clock[kernels.EPISODE_START] = position.episode_start
    game.clock[kernels.DONE] = position.transitions
    game.clock[kernels.PLACED] = position.under_way
    game.clock[kernels.END] = position.step
    game.cells[:] = position.cells
    game.arrived[:] = position.arrived
    return game


def _game(team: int, step: int) -> kernels.Game:
    clock = np.zeros(5, dtype=np.int64)
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
    rule = learner.factors or FactorRule()
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
        places=meeting_places(scenario),
        percept=percept_probabilities(scenario.perception, grid),
        all_peers=scenario.peers == "all",
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
        referee=scenario.referee,
        rows_a_step=1 if learner.factors is None else len(robots),
        most_rows=MOST_ROWS if learner.factors is None else rows_at_most(cells, len(robots)),
        replays=rule.replays if learner.factors else 0,
        share=rule.share,
        percept_update=rule.percept_update,
        right_of_way=rule.right_of_way and len(scenario.robots) > 2,
    )
