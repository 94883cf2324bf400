# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The studies as data: conditions, how many runs of each, and the table of each study."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sparse_coord_ros.engine.batch import prepare, run_batch
from sparse_coord_ros.experiments.catalogue import CLOSE, LARGE, LONG, SMALL
from sparse_coord_ros.experiments.conditions import Condition, make_condition
from sparse_coord_ros.experiments.report.analysis import gap_closed, paired
from sparse_coord_ros.experiments.report.text import Row, percent, size, to_markdown, with_error
from sparse_coord_ros.experiments.store import ConditionResult
from sparse_coord_ros.game.buildings import Building, building_text
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn.evaluation import Measure
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.solve.optimum import independent_bound
from sparse_coord_ros.solve.reference import shortest_path_reference
from sparse_coord_ros.solve.shipped import shipped_class_bound

SEED = 950_000
"""Seed of the first run: no search has seen these."""

RULES = "tools.coordination.rules:"
MOST_COMMON = 6
"""Values of a team that the table of routes names."""

NEVER = 1e-3
"""Asks a trial below which a team counts as one that never asks."""

ONE_PAIR = (*CLOSE, "isr", "mit", "cit", "suny", "cmu")
MANY = ("env2-4r", "crowd-4r", "crowd-6r", "crowd-8r")
ROUTES: Mapping[str, float] = {
    "env2-4r": 106.63,
    "crowd-4r": 107.88,
    "crowd-6r": 105.48,
    "crowd-8r": 105.05,
}
"""At -100: a prioritised planner that sees everything for nothing, doorways banned by local search
(an earlier study's; known to be reachable with full information)."""

Found = Callable[[Condition], ConditionResult]


@dataclass(frozen=True)
class Study:
    """One study.

    Attributes:
        name: what the command line and the marks in the document call it.
        runs: learning runs of a condition of two robots, and of more.
        trials: trials of a run of more than two robots.
        conditions: what is computed.
        table: returns the table.
    """

    name: str
    runs: tuple[int, int]
    trials: int
    conditions: Sequence[Condition]
    table: Callable[[Found], str]


def _factored(name: str, settings: Mapping[str, object]) -> Condition:
    return make_condition(name, "factored", settings)


def never_asks(result: ConditionResult) -> float:
    """Return the share of the teams that hardly ever ask."""
    return float(np.mean(result.run_means("asks") < NEVER))


def failed_share(result: ConditionResult) -> float:
    """Return the share of the teams that miss in more than one trial of a thousand."""
    if result.exact is not None:
        return float(np.mean(np.array(result.exact["arrived"]) < 0.999))
    return result.failed_teams / result.runs


def _reward(result: ConditionResult) -> str:
    return with_error(result.best("reward"))


def _bound(condition: Condition) -> float | None:
    bound = shipped_class_bound(condition.scenario)
    return bound.value if bound else None


def _pairs(found: Found) -> str:
    rows: list[Row] = []
    for name in ONE_PAIR:
        own, base = _factored(name, LONG), make_condition(name, "noncoop", LONG)
        result, other = found(own), found(base)
        bound, alone = _bound(own), shortest_path_reference(own.scenario).reward
        better = max(other.best("reward").mean, alone)
        share: Measure | None = None
        if bound is not None and name in CLOSE:
            share = gap_closed(result.run_means("reward"), other.run_means("reward"), bound)
        rows.append(
            {
                "scenario": name,
                "factored": _reward(result),
                "worst team": f"{result.run_means('reward').min():.2f}",
                "asks": f"{result.best('asks').mean:.2f}",
                "never ask": percent(never_asks(result)),
                "failed teams": percent(failed_share(result)),
                "Non-coop.": _reward(other),
                "above the better baseline": f"{result.best('reward').mean - better:+.2f}",
                "class bound": None if bound is None else f"{bound:.2f}",
                "share of the gap": None
                if share is None
                else f"{percent(share.mean)} ({100 * share.standard_error:.1f})",
            }
        )
    return to_markdown(rows)


FREE: Mapping[str, object] = {**LONG, "penalty": 0}


def _fall(found: Found) -> str:
    rows: list[Row] = []
    for name in CLOSE:
        row: dict[str, str | None] = {"scenario": name}
        bounds = [_bound(_factored(name, settings)) for settings in (FREE, LONG)]
        bound = (bounds[0] or np.nan) - (bounds[1] or np.nan)
        for who in ("factored", "coop", "noncoop"):
            first, last = (found(make_condition(name, who, settings)) for settings in (FREE, LONG))
            fall = paired(first.run_means("reward") - last.run_means("reward"))
            row[f"{who} falls by"] = with_error(fall)
            if who == "factored":
                row["class bound falls by"] = f"{bound:.2f}"
                row["times as much"] = f"{fall.mean / bound:.2f}"
        rows.append(row)
    return to_markdown(rows)


