# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`import-map --page`: clicks choose robots and doorways, a team learns, and bodies drive it."""

import argparse
import queue
import signal
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sparse_coord_ros.base.errors import (
    RunError,
    SettingError,
    SparseCoordError,
    failure_of,
)
from sparse_coord_ros.base.palette import DOORWAY_COLOUR, ROBOT_COLOURS
from sparse_coord_ros.cli import train
from sparse_coord_ros.cli.imported_map import CELL, RADIUS, check_free, make, write
from sparse_coord_ros.cli.main import make_parser
from sparse_coord_ros.cli.page import served, show_end
from sparse_coord_ros.core.engine.training_checkpoint import CHECKPOINT_FILE
from sparse_coord_ros.core.game.grid import FURTHEST, number_of
from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.core.runs.tables import load_team
from sparse_coord_ros.lab.driving.trials import DRIVE_SETTINGS, drive
from sparse_coord_ros.lab.maps.image import data_url, read_floor_plan
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

EPISODES = 20
"""In which bodies drive a team."""

SUPERSEDED_BY = {IMPORT: (IMPORT,), SAVE: (IMPORT, SAVE), STOP: (TRAIN, DRIVE)}
"""What need not be done any more, by what was wished for right after it."""

PLACES = ("start", "goal", "doorway", "no_doorway")
"""What a page chooses by clicks, by the options' names in the namespace."""


def serve(options: argparse.Namespace) -> None:
    """Serve the page until Ctrl-C; teams learn and drive in this thread, one after the other."""
    learning = MessageBoard()
    board = MessageBoard()
    board.source = page = ImportPage(options, board)
    threading.Thread(target=page.work, daemon=True).start()
    with served(options, learning, board, index="import.html"):
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

    def __init__(self, options: argparse.Namespace, board: MessageBoard) -> None:
        super().__init__()
        self._options = options
        self._board = board
        self._replace = options.replace
        self._plan = plan = read_floor_plan(options.map)
        self._busy = self._stopped = self._learned = False
        self._lock = threading.Lock()
        self._out: Path | None = None
        self.wanted: queue.SimpleQueue[tuple[str, Path]] = queue.SimpleQueue()
        cell = CELL_AT_FIRST if options.cell is None else options.cell
        radius = RADIUS_AT_FIRST if options.radius is None else options.radius
        first = {
            "cell": cell,
            "radius": radius,
            **{n: getattr(options, n) for n in PLACES},
        }
        rows, columns = plan.free.shape
        board.put(
            "run",
            controls=(IMPORT, SAVE, TRAIN, STOP, DRIVE),
            name=plan.name,
            picture=data_url(plan),
            origin=plan.origin,
            size=(columns * plan.resolution, rows * plan.resolution),
            doorway_colour=DOORWAY_COLOUR,
            colours=ROBOT_COLOURS,
            chosen=first,
        )
        self._wishes.put(Control(IMPORT, first))

    def control(self, control: Control) -> None:
        """Do it soon; SparseCoordError where a value is none. Called from the server's thread."""
        if control.name == STOP:
            self._stop()  # at once; as a wish it stops a team that has not begun
        value = None if control.name in (DRIVE, STOP) else _chosen(control.value)
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
        made = make(options, self._plan)
        grid = made.imported.grid
        shown = {"rows": grid.rows, "doorways_in_words": grid.doorways_in_words}
        self._board.put("imported", chosen=wish.value, **shown, **made.facts)
        if wish.name != IMPORT:
            if wish.name == TRAIN and made.scenario is None:
                raise RunError("no robot is placed: click its start and its goal")
            check_free(options, replace=self._replace)
            files = [*made.files, write(options, made)]
            self._replace = True  # they are this page's own now
            self._board.put("saved", files=list(map(str, files)))
            if wish.name == TRAIN:
                self._begin(TRAIN, files[1])
        self._board.put("problem", text="")

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
        words = ["train", str(scenario), "--learner", "factored"]
        options = make_parser("train").parse_args(words)
        self._out, run = train.begin(options)
        self._learned = False
        self._tell(f"A team learns: {self._out}", busy=True)
        train.learn(options, self._out, run, board)
        show_end(board, self._out)
        self._learned = True
        word = (board.get("evaluation") or {}).get("last_word", "")
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
            progress=lambda n: self._tell(
                f"Driven: {n} of {EPISODES} episodes", busy=True
            ),
        )
        simulator = driven.team.simulator
        self._tell(
            f"Bodies of radius {simulator.metric_map.radius:g} m drove {EPISODES} episodes: in "
            f"{driven.arrived.all(axis=1).sum()} all robots arrived; walls touched: "
            f"{simulator.bumps}, bodies: {len(simulator.touches)}. With pictures and other "
            f"bodies: sparse_coord drive {out}"
        )

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


def _chosen(said: Mapping[str, Any]) -> dict[str, Any]:
    """Return the page's choices, checked; a start may have no goal yet.

    Raises:
        SparseCoordError: a value is none.
    """
    numbers = {one.name: one.parse(said.get(one.name)) for one in (CELL, RADIUS)}
    return {**numbers, **{name: _places(name, said.get(name)) for name in PLACES}}


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
