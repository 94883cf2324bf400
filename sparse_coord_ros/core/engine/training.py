# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One learning run, on the engine that is quickest, with its history, evaluations and checkpoints.

The engines give the same bits, and each can continue a run of the other.
"""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.base.files import path_argument
from sparse_coord_ros.base.progress import Show, shown
from sparse_coord_ros.base.signals import STOPPING
from sparse_coord_ros.core.engine import batch
from sparse_coord_ros.core.engine.trained import Training
from sparse_coord_ros.core.engine.training_checkpoint import Checkpoint, load_checkpoint
from sparse_coord_ros.core.game.scenario import (
    Scenario,
    ScenarioLike,
    loaded,
    refuse_unexpected,
)
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.registry import (
    LearnerLike,
    chosen_learner,
    learner_of,
)
from sparse_coord_ros.core.runs.evaluation import Progress
from sparse_coord_ros.core.runs.run import LearningRun, TeamTransition
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS
from sparse_coord_ros.core.runs.team import Team

EVERY = Setting(
    "evaluate-every", int, 0, "steps between evaluations", low=0, high=10_000_000
)
EVERY_TRIALS = Setting(
    "trials", int, 200, "trials of each of them", low=2, high=10_000_000
)

FIRST_PART = 1000
"""Transitions learned at first between two looks at the clock and at signals."""

PART_SECONDS = (0.05, 0.2)
"""How long they may take; there are more of them, or fewer, next time."""

SAVE_SECONDS = 30.0
"""Time between two checkpoints."""


class Watcher(Protocol):
    """A watcher of a run in progress; it may pause the run, or slow it down.

    It is asked once more before the last transition.

    Attributes:
        wants_transition: the watcher wants to see one single transition at the next look.
    """

    wants_transition: bool

    def look(
        self, learning: LearningRun, transition: TeamTransition | None
    ) -> int | None:
        """Look at a run between two transitions.

        Args:
            learning: the run.
            transition: the transition just made, where it could be made singly; else None.

        Returns:
            The largest number of transitions until the next look; 0: pause, and look again at
            once; None: the best number for speed.
        """


def engine_for(scenario: Scenario, learner: str | Learner, engine: str = "auto") -> str:
    """Return the engine of a run: "numba" or "python".

    "auto" is numba where it is installed, it can compile the learner, and the run is long
    enough to justify numba's start of some seconds (or numba has started already).

    Raises:
        SettingError: numba is asked for, and not installed or no help to the learner.
    """
    rule = learner_of(learner)
    steps = batch.agent_steps(scenario)
    quick = batch.is_loaded(learner=rule) or batch.pays_to_compile(steps, rule)
    if engine == "auto" and not quick:
        return "python"
    return "numba" if batch.uses_numba(engine, rule) else "python"


def train(
    scenario: ScenarioLike,
    learner: LearnerLike = "coop",
    seed: int = 0,
    *,
    engine: str = "auto",
    evaluate_every: int | None = None,
    trials: int = 200,
    progress: Show = True,
    checkpoint: Path | None = None,
    resume: bool = False,
    watcher: Watcher | None = None,
    **unexpected: object,
) -> Training:
    """Learn once, for the scenario's budget: its setting `steps`, in transitions.

    `Training.history` is the history of episodes; `Training.save` writes a run's directory.

    With a `checkpoint` an interrupt (SIGINT, SIGTERM or SIGHUP, in the main thread) is held back
    until the run is saved; a second one is not. `train(..., resume=True)` continues from there, on
    any engine, and ends with the bits of an unbroken run.

    Args:
        scenario: the problem and its protocol.
        learner: the learner.
        seed: seed of every random draw.
        engine: "numba", "python", or "auto": the quicker one. The bits are the same.
        evaluate_every: transitions between two evaluations, the last one after the budget; 0:
            none; None: none, or for a resumed run as before.
        trials: greedy trials of each evaluation, seeded by the run's seed.
        progress: True: a bar at a terminal and in notebooks; False: nothing; or a function,
            called with the transitions done and the budget, several times a second.
        checkpoint: file to save to, every half minute and when interrupted; None: nowhere.
        resume: whether to continue from `checkpoint`.
        watcher: looks at the run several times a second; the bits stay the same.
        **unexpected: refused: settings are given with the scenario.

    Raises:
        ScenarioError, SettingError: no such scenario or learner, or a bad setting.
        RunError: the checkpoint is missing, cannot be read, or belongs to another run.
        PluginError: a learner or perception model of the user's own failed.
    """
    refuse_unexpected("train", unexpected)
    rule = chosen_learner(learner)
    scenario = rule.with_defaults(loaded(scenario))
    seed = RUN_SETTINGS["seed"].parse(seed)
    evaluate_every = None if evaluate_every is None else EVERY.parse(evaluate_every)
    trials = EVERY_TRIALS.parse(trials)
    told = shown(progress, "steps")
    if checkpoint is not None:
        checkpoint = path_argument("checkpoint", checkpoint)
    saved = None
    if resume:
        if checkpoint is None:
            raise SettingError(
                "setting resume: value is True, which needs a checkpoint to continue from"
            )
        saved = load_checkpoint(checkpoint, scenario, rule, seed)
        if evaluate_every is None:
            evaluate_every = saved.evaluate_every
            trials = saved.trials
    used = engine_for(scenario, rule, engine)
    if used == "numba":
        batch.prepare(rule)
    state = None if saved is None else saved.state
    under_way = _RunUnderWay(
        LearningRun(Team(scenario, rule, compiled=used == "numba"), seed, state),
        evaluate_every or 0,
        trials,
        [] if saved is None else list(saved.evaluations),
        checkpoint,
        told,
        watcher,
    )
    learning = under_way.run()
    return replace(
        batch.result_of(learning),
        evaluations=tuple(under_way.evaluations),
    )


@dataclass
class _RunUnderWay:
    """A run under way; `evaluations` so far, other arguments as in `train`."""

    learning: LearningRun
    evaluate_every: int
    trials: int
    evaluations: list[dict[str, Any]]
    checkpoint: Path | None
    progress: Progress
    watcher: Watcher | None

    def run(self) -> LearningRun:
        """Learn for the budget, or until a signal comes."""
        with _held_back(wanted=self.checkpoint is not None) as caught:
            self._learn(caught)
            if caught:
                self._save()
        if caught:
            signal.raise_signal(caught[0])
        return self.learning

    def _learn(self, caught: list[int]) -> None:
        learning = self.learning
        budget = learning.scenario.steps
        part = FIRST_PART
        saved = time.monotonic()
        self.progress(learning.done, budget)
        while learning.done < budget and not caught:
            wanted = self._look()
            if wanted == 0:
                continue  # the watcher holds the run
            target = self._target(min(part, wanted or part))
            began = time.monotonic()
            learning.advance(target)
            took = time.monotonic() - began
            part = _next_part(part, took, may_grow=wanted is None)
            self._evaluate_where_due(target)
            self.progress(learning.done, budget)
            if time.monotonic() - saved >= SAVE_SECONDS:
                self._save()
                saved = time.monotonic()

    def _target(self, most: int) -> int:
        """Return the number of transitions to learn up to, with at most `most` new ones.

        A watcher looks once more before the last transition. No evaluation is passed over.
        """
        done = self.learning.done
        budget = self.learning.scenario.steps
        every = self.evaluate_every
        target = min(budget, done + most)
        if self.watcher is not None and done < budget - 1:
            target = min(target, budget - 1)
        if every:
            target = min(target, (done // every + 1) * every)
        return target

    def _evaluate_where_due(self, done: int) -> None:
        """Play trials after each `evaluate_every` transitions, and at the end of the budget."""
        every = self.evaluate_every
        over = done == self.learning.scenario.steps
        if every and (over or done % every == 0):
            measures = self.learning.play(self.trials)
            seen = self.learning.scenario.peers_seen
            row = {"steps": done, "peers_seen": seen, **measures.to_dict()}
            self.evaluations.append(row)

    def _look(self) -> int | None:
        """Let the watcher look; return what it returns."""
        learning = self.learning
        watcher = self.watcher
        every = self.evaluate_every
        if watcher is None:
            return None
        following = learning.done + 1
        evaluated = every and following % every == 0
        apart = following == learning.scenario.steps or not evaluated
        transition = None
        if apart and watcher.wants_transition:
            transition = learning.make_transition()
        return watcher.look(learning, transition)

    def _save(self) -> None:
        """Write the checkpoint, where one is wanted."""
        if self.checkpoint is not None:
            run = self.learning
            evaluations = tuple(self.evaluations), self.evaluate_every, self.trials
            saved = Checkpoint(run.state(), *evaluations)
            saved.save(self.checkpoint, run.scenario, run.learner, run.seed)


def _next_part(part: int, took: float, *, may_grow: bool) -> int:
    """Return the number of transitions to make at once, after `part` took so many seconds."""
    if took > PART_SECONDS[1]:
        return max(1, part // 2)
    if took < PART_SECONDS[0] and may_grow:
        return 2 * part
    return part


@contextmanager
def _held_back(*, wanted: bool) -> Iterator[list[int]]:
    """Hold back the first signal of `STOPPING`; a list of one that came. The second interrupts."""
    caught: list[int] = []
    if not wanted or threading.current_thread() is not threading.main_thread():
        yield caught
        return

    def note(number: int, _frame: object) -> None:
        if caught:
            raise KeyboardInterrupt
        caught.append(number)

    numbers = [n for n in STOPPING if signal.getsignal(n) != signal.SIG_IGN]
    before = {number: signal.signal(number, note) for number in numbers}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
