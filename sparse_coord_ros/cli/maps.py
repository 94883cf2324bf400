# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord maps`: the shipped maps, or one of them."""

import argparse

from sparse_coord_ros.cli.options import JSON, Option, format_table, tell
from sparse_coord_ros.core.game.buildings import building
from sparse_coord_ros.core.game.grid import GridMap, load_map, map_names
from sparse_coord_ros.core.game.pose import pose_in_words
from sparse_coord_ros.core.game.scenario import load_scenario

EXAMPLE = "sparse_coord maps env1"


OPTIONS = (
    Option(
        "[name NAME]",
        None,
        "name of a map or of a generated building, or a map or scenario file",
    ),
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    grids = [
        map_of(name)
        for name in ([options.name] if options.name is not None else map_names())
    ]
    if options.name is not None:
        text = _in_words(grids[0])
    else:
        rows = [
            [
                g.name,
                str(len(g.cells)),
                str(g.doorway_count),
                str(len(g.starts)),
                g.title,
            ]
            for g in grids
        ]
        text = format_table(["map", "cells", "doorways", "starts", "title"], rows)
    tell(options, [_facts(grid) for grid in grids], text)


def _in_words(grid: GridMap) -> str:
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
    return "\n".join([*lines, "", *grid.rows])


def map_of(name: str) -> GridMap:
    """Return a map; the name may also be a scenario file or a generated building."""
    if name.endswith((".yaml", ".yml")) or building(name) is not None:
        return load_scenario(name).map
    return load_map(name)


def _facts(grid: GridMap) -> dict:
    names = ("name", "title", "source", "provenance", "rows", "resolution")
    return {
        **{name: getattr(grid, name) for name in names},
        "origin": list(grid.origin),
        "cells": len(grid.cells),
        **grid.doorway_facts,
        "starts": {digit: grid.cells[x] for digit, x in sorted(grid.starts.items())},
    }
