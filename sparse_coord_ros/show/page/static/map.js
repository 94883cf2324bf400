// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// The map: walls, doorways, starts, goals; what robots learned; where they are; who asks whom.

import { inkOn, shape, svg, tinted, written } from "/draw.js";
import { View } from "/view.js";

const UNIT = 48;
const LINGER_MS = 600; // how long a question stays visible while steps rush by
const RUSH_MS = 250; // steps that follow each other so fast
const SMALLEST = 9; // pixels: a robot's radius
const LAYERS = ["ground", "heat", "marks", "policy", "trails", "differ", "asks", "robots", "met"];

export class TeamMap extends View {
  constructor(element, onCell, buttons) {
    super(element, buttons);
    this.onCell = onCell;
    this.layers = { arrows: false, rings: true, heat: false, trails: true, differ: true };
    this.different = [];
    this.cell = this.peerCell = null;
    element.addEventListener("pointermove", (event) => this.point(event));
    element.addEventListener("click", () => { if (!this.dragged && this.cell !== null) this.pin(this.cell); });
    element.addEventListener("keydown", (event) => this.key(event));
  }

  // Another run: draw what stays.
  begin(run) {
    this.run = run;
    this.shown = new Set(run.robots.length <= 2 ? run.robots.keys() : [0]);
    this.lingering = [];
    this.tables = this.asked = null;
    this.cell = this.peerCell = null;
    this.colours = run.robots.map((robot) => tinted(robot.colour));
    const width = run.map.rows[0].length * UNIT + 6, height = run.map.rows.length * UNIT + 6;
    this.layer = Object.fromEntries(LAYERS.map((name) => [name, svg("g")]));
    this.cursor = svg("rect", { width: UNIT, height: UNIT, class: "cursor", visibility: "hidden" });
    this.peer = svg("rect", { width: UNIT, height: UNIT, class: "cursor peer", visibility: "hidden" });
    this.element.replaceChildren(...Object.values(this.layer), this.peer, this.cursor);
    this.layer.ground.append(svg("rect", { x: -3, y: -3, width, height, class: "wall" }));
    this.element.classList.toggle("built", run.map.under);
    const { href, ...place } = run.map.under ?? {};
    const scaled = Object.entries(place).map(([key, cells]) => [key, cells * UNIT]);
    if (href) this.layer.ground.append(svg("image", { href, preserveAspectRatio: "none", ...Object.fromEntries(scaled) }));
    run.map.cells.forEach((_, n) => this.layer.ground.append(this.square(n, 0, { class: "free", "data-cell": n })));
    for (const cell of run.map.doorways) {
      this.layer.marks.append(this.square(cell, 3, { class: "doorway", stroke: run.doorway_colour }));
    }
    this.corners("start", "S", 9, 11);
    this.corners("goal", "G", UNIT - 9, -11);
    this.bodies = run.robots.map((robot, k) => svg("g", { class: "robot", "data-robot": k + 1, visibility: "hidden" },
      svg("title", {}, robot.name), shape(robot, 13.5), svg("text", { fill: inkOn(robot.colour) }, String(k + 1))));
    this.layer.robots.append(...this.bodies);
    this.frame = null;
    this.show({ x: -3, y: -3, width, height }, 4 * UNIT);
  }

  look() {
    const pixels = super.look();
    this.grown = pixels ? Math.max(1, SMALLEST / (13.5 * pixels)) : 1; // a robot is seen on a large map, too
    this.element.style.setProperty("--grown", this.grown);
    this.element.classList.toggle("far", this.grown > 1.4);
    if (this.frame) this.move(...this.frame);
  }

  square(cell, margin, attributes) {
    const [r, c] = this.run.map.cells[cell];
    const side = UNIT - 2 * margin;
    return svg("rect", { x: c * UNIT + margin, y: r * UNIT + margin, width: side, height: side, ...attributes });
  }

