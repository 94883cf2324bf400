# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Floor plans from files: maps of map_server (a YAML file and an image), MovingAI maps."""

import base64
import io
import math
import os
import warnings
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

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
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.base.yaml_text import parse_yaml, to_yaml
from sparse_coord_ros.core.game.grid import (
    LEVEL,
    RESOLUTIONS,
    GridMap,
    load_map,
    pose_of,
)
from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.core.game.settings import Setting, SettingTable
from sparse_coord_ros.lab.maps.floor_plan import FloorPlan, turned

IMAGES = (".pgm", ".png", ".pbm", ".ppm", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff")
"""The ends of the names of images of map_server's maps."""

LONGEST_SIDE = 65_535
"""Pixels along a side: counts along a row are 16-bit numbers."""

FIELDS = SettingTable(
    [
        Setting("image", str, None, "the image's file"),
        Setting("resolution", float, None, "metres a pixel", *RESOLUTIONS),
        Setting("occupied_thresh", float, 0.65, "occupied above this probability"),
        Setting("free_thresh", float, 0.25, "free below this probability"),
    ]
)
"""Fields of the YAML file; the thresholds are map_saver's where the file has none."""

MODES = ("trinary", "scale", "raw")

TRUTHS = dict.fromkeys(("y", "yes", "true", "on"), True)
TRUTHS |= dict.fromkeys(("n", "no", "false", "off"), False)
"""The words that map_server reads as true or false."""

UNKNOWN_GREY = 205
"""The grey that map_saver writes for unknown; Jazzy's own free_thresh of 0.25 makes it free."""

UNKNOWN_BELOW = {"trinary": 0.196, "scale": 0.19}
"""A free_thresh at which this grey is unknown; in the mode `raw` it always is."""

OCTILE = ".map"
"""The end of the name of a map in MovingAI's format."""

OPAQUE = 255
"""The opacity of a pixel that is not transparent."""

LEAST_SHARE = 0.005
"""Smaller shares of an image are 0 % in a message: they are left out."""

SHARPEST = 4096
"""Pixels along the longer side of a picture with zoom."""

UNKNOWN_SHADE = 200
FREE_SHADE = 255
OCCUPIED_SHADE = 0
"""Shades of grey."""


class _Reading(NamedTuple):
    """How map_server turns pixels into the kinds free, occupied and unknown."""

    mode: str
    negate: bool
    occupied_thresh: float
    free_thresh: float


DEFAULT_READING = _Reading(
    "trinary",
    negate=False,
    occupied_thresh=FIELDS["occupied_thresh"].default,
    free_thresh=FIELDS["free_thresh"].default,
)


class _Pixels(NamedTuple):
    """The pixels of an image.

    Attributes:
        brightness: the sum of the colour channels, shape (rows, columns), integers.
        channels: their number.
        most: the largest value of a channel: 255, or 65,535 of images of 16 bits.
        opacity: 0 to 255, shape (rows, columns); None: the image has no transparency.
    """

    brightness: np.ndarray
    channels: int
    most: int
    opacity: np.ndarray | None


def read_floor_plan(path: Path) -> FloorPlan:
    """Read a map of map_server as it does, or a map of MovingAI.

    Args:
        path: the YAML file, whose field `image` counts from its folder; or a file that ends in
            .map, whose squares are pixels of 1 m.

    Raises:
        MapError: a file is missing or broken, a field is missing or bad, or no pixel is free.
    """
    if path.suffix == OCTILE:
        grid = load_map(str(path))
        return FloorPlan(path, grid.free, ~grid.free, 1.0, grid.origin)
    if is_picture(path):
        _check_exists(path)
        raise MapError(_yaml_wanted(path))
    if path.suffix == ".txt":
        load_map(str(path))
        remedy = f"write a scenario file with 'map: {path.name}' and robots"
        raise MapError(f"{path}: is a map of this package already; {remedy}")
    header = fields_of(path)
    if "robots" in header and "image" not in header:
        remedy = f"let a team learn on it: sparse_coord train {path}"
        raise MapError(
            f"{path}: is a scenario already, not the map of a building; {remedy}"
        )
    if "image" not in header:
        raise MapError(
            f"{path}: field 'image' is missing; give the YAML file that belongs to a map's image"
        )
    if "resolution" not in header:
        raise MapError(f"{path}: field 'resolution' is missing; add the metres a pixel")
    with retold(MapError, SettingError, f"{path}"):
        data = {
            name: field.parse(header.get(name, field.default))
            for name, field in FIELDS.items()
        }
        reading = _Reading(
            _mode(header.get("mode", MODES[0])),
            _negate(header.get("negate", False)),
            data["occupied_thresh"],
            data["free_thresh"],
        )
    origin = pose_of(header.get("origin", [0.0, 0.0]), f"{path}: field 'origin'")
    image = path.parent / data["image"]
    _refuse_other_place(path, image)
    return _floor_plan(path, image, data["resolution"], origin, reading)


def _refuse_other_place(path: Path, image: Path) -> None:
    """Raise MapError if a missing image lies beside its YAML file, as in a folder that was moved.

    Upper and lower case count as equal: elsewhere they may be.
    """
    if image.exists():
        return
    for other in path.parent.iterdir():
        if other.name.lower() == image.name.lower():
            raise MapError(
                f"{image}: no such image; {other.name} lies beside the YAML file: write "
                f"'image: {other.name}'"
            )


def fields_of(path: Path) -> dict[str, Any]:
    """Return the fields of a map's YAML file; a map of MovingAI has none.

    Raises:
        MapError: it cannot be read, or is no mapping.
    """
    if path.suffix == OCTILE:
        return {}
    text = read_text(path, MapError, "give the YAML file")
    return parse_yaml(text, where=str(path), error=MapError)


def _mode(value: object) -> str:
    mode = str(value).lower()
    if mode not in MODES:
        allowed = " or ".join(MODES)
        raise SettingError(
            f"setting mode: value is {in_short(value)}, allowed: {allowed}"
        )
    return mode


def _negate(value: object) -> bool:
    if isinstance(value, str) and value.lower() in TRUTHS:
        return TRUTHS[value.lower()]
    with suppress(ValueError):
        if isinstance(value, int | str):
            return int(value) != 0
    raise SettingError(
        f"setting negate: value is {in_short(value)}, allowed: 0, 1, true or false"
    )


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


def read_picture(image: Path, resolution: float, origin: Pose) -> FloorPlan:
    """Read an image that has no YAML file, with map_server's defaults.

    Args:
        image: the image.
        resolution: metres a pixel.
        origin: the pose of its lower left corner.

    Returns:
        The floor plan; its path is that of the YAML file that `write_header` writes.

    Raises:
        MapError: the image is missing, has a YAML file already, cannot be read, or has no free
            pixel.
    """
    _check_exists(image)
    path = image.with_suffix(".yaml")
    if path.exists():
        raise MapError(_yaml_wanted(image))
    return _floor_plan(path, image, resolution, origin, DEFAULT_READING)


def write_header(plan: FloorPlan, image: str) -> None:
    """Write the YAML file of a floor plan that was read with map_server's defaults.

    Args:
        plan: the floor plan.
        image: the name of its image, in the same folder as the YAML file.
    """
    fields = {
        "image": image,
        "resolution": plan.resolution,
        "origin": list(plan.origin),
        **DEFAULT_READING._asdict(),
        "negate": 0,
    }
    write_whole(plan.path, to_yaml(fields))


def _floor_plan(
    path: Path, image: Path, resolution: float, origin: Pose, reading: _Reading
) -> FloorPlan:
    """Return a floor plan.

    Args:
        path: the YAML file.
        image: its image.
        resolution: metres a pixel.
        origin: the pose of the image's lower left corner.
        reading: how its pixels are read.

    Raises:
        MapError: the image is missing or broken, or no pixel is free.
    """
    pixels = _pixels(image)
    free, occupied = _kinds(pixels, reading)
    remarks = tuple(_remarks(pixels, free, reading))
    if not free.any():
        why = remarks[0] if remarks else _why_none(reading)
        raise MapError(f"{image}: no pixel is free; {why}")
    return FloorPlan(path, free, occupied, resolution, origin, remarks)


def _remarks(pixels: _Pixels, free: np.ndarray, reading: _Reading) -> Iterator[str]:
    """Yield warnings about pixels, one line each."""
    opacity = pixels.opacity
    if opacity is not None:
        transparent = float(((opacity < OPAQUE) & ~free).mean())
        if transparent >= LEAST_SHARE:
            yield (
                f"{percent(transparent, whole=True)} of the pixels are transparent, and count as "
                "unknown or occupied: where they are free, fill them with "
                f"{'black' if reading.negate else 'white'}"
            )
    grey = free & (pixels.brightness == UNKNOWN_GREY * pixels.channels)
    doubtful = float(grey.sum()) / max(1, int(free.sum()))
    if doubtful >= LEAST_SHARE:
        below = UNKNOWN_BELOW[reading.mode]
        remedies = []
        if reading.free_thresh > below:
            remedies.append(f"set free_thresh to {below:g} in the YAML file")
        if opacity is not None and reading.mode == "trinary":
            remedies.append(
                "save the image without opacity, which counts as brightness"
            )
        yield (
            f"{percent(doubtful, whole=True)} of the free pixels have grey {UNKNOWN_GREY}, which "
            f"map_saver writes for unknown: where they are unknown, {', and '.join(remedies)}"
        )


def _why_none(reading: _Reading) -> str:
    """Return why no pixel is free, and the remedy."""
    return (
        f"free is what is {'darker' if reading.negate else 'brighter'} than a share of "
        f"{1.0 - reading.free_thresh:g} (1 - free_thresh); check negate, mode and the thresholds"
    )


def floor_plan_of(grid: GridMap) -> FloorPlan | None:
    """Return a map's floor plan, turned as the map; None if it is missing."""
    if grid.resolution is None or not os.path.isfile(grid.source):
        return None
    with suppress(MapError):
        plan = read_floor_plan(Path(grid.source))
        yaw = math.remainder(grid.origin.yaw - plan.origin.yaw, math.tau)
        return turned(plan, yaw) if abs(yaw) > LEVEL else plan
    return None


def _kinds(pixels: _Pixels, reading: _Reading) -> tuple[np.ndarray, np.ndarray]:
    """Return whether each pixel is free, and whether it is occupied, as map_server reads it.

    What map_server publishes is 0 where a pixel is free, 100 where it is occupied. In the mode
    `raw` it publishes the brightness as it is, up to 100, without `negate`; such a probability in
    percent counts by the thresholds. (Source: `loadMapFromFile` of nav2_map_server.)
    """
    brightness = pixels.brightness
    channels = pixels.channels
    if reading.mode == "trinary" and pixels.opacity is not None:
        # Opacity counts as a channel.
        brightness = brightness + pixels.opacity
        channels += 1
    levels = np.arange(channels * pixels.most + 1)
    shade = levels * (65535 // pixels.most) / channels / 65535
    if reading.mode == "raw":
        percents = np.floor(shade * 255 + 0.5)
        known = percents <= 100
        occupied = known & (percents / 100 > reading.occupied_thresh)
        occupied |= percents == 100
        free = known & ~occupied & (percents / 100 < reading.free_thresh)
        free |= percents == 0
        return free[brightness], occupied[brightness]
    probability = shade if reading.negate else 1.0 - shade
    occupied = probability > reading.occupied_thresh
    free = ~occupied & (probability < reading.free_thresh)
    if reading.mode == "scale":
        between = ~occupied & ~free
        span = reading.occupied_thresh - reading.free_thresh
        with np.errstate(divide="ignore", invalid="ignore"):
            percents = np.rint((probability - reading.free_thresh) / span * 100)
        free |= between & (percents == 0)
        occupied |= between & (percents == 100)
        if pixels.opacity is not None:
            opaque = pixels.opacity == OPAQUE
            return free[brightness] & opaque, occupied[brightness] & opaque
    return free[brightness], occupied[brightness]


def _pixels(path: Path) -> _Pixels:
    """Read an image."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                if max(image.size) > LONGEST_SIDE:
                    raise Image.DecompressionBombError
                image.load()
                return _pixels_of(image)
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


def _pixels_of(image: Image.Image) -> _Pixels:
    if image.mode.startswith("I;16"):
        return _Pixels(np.asarray(image).astype(np.int32), 1, 65535, None)
    if image.mode == "I":  # Pillow reads 16-bit PGM so
        values = np.asarray(image)
        most = 65535 if values.max(initial=0) > OPAQUE else OPAQUE
        return _Pixels(values, 1, most, None)
    if image.has_transparency_data:
        pixels = np.asarray(image.convert("RGBA"))
        colours = pixels[..., :3].sum(axis=-1, dtype=np.int32)
        return _Pixels(colours, 3, OPAQUE, pixels[..., 3])
    if image.mode in ("1", "L"):
        return _Pixels(np.asarray(image.convert("L")), 1, OPAQUE, None)
    pixels = np.asarray(image.convert("RGB"))
    return _Pixels(pixels.sum(axis=-1, dtype=np.int32), 3, OPAQUE, None)


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
    side = grid.squares.side
    height, width = (count * plan.resolution / side for count in plan.free.shape)
    ahead, left = grid.origin.relative(plan.origin.x, plan.origin.y)
    corner_and_size = {
        "x": ahead / side,
        "y": grid.shape[0] - left / side - height,
        "width": width,
        "height": height,
    }
    return {"href": data_url(plan), **corner_and_size}
