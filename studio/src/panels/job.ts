/** What the studio is busy with, at the foot of the sidebar, with a way to stop it. */
import { el, show } from "../dom";
import type { Session } from "../session";
import { progress } from "../ui/controls";

const TITLES: Record<string, string> = { regions: "Feature regions", correspond: "Matching", morph: "Morph", kernels: "Getting ready" };

export function jobTray(session: Session): HTMLElement {
  const bar = progress("Progress", () => session.tell({ type: "cancel" }));
  const upload = el("progress", { max: 1, "aria-label": "Upload" });
  const sending = el("div", { class: "progress", hidden: true }, el("p", { class: "hint" }, "Sending the file…"), upload);
  session.job.watch((job) => {
    if (job) bar.set(`${TITLES[job.kind] ?? job.kind}: ${job.stage}`, job.share);
    else bar.end();
  });
  session.upload.watch((share) => {
    show(sending, share !== null);
    upload.value = share ?? 0;
  });
  return el("div", { class: "tray" }, sending, bar.element);
}