def _paper(found: Found) -> str:
    rows: list[Row] = []
    for name in SMALL + LARGE:
        result, coop, base = (
            found(make_condition(name, learner, {"penalty": -20}))
            for learner in ("factored", "coop", "noncoop")
        )
        scenario = make_condition(name, "coop", {"penalty": -20}).scenario
        better = max(base.best("reward").mean, shortest_path_reference(scenario).reward)
        bound = shipped_class_bound(scenario)
        rows.append(
            {
                "scenario": name,
                "factored": _reward(result),
                "asks": f"{result.best('asks').mean:.2f}",
                "miscoordinations": f"{result.best('miscoordinations').mean:.2f}",
                "failed teams": percent(failed_share(result)),
                "coop": _reward(coop),
                "better baseline": f"{better:.2f}",
                "class bound": f"{bound.value:.2f}" if bound else None,
                "the paper's Coop.": f"{scenario.paper['coop']['reward'][0]:.1f}",
            }
        )
    return to_markdown(rows)


def _many(found: Found) -> str:
    rows: list[Row] = []
    for name in MANY:
        result, coop, base = (
            found(make_condition(name, learner, LONG))
            for learner in ("factored", "coop", "noncoop")
        )
        rows.append(
            {
                "scenario": name,
                "factored": _reward(result),
                "asks": f"{result.best('asks').mean:.2f}",
                "miscoordinations": f"{result.best('miscoordinations').mean:.3f}",
                "trials in which all arrive": percent(result.arrived, 2),
                "failed teams": percent(failed_share(result)),
                "coop": _reward(coop),
                "Non-coop.": _reward(base),
                "planner with routes": f"{ROUTES[name]:.2f}",
                "bytes of rho": size(result.visited_bytes),
            }
        )
    return to_markdown(rows)


def _routes(found: Found) -> str:
    condition = _factored("env2-2r", LONG)
    worth = np.round(found(condition).run_means("reward"), 2)
    values, counts = np.unique(worth, return_counts=True)
    rows = [
        {"worth": f"{values[i]:.2f}", "teams": percent(counts[i] / len(worth), 1)}
        for i in sorted(np.argsort(-counts, kind="stable")[:MOST_COMMON], key=lambda i: -values[i])
    ]
    rest = 1.0 - sum(np.sort(counts)[-MOST_COMMON:]) / len(worth)
    return to_markdown([*rows, {"worth": "others", "teams": percent(float(rest), 1)}])


def _fewer(found: Found) -> str:
    """Return how many of the peers that are asked could change anything; learned on the spot."""
    rows: list[Row] = []
    for name in MANY:
        scenario = _factored(name, LONG).scenario
        asks = useful = 0.0
        for run in run_batch(scenario, "factored", range(SEED, SEED + 10), trials=300, jobs=1):
            assert run.trials is not None
            for tables, asked in zip(run.tables, run.trials.asked, strict=True):
                assert tables.factors is not None
                pairs = {(x, peer) for x, peer, _ in tables.factors.states.tolist() if peer >= 0}
                asks += asked.sum()
                useful += sum(asked[x] for x, _ in pairs)
        rows.append(
            {
                "scenario": name,
                "peers asked": str(len(scenario.robots) - 1),
                "of these with a correction in that cell": f"{useful / asks:.2f}",
            }
        )
    return to_markdown(rows)


ABLATED: Mapping[str, str] = {
    "all of it": "factored",
    "no learning from being asked": RULES + "NotToldByRequests",
    "no percept update of r_bar": RULES + "NoPerceptUpdate",
    "no right of way (more than two robots)": RULES + "NoRightOfWay",
    "no replay": RULES + "NoReplay",
    "five replays": RULES + "FiveReplays",
}
PROTOCOLS: Mapping[str, Mapping[str, object]] = {
    "U begins at 0, not at 200": {"q_coord_init": 0},
    "starts: never exploring": {"starts": "fixed"},
    "starts: 10 % exploring at the end": {"starts": "exploring:1:0.1:0.5"},
}
ABLATION = (*CLOSE, "env2-4r", "crowd-8r", "cmu")


