# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page in headless Chromium: every source, every button, and values that are the log's."""

import re
from pathlib import Path

import numpy as np
import pytest
from browser import REMEDY, Browser, find_browser
from floor_plans import write
from teams import tables_in

from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.history import load_history
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.runlog import read_run
from sparse_coord_ros.log.runlog.relearned import Relearned
from sparse_coord_ros.log.runlog.window import LongLog
from sparse_coord_ros.show.page import messages
from sparse_coord_ros.show.page.message_board import MessageBoard
from sparse_coord_ros.show.page.server import Server

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]

STEP = "Number(document.getElementById('step').textContent.replaceAll(',', ''))"
STATE = "document.getElementById('state').dataset.state"


@pytest.fixture
def browser():
    if find_browser() is None:
        pytest.fail(REMEDY)
    with Browser() as opened:
        opened.size(1440, 960)
        yield opened
        assert opened.problems == []


@pytest.fixture(autouse=True)
def runs_in_a_folder_of_its_own(tmp_path, monkeypatch):
    """Leave no runs behind: a page names no directory for the run that it starts."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def bag(record):
    settings = {"steps": 1500, "perception": "probability:0.6"}
    return record(settings=settings, values={"checkpoint": 200}).bag


def address_of(process):
    process.wait_for("watch it at ")
    return re.search(r"watch it at (http\S+)", process.output)[1]


def click(browser, name):
    browser.value(f"document.getElementById('{name}').click()")


def cells(browser):
    """Return the cell of each robot on the map."""
    return browser.value(
        "[...document.querySelectorAll('.robot')].map((r) => Number(r.dataset.cell))"
    )


def test_a_bag_is_played_and_every_value_is_the_log_s(browser, start, bag):
    log = read_run(bag)
    process = start("cli.main", "watch", str(bag), "--port", "0", "--rate", "20")
    browser.open(address_of(process))
    browser.wait_for(f"{STEP} > 20")
    browser.wait_for("document.querySelector('#map .ask')")  # drawn while it plays
    browser.press(" ", "Space")
    browser.wait_for(f"{STATE} === 'paused'")
    step = browser.value(STEP)
    row = int(np.searchsorted(log.step, step))
    assert cells(browser) == log.cells[row].tolist()
    click(browser, "next-step")
    browser.wait_for(f"{STEP} === {log.step[row + 1]}")
    assert cells(browser) == log.cells[row + 1].tolist()
    browser.press("ArrowLeft")
    browser.wait_for(f"{STEP} === {step}")
    asking = int(np.flatnonzero(log.asked[:, 1] & ~log.perceived[:, 1])[9])
    wanted = int(log.step[asking])
    browser.value(
        "(() => { const s = document.getElementById('seek');"
        f"s.value = {wanted}; s.dispatchEvent(new Event('input')); }})()"
    )
    browser.wait_for(f"{STEP} === {wanted}")
    browser.wait_for(
        'document.querySelector(\'#map .ask[data-robot="2"][data-outcome="refused"]\')'
    )
    said = (
        f"document.querySelector('#dialogue li').innerText.includes('step {wanted}: ')"
    )
    browser.wait_for(said)
    assert "refused" in browser.value(
        "document.querySelector('#dialogue li').innerText"
    )
    browser.wait_for("document.getElementById('foot').dataset.read === '1'")
    due = (log.history().first_step <= wanted).sum()
    browser.wait_for(f"document.getElementById('episodes').textContent === '{due}'")
    moved = (
        f"{DETAILS}.find((text) => /goes \\w+ by Q\\*\\[\\d+\\]: north /.test(text))"
    )
    browser.wait_for(moved)  # the row of the table that decided
    browser.value("document.querySelector('#dialogue details').open = true")
    click(browser, "back")
    browser.wait_for(f"{STEP} < {wanted}")
    click(browser, "next-step")
    browser.wait_for(f"{STEP} === {wanted}")
    browser.wait_for("document.querySelectorAll('#curves .curve').length === 6")
    browser.wait_for("!document.getElementById('evaluation-panel').hidden")
    browser.value("document.getElementById('map').focus()")
    browser.press("ArrowDown")
    browser.press("ArrowRight")
    shown = browser.wait_for(
        "[...document.querySelectorAll('#cell tr[data-robot=\"1\"] td')]"
        ".map((cell) => cell.textContent)"
    )
    title = browser.value("document.getElementById('cell-title').textContent")
    cell = int(re.search(r"cell (\d+)", title)[1])
    again = LongLog(bag)
    [(at, tables), _] = Relearned(again).tables(wanted).values()
    again.bag.close()
    assert at == wanted and shown[1:] == [
        f"{value:.2f}" for value in tables.q_star[cell]
    ]
    ages = browser.value("document.getElementById('ages').textContent")
    assert ages == f"Tables of step {at:,}."


DETAILS = (
    "[...document.querySelectorAll('#dialogue details')].map((one) => one.textContent)"
)

CUT = """[...document.querySelectorAll('.trail')].flatMap((line) => {
  const at = [...line.points];
  return at.slice(1).map((p, i) => Math.abs(p.x - at[i].x) + Math.abs(p.y - at[i].y));
}).filter((far) => far !== 48).length"""
"""How many parts of trails do not lead from a cell to the one beside it."""


def test_trails_follow_the_cells_though_frames_are_skipped(browser, start, bag):
    process = start(
        "cli.main", "watch", str(bag), "--port", "0", "--rate", "300", "--step", "1"
    )
    browser.open(address_of(process))
    longest = "Math.max(...[...document.querySelectorAll('.trail')].map((t) => t.points.length))"
    browser.wait_for(f"{STEP} > 0 && document.querySelector('.trail')")
    steps = set()
    for _ in range(20):
        steps.add(browser.value(STEP))
        browser.wait_for(f"{STEP} > {max(steps)} || {STATE} === 'ended'")
        assert browser.value(CUT) == 0
    assert max(np.diff(sorted(steps))) > 3, "some frames were skipped"
    browser.wait_for(f"{STATE} === 'ended' && {longest} > 3")
    assert browser.value(CUT) == 0


@pytest.fixture
def shown(browser):
    """Return a function that shows frames of a run, made up, and one that gives a frame."""
    scenario = load_scenario("crowd-4r")
    board = MessageBoard()
    number = scenario.map.number
    fields = messages.run_fields(make_run(scenario, {}))
    board.put("run", source="live", title="made up", controls=(), **fields)
    server = Server(board, port=0)
    browser.open(server.address)

    def show(step, places, asks=(), after=None, **more):
        places, after = (
            [number[one] for one in cells] for cells in (places, after or places)
        )
        said = {"robot": 0, "peers": [1], "outcome": "answered", "ended": "answered"}
        board.put(
            "frame",
            step=step,
            cells=places,
            trails=[[cell] for cell in places],
            asks=[{**said, "robot": k} for k in asks],
            after=after,
            **{
                "state": "learning",
                "rate": 0,
                "speed": None,
                "transitions": step,
                "episode": 0,
            },
            **{"miscoordination": False, **more},
        )
        browser.wait_for(f"{STEP} === {step}")

    yield show
    server.close()


def test_a_question_is_drawn_where_it_was_asked_and_a_miscoordination_where_it_was(
    browser, shown
):
    places = [(1, 3), (3, 3), (5, 5), (6, 6)]
    drawn = "[...document.querySelectorAll('#map {}')].map(({{{}: x, {}: y}}) => "
    drawn += "[x.baseVal.value, y.baseVal.value])"
    lines = drawn.format(".ask line", "x1", "y1")
    for step in (1, 3, 5):
        shown(step, places, asks=[0])
        asked = browser.value(lines)
        shown(step + 1, [(0, 3), *places[1:]])
        late = browser.value(lines)  # it is still seen, or gone
        assert asked == [[3.5 * 48, 1.5 * 48]] and late in (asked, [])
    rings = drawn.format(".met", "cx", "cy")
    doors = [(1, 4), (1, 4), (3, 4), (6, 6)]
    shown(7, places, after=doors, miscoordination=True)
    assert browser.value(rings) == [[4.5 * 48, 1.5 * 48]], "where two robots are"
    apart = [(1, 4), (5, 4), (3, 3), (6, 6)]
    shown(8, places, after=apart, miscoordination=True)
    both = [[4.5 * 48, 1.5 * 48], [4.5 * 48, 5.5 * 48]]
    assert browser.value(rings) == both, "all doorways are one meeting place"
    shown(9, places, after=apart)
    assert browser.value(rings) == []
    assert browser.value("document.getElementById('speed').textContent") == "–"
    assert (
        browser.value("document.getElementById('silence').textContent")
        == "No question shown so far."
    )


WIDE = "document.documentElement.scrollWidth <= window.innerWidth"


@pytest.fixture(scope="module")
def learned(record):
    """Return the bag of a team of which one robot has learned to ask."""
    return record(settings={"steps": 4000, "penalty": -100}, values={"seed": 2}).bag


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_bag_opens_on_what_was_learned_and_keys_lead_on(
    browser, start, learned, scheme
):
    browser.prefer(scheme)
    process = start("cli.main", "watch", str(learned), "--port", "0")
    browser.size(1280, 900)
    browser.open(address_of(process))
    said = "document.getElementById('learned').innerText"
    browser.wait_for(
        f"{said}.includes('asks before the doorway') && {said}.includes('about')", 10
    )
    browser.wait_for("document.querySelectorAll('.trail[points*=\" \"]').length === 2")
    assert browser.value("document.querySelectorAll('.arrow.pale').length") > 0
    for key, kind in (("q", "question"), ("m", "miscoordination"), ("p", "policy")):
        browser.press("Home")
        browser.wait_for(f"{STEP} < 5")
        browser.wait_for(f"!document.querySelector('#jumps .{kind}').disabled")
        for _ in range(2):
            step = browser.value(STEP)
            browser.press(key)
            browser.wait_for(f"{STEP} > {step} && {STATE} === 'paused'")
    browser.press("End")
    browser.wait_for(f"{STATE} === 'ended'")
    last = browser.value(STEP)
    browser.press("m")
    told = "document.getElementById('said').textContent"
    browser.wait_for(f"{told} === 'No miscoordination after time step {last:,}.'")
    assert browser.value(STEP) == last
    browser.press("c")
    browser.wait_for(f"{STEP} < {last} && {told} === ''")
    whole = browser.value("document.getElementById('map').getAttribute('viewBox')")
    browser.press("z")
    browser.wait_for(
        f"document.getElementById('map').getAttribute('viewBox') !== '{whole}'"
    )
    browser.press("f")
    browser.wait_for(
        f"document.getElementById('map').getAttribute('viewBox') === '{whole}'"
    )
    browser.press("l")
    browser.wait_for(f"{STATE} === 'playing'")
    header = "document.querySelector('header')"
    assert browser.value(f"{header}.clientHeight") < 70  # two lines
    browser.size(400, 900)
    browser.wait_for(WIDE)
    value = browser.wait_for(
        "document.querySelector('#evaluation tr:nth-child(4) td:last-child')"
    )
    assert value and browser.value(
        "document.querySelector('#evaluation tr:nth-child(4) td:last-child')"
        ".getBoundingClientRect().right < 400"
    )


def q_star_shown(browser, page="document"):
    """Return the row of robot 1 of Q* of the map's first cell, as it is shown, by arrow keys."""
    browser.value(f"{page}.getElementById('map').focus()")
    down = "new KeyboardEvent('keydown', {key: 'ArrowDown', bubbles: true})"
    browser.value(f"{page}.getElementById('map').dispatchEvent({down})")
    cells = f"{page}.querySelectorAll('#cell tr[data-robot=\"1\"] td')"
    shown = f"[...{cells}].map((c) => c.textContent)"
    title = f"{page}.getElementById('cell-title').textContent"
    return browser.wait_for(f"{title}.includes(' cell 0 ') && {shown}")[1:]