  // Starts and goals as small labels in a cell's corner, side by side where several share a cell.
  corners(what, letter, top, line) {
    this.run.robots.forEach((robot, k) => {
      const place = this.run.robots.slice(0, k).filter((one) => one[what] === robot[what]).length;
      const [r, c] = this.run.map.cells[robot[what]];
      if (what === "goal") {
        const dashes = { "stroke-dasharray": "7 4", "stroke-dashoffset": 3 * place };
        this.layer.marks.append(this.square(robot.goal, 6 - 0.8 * place, { class: "goal", stroke: this.colours[k], ...dashes }));
      }
      const at = { x: c * UNIT + 10 + (place % 4) * 12.5, y: r * UNIT + top + Math.floor(place / 4) * line };
      this.layer.marks.append(svg("text", { ...at, class: "label", fill: written(robot.colour) }, `${letter}${k + 1}`));
    });
  }

  centre(cell) {
    const [r, c] = this.run.map.cells[cell];
    return [(c + 0.5) * UNIT, (r + 0.5) * UNIT];
  }

  // Where each robot is drawn, and how large: beside each other where they share a cell.
  places(cells) {
    return cells.map((cell, k) => {
      if (cell === null) return null;
      const many = cells.filter((other) => other === cell).length;
      const n = cells.slice(0, k).filter((other) => other === cell).length;
      const [x, y] = this.centre(cell), side = Math.ceil(Math.sqrt(many)), gap = UNIT / (side + 0.35);
      const dx = (n % side) - (side - 1) / 2, dy = Math.floor(n / side) - (Math.ceil(many / side) - 1) / 2;
      return [x + dx * gap, y + dy * gap, many === 1 ? 1 : many <= 4 ? 0.76 : 0.52];
    });
  }

  // Where each robot came from: through which cells, as the source knows them.
  trail(frame) {
    const points = (trail, k) => trail.map((cell) => this.centre(cell).map((at) => at + (k % 3 - 1) * 4)).join(" ");
    this.layer.trails.replaceChildren(...frame.trails.map((trail, k) => svg("polyline", {
      class: "trail", stroke: this.colours[k], "data-robot": k + 1, points: this.layers.trails ? points(trail, k) : "" })));
  }

  move(frame, held) {
    this.frame = [frame, held];
    this.trail(frame);
    const places = this.places(frame.cells);
    this.bodies.forEach((body, k) => {
      const place = places[k];
      body.classList.toggle("there", body.getAttribute("visibility") === "visible"); // else it would fly in
      body.setAttribute("visibility", place ? "visible" : "hidden");
      if (!place) return;
      body.style.transform = `translate(${place[0]}px,${place[1]}px) scale(${place[2] * this.grown})`;
      body.dataset.cell = frame.cells[k];
      body.classList.toggle("home", frame.cells[k] === this.run.robots[k].goal);
      body.classList.toggle("asking", frame.asks.some((ask) => ask.robot === k));
    });
    const now = performance.now();
    const asked = new Set(frame.asks.map((ask) => ask.robot));
    const rushing = !held && now - this.moved < RUSH_MS;
    this.moved = now;
    const old = !rushing ? [] : this.lingering.filter((one) => one.until > now && !asked.has(one.ask.robot) && one.step !== frame.step);
    this.lingering = [...old, ...frame.asks.map((ask) => ({ ask, places, until: now + LINGER_MS, step: frame.step }))];
    this.layer.asks.replaceChildren(...this.lingering.filter(({ ask, places }) => places[ask.robot]).map(({ ask, places }) => this.question(ask, places)));
    this.layer.met.replaceChildren(
      ...frame.together.flatMap((cell) => this.meeting(cell)),
      ...frame.exchanges.flatMap((pair) => this.exchange(pair.map((k) => frame.cells[k]))),
      ...frame.stopped.map(([k, , cell]) => this.barrier(frame.cells[k], cell)));
  }

