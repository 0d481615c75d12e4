/** One line at the head of the view that says what can be done now. */
import { el, show } from "../dom";
import { icon } from "./icons";

export type Tone = "plain" | "busy" | "problem";

export class Guide {
  readonly element = el("div", { class: "guide", role: "status", "aria-live": "polite" });

  say(text: string | null, tone: Tone = "plain"): void {
    show(this.element, text !== null);
    if (text === null || this.element.textContent === text) return;
    this.element.className = `guide ${tone}`;
    this.element.replaceChildren(...(tone === "problem" ? [icon("warning")] : []), el("span", {}, text));
  }
}
