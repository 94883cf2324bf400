# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node `watch` shows the content of the team's messages, and calls the world's services."""

from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from teams import same_bits, tables_in

from sparse_coord_ros.log.bags.reader import open_bag
from sparse_coord_ros.log.runlog import read_run
from sparse_coord_ros.log.runlog.explain import row_in_words
from sparse_coord_ros.protocol.wire.status import RunStatus, read_status
from sparse_coord_ros.ros.nodes import ros_topics, team, watch
from sparse_coord_ros.ros.nodes.watch import HeardTeam, WatchNode
from sparse_coord_ros.show.page.controls import PAUSE, RATE, RESET, STEP, Control
from sparse_coord_ros.show.page.live_source import LiveView
from sparse_coord_ros.show.page.message_board import MessageBoard
from sparse_coord_ros.show.steps import logged_trails


def heard_of(run):
    """Return what `HeardTeam` makes of messages, what takes them, and what it shows."""
    takes = {}
    view = LiveView(run, MessageBoard(), source="live", title="", controls=())

    class Listening:
        def listen(self, topic, then, owner, *, read):
            def unpack(data):
                return (read(deserialize_message(data, topic.type)),)

            self.listen_packed(topic, unpack, then, owner)

        def listen_packed(self, topic, unpack, then, owner):
            takes[f"/{owner}/{topic.name}"] = lambda data: then(*unpack(data))

    return HeardTeam(SimpleNamespace(subscriber=Listening()), run, view), takes, view


def without_tables(takes):
    """Return the other topics."""
    return {name for name in takes if not name.endswith("/tables")}


@pytest.mark.parametrize("name", ["env1", "env2-4r"])
def test_what_is_heard_is_what_the_log_says(record, name):
    recorded = record(name, settings={"perception": "probability:0.5"})
    log = read_run(recorded.bag)
    seen = {}
    team_heard, heard, view = heard_of(recorded.run)
    for message in open_bag(recorded.bag).messages(set(heard)):
        before = view.last
        heard[message.topic](message.data)
        if view.last is not before:
            view.show(transitions=team_heard.seen, episode=team_heard.episode)
            frame = view.board.get("frame")
            seen[frame["step"]] = frame
    assert same_bits(team_heard.history.so_far, log.history())
    assert team_heard.whole and team_heard.seen == recorded.run.scenario.steps == len(
        seen
    )
    assert len(team_heard.pending) <= 2  # nothing piles up
    ends = {"answered": 0, "refused": 0}
    for row in np.flatnonzero(np.isin(log.step, list(seen))).tolist():
        frame = seen[int(log.step[row])]
        assert list(frame["cells"]) == log.cells[row].tolist()
        assert [a["robot"] for a in frame["asks"]] == np.flatnonzero(
            log.asked[row]
        ).tolist()
        for ask in frame["asks"]:
            ends[ask["outcome"]] += 1
            assert (ask["outcome"] == "answered") == log.perceived[row, ask["robot"]]
    assert min(ends.values()) > 3
    asked = np.array(view.asked)
    assert np.array_equal(asked.sum(axis=1), log.asked.sum(axis=0))


@pytest.mark.parametrize("late", ["action", "reward", "local_state"])
def test_topics_may_overtake_one_another(good, late):
    """One topic of one robot comes three time steps later than all others: nothing is lost.

    Neither by who stood still for seconds, with all that in the queue: no clock is read.
    """
    team, takes, _ = heard_of(good.run)
    held = []
    states = 0
    for message in open_bag(good.bag).messages(set(takes)):
        states += message.topic == "/robot_1/local_state"
        if message.topic == f"/robot_2/{late}":
            held.append((states + 3, message))
            continue
        while held and held[0][0] <= states:
            takes[held[0][1].topic](held.pop(0)[1].data)
        takes[message.topic](message.data)
    for _, message in held:
        takes[message.topic](message.data)
    assert same_bits(team.history.so_far, read_run(good.bag).history())
    assert team.whole and team.seen == good.run.scenario.steps


def test_a_run_that_goes_back_is_shown_on(good):
    """The part that was taken back stays in the curves, and the page reports it."""
    team, takes, view = heard_of(good.run)
    messages = list(open_bag(good.bag).messages(set(takes)))
    for message in messages[:200]:
        takes[message.topic](message.data)
    seen = team.seen
    waiting = set(team.pending)
    for message in messages:
        takes[message.topic](message.data)
    assert (
        "went back to a checkpoint" in view.board.get("notice")["text"]
        and not team.whole
    )
    assert team.seen == seen + good.run.scenario.steps and not waiting & set(
        team.pending
    )


