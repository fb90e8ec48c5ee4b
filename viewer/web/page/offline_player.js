// Moments that stand in the page itself: what a file plays, where `Link` has a server.

import { unpack } from "./packing.js";

const [FULL, TOP, UNKNOWN] = [255, 254, 255]; // counts at full scale, their code, and that of none
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
    };
    setTimeout(() => this.begin(header)); // when the page is all there
  }

  begin({ style, size }) {
    this.page.controls.connected(true);
    this.tell({ kind: "hello", layers: Object.keys(this.layers), style, size });
    this.setLayer(this.layer);
    this.tell({ kind: "spans", spans: this.spans });
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
    const felt = this.arrays[moment.felt.pressure], shown = this.arrays[moment.values.pressure]; // not of mute taxels
    arrays.felt = Uint8Array.from(shown, (code, k) => (felt && code !== UNKNOWN ? Math.round((felt[k] * TOP) / FULL) : UNKNOWN));
    if (moment.poses) arrays.poses = this.arrays[moment.poses];
    for (const { outline } of moment.touches) {
      arrays[outline] = this.arrays[outline];
      arrays[`${outline}.share`] = this.arrays[`${outline}.share`];
    }
    this.page.take({ header: { ...moment, ...this.state() }, arrays });
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
