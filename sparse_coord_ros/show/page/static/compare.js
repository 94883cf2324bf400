// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// Several runs on one page: one clock, one time line, a map for each, and their curves in one chart.

import { Curves } from "/curves.js";
import { $, about, html, number, otherTheme, shared, spoken, svg, tell, tinted } from "/draw.js";
import { Lane } from "/lanes.js";
import { layerSigns, places, question } from "/legend.js";
import { TeamMap } from "/map.js";
import { connect, token } from "/stream.js";

const RATES = [0.5, 1, 2, 5, 10, 20, 50, 100, 500, 1000];
const AXES = { learned: "what was learned", episode: "the same episode", step: "the same step" };
const MARKS = ["question", "miscoordination", "exchange", "stopped"];
const MARK_NAMES = { stopped: "another robot stops it" };
const MEASURES = [["returns", 2, "return of a robot"], ["asks", 2, "questions of a robot"], ["miscoordinations", 3, "miscoordinations"]];
const LOOKS = [["var(--run-1)", ""], ["var(--run-2)", "7 4"], ["var(--run-3)", "2 3"], ["var(--run-4)", "9 3 2 3"]];
const look = (k) => ({ stroke: LOOKS[k % LOOKS.length][0], "stroke-dasharray": LOOKS[k % LOOKS.length][1], "data-run": k + 1 });

// What the maps show: of each layer its words, and whether it is shown at first.
const SHOWN = [["trails", "trails", true], ["rings", "where a robot would ask (pale: it never comes there)", true],
  ["differ", "", true], ["arrows", "best moves", false], ["heat", "asked so far", false]];

const letter = (k) => String.fromCharCode(65 + k);

const charts = new Curves($("curves"));
let columns = [], titles = [], clock = null, aligned = null, mayControl = false, sliding = -1e9;

// One run: its map, what happens now, and the values of its team.
class Column {
  constructor(k, title) {
    this.k = k;
    this.newest = {};
    this.element = svg("svg", { class: "map", role: "img", "aria-label": `map of ${title}` });
    this.learned = html("p", { className: "told" });
    this.value = html("dl", { className: "values" });
    this.now = html("p", { className: "now" });
    const zoom = html("div", { className: "zoom" });
    const head = html("div", { className: "head" }, html("h2", {}, html("span", { className: "letter" }, letter(k)), title), zoom);
    head.style.setProperty("--run", LOOKS[k % LOOKS.length][0]);
    this.body = html("div", { className: "body" }, this.learned, this.value, html("div", { className: "map-holder" }, this.element), this.now);
    $("columns").append(html("section", { className: "column" }, head, this.body));
    this.map = new TeamMap(this.element, () => {}, zoom);
    this.lane = new Lane($("lanes"), html("span", {}, html("b", {}, letter(k)), ` ${title}`), `what happened when in ${title}`,
      (share) => clock && send("seek", Math.round(clock.last * share)));
    connect(`?run=${k}`, (message) => this.take(message), () => tell("notice", "not connected"));
  }

  // Any message may come first: with the run all that came before is drawn.
  take(message) {
    const { newest } = this, { type } = message;
    newest[type] = message;
    if (!newest.run) return;
    for (const one of type === "run" ? Object.keys(newest) : [type]) this.draw(one);
  }

  draw(type) {
    const message = this.newest[type];
    ({
      run: () => this.begin(message),
      tables: () => { this.map.policy(message); differences(); headline(); },
      asked: () => this.map.heat(message),
      curves: () => drawCurves(),
      marks: () => this.mark(),
      dialogue: () => this.show(),
      evaluation: () => { this.values(); headline(); },
      learned: () => { this.learned.textContent = message.lines.join(" "); },
      notice: () => { if (message.text) tell("notice", `${titles[this.k]}: ${message.text}`); },
    })[type]?.();
  }

  begin(run) {
    this.body.classList.toggle("beside", isUpright(run.map));
    this.map.begin(run);
    this.map.shown = new Set(run.robots.keys());
    layers();
    headerOf();
    legend();
    charts.begin(kinds());
    this.show();
  }

  // What the clock shows of this run. Frames come with the clock: streams of their own would come sooner or later.
  get frame() {
    return clock?.frames[this.k];
  }

  // The robots that ask in a cell to which they come; until the team is evaluated by the tables that are shown.
  get askers() {
    const { evaluation, tables } = this.newest, known = tables?.robots.every(Boolean);
    const found = () => [...tables.robots.keys()].filter((k) => tables.robots[k].asks.some((cell) => tables.robots[k].enters.includes(cell)));
    return evaluation?.askers ?? (known ? found() : null);
  }

  // Its learning curves: of miscoordinations only where there can be some.
  get curves() {
    const { curves, run } = this.newest;
    return curves && run && { ...curves, miscoordinations: this.canMiscoordinate ? curves.miscoordinations : [] };
  }

  get canMiscoordinate() {
    return this.newest.run.kinds.includes("miscoordination");
  }

