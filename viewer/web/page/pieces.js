// Parts of a picture on the graphics card: what the body and the flat map both draw.

import { BODY, DISC, LINE, SHEET, SHELL, program } from "./shaders.js";
import { cross, unit } from "./matrices.js";
import { colour } from "./packing.js";

const SIDES = 6; // of the hexagon that stands for a taxel

export class Pieces {
  constructor(canvas, scene) {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, depth: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser offers no WebGL2");
    this.gl = gl;
    this.header = scene.header;
    this.arrays = scene.arrays;
    this.programs = Object.fromEntries(
      Object.entries({ body: BODY, shell: SHELL, sheet: SHEET, disc: DISC, line: LINE }).map(([k, s]) => [k, program(gl, s)]),
    );
    this.table = gl.createTexture();
    this.size = 1;
    this.unknown = colour(this.header.colours.unknown);
    this.vertexValues = this.buffer(new Float32Array(scene.arrays["sheet.points"].length / 3 * 2), gl.DYNAMIC_DRAW);
    this.taxels = scene.arrays["taxel.points"].length / 3;
    this.spread = new Uint8Array(SIDES * this.taxels).fill(255); // a byte for each corner
    this.codes = this.buffer(this.spread, gl.DYNAMIC_DRAW);
    this.ribbons = null;
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
  }

  buffer(data, usage = this.gl.STATIC_DRAW, target = this.gl.ARRAY_BUFFER) {
    const made = this.gl.createBuffer();
    this.gl.bindVertexArray(null);
    this.gl.bindBuffer(target, made);
    this.gl.bufferData(target, data, usage);
    return made;
  }

