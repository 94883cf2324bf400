# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page in headless Chromium: every source, every button, and the log's values."""

import re
from pathlib import Path

import numpy as np
import pytest
from browser import open_tab, size, visit, wait_for
from floor_plans import write
from PIL import Image
from teams import tables_in

from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.history import load_history
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.runlog import read_run
from sparse_coord_ros.log.runlog.growing import GrowingLog
from sparse_coord_ros.log.runlog.relearned import Relearned
from sparse_coord_ros.show.narrator import Narrator
from sparse_coord_ros.show.page import page_messages
from sparse_coord_ros.show.page.message_board import MessageBoard
from sparse_coord_ros.show.page.server import Server

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]

STEP = "Number(document.getElementById('step').dataset.step)"
"""The time step of the log; people see learning steps."""
STATE = "document.getElementById('state').dataset.state"


@pytest.fixture
def tab():
    """Return a tab of a tab; its page must not complain of anything."""
    problems = []
    with open_tab() as opened:
        opened.on("pageerror", lambda error: problems.append(str(error)))
        opened.on(
            "console",
            lambda said: problems.append(said.text) if said.type == "error" else None,
        )
        yield opened
    assert problems == []


@pytest.fixture(autouse=True)
def runs_in_a_folder_of_its_own(tmp_path, monkeypatch):
    """Leave no runs behind: a page names no directory for the run that it starts."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def bag(record):
    settings = {"steps": 1500, "perception": "probability:0.6"}
    return record(settings=settings, values={"checkpoint": 200}).bag


def address_of(process):
    process.wait_for("the page is at ")
    return re.search(r"the page is at (http\S+)", process.output)[1]


def click(tab, name):
    tab.evaluate(f"document.getElementById('{name}').click()")


def cells(tab):
    """Return the cell of each robot on the map."""
    return tab.evaluate(
        "[...document.querySelectorAll('.robot')].map((r) => Number(r.dataset.cell))"
    )


def test_a_bag_is_played_and_every_value_is_the_log_s(tab, start, bag):
    log = read_run(bag)
    process = start("cli.main", "watch", str(bag), "--port", "0", "--rate", "20")
    visit(tab, address_of(process))
    wait_for(tab, f"{STEP} > 20")
    wait_for(tab, "document.querySelector('#map .ask')")  # drawn while it plays
    tab.keyboard.press("Space")
    wait_for(tab, f"{STATE} === 'paused'")
    step = tab.evaluate(STEP)
    row = int(np.searchsorted(log.step, step))
    assert cells(tab) == log.cells[row].tolist()
    click(tab, "next-step")
    wait_for(tab, f"{STEP} === {log.step[row + 1]}")
    assert cells(tab) == log.cells[row + 1].tolist()
    tab.keyboard.press("ArrowLeft")
    wait_for(tab, f"{STEP} === {step}")
    asking = int(np.flatnonzero(log.asked[:, 1] & ~log.perceived[:, 1])[9])
    wanted = int(log.step[asking])
    tab.evaluate(
        "(() => { const s = document.getElementById('seek');"
        f"s.value = {wanted}; s.dispatchEvent(new Event('input')); }})()"
    )
    wait_for(tab, f"{STEP} === {wanted}")
    wait_for(
        tab,
        'document.querySelector(\'#map .ask[data-robot="2"][data-outcome="refused"]\')',
    )
    made = asking - log.episode[asking]
    said = (
        f"document.querySelector('#dialogue li').innerText.includes('step {made:,}: ')"
    )
    wait_for(tab, said)
    assert tab.evaluate("document.getElementById('step').textContent") == f"{made:,}"
    assert "refused" in tab.evaluate("document.querySelector('#dialogue li').innerText")
    wait_for(tab, "document.getElementById('foot').dataset.read === '1'")
    due = (log.history().first_step <= wanted).sum()
    wait_for(tab, f"document.getElementById('episodes').textContent === '{due}'")
    moved = (
        f"{DETAILS}.find((text) => /goes \\w+ by Q\\*\\[\\d+\\]: north /.test(text))"
    )
    wait_for(tab, moved)  # the row of the table that decided
    tab.evaluate("document.querySelector('#dialogue details').open = true")
    click(tab, "back")
    wait_for(tab, f"{STEP} < {wanted}")
    click(tab, "next-step")
    wait_for(tab, f"{STEP} === {wanted}")
    wait_for(tab, "document.querySelectorAll('#curves .curve').length === 4")
    wait_for(tab, "!document.getElementById('evaluation-panel').hidden")
    tab.evaluate("document.getElementById('map').focus()")
    tab.keyboard.press("ArrowDown")
    tab.keyboard.press("ArrowRight")
    wait_for(tab, f"document.{AGES} === 'Tables of this step.'")
    title, *shown = wait_for(
        tab,
        "document.querySelector('#cell tr[data-robot=\"1\"] td') &&"
        "[document.getElementById('cell-title'),"
        "...document.querySelectorAll('#cell tr[data-robot=\"1\"] td')]"
        ".map((one) => one.textContent)",
    )
    cell = int(re.search(r"cell (\d+)", title)[1])
    again = GrowingLog(bag)
    [(at, tables), _] = Relearned(again).tables(wanted).values()
    assert at == wanted
    values = tables.q_star[cell].tolist()
    due = [f"{value:.2f}" for value in values]
    if len(set(values)) == 1:
        due = ["never learned"]
    assert shown[1:] == due


DETAILS = (
    "[...document.querySelectorAll('#dialogue details')].map((one) => one.textContent)"
)

CUT = """[...document.querySelectorAll('.trail')].flatMap((line) => {
  const at = [...line.points];
  return at.slice(1).map((p, i) => Math.abs(p.x - at[i].x) + Math.abs(p.y - at[i].y));
}).filter((far) => far !== 48).length"""
"""Number of parts of trails that do not lead from a cell to its neighbour."""


def test_trails_follow_the_cells_though_frames_are_skipped(tab, start, bag):
    process = start(
        "cli.main", "watch", str(bag), "--port", "0", "--rate", "300", "--step", "1"
    )
    visit(tab, address_of(process))
    longest = "Math.max(...[...document.querySelectorAll('.trail')].map((t) => t.points.length))"
    wait_for(tab, f"{STEP} > 0 && document.querySelector('.trail')")
    steps = set()
    for _ in range(20):
        steps.add(tab.evaluate(STEP))
        wait_for(tab, f"{STEP} > {max(steps)} || {STATE} === 'ended'")
        assert tab.evaluate(CUT) == 0
    assert max(np.diff(sorted(steps))) > 3, "some frames were skipped"
    wait_for(tab, f"{STATE} === 'ended' && {longest} > 3")
    assert tab.evaluate(CUT) == 0


QUIET = {"miscoordination": False, "interactions": []}
QUIET |= {"together": [], "exchanges": [], "stopped": []}
"""Of a frame in which robots do not interact."""


@pytest.fixture
def shown(tab):
    """Return a function that shows frames of a run, made up, and one that gives a frame."""
    scenario = load_scenario("crowd-4r", interactions="together+swap")
    board = MessageBoard()
    number = scenario.map.number
    fields = page_messages.run_fields(make_run(scenario, {}))
    board.put("run", source="live", title="made up", controls=(), **fields)
    server = Server(board, port=0)
    tab.goto(server.address)

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
                "made": step,
                "episode": 0,
                **QUIET,
                **more,
            },
        )
        wait_for(tab, f"{STEP} === {step}")

    yield show
    server.close()


def test_a_question_is_drawn_where_it_was_asked_and_a_miscoordination_where_it_was(
    tab, shown
):
    places = [(1, 3), (3, 3), (5, 5), (6, 6)]
    drawn = "[...document.querySelectorAll('#map {}')].map(({{{}: x, {}: y}}) => "
    drawn += "[x.baseVal.value, y.baseVal.value])"
    lines = drawn.format(".ask line", "x1", "y1")
    for step in (1, 3, 5):
        shown(step, places, asks=[0])
        asked = tab.evaluate(lines)
        shown(step + 1, [(0, 3), *places[1:]])
        late = tab.evaluate(lines)  # it is still seen, or gone
        assert asked == [[3.5 * 48, 1.5 * 48]] and late in (asked, [])
    rings = drawn.format(".met", "cx", "cy")
    number = load_scenario("crowd-4r").map.number
    shown(7, places, miscoordination=True, together=[number[1, 4]])
    assert tab.evaluate(rings) == [[4.5 * 48, 1.5 * 48]], "where two robots are"
    said = ["robot_1 and robot_2 exchange their cells."]
    shown(8, places, miscoordination=True, exchanges=[[0, 1]], interactions=said)
    both = [[3.5 * 48, 1.5 * 48], [3.5 * 48, 3.5 * 48]]
    assert tab.evaluate(rings) == both, "where two robots exchanged cells"
    assert tab.evaluate("document.getElementById('now').textContent") == said[0]
    shown(9, places, stopped=[[0, 1, number[1, 4]]])
    assert tab.evaluate(rings) == []
    bars = "[...document.querySelectorAll('#map .bar-in-the-way')]"
    bars += ".map((bar) => bar.getBBox()).map((b) => [b.x, b.y, b.width, b.height])"
    [[x, y, width, height]] = tab.evaluate(bars)
    assert (x, y + height / 2, width) == (4 * 48, 1.5 * 48, 0), "between the cells"
    shown(10, places)
    assert tab.evaluate(bars) == []
    assert tab.evaluate("document.getElementById('speed').textContent") == "–"
    assert (
        tab.evaluate("document.getElementById('silence').textContent")
        == "No question shown so far."
    )


KEEP = """
window.kept = {};
window.closed = false;
const Real = WebSocket;
window.WebSocket = class extends Real {
  set onmessage(take) {
    window.take = (message) => take({ data: JSON.stringify(message) });
    super.onmessage = (event) => {
      const message = JSON.parse(event.data);
      if (window.closed) return;
      window.kept[message.type] = message;
      take(event);
    };
  }
};
"""
"""Keeps the newest message of each type, and takes no more once it is closed."""

ORDERS = """async () => {
  window.closed = true;
  const { run, ...others } = window.kept;
  for (const type of ["hello", "pages", "done", "error", "said"]) delete others[type];
  const types = Object.keys(others);
  const shown = async (order) => {
    for (const type of [...order, "frame"]) { // drawn again, robots no longer fly in
      window.take(type === "run" ? run : others[type]);
      await new Promise(requestAnimationFrame); // drawn after this picture
    }
    return document.querySelector("main").innerHTML;
  };
  const due = await shown(["run", ...types]);
  const shares = document.querySelectorAll("#lanes .mark").length;
  const wrong = [];
  let tried = 0;
  const orders = (left, taken) => left.length
    ? left.flatMap((one) => orders(left.filter((other) => other !== one), [...taken, one]))
    : [taken];
  const needed = ["frame", "marks", "curves", "tables"];
  const rest = types.filter((one) => !needed.includes(one));
  for (const order of orders(needed, [])) {
    tried += 1;
    for (const one of [[...order, ...rest], [...rest, ...order]]) {
      if ((await shown(["run", ...one])) !== due) wrong.push(one.join());
    }
  }
  return [types.length, shares, tried, wrong.slice(0, 5)];
}"""


def test_the_page_is_the_same_in_whatever_order_messages_come(tab, start, bag):
    """Marks that came before the first frame were never drawn."""
    tab.add_init_script(KEEP)
    process = start("cli.main", "watch", str(bag), "--port", "0")
    visit(tab, address_of(process))
    click(tab, "pause")
    wait_for(tab, f"{STATE} === 'paused' && window.kept.evaluation")
    wait_for(tab, "window.kept.curves.read === 1 && window.kept.learned")
    types, marks, tried, wrong = tab.evaluate(ORDERS)
    assert (types >= 7, marks >= 3, tried) == (True, True, 24)
    assert wrong == []


def test_what_cannot_be_done_after_the_end_is_disabled(tab, shown):
    """No run goes on that is finished, stopped or gone."""
    places = [(1, 3), (3, 3), (5, 5), (6, 6)]
    named = "document.getElementById('pause').textContent"
    buttons = "['pause', 'next-step', 'rate', 'reset']"
    disabled = f"{buttons}.map((id) => document.getElementById(id).disabled)"
    states = (
        ("learning", "Pause", False),
        ("paused", "Resume", False),
        ("finished", "Pause", True),
        ("learning", "Pause", False),
        ("stopped", "Pause", True),
        ("gone", "Pause", True),
    )
    for step, (state, name, over) in enumerate(states, start=1):
        shown(step, places, state=state)
        assert tab.evaluate(named) == name
        assert tab.evaluate(disabled) == [over] * 4
        assert tab.evaluate(STATE) == state


WIDE = "document.documentElement.scrollWidth <= window.innerWidth"


@pytest.fixture(scope="module")
def learned(record):
    """Return the bag of a team of which one robot has learned to ask."""
    return record(settings={"steps": 4000, "penalty": -100}, values={"seed": 2}).bag


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_bag_opens_on_what_was_learned_and_buttons_lead_on(
    tab, start, learned, scheme
):
    tab.emulate_media(color_scheme=scheme)
    process = start("cli.main", "watch", str(learned), "--port", "0")
    size(tab, 1280, 900)
    visit(tab, address_of(process))
    said = "document.getElementById('learned').innerText"
    wait_for(tab, f"{said}.includes(' asks in cell ') && {said}.includes('about')")
    wait_for(tab, "document.querySelectorAll('.trail[points*=\" \"]').length === 2")
    assert tab.evaluate("document.querySelectorAll('.arrow.pale').length") > 0
    for kind in ("question", "miscoordination", "policy"):
        tab.keyboard.press("Home")
        wait_for(tab, f"{STEP} < 5")
        wait_for(tab, f"!document.querySelector('#lanes button.{kind}').disabled")
        for _ in range(2):
            step = tab.evaluate(STEP)
            tab.click(f"#lanes button.{kind}")
            wait_for(tab, f"{STEP} > {step} && {STATE} === 'paused'")
    tab.keyboard.press("End")
    wait_for(tab, f"{STATE} === 'ended'")
    last = tab.evaluate(STEP)
    tab.click("#lanes button.miscoordination")
    told = "document.getElementById('said').textContent"
    wait_for(tab, f"{told} === 'No miscoordination after this step.'")
    assert tab.evaluate(STEP) == last
    tab.click("#lanes button.crossing")
    wait_for(tab, f"{STEP} < {last} && {told} === ''")
    whole = tab.evaluate("document.getElementById('map').getAttribute('viewBox')")
    tab.click("#zoom .closer")
    wait_for(
        tab, f"document.getElementById('map').getAttribute('viewBox') !== '{whole}'"
    )
    tab.click("#zoom .fit")
    wait_for(
        tab, f"document.getElementById('map').getAttribute('viewBox') === '{whole}'"
    )
    tab.click("#learned button")
    wait_for(tab, f"{STATE} === 'playing'")
    header = "document.querySelector('header')"
    assert tab.evaluate(f"{header}.clientHeight") < 70  # two lines
    size(tab, 400, 900)
    wait_for(tab, WIDE)
    value = wait_for(
        tab, "document.querySelector('#evaluation tr:nth-child(4) td:last-child')"
    )
    assert value and tab.evaluate(
        "document.querySelector('#evaluation tr:nth-child(4) td:last-child')"
        ".getBoundingClientRect().right < 400"
    )


def q_star_shown(tab, page="document"):
    """Return the row of robot 1 of Q* of the map's first cell, as it is shown, by arrow keys."""
    tab.evaluate(f"{page}.getElementById('map').focus()")
    down = "new KeyboardEvent('keydown', {key: 'ArrowDown', bubbles: true})"
    tab.evaluate(f"{page}.getElementById('map').dispatchEvent({down})")
    cells = f"{page}.querySelectorAll('#cell tr[data-robot=\"1\"] td')"
    shown = f"[...{cells}].map((c) => c.textContent)"
    title = f"{page}.getElementById('cell-title').textContent"
    return wait_for(tab, f"{title}.includes(' cell 0 ') && {shown}")[1:]


