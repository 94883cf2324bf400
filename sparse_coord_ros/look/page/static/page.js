// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// The page: takes the stream of messages, shows the newest of each, sends what buttons and keys ask.

import { Curves } from "/curves.js";
import { $, inkOn, number, shape, svg, tinted } from "/draw.js";
import { TeamMap } from "/map.js";
import { agesPanel, cellPanel, dialoguePanel, evaluationPanel } from "/panels.js";

const token = location.hash.slice(1);
const RATES = [0.5, 1, 2, 5, 10, 20, 50, 100, 500, 1000, 10000];
const HELD = ["paused", "ended", "finished", "stopped"];

let run = null, frame = null, tables = null, curves = null, evaluation = null, socket = null;
let asked = null, said = [];
let mayControl = false, drawing = false, dirty = new Set(), retry = 500, sliding = -1e9;

const map = new TeamMap($("map"), () => mark("cell"));
const charts = new Curves($("curves"));

// Messages come faster than a screen shows them: what came last is drawn, once a picture.
function mark(what) {
  dirty.add(what);
  if (drawing) return;
  drawing = true;
  requestAnimationFrame(() => {
    drawing = false;
    const what = dirty;
    dirty = new Set();
    if (!run) return;
    if (what.has("run")) begin();
    if (what.has("frame") && frame) showFrame();
    if (what.has("tables")) map.policy(tables);
    if (what.has("asked")) map.heat(asked);
    if (what.has("curves") && curves) showCurves();
    if (what.has("evaluation")) evaluationPanel(evaluation);
    if (what.has("dialogue")) dialoguePanel(run, said);
    if (what.has("cell") || what.has("tables")) showCell();
  });
}

function take(message) {
  switch (message.type) {
    case "hello": hello(message); break;
    case "run":
      run = message;
      frame = tables = curves = evaluation = asked = null;
      said = [];
      mark("run"); mark("evaluation"); break;
    case "frame": frame = message; mark("frame"); break;
    case "tables": tables = message; mark("tables"); break;
    case "asked": asked = message; mark("asked"); break;
    case "curves": curves = message; mark("curves"); break;
    case "evaluation": evaluation = message; mark("evaluation"); break;
    case "dialogue": said = message.entries; mark("dialogue"); break;
    case "notice": {
      $("notice").textContent = message.text;
      $("notice").hidden = !message.text;
      break;
    }
    case "error": $("said").textContent = message.text; break;
    case "done": $("said").textContent = ""; break;
  }
}

function hello(message) {
  mayControl = message.control;
  if (message.control) {
    $("said").textContent = "";
  } else if (token) {
    send("hello");
  } else {
    $("said").textContent = "view only: for controls open the address as it was printed";
  }
  if ($("scenario").options.length !== message.scenarios.length) {
    $("scenario").replaceChildren(...message.scenarios.map((name) => new Option(name, name)));
  }
  showControls();
}

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
  socket.onopen = () => { retry = 500; };
  socket.onmessage = (event) => take(JSON.parse(event.data));
  socket.onclose = () => {
    setState("not connected");
    document.body.dataset.connected = "no";
    setTimeout(connect, retry);
    retry = Math.min(5000, retry * 1.5);
  };
}

function send(what, value) {
  if (socket?.readyState !== WebSocket.OPEN) return;
  socket.send(JSON.stringify({ do: what, value, token }));
}

const can = (what) => mayControl && run !== null && run.controls.includes(what);

function showControls() {
  $("bar").hidden = !run;
  for (const element of document.querySelectorAll("[data-control]")) {
    element.hidden = !run?.controls.includes(element.dataset.control);
    for (const one of [element, ...element.querySelectorAll("button, select, input")]) {
      if ("disabled" in one) one.disabled = !mayControl;
    }
  }
  $("back").hidden = !run?.controls.includes("seek");
}

function setState(text) {
  $("state").textContent = text;
  $("state").dataset.state = text;
}

