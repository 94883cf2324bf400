// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// Learning curves: each point is the mean of some episodes, as `run.history` has them.

import { html, svg, ticks, tinted } from "/draw.js";

const WIDTH = 400, HEIGHT = 190, LEFT = 46, RIGHT = 24, TOP = 8, BOTTOM = 22;
const DASHES = ["", "6 3", "2 3", "8 3 2 3", "12 4", "4 7", "9 3 2 3 2 3", "1 5"];

const CHARTS = [
  { key: "length", title: "Steps of an episode", range: [0, 1] }, // at least
  { key: "reward", title: "Undiscounted return", range: [] },
  { key: "miscoordinations", title: "Miscoordinations", range: [0, 1] },
  { key: "asks", title: "Questions of a robot", range: [0, 1] },
];

const known = (values) => values.filter((v) => v !== null);

const mean = (lines) => lines[0].map((_, i) => {
  const values = known(lines.map((line) => line[i]));
  return values.length ? values.reduce((a, b) => a + b) / values.length : null;
});

const short = (n) => n.toLocaleString("en", { notation: "compact", maximumSignificantDigits: 3 });

export class Curves {
  constructor(element) {
    this.right = 1;
    this.charts = CHARTS.map((chart) => {
      const value = html("span");
      const picture = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": chart.title });
      element.append(html("section", { className: "chart" }, html("h2", {}, chart.title, value), picture));
      return { ...chart, value, picture };
    });
  }

  // The curves of the team; of robots: of two both, of more their mean and those that are shown.
  show(message, run, shown) {
    const steps = message?.step ?? [];
    this.right = Math.max(1, steps.at(-1) ?? 1);
    for (const chart of this.charts) {
      const values = message?.[chart.key] ?? [];
      const robots = Array.isArray(values[0]) ? [...values.entries()] : [];
      const few = robots.length <= 2;
      const lines = few ? robots : robots.filter(([k]) => shown.has(k));
      if (!few) lines.unshift([null, mean(values)]);
      if (values.length && !robots.length) lines.push([null, values]);
      this.draw(chart, run, steps, lines);
      const finals = lines.map(([, line]) => known(line).at(-1)?.toFixed(2) ?? "–");
      chart.value.textContent = (few ? finals : finals.slice(0, 1)).join(" · ");
    }
  }

  x(step) {
    return LEFT + ((WIDTH - LEFT - RIGHT) * Math.min(step, this.right)) / this.right;
  }

  draw({ picture, range }, run, steps, lines) {
    const path = (d, look) => picture.append(svg("path", { d, class: "axis", ...look }));
    const text = (at, words, look) => picture.append(svg("text", { class: "tick", x: at[0], y: at[1], ...look }, words));
    picture.replaceChildren();
    path(`M${LEFT},${TOP}V${HEIGHT - BOTTOM}H${WIDTH - RIGHT}`);
    const values = [...known(lines.flatMap(([, line]) => line)), ...range];
    if (!values.length) return;
    const low = Math.min(...values), most = Math.max(...values), high = most > low ? most : low + 1;
    const y = (value) => TOP + (HEIGHT - TOP - BOTTOM) * (1 - (value - low) / (high - low));
    for (const tick of ticks(low, high, (high - low) / 4)) {
      path(`M${LEFT - 4},${y(tick)}H${LEFT}`);
      text([LEFT - 7, y(tick)], short(tick), { "text-anchor": "end", "dominant-baseline": "central" });
    }
    for (const tick of ticks(0, this.right, this.right / 4)) {
      path(`M${this.x(tick)},${HEIGHT - BOTTOM}v4`);
      text([this.x(tick), HEIGHT - 6], short(tick), { "text-anchor": "middle" });
    }
    for (const [k, line] of lines) {
      const points = line.map((value, i) => value !== null && `${this.x(steps[i]).toFixed(1)},${y(value).toFixed(1)}`);
      const d = points.map((at, i) => at && (points[i - 1] ? "L" : "M") + at).filter(Boolean).join("");
      if (k === null) { path(d, { class: "curve team", "data-robot": "team" }); continue; }
      const stroke = tinted(run.robots[k].colour), last = points.findLast(Boolean);
      path(d, { class: "curve", stroke, "stroke-dasharray": DASHES[k], "data-robot": k + 1 });
      if (last) text(last.split(","), String(k + 1), { class: "end", dx: 5, fill: stroke });
    }
  }

  // Where the shown time step of a bag lies.
  place(step) {
    for (const { picture } of this.charts) {
      picture.querySelector(".here")?.remove();
      picture.append(svg("path", { class: "here", d: `M${this.x(step)},${TOP}V${HEIGHT - BOTTOM}` }));
    }
  }
}
