# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of map_server, as SLAM tools write them: a YAML file and an image, read and written."""

import io
import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

from sparse_coord_ros.errors import MapError, ScenarioError, in_short
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.grid import (
    DOORWAY,
    FURTHEST,
    IMAGES,
    RESOLUTIONS,
    WALL,
    GridMap,
    number_of,
)
from sparse_coord_ros.game.scenario import parse_yaml

MOST_YAML = 2**16
"""Bytes of the YAML file; those of map_server have a few hundred."""

MOST_PIXELS = 100_000_000
"""Pixels of an image: 10,000 x 10,000."""

LONGEST_SIDE = 65_535
"""Pixels along a side: counts along a row are 16-bit numbers."""

MODES = ("trinary", "scale", "raw")
FREE_BELOW, OCCUPIED_ABOVE = 0.25, 0.65
"""The thresholds of map_server where the file gives none."""

LEVEL = 1e-6
"""Largest yaw of an origin that counts as none, in radians."""


@dataclass(frozen=True)
class FloorPlan:
    """A map of map_server: what each pixel is, and where the image lies.

    Attributes:
        name: the file's stem.
        free: pixels known to be free, shape (rows, columns), bool, top row first.
        occupied: pixels known to be occupied; what is neither is unknown.
        resolution: metres a pixel.
        origin: (x, y) of the image's lower left corner, in metres.
    """

    name: str
    free: np.ndarray
    occupied: np.ndarray
    resolution: float
    origin: tuple[float, float]


def read_floor_plan(path: Path) -> FloorPlan:
    """Read a map as map_server does: image, resolution, origin, negate, thresholds, mode.

    A pixel's probability of being occupied is (255 - value) / 255, or value / 255 with `negate`.
    Colours count by their mean. Pixels that are not opaque are unknown; so is what lies between
    the thresholds.

    Args:
        path: the YAML file; the image's path in it counts from its folder.

    Raises:
        MapError: a file is missing or broken, or a field is missing or bad.
    """
    if path.suffix.lower() in IMAGES:
        beside = path.with_suffix(".yaml")
        raise MapError(
            f"{path}: is an image; give the YAML file that belongs to it"
            + (f": {beside}" if beside.exists() else ", with image, resolution and origin")
        )
    data = {"occupied_thresh": OCCUPIED_ABOVE, "free_thresh": FREE_BELOW} | _fields(path)
    where = str(path)
    image = data.get("image")
    if not isinstance(image, str) or not image or "\0" in image:
        raise MapError(f"{where}: field 'image' is {_shown(image)}, must name the image's file")

    def number(name: str, low: float, high: float) -> float:
        return number_of(data.get(name), low, high, f"{where}: field {name!r}")

    resolution = number("resolution", *RESOLUTIONS)
    origin = _origin(data.get("origin", [0.0, 0.0, 0.0]), f"{where}: field 'origin'")
    negate = data.get("negate", 0)
    if negate not in (0, 1):
        raise MapError(f"{where}: field 'negate' is {_shown(negate)}, allowed: 0 or 1")
    above, below = number("occupied_thresh", 0, 1), number("free_thresh", 0, 1)
    if below >= above:
        raise MapError(
            f"{where}: field 'free_thresh' is {below:g}, allowed: less than occupied_thresh "
            f"({above:g})"
        )
    mode = data.get("mode", "trinary")
    if mode not in MODES:
        raise MapError(f"{where}: field 'mode' is {_shown(mode)}, allowed: {', '.join(MODES)}")
    values, opaque = _pixels(path.parent / image)
    if mode == "raw":  # the value is the probability in percent; more is unknown
        occupancy = np.round(values if not negate else 255.0 - values)
        known, occupancy = opaque & (occupancy <= 100.0), occupancy / np.float32(100.0)
    else:
        occupancy = (values if negate else 255.0 - values) / np.float32(255.0)
        known = opaque
    free, occupied = known & (occupancy < below), known & (occupancy > above)
    return FloorPlan(path.stem, free, occupied, resolution, origin)


