# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of the page: `python -m tools.watch_pictures BAG STEP OUT.png [light|dark]`."""

import sys
import threading
from pathlib import Path

from sparse_coord_ros.look.page.bag_source import BagSource
from sparse_coord_ros.look.page.board import Board
from sparse_coord_ros.look.page.controls import PAUSE, SEEK, Control
from sparse_coord_ros.look.page.server import Server
from tools.browser import Browser


def picture(bag: Path, step: int, out: Path, scheme: str = "light") -> None:
    """Draw the page as it shows a bag at a time step."""
    board = Board()
    server, source = Server(board, port=0), BagSource(bag, board)
    for control in (Control(PAUSE, True), Control(SEEK, step)):
        source.control(control)
    over = threading.Event()
    playing = threading.Thread(target=source.play, args=(over.is_set,))
    playing.start()
    try:
        with Browser() as browser:
            browser.size(1320, 900)
            browser.prefer(scheme)
            browser.open(server.address)
            browser.wait_for("document.getElementById('foot').dataset.read === '1'", 600)
            browser.wait_for("!document.getElementById('evaluation-panel').hidden", 600)
            browser.wait_for("document.querySelector('#dialogue li')")
            browser.value("document.getElementById('map').focus()")
            for key in ("ArrowDown", "ArrowRight"):
                browser.press(key)
            browser.value("document.activeElement.blur()")
            browser.wait_for("document.querySelector('#cell td')")
            browser.picture(out)
    finally:
        over.set()
        playing.join()
        server.close()


if __name__ == "__main__":
    picture(Path(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]), *sys.argv[4:5])