AGES = "getElementById('ages').textContent"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_run_without_ros_ends_on_its_final_tables_then_acts_greedily(
    browser, start, tmp_path, scheme
):
    """The page has them beside the value of the team; robots that move are not said to stand."""
    out = tmp_path / "run"
    browser.prefer(scheme)
    options = (
        "--steps",
        "60000",
        "--engine",
        "python",
        "--penalty",
        "-100",
        "--seed",
        "4",
    )
    process = start(
        "cli.main",
        "train",
        "env1",
        *options,
        "--watch",
        "--port",
        "0",
        "--out",
        str(out),
    )
    browser.open(address_of(process))
    browser.wait_for("!document.getElementById('evaluation-panel').hidden", 90)
    assert browser.value(STATE) == "finished"
    browser.wait_for(f"document.{AGES} === 'Tables at the end of learning.'")
    assert browser.value("document.getElementById('speed').textContent") == "0"
    due = [f"{value:.2f}" for value in tables_in(out)[0].q_star[0]]
    assert q_star_shown(browser) == due
    asked = tables_in(out)[0].memory["updates"][:, COORDINATE]
    cells = (asked > 0).sum()
    shown = "document.querySelectorAll('#map rect[fill-opacity]').length"
    assert browser.value(shown) >= cells > 5
    again = start("cli.main", "watch", str(out), "--port", "0")
    browser.open(address_of(again))
    browser.wait_for(f"{STATE} === 'acting greedily' && {STEP} > 2")
    assert browser.value("document.getElementById('speed').textContent") == "2"
    assert browser.value(STEP) < 40, "it is a step of the episode"
    assert browser.value(
        "document.getElementById('transitions').textContent"
    ).startswith("60,000")
    played = "document.getElementById('asked-where').textContent"
    assert browser.value(played) == "asked here in 200 greedy episodes"
    assert q_star_shown(browser) == due
    for width in (1280, 400):
        browser.size(width, 800)
        browser.wait_for(WIDE)


