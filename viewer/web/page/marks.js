// Lines on body and flat map: outlines, normals and trails of touches, rings around chosen taxels.

import { cross, place, turn, unit } from "./matrices.js";
import { colour } from "./packing.js";
import { SIGNS } from "./signs.js";

const LIFT = 0.0009; // outlines above the sheet [m], as all lengths here where the scale of a part is 1
const RISE = 0.004; // trails above the skin [m]
const ARROW = 0.05; // length of a normal [m]
const BARB = 0.3; // of the arrow of a motion, its head
const RING = 0.55; // radius of a ring in spacings
const SIGN = 0.4; // radius of a sign in spacings
const INK = [0.08, 0.09, 0.11];
const FADED = 0.6; // how far what is silent goes to the ground
const TORN = 3; // longer than on the skin no piece of an outline becomes on the flat map
const MANY = 60; // rings that have all their sides

export class Marks {
  constructor({ header, arrays }, picture, flat) {
    Object.assign(this, { header, arrays, picture, flat });
    this.ringed = null;
  }

  showTouches({ header: { touches, stale }, arrays }) {
    const pale = (tint) => (stale ? tint.map((x) => x + (0.95 - x) * FADED) : tint);
    const round = [], flat = [];
    for (const touch of touches) {
      const part = this.header.parts.find((one) => one.name === touch.part);
      const to = this.picture.parts.has(touch.part) ? round : [];
      const model = this.picture.model(part.link), tint = pale(colour(touch.colour));
      const line = this.outline(touch, arrays, model, tint, to, LIFT * part.scale);
      if (part === this.flat.part) flat.push({ colour: `rgb(${tint.map((x) => Math.round(255 * x)).join(" ")})`, ends: line, halo: true });
      const foot = place(model, touch.centre), up = turn(model, touch.normal);
      to.push(foot[0], foot[1], foot[2], ...[0, 1, 2].map((i) => foot[i] + ARROW * part.scale * up[i]), ...tint);
      const trail = (touch.path || []).map((p) => place(model, p).map((x, i) => x + (i < 3 ? RISE * part.scale * up[i] : 0)));
      if (touch.ahead) this.ahead(touch, model, foot, up, tint, to, RISE * part.scale);
      for (let k = 1; k < trail.length; k++) to.push(...trail[k - 1].slice(0, 3), ...trail[k].slice(0, 3), ...tint);
    }
    this.picture.touches.set(round);
    this.flat.setLines(flat);
  }

  // An arrow over the skin where a touch moves.
  ahead(touch, model, foot, up, tint, to, rise) {
    const step = turn(model, touch.ahead), side = cross(step, up), start = [0, 1, 2].map((i) => foot[i] + 1.5 * rise * up[i]);
    const tip = start.map((x, i) => x + step[i]);
    const barbs = [-1, 1].map((sign) => tip.map((x, i) => x + BARB * (0.5 * sign * side[i] - step[i])));
    for (const [a, b] of [[start, tip], [tip, barbs[0]], [tip, barbs[1]], [barbs[0], barbs[1]]]) to.push(...a, ...b, ...tint);
  }

  // Add a touch's outline to the body's lines; its ends on the flat map come back.
  outline(touch, arrays, model, tint, round, lift) {
    const points = this.arrays["sheet.points"], normals = this.arrays["sheet.normals"], uv = this.arrays["sheet.uv"];
    const ends = arrays[touch.outline], shares = arrays[`${touch.outline}.share`], line = [];
    for (let k = 0; k < shares.length; k++) {
      const s = shares[k] / 65535, a = ends[2 * k], b = ends[2 * k + 1];
      const mix = (array, width, i) => array[width * a + i] * (1 - s) + array[width * b + i] * s;
      const p = [0, 1, 2].map((i) => mix(points, 3, i) + (lift * mix(normals, 4, i)) / 127);
      round.push(...place(model, p).slice(0, 3));
      line.push(mix(uv, 2, 0), mix(uv, 2, 1));
      if (!(k % 2)) continue;
      // Over a seam of the flat map a piece would lie right across it.
      const [ax, ay, az, bx, by, bz] = round.slice(-6), [au, av, bu, bv] = line.slice(-4);
      if (Math.hypot(bu - au, bv - av) > TORN * Math.hypot(bx - ax, by - ay, bz - az)) line.length -= 4;
      round.push(...tint);
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
        if (this.picture.parts.has(part.name)) this.ring(part, number, colour(tints[k]), chosen.count > MANY ? 6 : 12, round);
        flat.push({ number, tint: tints[k] });
      });
    }
    this.picture.chosen.set(round);
    this.flat.setRings(flat);
  }

  ring(part, number, tint, sides, round) {
    const at = this.around(part, number, RING);
    const corner = (c) => at(Math.cos((2 * Math.PI * c) / sides), Math.sin((2 * Math.PI * c) / sides));
    for (let c = 0; c < sides; c++) round.push(...corner(c), ...corner(c + 1), ...tint);
  }

  // Places around a taxel in the plane of the skin: its own up is the robot's where that lies in it.
  around(part, number, radius) {
    const points = this.arrays["taxel.points"], model = this.picture.model(part.link);
    const up = unit([...this.arrays["taxel.normals"].subarray(4 * number, 4 * number + 3)]);
    const level = cross([0, 0, 1], up), right = Math.hypot(...level) > 0.1 ? unit(level) : unit(cross(up, [0, 1, 0]));
    const ahead = cross(up, right), size = radius * part.spacing;
    return (x, y) => place(model, [0, 1, 2].map((i) => points[3 * number + i] + size * (x * right[i] + y * ahead[i]) + LIFT * part.scale * up[i])).slice(0, 3);
  }

  // Signs on taxels whose values mean nothing: those that the sample names, and those that sent nothing
  // where others of their part did, unless the layer has another reason to be grey.
  showSigns({ header: { signs = {} }, arrays: { values: codes } }, grey, moved = false) {
    const said = new Map(Object.entries(signs).flatMap(([name, numbers]) => numbers.map((number) => [number, name])));
    for (const { taxels: [first, count] } of this.header.parts) {
      const own = codes.subarray(first, first + count);
      if (grey || own.every((code) => code === 255)) continue;
      own.forEach((code, k) => code === 255 && !said.has(first + k) && said.set(first + k, "stale"));
    }
    const key = [...said].join();
    if (key === this.signed && !moved) return;
    this.signed = key;
    const round = [], flat = [];
    for (const [number, name] of said) {
      const part = this.header.parts.find(({ taxels: [first, count] }) => number >= first && number < first + count);
      flat.push({ number, strokes: SIGNS[name] });
      if (!this.picture.parts.has(part.name)) continue;
      const at = this.around(part, number, SIGN);
      for (const [from, to] of SIGNS[name]) round.push(...at(...from), ...at(...to), ...INK);
    }
    this.picture.signs.set(round);
    this.flat.setSigns(flat);
  }
}
