// The picture while camera and robot rest, where software draws: each pixel of the skin is coloured
// here and lines are drawn over them, as a pass of a software card over the picture takes far longer.

const NEARER = 2e-4; // lines before what they lie on, of all depths
const PIECE = 6; // longest piece of a line that is hidden or seen as a whole [px]

export class Rest {
  constructor(canvas) {
    this.canvas = canvas;
    this.paper = canvas.getContext("2d", { alpha: false });
    this.still = null;
    canvas.hidden = true;
  }

  // Take over the kept picture: its colours (4 bytes a pixel) and places (4 numbers), from below upwards.
  take(width, height, colours, places, faces) {
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    this.image = new ImageData(width, height);
    this.cells = new Uint32Array(this.image.data.buffer);
    this.depths = new Float32Array(width * height);
    const depths = new Float32Array(places.buffer), from = new Uint32Array(colours.buffer), skin = [];
    for (let y = 0; y < height; y++) {
      const row = (height - 1 - y) * width;
      this.cells.set(from.subarray(row, row + width), y * width);
      for (let x = 0; x < width; x++) {
        const k = 4 * (row + x);
        this.depths[y * width + x] = depths[k + 2];
        if (places[k]) skin.push(y * width + x, k);
      }
    }
    const n = skin.length / 2;
    this.pixels = new Uint32Array(n);
    this.corners = new Uint32Array(3 * n); // vertices of the sheet; or a taxel, three times
    this.shares = new Float32Array(2 * n);
    this.shades = new Float32Array(n);
    this.ofTaxels = false;
    for (let i = 0; i < n; i++) {
      const k = skin[2 * i + 1], what = places[k], about = places[k + 1];
      this.pixels[i] = skin[2 * i];
      this.shares[2 * i] = (about & 4095) / 4095;
      this.shares[2 * i + 1] = ((about >> 12) & 4095) / 4095;
      this.shades[i] = (about >>> 24) / 255;
      this.ofTaxels = what >= 0x80000000;
      for (let c = 0; c < 3; c++) this.corners[3 * i + c] = this.ofTaxels ? what & 0x7fffffff : faces[3 * (what - 1) + c];
    }
  }

  // Colour the skin: by the bytes of the taxels or the values of the sheets' vertices.
  draw(codes, values, colours) {
    const { pixels, corners, shares, shades, cells, ofTaxels } = this;
    for (let k = 0; k < pixels.length; k++) {
      const a = corners[3 * k], shade = shades[k];
      let cell;
      if (ofTaxels) cell = colours.taxel(codes[a]);
      else {
        const b = corners[3 * k + 1], c = corners[3 * k + 2], s = shares[2 * k], t = shares[2 * k + 1], rest = 1 - s - t;
        cell = colours.sheet(
          s * values[2 * a] + t * values[2 * b] + rest * values[2 * c],
          s * values[2 * a + 1] + t * values[2 * b + 1] + rest * values[2 * c + 1],
        );
      }
      const blue = ((cell >> 16) & 255) * shade + 0.5, green = ((cell >> 8) & 255) * shade + 0.5;
      cells[pixels[k]] = 0xff000000 | (blue << 16) | (green << 8) | ((cell & 255) * shade + 0.5);
    }
    this.paper.putImageData(this.image, 0, 0);
    this.canvas.hidden = false;
  }

  // Lines that stay while nothing moves: traced once, and laid over each sample.
  setStill(segments, matrix, width, around) {
    this.still = null;
    if (!segments.length) return;
    const { paper } = this, { width: w, height: h } = this.canvas;
    this.still = new OffscreenCanvas(w, h);
    this.paper = this.still.getContext("2d");
    this.drawLines(segments, matrix, width, around);
    this.paper = paper;
  }

  drawStill() {
    if (this.still) this.paper.drawImage(this.still, 0, 0);
  }

  hide() {
    this.canvas.hidden = true;
  }

  // Segments as ribbons have them, seen through a matrix; the white around them lies under all of them.
  drawLines(segments, matrix, width, around) {
    if (!segments.length) return;
    const paths = new Map();
    for (let k = 0; k < segments.length; k += 9) {
      const tint = `rgb(${[6, 7, 8].map((i) => Math.round(255 * segments[k + i])).join(" ")})`;
      if (!paths.has(tint)) paths.set(tint, new Path2D());
      this.trace(paths.get(tint), this.place(segments, k, matrix), this.place(segments, k + 3, matrix));
    }
    this.paper.lineCap = this.paper.lineJoin = "round";
    for (const [style, wide] of around ? [["#ffffff", around], [null, width]] : [[null, width]]) {
      for (const [tint, path] of paths) {
        Object.assign(this.paper, { strokeStyle: style || tint, lineWidth: wide });
        this.paper.stroke(path);
      }
    }
  }

  trace(path, from, to) {
    const pieces = Math.max(1, Math.min(200, Math.ceil(Math.hypot(to[0] - from[0], to[1] - from[1]) / PIECE)));
    let last = from, seen = this.isSeen(from);
    for (let k = 1; k <= pieces; k++) {
      const next = from.map((x, i) => x + ((to[i] - x) * k) / pieces), visible = this.isSeen(next);
      if (seen && visible) {
        path.moveTo(last[0], last[1]);
        path.lineTo(next[0], next[1]);
      }
      [last, seen] = [next, visible];
    }
  }

  isSeen([x, y, depth]) {
    const { width, height } = this.canvas;
    if (x < 0 || y < 0 || x >= width || y >= height) return false;
    return depth - NEARER <= this.depths[(y | 0) * width + (x | 0)];
  }

  // Where a point [m] is in the picture [px], and its depth.
  place(list, k, m) {
    const [x, y, z, w] = [0, 1, 2, 3].map((r) => m[r] * list[k] + m[4 + r] * list[k + 1] + m[8 + r] * list[k + 2] + m[12 + r]);
    return [(0.5 + x / w / 2) * this.canvas.width, (0.5 - y / w / 2) * this.canvas.height, 0.5 + z / w / 2];
  }
}