AGES = "getElementById('ages').textContent"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_run_without_ros_ends_on_its_final_tables_then_acts_greedily(
    tab, start, tmp_path, scheme
):
    """The page has them beside the value of the team; robots that move are not said to stand."""
    out = tmp_path / "run"
    tab.emulate_media(color_scheme=scheme)
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
    visit(tab, address_of(process))
    wait_for(tab, "!document.getElementById('evaluation-panel').hidden")
    wait_for(tab, f"{STATE} === 'finished'")
    wait_for(tab, f"document.{AGES} === 'Tables at the end of learning.'")
    assert tab.evaluate("document.getElementById('speed').textContent") == "0"
    due = [f"{value:.2f}" for value in tables_in(out)[0].q_star[0]]
    assert q_star_shown(tab) == due
    asked = tables_in(out)[0].memory["updates"][:, COORDINATE]
    cells = (asked > 0).sum()
    click(tab, "show-heat")
    shown = "document.querySelectorAll('#map rect[fill-opacity]').length"
    assert tab.evaluate(shown) >= cells > 5
    again = start("cli.main", "watch", str(out), "--port", "0")
    visit(tab, address_of(again))
    wait_for(tab, f"{STATE} === 'acting greedily' && {STEP} > 2")
    wait_for(tab, "document.getElementById('speed').textContent === '2'")
    assert tab.evaluate(STEP) < 40, "it is a step of the episode"
    assert tab.evaluate("document.getElementById('step').textContent").startswith(
        "60,000"
    )
    played = "document.getElementById('asked-where').textContent"
    assert tab.evaluate(played) == "asked here in 200 greedy episodes"
    assert q_star_shown(tab) == due
    for width in (1280, 400):
        size(tab, width, 800)
        wait_for(tab, WIDE)


