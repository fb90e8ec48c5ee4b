// What is written beside the picture: the state of the source, colours, touches, a taxel, notices.

import { readable } from "./labels.js";
import { $, made, words } from "./dom.js";
import { facts } from "./describe.js";
import { SIGNS, signPicture } from "./signs.js";

const ARROWS = "lines out of the skin: normals of touches; lines along it: the ways they took";
const NAMED = 4; // absent parts at most: a longer list would cover the body
const TELL = 800; // from a change of the touches to its being told [ms]
const NOTICE = 4000; // that a notice stays [ms]
const TOLD = 8000; // how long a problem stands there [ms]
const LATE = 100; // older pictures of a live source are marked [ms]
const WORK = 200; // that a layer may take before its being made is told [ms]
const SILENT = 500; // from one look at the clock to the next while nothing comes [ms]
const taxels = (count) => (count === 1 ? "1 taxel" : `${count.toLocaleString("en")} taxels`);
const css = ([r, g, b]) => `rgb(${r} ${g} ${b})`;

export class Words {
  constructor(header) {
    this.open = false;
    this.problem = this.why = "";
    $("robot").textContent = header.robot;
    document.title = `${header.robot} · Skinmap`;
    $("count").textContent = taxels(header.parts.reduce((n, part) => n + part.taxels[1], 0));
  }

  // A short line for some seconds.
  say(text) {
    $("notice").textContent = text;
    $("notice").hidden = false;
    clearTimeout(this.leaving);
    this.leaving = setTimeout(() => ($("notice").hidden = true), NOTICE);
  }

  tell(problem, write) {
    this.problem = problem;
    clearTimeout(this.forgetting);
    this.forgetting = setTimeout(() => {
      this.problem = "";
      write();
    }, TOLD);
    write();
  }

  connected(open, why = "") {
    this.open = open;
    this.problem = "";
    this.why = why;
  }

  showState(state, about, delay, lost = false) {
    const said = [];
    let warn = true;
    clearTimeout(this.again);
    if (!about.stale) Object.assign(this, { fresh: performance.now(), fitted: state.unfit });
    if (lost) said.push("the graphics card lost the picture; it is drawn anew when the card is back");
    else if (!this.open) said.push(this.why || "not connected; trying again");
    else if (state.error) said.push(state.error);
    else if (this.problem || about.problem) said.push(this.problem || about.problem);
    else if (about.stale) {
      const unfit = state.unfit - this.fitted;
      said.push(`no data for ${((performance.now() - this.fresh) / 1000).toFixed(1)} s`);
      if (unfit > 0) said.push(`${unfit.toLocaleString("en")} samples do not fit this skin`);
      this.again = setTimeout(() => this.showState(state, about, delay, lost), SILENT);
    } else {
      // Of a picture that stands still, rate and age say nothing.
      const age = 1e3 * about.latency + delay, moves = !state.paused && !state.ended;
      warn = moves && about.latency != null && age > LATE;
      if (warn) said.push(`late: shown after ${age.toFixed(0)} ms`);
      if (moves && about.rate != null) said.push(`${about.rate.toFixed(0)} samples/s`);
      if (moves && !warn && about.latency != null) said.push(`shown after ${age.toFixed(0)} ms`);
      if (about.dropped) said.push(`${about.dropped.toLocaleString("en")} left out`);
      if (state.ended) said.push("ended");
      if (state.paused) said.push("paused");
    }
    document.body.classList.toggle("stale", Boolean(about.stale));
    $("touch-list").dataset.age = about.stale ? `${((performance.now() - this.fresh) / 1000).toFixed(0)} s ago` : "";
    $("status").textContent = said.join(" · ");
    $("status").className = warn ? "warn" : "";
  }

  // A layer that is not there at once is being made.
  working(name) {
    clearTimeout(this.slow);
    this.slow = setTimeout(() => ($("bar-title").textContent = `${name} is being made ...`), WORK);
  }

