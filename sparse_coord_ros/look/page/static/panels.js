// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// What stands beside the map in words and numbers: Q* of a cell, questions, the team's value.

import { $, number, tinted } from "/draw.js";

// The row of Q* of a cell; null: none is chosen.
export function cellPanel(run, tables, cell) {
  const body = $("cell").tBodies[0];
  $("cell-hint").hidden = cell !== null;
  $("ages").hidden = !tables;
  if (cell === null || !tables) {
    $("cell-title").textContent = "Q* of a cell";
    body.replaceChildren();
    return;
  }
  const [r, c] = run.map.cells[cell];
  $("cell-title").textContent = `Q* of cell ${cell} [${r}, ${c}]`;
  const rows = [row("th", ["", ...run.actions.map((name) => (name === "coordinate" ? "ask" : name))])];
  tables.robots.forEach((own, k) => {
    if (!own) return;
    const values = own.q_star[cell];
    const best = Math.max(...values.filter((v) => v !== null));
    const one = row("td", [run.robots[k].name, ...values.map((v) => (v === null ? "–" : v.toFixed(2)))]);
    values.forEach((v, i) => { if (v !== null && v === best) one.cells[i + 1].className = "best"; });
    one.cells[0].style.color = tinted(run.robots[k].colour);
    one.dataset.robot = k + 1;
    rows.push(one);
  });
  body.replaceChildren(...rows);
}

// How old what the robots learned is: tables come now and then.
export function agesPanel(run, tables, frame) {
  if (!tables) return;
  const ages = tables.robots.map((own) => {
    if (!own) return "no tables";
    const age = frame ? frame.step - own.step : 0;
    return age > 0 ? `step ${number(own.step)}, ${number(age)} ago` : `step ${number(own.step)}`;
  });
  const same = ages.every((age) => age === ages[0]);
  $("ages").textContent = `Tables of ${same ? ages[0] : ages.map((age, k) => `${run.robots[k].name}: ${age}`).join("; ")}.`;
}

function row(kind, texts) {
  const one = document.createElement("tr");
  one.append(...texts.map((text) => {
    const cell = document.createElement(kind);
    cell.textContent = text;
    return cell;
  }));
  return one;
}

export function dialoguePanel(run, entries) {
  $("silence").hidden = entries.length > 0;
  $("dialogue").replaceChildren(...entries.toReversed().map((entry) => {
    const item = document.createElement("li");
    const said = run.outcomes[entry.outcome];
    item.style.borderColor = tinted(run.robots[entry.robot].colour);
    const at = document.createElement("span");
    at.className = "at";
    at.textContent = `step ${entry.step}: `;
    const sign = document.createElement("span");
    sign.className = "sign";
    sign.style.color = tinted(said.colour);
    sign.textContent = `${said.sign} `;
    item.append(sign, at, entry.lines.join("; "));
    return item;
  }));
}

export function evaluationPanel(e) {
  $("evaluation-panel").hidden = !e;
  if (!e) return;
  const pair = (one) => `${one.mean.toFixed(2)} ± ${one.spread.toFixed(2)}`;
  const beside = e.yardsticks.map(([name, value]) => [name, value.toFixed(2)]);
  const none = beside.map(() => "");
  $("evaluation").replaceChildren(
    row("th", ["", `${e.learner}, ${e.how}`, ...beside.map(([name]) => name)]),
    row("td", ["reward", pair(e.reward), ...beside.map(([, value]) => value)]),
    row("td", ["time to goal", pair(e.time_to_goal), ...none]),
    row("td", ["miscoordinations", pair(e.miscoordinations), ...none]),
    row("td", ["questions", pair(e.asks), ...none]),
    row("td", ["all arrive", `${(100 * e.all_arrived).toFixed(2)} %`, ...none]));
  $("evaluation").title = e.step === null ? "of the tables at the end" : `of the tables of step ${e.step}`;
}