def test_two_runs_are_beside_each_other(tab, start, learned, bag):
    process = start("cli.main", "watch", str(learned), str(bag), "--port", "0")
    visit(tab, address_of(process))
    titles = (
        "[...document.querySelectorAll('.column h2')].map((one) => one.textContent)"
    )
    wait_for(tab, f"{titles}.length === 2")
    shown = tab.evaluate(titles)
    assert shown[0].startswith("Acoop") and "ask_cost=0" in shown[0]
    assert shown[1].startswith("B")
    state = "document.getElementById('state').textContent"
    click(tab, "pause")
    wait_for(tab, f"{state} === 'paused'")
    wait_for(tab, "document.getElementById('headline').textContent.includes('earns')")
    wait_for(
        tab, "document.querySelectorAll('.robot[visibility=visible]').length === 4"
    )
    wait_for(tab, "document.querySelectorAll('.curve[data-run]').length >= 2")
    where = "document.getElementById('where').textContent"
    tab.evaluate(
        "const axis = document.getElementById('axis'); axis.value = 'step'; axis.onchange()"
    )
    wait_for(tab, f"{where}.startsWith('step ')")
    lines = "[...document.querySelectorAll('.curve')]"
    points = f"{lines}.map((one) => one.getAttribute('d').split('L').length)"
    wait_for(tab, f"Math.max(...{points}) > 3")
    assert max(tab.evaluate(points)) <= 40
    values = "[...document.querySelectorAll('.chart:not([hidden]) .value')]"
    values += ".map((one) => one.textContent)"
    tab.hover("section.chart:nth-of-type(2) svg")  # one cursor for all of them
    said = wait_for(
        tab, f"{values}.every((text) => text.includes(' at step ')) && {values}"
    )
    assert len(said) == 3
    assert len({text.partition(" at step ")[2] for text in said}) == 1
    tab.hover("h1")
    wait_for(tab, f"!{values}.some((text) => text.includes(' at step '))")
    for width in (1280, 400):
        size(tab, width, 800)
        wait_for(tab, WIDE)


