/** Opening and saving: two sheets, and files dropped on the page. */
import { el, show } from "../dom";
import type { Hello, MeshSlot, State } from "../protocol";
import type { Session } from "../session";
import { button, select } from "../ui/controls";
import { Dialog } from "../ui/dialog";
import { icon } from "../ui/icons";
import { recovery } from "./recovery";

type Upload = MeshSlot | "pairs" | "session";

const MORPH_FRAMES = 48;

export class Files {
  readonly #session: Session;
  readonly #done: (text: string) => void;
  readonly #open: Dialog;
  readonly #save: Dialog;
  readonly #saves: { row: HTMLElement; ready: (state: State) => boolean }[] = [];

  constructor(session: Session, done: (text: string) => void) {
    this.#session = session;
    this.#done = done;
    this.#open = new Dialog("Open", this.#meshRow("source"), this.#meshRow("target"), this.#extraRow(), this.#keptRow());
    this.#save = new Dialog("Save", this.#saveList());
    session.state.watch((state) => {
      for (const { row, ready } of this.#saves)
        for (const control of row.querySelectorAll("button")) control.disabled = !(state && ready(state));
    });
    this.#takeDrops();
  }

  showOpen(): void {
    this.#open.open();
  }

  showSave(): void {
    this.#save.open();
  }

  /** Asks the person for a file. */
  choose(slot: Upload, endings: string): void {
    const input = el("input", { type: "file", accept: endings });
    input.addEventListener("change", () => void this.#upload(slot, input.files?.[0]));
    input.click();
  }

  /** A list of the procedural meshes, and a button that opens the chosen one. */
  samples(slot: MeshSlot): HTMLElement {
    const place = el("div", { class: "row" });
    this.#session.hello.watch((hello) => {
      if (!hello) return;
      const options = sampleNames(hello).map(([value, label]) => ({ value, label }));
      const picker = select("Sample", options, options[0]?.value ?? "", () => undefined);
      const opener = button({ label: "Open sample", onClick: () => this.#sample(slot, picker.value) });
      place.replaceChildren(picker.element, opener);
    });
    return place;
  }

  #sample(slot: MeshSlot, name: string): void {
    this.#open.close();
    void this.#session.ask({ type: "sample", slot, name });
  }

  async #upload(slot: Upload, file: File | undefined): Promise<void> {
    if (!file) return;
    this.#open.close();
    if (await this.#session.send(slot, file)) this.#done(`${file.name} is open.`);
  }

  #meshRow(slot: MeshSlot): HTMLElement {
    const title = slot === "source" ? "Mesh A: the one to edit" : "Mesh B: to match and morph with";
    const chooser = button({ label: "Choose a file…", icon: "open", onClick: () => this.choose(slot, meshEndings(this.#session)) });
    return el(
      "section",
      { class: "file-row" },
      el("h3", {}, title),
      el("div", { class: "row" }, chooser, el("span", { class: "or" }, "or"), this.samples(slot)),
    );
  }

  #extraRow(): HTMLElement {
    const open = (slot: Upload, label: string, endings: string): HTMLElement =>
      button({ label, onClick: () => this.choose(slot, endings) });
    const note = el("p", { class: "hint" }, "A session fits the meshes it was made with: open these first.");
    return el(
      "section",
      { class: "file-row" },
      el("h3", {}, "Besides"),
      el("div", { class: "row" }, open("session", "Session…", ".json"), open("pairs", "Marker pairs…", ".csv,.json,.txt")),
      note,
    );
  }

  /** What a crash left, and edits that another mesh was opened over. */
  #keptRow(): HTMLElement {
    const list = el("div", { class: "recover" });
    const row = el("section", { class: "file-row", hidden: true }, el("h3", {}, "Kept from before"), list);
    let count = 0;
    this.#session.state.watch((state) => {
      const kept = state?.recoverable ?? [];
      list.replaceChildren(...kept.map((one) => recovery(this.#session, one)));
      show(row, kept.length > 0);
      if (kept.length > count && state?.meshes.source) this.#done("The edits before are kept: Open, Kept from before.");
      count = kept.length;
    });
    return row;
  }

  #saveList(): HTMLElement {
    const list = el("div", { class: "save-list" });
    const hasSource = (state: State): boolean => state.meshes.source !== null;
    list.append(
      this.#meshSave("source", "Mesh A as it is now", hasSource),
      this.#meshSave("target", "Mesh B", (state) => state.meshes.target !== null),
      this.#saveRow("Poses as an animation", "rest, kept poses and present shape", "poses.glb", hasSource),
      this.#saveRow("Morph as an animation", `${MORPH_FRAMES} frames`, `morph.glb?frames=${MORPH_FRAMES}`, (state) => state.morph !== null),
      this.#saveRow(
        "Marker pairs",
        "for morphlet correspond --pairs",
        "pairs.csv",
        (state) => state.markers.length > 0 || state.match !== null,
      ),
      this.#saveRow("Correspondence", "every vertex of A on B", "map.npz", (state) => state.match !== null),
      this.#saveRow("Session", "edits, paint and markers, to open again", "session.json", hasSource),
      this.#saveRow("Script", "the same with morphlet on the command line", "script.zip", hasSource),
    );
    return list;
  }

  #meshSave(slot: MeshSlot, title: string, ready: (state: State) => boolean): HTMLElement {
    const place = el("span", { class: "row" });
    this.#session.hello.watch((hello) => {
      const options = (hello?.formats ?? [".ply"]).map((ending) => ({ value: ending, label: ending }));
      const format = select("Format", options, options[0]?.value ?? ".ply", () => undefined);
      const name = (): string => stem(this.#session.state.value?.meshes[slot]?.name ?? slot) + format.value;
      const saver = button({
        label: "Save",
        icon: "save",
        onClick: () => void this.#download(`mesh?slot=${slot}&ending=${format.value}`, name()),
      });
      saver.setAttribute("aria-label", `Save: ${title}`);
      place.replaceChildren(format.element, saver);
    });
    const row = el("div", { class: "save-row" }, el("span", {}, title), place);
    this.#saves.push({ row, ready });
    return row;
  }

  #saveRow(title: string, note: string, what: string, ready: (state: State) => boolean): HTMLElement {
    const name = what.split("?")[0] ?? what;
    const saver = button({ label: "Save", icon: "save", onClick: () => void this.#download(what, name) });
    saver.setAttribute("aria-label", `Save: ${title}`);
    const row = el("div", { class: "save-row" }, el("span", {}, title, el("small", {}, note)), saver);
    this.#saves.push({ row, ready });
    return row;
  }

  async #download(what: string, name: string): Promise<void> {
    const blob = await this.#session.fetch(what);
    if (!blob) return;
    const address = URL.createObjectURL(blob);
    el("a", { href: address, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(address));
    this.#done(`${name} is saved.`);
  }

  #takeDrops(): void {
    const veil = el("div", { class: "drop-veil", hidden: true, "aria-hidden": "true" }, icon("open"), el("span", {}, "Drop it here"));
    document.body.append(veil);
    const isFile = (event: DragEvent): boolean => event.dataTransfer?.types.includes("Files") ?? false;
    document.addEventListener("dragover", (event) => {
      if (!isFile(event)) return;
      event.preventDefault();
      show(veil, true);
    });
    document.addEventListener("dragleave", (event) => {
      if (event.relatedTarget === null) show(veil, false);
    });
    document.addEventListener("drop", (event) => {
      show(veil, false);
      if (!isFile(event)) return;
      event.preventDefault();
      [...(event.dataTransfer?.files ?? [])].forEach((file, index) => void this.#upload(this.#slotFor(file, event, index), file));
    });
  }

  /** By its ending; a mesh that is dropped on mesh B's view is mesh B. */
  #slotFor(file: File, event: DragEvent, index: number): Upload {
    if (/\.json$/i.test(file.name)) return "session";
    if (/\.(csv|txt)$/i.test(file.name)) return "pairs";
    const place = event.target instanceof Element ? event.target.closest<HTMLElement>("[data-slot]")?.dataset["slot"] : undefined;
    return place === "target" || index === 1 ? "target" : "source";
  }
}

function sampleNames(hello: Hello): [string, string][] {
  return hello.samples.map((sample) => (typeof sample === "string" ? [sample, sample] : [sample.name, sample.title ?? sample.name]));
}

function meshEndings(session: Session): string {
  return (session.hello.value?.formats ?? []).join(",");
}

function stem(name: string): string {
  return name.replace(/\.[^.]*$/, "");
}
