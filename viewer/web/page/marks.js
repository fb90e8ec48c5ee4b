// Lines on body and flat map: outlines, normals and trails of touches, rings around chosen taxels.

import { cross, place, turn, unit } from "./matrices.js";
import { colour } from "./packing.js";

const LIFT = 0.0009; // outlines above the sheet [m]
const RISE = 0.004; // trails above the skin [m]
const ARROW = 0.05; // length of a normal [m]
const RING = 0.55; // radius of a ring in spacings
const MANY = 60; // rings that have all their sides

export class Marks {
  constructor({ header, arrays }, picture, flat) {
    Object.assign(this, { header, arrays, picture, flat });
    this.ringed = null;
  }

  showTouches({ header: { touches }, arrays }) {
    const round = [], flat = [];
    for (const touch of touches) {
      const part = this.header.parts.find((one) => one.name === touch.part);
      const model = this.picture.model(part.link), tint = colour(touch.colour);
      const line = this.outline(touch, arrays, model, tint, round);
      if (part === this.flat.part) flat.push({ colour: touch.colour, ends: line, halo: true });
      const foot = place(model, touch.centre), up = turn(model, touch.normal);
      round.push(foot[0], foot[1], foot[2], ...[0, 1, 2].map((i) => foot[i] + ARROW * up[i]), ...tint);
      const trail = (touch.path || []).map((p) => place(model, p).map((x, i) => x + (i < 3 ? RISE * up[i] : 0)));
      for (let k = 1; k < trail.length; k++) round.push(...trail[k - 1].slice(0, 3), ...trail[k].slice(0, 3), ...tint);
    }
    this.picture.touches.set(round);
    this.flat.setLines(flat);
  }

  // Add a touch's outline to the body's lines; its ends on the flat map come back.
  outline(touch, arrays, model, tint, round) {
    const points = this.arrays["sheet.points"], normals = this.arrays["sheet.normals"], uv = this.arrays["sheet.uv"];
    const ends = arrays[touch.outline], shares = arrays[`${touch.outline}.share`], line = [];
    for (let k = 0; k < shares.length; k++) {
      const s = shares[k] / 65535, a = ends[2 * k], b = ends[2 * k + 1];
      const mix = (array, width, i) => array[width * a + i] * (1 - s) + array[width * b + i] * s;
      const p = [0, 1, 2].map((i) => mix(points, 3, i) + (LIFT * mix(normals, 4, i)) / 127);
      round.push(...place(model, p).slice(0, 3));
      line.push(mix(uv, 2, 0), mix(uv, 2, 1));
      if (k % 2) round.push(...tint);
    }
    return line;
  }

  // Rings around what is chosen, in the colours of their traces; drawn anew where anything moved.
  showChosen(chosen, moved = false) {
    if (this.ringed === chosen.version && !moved) return;
    this.ringed = chosen.version;
    const round = [], flat = [];
    for (const [part, numbers] of chosen.byPart()) {
      const tints = chosen.tints(numbers.length);
      numbers.forEach((number, k) => {
        this.ring(part, number, colour(tints[k]), chosen.count > MANY ? 6 : 12, round);
        flat.push({ number, tint: tints[k] });
      });
    }
    this.picture.chosen.set(round);
    this.flat.setRings(flat);
  }

  ring(part, number, tint, sides, round) {
    const points = this.arrays["taxel.points"], model = this.picture.model(part.link);
    const up = unit([...this.arrays["taxel.normals"].subarray(4 * number, 4 * number + 3)]);
    const right = unit(cross(up, Math.abs(up[0]) < 0.6 ? [1, 0, 0] : [0, 1, 0])), ahead = cross(up, right);
    const corner = (c) => {
      const x = RING * part.spacing * Math.cos((2 * Math.PI * c) / sides), y = RING * part.spacing * Math.sin((2 * Math.PI * c) / sides);
      return place(model, [0, 1, 2].map((i) => points[3 * number + i] + x * right[i] + y * ahead[i] + LIFT * up[i])).slice(0, 3);
    };
    for (let c = 0; c < sides; c++) round.push(...corner(c), ...corner(c + 1), ...tint);
  }
}
