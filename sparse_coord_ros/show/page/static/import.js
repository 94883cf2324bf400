// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// The page of import-map: the building's picture, the cells made of it, and what clicks choose.

import { $, html, inkOn, number, svg, tell, ticks, tinted, written } from "/draw.js";
import { Film } from "/import_film.js";
import { connect, token } from "/stream.js";
import { View } from "/view.js";

const METRE = 100; // units of the picture
const TICKS = 55; // the fewest pixels between two numbers of an axis
const SMALLEST = 7; // pixels: a robot's radius
const PLACES = /at ((?:-?[\d.]+,-?[\d.]+ ?)+)/g; // of notes

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const SIGNS = { ".": "free cell", D: "doorway", "#": "no free cell" };

let run = null, imported = null, chosen = null, control = false, waiting = false, cursor = null;
let prospect = { note: "", doorway: null };
let laid = null; // the scale at which the picture lies
let scaled = false; // the reader has said the scale of a picture
const past = []; // what was chosen before each change, and what the change was

const picture = svg("image", { preserveAspectRatio: "none" });
const free = svg("path", { class: "cells" }), doors = svg("path", {}), over = svg("g");
const at = ([x, y]) => [x * METRE, -y * METRE];

// Of places relative to a pose [x, y, yaw]: metres ahead and left of it; and back.
const absolute = ([x, y, yaw = 0], [ahead, left]) => [
  x + Math.cos(yaw) * ahead - Math.sin(yaw) * left,
  y + Math.sin(yaw) * ahead + Math.cos(yaw) * left,
];
const relative = ([x, y, yaw = 0], [px, py]) => absolute([0, 0, -yaw], [px - x, py - y]);
const lies = (pose) => `translate(${at(pose)}) rotate(${(-(pose[2] ?? 0) * 180) / Math.PI})`;

class Plan extends View {
  look() {
    this.unit = 1 / super.look(); // units of a pixel
    if (Number.isFinite(this.unit)) {
      over.replaceChildren(...marks(), ...robots(), ...axes(), ...crosshair());
      film.draw();
    }
    return 1 / this.unit;
  }
}
const view = new Plan($("map"));
const film = new Film((k, radius) => disc(k, Math.max(radius * METRE, SMALLEST * view.unit)), at);
$("map").append(picture, free, doors, over, film.layer);

const text = (x, y, words, attributes) => svg("text", { x, y, "font-size": 12 * view.unit, ...attributes }, words);
const colourOf = (k) => run.colours[k % run.colours.length];

// Starts are discs, goals rings, of the robot's true radius where that is large enough to see.
function disc(k, r) {
  const colour = colourOf(k);
  return svg("g", {}, svg("circle", { r, fill: tinted(colour) }),
    svg("text", { class: "number", "font-size": 1.2 * r, fill: inkOn(colour) }, `${k + 1}`));
}
function ring(k, r) {
  const colour = tinted(colourOf(k));
  return svg("g", {}, svg("circle", { r: 1.35 * r, fill: "none", stroke: colour, "stroke-width": r / 3 }),
    svg("text", { x: 1.8 * r, class: "number", "font-size": 1.2 * r, fill: written(colourOf(k)) }, `${k + 1}`));
}
function robots() {
  if (!chosen) return [];
  const r = Math.max(chosen.radius * METRE, SMALLEST * view.unit);
  const one = (kind, drawn) => (place, k) => {
    const mark = drawn(k, r);
    for (const [key, value] of Object.entries({ class: kind, "data-robot": k + 1, transform: `translate(${at(place)})` })) mark.setAttribute(key, value);
    mark.append(svg("title", {}, `${kind} of robot ${k + 1}`));
    return mark;
  };
  return [...chosen.goal.map(one("goal", ring)), ...chosen.start.map(one("start", disc))];
}

const allNotes = () => [imported?.interactions ?? "", ...(imported?.notes ?? []), prospect.note].filter(Boolean);

