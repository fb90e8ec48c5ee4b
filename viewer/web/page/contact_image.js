// The contact image of a part in the head of its flat map, as image classifiers see it: the share of the
// largest pressure in 256 grey levels, interpolated in the flat map's own triangles.

const UNKNOWN = 255; // the byte of a taxel of which nothing is known
const FELT = 12; // the byte below which a taxel is at rest, as in the window: its noise is not stretched to white

export class ContactImage {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.paper = canvas.getContext("2d");
    this.arrays = scene.arrays;
  }

  // codes: a byte for each taxel, 0 without pressure; null where the layer shown is of something else.
  draw(part, codes) {
    const [first, count] = part.taxels;
    const largest = codes ? codes.subarray(first, first + count).reduce((most, code) => (code !== UNKNOWN && code > most ? code : most), 0) : 0;
    this.canvas.style.visibility = largest >= FELT ? "visible" : "hidden"; // its room stays: nothing jumps
    if (largest < FELT) return;
    const [rows, columns] = part.image, [start, size] = part.image_pixels;
    const { "image.pixels": pixels, "image.taxels": taxels, "image.weights": weights } = this.arrays;
    const image = new ImageData(columns, rows), cells = new Uint32Array(image.data.buffer).fill(0xff000000);
    for (let k = start; k < start + size; k++) {
      let sum = 0;
      for (let i = 3 * k; i < 3 * k + 3; i++) if (codes[taxels[i]] !== UNKNOWN) sum += weights[i] * codes[taxels[i]];
      const level = Math.min(255, Math.floor(sum / largest));
      cells[pixels[k]] = (0xff000000 | (level << 16) | (level << 8) | level) >>> 0;
    }
    this.canvas.width = columns;
    this.canvas.height = rows;
    this.paper.putImageData(image, 0, 0);
  }
}
