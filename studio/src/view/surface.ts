/** A mesh as the server sends it: its numbers in arrays that the GPU's buffers share. */
import { BufferAttribute, BufferGeometry, DynamicDrawUsage, type Vector3 } from "three";

export class Surface {
  readonly positions: Float32Array;
  readonly faces: Uint32Array;
  readonly attributes: { position: BufferAttribute; normal: BufferAttribute; index: BufferAttribute };
  /** Positions and faces alone: for searching. */
  readonly geometry = new BufferGeometry();
  /** Grows with every change of the positions. */
  revision = 0;
  readonly #normals: Float32Array;
  #subset: Uint32Array | null = null;
  #subsetNumber = 0;

  constructor(positions: Float32Array, normals: Float32Array, faces: Uint32Array) {
    this.positions = positions.slice();
    this.faces = faces.slice();
    this.#normals = normals.slice();
    this.attributes = {
      position: new BufferAttribute(this.positions, 3).setUsage(DynamicDrawUsage),
      normal: new BufferAttribute(this.#normals, 3).setUsage(DynamicDrawUsage),
      index: new BufferAttribute(this.faces, 1),
    };
    this.geometry.setIndex(this.attributes.index);
    this.geometry.setAttribute("position", this.attributes.position);
  }

  /** A mesh of nothing. */
  static none(): Surface {
    return new Surface(new Float32Array(3), new Float32Array(3), new Uint32Array(3));
  }

  get count(): number {
    return this.positions.length / 3;
  }

  /** The vertices that frames with this number are about. */
  subset(number: number, vertices: Uint32Array): void {
    this.#subsetNumber = number;
    this.#subset = vertices.slice();
  }

  /** The vertices of a set; undefined for all of them, null if the set is not known. */
  members(set: number): Uint32Array | undefined | null {
    if (set === 0) return undefined;
    return set === this.#subsetNumber ? this.#subset : null;
  }

  /** New positions of all vertices or of some. */
  move(members: Uint32Array | undefined, positions: Float32Array, normals: Float32Array): void {
    if (members) {
      scatter(this.positions, members, positions);
      scatter(this.#normals, members, normals);
    } else {
      this.positions.set(positions);
      this.#normals.set(normals);
    }
    this.attributes.position.needsUpdate = true;
    this.attributes.normal.needsUpdate = true;
    this.revision += 1;
  }

  point(vertex: number, into: Vector3): Vector3 {
    return into.fromArray(this.positions, 3 * vertex);
  }

  normal(vertex: number, into: Vector3): Vector3 {
    return into.fromArray(this.#normals, 3 * vertex);
  }
}

/** Rows of a few vertices into the array of all. */
function scatter(all: Float32Array, members: Uint32Array, rows: Float32Array): void {
  for (let row = 0; row < members.length; row++) {
    const at = 3 * (members[row] ?? 0);
    all[at] = rows[3 * row] ?? 0;
    all[at + 1] = rows[3 * row + 1] ?? 0;
    all[at + 2] = rows[3 * row + 2] ?? 0;
  }
}
