# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many independent learning runs and their trials, on all cores, bit for bit as single runs.

Run i of a batch with seed S is the single run with seed S + i: the same draws, the same tables.
With numba a run is one compiled loop without the interpreter's lock, and runs go on in threads;
without it `learn.simulation` and `learn.evaluation` run in processes. Where the iterator is
closed, as by Ctrl-C, neither goes on for longer than a block of time steps.
"""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import groupby
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from sparse_coord_ros.compiling import compile_once, has_numba, is_compiled, is_kept
from sparse_coord_ros.engine import kernels
from sparse_coord_ros.engine.cluster import Cluster
from sparse_coord_ros.engine.processes import in_processes
from sparse_coord_ros.engine.trained import Training
from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game import streams
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.game.generator import jump_table, source_of
from sparse_coord_ros.game.links import UP, link_of
from sparse_coord_ros.game.miscoordination import meeting_places, miscoordinated
from sparse_coord_ros.game.perception import (
    asked_peers,
    check_found_elsewhere,
    is_found_elsewhere,
    percept_probabilities,
)
from sparse_coord_ros.game.plugins import path_of
from sparse_coord_ros.game.scenario import Scenario, load_scenario
from sparse_coord_ros.game.schedules import probabilities, step_sizes
from sparse_coord_ros.game.world import EPISODE_GAP, FIRST_STEP, Action, Position, before_episode
from sparse_coord_ros.learn import loops
from sparse_coord_ros.learn.agent import Decision, Memory, Tables, action_of
from sparse_coord_ros.learn.evaluation import Trials
from sparse_coord_ros.learn.history import History, blank_history, concatenated
from sparse_coord_ros.learn.learners import Learner, learner_of
from sparse_coord_ros.learn.loops import Minds
from sparse_coord_ros.learn.rows import has_room, updated_rows
from sparse_coord_ros.learn.simulation import Glimpse, Learning, LearningState, groups_of
from sparse_coord_ros.solve.exact import exact_means

BLOCK = 2048
"""Time steps between two looks at whether anybody waits for the run and its tables have room."""

JUMPS = jump_table()
"""As of `loops.Draws`."""

SMALL = "env1"
"""The scenario on which loops are played when they are compiled."""

ENGINES = ("auto", "numba", "python")


def run_batch(
    scenario: Scenario,
    learner: str | Learner,
    seeds: Sequence[int],
    *,
    cluster: Cluster | None = None,
    **how: Any,
) -> Iterator[Training]:
    """Learn once for each seed, play greedy trials, and yield the runs in the order of the seeds.

    Args:
        scenario: the problem and its protocol.
        learner: a learner, or its name.
        seeds: one run each.
        cluster: whose workers compute; None: this machine.
        how: as of `run_batches`; a cluster's workers say by themselves how many `jobs` they do.

    Raises:
        SettingError: numba is asked for and not installed.
        RunError: a process that computed runs was killed, or the cluster is lost.
    """
    rule = learner_of(learner)
    if cluster is None:
        yield from run_batches([Batch(scenario, rule, seeds)], **how)
        return
    check_found_elsewhere(scenario.perception)
    shares = cluster.shares(seeds, agent_steps(scenario), len(seeds))
    asked = [(scenario, rule, share, {**how, "jobs": 1}) for share in shares]
    for _, runs in cluster.results(_runs_of, asked, in_order=True):
        yield from runs


class Batch(NamedTuple):
    """Learning runs of one learner in one scenario, one for each seed."""

    scenario: Scenario
    learner: Learner
    seeds: Sequence[int]


def run_batches(
    batches: Sequence[Batch],
    *,
    trials: int,
    engine: str = "auto",
    jobs: int | None = None,
    history: bool = False,
) -> Iterator[Training]:
    """Compute batches on this machine, one after the other: no core waits for the end of one.

    Args:
        batches: what to compute; the runs come in this order.
        trials: trials of each run; 0: none.
        engine: "numba", "python", or "auto": numba where it is installed.
        jobs: threads (or processes); all cores that this process may use where None.
        history: whether each run comes with its learning history.

    Raises:
        SettingError, RunError: as of `run_batch`.
    """
    jobs = len(os.sched_getaffinity(0)) if jobs is None else jobs
    for compiled, group in groupby(batches, lambda one: uses_numba(engine, one.learner)):
        same = list(group)
        if compiled:
            yield from _in_threads(same, trials, jobs, history)
            continue
        work = [(one.scenario, one.learner, s, trials, history) for one in same for s in one.seeds]
        found = all(map(_is_found_elsewhere, same))
        if jobs == 1 or len(work) == 1 or not found:
            yield from (_run_plain(*one) for one in work)
        else:
            yield from in_processes(_run_plain, work, jobs)


def _is_found_elsewhere(batch: Batch) -> bool:
    """Whether other processes find the learner and the perception model: not of a notebook."""
    learner = path_of(type(batch.learner)) is not None
    return learner and is_found_elsewhere(batch.scenario.perception)


def _in_threads(
    batches: Sequence[Batch], trials: int, jobs: int, history: bool
) -> Iterator[Training]:
    """Yield compiled runs."""
    stop = np.zeros(1, dtype=np.bool_)
    futures = []
    with ThreadPoolExecutor(jobs) as pool:
        try:
            for scenario, rule, seeds in batches:
                prepare(rule, history=history)
                run = partial(CompiledTeam(scenario, rule, stop).run, gathering=history)
                futures += [pool.submit(run, seed, trials) for seed in seeds]
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
    scenario: Scenario, learner: Learner, seeds: Sequence[int], how: dict[str, Any]
) -> list[Training]:
    """Compute some runs in a thread of a cluster's worker."""
    return list(run_batch(scenario, learner, seeds, **how))


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
        remedy = "pip install numba, or leave the engine out: plain Python computes the same bits"
        raise SettingError(f"setting engine: value is 'numba', which is not installed; {remedy}")
    return engine != "python" and has_numba() and (learner is None or learner.compiled)


