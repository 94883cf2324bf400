# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Starts the nodes of a live run: in this process, or each in its own."""

import errno
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Collection, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any, TypeAlias

from rclpy.logging import LoggingSeverity, set_logger_level

from sparse_coord_ros.base.errors import EXIT_BAD_INPUT, BagError, RunError
from sparse_coord_ros.base.signals import held_back
from sparse_coord_ros.cli.options import note
from sparse_coord_ros.core.runs.run_config import create_output
from sparse_coord_ros.log.bags.reader import BAG_DIRECTORY
from sparse_coord_ros.protocol.lockstep.node_checkpoints import CHECKPOINTS
from sparse_coord_ros.protocol.wire import RECORDER, WORLD
from sparse_coord_ros.ros.nodes.environment import (
    DOMAIN,
    ros_domain,
)
from sparse_coord_ros.ros.nodes.outputs import gather, holds_run
from sparse_coord_ros.ros.nodes.parameters import of_node, team_values
from sparse_coord_ros.ros.nodes.spin import Stop, ros_context, signals
from sparse_coord_ros.ros.nodes.team import run_team, team_run
from sparse_coord_ros.show.page.message_board import MessageBoard

Process: TypeAlias = subprocess.Popen[bytes]

POLL_SECONDS = 0.05
ALONE_SECONDS = 3.0
"""How long a world may outlive its robots: at a run's end it waits for its readers."""
GRACE_SECONDS = 15.0
"""How long a stopped process may take to save and close before it is killed."""


def run(
    values: Mapping[str, Any],
    *,
    processes: bool,
    quiet: bool = False,
    page: MessageBoard | None = None,
    stop: Stop | None = None,
) -> dict[str, Any]:
    """Run a team and return its summary.

    Args:
        values: some of `TEAM_PARAMETERS` and of the scenario's settings, as texts or typed.
        processes: whether every node has its own process; else all are in this one.
        quiet: no progress lines.
        page: the board of a page that shows the team in this process; None: none.
        stop: catches the signals that end the run; None: one of its own.

    Raises:
        SparseCoordError: bad input.
    """
    values = team_values(values)
    with signals() if stop is None else nullcontext(stop) as stop, sole_team():
        if processes:
            return _run_processes(values, stop, quiet)
        with ros_context() as context:
            if quiet:
                set_logger_level("", LoggingSeverity.WARN)
            return run_team(values, context=context, stop=lambda: bool(stop), page=page)


def sole_team() -> socket.socket:
    """Hold this machine's ROS domain until the returned socket is closed.

    Raises:
        RunError: another `sparse_coord run` of this user holds it, or the number is not a domain.
    """
    domain = ros_domain()
    holder = socket.socket(socket.AF_UNIX)
    try:  # an abstract address: it leaves no file, and ends with its process
        holder.bind(f"\0sparse_coord_{os.getuid()}_domain_{domain}")
    except OSError as error:
        if error.errno == errno.EADDRINUSE:  # else the system has no abstract addresses
            holder.close()
            raise RunError(
                f"ROS domain {domain}: another process runs a team in it; wait for its end, or "
                f"choose another {DOMAIN}"
            ) from None
    return holder


def _run_processes(values: dict[str, Any], stop: Stop, quiet: bool) -> dict[str, Any]:
    run = team_run(values)
    out = Path(values["out"])
    if not holds_run(values["out"]):
        create_output(out)
    bag = out / BAG_DIRECTORY
    kinds = {WORLD: WORLD, **{robot.name: "robot" for robot in run.scenario.robots}}
    if values["record"]:
        kinds[RECORDER] = RECORDER
    processes: dict[str, Process] = {}
    try:
        for name, kind in kinds.items():
            parameters = of_node(kind, values)
            if kind == RECORDER:
                parameters |= {"out": str(bag)}
            processes[name] = _start(kind, name, parameters, quiet)
        interrupted = _wait(processes, out, stop)
    finally:
        _end(processes.values())
    error = None
    recorder = processes.get(RECORDER)
    if recorder is not None and recorder.returncode:
        error = BagError(
            f"recorder ended with exit code {recorder.returncode}; the bag {bag} holds what was "
            "recorded until then, and is read up to there"
        )
    return gather(out, run.scenario, interrupted=interrupted, recording_error=error)


def _start(
    module: str, name: str, parameters: Mapping[str, Any], quiet: bool
) -> Process:
    """Start a node in a session of its own: a Ctrl-C reaches it once, through this process."""
    command = [
        sys.executable,
        "-P",
        "-m",
        "sparse_coord_ros.executables",
        module,
        "--ros-args",
    ]
    for key, value in parameters.items():
        command += ["-p", f"{key}:={json.dumps(value, ensure_ascii=False)}"]
    command += ["-r", f"__node:={name}", *["--log-level", "warn"] * quiet]
    with held_back():  # until `executables.main` of the child can handle them
        return subprocess.Popen(command, start_new_session=True)


def _wait(processes: Mapping[str, Process], out: Path, stop: Stop) -> bool:
    """Wait for all processes; return whether they were stopped early.

    The other processes continue without a recorder that has begun its bag; a world without robots
    is ended.

    Raises:
        RunError: one of the others failed.
    """
    world = processes[WORLD]
    robots = [
        process for name, process in processes.items() if name not in (WORLD, RECORDER)
    ]
    bag = out / BAG_DIRECTORY
    last_robot = time.monotonic()
    while True:
        # asked before their exit codes
        running = any(process.poll() is None for process in processes.values())
        needed = dict(processes)
        if bag.exists():
            needed.pop(RECORDER, None)
        _check(needed, running, out)
        if not running:
            # if all processes received the signal, they have ended by themselves
            return bool(stop)
        if world.poll() is not None or any(robot.poll() is None for robot in robots):
            last_robot = time.monotonic()
        left = time.monotonic() - last_robot > ALONE_SECONDS
        if left:
            note("all robots are gone: the run ends")
        if left or stop:
            _end(processes.values())
            return True
        time.sleep(POLL_SECONDS)


def _check(needed: Mapping[str, Process], running: bool, out: Path) -> None:
    """Raise `RunError` if a process that the others need has failed."""
    codes = {name: code for name, process in needed.items() if (code := process.poll())}
    if EXIT_BAD_INPUT in codes.values():
        raise RunError("a node stopped because of bad input (see its line above)")
    for name, code in codes.items():
        rest = "the others were stopped" if running else "the others had ended"
        text = f"{name} ended with exit code {code}; {rest}, their results are saved"
        if (out / CHECKPOINTS).is_dir():
            text += f"; continue with: sparse_coord run --resume {out}"
        raise RunError(text)


def _end(processes: Collection[Process]) -> None:
    """Ask the running processes to end, the world first; kill those that do not."""
    deadline = time.monotonic() + GRACE_SECONDS
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    for process in processes:
        try:
            process.wait(max(0.1, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
