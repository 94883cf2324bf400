# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag on the board: every value is the log's; played, held, stepped, sought, followed."""

import json
import re
import shutil
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from recordings import chunks_in

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE
from sparse_coord_ros.core.game.interactions import (
    interactions_of,
    miscoordinations,
)
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.core.runs.saved_tables import save_team
from sparse_coord_ros.log.bags.reader import bag_files
from sparse_coord_ros.log.runlog import read_run
from sparse_coord_ros.log.runlog.explain import (
    ASKS_TO_LEARN,
    IMPATIENT,
    coordinations,
    explained,
    in_words,
)
from sparse_coord_ros.log.runlog.growing import GrowingLog
from sparse_coord_ros.protocol.wire import COORDINATION_MAP
from sparse_coord_ros.show.narrator import Narrator
from sparse_coord_ros.show.page.bag_source import BagSource, since_in_words
from sparse_coord_ros.show.page.controls import (
    JUMP,
    LEARNED_EPISODE,
    PAUSE,
    RATE,
    SEEK,
    STEP,
    Control,
)
from sparse_coord_ros.show.page.counts import Counts
from sparse_coord_ros.show.page.key_steps import (
    KeySteps,
    LearnedTeam,
    highlight,
    kinds_of,
)
from sparse_coord_ros.show.page.message_board import MessageBoard


class Player:
    """A source, and its clock."""

    now = 0.0

    def __init__(self, bag, step=0):
        self.board = MessageBoard()
        self.source = BagSource(bag, self.board, step=step)
        self.source.tick()

    def do(self, name, value=None, seconds=0.0):
        self.source.control(Control(name, value))
        return self.after(seconds)

    def after(self, seconds):
        Player.now += seconds
        self.source.tick()
        return self.board.get("frame")


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    clock = SimpleNamespace(monotonic=lambda: Player.now, sleep=time.sleep)
    for module in ("bag_source", "controls"):
        monkeypatch.setattr(f"sparse_coord_ros.show.page.{module}.time", clock)


@pytest.fixture
def player(bag):
    made = Player(bag)
    yield made


def test_a_file_without_a_directory_is_called_by_its_name(bag, tmp_path, monkeypatch):
    shutil.copy(bag / "bag_0.mcap", tmp_path / "cut.mcap")
    monkeypatch.chdir(tmp_path)
    board = MessageBoard()
    BagSource(Path("cut.mcap"), board)
    assert board.get("run")["title"] == "cut.mcap"
    whole = MessageBoard()
    BagSource(bag, whole)
    assert whole.get("run")["title"] == str(bag)


def test_each_value_shown_is_the_log_s(player, bag):
    log = read_run(bag)
    for row in (0, 5, 100, 333, len(log.step) - 2):
        frame = player.do(SEEK, int(log.step[row]))
        assert frame["step"] == log.step[row]
        assert list(frame["cells"]) == log.cells[row].tolist()
        assert [a["robot"] for a in frame["asks"]] == np.flatnonzero(
            log.asked[row]
        ).tolist()
        for ask in frame["asks"]:
            assert (ask["outcome"] == "answered") == log.perceived[row, ask["robot"]]
        player.source.learn()
        tables = player.board.get("tables")
        assert {one["step"] for one in tables["robots"]} == {frame["step"]}
        json.dumps(tables, allow_nan=False)


def test_the_words_begin_as_explain_tells_them(player, bag):
    log = read_run(bag)
    step = int(log.step[np.flatnonzero(log.asked[:, 0] & log.perceived[:, 0])[3]])
    player.do(SEEK, step)
    said = player.board.get("dialogue")["entries"][-1]
    due = list(in_words(log, *explained(log, said["robot"], [step])))
    assert due.pop(1).startswith("  Q*[")
    assert said["step"] == step and due[0].endswith(said["lines"][0])
    assert said["lines"][1].startswith(due[1].strip())
    assert due[3].strip().startswith(said["lines"][2])
    assert due[4].strip() == said["lines"][3]
    player.do(SEEK, 10**9)
    told = {
        entry["outcome"]: entry["lines"][1]
        for entry in player.board.get("dialogue")["entries"]
    }
    assert "answers cell" in told["answered"] and told["refused"].endswith(": refused")