def _run_plain(
    scenario: Scenario, learner: Learner, seed: int, trials: int, gathering: bool
) -> Training:
    learning = begin(scenario, learner, seed, compiled=False, gathering=gathering)
    return _whole(learning, "python", trials)


def _whole(learning: "LearningRun", engine: str, trials: int) -> Training:
    """Learn for the scenario's budget, and play greedy trials with what was learned."""
    scenario, learner = learning.scenario, learning.learner
    learning.advance(scenario.steps)
    found = result_of(learning, engine)
    if not trials:
        return found
    exact = exact_means(scenario, found.tables, learner)
    return replace(found, trials=learning.play(trials), exact=exact)


def result_of(learning: "LearningRun", engine: str) -> Training:
    """Return what a run has brought so far; `engine` computed it."""
    return Training(
        learning.scenario,
        learning.learner,
        learning.seed,
        engine,
        learning.tables,
        learning.history,
        learning.visited,
        learning.done,
    )


def prepare(learner: str | Learner, *, engine: str = "auto", history: bool = False) -> None:
    """Compile the loops for a learner where that has not been done in this process.

    Does nothing where plain Python is going to compute. What shows progress calls it before its
    clock starts: it takes some seconds, once a process, and Ctrl-C ends it at once. It plays on a
    small map: on the user's own a trial may take minutes.

    Args:
        learner: a learner, or its name.
        engine: as of `run_batch`.
        history: whether the loop is needed that gathers the learning history.

    Raises:
        SettingError: numba is asked for and not installed.
    """
    rule = learner_of(learner)
    if uses_numba(engine, rule):

        def warm_up() -> None:
            small = rule.with_defaults(load_scenario(SMALL).with_settings({"steps": 1}))
            CompiledTeam(small, rule).run(0, 1, gathering=history)

        compile_once(*_loops_key(rule, history), warm_up)


def is_prepared(*, learner: str | Learner = "coop", history: bool = False) -> bool:
    """Whether the loops for a learner need no compiling: they are, in this process or on disk."""
    key = _loops_key(learner, history)
    return is_compiled(*key) or is_kept(*key)


def is_loaded(*, learner: str | Learner = "coop", history: bool = False) -> bool:
    """Whether the loops for a learner are ready in this process."""
    return is_compiled(*_loops_key(learner, history))


def _loops_key(learner: str | Learner, history: bool) -> tuple[str, type | None]:
    """Return what tells the compiled loops apart: numba compiles them for each kind of minds."""
    minds = learner_of(learner).minds
    name = "none" if minds is None else minds.__qualname__
    return f"{name}_with_history" if history else name, minds


class Stopped(Exception):  # noqa: N818 - no error: nobody waits for the run any more
    """A run was given up between two blocks."""


