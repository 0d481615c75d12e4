/** The Match tab: the two meshes, markers, regions, the correspondence and its figures. */
import { el, show } from "../dom";
import type { MeshSlot, Pair, State } from "../protocol";
import type { MatchColours, MatchScene, Shown } from "../scenes/match";
import type { Session } from "../session";
import { button, choice, section, toggle } from "../ui/controls";
import { qualitativeHex } from "../view/palette";
import type { Files } from "./files";

/** Letters that the server takes. */
const LONGEST_LABEL = 80;
const FEW_MARKERS = 3;

export function matchPanel(session: Session, scene: MatchScene, files: Files): HTMLElement {
  return el(
    "div",
    { class: "panel" },
    meshesSection(session, files),
    markersSection(session, scene, files),
    runSection(session),
    viewSection(session, scene),
  );
}

function meshesSection(session: Session, files: Files): HTMLElement {
  const rows = (["source", "target"] as const).map((slot) => meshRow(session, files, slot));
  return section("Meshes", ...rows);
}

function meshRow(session: Session, files: Files, slot: MeshSlot): HTMLElement {
  const letter = slot === "source" ? "A" : "B";
  const name = el("strong");
  const size = el("small");
  const open = button({ label: `Open mesh ${letter}`, icon: "open", iconOnly: true, look: "quiet", onClick: () => files.showOpen() });
  const close = button({
    label: `Close mesh ${letter}`,
    icon: "close",
    iconOnly: true,
    look: "quiet",
    onClick: () => void session.ask({ type: "close", slot }),
  });
  session.state.watch((state) => {
    const mesh = state?.meshes[slot] ?? null;
    name.textContent = mesh?.name ?? "none yet";
    size.textContent = mesh ? `${mesh.vertices.toLocaleString("en")} vertices` : "";
    show(close, mesh !== null);
  });
  return el("div", { class: "mesh-row" }, el("span", { class: "letter" }, letter), el("span", { class: "names" }, name, size), open, close);
}

function markersSection(session: Session, scene: MatchScene, files: Files): HTMLElement {
  const list = el("ol", { class: "items" });
  const note = el("p", { class: "hint" });
  const clear = button({ label: "Clear", icon: "trash", onClick: () => void session.ask({ type: "markers.clear" }) });
  const load = button({ label: "Load…", icon: "open", onClick: () => files.choose("pairs", ".csv,.json,.txt") });
  const rows: MarkerRow[] = [];
  const tell = (state: State | null): void => {
    const markers = state?.markers ?? [];
    while (rows.length > markers.length) rows.pop()?.element.remove();
    for (const [index, pair] of markers.entries()) {
      const row = (rows[index] ??= markerRow(session, index));
      if (!row.element.isConnected) list.append(row.element);
      row.set(pair);
    }
    clear.disabled = markers.length === 0;
    note.textContent = markerAdvice(markers.length, scene.pending.value?.slot ?? null);
  };
  session.state.watch(tell);
  scene.pending.watch(() => tell(session.state.value));
  return section("Markers", note, list, el("div", { class: "row" }, clear, load));
}

function markerAdvice(count: number, pending: MeshSlot | null): string {
  if (pending) return `Now click the same place on mesh ${pending === "source" ? "B" : "A"}. Escape drops it.`;
  if (count === 0) return "Click a place on one mesh, then the same place on the other. Without markers, feature regions are matched.";
  return count < FEW_MARKERS ? "Fewer than three are completed by matching feature regions." : "Drag a marker to move it.";
}

interface MarkerRow {
  element: HTMLElement;
  set(pair: Pair): void;
}

