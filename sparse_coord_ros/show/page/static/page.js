// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// The page: takes the stream of messages, shows the newest of each, sends what buttons and keys ask.

import { Curves } from "/curves.js";
import { $, about, html, inkOn, number, otherTheme, shape, shared, spoken, svg, tell, tinted } from "/draw.js";
import { Lane } from "/lanes.js";
import { layerSigns, places, question } from "/legend.js";
import { TeamMap } from "/map.js";
import { agesPanel, cellPanel, dialoguePanel, evaluationPanel, learnedPanel } from "/panels.js";
import { connect, token } from "/stream.js";

const UNKNOWN = "not known";
const RATES = [0.5, 1, 2, 5, 10, 20, 50, 100, 500, 1000, 10000];
// What one can jump to: its button, what it does.
const JUMPS = {
  question: ["question", "the next question"], miscoordination: ["miscoordination", "the next miscoordination"],
  exchange: ["exchange", "the next exchange of cells"],
  stopped: ["stopped robot", "the next robot that another one stops"],
  policy: ["change of asking", "the next change of where a robot would ask"],
  crossing: ["First crossing", "the first time that robots meet at a doorway, and all arrive without a miscoordination"],
};
const HELD = ["paused", "ended", "finished", "stopped"];
const OVER = ["finished", "stopped", "gone"]; // nothing goes on

let newest = {}; // message of each type
let mayControl = false, sliding = -1e9;

const map = new TeamMap($("map"), () => mark("cell"));
const charts = new Curves($("curves"));

// Messages come faster than a screen shows them: what came last is drawn, once a picture.
const due = new Set();
const DRAW = {
  run: begin,
  frame: showFrame,
  tables: () => { map.policy(newest.tables); showCell(); },
  asked: () => { map.heat(newest.asked); $("asked-where").textContent = newest.asked?.where ?? "asked here so far"; },
  curves: showCurves,
  evaluation: () => evaluationPanel(newest.run, newest.evaluation),
  learned: () => learnedPanel(newest.learned, mayControl && jump),
  marks: showMarks,
  dialogue: () => dialoguePanel(newest.run, newest.dialogue ?? {}),
  cell: showCell,
  pointed: () => cellPanel(newest.run, newest.tables, newest.pointed, map),
};

function mark(what) {
  if (!due.size) requestAnimationFrame(draw);
  due.add(what);
}

function draw() {
  const what = Object.keys(DRAW).filter((one) => due.has(one));
  due.clear();
  if (newest.run) what.forEach((one) => DRAW[one]());
}

const TAKE = {
  hello,
  error: ({ text }) => { $("said").textContent = text; },
  done: () => { $("said").textContent = ""; },
  pages: shared,
  said: ({ text }) => { if (mayControl) $("said").textContent = text; },
  notice: ({ text }) => tell("notice", text),
  run: (message) => {
    newest = newest.run ? { run: message } : { ...newest, run: message };
    Object.keys(DRAW).forEach(mark);
  },
};

// Any message may come first. Several parts of the page need two of them: the first of its type draws all parts,
// but begins no run anew: the cell that somebody points at stays.
function take(message) {
  if (TAKE[message.type]) return TAKE[message.type](message);
  const first = !newest[message.type];
  newest[message.type] = message;
  const parts = Object.keys(DRAW).filter((one) => first && one !== "run");
  for (const one of [message.type, ...parts]) mark(one);
}

function hello({ control, scenarios, learners }) {
  mayControl = control;
  mark("learned");
  if (!control && token) send("hello");
  $("said").textContent = control || token ? "" : "view only: for controls open the address as it was printed";
  for (const [id, names] of [["scenario", scenarios], ["learner", learners]]) {
    if (!$(id).length) $(id).append(...names.map((name) => new Option(name, name)));
  }
  nextRun();
  showControls();
}

function showControls() {
  $("bar").hidden = !newest.run;
  $("bar").disabled = !mayControl;
  for (const element of document.querySelectorAll("[data-control]")) {
    element.hidden = !newest.run?.controls.includes(element.dataset.control);
  }
}

// Says what the team is doing; a reader hears it once.
function setState(text) {
  if ($("state").dataset.state !== text) $("state").textContent = $("state").dataset.state = text;
}

