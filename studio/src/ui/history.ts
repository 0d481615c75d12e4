/** Undo and redo, which say what they would undo and redo. */
import type { Session } from "../session";
import { button } from "./controls";

export function historyButtons(session: Session): HTMLElement[] {
  const undo = button({
    label: "Undo",
    icon: "undo",
    iconOnly: true,
    keys: "Ctrl+Z",
    look: "quiet",
    onClick: () => void session.ask({ type: "undo" }),
  });
  const redo = button({
    label: "Redo",
    icon: "redo",
    iconOnly: true,
    keys: "Ctrl+Shift+Z",
    look: "quiet",
    onClick: () => void session.ask({ type: "redo" }),
  });
  session.state.watch((state) => {
    const { undo: last, redo: next } = state?.history ?? { undo: null, redo: null };
    undo.disabled = last === null;
    redo.disabled = next === null;
    undo.title = last === null ? "Nothing to undo" : `Undo: ${last} (Ctrl+Z)`;
    redo.title = next === null ? "Nothing to redo" : `Redo: ${next} (Ctrl+Shift+Z)`;
  });
  return [undo, redo];
}
