/** A session that was left or set aside, with a way back to it. */
import { el } from "../dom";
import type { State } from "../protocol";
import type { Session } from "../session";
import { button } from "../ui/controls";

export function recovery(session: Session, one: State["recoverable"][number]): HTMLElement {
  const when = new Date(one.saved);
  const saved = Number.isNaN(when.getTime()) ? one.saved : when.toLocaleString();
  const edits = `${one.edits} ${one.edits === 1 ? "edit" : "edits"}`;
  const meshes = one.meshes.join(", ");
  const recover = button({ label: "Recover", look: "primary", onClick: () => void session.ask({ type: "recover", name: one.name }) });
  const discard = button({ label: "Discard", look: "quiet", onClick: () => void session.ask({ type: "discard", name: one.name }) });
  recover.setAttribute("aria-label", `Recover ${meshes}`);
  discard.setAttribute("aria-label", `Discard ${meshes}`);
  return el(
    "div",
    { class: "recover-row" },
    el("p", {}, el("strong", {}, meshes), el("span", {}, `${edits}, saved ${saved}`)),
    recover,
    discard,
  );
}