def test_robots_of_all_runs_are_where_the_clock_says(tab):
    """As an episode begins again, the stream of a run may be ahead of the clock."""
    run = make_run(load_scenario("env1"), {})
    narrator = Narrator(run.scenario)
    boards = [MessageBoard(), MessageBoard(), MessageBoard()]
    common = boards[2]
    for board in boards[:2]:
        fields = page_messages.run_fields(run)
        board.put("run", source="bag", title="made up", controls=(), **fields)
    common.put("run", titles=["one", "other"], axes=["learned"], controls=())
    lengths = {"starts": [[1], [1]], "lengths": [[13], [13]], "offsets": [0]}
    common.put("aligned", axis="learned", **lengths)

    def frame(step, places):
        seen = TeamTransition(step, places, (None, None), places, False)
        trails = [[cell] for cell in places]
        fields = page_messages.frame_fields(seen, trails, narrator)
        return {"state": "playing", "rate": 2.0, "made": step - 1, **fields}

    def clock(position, frames):
        at = {"position": position, "last": 13, "segment": 0}
        state = {"axis": "learned", "state": "playing", "rate": 2.0}
        common.put("clock", frames=frames, **at, **state)

    start = frame(1, (0, 3))
    end = frame(14, (20, 17))
    clock(13, [end, end])
    server = Server(*boards, port=0, index="compare.html")
    tab.goto(server.address)
    where = "document.getElementById('where').textContent"
    wait_for(tab, f"{where}.startsWith('step 13 ')")
    told = "[...document.querySelectorAll('.told')].map((one) => one.textContent)"
    wait_for(tab, f"{told}.length === 2")
    for board in boards[:2]:
        board.put("frame", **start)
        board.put("learned", lines=["came after it"], first=1, step=None)
    wait_for(tab, f"{told}.every((text) => text === 'came after it')")
    assert cells(tab) == [20, 17, 20, 17]
    assert tab.evaluate(where).startswith("step 13 ")
    clock(0, [start, start])
    wait_for(tab, f"{where}.startsWith('step 0 ')")
    assert cells(tab) == [0, 3, 0, 3]
    server.close()