def test_two_runs_are_beside_each_other(browser, start, learned, bag):
    process = start("cli.main", "watch", str(learned), str(bag), "--port", "0")
    browser.open(address_of(process))
    frames = (
        "[...document.querySelectorAll('iframe')].map((one) => one.contentDocument)"
    )
    browser.wait_for(
        f"{frames}.filter((page) => page.getElementById('learned')?.innerText).length === 2"
    )
    titles = browser.value(
        f"{frames}.map((page) => page.getElementById('about').textContent)"
    )
    assert "penalty -100" in titles[0] and "penalty -20" in titles[1]
    browser.value(f"{frames}[1].getElementById('pause').click()")
    states = f"{frames}.map((page) => page.getElementById('state').textContent).join()"
    browser.wait_for(f"{states} === 'playing,paused'")


@pytest.mark.parametrize("robots", [2, 4, 8])
def test_a_team_is_watched_from_its_first_step(browser, start, tmp_path, robots):
    options = (
        "--steps",
        "300",
        "--rate",
        "20",
        "--port",
        "0",
        "--no-record",
        "--watch",
    )
    out = ("--set", "max_steps=40", "--out", str(tmp_path / "run"))
    process = start("cli.main", "run", f"crowd-{robots}r", *options, *out)
    browser.open(address_of(process))
    browser.wait_for(f"{STEP} >= 1")
    assert browser.problems == []
    browser.wait_for("Number(document.getElementById('episodes').textContent) > 1")
    browser.wait_for("document.querySelector('.curve')")


