/** Puts the page together. */
import "./styles/base.css";
import "./styles/controls.css";
import "./styles/layout.css";
import { Camera } from "three";
import { Cell } from "./cell";
import { el, show } from "./dom";
import { installHook } from "./hook";
import { Models } from "./models";
import { busyLine, head, lossBanner, noGraphics, sheetHandle } from "./page";
import { editPanel } from "./panels/edit";
import { Files } from "./panels/files";
import { welcome } from "./panels/welcome";
import { jobTray } from "./panels/job";
import { matchPanel } from "./panels/match";
import { morphPanel } from "./panels/morph";
import { EditScene } from "./scenes/edit";
import { MatchScene } from "./scenes/match";
import { MorphScene } from "./scenes/morph";
import type { Slot } from "./protocol";
import { Session } from "./session";
import { type Shortcut, Shortcuts } from "./shortcuts";
import { editShortcuts, editWorkspace } from "./workspaces/edit";
import { matchShortcuts, matchWorkspace } from "./workspaces/match";
import { morphShortcuts, morphWorkspace } from "./workspaces/morph";
import { Tabs } from "./ui/tabs";
import { Toasts } from "./ui/toasts";
import { Body } from "./view/body";
import { Stage } from "./view/stage";
import { Surface } from "./view/surface";
import type { View } from "./view/view";

export type TabName = "edit" | "match" | "morph";

/** Where there is no WebGL the page says so, and is nothing else. */
function opened(make: () => Stage): Stage {
  try {
    return make();
  } catch (error) {
    document.body.replaceChildren(noGraphics());
    throw error;
  }
}

const session = new Session(location);
session.connection.open(); // what comes waits until all below is there
const toasts = new Toasts();
session.onFailure(({ needed, found, advice }) => toasts.warn(`Needed ${needed}; found ${found}.`, advice));

const stage = opened(() => new Stage());
stage.announce(new Body(Surface.none()).object, new Camera()); // while the mesh is on its way
const models = new Models(session);
const edit = new EditScene(stage, session, models);
const match = new MatchScene(stage, session, models);
const morph = new MorphScene(stage, session, models);
const files = new Files(session, (text) => toasts.tell(text));
const tab = new Cell<TabName>("edit");

const editing = editPanel(session, edit);
const panels: Record<TabName, HTMLElement> = {
  edit: editing.element,
  match: matchPanel(session, match, files),
  morph: morphPanel(session, morph, () => tabs.choose("match")),
};
const places: Record<TabName, HTMLElement> = {
  edit: editWorkspace(session, edit),
  match: matchWorkspace(session, match, files),
  morph: morphWorkspace(session, morph),
};
const NAMES: Record<TabName, string> = { edit: "Edit", match: "Match", morph: "Morph" };
const TAB_NAMES = Object.keys(NAMES) as TabName[];
const tabs: Tabs<TabName> = new Tabs(
  "What to do",
  TAB_NAMES.map((id) => ({ id, label: NAMES[id], panel: panels[id] })),
  (id) => (tab.value = id),
);

const on = (where: TabName, list: Shortcut[]): Shortcut[] => list.map((one) => ({ ...one, where }));
const shortcuts: Shortcuts = new Shortcuts(
  [
    ...on("edit", editShortcuts(session, edit, editing)),
    ...on("match", matchShortcuts(match)),
    ...on("morph", morphShortcuts(morph)),
    { keys: "Ctrl+Z", does: "undo", group: "Everywhere", run: () => void session.ask({ type: "undo" }) },
    { keys: "Ctrl+Shift+Z", does: "redo", group: "Everywhere", run: () => void session.ask({ type: "redo" }) },
    { keys: "Ctrl+O", does: "open", group: "Everywhere", run: () => files.showOpen() },
    { keys: "Ctrl+S", does: "save", group: "Everywhere", run: () => files.showSave() },
    { keys: "?", does: "this sheet", group: "Everywhere", run: () => shortcuts.help() },
  ],
  () => tab.value,
);

const over = [welcome(session, files), busyLine(session.waiting), lossBanner(session.connection), toasts.element];
const workspace = el("main", { class: "workspace" }, stage.element, ...Object.values(places), ...over);
const does = { open: () => files.showOpen(), save: () => files.showSave(), help: () => shortcuts.help() };
const sidebar = el(
  "aside",
  { class: "sidebar", "aria-label": "Controls" },
  head(session.connection, does),
  tabs.list,
  ...Object.values(panels),
  jobTray(session),
);
sidebar.prepend(sheetHandle(sidebar));
document.body.append(workspace, sidebar);
tab.watch((name) => {
  for (const id of TAB_NAMES) show(places[id], id === name);
  stage.invalidate();
});
tabs.choose("edit");
const VIEWS: Record<TabName, (slot: Slot) => View> = {
  edit: () => edit.view,
  match: (slot) => (slot === "target" ? match.sides.target.view : match.sides.source.view),
  morph: () => morph.view,
};
installHook(session, models, stage, edit, (slot) => VIEWS[tab.value](slot));
