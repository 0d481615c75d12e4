/** What is there before any mesh: a place to drop one, samples, what a crash left. */
import { el, show } from "../dom";
import type { Session } from "../session";
import { button } from "../ui/controls";
import { icon } from "../ui/icons";
import type { Files } from "./files";
import { recovery } from "./recovery";

export function welcome(session: Session, files: Files): HTMLElement {
  const choose = button({ label: "Choose a mesh…", icon: "open", look: "primary", onClick: () => files.showOpen() });
  const left = el("div", { class: "recover" });
  const samples = el("div", { class: "sample-row" });
  const card = el(
    "div",
    { class: "welcome", hidden: true },
    el("div", { class: "welcome-mark" }, icon("open")),
    el("h2", {}, "Open a mesh"),
    el("p", {}, "Drop an OBJ, PLY, OFF, STL or GLB file here, or try one of these:"),
    samples,
    choose,
    left,
  );
  session.hello.watch((hello) => {
    const names = (hello?.samples ?? []).map((sample) => (typeof sample === "string" ? sample : sample.name));
    samples.replaceChildren(
      ...names
        .slice(0, MOST_SAMPLES)
        .map((name) => button({ label: name, onClick: () => void session.ask({ type: "sample", slot: "source", name }) })),
    );
  });
  session.state.watch((state) => {
    show(card, state !== null && state.meshes.source === null);
    left.replaceChildren(...(state?.recoverable ?? []).map((one) => recovery(session, one)));
  });
  return card;
}

const MOST_SAMPLES = 8;