def test_a_run_on_its_own_page_then_the_next_one(browser, start, tmp_path):
    out = tmp_path / "run"
    options = ("--steps", "1500", "--rate", "300", "--penalty", "-100", "--port", "0")
    process = start("cli.main", "run", "env1", *options, "--watch", "--out", str(out))
    browser.open(address_of(process))
    browser.wait_for(f"{STEP} > 10 && {STATE} === 'learning'")
    before = cells(browser)
    browser.wait_for(
        "JSON.stringify([...document.querySelectorAll('.robot')].map((r) => "
        f"Number(r.dataset.cell))) !== '{str(before).replace(' ', '')}'"
    )
    click(browser, "pause")
    browser.wait_for(f"{STATE} === 'paused'")
    step = browser.value(STEP)
    click(browser, "next-step")
    browser.wait_for(f"{STEP} > {step}")
    click(browser, "reset")
    browser.value(
        "(() => { const r = document.getElementById('rate'); r.value = '0';"
        "r.dispatchEvent(new Event('change')); })()"
    )
    click(browser, "pause")
    browser.wait_for(f"{STATE} === 'finished'")
    browser.wait_for("!document.getElementById('evaluation-panel').hidden")
    browser.wait_for("document.querySelector('#map .ask, #dialogue li')")
    history = load_history(out)
    browser.wait_for(
        f"document.getElementById('episodes').textContent === '{history.episodes}'"
    )
    assert browser.value(
        "document.getElementById('transitions').textContent"
    ).startswith("1,500")
    browser.value("document.getElementById('scenario').value = 'isr'")
    browser.value("document.getElementById('penalty').value = '-5'")
    browser.wait_for("!document.getElementById('start').disabled")
    click(browser, "start")
    browser.wait_for("document.getElementById('about').textContent.startsWith('isr')")
    assert "penalty -5," in browser.value(
        "document.getElementById('about').textContent"
    )
    browser.wait_for(f"{STEP} > 10")


