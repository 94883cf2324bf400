// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// The film of a drive on the map of import-map: bodies of their true size, in seconds of the episode.

import { $, svg } from "/draw.js";

const LONGEST = 20; // seconds that a film lasts at most

export class Film {
  // `robot` returns the picture of a robot: by its number, and its radius in metres.
  constructor(robot, at) {
    Object.assign(this, { robot, at, seconds: [], places: [], bodies: [], now: 0, playing: false });
    this.layer = svg("g", { class: "film" });
    $("play").onclick = () => this.play(!this.playing);
    $("frame").oninput = () => {
      this.play(false);
      this.show($("frame").valueAsNumber);
    };
  }

  // Another film, which begins to play where the reader does not want less motion; or none.
  load({ seconds, places, radius }) {
    Object.assign(this, { seconds, places, radius, now: 0 });
    this.play(false);
    const there = seconds.length > 0;
    $("film").hidden = !there;
    this.draw();
    if (!there) return;
    this.whole = seconds.at(-1);
    this.rate = Math.max(1, Math.ceil(this.whole / LONGEST));
    $("frame").max = this.whole;
    this.show(0);
    this.play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  }

  // Draws the bodies anew, as after a zoom: a small one is drawn larger than it is.
  draw() {
    this.bodies = (this.places[0] ?? []).map((_, k) => this.robot(k, this.radius));
    this.layer.replaceChildren(...this.bodies);
    this.place();
  }

  play(on) {
    this.playing = on;
    $("play").textContent = on ? "Pause" : "Play";
    if (!on) return;
    if (this.now >= this.whole) this.show(0);
    this.last = performance.now();
    requestAnimationFrame((time) => this.tick(time));
  }

  tick(time) {
    if (!this.playing) return;
    const now = this.now + (this.rate * Math.max(0, time - this.last)) / 1000;
    this.last = time;
    this.show(Math.min(now, this.whole));
    if (now >= this.whole) this.play(false);
    else requestAnimationFrame((next) => this.tick(next));
  }

  show(now) {
    this.now = now;
    this.place();
    const time = `${now.toFixed(1)} of ${this.whole.toFixed(1)} s`;
    $("frame").value = now;
    $("frame").setAttribute("aria-valuetext", time);
    $("film-time").textContent = `First episode, ${time}${this.rate > 1 ? `, ${this.rate} times as fast` : ""}`;
  }

  // Puts the bodies where they are now; between two frames that is on the straight line.
  place() {
    const { seconds, places, now } = this;
    const next = Math.max(1, seconds.findIndex((one) => one >= now)), before = next - 1;
    const share = next < seconds.length ? (now - seconds[before]) / (seconds[next] - seconds[before] || 1) : 0;
    this.bodies.forEach((body, k) => {
      const from = places[before][k], to = (places[next] ?? places[before])[k];
      const between = from.map((one, axis) => one + share * (to[axis] - one));
      body.setAttribute("transform", `translate(${this.at(between)})`);
    });
  }
}
