// Colours of the page in the light or in the dark, as the system's setting has it.

const dark = window.matchMedia("(prefers-color-scheme: dark)");
const LIGHT = { dark: false, ground: [0.969, 0.973, 0.98], panel: [255, 255, 255], card: "#ffffff", ink: "#20262e", faint: "#5f6772" };
const DARK = { dark: true, ground: [0.075, 0.09, 0.11], panel: [27, 32, 38], card: "#1b2026", ink: "#e8ebef", faint: "#a3acb8" };

export const colours = () => (dark.matches ? DARK : LIGHT);

export function onTheme(act) {
  dark.addEventListener("change", act);
}
