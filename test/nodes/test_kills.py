# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Twelve kills of processes: the run ends with the bits of an unbroken one, its bag identical."""

import os
import signal
import subprocess
import time
from contextlib import contextmanager

import pytest
from chaos import BEGUN, NODES, RATE, START_SECONDS, Plan, Team
from live_teams import command, odd_counts, same_tables

from sparse_coord_ros.log.bags.reader import BAG_DIRECTORY
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.wire import RECORDER, WORLD

FAST = Plan(steps=450, checkpoint=60)
SLOW = Plan(steps=420, checkpoint=120, rate=50.0)
SLOWER = Plan(steps=700, checkpoint=200, rate=50.0)
"""So that a recorder is back before the nodes have forgotten its last checkpoint."""
AGAIN = "continuing from the checkpoint"
"""In the world's line when a resumed run goes on."""

ROBOT = "sparse_coord_ros.ros.nodes.robot"
IN = {
    "a file": ("sparse_coord_ros.protocol.lockstep.node_checkpoints:write_whole", "3"),
    "writing tables": (
        "sparse_coord_ros.ros.nodes.recorder:Recording._write_down",
        "6",
    ),
    "its order": ("sparse_coord_ros.ros.nodes.restart:Restart._begin", "2"),
    "its obedience": (f"{ROBOT}:RobotNode._begin_attempt", "2"),
}
"""Where a node dies: in which call of which function."""


@contextmanager
def team_of(folder, plan=FAST, **dies):
    """Start a team; at the end all its processes have ended by themselves."""
    team = Team(plan, 7, folder, {name: IN[where] for name, where in dies.items()})
    try:
        team.wait(lambda: BEGUN in team.log, START_SECONDS, "the start")
        yield team
        team.wait(lambda: False, START_SECONDS, "the end")
    finally:
        team.kill(list(team.running))
    assert [code for _, code in team.codes if code] == [], team.log
    assert "Traceback" not in team.log


def after_a_checkpoint(team):
    """Wait until all have saved."""
    saved = "checkpoint/*_[1-9]*.npz"
    team.wait(lambda: len(list(team.out.glob(saved))) >= 3, START_SECONDS, "saving")
    time.sleep(0.3)  # the recorder, too


def again(team, *names):
    """Kill nodes, and start them again."""
    team.kill(names)
    for name in names:
        team.start(name)


def replace_the_dead(team, name):
    """Wait until a node has died by itself, and start it again."""
    team.running[name].wait(START_SECONDS)
    again(team, name)


def one_or_all(*names, plan=FAST):
    """Return a case: nodes are killed under way."""

    def happen(folder):
        with team_of(folder, plan) as team:
            after_a_checkpoint(team)
            again(team, *names)

    return happen


def dying(name, where, plan=FAST):
    """Return a case: a node dies at a moment of its own."""

    def happen(folder):
        with team_of(folder, plan, **{name: where}) as team:
            replace_the_dead(team, name)

    return happen


def dying_as_another_comes_back(name, where):
    """Return a case: a node dies while the team begins again because of another one."""

    def happen(folder):
        with team_of(folder, **{name: where}) as team:
            after_a_checkpoint(team)
            again(team, "robot_2")
            replace_the_dead(team, name)

    return happen


def all_twice(folder):
    """Kill all, and all again as they go on; then `run` goes on with each in its own process."""
    with team_of(folder) as team:
        after_a_checkpoint(team)
        again(team, *NODES)
        team.wait(lambda: AGAIN in team.log, START_SECONDS, "going on")
        team.kill(NODES)
        finished(subprocess.Popen(resuming(team.out, "--processes")))


def one_process(folder):
    """Kill a team in one process that learns from the states of peers, and go on so."""
    out = folder / "run"
    words = [
        "--seed",
        "7",
        "--checkpoint",
        "60",
        "--rate",
        str(RATE),
        "--out",
        str(out),
    ]
    words += ["--set", "steps=450", "--set", "perception=probability:0.7"]
    words += ["--set", "peers_seen=while_learning"]
    process = subprocess.Popen(command("sparse_coord", "run", "env1", *words))
    deadline = time.monotonic() + START_SECONDS
    while not list(out.glob("checkpoint/*_120.npz")) and time.monotonic() < deadline:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    finished(subprocess.Popen(resuming(out)))


def resuming(out, *more):
    return command("sparse_coord", "run", "--resume", str(out), *more)


def finished(process):
    assert process.wait(START_SECONDS) == 0


KILLS = {
    "all, in one process": one_process,
    "a robot as it saves": dying("robot_1", "a file"),
    "the recorder": one_or_all(RECORDER, plan=SLOW),
    "the world": one_or_all(WORLD),
    "a robot": one_or_all("robot_1"),
    "another robot": one_or_all("robot_2"),
    "all": one_or_all(*NODES),
    "the world as it saves": dying(WORLD, "a file"),
    "the recorder as it saves": dying(RECORDER, "writing tables", SLOWER),
    "the world during a resume": dying_as_another_comes_back(WORLD, "its order"),
    "a robot during a resume": dying_as_another_comes_back("robot_1", "its obedience"),
    "all, and all again during the resume": all_twice,
}
SHORT = 2
CASES = [
    pytest.param(name, marks=[pytest.mark.long] * (k >= SHORT))
    for k, name in enumerate(KILLS)
]


@pytest.mark.parametrize("what", CASES)
def test_who_was_killed_goes_on_as_if_nothing_had_happened(own_domain, tmp_path, what):
    KILLS[what](tmp_path)
    out = tmp_path / "run"
    assert same_tables(out)
    found = verify(out / BAG_DIRECTORY)
    assert found.same, found
    assert odd_counts(out, found) == []
