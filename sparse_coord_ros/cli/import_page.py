# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`import-map --page`: clicks choose robots and doorways, a team learns, and bodies drive it."""

import argparse
import dataclasses
import math
import queue
import signal
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from sparse_coord_ros.base.errors import (
    MapError,
    RunError,
    SettingError,
    SparseCoordError,
    failure_of,
    retold,
)
from sparse_coord_ros.base.palette import DOORWAY_COLOUR, ROBOT_COLOURS
from sparse_coord_ros.cli import train
from sparse_coord_ros.cli.imported_map import (
    CELL,
    RADIUS,
    ImportedMap,
    along,
    check_free,
    make,
    write,
)
from sparse_coord_ros.cli.main import make_parser
from sparse_coord_ros.cli.page import served, show_end
from sparse_coord_ros.core.engine.training_checkpoint import CHECKPOINT_FILE
from sparse_coord_ros.core.game.grid import FURTHEST, number_of
from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.core.runs.saved_tables import load_team
from sparse_coord_ros.lab.driving.trials import DRIVE_SETTINGS, Moment, drive, remedies
from sparse_coord_ros.lab.maps.floor_plan import FloorPlan
from sparse_coord_ros.lab.maps.image import (
    FIELDS,
    data_url,
    fields_of,
    is_picture,
    read_floor_plan,
    read_picture,
    write_header,
)
from sparse_coord_ros.lab.maps.meeting import prospect_of
from sparse_coord_ros.lab.maps.plan import Place
from sparse_coord_ros.show.page.controls import (
    DRIVE,
    IMPORT,
    SAVE,
    STOP,
    TRAIN,
    Control,
    Controlled,
)
from sparse_coord_ros.show.page.message_board import MessageBoard

CELL_AT_FIRST = 0.5
RADIUS_AT_FIRST = 0.2
"""Metres, unless the options say otherwise."""

FIELD = "import_map"
"""The field of a map's YAML file that says with which choices the page opens."""

SCALE_AT_FIRST: dict[str, Any] = {"resolution": 0.05, "origin": (0.0, 0.0)}
"""Metres a pixel (as most tools of SLAM have it), and (x, y) of the lower left corner in metres,
of a picture without a YAML file, until the page says otherwise."""

EPISODES = 20
"""In which bodies drive a team; a film shows the first one."""

MOST_FRAMES = 600
"""Of that film."""

SUPERSEDED_BY = {IMPORT: (IMPORT,), SAVE: (IMPORT, SAVE), STOP: (TRAIN, DRIVE)}
"""What need not be done any more, by what was wished for right after it."""

PLACES = ("start", "goal", "doorway", "no_doorway")
"""What a page chooses by clicks, by the options' names in the namespace."""


def serve(options: argparse.Namespace) -> None:
    """Serve the page until Ctrl-C; teams learn and drive in this thread, one after the other."""
    learning = MessageBoard()
    board = MessageBoard()
    board.source = page = ImportPage(options, board)
    for work in (page.work, page.judge):
        threading.Thread(target=work, daemon=True).start()
    with (
        served(options, learning, board, index="import.html"),
        suppress(KeyboardInterrupt),  # a Ctrl-C just after a stop
    ):
        while True:
            try:
                page.do(*page.wanted.get(), learning)
            except KeyboardInterrupt:
                if not page.stopped():
                    return


