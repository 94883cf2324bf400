# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of map_server, as SLAM tools write them: a YAML file and an image, read and shown."""

import base64
import io
import math
import os
import warnings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, UnidentifiedImageError

from sparse_coord_ros.base.errors import (
    MapError,
    SettingError,
    in_short,
    message_of,
    retold,
)
from sparse_coord_ros.base.files import read_text, refuse_stand_in, write_whole
from sparse_coord_ros.base.yaml_text import parse_yaml, to_yaml
from sparse_coord_ros.core.game.grid import (
    FURTHEST,
    RESOLUTIONS,
    GridMap,
    number_of,
)
from sparse_coord_ros.core.game.settings import Setting, SettingTable

IMAGES = (".pgm", ".png", ".pbm", ".ppm", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff")
"""The ends of the names of images of map_server's maps."""

LONGEST_SIDE = 65_535
"""Pixels along a side: counts along a row are 16-bit numbers."""

FIELDS = SettingTable(
    [
        Setting("image", str, None, "the image's file"),
        Setting("resolution", float, None, "metres a pixel", *RESOLUTIONS),
        Setting("negate", int, 0, "1: dark is free", low=0, high=1),
        Setting(
            "occupied_thresh", float, 0.65, "occupied from this probability on", 0, 1
        ),
        Setting("free_thresh", float, 0.25, "free below this probability", 0, 1),
        Setting(
            "mode", str, "trinary", "how to read", choices=("trinary", "scale", "raw")
        ),
    ]
)
"""The fields of the YAML file with map_server's defaults; fields without one are required."""

UNKNOWN_GREY = 205
"""The grey that map_saver writes for unknown; Jazzy's own free_thresh of 0.25 makes it free."""

LEVEL = 1e-6
"""Largest yaw of an origin that counts as none, in radians."""


SHARPEST = 4096
"""Pixels along the longer side of a picture with zoom."""

UNKNOWN_SHADE = 200
FREE_SHADE = 255
OCCUPIED_SHADE = 0
"""Shades of grey."""


@dataclass(frozen=True)
class FloorPlan:
    """A map of map_server: the kind of each pixel, and the position of the image.

    Attributes:
        path: the YAML file.
        free: pixels known to be free, shape (rows, columns), bool, top row first.
        occupied: pixels known to be occupied; all other pixels are unknown.
        resolution: metres per pixel.
        origin: (x, y) of the image's lower left corner, in metres.
        doubtful: share of the free pixels with the grey that map_saver writes for unknown.
    """

    path: Path
    free: np.ndarray
    occupied: np.ndarray
    resolution: float
    origin: tuple[float, float]
    doubtful: float = 0.0

    @property
    def name(self) -> str:
        """The file's stem."""
        return self.path.stem


def read_floor_plan(path: Path) -> FloorPlan:
    """Read a map as map_server does: image, resolution, origin, negate, thresholds, mode.

    A pixel's probability of being occupied is (255 - value) / 255, or value / 255 with `negate`.
    Colours count by their mean. Pixels that are not opaque are unknown; so are values between the
    thresholds.

    Args:
        path: the YAML file; the image's path in it counts from its folder.

    Raises:
        MapError: a file is missing or broken, or a field is missing or bad.
    """
    if is_picture(path):
        _check_exists(path)
        raise MapError(_yaml_wanted(path))
    text = read_text(path, MapError, "give the YAML file")
    said = parse_yaml(text, where=str(path), error=MapError)
    if "robots" in said and "image" not in said:
        remedy = f"let a team learn on it: sparse_coord train {path}"
        raise MapError(
            f"{path}: is a scenario already, not the map of a building; {remedy}"
        )
    if "image" not in said:
        raise MapError(
            f"{path}: field 'image' is missing; give the YAML file that belongs to a map's image"
        )
    with retold(MapError, SettingError, f"{path}"):
        data = {
            name: one.parse(said.get(name, one.default)) for name, one in FIELDS.items()
        }
    origin = _origin(said.get("origin", [0.0, 0.0, 0.0]), f"{path}: field 'origin'")
    return _floor_plan(path, data, origin)


def is_picture(path: Path) -> bool:
    """Return whether a file is an image, by its name."""
    return path.suffix.lower() in IMAGES


def _check_exists(image: Path) -> None:
    """Raise MapError if there is no image that the user has named."""
    if not image.exists():
        raise MapError(f"{image}: no such image; give an image that exists")


def _yaml_wanted(image: Path) -> str:
    """Return a text: an image needs its YAML file, with this content."""
    beside = image.with_suffix(".yaml")
    if beside.exists():
        return f"{image}: is an image; give the YAML file that belongs to it: {beside}"
    lines = f"image: {image.name}", "resolution: 0.05", "origin: [0, 0, 0]"
    return (
        f"{image}: is an image, and its scale is not known; write {beside} with three lines, "
        f"{' / '.join(map(repr, lines))} (metres a pixel; x, y in metres of the lower left "
        f"corner; yaw), and give that file; or choose them on a page: sparse_coord import-map "
        f"{image} --page"
    )


def read_picture(
    image: Path, resolution: float, origin: tuple[float, float]
) -> FloorPlan:
    """Read an image that has no YAML file, with map_server's defaults.

    Args:
        image: the image.
        resolution: metres a pixel.
        origin: (x, y) of its lower left corner, in metres.

    Returns:
        The floor plan; its path is that of the YAML file that `write_header` writes.

    Raises:
        MapError: the image is missing, has a YAML file already, or cannot be read.
    """
    _check_exists(image)
    path = image.with_suffix(".yaml")
    if path.exists():
        raise MapError(_yaml_wanted(image))
    defaults = {name: one.default for name, one in FIELDS.items()}
    fields = defaults | {"image": image.name, "resolution": resolution}
    return _floor_plan(path, fields, origin)


def write_header(plan: FloorPlan, image: str) -> None:
    """Write the YAML file of a floor plan that was read with map_server's defaults.

    Args:
        plan: the floor plan.
        image: the name of its image, in the same folder as the YAML file.
    """
    fields = {name: one.default for name, one in FIELDS.items()}
    fields |= {"image": image, "resolution": plan.resolution}
    write_whole(plan.path, to_yaml(fields | {"origin": [*plan.origin, 0.0]}))


def _floor_plan(
    path: Path, data: dict[str, Any], origin: tuple[float, float]
) -> FloorPlan:
    """Return a floor plan.

    Args:
        path: the YAML file.
        data: its fields but the origin, typed.
        origin: (x, y) in metres.

    Raises:
        MapError: the image is missing or broken, or the thresholds contradict each other.
    """
    above = data["occupied_thresh"]
    below = data["free_thresh"]
    negate = data["negate"]
    if below >= above:
        allowed = f"less than occupied_thresh ({above:g})"
        raise MapError(
            f"{path}: setting free_thresh: value is {below:g}, allowed: {allowed}"
        )
    values, known = _pixels(path.parent / data["image"])
    # the value is the probability in percent; more is unknown
    if data["mode"] == "raw":
        occupancy = np.round(values if not negate else 255.0 - values)
        known = known & (occupancy <= 100.0)
        occupancy = occupancy / np.float32(100.0)
    else:
        occupancy = (values if negate else 255.0 - values) / np.float32(255.0)
    free = known & (occupancy < below)
    occupied = known & (occupancy > above)
    doubtful = float((values[free] == UNKNOWN_GREY).mean()) if free.any() else 0.0
    return FloorPlan(path, free, occupied, data["resolution"], origin, doubtful)


def floor_plan_of(grid: GridMap) -> FloorPlan | None:
    """Return a map's floor plan; None if it is missing."""
    if grid.resolution is None or not os.path.isfile(grid.source):
        return None
    with suppress(MapError):
        return read_floor_plan(Path(grid.source))
    return None


def _origin(value: object, what: str) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) not in (2, 3):
        raise MapError(
            f"{what} is {in_short(value)}, allowed: [x, y, yaw] in metres, radians"
        )
    x, y, yaw = (number_of(one, -FURTHEST, FURTHEST, what) for one in [*value, 0.0][:3])
    if abs(math.remainder(yaw, math.tau)) > LEVEL:
        raise MapError(
            f"{what} has a yaw of {yaw:g}, allowed: 0, as cells lie along the image; turn the "
            "image so that its rows lie along the frame's x axis, and set 0"
        )
    return x, y