def _fields(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            data = file.read(MOST_YAML + 1)
        if len(data) > MOST_YAML:
            raise MapError(
                f"{path}: has more than {MOST_YAML} bytes, that of map_server has a few hundred; "
                "give the YAML file beside the image"
            )
        return parse_yaml(data.decode("utf-8"), where=str(path))
    except OSError as error:
        raise MapError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise MapError(f"{path}: is no UTF-8 text ({error.reason}); give the YAML file") from None
    except ScenarioError as error:
        raise MapError(str(error)) from None


def _shown(value: object) -> str:
    return "missing" if value is None else in_short(value)


def _origin(value: object, what: str) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) not in (2, 3):
        raise MapError(f"{what} is {_shown(value)}, allowed: [x, y, yaw] in metres, radians")
    x, y, yaw = (number_of(one, -FURTHEST, FURTHEST, what) for one in [*value, 0.0][:3])
    if abs(math.remainder(yaw, math.tau)) > LEVEL:
        raise MapError(
            f"{what} has a yaw of {yaw:g}, allowed: 0, as cells lie along the image; turn the "
            "image so that its rows lie along the frame's x axis, and set 0"
        )
    return x, y


def _pixels(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return an image's values from 0 to 255, float32, and which pixels are opaque."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                if image.width * image.height > MOST_PIXELS or max(image.size) > LONGEST_SIDE:
                    raise Image.DecompressionBombError
                image.load()
                return _values(image)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise MapError(
            f"{path}: has more than {MOST_PIXELS:,} pixels; scale it down, and multiply the "
            "resolution by as much"
        ) from None
    except FileNotFoundError:
        raise MapError(
            f"{path}: no such image; the YAML file's field 'image' is to name it, from the YAML "
            "file's folder"
        ) from None
    except Exception as error:  # Pillow raises what a broken file makes its decoders raise
        problem = " ".join(str(error).split())[:200]
        raise MapError(
            f"{path}: cannot be read as an image ({problem}); save it anew as PGM or PNG"
        ) from None


def _values(image: Image.Image) -> tuple[np.ndarray, np.ndarray]:
    mode = image.mode
    if mode.startswith("I;16"):
        values = np.asarray(image, dtype=np.float32) / np.float32(257.0)
    elif mode == "I":  # Pillow reads 16-bit PGM so
        values = np.asarray(image, dtype=np.float32)
        values = values / np.float32(257.0 if values.max(initial=0) > 255 else 1.0)
    elif mode in ("1", "L"):
        values = np.asarray(image.convert("L"), dtype=np.float32)
    else:
        pixels = np.asarray(image.convert("RGBA"))
        opaque = pixels[..., 3] == 255
        return pixels[..., :3].mean(axis=-1, dtype=np.float32), opaque
    return values, np.ones(values.shape, dtype=bool)


def write_floor_plan(
    grid: GridMap, directory: Path, name: str, *, resolution: float, pixels: int, image: str
) -> tuple[Path, Path]:
    """Write a map as map_server reads it; doorways are free.

    Args:
        grid: the map.
        directory: where to; it must exist.
        name: the files' stem.
        resolution: metres a cell.
        pixels: pixels along the side of a cell.
        image: "pgm" or "png".

    Returns:
        The YAML file and the image.
    """
    free = np.array([[sign != WALL for sign in row] for row in grid.rows])
    values = np.where(free, 254, 0).astype(np.uint8).repeat(pixels, axis=0).repeat(pixels, axis=1)
    file = io.BytesIO()
    Image.fromarray(values).save(file, format={"pgm": "PPM", "png": "PNG"}[image])
    picture, said = directory / f"{name}.{image}", directory / f"{name}.yaml"
    fields = {
        "image": picture.name,
        "mode": "trinary",
        "resolution": resolution / pixels,
        "origin": [*grid.origin, 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_ABOVE,
        "free_thresh": FREE_BELOW,
    }
    write_whole(picture, file.getvalue())
    write_whole(said, yaml.safe_dump(fields, sort_keys=False))
    return said, picture


def doorway_places(grid: GridMap, resolution: float) -> list[tuple[float, float]]:
    """Return (x, y) of the centre of each doorway cell, in metres."""
    rows = grid.shape[0]
    return [
        (
            grid.origin[0] + (c + 0.5) * resolution,
            grid.origin[1] + (rows - r - 0.5) * resolution,
        )
        for r, c in grid.cells
        if grid.rows[r][c] == DOORWAY
    ]
