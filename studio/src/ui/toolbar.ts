/** Tools as a column of icons: of each group one is pressed. */
import { el } from "../dom";
import { button } from "./controls";
import type { IconName } from "./icons";

export interface Tool<T extends string> {
  id: T;
  label: string;
  icon: IconName;
  keys: string;
}

export class Toolbar<T extends string> {
  readonly element: HTMLElement;
  readonly #buttons = new Map<T, HTMLButtonElement>();

  constructor(label: string, groups: readonly (readonly Tool<T>[])[], onChoose: (id: T) => void, ...more: HTMLElement[][]) {
    const columns = groups.map((tools) =>
      el(
        "div",
        { class: "tool-group" },
        ...tools.map((tool) => {
          const one = button({
            label: tool.label,
            icon: tool.icon,
            iconOnly: true,
            keys: tool.keys.toUpperCase(),
            look: "quiet",
            onClick: () => onChoose(tool.id),
          });
          this.#buttons.set(tool.id, one);
          return one;
        }),
      ),
    );
    this.element = el(
      "div",
      { class: "toolbar", role: "toolbar", "aria-label": label },
      ...columns,
      ...more.map((group) => el("div", { class: "tool-group" }, ...group)),
    );
  }

  press(id: T): void {
    for (const [one, element] of this.#buttons) element.setAttribute("aria-pressed", String(one === id));
  }
}