// A run: what stays while it is shown.
function begin() {
  document.body.dataset.connected = "yes";
  document.body.dataset.source = run.source;
  $("title").textContent = run.title;
  document.title = `${run.scenario} – sparse_coord watch`;
  const team = run.robots.length === 1 ? "1 robot" : `${run.robots.length} robots`;
  $("about").textContent = `${run.scenario}, ${run.learner} ${run.greedy ? "(greedy), " : ""}${team}, penalty ${run.penalty}, percepts: ${run.perception}, seed ${run.seed}`;
  $("map-title").textContent = run.map.name;
  $("map-title").title = run.map.title;
  $("foot").textContent = `sparse_coord_ros ${run.version}`;
  $("silence").hidden = false;
  $("dialogue").replaceChildren();
  map.shown = new Set(run.robots.length <= 2 ? run.robots.keys() : [0]);
  map.begin(run);
  map.cursorCell = null;
  $("robots").replaceChildren(...run.robots.map((robot, k) => chip(robot, k)));
  legend();
  const rates = run.source === "bag" ? RATES : [...RATES, 0];
  $("rate").replaceChildren(...rates.map((r) => new Option(r ? `${number(r)} steps/s` : "as fast as it goes", r)));
  $("penalty").value = run.penalty;
  if ([...$("scenario").options].some((o) => o.value === run.scenario)) $("scenario").value = run.scenario;
  charts.show(null, run, null, map.shown);
  showControls();
  showCell();
}

function chip(robot, k) {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "chip";
  button.setAttribute("aria-pressed", map.shown.has(k));
  button.title = `show what ${robot.name} learned (${k + 1})`;
  const body = shape(robot.shape, 13.5);
  const colour = tinted(robot.colour);
  body.setAttribute("fill", colour);
  const text = svg("text", { fill: inkOn(colour), "font-size": 14, "font-weight": 700, "text-anchor": "middle", "dominant-baseline": "central" }, String(k + 1));
  button.append(svg("svg", { viewBox: "-17 -17 34 34", "aria-hidden": "true" }, body, text), robot.name);
  button.onclick = () => toggle(k);
  return button;
}

function toggle(k) {
  if (!run || k >= run.robots.length) return;
  if (map.shown.has(k)) map.shown.delete(k); else map.shown.add(k);
  map.shown = new Set([...map.shown].sort((a, b) => a - b));
  $("robots").children[k].setAttribute("aria-pressed", map.shown.has(k));
  map.redraw();
  if (curves) mark("curves");
}

function legend() {
  const line = (outcome, words) => {
    const said = run.outcomes[outcome];
    const group = svg("g", { class: "ask", "data-outcome": outcome, stroke: tinted(said.colour) },
      svg("line", { x1: 2, y1: 11, x2: 58, y2: 11 }),
      svg("circle", { cx: 30, cy: 11, r: 10, fill: said.colour, class: "badge" }),
      svg("text", { x: 30, y: 11, stroke: "none" }, said.sign));
    return item(svg("svg", { viewBox: "0 0 60 22" }, group), words);
  };
  const item = (picture, words) => {
    const span = document.createElement("span");
    span.append(picture, words);
    return span;
  };
  const box = (element) => svg("svg", { viewBox: "0 0 60 22" }, element);
  const first = tinted(run.robots[0].colour);
  $("legend").replaceChildren(
    line("answered", "asks, is answered"), line("refused", "is refused"), line("failed", "no answer"),
    item(box(svg("rect", { x: 19, y: 2, width: 20, height: 18, class: "doorway", stroke: run.doorway_colour })), "doorway"),
    item(box(svg("circle", { cx: 30, cy: 11, r: 9, class: "ring", stroke: first })), "would ask here"),
    item(box(svg("rect", { x: 10, y: 2, width: 40, height: 18, fill: first, "fill-opacity": 0.4 })), "asked here so far"),
    item(box(svg("text", { x: 30, y: 12, class: "label", fill: "currentColor" }, "S1 G1")), "start, goal"),
    item(box(svg("text", { x: 30, y: 12, class: "met-sign", "font-size": "20" }, "✖")), "miscoordination"));
}

function showFrame() {
  const held = HELD.includes(frame.state);
  $("step").textContent = number(frame.step);
  $("transitions-of").hidden = frame.transitions === undefined;
  $("transitions").textContent = `${number(frame.transitions)} of ${number(run.budget)}`;
  $("speed").textContent = number(frame.speed ?? (held ? 0 : frame.rate || null));
  if (frame.episode !== undefined && !curves) $("episodes").textContent = number(frame.episode + 1);
  setState(frame.state);
  $("pause").textContent = held ? "Go on" : "Hold";
  $("pause").setAttribute("aria-pressed", held);
  $("start").disabled = !can("next") || !["finished", "stopped"].includes(frame.state);
  if (frame.rate !== undefined && document.activeElement !== $("rate")) {
    const options = [...$("rate").options];
    if (!options.some((o) => Number(o.value) === frame.rate)) $("rate").add(new Option(`${number(frame.rate)} steps/s`, frame.rate));
    $("rate").value = String(frame.rate);
  }
  if (frame.last !== undefined) {
    $("seek").min = frame.first;
    $("seek").max = frame.last;
    if (performance.now() - sliding > 600) $("seek").value = frame.step;
    $("seek").setAttribute("aria-valuetext", `time step ${frame.step} of ${frame.last}`);
    charts.place(frame.step);
  }
  map.move(frame, held);
  showAges();
}

