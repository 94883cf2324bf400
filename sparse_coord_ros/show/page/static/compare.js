// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// Several runs on one page: one clock, one time line, a map for each, and their curves in one chart.

import { Curves } from "/curves.js";
import { $, html, number, otherTheme, svg, tell } from "/draw.js";
import { Lane } from "/lanes.js";
import { TeamMap } from "/map.js";
import { connect, token } from "/stream.js";

const RATES = [0.5, 1, 2, 5, 10, 20, 50, 100, 500, 1000];
const AXES = { learned: "what was learned", episode: "the same episode", step: "the same time step" };
const MARKS = ["question", "miscoordination"];
const LOOKS = [["var(--run-1)", ""], ["var(--run-2)", "7 4"], ["var(--run-3)", "2 3"], ["var(--run-4)", "9 3 2 3"]];
const look = (k) => ({ stroke: LOOKS[k % LOOKS.length][0], "stroke-dasharray": LOOKS[k % LOOKS.length][1], "data-run": k + 1 });

const letter = (k) => String.fromCharCode(65 + k);

const charts = new Curves($("curves"));
let columns = [], titles = [], clock = null, aligned = null, mayControl = false, sliding = -1e9;

// One run: its map, what happens now, and what its team is worth.
class Column {
  constructor(k, title) {
    this.k = k;
    this.newest = {};
    this.element = svg("svg", { class: "map", tabindex: 0, role: "img", "aria-label": `map of ${title}` });
    this.value = html("p", { className: "quiet" });
    this.now = html("p", { className: "now" });
    this.now.setAttribute("role", "status");
    const zoom = html("div", { className: "zoom" });
    const head = html("div", { className: "head" }, html("h2", {}, title), zoom);
    head.style.setProperty("--run", LOOKS[k % LOOKS.length][0]);
    $("columns").append(html("section", { className: "column" }, head, this.value, html("div", { className: "map-holder" }, this.element), this.now));
    this.map = new TeamMap(this.element, () => {}, zoom);
    this.lane = new Lane($("lanes"), html("span", {}, title), `questions and miscoordinations of ${title}`,
      (share) => clock && send("seek", Math.round(clock.last * share)));
    connect(`?run=${k}`, (message) => this.take(message), () => tell("notice", "not connected"));
  }

  take(message) {
    this.newest[message.type] = message;
    const draw = {
      run: () => { this.map.begin(message); this.map.shown = new Set(message.robots.keys()); layers(); },
      frame: () => this.show(message),
      tables: () => { this.map.policy(message); differences(); },
      asked: () => this.map.heat(message),
      curves: () => drawCurves(),
      marks: () => this.mark(),
      dialogue: () => this.show(this.newest.frame),
      evaluation: () => { this.worth(); headline(); },
      notice: () => { if (message.text) tell("notice", `${titles[this.k]}: ${message.text}`); },
    }[message.type];
    if (draw && this.newest.run) draw();
  }

  show(frame) {
    if (!frame) return;
    this.map.move(frame, clock?.state === "paused");
    const said = this.newest.dialogue?.entries.filter((entry) => entry.step === frame.step).map((entry) => entry.text) ?? [];
    if (frame.miscoordination) said.push("The robots miscoordinate.");
    const home = frame.cells.every((cell, k) => cell === this.newest.run.robots[k].goal);
    this.now.textContent = said.join(" ") || (home ? "All robots have arrived." : " ");
  }

  worth() {
    const { returns, asks, miscoordinations, all_arrived, how } = this.newest.evaluation;
    this.value.textContent = `Return of a robot ${returns.mean.toFixed(2)} (${how}), questions ${asks.mean.toFixed(2)}; `
      + `miscoordinations ${miscoordinations.mean.toFixed(3)}; all arrive ${(100 * all_arrived).toFixed(1)} %`;
  }

  // What happened when, as ticks on the time line.
  mark() {
    if (!aligned || !clock) return;
    const { starts, lengths, offsets } = aligned, own = starts[this.k];
    const at = (step) => {
      const i = own.findLastIndex((start) => start <= step);
      return i >= 0 && step - own[i] <= lengths[this.k][i] ? offsets[i] + step - own[i] : null;
    };
    this.lane.show(MARKS.map((kind) => {
      const places = (this.newest.marks?.[kind] ?? []).map(at).filter((position) => position !== null);
      return [kind, places.map((position) => position / Math.max(1, clock.last))];
    }));
  }
}

// The cells in which a robot that can come there would do something else.
function differences() {
  const robots = columns.map((column) => column.newest.tables?.robots);
  const same = columns.every((column) => column.newest.run?.map.rows.join() === columns[0].newest.run?.map.rows.join());
  const found = new Set();
  if (same && robots.every((own) => own?.every(Boolean))) {
    for (const k of robots[0].keys()) {
      const entered = new Set(robots.flatMap((own) => own[k].enters));
      for (const cell of entered) {
        const does = new Set(robots.map((own) => (own[k].asks.includes(cell) ? "asks" : own[k].moves[cell].join())));
        if (does.size > 1) found.add(cell);
      }
    }
  }
  for (const column of columns) if (column.newest.run) column.map.mark([...found]);
  $("differ").textContent = `where the policies differ (${found.size} cells)`;
}

