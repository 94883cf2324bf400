# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord import-map`: a map of map_server as a map and a scenario of this package."""

import argparse
import math
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

from sparse_coord_ros.base.errors import MapError, SettingError, in_short
from sparse_coord_ros.cli.imported_map import (
    AUTO,
    CELL,
    RADIUS,
    ImportedMap,
    along,
    check_free,
    make,
    write,
)
from sparse_coord_ros.cli.options import (
    JSON,
    PAGE,
    PAGE_NAMES,
    Option,
    allowed_with,
    changes,
    tell,
)
from sparse_coord_ros.core.game.grid import FURTHEST
from sparse_coord_ros.core.game.pose import pose_in_words
from sparse_coord_ros.core.game.scenario import SETTINGS
from sparse_coord_ros.core.game.settings import parse_assignments
from sparse_coord_ros.lab.maps.image import read_floor_plan
from sparse_coord_ros.lab.maps.meeting import Prospect, prospect_of
from sparse_coord_ros.lab.maps.passages import IN_CORRIDORS
from sparse_coord_ros.lab.maps.plan import CELL_RADII, Place

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")

EXAMPLE = (
    "sparse_coord import-map examples/office.yaml --cell 0.85 --radius 0.1 "
    "--start -6,4.5 -3.4,0 --goal -3.4,0 -6,4.5 --out office"
)


def _place(text: str) -> Place:
    """Read X,Y in metres."""
    try:
        x, y = map(float, text.split(","))
    except ValueError:
        x = y = math.nan
    if not (abs(x) <= FURTHEST and abs(y) <= FURTHEST):
        allowed = "X,Y in metres of the map's frame, e.g. 2,-1"
        raise argparse.ArgumentTypeError(
            f"{in_short(text)} is no place, allowed: {allowed}"
        )
    return x, y


def _turn(text: str) -> float | str:
    """Read an angle in degrees, or auto."""
    if text == AUTO:
        return AUTO
    with suppress(ValueError):
        if math.isfinite(float(text)):
            return float(text)
    allowed = f"{AUTO}, or degrees counterclockwise, e.g. 20"
    raise argparse.ArgumentTypeError(
        f"{in_short(text)} is no angle, allowed: {allowed}"
    )


PLACES = {"action": "extend", "default": []}

OPTIONS = (
    Option(
        "map MAP.yaml",
        Path,
        "YAML file of a map of map_server, or a .map file of MovingAI",
    ),
    Option(
        "--cell",
        CELL.parse,
        f"{CELL.help} (default: about {CELL_RADII:g} radii, as the map allows)",
    ),
    Option("--radius", RADIUS.parse, RADIUS.help),
    Option(
        "--turn DEGREES",
        _turn,
        "angle of the grid to the image, counterclockwise; auto: that of the walls",
        {"default": 0.0},
    ),
    Option(
        "--start X,Y...",
        _place,
        "start of each robot, in metres in the map's frame",
        PLACES,
    ),
    Option("--goal X,Y...", _place, "goal of each robot, in the same order", PLACES),
    Option(
        "--doorway X,Y...",
        _place,
        "places in cells to mark as doorways",
        PLACES,
    ),
    Option("--no-doorway X,Y...", _place, "places in doorways to unmark", PLACES),
    Option(
        "--corridors",
        bool,
        "mark the cells of corridors one cell wide as doorways, and set interactions to "
        f"{IN_CORRIDORS}: one robot at a time in each cell",
    ),
    changes("change a scenario setting (default: suggested from the map's distances)"),
    Option("--out", Path, "output directory (default: <name>_map)"),
    Option("--replace", bool, "overwrite the output of an earlier import-map"),
    Option(
        "--page",
        bool,
        "choose cells, robots and doorways on a page in the browser, and start training there",
    ),
    *PAGE,
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    _check_names(options)
    if options.page:
        from sparse_coord_ros.cli.import_page import serve

        SETTINGS.parse(parse_assignments(options.assignments))
        serve(options)
        return
    allowed_with(options, "--page", PAGE_NAMES)
    from sparse_coord_ros.cli.computing import Bar

    with Bar("pixels", "reading the map"):
        plan = along(read_floor_plan(options.map), options.turn)
    _check_given(options)
    check_free(options, plan, replace=options.replace)
    with Bar("cells", "dividing the map into cells"):
        made = make(options, plan)
    prospect = None
    if made.scenario is None:
        made.notes.append(
            "no scenario: give --start and --goal, in metres, and --replace"
        )
    else:
        with Bar("robots", "comparing with robots that ignore each other"):
            prospect = prospect_of(made.scenario)
        if prospect.note:
            made.notes.append(prospect.note)
    with Bar("pictures", "drawing the map"):
        picture = write(options, made)
    facts = _facts(options.map.stem, made, prospect, picture)
    lines = _lines(made, prospect, facts, corridors=options.corridors)
    tell(options, facts, *lines, f"written: {' '.join(map(str, facts['files']))}")


def _check_names(options: argparse.Namespace) -> None:
    """Raise `MapError` unless the file's name is allowed, and each robot has start and goal."""
    name = options.map.stem
    if not NAME.fullmatch(name):
        what = f"name {name[:100]!r}: allowed are up to 100 letters, digits, '_', '-' and '.'"
        raise MapError(f"{what}; rename the file")
    if len(options.start) != len(options.goal):
        what = f"--start has {len(options.start)} places and --goal {len(options.goal)}"
        raise MapError(f"{what}; give each robot both")


def _check_given(options: argparse.Namespace) -> None:
    """Raise `SettingError` if an option is missing that is needed without the page."""
    if options.radius is None:
        raise SettingError("required: --radius; or choose on a page: --page")
    if options.assignments and not options.start:
        raise SettingError(
            "--set needs a scenario: give --start and --goal of the robots"
        )


def _facts(
    name: str, made: ImportedMap, prospect: Prospect | None, picture: Path
) -> dict[str, Any]:
    """Return the result as plain data."""
    rows, columns = made.imported.grid.shape
    return {
        "name": name,
        "rows": rows,
        "columns": columns,
        **made.facts,
        "parts": made.imported.parts,
        "wide_passages": made.imported.wide,
        "only_without_dust": made.imported.dusty,
        "files": [*made.files, picture],
        "advice": None if prospect is None else prospect.advice,
        "doorway_hint": None if prospect is None else prospect.doorway,
    }


def _lines(
    made: ImportedMap,
    prospect: Prospect | None,
    facts: dict[str, Any],
    *,
    corridors: bool,
) -> list[str]:
    """Return the result in words.

    Args:
        made: the imported map.
        prospect: whether asking will pay; None: there is no scenario.
        facts: the result as plain data.
        corridors: whether corridors were marked.
    """
    lines = [
        "{name}: {rows} x {columns}, {cells} cells of {resolution:g} m, {0}; "
        "lower left corner at {1}".format(
            made.imported.grid.doorways_in_words,
            pose_in_words(made.imported.grid.origin),
            **facts,
        )
    ]
    if made.suggested:
        settings = ", ".join(
            f"{name}={value}" for name, value in made.suggested.items()
        )
        lines.append(f"settings by distance: {settings}")
    if made.scenario is not None and made.scenario.prior == "map":
        lines.append(
            "robots begin with the values of robots alone on this map (prior=map)"
        )
    untaken = bool(made.imported.corridors) and not corridors
    lines.append(made.interactions + "; --corridors takes it" * untaken)
    if prospect is not None:
        lines.append(prospect.advice.text)
    return lines + [f"note: {note}" for note in made.notes]