def test_a_page_beside_a_team_in_other_processes(browser, start, tmp_path):
    page = start("nodes.watch", "--ros-args", "-p", "port:=0")
    browser.open(address_of(page))
    browser.wait_for(
        "document.getElementById('notice').textContent.includes('waiting')"
    )
    for number in range(2):  # the page stays, teams come and go
        options = (
            "--steps",
            "400",
            "--rate",
            "60",
            "--no-record",
            "--seed",
            str(number),
        )
        out = str(tmp_path / f"run{number}")
        team = start("cli.main", "run", "env1", "--processes", *options, "--out", out)
        about = "document.getElementById('about').textContent"
        browser.wait_for(f"{about}.endsWith('seed {number}') && {STEP} > 15")
        browser.wait_for(f"{STATE} === 'learning'")
        browser.wait_for(f"['finished', 'gone'].includes({STATE})", 60)
        assert team.exit_code() == 0
    history = load_history(tmp_path / "run1")
    late = "document.getElementById('notice').textContent.includes('the curves lack what was')"
    same = f"document.getElementById('episodes').textContent === '{history.episodes}'"
    browser.wait_for(f"{late} || {same}")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_eight_robots_in_light_and_dark(browser, start, tmp_path, scheme):
    (tmp_path / "eight.txt").write_text(
        "title: Two rooms\n---\n12..#..56\n....D....\n....#....\n....D....\n34..#..78\n"
    )
    robots = "".join(
        f"  robot_{k}: {{start: {k}, goal: [{(k - 1) % 4}, {8 if k < 5 else 0}]}}\n"
        for k in range(1, 9)
    )
    (tmp_path / "eight.yaml").write_text(
        f"map: eight.txt\nrobots:\n{robots}steps: 20000\n"
    )
    browser.prefer(scheme)
    process = start(
        "cli.main", "train", str(tmp_path / "eight.yaml"), "--engine", "python", "--watch",
        "--port", "0", "--out", str(tmp_path / "run"),
    )  # fmt: skip
    browser.open(address_of(process))
    browser.wait_for(f"{STEP} > 10")
    assert (
        browser.value("document.querySelectorAll('.robot[visibility=visible]').length")
        == 8
    )
    shapes = "[...document.querySelectorAll('.robot .body')].map((b) => b.outerHTML)"
    assert len(set(browser.value(shapes))) == 8
    browser.press("8", "Digit8")
    browser.wait_for("document.querySelector('.arrow[data-robot=\"8\"]')")
    arrows = "[...document.querySelectorAll('#map .arrow')].map((a) => [a.dataset.robot, {}])"
    dashed = browser.value(arrows.format("a.hasAttribute('stroke-dasharray')"))
    assert {tuple(one) for one in dashed} == {
        ("1", False),
        ("8", True),
    }  # told apart in grey
    assert browser.value(WIDE)
    browser.size(700, 900)
    browser.wait_for(WIDE)
    page = browser.value("getComputedStyle(document.body).backgroundColor")
    assert (page == "rgb(22, 23, 25)") == (scheme == "dark")


TEAM = "document.getElementById('team').textContent"


def press(browser, x, y):
    """Click a place of an imported map, in metres."""
    on = browser.value(
        f"(({{x, y}}) => [x, y])(new DOMPoint({100 * x}, {-100 * y})"
        ".matrixTransform(document.getElementById('map').getScreenCTM()))"
    )
    for kind in ("mousePressed", "mouseReleased"):
        how = {"type": kind, "button": "left", "clickCount": 1}
        browser.ask("Input.dispatchMouseEvent", x=on[0], y=on[1], **how)


def place_robots(browser, places):
    for n, place in enumerate(places, start=1):
        press(browser, *place)
        browser.wait_for(f"document.querySelectorAll('.start, .goal').length === {n}")


