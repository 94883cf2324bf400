# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord import-map`: a map of map_server as a map and a scenario of this package."""

import argparse
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli.options import Option
from sparse_coord_ros.errors import MapError, SettingError, in_short
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.scenario import Robot, Scenario
from sparse_coord_ros.game.settings import Setting, parse_assignments
from sparse_coord_ros.limits import to_yaml
from sparse_coord_ros.maps.gridding import SPECK
from sparse_coord_ros.maps.image import read_floor_plan
from sparse_coord_ros.maps.plan import Place, import_map, scenario_of
from sparse_coord_ros.maps.preview import write_preview

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")

CELL = Setting("cell", float, None, "side of a cell, in metres, e.g. 0.5", 0, 1000)
RADIUS = Setting("radius", float, None, "the robot's radius, in metres, e.g. 0.2", 0, 100)
SPECK_SIZE = Setting("speck", float, SPECK, "metres up to which a spot is noise; 0: none", 0, 10)
DOORWAY_LENGTH = Setting(
    "doorway-length",
    float,
    None,
    "metres through a doorway; longer ones are corridors (default: by cell and radius)",
    0,
    1000,
)

EXAMPLE = (
    "sparse_coord export-map env1 --out env1_map && sparse_coord import-map "
    "env1_map/env1.yaml --cell 1 --radius 0.1 --start 0.5,4.5 4.5,4.5 --goal 4.5,0.5 0.5,0.5 "
    "--out imported"
)


def _place(text: str) -> Place:
    """Read X,Y in metres."""
    try:
        x, y = map(float, text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise argparse.ArgumentTypeError(
            f"{in_short(text)} is no place, allowed: X,Y in metres of the map's frame, e.g. 2,-1"
        )
    return x, y


PLACES = {"action": "extend", "default": []}

OPTIONS = (
    Option("map MAP.yaml", Path, "the YAML file of the map"),
    CELL,
    RADIUS,
    Option(
        "--start X,Y...", _place, "where the robots start, in metres of the map's frame", PLACES
    ),
    Option("--goal X,Y...", _place, "where they are to go, in the same order", PLACES),
    Option("--doorway X,Y...", _place, "places in cells that are to be doorways too", PLACES),
    Option("--no-doorway X,Y...", _place, "places in doorways that are to be none", PLACES),
    Option("--doorway-length", DOORWAY_LENGTH.parse, DOORWAY_LENGTH.help),
    SPECK_SIZE,
    shared.changes(
        "a setting of the scenario; what is not set is suggested by the map's distances"
    ),
    Option("--out", Path, "directory (default: <name>_map)"),
    Option("--replace", bool, "replace what an earlier import-map wrote there"),
    shared.JSON,
)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    if len(options.start) != len(options.goal):
        raise MapError(
            f"--start has {len(options.start)} places and --goal {len(options.goal)}; give each "
            "robot both"
        )
    robots = list(zip(options.start, options.goal, strict=True))
    given = parse_assignments(options.assignments)
    if given and not robots:
        raise SettingError("--set needs a scenario: give --start and --goal of the robots")
    name = options.map.stem
    if not NAME.fullmatch(name):
        raise MapError(
            f"name {name[:100]!r}: allowed are up to 100 letters, digits, '_', '-' and '.'; "
            "rename the file"
        )
    folder = options.out or Path(f"{name}_map")
    text, scenario_file, picture = (folder / f"{name}{end}" for end in (".txt", ".yaml", ".png"))
    _check_free(options.map, [text, scenario_file, picture], options.replace)
    plan = read_floor_plan(options.map)
    imported = import_map(
        plan,
        cell=options.cell,
        radius=options.radius,
        robots=robots,
        add=options.doorway,
        remove=options.no_doorway,
        longest=options.doorway_length,
        speck=options.speck,
    )
    grid, notes = imported.grid, list(imported.notes)
    written = {text: grid.to_text()}
    suggested: dict[str, Any] = {}
    drawn: Sequence[Robot] = ()
    if robots:
        scenario, suggested, odd = scenario_of(imported, robots, given)
        notes += odd
        drawn = scenario.robots
        written[scenario_file] = _scenario_text(scenario, given, suggested)
    else:
        notes.append("no scenario: give --start and --goal, in metres, and --replace")
    folder.mkdir(parents=True, exist_ok=True)
    for path, content in written.items():
        write_whole(path, content)
    write_preview(picture, plan, grid, drawn)
    facts = {
        "name": name,
        "rows": grid.shape[0],
        "columns": grid.shape[1],
        "cells": len(grid.cells),
        "doorways": imported.doorways,
        "parts": imported.parts,
        "resolution": grid.resolution,
        "origin": grid.origin,
        "suggested": suggested,
        "notes": notes,
        "files": [*written, picture],
    }
    if options.json:
        shared.print_json(facts)
        return 0
    x, y = grid.origin
    print(
        "{name}: {rows} x {columns}, {cells} cells of {resolution:g} m, {doorways} doorways; "
        "lower left corner at {x:g},{y:g}".format(**facts, x=x, y=y)
    )
    if suggested:
        said = ", ".join(f"{name}={value}" for name, value in suggested.items())
        print(f"settings by distance: {said}")
    print("\n".join([*(f"note: {note}" for note in notes), "written:"]), *facts["files"])
    return 0


def _check_free(source: Path, files: list[Path], replace: bool) -> None:
    for path in files:
        if path.exists() and not replace:
            raise MapError(
                f"{path}: exists already, nothing is overwritten; choose another --out, or give "
                "--replace"
            )
        if path.exists() and source.exists() and path.samefile(source):
            raise MapError(f"{source} would be overwritten; choose another --out")


def _scenario_text(scenario: Scenario, given: dict, suggested: dict) -> str:
    """Return the text of the scenario file: robots, and the settings that are no defaults."""
    place = scenario.map.cells
    robots = {
        r.name: {"start": list(place[r.start]), "goal": list(place[r.goal])}
        for r in scenario.robots
    }
    values = ((name, getattr(scenario, name)) for name in given)
    plain = {k: v if isinstance(v, bool | int | float | str) else str(v) for k, v in values}
    data = {"map": f"{scenario.map.name}.txt", "robots": robots, **plain, **suggested}
    head = "# Made by import-map; robots' places are [row, column] of the map beside this file.\n"
    return head + to_yaml(data, default_flow_style=None)
