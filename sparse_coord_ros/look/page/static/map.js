// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// The map: walls, doorways, starts, goals; what robots learned; where they are; who asks whom.

import { inkOn, shape, svg, tinted } from "/draw.js";

const UNIT = 48;
const LINGER_MS = 600; // how long a question stays visible while steps rush by

export class TeamMap {
  constructor(element, onCell) {
    this.element = element;
    this.onCell = onCell;
    this.run = null;
    this.shown = new Set();
    this.layers = { arrows: true, rings: true, heat: true };
    this.lingering = [];
    this.cursorCell = null;
    element.addEventListener("pointermove", (event) => this.point(event));
    element.addEventListener("keydown", (event) => this.key(event));
  }

  // Another run, or another theme: draw what stays.
  begin(run) {
    this.run = run;
    this.frame = null;
    this.numbers = new Map(run.map.cells.map(([r, c], n) => [`${r},${c}`, n]));
    this.colours = run.robots.map((robot) => tinted(robot.colour));
    const rows = run.map.rows.length, columns = run.map.rows[0].length;
    this.element.setAttribute("viewBox", `-3 -3 ${columns * UNIT + 6} ${rows * UNIT + 6}`);
    this.element.replaceChildren();
    const layer = (name) => {
      const group = svg("g", { class: `layer-${name}` });
      this.element.append(group);
      return group;
    };
    const ground = layer("ground");
    ground.append(svg("rect", { x: -3, y: -3, width: columns * UNIT + 6, height: rows * UNIT + 6, class: "wall" }));
    run.map.cells.forEach(([r, c], n) => {
      ground.append(svg("rect", { x: c * UNIT, y: r * UNIT, width: UNIT, height: UNIT, class: "free", "data-cell": n }));
    });
    this.heatLayer = layer("heat");
    const marks = layer("marks");
    for (const cell of run.map.doorways) {
      const [r, c] = run.map.cells[cell];
      marks.append(svg("rect", { x: c * UNIT + 3, y: r * UNIT + 3, width: UNIT - 6, height: UNIT - 6, class: "doorway", stroke: run.doorway_colour }));
    }
    this.corner(marks, "start", "S");
    this.corner(marks, "goal", "G");
    this.policyLayer = layer("policy");
    this.askLayer = layer("asks");
    this.robotLayer = layer("robots");
    this.metLayer = layer("met");
    this.cursor = svg("rect", { width: UNIT, height: UNIT, class: "cursor", visibility: "hidden" });
    this.element.append(this.cursor);
    this.bodies = run.robots.map((robot, k) => {
      const body = shape(robot.shape, 13.5);
      body.setAttribute("class", "body");
      body.setAttribute("fill", this.colours[k]);
      const label = svg("text", { fill: inkOn(this.colours[k]) }, String(k + 1));
      const group = svg("g", { class: "robot", "data-robot": k + 1, visibility: "hidden" },
        svg("title", {}, robot.name), body, label);
      this.robotLayer.append(group);
      return group;
    });
  }

  // Starts and goals as small labels in a cell's corner, side by side where several share a cell.
  corner(marks, what, letter) {
    const used = new Map();
    this.run.robots.forEach((robot, k) => {
      const cell = robot[what];
      const place = used.get(cell) ?? 0;
      used.set(cell, place + 1);
      const [r, c] = this.run.map.cells[cell];
      const x = c * UNIT + 10 + (place % 4) * 12.5;
      const y = r * UNIT + (what === "start" ? 9 : UNIT - 9) + Math.floor(place / 4) * (what === "start" ? 11 : -11);
      if (what === "goal") {
        marks.append(svg("rect", { x: c * UNIT + 6 - place * 0.8, y: r * UNIT + 6 - place * 0.8, width: UNIT - 12 + place * 1.6, height: UNIT - 12 + place * 1.6, class: "goal", stroke: this.colours[k], "stroke-dasharray": "7 4", "stroke-dashoffset": 3 * place }));
      }
      const label = svg("text", { x, y, class: "label", fill: this.colours[k] }, `${letter}${k + 1}`);
      label.append(svg("title", {}, `${what} of ${robot.name}`));
      marks.append(label);
    });
  }

  centre(cell) {
    const [r, c] = this.run.map.cells[cell];
    return [(c + 0.5) * UNIT, (r + 0.5) * UNIT];
  }

