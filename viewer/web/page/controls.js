// Choices, player and keys: what people ask for, and what the server says beside samples.

import { KEYS, listen } from "./keys.js";
import { $, words } from "./dom.js";
import { Timeline } from "./timeline.js";
import { applyView, download, upload, viewOf } from "./view.js";
import { Words } from "./words.js";

const NEAR = 0.3; // a touch that begins so near to what is shown is the one that is shown [s]

export class Controls {
  constructor(page) {
    this.page = page;
    this.state = {};
    this.about = {};
    this.words = new Words(page.header);
    this.kept = null; // the view that was saved last
    this.timeline = new Timeline($("spans"), (to) => this.ask({ do: "seek", to }), () => this.stateChanged({}));
    for (const part of page.header.parts) {
      for (const id of ["part", "map-part"]) $(id).add(new Option(words(part.name), part.name));
    }
    this.mapChanged(page.flat.part);
    this.choices();
    this.player();
    listen(this);
  }

  ask(wish) {
    this.page.link.ask(wish);
  }

  say(text) {
    this.words.say(text);
  }

  choices() {
    const { page } = this;
    $("layer").onchange = () => page.askLayer($("layer").value);
    $("style").onchange = () => page.setStyle($("style").value);
    $("plot").onchange = () => page.setPlot($("plot").value);
    $("part").onchange = () => {
      page.setPart($("part").value);
      if ($("part").value) page.showFlat($("part").value);
    };
    $("map-part").onchange = () => $("map-part").value && page.showFlat($("map-part").value);
    $("view").onchange = () => this.look($("view").value);
    $("pick-close").onclick = () => this.clear();
    for (const reach of ["module", "patch"]) $(`pick-${reach}`).onclick = () => page.choose(page.picked, reach, false);
    $("help-open").onclick = $("help-close").onclick = () => this.toggleHelp();
    $("view-save").onclick = () => this.saveView();
    $("view-load").onclick = () => this.openView();
    // A list that was used with the mouse gives the keys back to the page.
    let pointed = false;
    document.addEventListener("pointerdown", () => (pointed = true), true);
    document.addEventListener("keydown", () => (pointed = false), true);
    document.addEventListener("change", (event) => pointed && event.target.blur());
  }

  player() {
    $("play").onclick = () => this.ask({ do: this.halted() ? "play" : "pause" });
    $("back").onclick = () => this.ask({ do: "step", by: -1 });
    $("on").onclick = () => this.ask({ do: "step", by: 1 });
    $("touch-before").onclick = () => this.nextTouch(-1);
    $("touch-next").onclick = () => this.nextTouch(1);
    $("time").oninput = () => this.ask({ do: "seek", to: Number($("time").value) });
    $("speed").onchange = () => this.ask({ do: "speed", to: Number($("speed").value) });
    $("loop").onchange = () => this.ask({ do: "loop", to: $("loop").checked });
    $("zero").onclick = () => this.zero();
  }

  // Whether nothing moves: one press of play changes that, at the end of a recording too.
  halted() {
    return Boolean(this.state.paused || (this.state.ended && this.state.seekable));
  }

  // What keys do.

  keyNames() {
    return KEYS.flatMap(([names]) => names);
  }

  jump(seconds) {
    const [first] = this.state.span ?? [0];
    this.ask({ do: "seek", to: Math.max(first, (this.state.position ?? 0) + seconds) });
  }

  // To the beginning of the next touch that is known, or of the one before (-1).
  nextTouch(way) {
    const here = this.state.position ?? 0, begun = this.timeline.spans.filter((span) => span[4]).map(([from]) => from).sort((a, b) => a - b);
    const to = way > 0 ? begun.find((one) => one > here + NEAR) : begun.findLast((one) => one < here - NEAR);
    if (to === undefined) this.say("no touch is known that way");
    else this.ask({ do: "seek", to });
  }

  changeSpeed(factor) {
    const to = this.state.speed * factor, known = [...$("speed").options].some(({ value }) => Number(value) === to);
    if (!this.state.seekable || !known) return this.say("no other speed");
    this.state.speed = to; // the next press may come before the answer
    this.ask({ do: "speed", to });
    this.say(`speed ${to}`);
  }

  toggleLoop() {
    if (!this.state.seekable) return this.say("a live source cannot be led through time");
    this.say(this.state.loop ? "plays once" : "plays over and over");
    this.ask({ do: "loop", to: !this.state.loop });
  }

  zero() {
    if ((this.state.zero_minutes ?? null) === null) return this.say("no load calibration");
    this.say("zero anew, as soon as nothing touches");
    this.ask({ do: "zero" });
  }

  chooseLayer(place) {
    if (place < $("layer").options.length) this.page.askLayer($("layer").options[place].value);
  }

  toggleStyle() {
    this.page.setStyle(this.page.picture.style === "discs" ? "surface" : "discs");
  }

  nextPlot() {
    const { options, selectedIndex } = $("plot");
    this.page.setPlot(($("plot").value = options[(selectedIndex + 1) % options.length].value));
  }

  // The camera led by keys: steps of a turn, a move in shares of the picture, or nearer.
  lead(act) {
    act(this.page.camera);
    this.page.cameraMoved();
  }

  nextMap() {
    const { parts } = this.page.header, now = parts.indexOf(this.page.flat.part);
    this.page.showFlat(parts[(now + 1) % parts.length].name, true);
  }

  clear() {
    this.page.choose(-1, "taxel", false);
  }

