// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// What all parts of the page draw with: elements, numbers, the robots' shapes and colours.

export const $ = (id) => document.getElementById(id);
export const number = (n) => (n === null || n === undefined ? "–" : n.toLocaleString("en"));

// Shows a line; an empty one takes it away.
export const tell = (id, text) => Object.assign($(id), { textContent: text, hidden: !text });

// How many pages are open: what one does is done for all.
export const shared = ({ count }) => tell("shared", count > 1 ? `${count} pages are open: they share one clock and its controls` : "");

// The round numbers of an axis, at least so far apart.
export function ticks(low, high, least) {
  const power = 10 ** Math.floor(Math.log10(least)), step = [1, 2, 5, 10].find((n) => n * power >= least) * power;
  const first = Math.ceil(low / step), count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: count }, (_, i) => Number(((first + i) * step).toPrecision(10)));
}

export function html(name, properties = {}, ...children) {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
}

export function svg(name, attributes = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

// Robots differ by shape as well as by colour and number: corners as [x, y], in robots' radii.
const ring = (corners, turn, inner = 1) => Array.from({ length: corners }, (_, i) => {
  const angle = ((turn + (360 * i) / corners) * Math.PI) / 180, radius = i % 2 ? inner : 1;
  return [radius * Math.cos(angle), radius * Math.sin(angle)];
});
const SHAPES = {
  square: [[-0.86, -0.86], [0.86, -0.86], [0.86, 0.86], [-0.86, 0.86]],
  triangle: [[0, -1.2], [1.2, 0.8], [-1.2, 0.8]],
  diamond: [[0, -1.2], [1.2, 0], [0, 1.2], [-1.2, 0]],
  pentagon: ring(5, -90),
  hexagon: ring(6, 0),
  star: ring(14, -90, 0.72),
  cross: [[-0.62, -1.05], [0.62, -1.05], [0.62, -0.62], [1.05, -0.62], [1.05, 0.62], [0.62, 0.62],
    [0.62, 1.05], [-0.62, 1.05], [-0.62, 0.62], [-1.05, 0.62], [-1.05, -0.62], [-0.62, -0.62]],
};

export function shape(robot, size) {
  const look = { class: "body", fill: tinted(robot.colour) };
  const corners = SHAPES[robot.shape];
  if (!corners) return svg("circle", { r: size, ...look });
  return svg("polygon", { points: corners.map(([x, y]) => `${x * size},${y * size}`).join(" "), ...look });
}

// A dark colour is made lighter where the page is dark.
const parts = (colour) => [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
const bright = ([r, g, b], power) => 0.2126 * (r / 255) ** power + 0.7152 * (g / 255) ** power + 0.0722 * (b / 255) ** power;
const lifted = (colour) => parts(colour).map((p) => (bright(parts(colour), 1) < 0.45 ? Math.round(0.58 * p + 107) : p));
const ink = (rgb) => (bright(rgb, 2.2) > 0.24 ? "#000" : "#fff");

// A robot's colour in letters and thin signs: dark enough to be read where the page is light.
export const written = (colour) => `light-dark(color-mix(in srgb, ${colour} 62%, #000), rgb(${lifted(colour)}))`;
export const tinted = (colour) => `light-dark(${colour}, rgb(${lifted(colour)}))`;
export const inkOn = (colour) => `light-dark(${ink(parts(colour))}, ${ink(lifted(colour))})`;

// Where the robots are and how they interact, for those who hear the page.
export function spoken(run, frame) {
  const places = frame.cells.map((cell, k) => {
    const at = run.map.cells[cell];
    return `${run.robots[k].name} ${at ? `in row ${at[0]}, column ${at[1]}` : "not seen"}`;
  });
  return `Step ${number(frame.made)}: ${[`${places.join("; ")}.`, ...frame.interactions].join(" ")}`;
}

// What a run is about: its scenario, its learner if that is given, and the rules.
export function about(run, learner) {
  const team = run.robots.length === 1 ? "1 robot" : `${run.robots.length} robots`;
  const parts = [run.scenario, learner, team, `seed ${run.seed}`].filter(Boolean);
  return `${parts.join(", ")}. ${run.rules}`;
}

// Dark where the page is light, and the other way round.
export function otherTheme() {
  const own = document.documentElement.style, system = matchMedia("(prefers-color-scheme: dark)");
  own.colorScheme = (own.colorScheme || (system.matches ? "dark" : "light")) === "dark" ? "light" : "dark";
}
