# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Draws maps of map_server whose doorways are known, to count what import-map finds."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml
from PIL import Image
from scipy import ndimage

from sparse_coord_ros.core.game.grid import GridMap

UNKNOWN = 205
WALL = 0
FREE = 254
PIXEL = 0.05
"""Metres."""

DRAWINGS = Path(__file__).with_name("floor_plans.yaml")

NEAR = 0.8
"""Metres from a true doorway's middle within which a found one is that one."""


@dataclass
class Drawing:
    """A floor plan in the making.

    Attributes:
        width, height: metres.
        thick: metres of wall.
        pixels: the image, top row first.
        doors: (x, y) of the middle of each doorway, from the lower left corner.
    """

    width: float
    height: float
    thick: float = 0.2
    doors: list[tuple[float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Begin with free space."""
        shape = round(self.height / PIXEL), round(self.width / PIXEL)
        self.pixels = np.full(shape, FREE, dtype=np.uint8)

    def fill(self, x: float, y: float, x2: float, y2: float, value: int = WALL) -> None:
        """Fill a rectangle."""
        rows = len(self.pixels)
        top = rows - round(y2 / PIXEL)
        bottom = rows - round(y / PIXEL)
        self.pixels[
            max(0, top) : bottom, max(0, round(x / PIXEL)) : round(x2 / PIXEL)
        ] = value

    def wall(self, x: float, y: float, x2: float, y2: float) -> None:
        """Draw a wall along a line, with its thickness to both sides."""
        half = self.thick / 2
        self.fill(x - half, y - half, x2 + half, y2 + half)

    def door(
        self, x: float, y: float, wide: float = 0.9, *, north: bool = True
    ) -> None:
        """Break a doorway into a wall; `north`: one that is passed northward."""
        along, through = (wide / 2, self.thick) if north else (self.thick, wide / 2)
        self.fill(x - along, y - through, x + along, y + through, FREE)
        self.doors.append((x, y))

    def outline(self) -> None:
        """Draw the outer walls."""
        left = low = self.thick / 2
        right = self.width - left
        high = self.height - low
        for y in (low, high):
            self.wall(left, y, right, y)
        for x in (left, right):
            self.wall(x, low, x, high)


def drawn(name: str) -> Drawing:
    """Return one of the plans of floor_plans.yaml."""
    said = yaml.safe_load(DRAWINGS.read_text(encoding="utf-8"))[name]
    width, height = said["size"]
    plan = Drawing(width, height, said["thick"])
    plan.outline()
    for line in said["walls"]:
        plan.wall(*line)
    for x, y, x2, y2 in said.get("gaps", ()):
        plan.fill(x, y, x2, y2, FREE)
    for door in said["doors"]:
        plan.door(*door)
    for door in said.get("eastward", ()):
        plan.door(*door, north=False)
    for box in said.get("things", ()):
        plan.fill(*box)
    return plan


def hall(
    width: float, height: float, racks: list[tuple[float, ...]], seed: int
) -> Drawing:
    """Return a hall as SLAM draws it: racks unknown inside, pillars, furniture, dust, two doors.

    A wall crosses it in the middle; racks are rectangles.
    """
    plan = Drawing(width, height)
    random = np.random.default_rng(seed)
    plan.outline()
    plan.wall(0, height / 2, width, height / 2)
    for share in (0.25, 0.75):
        plan.door(share * width, height / 2)
    for x, y, x2, y2 in racks:
        plan.fill(x, y, x2, y2)
        plan.fill(x + 0.1, y + 0.1, x2 - 0.1, y2 - 0.1, UNKNOWN)
    for x in np.arange(7.5, width - 1, 7.5):
        for y in np.arange(3.75, height, 7.5):
            plan.fill(x, y, x + 0.4, y + 0.4)  # a pillar
    for x, y in random.uniform((3, 3), (width - 3, height - 3), (8, 2)):
        plan.fill(x, y, x + random.uniform(0.3, 1), y + random.uniform(0.3, 1))
    free = np.flatnonzero(plan.pixels == FREE)
    plan.pixels.flat[random.choice(free, len(free) // 500, replace=False)] = WALL
    return plan


def tower() -> Drawing:
    """8 x 8 rooms of 25 m: 4,000 x 4,000 pixels, 112 doorways."""
    plan = Drawing(200.0, 200.0)
    plan.outline()
    for k in range(1, 8):
        plan.wall(25 * k, 0, 25 * k, 200)
        plan.wall(0, 25 * k, 200, 25 * k)
    for k in range(1, 8):
        for j in range(8):
            shift = 3.1 * ((k * 5 + j * 3) % 6 - 2.5)
            plan.door(25 * k, 25 * j + 12.5 + shift, north=False)
            plan.door(25 * j + 12.5 - shift, 25 * k)
    return plan


def scanned(plan: Drawing, degrees: float, seed: int) -> Drawing:
    """Return a plan as SLAM would have it: turned, noisy, in grey, with specks and gaps."""
    random = np.random.default_rng(seed)
    margin = round(1.5 / PIXEL)
    padded = np.pad(plan.pixels, margin, constant_values=UNKNOWN)
    turned = ndimage.rotate(padded, degrees, reshape=True, order=0, cval=UNKNOWN)
    # Walls are seen from inside, a few pixels deep; behind them it is unknown.
    walls = turned == WALL
    free = turned == FREE
    seen = walls & ndimage.binary_dilation(free, iterations=3)
    values = np.where(free, FREE, UNKNOWN)
    ragged = ndimage.binary_dilation(seen) & free & (random.random(seen.shape) < 0.25)
    values[(seen & (random.random(seen.shape) < 0.97)) | ragged] = WALL
    inside = np.flatnonzero(free)
    values.flat[random.choice(inside, len(inside) // 400, replace=False)] = WALL  # dust
    values.flat[random.choice(inside, len(inside) // 300, replace=False)] = UNKNOWN
    made = Drawing(turned.shape[1] * PIXEL, turned.shape[0] * PIXEL)
    made.pixels = values.astype(np.uint8)
    angle = math.radians(degrees)
    for x, y in plan.doors:
        dx = x - plan.width / 2
        dy = y - plan.height / 2
        made.doors.append(
            (
                made.width / 2 + dx * math.cos(angle) - dy * math.sin(angle),
                made.height / 2 + dx * math.sin(angle) + dy * math.cos(angle),
            )
        )
    return made


RAYS = 720
REACH = 9.0
"""Of a scanner: rays a turn, metres."""


def explored(plan: Drawing, degrees: float, seed: int) -> Drawing:
    """Return a plan as a scanner sees it that drives through it: hits and misses of single rays.

    Scans are taken from places in free space, each from a pose that is a little wrong, with
    noisy ranges; some rays are lost, some come back from people who have gone since. A pixel is
    what most rays say of it; what none has crossed is unknown.
    """
    random = np.random.default_rng(seed)
    turned = scanned(plan, degrees, seed)  # for its doorways and its size
    margin = round(1.5 / PIXEL)
    true = ndimage.rotate(
        np.pad(plan.pixels, margin, constant_values=UNKNOWN),
        degrees,
        order=0,
        cval=UNKNOWN,
    )
    free = true == FREE
    clear = ndimage.distance_transform_edt(free) * PIXEL
    lattice = np.zeros_like(free)
    lattice[:: round(1.1 / PIXEL), :: round(1.1 / PIXEL)] = True
    places = np.argwhere(lattice & (clear > 0.35))
    places = places[random.random(len(places)) < 0.75]
    hits = np.zeros(true.shape, dtype=np.int32)
    misses = np.zeros(true.shape, dtype=np.int32)
    walks = np.arange(1, int(REACH / PIXEL) + 1)

    def line(place: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the pixels along rays: rows and columns, shape (rays, steps)."""
        ways = np.sin(angles), np.cos(angles)
        rows, columns = (
            np.clip(np.round(p + np.outer(way, walks)), 0, size - 1).astype(int)
            for p, way, size in zip(place, ways, true.shape, strict=True)
        )
        return rows, columns

    for place in places:
        angles = np.linspace(0, 2 * math.pi, RAYS, endpoint=False) + random.uniform(
            0, 0.01
        )
        blocked = ~free[line(place, angles)]
        length = np.where(blocked.any(axis=1), blocked.argmax(axis=1), len(walks))
        hit = blocked.any(axis=1) & (random.random(RAYS) > 0.02)
        people = random.random(RAYS) < 0.004
        length = np.where(
            people, (length * random.uniform(0.2, 1.0, RAYS)).astype(int), length
        )
        length = length + np.round(random.normal(0, 0.015 / PIXEL, RAYS)).astype(int)
        rows, columns = line(
            place + random.normal(0, 0.012 / PIXEL, 2), angles + random.normal(0, 0.003)
        )
        crossed = walks[None, :] - 1 < length[:, None]
        np.add.at(misses, (rows[crossed], columns[crossed]), 1)
        ends = hit & (length >= 0) & (length < len(walks))
        at = np.flatnonzero(ends), length[ends]
        np.add.at(hits, (rows[at], columns[at]), 1)
    share = hits / np.maximum(hits + misses, 1)
    values = np.where(hits + misses == 0, UNKNOWN, np.where(share > 0.35, WALL, FREE))
    turned.pixels = values.astype(np.uint8)
    return turned


PLANS: dict[str, tuple[Callable[[], Drawing], str, tuple[float, float]]] = {
    "office": (lambda: drawn("office"), "pgm", (-10.0, -7.0)),
    "lab": (lambda: drawn("lab"), "png", (-1.0, -1.6)),
    "warehouse": (lambda: drawn("warehouse"), "png", (0.0, 0.0)),
    "slam_office": (lambda: scanned(drawn("office"), 1.5, 1), "pgm", (-11.3, -8.1)),
    "slam_flat": (lambda: scanned(drawn("flat"), -2.0, 2), "png", (2.5, 100.0)),
    "slam_clinic": (lambda: explored(drawn("clinic"), 0.8, 3), "pgm", (-4.0, -21.5)),
    "slam_school": (lambda: explored(drawn("school"), -1.2, 4), "png", (0.0, 0.0)),
    "depot": (
        lambda: hall(
            30.0, 15.0, [(14 + 3 * k, 2.0, 15.3 + 3 * k, 3.3) for k in range(5)], 5
        ),
        "pgm",
        (0.0, 0.0),
    ),
    "store": (
        lambda: hall(
            31.0, 50.0, [(5 + 7 * k, 3.0, 7 + 7 * k, 20.0) for k in range(4)], 6
        ),
        "pgm",
        (-15.0, -25.0),
    ),
    "tower": (tower, "png", (-100.0, -100.0)),
}
"""Drawing, format of the image and origin."""


def write(name: str, directory: Path) -> list[tuple[float, float]]:
    """Write a map's YAML file and image, and return its doorways in its frame."""
    draw, kind, origin = PLANS[name]
    plan = draw()
    image = directory / f"{name}.{kind}"
    Image.fromarray(plan.pixels).save(image)
    said = {
        "image": image.name,
        "resolution": PIXEL,
        "origin": [*origin, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    (directory / f"{name}.yaml").write_text(yaml.safe_dump(said, sort_keys=False))
    return [(x + origin[0], y + origin[1]) for x, y in plan.doors]


def write_grid(grid: GridMap, directory: Path, pixels: int = 10) -> Path:
    """Write a map's YAML file and image, with cells of 1 m; doorways are free cells."""
    free = np.array([[sign != "#" for sign in row] for row in grid.rows])
    values = np.where(free, FREE, WALL).astype(np.uint8)
    values = values.repeat(pixels, axis=0).repeat(pixels, axis=1)
    directory.mkdir(exist_ok=True)
    Image.fromarray(values).save(directory / f"{grid.name}.pgm")
    said = {
        "image": f"{grid.name}.pgm",
        "resolution": 1.0 / pixels,
        "origin": [0.0, 0.0, 0.0],
    }
    path = directory / f"{grid.name}.yaml"
    path.write_text(yaml.safe_dump(said, sort_keys=False))
    return path


def matched(true: list[tuple[float, float]], grid: GridMap) -> tuple[int, int]:
    """Return how many true doorways a map has, and how many of its doorway cells lie in none."""
    found = [grid.squares.centre(*grid.cells[cell]) for cell in grid.doorways]
    hits = sum(any(math.dist(t, f) <= NEAR for f in found) for t in true)
    return hits, sum(all(math.dist(t, f) > NEAR for t in true) for f in found)
