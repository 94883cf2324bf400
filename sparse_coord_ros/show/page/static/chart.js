// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// A chart: lines over learning steps, with the titles of both axes. A pointer shows the values.

import { html, svg, ticks } from "/draw.js";

const WIDTH = 300, HEIGHT = 170, LEFT = 46, RIGHT = 26, TOP = 10, BOTTOM = 38;
const LABEL = 11; // the height of a label

const known = (values) => values.filter((v) => v !== null);
const short = (n) => n.toLocaleString("en", { notation: "compact", maximumSignificantDigits: 3 });

// Labels at the ends of lines, moved up so that none covers another one.
function apart(ends) {
  const found = ends.toSorted((a, b) => b.at[1] - a.at[1]);
  for (let i = 1; i < found.length; i++) found[i].at[1] = Math.min(found[i].at[1], found[i - 1].at[1] - LABEL);
  return found;
}

export class Chart {
  // The title says what is drawn, and in which unit; the range holds values that the axis shows at least.
  // Calls point with the learning step under the pointer, and with null where it leaves.
  constructor(holder, title, range, point) {
    this.range = range;
    this.lines = [];
    this.right = 1; // the last learning step
    this.value = html("p");
    this.picture = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${title} over learning steps` });
    this.value.className = "value";
    this.section = html("section", { className: "chart" }, html("h2", {}, title), this.value, this.picture);
    holder.append(this.section);
    this.picture.addEventListener("pointermove", (event) => point(this.under(event)));
    this.picture.addEventListener("pointerleave", () => point(null));
  }

  // Each line has steps, values (null: not known), attributes of its path, a label at its end and the colour of its letters.
  show(lines) {
    this.lines = lines;
    this.right = Math.max(1, ...lines.map((line) => line.steps.at(-1) ?? 1));
    const path = (d, look) => this.picture.append(svg("path", { d, class: "axis", ...look }));
    const text = (at, words, look) => this.picture.append(svg("text", { class: "tick", x: at[0], y: at[1], ...look }, words));
    this.picture.replaceChildren();
    path(`M${LEFT},${TOP}V${HEIGHT - BOTTOM}H${WIDTH - RIGHT}`);
    text([(LEFT + WIDTH - RIGHT) / 2, HEIGHT - 5], "learning step", { "text-anchor": "middle" });
    const values = [...known(lines.flatMap((line) => line.values)), ...this.range];
    if (!values.length) return;
    const low = Math.min(...values), most = Math.max(...values), high = most > low ? most : low + 1;
    this.y = (value) => TOP + (HEIGHT - TOP - BOTTOM) * (1 - (value - low) / (high - low));
    for (const tick of ticks(low, high, (high - low) / 4)) {
      path(`M${LEFT - 4},${this.y(tick)}H${LEFT}`);
      text([LEFT - 7, this.y(tick)], short(tick), { "text-anchor": "end", "dominant-baseline": "central" });
    }
    for (const tick of ticks(0, this.right, this.right / 4)) {
      path(`M${this.x(tick)},${HEIGHT - BOTTOM}v4`);
      text([this.x(tick), HEIGHT - BOTTOM + 15], short(tick), { "text-anchor": "middle" });
    }
    const ends = [];
    for (const { steps, values, look, label, ink } of lines) {
      const points = values.map((value, i) => value !== null && `${this.x(steps[i]).toFixed(1)},${this.y(value).toFixed(1)}`);
      const d = points.map((at, i) => at && (points[i - 1] ? "L" : "M") + at).filter(Boolean).join("");
      path(d, { class: "curve", ...look });
      const last = points.findLast(Boolean);
      if (last && label) ends.push({ at: last.split(",").map(Number), label, fill: ink ?? look.stroke ?? "currentcolor" });
    }
    for (const { at, label, fill } of apart(ends)) text(at, label, { class: "end", dx: 5, fill });
    this.value.textContent = this.ends();
  }

  ends() {
    return this.named(this.lines.map((line) => known(line.values).at(-1) ?? null));
  }

  // A value of each line, with the line's label.
  named(values) {
    const one = (value, { label }) => `${label ? `${label}: ` : ""}${value === null ? "–" : value.toFixed(2)}`;
    return values.map((value, i) => one(value, this.lines[i])).join(" · ");
  }

  x(step) {
    return LEFT + ((WIDTH - LEFT - RIGHT) * Math.min(step, this.right)) / this.right;
  }

  // Where the shown steps lie, one for each look.
  place(steps, looks = [{}]) {
    this.picture.querySelectorAll(".here").forEach((line) => line.remove());
    steps.forEach((step, i) => step !== null && this.picture.append(
      svg("path", { class: "here", d: `M${this.x(step)},${TOP}V${HEIGHT - BOTTOM}`, ...looks[i] })));
  }

  // The learning step under the pointer.
  under(event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.picture.getScreenCTM().inverse()).x;
    return Math.min(this.right, (Math.max(0, at - LEFT) * this.right) / (WIDTH - LEFT - RIGHT));
  }

  // The values at a learning step; null: at the ends.
  read(step) {
    this.picture.querySelectorAll(".pointed").forEach((one) => one.remove());
    if (step === null || !this.lines.some((line) => line.steps.length)) {
      this.value.textContent = this.ends();
      return;
    }
    const places = this.lines.map((line) => line.steps.findLastIndex((one) => one <= step));
    const found = this.lines.map((line, i) => line.values[places[i]] ?? null);
    this.picture.append(svg("path", { class: "pointed", d: `M${this.x(step)},${TOP}V${HEIGHT - BOTTOM}` }));
    found.forEach((value, i) => value !== null && this.picture.append(
      svg("circle", { class: "pointed", cx: this.x(this.lines[i].steps[places[i]]), cy: this.y(value), r: 3 })));
    this.value.textContent = `${this.named(found)} at step ${short(Math.round(step))}`;
  }
}
