// From a value to its colour, written once for scripts and once for the graphics card, side by side:
// both take the nearest row of the table, and clamp what smoothing carried beyond its ends.

import { colour } from "./packing.js";

const UNKNOWN = 255; // the byte of a taxel of which nothing is known
const HALF = 0.5; // share of a value that must be known for it to be drawn
const packed = ([r, g, b]) => (0xff000000 | (b << 16) | (g << 8) | r) >>> 0;
const bytes = (hex) => colour(hex).map((x) => Math.round(255 * x));

export class ColourMap {
  // rows: [red, green, blue] of each byte of a taxel, 0 to 255; unknown: "#rrggbb".
  constructor(rows, unknown) {
    this.cells = Uint32Array.from(rows, packed);
    this.unknown = packed(bytes(unknown));
  }

  // Of a sheet's point: a sum of weighted bytes, and the sum of the weights that are known. 0xaabbggrr.
  sheet(value, known) {
    const { cells } = this, top = cells.length - 1;
    if (!(known >= HALF)) return this.unknown;
    const row = Math.floor(value / known + 0.5);
    return cells[row > 0 ? (row < top ? row : top) : 0];
  }

  taxel(code) {
    const { cells } = this;
    return code === UNKNOWN ? this.unknown : cells[code < cells.length ? code : cells.length - 1];
  }
}

export const css = (cell) => `rgb(${cell & 255} ${(cell >> 8) & 255} ${(cell >> 16) & 255})`;

// The same for the graphics card.
export const COLOURS = `
uniform sampler2D table; uniform float size; uniform vec3 unknown;
vec3 sheetColour(vec2 value) {
  if (!(value.y >= ${HALF})) return unknown;
  float row = clamp(floor(value.x / value.y + 0.5), 0.0, size - 1.0);
  return texelFetch(table, ivec2(int(row), 0), 0).rgb;
}
vec3 taxelColour(float row) {
  if (row > ${UNKNOWN - 0.5}) return unknown;
  return texelFetch(table, ivec2(int(min(row + 0.5, size - 0.5)), 0), 0).rgb;
}`;