  // A ring around a cell in which robots miscoordinate, and its sign.
  meeting(cell) {
    return this.ring(cell, "met", "✖");
  }

  ring(cell, name, sign) {
    const [x, y] = this.centre(cell);
    return [svg("circle", { cx: x, cy: y, r: UNIT * 0.6 * this.grown, class: name }),
      svg("text", { x: x + UNIT * 0.5, y: y - UNIT * 0.5, class: `${name}-sign` }, sign)];
  }

  // A ring around both cells that robots exchange, and its sign between them.
  exchange(cells) {
    const [[x, y], [x2, y2]] = cells.map((cell) => this.centre(cell));
    const rings = [[x, y], [x2, y2]].map(([cx, cy]) => svg("circle", { cx, cy, r: UNIT * 0.46 * this.grown, class: "met" }));
    return [...rings, svg("text", { x: (x + x2) / 2, y: (y + y2) / 2, class: "met-sign" }, "⇄")];
  }

  // A bar between a robot that is stopped and the cell into which it wants.
  barrier(cell, wanted) {
    const [x, y] = this.centre(cell), [x2, y2] = this.centre(wanted);
    const [mx, my] = [(x + x2) / 2, (y + y2) / 2], [dx, dy] = [0.36 * (y2 - y), 0.36 * (x2 - x)];
    return svg("path", { d: `M${mx - dx},${my - dy}L${mx + dx},${my + dy}`, class: "bar-in-the-way" });
  }

  // Lines from who asks to whom it asks; the sign is between two that are apart, else beside the asker.
  question(ask, places) {
    const { colour, sign } = this.run.outcomes[ask.outcome];
    const [x, y] = places[ask.robot];
    const ends = ask.peers.map((peer) => places[peer]).filter(Boolean);
    const group = svg("g", { class: "ask", "data-outcome": ask.outcome, "data-robot": ask.robot + 1, stroke: tinted(colour) },
      svg("title", {}, `${this.run.robots[ask.robot].name}: ${ask.ended}`),
      ...ends.map(([x2, y2]) => svg("line", { x1: x, y1: y, x2, y2 })));
    if (!ask.peers.length) group.append(svg("circle", { cx: x, cy: y, r: 21, class: "nobody" }));
    const [[px, py]] = ends.length === 1 ? ends : [[x, y]];
    const apart = Math.hypot(px - x, py - y) > 1.2 * UNIT;
    const [sx, sy] = apart ? [(x + px) / 2, (y + py) / 2] : [x + UNIT * 0.4, y - UNIT * 0.4];
    group.append(svg("g", { transform: `translate(${sx},${sy}) scale(${this.grown})` },
      svg("circle", { r: 9.5, fill: colour, class: "badge" }), svg("text", { stroke: "none" }, sign)));
    return group;
  }

  // What the robots learned.
  policy(tables) {
    this.tables = tables;
    this.layer.policy.replaceChildren();
    const robots = [...this.shown].filter((k) => tables?.robots[k]);
    robots.forEach((k, n) => {
      const own = tables.robots[k];
      const look = { stroke: this.colours[k], "data-robot": k + 1 };
      const shift = (n - (robots.length - 1) / 2) * Math.min(9, 26 / robots.length);
      for (const cell of this.layers.rings ? own.asks : []) {
        const [cx, cy] = this.centre(cell);
        const dashes = n ? `${3 + 2 * n} 3` : "none";
        this.layer.policy.append(svg("circle", { cx, cy, r: UNIT * 0.44 - n * 3, class: own.enters.includes(cell) ? "ring" : "ring pale", "stroke-dasharray": dashes, ...look }));
      }
      if (n) look["stroke-dasharray"] = n % 2 ? "3.5 4.5" : "0.1 4.5"; // round caps
      const enters = new Set(own.enters), lines = { arrow: [], "arrow pale": [] };
      (this.layers.arrows ? own.moves : []).forEach((moves, cell) => {
        if (moves.every((best) => best)) return; // nothing is known there yet
        this.run.directions.forEach(([dy, dx], move) => {
          if (!moves[move]) return;
          const [x, y] = this.centre(cell), at = (along, across) =>
            `${x + Math.abs(dy) * shift + along * dx - across * dy},${y + Math.abs(dx) * shift + along * dy + across * dx}`;
          lines[enters.has(cell) ? "arrow" : "arrow pale"].push(`M${at(-4, 0)}L${at(15, 0)}M${at(10, -5)}L${at(15, 0)}L${at(10, 5)}`);
        });
      });
      for (const [name, parts] of Object.entries(lines)) {
        if (parts.length) this.layer.policy.append(svg("path", { d: parts.join(""), class: name, ...look }));
      }
    });
  }

