// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// The page of import-map: the building's picture, the cells made of it, and what clicks choose.

import { $, html, inkOn, number, svg, tell, ticks, tinted } from "/draw.js";
import { connect, token } from "/stream.js";
import { View } from "/view.js";

const METRE = 100; // units of the picture
const TICKS = 55; // the fewest pixels between two numbers of an axis
const SMALLEST = 7; // pixels: a robot's radius
const PLACES = /at ((?:-?[\d.]+,-?[\d.]+ ?)+)/g; // of notes

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

let run = null, imported = null, chosen = null, control = false, waiting = false, cursor = null;
const past = []; // what was chosen before each change

const picture = svg("image", { preserveAspectRatio: "none" });
const free = svg("path", { class: "cells" }), doors = svg("path", {}), over = svg("g");
const at = ([x, y]) => [x * METRE, -y * METRE];

class Plan extends View {
  look() {
    this.unit = 1 / super.look(); // units of a pixel
    if (Number.isFinite(this.unit)) over.replaceChildren(...marks(), ...robots(), ...axes(), ...crosshair());
    return 1 / this.unit;
  }
}
const view = new Plan($("map"));
$("map").append(picture, free, doors, over);

const text = (x, y, words, attributes) => svg("text", { x, y, "font-size": 12 * view.unit, ...attributes }, words);

// Starts are discs, goals rings, of the robot's true radius where that is large enough to see.
function robots() {
  if (!chosen) return [];
  const r = Math.max(chosen.radius * METRE, SMALLEST * view.unit);
  const one = (kind) => (place, k) => {
    const [cx, cy] = at(place), colour = run.colours[k % run.colours.length], start = kind === "start";
    const size = r * (start ? 1 : 1.35), look = start ? { fill: tinted(colour) } : { fill: "none", stroke: tinted(colour), "stroke-width": r / 3 };
    return svg("g", { class: kind, "data-robot": k + 1 }, svg("circle", { cx, cy, r: size, ...look }),
      text(cx + (start ? 0 : 1.8 * r), cy, `${k + 1}`, { class: "number", "font-size": 1.2 * r, fill: start ? inkOn(colour) : tinted(colour) }));
  };
  return [...chosen.goal.map(one("goal")), ...chosen.start.map(one("start"))];
}

// The places that notes and problems name.
function marks() {
  const said = [...(imported?.notes ?? []), $("notice").textContent];
  return said.flatMap((note) => [...note.matchAll(PLACES)].flatMap(([, list]) => list.trim().split(" ")).map((place) => {
    const [cx, cy] = at(place.split(",").map(Number));
    return svg("circle", { cx, cy, r: 12 * view.unit, class: "met note" }, svg("title", {}, note));
  }));
}

// Where the arrow keys are.
function crosshair() {
  if (!cursor) return [];
  const [x, y] = at(cursor), long = 14 * view.unit;
  return [svg("path", { class: "cursor note", d: `M${x - long},${y}h${2 * long}M${x},${y - long}v${2 * long}` })];
}

function axes() {
  const { x, y, width, height } = view.seen, { unit } = view, least = (TICKS * unit) / METRE;
  const numbers = (low, size) => ticks(low, low + size, least).map((one) => [one * METRE, `${one} m`]);
  const line = (x1, y1, x2, y2) => svg("line", { x1, y1, x2, y2, class: "tick-line" });
  const bottom = y + height, long = 6 * unit;
  return [
    ...numbers(x / METRE, width / METRE).flatMap(([X, words]) => [line(X, bottom, X, bottom - long),
      text(X, bottom - 10 * unit, words, { class: "axis-text x-axis" })]),
    ...numbers(-bottom / METRE, height / METRE).filter(([Y]) => Y + bottom > 25 * unit).flatMap(([Y, words]) => [line(x, -Y, x + long, -Y),
      text(x + 9 * unit, -Y, words, { class: "axis-text y-axis" })]),
  ];
}

function show() {
  for (const [id, value] of [["cell-side", chosen.cell], ["radius", chosen.radius]]) {
    if (document.activeElement !== $(id)) $(id).value = value;
  }
  const { start, goal } = chosen, what = start.length > goal.length ? "the goal" : "the start";
  $("next").textContent = tool() === "robots" ? `Click ${what} of robot ${goal.length + 1}` : "Click a cell";
  $("undo").disabled = !past.length;
  $("train").disabled = !goal.length;
  view.look();
}

