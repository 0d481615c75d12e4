/** When each band of a morph moves: bars over time, coarse on top. */
import { el, svg } from "../dom";
import type { BandTiming } from "../protocol";

const WIDTH = 280;
const ROW = 20;
const BAR = 12;
const LEFT = 52;
const SAMPLES = 24;

type Easing = (t: number) => number;
const EASINGS: Record<string, Easing> = {
  linear: (t) => t,
  smoothstep: (t) => t * t * (3 - 2 * t),
  smootherstep: (t) => t * t * t * (t * (6 * t - 15) + 10),
};

export class SchedulePlot {
  readonly element: HTMLElement;
  readonly #picture = svg("svg", { class: "schedule", role: "img", "aria-label": "When each band moves" });
  readonly #cursor = svg("line", { class: "cursor" });
  #rows = 0;
  #time = 0;

  constructor() {
    this.element = el("figure", {}, this.#picture as unknown as Node);
  }

  show(bands: readonly BandTiming[], names: readonly string[]): void {
    this.#rows = bands.length;
    const height = ROW * bands.length + 18;
    this.#picture.setAttribute("viewBox", `0 0 ${WIDTH} ${height}`);
    const rows = bands.flatMap((band, index) => row(band, names[index] ?? "", index));
    const base = ROW * bands.length + 12;
    const ends = [
      svg("text", { x: LEFT, y: base }, "0"),
      svg("text", { x: WIDTH - 1, y: base, "text-anchor": "end" }, "1"),
      svg("text", { x: (LEFT + WIDTH) / 2, y: base, "text-anchor": "middle" }, "time"),
    ];
    this.#picture.replaceChildren(...rows, ...ends, this.#cursor);
    this.#picture.setAttribute(
      "aria-label",
      bands
        .map((band, index) => `${names[index] ?? ""} from ${band.start.toFixed(2)} to ${(band.start + band.duration).toFixed(2)}`)
        .join("; "),
    );
    this.at(this.#time);
  }

  at(time: number): void {
    this.#time = time;
    const x = LEFT + time * (WIDTH - LEFT - 1);
    for (const [name, value] of Object.entries({ x1: x, x2: x, y1: 0, y2: ROW * this.#rows }))
      this.#cursor.setAttribute(name, String(value));
  }
}

/** A band's name, its way, and how fast it goes: the curve of how far it is. */
function row(band: BandTiming, name: string, index: number): SVGElement[] {
  const span = WIDTH - LEFT - 1;
  const [x, y] = [LEFT + band.start * span, index * ROW + (ROW - BAR) / 2];
  const width = Math.max(2, band.duration * span);
  const ease = EASINGS[band.easing] ?? ((t: number) => t);
  const points = Array.from({ length: SAMPLES + 1 }, (_, k) => `${x + (width * k) / SAMPLES},${y + BAR * (1 - ease(k / SAMPLES))}`);
  return [
    svg("text", { x: 0, y: index * ROW + ROW / 2 + 4 }, name),
    svg("line", { class: "track", x1: LEFT, x2: WIDTH - 1, y1: y + BAR, y2: y + BAR }),
    svg("rect", { class: "bar", x, y, width, height: BAR, rx: 3 }),
    svg("polyline", { class: "curve", points: points.join(" ") }),
  ];
}
