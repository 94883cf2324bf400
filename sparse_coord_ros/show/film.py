# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An episode as an animated GIF: robots move, questions are lines from the asker to the asked."""

import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from matplotlib.text import Text
from PIL import Image

from sparse_coord_ros.base import palette
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.show.episodes import Episode
from sparse_coord_ros.show.map_pictures import draw_map
from sparse_coord_ros.show.narrator import Narrator
from sparse_coord_ros.show.steps import Interacting, Question, questions_of

DPI = 100
LONGEST_FILM_SIDE = 7.2
LARGEST_CELL = 0.72
SMALLEST_FILM_CELL = 0.24
"""Inches: of the map's longer side, if its cells then keep a size within the other two."""

LEAST_FILM_WIDTH = 3.6
"""Inches for the words below the map."""

SENTENCES = 3
"""Most questions in words at a time; of further ones only the number."""

MOST_STEPS = 300
"""Most steps of a film."""

SMOOTH_STEPS = 60
"""Robots glide in films of at most this many steps; in longer ones they jump."""

OUTCOME_LINES = {"answered": "-", "refused": (0, (4, 2)), "failed": (0, (1, 2))}
TALK = 1.6
HOLD = 4.0
"""Duration of the still frame of a question, and of the last frame, in time steps."""

ASIDE = 0.23
"""Distance of the signs of two robots that ask each other from the line between them, in cells."""

SHARED = 0.27
"""Distance of robots in a shared cell from its centre, in cells."""


