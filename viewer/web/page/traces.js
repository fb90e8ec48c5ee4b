// Pressures of the last seconds: kept in a fixed room, drawn for the chosen taxels.

import { made, words } from "./dom.js";
import { colours } from "./theme.js";

const SECONDS = 10; // that are kept
const SAMPLES = 500; // of each taxel: 50 a second
const ROOM = 8e6; // bytes at most: larger skins are sampled more rarely
const TOP = 254; // the code of 255 counts; 255 is unknown
const COUNTS = 255 / TOP; // counts of one step
const FONT = "system-ui, sans-serif";

export class History {
  constructor(count) {
    this.count = count;
    this.samples = Math.max(2, Math.min(SAMPLES, Math.floor(ROOM / count)));
    this.times = new Float64Array(this.samples).fill(NaN);
    this.codes = new Uint8Array(this.samples * count);
    this.next = 0;
    this.last = NaN;
  }

  // Keep a sample, unless the last one kept is too young.
  add(time, codes) {
    if (!Number.isFinite(time) || (time >= this.last && time - this.last < (0.9 * SECONDS) / this.samples)) return;
    if (time < this.last) this.times.fill(NaN); // led back: what came later is not true yet
    this.times[this.next] = time;
    this.codes.set(codes, this.next * this.count);
    this.last = time;
    this.next = (this.next + 1) % this.samples;
  }

  // Rows that are kept, oldest first, and the pressures of taxels at these times [counts].
  rows() {
    return Array.from({ length: this.samples }, (_, k) => (this.next + k) % this.samples).filter((row) => !Number.isNaN(this.times[row]));
  }

  counts(row, number) {
    const code = this.codes[row * this.count + number];
    return code > TOP ? NaN : code * COUNTS;
  }
}

const MAX_CONTACTS = 6; // that are plotted
const PAST = 0.1; // a speed is taken over so long [s]: centres jump from taxel to taxel
const UNITS = { force: "N", area: "mm²", speed: "mm/s" };

// Force, area and place of the contacts of the last seconds, as the window keeps them
// (viewer/drawing/touches/contact_courses.py).
export class Courses {
  constructor() {
    this.rows = [];
  }

  add({ time, stale, touches }) {
    if (!Number.isFinite(time) || stale) return;
    const last = this.rows.at(-1)?.time;
    if (time === last) return;
    if (time < last) this.rows = []; // led back: what came later is not true yet
    this.rows.push({ time, touches: new Map(touches.map((touch) => [`${touch.part}/${touch.identity}`, touch])) });
    while (this.rows.length > SAMPLES || time - this.rows[0].time > SECONDS) this.rows.shift();
  }

  // Times, a line for each of the contacts felt last, their names, and the unit.
  show(kind) {
    const { rows } = this, keys = [...new Set([...rows].reverse().flatMap((row) => [...row.touches.keys()]))].slice(0, MAX_CONTACTS);
    const known = rows.some((row) => [...row.touches.values()].some((touch) => touch.force !== null));
    const field = kind === "area" ? "area_mm2" : known ? "force" : "peak";
    const of = kind === "speed" ? (key, k) => this.speed(key, k) : (key, k) => rows[k].touches.get(key)?.[field] ?? NaN;
    return {
      times: rows.map((row) => row.time), lines: keys.map((key) => rows.map((_, k) => of(key, k))),
      names: keys.map((key) => words(key.split("/")[0])), unit: kind === "force" && !known ? "largest count" : UNITS[kind],
    };
  }

  speed(key, k) {
    const { rows } = this, now = rows[k].touches.get(key);
    let before = k;
    while (before > 0 && rows[k].time - rows[before - 1].time <= PAST + 1e-9) before -= 1;
    const then = rows[before].touches.get(key);
    if (!now || !then || before === k) return NaN;
    return (1e3 * Math.hypot(...now.centre.map((x, i) => x - then.centre[i]))) / (rows[k].time - rows[before].time);
  }
}

