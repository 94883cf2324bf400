# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`import-map --page` without a browser: what a page may ask for, is told, and saves."""

import os
import signal
import threading
import time
import urllib.request
from collections import Counter

import numpy as np
import pytest
from floor_plans import write_grid
from patience import PATIENCE_SECONDS

from sparse_coord_ros.base.errors import MapError, SparseCoordError
from sparse_coord_ros.cli import import_page
from sparse_coord_ros.cli.import_page import (
    CELL_AT_FIRST,
    RADIUS_AT_FIRST,
    ImportPage,
)
from sparse_coord_ros.cli.main import make_parser
from sparse_coord_ros.core.game.grid import load_map, parse_map
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.show.page.controls import (
    DRIVE,
    IMPORT,
    NEXT,
    SAVE,
    STOP,
    TRAIN,
    Control,
)
from sparse_coord_ros.show.page.message_board import MessageBoard

CHOSEN = {
    "cell": 1,
    "radius": 0.1,
    "start": [[0.5, 4.5], [4.5, 4.5]],
    "goal": [[4.5, 0.5], [0.5, 0.5]],
    "doorway": [[1.5, 2.5]],
    "no_doorway": [],
    "corridors": False,
}
OPTIONS = ("--cell", "1", "--radius", "0.1", "--start", "0.5,4.5", "4.5,4.5")
OPTIONS += ("--goal", "4.5,0.5", "0.5,0.5", "--doorway", "1.5,2.5", "--out")


@pytest.fixture
def plan(folder):
    """Draw env1 as a map of map_server."""
    write_grid(load_map("env1"), folder / "e")


@pytest.fixture
def page(plan):
    """Return the page of that map, and its board."""
    command = ["import-map", "e/env1.yaml", "--page", "--out", "clicked"]
    board = MessageBoard()
    made = ImportPage(make_parser("import-map").parse_args(command), board)
    threading.Thread(target=made.work, daemon=True).start()
    wait_for(lambda: board.get("problem"))
    return made, board


def wait_for(true):
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def told(page, name, **changes):
    """Ask for something; return the problem, or what was imported."""
    made, board = page
    before = board.get("problem")
    made.control(Control(name, CHOSEN | changes))
    wait_for(lambda: board.get("problem") is not before)
    return board.get("problem")["text"] or board.get("imported")


def test_what_is_saved_is_what_the_command_line_saves(page, sparse_coord, folder):
    assert page[1].get("imported")["resolution"] == CELL_AT_FIRST
    shown = told(page, IMPORT, start=[], goal=[], doorway=[])
    assert (shown["cells"], shown["doorways"], shown["resolution"]) == (21, 1, 1)
    for _ in range(2):  # its own files are replaced
        assert told(page, SAVE)["doorways_in_words"] == "1 doorway (2 cells)"
    files = [f"clicked/env1.{end}" for end in ("txt", "yaml", "png")]
    assert page[1].get("saved")["files"] == files
    assert sparse_coord("import-map", "e/env1.yaml", *OPTIONS, "typed")[0] == 0
    for name in files:
        typed = folder / name.replace("clicked", "typed")
        assert (folder / name).read_bytes() == typed.read_bytes()
    assert (
        told(page, TRAIN, start=[], goal=[])
        == "no robot is placed: click its start and its goal"
    )
    told(page, TRAIN)
    what, path = page[0].wanted.get(timeout=PATIENCE_SECONDS)
    assert (what, str(path)) == (TRAIN, "clicked/env1.yaml")
    assert (
        told(page, TRAIN)
        == "a team is already learning or driving: wait until it ends, or stop it"
    )


