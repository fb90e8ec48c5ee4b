// The lasso: a line drawn by hand around points, closed by itself.

const STRIDE = 2; // shorter moves add no corner [px]
const LEAST = 3; // corners that enclose anything
const CLICK = 4; // a line that stays so near to its beginning is a click [px]

export class Lasso {
  constructor(x, y) {
    this.corners = [[x, y]];
  }

  to(x, y) {
    const [lastX, lastY] = this.corners.at(-1);
    if (Math.hypot(x - lastX, y - lastY) >= STRIDE) this.corners.push([x, y]);
  }

  // Whether it encloses anything: a click does not, wherever a line ends.
  get drawn() {
    const [[x0, y0]] = this.corners;
    return this.corners.length >= LEAST && this.corners.some(([x, y]) => Math.hypot(x - x0, y - y0) >= CLICK);
  }

  // Whether a point lies inside, by the even-odd rule: the line may cross itself.
  holds(x, y) {
    let odd = false;
    this.corners.forEach(([x0, y0], k) => {
      const [x1, y1] = this.corners[(k + 1) % this.corners.length];
      if (y0 > y !== y1 > y && x < x0 + ((y - y0) * (x1 - x0)) / (y1 - y0)) odd = !odd;
    });
    return odd;
  }
}
