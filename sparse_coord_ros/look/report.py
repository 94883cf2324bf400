# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A page that tells all of a run, or of results: what was learned, its worth, what went wrong."""

import contextlib
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from sparse_coord_ros.engine.training import train
from sparse_coord_ros.errors import SparseCoordError
from sparse_coord_ros.experiments.report.entries import Entry
from sparse_coord_ros.experiments.report.section import common
from sparse_coord_ros.game.scenario import SETTINGS, Scenario, load_scenario
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.learners import LEARNERS, Learner, learner_of
from sparse_coord_ros.look import figures
from sparse_coord_ros.look.html import Page
from sparse_coord_ros.look.results import ResultsShown
from sparse_coord_ros.look.sources import TRIALS as PLAYED_EPISODES
from sparse_coord_ros.look.sources import Shown
from sparse_coord_ros.look.steps import ended
from sparse_coord_ros.palette import ANSWERED
from sparse_coord_ros.runlog.explain import explained, in_words
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.solve.exact import evaluate_best
from sparse_coord_ros.solve.reference import shortest_path_reference
from sparse_coord_ros.solve.shipped import yardsticks
from sparse_coord_ros.version import __version__
from sparse_coord_ros.wire import DIAGNOSTICS, ROSOUT

TRIALS = 1000
BASELINES = ("indiv", "noncoop")
MOST_WARNINGS = 20
WARNING_LEVEL = 30
"""Of a rcl_interfaces/Log; what is below is no warning."""

CAPTIONS = {
    "policy": "Greedy moves of the learned tables. A ring: the robot asks there before it moves. "
    "Pale: it never gets there in greedy episodes.",
    "asks": f"Where robots ask in {PLAYED_EPISODES} greedy episodes from the scenario's starts.",
    "sparsity": "How much of Q^C was ever learned, by the robot's own cell.",
    "curves": "Learning curves: each dot an episode, each line a running mean.",
    "percepts": "How often robots asked while they learned, and how it ended.",
}


def run_report(shown: Shown, *, baselines: bool = True) -> str:
    """Return the page of a run.

    Args:
        shown: the run.
        baselines: whether to let Indiv. and Non-coop. learn the same, to compare.

    Raises:
        SparseCoordError: it is no run.
    """
    config, scenario = shown.config, shown.config.scenario
    rule = config.rule
    page = Page(f"{scenario.name}: {rule.title or rule.label}, seed {config.seed}")
    page.say(
        f"{len(scenario.robots)} robots, {scenario.steps} steps of learning, penalty "
        f"{scenario.penalty:g} for a miscoordination, {scenario.ask_cost:g} for asking. "
        f"From {shown.path}; report of sparse_coord_ros {__version__}."
    )
    if shown.bag is not None and shown.log.damage is not None:
        page.say(f"The bag is damaged: {shown.log.damage}. What is before it:", warn=True)
    _worth(page, shown, baselines)
    whats = figures.available(shown)
    page.heading("What was learned")
    if not whats:
        page.say("There are neither tables nor a history to draw.", warn=True)
    for what in whats:
        shown.say(f"drawing {what}")
        page.figure(figures.runs_figure([shown], [what]), CAPTIONS[what])
    if shown.bag is not None:
        _dialogue(page, shown)
        _faults(page, shown)
    _scenario(page, scenario)
    _again(page, shown)
    return page.text()


def _worth(page: Page, shown: Shown, baselines: bool) -> None:
    config, scenario = shown.config, shown.config.scenario
    page.heading("What it is worth")
    rows: list[list[str]] = []
    if shown.has("tables"):
        shown.say("evaluating")
        rows.append(_measures("this team", scenario, shown.tables, config.rule))
    else:
        page.say("There are no learned tables to evaluate.", warn=True)
    others = [learner_of(name) for name in BASELINES if name in LEARNERS.registered]
    for rule in others if baselines else []:
        if rule.label == config.learner:
            continue
        shown.say(f"learning {rule.title}, to compare")
        learned = train(scenario, rule, config.seed)
        rows.append(_measures(f"{rule.title}, same seed", scenario, learned.tables, rule))
    paths = shortest_path_reference(scenario)
    rows.append(
        [
            *("fixed shortest paths", f"{paths.reward:.2f}", f"{paths.time_to_goal:.2f}"),
            *(f"{paths.miscoordinations:.3f}", "0", "-"),
        ]
    )
    for name, value in yardsticks(scenario):
        rows.append([name, f"{value:.2f}", "-", "-", "-", "-"])
    head = ["", "reward", "time to goal", "miscoordinations", "asks", "all arrive"]
    page.table(head, rows)
    page.say(
        "Total discounted reward a robot, steps to the goal, miscoordinations of an episode, asks "
        "of a robot; ± is the spread over robots and episodes. The class bound is the best team "
        "found of robots that see each other only by asking; the joint optimum sees all, always."
    )