// A run: what stays while it is shown.
function begin() {
  const { run } = newest;
  $("title").textContent = run.title;
  $("budget").textContent = number(run.budget);
  document.title = `${run.scenario} – sparse_coord watch`;
  $("about").textContent = about(run, `${run.learner}${run.greedy ? " (greedy)" : ""}`);
  Object.assign($("map-title"), { textContent: run.map.name, title: run.map.title });
  map.begin(run);
  $("robots").replaceChildren(...run.robots.map(chip));
  legend();
  const rates = run.source === "bag" ? RATES : [...RATES, 0];
  $("rate").replaceChildren(...rates.map((r) => new Option(r ? `${number(r)} steps/s` : "as fast as it goes", r)));
  for (const [kind, { lane }] of Object.entries(lanes)) lane.row.hidden = !run.kinds.includes(kind);
  charts.begin(run.kinds);
  nextRun();
  showControls();
}

// The next run is at first the one that is shown.
function nextRun() {
  const { run } = newest;
  if (run) for (const [id, value] of [["scenario", run.scenario], ["penalty", run.penalty], ["learner", run.label], ["steps", run.budget]]) $(id).value = value;
}

function chip(robot, k) {
  const text = svg("text", { fill: inkOn(robot.colour), "font-size": 14, "font-weight": 700, "text-anchor": "middle", "dominant-baseline": "central" }, String(k + 1));
  const picture = svg("svg", { viewBox: "-17 -17 34 34" }, shape(robot, 13.5), text);
  const title = `show what ${robot.name} learned`;
  return html("button", { type: "button", className: "chip", title, ariaPressed: map.shown.has(k), onclick: () => toggle(k) }, picture, robot.name);
}

function toggle(k) {
  if (k >= newest.run.robots.length) return;
  const shown = [...map.shown].filter((one) => one !== k);
  map.shown = new Set(map.shown.has(k) ? shown : [...shown, k].sort());
  $("robots").children[k].ariaPressed = map.shown.has(k);
  map.redraw();
  mark("curves");
}

function legend() {
  const { run } = newest, signs = layerSigns(tinted(run.robots[0].colour));
  $("legend").replaceChildren(
    question(run, "answered", "asks, is answered"), question(run, "refused", "is refused"), question(run, "failed", "no answer"),
    html("span", {}, signs.rings, "would ask here"), html("span", {}, signs.heat, html("span", { id: "asked-where" })),
    html("span", {}, signs.pale, "never visited"), ...places(run));
}

function showFrame() {
  const { frame, run, curves } = newest;
  if (!frame) return;
  const held = HELD.includes(frame.state);
  $("step").textContent = number(frame.made);
  $("step").dataset.step = frame.step; // of the log's clock, for tests
  $("speed").textContent = number(held ? 0 : frame.speed === undefined ? frame.rate || null : frame.speed);
  if (frame.episodes !== undefined) showEpisodes(frame.episodes, frame.counted_to < frame.step);
  else if (!curves) showEpisodes(frame.episode + 1);
  setState(frame.state);
  $("pause").textContent = frame.state === "ended" ? "Play again" : frame.state === "paused" ? "Resume" : "Pause";
  $("start").disabled = !["finished", "stopped"].includes(frame.state);
  for (const id of ["pause", "next-step", "rate", "reset"]) $(id).disabled = OVER.includes(frame.state);
  if (document.activeElement !== $("rate")) {
    const options = [...$("rate").options].map((one) => one.value);
    const rate = frame.rate ?? UNKNOWN;
    if (!options.includes(String(rate))) $("rate").add(new Option(rate === UNKNOWN ? UNKNOWN : `${number(rate)} steps/s`, rate));
    $("rate").value = rate;
  }
  if (frame.last !== undefined) {
    if (frame.last !== Number($("seek").max)) mark("marks"); // the log has grown
    $("seek").min = frame.first;
    $("seek").max = frame.last;
    if (performance.now() - sliding > 600) $("seek").value = frame.step;
    charts.place([frame.made]);
  }
  map.move(frame, held);
  $("now").textContent = frame.interactions.join(" ");
  $("seek").ariaValueText = `step ${number(frame.made)}`;
  if (held) $("spoken").textContent = spoken(run, frame);
  agesPanel(run, newest.tables, frame);
}