function showCurves() {
  $("episodes").textContent = number(curves.episodes);
  charts.show(curves, run, run.source === "bag" ? frame?.step : null, map.shown);
  const how = curves.window > 1 ? `each point of the curves: the mean of ${curves.window} episodes` : "each point of the curves: an episode";
  const read = curves.read < 1 ? ` · reading the log: ${Math.round(100 * curves.read)} %` : "";
  $("foot").textContent = `${how}${read} · sparse_coord_ros ${run.version}`;
  $("foot").dataset.read = curves.read;
}

function showCell() {
  cellPanel(run, tables, map.cursorCell);
  showAges();
}

const showAges = () => agesPanel(run, tables, frame);

// Buttons and keys.
const pause = () => send("pause", !HELD.includes(frame?.state));
$("pause").onclick = pause;
$("next-step").onclick = () => send("step", 1);
$("back").onclick = () => send("step", -1);
$("reset").onclick = () => send("reset");
$("rate").onchange = () => { send("rate", Number($("rate").value)); $("rate").blur(); };
$("seek").oninput = () => { sliding = performance.now(); send("seek", Number($("seek").value)); };
$("start").onclick = () => send("next", { scenario: $("scenario").value, penalty: Number($("penalty").value) });
for (const name of ["arrows", "rings", "heat"]) {
  $(`show-${name}`).onchange = (event) => { map.layers[name] = event.target.checked; map.redraw(); };
}
$("help").onclick = () => {
  $("keys").hidden = !$("keys").hidden;
  $("help").setAttribute("aria-expanded", !$("keys").hidden);
};
// The colours of robots depend on the theme: draw everything again.
function restyle() {
  if (!run) return;
  const { shown, cursorCell } = map;
  map.begin(run);
  map.shown = shown;
  map.cursorCell = null;
  map.choose(cursorCell);
  $("robots").replaceChildren(...run.robots.map((robot, k) => chip(robot, k)));
  legend();
  map.redraw();
  for (const what of ["frame", "curves", "cell", "dialogue"]) mark(what);
}
$("theme").onclick = () => {
  const dark = getComputedStyle(document.documentElement).getPropertyValue("--lift").trim() === "1";
  document.documentElement.dataset.theme = dark ? "light" : "dark";
  restyle();
};
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", restyle);

function faster(by) {
  const rates = [...$("rate").options].map((o) => Number(o.value)).filter((r) => r > 0).sort((a, b) => a - b);
  const now = frame?.rate || rates.at(-1);
  const next = by > 0 ? rates.find((r) => r > now) : rates.findLast((r) => r < now);
  if (next !== undefined) send("rate", next);
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || !run) return;
  const typing = ["INPUT", "SELECT", "TEXTAREA"].includes(event.target.tagName) && event.target.type !== "checkbox";
  if (typing) return;
  const onButton = event.target.tagName === "BUTTON" && (event.key === " " || event.key === "Enter");
  if (onButton) return;
  const seek = (at) => can("seek") && send("seek", Math.round(at));
  const keys = {
    " ": () => can("pause") && pause(),
    ArrowRight: () => can("step") && send("step", 1),
    ArrowLeft: () => can("seek") && send("step", -1),
    PageDown: () => seek((frame?.step ?? 0) + 100),
    PageUp: () => seek((frame?.step ?? 0) - 100),
    Home: () => seek(frame?.first ?? 0),
    End: () => seek(frame?.last ?? 0),
    "+": () => can("rate") && faster(1),
    "-": () => can("rate") && faster(-1),
    r: () => can("reset") && send("reset"),
    t: () => $("theme").click(),
    "?": () => $("help").click(),
  };
  const what = keys[event.key] ?? (/^[1-8]$/.test(event.key) ? () => toggle(Number(event.key) - 1) : null);
  if (!what) return;
  event.preventDefault();
  what();
});

connect();
