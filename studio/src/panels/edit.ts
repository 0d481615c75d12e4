/** The Edit tab: paint, region, method, symmetry, exact numbers, poses, looks. */
import { el, show } from "../dom";
import type { Axis, PaintMode, Plane, Role } from "../protocol";
import type { EditLook, EditScene } from "../scenes/edit";
import type { Session } from "../session";
import type { Up } from "../view/rig";
import { button, choice, section, select, slider, toggle } from "../ui/controls";
import { exactPanel, posesPanel } from "./exact";
import { MethodPanel } from "./method";
import { RegionPanel } from "./region";

export const BRUSH_RANGE_PX = { min: 6, max: 120, step: 1 };

export interface EditPanel {
  element: HTMLElement;
  /** By keys: another size of the brush. */
  resizeBrush(factor: number): void;
}

export function editPanel(session: Session, scene: EditScene): EditPanel {
  const brush = slider({
    ...BRUSH_RANGE_PX,
    label: "Brush size",
    value: scene.brush.radius,
    format: (radius) => `${radius} px`,
    onInput: (radius) => (scene.brush.radius = radius),
  });
  const element = el(
    "div",
    { class: "panel" },
    paintSection(session, scene, brush.element),
    new RegionPanel(session).element,
    new MethodPanel(session).element,
    symmetrySection(session),
    looksSection(scene),
    posesPanel(session),
    exactPanel(session),
  );
  session.state.watch((state) => element.toggleAttribute("inert", !state?.edit));
  return {
    element,
    resizeBrush(factor) {
      brush.value = Math.round(scene.brush.radius * factor);
      scene.brush.radius = brush.value;
    },
  };
}

function paintSection(session: Session, scene: EditScene, brush: HTMLElement): HTMLElement {
  const roles: { value: Role; label: string; swatch: string }[] = [
    { value: "handle", label: "Handle", swatch: "handle" },
    { value: "free", label: "Free", swatch: "free" },
    { value: "anchor", label: "Anchor", swatch: "anchor" },
  ];
  const modes: { value: PaintMode; label: string }[] = [
    { value: "set", label: "New" },
    { value: "add", label: "Add" },
    { value: "erase", label: "Erase" },
  ];
  const role = choice<Role>("Paint", roles, "handle", (value) => (scene.role.value = value));
  scene.role.watch((value) => (role.value = value));
  const mode = choice<PaintMode>("Each stroke", modes, scene.brush.mode, (value) => (scene.brush.mode = value));
  const through = toggle("Rectangle and lasso go through", false, (on) => (scene.brush.through = on));
  const clear = button({
    label: "Clear this paint",
    icon: "trash",
    onClick: () => void session.ask({ type: "paint", role: scene.role.value, mode: "set", vertices: [] }),
  });
  session.state.watch((state) => (clear.disabled = !state?.edit?.painted[scene.role.value]));
  scene.role.watch((value) => (clear.disabled = !session.state.value?.edit?.painted[value]));
  scene.tool.watch((tool) => show(brush, tool === "brush"));
  return section("Paint the mesh", role.element, mode.element, brush, through.element, clear);
}

function symmetrySection(session: Session): HTMLElement {
  const options: { value: Axis | "off"; label: string }[] = [
    { value: "off", label: "Off" },
    { value: "x", label: "x" },
    { value: "y", label: "y" },
    { value: "z", label: "z" },
  ];
  const axis = choice(
    "Mirror the handle across",
    options,
    "off",
    (value) => void session.ask({ type: "symmetry", plane: value === "off" ? null : { axis: value } }),
  );
  session.state.watch((state) => {
    axis.value = axisOf(state?.edit?.symmetry ?? null);
  });
  return section("Symmetry", axis.element);
}

/** The server tells planes by a point and their normal. */
function axisOf(plane: Plane | null): Axis | "off" {
  if (!plane) return "off";
  if ("axis" in plane) return plane.axis;
  return (["x", "y", "z"] as const)[plane.normal.findIndex((part) => Math.abs(part) === 1)] ?? "off";
}

function looksSection(scene: EditScene): HTMLElement {
  const looks: { value: EditLook; label: string }[] = [
    { value: "smooth", label: "Smooth" },
    { value: "flat", label: "Flat" },
    { value: "wire", label: "Wires" },
    { value: "distortion", label: "Distortion" },
  ];
  const look = select("Shading", looks, scene.look.value, (value) => (scene.look.value = value));
  scene.look.watch((value) => (look.value = value));
  const ups: { value: Up; label: string }[] = [
    { value: "y", label: "y" },
    { value: "z", label: "z" },
  ];
  const up = choice("Up is", ups, "y", (value) => scene.view.rig.stand(value));
  return section("View", look.element, up.element);
}
