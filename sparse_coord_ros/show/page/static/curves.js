// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// Learning curves: each point is the mean of some episodes, as `run.history` has them.

import { Chart } from "/chart.js";
import { tinted, written } from "/draw.js";

const DASHES = ["", "6 3", "2 3", "8 3 2 3", "12 4", "4 7", "9 3 2 3 2 3", "1 5"];

// What is drawn: the key of the message, the title with its unit, values that the axis shows at least.
const CURVES = [
  ["length", "Steps of an episode", [0, 1]],
  ["miscoordinations", "Miscoordinations of an episode", [0, 1]],
  ["asks", "Questions of a robot", [0, 1]],
];

// The mean over robots, at each point over those that were there.
const mean = (lines) => lines[0].map((_, i) => meanOf(lines.map((line) => line[i])));

// The mean of the values that are known; null: none is.
function meanOf(values) {
  const known = values.filter((v) => v !== null);
  return known.length ? known.reduce((a, b) => a + b) / known.length : null;
}

const COMPARED = 40; // the points of a curve of several runs: noise hides how they differ in more

// Where groups of as many points begin as leave so few; the first group may be smaller.
function groupsOf(count) {
  const size = Math.max(1, Math.ceil(count / COMPARED));
  return [...Array(count).keys()].filter((i) => i === 0 || (count - i) % size === 0);
}

export class Curves {
  constructor(element) {
    // All charts show the values at the learning step to which the pointer points in one.
    const point = (step) => this.charts.forEach(([, chart]) => chart.read(step));
    this.charts = CURVES.map(([key, title, range]) => [key, new Chart(element, title, range, point)]);
  }

  // The curves of the team; of robots: of two both, of more their mean and those that are shown.
  show(message, run, shown) {
    const steps = message?.step ?? [];
    for (const [key, chart] of this.charts) {
      const values = message?.[key] ?? [];
      const robots = Array.isArray(values[0]) ? [...values.entries()] : [];
      const few = robots.length <= 2;
      const lines = (few ? robots : robots.filter(([k]) => shown.has(k))).map(([k, line]) => ({
        steps, values: line, label: String(k + 1), ink: written(run.robots[k].colour),
        look: { stroke: tinted(run.robots[k].colour), "stroke-dasharray": DASHES[k], "data-robot": k + 1 } }));
      const team = (line) => ({ steps, values: line, look: { class: "curve team", "data-robot": "team" } });
      if (!few) lines.unshift(team(mean(values)));
      if (values.length && !robots.length) lines.push(team(values));
      chart.show(lines);
    }
  }

  // Of several runs, each with its message, label and look: the means over the robots, and over neighbouring points.
  compare(runs) {
    for (const [key, chart] of this.charts) {
      chart.show(runs.filter(({ message }) => message).map(({ message, label, look }) => {
        const values = message[key] ?? [];
        const team = Array.isArray(values[0]) ? mean(values) : values;
        const begins = groupsOf(team.length);
        const means = begins.map((begin, i) => meanOf(team.slice(begin, begins[i + 1])));
        return { steps: begins.map((begin) => message.step[begin]), values: means, label, look };
      }));
    }
  }

  // Curves that there are: by the kinds of marks that the runs can have.
  begin(kinds) {
    const of = new Map(this.charts);
    of.get("miscoordinations").section.hidden = !kinds.includes("miscoordination");
  }

  // Where the shown steps lie.
  place(steps, looks) {
    for (const [, chart] of this.charts) chart.place(steps, looks);
  }
}
