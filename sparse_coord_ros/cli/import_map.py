# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord import-map`: a map of map_server as a map and a scenario of this package."""

import argparse
import math
import re
from pathlib import Path
from typing import Any, NamedTuple

from sparse_coord_ros.cli.options import JSON, PAGE, Option, changes, tell
from sparse_coord_ros.cli.pictures import drawing
from sparse_coord_ros.errors import MapError, SettingError, in_short
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.grid import FURTHEST
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.settings import Setting, parse_assignments
from sparse_coord_ros.limits import to_yaml
from sparse_coord_ros.maps.gridding import SPECK
from sparse_coord_ros.maps.image import FloorPlan, read_floor_plan
from sparse_coord_ros.maps.plan import Imported, Place, import_map, scenario_of

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")

DPI = 150
"""Of the picture."""

CELL = Setting("cell", float, None, "side of a cell, in metres, e.g. 0.5", 0, 1000)
RADIUS = Setting("radius", float, None, "the robot's radius, in metres, e.g. 0.2", 0, 100)
SPECK_SIZE = Setting("speck", float, SPECK, "metres up to which a spot is noise; 0: none", 0, 10)
CORRIDOR = "metres through a doorway; longer ones are corridors (default: by cell and radius)"
DOORWAY_LENGTH = Setting("doorway-length", float, None, CORRIDOR, 0, 1000)

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
    if not (abs(x) <= FURTHEST and abs(y) <= FURTHEST):
        allowed = "X,Y in metres of the map's frame, e.g. 2,-1"
        raise argparse.ArgumentTypeError(f"{in_short(text)} is no place, allowed: {allowed}")
    return x, y


PLACES = {"action": "extend", "default": []}

OPTIONS = (
    Option("map MAP.yaml", Path, "the YAML file of the map"),
    Option("--cell", CELL.parse, CELL.help),
    Option("--radius", RADIUS.parse, RADIUS.help),
    Option(
        "--start X,Y...", _place, "where the robots start, in metres of the map's frame", PLACES
    ),
    Option("--goal X,Y...", _place, "where they are to go, in the same order", PLACES),
    Option("--doorway X,Y...", _place, "places in cells that are to be doorways too", PLACES),
    Option("--no-doorway X,Y...", _place, "places in doorways that are to be none", PLACES),
    Option("--doorway-length", DOORWAY_LENGTH.parse, DOORWAY_LENGTH.help),
    SPECK_SIZE,
    changes("a setting of the scenario; what is not set is suggested by the map's distances"),
    Option("--out", Path, "directory (default: <name>_map)"),
    Option("--replace", bool, "replace what an earlier import-map wrote there"),
    Option("--page", bool, "choose all that on a page in the browser, and start training there"),
    *PAGE,
    JSON,
)


