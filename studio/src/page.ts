/** The page's frame: a large view with its tools, a sidebar with tabs. */
import type { Cell } from "./cell";
import type { Connection } from "./connection";
import { el, show } from "./dom";
import { button } from "./ui/controls";
import { icon } from "./ui/icons";

export interface Head {
  open: () => void;
  save: () => void;
  help: () => void;
}

const PATIENCE_MS = 250;
const STATUS_TEXT = { connecting: "Connecting…", open: "Connected", lost: "Connection lost", unreachable: "No answer" } as const;

export function head(connection: Connection, does: Head): HTMLElement {
  const status = el("span", { class: "status" }, el("span", { class: "dot" }), el("span", { class: "unseen", role: "status" }));
  connection.status.watch((value) => {
    status.dataset["status"] = value;
    status.title = STATUS_TEXT[value];
    status.lastElementChild?.replaceChildren(STATUS_TEXT[value]);
  });
  return el(
    "header",
    { class: "head" },
    el("h1", {}, "morphlet", el("span", {}, "studio")),
    status,
    button({ label: "Open", icon: "open", keys: "Ctrl+O", iconOnly: true, look: "quiet", onClick: does.open }),
    button({ label: "Save", icon: "save", keys: "Ctrl+S", iconOnly: true, look: "quiet", onClick: does.save }),
    button({ label: "Keys and pointer", icon: "help", keys: "?", iconOnly: true, look: "quiet", onClick: does.help }),
  );
}

/** On small screens: the sidebar as a sheet that goes up and down. */
export function sheetHandle(sidebar: HTMLElement): HTMLElement {
  const handle = el(
    "button",
    { type: "button", class: "sheet-handle", "aria-expanded": "true" },
    el("span", { class: "unseen" }, "Controls"),
  );
  handle.addEventListener("click", () => {
    const low = sidebar.classList.toggle("low");
    handle.setAttribute("aria-expanded", String(!low));
  });
  return handle;
}

/** A line at the top of the view that moves while the studio works on an answer for longer than a blink. */
export function busyLine(waiting: Cell<number>): HTMLElement {
  const line = el("div", { class: "busy-line", role: "progressbar", "aria-label": "The studio is working", hidden: true });
  let timer = 0;
  waiting.watch((count) => {
    clearTimeout(timer);
    if (count > 0) timer = window.setTimeout(() => show(line, true), PATIENCE_MS);
    else show(line, false);
  });
  return line;
}

/** Says that the server is away, and that nothing is lost. */
export function lossBanner(connection: Connection): HTMLElement {
  const title = el("strong");
  const text = el("span");
  const again = button({ label: "Try now", onClick: () => connection.open() });
  const banner = el("div", { class: "banner", role: "alert", hidden: true }, icon("warning"), el("p", {}, title, text), again);
  connection.status.watch((status) => {
    show(banner, status === "lost" || status === "unreachable");
    show(again, status === "unreachable");
    if (status === "lost") {
      title.textContent = "Connection lost. ";
      text.textContent = "The studio keeps your edits; trying to come back…";
    } else if (status === "unreachable") {
      title.textContent = "The studio does not answer. ";
      text.textContent = "If you have started it again, open the address that it printed: it offers what was saved.";
    }
  });
  return banner;
}

export function noGraphics(): HTMLElement {
  const advice = "Switch on hardware acceleration in its settings, or try another browser.";
  return el(
    "main",
    { class: "no-graphics" },
    el("h1", {}, "This browser draws no 3D pictures"),
    el("p", {}, `The studio needs WebGL 2. ${advice}`),
  );
}