def _measures(name: str, scenario: Scenario, tables: Sequence[Tables], rule: Learner) -> list[str]:
    """Return the row of a team: exact where it can be, else by trials."""
    found = evaluate_best(scenario, tables, trials=TRIALS, learner=rule)
    return [
        f"{name}, {found.how}",
        f"{found.reward.mean:.2f} ± {found.reward.spread:.2f}",
        f"{found.time_to_goal.mean:.2f} ± {found.time_to_goal.spread:.2f}",
        f"{found.miscoordinations.mean:.3f} ± {found.miscoordinations.spread:.3f}",
        f"{found.asks.mean:.2f}",
        f"{found.all_arrived:.2%}",
    ]


def _dialogue(page: Page, shown: Shown) -> None:
    page.heading("Some questions and answers")
    shown.say("following the dialogue")
    samples = set(_samples(shown.log))
    log = shown.with_requests({step for _, step in samples})
    told = [
        one
        for k in range(len(log.names))
        for one in explained(log, k, sorted(step for robot, step in samples if robot == k))
        if one is not None
    ]
    if not told:
        page.say("Nobody asked anything that the log can tell of.")
    for one in sorted(told, key=lambda one: (one.step, one.robot)):
        page.code("\n".join(in_words(log, one)))


def _samples(log: RunLog) -> Iterator[tuple[int, int]]:
    """Yield robot and time step of questions: of each outcome the first, and the last answered."""
    for name, found in ended(log).items():
        places = np.argwhere(found)
        if len(places):
            chosen = [places[0], places[-1]] if name == ANSWERED else [places[0]]
            for row, k in chosen[: len(places)]:
                yield int(k), int(log.step[row])


def _faults(page: Page, shown: Shown) -> None:
    log = shown.log
    page.heading("Faults and diagnostics")
    rows: list[tuple[str, object]] = [
        (f"percepts {name}", int(found.sum())) for name, found in ended(log).items()
    ]
    last = log.tracks.statuses[-1] if log.tracks.statuses else None
    if last is not None:
        rows += [("state at the end", last.state), ("transitions", last.transitions)]
        rows += [("steps that the world made without a robot", last.left_out)] * (
            last.left_out is not None
        )
    steps, warnings = _spoken(log)
    if steps:
        rows.append(("steps/s, median (least, most)", _spread(steps)))
    rows.append(("odd messages among those read", len(log.problems)))
    page.table((), rows)
    for problem in log.problems[:MOST_WARNINGS]:
        page.say(str(problem), warn=True)
    if warnings:
        shown_ones = list(warnings.items())[:MOST_WARNINGS]
        page.table(["warning", "times"], [(text, n) for text, n in shown_ones])
    else:
        page.say("No node warned of anything.")
    page.say("Whether the log is what it has to be, bit for bit, says 'sparse_coord verify'.")
    if shown.directory is not None and (shown.directory / "summary.yaml").is_file():
        text = (shown.directory / "summary.yaml").read_text(encoding="utf-8", errors="replace")
        page.code(text, summary="summary.yaml")


def _spread(values: Sequence[float]) -> str:
    return f"{np.median(values):.0f} ({min(values):.0f}, {max(values):.0f})"


def _spoken(log: RunLog) -> tuple[list[float], Counter[str]]:
    """Return the world's speeds, and the nodes' warnings with how often they came."""
    spoken = log.tracks.spoken
    warnings = Counter(
        f"{said.name}: {said.msg}"[:300]
        for said in spoken.get(ROSOUT, ())
        if said.level >= WARNING_LEVEL
    )
    speeds: list[float] = []
    for said in spoken.get(DIAGNOSTICS, ()):
        own = [status for status in said.status if _is_of(status.name, log.tracks.prefix)]
        values = {v.key: v.value for status in own for v in status.values}
        with contextlib.suppress(ValueError):  # of another writer
            speeds.append(float(values.get("steps_per_second", 0)))
    return [speed for speed in speeds if speed > 0], warnings


