/** The handle's way in numbers, and kept poses. */
import { Euler, MathUtils, Quaternion } from "three";
import { el, show } from "../dom";
import type { Session } from "../session";
import { button, section, triple } from "../ui/controls";
import type { Quadruple, State, Transform, Triple } from "../protocol";

const DIGITS = 4;

export function exactPanel(session: Session): HTMLElement {
  const axes = ["x", "y", "z"] as const;
  const move = triple("Move", axes, 0, 0.01);
  const turn = triple("Turn (degrees)", axes, 0, 1);
  const scale = triple("Scale", axes, 1, 0.01);
  const apply = button({ label: "Apply", onClick: () => void session.ask({ type: "transform", transform: read() }) });
  const read = (): Transform => ({ translate: move.value, rotate: quaternionOf(turn.value), scale: scale.value });
  const element = el(
    "details",
    { class: "section" },
    el("summary", {}, "Exact move"),
    el("div", { class: "stack" }, move.element, turn.element, scale.element, apply),
  );
  element.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && event.target instanceof HTMLInputElement) void session.ask({ type: "transform", transform: read() });
  });
  session.state.watch((state) => {
    const transform = state?.edit?.transform;
    apply.disabled = !state?.edit?.ready;
    if (!transform || element.contains(document.activeElement)) return;
    move.value = rounded(transform.translate);
    turn.value = rounded(degreesOf(transform.rotate));
    scale.value = rounded(transform.scale);
  });
  return element;
}

export function posesPanel(session: Session): HTMLElement {
  const list = el("ul", { class: "items" });
  const keep = button({ label: "Keep this pose", icon: "plus", onClick: () => void session.ask({ type: "pose.keep" }) });
  const none = el("p", { class: "hint" }, "Kept poses go together into one animation: Save, Poses.");
  const tell = (state: State | null): void => {
    keep.disabled = !state?.meshes.source;
    show(none, !state?.poses.length);
    list.replaceChildren(
      ...(state?.poses ?? []).map(({ name }, index) => {
        const remove = button({
          label: `Remove ${name}`,
          icon: "close",
          iconOnly: true,
          look: "quiet",
          onClick: () => void session.ask({ type: "pose.remove", index }),
        });
        return el("li", {}, el("span", {}, name), remove);
      }),
    );
  };
  session.state.watch(tell);
  return section("Poses", list, none, keep);
}

function quaternionOf(degrees: Triple): Quadruple {
  const [x, y, z] = degrees.map(MathUtils.degToRad) as Triple;
  const { x: a, y: b, z: c, w } = new Quaternion().setFromEuler(new Euler(x, y, z));
  return [a, b, c, w];
}

function degreesOf(quaternion: Quadruple): Triple {
  const { x, y, z } = new Euler().setFromQuaternion(new Quaternion(...quaternion));
  return [x, y, z].map(MathUtils.radToDeg) as Triple;
}

function rounded(values: Triple): Triple {
  return values.map((value) => Number(value.toFixed(DIGITS))) as Triple;
}
