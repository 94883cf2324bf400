# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord train`: the same computation without ROS."""

import argparse
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.base.errors import RunError, os_error_text
from sparse_coord_ros.base.files import take_lock, write_whole
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.base.yaml_text import to_yaml
from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli.computing import Bar, note_without_numba
from sparse_coord_ros.cli.evaluate import (
    Evaluated,
    evaluation_of,
    facts_of_result,
    result_can_wait,
    result_table,
)
from sparse_coord_ros.cli.options import Option
from sparse_coord_ros.core.engine.batch import (
    ENGINES,
    agent_steps,
    pays_to_compile,
    prepare,
    result_of,
)
from sparse_coord_ros.core.engine.trained import Training
from sparse_coord_ros.core.engine.training import (
    EVERY,
    EVERY_TRIALS,
    Watcher,
    engine_for,
    train,
)
from sparse_coord_ros.core.engine.training_checkpoint import (
    CHECKPOINT_FILE,
    load_checkpoint,
)
from sparse_coord_ros.core.game.scenario import SETTINGS, Scenario
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.learners.mind import rows_in
from sparse_coord_ros.core.runs.history import HISTORY_FILE, load_history
from sparse_coord_ros.core.runs.repeating import repeating_command
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.run_config import (
    RUN_FILE,
    SUMMARY_FILE,
    RunConfig,
    create_output,
    later_result,
    load_run,
    make_run,
)
from sparse_coord_ros.core.runs.saved_tables import TEAM_FILE, load_team, save_team
from sparse_coord_ros.core.runs.team import Team
from sparse_coord_ros.core.solve.advice import advice
from sparse_coord_ros.core.solve.shipped import known_optimum
from sparse_coord_ros.core.solve.verdict import LOST, verdict_on
from sparse_coord_ros.protocol.lockstep.node_checkpoints import CHECKPOINTS
from sparse_coord_ros.protocol.wire import RunState
from sparse_coord_ros.show.page.message_board import MessageBoard

EVALUATIONS_FILE = "evaluations.csv"
FILES = (
    *(RUN_FILE, CHECKPOINT_FILE, HISTORY_FILE, EVALUATIONS_FILE, TEAM_FILE),
    SUMMARY_FILE,
)
"""The files that this verb writes."""

TRIALS = Setting(
    "trials", int, 1000, "trials of the evaluation", low=0, high=10_000_000
)

FAR = 0.05
"""A goal whose value is discounted to less than this share, seen from the start, is far away."""

EXAMPLE = (
    "sparse_coord train env1 --learner coop --steps 1e5 --seed 7\n"
    "  sparse_coord train --resume runs/a"
)


OPTIONS = (
    *shared.run_options(
        "continue an interrupted run; DIR is its output directory; replaces SCENARIO"
    ),
    Option(
        "--engine",
        ENGINES,
        "how to compute; all engines give identical results; auto: numba for runs that are "
        "long enough to pay for compiling",
    ),
    Option(
        "--evaluate-every STEPS",
        EVERY,
        f"also evaluate every STEPS steps, into {EVALUATIONS_FILE}",
        {"default": None},
    ),
    Option(
        "--trials",
        TRIALS,
        "trials of the final evaluation (default: exact if that is quick, else 1000; 0: no "
        "evaluation)",
        {"default": None},
    ),
    *shared.WATCH,
    shared.ALLOW,
    shared.JSON,
)


ENGINE_WORDS = {"numba": "compiled by numba", "python": "plain Python"}


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    if not options.watch:
        shared.allowed_with(options, "--watch", shared.PAGE_NAMES)
        learn(options, *begin(options))
        return
    from sparse_coord_ros.cli import page

    page.one_by_one(options, begin, learn)


def begin(options: argparse.Namespace) -> tuple[Path, RunConfig]:
    """Return a run's directory, and its configuration."""
    out = options.resume
    if out is None:
        scenario = shared.scenario_of(options)
        chosen = {"seed": options.seed, "learner": options.learner}
        run = make_run(scenario, chosen)
        return shared.output_directory(options, scenario.name), run
    shared.nothing_else_given(options)
    run = load_run(out)
    run.check_code()
    if (out / CHECKPOINTS).is_dir():
        raise RunError(
            f"{out}: holds a run of nodes; continue with: sparse_coord run --resume {out}"
        )
    if not (out / CHECKPOINT_FILE).exists() and not (out / TEAM_FILE).exists():
        raise RunError(
            f"{out}: the run has no checkpoint, there is nothing to continue; start another one"
        )
    return out, run


