# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points: they mind signals before the long imports of ROS and NumPy begin."""

import importlib
import os
import signal
import sys

STOPPED, INTERRUPTED = 0, 130


def world_simulator() -> int:
    """Run the node `world_simulator`."""
    return _start("sparse_coord_ros.nodes.world_simulator", STOPPED)


def robot() -> int:
    """Run the node `robot`."""
    return _start("sparse_coord_ros.nodes.robot", STOPPED)


def recorder() -> int:
    """Run the node `recorder`."""
    return _start("sparse_coord_ros.nodes.recorder", STOPPED)


def team() -> int:
    """Run the executable `team`."""
    return _start("sparse_coord_ros.nodes.team", STOPPED)


def player() -> int:
    """Run the node `player`."""
    return _start("sparse_coord_ros.nodes.player", STOPPED)


def driver() -> int:
    """Run the node `driver`."""
    return _start("sparse_coord_ros.nodes.driver", STOPPED)


def body() -> int:
    """Run the node `body`."""
    return _start("sparse_coord_ros.nodes.body", STOPPED)


def watch() -> int:
    """Run the node `watch`."""
    return _start("sparse_coord_ros.nodes.watch", STOPPED)


def sparse_coord() -> int:
    """Run the command line."""
    return _start("sparse_coord_ros.cli.main", INTERRUPTED)


def _start(module: str, code: int) -> int:
    """Import a module and run its `main`; a signal that comes before ends with `code`."""
    before = {
        number: signal.signal(number, lambda *_: os._exit(code))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        if signal.getsignal(number) != signal.SIG_IGN  # nohup: a closed terminal is no matter
    }
    signal.pthread_sigmask(signal.SIG_UNBLOCK, before)  # whoever started this may hold them back
    run = importlib.import_module(module).main
    if module.endswith("cli.main"):  # its verbs that run no nodes are interrupted as Python does
        for number, handler in before.items():
            signal.signal(number, handler)
    return run()


if __name__ == "__main__":
    sys.exit(globals()[sys.argv.pop(1)]())
