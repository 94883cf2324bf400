# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord run`: bad input, refused before any node starts."""

import itertools
import signal
import sys
from contextlib import nullcontext, suppress
from types import SimpleNamespace

import pytest


def test_existing_directory_is_not_touched(refused, folder):
    (folder / "out").mkdir()
    (folder / "out" / "tables.npz").write_text("precious")
    message = refused("run", "env1", "--steps", 5, "--out", "out")
    assert "output directory out" in message


def test_without_ros_it_says_what_to_do(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    message = refused("run", "env1", "--out", "out")
    for named in ("ROS 2", "'.[ros]'", "sparse_coord train"):
        assert named in message


def test_a_run_whose_tables_could_not_be_saved_is_not_said_to_be_unfinished(
    sparse_coord, folder, monkeypatch
):
    def run(values, **more):
        (folder / "out" / "checkpoint").mkdir(parents=True)
        return {"interrupted": False, "transitions": 5}

    monkeypatch.setattr("sparse_coord_ros.cli.live.run", run)
    code, printed, error = sparse_coord("run", "env1", "--steps", 5, "--out", "out")
    assert code == 2
    assert "finished" not in printed and "tables.npz" not in printed
    assert error.startswith("error: out: ")
    assert error.endswith("sparse_coord run --resume out\n")


def test_a_run_that_was_finished_already_is_said_to_be(
    sparse_coord, folder, monkeypatch
):
    """Of nodes that were started by hand the checkpoints stay, so that it can be resumed."""

    def run(values, **more):
        (folder / "out").mkdir()
        (folder / "out" / "tables.npz").touch()
        return {
            "interrupted": False,
            "transitions": 5,
            "seconds": 0.1,
            "steps_per_second": 0.0,
        }

    monkeypatch.setattr("sparse_coord_ros.cli.live.run", run)
    monkeypatch.setattr("sparse_coord_ros.cli.run.load_run", lambda out: None)
    code, printed, _ = sparse_coord("run", "--resume", "out")
    assert code == 0
    assert "5 steps (the run was already finished), " in printed
    assert "steps/s" not in printed


@pytest.mark.parametrize("number", [signal.SIGTERM])
@pytest.mark.parametrize("moment", ["the run's last", "show_end", "next_wish"])
def test_a_signal_ends_a_watched_run_in_whichever_moment(
    sparse_coord, folder, monkeypatch, number, moment
):
    """Also in the last moment of a run that is done: the page does not stay as if it were lost."""
    from sparse_coord_ros.cli import page

    def run_team(values, **more):
        (folder / "out").mkdir()
        (folder / "out" / "tables.npz").touch()
        if moment == "the run's last":
            signal.raise_signal(number)
        return {"interrupted": False, "transitions": 5}

    def show_end(server, out):
        if moment == "show_end":
            # as in a destructor, where nobody hears it
            with suppress(KeyboardInterrupt):
                signal.raise_signal(number)

    def sleep(seconds, times=itertools.count()):  # noqa: B008
        if moment == "next_wish":
            signal.raise_signal(number)
        assert next(times) < 3, "it goes on waiting"

    monkeypatch.setattr("sparse_coord_ros.cli.live.run_team", run_team)
    monkeypatch.setattr(page, "show_end", show_end)
    monkeypatch.setattr(page, "time", SimpleNamespace(sleep=sleep))
    before = signal.getsignal(number)
    code, _, _ = sparse_coord(
        "run", "env1", "--steps", 5, "--out", "out", "--watch", "--port", 0
    )
    assert code == 0 and signal.getsignal(number) == before


def test_the_page_chooses_the_next_team(monkeypatch):
    """It begins anew, in a directory of its own, whatever the first one went on from."""
    from sparse_coord_ros.cli import page

    begun = []
    played = []
    options = SimpleNamespace(
        scenario=None, penalty=None, out="a", resume="a", learner="coop", steps=None
    )
    wish = {"scenario": "isr", "penalty": -3.0, "learner": "voi", "steps": 50}
    server = SimpleNamespace(board=None)
    monkeypatch.setattr(page, "served", lambda options: nullcontext(server))
    monkeypatch.setattr(page, "show_end", lambda *_: None)
    monkeypatch.setattr(page, "next_wish", lambda *_: wish)

    def begin(options):
        begun.append(tuple(vars(options).values()))
        return f"out{len(begun)}", len(begun)

    def play(options, out, team, server):
        played.append((out, team))
        return 7 * (team == 2)

    assert page.one_by_one(options, begin, play) == 7
    assert begun == [
        (None, None, "a", "a", "coop", None),
        ("isr", -3.0, None, None, "voi", 50, [], []),
    ]
    assert played == [("out1", 1), ("out2", 2)]