def learn(
    options: argparse.Namespace,
    out: Path,
    run: RunConfig,
    board: MessageBoard | None = None,
) -> None:
    """Let one team learn, save its tables, and report it."""
    # refused before a directory is made
    engine_for(run.scenario, run.rule, options.engine)
    made = []
    if options.resume is None:
        made = [path for path in (out, *out.parents) if not path.exists()]
        create_output(out)
    folder = os.open(out, os.O_RDONLY | os.O_DIRECTORY)
    try:
        if not take_lock(folder):
            raise RunError(
                f"{out}: another process is learning there; wait until it ends, or stop it"
            )
        if options.resume is not None and not (out / CHECKPOINT_FILE).exists():
            shared.note(f"{out}: the run is finished already")
            done = _finished(out, run)
        else:
            done = _learn_there(options, out, run, board, made)
        _say(options, out, run, done)
    finally:
        os.close(folder)


def _finished(out: Path, run: RunConfig) -> Training:
    """Return a run that was finished earlier."""
    tables = load_team(out, run.scenario, run.rule)
    history = load_history(out)
    visited = np.array([rows_in(table.memory) for table in tables])
    steps = run.scenario.steps
    return Training(
        run.scenario, run.rule, run.seed, "", tables, history, visited, steps
    )


def _learn_there(
    options: argparse.Namespace,
    out: Path,
    run: RunConfig,
    board: MessageBoard | None,
    made: Sequence[Path],
) -> Training:
    """Let a team learn in its directory, and save it.

    A run that saves nothing removes the directories `made` for it, its own first.
    """
    resumed = options.resume is not None
    view = None
    try:
        if not resumed:
            write_whole(out / RUN_FILE, run.to_yaml())
        if board is not None:
            from sparse_coord_ros.show.page.training_source import TrainingView

            view = TrainingView(run, board, title=str(out), last=not options.watch)
            board.source = view
        done = _trained(options, out, run, view)
        _save(out, done)
        (out / CHECKPOINT_FILE).unlink(missing_ok=True)
    except RunError:  # of the checkpoint; its text has the remedy
        raise
    except BaseException as error:
        if view is not None:
            view.end(RunState.STOPPED)
        _end_early(out, run, error, made)
        raise
    if view is not None:
        view.end()
    return done


def _trained(
    options: argparse.Namespace, out: Path, run: RunConfig, view: Watcher | None
) -> Training:
    """Let the team learn, with a progress bar and checkpoints."""
    with Bar("steps", "preparing the learner", quiet=options.json) as bar:
        engine = _ready_engine(options, run, bar)
        return train(
            run.scenario,
            run.rule,
            run.seed,
            engine=engine,
            evaluate_every=options.evaluate_every,
            trials=EVERY_TRIALS.default,
            progress=bar.show,
            checkpoint=out / CHECKPOINT_FILE,
            resume=options.resume is not None,
            watcher=view,
        )


def _end_early(
    out: Path, run: RunConfig, error: BaseException, made: Sequence[Path]
) -> None:
    """Save what was learned until an error or an interrupt, and say how to continue.

    A new run without a checkpoint is removed.

    Raises:
        RunError: the error is one of the file system.
    """
    saved = (out / CHECKPOINT_FILE).exists()
    left = ""
    if saved:
        with suppress(OSError):  # of a full disk: the checkpoint is there
            _save(out, _broken_off(out, run))
        again = f"sparse_coord train --resume {out}"
        left = f"what was learned is saved in {out}; continue with: {again}"
    elif made and not (out / TEAM_FILE).exists():
        _remove(out, made)
        left = "nothing was saved"
    if isinstance(error, OSError) and not isinstance(error, BrokenPipeError):
        raise RunError(f"{os_error_text(error)}; make room; {left}") from None
    if left and (saved or isinstance(error, KeyboardInterrupt)):
        shared.note(left)


def _broken_off(out: Path, run: RunConfig) -> Training:
    """Return the run of a checkpoint so far."""
    scenario = run.scenario
    saved = load_checkpoint(out / CHECKPOINT_FILE, scenario, run.rule, run.seed)
    team = Team(scenario, run.rule, compiled=False)
    so_far = result_of(LearningRun(team, run.seed, saved.state))
    return replace(so_far, evaluations=saved.evaluations)


