/** The large part of the Match tab: meshes above, spheres below, A on the left. */
import { el, show } from "../dom";
import type { Files } from "../panels/files";
import type { MatchScene, MatchTool } from "../scenes/match";
import type { Session } from "../session";
import type { Shortcut } from "../shortcuts";
import { button } from "../ui/controls";
import { Guide } from "../ui/guide";
import { historyButtons } from "../ui/history";
import { type Tool, Toolbar } from "../ui/toolbar";

const TOOLS: readonly (readonly Tool<MatchTool>[])[] = [
  [
    { id: "look", label: "Look around", icon: "look", keys: "v" },
    { id: "marker", label: "Set markers", icon: "marker", keys: "m" },
  ],
];

export function matchWorkspace(session: Session, scene: MatchScene, files: Files): HTMLElement {
  const guide = new Guide();
  const frame = button({ label: "Show all", icon: "frame", iconOnly: true, keys: "Home", look: "quiet", onClick: () => scene.frame() });
  const toolbar = new Toolbar("Tools", TOOLS, (tool) => (scene.tool.value = tool), historyButtons(session), [frame]);
  scene.tool.watch((tool) => toolbar.press(tool));
  const { source, target } = scene.sides;
  const empty = el(
    "div",
    { class: "missing", "data-slot": "target" },
    el("p", {}, "Mesh B is not open."),
    button({ label: "Open mesh B", icon: "open", look: "primary", onClick: () => files.showOpen() }),
  );
  const cells = [source.view.element, target.view.element, source.sphereView.element, target.sphereView.element];
  const titles = ["A", "B", "Sphere of A", "Sphere of B"];
  const grid = el(
    "div",
    { class: "quad" },
    ...cells.map((view, index) =>
      el("div", { class: "cell" }, view, el("span", { class: "cell-title", "aria-hidden": "true" }, titles[index] ?? "")),
    ),
  );
  grid.children[1]?.append(empty);
  const promise = el("div", { class: "missing" }, el("p", {}, "The spheres come with the match."));
  grid.children[2]?.append(promise);
  scene.hasSpheres.watch((has) => show(promise, !has));
  scene.shown.watch((shown) => (grid.dataset["shown"] = shown));
  const tell = (): void => {
    const state = session.state.value;
    const both = state?.meshes.source != null && state.meshes.target !== null;
    show(empty, state?.meshes.source != null && state.meshes.target === null);
    show(toolbar.element, both);
    const pending = scene.pending.value;
    guide.say(
      !both
        ? null
        : pending
          ? `Now click the same place on mesh ${pending.slot === "source" ? "B" : "A"}.`
          : scene.tool.value === "marker"
            ? "Click a place on one mesh, then the same place on the other."
            : null,
    );
  };
  session.state.watch(tell);
  scene.pending.watch(tell);
  scene.tool.watch(tell);
  return el("div", { class: "place" }, grid, toolbar.element, guide.element);
}

export function matchShortcuts(scene: MatchScene): Shortcut[] {
  const tools = TOOLS.flat().map(({ id, label, keys }): Shortcut => ({
    keys,
    does: label.toLowerCase(),
    group: "Tools",
    run: () => (scene.tool.value = id),
  }));
  return [
    ...tools,
    { keys: "Home", does: "show all", group: "View", run: () => scene.frame() },
    { keys: "Escape", does: "drop what is being done", group: "Edits", run: () => void scene.cancel() },
  ];
}
