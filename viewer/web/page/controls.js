// Choices, player, keys and mouse, and all that is written beside the picture.

import { readable } from "./labels.js";

const $ = (id) => document.getElementById(id);
const TOLD = 8000; // how long a problem stands there [ms]
const TURN = 0.008; // radians a pixel
const words = (name) => name.replaceAll("_", " ");

export class Controls {
  constructor(page) {
    this.page = page;
    this.open = false;
    this.state = {};
    this.about = {};
    this.problem = "";
    const { header } = page;
    $("robot").textContent = header.robot;
    document.title = `${header.robot} · Skinmap`;
    $("count").textContent = `${header.parts.reduce((n, part) => n + part.taxels[1], 0).toLocaleString("en")} taxels`;
    for (const part of header.parts) {
      for (const id of ["part", "map-part"]) $(id).add(new Option(words(part.name), part.name));
    }
    this.mapChanged(page.flat.part);
    this.choices();
    this.player();
    this.mouse();
    document.addEventListener("keydown", (event) => this.key(event));
  }

  choices() {
    const { page } = this;
    $("layer").onchange = () => page.link.ask({ do: "layer", to: $("layer").value });
    $("style").onchange = () => page.setStyle($("style").value);
    $("part").onchange = () => {
      page.setPart($("part").value);
      if ($("part").value) page.showFlat($("part").value);
    };
    $("map-part").onchange = () => $("map-part").value && page.showFlat($("map-part").value);
    $("view").onchange = () => this.look($("view").value);
    $("pick-close").onclick = () => this.pick(-1);
  }

  look(name) {
    if (!name) return;
    if (name === "first") this.page.camera.home();
    else this.page.camera.look(name);
    $("view").value = name;
    this.page.cameraMoved();
  }

  player() {
    const ask = (wish) => this.page.link.ask(wish);
    $("play").onclick = () => ask({ do: this.state.paused ? "play" : "pause" });
    $("back").onclick = () => ask({ do: "step", by: -1 });
    $("on").onclick = () => ask({ do: "step", by: 1 });
    $("time").oninput = () => ask({ do: "seek", to: Number($("time").value) });
    $("speed").onchange = () => ask({ do: "speed", to: Number($("speed").value) });
    $("loop").onchange = () => ask({ do: "loop", to: $("loop").checked });
  }