def _is_of(name: str, prefix: str) -> bool:
    """Whether a status is of the bag's team: older ones do not name their namespace."""
    return name.rpartition("/")[0] in ("", prefix.strip("/"))


def _scenario(page: Page, scenario: Scenario) -> None:
    page.heading("Scenario")
    grid = scenario.map
    page.say(f"Map {grid.name}: {grid.title}".rstrip(": "))
    if grid.provenance:
        page.say(f"Provenance: {grid.provenance}")
    page.code("\n".join(grid.rows))
    rows = [
        (robot.name, str(list(grid.cells[robot.start])), str(list(grid.cells[robot.goal])))
        for robot in scenario.robots
    ]
    page.table(["robot", "start [row, column]", "goal [row, column]"], rows, words=True)
    settings = [
        (name, getattr(scenario, name), setting.default, setting.help)
        for name, setting in SETTINGS.items()
    ]
    page.table(["setting", "value", "default", "meaning"], settings, words=True)


def _again(page: Page, shown: Shown) -> None:
    page.heading("How to reproduce it")
    config = shown.config
    lines = [_command(shown)]
    if shown.bag is not None:
        lines.append(f"sparse_coord verify {shlex.quote(str(shown.bag))}")
    page.code("\n".join(lines))
    if config.tables:
        page.say(f"The run began with the tables of {config.tables}.", warn=True)
    page.table((), list(config.versions.items()), words=True)
    page.code(config.to_yaml(), summary="run.yaml: every parameter")


def _command(shown: Shown) -> str:
    """Return the command that computes the run again."""
    config = shown.config
    try:
        base: Scenario | None = load_scenario(config.scenario.name)
    except SparseCoordError:
        base = None
    if base is not None and base.computation() | {n: 0 for n in SETTINGS} != (
        config.scenario.computation() | {n: 0 for n in SETTINGS}
    ):
        base = None  # another map of that name
    name = config.scenario.name if base is not None else "SCENARIO.yaml"
    words = ["sparse_coord", "train", name, "--learner", config.learner]
    words += ["--seed", str(config.seed)]
    for setting in SETTINGS:
        value = getattr(config.scenario, setting)
        if base is None or value != getattr(base, setting):
            words += ["--set", f"{setting}={value}"]
    command = shlex.join(words)
    return command if base is not None else f"# scenario and map: see run.yaml below\n{command}"


def results_report(shown: ResultsShown) -> str:
    """Return the page of a results directory."""
    plan = shown.plan
    page = Page(f"Results in {shown.directory.name or shown.directory}")
    page.say(
        f"{len(shown.entries)} conditions, {plan.runs} learning runs of each with the seeds "
        f"{plan.seeds[0]} to {plan.seeds[-1]}, {plan.trials} greedy episodes of each run. Report "
        f"of sparse_coord_ros {__version__}."
    )
    for what in shown.whats:
        page.heading(_title(what))
        page.figure(shown.figure(what), _title(what))
    page.heading("Every condition")
    rows = [_row(entry) for entry in shown.entries]
    head = list(dict.fromkeys(key for row in rows for key in row))
    page.table(head, [[row.get(key) or "-" for key in head] for row in rows])
    page.say("In brackets: the standard error of the mean over the runs.")
    page.heading("How to reproduce it")
    words = ["sparse_coord", "reproduce"]
    words += [entry.condition.id for entry in shown.entries]
    words += ["--out", "results", "--runs", str(plan.runs), "--trials", str(plan.trials)]
    page.code(shlex.join([*words, "--seed", str(plan.seed)]))
    return page.text()


def _title(what: str) -> str:
    return {"conditions": "Reward, miscoordinations and asks", "asks": "Where robots ask"}.get(
        what, what.replace("_", ", ")
    )


def _row(entry: Entry) -> dict[str, str | None]:
    head = {"condition": entry.condition.id, "learner": entry.title}
    return {**head, **common(entry), "shortest paths": f"{entry.shortest_paths:.2f}"}
