# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord export-map`: a map of this package as a map of map_server."""

import argparse
from pathlib import Path

from sparse_coord_ros.base.errors import MapError
from sparse_coord_ros.base.limits import IMAGE
from sparse_coord_ros.cli.maps import map_of
from sparse_coord_ros.cli.options import Option
from sparse_coord_ros.core.game.grid import RESOLUTIONS
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.lab.maps.image import write_floor_plan

RESOLUTION = Setting("resolution", float, 1.0, "metres per cell", *RESOLUTIONS)
PIXELS = Setting("pixels", int, 10, "pixels per cell side", 1, 1000)

EXAMPLE = "sparse_coord export-map env1 --out env1_map"


OPTIONS = (
    Option("map MAP", None, "a map's name, a map file, or a scenario file"),
    Option(
        "--resolution",
        RESOLUTION,
        "metres per cell (default: the map's own, or 1)",
        {"default": None},
    ),
    PIXELS,
    Option("--image", ("pgm", "png"), "image format"),
    Option("--out", Path, "output directory (default: the current one)"),
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    grid = map_of(options.map)
    resolution = options.resolution or grid.resolution or 1.0
    pixels = options.pixels
    folder = options.out or Path()
    if grid.shape[0] * grid.shape[1] * pixels**2 > IMAGE.elements:
        raise MapError(
            f"--pixels {pixels}: the image would have more than {IMAGE.elements:,} pixels"
        )
    for path in (folder / f"{grid.name}.yaml", folder / f"{grid.name}.{options.image}"):
        if path.exists():
            raise MapError(
                f"{path}: exists already, nothing is overwritten; choose another --out"
            )
    folder.mkdir(parents=True, exist_ok=True)
    said, picture = write_floor_plan(
        grid,
        folder,
        grid.name,
        resolution=resolution,
        pixels=pixels,
        image=options.image,
    )
    print(f"written: {said}, {picture}")
    if grid.doorways:
        print(
            f"note: map_server knows no doorways; written as free cells: "
            f"{grid.doorways_in_words}"
        )
