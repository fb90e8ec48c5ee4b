// Brings the page together: what comes over the socket, what is drawn, what people do.

import { Camera } from "./camera.js";
import { Controls } from "./controls.js";
import { Film, stored } from "./film.js";
import { Flat } from "./flat.js";
import { Labels } from "./labels.js";
import { Link } from "./link.js";
import { cross, dot, place, turn, unit } from "./matrices.js";
import { colour, unpack } from "./packing.js";
import { Smoother } from "./pieces.js";
import { Picture } from "./picture.js";

const REST = 300; // after so long without a change all edges are smoothed [ms]
const WRITE = 100; // from a sample to its words beside the picture [ms]
const LIFT = 0.0009; // outlines above the sheet [m]
const INK = "#20262e";
const ARROW = 0.05; // length of a normal [m]

class Page {
  constructor(scene, connect) {
    this.header = scene.header;
    this.arrays = scene.arrays;
    this.stage = document.getElementById("stage");
    this.camera = new Camera(this.header);
    this.picture = new Picture(document.getElementById("picture"), scene);
    this.flat = new Flat(document.getElementById("flat"), scene);
    this.smoother = new Smoother(scene.arrays);
    this.labels = new Labels(document.getElementById("labels"), document.getElementById("leaders"));
    this.sample = null;
    this.picked = -1; // number of the taxel asked about
    this.fresh = false; // a sample that is not drawn yet
    this.received = 0;
    this.moved = 0; // when the camera or the robot last did [ms]
    this.wanted = false; // a picture is asked for
    this.writing = null; // words are about to be written
    this.still = 0;
    this.stats = { drawn: 0, bytes: 0, samples: 0, complete: 0, times: [] };
    this.controls = new Controls(this);
    this.link = connect(this);
    new ResizeObserver(() => this.resize()).observe(this.stage);
    new ResizeObserver(() => this.resize()).observe(this.flat.canvas);
    this.resize();
  }

  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (!width || !height) return;
    this.picture.resize(Math.round(width * ratio), Math.round(height * ratio));
    this.camera.resize(width / height, ratio);
    const flat = this.flat.canvas;
    this.flat.resize(Math.round(flat.clientWidth * ratio), Math.round(flat.clientHeight * ratio));
    this.redraw(true);
  }

  take(message) {
    const { header, arrays } = message;
    if (!this.sample) this.moved = performance.now(); // the first picture is drawn quickly
    this.sample = message;
    this.received += 1;
    this.fresh = true;
    if (arrays.poses && arrays.poses.some((x, i) => x !== this.picture.poses[i])) {
      this.picture.poses.set(arrays.poses);
      this.picture.forget();
      this.moved = performance.now(); // a robot in motion is drawn quickly
    }
    const values = this.smoother.carry(arrays.values);
    this.picture.setValues(arrays.values, values);
    this.flat.setValues(arrays.values, values);
    this.setOutlines(header.touches, arrays);
    this.controls.sampleCame(header);
    this.writing ??= setTimeout(() => this.write(), WRITE);
    this.redraw();
  }

  // Words follow at a pace that eyes can read, and cost no time of the picture's.
  write() {
    this.writing = null;
    this.controls.sampleChanged(this.sample.header);
  }

  setOutlines(touches, arrays) {
    const points = this.arrays["sheet.points"], normals = this.arrays["sheet.normals"], uv = this.arrays["sheet.uv"];
    const round = [], flat = [];
    for (const touch of touches) {
      const part = this.header.parts.find((one) => one.name === touch.part);
      const model = this.picture.model(part.link), tint = colour(touch.colour);
      const ends = arrays[touch.outline], shares = arrays[`${touch.outline}.share`], line = [];
      for (let k = 0; k < shares.length; k += 2) {
        const seg = [];
        for (let e = k; e < k + 2; e++) {
          const s = shares[e] / 65535, a = ends[2 * e], b = ends[2 * e + 1];
          const mix = (array, width, i) => array[width * a + i] * (1 - s) + array[width * b + i] * s;
          const p = [0, 1, 2].map((i) => mix(points, 3, i) + (LIFT * mix(normals, 4, i)) / 127);
          seg.push(...place(model, p).slice(0, 3));
          line.push(mix(uv, 2, 0), mix(uv, 2, 1));
        }
        round.push(...seg, ...tint);
      }
      if (part === this.flat.part) flat.push({ colour: touch.colour, ends: line, halo: true });
      const foot = place(model, touch.centre), up = turn(model, touch.normal);
      const tip = [0, 1, 2].map((i) => foot[i] + ARROW * up[i]);
      round.push(foot[0], foot[1], foot[2], ...tip, ...tint);
      const trail = (touch.path || []).map((p) => place(model, p).map((x, i) => x + (i < 3 ? 0.004 * up[i] : 0)));
      for (let k = 1; k < trail.length; k++) round.push(...trail[k - 1].slice(0, 3), ...trail[k].slice(0, 3), ...tint);
    }
    if (this.picked >= 0) this.ring(round, flat);
    this.picture.touches.set(round);
    this.flat.setLines(flat);
  }

  // A ring around the taxel that was picked, on the body and on the flat map.
  ring(round, flat) {
    const k = this.picked, points = this.arrays["taxel.points"], uv = this.arrays["taxel.uv"];
    const part = this.header.parts.find((one) => one.name === this.taxel(k).part);
    const model = this.picture.model(part.link), tint = colour(INK);
    const up = unit([...this.arrays["taxel.normals"].subarray(4 * k, 4 * k + 3)]);
    const right = unit(cross(up, Math.abs(up[0]) < 0.6 ? [1, 0, 0] : [0, 1, 0])), ahead = cross(up, right), line = [];
    for (let c = 0; c < 12; c++) {
      const ends = [c, c + 1].map((at) => [Math.cos((at * Math.PI) / 6), Math.sin((at * Math.PI) / 6)]);
      const radius = 0.55 * part.spacing;
      for (const [x, y] of ends) {
        const p = [0, 1, 2].map((i) => points[3 * k + i] + radius * (x * right[i] + y * ahead[i]) + LIFT * up[i]);
        round.push(...place(model, p).slice(0, 3));
      }
      round.push(...tint);
      for (const [x, y] of ends) line.push(uv[2 * k] + radius * x, uv[2 * k + 1] + radius * y);
    }
    if (part === this.flat.part) flat.push({ colour: INK, ends: line, halo: true });
  }

  pick(number) {
    this.picked = number;
    if (this.sample) this.setOutlines(this.sample.header.touches, this.sample.arrays);
    this.redraw(true);
  }

  setLayer(layer) {
    const categories = layer.categories.length > 0;
    for (const one of [this.picture, this.flat]) {
      one.setTable(layer.table, !categories);
      one.categories = categories;
    }
    this.picture.forget();
    this.controls.layerChanged(layer);
    this.redraw(true);
  }

  setStyle(style) {
    this.picture.style = this.flat.style = style;
    this.picture.forget();
    this.redraw(true);
  }

  setPart(name) {
    this.picture.parts = new Set(name ? [name] : this.header.parts.map((part) => part.name));
    this.picture.forget();
    this.redraw(true);
  }

  showFlat(name) {
    if (this.flat.part.name === name) return;
    this.flat.show(name);
    this.controls.mapChanged(this.flat.part);
    if (this.sample) this.setOutlines(this.sample.header.touches, this.sample.arrays);
    this.redraw(true);
  }

  cameraMoved() {
    this.moved = performance.now();
    this.redraw();
  }

  redraw(anew = false) {
    clearTimeout(this.still);
    if (anew) this.flat.stale = true;
    // Nothing is drawn before the first sample: a body drawn twice would only hold that up.
    if (this.wanted || !this.sample) return;
    this.wanted = true;
    requestAnimationFrame(() => this.draw(false));
  }

  draw(still) {
    this.wanted = false;
    if (!this.picture.rooms) return;
    this.picture.draw(this.camera, performance.now() - this.moved < REST, still);
    this.flat.draw(this.camera.ratio);
    this.showLabels();
    if (this.fresh) {
      this.fresh = false;
      this.stats.drawn += 1;
      this.stats.complete ||= performance.now();
      this.stats.times.push(performance.now());
      if (this.stats.times.length > 600) this.stats.times.shift();
      this.link.drawn(this.received);
    }
    document.body.dataset.drawn = this.stats.drawn;
    if (!still) this.still = setTimeout(() => this.draw(true), REST);
  }

  showLabels() {
    const { clientWidth: width, clientHeight: height } = this.stage;
    const shown = (this.sample ? this.sample.header.touches : []).filter((touch) => this.picture.parts.has(touch.part));
    const touches = shown.map((touch, k) => {
      const model = this.picture.model(this.header.parts.find((part) => part.name === touch.part).link);
      const [x, y] = this.camera.project(place(model, touch.centre));
      const hidden = dot(turn(model, touch.normal), this.camera.direction) < 0;
      const key = touch.identity >= 0 ? `${touch.identity}` : `${touch.part}/${k}`;
      return { key, text: touch.text, colour: touch.colour, at: [x * width, y * height], hidden };
    });
    const inside = touches.filter(({ at: [x, y] }) => x >= 0 && y >= 0 && x <= width && y <= height);
    this.labels.show(inside, { width, height, taken: document.getElementById("bar").offsetTop - 12 });
  }

  // Part and dense row of a taxel by its number among all.
  taxel(number) {
    const part = this.header.parts.find(({ taxels: [first, count] }) => number >= first && number < first + count);
    return part && { part: part.name, taxel: number - part.taxels[0] };
  }
}

async function start() {
  if (document.getElementById("reel")) {
    const reel = await stored("reel");
    return new Page(await stored("scene"), (page) => new Film(reel, page));
  }
  const answer = await fetch("scene.bin");
  if (!answer.ok) throw new Error(await answer.text());
  const root = new URL("live", location.href);
  return new Page(unpack(await answer.arrayBuffer()), (page) => new Link(root, page));
}

function failed(error) {
  const status = document.getElementById("status");
  status.className = "warn";
  status.textContent = `cannot show the robot: ${error.message}`;
}

start().then((page) => (window.skinmap = page), failed); // for tests and for the curious
