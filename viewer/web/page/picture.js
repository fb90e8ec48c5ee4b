// The robot. While camera and robot rest, all is drawn once and kept, and with it which point of the
// skin each pixel shows: a sample then costs a look at each pixel, and no triangles.

import { Pieces, Ribbons } from "./gl_buffers.js";
import { colour } from "./packing.js";
import { multiply } from "./matrices.js";
import { Rest } from "./cpu_raster.js";
import { colours } from "./theme.js";
import { closeRooms, openRooms } from "./framebuffers.js";

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
    this.sheet = this.array("sheet", { position: points("sheet.points"), normal: normals("sheet.normals") }, a["sheet.faces"]);
    this.corners = null; // of the sheets' faces, made when they are first needed
    this.hexes = this.hexagons(a["taxel.points"], a["taxel.normals"]);
    this.touches = new Ribbons(this);
    this.chosen = new Ribbons(this);
    this.signs = new Ribbons(this);
    this.nothing = gl.createVertexArray();
    this.rest = new Rest(document.getElementById("rest"));
    this.kept = null; // version of the camera that the kept picture was drawn for
    this.keptSmooth = false;
    this.placed = false; // the kept picture's points of the skin are known
    this.changed = false; // values are others than those of the kept picture
    gl.enable(gl.CULL_FACE);
  }

  resize(width, height) {
    if (this.canvas.width === width && this.canvas.height === height && this.rooms) return;
    this.canvas.width = width;
    this.canvas.height = height;
    closeRooms(this.gl, this.rooms);
    this.rooms = openRooms(this, width, height);
    this.forget();
  }

  // All must be drawn anew: the camera, the pose or what is shown has changed.
  forget() {
    this.kept = null;
  }

  setValues(codes, vertexValues) {
    Object.assign(this, { codes, values: vertexValues, changed: true, sent: false });
  }

  // Give the values to the card, where it is the one that draws.
  send() {
    if (this.sent || !this.codes) return;
    this.fill(this.codeList, this.codes);
    this.fill(this.valueList, this.values);
    this.sent = true;
  }

  model(link) {
    return this.poses.subarray(16 * link, 16 * link + 16);
  }

  // Draw: quick leaves out the smoothing of edges, which software takes long for; still smooths all.
  draw(camera, quick, still) {
    const { kept, work, smooth } = this.rooms, rough = quick && this.software;
    if (still || !this.software || !this.placed || this.kept !== camera.version) this.send();
    if (still) {
      this.rest.hide();
      this.into(smooth);
      this.drawBody(camera);
      this.drawSkin(camera);
      this.drawTouches(camera, false);
      this.resolve(smooth, work);
      this.show(work, false);
      return;
    }
    if (this.kept !== camera.version || (!this.keptSmooth && !rough)) this.keep(camera, rough);
    if (this.changed && !this.placed) this.place(camera);
    if (this.changed && this.software) {
      this.rest.draw(this.codes, this.values, this.colourMap);
      if (this.traced !== this.chosen.segments || this.marked !== this.signs.segments) {
        [this.traced, this.marked] = [this.chosen.segments, this.signs.segments];
        const segments = [...this.traced, ...this.marked];
        this.rest.setStill(segments, camera.matrix, ...this.ringWidths(camera).map((width) => width * camera.ratio));
      }
      this.rest.drawStill();
      this.rest.drawLines(this.touches.segments, camera.matrix, 3 * camera.ratio, 6 * camera.ratio);
      return;
    }
    this.rest.hide();
    this.show(kept, this.changed);
    this.drawTouches(camera, true);
  }

  // Draw body and skin, and keep them: colours with smooth edges, depths of the pixels' middles.
  keep(camera, rough) {
    this.send();
    const gl = this.gl, { kept, smooth } = this.rooms;
    for (const room of rough ? [kept] : [smooth, kept]) {
      this.into(room);
      if (!rough && room === kept) {
        this.resolve(smooth, kept);
        this.into(kept);
        gl.colorMask(false, false, false, false);
      }
      this.drawBody(camera);
      this.drawSkin(camera);
    }
    gl.colorMask(true, true, true, true);
    this.kept = camera.version;
    this.keptSmooth = !rough;
    this.placed = this.changed = false;
  }

  // Find which point of the skin each pixel of the kept picture shows.
  place(camera) {
    const gl = this.gl;
    gl.depthMask(false);
    gl.disable(gl.DEPTH_TEST);
    this.into(this.rooms.bare);
    this.use("depth", {});
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
    this.into(this.rooms.places);
    gl.enable(gl.POLYGON_OFFSET_FILL); // a hair nearer than the same faces as they were kept
    gl.polygonOffset(0, -4);
    this.corners ??= this.faceCorners();
    const discs = this.asSheet() ? 0 : 1, cover = this.style === "surface" ? COVER : FULL_DISC;
    this.eachPart((part, model, seen) => {
      const how = { seen, model, camera: camera.view, discs, radius: cover * part.spacing };
      if (discs) {
        this.drawHexagons(this.hexes, part.taxels, how, "places");
        return;
      }
      this.use("places", how);
      gl.bindVertexArray(this.corners);
      gl.drawArrays(gl.TRIANGLES, ...part.sheet_faces);
    }, camera);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.depthMask(true);
    this.placed = true;
    if (this.software) this.handOver();
  }

  // Give what was kept to the part of the page that draws samples without the card.
  handOver() {
    const gl = this.gl, { width, height } = this.canvas;
    const colours = new Uint8Array(4 * width * height), places = new Uint32Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA_INTEGER, gl.UNSIGNED_INT, places);
    this.into(this.rooms.kept);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, colours);
    this.rest.take(width, height, colours, places, this.arrays["sheet.faces"]);
    this.traced = null; // rings lie elsewhere in this picture
  }

  // Fill the canvas with a room's picture; live with the values of now.
  show(room, live) {
    const gl = this.gl;
    this.bind("kept", room.shown);
    this.into({ frame: null });
    gl.disable(gl.DEPTH_TEST);
    this.use("show", { ...this.colours(), live: live ? 1 : 0 });
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
  }

  into(room) {
    const gl = this.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, room.frame);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
  }

  resolve(from, to) {
    const gl = this.gl, w = this.canvas.width, h = this.canvas.height;
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, from.frame);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, to.frame);
    gl.blitFramebuffer(0, 0, w, h, 0, 0, w, h, gl.COLOR_BUFFER_BIT, gl.NEAREST);
  }

  drawBody(camera) {
    const gl = this.gl;
    gl.clearColor(...colours().ground, 1);
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

  eachPart(act, camera) {
    this.header.parts.forEach((part) => {
      if (!this.parts.has(part.name)) return;
      const model = this.model(part.link);
      act(part, model, multiply(camera.matrix, model));
    });
  }

  drawSkin(camera) {
    const gl = this.gl, sheet = this.asSheet(), cover = this.style === "surface" ? COVER : FULL_DISC;
    this.eachPart((part, model, seen) => {
      if (sheet) {
        gl.bindVertexArray(this.sheet);
        this.use("sheet", { seen, model, camera: camera.view, ...this.colours() });
        gl.drawElements(gl.TRIANGLES, part.sheet_faces[1], gl.UNSIGNED_INT, 4 * part.sheet_faces[0]);
      }
      const how = sheet ? { radius: part.dot, mode: 1, plain: this.tints.dot } : { radius: cover * part.spacing };
      this.drawHexagons(this.hexes, part.taxels, { seen, model, camera: camera.view, ...how });
    }, camera);
  }

  // Lines, hidden by what lies before them: by the depths that were kept, or those of the room drawn in.
  drawTouches(camera, tested) {
    const gl = this.gl, pixels = [this.canvas.width, this.canvas.height].map((x) => x / 2 / camera.ratio);
    const common = { seen: camera.matrix, pixels, tested: tested ? 1 : 0 };
    if (tested) gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.depthMask(false); // a halo never hides the line that it belongs to
    const [ring, around] = this.ringWidths(camera);
    if (around) this.chosen.draw({ ...common, width: around, nearer: 5e-5, halo: [1, 1, 1, 1] });
    this.chosen.draw({ ...common, width: ring, nearer: 1e-4, halo: [0, 0, 0, 0] });
    const [thin, white] = around ? [1.5, 3.5] : [ring, 0];
    if (white) this.signs.draw({ ...common, width: white, nearer: 5e-5, halo: [1, 1, 1, 1] });
    this.signs.draw({ ...common, width: thin, nearer: 1e-4, halo: [0, 0, 0, 0] });
    this.touches.draw({ ...common, width: 6, nearer: 2e-4, halo: [1, 1, 1, 1] });
    this.touches.draw({ ...common, width: 3, nearer: 4e-4, halo: [0, 0, 0, 0] });
    gl.depthMask(true);
    gl.enable(gl.CULL_FACE);
    gl.enable(gl.DEPTH_TEST);
  }

  // Of rings and the white around them [px]: thin and without white where taxels lie close in the picture.
  ringWidths(camera) {
    const metres = (2 * camera.distance * Math.tan(camera.angle / 2)) / (this.canvas.height / camera.ratio);
    const gap = Math.min(...this.header.parts.map(({ spacing }) => spacing)) / metres;
    return gap > 12 ? [2, 4] : [Math.max(1, gap / 6), 0];
  }

  // Number of the taxel under a point of the canvas [px], among all taxels; -1 where there is none.
  taxelAt(x, y, camera) {
    if (this.gl.isContextLost()) return -1;
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
      this.drawHexagons(this.hexes, part.taxels, { seen, model, camera: camera.view, ...how });
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