class CompiledTeam:
    """One scenario and learner as arrays, for many runs.

    Args:
        scenario: the problem and its protocol.
        learner: a learner, or its name; it has a compiled form.
        stop: where its one entry is set, runs raise `Stopped` at the next block.
        loops: the loops; those compiled for the learner where None.
    """

    def __init__(
        self,
        scenario: Scenario,
        learner: str | Learner,
        stop: np.ndarray | None = None,
        *,
        loops: kernels.Loops | None = None,
    ) -> None:
        self.scenario = scenario
        self.learner = learner_of(learner)
        self.minds: Any = self.learner.minds
        self.loops = loops or kernels.compiled(self.minds)  # type: ignore[arg-type]
        self._stop = np.zeros(1, dtype=np.bool_) if stop is None else stop
        whole = make_problem(scenario, self.learner, np.arange(len(scenario.robots)))
        groups = [np.array(members) for members in groups_of(scenario, self.learner)]
        self.learning = [whole._replace(members=members) for members in groups]
        self._trying = whole._replace(
            max_steps=scenario.horizon, exploring=np.zeros(1), epsilon=np.zeros(1)
        )

    def run(self, seed: int, trials: int, *, gathering: bool = False) -> Training:
        """Learn once and play greedy trials with what was learned."""
        return _whole(CompiledLearning(self, seed, gathering=gathering), "numba", trials)

    def learn(self, seed: int) -> Minds:
        """Learn for the scenario's budget."""
        learning = CompiledLearning(self, seed, gathering=False)
        learning.advance(self.scenario.steps)
        return learning.minds

    def play(self, minds: Minds, seed: int, trials: int, *, paired: bool = False) -> Trials:
        """Play greedy trials; `paired` as of `loops.CompiledScenario`."""
        scenario = self.scenario
        team = len(scenario.robots)
        results = np.zeros((trials, team, 4))
        asked, stays = np.zeros((2, team, len(scenario.map.cells)), dtype=np.int64)
        problem = self._trying._replace(budget=trials, paired=paired)
        draws = self.draws(seed, problem, streams.EVALUATION)
        game = _game_at(before_episode(0, FIRST_STEP + EPISODE_GAP, team))
        state = loops.State(problem, game, _choice(team), draws)
        while state.game.clock[loops.DONE] < trials:
            minds = self.with_room(minds)
            self.loops.play(state, minds, results, asked, stays)
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

    def tables(self, minds: Minds) -> list[Tables]:
        """Return what each robot learned, in the shapes of `learn.agent`."""
        return minds.tables(self.scenario, self.learner)

    def initial(self) -> Minds:
        """Return what robots know before learning."""
        minds: Minds = self.minds.initial(self.scenario, self.learner, BLOCK)
        return minds

    def remembered(self, memories: Sequence[Memory]) -> Minds:
        """Return minds to go on learning with from what each robot remembers."""
        minds = self.initial().remember(memories, self.scenario)
        return self._larger(minds) if minds.rows.hashed else minds

    def with_room(self, minds: Minds) -> Minds:
        """Return minds whose hashed tables stay half empty whatever a block brings."""
        return minds if has_room(minds.rows, BLOCK) else self._larger(minds)

    def _larger(self, minds: Minds) -> Minds:
        old = minds.rows
        rows = old.empty(old.rows_for(int(old.used.max()), BLOCK))
        self.loops.rehash(old, rows)
        return minds._replace(rows=rows)

    def check_wanted(self) -> None:
        """Raise `Stopped` where nobody waits for the run any more."""
        if self._stop[0]:
            raise Stopped

    def draws(
        self, seed: int, problem: loops.CompiledScenario, phase: int, first: int = 0
    ) -> loops.Draws:
        """Return where the draws come from; the first block begins with the time step `first`."""
        team = len(problem.starts)
        links = [link_of(self.scenario.link, seed, k, phase) for k in range(team)]
        fails = bool(team == 1 or (problem.percept < 1.0).any() or self.scenario.link != UP)
        looked_at = {
            streams.POLICY: True,
            streams.MOTION: True,
            streams.PERCEPT: problem.actions > PRIMITIVES and fails,
            streams.START: bool(problem.exploring.any()),
        } | dict.fromkeys(self.minds.roles(), phase == streams.LEARNING)
        sources = np.zeros((len(streams.DRAWS), team, 4), dtype=np.uint64)
        for role, width in streams.DRAWS.items():
            for k in problem.members.tolist() if looked_at.get(role) else ():
                sources[role, k] = source_of(seed, k, role, phase, first * width)
        return loops.Draws(
            sources=sources,
            since=np.full((len(streams.DRAWS), team), first),
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
        scenario, learner, seed: of the run.
        done: transitions made, by each group of robots.
        minds: what all robots know.
    """

    def __init__(
        self,
        team: CompiledTeam,
        seed: int,
        state: LearningState | None = None,
        *,
        gathering: bool = True,
    ) -> None:
        self.scenario, self.learner, self.seed = team.scenario, team.learner, seed
        robots, groups = len(team.scenario.robots), len(team.learning)
        self._team, self._choice = team, _choice(robots)
        self.minds = team.initial() if state is None else team.remembered(state.memories)
        if state is None:
            first, nothing = before_episode(0, FIRST_STEP, robots), blank_history(0, robots)
            state = LearningState((first,) * groups, (), (nothing,) * groups)
        self.done = state.positions[0].transitions
        games = [_game_at(position) for position in state.positions]
        self._states = [
            loops.State(
                problem,
                game,
                self._choice,
                team.draws(seed, problem, streams.LEARNING, int(game.clock[loops.END])),
            )
            for problem, game in zip(team.learning, games, strict=True)
        ]
        self._records = [_record(one) if gathering else None for one in state.histories]

    def advance(self, until: int) -> None:
        """Let every group of robots learn until it has made so many transitions.

        Raises:
            Stopped: nobody waits for the run any more.
        """
        team = self._team
        for number, state in enumerate(self._states):
            part = state._replace(problem=state.problem._replace(budget=until))
            while state.game.clock[loops.DONE] < until:
                self.minds = team.with_room(self.minds)
                record = self._records[number]
                if record is not None and not kernels.has_rows(record, BLOCK):
                    record = _record(_history(record, state))
                    self._records[number] = record
                team.loops.learn(part, self.minds, record)
                team.check_wanted()
        self.done = max(self.done, until)

    def glimpse(self) -> Glimpse:
        """Let every group of robots make one transition, and return it."""
        positions = [_position(state.game) for state in self._states]
        self.advance(self.done + 1)
        rows: list[tuple[int, Action | None, int]] = []  # in the order of the robots
        for state, before in zip(self._states, positions, strict=True):
            for k in state.problem.members.tolist():
                cell, action = before.cells[k], None
                if not (before.under_way and before.arrived[k]):
                    cell, action = int(self._choice.cells[k]), self._action(k, before.step)
                rows.append((cell, action, int(state.game.cells[k])))
        cells, actions, after = zip(*rows, strict=True)
        places = meeting_places(self.scenario)[np.array(after)]
        met = bool(miscoordinated(places)) and not self.learner.alone  # those never meet
        return Glimpse(positions[0].step, cells, actions, after, met)

    def _action(self, k: int, step: int) -> Action:
        """Return what a robot did at the time step that was made last."""
        chosen, scenario = self._choice, self.scenario
        draw = streams.Stream(self.seed, k, streams.POLICY).at(step)[streams.PEER]
        peers = asked_peers(scenario.peers, k, len(scenario.robots), draw)
        decision = Decision(int(chosen.actions[k]), peers)
        perceived = int(chosen.rows[k]) != loops.NO_ROW
        return action_of(decision, int(chosen.moves[k]), perceived=perceived)

    @property
    def step(self) -> int:
        """The time step of the next transition (of robots that learn alone: of the first one)."""
        return int(self._states[0].game.clock[loops.STEP])

    @property
    def asked(self) -> np.ndarray:
        """How often each robot has learned from COORDINATE in each cell, shape (robots, cells)."""
        counts: np.ndarray = self.minds.star_updates[:, :, COORDINATE].copy()
        return counts

    def play(self, trials: int) -> Trials:
        """Play greedy trials with what was learned so far."""
        return self._team.play(self.minds, self.seed, trials)

    @property
    def tables(self) -> list[Tables]:
        """What every robot has learned so far; it may go on learning in them."""
        return self._team.tables(self.minds)

    @property
    def visited(self) -> np.ndarray:
        """Joint states of Q^C that each robot has updated, shape (robots,), int64."""
        return np.asarray(np.sum(updated_rows(self.minds.rows.updates), axis=1))

    @property
    def history(self) -> History:
        """The episodes so far."""
        return concatenated([blank_history(0, len(self.scenario.robots)), *self._histories()])

    def state(self) -> LearningState:
        """Return where the run is."""
        positions = tuple(_position(state.game) for state in self._states)
        team = self._team.scenario
        memories = tuple(self.minds.memory(k, team) for k in range(len(team.robots)))
        return LearningState(positions, memories, self._histories())

    def _histories(self) -> tuple[History, ...]:
        pairs = zip(self._records, self._states, strict=True)
        return tuple(_history(record, state) for record, state in pairs if record is not None)


LearningRun: TypeAlias = Learning | CompiledLearning
"""A run in progress on either engine."""


def begin(
    scenario: Scenario,
    learner: Learner,
    seed: int,
    state: LearningState | None = None,
    *,
    compiled: bool,
    gathering: bool = True,
) -> LearningRun:
    """Return a run on one of the engines, at its beginning or where a state says.

    Args:
        scenario: the problem and its protocol.
        learner: the learner.
        seed: the run's seed.
        state: where to go on; None: at the beginning.
        compiled: whether numba is to compute it.
        gathering: whether to gather the history.
    """
    if compiled or learner.central:
        team = CompiledTeam(scenario, learner, loops=None if compiled else kernels.PLAIN)
        return CompiledLearning(team, seed, state, gathering=gathering)
    return Learning(scenario, learner, seed, state, gathering=gathering)


def _record(history: History) -> kernels.Record:
    """Return a record that goes on from a history, with room for two blocks of time steps."""
    room = blank_history(2 * BLOCK, history.robots)
    return kernels.Record(np.array([history.episodes]), concatenated([history, room]))


def _history(record: kernels.Record, state: loops.State) -> History:
    history = record.rows.first(int(record.used[0])).copy()
    history.present[:, state.problem.members] = True
    return history


def _position(game: loops.GameState) -> Position:
    clock, team = game.clock, len(game.cells)
    transitions, step = int(clock[loops.DONE]), int(clock[loops.STEP])
    if not clock[loops.PLACED]:
        return before_episode(transitions, step, team)
    cells = tuple(game.cells.tolist())
    arrived = tuple(map(bool, game.arrived.tolist()))
    return Position(transitions, step, True, int(clock[loops.EPISODE_START]), cells, arrived)


def _game_at(position: Position) -> loops.GameState:
    """Return the game at a position; the next block of time steps begins there."""
    clock = np.zeros(5, dtype=np.int64)
    clock[loops.STEP] = clock[loops.END] = position.step
    clock[loops.EPISODE_START] = position.episode_start
    clock[loops.DONE] = position.transitions
    clock[loops.PLACED] = position.under_way
    return loops.GameState(clock, np.array(position.cells), np.array(position.arrived, np.int8))


def _choice(team: int) -> loops.Choices:
    return loops.Choices(*np.zeros((4, team), dtype=np.int64))


AS_THEY_ARE = (
    *("max_steps", "move_success", "goal_reward", "ask_cost", "discount", "goal_value"),
    "referee",
)
"""Settings that loops read as they are."""


def make_problem(
    scenario: Scenario, learner: Learner, members: np.ndarray
) -> loops.CompiledScenario:
    """Return a scenario as arrays.

    Args:
        scenario: the problem and its protocol.
        learner: the learner.
        members: numbers of the robots that move.
    """
    grid, robots = scenario.map, scenario.robots
    free = [grid.leading_to(robot.goal) for robot in robots]
    start_cells = np.zeros((len(robots), max(map(len, free))), dtype=np.int64)
    for k, choices in enumerate(free):
        start_cells[k, : len(choices)] = choices
    alpha = step_sizes(scenario.step_size, scenario.steps)
    return loops.CompiledScenario(
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
        exploring=probabilities(scenario.starts, scenario.steps),
        epsilon=probabilities(scenario.epsilon, scenario.steps),
        alpha_by_count=alpha.by_count,
        alpha_by_step=alpha.by_step,
        discounts=np.cumprod([1.0, *[scenario.discount] * scenario.horizon]),
        actions=len(ACTIONS) if learner.asks else PRIMITIVES,
        weights=np.array(learner.weights(scenario)),
        budget=scenario.steps,
        paired=False,
        **{name: getattr(scenario, name) for name in AS_THEY_ARE},
    )
