/** One canvas behind all views; draws only when something changed. */
import { type Camera, type Object3D, WebGLRenderer } from "three";
import { el } from "../dom";
import type { Rig } from "./rig";
import type { View } from "./view";

const MOST_PIXELS_PER_POINT = 2;

export class Stage {
  readonly element: HTMLElement;
  readonly #renderer: WebGLRenderer;
  readonly #views: View[] = [];
  readonly #before: (() => void)[] = [];
  #asked = false;
  /** Pictures drawn so far. */
  pictures = 0;

  constructor() {
    const canvas = el("canvas", { class: "canvas", "aria-hidden": "true" });
    this.element = el("div", { class: "stage" }, canvas);
    this.#renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.#renderer.setPixelRatio(Math.min(devicePixelRatio, MOST_PIXELS_PER_POINT));
    this.#renderer.setScissorTest(true);
    this.#renderer.debug.checkShaderErrors = false; // to ask for errors is to wait for the compiler
    new ResizeObserver(() => this.invalidate()).observe(this.element);
  }

  /** Compiles what something is drawn with, beside other work: it will be drawn soon. */
  announce(object: Object3D, camera: Camera): void {
    this.#renderer.compile(object, camera);
  }

  add(view: View): void {
    this.#views.push(view);
    this.follow(view.rig);
  }

  /** Draws when a rig moves. */
  follow(rig: Rig): void {
    rig.onChange(() => this.invalidate());
  }

  /** Called before each picture: for work that many changes need only once. */
  beforeDraw(listener: () => void): void {
    this.#before.push(listener);
  }

  /** Asks for a picture, at the screen's next one. */
  invalidate(): void {
    if (this.#asked) return;
    this.#asked = true;
    requestAnimationFrame(() => this.#draw());
  }

  #draw(): void {
    this.#asked = false;
    for (const listener of this.#before) listener();
    const { clientWidth: width, clientHeight: height } = this.element;
    const canvas = this.#renderer.domElement;
    if (canvas.clientWidth !== width || canvas.clientHeight !== height || !this.pictures) this.#renderer.setSize(width, height);
    this.#renderer.setScissor(0, 0, width, height);
    this.#renderer.clear();
    const origin = this.element.getBoundingClientRect();
    for (const view of this.#views) {
      const box = view.element.getBoundingClientRect();
      if (!box.width || !box.height) continue;
      const left = box.left - origin.left;
      const bottom = origin.bottom - box.bottom;
      this.#renderer.setViewport(left, bottom, box.width, box.height);
      this.#renderer.setScissor(left, bottom, box.width, box.height);
      view.prepare(box.width / box.height);
      view.draw();
      this.#renderer.render(view.scene, view.camera);
    }
    this.pictures += 1;
  }
}