// What the teams do differently, in one sentence.
function headline() {
  const values = columns.map((column) => column.newest.evaluation);
  if (!values.every(Boolean)) return;
  const best = [...values.keys()].sort((a, b) => values[b].returns.mean - values[a].returns.mean);
  const parts = best.map((k) => `${letter(k)} (${titles[k]}) earns ${values[k].returns.mean.toFixed(2)} a robot, and a robot asks ${values[k].asks.mean.toFixed(2)} times in an episode`);
  $("headline").textContent = `${parts.join("; ")}.`;
}

function drawCurves() {
  charts.compare(columns.map((column, k) => ({ message: column.newest.curves, label: letter(k), look: look(k) })));
  place();
}

function place() {
  const frames = columns.map((column) => column.newest.frame);
  if (frames.every(Boolean)) charts.place(frames.map((frame) => frame.step), columns.map((_, k) => look(k)));
}

function layers() {
  for (const { map, newest } of columns) {
    for (const name of ["arrows", "rings", "heat", "trails", "differ"]) map.layers[name] = $(`show-${name}`).checked;
    if (newest.run) map.redraw();
  }
}

function showClock() {
  $("pause").textContent = clock.state === "paused" ? "Resume" : "Pause";
  $("state").textContent = clock.state;
  $("seek").max = clock.last;
  if (performance.now() - sliding > 600) $("seek").value = clock.position;
  $("axis").value = clock.axis;
  if (document.activeElement !== $("rate")) {
    if (![...$("rate").options].some((one) => Number(one.value) === clock.rate)) $("rate").add(new Option(`${number(clock.rate)} steps/s`, clock.rate));
    $("rate").value = clock.rate;
  }
  const into = clock.position - (aligned?.offsets[clock.segment] ?? 0);
  $("where").textContent = { learned: `step ${into} of the episode that shows what was learned`,
    episode: `episode ${number(clock.segment + 1)}, step ${into}`, step: `time step ${number(columns[0]?.newest.frame?.step)}` }[clock.axis];
  place();
}

const TAKE = {
  hello({ control }) {
    mayControl = control;
    $("bar").disabled = !control;
    if (!control && token) send("hello");
    $("said").textContent = control || token ? "" : "view only: for controls open the address as it was printed";
  },
  run(message) {
    titles = message.titles;
    $("title").textContent = titles.map((title, k) => `${letter(k)}: ${title}`).join(" · ");
    document.title = `${titles.join(", ")} – sparse_coord`;
    $("axis").replaceChildren(...message.axes.map((axis) => new Option(AXES[axis], axis)));
    $("rate").replaceChildren(...RATES.map((rate) => new Option(`${number(rate)} steps/s`, rate)));
    columns = titles.map((title, k) => new Column(k, `${letter(k)}: ${title}`));
    $("marks-legend").replaceChildren(...MARKS.map((kind) => html("span", {},
      svg("svg", { viewBox: "0 0 10 10" }, svg("path", { class: `mark ${kind}`, d: "M5,1v8" })), ` ${kind} `)));
  },
  aligned(message) { aligned = message; columns.forEach((column) => column.mark()); },
  clock(message) {
    const longer = clock?.last !== message.last;
    clock = message;
    if (longer) columns.forEach((column) => column.mark());
    showClock();
  },
  error({ text }) { $("said").textContent = text; },
  done() { $("said").textContent = ""; },
};

const pause = () => send("pause", clock?.state !== "paused");
$("pause").onclick = pause;
$("back").onclick = () => send("step", -1);
$("next-step").onclick = () => send("step", 1);
$("rate").onchange = () => { send("rate", Number($("rate").value)); $("rate").blur(); };
$("axis").onchange = () => { send("axis", $("axis").value); $("axis").blur(); };
$("seek").oninput = () => { sliding = performance.now(); send("seek", Number($("seek").value)); };
$("theme").onclick = otherTheme;
for (const name of ["arrows", "rings", "heat", "trails", "differ"]) $(`show-${name}`).onchange = layers;

const KEYS = {
  " ": pause, ArrowRight: () => send("step", 1), ArrowLeft: () => send("step", -1),
  PageDown: () => send("step", 100), PageUp: () => send("step", -100),
  Home: () => send("seek", 0), End: () => send("seek", clock.last),
};
document.addEventListener("keydown", (event) => {
  if (event.key === "t") return otherTheme();
  const own = event.target.matches("select, input") || (event.key === " " && event.target.matches("button"));
  if (!KEYS[event.key] || !mayControl || !clock || own || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  KEYS[event.key]();
});

// The last stream is that of the clock.
const { send } = connect("?run=99", (message) => TAKE[message.type]?.(message), () => { $("state").textContent = "not connected"; });
