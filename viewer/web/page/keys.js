// The keys of the page and what they do; the help lists them all. Where the window has the same key
// (viewer/interaction/controls.py), it does the same here, in the same words.

import { $, made } from "./dom.js";

// Names as events have them, as people read them, what they do, and the deed.
export const KEYS = [
  [[" "], "space", "pause, go on", (c) => $("play").onclick()],
  [["ArrowRight"], "left right", "one sample back, on", (c) => c.ask({ do: "step", by: 1 })],
  [["ArrowLeft"], "", "", (c) => c.ask({ do: "step", by: -1 })],
  [["ArrowUp"], "down up", "one second back, on", (c) => c.jump(1)],
  [["ArrowDown"], "", "", (c) => c.jump(-1)],
  [["Home"], "home", "to the beginning", (c) => c.jump(-Infinity)],
  [[","], ", .", "touch before, next", (c) => c.nextTouch(-1)],
  [["."], "", "", (c) => c.nextTouch(1)],
  [["+", "="], "+ -", "quicker, slower", (c) => c.changeSpeed(2)],
  [["-"], "", "", (c) => c.changeSpeed(0.5)],
  [["l"], "l", "loop", (c) => c.toggleLoop()],
  [["0"], "0", "zero forces, untouched", (c) => c.zero()],
  [["1", "2", "3", "4", "5", "6", "7", "8", "9"], "1 to 9", "layers, as they are listed", (c, key) => c.chooseLayer(Number(key) - 1)],
  [["d"], "d", "discs or surface", (c) => c.toggleStyle()],
  [["n"], "n", "flat map of the next part", (c) => c.nextMap()],
  [["c"], "c", "choose nothing", (c) => c.clear()],
  [["f"], "f b", "look from front, back", (c) => c.look("front")],
  [["b"], "", "", (c) => c.look("back")],
  [["["], "[ ] t", "left, right, top", (c) => c.look("left")],
  [["]"], "", "", (c) => c.look("right")],
  [["t"], "", "", (c) => c.look("top")],
  [[], "shift arrows", "turn the robot", null],
  [["z"], "z Z", "nearer, farther", (c) => c.lead((camera) => camera.nearer(1.15))],
  [["Z"], "", "", (c) => c.lead((camera) => camera.nearer(1 / 1.15))],
  [["W"], "W A S D", "move the robot", (c) => c.lead((camera) => camera.move(0, -0.04))],
  [["S"], "", "", (c) => c.lead((camera) => camera.move(0, 0.04))],
  [["A"], "", "", (c) => c.lead((camera) => camera.move(-0.04, 0))],
  [["D"], "", "", (c) => c.lead((camera) => camera.move(0.04, 0))],
  [["k"], "k", "plot taxels, or how touches went", (c) => c.nextPlot()],
  [["g"], "g", "go to the touches", (c) => c.focus()],
  [["r"], "r", "the whole robot again", (c) => c.look("first")],
  [["a"], "a", "map follows touches", (c) => c.follow()],
  [["v"], "v V", "save, load the view", (c) => c.saveView()],
  [["V"], "", "", (c) => c.loadView()],
  [["h", "?"], "h", "this help", (c) => c.toggleHelp()],
  [["Escape"], "esc", "close help and box", (c) => c.close()],
];
const STEP = 0.12; // that an arrow turns [rad]
const TURNS = { ArrowLeft: [STEP, 0], ArrowRight: [-STEP, 0], ArrowUp: [0, STEP], ArrowDown: [0, -STEP] };
const MOUSE = [
  ["drag", "turn (left), move (middle, right)"],
  ["wheel", "zoom; on a screen two fingers"],
  ["point", "what a taxel is"],
  ["click", "choose it, shift: its module"],
  ["", "ctrl: patch, both: add"],
  ["map", "drag draws a lasso, shift: add"],
  ["lanes", "wheel: zoom, drag: move"],
  ["plot", "wheel: zoom, point: values"],
];

export function listen(controls) {
  for (const [shown, text] of [...KEYS.filter(([, , text]) => text).map(([, shown, text]) => [shown, text]), ["", ""], ...MOUSE]) {
    $("help-keys").append(made("dt", shown), made("dd", text));
  }
  document.addEventListener("keydown", (event) => press(event, controls));
}

function press(event, controls) {
  if (event.shiftKey && TURNS[event.key] && !/^(INPUT|SELECT)$/.test(event.target.tagName)) {
    event.preventDefault();
    controls.lead((camera) => camera.turn(...TURNS[event.key]));
    return;
  }
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  // A list that has the focus keeps the keys that it is led with.
  if (/^(INPUT|SELECT)$/.test(event.target.tagName) && event.key !== "Escape") return;
  if (event.target.tagName === "BUTTON" && event.key === " ") return;
  const key = KEYS.find(([names]) => names.includes(event.key));
  if (!key) return;
  event.preventDefault();
  key[3](controls, event.key);
}