  heat(asked) {
    this.asked = asked;
    const robots = [...this.shown].filter((k) => this.layers.heat && asked?.robots[k]);
    const most = Math.max(1, ...robots.flatMap((k) => asked.robots[k]));
    const width = UNIT / robots.length;
    this.layer.heat.replaceChildren(...robots.flatMap((k, n) => asked.robots[k].flatMap((count, cell) => {
      const [r, c] = this.run.map.cells[cell];
      const look = { fill: this.colours[k], "fill-opacity": (0.08 + 0.5 * Math.sqrt(count / most)).toFixed(3) };
      return count ? [svg("rect", { x: c * UNIT + n * width, y: r * UNIT, width, height: UNIT, ...look })] : [];
    })));
  }

  // Cells in which another run's robots do something else: of each cell what they do, in words.
  mark(cells) {
    this.different = cells;
    this.layer.differ.replaceChildren(...(this.layers.differ ? [...cells] : []).map(([cell, words]) => {
      const [r, c] = this.run.map.cells[cell], x = (c + 1) * UNIT, y = r * UNIT;
      return svg("path", { class: "differs", d: `M${x - 15},${y + 1}H${x - 1}V${y + 15}Z` }, svg("title", {}, words));
    }));
  }

  redraw() {
    this.mark(this.different);
    if (this.frame) this.trail(this.frame[0]);
    this.policy(this.tables);
    this.heat(this.asked);
  }

  choose(cell) {
    if (cell === this.cell) return;
    this.cell = cell;
    this.frameCell(this.cursor, cell);
    this.onCell();
  }

  // Puts the peer in a cell; in the same one again: takes it away.
  pin(cell) {
    this.peerCell = cell === this.peerCell ? null : cell;
    this.frameCell(this.peer, this.peerCell);
    this.onCell();
  }

  frameCell(mark, cell) {
    const [r, c] = this.run.map.cells[cell] ?? [0, 0];
    const look = { x: c * UNIT, y: r * UNIT, visibility: cell === null ? "hidden" : "visible" };
    for (const [name, value] of Object.entries(look)) mark.setAttribute(name, value);
  }

  point(event) {
    if (this.drag(event)) return;
    const under = document.elementsFromPoint(event.clientX, event.clientY).find((one) => one.matches(".free"));
    if (under) this.choose(Number(under.dataset.cell));
  }

  key(event) {
    if (event.key === "Enter" && this.cell !== null) return this.pin(this.cell);
    const move = ["ArrowUp", "ArrowDown", "ArrowRight", "ArrowLeft"].indexOf(event.key);
    if (move < 0 || !this.run) return;
    event.preventDefault();
    event.stopPropagation();
    if (this.cell === null) return this.choose(0);
    const { cells, rows } = this.run.map, [dr, dc] = this.run.directions[move];
    let [r, c] = cells[this.cell];
    do { // over walls to the next free cell
      [r, c] = [r + dr, c + dc];
      const next = cells.findIndex(([row, column]) => row === r && column === c);
      if (next >= 0) return this.choose(next);
    } while (rows[r]?.[c] !== undefined);
  }
}
