# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The HTML report of a run: its learned policy, its value, its faults."""

import contextlib
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator

import numpy as np

from sparse_coord_ros.base.errors import SparseCoordError
from sparse_coord_ros.base.palette import ANSWERED
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.game.plugins import leaving_out
from sparse_coord_ros.core.game.scenario import SETTINGS, Scenario, load_scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.evaluation import Evaluation, with_spread
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.core.solve.exact import ExactEvaluation, evaluate_best
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.core.solve.shipped import yardsticks
from sparse_coord_ros.core.solve.verdict import last_word
from sparse_coord_ros.log.runlog.explain import Coordination, explained, in_words
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.show import figures
from sparse_coord_ros.show.html import Part, code, page, picture, table, text
from sparse_coord_ros.show.sources import PLAYED_EPISODES, OpenedRun
from sparse_coord_ros.show.steps import ended

REPORT_TRIALS = 1000
BASELINES = ("indiv", "noncoop")
MOST_WARNINGS = 20
WARNING_LEVEL = 30
"""Level of a warning in rcl_interfaces/Log."""

RUN_CAPTIONS = {
    "policy": "Greedy moves in the cells where the robot has learned. Ring: it asks there "
    "before it moves. Pale: it never visits that cell in greedy episodes.",
    "asks": f"Where robots ask in {PLAYED_EPISODES} greedy episodes from the scenario's starts.",
    "sparsity": "How much of Q^C was ever learned, by the robot's own cell.",
    "curves": "Learning curves: each dot an episode, each line a running mean.",
    "percepts": "How often robots asked while they learned, and how it ended.",
}


def run_report(shown: OpenedRun, *, baselines: bool = True) -> str:
    """Return the page of a run.

    Args:
        shown: the run.
        baselines: whether to let Indiv. and Non-coop. learn the same scenario, for comparison.

    Raises:
        SparseCoordError: the source is not a run.
    """
    config = shown.config
    scenario = shown.config.scenario
    sections: dict[str, Iterable[Part]] = {"": _begin(shown)}
    sections["The return of the team"] = _value(shown, baselines)
    sections["What was learned"] = _learned(shown)
    if shown.bag is not None:
        sections["Some questions and answers"] = _dialogue(shown)
        sections["Faults and diagnostics"] = faults(shown)
    sections["Scenario"] = _scenario(scenario)
    sections["How to reproduce it"] = _again(shown)
    return page(f"{scenario.name}: {config.title}, seed {config.seed}", sections)


def _begin(shown: OpenedRun) -> Iterator[Part]:
    scenario = shown.config.scenario
    yield text(
        f"{len(scenario.robots)} robots, {scenario.steps} steps of learning, penalty "
        f"{scenario.penalty:g} for a miscoordination, {scenario.ask_cost:g} for asking. "
        f"From {shown.path}; report of sparse_coord_ros {__version__}."
    )
    if shown.bag is not None and shown.log.losses:
        yield text(
            f"The bag is damaged. Lost: {'; '.join(shown.log.losses)}.", warn=True
        )


def _value(shown: OpenedRun, baselines: bool) -> Iterator[Part]:
    config = shown.config
    scenario = shown.config.scenario
    rows: list[list[str]] = []
    missing: list[str] = []
    if shown.has("tables"):
        shown.say("evaluating")
        with leaving_out("the value of this team", missing.append):
            found = evaluate_best(
                scenario, shown.tables, trials=REPORT_TRIALS, learner=config.rule
            )
            rows.append(_measures("this team", found))
            yield text(last_word(scenario, config.rule, found).text)
    else:
        yield text("There are no learned tables to evaluate.", warn=True)
    others = [learner_of(name) for name in BASELINES if name != config.learner]
    for rule in others if baselines else []:
        shown.say(f"learning {rule.title}, to compare")
        with leaving_out(f"{rule.title} to compare", missing.append):
            learned = train(scenario, rule, config.seed)
            found = evaluate_best(
                scenario, learned.tables, trials=REPORT_TRIALS, learner=rule
            )
            rows.append(_measures(f"{rule.title}, same seed", found))
    for words in missing:
        shown.say(words)
        yield text(words, warn=True)
    paths = shortest_path_reference(scenario)
    measures = (
        paths.measure_in_words("returns"),
        paths.measure_in_words("time_to_goal"),
        paths.measure_in_words("miscoordinations", 3),
    )
    arrive = percent(paths.all_arrived)
    rows.append(["fixed shortest paths", *measures, "0", arrive])
    rows += [[name, f"{value:.2f}", *"----"] for name, value in yardsticks(scenario)]
    yield table(
        ["team", "return", "time to goal", "miscoordinations", "asks", "all arrive"],
        rows,
    )
    yield text(
        "Return of a robot (total discounted reward of an episode), steps to the goal, "
        "miscoordinations of an episode, asks "
        "of a robot; ± is the spread over robots and episodes, s.e. the standard error of a mean "
        "of trials. Best asking team found: the best result of a search among robots that learn "
        "each other's position only by asking. Joint optimum: one controller sees all robots all "
        "the time, for free."
    )


