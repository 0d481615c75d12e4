/** The handle's gizmo: move, turn, scale; tells the whole way from the edit's rest. */
import { Matrix4, Object3D, Vector3 } from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";
import type { Transform, Triple } from "../protocol";
import type { View } from "./view";

export type GizmoMode = "translate" | "rotate" | "scale";

const SMALLEST_SCALE = 0.01;
const SIZE = 0.9;
const AXIS_COLOURS = ["#d6404c", "#2f9461", "#3d6fd6", "#ffc53d"] as const;

export class Gizmo {
  readonly #controls: TransformControls;
  readonly #grip = new Object3D();
  readonly #center = new Vector3();
  readonly #view: View;

  constructor(view: View, onChange: () => void) {
    this.#view = view;
    this.#controls = new TransformControls(view.camera, view.element);
    this.#controls.setSize(SIZE);
    this.#controls.setColors(...AXIS_COLOURS);
    this.#controls.addEventListener("change", onChange);
    view.add(this.#grip, this.#controls.getHelper());
  }

  /** Listens to a drag: its begin, each move, its end. */
  onDrag(begin: () => void, move: () => void, end: () => void): void {
    this.#controls.addEventListener("mouseDown", begin);
    this.#controls.addEventListener("objectChange", move);
    this.#controls.addEventListener("mouseUp", end);
  }

  set mode(mode: GizmoMode | null) {
    if (mode === null) this.#controls.detach();
    else {
      this.#controls.setMode(mode);
      this.#controls.setSpace(mode === "scale" ? "local" : "world");
      this.#controls.attach(this.#grip);
    }
  }

  get held(): boolean {
    return this.#controls.dragging;
  }

  /** Whether the pointer is over a part of it. */
  get hovered(): boolean {
    return this.#controls.object !== undefined && this.#controls.axis !== null;
  }

  get transform(): Transform {
    const { position, quaternion, scale } = this.#grip;
    const factor = (value: number): number => Math.max(SMALLEST_SCALE, value);
    return {
      translate: position.clone().sub(this.#center).toArray() as Triple,
      rotate: [quaternion.x, quaternion.y, quaternion.z, quaternion.w],
      scale: [factor(scale.x), factor(scale.y), factor(scale.z)],
    };
  }

  /** Puts it where the session says that the handle is. */
  place(center: Triple, transform: Transform): void {
    this.#center.fromArray(center);
    this.#grip.position.fromArray(transform.translate).add(this.#center);
    this.#grip.quaternion.fromArray(transform.rotate);
    this.#grip.scale.fromArray(transform.scale);
    this.#grip.updateMatrixWorld();
  }

  /** Lets go of a drag without an end. */
  drop(): void {
    this.#controls.dragging = false;
    this.#controls.axis = null;
  }

  /** The pixel on the page where an arrow's tip is: for tests. */
  tip(axis: "x" | "y" | "z"): { x: number; y: number } {
    const way = new Vector3().setFromMatrixColumn(new Matrix4(), { x: 0, y: 1, z: 2 }[axis]);
    const distance = this.#grip.position.distanceTo(this.#view.camera.position);
    const length = (distance * Math.min(1.9 * Math.tan((Math.PI * this.#view.camera.fov) / 360), 7) * SIZE) / 4;
    const spot = this.#view.pixel(this.#grip.position.clone().addScaledVector(way, 0.42 * length));
    const box = this.#view.element.getBoundingClientRect();
    return { x: box.left + spot.x, y: box.top + spot.y };
  }
}
