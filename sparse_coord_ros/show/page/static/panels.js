// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// What stands beside the map in words and numbers: Q* of a cell, questions, the team's value.

import { $, html, number, tinted, written } from "/draw.js";

const row = (kind, texts) => html("tr", {}, ...texts.map((text) => html(kind, {}, text)));

// Q* of a cell, a row a robot; and Q^C, where the peer is in a cell, too.
export function cellPanel(run, tables, pointed, { cell, peerCell }) {
  const chosen = cell !== null && tables;
  const place = (one) => { const [r, c] = run.map.cells[one]; return `cell ${one} [${r}, ${c}]`; };
  const known = chosen && pointed?.cell === cell && pointed.peer_cell === peerCell ? pointed.robots : [];
  $("cell-hint").hidden = chosen && peerCell !== null;
  $("cell-title").textContent = !chosen ? "Q* of a cell"
    : peerCell === null ? `Q* of ${place(cell)}` : `Q* of ${place(cell)}, Q^C with the peer in ${place(peerCell)}`;
  const names = run.actions.map((name) => (name === "coordinate" ? "ask" : name));
  const rows = chosen ? [row("th", ["robot", ...names])] : [];
  const said = [];
  for (const [k, own] of chosen ? tables.robots.entries() : []) {
    if (!own) continue;
    const { name, colour } = run.robots[k];
    if (same(own.q_star[cell])) { // as they were before learning
      rows.push(unlearnedRow(`${name} Q*`, k, names.length));
      continue;
    }
    rows.push(valuesRow(`${name} Q*`, own.q_star[cell], k, colour));
    const { q_coord = null, without, with: answered } = known[k] ?? {};
    if (!q_coord) continue;
    if (same(q_coord)) {
      rows.push(unlearnedRow(`${name} Q^C`, k, names.length));
      continue;
    }
    rows.push(valuesRow(`${name} Q^C`, [...q_coord, null], k, colour));
    const moves = (found) => found.map((one) => names[one]).join(" or ");
    said.push(moves(answered) === moves(without) ? `${name}: the answer changes nothing; it goes ${moves(without)}.`
      : `${name} goes ${moves(without)} without asking, ${moves(answered)} with the answer.`);
  }
  $("cell").tBodies[0].replaceChildren(...rows);
  $("asking").textContent = said.join(" ");
}

const same = (values) => values.filter((v) => v !== null).every((v) => v === values[0]);

function unlearnedRow(title, k, columns) {
  const one = html("tr", {}, html("td", {}, title), html("td", { colSpan: columns }, "never learned"));
  one.dataset.robot = k + 1;
  return one;
}

function valuesRow(title, values, k, colour) {
  const best = Math.max(...values.filter((v) => v !== null));
  const one = row("td", [title, ...values.map((v) => (v === null ? "–" : v.toFixed(2)))]);
  values.forEach((v, i) => { if (v === best) one.cells[i + 1].className = "best"; });
  one.cells[0].style.color = written(colour);
  one.dataset.robot = k + 1;
  return one;
}

// How old what the robots learned is: tables come now and then, and a log is read bit by bit.
export function agesPanel(run, tables, frame) {
  const ages = (tables?.robots ?? []).map((own) => {
    if (!own) return "not known";
    if (own.step === null) return "at the end of learning";
    const age = frame ? frame.step - own.step : 0;
    return age > 0 ? `about ${number(age)} steps old` : "of this step";
  });
  const same = new Set(ages).size === 1;
  const words = same ? ages[0] : ages.map((age, k) => `${run.robots[k].name}: ${age}`).join("; ");
  const lines = ages.length ? [`Tables ${words}.`] : [];
  if (frame?.counted_to < frame?.step) {
    lines.push("Episodes and questions are not yet counted up to this step.");
  }
  $("ages").textContent = lines.join(" ");
}

// What was learned, in two sentences; where one may, buttons to see it again, or all from the start.
export function learnedPanel(learned, jump) {
  $("learned").hidden = !learned;
  if (!learned) return;
  const button = (words, what) => html("button", { type: "button", onclick: what }, words);
  const seek = (at) => { $("seek").value = at; $("seek").dispatchEvent(new Event("input")); };
  $("learned").replaceChildren(html("b", {}, learned.lines.join(" ")), ...(jump && learned.first !== null ? [
    button("See it again", () => jump("learned")), button("From the start", () => seek(0))] : []));
}

export function dialoguePanel(run, { entries = [], since = null }) {
  $("silence").hidden = entries.length > 0;
  const shown = run.source === "bag" ? "" : " shown"; // a live page shows some of them
  $("silence").textContent = since === null ? `No question${shown} so far.` : `No question since step ${number(since)}.`;
  const held = document.activeElement.closest("#dialogue li")?.dataset.key;
  const opened = new Set([...$("dialogue").children].filter((item) => item.querySelector("details").open).map((item) => item.dataset.key));
  $("dialogue").replaceChildren(...entries.toReversed().map((entry) => {
    const { sign, colour } = run.outcomes[entry.outcome];
    const mark = html("span", { className: "sign" }, `${sign} `);
    mark.style.color = written(colour);
    const item = html("li", {}, mark, html("span", { className: "at" }, entry.made === null ? "" : `step ${number(entry.made)}: `), entry.text,
      html("details", { open: opened.has(`${entry.step} ${entry.robot}`) }, html("summary", {}, "details"), entry.lines.join("; ")));
    item.dataset.key = `${entry.step} ${entry.robot}`;
    item.style.borderColor = tinted(run.robots[entry.robot].colour);
    return item;
  }));
  const same = [...$("dialogue").children].find((item) => item.dataset.key === held);
  same?.querySelector("summary").focus({ preventScroll: true });
}

// What the yardsticks are, where they stand: teams that were found, and what no team can exceed.
const YARDSTICKS = {
  "best asking team found": "the best found by a search whose robots see each other only by asking; better ones may exist",
  "best learned team": "the best of many teams that learned; better ones may exist",
  "exact joint optimum": "every robot sees all others for free: no team has a higher value",
  "bound (robots alone)": "each robot alone in the world: no team has a higher value",
};

export function evaluationPanel(run, e) {
  $("evaluation-panel").hidden = !e;
  if (!e) return;
  const known = e.yardsticks.map(([name, value]) => {
    const one = row("td", ["", value.toFixed(2)]);
    one.cells[0].append(name, html("small", {}, YARDSTICKS[name] ?? ""));
    return one;
  });
  $("evaluation").replaceChildren(
    row("th", ["measure", `${e.learner}, ${e.cells.source}${e.source === "trials" ? " (standard errors)" : ""}`]),
    row("td", ["discounted return of a robot", e.cells.return]),
    ...known,
    row("td", ["time to goal", e.cells["time to goal"]]),
    ...(run.kinds.includes("miscoordination") ? [row("td", ["miscoordinations", e.cells.miscoordinations])] : []),
    row("td", ["questions of a robot", e.cells.asks]),
    row("td", ["all arrive", e.cells["all arrive"]]),
    html("caption", {}, e.verdict));
  $("evaluation-of").textContent = e.step === null ? "at the end of learning" : "by the newest tables";
}