@pytest.mark.parametrize("robots", [2, 4, 8])
def test_a_team_is_watched_from_its_first_step(tab, start, tmp_path, robots):
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
    visit(tab, address_of(process))
    wait_for(tab, f"{STEP} >= 1")
    wait_for(tab, "Number(document.getElementById('episodes').textContent) > 1")
    wait_for(tab, "document.querySelector('.curve')")


def test_a_run_on_its_own_page_then_the_next_one(tab, start, tmp_path):
    out = tmp_path / "run"
    options = ("--steps", "9000", "--rate", "100", "--penalty", "-100", "--port", "0")
    process = start("cli.main", "run", "env1", *options, "--watch", "--out", str(out))
    visit(tab, address_of(process))
    wait_for(tab, f"{STEP} > 10 && {STATE} === 'learning'")
    before = cells(tab)
    wait_for(
        tab,
        "JSON.stringify([...document.querySelectorAll('.robot')].map((r) => "
        f"Number(r.dataset.cell))) !== '{str(before).replace(' ', '')}'",
    )
    click(tab, "pause")
    wait_for(tab, f"{STATE} === 'paused'")
    step = tab.evaluate(STEP)
    click(tab, "next-step")
    wait_for(tab, f"{STEP} > {step}")
    click(tab, "reset")
    tab.evaluate(
        "(() => { const r = document.getElementById('rate'); r.value = '0';"
        "r.dispatchEvent(new Event('change')); })()"
    )
    click(tab, "pause")
    wait_for(tab, f"{STATE} === 'finished'")
    wait_for(tab, "!document.getElementById('evaluation-panel').hidden")
    wait_for(tab, "document.querySelector('#map .ask, #dialogue li')")
    history = load_history(out)
    wait_for(
        tab, f"document.getElementById('episodes').textContent === '{history.episodes}'"
    )
    assert tab.evaluate("document.getElementById('step').textContent").startswith(
        "9,000"
    )
    tab.evaluate("document.getElementById('scenario').value = 'isr'")
    tab.evaluate("document.getElementById('penalty').value = '-5'")
    wait_for(tab, "!document.getElementById('start').disabled")
    click(tab, "start")
    wait_for(tab, "document.getElementById('about').textContent.startsWith('isr')")
    assert "pays 5. " in tab.evaluate("document.getElementById('about').textContent")
    wait_for(tab, f"{STEP} > 10")


def test_a_page_beside_a_team_in_other_processes(tab, start, tmp_path):
    page = start("nodes.watch", "--ros-args", "-p", "port:=0")
    visit(tab, address_of(page))
    wait_for(tab, "document.getElementById('notice').textContent.includes('waiting')")
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
        begun = f"{about}.includes(', seed {number}. ') && {STEP} > 15"
        wait_for(tab, f"{begun} && {STATE} === 'learning'")
        wait_for(tab, f"['finished', 'gone'].includes({STATE})")
        assert team.exit_code() == 0
    history = load_history(tmp_path / "run1")
    late = "document.getElementById('notice').textContent.includes('the curves lack what was')"
    same = f"document.getElementById('episodes').textContent === '{history.episodes}'"
    wait_for(tab, f"{late} || {same}")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_eight_robots_in_light_and_dark(tab, start, tmp_path, scheme):
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
    tab.emulate_media(color_scheme=scheme)
    # fmt: skip
    process = start(
        "cli.main",
        "train",
        str(tmp_path / "eight.yaml"),
        "--engine",
        "python",
        "--watch",
        "--port",
        "0",
        "--out",
        str(tmp_path / "run"),
    )
    visit(tab, address_of(process))
    wait_for(tab, f"{STEP} > 10")
    assert (
        tab.evaluate("document.querySelectorAll('.robot[visibility=visible]').length")
        == 8
    )
    shapes = "[...document.querySelectorAll('.robot .body')].map((b) => b.outerHTML)"
    assert len(set(tab.evaluate(shapes))) == 8
    tab.click("#robots button:nth-child(8)")
    click(tab, "show-arrows")
    wait_for(tab, "document.querySelector('.arrow[data-robot=\"8\"]')")
    arrows = "[...document.querySelectorAll('#map .arrow')].map((a) => [a.dataset.robot, {}])"
    dashed = tab.evaluate(arrows.format("a.hasAttribute('stroke-dasharray')"))
    # told apart in grey
    assert {tuple(one) for one in dashed} == {
        ("1", False),
        ("8", True),
    }
    assert tab.evaluate(WIDE)
    size(tab, 700, 900)
    wait_for(tab, WIDE)
    page = tab.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (page == "rgb(22, 23, 25)") == (scheme == "dark")


FOCUS = """(() => {
  const one = document.activeElement, look = getComputedStyle(one);
  return one === document.body ? null
    : [one.id || one.className || one.textContent,
       look.outlineStyle, parseFloat(look.outlineWidth)];
})()"""
"""The focused element, and its outline."""

UNNAMED = """[...document.querySelectorAll('button, input, select, svg[role], section, fieldset')]
  .filter((one) => one.checkVisibility())
  .filter((one) => !(one.ariaLabel || one.labels?.length || one.textContent.trim()
    || one.getAttribute('aria-labelledby') || one.id === 'side'))
  .map((one) => one.outerHTML)"""
"""Controls, pictures and parts of a page that a screen reader cannot name."""

OUTSIDE = """[...document.body.children]
  .filter((one) => one.checkVisibility() && one.textContent.trim())
  .filter((one) => !['HEADER', 'MAIN', 'SCRIPT'].includes(one.tagName))
  .map((one) => one.outerHTML)"""
"""Elements outside of landmarks."""