def test_the_file_of_a_map_says_with_which_choices_the_page_opens(plan, folder):
    file = folder / "e/env1.yaml"
    file.write_text(file.read_text() + "import_map: {cell: 0.5, start: [[0.5, 0.5]]}\n")

    def opened(*options):
        words = ["import-map", "e/env1.yaml", "--page", *options]
        board = MessageBoard()
        ImportPage(make_parser("import-map").parse_args(words), board)
        return board.get("run")["chosen"]

    chosen = opened()
    assert (chosen["cell"], chosen["start"]) == (0.5, [(0.5, 0.5)])
    assert (chosen["radius"], chosen["goal"]) == (RADIUS_AT_FIRST, [])
    assert opened("--cell", "1")["cell"] == 1.0
    assert opened("--radius", "0")["radius"] == 0.0
    file.write_text(file.read_text().replace("0.5, start", "-1, start"))
    with pytest.raises(MapError, match=r"env1.yaml: field 'import_map': .*cell.*-1"):
        opened()


def test_the_page_opens_with_a_map_of_movingai(folder):
    (folder / "rooms.map").write_text(
        "type octile\nheight 3\nwidth 4\nmap\n@@@@\n@..@\n@@@@\n"
    )
    words = ["import-map", "rooms.map", "--page", "--cell", "1"]
    board = MessageBoard()
    made = ImportPage(make_parser("import-map").parse_args(words), board)
    threading.Thread(target=made.work, daemon=True).start()
    wait_for(lambda: board.get("problem"))
    assert board.get("problem")["text"] == ""
    assert board.get("imported")["cells"] == 2


class Counting(MessageBoard):
    """Counts the messages of each kind."""

    def __init__(self):
        super().__init__()
        self.counted = Counter()

    def put(self, kind, **fields):
        self.counted[kind] += 1
        super().put(kind, **fields)


@pytest.fixture
def waiting(plan):
    """Return a page that does nothing yet, and its board; wishes wait."""
    command = ["import-map", "e/env1.yaml", "--page", "--out", "clicked"]
    board = Counting()
    return ImportPage(make_parser("import-map").parse_args(command), board), board


def begin(page, what):
    """Let a page work until it has done what it was told, an import at the end."""
    made, board = page
    last = CHOSEN | {"radius": 0.15}
    made.control(Control(IMPORT, last))
    threading.Thread(target=made.work, daemon=True).start()
    wait_for(
        lambda: (board.get("imported") or {}).get("chosen", {}).get("radius") == 0.15
    )
    wait_for(lambda: board.get("problem"))
    return board.counted[what]


def test_many_saves_are_one(waiting, folder):
    for number in range(100):
        waiting[0].control(Control(SAVE, CHOSEN | {"cell": 0.5 if number < 99 else 1}))
    waiting[0].control(Control(IMPORT, CHOSEN))
    assert begin(waiting, "saved") == 1
    assert waiting[1].counted["imported"] == 2
    assert "resolution: 1.0" in (folder / "clicked/env1.txt").read_text()


def test_a_stop_right_after_train_is_obeyed(waiting):
    """Before the page has looked at either; the wish after it is another one."""
    page, board = waiting
    page.control(Control(TRAIN, CHOSEN))
    page.control(Control(STOP))
    assert begin(waiting, "team") == 0
    assert page.wanted.empty() and board.counted["saved"] == 0
    told((page, board), TRAIN)
    assert page.wanted.get(timeout=PATIENCE_SECONDS)[0] == TRAIN


def test_a_stop_while_the_team_is_made_is_obeyed(waiting, monkeypatch):
    page, board = waiting
    write = import_page.write

    def slowly(*arguments):
        page.control(Control(STOP))  # no team has begun yet
        return write(*arguments)

    monkeypatch.setattr(import_page, "write", slowly)
    page.control(Control(TRAIN, CHOSEN))
    begin(waiting, "team")
    wait_for(lambda: board.get("team")["text"] == "Stopped.")
    assert page.wanted.empty() and not board.get("team")["busy"]


def test_a_stop_before_the_team_learns_is_obeyed(page):
    told(page, TRAIN)
    page[0].control(Control(STOP))  # no main thread has taken it
    assert page[0].wanted.empty() and page[1].get("team")["text"] == "Stopped."