  // Where each robot is drawn: beside each other where they share a cell.
  places(cells) {
    const together = new Map();
    cells.forEach((cell, k) => {
      if (cell === null) return;
      if (!together.has(cell)) together.set(cell, []);
      together.get(cell).push(k);
    });
    const places = cells.map(() => null);
    for (const [cell, robots] of together) {
      const [x, y] = this.centre(cell);
      const side = Math.ceil(Math.sqrt(robots.length));
      const scale = robots.length === 1 ? 1 : robots.length <= 4 ? 0.76 : 0.52;
      robots.forEach((k, n) => {
        const gap = UNIT / (side + 0.35);
        const dx = robots.length === 1 ? 0 : ((n % side) - (side - 1) / 2) * gap;
        const dy = robots.length === 1 ? 0 : (Math.floor(n / side) - (Math.ceil(robots.length / side) - 1) / 2) * gap;
        places[k] = [x + dx, y + dy, scale];
      });
    }
    return places;
  }

  move(frame, held) {
    this.frame = frame;
    const places = this.places(frame.cells);
    this.bodies.forEach((body, k) => {
      const place = places[k];
      body.setAttribute("visibility", place ? "visible" : "hidden");
      if (!place) return;
      body.style.transform = `translate(${place[0]}px,${place[1]}px) scale(${place[2]})`;
      body.setAttribute("data-cell", frame.cells[k]);
      body.classList.toggle("home", frame.cells[k] === this.run.robots[k].goal);
      body.classList.toggle("asking", frame.asks.some((ask) => ask.robot === k));
    });
    const now = performance.now();
    const fresh = frame.asks.map((ask) => ({ ask, until: now + LINGER_MS, step: frame.step }));
    const asked = new Set(frame.asks.map((ask) => ask.robot));
    const old = held ? [] : this.lingering.filter((one) => one.until > now && !asked.has(one.ask.robot) && one.step !== frame.step);
    this.lingering = [...old, ...fresh];
    this.drawAsks(places);
    this.metLayer.replaceChildren();
    if (frame.miscoordination) this.drawMet(frame);
  }

  drawAsks(places) {
    this.askLayer.replaceChildren();
    for (const { ask } of this.lingering) {
      const from = places[ask.robot];
      if (!from) continue;
      const said = this.run.outcomes[ask.outcome];
      const colour = tinted(said.colour);
      const group = svg("g", { class: "ask", "data-outcome": ask.outcome, "data-robot": ask.robot + 1, stroke: colour });
      group.append(svg("title", {}, `${this.run.robots[ask.robot].name}: ${ask.ended}`));
      const badge = (x, y) => {
        group.append(svg("circle", { cx: x, cy: y, r: 9.5, fill: said.colour, class: "badge" }));
        group.append(svg("text", { x, y, stroke: "none" }, said.sign));
      };
      for (const peer of ask.peers) {
        const to = places[peer];
        if (!to) continue;
        group.append(svg("line", { x1: from[0], y1: from[1], x2: to[0], y2: to[1] }));
        if (ask.peers.length > 1) continue;
        if (Math.hypot(to[0] - from[0], to[1] - from[1]) > 1.2 * UNIT) badge((from[0] + to[0]) / 2, (from[1] + to[1]) / 2);
        else badge(from[0] + UNIT * 0.42, from[1] - UNIT * 0.42);
      }
      if (!ask.peers.length) group.append(svg("circle", { cx: from[0], cy: from[1], r: 21, class: "nobody" }));
      if (ask.peers.length !== 1) badge(from[0] + 17, from[1] - 17);
      this.askLayer.append(group);
    }
  }

  drawMet(frame) {
    const cells = frame.after ?? frame.cells;
    const doors = new Set(this.run.map.doorways);
    for (const cell of new Set(cells.filter((cell) => doors.has(cell)))) {
      const [x, y] = this.centre(cell);
      this.metLayer.append(svg("circle", { cx: x, cy: y, r: UNIT * 0.6, class: "met" }));
      this.metLayer.append(svg("text", { x: x + UNIT * 0.5, y: y - UNIT * 0.5, class: "met-sign" }, "✖"));
    }
  }

