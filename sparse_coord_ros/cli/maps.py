# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord maps`: the maps that the package ships, or one of them."""

import argparse

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli.options import Option
from sparse_coord_ros.game.buildings import building
from sparse_coord_ros.game.grid import GridMap, load_map, map_names
from sparse_coord_ros.game.scenario import load_scenario

EXAMPLE = "sparse_coord maps env1"


OPTIONS = (
    Option("[name NAME]", None, "a map's, a generated building's, or a map or scenario file"),
    shared.JSON,
)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
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
    """Return a map; that of a scenario file or of a generated building too."""
    if name.endswith((".yaml", ".yml")) or building(name) is not None:
        return load_scenario(name).map
    return load_map(name)


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
