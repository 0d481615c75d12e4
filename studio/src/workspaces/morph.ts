/** The large part of the Morph tab: the shape, and the time under it. */
import { el, show } from "../dom";
import type { MorphScene } from "../scenes/morph";
import type { Session } from "../session";
import type { Shortcut } from "../shortcuts";
import { button, slider } from "../ui/controls";
import { icon } from "../ui/icons";

const STEP = 0.001;
const KEY_STEP = 0.02;

export function morphWorkspace(session: Session, scene: MorphScene): HTMLElement {
  const play = button({
    label: "Play",
    icon: "play",
    iconOnly: true,
    keys: "Space",
    look: "primary",
    onClick: () => (scene.playing.value = !scene.playing.value),
  });
  scene.playing.watch((on) => {
    play.firstElementChild?.replaceWith(icon(on ? "pause" : "play"));
    play.setAttribute("aria-label", on ? "Pause" : "Play");
  });
  const time = slider({
    label: "Time",
    min: 0,
    max: 1,
    step: STEP,
    value: 0,
    format: (value) => value.toFixed(2),
    onInput: (value) => {
      scene.scrub(true);
      scene.go(value);
    },
    onChange: () => scene.scrub(false),
  });
  scene.time.watch((value) => (time.value = value));
  const scrubber = el(
    "div",
    { class: "scrubber" },
    play,
    el("span", { class: "letter" }, "A"),
    time.element,
    el("span", { class: "letter" }, "B"),
  );
  const empty = el(
    "div",
    { class: "missing" },
    el("h2", {}, "No morph yet"),
    el("p", {}, "Open two meshes, match them, then prepare the morph."),
  );
  session.state.watch((state) => {
    show(scrubber, state?.morph != null);
    show(empty, state?.meshes.source != null && state.morph === null);
  });
  return el("div", { class: "place" }, scene.view.element, empty, scrubber);
}

export function morphShortcuts(scene: MorphScene): Shortcut[] {
  const step = (by: number): void => scene.go(Math.min(1, Math.max(0, scene.time.value + by)));
  return [
    { keys: " ", does: "play or pause", group: "Morph", run: () => (scene.playing.value = !scene.playing.value) },
    { keys: ",", does: "a little back", group: "Morph", run: () => step(-KEY_STEP) },
    { keys: ".", does: "a little on", group: "Morph", run: () => step(KEY_STEP) },
    { keys: "Home", does: "show all", group: "View", run: () => scene.view.rig.frame() },
  ];
}