const TAKE = {
  hello(message) {
    control = message.control;
    if (!control && token) send("hello");
    $("bar").disabled = !control;
    $("state").textContent = control ? "ready" : "view only: open the address as it was printed";
  },
  run(message) {
    run = message;
    document.title = `${run.name} – sparse_coord import-map`;
    $("title").textContent = `${run.name}: from a map to a team`;
    const [width, height] = run.size.map((one) => one * METRE), [x, y] = at(run.origin), edge = 0.05 * Math.max(width, height);
    for (const [key, value] of Object.entries({ x, y: y - height, width, height, href: run.picture })) picture.setAttribute(key, value);
    doors.setAttribute("fill", run.doorway_colour);
    chosen ??= run.chosen;
    view.show({ x: x - edge, y: y - height - edge / 4, width: width + 2 * edge, height: height + 1.25 * edge }, 2 * METRE);
    show();
  },
  imported(message) {
    imported = message;
    if (JSON.stringify(imported.chosen) === JSON.stringify(chosen)) waiting = false;
    if (!waiting) chosen = imported.chosen; // another page has chosen it
    const { rows, resolution: side, cells, doorways_in_words: doorways, suggested } = imported, [x, y] = at(imported.origin), a = side * METRE;
    const path = (sign, margin) => rows.flatMap((row, r) => [...row].map((one, c) => (one !== sign ? "" :
      `M${x + (c + margin) * a},${y - (rows.length - r - margin) * a}h${(1 - 2 * margin) * a}v${(1 - 2 * margin) * a}h${-(1 - 2 * margin) * a}z`))).join("");
    free.setAttribute("d", path(".", 0.08));
    doors.setAttribute("d", path("D", 0.03));
    $("facts").textContent = `${number(cells)} cells of ${side} m, ${doorways}`;
    $("notes").replaceChildren(...imported.notes.map((note) => html("li", {}, note)));
    const settings = Object.entries(suggested).map(([key, value]) => `${key}=${value}`).join(", ");
    const known = suggested.prior === "map" ? " Robots begin with the values of robots alone on this map." : "";
    $("suggested").textContent = settings && `Settings by distance: ${settings}.${known}`;
    show();
  },
  problem({ text: words }) {
    tell("notice", words);
    if (words) waiting = false;
    if (control) $("state").textContent = "ready";
    if (run) view.look();
  },
  saved({ files }) { $("saved").textContent = `Saved: ${files.join(", ")}`; },
  team({ text: words, busy, learned }) {
    $("team").textContent = words;
    $("train").hidden = busy;
    $("stop").hidden = !busy;
    $("drive").hidden = busy || !learned;
    if (!$("learning").src) $("learning").src = `/index.html?run=0${location.hash}`;
    $("learning").hidden = false;
  },
};
TAKE.error = TAKE.problem;

// A change is shown at once, and the map imported again with it.
function choose(change) {
  if (!control) return;
  past.push(structuredClone(chosen));
  $("saved").textContent = "";
  change(chosen);
  wish("import");
}

function wish(what) {
  $("state").textContent = "importing";
  waiting = true;
  send(what, chosen);
  show();
}

const tool = () => document.querySelector("input[name=tool]:checked").value;

// The place in metres, as the middle of its cell where there is one, and the cell's sign.
function cellAt(x, y) {
  const { rows, resolution: side, origin } = imported ?? { rows: [], resolution: 1, origin: [0, 0] };
  const c = Math.floor((x - origin[0]) / side), level = Math.floor((y - origin[1]) / side), sign = rows[rows.length - 1 - level]?.[c];
  const place = sign ? [origin[0] + (c + 0.5) * side, origin[1] + (level + 0.5) * side] : [x, y];
  return { place: place.map((one) => Number(one.toFixed(3))), sign, key: `${level} ${c}` };
}

function doorway(now, { place, sign, key }) {
  const here = (list) => list.filter((one) => cellAt(...one).key !== key);
  const [own, against] = sign === "D" ? ["doorway", "no_doorway"] : ["no_doorway", "doorway"];
  const left = here(now[own]);
  if (left.length === now[own].length) now[against].push(place);
  now[own] = left; // a click takes back an earlier one
}

const metres = ({ x, y }) => [x / METRE, -y / METRE];
const say = ([x, y]) => { $("where").textContent = `x ${x.toFixed(2)} m, y ${y.toFixed(2)} m`; };
function act(place) {
  const cell = cellAt(...place);
  choose((now) => (tool() === "doorways" ? doorway(now, cell) : now[now.start.length > now.goal.length ? "goal" : "start"].push(cell.place)));
}
$("map").addEventListener("pointermove", (event) => { if (run && !view.drag(event)) say(metres(view.under(event))); });
$("map").addEventListener("click", (event) => { if (run && !view.dragged) act(metres(view.under(event))); });
$("map").addEventListener("keydown", (event) => {
  const by = ARROWS[event.key];
  if (!run || (!by && event.key !== "Enter")) return;
  event.preventDefault();
  const { x, y, width, height } = view.seen, from = cursor ?? metres({ x: x + width / 2, y: y + height / 2 });
  if (!by) return act(from);
  cursor = from.map((one, axis) => one + by[axis] * (imported?.resolution ?? 1));
  say(cursor);
  view.look();
});
// Doorways that were added or removed belong to a grid: another one begins without.
for (const [id, key] of [["cell-side", "cell"], ["radius", "radius"]]) {
  $(id).onchange = () => choose((now) => Object.assign(now, { [key]: $(id).valueAsNumber, doorway: [], no_doorway: [] }));
}
for (const one of document.querySelectorAll("input[name=tool]")) one.onchange = show;
$("undo").onclick = () => { chosen = past.pop(); wish("import"); };
$("no-robots").onclick = () => choose((now) => Object.assign(now, { start: [], goal: [] }));
for (const what of ["save", "train"]) $(what).onclick = () => wish(what);
for (const what of ["stop", "drive"]) $(what).onclick = () => send(what);

const { send } = connect("?run=1", (message) => TAKE[message.type]?.(message), () => { $("state").textContent = "not connected"; });