def _remove(out: Path, made: Sequence[Path]) -> None:
    """Remove this verb's files from its directory, and the new directories that are empty."""
    for name in FILES:
        (out / name).unlink(missing_ok=True)
    with suppress(OSError):  # one contains other files
        for folder in made:
            folder.rmdir()


def _ready_engine(options: argparse.Namespace, run: RunConfig, bar: Bar) -> str:
    """Return the engine of the run; say if numba compiles first, or is missing."""
    engine = engine_for(run.scenario, run.rule, options.engine)
    if engine == "numba":
        prepare(run.rule, engine=engine)
    bar.doing = "learning the first steps"
    if options.json:
        return engine
    missed = options.engine == "auto" and not has_numba()
    if missed and pays_to_compile(agent_steps(run.scenario), run.rule):
        note_without_numba()
    return engine


def _save(out: Path, done: Training) -> None:
    done.history.save(out)
    if done.evaluations:
        rows = [
            list(done.evaluations[0]),
            *(evaluation.values() for evaluation in done.evaluations),
        ]
        text = "".join(f"{','.join(map(str, row))}\n" for row in rows)
        write_whole(out / EVALUATIONS_FILE, text)
    save_team(out, [table.memory for table in done.tables])


def _say(
    options: argparse.Namespace, out: Path, run: RunConfig, done: Training
) -> None:
    """Print the results of learning, and their place."""
    scenario = run.scenario
    trials = options.trials
    lines = []
    last_line = []
    facts: dict[str, Any] = {"directory": out, "learner": run.learner, "seed": run.seed}
    facts |= {"engine": done.engine or None, "episodes": done.history.episodes}
    expected = advice(scenario)
    facts["advice"] = expected
    summary: dict[str, Any] = {}
    if trials != 0:
        with result_can_wait(out, "train"):
            measures = evaluation_of(run, done.tables, trials)
        summary["result"] = facts_of_result(scenario, measures)
        word = verdict_on(scenario, run.rule, measures)
        summary["verdict"] = word.text
        optimum = known_optimum(scenario)
        facts |= {
            "optimum": optimum.value,
            "optimum_exact": optimum.exact,
            "verdict": word,
        }
        facts["evaluation"] = measures.to_dict()
        lines = [result_table([Evaluated(out, run, measures)])]
        if word.kind == LOST:
            lines += tips(scenario, done)
            last_line = [word.text]
        else:
            lines.append(word.text)
    else:
        lines = [expected.text]
        summary["result"] = later_result(out)
    summary["repeat"] = repeating_command(run)
    summary["learning_steps"] = done.transitions
    summary["episodes"] = done.history.episodes
    write_whole(out / SUMMARY_FILE, to_yaml(summary))
    if done.engine:
        lines.append(f"engine   {ENGINE_WORDS[done.engine]}")
    lines += [f"result   {out / SUMMARY_FILE}", f"tables   {out / TEAM_FILE}"]
    lines += [f"history  {out / HISTORY_FILE}", f"run      {out / RUN_FILE}"]
    if done.evaluations:
        facts["evaluations"] = done.evaluations
        lines.append(f"on the way  {out / EVALUATIONS_FILE}")
    shared.tell(options, facts, *lines, *last_line)


def tips(scenario: Scenario, done: Training) -> list[str]:
    """Return advice for robots that do not arrive, at most two sentences.

    Args:
        scenario: the problem.
        done: the run, in which they do not.
    """
    moves = max(
        int(scenario.map.distances_to(r.goal)[r.start]) for r in scenario.robots
    )
    history = done.history
    last = slice(history.episodes // 2, None)
    arrived = history.arrived[last][history.present[last]].mean()
    left = scenario.discount**moves
    sentences = []
    if left < FAR:
        sentences.append(
            f"The goal is {moves} moves away, and discount {scenario.discount:g} leaves "
            f"{percent(left)} of its value there: --set discount=0.99."
        )
    elif str(scenario.starts) == "fixed":
        sentences.append(
            "Episodes that always begin at the same cells seldom find a distant goal: "
            f"--set starts={SETTINGS['starts'].default}."
        )
    share = percent(arrived, whole=True)
    ended = f"In the second half of learning {share} of the robots' episodes ended at the goal"
    return [*sentences, f"{ended}; learn longer: --steps {10 * scenario.steps}."]
