// What a picture is made of on the graphics card: buffers, textures, hexagons and ribbons.

import { BODY, DEPTH, DISC, LINE, PLACES, SHEET, SHELL, SHOW, UNITS, program } from "./shaders.js";
import { cross, unit } from "./matrices.js";
import { ColourMap } from "./colour_map.js";
import { colour } from "./packing.js";

const SIDES = 6; // of the hexagon that stands for a taxel
const WIDE = 2048; // of textures that hold a list, as in the programs
const SOURCES = { body: BODY, shell: SHELL, sheet: SHEET, disc: DISC, line: LINE, places: PLACES, show: SHOW, depth: DEPTH };

export class Pieces {
  constructor(canvas, scene) {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, depth: false });
    if (!gl) throw new Error("this browser offers no WebGL2");
    this.gl = gl;
    this.header = scene.header;
    this.arrays = scene.arrays;
    this.programs = Object.fromEntries(Object.entries(SOURCES).map(([k, s]) => [k, program(gl, s)]));
    this.size = 1; // rows of the table of colours
    this.unknown = colour(this.header.colours.unknown);
    this.taxels = scene.arrays["taxel.points"].length / 3;
    this.table = this.texture("table", gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, 1, 1);
    this.codeList = this.list("codes", new Uint8Array(this.taxels).fill(255), 1);
    this.valueList = this.list("values", new Float32Array(scene.arrays["sheet.points"].length / 3 * 2), 2);
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

  // A texture that stays at its sampler's unit; nothing lies between its pixels.
  texture(sampler, inside, format, type, width, height, data = null) {
    const gl = this.gl, made = gl.createTexture();
    this.bind(sampler, made);
    gl.texImage2D(gl.TEXTURE_2D, 0, inside, width, height, 0, format, type, data);
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.NEAREST);
    for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
    return made;
  }

  bind(sampler, texture) {
    this.gl.activeTexture(this.gl.TEXTURE0 + UNITS[sampler]);
    this.gl.bindTexture(this.gl.TEXTURE_2D, texture);
  }

  // A list of numbers as a texture: `width` numbers a pixel, read by their place in the list.
  list(sampler, data, width) {
    const gl = this.gl, rows = Math.max(1, Math.ceil(data.length / width / WIDE));
    const [inside, format, type] = {
      codes: [gl.R8UI, gl.RED_INTEGER, gl.UNSIGNED_BYTE],
      values: [gl.RG32F, gl.RG, gl.FLOAT],
      faces: [gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT],
    }[sampler];
    const room = new data.constructor(width * WIDE * rows);
    room.set(data);
    const made = this.texture(sampler, inside, format, type, WIDE, rows, room);
    return { sampler, made, room, rows, format, type };
  }

  fill(list, data) {
    const gl = this.gl;
    list.room.set(data);
    this.bind(list.sampler, list.made);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WIDE, list.rows, list.format, list.type, list.room);
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

  setTable(rows) {
    const gl = this.gl;
    this.size = rows.length;
    this.bind("table", this.table);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, rows.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE,
      new Uint8Array(rows.flatMap((row) => [...row, 255])));
    this.colourMap = new ColourMap(rows, this.header.colours.unknown);
  }

  colours() {
    return { size: this.size, unknown: this.unknown };
  }

  // The sheets' faces with corners of their own, and the list of which vertices these are.
  faceCorners() {
    const gl = this.gl, a = this.arrays, faces = a["sheet.faces"], n = faces.length;
    const points = new Float32Array(3 * n), normals = new Int8Array(4 * n), list = new Uint32Array((4 * n) / 3);
    for (let k = 0; k < n; k++) {
      const v = faces[k];
      for (let i = 0; i < 3; i++) {
        points[3 * k + i] = a["sheet.points"][3 * v + i];
        normals[4 * k + i] = a["sheet.normals"][4 * v + i];
      }
      list[4 * ((k / 3) | 0) + (k % 3)] = v;
    }
    this.list("faces", list, 4);
    return this.array("places", { position: [this.buffer(points), 3, gl.FLOAT], normal: [this.buffer(normals), 4, gl.BYTE, true] });
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
    const attributes = {
      centre: [this.buffer(centre), 3, gl.FLOAT], arm: [this.buffer(arm), 3, gl.FLOAT],
      axis: [this.buffer(axis), 4, gl.BYTE, true], number: [this.buffer(number), 1, gl.FLOAT],
    };
    return { disc: this.array("disc", attributes, faces), places: this.array("places", attributes, faces) };
  }

  drawHexagons(hexagons, [first, count], uniforms, programName = "disc") {
    const gl = this.gl;
    this.use(programName, { ...this.colours(), lift: 0, plain: [0, 0, 0], mode: 0, ...uniforms });
    gl.bindVertexArray(hexagons[programName]);
    gl.drawElements(gl.TRIANGLES, 12 * count, gl.UNSIGNED_INT, 48 * first);
  }
}

// Lines of a width in pixels: nine numbers a segment, from, to and colour; each becomes a ribbon.
export class Ribbons {
  constructor(pieces) {
    const gl = pieces.gl, buffer = pieces.buffer(new Float32Array(0), gl.DYNAMIC_DRAW);
    const field = (width, at) => [buffer, width, gl.FLOAT, false, 44, 4 * at];
    const attributes = { from: field(3, 0), to: field(3, 3), tint: field(3, 6), corner: field(2, 9) };
    this.array = pieces.array("line", attributes, new Uint32Array(0));
    this.pieces = pieces;
    this.buffer = buffer;
    this.count = 0;
    this.segments = [];
  }

  set(segments) {
    this.segments = segments;
    this.stale = true;
  }

  send() {
    const { segments } = this;
    this.stale = false;
    const gl = this.pieces.gl, count = segments.length / 9;
    const data = new Float32Array(44 * count), faces = new Uint32Array(6 * count);
    for (let k = 0; k < count; k++) {
      for (let c = 0; c < 4; c++) {
        for (let i = 0; i < 9; i++) data[44 * k + 11 * c + i] = segments[9 * k + i];
        data[44 * k + 11 * c + 9] = c & 1;
        data[44 * k + 11 * c + 10] = c < 2 ? -0.5 : 0.5;
        faces[6 * k + c] = 4 * k + c;
      }
      faces[6 * k + 3] = 4 * k + 2;
      faces[6 * k + 4] = 4 * k + 1;
      faces[6 * k + 5] = 4 * k + 3;
    }
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.DYNAMIC_DRAW);
    this.count = faces.length;
  }

  draw(uniforms) {
    if (this.stale) this.send();
    if (!this.count) return;
    const gl = this.pieces.gl;
    this.pieces.use("line", uniforms);
    gl.bindVertexArray(this.array);
    gl.drawElements(gl.TRIANGLES, this.count, gl.UNSIGNED_INT, 0);
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