// The places that notes and problems name.
function marks() {
  return [...allNotes(), $("notice").textContent].flatMap((note) => [...note.matchAll(PLACES)].flatMap(([, list]) => list.trim().split(" ")).map((place) => {
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

function legend() {
  const sample = (...marks) => svg("svg", { viewBox: "-16 -10 32 20", "aria-hidden": "true" }, ...marks);
  const entry = (words, ...marks) => html("span", {}, sample(...marks), words);
  const square = { x: -8, y: -8, width: 16, height: 16 };
  return [
    entry("free cell", svg("rect", { ...square, class: "cells" })),
    entry("doorway", svg("rect", { ...square, fill: run.doorway_colour })),
    entry("start of robot 1", disc(0, 9)),
    entry("its goal", ring(0, 6)),
    entry("a place that a note names", svg("circle", { r: 7, class: "met" })),
  ];
}

// What the next click on the map does.
function nextInWords() {
  if (tool() === "doorways") return "Click a free cell to add a doorway, a doorway to remove it";
  return `Click the ${placed()}`;
}
const placed = () => `${chosen.start.length > chosen.goal.length ? "goal" : "start"} of robot ${chosen.goal.length + 1}`;

function show() {
  for (const [id, value] of [["cell-side", chosen.cell], ["radius", chosen.radius]]) {
    if (document.activeElement !== $(id)) $(id).value = value;
  }
  const asked = !!chosen.scale && !scaled;
  $("next").textContent = asked ? "Say how large this picture is, above" : nextInWords();
  $("undo").disabled = !past.length;
  $("undo").title = past.length ? `Undo: ${past.at(-1).what}` : "Nothing to undo";
  $("save").disabled = asked;
  $("train").disabled = asked || !chosen.goal.length;
  $("corridors").checked = chosen.corridors;
  $("corridor-holder").hidden = !imported?.corridors;
  showScale();
  showProspect();
  view.look();
}

function showScale() {
  $("scale").hidden = !chosen.scale;
  $("scale").disabled = !control;
  if (!chosen.scale) return;
  const { resolution, origin: [x, y] } = chosen.scale;
  const values = { width: Number((resolution * run.pixels[0]).toPrecision(6)), resolution, "origin-x": x, "origin-y": y };
  for (const [id, value] of Object.entries(values)) if (document.activeElement !== $(id)) $(id).value = value;
  $("scaled").hidden = scaled;
  $("scale-why").textContent = `It has no YAML file with its scale. Save writes one: ${run.header}.`;
}

function showProspect() {
  $("advice").textContent = prospect.advice ?? "";
  $("add-holder").hidden = !prospect.doorway;
  const notes = [...(imported?.notes ?? []), prospect.note].filter(Boolean);
  $("notes").replaceChildren(...notes.map((note) => html("li", {}, note)));
}

// The picture at its scale; all of it is seen.
function layPicture(scale) {
  const { resolution, origin } = scale;
  laid = structuredClone(scale);
  const [wide, tall] = run.pixels.map((one) => one * resolution);
  const size = { x: 0, y: -tall * METRE, width: wide * METRE, height: tall * METRE };
  for (const [key, value] of Object.entries({ ...size, transform: lies(origin), href: run.picture })) picture.setAttribute(key, value);
  const corners = [[0, 0], [wide, 0], [0, tall], [wide, tall]].map((corner) => at(absolute(origin, corner)));
  const [xs, ys] = [0, 1].map((axis) => corners.map((corner) => corner[axis]));
  const x = Math.min(...xs), y = Math.min(...ys), width = Math.max(...xs) - x, height = Math.max(...ys) - y, edge = 0.05 * Math.max(width, height);
  view.show({ x: x - edge, y: y - edge / 4, width: width + 2 * edge, height: height + 1.25 * edge }, 2 * METRE);
}

const same = (one, other) => JSON.stringify(one) === JSON.stringify(other);

const TAKE = {
  hello(message) {
    control = message.control;
    if (!control && token) send("hello");
    $("bar").disabled = !control;
    $("corridors").disabled = $("add-doorway").disabled = !control;
    $("state").textContent = control ? "ready" : "view only: open the address as it was printed";
    if (chosen) show();
  },
  run(message) {
    run = message;
    document.title = `${run.name} – sparse_coord import-map`;
    $("title").textContent = `${run.name}: from a map to a team`;
    doors.setAttribute("fill", run.doorway_colour);
    chosen ??= run.chosen;
    layPicture(chosen.scale ?? run.scale);
    $("legend").replaceChildren(...legend());
    show();
  },
  imported(message) {
    imported = message;
    if (same(imported.chosen, chosen)) waiting = false;
    if (!waiting) chosen = imported.chosen; // another page has chosen it
    if (!same(prospect.chosen, chosen)) prospect = { note: "", doorway: null };
    const { rows, resolution: side, cells, doorways_in_words: doorways, suggested } = imported, a = side * METRE;
    const path = (sign, margin) => rows.flatMap((row, r) => [...row].map((one, c) => (one !== sign ? "" :
      `M${(c + margin) * a},${-(rows.length - r - margin) * a}h${(1 - 2 * margin) * a}v${(1 - 2 * margin) * a}h${-(1 - 2 * margin) * a}z`))).join("");
    free.setAttribute("d", path(".", 0.08));
    doors.setAttribute("d", path("D", 0.03));
    for (const one of [free, doors]) one.setAttribute("transform", lies(imported.origin));
    $("facts").textContent = `${number(cells)} cells of ${side} m, ${doorways}`;
    $("interactions").textContent = imported.interactions;
    const settings = Object.entries(suggested).map(([key, value]) => `${key}=${value}`).join(", ");
    const known = suggested.prior === "map" ? " Robots begin with the values of robots alone on this map." : "";
    $("suggested").textContent = settings && `Settings by distance: ${settings}.${known}`;
    if (chosen.scale && !same(laid, chosen.scale)) layPicture(chosen.scale);
    show();
  },
  prospect(message) {
    if (!same(message.chosen, chosen)) return;
    prospect = message;
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
    const held = document.activeElement.id;
    $("train").hidden = busy;
    $("stop").hidden = !busy;
    $("drive").hidden = busy || !learned;
    if (busy && ["train", "drive"].includes(held)) $("stop").focus(); // in place of a button that is gone
    if (!busy && held === "stop") $("train").focus();
    if (!$("learning").src) $("learning").src = `/index.html?run=0${location.hash}`;
    if (busy && !learned && !learning) showTeam(true);
    learning = busy && !learned;
  },
  film(message) {
    if (message.seconds.length) {
      showTeam(false);
      view.look(); // it has a size again
    }
    film.load(message);
  },
};
TAKE.error = TAKE.problem;

// There is one map: that of the team, or the one to change, on which the film is shown.
let learning = false;
function showTeam(shown) {
  $("learning").hidden = !shown;
  $("panels").hidden = shown;
  $("swap").hidden = false;
  $("swap").textContent = shown ? "Back to the map" : "Show the team";
}

// A change is shown at once, and the map imported again with it.
function choose(what, change) {
  if (!control) return;
  past.push({ what, chosen: structuredClone(chosen) });
  $("saved").textContent = "";
  change(chosen);
  $("said").textContent = what;
  wish("import");
}

function undo() {
  if (!control || !past.length) return;
  const { what, chosen: before } = past.pop();
  chosen = before;
  $("said").textContent = `Undone: ${what}`;
  wish("import");
}

function wish(what) {
  $("state").textContent = "importing";
  waiting = true;
  if (what === "import") prospect = { note: "", doorway: null };
  send(what, chosen);
  show();
}

const tool = () => document.querySelector("input[name=tool]:checked").value;

// The place in metres, as the middle of its cell where there is one, and the cell's sign.
function cellAt(x, y) {
  const { rows, resolution: side, origin } = imported ?? { rows: [], resolution: 1, origin: [0, 0] };
  const [c, level] = relative(origin, [x, y]).map((one) => Math.floor(one / side)), sign = rows[rows.length - 1 - level]?.[c];
  const place = sign ? absolute(origin, [(c + 0.5) * side, (level + 0.5) * side]) : [x, y];
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
const rounded = (one) => (Math.round(one * 100) / 100 || 0).toFixed(2); // never -0.00
const inWords = ([x, y]) => `x ${rounded(x)} m, y ${rounded(y)} m`;
const describe = (place) => `${inWords(place)}: ${SIGNS[cellAt(...place).sign] ?? SIGNS["#"]}`;
function act(place) {
  if (chosen.scale && !scaled) return;
  const cell = cellAt(...place), where = inWords(cell.place);
  if (tool() === "doorways") choose(`${cell.sign === "D" ? "no doorway" : "doorway"} at ${where}`, (now) => doorway(now, cell));
  else choose(`${placed()} at ${where}`, (now) => now[now.start.length > now.goal.length ? "goal" : "start"].push(cell.place));
}
$("map").addEventListener("pointermove", (event) => { if (run && !view.drag(event)) $("where").textContent = describe(metres(view.under(event))); });
$("map").addEventListener("click", (event) => { if (run && !view.dragged) act(metres(view.under(event))); });
$("map").addEventListener("keydown", (event) => {
  const by = ARROWS[event.key];
  if (!run || (!by && event.key !== "Enter")) return;
  event.preventDefault();
  const { x, y, width, height } = view.seen, from = cursor ?? metres({ x: x + width / 2, y: y + height / 2 });
  if (!by) return act(from);
  const side = imported?.resolution ?? 1, next = absolute([...from, imported?.origin[2]], by.map((one) => one * side)), { place } = cellAt(...next);
  if (!view.holds(...at(place))) return;
  cursor = place;
  $("where").textContent = $("said").textContent = describe(cursor);
  view.reveal(...at(cursor));
});
document.addEventListener("keydown", (event) => {
  const typing = event.target.matches("input[type=number]");
  if (!typing && (event.ctrlKey || event.metaKey) && event.key === "z") {
    event.preventDefault();
    undo();
  }
});
// Doorways that were added or removed belong to a grid: another one begins without.
for (const [id, key, name] of [["cell-side", "cell", "cell"], ["radius", "radius", "radius"]]) {
  $(id).onchange = () => choose(`${name} of ${$(id).value} m`, (now) => Object.assign(now, { [key]: $(id).valueAsNumber, doorway: [], no_doorway: [] }));
}
// Places in metres belong to a scale: another one begins without.
function rescale() {
  choose(`a picture of ${$("width").value} m`, (now) => Object.assign(now, {
    scale: { resolution: $("resolution").valueAsNumber, origin: [$("origin-x").valueAsNumber, $("origin-y").valueAsNumber] },
    start: [], goal: [], doorway: [], no_doorway: [],
  }));
}
$("width").onchange = () => { $("resolution").value = $("width").valueAsNumber / run.pixels[0]; rescale(); };
$("resolution").onchange = () => { $("width").value = $("resolution").valueAsNumber * run.pixels[0]; rescale(); };
$("origin-x").onchange = $("origin-y").onchange = rescale;
$("scaled").onclick = () => { scaled = true; show(); $("map").focus(); };
$("corridors").onchange = () => choose($("corridors").checked ? "one robot at a time in corridors" : "corridors as before",
  (now) => { now.corridors = $("corridors").checked; });
$("add-doorway").onclick = () => {
  const cell = cellAt(...prospect.doorway);
  choose(`doorway at ${inWords(cell.place)}`, (now) => doorway(now, cell));
  $("map").focus(); // the button is gone
};
for (const one of document.querySelectorAll("input[name=tool]")) one.onchange = show;
$("undo").onclick = undo;
$("swap").onclick = () => showTeam($("learning").hidden);
$("no-robots").onclick = () => choose("no robots", (now) => Object.assign(now, { start: [], goal: [] }));
for (const what of ["save", "train"]) $(what).onclick = () => wish(what);
for (const what of ["stop", "drive"]) $(what).onclick = () => send(what);

const { send } = connect("?run=1", (message) => TAKE[message.type]?.(message), () => { $("state").textContent = "not connected"; });
