# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord maps`: the maps that the package ships, or one of them."""

import argparse
from pathlib import Path

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli.options import Option
from sparse_coord_ros.errors import ScenarioError, SettingError
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.buildings import SIZES, Building, building_text
from sparse_coord_ros.game.grid import GridMap, load_map, map_names
from sparse_coord_ros.game.scenario import load_scenario

EXAMPLE = "sparse_coord maps env1"


OPTIONS = (
    Option("name NAME", None, "a map's name, a map file, or a scenario file", {"nargs": "?"}),
    Option(
        "--generate FILE",
        Path,
        "write a scenario on a generated building: rooms, corridors, doorways, robots",
    ),
    *(
        Option(f"--{name} N", None, f"{one.help} (with --generate; default: {one.default})")
        for name, one in SIZES.items()
    ),
    shared.JSON,
)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    numbers = {name: getattr(options, name) for name in SIZES}
    numbers = {name: value for name, value in numbers.items() if value is not None}
    if options.generate is not None:
        if options.name:
            raise SettingError(
                f"map {options.name!r}: is not needed with --generate; leave it out"
            )
        return _generate(options.generate, Building(**numbers), as_json=options.json)
    if numbers:
        raise SettingError(f"option --{next(iter(numbers))}: only with --generate FILE; add it")
    grids = [map_of(name) for name in ([options.name] if options.name else map_names())]
    if options.json:
        shared.print_json([_facts(grid) for grid in grids])
    elif options.name:
        grid = grids[0]
        height, width = grid.shape
        print(f"{grid.name}: {grid.title}\nsource: {grid.source}\nprovenance: {grid.provenance}")
        print(f"{height} x {width}, {len(grid.cells)} cells, {len(grid.doorways)} doorways")
        if grid.resolution is not None:
            x, y = grid.origin
            print(f"{grid.resolution:g} m a cell, lower left corner at {x:g},{y:g} m")
        print()
        print("\n".join(grid.rows))
    else:
        rows = [
            [g.name, str(len(g.cells)), str(len(g.doorways)), str(len(g.starts)), g.title]
            for g in grids
        ]
        print(shared.format_table(["map", "cells", "doorways", "starts", "title"], rows))
    return 0


def map_of(name: str) -> GridMap:
    """Return a map; that of a scenario file too."""
    return load_scenario(name).map if name.endswith((".yaml", ".yml")) else load_map(name)


def _generate(path: Path, building: Building, *, as_json: bool) -> int:
    """Write a building's scenario file, and show its map."""
    if path.exists():
        raise ScenarioError(f"{path}: exists already; choose another file, or remove it")
    write_whole(path, building_text(building))
    grid = load_scenario(str(path)).map
    if as_json:
        shared.print_json({"file": str(path), **_facts(grid)})
    else:
        print("\n".join([f"{path}: {grid.title}", "", *grid.rows]))
    return 0


def _facts(grid: GridMap) -> dict:
    return {
        "name": grid.name,
        "title": grid.title,
        "source": grid.source,
        "provenance": grid.provenance,
        "rows": list(grid.rows),
        "cells": len(grid.cells),
        "doorways": [list(grid.cells[x]) for x in sorted(grid.doorways)],
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "starts": {digit: list(grid.cells[x]) for digit, x in sorted(grid.starts.items())},
    }