def test_a_problem_is_one_line_and_nothing_is_overwritten(page, folder):
    (folder / "clicked").mkdir()
    (folder / "clicked" / "env1.png").write_text("mine")
    for changes, words in (
        (
            {"start": [[2.5, 0.5], [4.5, 4.5]]},
            "start of robot_1 at 2.5,0.5 is in no free cell",
        ),
        ({"cell": 0.01}, "cells of 0.01 m are smaller than a pixel"),
        ({}, "clicked/env1.png: exists already"),
    ):
        said = told(page, SAVE, **changes)
        assert words in said and "\n" not in said
    assert (folder / "clicked" / "env1.png").read_text() == "mine"
    assert not (folder / "clicked" / "env1.txt").exists()


@pytest.mark.parametrize(
    "changes",
    [
        {"cell": "wide"},
        {"radius": None},
        {"start": 5},
        {"goal": [[1]]},
        {"doorway": [[1, float("nan")]]},
        {"no_doorway": [["a", 1]]},
        {"start": [[True, 1]]},
        {"corridors": "yes"},
    ],
)
def test_odd_values_are_refused(page, changes):
    with pytest.raises(SparseCoordError, match="allowed: "):
        page[0].control(Control(IMPORT, CHOSEN | changes))


def test_a_page_is_served_a_team_learns_and_ctrl_c_ends_it(
    plan, sparse_coord, monkeypatch
):
    seen = []

    def visit(server):
        learning, board = server.page.boards
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/") as answer:
                seen.append(b"/import.js" in answer.read())
            board.source.control(Control(DRIVE))
            wait_for(
                lambda: (
                    (board.get("problem") or {}).get("text")
                    == "no team has learned yet"
                )
            )
            board.source.control(Control(TRAIN, CHOSEN))
            wait_for(lambda: (board.get("team") or {}).get("learned"))
            seen.append(learning.get("run")["controls"])
            board.source.control(Control(DRIVE))
            wait_for(
                lambda: (
                    "20 all robots arrived; walls touched: 0"
                    in board.get("team")["text"]
                )
            )
            film = board.get("film")
            seen.append((film["seconds"], film["places"]))
            monkeypatch.setattr(import_page.train, "learn", lambda *_: time.sleep(60))
            board.source.control(Control(TRAIN, CHOSEN))
            wait_for(lambda: "A team learns" in board.get("team")["text"])
            board.source.control(Control(STOP))
            wait_for(lambda: board.get("team")["text"].startswith("Stopped."))
            board.source.control(Control(STOP))  # nothing goes on: no harm
        finally:
            os.kill(os.getpid(), signal.SIGINT)

    def announced(server, options):
        threading.Thread(target=visit, args=[server]).start()

    monkeypatch.setattr("sparse_coord_ros.cli.page.announce", announced)
    command = (
        "import-map",
        "e/env1.yaml",
        "--page",
        "--port",
        "0",
        "--set",
        "steps=2000",
    )
    code, out, _ = sparse_coord(*command)
    assert code == 0 and "tables   runs/env1_" in out
    assert seen[0] and NEXT not in seen[1]
    seconds, places = seen[2]
    assert seconds == sorted(seconds) and seconds[0] == 0.0
    assert len(places) == len(seconds)
    for frame, chosen in ((places[0], "start"), (places[-1], "goal")):
        assert np.abs(np.subtract(frame, CHOSEN[chosen])).max() < 0.5


def test_it_says_what_coordination_will_bring_and_where_a_doorway_is_missing(page):
    """Robots that face each other across a hall of which no cell is a doorway."""
    made, board = page
    threading.Thread(target=made.judge, daemon=True).start()
    told(page, IMPORT)
    wait_for(lambda: board.get("prospect"))
    assert board.get("prospect")["advice"].startswith("Coordination ")
    assert board.get("prospect")["doorway"] is None
    told(page, IMPORT, no_doorway=[[2.5, 2.5]], doorway=[])
    wait_for(lambda: board.get("prospect")["doorway"])
    prospect = board.get("prospect")
    assert prospect["doorway"] == (2.5, 2.5)
    assert prospect["advice"].startswith("Asking will not pay: ")
    assert "a doorway at 2.5,2.5, where they meet most often" in prospect["note"]


