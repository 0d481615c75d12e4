/** What tests and curious people may read of the page; nothing here changes it. */
import { Vector3 } from "three";
import type { Models } from "./models";
import type { Slot, State } from "./protocol";
import type { EditScene } from "./scenes/edit";
import type { Session } from "./session";
import type { Stage } from "./view/stage";
import type { View } from "./view/view";

const SLOTS: readonly Slot[] = ["source", "target", "morph"];

export interface Hook {
  state(): State | null;
  positions(slot: Slot): number[];
  /** What each vertex is, as the server's frames tell it. */
  roles(slot: Slot): number[];
  updates(slot: Slot): number;
  /** Number of the last move of this page's hand, and of the move that the last frame of the source answers. */
  moves(): { told: number; answered: number };
  pictures(): number;
  /** Whether a mesh has been drawn since it came. */
  drawn(slot: Slot): boolean;
  /** Where each vertex is on the page, in pixels: x and y of the first, of the second, and so on. */
  pixels(slot: Slot): number[];
  /** Whether a vertex is in sight. */
  visible(slot: Slot, vertex: number): boolean;
  gizmoTip(axis: "x" | "y" | "z"): { x: number; y: number };
}

export function installHook(session: Session, models: Models, stage: Stage, edit: EditScene, views: (slot: Slot) => View): void {
  const surface = (slot: Slot) => models[slot].value?.surface;
  /** How many pictures there were when a mesh came. */
  const since = new Map<Slot, number>();
  for (const slot of SLOTS) models[slot].watch((model) => since.set(slot, model ? stage.pictures : Infinity));
  const hook: Hook = {
    state: () => session.state.value,
    positions: (slot) => [...(surface(slot)?.positions ?? [])],
    roles: (slot) => [...(models[slot].value?.roles ?? [])],
    updates: (slot) => models[slot].value?.updates ?? 0,
    moves: () => ({ told: edit.moves, answered: models.source.value?.seq ?? 0 }),
    pictures: () => stage.pictures,
    drawn: (slot) => stage.pictures > (since.get(slot) ?? Infinity),
    pixels(slot) {
      const view = views(slot);
      const box = view.element.getBoundingClientRect();
      const shown = surface(slot);
      const place = new Vector3();
      return Array.from({ length: shown?.count ?? 0 }, (_, vertex) => view.pixel(shown?.point(vertex, place) ?? place)).flatMap(
        ({ x, y }) => [box.left + x, box.top + y],
      );
    },
    visible: (slot, vertex) => models[slot].value?.picker.visible(views(slot), vertex) ?? false,
    gizmoTip: (axis) => edit.gizmo.tip(axis),
  };
  Object.defineProperty(window, "morphlet", { value: Object.freeze(hook) });
}
