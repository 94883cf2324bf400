# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord maps`: the shipped maps and scenarios, or one of them."""

import argparse
from pathlib import Path

from sparse_coord_ros.base.errors import MapError, did_you_mean
from sparse_coord_ros.cli.options import JSON, Option, format_table, tell
from sparse_coord_ros.core.game.buildings import building
from sparse_coord_ros.core.game.grid import GridMap, load_map, map_names
from sparse_coord_ros.core.game.pose import pose_in_words
from sparse_coord_ros.core.game.scenario import (
    Scenario,
    load_scenario,
    scenario_names,
    scenarios_by_map,
)

EXAMPLE = "sparse_coord maps\n  sparse_coord maps env1"


OPTIONS = (
    Option(
        "[name NAME]",
        None,
        "name of a scenario, a map or a generated building, or a scenario or map file",
        {"names": lambda: sorted({*scenario_names(), *map_names()})},
    ),
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    if options.name is None:
        _list(options)
        return
    known = (*scenario_names(), *map_names())
    name = options.name
    if not (name in known or building(name) or Path(name).exists()):
        raise MapError(
            f"map {name!r}: no such scenario or map{did_you_mean(name, known)}; give the path of "
            "a file, or a name that 'sparse_coord maps' lists"
        )
    scenario = _scenario_of(name)
    grid = load_map(name) if scenario is None else scenario.map
    facts = _facts(grid)
    lines = _in_words(grid)
    if scenario is not None:
        robots = scenario.to_dict()["robots"]
        facts |= {"scenario": scenario.name, "robots": robots}
        lines.append("")
        for name, cells in robots.items():
            lines.append(f"{name}: from {cells['start']} to {cells['goal']}")
    tell(options, [facts], *lines)


def _list(options: argparse.Namespace) -> None:
    """List the shipped maps, and the scenarios on each."""
    facts = []
    rows = []
    on_map = scenarios_by_map()
    for name in map_names():
        grid = load_map(name)
        scenarios = on_map.get(name, [])
        facts.append({**_facts(grid), "scenarios": scenarios})
        counts = [len(grid.cells), grid.doorway_count, len(grid.starts)]
        rows.append([name, *map(str, counts), ", ".join(scenarios), grid.title])
    head = ["map", "cells", "doorways", "starts", "scenarios", "title"]
    tell(
        options,
        facts,
        format_table(head, rows),
        "\nA scenario is a map with robots: sparse_coord train SCENARIO. Generated buildings are "
        "scenarios, too,\nsuch as building-3x2x4-16r-0 and unseen1-door-2r-3.",
    )


def _scenario_of(name: str) -> Scenario | None:
    """Return the scenario of this name or file; None: it is a map.

    A name of both, such as env1, stands for the scenario.
    """
    is_file = name.endswith((".yaml", ".yml"))
    if is_file or name in scenario_names() or building(name) is not None:
        return load_scenario(name)
    return None


def _in_words(grid: GridMap) -> list[str]:
    (height, width) = grid.shape
    lines = [f"{grid.name}: {grid.title}", f"source: {grid.source}"]
    lines.append(f"provenance: {grid.provenance}")
    lines.append(
        f"{height} x {width}, {len(grid.cells)} cells, {grid.doorways_in_words}"
    )
    if grid.resolution is not None:
        lines.append(
            f"{grid.resolution:g} m a cell, lower left corner at "
            f"{pose_in_words(grid.origin)}"
        )
    return [*lines, "", *grid.rows]


def _facts(grid: GridMap) -> dict:
    names = ("name", "title", "source", "provenance", "rows", "resolution")
    return {
        **{name: getattr(grid, name) for name in names},
        "origin": list(grid.origin),
        "cells": len(grid.cells),
        **grid.doorway_facts,
        "starts": {digit: grid.cells[x] for digit, x in sorted(grid.starts.items())},
    }