  show() {
    const { frame } = this;
    if (!frame || !this.newest.run) return;
    this.map.move(frame, clock.state === "paused");
    const { run, dialogue } = this.newest;
    const said = dialogue?.entries.filter((entry) => entry.step === frame.step).map((entry) => entry.text) ?? [];
    said.push(...frame.interactions);
    const home = frame.cells.every((cell, k) => cell === run.robots[k].goal);
    this.now.replaceChildren(html("b", {}, "Now:"), ` ${said.join(" ") || (home ? "all robots have arrived." : "no robot asks.")}`);
    this.spoken = `${letter(this.k)}. ${spoken(run, frame)}`;
  }

  // The values of the newest tables.
  values() {
    const { evaluation } = this.newest;
    const one = (value, words) => html("div", {}, html("dt", {}, words), html("dd", {}, value));
    this.value.replaceChildren(
      ...MEASURES.filter(([name]) => name !== "miscoordinations" || this.canMiscoordinate).map(([name, digits, words]) => one(withError(evaluation, name, digits), words)),
      one(evaluation.cells["all arrive"], "all arrive"));
  }

  // What happened when, as ticks on the time line.
  mark() {
    if (!aligned || !clock) return;
    const { starts, lengths, offsets } = aligned, own = starts[this.k];
    const at = (step) => {
      const i = own.findLastIndex((start) => start <= step);
      return i >= 0 && step - own[i] <= lengths[this.k][i] ? offsets[i] + step - own[i] : null;
    };
    this.lane.show(kinds().map((kind) => {
      const places = (this.newest.marks?.[kind] ?? []).map(at).filter((position) => position !== null);
      return [kind, places.map((position) => position / Math.max(1, clock.last))];
    }));
  }
}

// Whether words fit beside a map: it is hardly wider than high.
function isUpright({ rows }) {
  return Math.max(...rows.map((row) => row.length)) <= 1.2 * rows.length;
}

// The cells in which a robot that can come there would do something else.
function differences() {
  const robots = columns.map((column) => column.newest.tables?.robots);
  const same = columns.every((column) => column.newest.run?.map.rows.join() === columns[0].newest.run?.map.rows.join());
  const found = new Map();
  if (same && robots.every((own) => own?.every(Boolean))) {
    for (const k of robots[0].keys()) {
      const entered = new Set(robots.flatMap((own) => own[k].enters));
      for (const cell of entered) {
        const does = robots.map((own) => (own[k].asks.includes(cell) ? "asks" : movesInWords(own[k].moves[cell])));
        const { name } = columns[0].newest.run.robots[k];
        const words = `${name} ${does.map((one, run) => `${one} in ${letter(run)}`).join(", ")}.`;
        if (new Set(does).size > 1) found.set(cell, found.has(cell) ? `${found.get(cell)} ${words}` : words);
      }
    }
  }
  for (const column of columns) if (column.newest.run) column.map.mark(found);
  $("differ").textContent = `where they do something else (${found.size} cells)`;
}

// The best moves of a cell.
function movesInWords(best) {
  const { actions } = columns[0].newest.run;
  return `moves ${best.flatMap((is, move) => (is ? [actions[move]] : [])).join(" or ")}`;
}

// A mean, with its standard error where it has one.
function withError(evaluation, name, digits) {
  const error = evaluation[`${name}_error`];
  return evaluation[name].toFixed(digits) + (error > 0 ? ` (s.e. ${error.toFixed(digits)})` : "");
}

// Which robots of a team ask, in words.
function askers(run, asking) {
  const names = asking.map((k) => run.robots[k].name);
  if (!names.length) return "no robot asks";
  if (names.length === run.robots.length) return names.length === 2 ? "both robots ask" : "all robots ask";
  if (names.length === 1) return `only ${names[0]} asks`;
  return `${names.slice(0, -1).join(", ")} and ${names.at(-1)} ask`;
}

// What the teams do differently, and what that brings.
function headline() {
  if (!columns.every((column) => column.newest.run)) return;
  const asking = columns.map((column) => column.askers);
  if (!asking.every(Boolean)) return;
  const said = asking.map((robots, k) => askers(columns[k].newest.run, robots));
  const several = new Set(said).size > 1;
  const each = `${said.map((words, k) => `in ${letter(k)} ${words}`).join(", ")}.`;
  const values = columns.map((column) => column.newest.evaluation);
  if (!values.every(Boolean)) {
    $("headline").textContent = several ? `I${each.slice(1)}` : `In all runs ${said[0]}.`;
    return;
  }
  const often = values.map((value, k) => `${withError(value, "asks", 2)} times an episode in ${letter(k)}`);
  const told = several ? each : `in all runs ${said[0]}: a robot ${often.join(", ")}.`;
  const earned = values.map((value, k) => `${withError(value, "returns", 2)} in ${letter(k)}`).join(", ");
  const failing = values.map((value, k) => (value.failing ? `The team of ${letter(k)} fails. ` : "")).join("");
  $("headline").textContent = `${failing}I${told.slice(1)} On average a robot earns ${earned}.`;
  const beside = new Set(values.map(yardsticks));
  $("beside").textContent = beside.size === 1 ? [...beside][0] : "";
}

