# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several bags by one clock: each shows its own time step of what they have in common."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.runlog import read_run
from sparse_coord_ros.show.page.bag_source import BagSource
from sparse_coord_ros.show.page.comparison import Comparison, aligned, titles_of
from sparse_coord_ros.show.page.controls import (
    AXIS,
    EPISODE,
    LEARNED_EPISODE,
    PAUSE,
    RATE,
    SEEK,
    STEP,
    TIME_STEP,
    Control,
    parse_control,
)
from sparse_coord_ros.show.page.message_board import MessageBoard


def test_runs_begin_a_segment_at_once_and_wait_for_each_other():
    axis = aligned(np.array([[1, 6], [1, 9]]), np.array([[3, 1], [6, 0]]))
    assert axis.offsets.tolist() == [0, 7] and axis.last == 8
    found = [axis.steps_at(position) for position in range(9)]
    assert found == [
        *([1, 1], [2, 2], [3, 3], [4, 4], [4, 5], [4, 6], [4, 7]),
        *([6, 9], [7, 9]),
    ]
    assert [axis.position_of(0, step) for step in (1, 4, 5, 6, 7, 99)] == [
        *(0, 3, 3, 7, 8, 8)
    ]
    assert axis.position_of(1, 0) == 0


def test_titles_tell_runs_apart():
    def run(learner, seed=1, **settings):
        scenario = load_scenario("env1", **settings)
        return make_run(scenario, {"learner": learner, "seed": seed})

    assert titles_of([run("coop"), run("voi")]) == ["coop", "voi"]
    titles = titles_of([run("coop", penalty=-50), run("coop"), run("voi")])
    assert titles[0] == "coop, env1, penalty=-50"
    assert titles[2] == "voi"
    assert titles_of([run("coop"), run("coop", 2)]) == [
        "coop, seed 1",
        "coop, seed 2",
    ]


@pytest.fixture(scope="module")
def bags(record):
    settings = {"steps": 600, "penalty": -100}
    return [
        record(settings=settings, values={"learner": learner}).bag
        for learner in ("coop", "voi")
    ]


@pytest.fixture
def clock(monkeypatch):
    """Return the clock; `now` is its time."""
    clock = SimpleNamespace(now=0.0, sleep=time.sleep)
    clock.monotonic = lambda: clock.now
    for name in ("bag_source", "comparison", "controls"):
        monkeypatch.setattr(f"sparse_coord_ros.show.page.{name}.time", clock)
    return clock


@pytest.fixture
def player(bags, clock):
    sources = [BagSource(bag, MessageBoard()) for bag in bags]
    for source in sources:
        source.read_through()
    made = Comparison(sources, MessageBoard())
    made.board.pages = 1

    def do(name=None, value=None, seconds=0.0):
        if name is not None:
            made.control(Control(name, value))
        clock.now += seconds
        made.tick()
        return [source.board.get("frame") for source in sources]

    do()
    yield SimpleNamespace(do=do, board=made.board, sources=sources)


def said(player):
    """Return what the clock says."""
    return player.board.get("clock")


def test_by_time_step_both_are_at_the_same_one(player, bags):
    player.do(AXIS, TIME_STEP)
    frames = player.do(SEEK, 200)
    assert {frame["step"] for frame in frames} == {201}
    for bag, frame in zip(bags, frames, strict=True):
        log = read_run(bag)
        assert list(frame["cells"]) == log.cells[log.row_of[201]].tolist()
    player.do(PAUSE, True)
    assert {frame["step"] for frame in player.do(STEP, -1)} == {200}
    assert {frame["state"] for frame in player.do(seconds=5.0)} == {"paused"}
    player.do(RATE, 20.0)
    player.do(PAUSE, False)
    frames = player.do(seconds=1.0)
    assert {frame["step"] for frame in frames} == {220}
    player.do(SEEK, 10**9)
    player.do(seconds=1.0)
    assert said(player)["state"] == "paused"
    assert said(player)["position"] == said(player)["last"]
    player.do(PAUSE, False)
    assert said(player)["position"] == 0


def test_by_episode_both_are_in_the_same_one(player, bags):
    player.do(AXIS, EPISODE)
    history = [source.history for source in player.sources]
    count = min(one.episodes for one in history)
    axis = player.board.get("aligned")
    assert [len(starts) for starts in axis["starts"]] == [count, count]
    player.do(PAUSE, True)
    for episode in (0, 3, count - 1):
        frames = player.do(SEEK, axis["offsets"][episode])
        assert [frame["step"] for frame in frames] == [
            one.first_step[episode] for one in history
        ]
        assert said(player)["segment"] == episode
        lengths = [one.length[episode] for one in history]
        frames = player.do(SEEK, axis["offsets"][episode] + min(lengths) + 1)
        shorter = int(np.argmin(lengths))
        if lengths[0] != lengths[1]:
            end = history[shorter].first_step[episode] + lengths[shorter]
            assert frames[shorter]["step"] == end


def test_what_was_learned_is_played_again_and_again(player):
    player.do(AXIS, LEARNED_EPISODE)
    shown = [source.highlight for source in player.sources]
    frames = player.do()
    assert [frame["step"] for frame in frames] == [one.first for one in shown]
    longest = max(one.last + 1 - one.first for one in shown)
    frames = player.do(seconds=longest / 2.0)
    assert [frame["step"] for frame in frames] == [one.last + 1 for one in shown]
    assert said(player)["state"] == "playing"
    frames = player.do(seconds=5.0)
    assert [frame["step"] for frame in frames] == [one.first for one in shown]


def test_the_first_page_sees_what_was_learned_from_its_start(player):
    """Time passes only while a page is open; one that is opened beside it changes nothing."""
    player.do(AXIS, LEARNED_EPISODE)
    player.do(seconds=1.0)
    assert said(player)["position"] == 2
    player.board.pages = 2
    player.do(seconds=0.5)
    assert said(player)["position"] == 3
    player.board.pages = 0
    player.do(seconds=5.0)
    assert said(player)["position"] == 3
    player.board.pages = 1
    player.do(seconds=5.0)
    assert said(player)["position"] == 0
    player.do(AXIS, TIME_STEP)
    player.do(SEEK, 200)
    player.board.pages = 0
    player.do()
    player.board.pages = 1
    player.do()
    assert said(player)["position"] == 200


def test_the_clock_carries_the_frames_of_its_position(player):
    player.do(AXIS, LEARNED_EPISODE)
    starts = [source.highlight.first for source in player.sources]
    lengths = [
        source.highlight.last + 1 - source.highlight.first for source in player.sources
    ]
    positions = []
    for _ in range(4 * max(lengths)):  # it wraps at least once
        player.do(seconds=0.25)
        clock = said(player)
        positions.append(clock["position"])
        due = [
            start + min(clock["position"], length)
            for start, length in zip(starts, lengths, strict=True)
        ]
        assert [frame["step"] for frame in clock["frames"]] == due
    assert max(positions) == max(lengths) and (np.diff(positions) < 0).any()


def test_the_clock_is_told_only_where_it_changes(player):
    player.do(PAUSE, True)
    board = player.board
    before = board.newer(0)
    player.do(seconds=3.0)
    assert board.newer(0) == before


def test_another_axis_is_refused():
    with pytest.raises(SettingError, match="allowed: learned, episode, step"):
        parse_control({"do": AXIS, "value": "time"}, (AXIS,))
