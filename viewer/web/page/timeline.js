// Touches on the time line: a coloured span for each, above the slider.

import { contrast } from "./labels.js";
import { colours } from "./theme.js";

const EDGE = 8; // of the slider: half its handle [px]

export class Timeline {
  constructor(canvas) {
    this.canvas = canvas;
    this.spans = []; // [from, to [s], colour, words]
  }

  set(spans) {
    this.spans = spans;
    this.drawn = "";
  }

  draw([first, last], ratio) {
    const { canvas } = this, { clientWidth: width, clientHeight: height } = canvas;
    const key = [Math.round(first * 4), Math.round(last * 4), width, height, ratio, this.spans.length, colours().dark].join();
    if (key === this.drawn || !width) return;
    this.drawn = key;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext("2d"), place = (time) => EDGE + ((time - first) / (last - first)) * (width - 2 * EDGE);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    if (!(last > first)) return;
    for (const [from, to, tint] of this.spans) {
      if (to < first || from > last) continue;
      const left = place(Math.max(from, first)), right = place(Math.min(to, last));
      pen.fillStyle = tint;
      pen.fillRect(left, 1, Math.max(2, right - left), height - 2);
      if (contrast(tint, colours().card) > 2) continue; // dark on dark, light on light: a rim shows it
      pen.strokeStyle = colours().faint;
      pen.strokeRect(left + 0.5, 1.5, Math.max(2, right - left) - 1, height - 3);
    }
  }
}
