// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// Learning curves: each point is the mean of some episodes, as `run.history` has them.

import { svg, tinted } from "/draw.js";

const WIDTH = 400, HEIGHT = 190, LEFT = 46, RIGHT = 24, TOP = 8, BOTTOM = 22;
const DASHES = ["", "6 3", "2 3", "8 3 2 3", "12 4", "4 7", "9 3 2 3 2 3", "1 5"];

export const CHARTS = [
  { key: "length", title: "Steps of an episode", low: 0 },
  { key: "reward", title: "Reward of a robot", robots: true },
  { key: "miscoordinations", title: "Miscoordinations", low: 0 },
  { key: "asks", title: "Questions of a robot", robots: true, low: 0 },
];

function nice(low, high, count = 4) {
  const span = high - low || 1;
  const raw = span / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find((n) => n * power >= raw) * power;
  const ticks = [];
  for (let at = Math.ceil(low / step) * step; at <= high + 1e-9 * span; at += step) ticks.push(Number(at.toPrecision(10)));
  return ticks;
}

const mean = (lines) => lines[0].map((_, i) => {
  const values = lines.map((line) => line[i]).filter((v) => v !== null);
  return values.length ? values.reduce((a, b) => a + b) / values.length : null;
});

const short = (n) => Math.abs(n) >= 1e6 ? `${+(n / 1e6).toPrecision(3)}M` : Math.abs(n) >= 1e4 ? `${+(n / 1e3).toPrecision(3)}k` : `${+n.toPrecision(4)}`;

export class Curves {
  constructor(element) {
    this.charts = CHARTS.map((chart) => {
      const value = document.createElement("span");
      const head = document.createElement("h2");
      head.append(chart.title, value);
      const picture = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": chart.title });
      const box = document.createElement("section");
      box.className = "chart";
      box.id = `chart-${chart.key}`;
      box.append(head, picture);
      element.append(box);
      return { ...chart, value, picture };
    });
  }

  show(message, run, position, shown) {
    this.message = message;
    this.run = run;
    this.shown = shown;
    for (const chart of this.charts) this.draw(chart, position);
  }

  draw(chart, position) {
    const { message, run } = this;
    const picture = chart.picture;
    picture.replaceChildren();
    // Of more than two robots: their mean, and those whose tables are shown.
    const few = run.robots.length <= 2;
    const lines = []; // [robot or null, values]
    if (message && chart.robots) {
      if (!few) lines.push([null, mean(message[chart.key])]);
      message[chart.key].forEach((line, k) => { if (few || this.shown.has(k)) lines.push([k, line]); });
    } else if (message) lines.push([null, message[chart.key]]);
    const steps = message?.step ?? [];
    const values = lines.flatMap(([, line]) => line).filter((v) => v !== null);
    const right = Math.max(1, steps.at(-1) ?? 1);
    let low = Math.min(chart.low ?? Infinity, ...values), high = Math.max(...values, (chart.low ?? -Infinity) + 1);
    if (!values.length) [low, high] = [0, 1];
    if (low === high) high = low + 1;
    const x = (step) => LEFT + ((WIDTH - LEFT - RIGHT) * step) / right;
    const y = (value) => TOP + (HEIGHT - TOP - BOTTOM) * (1 - (value - low) / (high - low));
    picture.append(svg("path", { class: "axis", d: `M${LEFT},${TOP}V${HEIGHT - BOTTOM}H${WIDTH - RIGHT}` }));
    for (const tick of nice(low, high)) {
      picture.append(svg("path", { class: "axis", d: `M${LEFT - 4},${y(tick)}H${LEFT}` }));
      picture.append(svg("text", { class: "tick", x: LEFT - 7, y: y(tick), "text-anchor": "end", "dominant-baseline": "central" }, short(tick)));
    }
    for (const tick of nice(0, right)) {
      picture.append(svg("path", { class: "axis", d: `M${x(tick)},${HEIGHT - BOTTOM}v4` }));
      picture.append(svg("text", { class: "tick", x: x(tick), y: HEIGHT - 6, "text-anchor": "middle" }, short(tick)));
    }
    const ends = [];
    for (const [k, line] of lines) {
      let path = "", down = false, last = null;
      line.forEach((value, i) => {
        if (value === null) { down = false; return; }
        path += `${down ? "L" : "M"}${x(steps[i]).toFixed(1)},${y(value).toFixed(1)}`;
        down = true;
        last = [i, value];
      });
      if (!last) continue;
      const colour = k === null ? null : tinted(run.robots[k].colour);
      const curve = svg("path", { class: colour ? "curve" : "curve team", d: path, "data-robot": k === null ? "team" : k + 1 });
      if (colour) {
        curve.setAttribute("stroke", colour);
        curve.setAttribute("stroke-dasharray", DASHES[k]);
        ends.push([y(last[1]), k, colour, x(steps[last[0]])]);
      }
      picture.append(curve);
    }
    ends.sort((a, b) => a[0] - b[0]);
    let above = -Infinity;
    for (const [at, k, colour, end] of ends) {
      above = Math.max(at, above + 11);
      picture.append(svg("text", { class: "end", x: end + 5, y: above, fill: colour }, String(k + 1)));
    }
    this.here(chart, position);
    const finals = lines.map(([, line]) => line.findLast((v) => v !== null)).filter((v) => v !== undefined);
    chart.value.textContent = (few || !chart.robots ? finals : finals.slice(0, 1)).map((v) => v.toFixed(2)).join(" · ");
  }

  // Where the shown time step lies; of a bag only, as live it is always the end.
  here(chart, position) {
    chart.picture.querySelector(".here")?.remove();
    const steps = this.message?.step ?? [];
    if (position === null || position === undefined || !steps.length) return;
    const right = Math.max(1, steps.at(-1));
    const x = LEFT + ((WIDTH - LEFT - RIGHT) * Math.min(position, right)) / right;
    chart.picture.append(svg("path", { class: "here", d: `M${x},${TOP}V${HEIGHT - BOTTOM}` }));
  }

  place(position) {
    for (const chart of this.charts) this.here(chart, position);
  }
}
