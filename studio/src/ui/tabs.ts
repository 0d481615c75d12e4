/** Tabs as the ARIA practices have them: arrows move, the chosen one alone is in the tab order. */
import { el, show } from "../dom";

export interface Tab<T extends string> {
  id: T;
  label: string;
  panel: HTMLElement;
}

export class Tabs<T extends string> {
  readonly list: HTMLElement;
  readonly #tabs: readonly Tab<T>[];
  readonly #buttons: HTMLButtonElement[];
  readonly #onChange: (id: T) => void;

  constructor(label: string, tabs: readonly Tab<T>[], onChange: (id: T) => void) {
    this.#tabs = tabs;
    this.#onChange = onChange;
    this.#buttons = tabs.map((tab) =>
      el(
        "button",
        { type: "button", role: "tab", id: `tab-${tab.id}`, "aria-controls": `panel-${tab.id}`, click: () => this.choose(tab.id) },
        tab.label,
      ),
    );
    for (const { id, panel } of tabs) {
      panel.id = `panel-${id}`;
      panel.setAttribute("role", "tabpanel");
      panel.setAttribute("aria-labelledby", `tab-${id}`);
    }
    this.list = el(
      "div",
      { class: "tabs", role: "tablist", "aria-label": label, keydown: (event: KeyboardEvent) => this.#onKey(event) },
      ...this.#buttons,
    );
  }

  choose(id: T): void {
    this.#tabs.forEach((tab, index) => {
      const chosen = tab.id === id;
      this.#buttons[index]?.setAttribute("aria-selected", String(chosen));
      this.#buttons[index]?.setAttribute("tabindex", chosen ? "0" : "-1");
      show(tab.panel, chosen);
    });
    this.#onChange(id);
  }

  #onKey(event: KeyboardEvent): void {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (step === undefined) return;
    const now = this.#buttons.findIndex((tab) => tab === document.activeElement);
    const next = (now + step + this.#tabs.length) % this.#tabs.length;
    this.#buttons[next]?.focus();
    const tab = this.#tabs[next];
    if (tab) this.choose(tab.id);
    event.preventDefault();
  }
}