  look(name) {
    if (!name) return;
    if (name === "first") this.page.camera.home();
    else this.page.camera.look(name);
    this.page.cameraMoved(name);
  }

  focus() {
    if (!this.page.focus()) this.say("nothing is touched");
  }

  follow() {
    $("map-part").value = $("part").value = "";
    this.page.setPart("");
    this.followTouches(this.about.touches ?? []);
  }

  view() {
    return viewOf(this.page);
  }

  saveView() {
    this.kept = this.view();
    this.say(`view saved in ${download(this.kept)}`);
  }

  loadView() {
    if (this.kept) this.setView(this.kept, "the view saved last");
    else this.openView();
  }

  openView() {
    upload((view, name) => this.setView(view, `view of ${name}`), (problem) => this.say(problem));
  }

  // Show a saved view; where it does not fit, that is said and nothing changes.
  setView(view, name) {
    try {
      applyView(this.page, view, [...$("layer").options].map(({ value }) => value));
      this.kept = view;
      this.say(name);
    } catch (error) {
      this.say(error.message);
    }
  }

  toggleHelp() {
    $("help").hidden = !$("help").hidden;
  }

  close() {
    $("help").hidden = true;
    this.page.hover.leave();
  }

  // What the server says beside samples.
  letter(message) {
    const kinds = {
      hello: () => this.hello(message),
      layer: () => this.page.setLayer(message),
      state: () => this.stateChanged(message),
      pick: () => this.page.isPicked(message) && this.words.showTaxel(message),
      point: () => this.page.hover.tell(message),
      notice: () => this.say(message.text),
      spans: () => this.timeline.set(message.spans, message.parts),
      plot: () => this.page.traces.take(message),
      problem: () => {
        this.words.tell(message.text, () => this.write());
        if (this.page.layer.table) this.words.showLayer(this.page.layer);
      },
    };
    kinds[message.kind]?.();
  }

  hello({ layers, style, view, scene, size, title }) {
    if (title) $("robot").textContent = title;
    if (size) Object.assign($("stage").style, { width: `${size[0]}px`, height: `${size[1]}px` });
    if (this.scene && this.scene !== scene) {
      this.page.outdated = true; // the server came back with another scene
      location.reload();
    }
    this.scene = scene;
    if ($("layer").options.length) {
      this.page.askLayer($("layer").value); // connected again: what was chosen stays chosen
      this.page.traces.again();
      return;
    }
    for (const name of layers) $("layer").add(new Option(name, name));
    this.page.setStyle(style);
    this.begin = view; // when the first layer is there
  }

  layerChanged(layer) {
    $("layer").value = layer.name;
    this.words.showLayer(layer);
    const { begin } = this;
    this.begin = null;
    if (begin) this.setView(begin, "as it was saved");
  }

  mapChanged(part) {
    this.words.showMap(part);
  }

  // The player's state counts from now on, not when it is written: a letter may come between.
  sampleCame(header) {
    this.state = { ...this.state, ...header };
  }

  sampleChanged(header) {
    this.about = header;
    this.stateChanged({});
    this.words.showTouches(header.touches);
    if (!$("map-part").value && !$("part").value) this.followTouches(header.touches);
  }

  // The map of a part that is touched; where none is, of one that the source has.
  followTouches(touches) {
    const { page } = this, { name } = page.flat.part, silent = page.silent();
    if (touches.length && !touches.some(({ part }) => part === name)) page.showFlat(touches[0].part);
    if (touches.length || !silent.some((part) => part.name === name)) return;
    const heard = page.header.parts.find((part) => !silent.includes(part));
    if (heard) page.showFlat(heard.name);
  }

  stateChanged(state) {
    this.state = { ...this.state, ...state };
    const { seekable, position, speed, loop, span = [0, 0] } = this.state, paused = this.halted();
    $("player").hidden = Boolean(this.state.single);
    $("play-sign").setAttribute("d", paused ? "M4 3v10l9-5z" : "M4 3h3v10H4zM9 3h3v10H9z");
    $("play").setAttribute("aria-label", paused ? "play" : "pause");
    for (const id of ["speed", "loop"]) $(id).disabled = !seekable;
    $("time").disabled = !(span[1] > span[0]);
    if (span[1] !== null) this.timeline.draw(span, position ?? 0, this.page.camera.ratio);
    if (span[1] !== null) Object.assign($("time"), { min: this.timeline.view[0], max: this.timeline.view[1] });
    if (document.activeElement !== $("time") || paused === false) $("time").value = position ?? 0;
    $("clock").textContent = this.told();
    if (document.activeElement !== $("speed")) $("speed").value = `${speed}`;
    $("loop").checked = loop;
    const minutes = this.state.zero_minutes ?? null; // age of the zero of the forces
    $("zero").hidden = minutes === null;
    $("zero").textContent = `zero, ${minutes} min old`;
    this.write();
  }

  // Where it stands: in a recording, or how long before now.
  told() {
    const { seekable, position, paused, span } = this.state, at = position ?? 0;
    if (!span || span[1] === null) return "";
    if (seekable) return `${at.toFixed(2)} / ${span[1].toFixed(2)} s`;
    return paused ? `${(at - span[1]).toFixed(1)} s` : "live";
  }

  connected(open, why) {
    this.words.connected(open, why);
    this.write();
  }

  themed() {
    this.words.themed();
  }

  write() {
    this.words.showState(this.state, this.about, this.page.delay, this.page.lost);
  }
}
