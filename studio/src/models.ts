/** The meshes of the session as the server's frames have made them. */
import { Cell } from "./cell";
import type { Frame } from "./frames";
import type { Slot } from "./protocol";
import type { Session } from "./session";
import { Picker } from "./view/picking";
import { Surface } from "./view/surface";

/** What of a model has changed. */
export type Part = "positions" | "roles" | "distortion" | "sphere" | "labels" | "images";

export class Model {
  readonly mesh: number;
  readonly surface: Surface;
  readonly picker: Picker;
  /** Colours of the file, red, green, blue and alpha of each vertex. */
  readonly colours: Uint8Array | null;
  roles: Uint8Array | null = null;
  distortion: Float32Array | null = null;
  sphere: Float32Array | null = null;
  /** Points of the sphere, moved so that matching vertices have the same. */
  laid: Float32Array | null = null;
  labels: Int32Array | null = null;
  images: Float32Array | null = null;
  /** Frames taken. */
  updates = 0;
  /** Which move of a hand the last frame answers; 0 if none. */
  seq = 0;

  constructor(mesh: number, surface: Surface, colours: Uint8Array | null) {
    this.mesh = mesh;
    this.surface = surface;
    this.picker = new Picker(surface);
    this.colours = colours;
  }
}

export class Models {
  readonly source = new Cell<Model | null>(null);
  readonly target = new Cell<Model | null>(null);
  readonly morph = new Cell<Model | null>(null);
  readonly #listeners: ((slot: Slot, part: Part) => void)[] = [];

  constructor(session: Session) {
    session.onFrame("mesh", (frame) => {
      this[frame.slot].value = new Model(
        frame.mesh,
        new Surface(frame.positions, frame.normals, frame.faces),
        frame.colours?.slice() ?? null,
      );
    });
    session.onFrame("subset", (frame) => this.#of(frame)?.surface.subset(frame.set, frame.vertices));
    session.onFrame("frame", (frame) => this.#moved(frame));
    session.onFrame("roles", (frame) => this.#set(frame, "roles", (model) => (model.roles = frame.roles.slice())));
    session.onFrame("labels", (frame) => this.#set(frame, "labels", (model) => (model.labels = frame.labels.slice())));
    session.onFrame("images", (frame) => this.#set(frame, "images", (model) => (model.images = frame.positions.slice())));
    session.onFrame("sphere", (frame) =>
      this.#set(frame, "sphere", (model) => (model[frame.laid ? "laid" : "sphere"] = frame.points.slice())),
    );
    session.state.watch((state) => {
      if (!state) return;
      for (const slot of ["source", "target", "morph"] as const) if (!state.meshes[slot]) this[slot].value = null;
    });
  }

  onChange(listener: (slot: Slot, part: Part) => void): void {
    this.#listeners.push(listener);
  }

  #of(frame: Frame): Model | null {
    const model = this[frame.slot].value;
    return model?.mesh === frame.mesh ? model : null;
  }

  #set(frame: Frame, part: Part, put: (model: Model) => void): void {
    const model = this.#of(frame);
    if (!model) return;
    put(model);
    this.#tell(frame.slot, part);
  }

  #moved(frame: Extract<Frame, { kind: "frame" }>): void {
    const model = this.#of(frame);
    const members = model?.surface.members(frame.set);
    if (!model || members === null) return;
    model.surface.move(members, frame.positions, frame.normals);
    model.updates += 1;
    model.seq = frame.seq;
    this.#tell(frame.slot, "positions");
    if (!frame.distortion) return;
    model.distortion = spread(model.distortion, model.surface.count, members, frame.distortion);
    this.#tell(frame.slot, "distortion");
  }

  #tell(slot: Slot, part: Part): void {
    for (const listener of this.#listeners) listener(slot, part);
  }
}

/** Values of a few vertices among those of all; vertices outside a subset are as they were at rest. */
function spread(before: Float32Array | null, count: number, members: Uint32Array | undefined, values: Float32Array): Float32Array {
  if (!members) return values.slice();
  const all = before?.length === count ? before : new Float32Array(count);
  members.forEach((vertex, row) => (all[vertex] = values[row] ?? 0));
  return all;
}
