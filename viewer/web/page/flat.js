// The flat map of one part: the same values, outlines and clicks as on the body. It is drawn without
// the graphics card: each pixel knows its place on the sheet, as long as part and size stay.

import { ColourMap, css } from "./colour_map.js";
import { colours } from "./theme.js";

const packedPanel = () => {
  const [r, g, b] = colours().panel;
  return (0xff000000 | (b << 16) | (g << 8) | r) >>> 0;
};
const MARGIN = 1.06;
const GROUND = 0xffe8e3de; // 0xaabbggrr behind discs: those at rest are nearly white
const COVER = 0.6;
const RING = 0.5; // radius of a ring in spacings

export class Flat {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.paper = canvas.getContext("2d", { alpha: false });
    this.header = scene.header;
    this.arrays = scene.arrays;
    // Places of all vertices, then the others of those on a seam, and which vertices these are.
    const own = scene.arrays["sheet.uv"], seam = scene.arrays["seam.uv"];
    this.uv = new Float32Array(own.length + seam.length);
    this.uv.set(own);
    this.uv.set(seam, own.length);
    this.vertex = (k) => (2 * k < own.length ? k : scene.arrays["seam.vertices"][k - own.length / 2]);
    this.part = this.header.parts[0];
    this.categories = false;
    this.style = "surface";
    this.colourMap = new ColourMap([[0, 0, 0]], this.header.colours.unknown);
    this.lines = []; // {colour, ends: [u, v, u, v, ...], halo} [m]
    this.rings = []; // {number, tint} of the chosen taxels
    this.signs = [];
    this.lasso = null; // its corners [px]
    this.ready = false; // pixels are known for this part and size
    this.stale = true; // something else than values has changed
    this.shown = new Uint8Array(0);
  }

  setTable(rows) {
    this.colourMap = new ColourMap(rows, this.header.colours.unknown);
    this.stale = true;
  }

  setValues(codes, values) {
    this.codes = codes;
    this.values = values;
  }

  setLines(lines) {
    this.stale ||= lines.length > 0 || this.lines.length > 0;
    this.lines = lines;
  }

  setRings(rings) {
    this.rings = rings;
    this.ringed = false;
    this.stale = true;
  }

  setSigns(signs) {
    this.signs = signs; // {number, strokes} of taxels that are not to be trusted
    this.ringed = false;
    this.stale = true;
  }

  setLasso(lasso) {
    this.lasso = lasso && lasso.corners;
    this.stale = true;
  }

  resize(width, height) {
    if (this.canvas.width === width && this.canvas.height === height) return;
    this.canvas.width = width;
    this.canvas.height = height;
    this.ready = false;
  }

  show(name) {
    this.part = this.header.parts.find((part) => part.name === name) || this.part;
    this.ready = false;
  }

  // Middle and half the sides [m] of what the canvas shows.
  frame() {
    const { uv } = this, [start, size] = this.part.flat_faces;
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (const v of this.arrays["flat.faces"].subarray(start, start + size)) {
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

  // Find for each pixel the face it lies in, and draw what stays: dots and borders.
  prepare(ratio) {
    const { width, height } = this.canvas, { middle, half } = this.frame();
    this.scale = width / (2 * half[0]); // pixels a metre
    this.at = (u, v) => [width / 2 + (u - middle[0]) * this.scale, height / 2 - (v - middle[1]) * this.scale];
    this.image = new ImageData(width, height);
    this.cells = new Uint32Array(this.image.data.buffer).fill(packedPanel());
    this.places();
    this.dots = this.drawDots(ratio);
    this.border = this.drawBorder(ratio);
    this.ready = this.stale = true;
    this.ringed = false;
  }

  drawDots(ratio) {
    const over = new OffscreenCanvas(this.canvas.width, this.canvas.height), pen = over.getContext("2d");
    const radius = Math.min(this.part.dot * this.scale, 2.2 * ratio);
    pen.fillStyle = this.header.colours.dot;
    for (const [, x, y] of this.discs()) {
      pen.beginPath();
      pen.arc(x, y, radius, 0, 2 * Math.PI);
      pen.fill();
    }
    return over;
  }

  // Each taxel of the part with its place [px]; those on a seam have several.
  discs() {
    const { arrays, part } = this, [first, count] = part.taxels, [start, size] = part.seam_taxels;
    const found = (uv, k, number) => [number, ...this.at(uv[2 * k], uv[2 * k + 1])];
    return [
      ...Array.from({ length: count }, (_, k) => found(arrays["taxel.uv"], first + k, first + k)),
      ...Array.from({ length: size }, (_, k) => found(arrays["seam.dots"], start + k, arrays["seam.taxels"][start + k])),
    ];
  }

  drawBorder(ratio) {
    const over = new OffscreenCanvas(this.canvas.width, this.canvas.height), pen = over.getContext("2d");
    const { uv } = this, ends = this.arrays["flat.border"], [start, size] = this.part.flat_border;
    Object.assign(pen, { strokeStyle: this.header.colours.rim, lineWidth: ratio });
    pen.beginPath();
    for (let k = start; k < start + size; k++) pen[(k - start) % 2 ? "lineTo" : "moveTo"](...this.at(uv[2 * ends[k]], uv[2 * ends[k] + 1]));
    pen.stroke();
    return over;
  }

  // Rings around the chosen taxels of the part shown, drawn when others are chosen.
  drawRings(ratio) {
    const here = this.rings.filter(({ number }) => number >= this.part.taxels[0] && number < this.part.taxels[0] + this.part.taxels[1]);
    const signs = this.signs.filter(({ number }) => number >= this.part.taxels[0] && number < this.part.taxels[0] + this.part.taxels[1]);
    this.ringed = true;
    this.ringsOver = here.length + signs.length ? new OffscreenCanvas(this.canvas.width, this.canvas.height) : null;
    if (!this.ringsOver) return;
    const pen = this.ringsOver.getContext("2d"), uv = this.arrays["taxel.uv"], radius = RING * this.part.spacing * this.scale;
    for (const [style, width] of [["#ffffff", 4], [null, 2]]) {
      for (const { number, tint } of here) {
        Object.assign(pen, { strokeStyle: style || tint, lineWidth: width * ratio });
        pen.beginPath();
        pen.arc(...this.at(uv[2 * number], uv[2 * number + 1]), radius, 0, 2 * Math.PI);
        pen.stroke();
      }
    }
    const size = 0.8 * radius;
    for (const [style, width] of [["#ffffff", 0.7], ["#14171c", 0.3]]) {
      Object.assign(pen, { strokeStyle: style, lineWidth: Math.max(width * size, ratio), lineCap: "round" });
      pen.beginPath();
      for (const { number, strokes } of signs) {
        const [x, y] = this.at(uv[2 * number], uv[2 * number + 1]);
        for (const [[a, b], [c, d]] of strokes) {
          pen.moveTo(x + size * a, y - size * b);
          pen.lineTo(x + size * c, y - size * d);
        }
      }
      pen.stroke();
    }
  }

  // Pixels on the sheet: which, the three vertices around each, and the shares of the first two.
  places() {
    const { width, height } = this.canvas, { uv } = this, faces = this.arrays["flat.faces"];
    const [start, size] = this.part.flat_faces, face = new Int32Array(width * height).fill(-1);
    const shares = new Float32Array(2 * width * height);
    for (let f = start; f < start + size; f += 3) {
      const [a, b, c] = [0, 1, 2].map((i) => this.at(uv[2 * faces[f + i]], uv[2 * faces[f + i] + 1]));
      const area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
      if (!area) continue;
      const top = Math.max(0, Math.ceil(Math.min(a[1], b[1], c[1]) - 0.5)), bottom = Math.min(height - 1, Math.max(a[1], b[1], c[1]) - 0.5);
      const left = Math.max(0, Math.ceil(Math.min(a[0], b[0], c[0]) - 0.5)), right = Math.min(width - 1, Math.max(a[0], b[0], c[0]) - 0.5);
      for (let y = top; y <= bottom; y++) {
        for (let x = left; x <= right; x++) {
          const px = x + 0.5, py = y + 0.5;
          const s = ((b[0] - px) * (c[1] - py) - (c[0] - px) * (b[1] - py)) / area;
          const t = ((c[0] - px) * (a[1] - py) - (a[0] - px) * (c[1] - py)) / area;
          if (s < 0 || t < 0 || s + t > 1) continue;
          face[y * width + x] = f;
          shares[2 * (y * width + x)] = s;
          shares[2 * (y * width + x) + 1] = t;
        }
      }
    }
    this.pixels = Uint32Array.from(face.keys()).filter((p) => face[p] >= 0);
    this.corners = new Uint32Array(3 * this.pixels.length);
    this.shares = new Float32Array(2 * this.pixels.length);
    this.pixels.forEach((p, k) => {
      for (let i = 0; i < 3; i++) this.corners[3 * k + i] = this.vertex(faces[face[p] + i]);
      this.shares[2 * k] = shares[2 * p];
      this.shares[2 * k + 1] = shares[2 * p + 1];
    });
  }

  // Draw, unless nothing on this part has changed.
  draw(ratio) {
    if (!this.codes || !this.canvas.width || !this.canvas.height) return;
    const [first, count] = this.part.taxels, codes = this.codes.subarray(first, first + count);
    if (!this.ready) this.prepare(ratio);
    if (!this.stale && codes.every((code, k) => code === this.shown[k])) return;
    this.shown = codes.slice();
    this.stale = false;
    const sheet = this.style === "surface" && !this.categories;
    if (sheet) this.fillSheet();
    else for (const pixel of this.pixels) this.cells[pixel] = GROUND;
    this.paper.putImageData(this.image, 0, 0);
    if (sheet) this.paper.drawImage(this.dots, 0, 0);
    else this.drawDiscs(first, codes);
    this.paper.drawImage(this.border, 0, 0);
    if (!this.ringed) this.drawRings(ratio);
    if (this.ringsOver) this.paper.drawImage(this.ringsOver, 0, 0);
    this.drawLines(ratio);
  }

  fillSheet() {
    const { pixels, corners, shares, cells, values, colourMap } = this;
    for (let k = 0; k < pixels.length; k++) {
      const a = 2 * corners[3 * k], b = 2 * corners[3 * k + 1], c = 2 * corners[3 * k + 2];
      const s = shares[2 * k], t = shares[2 * k + 1], rest = 1 - s - t;
      cells[pixels[k]] = colourMap.sheet(
        s * values[a] + t * values[b] + rest * values[c],
        s * values[a + 1] + t * values[b + 1] + rest * values[c + 1],
      );
    }
  }

  drawDiscs(first, codes) {
    const { paper } = this, byCode = new Map();
    for (const [number, ...at] of this.discs()) {
      const code = codes[number - first];
      byCode.get(code)?.push(at) ?? byCode.set(code, [at]);
    }
    const radius = (this.style === "surface" ? COVER : 0.47) * this.part.spacing * this.scale;
    for (const [code, places] of byCode) {
      paper.fillStyle = css(this.colourMap.taxel(code));
      paper.beginPath();
      for (const [x, y] of places) {
        paper.moveTo(x + radius, y);
        paper.arc(x, y, radius, 0, 2 * Math.PI);
      }
      paper.fill();
    }
  }

  drawLines(ratio) {
    const { paper, lasso } = this;
    paper.lineCap = paper.lineJoin = "round";
    const stroke = (style, width, path) => Object.assign(paper, { strokeStyle: style, lineWidth: width * ratio }).stroke(path);
    const paths = this.lines.map(({ colour: tint, ends, halo }) => {
      const path = new Path2D();
      for (let k = 0; k < ends.length; k += 4) {
        path.moveTo(...this.at(ends[k], ends[k + 1]));
        path.lineTo(...this.at(ends[k + 2], ends[k + 3]));
      }
      return { path, tint, halo };
    });
    for (const { path, halo } of paths) if (halo) stroke("#ffffff", 5, path);
    for (const { path, tint, halo } of paths) stroke(tint, halo ? 2.5 : 1.5, path);
    if (!lasso) return;
    const path = new Path2D();
    lasso.forEach(([x, y]) => path.lineTo(x, y));
    path.closePath();
    stroke("#20262e", 1.5, path);
  }

  // Numbers of the taxels that a lasso on the canvas encloses.
  enclosed(lasso) {
    const uv = this.arrays["taxel.uv"], [first, count] = this.part.taxels;
    if (!this.ready) return [];
    return Array.from({ length: count }, (_, k) => first + k).filter((k) => lasso.holds(...this.at(uv[2 * k], uv[2 * k + 1])));
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
