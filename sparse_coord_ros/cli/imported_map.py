# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map and a scenario made from a floor plan, by the options of `import-map`, and their files."""

import argparse
import math
from pathlib import Path
from typing import Any, NamedTuple

from sparse_coord_ros.base.errors import MapError
from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.base.yaml_text import to_yaml
from sparse_coord_ros.cli.pictures import drawing
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.settings import Setting, parse_assignments
from sparse_coord_ros.lab.maps.floor_plan import FloorPlan, turned
from sparse_coord_ros.lab.maps.passages import IN_CORRIDORS, IN_DOORWAYS
from sparse_coord_ros.lab.maps.plan import (
    ASKEW,
    Imported,
    import_map,
    places,
    scenario_of,
)

CELL = Setting("cell", float, None, "side of a cell, in metres, e.g. 0.5", 0, 1000)
RADIUS = Setting(
    "radius", float, None, "the robot's radius, in metres, e.g. 0.2", 0, 100
)

MAP_OPTIONS = ("cell", "radius", "doorway", "no_doorway", "corridors")
"""The options of which a map is made."""

AUTO = "auto"
"""The value of --turn for a grid along the walls."""

DPI = 150
"""Of the picture."""


class ImportedMap(NamedTuple):
    """What is made of a floor plan as the options say.

    Attributes:
        plan: the floor plan.
        imported: the map.
        scenario: None where there are no robots.
        suggested: its settings that fit the map's distances.
        interactions: a sentence: which kinds of interaction fit the map.
        notes: what is odd, one line each.
        files: what there is to write, by name.
    """

    plan: FloorPlan
    imported: Imported
    scenario: Scenario | None
    suggested: dict[str, Any]
    interactions: str
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
            "origin": list(grid.origin),
            "suggested": self.suggested,
            "corridors": len(self.imported.corridors),
            "interactions": self.interactions,
            "notes": self.notes,
        }


def along(plan: FloorPlan, turn: float | str) -> FloorPlan:
    """Return a floor plan with rows along the grid.

    Args:
        plan: the floor plan.
        turn: the angle of the grid to it, in degrees; AUTO: that of its walls, from `ASKEW` on.

    Raises:
        MapError: the walls have no main direction.
    """
    if isinstance(turn, float):
        return turned(plan, math.radians(turn)) if turn else plan
    yaw = plan.wall_direction
    if yaw is None:
        raise MapError(
            f"map {plan.name}: its walls have no main direction; give --turn in degrees"
        )
    return turned(plan, yaw) if abs(math.degrees(yaw)) >= ASKEW else plan


def make(options: argparse.Namespace, plan: FloorPlan) -> ImportedMap:
    """Make a map and, where there are robots, a scenario as the options say.

    Raises:
        SparseCoordError: the map or the scenario cannot be made; or a --set without '='.
    """
    robots = list(zip(options.start, options.goal, strict=False))
    # for a goal, on the page
    waiting = [(start, start) for start in options.start[len(robots) :]]
    given = parse_assignments(options.assignments)
    chosen = {name: getattr(options, name) for name in MAP_OPTIONS}
    imported = import_map(plan, robots=[*robots, *waiting], **chosen)
    if options.corridors and imported.corridors:
        given = {"interactions": IN_CORRIDORS} | given
    interactions = _interactions_in_words(imported, taken=options.corridors)
    text, scenario_file, _ = _paths(options)
    notes = list(imported.notes)
    files = {text: imported.grid.to_text()}
    if not robots:
        return ImportedMap(plan, imported, None, {}, interactions, notes, files)
    scenario, suggested, odd = scenario_of(imported, robots, given)
    files[scenario_file] = _scenario_text(scenario, given, suggested)
    notes += odd
    return ImportedMap(plan, imported, scenario, suggested, interactions, notes, files)


def _interactions_in_words(imported: Imported, *, taken: bool) -> str:
    """Return which kinds of interaction fit a map.

    Args:
        imported: the map.
        taken: whether the user has taken those of corridors.
    """
    middles = imported.corridors
    if not middles:
        return f"interactions={IN_DOORWAYS} fits: no corridor is one cell wide"
    corridors = "1 corridor is"
    if len(middles) > 1:
        corridors = f"{len(middles)} corridors are"
    narrow = f"{corridors} one cell wide ({imported.narrow_cells} cells)"
    if taken:
        return (
            f"interactions={IN_CORRIDORS}: {narrow}, in the middle at {places(middles)}; their "
            "cells are doorways, which hold one robot each"
        )
    return (
        f"interactions={IN_CORRIDORS} fits: {narrow}, in the middle at {places(middles)}; robots "
        f"cannot pass each other there, which {IN_DOORWAYS} does not know"
    )


def write(options: argparse.Namespace, made: ImportedMap) -> Path:
    """Write the files, and the picture, whose path is returned."""
    picture = _paths(options)[-1]
    picture.parent.mkdir(parents=True, exist_ok=True)
    for path, content in made.files.items():
        write_whole(path, content)
    with drawing():
        from sparse_coord_ros.show.charts import rendered
        from sparse_coord_ros.show.paths import floor_figure

        grid = made.imported.grid
        robots = () if made.scenario is None else made.scenario.robots
        figure = floor_figure(
            grid,
            robots,
            made.plan,
            cells=True,
            wide=made.imported.wide,
            dusty=made.imported.dusty,
        )
        data = rendered(figure, "png", DPI)
    write_whole(picture, data)
    return picture


def _paths(options: argparse.Namespace) -> list[Path]:
    """Return the paths of the map, the scenario and the picture."""
    name = options.map.stem
    folder = options.out or Path(f"{name}_map")
    return [folder / f"{name}{end}" for end in (".txt", ".yaml", ".png")]


def check_free(options: argparse.Namespace, plan: FloorPlan, *, replace: bool) -> None:
    """Refuse to write over files, unless they may be replaced; over the floor plan's never.

    Raises:
        MapError: it would.
    """
    for path in _paths(options):
        if path.exists() and not replace:
            remedy = "choose another --out, or give --replace"
            raise MapError(f"{path}: exists already, nothing is overwritten; {remedy}")
        for source in (options.map, plan.path):
            if path.resolve() == source.resolve():
                raise MapError(f"{source} would be overwritten; choose another --out")


def _scenario_text(scenario: Scenario, given: dict, suggested: dict) -> str:
    """Return the text of the scenario file: robots, and the settings that are no defaults."""
    data = scenario.to_dict()
    chosen = {name: data[name] for name in ("robots", *given)}
    chosen_data = {"map": f"{scenario.map.name}.txt", **chosen, **suggested}
    head = "# Made by import-map; robots' places are [row, column] of the map beside this file.\n"
    return head + to_yaml(chosen_data, default_flow_style=None)
