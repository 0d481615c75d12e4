/** The scene of the Match tab: two meshes and their spheres, feature regions, markers. */
import { Cell } from "../cell";
import type { Models } from "../models";
import type { MeshSlot, State } from "../protocol";
import type { Session } from "../session";
import { type Grip, Gestures, type Taker } from "../view/gestures";
import type { Mark } from "../view/markers";
import { CLAY, OUTSIDE, placeColour, qualitative, type Rgb } from "../view/palette";
import { Rig } from "../view/rig";
import type { Stage } from "../view/stage";
import { Side } from "./side";

export type MatchTool = "look" | "marker";
export type MatchColours = "plain" | "regions" | "map";
export type Shown = "meshes" | "both" | "spheres";

const CLICK_SLOP_PX = 5;

export class MatchScene {
  readonly tool = new Cell<MatchTool>("marker");
  readonly colours = new Cell<MatchColours>("regions");
  readonly linked = new Cell(true);
  readonly laid = new Cell(true);
  readonly shown = new Cell<Shown>("both");
  readonly hasSpheres = new Cell(false);
  /** The vertex that waits for its partner on the other mesh. */
  readonly pending = new Cell<{ slot: MeshSlot; vertex: number } | null>(null);
  readonly sides: Record<MeshSlot, Side>;
  readonly #stage: Stage;
  readonly #session: Session;
  readonly #rig = new Rig();
  readonly #gestures: Gestures[] = [];
  #faded = true;

