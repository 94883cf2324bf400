# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord optimum`: the joint optimum, fixed shortest paths, the best asking team found."""

import argparse
from dataclasses import asdict
from pathlib import Path

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.cli import pictures
from sparse_coord_ros.cli.options import (
    ALLOW,
    JSON,
    SEED,
    Option,
    allowed_with,
    scenario_of,
    scenario_options,
    tell,
)
from sparse_coord_ros.core.game.interactions import interactions_of, only_together
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.runs.measures import EXACT, Measures
from sparse_coord_ros.core.solve.asking_search import (
    RESTARTS,
    WARNING,
    check_two_robots,
    find_asking_team,
)
from sparse_coord_ros.core.solve.asking_words import in_words
from sparse_coord_ros.core.solve.optimum import (
    MOST_JOINT_STATES,
    independent_bound,
    joint_optimum,
)
from sparse_coord_ros.core.solve.shipped import (
    BOUND,
    shipped_asking_team,
    shipped_best_team,
)
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths

OF_THE_SEARCH = ("restarts", "seed", "out")

EXAMPLE = "sparse_coord optimum env1"


OPTIONS = (
    *scenario_options(),
    Option(
        "--class",
        bool,
        "search for the best asking team (two robots)",
        {"dest": "asking"},
    ),
    Option(
        "--restarts",
        RESTARTS,
        f"with --class: restarts of the search (default: {RESTARTS.default})",
        {"default": None},
    ),
    Option(
        "--seed",
        SEED,
        f"with --class: seed of the search (default: {SEED.default})",
        {"default": None},
    ),
    Option(
        "--out",
        Path,
        "with --class: JSON file that stores the search; an existing one is continued",
    ),
    ALLOW,
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    scenario = scenario_of(options)
    if options.asking:
        _search(options, scenario)
        return
    allowed_with(options, "--class", OF_THE_SEARCH)
    optimum = joint_optimum(scenario)
    bound = independent_bound(scenario)
    paths = shortest_paths(scenario)
    shipped = shipped_asking_team(scenario)
    team = shipped_best_team(scenario)
    facts = {"scenario": scenario.name, **asdict(optimum)}
    facts |= {"robots_alone": bound}
    facts |= {"shortest_paths": paths.to_dict()}
    facts |= {"best_asking_team": shipped, "best_team": team}
    known = {"exact joint optimum": "not computed: too many joint states"}
    if optimum.joint_states > MOST_JOINT_STATES:
        limit = f"more than {MOST_JOINT_STATES} joint states"
        known["exact joint optimum"] = f"not computed: {limit}"
    if optimum.exact:
        known["exact joint optimum"] = f"{optimum.value:.2f}"
    if shipped is not None:
        known["best asking team found"] = f"{shipped.value:.2f}, {WARNING}"
    if team is not None:
        known["best learned team"] = str(team)
    known[BOUND] = f"{bound:.2f}"
    known["fixed shortest paths"] = _paths_in_words(paths)
    head = f"{scenario.name}, penalty {scenario.penalty:g}, {optimum.joint_states} joint states"
    lines = [f"{name:<22} {value}" for name, value in known.items()]
    if paths.failed:
        lines.append(_horizon_in_words(scenario))
    tell(options, facts, head, *lines)


def _paths_in_words(paths: Measures) -> str:
    """Return return and miscoordinations, and how often robots do not arrive."""
    missed = paths.in_words("miscoordinations")
    text = f"{paths.in_words('returns')}, {missed} miscoordinations"
    arrive = percent(paths.mean("arrived"))
    if arrive != percent(1.0):
        text += f", all arrive in {arrive}"
    return text if paths.source == EXACT else f"{text}; {paths.how}"


def _horizon_in_words(scenario: Scenario) -> str:
    """Return which of the numbers are those of the horizon; the others are carried to infinity."""
    steps = "step" if scenario.horizon == 1 else "steps"
    within = f"within the horizon of {scenario.horizon} {steps}"
    if only_together(interactions_of(scenario)):
        return f"Miscoordinations and arrivals are counted {within}; values have no horizon."
    return f"Shortest paths are evaluated {within}; the other values have no horizon."


def _search(options: argparse.Namespace, scenario: Scenario) -> None:
    """Search for the best asking team, and print the result."""
    from sparse_coord_ros.cli.computing import Bar

    check_two_robots(scenario)
    if options.out is not None:
        pictures.check_out(options.out)
    with Bar("restarts", "searching for asking teams", quiet=options.json) as bar:
        team = find_asking_team(
            scenario,
            restarts=RESTARTS.default if options.restarts is None else options.restarts,
            seed=SEED.default if options.seed is None else options.seed,
            file=options.out,
            progress=bar.show,
        )
    lines = [
        f"{scenario.name}, penalty {scenario.penalty:g}, the best asking team found",
        f"found        {team.value:.3f}, {WARNING}",
        f"{team.agreed} of {team.restarts} restarts agree, seed {team.seed}",
    ]
    shipped = shipped_asking_team(scenario)
    if shipped is not None:
        agreed = f"{shipped.agreed} of {shipped.restarts} restarts"
        lines.append(f"shipped      {shipped.value:.3f}, {agreed}, {shipped.date}")
    lines += in_words(scenario, team.robots)
    for robot, gain in zip(scenario.robots, team.gains, strict=True):
        if gain:
            lines.append(
                f"{robot.name} alone could gain {gain:.3f} for itself: no equilibrium"
            )
    if not any(team.gains):
        lines.append(
            "no robot can gain by changing alone, as far as the search found: an equilibrium"
        )
    if options.out is not None:
        lines.append(f"written: {options.out}")
    tell(options, {"scenario": scenario.name, **asdict(team)}, *lines)
