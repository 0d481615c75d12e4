/** What the colours mean. */
import { el } from "../dom";
import { SEQUENTIAL_CSS } from "../view/palette";

export function roleLegend(): { element: HTMLElement; tell: (handle: number, free: number, anchors: number) => void } {
  const counts = ["handle", "free", "anchor"].map(() => el("b", {}, "0"));
  const words = ["Handle", "Free", "Anchors"];
  const rows = ["handle", "free", "anchor"].map((role, index) =>
    el("li", {}, el("span", { class: `swatch ${role}` }), el("span", {}, words[index] ?? ""), counts[index]),
  );
  return {
    element: el("ul", { class: "legend", "aria-label": "Vertices by role" }, ...rows),
    tell: (...numbers) => numbers.forEach((value, index) => counts[index]?.replaceChildren(value.toLocaleString("en"))),
  };
}

export function scaleLegend(title: string, low: string, high: string): HTMLElement {
  const bar = el("span", { class: "scale-bar", "aria-hidden": "true" });
  bar.style.background = SEQUENTIAL_CSS;
  return el(
    "div",
    { class: "legend scale" },
    el("span", {}, title),
    el("span", { class: "scale-row" }, el("span", {}, low), bar, el("span", {}, high)),
  );
}
