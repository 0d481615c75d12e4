/** A surface as one scene shows it: with its own colours and look. */
import { BufferAttribute, BufferGeometry, DynamicDrawUsage, Group, Mesh, MeshBasicMaterial } from "three";
import { Clay } from "./clay";
import { CLAY, type Rgb } from "./palette";
import type { Surface } from "./surface";

export type Look = "smooth" | "flat" | "wire";

const WIRE = { color: "#27313c", opacity: 0.34, transparent: true, wireframe: true };
export class Body {
  readonly object = new Group();
  readonly #geometry = new BufferGeometry();
  readonly #colour: BufferAttribute;
  readonly #material = new Clay();
  readonly #wireMaterial = new MeshBasicMaterial(WIRE);
  readonly #wire: Mesh;

  constructor({ attributes }: Surface, position: BufferAttribute = attributes.position, normal: BufferAttribute = attributes.normal) {
    this.#colour = new BufferAttribute(new Float32Array(3 * position.count), 3).setUsage(DynamicDrawUsage);
    this.#geometry.setIndex(attributes.index);
    this.#geometry.setAttribute("position", position);
    this.#geometry.setAttribute("normal", normal);
    this.#geometry.setAttribute("color", this.#colour);
    this.#wire = new Mesh(this.#geometry, this.#wireMaterial);
    this.#wire.visible = false;
    this.object.add(new Mesh(this.#geometry, this.#material), this.#wire);
    for (const child of this.object.children) child.frustumCulled = false;
    this.paintPlain();
  }

  set look(look: Look) {
    this.#wire.visible = look === "wire";
    this.#material.flatly = look !== "smooth";
  }

  paint(colour: (vertex: number) => Rgb): void {
    const colours = this.#colour.array;
    for (let vertex = 0; vertex < this.#colour.count; vertex++) {
      const rgb = colour(vertex);
      colours[3 * vertex] = rgb[0];
      colours[3 * vertex + 1] = rgb[1];
      colours[3 * vertex + 2] = rgb[2];
    }
    this.#colour.needsUpdate = true;
  }

  paintPlain(): void {
    this.paint(() => CLAY);
  }

  dispose(): void {
    this.object.removeFromParent();
    this.#geometry.dispose();
    this.#material.dispose();
    this.#wireMaterial.dispose();
  }
}