def test_details_have_the_row_of_the_newest_tables(good):
    """As it was announced; it may have changed since the robot asked."""
    _, takes, view = heard_of(good.run)
    log = read_run(good.bag)
    for one in open_bag(good.bag).messages(["/robot_1/tables", "/robot_2/tables"]):
        if one.log_time_ns == 0:
            takes[one.topic](one.data)
    tables = {k: log.tables[k, 0] for k in range(2)}
    told = 0
    for message in open_bag(good.bag).messages(without_tables(takes)):
        takes[message.topic](message.data)
        view.show(transitions=0, episode=0)
    for entry in view.board.get("dialogue")["entries"]:
        k = entry["robot"]
        row = int(np.searchsorted(log.step, entry["step"]))
        cell, peer = log.cells[row, [k, 1 - k]].tolist()
        known = entry["outcome"] == "answered"
        due = tables[k].q_coord[cell, peer] if known else tables[k].q_star[cell, :4]
        assert entry["lines"][2].endswith(f", in the newest tables {row_in_words(due)}")
        told += known
    assert 3 < told < len(view.board.get("dialogue")["entries"])


def test_trails_are_those_of_the_episode(good):
    _, takes, view = heard_of(good.run)
    log = read_run(good.bag)
    seen = 0
    for message in open_bag(good.bag).messages(set(takes)):
        takes[message.topic](message.data)
        view.show(transitions=0, episode=0)
        frame = view.board.get("frame")
        if view.last is not None:
            row = int(np.searchsorted(log.step, frame["step"]))
            assert frame["trails"] == logged_trails(log, row)
            seen += max(map(len, frame["trails"])) > 3
    assert seen > 10


def test_reasons_are_told_of_robots_whose_tables_were_heard(good):
    _, takes, view = heard_of(good.run)
    for one in open_bag(good.bag).messages(["/robot_2/tables"]):
        takes[one.topic](one.data)
    told = {0: set(), 1: set()}
    for message in open_bag(good.bag).messages(without_tables(takes)):
        takes[message.topic](message.data)
        view.show(transitions=0, episode=0)
    for entry in view.board.get("dialogue")["entries"]:
        told[entry["robot"]].add("Q" in entry["lines"][2])
    assert told == {0: {False}, 1: {True}}


def test_a_robot_that_is_left_out_holds_nobody_up(good):
    """The node waits half a second for missing messages, and then continues without them."""
    team, takes, _ = heard_of(good.run)
    messages = list(open_bag(good.bag).messages(set(takes)))
    for message in messages[:80]:
        if message.topic not in ("/robot_2/action", "/robot_2/reward"):
            takes[message.topic](message.data)
    assert team.seen < 5
    for _ in range(watch.LATE_TICKS + 1):
        team.tick()
    assert team.seen > 5 and len(team.pending) < 3 and team.whole
    step = min(team.pending)
    team.compare(RunStatus("", "learning", step, team.seen, left_out=team.without))
    assert team.whole  # the world says so, too
    team.compare(RunStatus("", "learning", step, team.seen, left_out=0))
    assert not team.whole


MISSED = {
    "nothing": ((), 0, 0),
    "the first actions of a robot": (("/robot_2/action",), 0, 3),
    "the first states of a robot": (("/robot_2/local_state",), 0, 2),
    "what all did in the first steps": (("/robot_1/action", "/robot_2/action"), 0, 3),
    "what all did in the middle": (("/robot_1/reward", "/robot_2/reward"), 40, 43),
    "what a robot did in the middle": (("/robot_2/action", "/robot_2/reward"), 40, 43),
    "a state in the middle": (("/robot_1/local_state",), 40, 41),
    "the first steps": (("/robot_1/local_state", "/robot_2/local_state"), 0, 4),
}


@pytest.mark.parametrize("what", MISSED)
def test_what_was_missed_is_said_and_begins_no_episode(good, what):
    team, takes, view = heard_of(good.run)
    takes["/status"] = lambda data: team.compare(
        read_status(deserialize_message(data, ros_topics.STATUS.type))
    )
    topics, begin, end = MISSED[what]
    count = dict.fromkeys(takes, 0)
    for number, message in enumerate(open_bag(good.bag).messages(set(takes))):
        topic = message.topic
        count[topic] += 1
        if topic not in topics or not begin < count[topic] <= end:
            takes[topic](message.data)
        if number % 20 == 0:
            team.tick()
    for _ in range(watch.LATE_TICKS + 1):
        team.tick()
    said = view.board.get("notice")["text"]
    assert team.whole == ("the curves lack" not in said) == (what == "nothing")
    assert team.history.so_far.episodes == read_run(good.bag).history().episodes
    view.notice("another thing")
    view.notice("")
    assert view.board.get("notice")["text"] == said  # it stays


