/** How the free vertices follow: a method and its options, as the server tells them. */
import { el, show } from "../dom";
import type { EditState, Method, MethodOption, OptionValue } from "../protocol";
import type { Session } from "../session";
import { type Control, choice, section, select, slider, toggle, triple } from "../ui/controls";

/** Soft weights from a tenth to ten thousand, in powers of ten. */
const WEIGHT_POWERS = { min: -1, max: 4, step: 0.1, start: 1 };
const SLIDER_STEPS = 100;

export class MethodPanel {
  readonly element: HTMLElement;
  readonly #session: Session;
  readonly #options = el("div", { class: "stack" });
  readonly #place = el("div");
  readonly #soft: Control<boolean>;
  readonly #weight: Control<number>;
  #controls = new Map<string, Control<OptionValue>>();
  #picker: Control<string> | null = null;
  #shown = "";

  constructor(session: Session) {
    this.#session = session;
    this.#soft = toggle("Hold the handle softly", false, () => this.#send(false));
    this.#weight = slider({
      ...WEIGHT_POWERS,
      label: "Weight",
      value: WEIGHT_POWERS.start,
      format: (power) => (10 ** power).toPrecision(2).replace(/\.0$/, ""),
      onInput: () => this.#send(true),
      onChange: () => this.#send(false),
    });
    this.element = section("Method", this.#place, this.#options, this.#soft.element, this.#weight.element);
    session.hello.watch((hello) => {
      if (!hello) return;
      const entries = hello.methods.map(({ name, title }) => ({ value: name, label: title }));
      this.#picker = select("How the rest follows", entries, entries[0]?.value ?? "", (name) => this.#choose(name));
      this.#place.replaceChildren(this.#picker.element);
      this.#shown = "";
    });
    session.state.watch((state) => this.#tell(state?.edit ?? null));
  }

  #method(name: string): Method | undefined {
    return this.#session.hello.value?.methods.find((method) => method.name === name);
  }

  #choose(name: string): void {
    const soft = this.#method(name)?.soft ?? false;
    void this.#session.ask({ type: "method", name, options: {}, weight: soft ? this.#chosenWeight() : null });
  }

  #chosenWeight(): number | null {
    return this.#soft.value ? 10 ** this.#weight.value : null;
  }

  #send(live: boolean): void {
    const name = this.#picker?.value ?? "";
    const options = Object.fromEntries([...this.#controls].map(([key, control]) => [key, control.value]));
    const weight = this.#method(name)?.soft ? this.#chosenWeight() : null;
    const request = { type: "method", name, options, weight, live } as const;
    if (live) this.#session.tell(request);
    else void this.#session.ask(request);
  }

  #tell(edit: EditState | null): void {
    if (!edit || !this.#picker) return;
    this.#picker.value = edit.method.name;
    this.#rebuild(edit.method.name);
    for (const [name, control] of this.#controls) {
      const value = edit.method.options[name];
      if (value !== undefined && !control.element.contains(document.activeElement)) control.value = value;
    }
    const soft = this.#method(edit.method.name)?.soft ?? false;
    show(this.#soft.element, soft);
    show(this.#weight.element, soft && edit.weight !== null);
    this.#soft.value = edit.weight !== null;
    if (edit.weight !== null && !this.#weight.element.contains(document.activeElement)) this.#weight.value = Math.log10(edit.weight);
  }

  #rebuild(name: string): void {
    if (name === this.#shown) return;
    this.#shown = name;
    const options = this.#method(name)?.options ?? [];
    this.#controls = new Map(options.map((option) => [option.name, this.#control(option)]));
    this.#options.replaceChildren(...[...this.#controls.values()].map(({ element }) => element));
  }

  #control(option: MethodOption): Control<OptionValue> {
    if (option.kind === "number") return this.#number(option) as Control<OptionValue>;
    if (option.kind === "flag") return toggle(option.title, option.default, () => this.#send(false)) as Control<OptionValue>;
    if (option.kind === "choice") {
      const entries = option.choices.map((value) => ({ value, label: spaced(value) }));
      const make = entries.length > 3 ? select<string> : choice<string>;
      return make(option.title, entries, option.default, () => this.#send(false)) as Control<OptionValue>;
    }
    const counts = triple(option.title, ["x", "y", "z"], option.default[0] ?? option.low, 1);
    counts.element.addEventListener("change", () => this.#send(false));
    return counts as unknown as Control<OptionValue>;
  }

  #number(option: Extract<MethodOption, { kind: "number" }>): Control<number> {
    const step = (option.high - option.low) / SLIDER_STEPS;
    return slider({
      label: option.title,
      min: option.low,
      max: option.high,
      step,
      value: option.default,
      format: (value) => String(Number(value.toPrecision(3))),
      onInput: () => this.#send(true),
      onChange: () => this.#send(false),
    });
  }
}

/** `two-words` as people write it. */
function spaced(name: string): string {
  const words = name.replaceAll(/[-_]/g, " ");
  return words.charAt(0).toUpperCase() + words.slice(1);
}