class Made(NamedTuple):
    """What is made of a floor plan as the options say.

    Attributes:
        plan: the floor plan.
        imported: the map.
        scenario: None where there are no robots.
        suggested: its settings that fit the map's distances.
        notes: what is odd, one line each.
        files: what there is to write, by name.
    """

    plan: FloorPlan
    imported: Imported
    scenario: Scenario | None
    suggested: dict[str, Any]
    notes: list[str]
    files: dict[Path, str]

    @property
    def facts(self) -> dict[str, Any]:
        """What there is to know of it, as plain data."""
        grid = self.imported.grid
        return {
            "cells": len(grid.cells),
            **grid.doorway_facts,
            "resolution": grid.resolution,
            "origin": grid.origin,
            "suggested": self.suggested,
            "notes": self.notes,
        }


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    name = options.map.stem
    if not NAME.fullmatch(name):
        what = f"name {name[:100]!r}: allowed are up to 100 letters, digits, '_', '-' and '.'"
        raise MapError(f"{what}; rename the file")
    if len(options.start) != len(options.goal):
        what = f"--start has {len(options.start)} places and --goal {len(options.goal)}"
        raise MapError(f"{what}; give each robot both")
    if options.page:
        from sparse_coord_ros.cli.import_page import serve

        serve(options)
        return
    plan = read_floor_plan(options.map)
    missing = [f"--{one}" for one in ("cell", "radius") if getattr(options, one) is None]
    if missing:
        raise SettingError(f"required: {', '.join(missing)}; or choose on a page: --page")
    if options.assignments and not options.start:
        raise SettingError("--set needs a scenario: give --start and --goal of the robots")
    check_free(options, replace=options.replace)
    from sparse_coord_ros.cli.computing import Bar

    with Bar("cells", "laying the grid"):
        made = make(options, plan)
    if made.scenario is None:
        made.notes.append("no scenario: give --start and --goal, in metres, and --replace")
    picture = write(options, made)
    rows, columns = made.imported.grid.shape
    facts = {"name": name, "rows": rows, "columns": columns, **made.facts}
    facts |= {"parts": made.imported.parts, "files": [*made.files, picture]}
    lines = [
        "{name}: {rows} x {columns}, {cells} cells of {resolution:g} m, {0}; "
        "lower left corner at {origin[0]:g},{origin[1]:g}".format(
            made.imported.grid.doorways_in_words, **facts
        )
    ]
    if made.suggested:
        said = ", ".join(f"{name}={value}" for name, value in made.suggested.items())
        lines.append(f"settings by distance: {said}")
    lines += [f"note: {note}" for note in made.notes]
    tell(options, facts, *lines, f"written: {' '.join(map(str, facts['files']))}")


def make(options: argparse.Namespace, plan: FloorPlan) -> Made:
    """Make a map and, where there are robots, a scenario as the options say.

    Raises:
        SparseCoordError: as of `import_map` and `scenario_of`; or a --set without '='.
    """
    robots = list(zip(options.start, options.goal, strict=False))
    waiting = [(one, one) for one in options.start[len(robots) :]]  # for a goal, on the page
    given = parse_assignments(options.assignments)
    names = ("cell", "radius", "doorway", "no_doorway", "doorway_length", "speck")
    chosen = {name: getattr(options, name) for name in names}
    imported = import_map(plan, robots=[*robots, *waiting], **chosen)
    text, scenario_file, _ = _paths(options)
    notes = list(imported.notes)
    files = {text: imported.grid.to_text()}
    if not robots:
        return Made(plan, imported, None, {}, notes, files)
    scenario, suggested, odd = scenario_of(imported, robots, given)
    files[scenario_file] = _scenario_text(scenario, given, suggested)
    return Made(plan, imported, scenario, suggested, notes + odd, files)


def write(options: argparse.Namespace, made: Made) -> Path:
    """Write the files, and the picture, whose path is returned."""
    picture = _paths(options)[-1]
    picture.parent.mkdir(parents=True, exist_ok=True)
    for path, content in made.files.items():
        write_whole(path, content)
    with drawing():
        from sparse_coord_ros.experiments.report.charts import rendered
        from sparse_coord_ros.look.paths import floor_figure

        grid = made.imported.grid
        robots = () if made.scenario is None else made.scenario.robots
        figure = floor_figure(grid, robots, made.plan, side=grid.resolution or 1.0, cells=True)
        data = rendered(figure, "png", DPI)
    write_whole(picture, data)
    return picture


def _paths(options: argparse.Namespace) -> list[Path]:
    """Return where the map, the scenario and the picture go."""
    name = options.map.stem
    folder = options.out or Path(f"{name}_map")
    return [folder / f"{name}{end}" for end in (".txt", ".yaml", ".png")]


def check_free(options: argparse.Namespace, *, replace: bool) -> None:
    """Refuse to write over files, unless they may be replaced; over the source never.

    Raises:
        MapError: it would.
    """
    source = options.map
    for path in _paths(options):
        if path.exists() and not replace:
            remedy = "choose another --out, or give --replace"
            raise MapError(f"{path}: exists already, nothing is overwritten; {remedy}")
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
