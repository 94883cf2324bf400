# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many independent learning runs and their teams, on all cores, bit for bit as single runs.

Run i of a batch with seed S is the single run with seed S + i: the same draws, the same tables.
With numba a run is one compiled loop without the interpreter's lock, and runs go on in threads;
without it the same loops run as plain Python, in processes. If the iterator is
closed, as by Ctrl-C, both stop within a block of time steps.
"""

import os
import re
import sys
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import groupby, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import (
    compile_once,
    has_numba,
    is_compiled,
    is_kept,
)
from sparse_coord_ros.base.errors import PluginError, SettingError
from sparse_coord_ros.core.engine.cluster import Cluster
from sparse_coord_ros.core.engine.processes import in_processes
from sparse_coord_ros.core.engine.trained import Training
from sparse_coord_ros.core.game.perception import (
    check_found_elsewhere,
    is_found_elsewhere,
)
from sparse_coord_ros.core.game.plugins import is_shipped, path_of
from sparse_coord_ros.core.game.scenario import Scenario, load_scenario
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.mind import rows_in
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.history import blank_history
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.team import Team
from sparse_coord_ros.core.solve.exact import evaluate_exact, is_quick

SMALL = "env1"
"""The scenario on which loops are played when they are compiled."""

ENGINES = ("auto", "numba", "python")

TELLING = (
    "No implementation of function",
    "Untyped global name",
    "Unknown attribute",
    "Cannot",
    "NameError",
    "Only accept",
    "Unsupported",
    "Use of unsupported",
    "cannot determine",
)
"""Beginnings of the lines in which numba says what it cannot compile."""


WORTH_COMPILING = 400_000
WORTH_LOADING = 100_000
"""Agent-steps of coop that plain Python makes while numba compiles, or is imported and finds the
compiled loops on disk: less work is done sooner without."""

STEPS_OF_A_TRIAL = 20
"""Steps of a greedy trial, roughly."""


def run_batch(
    scenario: Scenario,
    learner: str | Learner,
    seeds: Sequence[int],
    *,
    cluster: Cluster | None = None,
    **how: Any,
) -> Iterator[Training]:
    """Learn once for each seed, evaluate each team, and yield the runs in the order of the seeds.

    Args:
        scenario: the problem and its protocol.
        learner: a learner, or its name.
        seeds: one run each.
        cluster: the cluster that computes; None: this machine.
        how: arguments of `run_batches`; on a cluster without `jobs`.

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
        batches: the batches; runs are yielded in this order.
        trials: greedy trials of each run's team, where it is not evaluated exactly; 0: it is not
            evaluated.
        engine: "numba", "python", or "auto": numba where it is installed.
        jobs: threads (or processes); all cores that this process may use where None.
        history: whether each run comes with its learning history.

    Raises:
        SettingError, RunError: as for `run_batch`.
    """
    jobs = len(os.sched_getaffinity(0)) if jobs is None else jobs
    work_of: Counter[type[Learner]] = Counter()
    for batch in batches:
        work_of[batch.learner.rule] += _work_of(batch, trials)

    def how_to_compute(batch: Batch) -> str:
        if not uses_numba(engine):
            return "processes"
        rule = batch.learner
        quick = is_loaded(learner=rule) or pays_to_compile(work_of[rule.rule], rule)
        if not quick and engine != "numba":
            return "here"
        return "threads" if uses_numba(engine, rule) else "processes"

    for how, group in groupby(batches, how_to_compute):
        same = list(group)
        if how == "threads":
            yield from _in_threads(same, trials, jobs, history)
            continue
        work = [
            (batch.scenario, batch.learner, seed, trials, history)
            for batch in same
            for seed in batch.seeds
        ]
        found_elsewhere = all(map(_is_found_elsewhere, same))
        if how == "here" or jobs == 1 or len(work) == 1 or not found_elsewhere:
            yield from (_run_plain(*arguments) for arguments in work)
        else:
            yield from in_processes(_run_plain, work, jobs)


def _work_of(batch: Batch, trials: int) -> int:
    """Return the agent-steps of a batch, roughly those of its trials included."""
    scenario = batch.scenario
    steps = agent_steps(scenario)
    if not is_quick(scenario):
        steps += trials * len(scenario.robots) * STEPS_OF_A_TRIAL
    return steps * len(batch.seeds)


def pays_to_compile(steps: int, learner: Learner) -> bool:
    """Return whether plain Python takes longer for so many agent-steps than numba to begin."""
    needed = WORTH_LOADING if is_prepared(learner=learner) else WORTH_COMPILING
    return steps * learner.slow >= needed


def _is_found_elsewhere(batch: Batch) -> bool:
    """Return whether other processes find learner and perception model: not of a notebook."""
    learner = path_of(type(batch.learner)) is not None
    return learner and is_found_elsewhere(batch.scenario.perception)


def _in_threads(
    batches: Sequence[Batch], trials: int, jobs: int, history: bool
) -> Iterator[Training]:
    """Yield compiled runs."""
    stop = np.zeros(1, dtype=np.bool_)
    with ThreadPoolExecutor(jobs) as pool:

        def submitted() -> Iterator[Future[Training]]:
            for scenario, rule, seeds in batches:
                prepare(rule)
                team = Team(scenario, rule, compiled=True, stop=stop)
                run = partial(_run, team, trials=trials, gathering=history)
                for seed in seeds:
                    yield pool.submit(run, seed)

        # Only some ahead: a learner is compiled when its turn comes, and tables can be large.
        futures = submitted()
        waiting = deque(islice(futures, 2 * jobs))
        try:
            while waiting:
                yield waiting.popleft().result()
                waiting.extend(islice(futures, 1))
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
    """Return whether an engine setting means numba here, for a given learner if any.

    Raises:
        SettingError: there is no such engine; or numba is asked for, and not installed or no help
            to the learner.
    """
    if engine not in ENGINES:
        raise SettingError(
            f"setting engine: value is {engine!r}, allowed: {', '.join(ENGINES)}"
        )
    if engine == "python":
        return False
    if not has_numba():
        if engine == "auto":
            return False
        remedy = "pip install numba, or leave the engine out: plain Python computes the same bits"
        raise SettingError(
            f"setting engine: value is 'numba', which is not installed; {remedy}"
        )
    if learner is None or _compiles(learner):
        return True
    if engine == "numba":
        raise SettingError(
            f"setting engine: value is 'numba', but it cannot compile learner {learner.label}; "
            "leave the engine out, or choose 'python'"
        )
    return False


_compiling: dict[type[Learner], bool] = {}


def _compiles(learner: Learner) -> bool:
    """Return whether numba compiles a learner; if not, say so once.

    Tests check this package's learners. A user's own one is compiled here.
    """
    rule = learner.rule
    if is_shipped(rule):
        return True
    if rule not in _compiling:
        try:
            _compile(learner)
            _compiling[rule] = True
        except PluginError as error:
            _learn_one_step(learner, compiled=False)  # it may fail by itself
            _compiling[rule] = False
            reason = _reason(error)
            print(
                f"learner {learner.label}: runs in plain Python, not compiled: numba cannot "
                f"compile it ({reason})",
                file=sys.stderr,
            )
    return _compiling[rule]


def _reason(error: PluginError) -> str:
    """Return where numba fails, its reason, and what to change: one line of its long message.

    The place is the user's hook that it compiled last, and the last line outside of numba and of
    this package. The reason is the last line that tells one.
    """
    text = str(error.__cause__)
    parts = [
        f"its {name}"
        for name in re.findall(r"Function\(<function \S+\.(\w+) at", text)[-1:]
    ]
    files = re.findall(r"During: typing of .* at (\S+) \((\d+)\)", text)
    package = str(Path(__file__).parents[2])
    lines_of_user = [
        line for file, line in files if package not in file and "/numba/" not in file
    ]
    parts += [f"line {line}" for line in lines_of_user[-1:]]
    lines = [line.strip() for line in text.splitlines()]
    reasons = [line for line in lines if line.startswith(TELLING)]
    reason = type(error.__cause__).__name__
    if reasons:
        reason = re.sub(r" at 0x[0-9a-f]+| found for signature:$", "", reasons[-1])
    where = f"{', '.join(parts)}: " if parts else ""
    allowed = "index arrays, compute, and call functions marked by @sc.rules.jitable"
    return f"{where}{reason[:120]}; it may {allowed}"


def _run_plain(
    scenario: Scenario, learner: Learner, seed: int, trials: int, gathering: bool
) -> Training:
    return _run(Team(scenario, learner, compiled=False), seed, trials, gathering)


def _run(team: Team, seed: int, trials: int, gathering: bool) -> Training:
    """Learn for the scenario's budget, and evaluate the learned tables."""
    learning = LearningRun(team, seed)
    learning.advance(team.scenario.steps)
    training = result_of(learning, history=gathering)
    if not trials:
        return training
    if is_quick(team.scenario):
        return replace(
            training, measures=evaluate_exact(team.scenario, training.tables)
        )
    return replace(training, measures=learning.play(trials))


