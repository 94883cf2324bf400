# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of `watch`, `run --watch` and `train --watch`: served while a block runs."""

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from sparse_coord_ros.core.settings import Setting
from sparse_coord_ros.errors import RunError

if TYPE_CHECKING:
    from sparse_coord_ros.watch.server import Server

PORT = Setting("port", int, 8765, "of the page; 0: one that is free", low=0, high=65535)


@contextmanager
def served(options: argparse.Namespace) -> Iterator["Server"]:
    """Serve the page where the options say, and print its address.

    Raises:
        RunError: aiohttp is missing, the port is taken, or the address cannot be served.
        SettingError: the port is none.
    """
    port = PORT.parse(options.port)
    try:
        from sparse_coord_ros.watch.board import Board
        from sparse_coord_ros.watch.server import Server, is_loopback
    except ImportError as error:
        raise RunError(
            f"the page needs the Python package aiohttp ({error}); install it: pip install "
            "aiohttp, or sudo apt install python3-aiohttp"
        ) from None
    server = Server(Board(), host=options.host, port=port)
    try:
        if not is_loopback(options.host):
            print(
                f"warning: the page is served on {options.host}: whoever reaches this machine can "
                "watch, and who has the whole address can control the run",
                file=sys.stderr,
            )
        print(f"watch it at {server.address}", file=sys.stderr, flush=True)
        if options.browser and not _opened(server.address):
            print("no browser is here: open that address in one", file=sys.stderr)
        yield server
    finally:
        server.close()


def _opened(address: str) -> bool:
    """Open a graphical browser; a browser in the terminal would hide everything else."""
    import webbrowser

    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return False
    return type(browser) is not webbrowser.GenericBrowser and browser.open(address)