  constructor(stage: Stage, session: Session, models: Models) {
    this.#stage = stage;
    this.#session = session;
    const sphereRig = new Rig();
    this.sides = { source: new Side("source", this.#rig, sphereRig), target: new Side("target", this.#rig, sphereRig) };
    for (const side of Object.values(this.sides)) this.#join(side, models);
    stage.beforeDraw(() => this.#recolour());
    models.onChange((slot, part) => {
      if (slot === "morph") return;
      if (part === "sphere") this.#showSphere(this.sides[slot]);
      if (part !== "positions") this.fade();
      stage.invalidate();
    });
    session.state.watch((state) => this.#settled(state));
    this.pending.watch(() => this.#settled(session.state.value));
    this.colours.watch(() => this.fade());
    this.laid.watch(() => {
      for (const side of Object.values(this.sides)) this.#showSphere(side);
      this.fade();
    });
    this.shown.watch(() => stage.invalidate());
    this.linked.watch((linked) => this.#link(linked));
  }

  /** Drops what waits or is dragged; whether there was something. */
  cancel(): boolean {
    const waits = this.pending.value !== null;
    this.pending.value = null;
    return this.#gestures.map((one) => one.cancel()).includes(true) || waits;
  }

  frame(): void {
    for (const side of Object.values(this.sides)) {
      side.view.rig.frame();
      side.sphereView.rig.frame();
    }
  }

  /** Asks for new colours, at the next picture. */
  fade(): void {
    this.#faded = true;
    this.#stage.invalidate();
  }

  #join(side: Side, models: Models): void {
    this.#stage.add(side.view);
    this.#stage.add(side.sphereView);
    this.#gestures.push(new Gestures(side.view, this.#taker(side), () => false));
    this.#gestures.push(new Gestures(side.sphereView, NO_TAKER, () => false));
    models[side.slot].watch((model) => {
      side.show(model);
      this.#showSphere(side);
      this.#settled(this.#session.state.value);
      this.fade();
    });
  }

  #showSphere(side: Side): void {
    side.showSphere(this.laid.value);
    this.hasSpheres.value = Object.values(this.sides).some((one) => one.hasSphere);
  }

  #link(linked: boolean): void {
    const { target } = this.sides;
    if (linked) target.view.rig = this.#rig;
    else {
      target.view.rig = this.#rig.copy();
      this.#stage.follow(target.view.rig);
    }
    this.#stage.invalidate();
  }

  #taker(side: Side): Taker {
    const pick = (x: number, y: number): number | null => side.model?.picker.near(side.view, { x, y })?.vertex ?? null;
    return {
      down: (event): Grip | null => {
        const start = side.view.spot(event);
        const mark = side.marks.at(start);
        if (mark !== null && mark < (this.#session.state.value?.markers.length ?? 0)) return this.#dragMark(side, mark, pick);
        return this.tool.value === "marker" && pick(start.x, start.y) !== null ? this.#click(side, start, pick) : null;
      },
      hover: () => undefined,
      enter: () => {
        const { width, height } = side.view.size;
        const vertex = pick(width / 2, height / 2);
        if (vertex !== null) this.#chosen(side.slot, vertex);
      },
      doubleClick: () => undefined,
    };
  }

  #click(side: Side, start: { x: number; y: number }, pick: (x: number, y: number) => number | null): Grip {
    let last = start;
    let moved = false;
    return {
      move: (event) => {
        const now = side.view.spot(event);
        moved ||= Math.hypot(now.x - start.x, now.y - start.y) > CLICK_SLOP_PX;
        if (moved) side.view.rig.turn((now.x - last.x) / side.view.size.height, (now.y - last.y) / side.view.size.height);
        last = now;
      },
      end: () => {
        const vertex = moved ? null : pick(start.x, start.y);
        if (vertex !== null) this.#chosen(side.slot, vertex);
      },
      cancel: () => undefined,
    };
  }

  #dragMark(side: Side, index: number, pick: (x: number, y: number) => number | null): Grip {
    let vertex: number | null = null;
    const drop = (): void => {
      side.marks.drag(index, null);
      this.#stage.invalidate();
    };
    return {
      move: (event) => {
        const spot = side.view.spot(event);
        vertex = pick(spot.x, spot.y) ?? vertex;
        side.marks.drag(index, vertex);
        this.#stage.invalidate();
      },
      end: () => {
        if (vertex !== null) void this.#session.ask({ type: "marker.move", index, slot: side.slot, vertex }).then(drop);
        else drop();
      },
      cancel: drop,
    };
  }

  #chosen(slot: MeshSlot, vertex: number): void {
    const first = this.pending.value;
    if (!first || first.slot === slot) {
      this.pending.value = { slot, vertex };
      return;
    }
    this.pending.value = null;
    const pair = { [first.slot]: first.vertex, [slot]: vertex } as Record<MeshSlot, number>;
    void this.#session.ask({ type: "marker.add", ...pair });
  }

  #settled(state: State | null): void {
    for (const side of Object.values(this.sides))
      side.marks.show(side.model?.surface ?? null, side.model ? this.#marks(side.slot, state) : []);
    this.#stage.invalidate();
  }

  #marks(slot: MeshSlot, state: State | null): Mark[] {
    const markers = state?.markers ?? [];
    const marks = markers.map((pair, index): Mark => ({ vertex: pair[slot], text: String(index + 1), index }));
    const pending = this.pending.value;
    if (pending?.slot === slot) marks.push({ vertex: pending.vertex, text: String(markers.length + 1), index: markers.length });
    const own = new Set(markers.map((pair) => pair[slot]));
    const found = (state?.match?.pairs ?? []).filter((pair) => !own.has(pair[slot]));
    return [...marks, ...found.map((pair, index): Mark => ({ vertex: pair[slot], text: "", index: markers.length + index }))];
  }

  #recolour(): void {
    if (!this.#faded) return;
    this.#faded = false;
    for (const side of Object.values(this.sides)) side.paint(this.#colour(side));
  }

  #colour({ slot, model }: Side): (vertex: number) => Rgb {
    const how = this.colours.value;
    const { labels, images } = model ?? {};
    if (how === "regions" && labels) {
      const colours = regionColours(slot, this.#session.state.value);
      return (vertex) => colours.get(labels[vertex] ?? -1) ?? OUTSIDE;
    }
    const target = this.sides.target.model?.surface.positions;
    const places = slot === "target" ? target : images;
    if (how === "map" && places && target) return placeColour(places, target);
    return () => CLAY;
  }
}

/** Regions that go together have one colour; those without a partner are darker than what is outside. */
function regionColours(slot: MeshSlot, state: State | null): Map<number, Rgb> {
  const pairs = state?.regions?.pairs ?? [];
  return new Map(pairs.map((pair, index) => [pair[slot === "source" ? 0 : 1], qualitative(index)]));
}

const NO_TAKER: Taker = { down: () => null, hover: () => undefined, enter: () => undefined, doubleClick: () => undefined };
