// The flat map of one part: the same values, outlines and clicks as on the body.

import { Pieces } from "./pieces.js";
import { colour } from "./packing.js";
import { flatten } from "./matrices.js";

const MARGIN = 1.06;
const GROUND = [0.87, 0.89, 0.91]; // behind discs: those at rest are nearly white
const COVER = 0.6;
const STILL = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);

export class Flat extends Pieces {
  constructor(canvas, scene) {
    super(canvas, scene);
    const gl = this.gl, a = this.arrays;
    this.canvas = canvas;
    this.part = this.header.parts[0];
    this.categories = false;
    this.style = "surface";
    const uv = this.buffer(a["sheet.uv"]);
    this.sheet = this.array("sheet", { position: [uv, 2, gl.FLOAT], value: [this.vertexValues, 2, gl.FLOAT] }, a["flat.faces"]);
    this.border = this.array("sheet", { position: [uv, 2, gl.FLOAT] }, a["flat.border"]);
    const centres = new Float32Array(3 * this.taxels), axes = new Int8Array(4 * this.taxels);
    for (let k = 0; k < this.taxels; k++) {
      centres.set(a["taxel.uv"].subarray(2 * k, 2 * k + 2), 3 * k);
      axes[4 * k + 2] = 127;
    }
    this.hexes = this.hexagons(centres, axes);
    this.stale = true; // something else than values has changed
    this.shown = [];
    gl.disable(gl.DEPTH_TEST);
  }

  setLines(segments) {
    this.stale ||= segments.length > 0 || this.ribbons?.count > 0;
    super.setLines(segments);
  }

  show(name) {
    this.part = this.header.parts.find((part) => part.name === name) || this.part;
  }

  // Middle and half the sides [m] of what the canvas shows.
  frame() {
    const uv = this.arrays["sheet.uv"], [first, count] = this.part.vertices;
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (let v = first; v < first + count; v++) {
      for (let k = 0; k < 2; k++) {
        low[k] = Math.min(low[k], uv[2 * v + k]);
        high[k] = Math.max(high[k], uv[2 * v + k]);
      }
    }
    const sides = [0, 1].map((k) => Math.max(high[k] - low[k], 1e-3) / 2);
    const metres = MARGIN * Math.max(sides[0] / this.canvas.width, sides[1] / this.canvas.height);
    return {
      middle: [0, 1].map((k) => (low[k] + high[k]) / 2),
      half: [metres * this.canvas.width, metres * this.canvas.height],
    };
  }

  // Draw, unless nothing on this part has changed.
  draw(ratio) {
    const [first, count] = this.part.taxels;
    const codes = this.spread.slice(6 * first, 6 * (first + count));
    if (!this.stale && codes.every((code, k) => code === this.shown[k])) return;
    this.shown = codes;
    this.stale = false;
    const gl = this.gl, { middle, half } = this.frame(), seen = flatten(middle, half);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    const common = { seen, model: STILL, camera: STILL, lit: 0, ...this.colours() };
    const sheet = this.style === "surface" && !this.categories;
    gl.clearColor(...(sheet ? [1, 1, 1] : GROUND), 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (sheet) {
      this.use("sheet", common);
      gl.bindVertexArray(this.sheet);
      gl.drawElements(gl.TRIANGLES, this.part.flat_faces[1], gl.UNSIGNED_INT, 4 * this.part.flat_faces[0]);
    }
    const pixel = (2 * half[1]) / this.canvas.height;
    const how = sheet
      ? { radius: Math.min(this.part.dot, 2.2 * ratio * pixel), mode: 1, plain: colour(this.header.colours.dot) }
      : { radius: (this.style === "surface" ? COVER : 0.47) * this.part.spacing };
    this.drawHexagons(this.hexes, this.part.taxels, { ...common, ...how });
    if (sheet) {
      this.use("sheet", { ...common, unknown: colour(this.header.colours.rim) });
      gl.bindVertexArray(this.border);
      gl.drawElements(gl.LINES, this.part.flat_border[1], gl.UNSIGNED_INT, 4 * this.part.flat_border[0]);
    }
    const pixels = [this.canvas.width, this.canvas.height].map((x) => x / 2 / ratio);
    this.drawLines(seen, pixels, 5, 0, [1, 1, 1, 1]);
    this.drawLines(seen, pixels, 2.5, 0, [0, 0, 0, 0]);
  }

  // Number of the taxel nearest to a point of the canvas [px], among all taxels; -1 outside.
  taxelAt(x, y) {
    const { middle, half } = this.frame(), uv = this.arrays["taxel.uv"], [first, count] = this.part.taxels;
    const u = middle[0] + half[0] * ((2 * x) / this.canvas.width - 1);
    const v = middle[1] - half[1] * ((2 * y) / this.canvas.height - 1);
    let best = -1, least = this.part.spacing;
    for (let k = first; k < first + count; k++) {
      const gap = Math.hypot(uv[2 * k] - u, uv[2 * k + 1] - v);
      if (gap < least) [best, least] = [k, gap];
    }
    return best;
  }
}