class ImportPage(Controlled):
    """Imports a map again with each change that a page makes, and saves what came of it.

    Args:
        options: of the verb: where the page begins.
        board: where the messages go.

    Attributes:
        wanted: what is to be done: train and a scenario's file, or drive and a run's directory.

    Raises:
        MapError: the map cannot be read.
    """

    _plan: FloorPlan

    def __init__(self, options: argparse.Namespace, board: MessageBoard) -> None:
        super().__init__()
        self._options = options
        self._board = board
        self._replace = options.replace
        self._picture = is_picture(options.map)
        if self._picture:
            self._plan = read_picture(options.map, **_pose_of(SCALE_AT_FIRST))
        else:
            self._plan = read_floor_plan(options.map)
        self._along = along(self._plan, options.turn)
        self._to_judge: queue.SimpleQueue[tuple[dict[str, Any], Scenario]] = (
            queue.SimpleQueue()
        )
        self._busy = self._stopped = self._learned = False
        self._lock = threading.Lock()
        self._out: Path | None = None
        self.wanted: queue.SimpleQueue[tuple[str, Path]] = queue.SimpleQueue()
        first = _first(options, self._plan.resolution)
        if self._picture:
            first["scale"] = SCALE_AT_FIRST
        board.put(
            "run",
            controls=(IMPORT, SAVE, TRAIN, STOP, DRIVE),
            name=self._plan.name,
            picture=data_url(self._plan),
            pixels=self._plan.free.shape[::-1],
            scale={
                "resolution": self._plan.resolution,
                "origin": list(self._plan.origin),
            },
            header=str(self._plan.path) if self._picture else "",
            doorway_colour=DOORWAY_COLOUR,
            colours=ROBOT_COLOURS,
            chosen=first,
        )
        self._wishes.put(Control(IMPORT, first))

    def control(self, control: Control) -> None:
        """Do it soon; SparseCoordError where a value is none. Called from the server's thread."""
        if control.name == STOP:
            self._stop()  # at once; as a wish it stops a team that has not begun
        value = None
        if control.name not in (DRIVE, STOP):
            value = _chosen(control.value, scaled=self._picture)
        self._wishes.put(Control(control.name, value))

    def work(self) -> None:
        """Do what is wished for, for ever; a wish that a later one makes needless is left out."""
        waiting: list[Control] = []
        while True:
            while not waiting or not self._wishes.empty():
                wish = self._wishes.get()
                while waiting and waiting[-1].name in SUPERSEDED_BY.get(wish.name, ()):
                    waiting.pop()
                waiting.append(wish)
            try:
                self._do(waiting.pop(0))
            except (SparseCoordError, OSError) as error:
                self._board.put("problem", text=str(failure_of(error)))

    def judge(self) -> None:
        """Say for ever what coordination will bring, of the newest scenario that was made."""
        while True:
            chosen, scenario = self._to_judge.get()
            while not self._to_judge.empty():
                chosen, scenario = self._to_judge.get()
            try:
                prospect = prospect_of(scenario)
            except SparseCoordError as error:
                self._board.put("problem", text=str(error))
                continue
            self._board.put(
                "prospect",
                chosen=chosen,
                advice=prospect.advice.text,
                note=prospect.note,
                doorway=prospect.doorway,
            )

    def _stop(self) -> None:
        """Stop the team that learns or drives, if there is one."""
        with self._lock:
            if not self._busy or self._stopped:
                return
            try:
                self.wanted.get_nowait()
            except queue.Empty:  # the main thread has it
                self._stopped = True
                signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
            else:
                self._tell("Stopped.")

    def _do(self, wish: Control) -> None:
        if wish.name == STOP:
            self._stop()
            return
        if wish.name in (TRAIN, DRIVE) and self._busy:
            raise RunError(
                "a team is already learning or driving: wait until it ends, or stop it"
            )
        if wish.name == DRIVE:
            if self._out is None or not self._learned:
                raise RunError("no team has learned yet")
            self._begin(DRIVE, self._out)
            return
        options = argparse.Namespace(**{**vars(self._options), **wish.value})
        if self._picture:
            self._scale_by(wish.value["scale"], options)
        made = make(options, self._along)
        grid = made.imported.grid
        shown = {"rows": grid.rows, "doorways_in_words": grid.doorways_in_words}
        self._board.put("imported", chosen=wish.value, **shown, **made.facts)
        if made.scenario is not None:
            self._to_judge.put((wish.value, made.scenario))
        if wish.name != SAVE:
            self._board.put_new("film", seconds=[], places=[])
        if wish.name != IMPORT:
            if wish.name == TRAIN and made.scenario is None:
                raise RunError("no robot is placed: click its start and its goal")
            files = self._save(options, made)
            self._board.put("saved", files=list(map(str, files)))
            if wish.name == TRAIN:
                self._begin(TRAIN, files[1])
        self._board.put("problem", text="")

    def _scale_by(self, scale: Any, options: argparse.Namespace) -> None:
        """Give the picture another scale, if it has another one."""
        pose = _pose_of(scale)
        if all(getattr(self._plan, name) == value for name, value in pose.items()):
            return
        self._plan = dataclasses.replace(self._plan, **pose)
        self._along = along(self._plan, options.turn)

    def _save(self, options: argparse.Namespace, made: ImportedMap) -> list[Path]:
        """Write all files, and return them; a picture gets its YAML file, too."""
        check_free(options, self._plan, replace=self._replace)
        header = self._plan.path
        if self._picture and header.exists() and not self._replace:
            raise MapError(f"{header}: exists already, nothing is overwritten; give it")
        files = [*made.files, write(options, made)]
        if self._picture:
            write_header(self._plan, options.map.name)
            files.append(header)
        self._replace = True  # they are this page's own now
        return files

    def _begin(self, what: str, path: Path) -> None:
        with self._lock:
            self._tell("It begins ...", busy=True)
            self.wanted.put((what, path))

    def _tell(self, text: str, *, busy: bool = False) -> None:
        """Say what goes on; not `busy`: what has come of it."""
        self._busy = busy
        self._board.put("team", text=text, busy=busy, learned=self._learned)
        if not busy:  # so that is no problem any more
            self._board.put("problem", text="")

    def do(self, what: str, path: Path, board: MessageBoard) -> None:
        """Let a team learn, or bodies drive it, as `wanted` says; KeyboardInterrupt ends it."""
        try:
            if what == TRAIN:
                self._learn(path, board)
            else:
                self._drive(path)
        except SparseCoordError as error:
            self._tell(str(error))

    def _learn(self, scenario: Path, board: MessageBoard) -> None:
        """Let a team learn as `train` does, with the learner that needs the fewest steps."""
        words = ["train", str(scenario), "--learner", "voi"]
        options = make_parser("train").parse_args(words)
        self._out, run = train.begin(options)
        self._learned = False
        self._tell(f"A team learns: {self._out}", busy=True)
        train.learn(options, self._out, run, board)
        show_end(board, self._out)
        self._learned = True
        word = (board.get("evaluation") or {}).get("verdict", "")
        self._tell(f"Learned: {self._out}. {word}")

    def _drive(self, out: Path) -> None:
        """Drive a team in bodies of the map's radius."""
        run = load_run(out)
        driven = drive(
            run,
            load_team(out, run.scenario, run.rule),
            episodes=EPISODES,
            seed=0,
            values=DRIVE_SETTINGS.defaults(),
            followed=1,
            progress=lambda n: self._tell(
                f"Driven: {n} of {EPISODES} episodes", busy=True
            ),
        )
        simulator = driven.team.simulator
        radius = simulator.metric_map.radius
        self._board.put("film", radius=radius, **_film(driven.team.path))
        sentences = [
            f"Bodies of radius {radius:g} m drove {EPISODES} episodes: in "
            f"{driven.arrived.all(axis=1).sum()} all robots arrived; walls touched: "
            f"{simulator.bumps}, bodies: {len(simulator.touches)}.",
            *remedies(run, driven),
            "The film on the map shows the first one. Other bodies: sparse_coord drive "
            f"{out}",
        ]
        self._tell(" ".join(sentences))

    def stopped(self) -> bool:
        """Return whether an interrupt is the page's wish to stop; then it is told so."""
        stopped = self._stopped
        self._stopped = False
        if stopped and self._busy:  # else its end was faster
            saved = self._out is not None and (self._out / CHECKPOINT_FILE).exists()
            self._tell(
                "Stopped."
                + f" Continue with: sparse_coord train --resume {self._out}" * saved
            )
        return stopped