// The number of episodes; not `whole`: there are at least so many.
function showEpisodes(count, atLeast = false) {
  $("episodes").textContent = `${atLeast ? "≥ " : ""}${number(count)}`;
  $("episodes").nextSibling.textContent = count === 1 ? " episode" : " episodes";
}

function showCurves() {
  const { curves, run, frame } = newest;
  charts.show(curves, run, map.shown);
  if (frame?.last !== undefined) charts.place([frame.made]);
  if (!curves) return;
  if (frame?.episodes === undefined) showEpisodes(curves.episodes);
  const how = curves.window > 1 ? `the mean of ${curves.window} episodes` : "an episode";
  const read = curves.read < 1 ? ` · reading the log: ${Math.round(100 * curves.read)} %` : "";
  $("foot").textContent = `each point of the curves: ${how}${read} · sparse_coord_ros ${run.version}`;
  $("foot").dataset.read = curves.read;
}

function showMarks() {
  const { marks, frame } = newest;
  for (const [kind, { button, lane }] of Object.entries(lanes)) {
    button.disabled = !marks?.[kind]?.length;
    if (marks?.[kind] && frame) lane.show([[kind, marks[kind].map((step) => (step - frame.first) / Math.max(1, frame.last - frame.first))]]);
  }
}

function showCell() {
  if (map.peerCell !== null && map.cell !== null && newest.tables) send("look", [map.cell, map.peerCell]);
  cellPanel(newest.run, newest.tables, newest.pointed, map);
  agesPanel(newest.run, newest.tables, newest.frame);
}

// Buttons and keys.
const pause = () => send("pause", !HELD.includes(newest.frame?.state));
$("pause").onclick = pause;
$("next-step").onclick = () => send("step", 1);
$("back").onclick = () => send("step", -1);
$("reset").onclick = () => send("reset");
$("rate").onchange = () => {
  if ($("rate").value !== UNKNOWN) send("rate", Number($("rate").value));
  $("rate").blur();
};
$("seek").oninput = () => { sliding = performance.now(); send("seek", Number($("seek").value)); };
$("start").onclick = () => send("next", { scenario: $("scenario").value, penalty: Number($("penalty").value), learner: $("learner").value, steps: Number($("steps").value) });
const jump = (kind) => send("jump", kind);
const lanes = {};
for (const [kind, [words, what]] of Object.entries(JUMPS)) {
  const button = html("button", { type: "button", className: kind, title: what, disabled: true, onclick: () => jump(kind) }, `${words} ▸`);
  button.dataset.kind = kind;
  const toStep = (share) => { const { first, last } = newest.frame; seek(first + share * (last - first)); };
  lanes[kind] = { button, lane: new Lane($("lanes"), html("span", {}, button), `when: ${what.replace("the next ", "")}`, toStep) };
}
for (const name of ["arrows", "rings", "heat", "trails"]) {
  $(`show-${name}`).onchange = (event) => { map.layers[name] = event.target.checked; map.redraw(); };
}
$("theme").onclick = otherTheme;

// Key: the control that it needs, and what it does.
const seek = (at) => send("seek", Math.round(at ?? 0));
const KEYS = {
  " ": ["pause", pause],
  ArrowRight: ["step", () => send("step", 1)],
  ArrowLeft: ["seek", () => send("step", -1)],
  Home: ["seek", (frame) => seek(frame.first)],
  End: ["seek", (frame) => seek(frame.last)],
};

document.addEventListener("keydown", (event) => {
  const { run, frame } = newest, [control, act] = KEYS[event.key] ?? [];
  const own = event.target.matches("select, input:not([type=checkbox])") || (event.key === " " && event.target.matches("button, input"));
  if (!act || !run || !frame || own || event.ctrlKey || event.altKey || event.metaKey) return;
  if (!(mayControl && run.controls.includes(control))) return;
  event.preventDefault();
  act(frame);
});

const { send } = connect(location.search, take, () => setState("not connected"));
