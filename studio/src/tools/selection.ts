/** The tools that choose vertices: click, brush, rectangle, lasso. */
import { el, show, svg } from "../dom";
import type { PaintMode } from "../protocol";
import type { Grip } from "../view/gestures";
import type { Picker } from "../view/picking";
import type { Spot, View } from "../view/view";

export type SelectionTool = "click" | "brush" | "rectangle" | "lasso";

export interface Brush {
  tool: SelectionTool;
  /** Radius of the brush, in pixels. */
  radius: number;
  /** Rectangle and lasso take what is hidden too. */
  through: boolean;
  mode: PaintMode;
}

export interface Canvas {
  view: View;
  picker: Picker;
  /** Shows vertices at once, before the server has them. */
  preview(vertices: number[], mode: PaintMode): void;
  paint(vertices: number[], mode: PaintMode): void;
  revert(): void;
}

const CLICK_SLOP_PX = 5;

/** Shift adds, Alt erases, whatever the sidebar says. */
export function modeOf(event: { shiftKey: boolean; altKey: boolean }, brush: Brush): PaintMode {
  if (event.altKey) return "erase";
  return event.shiftKey ? "add" : brush.mode;
}

export class Selection {
  readonly overlay: HTMLElement;
  readonly #ring = el("div", { class: "brush-ring", hidden: true });
  readonly #outline = svg("polygon", { class: "outline" });

  constructor() {
    const drawing = svg("svg", { class: "outlines", "aria-hidden": "true" }, this.#outline);
    this.overlay = el("div", { class: "overlay" }, drawing as unknown as Node, this.#ring);
  }

  /** The ring that shows what a brush would take. */
  hover(spot: Spot | null, brush: Brush): void {
    show(this.#ring, spot !== null && brush.tool === "brush");
    if (!spot) return;
    const { style } = this.#ring;
    style.width = style.height = `${2 * brush.radius}px`;
    style.transform = `translate(${spot.x - brush.radius}px, ${spot.y - brush.radius}px)`;
  }

  /** Starts a stroke; null where there is nothing to take, so that the camera may. */
  down(event: PointerEvent, canvas: Canvas, brush: Brush): Grip | null {
    const mode = modeOf(event, brush);
    const start = canvas.view.spot(event);
    if (brush.tool === "rectangle" || brush.tool === "lasso") return this.#outlined(start, canvas, brush, mode);
    if (!canvas.picker.near(canvas.view, start)) return null;
    return brush.tool === "click" ? this.#click(start, canvas, mode) : this.#stroke(event, canvas, brush, mode);
  }

  /** A click in the middle of the view, by the keyboard. */
  enter(canvas: Canvas, brush: Brush): void {
    const { width, height } = canvas.view.size;
    const hit = canvas.picker.near(canvas.view, { x: width / 2, y: height / 2 });
    if (!hit) return;
    const radius = brush.radius * canvas.view.pixelSize(hit.point);
    canvas.paint(brush.tool === "click" ? [hit.vertex] : canvas.picker.around(hit, radius), brush.mode);
  }

  #click(start: Spot, canvas: Canvas, mode: PaintMode): Grip {
    return {
      move: () => undefined,
      end: (event) => {
        const spot = canvas.view.spot(event);
        const hit = Math.hypot(spot.x - start.x, spot.y - start.y) > CLICK_SLOP_PX ? null : canvas.picker.near(canvas.view, spot);
        if (hit) canvas.paint([hit.vertex], mode);
      },
      cancel: () => undefined,
    };
  }

  #stroke(first: PointerEvent, canvas: Canvas, brush: Brush, mode: PaintMode): Grip {
    const painted = new Set<number>();
    const dab = (event: PointerEvent): void => {
      const spot = canvas.view.spot(event);
      this.hover(spot, brush);
      const hit = canvas.picker.near(canvas.view, spot);
      if (!hit) return;
      const fresh = canvas.picker.around(hit, brush.radius * canvas.view.pixelSize(hit.point)).filter((vertex) => !painted.has(vertex));
      for (const vertex of fresh) painted.add(vertex);
      if (fresh.length) canvas.preview([...painted], mode);
    };
    dab(first);
    return {
      move: (event) => {
        const between = event.getCoalescedEvents();
        for (const each of between.length ? between : [event]) dab(each);
      },
      end: () => {
        if (painted.size) canvas.paint([...painted], mode);
        else canvas.revert();
      },
      cancel: () => canvas.revert(),
    };
  }

  #outlined(start: Spot, canvas: Canvas, brush: Brush, mode: PaintMode): Grip {
    let corners: Spot[] = [start];
    const draw = (): void => this.#outline.setAttribute("points", corners.map(({ x, y }) => `${x},${y}`).join(" "));
    const clear = (): void => this.#outline.removeAttribute("points");
    return {
      move: (event) => {
        const now = canvas.view.spot(event);
        corners = brush.tool === "lasso" ? [...corners, now] : [start, { x: now.x, y: start.y }, now, { x: start.x, y: now.y }];
        draw();
      },
      end: () => {
        clear();
        const vertices = corners.length > 2 ? canvas.picker.inside(canvas.view, (spot) => within(corners, spot), brush.through) : [];
        if (vertices.length) canvas.paint(vertices, mode);
      },
      cancel: clear,
    };
  }
}

/** Whether a spot is inside a polygon: a ray to the right crosses it an odd number of times. */
export function within(corners: readonly Spot[], { x, y }: Spot): boolean {
  let inside = false;
  corners.forEach((a, index) => {
    const b = corners[(index + 1) % corners.length] ?? a;
    if (a.y > y !== b.y > y && x < a.x + ((y - a.y) * (b.x - a.x)) / (b.y - a.y)) inside = !inside;
  });
  return inside;
}