// What other teams earn.
function yardsticks({ ignoring, yardsticks: known }) {
  const others = known.map(([name, value]) => `${name} ${value.toFixed(2)}`);
  if (ignoring !== null) others.unshift(`robots that ignore each other ${ignoring.toFixed(2)}`);
  return others.length ? `To compare: ${others.join(" · ")}` : "";
}

// The scenario and its settings, where they are those of all runs.
function headerOf() {
  const runs = columns.map((column) => column.newest.run);
  const found = new Set(runs.map((run) => run && about(run)));
  $("about").textContent = found.size === 1 ? [...found][0] ?? "" : "";
}

// The kinds of marks that the runs can have.
const kinds = () => MARKS.filter((kind) => columns.some((column) => column.newest.run?.kinds.includes(kind)));

function legend() {
  $("marks-legend").replaceChildren(...kinds().map((kind) => html("span", {},
    svg("svg", { viewBox: "0 0 10 10", "aria-hidden": "true" }, svg("path", { class: `mark ${kind}`, d: "M5,1v8" })), ` ${MARK_NAMES[kind] ?? kind}`)));
  const { run } = columns.find((column) => column.newest.run).newest;
  const signs = layerSigns(tinted(run.robots[0].colour));
  for (const [name] of SHOWN) $(`sign-${name}`).replaceChildren(signs[name]);
  const outcomes = run.perception === "always" ? [] : [["refused", "is refused"], ["failed", "no answer"]];
  $("signs").replaceChildren(...[["answered", "asks, is answered"], ...outcomes].map(([outcome, words]) => question(run, outcome, words)), ...places(run));
}

// The boxes, each with its sign; then the other signs.
function begin() {
  $("layers").replaceChildren(...SHOWN.map(([name, words, checked]) => html("label", {},
    html("input", { type: "checkbox", id: `show-${name}`, checked, onchange: layers }), html("span", { id: `sign-${name}` }),
    name === "differ" ? html("span", { id: "differ" }, "where they do something else") : words)), html("p", { id: "signs", className: "quiet" }));
}

function drawCurves() {
  charts.compare(columns.map((column, k) => ({ message: column.curves, label: letter(k), look: look(k) })));
  place();
}

function place() {
  const frames = columns.map((column) => column.frame);
  if (frames.every(Boolean)) charts.place(frames.map((frame) => frame.made), columns.map((_, k) => look(k)));
}

function layers() {
  for (const { map, newest } of columns) {
    for (const [name] of SHOWN) map.layers[name] = $(`show-${name}`).checked;
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
  $("where").textContent = { learned: `step ${into} of ${clock.last}, again and again`,
    episode: `episode ${number(clock.segment + 1)}, step ${into}`, step: `step ${number(columns[0]?.frame?.made)}` }[clock.axis];
  $("seek").ariaValueText = $("where").textContent;
  place();
  if (clock.state === "paused") requestAnimationFrame(() => { $("spoken").textContent = columns.map((column) => column.spoken ?? "").join(" "); });
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
    const named = titles.map((title, k) => `${title} (${letter(k)})`).join(" and ");
    $("title").textContent = named[0].toUpperCase() + named.slice(1);
    document.title = `${titles.join(", ")} – sparse_coord`;
    $("axis").replaceChildren(...message.axes.map((axis) => new Option(AXES[axis], axis)));
    $("rate").replaceChildren(...RATES.map((rate) => new Option(`${number(rate)} steps/s`, rate)));
    if (!columns.length) columns = titles.map((title, k) => new Column(k, title)); // not again after a lost connection
  },
  aligned(message) { aligned = message; columns.forEach((column) => column.mark()); },
  clock(message) {
    const longer = clock?.last !== message.last;
    clock = message;
    if (longer) columns.forEach((column) => column.mark());
    columns.forEach((column) => column.show());
    showClock();
  },
  error({ text }) { $("said").textContent = text; },
  done() { $("said").textContent = ""; },
  pages: shared,
};

const pause = () => send("pause", clock?.state !== "paused");
$("pause").onclick = pause;
$("back").onclick = () => send("step", -1);
$("next-step").onclick = () => send("step", 1);
$("rate").onchange = () => { send("rate", Number($("rate").value)); $("rate").blur(); };
$("axis").onchange = () => { send("axis", $("axis").value); $("axis").blur(); };
$("seek").oninput = () => { sliding = performance.now(); send("seek", Number($("seek").value)); };
$("theme").onclick = otherTheme;
begin();

const KEYS = {
  " ": pause, ArrowRight: () => send("step", 1), ArrowLeft: () => send("step", -1),
  Home: () => send("seek", 0), End: () => send("seek", clock.last),
};

document.addEventListener("keydown", (event) => {
  const own = event.target.matches("select, input:not([type=checkbox])") || (event.key === " " && event.target.matches("button, input"));
  const act = mayControl && clock ? KEYS[event.key] : undefined;
  if (!act || own || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  act();
});

// The last stream is that of the clock.
const { send } = connect("?run=99", (message) => TAKE[message.type]?.(message), () => { $("state").textContent = "not connected"; });
