// Brings the page together: what comes over the socket, what is drawn, what people do.

import { Camera } from "./camera.js";
import { Chosen, partOf } from "./selection.js";
import { Controls } from "./controls.js";
import { $ } from "./dom.js";
import { Film, stored } from "./offline_player.js";
import { ContactImage } from "./contact_image.js";
import { Flat } from "./flat.js";
import { Hover } from "./hover.js";
import { Labels } from "./labels.js";
import { Link } from "./link.js";
import { Marks } from "./marks.js";
import { dot, place, turn } from "./matrices.js";
import { unpack } from "./packing.js";
import { Smoother } from "./gl_buffers.js";
import { Picture } from "./picture.js";
import { Pointer } from "./pointer.js";
import { onTheme } from "./theme.js";
import { Traces } from "./traces.js";

const REST = 300; // after so long without a change all edges are smoothed [ms]
const WRITE = 100; // from a sample to its words beside the picture [ms]
const LOOK = 500; // from one look at what stands before a touch to the next [ms]
const UNKNOWN = 255; // the code of a taxel of which nothing is known

class Page {
  constructor(scene, connect) {
    this.header = scene.header;
    this.arrays = scene.arrays;
    this.stage = $("stage");
    this.camera = new Camera(this.header);
    this.picture = new Picture($("picture"), scene);
    this.flat = new Flat($("flat"), scene);
    this.contactImage = new ContactImage($("contact-image"), scene);
    this.smoother = new Smoother(scene.arrays);
    this.labels = new Labels($("labels"), $("leaders"));
    this.marks = new Marks(scene, this.picture, this.flat);
    this.chosen = new Chosen(scene);
    this.traces = new Traces($("traces"), this.chosen, (wish) => this.link.ask(wish));
    this.hover = new Hover(this);
    this.sample = null;
    this.layer = { name: "" };
    this.picked = -1; // number of the taxel told about beside the map
    this.fresh = false; // a sample that is not drawn yet
    this.came = 0; // when it did [ms]
    this.lost = false; // the graphics card
    this.looked = new Map(); // what stands before a touch
    this.delay = 0; // from a sample to its picture, smoothed [ms]
    this.received = 0;
    this.moved = 0; // when the camera or the robot last did [ms]
    this.wanted = false; // a picture is asked for
    this.writing = null; // words are about to be written
    this.still = 0;
    this.led = false; // by the page beside this one
    this.stats = { drawn: 0, bytes: 0, samples: 0, complete: 0, times: [] };
    this.controls = new Controls(this);
    this.pointer = new Pointer(this);
    this.link = connect(this);
    this.watchCard();
    onTheme(() => {
      this.picture.forget();
      this.flat.ready = false;
      for (const kind of ["labels", "controls"]) this[kind].themed?.();
      this.redraw(true);
    });
    new ResizeObserver(() => this.resize()).observe(this.stage);
    new ResizeObserver(() => this.resize()).observe(this.flat.canvas);
    this.resize();
  }

