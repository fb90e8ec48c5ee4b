// The robot. While the camera rests, all is drawn once and kept with its depths; a sample draws anew
// the skin of the parts that changed, and the lines of touches. Software then keeps up with samples.

import { Pieces } from "./pieces.js";
import { colour } from "./packing.js";
import { multiply } from "./matrices.js";

const SMOOTH = 4; // samples a pixel of what is kept
const FULL_DISC = 0.47; // radius of a disc in spacings
const COVER = 0.62; // the same where discs are to leave no gap: for categories and for picking

export class Picture extends Pieces {
  constructor(canvas, scene) {
    super(canvas, scene);
    const gl = this.gl, a = this.arrays;
    this.canvas = canvas;
    this.software = /swiftshader|llvmpipe|software/i.test(rendererName(gl));
    this.poses = a.poses.slice();
    this.style = "surface";
    this.categories = false;
    this.parts = new Set(this.header.parts.map((part) => part.name));
    this.tints = Object.fromEntries(Object.entries(this.header.colours).map(([k, v]) => [k, colour(v)]));
    const normals = (name) => [this.buffer(a[name]), 4, gl.BYTE, true];
    const points = (name) => [this.buffer(a[name]), 3, gl.FLOAT];
    this.body = this.array("body", { position: points("body.points"), normal: normals("body.normals") }, a["body.faces"]);
    this.shell = this.array("shell", { position: points("shell.points") }, a["shell.faces"]);
    this.sheet = this.array("sheet", {
      position: points("sheet.points"), normal: normals("sheet.normals"), value: [this.vertexValues, 2, gl.FLOAT],
    }, a["sheet.faces"]);
    this.hexes = this.hexagons(a["taxel.points"], a["taxel.normals"]);
    this.kept = null; // version of the camera that the kept picture was drawn for
    this.keptSmooth = false;
    this.keptCodes = new Uint8Array(this.taxels);
    gl.enable(gl.CULL_FACE);
  }

  resize(width, height) {
    if (this.canvas.width === width && this.canvas.height === height && this.rooms) return;
    const gl = this.gl;
    this.canvas.width = width;
    this.canvas.height = height;
    for (const room of Object.values(this.rooms || {})) {
      gl.deleteFramebuffer(room.frame);
      room.stores.forEach((store) => gl.deleteRenderbuffer(store));
    }
    const samples = Math.min(SMOOTH, gl.getParameter(gl.MAX_SAMPLES));
    const kept = this.room(0);
    this.rooms = { kept, work: this.room(0, kept.stores[1]), smooth: this.room(samples) };
    this.forget();
  }

