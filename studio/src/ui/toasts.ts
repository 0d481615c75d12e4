/** Short messages at the foot of the view: what happened, and what to do about it. */
import { el } from "../dom";
import { button } from "./controls";
import { icon } from "./icons";

const READING_TIME_MS = 6000;
const MOST = 3;

export class Toasts {
  readonly element = el("div", { class: "toasts" });
  readonly #polite = el("div", { role: "status", "aria-live": "polite" });
  readonly #urgent = el("div", { role: "alert" });

  constructor() {
    this.element.append(this.#urgent, this.#polite);
  }

  /** Goes away by itself. */
  tell(text: string): void {
    const toast = this.#add(this.#polite, "done", text, "");
    setTimeout(() => toast.remove(), READING_TIME_MS);
  }

  /** Stays until it is closed. */
  warn(text: string, advice = ""): void {
    const twin = [...this.#urgent.children].find((child) => child.getAttribute("data-text") === text);
    twin?.remove();
    this.#add(this.#urgent, "warning", text, advice).setAttribute("data-text", text);
  }

  clear(): void {
    this.#urgent.replaceChildren();
    this.#polite.replaceChildren();
  }

  #add(place: HTMLElement, mark: "done" | "warning", text: string, advice: string): HTMLElement {
    const words = el("div", { class: "words" }, el("p", {}, text), advice ? el("p", { class: "advice" }, advice) : null);
    const toast = el("div", { class: `toast ${mark}` }, icon(mark), words);
    toast.append(button({ label: "Dismiss", icon: "close", iconOnly: true, look: "quiet", onClick: () => toast.remove() }));
    while (place.children.length >= MOST) place.firstElementChild?.remove();
    place.append(toast);
    return toast;
  }
}
