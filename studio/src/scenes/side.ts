/** One of the two meshes of the Match tab, and its sphere. */
import { BufferAttribute } from "three";
import type { Model } from "../models";
import type { MeshSlot } from "../protocol";
import { Body } from "../view/body";
import { MarkLayer } from "../view/markers";
import type { Rgb } from "../view/palette";
import type { Rig } from "../view/rig";
import { View } from "../view/view";

/** A little more than the sphere's radius: it fills its view as no mesh does. */
const SPHERE_ROOM = 1.2;
const NAMES: Record<MeshSlot, string> = { source: "Mesh A", target: "Mesh B" };

export class Side {
  readonly slot: MeshSlot;
  readonly view: View;
  readonly sphereView: View;
  readonly marks: MarkLayer;
  model: Model | null = null;
  #body: Body | null = null;
  #sphere: Body | null = null;

  constructor(slot: MeshSlot, rig: Rig, sphereRig: Rig) {
    this.slot = slot;
    this.view = new View(`${NAMES[slot]}. Arrow keys turn it, Enter sets a marker in the middle.`, rig);
    this.sphereView = new View(`Sphere of ${NAMES[slot]}. Arrow keys turn it.`, sphereRig);
    this.sphereView.ball.radius = SPHERE_ROOM;
    this.marks = new MarkLayer(this.view);
    this.view.element.dataset["slot"] = slot;
  }

  show(model: Model | null): void {
    this.model = model;
    this.#body?.dispose();
    this.#body = null;
    if (model) {
      this.#body = new Body(model.surface);
      this.view.add(this.#body.object);
      this.view.center(model.surface.positions);
    }
  }

  /** `laid`: as it lies in the target's sphere, where that is known. */
  showSphere(laid: boolean): void {
    this.#sphere?.dispose();
    this.#sphere = null;
    const points = (laid ? this.model?.laid : null) ?? this.model?.sphere;
    if (!this.model || !points) return;
    const position = new BufferAttribute(points, 3);
    this.#sphere = new Body(this.model.surface, position, position);
    this.sphereView.add(this.#sphere.object);
  }

  get hasSphere(): boolean {
    return this.#sphere !== null;
  }

  paint(colour: (vertex: number) => Rgb): void {
    this.#body?.paint(colour);
    this.#sphere?.paint(colour);
  }
}
