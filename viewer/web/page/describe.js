// What is known of one taxel, in the words of the window's box (viewer/interaction/pointing.py).

import { words } from "./dom.js";
import { SIGNS } from "./signs.js";

const MANY = 8; // neighbours that are listed by number
const PLAIN = ["pressure", "raw", "structures", "patches"]; // layers whose value is told anyway
const number = (value, digits) => (value === null ? "unknown" : `${Number(value.toPrecision(digits))}`);

// Name and text of each thing that is known; those of one line of the window together.
export function facts(about) {
  const { neighbours, shown } = about, listed = neighbours.slice(0, MANY).join(" ") || "none";
  const more = neighbours.length > MANY ? ` and ${neighbours.length - MANY} more` : "";
  const felt = [["pressure", about.pressure], ["raw", about.raw]].filter(([name]) => about.sent.includes(name));
  const lines = [
    [["", words(about.part)], ["channel", about.channel]],
    [["module", about.module], ["patch", about.patch], ["taxel", about.taxel]],
    [["position", `${about.position_mm.map((x) => x.toFixed(1)).join(" ")} mm`]],
    [["normal", about.normal.map((x) => x.toFixed(2)).join(" ")]],
    [["neighbours", listed + more]],
    felt.map(([name, value], k) => [name, number(value, 4) + (k + 1 === felt.length ? " counts" : "")]),
  ];
  if (shown && !PLAIN.includes(shown.name)) lines.push([[shown.title, value(shown)]]);
  if (shown?.name !== "health" && about.health in SIGNS) lines.push([["health", about.health]]);
  if (about.structure !== null) lines.push([["structure", about.structure]]);
  for (const touch of about.touches) lines.push([["in", touch]]);
  return lines.filter((line) => line.length);
}

// The box's lines.
export function lines(about) {
  return facts(about).map((line) => line.map(([name, text]) => (name ? `${name} ${text}` : text)).join(", "));
}

function value({ value: felt, category, unit }) {
  if (category) return category;
  return felt === null ? "unknown" : `${number(felt, 3)} ${unit.split(",")[0]}`;
}
