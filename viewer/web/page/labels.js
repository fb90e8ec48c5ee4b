// Boxed names of touches beside the robot, each with a line to its centre.

import { colour } from "./packing.js";
import { colours } from "./theme.js";

const GAP = 6; // between two boxes [px]
const TOP = 64; // below heading and status [px]
const SVG = "http://www.w3.org/2000/svg";

const READABLE = 4.5; // contrast of letters (WCAG 2.1)
const linear = (share) => (share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4);

// 1 to 21, of letters on their ground.
export function contrast(one, other) {
  const [a, b] = [one, other].map((hex) => {
    const [r, g, blue] = colour(hex).map(linear);
    return 0.2126 * r + 0.7152 * g + 0.0722 * blue + 0.05;
  });
  return Math.max(a, b) / Math.min(a, b);
}

// The colour of a class for letters on a panel; ink where they could not be read.
export function readable(hex) {
  const { card, ink } = colours();
  return contrast(hex, card) < READABLE ? ink : hex;
}

export class Labels {
  constructor(holder, leaders) {
    this.holder = holder;
    this.leaders = leaders;
    this.made = new Map();
  }

  // touches: [{key, text, colour, at: [x, y] px, hidden}], room: {width, height, taken: lowest left y}
  show(touches, room) {
    for (const [key, { box, line }] of this.made) {
      if (touches.some((touch) => touch.key === key)) continue;
      box.remove();
      line.remove();
      this.made.delete(key);
    }
    const middle = touches.reduce((sum, touch) => sum + touch.at[0], 0) / (touches.length || 1);
    const sides = { left: [], right: [] };
    for (const touch of touches) {
      const one = this.made.get(touch.key) || this.make(touch.key);
      this.write(one, touch);
      // A side once chosen is kept while the touch lasts, unless the touch wanders far across.
      const across = touch.at[0] - room.width / 2;
      if (!one.side || Math.abs(across) > 0.12 * room.width) {
        one.side = (touches.length > 1 ? touch.at[0] - (middle + room.width / 2) / 2 : across) < 0 ? "left" : "right";
      }
      sides[one.side].push({ ...touch, ...one, });
    }
    // Boxes that do not fit above the legend stand on the other side.
    const above = sides.left.reduce((sum, { height }) => sum + height + GAP, TOP);
    if (above > room.taken + GAP) sides.right.push(...sides.left.splice(0));
    for (const side of ["left", "right"]) this.stack(sides[side], side, room);
  }

  // What stands in a box changes rarely, and its size is asked for only then: that costs a layout.
  write(one, { text, colour: tint, hidden }) {
    const said = `${text} ${tint} ${hidden}`;
    if (one.said === said) return;
    one.said = said;
    one.box.textContent = text;
    one.box.style.borderColor = tint;
    one.box.style.color = readable(tint);
    one.box.classList.toggle("hidden", hidden);
    one.line.setAttribute("stroke", tint);
    one.line.setAttribute("stroke-dasharray", hidden ? "3 3" : "none");
    one.height = one.box.offsetHeight;
    one.width = one.box.offsetWidth;
  }

  // Letters for the light or the dark, from the next picture on.
  themed() {
    for (const one of this.made.values()) one.said = "";
  }

  make(key) {
    const box = document.createElement("div");
    box.className = "label";
    this.holder.append(box);
    const line = document.createElementNS(SVG, "path");
    this.leaders.append(line);
    const one = { box, line, side: "" };
    this.made.set(key, one);
    return one;
  }

  stack(column, side, room) {
    column.sort((a, b) => a.at[1] - b.at[1]);
    const bottom = side === "left" ? room.taken : room.height - 12;
    let y = TOP;
    for (const one of column) {
      one.y = Math.max(y, one.at[1] - one.height / 2 - 30);
      y = one.y + one.height + GAP;
    }
    let limit = bottom;
    for (const one of [...column].reverse()) {
      one.y = Math.max(TOP, Math.min(one.y, limit - one.height));
      limit = one.y - GAP;
    }
    const inset = Math.max(12, 0.08 * room.width);
    for (const { box, line, at, y: upper, width, height } of column) {
      const x = side === "left" ? inset : room.width - inset - width;
      box.style.transform = `translate(${x.toFixed(1)}px, ${upper.toFixed(1)}px)`;
      const start = side === "left" ? x + width : x;
      const mid = upper + height / 2, [ax, ay] = at.map((v) => v.toFixed(1));
      line.setAttribute("d", `M${start.toFixed(1)} ${mid.toFixed(1)}L${ax} ${ay}m-3 0a3 3 0 1 0 6 0a3 3 0 1 0 -6 0`);
    }
  }
}
