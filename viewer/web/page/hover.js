// What the pointer rests on: a ring around the taxel and a box of what is known of it.

import { $, made } from "./dom.js";
import { lines } from "./describe.js";

const PACE = 60; // between two looks at what lies under the pointer [ms]
const ASIDE = 14; // of the box from the taxel [px]

export class Hover {
  constructor(page) {
    this.page = page;
    this.number = -1;
    this.place = null; // {x, y, find, where} of the pointer
    this.timer = 0;
    this.next = 0;
    this.box = $("hover");
    this.rings = $("hover-ring");
  }

  // The pointer is somewhere: `find` tells which taxel is there, `where` where a taxel is [px of the page].
  point(find, where) {
    Object.assign(this, { find, where });
    if (this.timer) return;
    this.timer = setTimeout(() => this.look(), Math.max(0, this.next - performance.now()));
  }

  look() {
    this.timer = 0;
    this.next = performance.now() + PACE;
    if (this.find) this.show(this.find());
  }

  leave() {
    this.find = null;
    this.show(-1);
  }

  show(number) {
    const before = this.number;
    this.number = number;
    if (number < 0) this.box.hidden = this.rings.hidden = true;
    else if (number !== before) this.ask();
  }

  // Ask again: the values have changed.
  ask() {
    if (this.number >= 0) this.page.link.ask({ do: "point", ...this.page.taxel(this.number) });
  }

  tell(about) {
    const here = this.page.taxel(this.number);
    if (!here || here.part !== about.part || here.taxel !== about.taxel) return;
    const [x, y, radius] = this.where(this.number);
    this.rings.hidden = this.box.hidden = false;
    Object.assign(this.rings.style, { left: `${x - radius}px`, top: `${y - radius}px`, width: `${2 * radius}px`, height: `${2 * radius}px` });
    this.box.replaceChildren(...lines(about).map((line) => made("div", line)));
    const { offsetWidth: width, offsetHeight: height } = this.box, { innerWidth, innerHeight } = window;
    const beside = (at, size, room) => Math.max(2, at + ASIDE + size > room ? at - ASIDE - size : at + ASIDE);
    Object.assign(this.box.style, { left: `${beside(x, width, innerWidth)}px`, top: `${beside(y, height, innerHeight)}px` });
  }
}