def result_of(learning: LearningRun, *, history: bool = True) -> Training:
    """Return the results of a run so far, with or without its learning history."""
    memories = learning.memories
    episodes = blank_history(0, len(learning.scenario.robots))
    if history:
        episodes = learning.history
    return Training(
        learning.scenario,
        learning.learner,
        learning.seed,
        "numba" if learning.team.compiled else "python",
        learning.team.tables(memories),
        episodes,
        np.array([rows_in(memory) for memory in memories]),
        learning.done,
    )


def prepare(learner: str | Learner, *, engine: str = "auto") -> None:
    """Compile the loop of a learner, once in this process; say so if it is not on disk.

    Does nothing for plain Python. Progress displays call it before their clock starts: it takes
    some seconds, and Ctrl-C ends it at once. It plays on a small map: on the user's own a trial
    may take minutes.

    Args:
        learner: a learner, or its name.
        engine: as for `run_batch`.

    Raises:
        SettingError: numba is asked for and not installed.
    """
    rule = learner_of(learner)
    if uses_numba(engine, rule):
        _compile(rule)


def _compile(learner: Learner) -> None:
    """Compile the loop of a learner, or load it from disk."""
    if not is_prepared(learner=learner):
        print(
            f"compiling learner {learner.label}, once per machine, some seconds",
            file=sys.stderr,
        )
    compile_once(*_loop_key(learner), partial(_learn_one_step, learner, compiled=True))


def _learn_one_step(learner: Learner, *, compiled: bool) -> None:
    small = learner.with_defaults(load_scenario(SMALL).with_settings({"steps": 1}))
    LearningRun(Team(small, learner, compiled=compiled), seed=0).advance(1)


def is_prepared(*, learner: str | Learner = "coop") -> bool:
    """Return whether a learner's loop is compiled, in this process or on disk."""
    key = _loop_key(learner)
    return is_compiled(*key) or is_kept(*key)


def is_loaded(*, learner: str | Learner = "coop") -> bool:
    """Return whether the loop of a learner is ready in this process."""
    return is_compiled(*_loop_key(learner))


def _loop_key(learner: str | Learner) -> tuple[str, type]:
    """Return a key of a compiled loop: numba compiles one for each learner."""
    kind = learner_of(learner).rule
    return kind.__qualname__, kind