def _varied(name: str) -> Mapping[str, Condition]:
    """Return a scenario's conditions of the ablation."""
    given = {"penalty": -20} if name == "cmu" else LONG
    rules = {text: make_condition(name, rule, given) for text, rule in ABLATED.items()}
    protocols = {text: _factored(name, {**given, **more}) for text, more in PROTOCOLS.items()}
    blind = {}
    if name in MANY:
        blind["r^C whoever it was (referee: off)"] = _factored(name, {**given, "referee": "off"})
    return rules | protocols | blind


def _ablation(found: Found) -> str:
    by_name = {name: _varied(name) for name in ABLATION}
    rows: list[Row] = []
    for text in dict.fromkeys(text for varied in by_name.values() for text in varied):
        row: dict[str, str | None] = {"what": text}
        for name, varied in by_name.items():
            head = f"{name} at -20" if name == "cmu" else name
            row[head] = None
            if text in varied:
                result = found(varied[text])
                failed = failed_share(result)
                row[head] = _reward(result) + (f", {failed:.0%} fail" if failed else "")
        rows.append(row)
    return to_markdown(rows)


CREDITS: Mapping[str, tuple[str, ...]] = {
    "env1": ("own", "weight:1.5", "team"),
    "env2-2r": ("own", "weight:1.5", "team"),
    "pentagon": ("own", "weight:1.5", "team"),
    "env2-4r": ("own", "weight:2", "team"),
    "crowd-6r": ("own", "weight:2", "team"),
    "crowd-8r": ("own", "weight:2", "team"),
}


def _credit_conditions() -> list[Condition]:
    return [
        _factored(name, {**LONG, "penalty": penalty, "credit": credit})
        for name, credits in CREDITS.items()
        for penalty in (-20, -100)
        for credit in credits
    ]


def _credit(found: Found) -> str:
    rows: list[Row] = []
    for name, credits in CREDITS.items():
        for penalty in (-20, -100):
            row: dict[str, str | None] = {"scenario": name, "penalty": str(penalty)}
            for credit in credits:
                result = found(_factored(name, {**LONG, "penalty": penalty, "credit": credit}))
                failed = failed_share(result)
                head = credit if credit in ("own", "team") else "in between (1.5; 2)"
                row[head] = _reward(result) + (f", {failed:.0%} fail" if failed else "")
            rows.append(row)
    return to_markdown(rows)


PERCEPTS: Mapping[str, Mapping[str, object]] = {
    "the paper's steps": {"penalty": -100},
    "percepts succeed 3 times of 4": {**LONG, "perception": "probability:0.75"},
    "percepts succeed half of the time": {**LONG, "perception": "probability:0.5"},
    "line of sight": {**LONG, "perception": "line_of_sight"},
    "within 2 cells": {**LONG, "perception": "range:2"},
    "within 1 cell": {**LONG, "perception": "range:1"},
    "r^C 1 : 0.5": {**LONG, "common_reward": "each:1:0.5"},
    "r^C 1 : 0": {**LONG, "common_reward": "each:1:0"},
    "r^C 2 : 0": {**LONG, "common_reward": "each:2:0"},
    "asking costs 0": {**LONG, "ask_cost": 0},
    "asking costs 5": {**LONG, "ask_cost": 5},
}


PAPERS = "env1"
"""Where the paper's learner is computed beside it."""


def _percepts(found: Found) -> str:
    rows: list[Row] = []
    for text, settings in PERCEPTS.items():
        row: dict[str, str | None] = {"what": text}
        for name in CLOSE:
            result = found(_factored(name, settings))
            failed = failed_share(result)
            row[name] = _reward(result) + (f", {failed:.0%} fail" if failed else "")
        row[f"{PAPERS}, coop"] = _reward(found(make_condition(PAPERS, "coop", settings)))
        rows.append(row)
    return to_markdown(rows)


JOINT = RULES + "JointState"
"""Learns the full joint state, which it sees for nothing; it fits for two robots."""

ROBOTS = (2, 4, 8, 16)
BUILDINGS = ({"seed": 0}, {"seed": 1}, {"seed": 2}, {"rooms": 4, "size": 5, "seed": 0})


def buildings(folder: Path) -> dict[int, list[str]]:
    """Write the buildings of the study of scale as scenario files; return them by their robots."""
    folder.mkdir(parents=True, exist_ok=True)
    made: dict[int, list[str]] = {}
    for robots in ROBOTS:
        for numbers in BUILDINGS:
            building = Building(**numbers, robots=robots)
            name = f"{building.rooms}x{building.rows}x{building.size}-{robots}r-{building.seed}"
            path = folder / f"building-{name}.yaml"
            path.write_text(building_text(building), encoding="utf-8")
            made.setdefault(robots, []).append(str(path))
    return made


