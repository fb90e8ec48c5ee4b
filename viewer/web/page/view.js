// Saved views: what is shown and from where, in the files of the window (viewer/interaction/view_file.py).

import { made } from "./dom.js";
import { add, scale, unit } from "./matrices.js";

const FORMAT = "skinmap-view";
const VERSION = 1;
const NAME = "skinmap-view.json";
const LARGEST = 4e6; // bytes

const degrees = (radians) => (radians * 180) / Math.PI;
const triple = (value) => Array.isArray(value) && value.length === 3 && value.every(Number.isFinite);

export function viewOf(page) {
  const { camera, header } = page, selection = {};
  for (const [part, numbers] of page.chosen.byPart()) selection[part.name] = numbers.map((number) => number - part.taxels[0]);
  return {
    format: FORMAT, version: VERSION, robot: header.robot,
    camera: { position: add(camera.middle, scale(camera.direction, camera.distance)), focus: camera.middle, up: [0, 0, 1], angle: degrees(camera.angle), mode: "free" },
    layer: page.layer.name, style: page.picture.style, part: page.flat.part.name, selection,
  };
}

// Show what was saved; nothing changes where it does not fit the scene.
export function applyView(page, view, layers) {
  check(view, page.header, layers);
  const { camera: saved, selection = {} } = view, { camera } = page;
  const way = add(saved.position, scale(saved.focus, -1)), [x, y, z] = unit(way), far = Math.hypot(...way);
  camera.set(Math.atan2(y, x), Math.asin(z), saved.focus, (far * Math.tan((saved.angle * Math.PI) / 360)) / Math.tan(camera.angle / 2));
  page.setStyle(view.style);
  page.askLayer(view.layer);
  if (view.part) page.showFlat(view.part, true);
  const parts = page.header.parts.filter(({ name }) => name in selection);
  page.chosen.replace(parts.flatMap(({ name, taxels: [first] }) => selection[name].map((taxel) => first + taxel)));
  page.chosenChanged();
  page.cameraMoved();
}

function check(view, { robot, parts }, layers) {
  const fail = (text) => {
    throw new Error(text);
  };
  if (!view || view.format !== FORMAT) fail(`no saved view: "format": "${FORMAT}" expected`);
  if (view.version !== VERSION) fail(`view of version ${view.version}; this Skinmap reads version ${VERSION}`);
  const { camera, selection = {} } = view;
  if (!camera || !triple(camera.position) || !triple(camera.focus) || !(camera.angle >= 0.1 && camera.angle <= 170)) fail("damaged view: camera with position, focus and angle expected");
  if (Math.hypot(...camera.position.map((x, i) => x - camera.focus[i])) < 1e-9) fail("damaged view: the camera looks nowhere");
  if (view.robot !== robot) fail(`the view was saved of '${view.robot}', this robot is '${robot}'`);
  if (!layers.includes(view.layer)) fail(`no layer '${view.layer}'; there is: ${layers.join(", ")}`);
  if (!["discs", "surface"].includes(view.style)) fail(`damaged view: "style" is '${view.style}'; there is: discs, surface`);
  const names = parts.map(({ name }) => name);
  if (typeof selection !== "object" || selection === null) fail('damaged view: parts with taxels expected as "selection"');
  for (const name of [...(view.part ? [view.part] : []), ...Object.keys(selection)]) {
    if (!names.includes(name)) fail(`no part in this scene '${name}'; there is: ${names.join(", ")}`);
  }
  for (const { name, taxels: [, count] } of parts) {
    const rows = selection[name] ?? [];
    if (!Array.isArray(rows) || !rows.every((row) => Number.isInteger(row) && row >= 0)) fail(`damaged view: rows of taxels expected for '${name}'`);
    const most = rows.reduce((a, b) => Math.max(a, b), -1);
    if (most >= count) fail(`the view's selection names taxel ${most}, '${name}' has ${count} taxels`);
  }
}

// Give a view to the browser as a file; its name comes back.
export function download(view) {
  const address = URL.createObjectURL(new Blob([`${JSON.stringify(view, null, 2)}\n`], { type: "application/json" }));
  made("a", "", { href: address, download: NAME }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
  return NAME;
}

// Let people choose a file, and read the view in it.
export function upload(take, failed) {
  const input = made("input", "", { type: "file", accept: ".json,application/json" });
  input.onchange = async () => {
    const [file] = input.files;
    if (!file) return;
    try {
      if (file.size > LARGEST) throw new Error(`more than ${LARGEST} bytes: no saved view`);
      const text = await file.text();
      take(parsed(text), file.name);
    } catch (error) {
      failed(`${file.name}: ${error.message}`);
    }
  };
  input.click();
}

function parsed(text) {
  try {
    return JSON.parse(text);
  } catch {
    throw new Error("no saved view: not JSON text");
  }
}