  // Somewhere to draw: colours, and depths of its own or those of another room.
  room(samples, depths = null) {
    const gl = this.gl, frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    const store = (where, format, shared) => {
      const made = shared || gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, made);
      if (!shared) {
        gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, format, this.canvas.width, this.canvas.height);
      }
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, where, gl.RENDERBUFFER, made);
      return made;
    };
    return {
      frame,
      stores: [store(gl.COLOR_ATTACHMENT0, gl.RGBA8), store(gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT24, depths)],
    };
  }

  // All must be drawn anew: the camera, the pose or what is shown has changed.
  forget() {
    this.kept = null;
  }

  model(link) {
    return this.poses.subarray(16 * link, 16 * link + 16);
  }

  // Draw: quick leaves out the smoothing of edges, which software takes long for; still smooths all.
  draw(camera, quick, still) {
    const gl = this.gl, { kept, work, smooth } = this.rooms, rough = quick && this.software;
    const anew = this.kept !== camera.version || (!this.keptSmooth && !rough);
    if (anew) this.keep(camera, rough);
    gl.enable(gl.SCISSOR_TEST);
    if (anew) gl.scissor(0, 0, this.canvas.width, this.canvas.height);
    else gl.scissor(...this.reach(camera));
    if (still) {
      this.into(smooth);
      this.drawBody(camera);
      this.drawSkin(camera, this.header.parts);
      this.drawTouches(camera);
      this.copy(smooth, work);
    } else {
      this.copy(kept, work);
      this.into(work);
      gl.depthMask(false);
      this.drawSkin(camera, this.changed(), true);
      this.drawTouches(camera);
      gl.depthMask(true);
    }
    this.copy(work, { frame: null });
    gl.disable(gl.SCISSOR_TEST);
  }

  // Draw body and skin, and keep them: colours with smooth edges, depths of the pixels' middles.
  keep(camera, rough) {
    const gl = this.gl, { kept, smooth } = this.rooms;
    for (const room of rough ? [kept] : [smooth, kept]) {
      this.into(room);
      if (!rough && room === kept) {
        this.copy(smooth, kept);
        gl.bindFramebuffer(gl.FRAMEBUFFER, kept.frame);
        gl.colorMask(false, false, false, false);
      }
      this.drawBody(camera);
      this.drawSkin(camera, this.header.parts);
    }
    gl.colorMask(true, true, true, true);
    for (let k = 0; k < this.taxels; k++) this.keptCodes[k] = this.spread[6 * k];
    this.kept = camera.version;
    this.keptSmooth = !rough;
  }

  // Parts whose values are others than those kept.
  changed() {
    return this.header.parts.filter(({ taxels: [first, count] }) => {
      for (let k = first; k < first + count; k++) if (this.keptCodes[k] !== this.spread[6 * k]) return true;
      return false;
    });
  }

  // Rectangle of the canvas that the robot and what is drawn at it can fill.
  reach(camera) {
    const { middle, size } = this.header, { width, height } = this.canvas, low = [1, 1], high = [0, 0];
    for (let k = 0; k < 8; k++) {
      const at = camera.project(middle.map((m, i) => m + (k & (1 << i) ? 0.55 : -0.55) * size[i]));
      at.forEach((share, i) => {
        low[i] = Math.min(low[i], Math.max(0, share));
        high[i] = Math.max(high[i], Math.min(1, share));
      });
    }
    const pixels = [low[0] * width, (1 - high[1]) * height, (high[0] - low[0]) * width, (high[1] - low[1]) * height];
    return pixels.map((p, i) => (i < 2 ? Math.floor(p) : Math.max(0, Math.ceil(p) + 1)));
  }

  into(room) {
    const gl = this.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, room.frame);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
  }

  copy(from, to) {
    const gl = this.gl, w = this.canvas.width, h = this.canvas.height;
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, from.frame);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, to.frame);
    gl.blitFramebuffer(0, 0, w, h, 0, 0, w, h, gl.COLOR_BUFFER_BIT, gl.NEAREST);
  }

  drawBody(camera) {
    const gl = this.gl;
    gl.clearColor(...this.tints.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.POLYGON_OFFSET_FILL); // what lies on the skin is never torn by the cover below it
    gl.polygonOffset(1, 8);
    gl.bindVertexArray(this.body);
    this.header.links.forEach((link, number) => {
      if (!link.count) return;
      const model = this.model(number);
      this.use("body", { seen: multiply(camera.matrix, model), model, camera: camera.view, colour: this.tints.body });
      gl.drawElements(gl.TRIANGLES, link.count, gl.UNSIGNED_INT, 4 * link.first);
    });
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.disable(gl.CULL_FACE);
    gl.bindVertexArray(this.shell);
    if (this.asSheet()) {
      this.eachPart((part, model, seen) => {
        this.use("shell", { seen, model, camera: camera.view, colour: this.tints.rim });
        gl.drawElements(gl.TRIANGLES, part.shell_faces[1], gl.UNSIGNED_INT, 4 * part.shell_faces[0]);
      }, camera);
    }
    gl.enable(gl.CULL_FACE);
  }

  asSheet() {
    return this.style === "surface" && !this.categories;
  }

  eachPart(act, camera, parts = this.header.parts) {
    parts.forEach((part) => {
      if (!this.parts.has(part.name)) return;
      const model = this.model(part.link);
      act(part, model, multiply(camera.matrix, model));
    });
  }

  drawSkin(camera, parts, again = false) {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    const sheet = this.asSheet(), cover = this.style === "surface" ? COVER : FULL_DISC;
    this.eachPart((part, model, seen) => {
      if (sheet) {
        gl.bindVertexArray(this.sheet);
        this.use("sheet", { seen, model, camera: camera.view, lit: 1, ...this.colours() });
        gl.drawElements(gl.TRIANGLES, part.sheet_faces[1], gl.UNSIGNED_INT, 4 * part.sheet_faces[0]);
        if (again) return; // the dots stand there already
      }
      const how = sheet ? { radius: part.dot, mode: 1, plain: this.tints.dot } : { radius: cover * part.spacing };
      this.drawHexagons(this.hexes, part.taxels, { seen, model, camera: camera.view, ...how });
    }, camera, parts);
  }

  drawTouches(camera) {
    const gl = this.gl;
    const pixels = [this.canvas.width, this.canvas.height].map((x) => x / 2 / camera.ratio);
    gl.disable(gl.CULL_FACE);
    this.drawLines(camera.matrix, pixels, 6, 2e-4, [1, 1, 1, 1]);
    this.drawLines(camera.matrix, pixels, 3, 4e-4, [0, 0, 0, 0]);
    gl.enable(gl.CULL_FACE);
  }

  // Number of the taxel under a point of the canvas [px], among all taxels; -1 where there is none.
  taxelAt(x, y, camera) {
    const gl = this.gl, row = this.canvas.height - 1 - Math.floor(y), column = Math.floor(x);
    if (!this.rooms || x < 0 || row < 0) return -1;
    if (this.kept !== camera.version) this.keep(camera, this.software);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(column, row, 1, 1);
    this.into(this.rooms.work);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.depthMask(false);
    this.eachPart((part, model, seen) => {
      const how = { radius: COVER * part.spacing, mode: 2, lift: 2e-4 };
      this.drawHexagons(this.hexes, part.taxels, { seen, model, camera: camera.view, ...how }, true);
    }, camera);
    gl.depthMask(true);
    const pixel = new Uint8Array(4);
    gl.readPixels(column, row, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    gl.disable(gl.SCISSOR_TEST);
    return pixel[0] + 256 * pixel[1] + 65536 * pixel[2] - 1;
  }
}

function rendererName(gl) {
  const about = gl.getExtension("WEBGL_debug_renderer_info");
  return about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : "";
}