def _pixels(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return an image's values from 0 to 255, float32, and whether each pixel is opaque."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                if max(image.size) > LONGEST_SIDE:
                    raise Image.DecompressionBombError
                image.load()
                return _values(image)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        remedy = "scale it down, and multiply the resolution by as much"
        raise MapError(f"{path}: has too many pixels; {remedy}") from None
    except FileNotFoundError:
        remedy = (
            "the YAML file's field 'image' is to name it, from the YAML file's folder"
        )
        raise MapError(f"{path}: no such image; {remedy}") from None
    except (
        Exception
    ) as error:  # Pillow's decoders raise any exception for a broken file
        if path.is_file():
            with path.open("rb") as file:
                refuse_stand_in(path, file.read(100), MapError)
        problem = message_of(error)[:200]
        if isinstance(error, UnidentifiedImageError):  # its text names a Python object
            problem = "its format is unknown"
        why = f"cannot be read as an image ({problem}); save it anew as PGM or PNG"
        raise MapError(f"{path}: {why}") from None


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


def grey(plan: FloorPlan) -> np.ndarray:
    """Return a floor plan as a grey picture, shape (rows, columns), uint8, top row first."""
    shade = np.full(plan.free.shape, UNKNOWN_SHADE, dtype=np.uint8)
    shade[plan.free] = FREE_SHADE
    shade[plan.occupied] = OCCUPIED_SHADE
    return shade


def data_url(plan: FloorPlan) -> str:
    """Return a floor plan as a grey picture for a page: a PNG, at most `SHARPEST` pixels long."""
    picture = Image.fromarray(grey(plan))
    picture = picture.reduce(math.ceil(max(picture.size) / SHARPEST))
    file = io.BytesIO()
    picture.save(file, format="PNG")
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"


def under(grid: GridMap) -> dict[str, Any] | None:
    """Return the floor plan under a map, as a picture for a page, or None.

    Its place is that of its upper left corner, and its size, in cells of the map.
    """
    plan = floor_plan_of(grid)
    if plan is None:
        return None
    scale = plan.resolution / (grid.resolution or 1.0)
    height, width = (side * scale for side in plan.free.shape)
    x, y = (
        (a - b) / (grid.resolution or 1.0)
        for a, b in zip(plan.origin, grid.origin, strict=True)
    )
    place = {"x": x, "y": grid.shape[0] - y - height, "width": width, "height": height}
    return {"href": data_url(plan), **place}
