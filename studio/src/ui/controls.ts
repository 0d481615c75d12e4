/** The controls of the sidebar, each with its label: native elements, so that keys and screen readers work as everywhere. */
import { el, freshId, show } from "../dom";
import { icon, type IconName } from "./icons";

export interface Control<T> {
  readonly element: HTMLElement;
  value: T;
  disabled: boolean;
}

export interface SliderOptions {
  label: string;
  min: number;
  max: number;
  step: number;
  value: number;
  hint?: string;
  format?: (value: number) => string;
  /** While it moves. */
  onInput?: (value: number) => void;
  /** When it is let go. */
  onChange?: (value: number) => void;
}

export function slider(options: SliderOptions): Control<number> & { range(min: number, max: number, step: number): void } {
  const id = freshId("slider");
  const format = options.format ?? String;
  const output = el("output", { for: id });
  const input = el("input", { id, type: "range", min: options.min, max: options.max, step: options.step, value: options.value });
  const refresh = (): void => {
    const text = format(input.valueAsNumber);
    output.textContent = text;
    input.setAttribute("aria-valuetext", text);
    const share = (input.valueAsNumber - Number(input.min)) / Math.max(Number(input.max) - Number(input.min), Number.EPSILON);
    input.style.setProperty("--share", `${100 * share}%`);
  };
  input.addEventListener("input", () => {
    refresh();
    options.onInput?.(input.valueAsNumber);
  });
  input.addEventListener("change", () => options.onChange?.(input.valueAsNumber));
  refresh();
  const element = el("div", { class: "field" }, el("label", { for: id }, options.label), output, input, hint(options.hint, input));
  return {
    element,
    get value() {
      return input.valueAsNumber;
    },
    set value(next: number) {
      input.value = String(next);
      refresh();
    },
    get disabled() {
      return input.disabled;
    },
    set disabled(off: boolean) {
      input.disabled = off;
    },
    range(min: number, max: number, step: number) {
      Object.assign(input, { min: String(min), max: String(max), step: String(step) });
      refresh();
    },
  };
}

export interface Option<T extends string> {
  value: T;
  label: string;
  swatch?: string;
}

/** A row of which one is chosen: radio buttons that look like one. */
export function choice<T extends string>(label: string, options: readonly Option<T>[], value: T, onChange: (value: T) => void): Control<T> {
  const name = freshId("choice");
  const inputs = options.map((option) => {
    const input = el("input", { type: "radio", name, value: option.value, id: freshId("radio"), checked: option.value === value });
    input.addEventListener("change", () => onChange(option.value));
    return input;
  });
  const labels = options.map((option, index) =>
    el(
      "label",
      { for: inputs[index]?.id },
      option.swatch ? el("span", { class: `swatch ${option.swatch}` }) : null,
      el("span", {}, option.label),
    ),
  );
  const row = el("div", { class: "segments" }, ...inputs.flatMap((input, index) => [input, labels[index]]));
  const element = el("fieldset", { class: "choice" }, el("legend", {}, label), row);
  return {
    element,
    get value() {
      return (inputs.find((input) => input.checked)?.value ?? value) as T;
    },
    set value(next: T) {
      for (const input of inputs) input.checked = input.value === next;
    },
    get disabled() {
      return element.disabled;
    },
    set disabled(off: boolean) {
      element.disabled = off;
    },
  };
}

export function select<T extends string>(
  label: string,
  options: readonly Option<T>[],
  value: T,
  onChange: (value: T) => void,
  note?: string,
): Control<T> {
  const id = freshId("select");
  const input = el("select", { id }, ...options.map((option) => el("option", { value: option.value }, option.label)));
  input.value = value;
  input.addEventListener("change", () => onChange(input.value as T));
  const element = el("div", { class: "field" }, el("label", { for: id }, label), input, hint(note, input));
  return simple<T>(element, input);
}

