# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of `watch`, `run --watch` and `train --watch`: served while a block runs."""

import argparse
import time
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from sparse_coord_ros.base.errors import RunError, SparseCoordError
from sparse_coord_ros.cli.options import note
from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.core.runs.saved_tables import load_team
from sparse_coord_ros.show.page.controls import NEXT, Control, Controlled
from sparse_coord_ros.show.page.message_board import MessageBoard

if TYPE_CHECKING:
    from sparse_coord_ros.ros.nodes.spin import Stop
    from sparse_coord_ros.show.page.server import Server

Team = TypeVar("Team")


@contextmanager
def served(
    options: argparse.Namespace, *boards: MessageBoard, index: str = "index.html"
) -> Iterator["Server"]:
    """Serve the page at the address in the options, and print the address.

    Args:
        options: of the verb.
        boards: the boards of the page; without: an empty one.
        index: the file that is shown first.

    Raises:
        RunError: aiohttp is missing, the port is taken, or the address cannot be served.
    """
    from sparse_coord_ros.show.page.server import Server

    server = Server(
        *(boards or [MessageBoard()]), host=options.host, port=options.port, index=index
    )
    with closing(server):
        if server.warning:
            note(f"warning: {server.warning}")
        announce(server, options)
        yield server


def announce(server: "Server", options: argparse.Namespace) -> None:
    """Print the address of a page that has something to show; open it where that is wanted."""
    note(f"the page is at {server.address}")
    if options.browser and not webbrowser.open(server.address):
        note("no browser was found: open that address in one")


class RunChoice(Controlled):
    """The source between two runs: receives the choice of the next run."""

    next: Mapping[str, Any] | None = None

    def control(self, control: Control) -> None:
        """Note the choice; called from the server's thread."""
        if control.name != NEXT:
            raise RunError("the run is over: choose the next one")
        self.next = control.value


def one_by_one(
    options: argparse.Namespace,
    begin: Callable[[argparse.Namespace], tuple[Path, Team]],
    play: Callable[[argparse.Namespace, Path, Team, MessageBoard], int | None],
    stop: "Stop | None" = None,
) -> int | None:
    """Let teams learn one after the other on a page, as it requests; return the exit code.

    Args:
        options: of the verb; the page chooses the next team's scenario, penalty, learner and
            steps.
        begin: returns a team's output directory, and its configuration.
        play: lets it learn to the end; returns the exit code.
        stop: catches the signals that end the waiting between two teams; None: Ctrl-C does.
    """
    out, team = begin(options)
    with served(options) as server:
        while True:
            code = play(options, out, team, server.board)
            if code:
                return code
            try:
                with nullcontext() if stop is None else stop.at_once():
                    show_end(server.board, out)
                    wish = next_wish(server, lambda: bool(stop))
            except KeyboardInterrupt:
                return None
            options.scenario = wish["scenario"]
            options.penalty = wish["penalty"]
            options.learner = wish["learner"]
            options.steps = wish["steps"]
            options.start = options.goal = []
            options.out = options.resume = None
            out, team = begin(options)


def show_end(board: MessageBoard, out: Path) -> None:
    """Show the learned policy of a finished run."""
    from sparse_coord_ros.show.page.page_messages import measured, put_end

    try:
        run = load_run(out)
        tables = load_team(out, run.scenario, run.rule)
        put_end(board, run, tables, measured(run, tables))
    except SparseCoordError as error:
        board.put("notice", text=str(error))


def next_wish(server: "Server", stop: Callable[[], bool]) -> Mapping[str, Any]:
    """Wait for the page's next request; Ctrl-C ends the waiting.

    Args:
        server: of the page.
        stop: returns whether to stop waiting; called several times a second.

    Returns:
        The scenario's name, penalty, learner and steps, as settings.

    Raises:
        KeyboardInterrupt: on Ctrl-C, or if `stop` returns True.
    """
    wishes = RunChoice()
    server.board.source = wishes
    note(
        f"the run is over; the page stays at {server.address}: start the next run there, or end "
        "with Ctrl-C"
    )
    while wishes.next is None:
        if stop():
            raise KeyboardInterrupt
        time.sleep(0.05)
    server.board.source = None
    return wishes.next
