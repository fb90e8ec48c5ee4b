// Moments that stand in the page itself: what a file plays, where `Link` has a server.

import { words } from "./dom.js";
import { unpack } from "./packing.js";
import { rowsOf } from "./traces.js";

const [FULL, UNKNOWN] = [255, 255]; // counts at full scale, and the code of none
const LEAST = 20; // shortest time that a moment is shown [ms]
const round = (x, digits) => Number(x.toFixed(digits));

// A message as `viewer/export/html_page.py` writes it: deflated, in base64.
export async function stored(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
  const plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return unpack(await new Response(plain).arrayBuffer());
}

export class Film {
  constructor({ header, arrays }, page) {
    this.page = page;
    this.arrays = arrays;
    this.moments = header.moments;
    this.layers = Object.fromEntries(header.layers.map((layer) => [layer.name, layer]));
    this.layer = header.layer;
    this.now = header.now;
    this.spans = header.spans;
    this.paused = this.moments.length > 1;
    this.speed = 1;
    this.loop = false;
    this.timer = 0;
    this.acts = {
      layer: ({ to }) => this.setLayer(to),
      pick: (wish) => this.tell({ kind: "pick", ...this.describe(wish) }),
      point: (wish) => this.tell({ kind: "point", ...this.describe(wish) }),
      play: () => this.play(),
      pause: () => this.pause(),
      step: ({ by }) => this.step(by),
      seek: ({ to }) => this.show(this.at(to)),
      speed: ({ to }) => (this.speed = to),
      loop: ({ to }) => (this.loop = to),
      plot: (wish) => this.plot(wish),
    };
    setTimeout(() => this.begin(header)); // when the page is all there
  }

  begin({ style, size }) {
    this.page.controls.connected(true);
    this.tell({ kind: "hello", layers: Object.keys(this.layers), style, size });
    this.setLayer(this.layer);
    const seen = new Set(this.spans.map((span) => span[4]));
    this.tell({ kind: "spans", spans: this.spans, parts: this.page.header.parts.map(({ name }) => name).filter((name) => seen.has(name)) });
  }

  // What is plotted, out of the moments that the file has: as viewer/drawing/touches/traces.py does.
  plot(wish) {
    this.wish = wish;
    const { plot, part, seconds } = wish, taxels = rowsOf(wish.taxels), now = this.time(this.now), traces = this.page.header.traces;
    if (!plot) return;
    const rows = this.moments.filter((_, k) => this.time(k) <= now + 1e-6 && this.time(k) >= now - seconds);
    const times = rows.map((row) => row.time - this.moments[this.now].time), told = { kind: "plot", times, span: seconds, levels: {}, note: "" };
    if (plot === "taxels") {
      const one = this.page.header.parts.find(({ name }) => name === part), first = one.taxels[0];
      const felt = (row, k) => (row.felt.pressure ? this.arrays[row.felt.pressure][first + k] : NaN);
      const few = taxels.length <= traces.length, known = (x) => (Number.isFinite(x) ? x : null);
      const lines = few ? taxels.map((k) => rows.map((row) => known(felt(row, k)))) : [
        rows.map((row) => known(taxels.reduce((sum, k) => sum + felt(row, k), 0) / taxels.length)),
        rows.map((row) => known(Math.max(...taxels.map((k) => felt(row, k))))),
      ];
      const names = few ? taxels.map((k) => `${this.page.arrays["taxel.channels"][first + k]}`) : ["mean", `largest of ${taxels.length} taxels`];
      this.tell({ ...told, title: `${words(part)}, counts${few ? " by channel" : ""}`, names, lines, top: FULL });
      return;
    }
    const key = (touch) => `${touch.part}/${touch.identity}`, field = { area: "area_mm2", force: "force", probability: "confidence" }[plot] ?? "peak";
    const last = new Map(rows.flatMap((row) => row.touches.map((touch) => [key(touch), touch]))), keys = [...last.keys()].reverse().slice(0, traces.length);
    const lines = keys.map((one) => rows.map((row) => {
      const value = row.touches.find((touch) => key(touch) === one)?.[field] ?? null;
      return value !== null && plot === "probability" ? 100 * value : value;
    }));
    const most = plot === "probability" ? 100 : Math.max(1, ...lines.flat().filter((x) => x !== null)), power = 10 ** Math.floor(Math.log10(most));
    const unit = { area: "mm²", force: "N", probability: "%" }[plot] ?? "counts";
    this.tell({ ...told, title: `touches: ${field === "peak" ? "largest pressure" : plot}, ${unit}`, names: keys.map((one) => words(last.get(one).label)), lines, top: [1, 2, 5, 10].map((step) => step * power).find((x) => x >= most) });
  }