def test_corridors_are_taken_where_the_page_says_so(page, sparse_coord, folder):
    plain = told(page, IMPORT, doorway=[])
    assert plain["corridors"] == 0 and "together fits" in plain["interactions"]
    text = "---\n...###...\n.........\n...###...\n"
    write_grid(parse_map(text, name="lane", where="lane.txt"), folder / "l")
    options = ["import-map", "l/lane.yaml", "--page", "--cell", "1", "--radius", "0.1"]
    board = MessageBoard()
    lane = ImportPage(make_parser("import-map").parse_args(options), board)
    threading.Thread(target=lane.work, daemon=True).start()
    wait_for(lambda: board.get("problem"))
    robots = {"start": [[0.5, 0.5]], "goal": [[8.5, 0.5]], "doorway": []}
    shown = told((lane, board), SAVE, **robots)
    assert shown["corridors"] == 1 and shown["doorways"] == 0
    assert (
        "swap+block fits: 1 corridor is one cell wide (3 cells)"
        in (shown["interactions"])
    )
    assert load_scenario(folder / "lane_map/lane.yaml").interactions == "together"
    shown = told((lane, board), SAVE, corridors=True, **robots)
    assert shown["doorways_in_words"] == "1 doorway (3 cells)"
    assert load_scenario(folder / "lane_map/lane.yaml").interactions == "swap+block"


def test_a_picture_without_a_yaml_file_is_scaled(plan, sparse_coord, folder):
    """The page asks for its scale; what is saved is what a YAML file would have given."""
    header = folder / "e" / "env1.yaml"
    header.rename(folder / "kept.yaml")
    command = ["import-map", "e/env1.pgm", "--page", "--out", "clicked"]
    board = MessageBoard()
    made = ImportPage(make_parser("import-map").parse_args(command), board)
    threading.Thread(target=made.work, daemon=True).start()
    wait_for(lambda: board.get("problem"))
    first = board.get("run")
    assert first["header"] == "e/env1.yaml"
    assert first["chosen"]["scale"]["resolution"] == 0.05
    side = 5 / first["pixels"][0]
    scale = {"resolution": side, "origin": [0, 0]}
    assert told((made, board), SAVE, scale=scale)["cells"] == 21
    assert board.get("saved")["files"][-1] == "e/env1.yaml"
    assert sparse_coord("import-map", "e/env1.yaml", *OPTIONS, "typed")[0] == 0
    for name in ("env1.txt", "env1.yaml", "env1.png"):
        clicked = (folder / "clicked" / name).read_bytes()
        assert clicked == (folder / "typed" / name).read_bytes()
    for odd in ({"resolution": 0, "origin": [0, 0]}, {"origin": [0, 0]}, None):
        with pytest.raises(SparseCoordError, match="allowed: "):
            made.control(Control(IMPORT, CHOSEN | {"scale": odd}))


@pytest.mark.parametrize("more", [[], ["--page"]])
def test_a_picture_that_is_missing_is_said_to_be(sparse_coord, more):
    """The user named the picture, not a YAML file's field."""
    code, _, said = sparse_coord("import-map", "gone.png", *more)
    assert code == 2
    assert said == "error: gone.png: no such image; give an image that exists\n"


def test_a_picture_s_files_are_not_written_over(plan, folder):
    """Its scenario would have the name of its YAML file."""
    (folder / "e" / "env1.yaml").unlink()
    command = ["import-map", "e/env1.pgm", "--page", "--out", "e", "--replace"]
    board = MessageBoard()
    made = ImportPage(make_parser("import-map").parse_args(command), board)
    threading.Thread(target=made.work, daemon=True).start()
    wait_for(lambda: board.get("problem"))
    scale = {"resolution": 0.05, "origin": [0, 0]}
    said = told(
        (made, board), SAVE, scale=scale, cell=0.5, start=[], goal=[], doorway=[]
    )
    assert "would be overwritten; choose another --out" in said
    assert not (folder / "e" / "env1.yaml").exists()
