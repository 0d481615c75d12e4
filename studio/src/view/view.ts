/** One look at one scene: an element that takes the pointer, and a camera on the shared rig. */
import { Box3, type Object3D, PerspectiveCamera, Ray, Scene, Sphere, Vector2, Vector3 } from "three";
import { el } from "../dom";
import type { Ball, Rig } from "./rig";

const FIELD_OF_VIEW = 32;

export interface Spot {
  x: number;
  y: number;
}

export interface Covered {
  top: number;
  bottom: number;
}

const NOTHING: Covered = { top: 0, bottom: 0 };
/** Share of the height in which a mesh is shown at least. */
const LEAST_FREE = 0.4;

export class View {
  readonly element: HTMLElement;
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW);
  rig: Rig;
  readonly ball: Ball = { center: new Vector3(), radius: 1 };
  /** Pixels at the top and at the foot that other things cover. */
  readonly #covered: () => Covered;
  readonly #before: (() => void)[] = [];

  constructor(label: string, rig: Rig, covered: () => Covered = () => NOTHING) {
    this.rig = rig;
    this.#covered = covered;
    this.element = el("div", { class: "view", tabindex: 0, role: "application", "aria-label": label });
  }

  add(...objects: Object3D[]): void {
    if (objects.length) this.scene.add(...objects);
  }

  /** The middle and size of what the view is about. */
  center(...shapes: Float32Array[]): void {
    const box = new Box3();
    for (const positions of shapes) box.union(new Box3().setFromArray(positions));
    const sphere = box.getBoundingSphere(new Sphere());
    this.ball.center.copy(sphere.center);
    this.ball.radius = sphere.radius || 1;
  }

  /** Called before each picture of this view, with the camera in its place. */
  beforeDraw(listener: () => void): void {
    this.#before.push(listener);
  }

  prepare(aspect: number): void {
    const { width, height } = this.size;
    const { top, bottom } = this.#covered();
    this.rig.place(this.camera, this.ball, aspect, Math.max(LEAST_FREE, 1 - (top + bottom) / height));
    this.camera.setViewOffset(width, height, 0, (bottom - top) / 2, width, height);
    this.camera.updateProjectionMatrix();
  }

  draw(): void {
    for (const listener of this.#before) listener();
  }

  /** Where a pointer is, in pixels of the view. */
  spot(event: { clientX: number; clientY: number }): Spot {
    const box = this.element.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  get size(): { width: number; height: number } {
    return { width: this.element.clientWidth, height: this.element.clientHeight };
  }

  /** The ray through a pixel. */
  ray(spot: Spot): Ray {
    const { width, height } = this.size;
    this.prepare(width / height);
    const seen = new Vector2((2 * spot.x) / width - 1, 1 - (2 * spot.y) / height);
    const origin = new Vector3().setFromMatrixPosition(this.camera.matrixWorld);
    const direction = new Vector3(seen.x, seen.y, 0.5).unproject(this.camera).sub(origin).normalize();
    return new Ray(origin, direction);
  }

  /** The pixel of a point. */
  pixel(point: Vector3): Spot {
    const { width, height } = this.size;
    this.prepare(width / height);
    const seen = point.clone().project(this.camera);
    return { x: ((seen.x + 1) / 2) * width, y: ((1 - seen.y) / 2) * height };
  }

  /** How long a pixel is at a point, in units of the mesh. */
  pixelSize(point: Vector3): number {
    const distance = point.distanceTo(this.camera.position);
    return (2 * distance * Math.tan((this.camera.fov * Math.PI) / 360)) / this.size.height;
  }
}
