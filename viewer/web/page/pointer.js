// Mouse, pen and fingers on the body and on the flat map: turn, move, nearer; choose, lasso, ask.

import { Lasso } from "./lasso.js";
import { $, pixel } from "./dom.js";
import { place } from "./matrices.js";

const TURN = 0.008; // radians a pixel
const CLICK = 4; // a press that moves less is a click [px]
const LEAST_RING = 6; // radius of the ring around what is pointed at [px]

// Shift: the module, control: the patch; both add the module to what is chosen.
const reachOf = (event) => (event.shiftKey ? "module" : event.ctrlKey || event.metaKey ? "patch" : "taxel");
const adds = (event) => event.shiftKey && (event.ctrlKey || event.metaKey);

export class Pointer {
  constructor(page) {
    this.page = page;
    this.down = new Map(); // where each finger is [px of the page]
    this.far = 0;
    this.lasso = null;
    this.onBody(page.picture.canvas);
    this.onMap(page.flat.canvas);
  }

  onBody(canvas) {
    const { page, down } = this;
    canvas.onpointerdown = (event) => {
      canvas.setPointerCapture(event.pointerId);
      down.set(event.pointerId, [event.clientX, event.clientY]);
      if (down.size === 1) this.far = 0;
      page.hover.leave();
    };
    canvas.onpointermove = (event) => {
      if (!down.has(event.pointerId)) {
        if (event.pointerType === "mouse" && !event.buttons) page.hover.point(() => this.onSkin(event), (number) => this.ofBody(number));
        return;
      }
      this.drag(canvas, event);
    };
    canvas.onpointerup = (event) => {
      canvas.classList.remove("turning");
      const single = down.size === 1;
      down.delete(event.pointerId);
      if (single && this.far < CLICK && event.button === 0) this.click(this.onSkin(event), event);
    };
    canvas.onpointercancel = (event) => down.delete(event.pointerId);
    canvas.onpointerleave = () => page.hover.leave();
    canvas.oncontextmenu = (event) => event.preventDefault();
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      page.hover.leave();
      page.camera.nearer(Math.exp(-0.0015 * event.deltaY));
      page.cameraMoved();
    }, { passive: false });
  }

  // One pointer turns, or moves with another button; two fingers move, and nearer as they part.
  drag(canvas, event) {
    const { camera } = this.page, last = this.down.get(event.pointerId), now = [event.clientX, event.clientY];
    const [dx, dy] = [now[0] - last[0], now[1] - last[1]], height = canvas.clientHeight;
    this.down.set(event.pointerId, now);
    this.far += Math.hypot(dx, dy);
    if (this.far < CLICK) return;
    canvas.classList.add("turning");
    if (this.down.size > 1) {
      const [other] = [...this.down].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      const gap = (at) => Math.max(1, Math.hypot(at[0] - other[0], at[1] - other[1]));
      camera.nearer(gap(now) / gap(last));
      camera.move(dx / 2 / height, dy / 2 / height);
    } else if (event.buttons & 6 || event.shiftKey) camera.move(dx / height, dy / height);
    else camera.turn(TURN * dx, TURN * dy);
    this.page.cameraMoved();
  }

  onMap(canvas) {
    const { page } = this;
    canvas.onpointerdown = (event) => {
      if (event.button !== 0) return;
      canvas.setPointerCapture(event.pointerId);
      this.lasso = new Lasso(...pixel(event, canvas));
      page.hover.leave();
    };
    canvas.onpointermove = (event) => {
      if (this.lasso) {
        this.lasso.to(...pixel(event, canvas));
        this.trace(this.lasso);
      } else if (event.pointerType === "mouse") page.hover.point(() => page.flat.taxelAt(...pixel(event, canvas)), (number) => this.ofMap(number));
    };
    canvas.onpointerup = (event) => {
      const { lasso } = this;
      this.lasso = null;
      this.trace(null);
      if (!lasso) return;
      if (lasso.drawn) page.enclose(page.flat.enclosed(lasso), event.shiftKey);
      else this.click(page.flat.taxelAt(...pixel(event, canvas)), event);
    };
    canvas.onpointercancel = () => this.trace((this.lasso = null));
    canvas.onpointerleave = () => page.hover.leave();
  }

  trace(lasso) {
    this.page.flat.setLasso(lasso);
    this.page.redraw();
  }

  click(number, event) {
    this.page.choose(number, reachOf(event), adds(event));
  }

  onSkin(event) {
    const { picture, camera } = this.page;
    return picture.taxelAt(...pixel(event, picture.canvas), camera);
  }

  // Where a taxel is in the page, and a radius around it [px].
  ofBody(number) {
    const { page } = this, part = page.partOf(number), points = page.arrays["taxel.points"], box = $("picture").getBoundingClientRect();
    const at = place(page.picture.model(part.link), points.subarray(3 * number, 3 * number + 3));
    const [x, y] = page.camera.project(at), pixels = box.height / (2 * page.camera.distance * Math.tan(page.camera.angle / 2));
    return [box.left + x * box.width, box.top + y * box.height, Math.max(LEAST_RING, 0.6 * part.spacing * pixels)];
  }

  ofMap(number) {
    const { flat } = this.page, uv = flat.arrays["taxel.uv"], box = flat.canvas.getBoundingClientRect(), share = box.width / flat.canvas.width;
    const [x, y] = flat.at(uv[2 * number], uv[2 * number + 1]);
    return [box.left + x * share, box.top + y * share, Math.max(LEAST_RING, 0.6 * flat.part.spacing * flat.scale * share)];
  }
}
