# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`import-map --page`: clicks choose robots and doorways, cells are seen; then a team learns."""

import argparse
import queue
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sparse_coord_ros.cli import train
from sparse_coord_ros.cli.import_map import CELL, RADIUS, Made, check_free, make, write
from sparse_coord_ros.cli.main import make_parser
from sparse_coord_ros.cli.page import announce, served, show_end
from sparse_coord_ros.errors import RunError, SettingError, SparseCoordError, failure_of
from sparse_coord_ros.game.grid import FURTHEST, number_of
from sparse_coord_ros.look.page.board import Board
from sparse_coord_ros.look.page.controls import IMPORT, SAVE, TRAIN, Control, Controlled
from sparse_coord_ros.maps.image import read_floor_plan
from sparse_coord_ros.maps.plan import Place
from sparse_coord_ros.maps.preview import data_url
from sparse_coord_ros.palette import DOORWAY_COLOUR, ROBOT_COLOURS

if TYPE_CHECKING:
    from sparse_coord_ros.look.page.server import Server

CELL_AT_FIRST, RADIUS_AT_FIRST = 0.5, 0.2
"""Metres, unless the options say otherwise."""

PLACES = ("start", "goal", "doorway", "no_doorway")
"""What a page chooses by clicks, by the options' names in the namespace."""


def serve(options: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C; teams learn in this thread, one after the other."""
    learning, board = Board(), Board()
    with served(options, learning, board, index="import.html") as server:
        page = ImportPage(options, board)
        board.source = page
        announce(server, options)
        threading.Thread(target=page.work, daemon=True).start()
        while True:
            try:
                scenario = page.wanted.get()
            except KeyboardInterrupt:
                return 0
            page.learn(scenario, server)


class ImportPage(Controlled):
    """Imports a map again with each change that a page makes, and saves what came of it.

    Args:
        options: of the verb: where the page begins.
        board: where the messages go.

    Attributes:
        wanted: scenario files on which teams are to learn.

    Raises:
        MapError: the map cannot be read.
    """

    def __init__(self, options: argparse.Namespace, board: Board) -> None:
        super().__init__()
        self._options, self._board, self._replace = options, board, options.replace
        self._plan = plan = read_floor_plan(options.map)
        self._learning = False
        self.wanted: queue.SimpleQueue[Path] = queue.SimpleQueue()
        cell = CELL_AT_FIRST if options.cell is None else options.cell
        radius = RADIUS_AT_FIRST if options.radius is None else options.radius
        first = {"cell": cell, "radius": radius, **{n: getattr(options, n) for n in PLACES}}
        rows, columns = plan.free.shape
        board.put(
            "run",
            controls=(IMPORT, SAVE, TRAIN),
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
        self._wishes.put(Control(control.name, _chosen(control.value)))

    def work(self) -> None:
        """Do what is wished for, for ever; of several imports only the last."""
        while True:
            wish = self._wishes.get()
            while wish.name == IMPORT and not self._wishes.empty():
                wish = self._wishes.get()
            try:
                self._do(wish)
            except (SparseCoordError, OSError) as error:
                self._board.put("problem", text=str(failure_of(error)))

    def _do(self, wish: Control) -> None:
        options = argparse.Namespace(**{**vars(self._options), **wish.value})
        made = make(options, self._plan)
        self._board.put("imported", chosen=wish.value, **_fields(made))
        if wish.name != IMPORT:
            if wish.name == TRAIN and (self._learning or made.scenario is None):
                busy = "a team learns already: wait for its end"
                raise RunError(busy if self._learning else "no robot is there: click its places")
            check_free(options, replace=self._replace)
            files = [*made.files, write(options, made)]
            self._replace = True  # they are this page's own now
            self._board.put("saved", files=list(map(str, files)))
            if wish.name == TRAIN:
                self._learning = True
                self.wanted.put(files[1])
        self._board.put("problem", text="")

    def learn(self, scenario: Path, server: "Server") -> None:
        """Let a team learn as `train` does; the server's first board shows it."""
        options = make_parser("train").parse_args(["train", str(scenario)])
        try:
            out, run = train.begin(options)
            self._board.put("learning", out=str(out), word="")
            train.learn(options, out, run, server)
            show_end(server, out)
            found = server.board.get("evaluation") or {}
            self._board.put("learning", out=str(out), word=found.get("last_word", ""))
        except SparseCoordError as error:
            self._board.put("problem", text=str(error))
        self._learning = False


def _fields(made: Made) -> dict[str, Any]:
    """Return what a page shows of an imported map."""
    grid = made.imported.grid
    return {
        "rows": grid.rows,
        "origin": grid.origin,
        "side": grid.resolution,
        "cells": len(grid.cells),
        "doorways": made.imported.doorways,
        "suggested": made.suggested,
        "notes": made.notes,
    }


def _chosen(said: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a page chose, checked; there may be a start that has no goal yet.

    Raises:
        SparseCoordError: a value is none.
    """
    numbers = {one.name: one.parse(said.get(one.name)) for one in (CELL, RADIUS)}
    return {**numbers, **{name: _places(name, said.get(name)) for name in PLACES}}


def _places(name: str, value: Any) -> list[Place]:
    pairs = isinstance(value, list) and all(isinstance(p, list) and len(p) == 2 for p in value)
    if not pairs:
        raise SettingError(f"{name}: allowed: a list of places, each [x, y] in metres")
    x_of, y_of = ([number_of(p[k], -FURTHEST, FURTHEST, name) for p in value] for k in (0, 1))
    return list(zip(x_of, y_of, strict=True))