PALE = """() => {
  const pixel = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
  const parts = (colour) => {
    pixel.clearRect(0, 0, 1, 1);
    pixel.fillStyle = colour;
    pixel.fillRect(0, 0, 1, 1);
    const [r, g, b, alpha] = pixel.getImageData(0, 0, 1, 1).data;
    return [r, g, b, alpha / 255];
  };
  const bright = (rgb) => rgb.map((p) => p / 255)
    .map((p) => (p <= 0.03928 ? p / 12.92 : ((p + 0.055) / 1.055) ** 2.4))
    .reduce((sum, p, i) => sum + p * [0.2126, 0.7152, 0.0722][i], 0);
  const under = (one) => {
    for (let at = one; at; at = at.parentElement) {
      const found = parts(getComputedStyle(at).backgroundColor);
      if (found[3] === 1) return found.slice(0, 3);
    }
    return [255, 255, 255];
  };
  const written = (node) => node.nodeType === Node.TEXT_NODE && node.data.trim();
  return [...document.body.querySelectorAll('*')]
    .filter((one) => [...one.childNodes].some(written) && one.checkVisibility())
    .filter((one) => !one.closest('svg, :disabled, option'))
    .map((one) => [one, [parts(getComputedStyle(one).color).slice(0, 3), under(one)].map(bright)])
    .filter(([, [a, b]]) => (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05) < 4.5)
    .map(([one]) => one.outerHTML);
}"""
"""Elements with letters of less contrast than WCAG's level AA asks for."""


@pytest.fixture(scope="module")
def two(record):
    """Return the bags of two runs."""
    found = []
    for learner in ("coop", "voi"):
        values = {"seed": 2, "learner": learner}
        settings = {"steps": 1500, "penalty": -100}
        found.append(str(record(settings=settings, values=values).bag))
    return found


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("several", [False, True])
def test_keys_alone_reach_every_control_and_a_reader_hears_the_step(
    tab, start, two, scheme, several
):
    tab.emulate_media(color_scheme=scheme)
    bags = two if several else two[:1]
    process = start("cli.main", "watch", *bags, "--port", "0", "--rate", "5")
    size(tab, 1280, 800)
    visit(tab, address_of(process))
    wait_for(tab, "document.querySelector('.trail')")
    if several:
        wait_for(
            tab, "document.getElementById('headline').textContent.includes('earns')"
        )
        told = "[...document.querySelectorAll('.told')].map((one) => one.textContent)"
        assert all(tab.evaluate(told))
        about = tab.evaluate(text_of("about"))
        assert about.startswith(
            "env1, 2 robots, seed 2. If two robots are in one doorway,"
        )
        assert "robots that ignore each other 92.60 · " in tab.evaluate(
            text_of("beside")
        )
        assert tab.evaluate(text_of("where")).endswith(", again and again")
        labels = "[...document.querySelectorAll('#layers label')]"
        signs = f"{labels}.map((one) => one.querySelectorAll('svg > *').length)"
        assert tab.evaluate(signs) == [1] * 5
        assert "doorway" in tab.evaluate(text_of("signs"))
        differ = "[...document.querySelectorAll('.differs > title')]"
        words = tab.evaluate(f"{differ}.map((one) => one.textContent)")
        assert words and all(
            " in A, " in one and one.endswith(" in B.") for one in words
        )
    paused = "document.getElementById('state').textContent === 'paused'"
    tab.keyboard.press("Space")  # else a control may go while it has the focus
    wait_for(tab, paused)
    reached = []
    for _ in range(40):
        tab.keyboard.press("Tab")
        focus = tab.evaluate(FOCUS)
        if focus is None or focus[0] in [
            one[0] for one in reached if one[0] == "theme"
        ]:
            break
        reached.append(focus)
    names = {one[0] for one in reached}
    due = {"theme", "pause", "back", "next-step", "rate", "seek", "show-trails"}
    due |= {"axis", "show-differ"} if several else {"map", "dialogue"}
    assert due <= names
    assert all(style != "none" and width >= 2 for _, style, width in reached)
    assert tab.evaluate(UNNAMED) == []
    assert tab.evaluate(OUTSIDE) == []
    if not several:
        tab.evaluate("document.getElementById('map').focus()")
        for key in ("ArrowDown", "Enter"):
            tab.keyboard.press(key)
        cell = "document.getElementById('cell').textContent"
        wait_for(
            tab, f"{cell}.includes('robot_1 Q*') && {cell}.includes('robot_1 Q^C')"
        )
        wait_for(tab, "document.querySelector('#dialogue .sign')")
    assert tab.evaluate(PALE) == []
    tab.evaluate("document.activeElement.blur()")
    tab.keyboard.press("Home")  # at the end there would be no step to go on to
    # it may stand at the step after the first one: that is where ArrowRight leads
    seek = "document.getElementById('seek')"
    wait_for(tab, f"{seek}.value === {seek}.min")
    tab.wait_for_timeout(300)
    heard = "document.getElementById('spoken').textContent"
    wait_for(tab, f"{heard}.includes('robot_1 in row ')")
    before = tab.evaluate(heard)
    tab.keyboard.press("ArrowRight")
    wait_for(tab, f"{heard} !== {before!r}")
    size(tab, 400, 800)
    wait_for(tab, WIDE)


TEAM = "document.getElementById('team').textContent"


def press(tab, x, y):
    """Click a place of an imported map, in metres."""
    on = tab.evaluate(
        f"(({{x, y}}) => [x, y])(new DOMPoint({100 * x}, {-100 * y})"
        ".matrixTransform(document.getElementById('map').getScreenCTM()))"
    )
    tab.mouse.click(*on)