def film(
    scenario: Scenario,
    episode: Episode,
    *,
    title: str,
    rate: float = 2.0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> bytes:
    """Return an episode as the bytes of a GIF; the same episode gives the same bytes.

    Args:
        scenario: the problem.
        episode: the episode.
        title: the title above the picture.
        rate: time steps per second.
        progress: called with the steps drawn and those to draw.
    """
    shown = min(len(episode.steps), MOST_STEPS)
    glide = (0.35, 0.7) if shown <= SMOOTH_STEPS else ()
    pictures = EpisodePictures(scenario, episode, title)
    images = []
    lasting = []
    for step in range(shown):
        if questions_of(episode.steps[step]):
            images.append(pictures.at(step, 0.0, speaking=True))
            lasting.append(TALK)
        images += [pictures.at(step, moved) for moved in (*glide, 1.0)]
        lasting += [*[0.15] * len(glide), 0.7 if glide else 1.0]
        progress(step + 1, shown)
    durations = [max(20, round(100 * lasts / rate) * 10) for lasts in lasting]
    durations[-1] += round(1000 * HOLD / rate)
    file = io.BytesIO()
    rest = images[1:]
    images[0].save(
        file, "gif", save_all=True, append_images=rest, duration=durations, loop=0
    )
    return file.getvalue()


class EpisodePictures:
    """Pictures of an episode: the map is drawn once, the robots anew for each picture.

    Args:
        scenario: the problem.
        episode: the episode.
        title: the title above the map.

    Attributes:
        caption: the text below the map.
    """

    def __init__(self, scenario: Scenario, episode: Episode, title: str) -> None:
        self._episode = episode
        self._names = [robot.name for robot in scenario.robots]
        steps = episode.steps
        rows, columns = scenario.map.shape
        cell = min(LARGEST_CELL, LONGEST_FILM_SIDE / max(rows, columns))
        self._cell = cell = max(SMALLEST_FILM_CELL, cell)
        narrator = Narrator(scenario)
        self._interacting = [narrator.interacting(step) for step in steps]
        self._interactions = [narrator.interactions(step) for step in steps]
        asked = max(len(questions_of(step)) for step in steps)
        self._spoken = min(SENTENCES, max(asked, *map(len, self._interactions)))
        above = 0.32
        below = 0.34 + 0.2 * self._spoken
        width = max(LEAST_FILM_WIDTH, columns * cell + 0.2)
        height = rows * cell + above + below
        self._figure = figure = Figure(figsize=(width, height), dpi=DPI)
        canvas: Any = FigureCanvasAgg(figure)
        self._canvas = canvas
        wide = columns * cell / width
        high = rows * cell / height
        self._axes = figure.add_axes(((1 - wide) / 2, below / height, wide, high))
        draw_map(
            self._axes, scenario, label_size=max(5.0, 11 * cell), label_height=0.14
        )
        for k, robot in enumerate(scenario.robots):
            row, column = scenario.map.cells[robot.goal]
            mark = Rectangle(
                (column + 0.18, row + 0.28), 0.64, 0.64, fill=False, linewidth=2
            )
            mark.set(edgecolor=palette.robot_colour(k), linestyle=(0, (2, 1.5)))
            self._axes.add_patch(mark)
        self._axes.set_title(title, fontsize=10, parse_math=False)
        self._canvas.draw()
        self._empty = self._canvas.copy_from_bbox(figure.bbox)
        self.caption = figure.text(
            0.01, (below - 0.1) / height, "", fontsize=9, va="top"
        )
        self.caption.set_parse_math(False)
        self._places = np.array([*scenario.map.cells, (np.nan, np.nan)])[:, ::-1] + 0.5
        cells = [
            *(step.cells for step in steps),
            steps[-1].after or (None,) * len(self._names),
        ]
        self._cells = np.nan_to_num(np.array(cells, dtype=float), nan=-1).astype(int)
        self._palette = film_palette()

    def at(self, step: int, moved: float, *, speaking: bool = False) -> Image.Image:
        """Return the picture of a moment.

        Args:
            step: the time step, from 0.
            moved: the elapsed share of it.
            speaking: whether its questions are shown.
        """
        positions = (1 - moved) * self._standing(step) + moved * self._standing(
            step + 1
        )
        self._canvas.restore_region(self._empty)
        over = moved == 1.0
        together = over and self._episode.steps[step].miscoordination
        asks = questions_of(self._episode.steps[step]) if speaking else ()
        if over:
            self._put(self._meeting(self._interacting[step], step))
        self._put(self._trails(step, positions))
        self._put(line for ask in asks for line in self._lines(ask, positions))
        self._put(self._robots(positions, {ask.asker for ask in asks}))
        for ask in asks:
            aside = ASIDE if any(map(ask.is_mutual_with, asks)) else 0.0
            self._put(self._sign(ask, positions, aside))
        if over:
            self._put(self._marks(self._interacting[step], step))
        sentences = [ask.in_words(self._names) for ask in asks]
        if over:
            sentences = self._interactions[step]
        self._say(step + over, sentences, together)
        self._figure.draw_artist(self.caption)
        image = Image.frombuffer(
            "RGBA",
            self._canvas.get_width_height(),
            self._canvas.buffer_rgba().tobytes(),
        )
        return image.convert("RGB").quantize(
            palette=self._palette, dither=Image.Dither.NONE
        )

    def _put(self, artists: Iterable[Artist]) -> None:
        """Draw artists in this picture only."""
        for artist in artists:
            self._axes.add_artist(artist)
            self._axes.draw_artist(artist)
            artist.remove()

    def _standing(self, step: int) -> np.ndarray:
        """Return the robots' positions, shape (robots, 2); side by side in one cell."""
        cells = self._cells[step].tolist()
        positions: np.ndarray = self._places[cells]
        for k, cell in enumerate(cells):
            if cells.count(cell) > 1:
                turn = 2 * np.pi * cells[:k].count(cell) / cells.count(cell)
                positions[k] += SHARED * np.array([-np.cos(turn), np.sin(turn)])
        return positions

    def _trails(self, step: int, positions: np.ndarray) -> Iterator[Artist]:
        """Yield each robot's way from its start through the cells of the steps to its position."""
        others = len(self._names) - 1
        for k in range(len(self._names)):
            x, y = np.vstack([self._places[self._cells[: step + 1, k]], positions[k]]).T
            shift = 0.1 * (k - others / 2) / max(1, others)
            yield Line2D(
                x + shift,
                y + shift,
                color=_pale(palette.robot_colour(k)),
                linewidth=2.5,
            )

    def _meeting(self, interacting: Interacting, step: int) -> Iterator[Artist]:
        """Yield the marks of robots that are together in a cell, or exchange their cells."""
        cells = set(interacting.together)
        for pair in interacting.exchanges:
            cells.update(self._cells[step, list(pair)].tolist())
        for x in sorted(cells):
            style: dict[str, Any] = {
                "facecolor": _pale(palette.DOORWAY_COLOUR),
                "hatch": "xx",
            }
            corner = self._places[x] - 0.5
            yield Rectangle(
                corner, 1, 1, edgecolor=palette.DOORWAY_COLOUR, linewidth=3, **style
            )

    def _marks(self, interacting: Interacting, step: int) -> Iterator[Artist]:
        """Yield the signs of exchanges, and a bar before each stopped robot."""
        for pair in interacting.exchanges:
            x, y = self._places[self._cells[step, list(pair)]].mean(axis=0)
            ring = Circle((x, y), 0.22, facecolor="white", linewidth=1.8)
            ring.set_edgecolor(palette.DOORWAY_COLOUR)
            yield ring
            yield self._letter(x, y, palette.EXCHANGE_SIGN, "black", least=7.0)
        for k, _, cell in interacting.stopped:
            at = self._places[self._cells[step, k]]
            ahead = self._places[cell] - at
            middle = at + 0.5 * ahead
            across = 0.36 * np.array([-ahead[1], ahead[0]])
            ends = np.transpose([middle - across, middle + across])
            yield Line2D(*ends, linewidth=6, color="white")
            yield Line2D(*ends, linewidth=3.6, color="black")

    def _robots(self, positions: np.ndarray, askers: set[int]) -> Iterator[Artist]:
        known = {
            k: position
            for k, position in enumerate(positions.tolist())
            if np.isfinite(position[0])
        }
        for k in sorted(askers & known.keys()):
            yield Circle(
                known[k], 0.4, facecolor="white", edgecolor="black", linewidth=2
            )
        for k, (x, y) in known.items():
            colour = palette.robot_colour(k)
            yield Circle(
                (x, y), 0.3, facecolor=colour, edgecolor="black", linewidth=0.8
            )
            yield self._letter(x, y, str(k + 1), palette.ink_on(colour), least=6.0)

    @staticmethod
    def _lines(ask: Question, positions: np.ndarray) -> Iterator[Artist]:
        """Yield the lines from the asker to the robots that it asks; several lines are thinner."""
        width = 3.2 if len(ask.peers) == 1 else 1.8
        for peer in ask.peers:
            line = Line2D(
                *np.transpose([positions[ask.asker], positions[peer]]), linewidth=width
            )
            line.set(
                color=palette.OUTCOME_COLOURS[ask.outcome],
                linestyle=OUTCOME_LINES[ask.outcome],
            )
            yield line

    def _sign(
        self, ask: Question, positions: np.ndarray, aside: float
    ) -> Iterator[Artist]:
        """Yield the sign of a question's outcome, nearer to the asked robot.

        A question to several robots has one sign, beside the asker: more would hide robots.

        Args:
            ask: the question.
            positions: of the robots.
            aside: how far to the side of its line the sign stands, in cells.
        """
        peer = ask.peers[0] if len(ask.peers) == 1 else ask.asker
        x, y = 0.45 * positions[ask.asker] + 0.55 * positions[peer]
        if len(ask.peers) > 1:
            x = x + 0.28
            y = y - 0.28
        along = positions[peer] - positions[ask.asker]
        length = float(np.hypot(*along))
        if length > 0.0:
            x = x - aside * along[1] / length
            y = y + aside * along[0] / length
        if np.isfinite(x):
            colour = palette.OUTCOME_COLOURS[ask.outcome]
            yield Circle(
                (x, y), 0.22, facecolor="white", edgecolor=colour, linewidth=1.8
            )
            yield self._letter(
                x, y, palette.OUTCOME_SIGNS[ask.outcome], "black", least=7.0
            )

    def _letter(
        self, x: float, y: float, letter: str, colour: str, *, least: float
    ) -> Text:
        size = max(least, 17 * self._cell)
        style: dict[str, Any] = {
            "fontweight": "bold",
            "ha": "center",
            "va": "center_baseline",
        }
        return Text(x, y, letter, color=colour, fontsize=size, **style)

    def _say(self, step: int, sentences: Sequence[str], together: bool) -> None:
        lines = list(sentences)
        if len(lines) > self._spoken:
            lines[self._spoken - 1 :] = [f"and {len(lines) - self._spoken + 1} more"]
        length = len(self._episode.steps)
        at = f"step {step} of {length}"
        if together:
            at += ": miscoordination"
        elif step == length:
            at += ": all there" if self._episode.arrived else ": not all there"
        self.caption.set_text("\n".join([at, *lines]))


def _pale(colour: str) -> tuple[float, float, float]:
    red, green, blue = palette.rgb(colour)
    return 0.35 * red + 0.65, 0.35 * green + 0.65, 0.35 * blue + 0.65


def film_palette() -> Image.Image:
    """Return an image whose palette has every drawn colour, and mixtures for smooth edges."""
    colours = [
        *palette.ROBOT_COLOURS,
        *palette.OUTCOME_COLOURS.values(),
        palette.DOORWAY_COLOUR,
    ]
    shares = np.array([1.0, 0.75, 0.5, 0.35, 0.2])[:, None, None, None]
    grounds = np.array([1.0, 0.25, 0.0])[:, None, None]
    mixed = (
        shares * np.array([palette.rgb(colour) for colour in colours])
        + (1 - shares) * grounds
    )
    greys = np.repeat([*np.arange(32) / 31, 0x40 / 255, 0.85], 3)
    image = Image.new("P", (1, 1))
    both = np.round(np.append(mixed, greys).reshape(-1, 3) * 255).astype(np.uint8)
    image.putpalette(np.unique(both, axis=0).tobytes())
    return image