def _film(path: Sequence[Moment]) -> dict[str, Any]:
    """Return a film of an episode for a page: seconds, and the bodies' places at these times."""
    step = math.ceil(len(path) / MOST_FRAMES)
    frames = [*path[:-1:step], path[-1]]
    start = frames[0].seconds
    return {
        "seconds": [round(frame.seconds - start, 2) for frame in frames],
        "places": [
            [[round(x, 3), round(y, 3)] for x, y in frame.places] for frame in frames
        ],
    }


def _first(options: argparse.Namespace, pixel: float) -> dict[str, Any]:
    """Return the choices with which the page opens: by option, map file, or ours.

    Args:
        options: the options.
        pixel: metres a pixel; a cell is no smaller.

    Raises:
        SparseCoordError: the map's file cannot be read, or its field `import_map` has a bad value.
    """
    first: dict[str, Any] = {
        "cell": max(CELL_AT_FIRST, pixel),
        "radius": RADIUS_AT_FIRST,
    }
    first |= {name: [] for name in PLACES} | {"corridors": False}
    if not is_picture(options.map):
        kept = fields_of(options.map).get(FIELD, {})
        with retold(MapError, SparseCoordError, f"{options.map}: field {FIELD!r}"):
            if not isinstance(kept, Mapping):
                raise SettingError(f"allowed: {', '.join(first)}, each with its value")
            first |= _chosen({**first, **kept}, scaled=False)
    for name in first:
        given = getattr(options, name)
        if given != options.parser.get_default(name):
            first[name] = given
    return first


def _chosen(choices: Mapping[str, Any], *, scaled: bool) -> dict[str, Any]:
    """Return the page's choices, checked; a start may have no goal yet.

    Args:
        choices: the choices.
        scaled: whether they say the scale of the picture.

    Raises:
        SparseCoordError: a value is none.
    """
    numbers = {
        setting.name: setting.parse(choices.get(setting.name))
        for setting in (CELL, RADIUS)
    }
    places = {name: _places(name, choices.get(name)) for name in PLACES}
    corridors = choices.get("corridors")
    if not isinstance(corridors, bool):
        raise SettingError("corridors: allowed: true or false")
    chosen = {**numbers, **places, "corridors": corridors}
    if scaled:
        scale = choices.get("scale")
        if not isinstance(scale, Mapping):
            raise SettingError("scale: allowed: resolution and origin of the picture")
        chosen["scale"] = _scale(scale)
    return chosen


def _scale(scale: Mapping[str, Any]) -> dict[str, Any]:
    """Return a picture's `resolution` in metres a pixel, and its `origin` in metres, checked."""
    [origin] = _places("origin", [scale.get("origin")])
    return {
        "resolution": FIELDS["resolution"].parse(scale.get("resolution")),
        "origin": origin,
    }


def _pose_of(scale: Mapping[str, Any]) -> dict[str, Any]:
    """Return a picture's scale with its origin as a pose."""
    return {**scale, "origin": Pose(*scale["origin"])}


def _places(name: str, value: Any) -> list[Place]:
    pairs = isinstance(value, list) and all(
        isinstance(p, list) and len(p) == 2 for p in value
    )
    if not pairs:
        raise SettingError(f"{name}: allowed: a list of places, each [x, y] in metres")
    x_of, y_of = (
        [number_of(p[k], -FURTHEST, FURTHEST, name) for p in value] for k in (0, 1)
    )
    return list(zip(x_of, y_of, strict=True))