  tell(message) {
    this.page.controls.letter(message);
  }

  ask(wish) {
    this.acts[wish.do]?.(wish);
    if (wish.do !== "pick" && wish.do !== "point") this.tell({ kind: "state", ...this.state() });
  }

  drawn() {}

  state() {
    const { moments, now, paused, speed, loop } = this, single = moments.length < 2;
    return {
      single, paused, speed, loop, seekable: !single, error: null, ended: false, unfit: 0,
      span: [0, this.time(moments.length - 1)], position: this.time(now), duration: single ? null : this.time(moments.length - 1),
    };
  }

  // Of a moment, from the first one on [s].
  time(number) {
    return (this.moments[number].time ?? 0) - (this.moments[0].time ?? 0);
  }

  at(seconds) {
    let number = 0;
    while (number + 1 < this.moments.length && this.time(number + 1) <= seconds + 1e-6) number += 1;
    return number;
  }

  setLayer(name) {
    this.layer = name;
    this.tell({ kind: "layer", ...this.layers[name] });
    this.show(this.now);
  }

  show(number) {
    this.now = number;
    const moment = this.moments[number], arrays = { values: this.arrays[moment.values[this.layer]] };
    if (moment.poses) arrays.poses = this.arrays[moment.poses];
    for (const { outline } of moment.touches) {
      arrays[outline] = this.arrays[outline];
      arrays[`${outline}.share`] = this.arrays[`${outline}.share`];
    }
    this.page.take({ header: { ...moment, ...this.state() }, arrays });
    if (this.wish) this.plot(this.wish);
  }

  step(by) {
    this.pause();
    const to = this.now + by;
    if (this.moments[to]) this.show(to);
    else this.tell({ kind: "notice", text: "no further sample that way" });
  }

  pause() {
    this.paused = true;
    clearTimeout(this.timer);
  }

  play() {
    if (this.moments.length < 2) return;
    this.paused = false;
    if (this.now === this.moments.length - 1) this.show(0);
    this.wait();
  }

  wait() {
    clearTimeout(this.timer);
    const last = this.now === this.moments.length - 1;
    if (last && !this.loop) {
      this.pause();
      this.tell({ kind: "state", ...this.state() });
      return;
    }
    const gap = last ? 0 : this.time(this.now + 1) - this.time(this.now);
    this.timer = setTimeout(() => {
      this.show(last ? 0 : this.now + 1);
      this.wait();
    }, Math.max(LEAST, (1e3 * gap) / this.speed));
  }

  // As `viewer/web/sample.py` tells it.
  describe({ part, taxel }) {
    const { page, arrays } = this, { header } = page, scene = page.arrays, moment = this.moments[this.now];
    const one = header.parts.find(({ name }) => name === part), k = one.taxels[0] + taxel;
    const three = (array, factor, digits) => [0, 1, 2].map((i) => round(factor * array[3 * k + i], digits));
    const felt = (name) => {
      const value = moment.felt[name] ? arrays[moment.felt[name]][k] : NaN;
      return Number.isFinite(value) ? value : null;
    };
    const name = (layer) => this.layers[layer]?.categories[arrays[moment.values[layer]][k]] ?? null;
    const sent = ["pressure", "raw"].filter((kind) => moment.felt[kind]);
    const beside = arrays.beside.subarray(arrays["beside.starts"][k], arrays["beside.starts"][k + 1]);
    return {
      part, taxel, channel: scene["taxel.channels"][k], module: scene["taxel.modules"][k],
      patch: scene["taxel.patches"][k] + 1, link: header.links[one.link].name,
      position_mm: three(arrays.positions, 1e3, 1), normal: three(arrays.normals, 1, 2),
      neighbours: [...beside].map((other) => scene["taxel.channels"][other]),
      sent, pressure: felt("pressure"), raw: felt("raw"), structure: name("structures"), health: name("health"),
      shown: { name: this.layer, title: this.layers[this.layer].title, unit: this.layers[this.layer].unit, category: name(this.layer), value: this.value(k) },
      touches: moment.touches.filter((touch) => touch.part === part && touch.members?.includes(taxel)).map((touch) => touch.text),
    };
  }

  // What the layer shows of a taxel, as near as its colours tell.
  value(k) {
    const { table, limits: [low, high] } = this.layers[this.layer], code = this.arrays[this.moments[this.now].values[this.layer]][k];
    return code === UNKNOWN ? null : low + ((high - low) * (code + 0.5)) / table.length;
  }
}