  showLayer(layer) {
    clearTimeout(this.slow);
    $("bar-title").textContent = layer.title;
    $("bar-unit").textContent = layer.unit;
    this.missing = layer.missing;
    [this.heard, this.grey] = [layer.heard, layer.grey];
    $("bar-scale").hidden = layer.categories.length > 0;
    $("bar-colours").style.background = `linear-gradient(to top, ${layer.table.map(css).join(",")})`;
    const [low, high] = layer.limits, [below, above] = layer.cut;
    const tick = (share) => `${Number((low + share * (high - low)).toPrecision(3))}`;
    $("bar-ticks").replaceChildren(...[tick(1) + (above ? "+" : ""), tick(0.5), (below ? "≤" : "") + tick(0)].map((text) => made("li", text)));
    $("bar-names").replaceChildren(...layer.categories.map((name, k) => {
      const item = made("li"), swatch = made("i");
      swatch.style.background = css(layer.table[k]);
      if (layer.name === "health" && name in SIGNS) swatch.append(signPicture(name));
      item.append(swatch, name);
      return item;
    }));
  }

  // Why nothing is seen of a layer, or of some parts; what the lines at touches and the signs are.
  showNotes(silent, parts, touched, signs = {}) {
    const none = silent.length === parts.length, notes = [];
    if (none) notes.push(this.missing);
    else if (silent.length && this.heard) {
      const named = silent.length <= NAMED ? silent.map((part) => words(part.name)).join(", ") : `${silent.length} parts`;
      notes.push(`grey: not in this source: ${named}`);
    }
    if (!none && this.grey) notes.push(`grey: ${this.grey}`);
    if (touched) notes.push(ARROWS);
    const marked = Object.entries(signs).map(([name, numbers]) => `${numbers.length.toLocaleString("en")} ${name}`);
    if (marked.length && !none) notes.push(`with a sign, not to be trusted: ${marked.join(", ")}`);
    $("bar-missing").replaceChildren(...notes.map((note) => made("span", note)));
  }

  showMap(part) {
    $("map-about").textContent = `${words(part.name)}: ${taxels(part.taxels[1])}, ${part.patches} ${part.patches === 1 ? "patch" : "patches"}`;
  }

  // Which touches there are, for who listens: told when others came or got another name, not often.
  announce(touches) {
    const said = touches.map((touch) => `${touch.label.replaceAll("_", " ")} on ${words(touch.part)}`).sort().join(", ") || "no touch";
    this.wish = said;
    if (said === this.announced || this.telling) return;
    this.telling = setTimeout(() => {
      this.telling = null;
      this.announced = this.wish;
      $("said").textContent = this.wish;
    }, TELL);
  }

  themed() {
    this.showTouches(this.touches ?? []);
  }

  showTouches(touches) {
    this.touches = touches;
    this.announce(touches);
    $("touches-head").textContent = touches.length ? (touches.length === 1 ? "1 touch" : `${touches.length} touches`) : "no touch";
    $("touch-list").replaceChildren(...touches.map((touch) => {
      const item = made("li"), name = made("b", touch.text);
      name.style.color = readable(touch.colour);
      item.append(name, made("span", touch.about.join("   ")));
      return item;
    }));
  }

  // All of a taxel, name by name.
  showTaxel(about) {
    const rows = facts(about).map((line) => line.slice(0, 2).map(([name, text]) => [name || "part", text]));
    rows.splice(2, 0, [["taxel", about.taxel], ["link", about.link]]);
    if (about.health !== null && !(about.health in SIGNS)) rows.push([["health", about.health]]);
    const cell = ([name, text], _, { length }) => [made("dt", name), made("dd", text, { className: length < 2 ? "wide" : "" })];
    $("pick-about").replaceChildren(...rows.flatMap((row) => row.flatMap(cell)));
    $("pick").hidden = false;
  }

  showCount(count) {
    $("chosen-count").textContent = count ? (count === 1 ? "1 taxel chosen" : `${count} taxels chosen`) : "";
  }
}
