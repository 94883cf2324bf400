# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord import-map`: a map of map_server as a map and a scenario of this package."""

import argparse
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.errors import MapError, SettingError
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.scenario import Robot, Scenario
from sparse_coord_ros.game.settings import parse_assignments
from sparse_coord_ros.maps.gridding import SPECK
from sparse_coord_ros.maps.image import read_floor_plan
from sparse_coord_ros.maps.plan import import_map, parse_place, scenario_of
from sparse_coord_ros.maps.preview import write_preview

PLACE = re.compile(r"^-[\d.]")
"""What begins a place west of the origin, and no option."""

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")

EXAMPLE = (
    "sparse_coord export-map env1 --out env1_map && sparse_coord import-map "
    "env1_map/env1.yaml --cell 1 --radius 0.1 --start 0.5,4.5 4.5,4.5 --goal 4.5,0.5 0.5,0.5 "
    "--out imported"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    # argparse takes -3,2 for an option unless it looks like a negative number.
    parser._negative_number_matcher = PLACE
    parser.add_argument("map", metavar="MAP.yaml", type=Path, help="the YAML file of the map")
    parser.add_argument("--cell", required=True, help="side of a cell, in metres, e.g. 0.5")
    parser.add_argument("--radius", required=True, help="the robot's radius, in metres, e.g. 0.2")
    for name, text in (
        ("--start", "where the robots start, in metres of the map's frame; one a robot"),
        ("--goal", "where they are to go; one a robot, in the same order"),
        ("--doorway", "places in cells that are to be doorways too"),
        ("--no-doorway", "places in doorways that are to be none"),
    ):
        parser.add_argument(name, nargs="+", action="extend", default=[], metavar="X,Y", help=text)
    parser.add_argument(
        "--doorway-length",
        help="metres through a doorway at most; longer ones are corridors (default: by cell and "
        "radius)",
    )
    parser.add_argument(
        "--speck",
        default=str(SPECK),
        help=f"metres up to which a spot is noise; 0: none (default: {SPECK:g})",
    )
    shared.add_set(
        parser, "a setting of the scenario; what is not set is suggested by the map's distances"
    )
    parser.add_argument("--name", help="name of map and scenario (default: that of the file)")
    parser.add_argument("--out", type=Path, help="directory (default: <name>_map)")
    parser.add_argument(
        "--replace", action="store_true", help="replace what an earlier import-map wrote there"
    )
    shared.add_json(parser)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    if len(options.start) != len(options.goal):
        raise MapError(
            f"--start has {len(options.start)} places and --goal {len(options.goal)}; give each "
            "robot both"
        )
    robots = [
        (parse_place(start), parse_place(goal))
        for start, goal in zip(options.start, options.goal, strict=True)
    ]
    given = parse_assignments(options.assignments)
    if given and not robots:
        raise SettingError("--set needs a scenario: give --start and --goal of the robots")
    name = _checked(options.map.stem if options.name is None else options.name)
    folder = options.out or Path(f"{name}_map")
    text, scenario_file, picture = (folder / f"{name}{end}" for end in (".txt", ".yaml", ".png"))
    _check_free(options.map, folder, [text, scenario_file, picture], options.replace)
    plan = read_floor_plan(options.map)
    length = options.doorway_length
    imported = import_map(
        plan,
        cell=_metres("cell", options.cell),
        radius=_metres("radius", options.radius),
        robots=robots,
        add=[parse_place(place) for place in options.doorway],
        remove=[parse_place(place) for place in options.no_doorway],
        longest=None if length is None else _metres("doorway-length", length),
        speck=_metres("speck", options.speck),
        name=name,
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
        "parts": list(imported.parts),
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "suggested": suggested,
        "notes": notes,
        "files": [str(path) for path in (*written, picture)],
    }
    if options.json:
        shared.print_json(facts)
    else:
        _print(facts)
    return 0


def _print(facts: dict[str, Any]) -> None:
    x, y = facts["origin"]
    print(
        f"{facts['name']}: {facts['rows']} x {facts['columns']}, {facts['cells']} cells of "
        f"{facts['resolution']:g} m, {facts['doorways']} doorways; lower left corner at "
        f"{x:g},{y:g}"
    )
    if facts["suggested"]:
        said = ", ".join(f"{name}={value}" for name, value in facts["suggested"].items())
        print(f"settings by distance: {said}")
    for note in facts["notes"]:
        print(f"note: {note}")
    print("written: " + ", ".join(facts["files"]))


def _checked(name: str) -> str:
    if not NAME.fullmatch(name):
        raise MapError(
            f"name {name[:100]!r}: allowed are up to 100 letters, digits, '_', '-' and '.'; "
            "choose one with --name"
        )
    return name


def _metres(flag: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise SettingError(f"--{flag}: value is {text!r}, allowed: a number of metres")
    return value


def _check_free(source: Path, folder: Path, files: list[Path], replace: bool) -> None:
    there = [path for path in files if path.exists()]
    if there and not replace:
        raise MapError(
            f"{there[0]}: exists already, nothing is overwritten; choose another --out, or give "
            "--replace"
        )
    if any(path.exists() and path.samefile(source) for path in there if source.exists()):
        raise MapError(f"{folder}: {source} would be overwritten; choose another --out")


def _scenario_text(scenario: Scenario, given: dict, suggested: dict) -> str:
    """Return the text of the scenario file: robots, and the settings that are no defaults."""
    place = scenario.map.cells
    robots = {
        r.name: {"start": list(place[r.start]), "goal": list(place[r.goal])}
        for r in scenario.robots
    }
    plain = {k: _plain(getattr(scenario, k)) for k in given}
    data = {"map": f"{scenario.map.name}.txt", "robots": robots, **plain, **suggested}
    head = "# Made by import-map; robots' places are [row, column] of the map beside this file.\n"
    return head + yaml.safe_dump(data, sort_keys=False, default_flow_style=None)


def _plain(value):
    return value if isinstance(value, bool | int | float | str) else str(value)