  // A card that is lost takes all with it: said at once, and all is made anew when it is back.
  watchCard() {
    const canvas = $("picture");
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.lost = true;
      this.controls.write();
    });
    canvas.addEventListener("webglcontextrestored", () => {
      const { style, parts, poses, categories } = this.picture;
      this.picture.rest.hide();
      this.picture = new Picture(canvas, { header: this.header, arrays: this.arrays });
      Object.assign(this.picture, { style, parts, poses, categories });
      this.picture.setTable(this.layer.table);
      this.marks.picture = this.picture;
      this.lost = false;
      this.resize();
      this.markAll();
      if (this.sample) this.picture.setValues(this.sample.arrays.values, this.smoother.out);
      this.controls.write();
      this.redraw(true);
    });
  }

  // Bring all that is marked to where it is now.
  markAll() {
    this.marks.showChosen(this.chosen, true);
    if (!this.sample) return;
    this.marks.showSigns(this.sample, this.layer.grey, true);
    this.marks.showTouches(this.sample);
  }

  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (!width || !height) return;
    if (!this.lost) this.picture.resize(Math.round(width * ratio), Math.round(height * ratio));
    this.camera.resize(width / height, ratio);
    const flat = this.flat.canvas;
    this.flat.resize(Math.round(flat.clientWidth * ratio), Math.round(flat.clientHeight * ratio));
    this.redraw(true);
  }

  take(message) {
    const { header, arrays } = message;
    if (this.outdated) return; // of another robot: the page is about to be loaded anew
    if (!this.sample) this.moved = performance.now(); // the first picture is drawn quickly
    this.sample = message;
    this.received += 1;
    if (!this.fresh) this.came = performance.now();
    this.fresh = true;
    if (arrays.poses && arrays.poses.some((x, i) => x !== this.picture.poses[i])) {
      this.picture.poses.set(arrays.poses);
      this.picture.forget();
      this.marks.showChosen(this.chosen, true);
      this.marks.signed = null;
      this.moved = performance.now(); // a robot in motion is drawn quickly
    }
    const values = this.smoother.carry(arrays.values);
    this.picture.setValues(arrays.values, values);
    this.flat.setValues(arrays.values, values);
    this.marks.showSigns(message, this.layer.grey);
    this.marks.showTouches(message);
    this.controls.sampleCame(header);
    this.writing ??= setTimeout(() => this.write(), WRITE);
    this.redraw();
  }

  // Parts of which nothing is known.
  silent() {
    const values = this.sample?.arrays.values ?? [];
    return values.length === 0 ? [] : this.header.parts.filter(({ taxels: [first, count] }) => values.subarray(first, first + count).every((code) => code === UNKNOWN));
  }

  // Words follow at a pace that eyes can read, and cost no time of the picture's.
  write() {
    this.writing = null;
    this.controls.sampleChanged(this.sample.header);
    const { touches, signs } = this.sample.header;
    this.controls.words.showNotes(this.silent(), this.header.parts, touches.length > 0, signs);
    this.hover.ask();
    if (this.picked >= 0) this.link.ask({ do: "pick", ...this.taxel(this.picked) });
  }

  // Choose what is at a taxel, and tell of it beside the map; beside the skin, nothing.
  choose(number, reach, add) {
    const taxels = number < 0 ? [] : this.chosen.reached(number, reach);
    if (!add) this.chosen.replace(taxels);
    else if (taxels.length) this.chosen.toggle(taxels);
    if (number >= 0 || !add) this.pick(number);
    this.chosenChanged();
  }

  // Choose what a lasso on the flat map encloses.
  enclose(numbers, add) {
    if (add) this.chosen.add(numbers);
    else this.chosen.replace(numbers);
    this.chosenChanged();
  }

  chosenChanged() {
    if (!this.chosen.count) this.pick(-1);
    this.marks.showChosen(this.chosen);
    this.traces.show(this.flat.part);
    this.controls.words.showCount(this.chosen.count);
    this.redraw();
  }

  pick(number) {
    this.picked = number;
    if (number < 0) $("pick").hidden = true;
    else this.link.ask({ do: "pick", ...this.taxel(number) });
  }

  isPicked({ part, taxel }) {
    const picked = this.taxel(this.picked);
    return picked && picked.part === part && picked.taxel === taxel;
  }

  askLayer(name) {
    this.link.ask({ do: "layer", to: name });
    if (name !== this.layer.name) this.controls.words.working(name);
    this.lead((page) => page.askLayer(name));
  }

  // Where two pages stand side by side, the other one follows what is done here.
  lead(what) {
    const { parent } = window, side = /\/(left|right)\/$/.exec(location.pathname);
    const page = parent !== window && side ? parent[side[1] === "left" ? 1 : 0].skinmap : null;
    if (!page || this.led) return;
    page.led = true;
    try {
      what(page);
    } finally {
      page.led = false;
    }
  }

  setLayer(layer) {
    const categories = layer.categories.length > 0;
    this.layer = layer;
    for (const one of [this.picture, this.flat]) {
      one.setTable(layer.table);
      one.categories = categories;
    }
    this.picture.forget();
    this.controls.layerChanged(layer);
    this.redraw(true);
  }

  setStyle(style) {
    this.picture.style = this.flat.style = $("style").value = style;
    this.picture.forget();
    this.redraw(true);
    this.lead((page) => page.setStyle(style));
  }

  setPlot(plot) {
    this.traces.plot = plot;
    this.traces.show(this.flat.part);
  }

  setPart(name) {
    const all = this.header.parts.map((part) => part.name), other = (name ? 1 : all.length) !== this.picture.parts.size;
    this.picture.parts = new Set(name ? [name] : all);
    this.picture.forget();
    this.markAll();
    if (name) this.frame(name);
    else if (other) this.camera.home();
    if (name || other) this.cameraMoved();
    this.redraw(true);
  }

  // Bring a part close, seen from where most of it is seen.
  frame(name) {
    const part = this.header.parts.find((one) => one.name === name), [first, count] = part.taxels, model = this.picture.model(part.link);
    const rows = Array.from({ length: Math.min(count, 200) }, (_, k) => first + Math.floor((k * count) / Math.min(count, 200)));
    const three = (array, row, width) => array.subarray(width * row, width * row + 3);
    this.camera.focus(
      rows.map((row) => place(model, three(this.arrays["taxel.points"], row, 3)).slice(0, 3)),
      rows.map((row) => turn(model, [...three(this.arrays["taxel.normals"], row, 4)].map((x) => x / 127))),
    );
  }

  // The flat map of a part; one that was asked for by name stays.
  showFlat(name, stays = false) {
    if (stays) $("map-part").value = name;
    if (this.flat.part.name === name) return;
    this.flat.show(name);
    this.controls.mapChanged(this.flat.part);
    this.traces.show(this.flat.part);
    if (this.sample) this.marks.showTouches(this.sample);
    this.redraw(true);
  }

  // Bring what is touched close; false where nothing is.
  focus() {
    const touches = this.sample ? this.sample.header.touches : [];
    if (!touches.length) return false;
    const models = touches.map(({ part }) => this.picture.model(this.header.parts.find(({ name }) => name === part).link));
    this.camera.focus(touches.map(({ centre }, k) => place(models[k], centre).slice(0, 3)), touches.map(({ normal }, k) => turn(models[k], normal)));
    this.cameraMoved();
    return true;
  }

  cameraMoved(name = "") {
    $("view").value = name;
    this.moved = performance.now();
    this.redraw();
    this.lead((page) => {
      if (page.header.robot !== this.header.robot) return;
      const { azimuth, elevation, middle, zoom, far } = this.camera;
      Object.assign(page.camera, { azimuth, elevation, middle: [...middle], zoom, far }).update();
      page.cameraMoved(name);
    });
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
    if (!this.picture.rooms || this.lost) return;
    this.picture.draw(this.camera, performance.now() - this.moved < REST, still);
    this.flat.draw(this.camera.ratio);
    this.contactImage.draw(this.flat.part, this.layer.name === "pressure" ? this.sample.arrays.values : null);
    this.showLabels();
    if (this.fresh) {
      this.fresh = false;
      this.stats.drawn += 1;
      this.delay += 0.1 * (performance.now() - this.came - this.delay);
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
      const key = touch.identity >= 0 ? `${touch.identity}` : `${touch.part}/${k}`;
      const hidden = dot(turn(model, touch.normal), this.camera.direction) < 0 || this.covered(key, x, y);
      const text = `${touch.text}${hidden ? ", behind" : ""}${this.sample.header.stale ? ", last heard" : ""}`;
      return { key, text, colour: touch.colour, at: [x * width, y * height], hidden };
    });
    const inside = touches.filter(({ at: [x, y] }) => x >= 0 && y >= 0 && x <= width && y <= height);
    this.labels.show(inside, { width, height, taken: $("bar").offsetTop - 12 });
  }

  // Whether something stands before the skin there, in shares of the picture: looked at now and then.
  covered(key, x, y) {
    const { canvas } = this.picture, now = performance.now(), known = this.looked.get(key);
    if (known && known.version === this.camera.version && now - known.at < LOOK) return known.covered;
    if (now - this.moved < REST) return known?.covered ?? false;
    if (this.looked.size > 64) this.looked.clear();
    const covered = this.picture.taxelAt(x * canvas.width, y * canvas.height, this.camera) < 0;
    this.looked.set(key, { covered, at: now, version: this.camera.version });
    return covered;
  }

  partOf(number) {
    return partOf(this.header, number);
  }

  // Part and dense row of a taxel by its number among all.
  taxel(number) {
    const part = this.partOf(number);
    return part && { part: part.name, taxel: number - part.taxels[0] };
  }
}

async function start() {
  if ($("reel")) {
    const reel = await stored("reel");
    return new Page(await stored("scene"), (page) => new Film(reel, page));
  }
  const answer = await fetch("scene.bin");
  if (!answer.ok) throw new Error(await answer.text());
  const root = new URL("live", location.href);
  return new Page(unpack(await answer.arrayBuffer()), (page) => new Link(root, page));
}

function failed(error) {
  $("status").className = "warn";
  $("status").textContent = `cannot show the robot: ${error.message}`;
}

start().then((page) => (window.skinmap = page), failed); // for tests and for the curious
