/** Binary frames: a header of 40 bytes, then arrays without gaps. */
import type { Slot } from "./protocol";

const MAGIC = 0x54534c4d; // the letters MLST, little-endian
const VERSION = 1;
const HEADER_BYTES = 40;
const SLOTS: readonly Slot[] = ["source", "target", "morph"];
const KIND = { mesh: 1, subset: 2, frame: 3, roles: 4, sphere: 5, labels: 6, images: 7 } as const;

interface Header {
  slot: Slot;
  number: number;
  mesh: number;
  set: number;
  seq: number;
}

export type Frame = Header &
  (
    | { kind: "mesh"; positions: Float32Array; normals: Float32Array; faces: Uint32Array; colours: Uint8Array | null }
    | { kind: "subset"; vertices: Uint32Array }
    | { kind: "frame"; positions: Float32Array; normals: Float32Array; distortion: Float32Array | null }
    | { kind: "roles"; roles: Uint8Array }
    | { kind: "sphere"; points: Float32Array; laid: boolean }
    | { kind: "labels"; labels: Int32Array }
    | { kind: "images"; positions: Float32Array }
  );

/** Reads a frame; its arrays share the buffer's memory. */
export function decode(buffer: ArrayBuffer): Frame {
  const view = new DataView(buffer);
  if (view.getUint32(0, true) !== MAGIC || view.getUint16(4, true) !== VERSION) throw new Error("not a frame of this protocol");
  const slot = SLOTS[view.getUint16(8, true)];
  if (slot === undefined) throw new Error("a frame of an unknown slot");
  const flagged = (view.getUint16(10, true) & 1) === 1;
  const word = (at: number): number => view.getUint32(at, true);
  const header: Header = { slot, number: word(12), mesh: word(16), set: word(20), seq: word(32) };
  const count = word(24);
  const extra = word(28);
  let at = HEADER_BYTES;
  const floats = (length: number): Float32Array => new Float32Array(buffer, (at += 4 * length) - 4 * length, length);
  const words = (length: number): Uint32Array => new Uint32Array(buffer, (at += 4 * length) - 4 * length, length);
  switch (view.getUint16(6, true)) {
    case KIND.mesh: {
      const [positions, normals, faces] = [floats(3 * count), floats(3 * count), words(3 * extra)];
      return { ...header, kind: "mesh", positions, normals, faces, colours: flagged ? new Uint8Array(buffer, at, 4 * count) : null };
    }
    case KIND.subset:
      return { ...header, kind: "subset", vertices: words(count) };
    case KIND.frame: {
      const [positions, normals] = [floats(3 * count), floats(3 * count)];
      return { ...header, kind: "frame", positions, normals, distortion: flagged ? floats(count) : null };
    }
    case KIND.roles:
      return { ...header, kind: "roles", roles: new Uint8Array(buffer, at, count) };
    case KIND.sphere:
      return { ...header, kind: "sphere", points: floats(3 * count), laid: flagged };
    case KIND.labels:
      return { ...header, kind: "labels", labels: new Int32Array(buffer, at, count) };
    case KIND.images:
      return { ...header, kind: "images", positions: floats(3 * count) };
    default:
      throw new Error("a frame of an unknown kind");
  }
}

export const ROLE = { anchor: 0, free: 1, handle: 2, mask: 3, painted: 4, mirrored: 8 } as const;
