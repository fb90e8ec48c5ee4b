"use strict";

const byId = (name) => document.getElementById(name);
const BLUE = "#2f6fb3";
const ORANGE = "#d9741a";
const GREY = "#888";
let state = null;

async function press(key, rest = "") {
  try {
    const answer = await fetch("press", { method: "POST", body: JSON.stringify({ key, rest }) });
    state = await answer.json();
  } catch {
    byId("error").textContent = "the command has ended";
    return;
  }
  draw();
  if (key === "w" || key === "q") {
    byId("error").textContent = key === "w" ? "written" : "ended, nothing written";
  }
}

function draw() {
  byId("name").textContent = `${state.name}: ${state.touches.length} touches`;
  byId("shown").textContent = state.shown;
  byId("error").textContent = state.error;
  const words = [...new Set(state.touches.map((touch) => touch[3]))];
  byId("words").replaceChildren(...words.map((word) => new Option(word, word)));
  course();
  picture();
}

function course() {
  const canvas = byId("course");
  const pen = canvas.getContext("2d");
  pen.clearRect(0, 0, canvas.width, canvas.height);
  const [start, end] = state.span_s;
  const across = (time) => ((time - start) / Math.max(end - start, 1e-9)) * canvas.width;
  state.touches.forEach(([, began, ended], place) => {
    pen.globalAlpha = place === state.place ? 0.7 : 0.25;
    pen.fillStyle = place === state.place ? ORANGE : BLUE;
    pen.fillRect(across(began), 0, Math.max(across(ended) - across(began), 2), canvas.height);
  });
  pen.globalAlpha = 1;
  const low = Math.min(...state.loads);
  const high = Math.max(...state.loads, low + 1e-9);
  pen.strokeStyle = GREY;
  pen.lineWidth = 2;
  pen.beginPath();
  state.loads.forEach((load, k) => {
    const x = (k / Math.max(state.loads.length - 1, 1)) * canvas.width;
    pen.lineTo(x, canvas.height - 4 - ((load - low) / (high - low)) * (canvas.height - 8));
  });
  pen.stroke();
}

function picture() {
  const canvas = byId("picture");
  const pen = canvas.getContext("2d");
  pen.clearRect(0, 0, canvas.width, canvas.height);
  if (!state.picture) return;
  const { uv, peak } = state.picture;
  const low = [0, 1].map((axis) => Math.min(...uv.map((point) => point[axis])));
  const high = [0, 1].map((axis) => Math.max(...uv.map((point) => point[axis])));
  const scale = Math.min(
    (canvas.width - 30) / Math.max(high[0] - low[0], 1e-9),
    (canvas.height - 30) / Math.max(high[1] - low[1], 1e-9),
  );
  const size = Math.max(2, Math.min(9, (0.8 * scale * (high[0] - low[0])) / Math.sqrt(2 * uv.length)));
  uv.forEach(([u, v], k) => {
    pen.globalAlpha = 0.15 + 0.85 * peak[k];
    pen.fillStyle = peak[k] > 0.1 ? ORANGE : GREY;
    pen.beginPath();
    pen.arc(15 + (u - low[0]) * scale, canvas.height - 15 - (v - low[1]) * scale, size, 0, 7);
    pen.fill();
  });
  pen.globalAlpha = 1;
}

byId("naming").addEventListener("submit", (event) => {
  event.preventDefault();
  press("n", byId("word").value);
});
byId("keys").addEventListener("click", (event) => {
  if (event.target.dataset.key !== undefined) press(event.target.dataset.key);
});
byId("course").addEventListener("click", (event) => {
  const [start, end] = state.span_s;
  const time = start + (event.offsetX / event.target.clientWidth) * (end - start);
  const gaps = state.touches.map(([, began, ended]) => Math.max(began - time, time - ended, 0));
  if (gaps.length) press("g", String(1 + gaps.indexOf(Math.min(...gaps))));
});
document.addEventListener("keydown", (event) => {
  if (event.target.tagName === "INPUT" || event.ctrlKey || event.metaKey) return;
  const key = { ArrowRight: "", ArrowLeft: "b", s: "s", j: "j", d: "d", u: "u" }[event.key];
  if (key !== undefined) {
    event.preventDefault();
    press(key);
  }
});
press("look");
