/** The scene of the Edit tab: one mesh, its paint, the gizmo on its handle. */
import type { Vector3 } from "three";
import { Cell } from "../cell";
import { ROLE } from "../frames";
import type { Model, Models } from "../models";
import type { EditState, PaintMode, Role } from "../protocol";
import type { Session } from "../session";
import { type Brush, type Canvas, Selection, type SelectionTool } from "../tools/selection";
import { Body, type Look } from "../view/body";
import { type Grip, Gestures } from "../view/gestures";
import { Gizmo, type GizmoMode } from "../view/gizmo";
import { CLAY, ROLE_COLOURS, type Rgb, sequential } from "../view/palette";
import { Rig } from "../view/rig";
import type { Stage } from "../view/stage";
import { View } from "../view/view";

export type EditTool = "look" | SelectionTool | GizmoMode;
export type EditLook = Look | "distortion";

/** Root mean square of the logarithms of stretch at which the colours end. */
export const MOST_DISTORTION = 0.5;
const SMALL_SCREEN = matchMedia("(max-width: 820px)");
const COVERED = { top: 62, bottom: 84 };
const NOTHING = { top: 0, bottom: 0 };
const START_RADIUS_PX = 28;
/** How long after the answer to a stroke its roles may come. */
const LATEST_ROLES_MS = 400;
const GIZMO_MODES: readonly EditTool[] = ["translate", "rotate", "scale"];

export class EditScene {
  readonly view = new View("Mesh to edit. Arrow keys turn it, plus and minus zoom, Enter picks the middle.", new Rig(), () =>
    SMALL_SCREEN.matches ? COVERED : NOTHING,
  );
  readonly tool = new Cell<EditTool>("brush");
  readonly role = new Cell<Role>("handle");
  readonly look = new Cell<EditLook>("smooth");
  readonly brush: Brush = { tool: "brush", radius: START_RADIUS_PX, through: false, mode: "set" };
  readonly gizmo: Gizmo;
  readonly #stage: Stage;
  readonly #session: Session;
  readonly #models: Models;
  readonly #selection = new Selection();
  readonly #gestures: Gestures;
  #body: Body | null = null;
  #preview: { vertices: Set<number>; mode: PaintMode } | null = null;
  #lastSeq = 0;
  #faded = true;
  #awaited = false;
  /** The mesh that was seen last: it keeps its camera when it comes again, after a lost connection. */
  #lastMesh = 0;