  // A vertex array: attributes are name: [buffer, width, type, normalised, stride, offset].
  array(programName, attributes, elements = null) {
    const gl = this.gl;
    const indices = elements ? this.buffer(elements, gl.STATIC_DRAW, gl.ELEMENT_ARRAY_BUFFER) : null;
    const made = gl.createVertexArray();
    gl.bindVertexArray(made);
    for (const [name, [buffer, width, type, normalised, stride, offset]] of Object.entries(attributes)) {
      const at = this.programs[programName].attribute(name);
      if (at < 0) continue;
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, width, type, normalised || false, stride || 0, offset || 0);
    }
    if (indices) gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, indices);
    gl.bindVertexArray(null);
    return made;
  }

  use(name, uniforms) {
    const { made, at } = this.programs[name];
    const gl = this.gl;
    gl.useProgram(made);
    for (const [key, value] of Object.entries(uniforms)) {
      if (!(key in at)) continue;
      if (typeof value === "number") gl.uniform1f(at[key], value);
      else if (value.length === 2) gl.uniform2fv(at[key], value);
      else if (value.length === 3) gl.uniform3fv(at[key], value);
      else if (value.length === 4) gl.uniform4fv(at[key], value);
      else gl.uniformMatrix4fv(at[key], false, value);
    }
  }

  setTable(rows, smooth) {
    const gl = this.gl;
    this.size = rows.length;
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, rows.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE,
      new Uint8Array(rows.flatMap((row) => [...row, 255])));
    for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, smooth ? gl.LINEAR : gl.NEAREST],
      [gl.TEXTURE_MAG_FILTER, smooth ? gl.LINEAR : gl.NEAREST],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) {
      gl.texParameteri(gl.TEXTURE_2D, key, value);
    }
  }

  setValues(codes, vertexValues) {
    const gl = this.gl;
    for (let k = 0; k < this.spread.length; k++) this.spread[k] = codes[(k / SIDES) | 0];
    gl.bindBuffer(gl.ARRAY_BUFFER, this.codes);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, this.spread);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.vertexValues);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, vertexValues);
  }

  colours() {
    return { size: this.size, unknown: this.unknown };
  }

  // A hexagon at each point, lying across its axis. No instances: software draws them one by one.
  hexagons(points, axes) {
    const gl = this.gl, n = this.taxels, corners = SIDES * n;
    const centre = new Float32Array(3 * corners), arm = new Float32Array(3 * corners);
    const axis = new Int8Array(4 * corners), number = new Float32Array(corners), faces = new Uint32Array(12 * n);
    for (let k = 0; k < n; k++) {
      const up = unit([...axes.subarray(4 * k, 4 * k + 3)]), least = up.map(Math.abs);
      const right = unit(cross(up, [0, 1, 2].map((i) => (i === least.indexOf(Math.min(...least)) ? 1 : 0))));
      const ahead = cross(up, right);
      for (let c = 0; c < SIDES; c++) {
        const at = SIDES * k + c, cos = Math.cos((c * Math.PI) / 3), sin = Math.sin((c * Math.PI) / 3);
        for (let i = 0; i < 3; i++) {
          centre[3 * at + i] = points[3 * k + i];
          arm[3 * at + i] = cos * right[i] + sin * ahead[i];
          axis[4 * at + i] = axes[4 * k + i];
        }
        number[at] = k;
      }
      faces.set([0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5].map((c) => SIDES * k + c), 12 * k);
    }
    const common = {
      centre: [this.buffer(centre), 3, gl.FLOAT], arm: [this.buffer(arm), 3, gl.FLOAT],
      axis: [this.buffer(axis), 4, gl.BYTE, true],
    };
    return {
      shown: this.array("disc", { ...common, code: [this.codes, 1, gl.UNSIGNED_BYTE] }, faces),
      picked: this.array("disc", { ...common, code: [this.buffer(number), 1, gl.FLOAT] }, faces),
    };
  }

  drawHexagons(hexagons, [first, count], uniforms, picked = false) {
    const gl = this.gl;
    this.use("disc", { ...this.colours(), lift: 0, plain: [0, 0, 0], mode: 0, ...uniforms });
    gl.bindVertexArray(picked ? hexagons.picked : hexagons.shown);
    gl.drawElements(gl.TRIANGLES, 12 * count, gl.UNSIGNED_INT, 48 * first);
  }

  // Lines of all touches: nine numbers a segment, from, to and colour; each becomes a ribbon.
  setLines(segments) {
    const gl = this.gl, count = segments.length / 9;
    const data = new Float32Array(44 * count), faces = new Uint32Array(6 * count);
    for (let k = 0; k < count; k++) {
      for (let c = 0; c < 4; c++) {
        data.set(segments.slice(9 * k, 9 * k + 9), 44 * k + 11 * c);
        data[44 * k + 11 * c + 9] = c & 1;
        data[44 * k + 11 * c + 10] = c < 2 ? -0.5 : 0.5;
      }
      faces.set([0, 1, 2, 2, 1, 3].map((c) => 4 * k + c), 6 * k);
    }
    if (!this.ribbons) {
      const buffer = this.buffer(data, gl.DYNAMIC_DRAW), field = (width, at) => [buffer, width, gl.FLOAT, false, 44, 4 * at];
      const attributes = { from: field(3, 0), to: field(3, 3), tint: field(3, 6), corner: field(2, 9) };
      this.ribbons = { buffer, array: this.array("line", attributes, faces) };
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, this.ribbons.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    gl.bindVertexArray(this.ribbons.array);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.DYNAMIC_DRAW);
    this.ribbons.count = faces.length;
  }

  drawLines(seen, pixels, width, nearer, halo) {
    if (!this.ribbons?.count) return;
    const gl = this.gl;
    this.use("line", { seen, pixels, width, nearer, halo });
    gl.bindVertexArray(this.ribbons.array);
    gl.drawElements(gl.TRIANGLES, this.ribbons.count, gl.UNSIGNED_INT, 0);
  }
}

// Values of the taxels carried to the sheets' vertices: two numbers each, the value and how far known.
export class Smoother {
  constructor(arrays) {
    this.starts = arrays["smooth.starts"];
    this.taxels = arrays["smooth.taxels"];
    this.weights = arrays["smooth.weights"];
    this.out = new Float32Array(2 * (this.starts.length - 1));
  }

  carry(codes) {
    const { starts, taxels, weights, out } = this;
    for (let v = 0; v + 1 < starts.length; v++) {
      let value = 0, known = 0;
      for (let k = starts[v]; k < starts[v + 1]; k++) {
        const code = codes[taxels[k]];
        if (code < 255) {
          value += weights[k] * code;
          known += weights[k];
        }
      }
      out[2 * v] = value;
      out[2 * v + 1] = known;
    }
    return out;
  }
}