def place_robots(tab, places):
    for n, place in enumerate(places, start=1):
        press(tab, *place)
        wait_for(tab, f"document.querySelectorAll('.start, .goal').length === {n}")


def test_a_depot_becomes_a_driven_team_by_clicks(tab, start, tmp_path):
    """From the image to bodies that drive what was learned; another team is stopped."""
    write("depot", tmp_path)
    # fmt: skip
    process = start(
        "cli.main",
        "import-map",
        str(tmp_path / "depot.yaml"),
        "--page",
        "--port",
        "0",
        "--out",
        str(tmp_path / "out"),
    )
    visit(tab, address_of(process))
    wait_for(
        tab, "document.getElementById('facts').textContent.startsWith('1,560 cells')"
    )
    place_robots(tab, [(1.5, 1.5), (28.5, 13.5), (28.5, 13.5), (1.5, 1.5)])
    click(tab, "train")
    wait_for(tab, f"{TEAM}.startsWith('Learned: ')")
    click(tab, "drive")
    wait_for(tab, f"{TEAM}.startsWith('Bodies of radius 0.2 m drove 20 episodes')")
    assert "in 20 all robots arrived; walls touched: 0, " in tab.evaluate(TEAM)
    wait_for(tab, "document.querySelectorAll('.film circle').length === 2")
    wait_for(tab, "document.getElementById('frame').valueAsNumber > 2")
    tab.emulate_media(reduced_motion="reduce")
    click(tab, "train")
    wait_for(tab, f"{TEAM}.startsWith('A team learns: ')")
    click(tab, "stop")
    wait_for(tab, f"{TEAM}.startsWith('Stopped.')")
    wait_for(tab, "!document.getElementById('train').hidden")


