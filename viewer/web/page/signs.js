// Signs that say what a colour cannot, as the window has them (viewer/drawing/skin/taxel_drawing.py): lines
// in a circle of radius 1.

const SVG = "http://www.w3.org/2000/svg";
const closed = (...points) => points.map((point, k) => [point, points[(k + 1) % points.length]]);
const falling = [[-0.6, 0.6], [0.6, -0.6]], rising = [[-0.6, -0.6], [0.6, 0.6]];

export const SIGNS = {
  dead: [falling, rising],
  stuck: closed([-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]),
  saturated: closed([-0.75, -0.5], [0.75, -0.5], [0, 0.8]),
  noisy: [[[-0.75, -0.35], [-0.3, 0.4]], [[-0.3, 0.4], [0.25, -0.4]], [[0.25, -0.4], [0.75, 0.35]]],
  unheard: [[[-0.6, 0], [0.6, 0]]],
  stale: [rising],
};

// For the legend.
export function signPicture(name) {
  const picture = document.createElementNS(SVG, "svg"), path = document.createElementNS(SVG, "path");
  picture.setAttribute("viewBox", "-1 -1 2 2");
  path.setAttribute("d", SIGNS[name].map(([[a, b], [c, d]]) => `M${a} ${-b}L${c} ${-d}`).join(""));
  path.setAttribute("class", "sign");
  picture.append(path.cloneNode(), path);
  return picture;
}
