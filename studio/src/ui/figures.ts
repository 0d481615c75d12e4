/** The numbers of an edit, at the foot of the view. */
import { el } from "../dom";
import type { Numbers } from "../protocol";

const READING_PAUSE_MS = 120;

type Key = "frame_ms" | "energy" | "rate" | "volume_change";

const LABELS: Record<Key, { label: string; title: string; format: (value: number) => string }> = {
  frame_ms: { label: "Frame", title: "The server's time for the last frame", format: (value) => `${value.toFixed(1)} ms` },
  energy: { label: "Energy", title: "What the method makes as small as it can", format: (value) => value.toPrecision(3) },
  rate: { label: "Rate D", title: "How much the edit deforms, in percent", format: (value) => `${value.toFixed(2)} %` },
  volume_change: {
    label: "Volume",
    title: "Change of the volume, in percent",
    format: (value) => `${value > 0 ? "+" : ""}${value.toFixed(2)} %`,
  },
};

export class Figures {
  readonly element: HTMLElement;
  readonly #cells = new Map<Key, HTMLElement>();
  #newest: Numbers | null = null;
  #timer = 0;

  constructor() {
    const rows = (Object.keys(LABELS) as Key[]).map((key) => {
      const cell = el("dd", {}, "–");
      this.#cells.set(key, cell);
      return el("div", { title: LABELS[key].title }, el("dt", {}, LABELS[key].label), cell);
    });
    this.element = el("dl", { class: "figures", "aria-label": "Numbers of the edit" }, ...rows);
  }

  /** Shows the newest numbers, no more often than eyes can follow. */
  tell(numbers: Numbers | null): void {
    this.#newest = numbers;
    this.#timer ||= window.setTimeout(() => this.#show(), READING_PAUSE_MS);
  }

  #show(): void {
    this.#timer = 0;
    const numbers = this.#newest;
    for (const [key, cell] of this.#cells) {
      const value = numbers?.[key] ?? null;
      cell.textContent = value === null ? "–" : LABELS[key].format(value);
    }
  }
}