// A round number, at least so large.
function roundUp(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= 0.999 * value);
}

export class Traces {
  constructor(section, scene, chosen) {
    this.section = section;
    this.canvas = section.querySelector("canvas");
    this.channels = scene.arrays["taxel.channels"];
    this.history = new History(this.channels.length);
    this.chosen = chosen;
    this.courses = new Courses();
    this.plot = "taxels";
  }

  // What is plotted: a course of the contacts, or the pressures of chosen taxels.
  show(part) {
    if (this.plot === "taxels") return this.showTaxels(part);
    this.section.hidden = false;
    const { times, lines, names, unit } = this.courses.show(this.plot);
    this.write(`contacts: ${this.plot}, ${unit}`, names);
    this.draw(times, lines, roundUp(Math.max(...lines.flat().filter(Number.isFinite))));
  }

  // Those of the part on the flat map, or of another where none is chosen there; of many their mean
  // and their largest.
  showTaxels(part) {
    const byPart = this.chosen.byPart();
    this.section.hidden = !byPart.size;
    if (!byPart.size) return;
    const on = byPart.has(part) ? part : [...byPart.keys()][0], numbers = byPart.get(on);
    const { history } = this, rows = history.rows(), few = numbers.length <= this.chosen.header.traces.length;
    const names = few ? numbers.map((number) => `${this.channels[number]}`) : ["mean", `largest of ${numbers.length} taxels`];
    const lines = few ? numbers.map((number) => rows.map((row) => history.counts(row, number))) : this.summary(rows, numbers);
    this.write(`${words(on.name)}, counts${few ? " by channel" : ""}`, names);
    this.draw(rows.map((row) => history.times[row]), lines);
  }

  // Mean and largest of many taxels at each time.
  summary(rows, numbers) {
    const mean = [], largest = [];
    for (const row of rows) {
      let sum = 0, count = 0, most = NaN;
      for (const number of numbers) {
        const value = this.history.counts(row, number);
        if (Number.isNaN(value)) continue;
        sum += value;
        count += 1;
        if (!(value <= most)) most = value;
      }
      mean.push(sum / count);
      largest.push(most);
    }
    return [mean, largest];
  }

  write(title, names) {
    const said = [title, ...names].join("\n");
    if (this.said === said) return;
    this.said = said;
    this.section.querySelector("h2").textContent = title;
    const tints = this.chosen.header.traces;
    this.section.querySelector("ol").replaceChildren(...names.map((name, k) => {
      const item = made("li", name);
      item.style.color = tints[k];
      return item;
    }));
  }

  draw(times, lines, most = 255) {
    const { canvas } = this, ratio = Math.min(window.devicePixelRatio || 1, 2), pen = canvas.getContext("2d");
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const left = 34, right = width - 4, top = 8, bottom = height - 18, now = times.at(-1);
    Object.assign(pen, { strokeStyle: colours().faint, fillStyle: colours().faint, lineWidth: 1, lineJoin: "round", font: `12px ${FONT}`, textAlign: "right" });
    pen.beginPath();
    [[left, top], [left, bottom], [right, bottom]].forEach((p) => pen.lineTo(...p));
    pen.stroke();
    pen.fillText(`${most}`, left - 4, top + 5);
    pen.fillText("0", left - 4, bottom + 3);
    pen.fillText("now", right, height - 3);
    pen.textAlign = "left";
    pen.fillText(`-${SECONDS} s`, left, height - 3);
    pen.lineWidth = 1.6;
    lines.forEach((values, k) => {
      pen.strokeStyle = this.chosen.header.traces[k];
      pen.beginPath();
      let open = false;
      values.forEach((value, i) => {
        const x = right + ((times[i] - now) / SECONDS) * (right - left), y = bottom - (value / most) * (bottom - top);
        const known = x >= left && Number.isFinite(value);
        if (known) pen[open ? "lineTo" : "moveTo"](x, y);
        open = known;
      });
      pen.stroke();
    });
  }
}
