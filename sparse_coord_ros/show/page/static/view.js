// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// Which part of a picture is seen: zoom, pan and fit, by wheel, by dragging, by buttons, or by a call.

import { $, html } from "/draw.js";

const STILL = 4; // pixels that a click may wander

export class View {
  constructor(element, buttons = $("zoom")) {
    this.element = element;
    element.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(1.2 ** -Math.sign(event.deltaY), this.under(event));
    }, { passive: false });
    element.addEventListener("pointerdown", (event) => { this.pressed = event; this.dragged = false; });
    const button = (className, words, title, onclick) => html("button", { className, type: "button", title, onclick }, words);
    buttons.replaceChildren(button("closer", "+", "closer", () => this.zoom(1.5)),
      button("further", "−", "further away", () => this.zoom(1 / 1.5)), button("fit", "Fit", "the whole map", () => this.fit()));
    new ResizeObserver(() => this.whole && this.look()).observe(element);
  }

  // Another picture: all of it, and the least width to see.
  show(whole, closest) {
    Object.assign(this, { whole, closest });
    this.fit();
  }

  fit() {
    this.seen = { ...this.whole };
    this.look();
  }

  // Returns the pixels of a unit.
  look() {
    const { x, y, width, height } = this.seen;
    this.element.setAttribute("viewBox", `${x} ${y} ${width} ${height}`);
    return Math.min(this.element.clientWidth / width, this.element.clientHeight / height);
  }

  under(event) {
    return new DOMPoint(event.clientX, event.clientY).matrixTransform(this.element.getScreenCTM().inverse());
  }

  zoom(times, at = { x: this.seen.x + this.seen.width / 2, y: this.seen.y + this.seen.height / 2 }) {
    const width = Math.min(this.whole.width, Math.max(this.closest, this.seen.width / times)), by = width / this.seen.width;
    this.seen = { x: at.x + (this.seen.x - at.x) * by, y: at.y + (this.seen.y - at.y) * by, width, height: this.seen.height * by };
    this.pan(0, 0);
  }

  pan(dx, dy) {
    const inside = (at, size, low, all) => Math.min(Math.max(at, low), low + all - size);
    this.seen.x = inside(this.seen.x + dx, this.seen.width, this.whole.x, this.whole.width);
    this.seen.y = inside(this.seen.y + dy, this.seen.height, this.whole.y, this.whole.height);
    this.look();
  }

  holds(x, y) {
    const { whole } = this;
    return x >= whole.x && x <= whole.x + whole.width && y >= whole.y && y <= whole.y + whole.height;
  }

  // Pans as little as shows a place.
  reveal(x, y) {
    const { seen } = this;
    const outside = (at, low, size) => Math.min(0, at - low) + Math.max(0, at - low - size);
    this.pan(outside(x, seen.x, seen.width), outside(y, seen.y, seen.height));
  }

  // Pans where a pointer that moves is pressed; returns whether it is.
  drag(event) {
    if (event.buttons !== 1 || !this.pressed) return false;
    this.dragged ||= Math.hypot(event.clientX - this.pressed.clientX, event.clientY - this.pressed.clientY) > STILL;
    const by = 1 / this.element.getScreenCTM().a;
    if (this.dragged) this.pan(-event.movementX * by, -event.movementY * by);
    return true;
  }
}
