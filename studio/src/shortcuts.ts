/** Keys of the whole page, and the sheet that tells them. */
import { el } from "./dom";
import { toggle } from "./ui/controls";
import { Dialog } from "./ui/dialog";

export interface Shortcut {
  /** As `event.key`, in lower case; with `Ctrl+` or `Ctrl+Shift+` before it. */
  keys: string;
  does: string;
  group: string;
  run: () => void;
  /** On which tabs; on all if left out. */
  where?: string;
}

const STORED = "morphlet.single-keys";
const POINTER_HELP: [string, string][] = [
  ["Drag", "use the tool; beside the mesh, turn"],
  ["Right drag", "turn"],
  ["Middle drag, Shift + right drag", "move the view"],
  ["Wheel, two fingers", "zoom; two fingers move too"],
  ["Shift / Alt while painting", "add / erase"],
  ["Arrow keys, + and −", "turn and zoom, with the view focused"],
  ["Enter", "use the tool in the middle of the view"],
];

export class Shortcuts {
  readonly #list: readonly Shortcut[];
  readonly #sheet: Dialog;
  readonly #where: () => string;
  #single = localStorage.getItem(STORED) !== "off";

  constructor(list: readonly Shortcut[], where: () => string) {
    this.#list = list;
    this.#where = where;
    const groups = [...new Set(list.map(titleOf))];
    const tables = groups.map((group) =>
      table(
        group,
        list.filter((one) => titleOf(one) === group).map(({ keys, does }) => [keys, does]),
      ),
    );
    const single = toggle("Single letters are shortcuts", this.#single, (on) => this.#useSingle(on));
    this.#sheet = new Dialog(
      "Keys and pointer",
      el("div", { class: "help-columns" }, ...tables, table("Pointer", POINTER_HELP)),
      single.element,
    );
    this.#sheet.element.classList.add("wide");
    document.addEventListener("keydown", (event) => this.#key(event));
  }

  help(): void {
    this.#sheet.open();
  }

  #useSingle(on: boolean): void {
    this.#single = on;
    localStorage.setItem(STORED, on ? "on" : "off");
  }

  #key(event: KeyboardEvent): void {
    if (event.defaultPrevented || document.querySelector("dialog[open]")) return;
    const control = event.ctrlKey || event.metaKey;
    const typing =
      event.target instanceof HTMLElement &&
      event.target.matches("input:not([type=range], [type=radio], [type=checkbox]), select, textarea");
    if (!control && (typing || !this.#single) && event.key !== "Escape") return;
    const pressed = (control ? (event.shiftKey ? "Ctrl+Shift+" : "Ctrl+") : "") + event.key.toLowerCase();
    const found = this.#list.find(
      ({ keys, where }) => keys.toLowerCase() === pressed.toLowerCase() && (where ?? this.#where()) === this.#where(),
    );
    if (!found || event.altKey) return;
    event.preventDefault();
    found.run();
  }
}

function named(keys: string): string {
  return keys === " " ? "Space" : keys.length === 1 ? keys.toUpperCase() : keys;
}

function titleOf({ where, group }: Shortcut): string {
  return where ? `${where.charAt(0).toUpperCase()}${where.slice(1)}: ${group.toLowerCase()}` : group;
}

function table(title: string, rows: [string, string][]): HTMLElement {
  const body = rows.map(([keys, does]) => el("tr", {}, el("th", { scope: "row" }, el("kbd", {}, named(keys))), el("td", {}, does)));
  return el("table", {}, el("caption", {}, title), el("tbody", {}, ...body));
}
