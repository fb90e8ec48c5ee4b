// Where the robot is seen from: azimuth and elevation [rad] about a middle, z upwards.

import { add, cross, dot, lookFrom, multiply, perspective, place, scale, unit } from "./matrices.js";

const STEEPEST = 1.5; // [rad]: not quite from above, where up is undecided
const SLANT = 1.22; // steepest view of a touch [rad]
const AROUND = 0.06; // what is shown around a touch that is looked at [m]
const RISE = 8; // of the level views: feet and shoulders show their tops [deg]
const VIEWS = { front: [0, RISE], left: [90, RISE], back: [180, RISE], right: [-90, RISE], top: [0, 82] }; // turn and rise [deg]
const radians = (degrees) => (degrees * Math.PI) / 180;

export class Camera {
  constructor(header) {
    this.angle = radians(header.view_angle);
    this.header = header;
    this.version = 0;
    this.ratio = 1;
    this.aspect = 1;
    this.home();
  }

  home() {
    const [azimuth, elevation] = this.header.front.map(radians);
    Object.assign(this, { azimuth, elevation, middle: [...this.header.middle], zoom: 1, far: null });
    this.update();
  }

  // Look from one side; front is 20 degrees beside the first view, as that is a three-quarter one.
  look(name) {
    this.home();
    const [turn, rise] = VIEWS[name];
    this.azimuth += radians(turn - 20);
    this.elevation = radians(rise);
    this.update();
  }

  // Look at a middle from a distance [m].
  set(azimuth, elevation, middle, distance) {
    Object.assign(this, { azimuth, middle: [...middle], zoom: 1, far: distance });
    this.elevation = Math.max(-STEEPEST, Math.min(STEEPEST, elevation));
    this.update();
  }

  // Bring places close, seen from straight above them; places all round have no side.
  focus(points, normals) {
    const middle = scale(points.reduce(add), 1 / points.length), normal = scale(normals.reduce(add), 1 / normals.length);
    const far = AROUND + Math.max(...points.map((p) => Math.hypot(...p.map((x, i) => x - middle[i]))));
    let { azimuth, elevation } = this;
    if (Math.hypot(...normal) > 0.2) {
      const [x, y, z] = unit(normal);
      if (Math.hypot(x, y) > 0.1) azimuth = Math.atan2(y, x);
      elevation = Math.max(-SLANT, Math.min(SLANT, Math.asin(z)));
    }
    this.set(azimuth, elevation, middle, (1.3 * far) / Math.tan(this.angle / 2) / Math.min(1, this.aspect));
  }

  get direction() {
    const c = Math.cos(this.elevation);
    return [c * Math.cos(this.azimuth), c * Math.sin(this.azimuth), Math.sin(this.elevation)];
  }

  get distance() {
    return (this.far ?? this.whole()) / this.zoom;
  }

  // Distance from which the box of the robot fills the picture, leaving a margin for labels.
  whole() {
    const towards = this.direction, right = unit(cross([0, 0, 1], towards)), up = cross(towards, right);
    const half = scale(this.header.size, 0.5);
    let needed = 0;
    for (let k = 0; k < 8; k++) {
      const p = half.map((h, i) => (k & (1 << i) ? h : -h));
      const t = Math.tan(this.angle / 2);
      needed = Math.max(
        needed,
        dot(p, towards) + (1.12 * Math.abs(dot(p, up))) / t,
        dot(p, towards) + (1.3 * Math.abs(dot(p, right))) / (t * this.aspect),
      );
    }
    return needed;
  }

  turn(dx, dy) {
    this.azimuth -= dx;
    this.elevation = Math.max(-STEEPEST, Math.min(STEEPEST, this.elevation + dy));
    this.update();
  }

  // Move by shares of the picture's height.
  move(dx, dy) {
    const towards = this.direction, right = unit(cross([0, 0, 1], towards)), up = cross(towards, right);
    const metres = 2 * this.distance * Math.tan(this.angle / 2);
    this.middle = add(this.middle, add(scale(right, -dx * metres), scale(up, dy * metres)));
    this.update();
  }

  nearer(factor) {
    this.zoom = Math.max(0.2, Math.min(40, this.zoom * factor));
    this.update();
  }

  resize(aspect, ratio) {
    this.aspect = aspect;
    this.ratio = ratio;
    this.update();
  }

  update() {
    const d = this.distance, { reach } = this.header;
    const eye = add(this.middle, scale(this.direction, d));
    this.view = lookFrom(eye, this.middle, [0, 0, 1]);
    this.matrix = multiply(perspective(this.angle, this.aspect, Math.max(0.02, d - reach), d + reach), this.view);
    this.version += 1;
  }

  // Place of a point [m] in the picture, in shares of its width and height from the upper left.
  project(point) {
    const [x, y, , w] = place(this.matrix, point);
    return [0.5 + x / w / 2, 0.5 - y / w / 2];
  }
}