def test_a_building_becomes_a_team_by_clicks(tab, start, tmp_path):
    """From the image to a team that has learned: cells, robots, doorways, undo, save, train."""
    out = tmp_path / "office"
    options = ("--page", "--port", "0", "--out", str(out), "--set", "steps=20000")
    process = start(
        "cli.main", "import-map", str(ROOT / "examples/office.yaml"), *options
    )
    visit(tab, address_of(process))
    facts = "document.getElementById('facts').textContent"

    wait_for(tab, f"{facts} === '304 cells of 0.85 m, 6 doorways'")
    wait_for(tab, f"{text_of('advice')}.startsWith('Coordination will pay: ')")
    assert tab.evaluate("document.querySelectorAll('.start').length") == 2
    click(tab, "no-robots")
    for name, value in (("cell-side", 0.5), ("radius", 0.2)):
        tab.evaluate(
            f"(() => {{ const c = document.getElementById('{name}');"
            f"c.value = {value}; c.dispatchEvent(new Event('change')); }})()"
        )
    wait_for(tab, f"{facts} === '937 cells of 0.5 m, 6 doorways'")
    tab.evaluate(
        "(() => { const c = document.getElementById('cell-side');"
        "c.value = 0.4; c.dispatchEvent(new Event('change')); })()"
    )
    wait_for(
        tab, "document.getElementById('notes').innerText.includes('lanes touch walls')"
    )
    click(tab, "undo")
    wait_for(tab, f"{facts}.startsWith('937 cells of 0.5 m')")
    places = [(-8, -5), (8, 5), (8, 5), (-8, -5)]
    place_robots(tab, places)
    press(tab, -3.4, 3)
    wait_for(
        tab, "document.getElementById('notice').innerText.includes('in no free cell')"
    )
    click(tab, "undo")
    wait_for(tab, "document.getElementById('notice').hidden")
    tab.evaluate("document.getElementById('map').focus()")
    for key in ("ArrowLeft", "Enter"):  # by keys alone
        tab.keyboard.press(key)
    wait_for(tab, "document.querySelectorAll('.start').length === 3")
    click(tab, "undo")
    tab.evaluate("document.querySelector('input[value=doorways]').click()")
    for place, doors in (((-4, 0.1), 7), ((-6.6, -0.9), 6)):
        press(tab, *place)
        wait_for(tab, f"{facts}.endsWith(', {doors} doorways')")
    ticks = "document.querySelectorAll('.x-axis').length"
    wait_for(tab, f"{ticks} > 3")
    for width, height in ((400, 800), (1280, 900)):
        size(tab, width, height)
        assert tab.evaluate(WIDE)
    click(tab, "train")
    wait_for(tab, f"{TEAM}.startsWith('Learned: runs/office_')")
    frame = "document.getElementById('learning').contentDocument"
    wait_for(tab, f"{frame}.querySelector('#state').dataset.state === 'finished'")
    assert tab.evaluate("document.getElementById('panels').hidden"), "one map, not two"
    wait_for(tab, f"{frame}.{AGES} === 'Tables at the end of learning.'")
    made = Path(re.search(r"Learned: (runs/office_\S+?)\. ", tab.evaluate(TEAM))[1])
    tables = tables_in(made)
    assert q_star_shown(tab, frame) == [
        f"{value:.2f}" for value in tables[0].q_star[0].round(4)
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


def text_of(name):
    return f"document.getElementById('{name}').textContent"


def test_the_import_page_by_keys_narrow_and_dark(tab, start, tmp_path):
    """What is clicked next, legend, advice, hint, undo and live regions; 400 pixels, dark."""
    tab.emulate_media(color_scheme="dark")
    size(tab, 400, 800)
    office = str(ROOT / "examples/office.yaml")
    options = ("--page", "--port", "0", "--out", str(tmp_path / "out"))
    # across the corridor, to and fro
    robots = ("--start", "-5,0", "5,0", "--goal", "5,0", "-5,0")
    robots += ("--cell", "0.5", "--radius", "0.2")
    process = start("cli.main", "import-map", office, *options, *robots)
    visit(tab, address_of(process))
    wait_for(tab, f"{text_of('advice')}.startsWith('Asking will not pay: ')")
    assert tab.evaluate(WIDE)
    assert "interactions=together fits" in tab.evaluate(text_of("interactions"))
    assert tab.evaluate("document.querySelectorAll('#legend span').length") == 5
    assert tab.evaluate(PALE) == []
    assert tab.evaluate(OUTSIDE) == []
    assert tab.evaluate(text_of("next")) == "Click the start of robot 3"
    wait_for(tab, "!document.getElementById('add-holder').hidden")
    assert "where they meet most often" in tab.evaluate(text_of("notes"))
    tab.evaluate("document.getElementById('add-doorway').focus()")
    tab.keyboard.press("Enter")
    wait_for(tab, f"{text_of('advice')}.startsWith('Coordination may pay: ')")
    assert tab.evaluate(text_of("said")).startswith("doorway at x -0.10 m")
    assert tab.evaluate("document.activeElement.id") == "map", "the button is gone"
    top = "document.getElementById('map').getBoundingClientRect().top"
    before = tab.evaluate(top)
    for key in ("ArrowLeft", "ArrowLeft"):
        tab.keyboard.press(key)
    assert tab.evaluate(top) == before, "the map stays where it is"
    place, _, kind = tab.evaluate(text_of("said")).partition(": ")
    assert kind == "free cell"
    tab.keyboard.press("Enter")
    wait_for(tab, "document.querySelectorAll('.start').length === 3")
    assert tab.evaluate(text_of("said")) == f"start of robot 3 at {place}"
    assert tab.evaluate(text_of("next")) == "Click the goal of robot 3"
    for undone in ("start of robot 3", "doorway at"):
        title = tab.evaluate("document.getElementById('undo').title")
        assert title.startswith(f"Undo: {undone}")
        tab.keyboard.press("Control+z")
        wait_for(tab, f"{text_of('said')}.startsWith('Undone: {undone}')")
    wait_for(tab, f"{text_of('facts')}.endsWith(', 6 doorways')")
    assert tab.evaluate("document.getElementById('undo').disabled")
    assert tab.evaluate(WIDE)
    assert tab.evaluate(UNNAMED) == []
    for _ in range(6):
        tab.evaluate("document.querySelector('#zoom .closer').click()")
    for _ in range(60):  # to the wall and not beyond; the view follows
        tab.keyboard.press("ArrowLeft")
    inside = """(() => {
        const mark = document.querySelector('#map .cursor').getBoundingClientRect();
        const map = document.getElementById('map').getBoundingClientRect();
        const middle = mark.left + mark.width / 2;
        return map.left <= middle && middle <= map.right;
    })()"""
    assert tab.evaluate(inside)
    live = "[...document.querySelectorAll('[role=status], [role=alert]')]"
    assert set(tab.evaluate(f"{live}.map((one) => one.id)")) >= {
        "state",
        "notice",
        "team",
        "said",
        "advice",
        "next",
    }


def test_a_picture_without_a_yaml_file_and_a_corridor(tab, start, tmp_path):
    """The page asks for the scale before it takes clicks; the corridor's setting is taken."""
    rows = ("....###....", "....###....", "...........", "....###....", "....###....")
    free = np.array([[sign == "." for sign in row] for row in rows])
    pixels = np.where(np.pad(free, 1).repeat(10, axis=0).repeat(10, axis=1), 254, 0)
    Image.fromarray(pixels.astype(np.uint8)).save(tmp_path / "lane.png")
    out = tmp_path / "out"
    options = ("--page", "--port", "0", "--out", str(out))
    process = start("cli.main", "import-map", str(tmp_path / "lane.png"), *options)
    visit(tab, address_of(process))
    wait_for(tab, "!document.getElementById('scale').hidden")
    wait_for(tab, f"{text_of('next')} === 'Say how large this picture is, above'")
    names = "[...document.querySelectorAll('#scale input')].map((one) => one.ariaLabel)"
    corner = ["lower left corner: x in metres", "lower left corner: y in metres"]
    assert tab.evaluate(names) == ["width in metres", "metres a pixel", *corner]
    assert tab.evaluate("document.getElementById('save').disabled")
    press(tab, 1, 1)
    tab.fill("#width", "13")
    tab.keyboard.press("Tab")
    wait_for(tab, "document.getElementById('resolution').valueAsNumber === 0.1")
    tab.fill("#cell-side", "1")
    tab.keyboard.press("Tab")
    wait_for(tab, f"{text_of('facts')} === '43 cells of 1 m, 0 doorways'")
    click(tab, "scaled")
    assert tab.evaluate(text_of("next")) == "Click the start of robot 1"
    place_robots(tab, [(1.5, 5.5), (11.5, 1.5), (11.5, 1.5), (1.5, 5.5)])
    assert "swap+block fits: 1 corridor" in tab.evaluate(text_of("interactions"))
    tab.evaluate("document.getElementById('corridors').focus()")
    tab.keyboard.press("Space")
    wait_for(tab, f"{text_of('facts')} === '43 cells of 1 m, 1 doorway (3 cells)'")
    wait_for(tab, f"{text_of('advice')}.startsWith('Coordination will pay: ')")
    click(tab, "save")
    wait_for(tab, f"{text_of('saved')}.includes('lane.yaml')")
    assert load_scenario(out / "lane.yaml").interactions == "swap+block"
    assert "resolution: 0.1" in (tmp_path / "lane.yaml").read_text()
