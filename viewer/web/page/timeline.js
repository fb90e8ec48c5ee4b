// The time line: a lane for each part above the slider, touches and marks as bars, a ruler.

import { contrast } from "./labels.js";
import { words } from "./dom.js";
import { colours } from "./theme.js";

const EDGE = 8; // of the slider: half its handle [px]
const LANE = 10, HIGHEST = 78, TICKS = 14; // heights of a lane, of all at most, and of the ruler's times [px]
const SHORTEST = 0.5; // that the lanes can be zoomed to [s]
const STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 10800, 14400, 21600, 43200, 86400, 172800, 604800];
const CLICK = 4; // a press that moves less is a click [px]

// A time of a recording, as exact as what is seen is long [s].
export function clock(seconds, length) {
  if (length < 120) return `${seconds.toFixed(length < 20 ? 1 : 0)} s`;
  const whole = Math.round(seconds), two = (x) => `${x}`.padStart(2, "0"), minutes = Math.floor(whole / 60) % 60, hours = Math.floor(whole / 3600);
  if (length < 3600 && !hours) return `${minutes}:${two(whole % 60)}`;
  return `${hours}:${two(minutes)}${length < 3600 ? `:${two(whole % 60)}` : ""}`;
}

export class Timeline {
  // `seek` goes to a time, `zoomed` is told when something else is seen.
  constructor(canvas, seek, zoomed) {
    this.canvas = canvas;
    this.spans = []; // [from, to [s], colour, words, part ("" of a gap), whether it is a mark]
    this.lanes = [];
    this.all = [0, 0];
    this.zoom = null; // from when to when, where not all is seen [s]
    this.seek = seek;
    this.zoomed = zoomed;
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.point(event));
    canvas.addEventListener("dblclick", () => this.see(...this.all));
  }

  set(spans, lanes = this.lanes) {
    this.spans = spans;
    if (lanes.join() !== this.lanes.join()) this.lanes = lanes;
    this.drawn = "";
  }

  get view() {
    return this.zoom ?? this.all;
  }

  get laneHeight() {
    return Math.min(LANE, HIGHEST / Math.max(this.lanes.length, 1));
  }

  time(event) {
    const box = this.canvas.getBoundingClientRect(), [first, last] = this.view;
    const share = (event.clientX - box.left - EDGE) / (box.width - 2 * EDGE);
    return first + Math.min(Math.max(share, 0), 1) * (last - first);
  }

  see(low, high) {
    const [first, last] = this.all, length = Math.max(high - low, SHORTEST), from = Math.min(Math.max(low, first), last - length);
    this.zoom = length >= last - first ? null : [from, from + length];
    this.zoomed();
  }

  wheel(event) {
    event.preventDefault();
    const factor = event.deltaY > 0 ? 1.25 : 0.8, about = this.time(event), [low, high] = this.view;
    this.see(about - (about - low) * factor, about + (high - about) * factor);
  }

  press(event) {
    const { canvas } = this, [low, high] = this.view, start = event.clientX, width = canvas.clientWidth - 2 * EDGE;
    let far = false;
    const move = ({ clientX }) => {
      far ||= Math.abs(clientX - start) >= CLICK;
      const by = ((start - clientX) / width) * (high - low);
      if (far && this.zoom) this.see(low + by, high + by);
    };
    const end = (last) => {
      canvas.removeEventListener("pointermove", move);
      if (!far || !this.zoom) this.seek(this.time(last));
    };
    canvas.setPointerCapture(event.pointerId);
    canvas.addEventListener("pointermove", move);
    canvas.addEventListener("pointerup", end, { once: true });
  }

  point(event) {
    const box = this.canvas.getBoundingClientRect(), [low, high] = this.view, time = this.time(event);
    const lane = this.lanes[Math.floor((event.clientY - box.top - TICKS) / this.laneHeight)], near = (2 * (high - low)) / box.width;
    const here = this.spans.filter(([from, to, , , part]) => (part === lane || !part) && from - near <= time && time <= to + near).at(-1);
    this.canvas.title = `${clock(time, high - low)}  ${here ? here[3] : words(lane ?? "")}`;
  }

  // Follow the player: what is seen goes with it where it leaves that.
  draw(all, position, ratio) {
    if (all.join() !== this.all.join()) this.all = all;
    if (this.zoom && position !== this.position && (position < this.zoom[0] || position > this.zoom[1])) {
      const length = this.zoom[1] - this.zoom[0];
      this.see(position - 0.1 * length, position + 0.9 * length);
    }
    this.position = position;
    const { canvas } = this, [first, last] = this.view, ruler = this.lanes.length > 0;
    const tall = ruler ? Math.ceil(TICKS + this.lanes.length * this.laneHeight) : 10;
    if (canvas.style.height !== `${tall}px`) canvas.style.height = `${tall}px`;
    const width = canvas.clientWidth, key = [Math.round(first * 20), Math.round(last * 20), width, ratio, colours().dark].join();
    if (!width) return;
    if (key !== this.drawn) {
      this.drawn = key;
      this.lay(width, tall, ratio);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(this.laid, 0, 0);
    if (!(last > first)) return;
    pen.fillStyle = colours().ink;
    pen.fillRect(Math.round(ratio * this.place(position, width)), ratio * (ruler ? TICKS - 3 : 0), Math.max(1, ratio), canvas.height);
  }

  place(time, width) {
    const [first, last] = this.view;
    return EDGE + ((time - first) / (last - first)) * (width - 2 * EDGE);
  }

  // Lanes, bars and ruler, kept until they change.
  lay(width, tall, ratio) {
    const { canvas, lanes, laneHeight: thick } = this, [first, last] = this.view, shown = colours();
    this.laid = Object.assign(document.createElement("canvas"), { width: Math.round(width * ratio), height: Math.round(tall * ratio) });
    Object.assign(canvas, { width: this.laid.width, height: this.laid.height });
    const pen = this.laid.getContext("2d"), marked = this.spans.some((span) => span[5]), top = lanes.length ? TICKS : 0;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (!(last > first)) return;
    pen.fillStyle = pen.strokeStyle = shown.faint;
    pen.globalAlpha = 0.13;
    lanes.forEach((_, k) => pen.fillRect(EDGE, top + k * thick, width - 2 * EDGE, thick - 1));
    pen.globalAlpha = 1;
    for (const [from, to, tint, , part, mark] of this.spans) {
      if (to < first || from > last) continue;
      const left = this.place(Math.max(from, first), width), wide = Math.max(2, this.place(Math.min(to, last), width) - left);
      const low = mark ? 0.6 : 0, high = !mark && marked && part ? 0.55 : 1;
      for (const k of part ? [lanes.indexOf(part)] : lanes.keys()) {
        if (k < 0 && lanes.length) continue;
        const y = top + Math.max(k, 0) * thick + low * (thick - 1), h = lanes.length ? Math.max(1, (high - low) * (thick - 1)) : tall;
        pen.fillStyle = tint;
        pen.fillRect(left, y, wide, h);
        if (contrast(tint, shown.card) <= 2 && h > 3) pen.strokeRect(left + 0.5, y + 0.5, wide - 1, h - 1); // dark on dark: a rim shows it
      }
    }
    if (!lanes.length) return;
    const step = STEPS.find((one) => (last - first) / one <= Math.max(2, width / 90)) ?? STEPS.at(-1);
    Object.assign(pen, { font: "11px system-ui, sans-serif", fillStyle: shown.faint });
    for (let k = Math.ceil(first / step - 1e-9); k * step <= last + 1e-9; k += 1) {
      const x = this.place(k * step, width), text = clock(k * step, last - first), half = pen.measureText(text).width / 2;
      pen.fillRect(x, TICKS - 3, 1, tall);
      pen.fillText(text, Math.min(Math.max(x - half, 0), width - 2 * half), TICKS - 4);
    }
  }
}
