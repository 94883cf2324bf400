// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// What all parts of the page draw with: elements, numbers, the robots' shapes and colours.

export const $ = (id) => document.getElementById(id);
export const number = (n) => (n === null || n === undefined ? "–" : n.toLocaleString("en"));

const NS = "http://www.w3.org/2000/svg";

export function svg(name, attributes = {}, ...children) {
  const element = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

// Robots differ by shape as well as by colour and number.
export function shape(name, size) {
  const ring = (corners, turn = -90, inner = null) => {
    const points = [];
    const count = inner === null ? corners : 2 * corners;
    for (let i = 0; i < count; i++) {
      const radius = inner !== null && i % 2 ? size * inner : size;
      const angle = ((turn + (360 * i) / count) * Math.PI) / 180;
      points.push(`${(radius * Math.cos(angle)).toFixed(2)},${(radius * Math.sin(angle)).toFixed(2)}`);
    }
    return svg("polygon", { points: points.join(" ") });
  };
  const side = size * 0.86;
  const third = size * 0.42;
  switch (name) {
    case "square": return svg("rect", { x: -side, y: -side, width: 2 * side, height: 2 * side });
    case "triangle": {
      const big = size * 1.2;
      return svg("polygon", { points: `0,${-big} ${big},${0.8 * size} ${-big},${0.8 * size}` });
    }
    case "diamond": return svg("polygon", { points: `0,${-1.2 * size} ${1.2 * size},0 0,${1.2 * size} ${-1.2 * size},0` });
    case "pentagon": return ring(5);
    case "hexagon": return ring(6, 0);
    case "star": return ring(7, -90, 0.72);
    case "cross": {
      const a = size * 1.05, b = size * 0.62;
      return svg("polygon", { points: [[-b, -a], [b, -a], [b, -b], [a, -b], [a, b], [b, b], [b, a], [-b, a], [-b, b], [-a, b], [-a, -b], [-b, -b]].map((p) => p.join(",")).join(" ") });
    }
    default: return svg("circle", { r: size });
  }
}

// A dark colour is made lighter where the page is dark, a light one darker where it is light.
export function tinted(colour) {
  const dark = getComputedStyle(document.documentElement).getPropertyValue("--lift").trim() === "1";
  const parts = [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
  const light = (0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]) / 255;
  const mix = dark && light < 0.45 ? 0.42 : 0;
  return `rgb(${parts.map((p) => Math.round(p + (255 - p) * mix)).join(",")})`;
}

export function inkOn(colour) {
  const [r, g, b] = colour.match(/\d+/g).map((p) => (p / 255) ** 2.2);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b > 0.24 ? "#000" : "#fff";
}
