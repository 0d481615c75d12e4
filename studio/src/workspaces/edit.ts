/** The large part of the Edit tab: the view, its tools, what to do now, numbers and legend. */
import { el, show } from "../dom";
import type { EditPanel } from "../panels/edit";
import type { Role, State } from "../protocol";
import { type EditLook, type EditScene, type EditTool, MOST_DISTORTION } from "../scenes/edit";
import type { Session } from "../session";
import type { Shortcut } from "../shortcuts";
import { button } from "../ui/controls";
import { Figures } from "../ui/figures";
import { Guide, type Tone } from "../ui/guide";
import { historyButtons } from "../ui/history";
import { roleLegend, scaleLegend } from "../ui/legend";
import { type Tool, Toolbar } from "../ui/toolbar";

const TOOLS: readonly (readonly Tool<EditTool>[])[] = [
  [{ id: "look", label: "Look around", icon: "look", keys: "v" }],
  [
    { id: "click", label: "Pick single vertices", icon: "click", keys: "c" },
    { id: "brush", label: "Brush", icon: "brush", keys: "b" },
    { id: "rectangle", label: "Rectangle", icon: "rectangle", keys: "x" },
    { id: "lasso", label: "Lasso", icon: "lasso", keys: "l" },
  ],
  [
    { id: "translate", label: "Move the handle", icon: "move", keys: "g" },
    { id: "rotate", label: "Turn the handle", icon: "rotate", keys: "r" },
    { id: "scale", label: "Scale the handle", icon: "scale", keys: "s" },
  ],
];
const LOOKS: readonly EditLook[] = ["smooth", "flat", "wire", "distortion"];
const BRUSH_STEP = 1.25;
const HAS_KEYS = matchMedia("(hover: hover)").matches;
const READY = HAS_KEYS ? "Ready: press G to move the handle, R to turn it, S to scale it." : "Ready: move, turn or scale the handle.";

export function editWorkspace(session: Session, scene: EditScene): HTMLElement {
  const figures = new Figures();
  const guide = new Guide();
  const legend = roleLegend();
  const scale = scaleLegend("Stretch", "none", `${Math.round(100 * (Math.exp(MOST_DISTORTION) - 1))} %`);
  const reset = button({
    label: "Reset this edit",
    icon: "reset",
    iconOnly: true,
    look: "quiet",
    onClick: () => void session.ask({ type: "reset", what: "transform" }),
  });
  const frame = button({
    label: "Show all",
    icon: "frame",
    iconOnly: true,
    keys: "Home",
    look: "quiet",
    onClick: () => scene.view.rig.frame(),
  });
  const toolbar = new Toolbar("Tools", TOOLS, (tool) => (scene.tool.value = tool), [...historyButtons(session), reset], [frame]);
  scene.tool.watch((tool) => toolbar.press(tool));
  const refresh = (): void => {
    const state = session.state.value;
    const edit = state?.edit;
    guide.say(...advice(state, scene.tool.value, session.hello.value?.client ?? null));
    legend.tell(edit?.handle.count ?? 0, edit?.free ?? 0, edit?.anchors ?? 0);
    reset.disabled = !edit;
    for (const element of [figures.element, toolbar.element, legend.element]) show(element, edit !== undefined && edit !== null);
    show(legend.element, edit != null && scene.look.value !== "distortion");
    show(scale, edit != null && scene.look.value === "distortion");
  };
  session.state.watch(refresh);
  scene.tool.watch(refresh);
  scene.look.watch(refresh);
  session.numbers.watch((numbers) => figures.tell(numbers));
  const foot = el("div", { class: "foot" }, legend.element, scale, figures.element);
  return el("div", { class: "place", "data-slot": "source" }, scene.view.element, toolbar.element, guide.element, foot);
}

/** What can be done now, in one line. */
function advice(state: State | null, tool: EditTool, me: number | null): [string | null, Tone?] {
  const edit = state?.edit;
  if (!state || !edit) return [null];
  if (state.drag !== null)
    return state.drag === me ? ["Dragging. Escape puts it back.", "busy"] : ["Another page is dragging the handle.", "busy"];
  if (edit.handle.count === 0) return ["Paint the handle: what you want to pull."];
  if (edit.problem) return [`${edit.problem.needed} is needed: ${edit.problem.advice}`, "problem"];
  const moves = tool === "translate" || tool === "rotate" || tool === "scale";
  return edit.ready && !moves ? [READY] : [moves ? "Drag an arrow, a ring or a square." : null];
}

export function editShortcuts(session: Session, scene: EditScene, panel: EditPanel): Shortcut[] {
  const tools = TOOLS.flat().map(({ id, label, keys }): Shortcut => ({
    keys,
    does: label.toLowerCase(),
    group: "Tools",
    run: () => (scene.tool.value = id),
  }));
  const roles = (["handle", "free", "anchor"] as const).map((role: Role, index): Shortcut => ({
    keys: String(index + 1),
    does: `paint ${role}`,
    group: "Paint",
    run: () => (scene.role.value = role),
  }));
  const nextLook = (): EditLook => LOOKS[(LOOKS.indexOf(scene.look.value) + 1) % LOOKS.length] ?? "smooth";
  return [
    ...tools,
    ...roles,
    { keys: "[", does: "smaller brush", group: "Paint", run: () => panel.resizeBrush(1 / BRUSH_STEP) },
    { keys: "]", does: "larger brush", group: "Paint", run: () => panel.resizeBrush(BRUSH_STEP) },
    { keys: "w", does: "next shading", group: "View", run: () => (scene.look.value = nextLook()) },
    { keys: "Home", does: "show all", group: "View", run: () => scene.view.rig.frame() },
    { keys: "p", does: "keep this pose", group: "Edits", run: () => void session.ask({ type: "pose.keep" }) },
    { keys: "Escape", does: "put a drag or a stroke back", group: "Edits", run: () => void scene.cancel() },
  ];
}
