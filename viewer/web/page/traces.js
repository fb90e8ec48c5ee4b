// The plot below the map: what the server tells of it is drawn, up to what is shown.

import { made } from "./dom.js";
import { colours } from "./theme.js";

const FONT = "system-ui, sans-serif";
const SPANS = [1, 2, 5, 10, 20, 60]; // that a plot can have [s]

// Rows as bits in base64, the first in the lowest bit: a message has 4 kB at most.
function bits(rows) {
  const bytes = new Uint8Array(rows.length ? (Math.max(...rows) >> 3) + 1 : 0);
  for (const row of rows) bytes[row >> 3] |= 1 << (row & 7);
  return btoa(String.fromCharCode(...bytes));
}

export const rowsOf = (text) => [...atob(text)].flatMap((letter, k) => [...Array(8).keys()].filter((bit) => (letter.charCodeAt(0) >> bit) & 1).map((bit) => 8 * k + bit));

export class Traces {
  constructor(section, chosen, ask) {
    this.section = section;
    this.canvas = section.querySelector("canvas");
    this.chosen = chosen;
    this.ask = ask;
    this.plot = "taxels";
    this.seconds = 10;
    this.told = null; // the plot as it came
    this.cursor = null; // where values are told, in shares of the width
    this.canvas.addEventListener("wheel", (event) => this.zoom(event), { passive: false });
    this.canvas.addEventListener("pointermove", (event) => this.point(event));
    this.canvas.addEventListener("pointerleave", () => this.point(null));
  }

  // Ask for a course of the touches, or the chosen taxels of the part on the map, or of another.
  show(part) {
    const byPart = this.chosen.byPart(), on = byPart.has(part) ? part : [...byPart.keys()][0];
    const wanted = this.plot !== "taxels" || on;
    const taxels = on ? byPart.get(on).map((number) => number - on.taxels[0]) : [];
    const wish = { do: "plot", plot: wanted ? this.plot : null, part: on?.name ?? "", taxels: bits(taxels), seconds: this.seconds };
    const key = JSON.stringify(wish);
    if (!wanted) {
      this.section.hidden = true;
      this.told = null;
    }
    if (key === this.asked || (!wanted && !this.asked)) return;
    this.asked = key;
    this.wish = wish;
    this.ask(wish);
  }

  // Connected again: the server knows nothing of what was asked.
  again() {
    if (this.wish?.plot) this.ask(this.wish);
  }

  zoom(event) {
    event.preventDefault();
    const place = SPANS.indexOf(this.seconds) + (event.deltaY > 0 ? 1 : -1);
    this.seconds = SPANS[Math.min(Math.max(place, 0), SPANS.length - 1)];
    if (this.wish) this.ask((this.wish = { ...this.wish, seconds: this.seconds }));
    this.asked = JSON.stringify(this.wish);
  }

  point(event) {
    const box = this.canvas.getBoundingClientRect();
    this.cursor = event && (event.clientX - box.left - 34) / (box.width - 38);
    if (this.told) this.take(this.told);
  }

  take(told) {
    if (!this.wish?.plot) return; // it was put away meanwhile
    this.told = told;
    this.section.hidden = false;
    const { times, lines, span } = told;
    let at = -1;
    if (this.cursor !== null && times.length) {
      const wanted = (this.cursor - 1) * span;
      at = times.reduce((best, time, k) => (Math.abs(time - wanted) < Math.abs(times[best] - wanted) ? k : best), 0);
    }
    const value = (k) => (lines[k][at] === null ? "-" : `${Number(lines[k][at].toPrecision(3))}`);
    this.write(told.title, told.names.map((name, k) => (at < 0 ? name : `${name}: ${value(k)}`)), told.note);
    this.draw(told, at);
  }

  write(title, names, note) {
    const said = [title, ...names, note].join("\n");
    if (this.said === said) return;
    this.said = said;
    this.section.querySelector("h2").textContent = title;
    const tints = [...this.chosen.header.traces.slice(0, names.length), colours().faint];
    this.section.querySelector("ol").replaceChildren(...[...names, ...(note ? [note] : [])].map((name, k) => {
      const item = made("li", name);
      item.style.color = tints[k];
      return item;
    }));
  }

  draw({ times, lines, top: most, span, levels }, at) {
    const { canvas } = this, ratio = Math.min(window.devicePixelRatio || 1, 2), pen = canvas.getContext("2d");
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const left = 34, right = width - 4, top = 8, bottom = height - 18;
    const across = (time) => right + (time / span) * (right - left), up = (value) => bottom - (Math.min(value, most) / most) * (bottom - top);
    Object.assign(pen, { strokeStyle: colours().faint, fillStyle: colours().faint, lineWidth: 1, lineJoin: "round", font: `12px ${FONT}`, textAlign: "right" });
    const path = (points) => {
      pen.beginPath();
      points.forEach((p) => pen.lineTo(...p));
      pen.stroke();
    };
    path([[left, top], [left, bottom], [right, bottom]]);
    for (const level of Object.values(levels)) path([[left, up(level)], [right, up(level)]]);
    pen.fillText(`${most}`, left - 4, top + 5);
    pen.fillText("0", left - 4, bottom + 3);
    pen.fillText(at < 0 ? "now" : `${times[at].toFixed(2)} s`, right, height - 3);
    pen.textAlign = "left";
    pen.fillText(`-${span} s`, left, height - 3);
    if (at >= 0) path([[across(times[at]), top], [across(times[at]), bottom]]);
    pen.lineWidth = 1.6;
    lines.forEach((values, k) => {
      pen.strokeStyle = this.chosen.header.traces[k];
      pen.beginPath();
      let open = false;
      values.forEach((value, i) => {
        const x = across(times[i]), known = x >= left - 1 && value !== null;
        if (known) pen[open ? "lineTo" : "moveTo"](x, up(value));
        open = known;
      });
      pen.stroke();
    });
  }
}