  // What the robots learned.
  policy(tables) {
    this.tables = tables;
    if (!this.run || !tables) return;
    this.policyLayer.replaceChildren();
    const robots = [...this.shown].filter((k) => tables.robots[k]);
    robots.forEach((k, n) => {
      const own = tables.robots[k];
      const colour = this.colours[k];
      const shift = robots.length === 1 ? 0 : (n - (robots.length - 1) / 2) * Math.min(9, 26 / robots.length);
      if (this.layers.rings) {
        for (const cell of own.asks) {
          const [x, y] = this.centre(cell);
          const ring = svg("circle", { cx: x, cy: y, r: UNIT * 0.44 - n * 3, class: "ring", stroke: colour, "data-robot": k + 1 });
          if (n) ring.setAttribute("stroke-dasharray", `${3 + 2 * n} 3`);
          this.policyLayer.append(ring);
        }
      }
      if (!this.layers.arrows) return;
      own.moves.forEach((moves, cell) => {
        if (moves.every((best) => best)) return; // nothing is known there yet
        const [x, y] = this.centre(cell);
        moves.forEach((best, move) => {
          if (!best) return;
          const [dx, dy] = [[0, -1], [0, 1], [1, 0], [-1, 0]][move];
          const [cx, cy] = [x + Math.abs(dy) * shift, y + Math.abs(dx) * shift];
          const reach = 15, head = 5;
          const [tx, ty] = [cx + dx * reach, cy + dy * reach];
          const path = `M${cx - dx * 4},${cy - dy * 4}L${tx},${ty}` +
            `M${tx - dx * head + dy * head},${ty - dy * head + dx * head}L${tx},${ty}L${tx - dx * head - dy * head},${ty - dy * head - dx * head}`;
          const arrow = svg("path", { d: path, class: "arrow", stroke: colour, "data-robot": k + 1 });
          if (n) arrow.setAttribute("stroke-dasharray", n % 2 ? "3.5 4.5" : "0.1 4.5"); // round caps
          this.policyLayer.append(arrow);
        });
      });
    });
  }

  heat(asked) {
    this.asked = asked;
    if (!this.run) return;
    this.heatLayer.replaceChildren();
    if (!asked || !this.layers.heat) return;
    const robots = [...this.shown].filter((k) => asked.robots[k]);
    const most = Math.max(1, ...robots.flatMap((k) => asked.robots[k]));
    const width = UNIT / Math.max(1, robots.length);
    robots.forEach((k, n) => {
      asked.robots[k].forEach((count, cell) => {
        if (!count) return;
        const [r, c] = this.run.map.cells[cell];
        this.heatLayer.append(svg("rect", {
          x: c * UNIT + n * width, y: r * UNIT, width, height: UNIT, fill: this.colours[k],
          "fill-opacity": (0.08 + 0.5 * Math.sqrt(count / most)).toFixed(3),
          "data-robot": k + 1, "data-count": count,
        }));
      });
    });
  }

  redraw() {
    this.policy(this.tables);
    this.heat(this.asked);
  }

  choose(cell) {
    if (!this.run || cell === this.cursorCell) return;
    this.cursorCell = cell;
    this.cursor.setAttribute("visibility", cell === null ? "hidden" : "visible");
    if (cell !== null) {
      const [r, c] = this.run.map.cells[cell];
      this.cursor.setAttribute("x", c * UNIT);
      this.cursor.setAttribute("y", r * UNIT);
    }
    this.onCell(cell);
  }

  point(event) {
    if (!this.run) return;
    const matrix = this.element.getScreenCTM();
    if (!matrix) return;
    const place = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
    const cell = this.numbers.get(`${Math.floor(place.y / UNIT)},${Math.floor(place.x / UNIT)}`);
    if (cell !== undefined) this.choose(cell);
  }

  key(event) {
    const step = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowRight: [0, 1], ArrowLeft: [0, -1] }[event.key];
    if (!step || !this.run) return;
    event.preventDefault();
    event.stopPropagation();
    if (this.cursorCell === null) return this.choose(0);
    let [r, c] = this.run.map.cells[this.cursorCell];
    const rows = this.run.map.rows.length, columns = this.run.map.rows[0].length;
    do { // over walls to the next free cell
      [r, c] = [r + step[0], c + step[1]];
      const cell = this.numbers.get(`${r},${c}`);
      if (cell !== undefined) return this.choose(cell);
    } while (r >= 0 && c >= 0 && r < rows && c < columns);
  }
}