def _measures(name: str, found: Evaluation | ExactEvaluation) -> list[str]:
    """Return the table row of a team."""
    spread = [(found.returns, 2), (found.time_to_goal, 2), (found.miscoordinations, 3)]
    measures = [with_spread(one, digits) for one, digits in spread]
    measures += [f"{found.asks.mean:.2f}", percent(found.all_arrived)]
    return [f"{name}, {found.how}", *measures]


def _learned(shown: OpenedRun) -> Iterator[Part]:
    whats = figures.available(shown)
    if not whats:
        yield text("There are neither tables nor a history to draw.", warn=True)
    for what in whats:
        shown.say(f"drawing {what}")
        yield picture(figures.runs_figure([shown], [what]), RUN_CAPTIONS[what])


def _dialogue(shown: OpenedRun) -> Iterator[Part]:
    shown.say("following the dialogue")
    samples = sorted(set(_samples(shown.log)))
    log = shown.with_requests({step for _, step in samples})
    if shown.config.known_rule is None:
        yield text(
            "The learner's code was not imported: questions and answers are shown, their "
            "reasons are not.",
            warn=True,
        )
    told: list[Coordination] = []
    for k in range(len(log.names)):
        told += explained(log, k, [step for robot, step in samples if robot == k])
    if not told:
        yield text("The log holds no question.")
    for one in sorted(told, key=lambda one: (one.step, one.robot)):
        yield code("\n".join(in_words(log, one)))


def _samples(log: RunLog) -> Iterator[tuple[int, int]]:
    """Yield robot and time step of questions: the first of each outcome, and the last answered."""
    for name, found in ended(log).items():
        places = np.argwhere(found)
        for row, k in [*places[:1], *places[-1:]] if name == ANSWERED else places[:1]:
            yield int(k), int(log.step[row])


def faults(shown: OpenedRun) -> Iterator[Part]:
    """Yield the faults of a recorded run: percepts, messages, warnings of nodes."""
    log = shown.log
    facts: dict[str, object] = {
        f"questions {how}": at.sum() for how, at in ended(log).items()
    }
    if log.messages.statuses:
        last = log.messages.statuses[-1]
        facts |= {"state at the end": last.state, "transitions": last.transitions}
        facts["time steps that the world made without a robot"] = last.left_out
    facts["unusual messages"] = len(log.problems)
    yield table((), list(facts.items()))
    for problem in log.problems[:MOST_WARNINGS]:
        yield text(str(problem), warn=True)
    said = [one for one in log.messages.rosout if one.level >= WARNING_LEVEL]
    warnings = Counter(f"{one.name}: {one.msg}"[:300] for one in said)
    listed = table(["warning", "times"], list(warnings.items())[:MOST_WARNINGS])
    yield listed if warnings else text("No node logged a warning.")
    yield text("'sparse_coord verify' checks the log bit for bit.")


def _scenario(scenario: Scenario) -> Iterator[Part]:
    grid = scenario.map
    yield text(f"Map {grid.name}: {grid.title}".rstrip(": "))
    if grid.provenance:
        yield text(f"Provenance: {grid.provenance}")
    yield code("\n".join(grid.rows))
    at = [list(cell) for cell in grid.cells]
    places = [
        (robot.name, at[robot.start], at[robot.goal]) for robot in scenario.robots
    ]
    yield table(
        ["robot", "start [row, column]", "goal [row, column]"], places, words=True
    )


def _again(shown: OpenedRun) -> Iterator[Part]:
    config = shown.config
    verify = ""
    if shown.bag is not None:
        verify = f"\nsparse_coord verify {shlex.quote(str(shown.bag))}"
    yield code(_command(config) + verify)
    if config.tables:
        yield text(f"The run began with the tables of {config.tables}.", warn=True)
    yield table((), list(config.versions.items()), words=True)
    yield code(config.to_yaml(), summary="run.yaml: every parameter")


def _command(config: RunConfig) -> str:
    """Return the command that computes the run again."""
    scenario = config.scenario
    base = None
    with contextlib.suppress(SparseCoordError):  # a scenario made by hand has no name
        known = load_scenario(scenario.name)
        base = (
            known
            if (known.map, known.robots) == (scenario.map, scenario.robots)
            else None
        )
    words = [
        "sparse_coord",
        "train",
        "SCENARIO.yaml" if base is None else scenario.name,
    ]
    words += ["--learner", config.learner, "--seed", str(config.seed)]
    for name in SETTINGS:
        value = getattr(scenario, name)
        words += (
            [] if value == getattr(base, name, None) else ["--set", f"{name}={value}"]
        )
    comment = "# scenario and map: see run.yaml below\n" if base is None else ""
    return comment + shlex.join(words)
