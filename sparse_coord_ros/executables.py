# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points: they mind signals before the long imports of ROS and NumPy begin.

A node is started by `ros2 run sparse_coord_ros robot`, or without the command `ros2` by
`python -m sparse_coord_ros.executables robot`; both take the same `--ros-args`.
"""

import atexit
import gc
import importlib
import os
import signal
import sys
from pathlib import Path
from typing import NoReturn

from sparse_coord_ros.base.errors import (
    EXIT_BAD_INPUT,
    EXIT_INTERRUPTED,
    RunError,
    SparseCoordError,
)
from sparse_coord_ros.base.signals import STOPPING
from sparse_coord_ros.base.streams import open_streams

COMMAND_LINE = "sparse_coord"
DRIVING = ("driver", "nav2_driver", "nav2_stand_in", "body")
NODES = ("world_simulator", "robot", "recorder", "team", "watch", "player", *DRIVING)
"""Executables; each is the module of its name in `sparse_coord_ros.ros.nodes`, or, if it is in
`DRIVING`, in `sparse_coord_ros.ros.driving`."""


def sparse_coord() -> int:
    """Run the command line."""
    atexit.register(gc.freeze)  # the process ends at once: no search for garbage before
    return main(COMMAND_LINE)


def runs_nodes(verb: list[str]) -> bool:
    """Return whether a verb of the command line, if there is one, runs ROS nodes."""
    from sparse_coord_ros.cli.verbs import LIVE

    return any(name in LIVE for name in verb)


def check_middleware() -> None:
    """Refuse a middleware that is not installed: importing rclpy with it ends the process.

    Raises:
        RunError: RMW_IMPLEMENTATION names none.
    """
    name = os.environ.get("RMW_IMPLEMENTATION", "")
    folders = [Path(sys.prefix) / "lib"]
    folders += map(Path, os.environ.get("LD_LIBRARY_PATH", "").split(":"))
    if name and not any((folder / f"lib{name}.so").exists() for folder in folders):
        raise RunError(
            f"RMW_IMPLEMENTATION is {name!r}, which is not installed; unset it"
        )


def module_of(name: str) -> str:
    """Return the module of an executable."""
    if name == COMMAND_LINE:
        return "sparse_coord_ros.cli.main"
    folder = "driving" if name in DRIVING else "nodes"
    return f"sparse_coord_ros.ros.{folder}.{name}"


def main(name: str) -> int:
    """Run an executable; a signal that comes while it is imported ends the process.

    Args:
        name: one of `NODES`, or `COMMAND_LINE`.
    """
    open_streams()
    is_node = name != COMMAND_LINE
    is_live = is_node or runs_nodes(sys.argv[1:2])
    module = module_of(name)

    def leave(number: int, frame: object) -> NoReturn:
        # An exception could be lost: rclpy takes one in its import for a missing library.
        if is_node:
            os._exit(0)
        os.write(sys.stderr.fileno(), b"interrupted\n")
        os._exit(EXIT_INTERRUPTED)

    before = {
        number: signal.signal(number, leave)
        for number in STOPPING
        if signal.getsignal(number)
        != signal.SIG_IGN  # nohup: a closed terminal is no matter
    }
    # the parent process may block them
    signal.pthread_sigmask(signal.SIG_UNBLOCK, before)
    try:
        if is_live:
            check_middleware()
        run = importlib.import_module(module).main
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    if not is_live:  # it is interrupted as Python does
        for number, handler in before.items():
            signal.signal(number, handler)
    code = run()
    if is_node:  # all is done: a late Ctrl-C of launch must not look like a death
        for number in before:
            signal.signal(number, signal.SIG_IGN)
    return code


if __name__ == "__main__":
    known = (COMMAND_LINE, *NODES)
    if len(sys.argv) < 2 or sys.argv[1] not in known:
        print(
            f"error: give the name of an executable: {', '.join(known)}",
            file=sys.stderr,
        )
        sys.exit(EXIT_BAD_INPUT)
    sys.exit(main(sys.argv.pop(1)))