/** A pair: its number, its label to write, its vertices; stays in its place while others change, and keeps the focus. */
function markerRow(session: Session, index: number): MarkerRow {
  const chip = el("span", { class: "chip" }, String(index + 1));
  chip.style.setProperty("--chip", qualitativeHex(index));
  const plain = `Pair ${index + 1}`;
  const label = el("input", {
    type: "text",
    class: "label",
    maxlength: LONGEST_LABEL,
    placeholder: plain,
    "aria-label": `Label of pair ${index + 1}`,
  });
  const ends = el("small");
  const remove = button({
    label: `Remove ${plain}`,
    icon: "close",
    iconOnly: true,
    look: "quiet",
    onClick: () => void session.ask({ type: "marker.remove", index }),
  });
  let told = "";
  label.addEventListener("change", () => {
    void session.ask({ type: "marker.label", index, label: label.value.trim() }).then((done) => {
      if (!done) label.value = told;
    });
  });
  return {
    element: el("li", {}, chip, el("span", { class: "names" }, label, ends), remove),
    set(pair) {
      if (told !== pair.label || document.activeElement !== label) label.value = told = pair.label;
      ends.textContent = `${pair.source} → ${pair.target}`;
      const name = `Remove ${pair.label || plain}`;
      remove.title = name;
      remove.querySelector(".unseen")?.replaceChildren(name);
    },
  };
}

const CONTESTED = "Regions of one colour go together: a guess, others are nearly as good. Matching compares their maps.";

function runSection(session: Session): HTMLElement {
  const regions = button({ label: "Find feature regions", onClick: () => void session.ask({ type: "regions" }) });
  const run = button({ label: "Match A to B", look: "primary", onClick: () => void session.ask({ type: "correspond" }) });
  const guess = el("p", { class: "hint" });
  const take = button({ label: "Keep the found pairs as markers", onClick: () => void session.ask({ type: "markers.take" }) });
  const stale = el("p", { class: "note" }, "Markers or meshes have changed since: match again.");
  const ambiguous = el("p", { class: "note" }, "The shapes leave more than one way to match; markers decide.");
  const warnings = el("ul", { class: "notes" });
  const figures = el("dl", { class: "table" });
  session.state.watch((state) => {
    const ready = state?.meshes.source != null && state.meshes.target !== null && state.job === null;
    regions.disabled = run.disabled = !ready;
    const match = state?.match ?? null;
    show(guess, state?.regions != null && match === null);
    guess.textContent = state?.regions?.contested ? CONTESTED : "Regions of one colour go together.";
    show(take, match !== null && match.pairs.length > 0);
    show(stale, match !== null && !match.current);
    show(ambiguous, match?.ambiguous === true);
    warnings.replaceChildren(...(match?.warnings ?? []).map((text) => el("li", { class: "note" }, text)));
    figures.replaceChildren(...Object.entries(match?.figures ?? {}).flatMap(([key, value]) => figure(key, value)));
    show(figures, match !== null && figures.childElementCount > 0);
  });
  return section("Correspondence", regions, run, guess, stale, ambiguous, warnings, take, figures);
}

const SMALL = 1e-3;

function short(value: number): string {
  return value !== 0 && Math.abs(value) < SMALL ? value.toExponential(1) : String(Number(value.toPrecision(3)));
}

function figure(key: string, value: unknown): HTMLElement[] {
  if (typeof value !== "number" && typeof value !== "string") return [];
  const text = typeof value === "number" ? short(value) : value;
  const words = key.replaceAll("_", " ");
  return [el("dt", {}, words.charAt(0).toUpperCase() + words.slice(1)), el("dd", {}, text)];
}

function viewSection(session: Session, scene: MatchScene): HTMLElement {
  const colours: { value: MatchColours; label: string }[] = [
    { value: "plain", label: "Plain" },
    { value: "regions", label: "Regions" },
    { value: "map", label: "Map" },
  ];
  const shown: { value: Shown; label: string }[] = [
    { value: "meshes", label: "Meshes" },
    { value: "both", label: "Both" },
    { value: "spheres", label: "Spheres" },
  ];
  const colour = choice("Colours", colours, scene.colours.value, (value) => (scene.colours.value = value));
  scene.colours.watch((value) => (colour.value = value));
  session.onJob((kind, status) => {
    if (status !== "done") return;
    if (kind === "regions") scene.colours.value = "regions";
    if (kind === "correspond") scene.colours.value = "map";
  });
  const layout = choice("Show", shown, scene.shown.value, (value) => (scene.shown.value = value));
  const linked = toggle("Both turn together", true, (on) => (scene.linked.value = on));
  const laid = toggle("A's sphere as it lies in B's", true, (on) => (scene.laid.value = on));
  return section("View", colour.element, layout.element, linked.element, laid.element);
}