/** On or off. */
export function toggle(label: string, value: boolean, onChange: (value: boolean) => void): Control<boolean> {
  const id = freshId("toggle");
  const input = el("input", { id, type: "checkbox", role: "switch", checked: value });
  input.addEventListener("change", () => onChange(input.checked));
  const element = el("div", { class: "toggle" }, input, el("label", { for: id }, label));
  return {
    element,
    get value() {
      return input.checked;
    },
    set value(next: boolean) {
      input.checked = next;
    },
    get disabled() {
      return input.disabled;
    },
    set disabled(off: boolean) {
      input.disabled = off;
    },
  };
}

export interface ButtonOptions {
  icon?: IconName;
  label: string;
  /** Shown where the label is not: on buttons that are only an icon. */
  iconOnly?: boolean;
  keys?: string;
  look?: "primary" | "quiet" | "danger";
  onClick: () => void;
}

export function button(options: ButtonOptions): HTMLButtonElement {
  const title = options.keys ? `${options.label} (${options.keys})` : options.label;
  const keys = options.keys ? { "aria-keyshortcuts": options.keys.replace("Ctrl", "Control") } : {};
  const element = el(
    "button",
    { type: "button", class: `button ${options.look ?? ""} ${options.iconOnly ? "icon-only" : ""}`, title, ...keys },
    options.icon ? icon(options.icon) : null,
    el("span", { class: options.iconOnly ? "unseen" : "" }, options.label),
  );
  element.addEventListener("click", options.onClick);
  return element;
}

/** A group of controls under a heading. */
export function section(title: string, ...children: (HTMLElement | null)[]): HTMLElement {
  const id = freshId("section");
  return el("section", { class: "section", "aria-labelledby": id }, el("h2", { id }, title), ...children);
}

function hint(text: string | undefined, input: HTMLElement): HTMLElement | null {
  if (text === undefined) return null;
  const id = freshId("hint");
  input.setAttribute("aria-describedby", id);
  return el("p", { class: "hint", id }, text);
}

function simple<T extends string>(element: HTMLElement, input: HTMLSelectElement): Control<T> {
  return {
    element,
    get value() {
      return input.value as T;
    },
    set value(next: T) {
      input.value = next;
    },
    get disabled() {
      return input.disabled;
    },
    set disabled(off: boolean) {
      input.disabled = off;
    },
  };
}

/** Three numbers in a row: an exact move, for the keyboard. */
export function triple(
  label: string,
  names: readonly [string, string, string],
  value: number,
  step: number,
): Control<[number, number, number]> {
  const inputs = names.map((name) => el("input", { type: "number", step, value, "aria-label": `${label} ${name}` }));
  const cells = inputs.map((input, index) =>
    el("span", { class: "cell" }, el("span", { "aria-hidden": "true" }, names[index] ?? ""), input),
  );
  const element = el("fieldset", { class: "triple" }, el("legend", {}, label), ...cells);
  return {
    element,
    get value() {
      return inputs.map((input) => (Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : value)) as [number, number, number];
    },
    set value(next: [number, number, number]) {
      inputs.forEach((input, index) => (input.value = String(next[index])));
    },
    get disabled() {
      return element.disabled;
    },
    set disabled(off: boolean) {
      element.disabled = off;
    },
  };
}

export interface Progress {
  readonly element: HTMLElement;
  set(text: string, share: number | null): void;
  end(): void;
}

/** How far a long task is, and a button that stops it. */
export function progress(label: string, onCancel: () => void): Progress {
  const bar = el("progress", { max: 1, "aria-label": label });
  const text = el("p", { class: "hint" });
  const element = el("div", { class: "progress", hidden: true }, text, bar, button({ label: "Cancel", icon: "close", onClick: onCancel }));
  return {
    element,
    set(words: string, share: number | null) {
      show(element, true);
      text.textContent = words;
      if (share === null) bar.removeAttribute("value");
      else bar.value = share;
    },
    end() {
      show(element, false);
    },
  };
}
