/** Pointers, wheel and keys on a view: a tool takes them first, the camera what it leaves. */
import type { Spot, View } from "./view";

const WHEEL_STEP = 0.0012;
const KEY_TURN = 0.04;
const KEY_ZOOM = 1.15;
const PRIMARY = 0;
const MIDDLE = 1;

/** A pointer that is down, until it is let go. */
export interface Grip {
  move(event: PointerEvent): void;
  end(event: PointerEvent): void;
  cancel(): void;
}

export interface Taker {
  /** A grip if the tool wants this pointer. */
  down(event: PointerEvent, view: View): Grip | null;
  /** The pointer passes over the view, not pressed; null when it leaves. */
  hover(event: PointerEvent | null, view: View): void;
  /** Enter on the view: as a click in its middle. */
  enter(view: View): void;
  doubleClick(event: MouseEvent, view: View): void;
}

export class Gestures {
  readonly #view: View;
  readonly #taker: Taker;
  readonly #busy: () => boolean;
  readonly #fingers = new Map<number, Spot>();
  #grip: Grip | null = null;

  /** `busy` tells whether something else holds the pointer. */
  constructor(view: View, taker: Taker, busy: () => boolean) {
    this.#view = view;
    this.#taker = taker;
    this.#busy = busy;
    const on = view.element;
    on.addEventListener("pointerdown", (event) => this.#down(event));
    on.addEventListener("pointermove", (event) => this.#move(event));
    on.addEventListener("pointerup", (event) => this.#up(event));
    on.addEventListener("pointercancel", (event) => this.#lost(event));
    on.addEventListener("pointerleave", () => taker.hover(null, view));
    on.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    on.addEventListener("contextmenu", (event) => event.preventDefault());
    on.addEventListener("dblclick", (event) => taker.doubleClick(event, view));
    on.addEventListener("keydown", (event) => this.#key(event));
    on.addEventListener("blur", () => on.classList.remove("by-pointer"));
    on.style.touchAction = "none";
  }

  /** Drops whatever a pointer is doing. */
  cancel(): boolean {
    const held = this.#grip !== null;
    this.#grip?.cancel();
    this.#grip = null;
    return held;
  }

  #down(event: PointerEvent): void {
    this.#view.element.classList.add("by-pointer");
    this.#view.element.focus({ preventScroll: true });
    if (this.#busy()) return;
    this.#fingers.set(event.pointerId, this.#view.spot(event));
    this.#view.element.setPointerCapture(event.pointerId);
    this.#grip?.cancel();
    this.#grip = this.#fingers.size > 1 ? this.#pinch() : this.#single(event);
  }

  #single(event: PointerEvent): Grip {
    const own = event.button === PRIMARY ? this.#taker.down(event, this.#view) : null;
    if (own) return own;
    const pans = event.button === MIDDLE || event.shiftKey;
    return this.#camera(this.#view.spot(event), (right, down) =>
      pans ? this.#view.rig.pan(right, down) : this.#view.rig.turn(right, down),
    );
  }

  #camera(start: Spot, act: (right: number, down: number) => void): Grip {
    let last = start;
    return {
      move: (event) => {
        const now = this.#view.spot(event);
        const { height } = this.#view.size;
        act((now.x - last.x) / height, (now.y - last.y) / height);
        last = now;
      },
      end: () => undefined,
      cancel: () => undefined,
    };
  }

  /** Two fingers: their middle pans, their distance zooms. */
  #pinch(): Grip {
    let { middle, distance } = this.#spread();
    return {
      move: () => {
        const now = this.#spread();
        const { height } = this.#view.size;
        this.#view.rig.pan((now.middle.x - middle.x) / height, (now.middle.y - middle.y) / height);
        if (distance > 0 && now.distance > 0) this.#view.rig.dolly(now.distance / distance);
        ({ middle, distance } = now);
      },
      end: () => undefined,
      cancel: () => undefined,
    };
  }

  #spread(): { middle: Spot; distance: number } {
    const [first, second] = [...this.#fingers.values()];
    if (!first || !second) return { middle: first ?? { x: 0, y: 0 }, distance: 0 };
    const middle = { x: (first.x + second.x) / 2, y: (first.y + second.y) / 2 };
    return { middle, distance: Math.hypot(first.x - second.x, first.y - second.y) };
  }

  #move(event: PointerEvent): void {
    if (this.#fingers.has(event.pointerId)) this.#fingers.set(event.pointerId, this.#view.spot(event));
    if (this.#grip) this.#grip.move(event);
    else if (!this.#busy()) this.#taker.hover(event, this.#view);
  }

  #up(event: PointerEvent): void {
    this.#fingers.delete(event.pointerId);
    this.#grip?.end(event);
    this.#grip = null;
  }

  #lost(event: PointerEvent): void {
    this.#fingers.delete(event.pointerId);
    this.cancel();
  }

  #wheel(event: WheelEvent): void {
    event.preventDefault();
    this.#view.rig.dolly(Math.exp(-event.deltaY * WHEEL_STEP));
  }

  #key(event: KeyboardEvent): void {
    if (event.key === "Tab" || event.key.startsWith("Arrow")) this.#view.element.classList.remove("by-pointer");
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { rig } = this.#view;
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (way) {
      const [right, down] = [KEY_TURN * (way[0] ?? 0), KEY_TURN * (way[1] ?? 0)];
      if (event.shiftKey) rig.pan(right, down);
      else rig.turn(right, down);
    } else if (event.key === "+" || event.key === "=") rig.dolly(KEY_ZOOM);
    else if (event.key === "-") rig.dolly(1 / KEY_ZOOM);
    else if (event.key === "Home") rig.frame();
    else if (event.key === "Enter") this.#taker.enter(this.#view);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }
}
