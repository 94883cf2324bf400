// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// A lane of the time line: what happened when, as ticks. A click leads there.

import { html, svg } from "/draw.js";

const WIDTH = 1000, HEIGHT = 10;

export class Lane {
  // The label stands before the lane; seek is called with the share of the time line that was clicked.
  constructor(holder, label, title, seek) {
    this.picture = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img", "aria-label": title });
    this.row = html("div", { className: "lane-of" }, label, this.picture);
    holder.append(this.row);
    this.picture.addEventListener("click", (event) => {
      const box = this.picture.getBoundingClientRect(), inner = box.width - 16; // without its padding
      seek(Math.min(1, Math.max(0, (event.clientX - box.left - 8) / inner)));
    });
  }

  // Each row has a kind, and shares of the time line from 0 to 1. Rows with ticks share the lane's height.
  show(all) {
    const rows = all.filter(([, shares]) => shares.length > 0);
    const height = HEIGHT / rows.length;
    this.picture.replaceChildren(svg("rect", { width: WIDTH, height: HEIGHT, class: "lane" }), ...rows.map(([kind, shares], row) =>
      svg("path", { class: `mark ${kind}`, d: shares.map((share) => `M${(WIDTH * share).toFixed(1)},${row * height + 0.5}v${height - 1}`).join("") })));
  }
}