def scale(folder: Path) -> Study:
    """Return the study of scale, its buildings written into a folder."""
    made = buildings(folder)
    given = {"penalty": -100}
    joint = [make_condition(path, JOINT, {**given, "ask_cost": 0}) for path in made[2]]
    learners = ("factored", "coop", "noncoop")
    by_robots = {
        robots: [[make_condition(path, who, given) for who in learners] for path in paths]
        for robots, paths in made.items()
    }

    def table(found: Found) -> str:
        rows = []
        for robots, own in by_robots.items():
            factored, coop, base = (
                [found(one) for one in some] for some in zip(*own, strict=True)
            )
            scenarios = [some[0].scenario for some in own]
            bound = np.mean([independent_bound(one) for one in scenarios])
            fixed = [8 * len(one.map.cells) * (2 * 4 + 1) for one in scenarios]
            spent = [learning_seconds(one) for one in scenarios]
            rows.append(
                {
                    "robots": str(robots),
                    "factored": _pooled(factored),
                    "robots alone (bound)": f"{bound:.2f}",
                    "coop": _pooled(coop),
                    "Non-coop.": _pooled(base),
                    "full joint state": _pooled([found(c) for c in joint])
                    if robots == 2
                    else None,
                    "asks": f"{np.mean([r.best('asks').mean for r in factored]):.2f}",
                    "miscoordinations": _mean(factored, "miscoordinations"),
                    "trials in which all arrive": percent(_arrived(factored), 2),
                    "of coop's": percent(_arrived(coop), 2),
                    "of Non-coop.'s": percent(_arrived(base), 2),
                    "of the full joint state's": (
                        percent(_arrived([found(c) for c in joint]), 2) if robots == 2 else None
                    ),
                    "bytes a robot": size(
                        float(np.mean([r.visited_bytes for r in factored]) + np.mean(fixed))
                    ),
                    "seconds to learn": f"{np.mean(spent):.2f}",
                }
            )
        return to_markdown(rows)

    everything = [one for own in by_robots.values() for some in own for one in some] + joint
    return Study("scale", (10, 10), 300, everything, table)


def _pooled(results: Sequence[ConditionResult]) -> str:
    """Return mean and standard error over the runs of several buildings, each by itself."""
    measures = [result.best("reward") for result in results]
    error = np.sqrt(sum(one.standard_error**2 for one in measures)) / len(measures)
    return f"{np.mean([one.mean for one in measures]):.2f} ({error:.2f})"


def _mean(results: Sequence[ConditionResult], name: str) -> str:
    return f"{np.mean([result.best(name).mean for result in results]):.3f}"


def _arrived(results: Sequence[ConditionResult]) -> float:
    return float(np.mean([result.arrived for result in results]))


def learning_seconds(scenario: Scenario) -> float:
    """Return the seconds of processor time of one learning run of the factored learner."""
    scenario = learner_of("factored").with_defaults(scenario)
    prepare(scenario, "factored")
    began = time.process_time()
    list(run_batch(scenario, "factored", [SEED], trials=0, jobs=1))
    return time.process_time() - began


STUDIES: tuple[Study, ...] = (
    Study(
        "pairs",
        (200, 100),
        2,
        [make_condition(n, who, LONG) for n in ONE_PAIR for who in ("factored", "noncoop")],
        _pairs,
    ),
    Study(
        "fall",
        (200, 100),
        2,
        [
            make_condition(name, who, settings)
            for name in CLOSE
            for who in ("factored", "coop", "noncoop")
            for settings in (FREE, LONG)
        ],
        _fall,
    ),
    Study(
        "many",
        (200, 100),
        300,
        [make_condition(n, who, LONG) for n in MANY for who in ("factored", "coop", "noncoop")],
        _many,
    ),
    Study(
        "paper",
        (200, 100),
        1000,
        [
            make_condition(n, who, {"penalty": -20})
            for n in SMALL + LARGE
            for who in ("factored", "coop", "noncoop")
        ],
        _paper,
    ),
    Study(
        "ablation",
        (40, 16),
        200,
        [one for name in ABLATION for one in _varied(name).values()],
        _ablation,
    ),
    Study("routes", (200, 100), 2, [_factored("env2-2r", LONG)], _routes),
    Study("fewer", (10, 10), 300, [], _fewer),
    Study("credit", (40, 16), 200, _credit_conditions(), _credit),
    Study(
        "percepts",
        (40, 16),
        200,
        [
            make_condition(name, who, settings)
            for settings in PERCEPTS.values()
            for name, who in (*((name, "factored") for name in CLOSE), (PAPERS, "coop"))
        ],
        _percepts,
    ),
)