TEAMS = {
    "coop": ("env1", {"perception": "probability:0.6", "steps": 300}, {}),
    "voi": (
        "env1",
        {"perception": "probability:0.6", "steps": 200},
        {"learner": "voi"},
    ),
    "three, peers seen": (
        "crowd-3r",
        {"steps": 100, "peers_seen": "while_learning"},
        {"learner": "voi"},
    ),
}


@pytest.mark.parametrize("team", TEAMS)
def test_details_have_the_row_that_decided(team, record):
    """Of every question that is shown, as `explain` has it; found when nothing else is to do."""
    name, settings, values = TEAMS[team]
    recorded = record(name, settings=settings, values={"checkpoint": 100, **values})
    player = Player(recorded.bag)
    log = read_run(recorded.bag)
    steps = log.step[log.asked.any(axis=1)]
    for step in (int(steps[len(steps) // 2]), int(log.step[-1])):
        player.do(SEEK, step)
        player.source.learn()  # the tables first
        player.source.learn()
        player.source.tick()
        check_rows(player, log)
    again = int(steps[len(steps) // 2])
    player.do(SEEK, again)
    player.do(PAUSE, True)
    for _ in range(10):  # on the way, step by step
        player.do(STEP, 1)
        player.source.learn()
    player.source.tick()
    newest = player.board.get("dialogue")["entries"][-1]
    assert newest["step"] > again and ": north " in moves_told(newest["lines"])[-1]
    player.source.learn()
    player.source.tick()
    check_rows(player, log)


def check_rows(player, log):
    """Check the details of all questions that are shown."""
    entries = player.board.get("dialogue")["entries"]
    assert len(entries) > 3
    for entry in entries:
        due = in_words(log, *explained(log, entry["robot"], [entry["step"]]))
        moved = moves_told(due)
        assert moves_told(entry["lines"]) == moved and ": north " in moved[-1]


def moves_told(lines):
    """Return the lines of a question that say what the robot did, and why."""
    begins = ("goes ", ASKS_TO_LEARN, IMPATIENT)
    return [line.strip() for line in lines if line.strip().startswith(begins)]


def test_the_page_says_where_a_robot_waits_in_vain(record):
    values = {"checkpoint": 100, "learner": "voi"}
    settings = {"steps": 600, "peers_seen": "while_learning"}
    bag = record("crowd-3r", settings=settings, values=values).bag
    log = read_run(bag)
    impatient = [
        one
        for robot in range(3)
        for one in explained(log, robot, coordinations(log, robot))
        if one.reason.impatient
    ]
    assert impatient
    player = Player(bag)
    for one in impatient:
        player.do(SEEK, one.step)
        entries = player.board.get("dialogue")["entries"]
        newest = [entry for entry in entries if entry["robot"] == one.robot][-1]
        assert newest["step"] == one.step
        if one is impatient[0]:  # later ones may be known already
            assert moves_told(newest["lines"]) == [f"goes {ACTIONS[one.move]}"]
        for _ in range(2):
            player.source.learn()
        player.source.tick()
        entries = player.board.get("dialogue")["entries"]
        newest = [entry for entry in entries if entry["robot"] == one.robot][-1]
        assert moves_told(newest["lines"]) == moves_told(in_words(log, one))
        assert moves_told(newest["lines"])[0] == IMPATIENT


@pytest.mark.parametrize(("name", "learner"), [("env1", "coop"), ("crowd-3r", "voi")])
def test_a_run_in_which_nobody_learns_has_its_rows_too(name, learner, record, tmp_path):
    values = {"learner": learner}
    seen = {"peers_seen": "while_learning"} if learner == "voi" else {}
    tables = record(name, settings={"steps": 300, **seen}, values=values).bag
    load = Player(tables)
    robots = range(len(load.source.run.scenario.robots))
    own = [load.source.log.so_far.tables_before(k).tables for k in robots]
    save_team(tmp_path, [one.memory for one in own])
    values |= {"greedy": True, "tables": str(tmp_path)}
    recorded = record(name, settings={"steps": 100}, values=values)
    player = Player(recorded.bag)
    player.do(SEEK, 10**6)
    for _ in range(2):
        player.source.learn()
    player.source.tick()
    check_rows(player, read_run(recorded.bag))


def test_counts_are_those_up_to_the_time_step_that_is_shown(player, bag):
    """The number of episodes, and how often was asked in each cell: forward and back."""
    log = read_run(bag)
    history = log.history()
    frame = player.do(SEEK, int(log.step[300]))
    # nothing is read yet
    assert frame["counted_to"] < frame["step"] and frame["episodes"] == 0
    player.source.read_through()
    for row in (300, len(log.step) - 2, 30, 301, 0):
        frame = player.do(SEEK, int(log.step[row]))
        assert frame["counted_to"] == frame["step"] == log.step[row]
        assert frame["episodes"] == (history.first_step <= log.step[row]).sum()
        due = np.zeros((2, len(log.run.scenario.map.cells)), dtype=int)
        rows, robots = np.nonzero(log.asked[: row + 1])
        np.add.at(due, (robots, log.cells[rows, robots]), 1)
        assert player.board.get("asked")["robots"] == due.tolist()
    assert player.do(SEEK, 10**9)["episodes"] == history.episodes


def test_sums_of_many_questions_are_the_questions(bag, monkeypatch):
    """However many are summed up at once, and whatever is read again."""
    monkeypatch.setattr("sparse_coord_ros.show.page.counts.SUM_EVERY", 7)
    log = read_run(bag)
    long = GrowingLog(bag)
    monkeypatch.setattr("sparse_coord_ros.log.runlog.growing.PART_STEPS", 100)
    counts = Counts(2, len(log.run.scenario.map.cells))
    begin = 0
    for part in long.episodes():
        for _ in range(2):
            counts = counts.with_part(begin, part)
        begin = part.last_step + 1
    assert begin > log.step[-1] and counts.read_to >= log.step[-1]
    nothing = long.so_far.between(0, 0)
    for row in range(0, len(log.step), 17):
        found = counts.up_to(int(log.step[row]), nothing)
        asked = log.asked[: row + 1]
        assert found.asked.sum(axis=1).tolist() == asked.sum(axis=0).tolist()
        assert found.questions == asked.sum() and found.read_to == log.step[row]
    part = next(long.episodes())
    counts = Counts(2, len(log.run.scenario.map.cells)).with_part(0, part)
    assert 0 < counts.read_to < 500
    step = int(log.step[np.searchsorted(log.step, counts.read_to + 60)])
    found = counts.up_to(step, long.around(step))  # reading has not come so far
    asked = log.asked[log.step <= step]
    assert found.asked.sum(axis=1).tolist() == asked.sum(axis=0).tolist()
    assert found.questions == asked.sum() and found.read_to == step
    assert found.episodes == (log.history().first_step <= step).sum()
    late = counts.up_to(
        step, long.so_far.between(step, step)
    )  # nor does that go back to it
    assert late.read_to == counts.read_to and late.questions < found.questions


def test_trails_lead_through_the_cells_that_the_log_has(player, bag):
    log = read_run(bag)
    lead = read_run(bag).run.scenario.map.next_cell
    for row in (0, 50, 51, 200, 333):
        frame = player.do(SEEK, int(log.step[row]))
        for k, trail in enumerate(frame["trails"]):
            assert trail[-1] == log.cells[row, k]
            assert all(
                b in lead[a] and a != b for a, b in zip(trail, trail[1:], strict=False)
            )
            same = np.flatnonzero(
                (log.episode == log.episode[row]) & (log.step <= log.step[row])
            )
            cells = log.cells[same[-60:], k]
            assert trail == cells[np.insert(np.diff(cells) != 0, 0, True)].tolist()


def test_where_no_question_was_heard_of_the_page_says_since_when(record):
    player = Player(record(values={"learner": "noncoop"}, settings={"steps": 3000}).bag)
    player.do(SEEK, 1)
    assert player.board.get("dialogue") == {
        "type": "dialogue",
        "entries": [],
        "since": None,
    }
    last = player.do(SEEK, 10**9)["step"]
    since = player.board.get("dialogue")["since"]
    assert since is None, "not read so far"
    player.source.read_through()
    player.do(SEEK, 1)
    last = player.do(SEEK, 10**9)["step"]
    since = player.board.get("dialogue")["since"]
    window = player.source.log.around(last)
    log = read_run(player.source.log.path)
    row = np.searchsorted(log.step, window.step[0])
    assert since == row - log.episode[row] > 1


def test_of_a_robot_without_tables_it_is_told_what_happened(bag, tmp_path, rewritten):
    def ours(messages):
        return [one for one in messages if one.topic != "/robot_1/tables"]

    player = Player(rewritten(bag, tmp_path / "own", ours))
    player.do(SEEK, 10**9)
    told = {0: set(), 1: set()}
    for entry in player.board.get("dialogue")["entries"]:
        told[entry["robot"]].add("Q" in entry["lines"][2])
    assert told == {0: {False}, 1: {True}}


def test_curves_and_evaluation_are_those_of_the_log(player, bag):
    player.source.read_through()
    curves = player.board.get("curves")
    history = read_run(bag).history()
    assert curves["episodes"] == history.episodes and curves["read"] == 1.0
    assert curves["asks"] == history.asks.T.tolist()
    assert curves["length"] == history.length.tolist()  # so few that each is a point
    evaluation = player.board.get("evaluation")
    [[name, optimum]] = evaluation["yardsticks"]
    assert name == "exact joint optimum" and optimum > evaluation["returns"]
    assert evaluation["source"] == "exact" and evaluation["step"] > 0
    assert evaluation["returns_error"] == 0.0, "of trials the page shows it"
    player.do(SEEK, 10**9)
    assert np.array(player.board.get("asked")["robots"]).sum() == history.asks.sum()


def test_playing_holding_stepping_seeking(player):
    log = player.source.log.around(1)
    player.do(RATE, 10.0)
    assert player.after(1.0)["step"] in (10, 11)
    frame = player.do(PAUSE, True)
    assert frame["state"] == "paused" and player.after(5.0)["step"] == frame["step"]
    row = int(np.searchsorted(log.step, frame["step"]))
    assert player.do(STEP, 1)["step"] == log.step[row + 1]
    assert player.do(STEP, -1)["step"] == log.step[row]
    assert player.do(SEEK, -5)["step"] == player.source.first
    assert player.do(STEP, -1)["step"] == player.source.first
    assert player.do(SEEK, 10**12)["step"] == player.source.log.last_step
    assert player.do(STEP, 1)["state"] == "ended"
    # again from the start
    assert player.do(PAUSE, False)["step"] == player.source.first
    player.do(RATE, 0.0)
    assert player.after(0.1)["state"] == "ended"


@pytest.fixture(scope="module")
def learned(record):
    """Return the bag of a team of which one robot has learned to ask."""
    return record(settings={"steps": 4000, "penalty": -100}, values={"seed": 2}).bag


def test_a_bag_opens_on_what_was_learned(learned):
    """The sentences are true of the log, and the episode is played again and again."""
    player = Player(learned, step=None)
    log = read_run(learned)
    said = player.board.get("learned")
    frame = player.board.get("frame")
    assert frame["step"] == said["first"] and frame["rate"] == 2.0
    [text] = said["lines"]
    row = int(np.searchsorted(log.step, said["step"]))
    k = int(re.match(r"robot_(\d) asks in cell \d+, and ", text)[1]) - 1
    assert log.asked[row, k] and log.perceived[row, k]
    home = log.run.scenario.map.distances_to(log.run.scenario.robots[k].goal)
    cell, peer = log.cells[row, [k, 1 - k]].tolist()
    newest = player.source.log.so_far.tables_before(k).tables
    move = newest.q_coord[cell, peer].argmax()
    assert move == log.move[row, k] and newest.q_star[cell].argmax() == COORDINATE
    back = home[log.run.scenario.map.next_cell[cell, move]] - home[cell]
    assert (
        f" {('goes on', 'waits', 'steps back')[back + 1]} if robot_{2 - k} is " in text
    )
    narrator = Narrator(log.run.scenario)
    assert text.endswith(f" is {narrator.seen_from(cell, peer)}.")
    seen = [player.after(0.5)["step"] for _ in range(60)]
    assert seen.count(said["step"]) > 1 and min(seen) == said["first"]
    assert player.do(RATE, 20.0)["rate"] == 20.0
    assert player.do(SEEK, 0)["step"] == player.source.first
    assert player.after(60.0)["step"] > 1000  # the whole recording
    assert player.do(JUMP, LEARNED_EPISODE)["step"] == said["first"]
    player.source.read_through()
    line = player.board.get("learned")["lines"][1]
    assert line.startswith(f"robot_{k + 1} learned to ask there at about step ")
    since = int(re.search(r"at about step ([\d,]+)\.$", line)[1].replace(",", ""))
    steps, rows = log.series[COORDINATION_MAP, k]
    rows_of = np.searchsorted(log.step, steps)
    steps = rows_of - log.episode[rows_of]
    place = log.frame.places[log.cells[row, k]]
    asks = (
        np.frombuffer(rows["data"].tobytes(), np.int8).reshape(len(steps), -1)[:, place]
        == 100
    )
    assert asks[-1] and steps[np.flatnonzero(~asks)[-1] + 1] == pytest.approx(
        since, rel=0.01
    )


def test_a_team_that_does_not_arrive_yet_is_not_praised(record):
    """The headline is the verdict, as soon as there is one."""
    settings = {"steps": 60, "max_steps": 2}
    player = Player(record(settings=settings).bag, step=None)
    text = player.board.get("learned")["lines"][0]
    begun = r"Here not all robots arrive without a miscoordination\. (Here )?robot_[12] asks "
    assert re.match(begun, text)
    player.source.read_through()
    [line] = player.board.get("learned")["lines"]
    assert re.fullmatch(
        r"In [\d.]+ % of the episodes some robot did not arrive\.", line
    )
    assert player.board.get("evaluation")["verdict"].startswith(line)


def test_where_no_answer_changes_a_move_the_headline_is_the_verdict(record):
    player = Player(record(values={"learner": "noncoop"}).bag, step=None)
    [line] = player.board.get("learned")["lines"]
    assert line == "In the last episodes no robot asks another one."
    assert player.board.get("tables")["robots"][1]["step"] > 0  # the newest, at once
    player.source.read_through()
    [line] = player.board.get("learned")["lines"]
    assert line == player.board.get("evaluation")["headline"] != ""


@pytest.fixture(scope="module")
def tables(learned):
    """Return what each robot had learned in the end."""
    log = GrowingLog(learned)
    return [log.so_far.tables_before(k).tables for k in range(2)]


@pytest.fixture
def team(learned, tables):
    """Return a log, what its robots have learned, and what else `highlight` needs."""
    log = read_run(learned)
    narrator = Narrator(log.run.scenario)
    return log, LearnedTeam(log.run, tables), KeySteps(log.run), narrator


def test_a_cell_that_no_greedy_robot_reaches_is_not_what_was_learned(team):
    """An episode of learning may begin anywhere; greedy ones begin at the starts."""
    _, learned, _, _ = team
    usual = highlight(*team)
    reached = learned.reached[usual.robot]
    assert usual.cell in reached
    learned.reached[usual.robot] = reached[reached != usual.cell]
    other = highlight(*team)
    assert (other.robot, other.cell) != (usual.robot, usual.cell)
    learned.reached = [[], []]
    assert highlight(*team).text.startswith("Here ")


class Undecided(LearnedTeam):
    """A team whose tables say of no move that it is the one after an answer."""

    def chose_by_answer(self, step, k):
        return False


@pytest.mark.parametrize("what", ["its move", "that it asks"])
def test_what_its_tables_do_not_confirm_is_told_as_what_happened(team, tables, what):
    """Not as what it has learned."""
    log, learned, *more = team
    if what == "its move":
        learned = Undecided(log.run, tables)
    else:
        learned.policies = [
            one._replace(asks=one.asks & False) for one in learned.policies
        ]
    found = highlight(log, learned, *more)
    told = r"Here robot_[12] asks .*\. Answer: robot_[12] is .*\. robot_[12] .*\.$"
    assert re.match(told, found.text)
    assert " if " not in found.text
    assert log.asked[np.searchsorted(log.step, found.step)].any()


def test_of_a_larger_team_one_robot_is_told(record):
    """All robots that ask at once would fill the page."""
    settings = {"steps": 300, "penalty": -100}
    bag = record("env2-4r", settings=settings, values={"learner": "voi"}).bag
    long_log = GrowingLog(bag)
    tables = [long_log.so_far.tables_before(k).tables for k in range(4)]
    log = read_run(bag)
    narrator = Narrator(log.run.scenario)
    team = LearnedTeam(log.run, tables)
    found = highlight(log, team, KeySteps(log.run), narrator)
    row = np.searchsorted(log.step, found.step)
    assert log.asked[row].sum() > 1
    assert found.text.count(" asks ") == 1


def test_since_when_a_robot_would_ask_is_told():
    told = [since_in_words("robot_1", 1, since) for since in (None, 1, 10_873)]
    assert told == [
        "By its newest tables robot_1 would not ask there.",
        "By its tables robot_1 would have asked there from the start.",
        "robot_1 learned to ask there at about step 10,900.",
    ]


def test_robots_without_a_way_to_a_doorway_do_not_meet_at_it(make):
    run = make_run(make("1.D.2\n#####\n....."), {})
    found = KeySteps(run)
    number = run.scenario.map.number
    cells = [[(0, 1), (0, 3)], [(0, 1), (2, 0)], [(2, 1), (2, 0)], [(0, 2), (0, 4)]]
    places = np.array([[number[place] for place in joint] for joint in cells])
    assert found.meetings(places).tolist() == [True, False, False, False]


def test_jumps_lead_to_what_matters(learned):
    player = Player(learned)
    log = read_run(learned)
    player.source.read_through()
    marks = player.board.get("marks")
    inter = interactions_of(log.run.scenario)
    met = miscoordinations(inter, log.cells[:-1].T, log.cells[1:].T)
    met &= np.diff(log.step) == 1
    for kind, due in (("question", log.asked.any(axis=1)), ("miscoordination", met)):
        steps = log.step[np.flatnonzero(due)]
        assert set(marks[kind]) <= set(steps.tolist()) and marks[kind][0] == steps[0]
        player.do(SEEK, int(steps[4]))
        frame = player.do(JUMP, kind)
        assert (frame["step"], frame["state"]) == (steps[5], "paused")
        assert bool(frame["asks"]) if kind == "question" else frame["miscoordination"]
        last = player.do(SEEK, log.step[-1].item())["step"]
        assert player.do(JUMP, kind)["step"] == last, "it does not begin again"
        assert player.board.get("said")["text"] == f"No {kind} after this step."
        assert player.do(SEEK, 1) and player.board.get("said")["text"] == ""
    history = log.history()
    player.do(SEEK, 10**9)
    crossing = player.do(JUMP, "crossing")["step"]
    assert player.do(JUMP, "crossing")["step"] == crossing
    number = int(np.searchsorted(history.first_step, crossing, side="right")) - 1
    assert history.arrived[number].all() and not history.miscoordinations[number]
    for step in marks["policy"]:
        k = [
            np.isin(steps, step).any()
            for steps, _ in (
                log.series[COORDINATION_MAP, k] for k in range(len(log.names))
            )
        ].index(True)
        assert step in log.series[COORDINATION_MAP, k][0]
    assert set(kinds_of(log.run.scenario)) <= set(marks)


def test_a_bag_that_grows_is_followed(bag, tmp_path, monkeypatch):
    data = bag_files(bag)[0].read_bytes()
    path = tmp_path / "grows.mcap.partial"
    path.write_bytes(data[: len(data) // 2])
    monkeypatch.setattr(
        "sparse_coord_ros.show.page.bag_source.being_recorded", lambda path: True
    )
    player = Player(path, step=None)
    before = player.after(0.1)
    player.source.learn()
    assert (
        player.board.get("tables")["robots"][0]["step"]
        in player.source.log.so_far.table_steps()[0]
    )
    assert (
        before["state"] == "following"
        and "follows" in player.board.get("notice")["text"]
    )
    assert before["step"] == player.source.log.last_step
    # it follows no longer
    assert player.do(SEEK, 50, seconds=1.0)["state"] == "playing"
    assert (
        player.do(PAUSE, True)["state"] == "paused" and player.after(9.0)["step"] < 70
    )
    assert player.do(SEEK, 40)["state"] == "paused"
    assert player.do(SEEK, 10**6)["state"] == "following"  # and now it does
    assert player.do(STEP, 1)["state"] == "ended"
    assert player.do(PAUSE, False)["state"] == "following"
    nothing_read = player.do(JUMP, "policy")
    assert nothing_read["step"] == before["step"]
    said = player.board.get("said")["text"]
    assert said == (
        "No change of where a robot would ask after this step; 0 % of the log are read so far."
    )
    reading = threading.Thread(target=player.source.read_through)
    reading.start()
    while player.board.get("curves") is None:
        time.sleep(0.01)
    frame = player.do(SEEK, 10**6)
    half = read_run(path).between(0, frame["step"])
    # the episode that goes on is counted, too
    assert frame["counted_to"] == frame["step"]
    assert np.sum(player.board.get("asked")["robots"]) == half.asked.sum()
    assert frame["episodes"] == len(np.unique(half.episode))
    with path.open("ab") as file:
        file.write(data[len(data) // 2 :])
    player.source.look()
    reading.join()
    assert player.board.get("curves")["episodes"] == read_run(bag).history().episodes
    assert player.after(0.1)["step"] == read_run(bag).step[-1] > before["step"]
    assert not player.source.growing and player.board.get("notice")["text"] == ""
    assert (
        player.do(JUMP, LEARNED_EPISODE)["step"] == player.board.get("learned")["first"]
    )


def test_a_long_look_at_a_file_is_followed_by_a_longer_pause(player, monkeypatch):
    looks = []

    def look():
        looks.append(Player.now)
        Player.now += 2.0

    player.source.growing = True
    monkeypatch.setattr(player.source, "look", look)
    counts = []
    for later in (0.0, 1.0, 18.0, 1.5):
        Player.now += later
        player.source.look_when_due()
        counts.append(len(looks))
    assert counts == [1, 1, 1, 2]


@pytest.mark.parametrize(
    ("recorded_now", "words"), [(True, "try again soon"), (False, "info'")]
)
def test_a_bag_without_a_message_yet(tmp_path, monkeypatch, recorded_now, words):
    nothing = SimpleNamespace(
        empty=True,
        finished=False,
        last_file=tmp_path,
        run=None,
    )
    monkeypatch.setattr(
        "sparse_coord_ros.show.page.bag_source.GrowingLog", lambda *_: nothing
    )
    monkeypatch.setattr(
        "sparse_coord_ros.show.page.bag_source.being_recorded",
        lambda path: recorded_now,
    )
    with pytest.raises(BagError, match=words):
        BagSource(tmp_path, MessageBoard())


def test_what_is_damaged_unfinished_or_removed(bag, tmp_path):
    data = bytearray(bag_files(bag)[0].read_bytes())
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    player = Player(cut)
    assert "it has no end" in player.board.get("notice")["text"]
    whole = bytearray(bag_files(bag)[0].read_bytes())
    offset, _ = chunks_in(bag_files(bag)[0])[-1]
    whole[offset + 200 : offset + 264] = bytes(64)
    cut.write_bytes(whole)
    player = Player(cut)
    player.source.read_through()
    assert "damaged at byte " in player.board.get("notice")["text"]
    copy = tmp_path / "copy"
    shutil.copytree(bag, copy)
    player = Player(copy)
    shutil.rmtree(copy)
    assert player.do(SEEK, 500)["step"] > 490


def test_people_count_learning_steps(bag):
    """The log's time steps are more: there are some between two episodes."""
    log = read_run(bag)
    made = np.arange(len(log.step)) - log.episode
    begins = np.searchsorted(log.step, log.history().first_step)
    assert log.history().steps_before.tolist() == made[begins].tolist()
    player = Player(bag)
    assert player.do(SEEK, 10**9)["made"] is None, "not read so far"
    player.source.read_through()
    for row in (0, 40, len(log.step) // 2, -1):
        assert player.do(SEEK, int(log.step[row]))["made"] == made[row]
    last = player.do(SEEK, 10**9)
    assert last["made"] == log.run.scenario.steps < last["step"]
    curves = player.board.get("curves")
    assert curves["step"][-1] < log.run.scenario.steps
