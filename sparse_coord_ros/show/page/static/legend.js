// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// The signs of a map, each with its words.

import { html, svg, tinted } from "/draw.js";

const sign = (...shapes) => svg("svg", { viewBox: "0 0 60 22", "aria-hidden": "true" }, ...shapes);
const item = (words, ...shapes) => html("span", {}, sign(...shapes), words);

// A line from a robot to the one that it asks.
export function question(run, outcome, words) {
  const { colour, sign: letter } = run.outcomes[outcome];
  return item(words, svg("g", { class: "ask", "data-outcome": outcome, stroke: tinted(colour) },
    svg("line", { x1: 2, y1: 11, x2: 58, y2: 11 }),
    svg("circle", { cx: 30, cy: 11, r: 10, fill: colour, class: "badge" }),
    svg("text", { x: 30, y: 11, stroke: "none" }, letter)));
}

// What lies on the map, and what happens on it, without the questions.
export function places(run) {
  const found = [item("start, goal", svg("text", { x: 30, y: 12, class: "label", fill: "currentColor" }, "S1 G1"))];
  if (run.map.doorways.length) found.push(
    item("doorway", svg("rect", { x: 19, y: 2, width: 20, height: 18, class: "doorway", stroke: run.doorway_colour })));
  if (run.kinds.includes("miscoordination")) found.push(
    item("miscoordination", svg("text", { x: 30, y: 12, class: "met-sign" }, "✖")));
  if (run.kinds.includes("exchange")) found.push(item("robots exchange cells", svg("text", { x: 30, y: 12, class: "met-sign" }, "⇄")));
  if (run.kinds.includes("stopped")) found.push(item("another robot stops it", svg("path", { d: "M30,3v16", class: "bar-in-the-way" })));
  return found;
}

// The signs of what robots learned and did, by the names of a map's layers.
export function layerSigns(colour) {
  const line = { stroke: colour, fill: "none" };
  return {
    trails: sign(svg("path", { d: "M8,11H52", class: "trail", ...line })),
    rings: sign(svg("circle", { cx: 30, cy: 11, r: 9, class: "ring", ...line })),
    differ: sign(svg("path", { d: "M20,1H40V21Z", class: "differs" })),
    arrows: sign(svg("path", { d: "M14,11H46M38,5L46,11L38,17", class: "arrow", ...line })),
    heat: sign(svg("rect", { x: 10, y: 2, width: 40, height: 18, fill: colour, "fill-opacity": 0.4 })),
    pale: sign(svg("path", { d: "M14,11H46", class: "arrow pale", ...line })),
  };
}