def test_a_page_beside_a_live_team(bench, monkeypatch):
    monkeypatch.setattr(watch, "GONE_SECONDS", 1.5)  # it says its status every second
    world = bench.world(steps=3000, checkpoint=20)
    node = bench.add(
        WatchNode(context=bench.place("observer")[0], values={"port": 0}), "observer"
    )
    board = node.server.board
    assert board.get("run") is None
    bench.robots(2)
    bench.spin_until(lambda: board.get("frame") is not None, "a frame")
    assert (
        board.get("run")["scenario"] == "env1" and board.get("run")["source"] == "live"
    )
    board.pages += 1
    bench.spin_until(lambda: board.get("frame")["step"] > 0, "the first step")
    assert board.get("frame")["rate"] is None, "nobody has said it"
    node.controls.control(Control(PAUSE, True))
    bench.spin_until(lambda: board.get("frame")["state"] == "paused", "it holds")
    bench.spin_until(lambda: world.lockstep.complete, "all have acted")
    step = world.lockstep.world.step
    node.controls.control(Control(STEP, 1))
    bench.spin_until(lambda: board.get("frame")["step"] == step, "one step more")
    assert board.get("frame")["cells"] == node.team.view.last.cells
    node.controls.control(Control(RATE, 500.0))
    bench.spin_until(lambda: world.values["rate"] == 500.0, "the rate")
    bench.spin_until(lambda: board.get("frame")["rate"] == 500.0, "it is known now")
    episode = world.lockstep.world.episode
    node.controls.control(Control(RESET))
    bench.spin_until(lambda: world.lockstep.world.episode > episode, "a new episode")
    node.controls.control(Control(PAUSE, False))
    bench.spin_until(lambda: node.team.tables.get(1, (0,))[0] >= 20, "new tables")
    bench.spin_until(lambda: board.get("curves")["length"], "curves")
    node.controls.control(Control(RATE, -5.0))
    bench.spin_until(
        lambda: "rate: " in board.get("notice")["text"], "the world refuses"
    )
    bench.destroy(world)
    bench.spin_until(lambda: board.get("frame")["state"] == "gone", "the world is gone")
    node.controls.control(Control(PAUSE, True))
    bench.spin_until(
        lambda: "is missing: the world is gone" in board.get("notice")["text"],
        "no world",
    )
    said = RunStatus(board.get("run")["scenario"], "stopped", 1, 1)
    node.world_said(said)
    assert board.get("notice")["text"].startswith("the run was stopped before its end")
    node.world_said(said._replace(state="learning"))
    assert "stopped" not in board.get("notice")["text"]


def test_a_team_in_one_process_with_a_page(bench, tmp_path, monkeypatch):
    from sparse_coord_ros.show.page.server import Server

    page = Server(MessageBoard(), port=0)
    page.board.pages += 1
    put = page.board.put
    states = []

    def noted(kind, **fields):
        if kind == "frame":
            states.append(fields["state"])
        put(kind, **fields)

    monkeypatch.setattr(page.board, "put", noted)
    try:
        values = {
            "scenario": "env1",
            "steps": 300,
            "out": str(tmp_path / "run"),
        }
        values |= {"seed": 3}
        context = bench.place()[0]
        team.run_team(values, context=context, page=page.board)
        log = read_run(tmp_path / "run/bag")
        board = page.board
        frame = board.get("frame")
        curves = board.get("curves")
        assert frame["state"] == "finished" and frame["made"] == 300
        assert {*states} > {"finished"}, "it is shown on its way, too"
        history = log.history()
        assert curves["length"] == history.length.tolist()
        assert curves["asks"] == history.asks.T.tolist()
        assert np.array(board.get("asked")["robots"]).sum() == log.asked.sum()
        assert frame["step"] == log.step[np.flatnonzero(log.move.max(axis=1) >= 0)[-1]]
        saved = tables_in(tmp_path / "run")
        for shown, own in zip(board.get("tables")["robots"], saved, strict=True):
            assert shown["step"] > frame["step"]
            assert shown["q_star"] == own.q_star.round(4).tolist()
    finally:
        page.close()
