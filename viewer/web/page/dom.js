// Short words for what the page's elements are asked all the time.

export const $ = (id) => document.getElementById(id);
export const words = (name) => name.replaceAll("_", " ");

// A new element of a kind, with text in it.
export function made(kind, text = "", about = {}) {
  return Object.assign(document.createElement(kind), { textContent: text }, about);
}

// Where a pointer is on a canvas [px of the canvas].
export function pixel(event, canvas) {
  const box = canvas.getBoundingClientRect();
  return [(event.clientX - box.left) * (canvas.width / box.width), (event.clientY - box.top) * (canvas.height / box.height)];
}