  mouse() {
    const { page } = this, canvas = page.picture.canvas;
    let last = null, far = 0;
    const at = (event, on) => {
      const box = on.getBoundingClientRect();
      return [(event.clientX - box.left) * (on.width / box.width), (event.clientY - box.top) * (on.height / box.height)];
    };
    canvas.onpointerdown = (event) => {
      canvas.setPointerCapture(event.pointerId);
      last = [event.clientX, event.clientY];
      far = 0;
    };
    canvas.onpointermove = (event) => {
      if (!last) return;
      const [dx, dy] = [event.clientX - last[0], event.clientY - last[1]];
      last = [event.clientX, event.clientY];
      far += Math.hypot(dx, dy);
      if (far < 3) return;
      canvas.classList.add("turning");
      $("view").value = "";
      if (event.buttons & 2 || event.shiftKey) page.camera.move(dx / canvas.clientHeight, dy / canvas.clientHeight);
      else page.camera.turn(TURN * dx, TURN * dy);
      page.cameraMoved();
    };
    canvas.onpointerup = (event) => {
      canvas.classList.remove("turning");
      if (last && far < 3 && event.button === 0) this.pick(page.picture.taxelAt(...at(event, canvas), page.camera));
      last = null;
    };
    canvas.onpointercancel = () => (last = null);
    canvas.oncontextmenu = (event) => event.preventDefault();
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      page.camera.nearer(Math.exp(-0.0015 * event.deltaY));
      page.cameraMoved();
    }, { passive: false });
    const flat = page.flat.canvas;
    flat.onclick = (event) => this.pick(page.flat.taxelAt(...at(event, flat)));
  }

  pick(number) {
    const taxel = this.page.taxel(number);
    if (!taxel) $("pick").hidden = true;
    else this.page.link.ask({ do: "pick", ...taxel });
    this.page.pick(taxel ? number : -1);
  }

  key(event) {
    if (/^(INPUT|SELECT)$/.test(event.target.tagName) || event.ctrlKey || event.metaKey || event.altKey) return;
    const next = (select) => {
      select.selectedIndex = (select.selectedIndex + 1) % select.options.length;
      select.onchange();
    };
    const acts = {
      h: () => ($("help").hidden = !$("help").hidden),
      Escape: () => ($("help").hidden = true),
      " ": () => $("play").onclick(),
      ArrowLeft: () => $("back").onclick(),
      ArrowRight: () => $("on").onclick(),
      0: () => this.look("first"),
      1: () => this.look("front"),
      2: () => this.look("back"),
      3: () => this.look("left"),
      4: () => this.look("right"),
      s: () => next($("style")),
      l: () => next($("layer")),
    };
    if (!(event.key in acts)) return;
    event.preventDefault();
    acts[event.key]();
  }

  // What the server says beside samples.
  letter(message) {
    const kinds = {
      hello: () => this.hello(message),
      layer: () => this.page.setLayer(message),
      state: () => this.stateChanged(message),
      pick: () => this.showPick(message),
      problem: () => {
        this.problem = message.text;
        clearTimeout(this.forgetting);
        this.forgetting = setTimeout(() => {
          this.problem = "";
          this.write();
        }, TOLD);
        this.write();
      },
    };
    kinds[message.kind]?.();
  }

  hello({ layers, style }) {
    if (!$("layer").options.length) {
      for (const name of layers) $("layer").add(new Option(name, name));
      $("style").value = style;
      this.page.setStyle(style);
      return;
    }
    // Connected again: what was chosen stays chosen.
    this.page.link.ask({ do: "layer", to: $("layer").value });
  }

  layerChanged(layer) {
    $("layer").value = layer.name;
    $("bar-title").textContent = layer.title;
    $("bar-unit").textContent = layer.unit;
    const css = ([r, g, b]) => `rgb(${r} ${g} ${b})`;
    $("bar-scale").hidden = layer.categories.length > 0;
    $("bar-colours").style.background = `linear-gradient(to top, ${layer.table.map(css).join(",")})`;
    const [low, high] = layer.limits;
    $("bar-ticks").replaceChildren(...[1, 0.5, 0].map((share) => {
      const tick = document.createElement("li");
      tick.textContent = `${Number((low + share * (high - low)).toPrecision(3))}`;
      return tick;
    }));
    $("bar-names").replaceChildren(...layer.categories.map((name, k) => {
      const item = document.createElement("li"), swatch = document.createElement("i");
      swatch.style.background = css(layer.table[k]);
      item.append(swatch, name);
      return item;
    }));
    this.missing = layer.missing;
  }

  mapChanged(part) {
    $("map-about").textContent = `${words(part.name)}: ${part.taxels[1]} taxels, ${part.patches} ${part.patches === 1 ? "patch" : "patches"}`;
  }

  // The player's state counts from now on, not when it is written: a letter may come between.
  sampleCame(header) {
    this.state = { ...this.state, ...header };
  }

  sampleChanged(header) {
    this.about = header;
    this.stateChanged({});
    const { touches } = header;
    $("touches-head").textContent = touches.length ? (touches.length === 1 ? "1 touch" : `${touches.length} touches`) : "no touch";
    $("touch-list").replaceChildren(...touches.map((touch) => {
      const item = document.createElement("li"), name = document.createElement("b"), where = document.createElement("span");
      name.textContent = touch.text;
      name.style.color = readable(touch.colour);
      const area = touch.area === null ? "" : `, ${(1e4 * touch.area).toFixed(1)} cm²`;
      const force = touch.force === null ? "" : `, ${touch.force.toFixed(1)} N`;
      where.textContent = `${words(touch.part)}${area}${force}`;
      item.append(name, where);
      return item;
    }));
    if (!$("map-part").value && !$("part").value && touches.length) {
      const here = touches.some((touch) => touch.part === this.page.flat.part.name);
      if (!here) this.page.showFlat(touches[0].part);
    }
  }

  stateChanged(state) {
    this.state = { ...this.state, ...state };
    const { paused, seekable, position, duration, speed, loop } = this.state;
    $("player").hidden = Boolean(this.state.single);
    $("play-sign").setAttribute("d", paused ? "M4 3v10l9-5z" : "M4 3h3v10H4zM9 3h3v10H9z");
    $("play").setAttribute("aria-label", paused ? "play" : "pause");
    for (const id of ["time", "speed", "loop"]) $(id).disabled = !seekable;
    if (duration !== null) $("time").max = duration;
    if (document.activeElement !== $("time") || paused === false) $("time").value = position ?? 0;
    $("clock").textContent = duration === null ? (seekable ? "" : "live") : `${(position ?? 0).toFixed(2)} / ${duration.toFixed(2)} s`;
    if (document.activeElement !== $("speed")) $("speed").value = `${speed}`;
    $("loop").checked = loop;
    this.write();
  }

  connected(open) {
    this.open = open;
    this.problem = "";
    this.write();
  }

  write() {
    const { about, state } = this, said = [];
    let warn = true;
    if (!this.open) said.push("not connected; trying again");
    else if (state.error) said.push(`the source failed: ${state.error}`);
    else if (this.problem || about.problem) said.push(this.problem || about.problem);
    else if (about.stale) said.push("stale: nothing comes from the source");
    else {
      warn = false;
      if (about.rate != null) said.push(`${about.rate.toFixed(0)} samples/s`);
      if (about.latency != null) said.push(`latency ${(1e3 * about.latency).toFixed(0)} ms`);
      if (about.dropped) said.push(`${about.dropped} left out`);
      if (state.ended) said.push("at its end");
      if (state.paused) said.push("paused");
    }
    $("status").textContent = said.join(" · ");
    $("status").className = warn ? "warn" : "";
  }

  showPick(taxel) {
    const rows = {
      part: words(taxel.part), channel: taxel.channel, module: taxel.module, patch: taxel.patch,
      position: `${taxel.position_mm.join(", ")} mm in ${taxel.link}`,
      normal: taxel.normal.join(", "), neighbours: `channels ${taxel.neighbours.join(", ")}`,
      pressure: taxel.pressure === null ? "unknown" : `${taxel.pressure.toFixed(0)} counts`,
      raw: taxel.raw === null ? null : `${taxel.raw.toFixed(0)} counts`,
      structure: taxel.structure, health: taxel.health,
    };
    const list = [];
    for (const [name, value] of Object.entries(rows)) {
      if (value === null) continue;
      const term = document.createElement("dt"), text = document.createElement("dd");
      term.textContent = name;
      text.textContent = value;
      list.push(term, text);
    }
    $("pick-about").replaceChildren(...list);
    $("pick").hidden = false;
  }
}