def test_a_depot_becomes_a_driven_team_by_clicks(browser, start, tmp_path):
    """From the image to bodies that drive what was learned; another team is stopped."""
    write("depot", tmp_path)
    process = start(
        "cli.main", "import-map", str(tmp_path / "depot.yaml"), "--page", "--port", "0",
        "--out", str(tmp_path / "out"),
    )  # fmt: skip
    browser.open(address_of(process))
    browser.wait_for(
        "document.getElementById('facts').textContent.startsWith('1,560 cells')"
    )
    place_robots(browser, [(1.5, 1.5), (28.5, 13.5), (28.5, 13.5), (1.5, 1.5)])
    click(browser, "train")
    browser.wait_for(f"{TEAM}.startsWith('Learned: ')", 300)
    click(browser, "drive")
    browser.wait_for(
        f"{TEAM}.startsWith('Bodies of radius 0.2 m drove 20 episodes')", 120
    )
    assert "in 20 all robots arrived; walls touched: 0, " in browser.value(TEAM)
    click(browser, "train")
    browser.wait_for(f"{TEAM}.startsWith('A team learns: ')")
    click(browser, "stop")
    browser.wait_for(f"{TEAM}.startsWith('Stopped.')")
    browser.wait_for("!document.getElementById('train').hidden")


def test_a_building_becomes_a_team_by_clicks(browser, start, tmp_path):
    """From the image to a team that has learned: cells, robots, doorways, undo, save, train."""
    out = tmp_path / "office"
    options = ("--page", "--port", "0", "--out", str(out), "--set", "steps=20000")
    process = start(
        "cli.main", "import-map", str(ROOT / "examples/office.yaml"), *options
    )
    browser.open(address_of(process))
    facts = "document.getElementById('facts').textContent"

    browser.wait_for(f"{facts} === '937 cells of 0.5 m, 6 doorways'")
    browser.value(
        "(() => { const c = document.getElementById('cell-side');"
        "c.value = 0.4; c.dispatchEvent(new Event('change')); })()"
    )
    browser.wait_for(
        "document.getElementById('notes').innerText.includes('lanes touch walls')"
    )
    click(browser, "undo")
    browser.wait_for(f"{facts}.startsWith('937 cells of 0.5 m')")
    places = [(-8, -5), (8, 5), (8, 5), (-8, -5)]
    place_robots(browser, places)
    press(browser, -3.4, 3)
    browser.wait_for(
        "document.getElementById('notice').innerText.includes('in no free cell')"
    )
    click(browser, "undo")
    browser.wait_for("document.getElementById('notice').hidden")
    browser.value("document.getElementById('map').focus()")
    for key in ("ArrowLeft", "Enter"):  # by keys alone
        browser.press(key)
    browser.wait_for("document.querySelectorAll('.start').length === 3")
    click(browser, "undo")
    browser.value("document.querySelector('input[value=doorways]').click()")
    for place, doors in (((-4, 0.1), 7), ((-6.6, -0.9), 6)):
        press(browser, *place)
        browser.wait_for(f"{facts}.endsWith(', {doors} doorways')")
    click(browser, "closer")
    ticks = "document.querySelectorAll('.x-axis').length"
    browser.wait_for(f"{ticks} > 3")
    for width, height in ((400, 800), (1280, 900)):
        browser.size(width, height)
        assert browser.value(WIDE)
    click(browser, "train")
    browser.wait_for(f"{TEAM}.startsWith('Learned: runs/office_')", 120)
    frame = "document.getElementById('learning').contentDocument"
    browser.wait_for(f"{frame}.querySelector('#state').dataset.state === 'finished'")
    browser.wait_for(f"{frame}.{AGES} === 'Tables at the end of learning.'")
    made = Path(re.search(r"Learned: (runs/office_\S+?)\. ", browser.value(TEAM))[1])
    tables = tables_in(made)
    assert q_star_shown(browser, frame) == [
        f"{value:.2f}" for value in tables[0].q_star[0]
    ]
    made = load_scenario(out / "office.yaml")
    grid = made.map
    for k, robot in enumerate(made.robots):
        for cell, (x, y) in (
            (robot.start, places[2 * k]),
            (robot.goal, places[2 * k + 1]),
        ):
            row, column = grid.cells[cell]
            level = grid.shape[0] - 1 - row
            middle = [
                grid.origin[0] + (column + 0.5) / 2,
                grid.origin[1] + (level + 0.5) / 2,
            ]
            assert np.abs(np.subtract(middle, (x, y))).max() <= 0.25
