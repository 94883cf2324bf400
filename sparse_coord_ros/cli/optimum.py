# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord optimum`: the exact joint optimum of a scenario, and fixed shortest paths."""

import argparse
from dataclasses import asdict

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.core.optimum import LARGEST, independent_bound, joint_optimum
from sparse_coord_ros.core.reference import shortest_path_reference


def add_parser(verbs) -> None:
    """Add the verb."""
    parser = shared.add_verb(
        verbs,
        "optimum",
        example="sparse_coord optimum env1 --penalty -100",
    )
    shared.add_scenario(parser)
    shared.add_json(parser)
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    scenario = shared.scenario_of(options)
    optimum = joint_optimum(scenario)
    bound = independent_bound(scenario)
    paths = shortest_path_reference(scenario)
    if options.json:
        found = {"scenario": scenario.name, **asdict(optimum), "robots_alone": bound}
        shared.print_json({**found, "shortest_paths": asdict(paths)})
        return 0
    print(f"{scenario.name}, penalty {scenario.penalty:g}, {optimum.joint_states} joint states")
    if optimum.exact:
        print(f"exact joint optimum  {optimum.value:.2f}")
    else:
        print(f"exact joint optimum  not computed: more than {LARGEST} joint states")
    print(f"bound (robots alone) {bound:.2f}")
    print(
        f"fixed shortest paths {paths.reward:.2f}, {paths.miscoordinations:.2f} miscoordinations"
    )
    return 0
