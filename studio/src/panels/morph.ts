/** The Morph tab: the path, and when each band moves. */
import { el, show } from "../dom";
import type { BandTiming, State } from "../protocol";
import type { MorphScene } from "../scenes/morph";
import type { Session } from "../session";
import type { Look } from "../view/body";
import { button, type Control, choice, section, select, slider, toggle } from "../ui/controls";
import { SchedulePlot } from "../ui/schedule";

const SLOWEST = 1;
const FASTEST = 10;
const LATEST_START = 0.9;
const STEP = 0.01;
/** Of the time that is left, how much of a cascade's step a band overlaps with the next. */
const OVERLAP = 0.5;
const PATH_TITLES: Record<string, string> = { gradient: "Gradient", linear: "Straight lines", wavelet: "Bands" };

interface BandControls {
  start: Control<number>;
  speed: Control<number>;
}

export function morphPanel(session: Session, scene: MorphScene, goMatch: () => void): HTMLElement {
  return el("div", { class: "panel" }, pathSection(session, goMatch), new BandsSection(session, scene).element, viewSection(scene));
}

function pathSection(session: Session, goMatch: () => void): HTMLElement {
  const place = el("div");
  const note = el("p", { class: "hint" }, "A morph needs to know which place of A is which of B.");
  const match = button({ label: "Match first", onClick: goMatch });
  const prepare = button({
    label: "Prepare the morph",
    look: "primary",
    onClick: () => void session.ask({ type: "morph", path: picker?.value ?? "gradient" }),
  });
  let picker: Control<string> | null = null;
  session.hello.watch((hello) => {
    const options = (hello?.paths ?? ["gradient"]).map((value) => ({ value, label: PATH_TITLES[value] ?? value }));
    picker = select("Path from A to B", options, "wavelet", () => undefined, "Bands move coarse and fine form at times of their own.");
    place.replaceChildren(picker.element);
  });
  session.state.watch((state) => {
    const matched = state?.match != null;
    show(note, !matched);
    show(match, !matched);
    prepare.disabled = !matched || state.job !== null;
    prepare.lastElementChild?.replaceChildren(state?.morph ? "Prepare again" : "Prepare the morph");
    if (state?.morph && picker && !picker.element.contains(document.activeElement)) picker.value = state.morph.path;
  });
  return section("Path", place, note, match, prepare);
}

/** Sliders for each band, and the picture of all. */
class BandsSection {
  readonly element: HTMLElement;
  readonly #session: Session;
  readonly #plot = new SchedulePlot();
  readonly #place = el("div", { class: "bands" });
  readonly #easing = el("div");
  #easingPicker: Control<string> | null = null;
  #bands: BandControls[] = [];

  constructor(session: Session, scene: MorphScene) {
    this.#session = session;
    const presets = el(
      "div",
      { class: "row compact" },
      button({ label: "Together", onClick: () => this.#preset((count) => Array.from({ length: count }, () => 0)) }),
      button({ label: "Coarse first", onClick: () => this.#preset(cascade) }),
      button({ label: "Fine first", onClick: () => this.#preset((count) => cascade(count).reverse()) }),
    );
    this.element = section("When each band moves", this.#plot.element, presets, this.#easing, this.#place);
    session.hello.watch((hello) => {
      const options = (hello?.easings ?? []).map((value) => ({ value, label: value }));
      this.#easingPicker = select("Easing", options, options[0]?.value ?? "linear", () => this.#send());
      this.#easing.replaceChildren(this.#easingPicker.element);
    });
    session.state.watch((state) => this.#tell(state));
    scene.time.watch((time) => this.#plot.at(time));
  }

  #preset(starts: (count: number) => number[]): void {
    const first = starts(this.#bands.length);
    const latest = Math.max(...first);
    this.#bands.forEach((band, index) => {
      band.start.value = first[index] ?? 0;
      band.speed.value = 1 / (1 - latest);
    });
    this.#send();
  }

  #send(): void {
    void this.#session.ask({ type: "morph.schedule", bands: this.#timings() });
  }

  #timings(): BandTiming[] {
    const easing = this.#easingPicker?.value ?? "linear";
    return this.#bands.map(({ start, speed }) => ({ start: start.value, duration: Math.min(1 / speed.value, 1 - start.value), easing }));
  }

  #redraw(): void {
    this.#plot.show(this.#timings(), bandNames(this.#bands.length));
  }

  #tell(state: State | null): void {
    const morph = state?.morph;
    show(this.element, morph?.path === "wavelet");
    if (morph?.path !== "wavelet") return;
    if (this.#bands.length !== morph.schedule.length) this.#rebuild(morph.schedule.length);
    if (!this.#place.contains(document.activeElement) || !document.activeElement?.matches(":active"))
      morph.schedule.forEach((timing, index) => {
        const band = this.#bands[index];
        if (!band) return;
        band.start.value = timing.start;
        band.speed.value = 1 / timing.duration;
      });
    const easing = morph.schedule[0]?.easing;
    if (easing && this.#easingPicker) this.#easingPicker.value = easing;
    this.#redraw();
  }

  #rebuild(count: number): void {
    const names = bandNames(count);
    this.#bands = names.map(() => ({ start: this.#slider("Start", 0, LATEST_START), speed: this.#slider("Speed", SLOWEST, FASTEST) }));
    this.#place.replaceChildren(
      ...this.#bands.map(({ start, speed }, index) =>
        el("fieldset", { class: "band" }, el("legend", {}, names[index] ?? ""), start.element, speed.element),
      ),
    );
  }

  #slider(label: string, min: number, max: number): Control<number> {
    return slider({
      label,
      min,
      max,
      step: STEP,
      value: min,
      format: (value) => value.toFixed(2),
      onInput: () => this.#redraw(),
      onChange: () => this.#send(),
    });
  }
}

function cascade(count: number): number[] {
  const step = (1 - OVERLAP) / Math.max(1, count - 1);
  return Array.from({ length: count }, (_, index) => index * step);
}

function bandNames(count: number): string[] {
  return Array.from({ length: count }, (_, index) => (index === 0 ? "Coarse" : index === count - 1 ? "Fine" : `Band ${index + 1}`));
}

function viewSection(scene: MorphScene): HTMLElement {
  const looks: { value: Look; label: string }[] = [
    { value: "smooth", label: "Smooth" },
    { value: "flat", label: "Flat" },
    { value: "wire", label: "Wires" },
  ];
  const look = choice("Shading", looks, scene.look.value, (value) => (scene.look.value = value));
  const coloured = toggle("Colour by place on A", false, (on) => (scene.coloured.value = on));
  return section("View", look.element, coloured.element);
}
