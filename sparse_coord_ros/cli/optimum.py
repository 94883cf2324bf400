# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord optimum`: the exact joint optimum, fixed shortest paths, and the class bound."""

import argparse
from dataclasses import asdict
from pathlib import Path

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli import pictures
from sparse_coord_ros.cli.options import SEED, Option
from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.solve.class_search import (
    RESTARTS,
    WARNING,
    check_class,
    class_bound,
    in_words,
)
from sparse_coord_ros.solve.optimum import LARGEST, independent_bound, joint_optimum
from sparse_coord_ros.solve.reference import shortest_path_reference
from sparse_coord_ros.solve.shipped import shipped_best_team, shipped_class_bound, shipped_routes
from sparse_coord_ros.solve.simdp import PLANNERS, sparse_plan

OF_THE_SEARCH = ("restarts", "seed", "out")

EXAMPLE = "sparse_coord optimum env1 --penalty -100"


OPTIONS = (
    *shared.scenario_options(),
    Option(
        "--class",
        bool,
        "search for the best team of two robots that has Algorithm 1's form",
        {"dest": "class_bound"},
    ),
    Option("--simdp", bool, "also plan for two robots that see each other only near doorways"),
    Option("--restarts", RESTARTS.parse, f"with --class (default: {RESTARTS.default})"),
    Option("--seed", SEED.parse, f"with --class: seed of the search (default: {SEED.default})"),
    Option("--out", Path, "with --class: a JSON file to keep the search in, and to go on from"),
    shared.JSON,
)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    scenario = shared.scenario_of(options)
    if options.class_bound:
        return _class_bound(options, scenario)
    for name in OF_THE_SEARCH:
        if getattr(options, name) is not None:
            raise SettingError(f"--{name} is of the search for the class bound; add --class")
    optimum = joint_optimum(scenario)
    bound = independent_bound(scenario)
    paths = shortest_path_reference(scenario)
    shipped, team = shipped_class_bound(scenario), shipped_best_team(scenario)
    routes = shipped_routes(scenario)
    planned = {one: sparse_plan(scenario, one) for one in PLANNERS if options.simdp}
    if options.json:
        known = {"class_bound": shipped, "best_team": team, "route_planner": routes}
        facts = {"scenario": scenario.name, **asdict(optimum), "robots_alone": bound}
        facts["shortest_paths"] = paths
        if planned:
            facts["dec_simdp"] = {name: plan._asdict() for name, plan in planned.items()}
        shared.print_json({**facts, **known})
        return 0
    print(f"{scenario.name}, penalty {scenario.penalty:g}, {optimum.joint_states} joint states")
    if optimum.exact:
        print(f"exact joint optimum  {optimum.value:.2f}")
    else:
        print(f"exact joint optimum  not computed: more than {LARGEST} joint states")
    if shipped is not None:
        print(f"class bound          {shipped.value:.2f}, {WARNING}")
    if team is not None:
        print(f"best learned team    {team}")
    if routes is not None:
        told = f"{routes.value:.2f} ({routes.standard_error:.2f})"
        print(f"route planner        {told}, sees everything for nothing")
    for name, plan in planned.items():
        told = f"{plan.value:.2f} ({plan.standard_error:.2f})"
        print(f"Dec-SIMDP, {name:<9} {told}, {plan.priced:.2f} if looking costs what asking does")
    print(f"bound (robots alone) {bound:.2f}")
    print(
        f"fixed shortest paths {paths.reward:.2f}, {paths.miscoordinations:.2f} miscoordinations"
    )
    return 0


def _class_bound(options: argparse.Namespace, scenario: Scenario) -> int:
    """Search for the class bound, and say what was found."""
    from sparse_coord_ros.cli.computing import Bar

    check_class(scenario)
    if options.out is not None:
        pictures.check_out(options.out)

    bar = Bar("restarts", quiet=options.json)
    with bar:
        found = class_bound(
            scenario,
            restarts=RESTARTS.default if options.restarts is None else options.restarts,
            seed=SEED.default if options.seed is None else options.seed,
            file=options.out,
            progress=lambda done, of, best: bar.show(done, of, f"best {best:.4f}"),
        )
    if options.json:
        shared.print_json({"scenario": scenario.name, **asdict(found)})
        return 0
    print(f"{scenario.name}, penalty {scenario.penalty:g}, the best team of Algorithm 1's form")
    print(f"class bound  {found.value:.3f}, {WARNING}")
    print(f"{found.agreed} of {found.restarts} restarts agree, seed {found.seed}")
    shipped = shipped_class_bound(scenario)
    if shipped is not None:
        print(
            f"shipped      {shipped.value:.3f}, {shipped.agreed} of {shipped.restarts} restarts, "
            f"{shipped.date}"
        )
    print("\n".join(in_words(scenario, found.robots)))
    for robot, gain in zip(scenario.robots, found.gains, strict=True):
        if gain:
            print(f"{robot.name} alone could gain {gain:.3f} for itself: no equilibrium")
    if not any(found.gains):
        print("no robot was found to gain by changing alone: an equilibrium, as far as known")
    if options.out is not None:
        print(f"written: {options.out}")
    return 0
