/** What follows the handle: a radius along the surface, seen while the slider moves. */
import type { EditState, Metric, State } from "../protocol";
import type { Session } from "../session";
import { type Control, section, select, slider, toggle } from "../ui/controls";

/** The radius as a share of the mesh's diagonal, in powers of ten: from 1 in 300 to all of it. */
const POWERS = { min: -2.5, max: 0, step: 0.01, start: -0.8 };
const METRICS: readonly { value: Metric; label: string }[] = [
  { value: "geodesic", label: "Along the surface" },
  { value: "edges", label: "Along edges" },
  { value: "euclidean", label: "Through space" },
];

export class RegionPanel {
  readonly element: HTMLElement;
  readonly #session: Session;
  readonly #radius: Control<number>;
  readonly #limited: Control<boolean>;
  readonly #metric: Control<Metric>;
  #diagonal = 1;

  constructor(session: Session) {
    this.#session = session;
    this.#radius = slider({
      ...POWERS,
      label: "Radius",
      value: POWERS.start,
      format: (power) => (this.#diagonal * 10 ** power).toPrecision(3),
      onInput: () => this.#send(true),
      onChange: () => this.#send(false),
    });
    this.#limited = toggle("Only within a radius", true, () => this.#send(false));
    this.#metric = select("Distance", METRICS, "geodesic", () => this.#send(false));
    this.element = section("Region that follows", this.#limited.element, this.#radius.element, this.#metric.element);
    session.state.watch((state) => this.#tell(state));
  }

  #send(live: boolean): void {
    const radius = this.#limited.value ? this.#diagonal * 10 ** this.#radius.value : null;
    const request = { type: "roi", radius, metric: this.#metric.value, live } as const;
    if (live) this.#session.tell(request);
    else void this.#session.ask(request);
  }

  #tell(state: State | null): void {
    const edit: EditState | null = state?.edit ?? null;
    if (!edit) return;
    this.#diagonal = state?.meshes.source?.diagonal ?? 1;
    this.#limited.value = edit.radius !== null;
    this.#radius.disabled = edit.radius === null;
    this.#metric.value = edit.metric;
    const busy = this.#radius.element.contains(document.activeElement) && document.activeElement?.matches(":active");
    if (edit.radius !== null && !busy) this.#radius.value = Math.log10(edit.radius / this.#diagonal);
  }
}