  constructor(stage: Stage, session: Session, models: Models) {
    this.#stage = stage;
    this.#session = session;
    this.#models = models;
    stage.add(this.view);
    stage.beforeDraw(() => this.#recolour());
    this.view.element.append(this.#selection.overlay);
    this.gizmo = new Gizmo(this.view, () => stage.invalidate());
    this.gizmo.onDrag(
      () => session.tell({ type: "drag.begin" }),
      () => session.tell({ type: "drag.move", seq: this.#nextSeq(), transform: this.gizmo.transform }),
      () => void session.ask({ type: "drag.end", seq: this.#nextSeq(), transform: this.gizmo.transform }).then(() => this.#rest()),
    );
    session.connection.status.watch((status) => {
      if (status !== "open" && this.gizmo.held) this.gizmo.drop();
    });
    this.view.element.addEventListener("pointercancel", () => this.cancel());
    this.#gestures = new Gestures(this.view, this.#taker(), () => this.gizmo.held || this.gizmo.hovered);
    models.source.watch((model) => this.#shown(model));
    models.onChange((slot, part) => {
      if (slot !== "source") return;
      if (part === "roles") this.#arrived();
      if (part === "roles" || part === "distortion") this.#colour();
      stage.invalidate();
    });
    session.state.watch((state) => this.#settled(state?.edit ?? null));
    this.tool.watch(() => this.#rest());
    this.look.watch((look) => this.#dress(look));
  }

  /** Stops a stroke or puts a drag back; whether there was one. */
  cancel(): boolean {
    if (!this.gizmo.held) return this.#gestures.cancel();
    this.gizmo.drop();
    this.#session.tell({ type: "drag.cancel" });
    return true;
  }

  /** The gizmo where the session has the handle, whatever came of a drag. */
  #rest(): void {
    this.#settled(this.#session.state.value?.edit ?? null);
  }

  /** Number of the last move of this page's hand. */
  get moves(): number {
    return this.#lastSeq;
  }

  #nextSeq(): number {
    this.#lastSeq += 1;
    return this.#lastSeq;
  }

  #taker(): ConstructorParameters<typeof Gestures>[1] {
    return {
      down: (event): Grip | null => {
        const canvas = this.#canvas();
        return canvas && this.#paints() ? this.#selection.down(event, canvas, this.brush) : null;
      },
      hover: (event) => this.#selection.hover(event && this.#paints() ? this.view.spot(event) : null, this.brush),
      enter: () => {
        const canvas = this.#canvas();
        if (canvas && this.#paints()) this.#selection.enter(canvas, this.brush);
      },
      doubleClick: (event) => {
        const hit = this.#paints() ? null : this.#models.source.value?.picker.hit(this.view.ray(this.view.spot(event)));
        if (hit) this.view.rig.focus(hit.point as Vector3, this.view.ball);
      },
    };
  }

  #paints(): boolean {
    const tool = this.tool.value;
    if (tool === "look" || GIZMO_MODES.includes(tool)) return false;
    this.brush.tool = tool as SelectionTool;
    return true;
  }

  #canvas(): Canvas | null {
    const model = this.#models.source.value;
    if (!model) return null;
    return {
      view: this.view,
      picker: model.picker,
      preview: (vertices, mode) => this.#previewed({ vertices: new Set(vertices), mode }),
      paint: (vertices, mode) => {
        this.#previewed({ vertices: new Set(vertices), mode });
        this.#awaited = true;
        void this.#session
          .ask({ type: "paint", role: this.role.value, mode, vertices })
          .then((done) => setTimeout(() => this.#arrived(), done ? LATEST_ROLES_MS : 0));
      },
      revert: () => this.#previewed(null),
    };
  }

  /** The server's roles are there: the preview has done its work. */
  #arrived(): void {
    if (!this.#awaited) return;
    this.#awaited = false;
    this.#previewed(null);
  }

  #previewed(preview: { vertices: Set<number>; mode: PaintMode } | null): void {
    this.#preview = preview;
    this.#colour();
  }

  #shown(model: Model | null): void {
    this.#body?.dispose();
    this.#body = null;
    if (model) {
      this.#body = new Body(model.surface);
      this.view.add(this.#body.object);
      if (model.mesh !== this.#lastMesh) {
        this.view.center(model.surface.positions);
        this.view.rig.frame();
      }
      this.#lastMesh = model.mesh;
      this.#dress(this.look.value);
    }
    this.#rest();
  }

  #dress(look: EditLook): void {
    if (this.#body) this.#body.look = look === "distortion" ? "smooth" : look;
    const wanted = look === "distortion";
    if (this.#session.state.value && this.#session.state.value.display.distortion !== wanted)
      void this.#session.ask({ type: "display", distortion: wanted });
    this.#colour();
  }

  /** The gizmo where the session says, unless this page is dragging it. */
  #settled(edit: EditState | null): void {
    if (this.gizmo.held) return;
    const tool = this.tool.value;
    const moves = GIZMO_MODES.includes(tool) && edit?.ready === true && edit.handle.center !== null;
    if (moves && edit?.handle.center) this.gizmo.place(edit.handle.center, edit.transform);
    this.gizmo.mode = moves ? (tool as GizmoMode) : null;
    this.#selection.hover(null, this.brush);
    this.view.element.dataset["tool"] = tool;
    this.#colour();
  }

  /** Asks for new colours, at the next picture. */
  #colour(): void {
    this.#faded = true;
    this.#stage.invalidate();
  }

  #recolour(): void {
    if (!this.#faded) return;
    this.#faded = false;
    const model = this.#models.source.value;
    if (!model || !this.#body) return;
    const { distortion, roles } = model;
    if (this.look.value === "distortion" && distortion)
      this.#body.paint((vertex) => sequential((distortion[vertex] ?? 0) / MOST_DISTORTION));
    else this.#body.paint(this.#roleColour(roles, model.colours));
  }

  #roleColour(roles: Uint8Array | null, file: Uint8Array | null): (vertex: number) => Rgb {
    const handles = (this.#session.state.value?.edit?.handle.count ?? 0) > 0 || this.#preview !== null;
    const shown = this.#preview;
    return (vertex) => {
      const role = roles?.[vertex] ?? 0;
      if (shown?.vertices.has(vertex)) return shown.mode === "erase" ? CLAY : painted(this.role.value);
      if (shown?.mode === "set" && (role & ROLE.painted) !== 0 && nameOf(role) === this.role.value) return CLAY;
      if ((role & ROLE.painted) === 0 && !handles) return fileColour(file, vertex) ?? CLAY;
      return colourOf(role);
    };
  }
}

function nameOf(role: number): Role {
  return (["anchor", "free", "handle"] as const)[role & ROLE.mask] ?? "anchor";
}

function painted(role: Role): Rgb {
  return { anchor: ROLE_COLOURS.anchorPainted, free: ROLE_COLOURS.freePainted, handle: ROLE_COLOURS.handle }[role];
}

function colourOf(role: number): Rgb {
  if ((role & ROLE.mirrored) !== 0) return ROLE_COLOURS.handleMirrored;
  const name = nameOf(role);
  return (role & ROLE.painted) !== 0 ? painted(name) : ROLE_COLOURS[name];
}

const BYTE = 255;

function fileColour(colours: Uint8Array | null, vertex: number): Rgb | null {
  if (!colours) return null;
  const channel = (at: number): number => ((colours[4 * vertex + at] ?? 0) / BYTE) ** 2.2;
  return [channel(0), channel(1), channel(2)];
}
